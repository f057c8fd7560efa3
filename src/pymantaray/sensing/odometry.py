"""Noise-free odometry: the motion from each sample to the next, in the body frame."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix
from pymantaray.records import Trajectories

Array = NDArray[np.float64]


def measure_odometry(truth: Trajectories) -> tuple[Array, Array]:
    """
    Relative poses ``T_k^-1 T_{k+1}``.

    Parameters
    ----------
    truth : Trajectories

    Returns
    -------
    rotation : ndarray, shape (n_agents, n_time - 1, 4)
        Quaternion (w, x, y, z) from body frame k + 1 to k, with w >= 0.
    translation : ndarray, shape (n_agents, n_time - 1, 3)
        Motion in body frame k. [m]
    """
    to_world = matrix_from_quaternion(truth.quaternion)
    to_body = np.swapaxes(to_world[:, :-1], -1, -2)
    moved = np.diff(truth.position, axis=1)
    return (
        quaternion_from_matrix(to_body @ to_world[:, 1:]),
        np.einsum("...ij,...j->...i", to_body, moved),
    )
