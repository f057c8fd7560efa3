"""Natural cubic splines through many columns of values: their values, or their slopes alone."""

import numpy as np

from pymantaray.arrays import Array


def natural_spline(points: Array, values: Array, at: Array, *, axis: int = -1) -> Array:
    """Values of the natural cubic splines through values along an axis."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(points, values, axis=axis, bc_type="natural")(at))


def natural_slopes(points: Array, values: Array) -> Array:
    """
    Slopes at the points of the natural cubic spline through each row of values (..., n).

    They are those of `natural_spline`, which also computes the other coefficients and takes three
    times as long. LAPACK solves all rows in place.
    """
    from scipy.linalg.lapack import dgtsv

    step = np.diff(points)
    n = points.size
    rise = np.diff(values)
    right_side = np.empty(values.shape)
    right_side[..., 0] = 3.0 * rise[..., 0]
    right_side[..., -1] = 3.0 * rise[..., -1]
    rise /= step
    inner = right_side[..., 1:-1]
    np.multiply(step[1:], rise[..., :-1], out=inner)
    rise[..., 1:] *= step[:-1]
    inner += rise[..., 1:]
    inner *= 3.0
    diagonal = 2.0 * np.concatenate([step[:1], step[:-1] + step[1:], step[-1:]])
    above = np.append(step[0], step[:-1])
    below = np.append(step[1:], step[-1])
    rows = right_side.reshape(-1, n).T
    *_, slopes, _ = dgtsv(below, diagonal, above, rows, overwrite_b=True)
    return np.asarray(slopes.T).reshape(values.shape)
