"""Why a graph cannot be solved: one line that names a variable."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation.graph import FactorGraph, GraphValues

Array = NDArray[np.float64]

_FREE = 1e6  # m or rad; what may stray so far counts as undetermined, here as in the solver
_SINGULAR = 1e-15  # eigenvalue of the scaled information; rounding leaves some 1e-17 of zero
_SPREAD = 1e-12  # variances this far below the median leave no digits for the others


def diagnose(graph: FactorGraph, values: GraphValues) -> str | None:
    """
    Say which variable makes a graph singular or badly conditioned.

    Parameters
    ----------
    graph : FactorGraph
        Must pass `pymantaray.estimation.graph.check_graph`.
    values : GraphValues
        Where the question is asked: what ranges determine depends on the geometry.

    Returns
    -------
    str or None
        One line, or None if nothing of the kind is found.

    Notes
    -----
    The weakest direction is the eigenvector of the least eigenvalue of the information matrix, scaled to a
    unit diagonal. It counts as undetermined if the eigenvalue is zero to working precision, or the standard
    deviation of some variable along it exceeds 1,000 km or as many radians. Conditioning is judged
    by the variances: one 1e-12 times the median of its kind, metres or radians, drowns the rest in rounding.
    """
    from pymantaray.estimation._gtsam.weakest import weakest_direction

    found = _tightest(graph)
    if found is not None:
        what, variable, variance, median = found
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


def worst_misfit(graph: FactorGraph, values: GraphValues) -> str:
    """
    Say which measurement fits the values worst.

    Parameters
    ----------
    graph : FactorGraph
        Must pass `pymantaray.estimation.graph.check_graph`, and have a measurement.
    values : GraphValues

    Returns
    -------
    str
        Names of the variables it is about and its share of the cost, such as ``A17 and L0 (cost 3e+04)``.
    """
    from pymantaray.estimation._gtsam.weakest import worst_factor

    variables, cost = worst_factor(graph, values)
    return f"{' and '.join(graph.variable_name(v) for v in variables)} (cost {cost:.3g})"


def _tightest(graph: FactorGraph) -> tuple[str, int, float, float] | None:
    """Kind, variable and size of the smallest variance, and the median, if the two are too far apart."""
    n = graph.n_poses
    edge, prior = (np.diagonal(c, axis1=1, axis2=2) for c in (graph.edge_covariance, graph.prior_covariance))
    fix, survey = (np.diagonal(c, axis1=1, axis2=2) for c in (graph.fix_covariance, graph.survey_covariance))
    lengths: list[tuple[str, NDArray[np.int32], Array]] = [
        ("odometry", graph.edge_to, edge[:, 3:].min(axis=1, initial=np.inf)),
        ("first-pose prior", graph.prior_pose, prior[:, 3:].min(axis=1, initial=np.inf)),
        ("GNSS fix", graph.fix_pose, fix.min(axis=1, initial=np.inf)),
        ("depth", graph.depth_pose, graph.depth_variance),
        ("landmark prior", graph.survey_landmark + n, survey.min(axis=1, initial=np.inf)),
        ("range", graph.range_first, graph.range_variance),
    ]
    angles = [
        ("odometry", graph.edge_to, edge[:, :3].min(axis=1, initial=np.inf)),
        ("first-pose prior", graph.prior_pose, prior[:, :3].min(axis=1, initial=np.inf)),
    ]
    for tables in (lengths, angles):
        everything = np.concatenate([variance for _, _, variance in tables])
        if everything.size == 0:
            continue
        median = float(np.median(everything))
        for what, variables, variance in tables:
            if variance.size and variance.min() < _SPREAD * median:
                row = int(np.argmin(variance))
                return what, int(variables[row]), float(variance[row]), median
    return None
