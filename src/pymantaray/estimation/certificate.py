r"""
Certificate of global optimality for pose graphs and range-aided graphs, by Lagrangian duality.

The problem of the certificate is that of SE-Sync [1]_ and CORA [2]_. Its cost is half the sum of

- :math:`\kappa\,|R_j - R_i R_{ij}|_F^2` with :math:`\kappa = 1 / (2 \sigma_R^2)` for relative rotations and attitudes,
- :math:`\tau\,|t_j - t_i - R_i t_{ij}|^2` with :math:`\tau = 1 / \sigma_t^2` for relative positions, sightings, fixes and priors,
- :math:`|t_j - t_i - d\,u|^2 / \sigma_d^2` for ranges d, with an unknown unit vector u each,

where each :math:`\sigma^2` is the mean variance of the axes. Priors are edges from a node of the world. Row blocks
:math:`R_i^\top`, :math:`t_i^\top` and :math:`u^\top` form a matrix X, and the cost is :math:`\frac12 \mathrm{tr}(X^\top Q X)`.
The constraints are :math:`R_i^\top R_i = I` and :math:`|u| = 1`. At a critical point the multipliers are the symmetric block diagonal
:math:`\Lambda` of :math:`Q X X^\top`, and :math:`S = Q - \Lambda` has :math:`S X = 0`. For every feasible Y

.. math:: f(Y) = f(X) + \tfrac12 \mathrm{tr}(Y^\top S Y),

so X is a global minimum if S has no negative eigenvalue. With free positions eliminated from S, rows of rotations and unit vectors
have a constant sum of squares m, and :math:`f(Y) \ge f(X) + \frac{m}{2} \lambda_{\min}`.

References
----------
.. [1] Rosen, Carlone, Bandeira and Leonard, SE-Sync, https://github.com/david-m-rosen/SE-Sync
.. [2] Papalia et al., "Certifiably Correct Range-Aided SLAM", https://arxiv.org/abs/2302.11614
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.sparse import csc_array, csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh, splu

from pymantaray.estimation.graph import FactorGraph, GraphValues
from pymantaray.estimation.range_models import chord
from pymantaray.geometry.se3 import matrix_from_quaternion

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_GAP = (
    1e-3  # relative, and a tenth of it absolute: largest gap between cost and bound of a certified solution
)
_STEPS, _TRIALS = 100, 20  # of Newton's method; of damping in each
_DECREMENT = 1e-13  # relative decrease of the cost that ends Newton's method
_CRITICAL = 1e-6  # relative; a larger Newton decrement is not at a critical point


@dataclass(frozen=True)
class Certificate:
    """
    Result of `certify`.

    Parameters
    ----------
    certified : bool
        True if the critical point next to the estimate is a global minimum of the certificate's problem.
    least_eigenvalue : float
        Least eigenvalue of the certificate matrix; NaN if there is no certificate.
    cost : float
        Cost of the certificate's problem at that critical point. [-]
    lower_bound : float
        Lower bound of this cost over all values. [-]
    distance : float
        Largest distance between positions of the estimate and of the critical point. [m]
    reason : str or None
        Why there is no certificate; None if there is one or a negative eigenvalue.
    """

    certified: bool
    least_eigenvalue: float = np.nan
    cost: float = np.nan
    lower_bound: float = np.nan
    distance: float = np.nan
    reason: str | None = None

    @property
    def text(self) -> str:
        """One line for people."""
        if self.reason is not None:
            return f"no certificate: {self.reason}"
        if self.certified:
            return f"certified: global minimum, cost {self.cost:.6g} of the chordal problem"
        return (
            f"not certified: least eigenvalue {self.least_eigenvalue:.3g}; cost {self.cost:.6g} of the chordal problem,"
            f" lower bound {self.lower_bound:.6g}"
        )


def certify(graph: FactorGraph, values: GraphValues) -> Certificate:
    """
    Certify that an estimate is a global minimum, or compute the least eigenvalue of the certificate matrix.

    The estimate is first refined for the problem of the certificate, whose weights are isotropic and whose rotation residuals are
    chordal; ``distance`` tells how far that moves it. A negative eigenvalue means a local minimum, or a relaxation that is not
    tight, which is common with ranges.

    Parameters
    ----------
    graph : FactorGraph
        A graph of two or three dimensions without depth factors.
    values : GraphValues
        The estimate.

    Returns
    -------
    Certificate
    """
    if len(graph["depth"]):
        return Certificate(False, reason="depth factors are not quadratic in the relaxation")
    problem = ChordalProblem(graph)
    start = problem.matrix(values)
    point, decrement = _descend(problem, start)
    cost = problem.cost(point)
    moved = problem.positions(point) - problem.positions(start)
    distance = float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    if decrement > _CRITICAL * (1.0 + cost):
        return Certificate(
            False, cost=cost, distance=distance, reason="no critical point of the chordal problem found"
        )
    constrained = problem.constrained
    size = float(np.sum(point[constrained] ** 2))
    allowed = 2.0 * (_GAP * cost + 0.1 * _GAP) / size
    least = least_eigenvalue(problem.certificate_matrix(point), constrained, allowed)
    if not np.isfinite(least):
        return Certificate(
            False, cost=cost, distance=distance, reason="the Lanczos iteration did not converge"
        )
    bound = max(cost + 0.5 * size * min(least, 0.0), 0.0)
    return Certificate(least >= -allowed, least, cost, bound, distance)


class _Differences(NamedTuple):
    """Relative measurements between nodes, -1 for the world: rotation, position and their weights."""

    first: Indices
    second: Indices
    rotation: Array | None
    position: Array | None
    kappa: Array
    tau: Array


class ChordalProblem:
    """
    Matrix form of a graph: rows of the world's rotation, of rotation and position of each pose, of landmarks and of unit vectors.

    ``root`` is a sparse matrix with cost ``|root X|^2 / 2``.
    """

    def __init__(self, graph: FactorGraph) -> None:
        self.graph, self.d = graph, 2 if graph.planar else 3
        d, n = self.d, graph.n_poses
        node = np.arange(graph.n_variables)
        self.rotation_row = d + (d + 1) * np.arange(n)
        self.position_row = np.where(node < n, d + (d + 1) * node + d, d + (d + 1) * n + node - n)
        self.unit_row = d + (d + 1) * n + (graph.n_variables - n) + np.arange(len(graph["range"]))
        self.size = int(d + (d + 1) * n + (graph.n_variables - n) + len(graph["range"]))
        self.constrained = np.ones(self.size, dtype=bool)
        self.constrained[self.position_row] = False
        self.root = self._root()
        self.quadratic = csc_array(self.root.T @ self.root)

    def matrix(self, values: GraphValues) -> Array:
        """Rows X of values, with unit vectors along the ranges."""
        d, x = self.d, np.zeros((self.size, self.d))
        x[:d] = np.eye(d)
        rotation = matrix_from_quaternion(values.quaternion)[:, :d, :d]
        x[self.rotation_row[:, None] + np.arange(d)] = np.swapaxes(rotation, 1, 2)
        place = np.concatenate([values.position, values.landmark_position])[:, :d]
        x[self.position_row] = place
        first, second = self.graph["range"].variables.T
        unit = chord(place[first], place[second])[1]
        unit[~unit.any(axis=1), 0] = 1.0
        x[self.unit_row] = unit
        return x

    def positions(self, x: Array) -> Array:
        """Positions of all variables."""
        return np.asarray(x[self.position_row])

    def cost(self, x: Array) -> float:
        """Half the sum of squared residuals."""
        return 0.5 * float(np.sum((self.root @ x) ** 2))

    def certificate_matrix(self, x: Array) -> csc_array:
        """S = Q - Lambda at a critical point."""
        d, product = self.d, self.quadratic @ x
        start = np.concatenate([[0], self.rotation_row])[:, None] + np.arange(d)
        block = product[start] @ np.swapaxes(x[start], 1, 2)
        block = 0.5 * (block + np.swapaxes(block, 1, 2))
        row = np.broadcast_to(start[:, :, None], block.shape).ravel()
        column = np.broadcast_to(start[:, None, :], block.shape).ravel()
        unit = np.sum(product[self.unit_row] * x[self.unit_row], axis=1)
        entries = np.concatenate([block.ravel(), unit])
        rows, columns = np.concatenate([row, self.unit_row]), np.concatenate([column, self.unit_row])
        multipliers = csc_array((entries, (rows, columns)), shape=(self.size, self.size))
        return csc_array(self.quadratic - multipliers)

    def _root(self) -> csr_array:
        parts = [self._rows_of(difference) for difference in self._differences()] + [self._range_rows()]
        entry, row, column, count = [], [], [], 0
        for values, rows, columns, height in parts:
            entry.append(values)
            row.append(rows + count)
            column.append(columns)
            count += height
        index = np.concatenate(row), np.concatenate(column)
        return csr_array((np.concatenate(entry), index), shape=(count, self.size))

    def _differences(self) -> list[_Differences]:
        """All factors but ranges as relative measurements, priors from the world."""
        out, turns = [], [2] if self.d == 2 else [0, 1, 2]
        for name in ("prior", "fix", "survey", "edge", "attitude", "dvl", "sighting"):
            table = self.graph[name]
            ends = table.variables.astype(np.intp)
            first = ends[:, 0] if ends.shape[1] == 2 else np.full(len(table), -1)
            columns, variance = table.kind.columns_at, np.diagonal(table.covariance, axis1=1, axis2=2)
            turn = "quaternion" in columns
            rotation = (
                matrix_from_quaternion(table.column("quaternion"))[:, : self.d, : self.d] if turn else None
            )
            position = table.column("position")[:, : self.d] if "position" in columns else None
            kappa = 0.5 / variance[:, turns].mean(axis=1) if turn else np.empty(0)
            along = [a + 3 * turn for a in range(self.d)]
            tau = 1.0 / variance[:, along].mean(axis=1) if position is not None else np.empty(0)
            out.append(_Differences(first, ends[:, -1], rotation, position, kappa, tau))
        return out

    def _rows_of(self, m: _Differences) -> tuple[Array, Indices, Indices, int]:
        """Entries, rows, columns and number of rows of some relative measurements."""
        d, n = self.d, m.first.size
        k, axis = np.arange(n), np.arange(d)
        start = np.where(m.first < 0, 0, d + (d + 1) * m.first)  # of the rotation of the first node
        entry, row, column, height = [], [], [], 0
        if m.rotation is not None:
            weight = np.sqrt(m.kappa)
            rows = d * k[:, None] + axis
            entry += [np.repeat(weight, d), -(weight[:, None, None] * np.swapaxes(m.rotation, 1, 2)).ravel()]
            row += [rows.ravel(), np.repeat(rows.ravel(), d)]
            column.append((d + (d + 1) * m.second[:, None] + axis).ravel())
            column.append(np.repeat(start[:, None] + axis, d, axis=0).ravel())
            height = d * n
        if m.position is not None:
            weight, rows, inner = np.sqrt(m.tau), height + k, m.first >= 0
            entry += [weight, -weight[inner], -(weight[:, None] * m.position).ravel()]
            row += [rows, rows[inner], np.repeat(rows, d)]
            column += [self.position_row[m.second], self.position_row[m.first[inner]]]
            column.append((start[:, None] + axis).ravel())
            height += n
        return np.concatenate(entry), np.concatenate(row), np.concatenate(column), height

    def _range_rows(self) -> tuple[Array, Indices, Indices, int]:
        ranges = self.graph["range"]
        first, second = self.position_row[ranges.variables.astype(np.intp).T]
        weight, k = 1.0 / np.sqrt(ranges.variance), np.arange(len(ranges))
        entry = np.concatenate([weight, -weight, -weight * ranges.column("distance")])
        return entry, np.tile(k, 3), np.concatenate([second, first, self.unit_row]), k.size


def _descend(problem: ChordalProblem, x: Array) -> tuple[Array, float]:
    """Critical point by damped Newton steps on the manifold, and the last Newton decrement."""
    cost, damping, decrement = problem.cost(x), 0.0, np.inf
    for _ in range(_STEPS):
        tangent = _tangent(problem, x)
        gradient = tangent.T @ (problem.quadratic @ x).ravel()
        eye = eye_array(problem.d)
        hessian = csc_array(tangent.T @ kron(problem.certificate_matrix(x), eye, format="csc") @ tangent)
        scale = np.abs(hessian.diagonal())
        for _ in range(_TRIALS):
            damped = csc_array(hessian + diags_array((damping + 1e-12) * scale))
            step = -splu(damped).solve(gradient)
            decrement = -0.5 * float(gradient @ step)
            trial = _moved(problem, x, step)
            lower = problem.cost(trial)
            if decrement >= 0.0 and lower <= cost + 1e-12 * (1.0 + cost):
                break
            damping = max(10.0 * damping, 1e-6)
        else:
            return x, abs(decrement)
        x, cost, damping = trial, min(lower, cost), 0.1 * damping if damping > 1e-6 else 0.0
        if decrement <= _DECREMENT * (1.0 + cost):
            break
    return x, abs(decrement)


def _skew(d: int) -> Array:
    """Basis of the skew-symmetric matrices."""
    pairs = [(a, b) for a in range(d) for b in range(a)]
    out = np.zeros((len(pairs), d, d))
    for k, (a, b) in enumerate(pairs):
        out[k, a, b], out[k, b, a] = 1.0, -1.0
    return out


def _complement(unit: Array) -> Array:
    """Orthonormal vectors across unit vectors (n, d), shape (n, d - 1, d)."""
    return np.asarray(np.linalg.svd(unit[:, None, :])[2][:, 1:])


def _tangent(problem: ChordalProblem, x: Array) -> csc_array:
    """Basis of the tangent space: derivatives of X, row by row, by rotations, positions and directions of unit vectors."""
    d, skew = problem.d, _skew(problem.d)
    axis = np.arange(d)
    start = problem.rotation_row[:, None] + axis
    turned = np.einsum("kab,nbc->nkac", skew, x[start])
    at = np.broadcast_to((d * start[:, :, None] + axis)[:, None], turned.shape)
    n, k = turned.shape[:2]
    by_turn = np.broadcast_to(np.arange(n * k).reshape(n, k, 1, 1), turned.shape)
    place = (d * problem.position_row[:, None] + axis).ravel()
    by_place = n * k + np.arange(place.size)
    across = _complement(x[problem.unit_row])
    unit = np.broadcast_to((d * problem.unit_row[:, None] + axis)[:, None], across.shape)
    count = across.shape[0] * (d - 1)
    by_unit = np.broadcast_to((n * k + place.size + np.arange(count)).reshape(-1, d - 1, 1), across.shape)
    entry = np.concatenate([turned.ravel(), np.ones(place.size), across.ravel()])
    row = np.concatenate([at.ravel(), place, unit.ravel()])
    column = np.concatenate([by_turn.ravel(), by_place, by_unit.ravel()])
    return csc_array((entry, (row, column)), shape=(problem.size * d, n * k + place.size + count))


def _moved(problem: ChordalProblem, x: Array, step: Array) -> Array:
    """Point after a tangent step."""
    d, skew, out = problem.d, _skew(problem.d), x.copy()
    n, k = problem.rotation_row.size, len(skew)
    start = problem.rotation_row[:, None] + np.arange(d)
    turn = np.einsum("nk,kab->nab", step[: n * k].reshape(n, k), skew)
    if n:
        left, _, right = np.linalg.svd(np.asarray(expm(turn)) @ x[start])
        out[start] = left @ right
    rest = step[n * k :]
    place = d * problem.position_row.size
    out[problem.position_row] += rest[:place].reshape(-1, d)
    across = _complement(x[problem.unit_row])
    unit = x[problem.unit_row] + np.einsum("nk,nkc->nc", rest[place:].reshape(-1, d - 1), across)
    out[problem.unit_row] = unit / np.linalg.norm(unit, axis=1)[:, None]
    return out


def least_eigenvalue(matrix: csc_array, constrained: NDArray[np.bool_], allowed: float) -> float:
    """
    Least eigenvalue of the Schur complement of a certificate matrix on its constrained rows, by Lanczos.

    The shift grows from ``allowed`` until the shifted matrix has no negative eigenvalue, by the signs of its pivots; the inverse of
    the shifted matrix then has the least eigenvalue as its largest. NaN if that fails.
    """
    rows = np.flatnonzero(constrained)
    shift, largest = allowed, float(abs(matrix).sum(axis=0).max())
    while True:
        factor = _positive_factor(matrix, constrained, shift)
        if factor is not None:
            break
        if shift > 2.0 * largest:
            return float(np.nan)
        shift *= 10.0

    def inverse(v: Array) -> Array:
        right = np.zeros(constrained.size)
        right[rows] = v.ravel()
        return np.asarray(factor.solve(right)[rows])

    operator = LinearOperator((rows.size, rows.size), matvec=inverse, dtype=float)
    start = np.random.default_rng(0).standard_normal(rows.size)
    try:
        value = eigsh(operator, k=1, which="LA", v0=start, return_eigenvectors=False, tol=1e-8)[0]
    except ArpackError:
        return float(np.nan)
    return float(1.0 / value - shift)


def _positive_factor(matrix: csc_array, constrained: NDArray[np.bool_], shift: float) -> Any | None:
    """Sparse factor of a matrix with a shift on its constrained rows; None unless all pivots are positive."""
    shifted = csc_array(matrix + diags_array(np.where(constrained, shift, 0.0)))
    try:
        factor = splu(
            shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError:  # exactly singular
        return None
    symmetric = np.array_equal(factor.perm_r, factor.perm_c)
    return factor if symmetric and (factor.U.diagonal() > 0.0).all() else None
