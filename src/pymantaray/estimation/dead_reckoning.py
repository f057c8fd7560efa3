"""Dead reckoning: odometry composed from the first pose, nothing else."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix
from pymantaray.records import Measurements

Array = NDArray[np.float64]


def dead_reckon(measurements: Measurements) -> tuple[Array, Array]:
    """
    Trajectories that odometry alone gives, from the mean of each vehicle's first-pose prior.

    Parameters
    ----------
    measurements : Measurements

    Returns
    -------
    position : ndarray, shape (n_agents, n_times, 3)
        North, east, down in the local frame. [m]
    quaternion : ndarray, shape (n_agents, n_times, 4)
        Rotation body to world, (w, x, y, z) with w >= 0.

    Raises
    ------
    EstimationError
        If a vehicle has no first-pose prior or an odometry edge is not finite.
    """
    o = measurements
    for what, values in (
        ("first-pose prior", np.concatenate([o.first_position, o.first_quaternion], axis=1)),
        ("odometry", np.concatenate([o.odometry_rotation, o.odometry_translation], axis=2)),
    ):
        fine = np.isfinite(values).reshape(o.name.size, -1).all(axis=1)
        if not fine.all():
            raise EstimationError(
                f"vehicle {o.name[np.argmin(fine)]}: {what} is not finite; dead reckoning needs all of it"
            )
    n_agents, n_times = o.depth.shape
    step = matrix_from_quaternion(o.odometry_rotation)
    rotation = np.empty((n_times, n_agents, 3, 3))
    rotation[0] = matrix_from_quaternion(o.first_quaternion)
    for k in range(n_times - 1):
        np.matmul(rotation[k], step[:, k], out=rotation[k + 1])
    moved = np.einsum("taij,atj->ati", rotation[:-1], o.odometry_translation)
    position = np.concatenate([o.first_position[:, None], moved], axis=1).cumsum(axis=1)
    return position, quaternion_from_matrix(np.swapaxes(rotation, 0, 1))
