"""Acoustic ranges with refraction in ROS 2."""
