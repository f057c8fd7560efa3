"""
Bounds of interpolation: levels on straight lines where a spline would leave its levels, straight
lines between grid points, and steps of the profile that are wide enough for rays.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pymantaray.arrays import Array
from pymantaray.geometry.natural_spline import SLOPE_SHARE, hermite_overshoot, natural_slopes
from pymantaray.geometry.splines import ACROSS_MARGIN, spline_degree

DEPTH_MARGIN = 3.0
"""Distance by which a spline in depth may leave the range of two neighbouring levels. [m/s]"""
LEAST_STEP = 1e-9  # m; between values of an axis; derivatives across smaller steps overflow
_STRAIGHT = 0.05  # m/s; departure of the spline through added levels from the straight line
_STEEPEST = 1e3  # 1/s; rays cross greater gradients of sound speed inaccurately
_ROUNDING = 1e-9
_WIDEST_CHANGE = 1500.0  # m/s; between allowed sound speeds
_MAX_HALVINGS = 64
_MAX_NOTES = 3


def bounded_levels(depth: Array, speed: Array) -> tuple[Array, Array, Array]:
    """
    Levels through which the natural cubic spline leaves no interval by more than the margin.

    Intervals that it would leave are halved, with sound speed (..., n) on the straight line, until
    the spline is straight in all of them. Returns also the distance by which the spline would leave
    each of the original intervals that have new levels, otherwise zero. [m/s]
    """
    slopes = natural_slopes(depth, speed)
    left = beyond_margin(depth, speed, slopes)
    if not left.any():
        return depth, speed, left
    interval = np.arange(left.size)  # original interval of each interval
    for _ in range(_MAX_HALVINGS):
        step = np.diff(depth)
        departure = spline_departure(depth, speed, slopes).reshape(-1, step.size).max(axis=0)
        wide = (left[interval] > 0.0) & (departure > _STRAIGHT) & (step > 2.0 * LEAST_STEP)
        rows = np.flatnonzero(wide)
        if not rows.size:
            break
        middle = 0.5 * (speed[..., rows] + speed[..., rows + 1])
        depth = np.insert(depth, rows + 1, 0.5 * (depth[rows] + depth[rows + 1]))
        speed = np.insert(speed, rows + 1, middle, axis=-1)
        interval = np.insert(interval, rows + 1, interval[rows])
        slopes = natural_slopes(depth, speed)
        more = beyond_margin(depth, speed, slopes)
        new = left[interval] == 0.0
        np.maximum.at(left, interval[new], more[new])
    return depth, speed, left


def spline_departure(depth: Array, speed: Array, slopes: Array) -> Array:
    """Upper bound of the distance between cubics and straight lines in intervals (..., n - 1)."""
    step = np.diff(depth)
    chord = np.diff(speed) / step
    bends = np.abs(slopes[..., :-1] - chord) + np.abs(slopes[..., 1:] - chord)
    return np.asarray(SLOPE_SHARE * step * bends)


def beyond_margin(depth: Array, speed: Array, slopes: Array) -> Array:
    """Distance by which cubics leave their intervals, zero up to the margin. [m/s]"""
    beyond = hermite_overshoot(depth, speed, slopes, ignore=DEPTH_MARGIN)
    return np.where(beyond > DEPTH_MARGIN, beyond, 0.0)


def straight_notes(depth: Array, left: Array) -> tuple[str, ...]:
    """Notes about intervals of levels that a spline would leave. [m, m/s]"""
    return _listed(
        f"between {depth[first]:g} and {depth[last]:g} m the sound speed is linear: a spline would"
        f" leave its levels by {left[first:last].max():.0f} m/s"
        for first, last in _runs(left > 0.0)
    )


def across_degrees(
    axes: tuple[Array, Array], speed: Array
) -> tuple[tuple[int, int], tuple[str, ...]]:
    """
    Degrees of the splines along north and east, and notes: one where a cubic would leave the grid
    points of an axis by more than the margin.
    """
    degrees = []
    notes = []
    span = speed.max(axis=0).max(axis=0) - speed.min(axis=0).min(axis=0)
    for k, name in enumerate(("north", "east")):
        degree, beyond = spline_degree(axes[k], speed, span, axis=k)
        degrees.append(degree)
        if beyond > ACROSS_MARGIN:
            notes.append(
                f"along {name} the sound speed is linear between grid points: a spline would leave"
                f" them by {beyond:.0f} m/s"
            )
    return (degrees[0], degrees[1]), tuple(notes)


def resolved_steps(axis: Array, speed: Array, name: str) -> tuple[Array, Array, tuple[str, ...]]:
    """
    Points of an axis whose sound speed (..., n) changes by at most 1000 m/s per metre, and notes.

    Steeper steps become wider about their middle, within the axis: the effect on travel times is of
    second order in the change. Points inside a step, or that it covers, are left out.
    """
    step = np.diff(axis)
    thin = np.flatnonzero(_STEEPEST * step < _WIDEST_CHANGE)
    if not thin.size:
        return axis, speed, ()
    change = np.abs(speed[..., thin + 1] - speed[..., thin]).reshape(-1, thin.size)
    if not (change > _STEEPEST * (1.0 + _ROUNDING) * step[thin]).any():
        return axis, speed, ()
    rows = speed.reshape(-1, axis.size)
    groups = [(i, i) for i in range(axis.size)]  # first and last point of each step
    ends = [_step_ends(axis, rows, group) for group in groups]
    i = 0
    while i + 1 < len(groups):
        gap = ends[i + 1][0] - ends[i][1]
        jump = _change(rows, groups[i][1], groups[i + 1][0])
        if gap < LEAST_STEP or jump > _STEEPEST * (1.0 + _ROUNDING) * gap:
            groups[i : i + 2] = [(groups[i][0], groups[i + 1][1])]
            ends[i : i + 2] = [_step_ends(axis, rows, groups[i])]
            i = max(i - 1, 0)
        else:
            i += 1
    points = [end for pair, (a, b) in zip(ends, groups, strict=True) for end in pair[: 1 + (a < b)]]
    columns = [i for a, b in groups for i in ((a, b) if a < b else (a,))]
    notes = _listed(
        f"sound speed changes by {_change(rows, a, b):.3g} m/s between {axis[a]:.12g} and"
        f" {axis[b]:.12g} m {name}: in the medium over {end[1] - end[0]:.2g} m"
        for (a, b), end in zip(groups, ends, strict=True)
        if a < b
    )
    return np.array(points), speed[..., columns], notes


def _step_ends(axis: Array, rows: Array, group: tuple[int, int]) -> tuple[float, float]:
    """Positions of the first and the last point of a step that is wide enough. [m]"""
    first, last = float(axis[group[0]]), float(axis[group[1]])
    more = max(_change(rows, *group) / _STEEPEST - (last - first), 0.0)
    above = 0.0 if group[0] == 0 else 1.0 if group[1] == axis.size - 1 else 0.5
    return max(first - above * more, float(axis[0])), min(
        last + (1.0 - above) * more, float(axis[-1])
    )


def _change(rows: Array, first: int, last: int) -> float:
    """Largest change of the sound speed between two points. [m/s]"""
    return float(np.abs(rows[:, last] - rows[:, first]).max())


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last + 1 of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _listed(notes: Iterable[str]) -> tuple[str, ...]:
    """The first notes, and the number of the others."""
    every = list(notes)
    more = len(every) - _MAX_NOTES
    return (*every[:_MAX_NOTES], *([f"and at {more} other depths"] if more > 0 else []))
