"""Gauss-Newton on GTSAM's linear algebra, with Levenberg-Marquardt where it does not descend."""

from dataclasses import replace
from typing import Any, Protocol

import gtsam
import numpy as np

from pymantaray.estimation.losses import Loss
from pymantaray.estimation.solution import Progress, SolveOptions

_RISE = 1e-9  # relative; a smaller rise of the cost is rounding
# Steps in a row that may leave the cost above its lowest: a full step from afar overshoots the rotations,
# and the next one more than makes up for it. (A damped solve from there costs ten full steps.)
_PATIENCE = 2
_CRAWL = 1e-9  # relative fall of the cost at which damped steps from a singular start end
# A variable is undetermined if, given all that are eliminated after it, some direction of it may stray
# by the inverse of this: 1,000 km, or as many radians.
SMALLEST_PIVOT = 1e-6


class Problem(Protocol):
    """A cost to be minimized, of a graph whose ranges are under a loss or, for None, squared."""

    loss: Loss | None

    def error(self, values: Any) -> float:
        """Cost at values."""
        ...

    def linearize(self, values: Any) -> Any:
        """Linear system at values, ranges weighted as the loss has it there; a gtsam.GaussianFactorGraph."""
        ...

    @property
    def stock(self) -> Any:
        """The same as a gtsam.NonlinearFactorGraph, for damped steps."""
        ...

    def under(self, loss: Loss | None) -> "Problem":
        """The same ranges under another loss."""
        ...

    def whitened(self, values: Any) -> Any:
        """Residuals of the ranges in their standard deviations."""
        ...


def step(linear: Any, ordering: Any) -> tuple[Any, Any] | None:
    """
    Step to the optimum of a linear system, and the factorization; None if it is singular.

    GTSAM's Cholesky also takes a rolled pose for singular whose last pivots differ by 4,096.
    """
    try:
        conditionals = linear.eliminateSequential(ordering)
    except RuntimeError:  # GTSAM's IndeterminantLinearSystemException
        return None
    return conditionals.optimize(), conditionals


def optimize(problem: Problem, initial: Any, ordering: Any, options: SolveOptions) -> tuple[Any, Progress]:
    """
    Values that minimize a cost of squares, and how it went.

    Where Gauss-Newton does not get below its lowest cost within three steps or meets a singular system,
    Levenberg-Marquardt takes over from the start; Gauss-Newton polishes its end, unless that moves away again,
    where large residuals make the optimum repel it. The last system solved is undamped, and proves convergence.
    """
    values, progress = _gauss_newton(problem, initial, ordering, options)
    if not (progress.singular or np.isnan(progress.last_step)):
        return values, progress
    damped, iterations = _levenberg_marquardt(problem, initial, ordering, options, singular=progress.singular)
    if iterations == 0:
        return initial, replace(progress, iterations=0, final_cost=progress.initial_cost)
    values, end = _gauss_newton(problem, damped, ordering, options)
    if not (end.singular or end.last_step <= options.step_tolerance):  # repelled, or about to be
        linear = problem.linearize(damped)
        solved = step(linear, ordering)
        values, end = damped, replace(end, iterations=0, final_cost=end.initial_cost)
        if solved is not None:
            end = _evidence(end, linear, *solved)
    return values, replace(end, iterations=iterations + end.iterations, initial_cost=progress.initial_cost)


def _gauss_newton(
    problem: Problem, initial: Any, ordering: Any, options: SolveOptions
) -> tuple[Any, Progress]:
    """Run undamped; a cost that stays above its lowest for too long leaves ``last_step`` NaN."""
    values, cost = initial, float(problem.error(initial))
    lowest, above = cost, 0
    progress = Progress(iterations=0, initial_cost=cost, final_cost=cost)
    for iteration in range(1, options.max_iterations + 1):
        linear = problem.linearize(values)
        solved = step(linear, ordering)
        if solved is None:
            return values, replace(progress, singular=True, last_step=np.nan)
        delta, conditionals = solved
        trial = values.retract(delta)
        trial_cost = float(problem.error(trial))
        above = 0 if trial_cost <= lowest + _RISE * (1.0 + lowest) else above + 1
        if above > _PATIENCE or not np.isfinite(trial_cost):
            return values, replace(progress, last_step=np.nan)
        values, lowest = trial, min(lowest, trial_cost)
        progress = replace(progress, iterations=iteration, final_cost=trial_cost)
        if above == 0 and largest_of(delta) <= options.step_tolerance:
            break
    return values, _evidence(progress, linear, delta, conditionals)


def _evidence(progress: Progress, linear: Any, delta: Any, conditionals: Any) -> Progress:
    """Add what the last undamped system says of convergence."""
    gradient = linear.gradientAtZero()
    # of the square-root information matrix
    pivots = np.concatenate([conditionals.at(i).R().diagonal() for i in range(conditionals.size())])
    return replace(
        progress,
        last_step=largest_of(delta),
        gradient_norm=largest_of(gradient),
        newton_decrement=-0.5 * float(gradient.dot(delta)),
        singular=not np.abs(pivots).min() >= SMALLEST_PIVOT,
    )


def _levenberg_marquardt(
    problem: Problem, initial: Any, ordering: Any, options: SolveOptions, *, singular: bool
) -> tuple[Any, int]:
    """End of damped steps and their number, 0 if they fail."""
    parameters = gtsam.LevenbergMarquardtParams()
    # where Cholesky balks, it would take hundreds of steps damped until it does not
    parameters.setLinearSolverType("SEQUENTIAL_QR" if singular else "SEQUENTIAL_CHOLESKY")
    parameters.setOrdering(ordering)
    # to the last digit: Gauss-Newton may not be able to polish it; a singular graph would crawl on for ever
    parameters.setRelativeErrorTol(_CRAWL if singular else 0.0)
    parameters.setAbsoluteErrorTol(0.0)
    parameters.setMaxIterations(10 * options.max_iterations)
    optimizer = gtsam.LevenbergMarquardtOptimizer(problem.stock, initial, parameters)
    try:
        return optimizer.optimize(), int(optimizer.iterations())
    except RuntimeError:
        return initial, 0


def largest_of(vectors: Any) -> float:
    """Largest component of gtsam.VectorValues."""
    return float(np.abs(vectors.vector()).max())
