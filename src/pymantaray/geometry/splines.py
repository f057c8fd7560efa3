"""B-splines through values on the axes of a rectilinear grid."""

from functools import cached_property, lru_cache

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.geometry.natural_spline import SLOPE_SHARE, hermite_overshoot

ACROSS_MARGIN = 5.0
"""
Distance by which a spline of sound speed may leave neighbouring grid points along horizontal axes.
[m/s]
"""
_VALUES_PER_PART = 2**20  # that `spline_overshoot` compares at a time


class AxisSpline:
    """
    B-splines through values at the points of one axis, with not-a-knot ends.

    The degree is at most n - 1 for n points. With one point, the knots are 0 and 1, and the spline
    is constant. The matrix of the points is banded and totally positive ([1]), so elimination needs
    no exchange of rows. A step of it takes all lines of values at once; libraries solve line by
    line, or wait for their own threads.

    References
    ----------
    [1] C. de Boor, R. DeVore, "A geometric proof of total positivity for spline interpolation,"
        Technical Summary Report 2677, Mathematics Research Center, University of
        Wisconsin-Madison, 1984
    """

    def __init__(self, points: Array, degree: int = 3) -> None:
        self.knots = np.array([0.0, 1.0])
        self._points = points
        self._steps: list[tuple[int, int, float]] = []
        """
        Steps of elimination in order: a line of values, another one, and the multiple of the other
        to subtract.
        """
        self._diagonal = np.ones(1)
        if points.size > 1:
            from scipy.interpolate import BSpline, make_interp_spline

            degree = min(degree, points.size - 1)
            self.knots = np.ascontiguousarray(make_interp_spline(points, points, k=degree).t)
            self._steps, self._diagonal = _elimination(
                BSpline.design_matrix(points, self.knots, degree).toarray()
            )
        self.knots.setflags(write=False)  # media share them

    def coefficients(self, values: Array, *, axis: int) -> Array:
        """Coefficients of the splines through values along one axis."""
        lines = np.array(np.moveaxis(values, axis, 0), dtype=float, order="C")
        for line, other, factor in self._steps:
            lines[line] -= factor * lines[other]
        lines /= self._diagonal.reshape(-1, *[1] * (lines.ndim - 1))
        return np.ascontiguousarray(np.moveaxis(lines, 0, axis))

    @cached_property
    def slopes(self) -> Array:
        """Matrix by which values at the points give the slopes of their spline there."""
        from scipy.interpolate import BSpline

        n = self._diagonal.size
        degree = self.knots.size - n - 1
        spline = BSpline(self.knots, self.coefficients(np.eye(n), axis=0), degree)
        return np.asarray(spline.derivative()(self._points))

    @cached_property
    def reach(self) -> float:
        """
        Upper bound of the distance by which the spline leaves the range of two neighbouring values,
        per largest difference of neighbours.
        """
        by_difference = np.cumsum(self.slopes[:, ::-1], axis=1)[:, -2::-1]
        steepest = np.abs(by_difference).sum(axis=1)
        return SLOPE_SHARE * float((np.diff(self._points) * (steepest[1:] + steepest[:-1])).max())


def axis_spline(points: Array, degree: int = 3) -> AxisSpline:
    """`AxisSpline` of points, from a cache: columns of an atlas and ensemble members share axes."""
    return _cached_spline(np.ascontiguousarray(points, dtype=float).tobytes(), degree)


@lru_cache(maxsize=64)
def _cached_spline(points: bytes, degree: int) -> AxisSpline:
    return AxisSpline(np.frombuffer(points), degree)


def spline_coefficients(
    points: Array, values: Array, *, axis: int, degree: int = 3
) -> tuple[Array, Array]:
    """Coefficients and knots of the B-spline through values along one axis."""
    spline = axis_spline(points, degree)
    return spline.coefficients(values, axis=axis), spline.knots


def spline_overshoot(
    points: Array, values: Array, span: Array, *, axis: int, ignore: float
) -> float:
    """
    Largest distance by which the cubic B-spline along an axis of values (n, m, levels) leaves the
    range of two neighbouring values, or an upper bound of it if this is at most ``ignore``; span is
    the difference of the largest and the smallest value of each level.
    """
    if points.size < 3:
        return 0.0
    spline = axis_spline(points)
    beyond = spline.reach * span
    doubtful = np.flatnonzero(beyond > ignore)
    if not doubtful.size:
        return float(beyond.max(initial=0.0))
    lines = np.moveaxis(values[..., doubtful[0] : doubtful[-1] + 1], axis, 0)
    change = lines[1:] - lines[:-1]
    most = np.maximum(change.max(axis=0), -change.min(axis=0)).max(axis=0)
    beyond[doubtful[0] : doubtful[-1] + 1] = spline.reach * most
    steep = np.flatnonzero(spline.reach * most > ignore)
    at_a_time = max(_VALUES_PER_PART // lines[..., 0].size, 1)
    for start in range(0, steep.size, at_a_time):
        levels = steep[start : start + at_a_time]
        columns = lines[..., levels].reshape(points.size, -1)
        slopes = (spline.slopes @ columns).T
        exact = hermite_overshoot(points, columns.T, slopes, ignore=ignore).max()
        beyond[doubtful[0] + levels] = exact
    return float(beyond.max())


def spline_degree(points: Array, values: Array, span: Array, *, axis: int) -> tuple[int, float]:
    """
    Degree of the B-spline of sound speed along an axis, and the distance by which a cubic would
    leave the grid points, see `spline_overshoot`; the degree is 1 where this exceeds the margin.
    """
    beyond = spline_overshoot(points, values, span, axis=axis, ignore=ACROSS_MARGIN)
    return 1 if beyond > ACROSS_MARGIN else min(3, points.size - 1), beyond


def _elimination(matrix: Array) -> tuple[list[tuple[int, int, float]], Array]:
    """Steps that make a matrix diagonal without exchange of rows, and the diagonal."""
    remainder = matrix.copy()
    n = len(matrix)
    steps: list[tuple[int, int, float]] = []

    def clear(rows: Indices, k: int) -> None:
        for i in rows:
            factor = float(remainder[i, k] / remainder[k, k])
            remainder[i] -= factor * remainder[k]
            remainder[i, k] = 0.0
            steps.append((int(i), k, factor))

    for k in range(n):
        clear(k + 1 + np.flatnonzero(remainder[k + 1 :, k]), k)
    for k in reversed(range(n)):
        clear(np.flatnonzero(remainder[:k, k]), k)
    return steps, np.diagonal(remainder).copy()
