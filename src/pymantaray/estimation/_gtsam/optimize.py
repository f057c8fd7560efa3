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
_CRAWL = 1e-9  # relative fall of the cost at which damped steps from a singular start end
# Steps of less than this, in m or rad, hardly change the linear system: the next ones may do without a new factorization,
# as long as each is shorter than the one before by the second factor.
_NEAR, _CONTRACTION = 5e-3, 0.5
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
    solver = "SEQUENTIAL_CHOLESKY"
    try:
        graph.linearize(initial).eliminateSequential(ordering)
    except RuntimeError:  # where Cholesky balks, it takes hundreds of steps damped until it does not
        solver = "SEQUENTIAL_QR"
    damped, iterations = _levenberg_marquardt(
        getattr(graph, "stock", graph), initial, ordering, options, solver, progress.singular
    )
    if iterations == 0:
        return initial, replace(progress, iterations=0, final_cost=progress.initial_cost)
    values, end = _gauss_newton(graph, damped, ordering, options)
    if not (end.singular or end.last_step <= options.step_tolerance):  # repelled, or about to be
        linear = graph.linearize(damped)
        conditionals = _eliminated(linear, ordering)
        values, end = damped, replace(end, iterations=0, final_cost=end.initial_cost)
        if conditionals is not None:
            end = _evidence(end, linear, conditionals, conditionals.optimize())
    return values, replace(end, iterations=iterations + end.iterations, initial_cost=progress.initial_cost)


def _gauss_newton(graph: Any, initial: Any, ordering: Any, options: SolveOptions) -> tuple[Any, Progress]:
    """Run undamped; a cost that stays above its lowest for too long leaves ``last_step`` NaN."""
    values, cost = initial, float(graph.error(initial))
    lowest, above, largest, keep = cost, 0, np.inf, False
    conditionals: Any = None
    progress = Progress(iterations=0, initial_cost=cost, final_cost=cost)
    for iteration in range(1, options.max_iterations + 1):
        linear = graph.linearize(values)
        if keep:
            whitened = conditionals.backSubstituteTranspose(linear.gradientAtZero())
            delta = conditionals.backSubstitute(whitened).scale(-1.0)
        else:
            conditionals = _eliminated(linear, ordering)
            if conditionals is None:
                return values, replace(progress, singular=True, last_step=np.nan)
            delta = conditionals.optimize()
        trial = values.retract(delta)
        trial_cost = float(graph.error(trial))
        above = 0 if trial_cost <= lowest + _RISE * (1.0 + lowest) else above + 1
        if above > _PATIENCE or not np.isfinite(trial_cost):
            return values, replace(progress, last_step=np.nan)
        values, cost, lowest = trial, trial_cost, min(lowest, trial_cost)
        progress = replace(progress, iterations=iteration, final_cost=cost)
        before = largest
        # the norm costs nothing, the largest component a copy: look at it only where it may be small
        small = delta.norm() <= max(_NEAR, options.step_tolerance) * np.sqrt(6 * delta.size())
        largest = _largest(delta) if small else np.inf
        if above == 0 and largest <= options.step_tolerance:
            break
        keep = above == 0 and largest <= min(_NEAR, _CONTRACTION * before)
    return values, _evidence(progress, linear, conditionals, delta)


def _eliminated(linear: Any, ordering: Any) -> Any:
    """
    Factorization of a linear system; None if it is singular.

    GTSAM's Cholesky also refuses a pose whose pivots differ by some 4,000, such as a depth of 0.1 mm among odometry of
    metres; QR tells it from a singular one, with no square of a measurement's precision.
    """
    try:
        return linear.eliminateSequential(ordering)
    except RuntimeError:  # GTSAM's IndeterminantLinearSystemException
        return _eliminated_by_qr(linear, ordering)


def _eliminated_by_qr(linear: Any, ordering: Any) -> Any:
    """Same, variable by variable: GTSAM's Python has no QR of a whole graph that shows its factors."""
    place = {ordering.at(i): i for i in range(ordering.size())}
    waiting: list[Any] = [
        gtsam.GaussianFactorGraph() for _ in place
    ]  # by the first variable to be eliminated

    def wait(factor: Any) -> None:
        keys = [] if factor is None else factor.keys()
        if keys:
            waiting[min(place[key] for key in keys)].push_back(factor)

    for i in range(linear.size()):
        wait(linear.at(i))
    conditionals = gtsam.GaussianBayesNet()
    try:
        for key, factors in zip(place, waiting, strict=True):
            one = gtsam.Ordering()
            one.push_back(key)
            conditional, rest = gtsam.EliminateQR(factors, one)
            conditionals.push_back(conditional)
            wait(rest)
    except (RuntimeError, ValueError):  # fewer rows than a variable has axes
        return None
    return conditionals if _smallest_pivot(conditionals) >= _SMALLEST_PIVOT else None


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


def _levenberg_marquardt(
    graph: Any, initial: Any, ordering: Any, options: SolveOptions, solver: str, singular: bool
) -> tuple[Any, int]:
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setLinearSolverType(solver)
    parameters.setOrdering(ordering)
    # to the last digit: Gauss-Newton may not be able to polish it; a singular graph would crawl on for ever
    parameters.setRelativeErrorTol(_CRAWL if singular else 0.0)
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
    rows = [conditionals.at(i).R().diagonal() for i in range(conditionals.size())]
    return float(np.abs(np.concatenate(rows)).min())
