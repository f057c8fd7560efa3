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
    Multilinear interpolator of values (n_1, ..., n_d, ...) on d increasing axes.

    It takes coordinates (..., d).

    It is constant along an axis of one point and beyond the edges of the other axes. It can be
    pickled.
    """
    from scipy.interpolate import RegularGridInterpolator

    points = [np.asarray(axis, dtype=float) for axis in axes]
    field = np.asarray(values, dtype=float)
    varying = [k for k, axis in enumerate(points) if axis.size > 1]
    field = field.squeeze(axis=tuple(set(range(len(points))) - set(varying)))
    if not varying:
        return partial(_repeat, field)
    grid = [points[k] for k in varying]
    low, high = (np.array([axis[end] for axis in grid]) for end in (0, -1))
    return partial(_look_up_clipped, RegularGridInterpolator(grid, field), varying, low, high)


def _repeat(field: Array, coordinates: ArrayLike) -> Array:
    return np.broadcast_to(field, (*np.shape(coordinates)[:-1], *field.shape))


def _look_up_clipped(
    look_up: Callable[[Array], Array],
    axes: list[int],
    low: Array,
    high: Array,
    coordinates: ArrayLike,
) -> Array:
    return np.asarray(look_up(np.clip(np.asarray(coordinates, dtype=float)[..., axes], low, high)))
