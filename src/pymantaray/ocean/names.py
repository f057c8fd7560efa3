"""Names that stand for an ocean without a file."""

SYNTHETIC = "synthetic:"
"""Prefix of the name of a synthetic ocean, as in ``synthetic:fram``."""
