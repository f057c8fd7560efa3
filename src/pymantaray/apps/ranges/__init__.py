"""Ranges of existing trajectories."""
