"""ROS's axes, REP-103: the world's x, y, z are east, north, up, a body's forward, left, up. Nowhere else are they used."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def swap_enu(place: ArrayLike) -> Array:
    """North, east, down (..., 3) of east, north, up, and the other way round. [m]"""
    p = np.asarray(place, dtype=float)
    return np.asarray(p[..., [1, 0, 2]] * [1.0, 1.0, -1.0])


def swap_enu_attitude(quaternion: ArrayLike) -> Array:
    """
    Body (forward, right, down) to north, east, down of body (forward, left, up) to east, north, up, and the other way round.

    Quaternions (..., 4) are (w, x, y, z). The turn of the world, half of one about the line between north and east, stands
    before, that of the body, half of one about forward, behind.
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=float), -1, 0)
    return np.asarray(np.stack([w + z, x + y, x - y, w - z], axis=-1) * np.sqrt(0.5))
