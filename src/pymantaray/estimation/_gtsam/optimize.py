"""Gauss-Newton on GTSAM's linear algebra, with Levenberg-Marquardt where it does not descend."""

from dataclasses import replace
from typing import Any

import gtsam
import numpy as np

from pymantaray.estimation.gate import Progress, SolveOptions

_RISE = 1e-9  # relative; a smaller rise of the cost is rounding
# Steps in a row that may leave the cost above its lowest: a full step from afar overshoots the rotations,
# and the next one more than makes up for it. (A damped solve from there costs ten full steps.)
_PATIENCE = 2
# A variable is undetermined if, given all that are eliminated after it, some direction of it may stray
# by the inverse of this: 1,000 km, or as many radians.
_SMALLEST_PIVOT = 1e-6


def optimize(graph: Any, initial: Any, ordering: Any, options: SolveOptions) -> tuple[Any, Progress]:
    """
    Minimize the cost of a graph.

    Gauss-Newton runs until no variable moves by more than the tolerance. If the cost does not fall below its
    lowest within three steps or the linear system cannot be solved, Levenberg-Marquardt takes over from the
    start; Gauss-Newton polishes its end, unless that moves away again, as it does where large residuals make
    the optimum repel it. Either way the last system solved is undamped, and proves convergence or the want
    of it.

    Parameters
    ----------
    graph : gtsam.NonlinearFactorGraph
    initial : gtsam.Values
    ordering : gtsam.Ordering
    options : SolveOptions
        ``max_iterations`` holds for Gauss-Newton; damped steps may be ten times as many.

    Returns
    -------
    values : gtsam.Values
        Where it ended.
    progress : Progress
    """
    values, progress = _gauss_newton(graph, initial, ordering, options)
    if not (progress.singular or np.isnan(progress.last_step)):
        return values, progress
    damped, iterations = _levenberg_marquardt(getattr(graph, "stock", graph), initial, ordering, options)
    if iterations == 0:
        return initial, replace(progress, iterations=0, final_cost=progress.initial_cost)
    values, end = _gauss_newton(graph, damped, ordering, options)
    if np.isnan(end.last_step) and not end.singular:
        linear, conditionals, delta = _undamped_step(graph, damped, ordering)
        values, end = damped, replace(end, iterations=0, final_cost=end.initial_cost)
        if delta is not None:
            end = _evidence(end, linear, conditionals, delta)
    return values, replace(end, iterations=iterations + end.iterations, initial_cost=progress.initial_cost)


def _gauss_newton(graph: Any, initial: Any, ordering: Any, options: SolveOptions) -> tuple[Any, Progress]:
    """Run undamped; a cost that stays above its lowest for too long leaves ``last_step`` NaN."""
    values, cost = initial, float(graph.error(initial))
    lowest, above = cost, 0
    progress = Progress(iterations=0, initial_cost=cost, final_cost=cost)
    for iteration in range(1, options.max_iterations + 1):
        linear, conditionals, delta = _undamped_step(graph, values, ordering)
        if delta is None:
            return values, replace(progress, singular=True, last_step=np.nan)
        trial = values.retract(delta)
        trial_cost = float(graph.error(trial))
        above = 0 if trial_cost <= lowest + _RISE * (1.0 + lowest) else above + 1
        if above > _PATIENCE or not np.isfinite(trial_cost):
            return values, replace(progress, last_step=np.nan)
        values, cost, lowest = trial, trial_cost, min(lowest, trial_cost)
        progress = replace(progress, iterations=iteration, final_cost=cost)
        # the norm costs nothing, the largest component a copy: look at it only where it may be small
        if (
            above == 0
            and delta.norm() <= options.step_tolerance * np.sqrt(6 * delta.size())
            and (_largest(delta) <= options.step_tolerance)
        ):
            break
    return values, _evidence(progress, linear, conditionals, delta)


def _undamped_step(graph: Any, values: Any, ordering: Any) -> tuple[Any, Any, Any]:
    """Linear system at the values, its elimination and its solution; None for the last two if singular."""
    linear = graph.linearize(values)
    try:
        conditionals = linear.eliminateSequential(ordering)
    except RuntimeError:  # GTSAM's IndeterminantLinearSystemException
        return linear, None, None
    return linear, conditionals, conditionals.optimize()


def _evidence(progress: Progress, linear: Any, conditionals: Any, delta: Any) -> Progress:
    """Add what the last undamped system says of convergence."""
    gradient = linear.gradientAtZero()
    return replace(
        progress,
        last_step=_largest(delta),
        gradient_norm=_largest(gradient),
        newton_decrement=-0.5 * float(gradient.dot(delta)),
        singular=not _smallest_pivot(conditionals) >= _SMALLEST_PIVOT,
    )


def _levenberg_marquardt(graph: Any, initial: Any, ordering: Any, options: SolveOptions) -> tuple[Any, int]:
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType("SEQUENTIAL_CHOLESKY")
    parameters.setOrdering(ordering)
    parameters.setRelativeErrorTol(0.0)  # to the last digit: Gauss-Newton may not be able to polish it
    parameters.setAbsoluteErrorTol(0.0)
    parameters.setMaxIterations(10 * options.max_iterations)
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, initial, parameters)
    try:
        return optimizer.optimize(), int(optimizer.iterations())
    except RuntimeError:
        return initial, 0


def _largest(vectors: Any) -> float:
    return float(np.abs(vectors.vector()).max())


def _smallest_pivot(conditionals: Any) -> float:
    """Smallest diagonal entry of the square-root information matrix."""
    return min(float(np.abs(conditionals.at(i).R().diagonal()).min()) for i in range(conditionals.size()))
