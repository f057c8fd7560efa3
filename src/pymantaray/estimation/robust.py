"""Batch solves with robust losses on the ranges; gtsam is loaded at first use."""

from dataclasses import replace
from typing import Any

from pymantaray.estimation.gate import Progress, SolveOptions, gate
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph, check_values
from pymantaray.estimation.losses import Loss, whitened_ranges
from pymantaray.estimation.solution import Solution, judged


def solve_robust(
    graph: FactorGraph, initial: GraphValues, loss: Loss, *, options: SolveOptions | None = None
) -> Solution:
    """
    Solve one graph with a robust loss on its ranges, and least squares on everything else.

    Parameters
    ----------
    graph : FactorGraph
        Its ranges are taken as distances.
    initial : GraphValues
        Where to start. Where the loss is not convex the end depends on it: judge from dead reckoning, for the truth
        hides local minima.
    loss : Loss
        For example ``LOSSES["huber"]``.
    options : SolveOptions, optional

    Returns
    -------
    Solution
        Its costs are robust ones, and ``expected_cost`` is NaN.

    Raises
    ------
    EstimationError
        If a measurement or a noise level of the graph, or the start, cannot be used.

    Notes
    -----
    The health gate asks for what it asks of every solve: a step was taken, the robust cost fell, the system
    re-weighted at the end is regular, and one more step of it is short and promises to gain nothing. It does not
    ask for a cost within chi-square bounds, since a robust cost has no chi-square distribution, whether
    there are outliers or not. A stationary point passes, and may be a local minimum.

    See Also
    --------
    pymantaray.estimation.losses.range_weights : which ranges the solution does not believe.
    """
    from pymantaray.estimation._gtsam.factors import FactorBuilder, to_graph_values

    check_graph(graph)
    check_values(graph, initial)
    builder, options = FactorBuilder(), options or SolveOptions()
    values, progress = minimize_robust(builder, builder.base(graph), graph, loss, initial, options)
    return robust_solution(to_graph_values(values, initial), progress, options)


def minimize_robust(
    builder: Any, common: Any, graph: FactorGraph, loss: Loss, initial: GraphValues, options: SolveOptions
) -> tuple[Any, Progress]:
    """
    Minimize the cost of a graph that shares what is common to several.

    Parameters
    ----------
    builder : FactorBuilder
    common : gtsam.NonlinearFactorGraph
        All factors of the graph but its ranges.
    graph : FactorGraph
    loss : Loss
    initial : GraphValues
    options : SolveOptions
        At least 300 steps are allowed.

    Returns
    -------
    values : gtsam.Values
    progress : Progress
    """
    from pymantaray.estimation._gtsam.factors import to_graph_values
    from pymantaray.estimation._gtsam.graduated import ROBUST_STEPS, minimize
    from pymantaray.estimation._gtsam.robust import robust_factors

    return minimize(
        lambda narrowed: robust_factors(builder, common, graph, narrowed),
        lambda values: whitened_ranges(graph, to_graph_values(values, initial)),
        loss,
        builder.values(initial),
        builder.ordering(graph, builder.with_ranges(common, graph)),
        replace(options, max_iterations=max(options.max_iterations, ROBUST_STEPS)),
    )


def robust_solution(found: GraphValues, progress: Progress, options: SolveOptions) -> Solution:
    """
    Verdict on one solve whose cost has no chi-square distribution.

    Parameters
    ----------
    found : GraphValues
        Where it ended.
    progress : Progress
    options : SolveOptions

    Returns
    -------
    Solution
    """
    return judged(found, progress, gate(progress, 0, options, model_is_right=False))
