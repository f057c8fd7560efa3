"""Linear interpolation on a rectilinear grid, the one rule for every field on a local or geographic grid."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def linear_interpolator(axes: Sequence[ArrayLike], values: ArrayLike) -> Callable[[ArrayLike], Array]:
    """
    Values (..., ...) at coordinates (..., d), of values (n_1, ..., n_d, ...) on d rising axes.

    Multilinear; constant along an axis of one point and beyond the edges of the others.
    """
    from scipy.interpolate import RegularGridInterpolator

    points, field = [np.asarray(axis, dtype=float) for axis in axes], np.asarray(values, dtype=float)
    varying = [k for k, axis in enumerate(points) if axis.size > 1]
    field = field.squeeze(axis=tuple(set(range(len(points))) - set(varying)))
    if not varying:
        return lambda at: np.broadcast_to(field, (*np.shape(at)[:-1], *field.shape))
    grid = [points[k] for k in varying]
    low, high = ([axis[end] for axis in grid] for end in (0, -1))
    look_up = RegularGridInterpolator(grid, field)
    return lambda at: np.asarray(look_up(np.clip(np.asarray(at, dtype=float)[..., varying], low, high)))
