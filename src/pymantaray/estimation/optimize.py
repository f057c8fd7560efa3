"""Gauss-Newton on normal equations, with Levenberg-Marquardt where it does not descend."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation.normal_equations import Factor, NormalEquations
from pymantaray.estimation.problems import Problem, State
from pymantaray.estimation.solution import Progress, SolveOptions

Array = NDArray[np.float64]

_RISE = 1e-9  # relative; a smaller rise of the cost is rounding
# Steps in a row that may leave the cost above its lowest: a full step from afar overshoots the rotations,
# and the next one more than makes up for it. (A damped solve from there costs ten full steps.)
_PATIENCE = 2
_QUICK = 100.0  # by which a step with curvature shortens the next
_CRAWL = 1e-9  # relative fall of the cost at which damped steps from a singular start end
_FIRST_DAMPING, _MOST_DAMPING = 1e-5, 1e5  # of the diagonal
_LITTLE = 0.01  # relative fall of the cost at which damped steps take all of its curvature


class LastStep(NamedTuple):
    """The last undamped step: where it started, the factor and the step, in the order of rows."""

    state: State
    factor: Factor
    step: Array


class Optimum(NamedTuple):
    """Where an optimization ended, and how it went."""

    state: State
    progress: Progress
    last: LastStep | None = None


def optimize(problem: Problem, initial: State, options: SolveOptions) -> Optimum:
    """
    Values that minimize a cost of squares, and how it went.

    Where Gauss-Newton does not get below its lowest cost within three steps or meets a singular system, damped steps take
    over: from the start, of a graph without ranges from where it was lowest. Gauss-Newton polishes their end, unless that moves away again,
    where large residuals make the optimum repel it. The last system solved is undamped, and proves convergence.
    """
    first, lowest = _gauss_newton(problem, initial, options)
    progress = first.progress
    if not (progress.singular or np.isnan(progress.last_step)):
        return first
    begin, taken = (lowest, progress.iterations) if problem.bare and not progress.singular else (initial, 0)
    damped, iterations = _levenberg_marquardt(problem, begin, options, taken, singular=progress.singular)
    if iterations == 0 and begin is initial:
        return Optimum(initial, replace(progress, iterations=0, final_cost=progress.initial_cost))
    end, _ = _gauss_newton(problem, damped, options, taken + iterations)
    if not (
        end.progress.singular or end.progress.last_step <= options.step_tolerance
    ):  # repelled, or about to be
        end = prove(problem, damped)
    taken += iterations + end.progress.iterations
    return end._replace(progress=replace(end.progress, iterations=taken, initial_cost=progress.initial_cost))


def prove(problem: Problem, state: State) -> Optimum:
    """A state as it is, with what an undamped step from it, not taken, says of convergence."""
    equations = problem.linearize(state)
    progress = Progress(iterations=0, initial_cost=equations.cost, final_cost=equations.cost)
    factor = equations.factorize()
    if factor is None:
        return Optimum(state, replace(progress, singular=True))
    return _proven(state, progress, equations, LastStep(state, factor, factor.solve(-equations.gradient)))


def _gauss_newton(
    problem: Problem, initial: State, options: SolveOptions, taken: int = 0
) -> tuple[Optimum, State]:
    """
    Run undamped; a cost that stays above its lowest for too long leaves ``last_step`` NaN. Beside, where it was lowest.

    With the curvature of odometry a step leaves a hundredth of the error, without it a sixth; that of distances, from the
    second step on, matters where ranges are off by more than odometry is in doubt. Either is left out as soon as the
    matrix is not positive definite with it, and both of the last step, which proves convergence.
    """
    state, equations, most = initial, problem.linearize(initial, 2), 3
    lowest, above, best = equations.cost, 0, initial
    progress = Progress(iterations=0, initial_cost=lowest, final_cost=lowest)
    for iteration in range(1, options.max_iterations + 1):
        factor = equations.factorize()
        while factor is None and equations.order > 1:
            most = equations.order - 1
            equations = problem.linearize(state, most)
            factor = equations.factorize()
        if factor is None:
            return Optimum(state, replace(progress, singular=True, last_step=np.nan)), best
        last = LastStep(state, factor, factor.solve(-equations.gradient))
        largest = float(np.abs(last.step).max())
        trial = state.moved(problem.structure, last.step)
        ended = equations.order == 1 and largest <= options.step_tolerance
        if largest <= _QUICK * options.step_tolerance:
            most = 1
        ahead = None if ended else problem.linearize(trial, most)
        cost = problem.cost(trial) if ahead is None else ahead.cost
        above = 0 if cost <= lowest + _RISE * (1.0 + lowest) else above + 1
        if above > _PATIENCE or not np.isfinite(cost):
            return Optimum(state, replace(progress, last_step=np.nan)), best
        best = trial if cost < lowest else best
        state, lowest = trial, min(lowest, cost)
        progress = replace(progress, iterations=iteration, final_cost=cost)
        if options.report is not None:
            options.report(taken + iteration, cost)
        if (ended and above == 0) or iteration == options.max_iterations:
            break
        equations = ahead or problem.linearize(trial)
    return _proven(state, progress, equations, last), best


def _proven(state: State, progress: Progress, equations: NormalEquations, last: LastStep) -> Optimum:
    """Add what the last undamped system says of convergence."""
    progress = replace(
        progress,
        last_step=float(np.abs(last.step).max()),
        gradient_norm=float(np.abs(equations.gradient).max()),
        newton_decrement=-0.5 * float(np.sum(equations.gradient * last.step)),
    )
    return Optimum(state, progress, last)


def _levenberg_marquardt(
    problem: Problem, initial: State, options: SolveOptions, taken: int, *, singular: bool
) -> tuple[State, int]:
    """
    End of damped steps and their number: at a minimum, where no damping lowers the cost, or where a singular graph begins to crawl.

    Without ranges poses move along arcs, so that a chain may turn as a whole; ranges tie it to other chains, and from afar arcs end
    in other minima. Where a step along arcs gained little Gauss-Newton's matrix is not the cost's own: then that with all of the
    curvature is asked first. Away from a minimum it is not positive definite.
    """
    state, damping, fall = initial, _FIRST_DAMPING, np.inf
    for iteration in range(10 * options.max_iterations):
        matrices = [problem.linearize(state)]
        if fall <= _LITTLE and problem.bare and not singular:
            matrices.insert(0, problem.linearize(state, 4))
        before = matrices[0].cost
        damped = _damped_step(problem, state, matrices, damping, options.step_tolerance)
        if damped is None:
            return state, iteration
        state, cost, damping = damped
        fall = (before - cost) / before
        if options.report is not None:
            options.report(taken + iteration + 1, cost)
        if singular and fall <= _CRAWL:
            return state, iteration + 1
        damping *= 0.1
    return state, 10 * options.max_iterations


class _DampedStep(NamedTuple):
    """Where a damped step led, its cost and its damping."""

    state: State
    cost: float
    damping: float


def _damped_step(
    problem: Problem, state: State, matrices: list[NormalEquations], damping: float, tolerance: float
) -> _DampedStep | None:
    """
    First step that lowers the cost, by ever more damping; None if there is none, or hardly damped ones are within tolerance.

    Of two matrices the first is no longer asked when it is not positive definite.
    """
    while damping <= _MOST_DAMPING:
        for equations in list(matrices):
            factor = equations.damped(damping).factorize()
            if factor is None and len(matrices) > 1:
                matrices.remove(equations)
            elif factor is not None:
                step = factor.solve(-equations.gradient)
                if damping <= _FIRST_DAMPING and float(np.abs(step).max()) <= tolerance:
                    return None
                trial = state.moved(problem.structure, step, arc=problem.bare)
                cost = problem.cost(trial)
                if cost < equations.cost:
                    return _DampedStep(trial, cost, damping)
        damping *= 10.0
    return None
