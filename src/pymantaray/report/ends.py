"""Where the two ends of every attempted range are."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.records import Observations, Trajectories

Array = NDArray[np.float64]


def range_ends(truth: Trajectories, observations: Observations) -> tuple[Array, Array]:
    """
    True positions of transmitter and receiver of every attempted range.

    Parameters
    ----------
    truth : Trajectories
        Same vehicles and times as the observations.
    observations : Observations
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
        out[agent] = truth.position[who[agent], observations.range_sample[agent]]
        out[~agent] = observations.landmark_position[who[~agent] - n_agents]
        return out

    return place(observations.range_transmitter), place(observations.range_receiver)
