"""Checks and units of numbers that users give."""
