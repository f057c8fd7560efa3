"""Noise-free depth sensors."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.records import Trajectories


def measure_depth(truth: Trajectories) -> NDArray[np.float64]:
    """
    Depth of every vehicle at every sample.

    Parameters
    ----------
    truth : Trajectories

    Returns
    -------
    ndarray, shape (n_agents, n_time)
        Positive down. [m]
    """
    return np.array(truth.position[..., 2])
