"""Where the two ends of every attempted range are."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.records import Measurements, Trajectories

Array = NDArray[np.float64]


def range_ends(truth: Trajectories, measurements: Measurements) -> tuple[Array, Array]:
    """
    True positions of transmitter and receiver of every attempted range.

    Parameters
    ----------
    truth : Trajectories
        Same vehicles and times as the measurements.
    measurements : Measurements
        Its range table names the participants.

    Returns
    -------
    transmitter, receiver : ndarray, shape (n_ranges, 3)
        North, east, down. [m]
    """
    n_agents = len(truth.name)

    def place(who: NDArray[np.int32]) -> Array:
        out = np.empty((who.size, 3))
        agent = who < n_agents
        out[agent] = truth.position[who[agent], measurements.range_sample[agent]]
        out[~agent] = measurements.landmark_position[who[~agent] - n_agents]
        return out

    return place(measurements.range_transmitter), place(measurements.range_receiver)
