r"""
Certificate of global optimality for pose graphs and range-aided graphs, by Lagrangian duality, and
the Riemannian staircase, which finds a global minimum of the relaxation of a chordal problem.

The certificate matrix S of a `ChordalProblem` gives the cost of every feasible Y,

.. math:: f(Y) = f(X) + \tfrac12 \mathrm{tr}(Y^\top S Y),

so X is a global minimum if S has no negative eigenvalue. With free positions eliminated from S,
rows of rotations and unit vectors have a constant sum of squares m, and :math:`f(Y) \ge f(X) +
\frac{m}{2} \lambda_{\min}`. The same bound at a global minimum of the relaxation is the largest
one.

In the staircase, the rows of the problem's matrix X get more columns than the dimension d, which
removes local minima. Newton's method descends to a critical point. If the certificate matrix S has
a negative eigenvalue there, a further column along its eigenvector leads down, and the descent
continues. Without one, X is the global minimum of the relaxation. The bound of `lower_bound` is
valid at any point with the best positions, critical or not. `rounded` projects X to d columns,
which gives starting values for a solver.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import csc_array, diags_array, eye_array, kron
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

from pymantaray.apps.graphs.chordal_problem import ChordalProblem, not_quadratic
from pymantaray.arrays import Array
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues
from pymantaray.estimation.solvers.normal_equations import symmetric_factor

MAX_RELAXED_FACTORS = 500  # largest graph whose relaxation is solved: about 1 s of CPU
# relative, and a tenth of it absolute: largest gap between cost and bound of a global minimum
GAP = 1e-3
_MORE_COLUMNS = 5  # than the dimension, at most
_STEPS = 100  # of Newton's method; of damping in each
_TRIALS = 20
_DECREMENT = 1e-13  # relative decrease of the cost that ends Newton's method
_RELAXED_DECREMENT = 1e-7  # the same in the relaxation, whose bound is valid at any point
_MIN_DAMPING = 1e-12  # of the diagonal of the Hessian; the first after a failed step
_FIRST_DAMPING = 1e-6
_CONVERGED_DAMPING = 1e-5  # a larger one makes steps short away from critical points
_SHORTEST = 1e-4  # of the length of a unit vector; shortest step along an eigenvector
_CRITICAL = 1e-6  # relative; a larger Newton decrement is not at a critical point


@dataclass(frozen=True)
class Relaxation:
    """
    Result of `relax`.

    ``point`` has a row for each row of the problem and ``rank`` columns; ``cost`` is its cost. No
    values of the problem have a cost below ``lower_bound``. ``tight`` is true if the first level,
    without further columns, is a global minimum.
    """

    point: Array
    cost: float
    lower_bound: float
    tight: bool

    @property
    def rank(self) -> int:
        """Number of columns."""
        return int(self.point.shape[1])


def can_relax(graph: FactorGraph) -> bool:
    """True if a graph has a relaxation, and is small enough for it."""
    return not not_quadratic(graph) and graph.n_factors <= MAX_RELAXED_FACTORS


def relax(problem: ChordalProblem, x: Array) -> Relaxation:
    """
    Minimize the relaxation, starting from a point of the problem, until cost and lower bound agree.
    """
    bound = 0.0
    first = x.shape[1]
    x = problem.feasible(x)
    while True:
        x, _ = descend(problem, x, tolerance=_RELAXED_DECREMENT)
        cost = problem.cost(x)
        least, direction = least_eigenpair(problem, x)
        bound = max(bound, lower_bound(problem, cost, least))
        closed = cost - bound <= gap(cost)
        if closed or direction is None or x.shape[1] == first + _MORE_COLUMNS:
            return Relaxation(x, cost, bound, tight=closed and x.shape[1] == first)
        x = _escape(problem, x, direction)


def rounded(problem: ChordalProblem, x: Array, like: GraphValues) -> GraphValues:
    """
    Values next to a point of the relaxation: its columns in the frame of the world, projected to
    rotations.
    """
    d = problem.d
    out = x[:, : problem.d].copy()
    start = problem.rotation_row[:, None] + np.arange(d)
    left, _, right = np.linalg.svd(out[start])
    left[:, :, -1] *= np.sign(np.linalg.det(left @ right))[:, None]
    out[start] = left @ right
    return problem.values(problem.feasible(out), like)


def gap(cost: float) -> float:
    """Largest difference of cost and lower bound of a global minimum."""
    return GAP * cost + 0.1 * GAP


def lower_bound(problem: ChordalProblem, cost: float, least: float) -> float:
    """
    Lower bound of the cost over all values, from the cost of a point with the best positions and
    the least eigenvalue there.
    """
    # sum of squares of all constrained rows
    size = problem.d * (1 + problem.rotation_row.size) + problem.unit_row.size
    return max(cost + 0.5 * size * min(least, 0.0), 0.0) if np.isfinite(least) else 0.0


def descend(
    problem: ChordalProblem, x: Array, *, tolerance: float = _DECREMENT
) -> tuple[Array, float]:
    """Critical point by damped Newton steps on the manifold, and the last Newton decrement."""
    cost = problem.cost(x)
    damping = _MIN_DAMPING
    decrement = np.inf
    for _ in range(_STEPS):
        tangent = _tangent(problem, x)
        gradient = tangent.T @ (problem.quadratic @ x).ravel()
        eye = eye_array(x.shape[1])
        hessian = csc_array(
            tangent.T @ kron(problem.certificate_matrix(x), eye, format="csc") @ tangent
        )
        scale = np.abs(hessian.diagonal()) + np.finfo(float).tiny
        for _ in range(_TRIALS):
            factor = positive_factor(csc_array(hessian + diags_array(damping * scale)))
            if factor is not None:
                step = -factor.solve(gradient)
                decrement = -0.5 * float(gradient @ step)
                expected = -float(gradient @ step + 0.5 * step @ (hessian @ step))
                trial = problem.feasible(x + (tangent @ step).reshape(x.shape))
                lower = problem.cost(trial)
                if lower <= cost + 1e-12 * (1.0 + cost):
                    break
            damping = max(10.0 * damping, _FIRST_DAMPING)
        else:
            return x, abs(decrement)
        agrees = cost - lower >= 0.75 * expected
        converged = decrement <= tolerance * (1.0 + cost) and damping <= _CONVERGED_DAMPING
        x = trial
        cost = min(lower, cost)
        if converged:
            break
        damping = max(0.1 * damping, _MIN_DAMPING) if agrees else damping
    return x, abs(decrement)


def _escape(problem: ChordalProblem, x: Array, direction: Array) -> Array:
    """Lower point with one more column, along an eigenvector of the certificate matrix."""
    wide = np.pad(x, ((0, 0), (0, 1)))
    best = wide
    lowest = problem.cost(wide)
    length = 1.0
    while length > _SHORTEST:
        moved = wide.copy()
        moved[:, -1] = length * direction
        _, _, right = np.linalg.svd(moved[: problem.d])
        left, _, short = np.linalg.svd(moved[: problem.d], full_matrices=False)
        turn = np.concatenate([(left @ short).T, right[problem.d :].T], axis=1)
        moved = problem.feasible(np.asarray(moved @ turn))
        cost = problem.cost(moved)
        if cost < lowest:
            best = moved
            lowest = cost
        elif best is not wide:
            break
        length *= 0.5
    return best


def _skew(d: int) -> Array:
    """Orthonormal basis of the skew-symmetric matrices, up to a factor."""
    pairs = [(a, b) for a in range(d) for b in range(a)]
    out = np.zeros((len(pairs), d, d))
    for k, (a, b) in enumerate(pairs):
        out[k, a, b] = 1.0
        out[k, b, a] = -1.0
    return out


def _complement(rows: Array) -> Array:
    """Orthonormal vectors across the rows of blocks (n, d, p), shape (n, p - d, p)."""
    return np.asarray(np.linalg.svd(rows)[2][:, rows.shape[1] :])


def _tangent(problem: ChordalProblem, x: Array) -> csc_array:
    """
    Basis of the tangent space: derivatives of X, row by row, by rotations, positions and directions
    of unit vectors.
    """
    d = problem.d
    p = x.shape[1]
    axis = np.arange(x.shape[1])
    start = problem.rotation_row[:, None] + np.arange(d)
    within = np.einsum("kab,nbc->nkac", _skew(d), x[start])
    out = np.einsum("ai,nqc->niqac", np.eye(d), _complement(x[start])).reshape(
        len(start), d * (p - d), d, p
    )
    turned = np.concatenate([within, out], axis=1)
    at = np.broadcast_to((p * start[:, :, None] + axis)[:, None], turned.shape)
    n, k = turned.shape[:2]
    by_turn = np.broadcast_to(np.arange(n * k).reshape(n, k, 1, 1), turned.shape)
    place = (p * problem.position_row[:, None] + axis).ravel()
    by_place = n * k + np.arange(place.size)
    across = _complement(x[problem.unit_row][:, None])
    unit = np.broadcast_to((p * problem.unit_row[:, None] + axis)[:, None], across.shape)
    count = across.shape[0] * (p - 1)
    by_unit = np.broadcast_to(
        (n * k + place.size + np.arange(count)).reshape(-1, p - 1, 1), across.shape
    )
    entry = np.concatenate([turned.ravel(), np.ones(place.size), across.ravel()])
    row = np.concatenate([at.ravel(), place, unit.ravel()])
    column = np.concatenate([by_turn.ravel(), by_place, by_unit.ravel()])
    return csc_array((entry, (row, column)), shape=(problem.size * p, n * k + place.size + count))


def least_eigenpair(problem: ChordalProblem, x: Array) -> tuple[float, Array | None]:
    """
    Least eigenvalue of the Schur complement of the certificate matrix on its constrained rows, and
    its direction in all rows.

    It uses the Lanczos method with a shift, which grows until the shifted matrix has no negative
    eigenvalue, by the signs of its pivots; the inverse of the shifted matrix then has the least
    eigenvalue as its largest. NaN and None if that fails.
    """
    matrix = problem.certificate_matrix(x)
    constrained = problem.constrained
    rows = np.flatnonzero(constrained)
    shift = 2.0 * gap(problem.cost(x)) / rows.size
    largest = float(abs(matrix).sum(axis=0).max())
    while True:
        factor = positive_factor(csc_array(matrix + diags_array(np.where(constrained, shift, 0.0))))
        if factor is not None:
            break
        if shift > 2.0 * largest:
            return float(np.nan), None
        shift *= 10.0

    def solved(v: Array) -> Array:
        right = np.zeros(constrained.size)
        right[rows] = v.ravel()
        return np.asarray(factor.solve(right))

    operator = LinearOperator((rows.size, rows.size), matvec=lambda v: solved(v)[rows], dtype=float)
    start = np.random.default_rng(0).standard_normal(rows.size)
    try:
        value, vector = eigsh(operator, k=1, which="LA", v0=start, tol=1e-8)
    except ArpackError:
        return float(np.nan), None
    direction = solved(vector[:, 0])
    return float(1.0 / value[0] - shift), direction / np.abs(direction[rows]).max()


def positive_factor(matrix: csc_array) -> Any | None:
    """Sparse factor of a symmetric matrix; None unless all pivots are positive."""
    try:
        factor = symmetric_factor(matrix)
    except RuntimeError:  # exactly singular
        return None
    symmetric = np.array_equal(factor.perm_r, factor.perm_c)
    return factor if symmetric and (factor.U.diagonal() > 0.0).all() else None


@dataclass(frozen=True)
class Certificate:
    r"""
    Result of `certify`.

    Parameters
    ----------
    certified : bool
        True if the critical point next to the estimate is a global minimum of the certificate's
        problem.
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

    Examples
    --------
    Continues the example of `pymantaray.apps.graphs`:

    >>> from pymantaray.apps.graphs import certify, solve_graph
    >>> result = solve_graph(opened)
    >>> proof = certify(result.graph, result.solution.values)
    >>> proof.certified, proof.lower_bound <= proof.cost
    (True, True)
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
            f"not certified: least eigenvalue {self.least_eigenvalue:.3g}; cost {self.cost:.6g} of"
            f" the chordal problem, lower bound {self.lower_bound:.6g}"
        )


def certify(graph: FactorGraph, values: GraphValues) -> Certificate:
    r"""
    Certify that an estimate is a global minimum, or compute the least eigenvalue of the certificate
    matrix.

    The estimate is first refined for the problem of the certificate, whose weights are isotropic
    and whose rotation residuals are chordal; ``distance`` is how far that moves it. The estimate is
    certified if its cost is within 0.1 % (and 0.0001) of a lower bound. The least eigenvalue gives
    a bound; if it is negative in a small graph, `relax` computes a better one. Without a
    certificate, the estimate is a local minimum, or the relaxation is not tight.

    Parameters
    ----------
    graph : FactorGraph
        A graph of two or three dimensions; with factors of a coordinate alone, such as depths,
        there is no certificate.
    values : GraphValues
        The estimate.

    Returns
    -------
    Certificate

    Examples
    --------
    Continues the example of `pymantaray.apps.graphs`:

    >>> from pymantaray.apps.graphs import certify, solve_graph
    >>> result = solve_graph(opened)
    >>> certify(result.graph, result.solution.values).certified
    True
    """
    if others := not_quadratic(graph):
        return Certificate(False, reason=f"{', '.join(others)} are not quadratic in the relaxation")
    problem = ChordalProblem(graph)
    start = problem.matrix(values)
    point, decrement = descend(problem, start)
    cost = problem.cost(point)
    moved = problem.positions(point) - problem.positions(start)
    distance = float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    if decrement > _CRITICAL * (1.0 + cost):
        return Certificate(
            False,
            cost=cost,
            distance=distance,
            reason="no critical point of the chordal problem found",
        )
    least, _ = least_eigenpair(problem, point)
    if not np.isfinite(least):
        return Certificate(
            False, cost=cost, distance=distance, reason="the Lanczos iteration did not converge"
        )
    bound = lower_bound(problem, cost, least)
    if cost - bound > gap(cost) and can_relax(graph):
        bound = max(bound, relax(problem, point).lower_bound)
    return Certificate(cost - bound <= gap(cost), least, cost, bound, distance)
