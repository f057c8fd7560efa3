"""
Interpolation of the mean slowness of a ray within one cell, from values and gradients at its
corners.
"""

from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array

REFERENCE_SLOWNESS = 1.0 / 1500.0  # s/m; a table stores the relative difference from it


class Interpolated(NamedTuple):
    """Value of a function and its derivatives by the three coordinates, shapes (n,) and (n, 3)."""

    value: Array
    gradient: Array


def interpolate(at: Array, size: Array, values: Array, gradients: Array) -> Interpolated:
    """
    Interpolate within cells: cubic along each axis from the values and gradients at the corners,
    linear across it.

    The three one-dimensional Hermite corrections are added to the trilinear interpolation, so that
    all cubic polynomials are reproduced and the error is of fourth order in the size of the cell.

    Parameters
    ----------
    at : ndarray, shape (n, 3)
        Position within each cell, from 0 to 1 along each axis.
    size : ndarray, shape (n, 3)
        Lengths of the edges.
    values : ndarray, shape (n, 8)
        Values at the corners; bit k of a corner's number is its side along axis k.
    gradients : ndarray, shape (n, 8, 3)
        Derivatives at the corners.

    Returns
    -------
    Interpolated
        Derivatives are those of the interpolating polynomial.
    """
    weight = np.stack([1.0 - at, at])
    slope = (-1.0, 1.0)
    value = np.zeros(len(at))
    derivative = np.zeros((3, len(at)))
    for corner in range(8):
        i = corner & 1
        j = corner >> 1 & 1
        k = corner >> 2 & 1
        a = weight[i, :, 0]
        b = weight[j, :, 1]
        c = weight[k, :, 2]
        f = values[:, corner]
        value += a * b * c * f
        derivative[0] += slope[i] * (b * c * f)
        derivative[1] += slope[j] * (a * c * f)
        derivative[2] += slope[k] * (a * b * f)
    for axis in range(3):
        _add_hermite(
            axis, at[:, axis], size[:, axis], weight, (values, gradients), (value, derivative)
        )
    return Interpolated(value, derivative.T / size)


def _add_hermite(
    axis: int,
    t: Array,
    length: Array,
    weight: Array,
    corners: tuple[Array, Array],
    sums: tuple[Array, Array],
) -> None:
    """
    Add the difference between cubic Hermite and linear interpolation along the four edges of an
    axis.
    """
    values, gradients = corners
    value, derivative = sums
    u = (axis + 1) % 3
    v = (axis + 2) % 3
    left = t * (1.0 - t) * (1.0 - t)
    right = t * t * (1.0 - t)
    left_slope = (1.0 - t) * (1.0 - 3.0 * t)
    right_slope = t * (2.0 - 3.0 * t)
    for side in range(4):
        p = side & 1
        q = side >> 1
        low = (p << u) + (q << v)
        high = low + (1 << axis)
        step = values[:, high] - values[:, low]
        first = gradients[:, low, axis] * length - step
        last = step - gradients[:, high, axis] * length
        excess = left * first + right * last
        a = weight[p, :, u]
        b = weight[q, :, v]
        value += a * b * excess
        derivative[axis] += a * b * (left_slope * first + right_slope * last)
        derivative[u] += (1.0 if p else -1.0) * (b * excess)
        derivative[v] += (1.0 if q else -1.0) * (a * excess)
