"""Why a graph cannot be solved: one line that names a variable."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.graph import KINDS, FactorGraph, GraphValues

Array = NDArray[np.float64]

_FREE = 1e6  # m or rad; what may stray so far counts as undetermined, here as in the solver
_SINGULAR = 1e-15  # eigenvalue of the scaled information; rounding leaves some 1e-17 of zero
_PIVOTS = 4096.0  # ratio of standard deviations that GTSAM's Cholesky takes for singular
_SPREAD = 1e-12  # variances this far below the median leave no digits for the others


def diagnose(graph: FactorGraph, values: GraphValues) -> str | None:
    """
    Say in one line which variable makes a graph singular or badly conditioned, if one does.

    Judged by the weakest direction of the information matrix, scaled to a unit diagonal, and by the smallest variance
    of metres or radians against the median.
    """
    from pymantaray.estimation._gtsam.marginals import weakest_direction

    tightest = _tightest(graph)
    if tightest is not None:
        what, variable, variance, median = tightest
        return (
            f"{graph.variable_name(variable)}: {what} variance {variance:g} is {variance / median:.0e} of the median,"
            f" {median:g}: badly conditioned; needs variances of more like size"
        )
    weakest = weakest_direction(graph, values)
    if weakest.eigenvalue >= _SINGULAR and weakest.sigma < _FREE:
        return None
    if np.isinf(weakest.sigma):
        why = "nothing measures it"
    elif weakest.eigenvalue < _SINGULAR:
        why = "it may move, with what it is tied to, and nothing would change"
    else:
        why = f"it may stray by {weakest.sigma:.0e} {'rad' if weakest.turns else 'm'}"
    return (
        f"{graph.variable_name(weakest.variable)}: priors, odometry and ranges do not determine its"
        f" {'rotation' if weakest.turns else 'position'}: {why}; singular, needs a prior or more ranges"
    )


def refuse_sharp_depths(graph: FactorGraph, values: GraphValues) -> None:
    """
    Refuse depths too good for the solver, in a graph that it takes for singular and that is not.

    GTSAM's Cholesky gives up where the last two pivots of a pose differ by 4,096, as those of a rolled
    vehicle do whose depth is so much better known than where its odometry leads to.
    """
    depth, edge = graph["depth"], graph["edge"]
    largest = np.zeros(graph.n_poses)
    for end in edge.variables.T:
        np.maximum.at(largest, end, np.sqrt(edge.variance[:, 3:].max(axis=1)))
    sigma, odometry = np.sqrt(depth.variance), largest[depth.subject]
    sharp = sigma < odometry / _PIVOTS
    if sharp.any() and diagnose(graph, values) is None:
        row = int(np.argmax(sharp))
        raise EstimationError(
            f"{graph.variable_name(int(depth.subject[row]))}: depth sigma is {sigma[row]:g} m where odometry has"
            f" {odometry[row]:.3g} m, too much better for the solver: needs {odometry[row] / _PIVOTS:.2g} m or more"
        )


def worst_misfit(graph: FactorGraph, values: GraphValues) -> str:
    """Say which measurement fits the values worst, such as ``A17 and L0 (cost 3e+04)``."""
    from pymantaray.estimation._gtsam.marginals import worst_factor

    variables, cost = worst_factor(graph, values)
    return f"{' and '.join(graph.variable_name(v) for v in variables)} (cost {cost:.3g})"


def _tightest(graph: FactorGraph) -> tuple[str, int, float, float] | None:
    """Kind, variable and size of the smallest variance, and the median, if the two are too far apart."""
    for unit in ("m", "rad"):
        tables = [
            (factors, np.diagonal(factors.covariance, axis1=1, axis2=2)[:, factors.kind.rows_in(unit)])
            for factors in (graph[name] for name in KINDS)
        ]
        tables = [(factors, variance.min(axis=1)) for factors, variance in tables if variance.size]
        if not tables:
            continue
        median = float(np.median(np.concatenate([variance for _, variance in tables])))
        for factors, variance in tables:
            if variance.min() < _SPREAD * median:
                row = int(np.argmin(variance))
                return factors.kind.what, int(factors.subject[row]), float(variance[row]), median
    return None
