"""Diagnose why a graph cannot be solved, in one line that names a variable."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import diags_array, eye_array

from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues
from pymantaray.estimation.solvers.normal_equations import SIZE, symmetric_factor
from pymantaray.estimation.solvers.problems import GraphState, distance_problem
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, so3_exp

# m or rad; a standard deviation of this size counts as undetermined, as in the solver
_UNDETERMINED = 1e6
# added to the scaled information matrix, whose diagonal is 1, so that it can be factorized
_DAMPING = 1e-15
# each reduces all but the weakest direction by the ratio of the eigenvalues
_INVERSE_ITERATIONS = 6
# rad, and share of the extent of all positions; moves values out of accidental alignments
_JITTER = 0.1
# smallest ratio of a variance to the median; below, the other factors lose all digits
_MIN_VARIANCE_RATIO = 1e-12


def check_conditioned(graph: FactorGraph) -> None:
    """
    Refuse a graph with a variance so far below the median that the other factors lose all digits.
    """
    tightest = _tightest(graph)
    if tightest is not None:
        what, variable, variance, median = tightest
        raise EstimationError(
            f"{graph.variable_name(variable)}: {what} variance {variance:g} is"
            f" {variance / median:.0e} of the median, {median:g}: badly conditioned; give variances"
            " of more similar size"
        )


def diagnose(graph: FactorGraph, values: GraphValues) -> str | None:
    """
    Name the variable that makes a graph singular at any values; None if the graph is determined.

    The graph is determined if the solver can factorize its normal equations at the values, or near
    them.
    """
    if _is_determined(graph, values) or _is_determined(
        graph, _jittered(values, planar=graph.planar)
    ):
        return None
    weakest = _weakest_direction(graph, values)
    if np.isinf(weakest.sigma):
        why = "nothing measures it"
    elif weakest.sigma < _UNDETERMINED:
        why = "if it moves together with the variables tied to it, no residual changes"
    else:
        why = f"it may stray by {weakest.sigma:.0e} {'rad' if weakest.turns else 'm'}"
    return (
        f"{graph.variable_name(weakest.variable)}: priors, odometry and ranges do not determine its"
        f" {'rotation' if weakest.turns else 'position'}: {why}; singular; add a prior or more"
        " ranges"
    )


def diagnose_start(graph: FactorGraph, values: GraphValues) -> str | None:
    """
    Name a variable that is undetermined at exactly these values but determined near them; None if
    there is none.
    """
    if _is_determined(graph, values):
        return None
    weakest = _weakest_direction(graph, values)
    return (
        f"{graph.variable_name(weakest.variable)}: its"
        f" {'rotation' if weakest.turns else 'position'} is not determined at the start, but near"
        " it: measurements happen to be aligned there; try another start, or add a prior"
    )


def _is_determined(graph: FactorGraph, values: GraphValues) -> bool:
    """True if the solver can factorize the normal equations at some values."""
    return distance_problem(graph).linearize(GraphState.of(values)).step() is not None


def _jittered(values: GraphValues, *, planar: bool) -> GraphValues:
    """Values with a reproducible random displacement and rotation of every variable."""
    rng = np.random.default_rng(0)
    place = np.concatenate([values.position, values.landmark_position])
    extent = float(np.linalg.norm(place - place.mean(axis=0), axis=1).max(initial=0.0)) or 1.0
    shift = _JITTER * extent * rng.standard_normal(place.shape)
    turn = _JITTER * rng.standard_normal(values.position.shape)
    if planar:
        shift[:, 2] = 0.0
        turn[:, :2] = 0.0
    n = len(values.position)
    rotation = matrix_from_quaternion(values.quaternion) @ so3_exp(turn)
    return GraphValues((place + shift)[:n], quaternion_from_matrix(rotation), (place + shift)[n:])


def worst_misfit(graph: FactorGraph, values: GraphValues) -> str:
    """Name the measurement with the largest cost, such as ``A17 and L0 (cost 3e+04)``."""
    problem = distance_problem(graph)
    state = GraphState.of(values)
    variables, cost = problem.factors.worst(state)
    ranges = 0.5 * problem.ranges.whitened(state) ** 2
    if ranges.max(initial=-1.0) > cost:
        variables = graph["range"].variables[ranges.argmax()].tolist()
        cost = float(ranges.max())
    return f"{' and '.join(graph.variable_name(v) for v in variables)} (cost {cost:.3g})"


def _tightest(graph: FactorGraph) -> tuple[str, int, float, float] | None:
    """
    Kind, variable and size of the smallest variance, and the median, if their ratio is too small.
    """
    for unit in ("m", "rad"):
        tables = [
            (
                factors,
                np.diagonal(factors.covariance, axis1=1, axis2=2)[
                    :, factors.kind.rows_in(unit, planar=graph.planar)
                ],
            )
            for factors in graph.tables.values()
        ]
        tables = [(factors, variance.min(axis=1)) for factors, variance in tables if variance.size]
        if not tables:
            continue
        median = float(np.median(np.concatenate([variance for _, variance in tables])))
        for factors, variance in tables:
            if variance.min() < _MIN_VARIANCE_RATIO * median:
                row = int(np.argmin(variance))
                return factors.kind.what, int(factors.subject[row]), float(variance[row]), median
    return None


class _Weakest(NamedTuple):
    """Variable of the largest standard deviation, whether that is its rotation, and its size."""

    variable: int
    turns: bool
    sigma: float  # m or rad


def _weakest_direction(graph: FactorGraph, values: GraphValues) -> _Weakest:
    """
    Find the least determined variable by inverse iteration; its sigma is infinite if no factor
    mentions it.
    """
    information = distance_problem(graph).linearize(GraphState.of(values)).information()
    diagonal = information.diagonal()
    if not (diagonal > 0.0).all():
        free = int(np.argmin(diagonal > 0.0))
        return _Weakest(free // SIZE, free % SIZE < 3, np.inf)
    scale = 1.0 / np.sqrt(diagonal)
    scaled = diags_array(scale) @ information @ diags_array(scale)
    factors = symmetric_factor((scaled + _DAMPING * eye_array(scale.size)).tocsc())
    x = np.random.default_rng(0).standard_normal(scale.size)
    for _ in range(_INVERSE_ITERATIONS):
        x = factors.solve(x)
        x /= np.linalg.norm(x)
    eigenvalue = float(np.dot(x, np.asarray(scaled @ x)))
    stray = np.abs(x * scale) / np.sqrt(max(eigenvalue, _DAMPING))
    furthest = int(np.argmax(stray > 0.999 * stray.max()))
    return _Weakest(furthest // SIZE, furthest % SIZE < 3, float(stray[furthest]))
