"""Noise-free GNSS fixes of surfaced vehicles."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import SensingError
from pymantaray.records import Trajectories


class Fixes(NamedTuple):
    """GNSS fixes by vehicle and sample."""

    agent: NDArray[np.int64]
    sample: NDArray[np.int64]
    position: NDArray[np.float64]


def measure_gnss(truth: Trajectories, *, gnss_depth: float = 1.0) -> Fixes:
    """
    Fix at each sample at which a vehicle is shallower than its antenna can reach.

    Parameters
    ----------
    truth : Trajectories
    gnss_depth : float
        A fix is had while the depth is smaller. [m]

    Returns
    -------
    Fixes
        Index of the vehicle, index of the sample, and the position there [m].

    Raises
    ------
    SensingError
        If the depth is negative or NaN.
    """
    if not gnss_depth >= 0.0:
        raise SensingError(f"gnss_depth is {gnss_depth:g} m; it must be zero or positive")
    agent, sample = np.nonzero(truth.position[..., 2] < gnss_depth)
    return Fixes(agent=agent, sample=sample, position=truth.position[agent, sample])
