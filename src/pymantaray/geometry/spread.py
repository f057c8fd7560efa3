"""Spread of values with outliers."""

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal quantity over its median absolute deviation."""
