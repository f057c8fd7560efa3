"""Interpolation of many levels at once from a rectangular grid to scattered points."""

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline
from scipy.sparse.linalg import SuperLU, splu

from pymantaray.errors import OceanError

Array = NDArray[np.float64]


class TensorSpline:
    """
    Tensor-product spline through values on a rectangular grid, evaluated at fixed points.

    The weights of the points are worked out once; fields are then interpolated by one sparse product
    for all their levels.

    Parameters
    ----------
    rows, columns : ndarray, shape (n_rows,), (n_columns,)
        Axes of the grid, strictly rising.
    at_rows, at_columns : ndarray, shape (...)
        Points, in the units of the axes, inside the grid.
    degree : {1, 3}
        1 is bilinear, 3 the C2 cubic spline with not-a-knot ends.

    Raises
    ------
    OceanError
        If a point lies outside the grid.
    """

    def __init__(
        self, rows: Array, columns: Array, at_rows: Array, at_columns: Array, *, degree: int = 3
    ) -> None:
        self._solvers = [splu(_collocation(axis, axis, degree).tocsc()) for axis in (rows, columns)]
        self._shape = at_rows.shape
        self._weights = _face_splitting_product(
            _basis(rows, at_rows.ravel(), degree), _basis(columns, at_columns.ravel(), degree)
        )

    def __call__(self, field: Array) -> Array:
        """
        Interpolate a field, level by level.

        Parameters
        ----------
        field : ndarray, shape (levels, n_rows, n_columns)
            Without NaN.

        Returns
        -------
        ndarray, shape (..., levels)
            With the points' shape in front.
        """
        coefficients = field
        for axis, solver in enumerate(self._solvers, start=1):
            coefficients = _solve_along(solver, coefficients, axis)
        flat = coefficients.reshape(len(field), -1)
        return np.asarray(self._weights @ flat.T).reshape(*self._shape, len(field))


def spline_coefficients(points: Array, values: Array, *, axis: int) -> tuple[Array, Array]:
    """
    B-spline through values along one axis, cubic where there are points enough, with not-a-knot ends.

    Parameters
    ----------
    points : ndarray, shape (n,)
        Strictly rising. With one point nothing varies along the axis.
    values : ndarray, shape (..., n, ...)
    axis : int
        Along which the points lie.

    Returns
    -------
    coefficients : ndarray, shape of values
    knots : ndarray, shape (n + degree + 1,)
        In the unit of the points; the degree is min(3, n - 1). For one point 0 and 1.
    """
    if points.size == 1:
        return values, np.array([0.0, 1.0])
    degree = min(3, points.size - 1)
    knots = make_interp_spline(points, points, k=degree).t
    solver = splu(BSpline.design_matrix(points, knots, degree).tocsc())
    return np.ascontiguousarray(_solve_along(solver, values, axis)), np.ascontiguousarray(knots)


def _solve_along(solver: SuperLU, values: Array, axis: int) -> Array:
    """Coefficients along an axis. By a sparse factorization: LAPACK's banded solver waits for its own threads."""
    lines = np.moveaxis(values, axis, 0)
    solved = solver.solve(np.ascontiguousarray(lines.reshape(len(lines), -1)))
    return np.asarray(np.moveaxis(solved.reshape(lines.shape), 0, axis))


def _basis(axis: Array, points: Array, degree: int) -> sp.csr_array:
    """Values of the axis' B-splines at points, which must lie on the axis."""
    slack = 1e-6 * (axis[-1] - axis[0])  # a domain's side may lie on the window's edge
    outside = np.count_nonzero((points < axis[0] - slack) | (points > axis[-1] + slack))
    if outside:
        raise OceanError(
            f"regridding: {outside} of {points.size} points lie outside {axis[0]:g} to {axis[-1]:g} degrees;"
            " shrink the domain"
        )
    return _collocation(axis, np.clip(points, axis[0], axis[-1]), degree)


def _collocation(axis: Array, points: Array, degree: int) -> sp.csr_array:
    """Matrix from B-spline coefficients to values at points, ``degree + 1`` entries a row."""
    # not-a-knot: the knots next to the ends of the axis are left out
    interior = axis[1:-1] if degree == 1 else axis[2:-2]
    knots = np.concatenate([[axis[0]] * (degree + 1), interior, [axis[-1]] * (degree + 1)])
    return sp.csr_array(BSpline.design_matrix(points, knots, degree))


def _face_splitting_product(left: sp.csr_array, right: sp.csr_array) -> sp.csr_array:
    """Row-wise Kronecker product: row i is ``kron(left[i], right[i])``."""
    n = left.shape[0]
    a = np.asarray(left.data).reshape(n, -1, 1)
    b = np.asarray(right.data).reshape(n, 1, -1)
    column = left.indices.reshape(n, -1, 1) * right.shape[1] + right.indices.reshape(n, 1, -1)
    per_row = a.shape[1] * b.shape[2]
    return sp.csr_array(
        ((a * b).ravel(), column.ravel(), np.arange(n + 1) * per_row),
        shape=(n, left.shape[1] * right.shape[1]),
    )
