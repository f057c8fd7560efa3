"""
Conversion to and from ROS's axes, REP-103: world x, y, z are east, north, up; body x, y, z are
forward, left, up.
"""

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array


def swap_enu(place: ArrayLike) -> Array:
    """Convert east, north, up (..., 3) to north, east, down, or back. [m]"""
    p = np.asarray(place, dtype=float)
    return np.asarray(p[..., [1, 0, 2]] * [1.0, 1.0, -1.0])


def swap_enu_attitude(quaternion: ArrayLike) -> Array:
    """
    Convert attitudes of body (forward, left, up) in east, north, up to body (forward, right, down)
    in north, east, down, or back.

    Quaternions (..., 4) are (w, x, y, z). The rotation of the world, by pi about the bisector of
    north and east, multiplies from the left; the rotation of the body, by pi about forward,
    multiplies from the right.
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=float), -1, 0)
    return np.asarray(np.stack([w + z, x + y, x - y, w - z], axis=-1) * np.sqrt(0.5))
