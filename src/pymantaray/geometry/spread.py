"""Spread of values: robust standard deviation and root mean square."""

import numpy as np
from numpy.typing import NDArray

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def root_mean(squares: NDArray[np.float64]) -> float:
    """Root of the mean of squares; NaN without any."""
    return float(np.sqrt(squares.mean())) if squares.size else np.nan
