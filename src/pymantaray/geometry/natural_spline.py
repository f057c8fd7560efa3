"""Natural cubic splines through many columns of values: their values, or their slopes alone."""

import numpy as np

from pymantaray.arrays import Array

SLOPE_SHARE = 4.0 / 27.0  # largest value of t (1 - t)^2 for t from 0 to 1


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
    *_, slopes, _ = dgtsv(below, diagonal, above, right_side.reshape(-1, n).T, overwrite_b=True)
    return np.asarray(slopes.T).reshape(values.shape)


def hermite_overshoot(points: Array, values: Array, slopes: Array, *, ignore: float) -> Array:
    """
    Distance by which the cubics between points leave the range of their two values (n - 1,), the
    largest of all rows.

    A cubic whose slopes are between zero and three times that of its chord is monotone (Fritsch and
    Carlson, 1980). Slopes outside this range by u and v add at most 4 / 27 of the interval times
    u + v. Values up to ``ignore`` may be this bound instead of the distance.
    """
    step = np.diff(points)
    high, low = slopes, slopes
    while high.ndim > 1:  # axis by axis, which is faster than all at once
        high, low = high.max(axis=0), low.min(axis=0)
    steepest = np.maximum(high, -low)
    bound = SLOPE_SHARE * step * (steepest[:-1] + steepest[1:])
    doubtful = np.flatnonzero(bound > ignore)
    if doubtful.size:
        ends = (x[..., i] for x in (values, slopes) for i in (doubtful, doubtful + 1))
        flat = [end.reshape(-1, doubtful.size) for end in ends]
        bound[doubtful] = _overshoots(step[doubtful], *flat, ignore=ignore)
    return np.asarray(bound)


def _overshoots(
    h: Array, first: Array, last: Array, slope: Array, last_slope: Array, *, ignore: float
) -> Array:
    """As `hermite_overshoot`, from values and slopes at both ends of intervals (rows, n)."""
    chord = (last - first) / h
    low, high = np.minimum(3.0 * chord, 0.0), np.maximum(3.0 * chord, 0.0)
    outside = np.abs(slope - np.clip(slope, low, high))
    outside += np.abs(last_slope - np.clip(last_slope, low, high))
    bound = SLOPE_SHARE * h * outside
    cubics = np.nonzero(bound > ignore)
    if not cubics[0].size:
        return np.asarray(bound.max(axis=0))
    bound[cubics] = _cubic_overshoot(
        h[cubics[1]], first[cubics], last[cubics], slope[cubics], last_slope[cubics]
    )
    return np.asarray(bound.max(axis=0))


def _cubic_overshoot(h: Array, first: Array, last: Array, slope: Array, last_slope: Array) -> Array:
    """Distance by which each cubic leaves the range of its values at both ends."""
    # first + h t (slope + t (square + t cube)), whose derivative is zero at two t
    chord = (last - first) / h
    square = 3.0 * chord - 2.0 * slope - last_slope
    cube = slope + last_slope - 2.0 * chord
    root = np.sqrt(np.maximum(square * square - 3.0 * cube * slope, 0.0))
    q = -(square + np.copysign(root, square))
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = np.nan_to_num(np.stack([q / (3.0 * cube), slope / q]), nan=0.0)
    beyond = np.zeros(first.size)
    for t in np.clip(turning, 0.0, 1.0):
        value = first + h * t * (slope + t * (square + t * cube))
        outside = np.maximum(value - np.maximum(first, last), np.minimum(first, last) - value)
        beyond = np.maximum(beyond, outside)
    return beyond
