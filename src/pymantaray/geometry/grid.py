"""Linear interpolation on a rectilinear grid, for all fields on local and geographic grids."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array


def linear_interpolator(
    axes: Sequence[ArrayLike], values: ArrayLike
) -> Callable[[ArrayLike], Array]:
    """
    Multilinear interpolator of values (n_1, ..., n_d, ...) on d increasing axes, as a function of
    coordinates (..., d).

    It is constant along an axis of one point and beyond the edges of the other axes. It can be
    pickled.
    """
    from scipy.interpolate import RegularGridInterpolator

    points = [np.asarray(axis, dtype=float) for axis in axes]
    field = np.asarray(values, dtype=float)
    varying = [k for k, axis in enumerate(points) if axis.size > 1]
    field = field.squeeze(axis=tuple(set(range(len(points))) - set(varying)))
    if not varying:
        return partial(_uniform, field)
    grid = [points[k] for k in varying]
    low, high = (np.array([axis[end] for axis in grid]) for end in (0, -1))
    return partial(_clipped, RegularGridInterpolator(grid, field), varying, low, high)


def _uniform(field: Array, at: ArrayLike) -> Array:
    return np.broadcast_to(field, (*np.shape(at)[:-1], *field.shape))


def _clipped(
    look_up: Callable[[Array], Array], axes: list[int], low: Array, high: Array, at: ArrayLike
) -> Array:
    return np.asarray(look_up(np.clip(np.asarray(at, dtype=float)[..., axes], low, high)))
