"""Spread of values: robust standard deviation and root mean square."""

import numpy as np

from pymantaray.arrays import Array

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def root_mean(squares: Array) -> float:
    """Root of the mean of squares; NaN without any."""
    return float(np.sqrt(squares.mean())) if squares.size else np.nan
