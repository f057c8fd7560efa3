"""Descent under a robust loss: re-weighted steps with a line search, graduated or not."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation.optimize import Optimum, optimize
from pymantaray.estimation.problems import Problem, State
from pymantaray.estimation.solution import Progress, SolveOptions

ROBUST_STEPS = 300  # allowed at least: re-weighting takes more of them than least squares
_LONGEST = 64.0  # times the step that the re-weighted system asks for
_SHORTEST = 1e-4
_POLISH = 50  # full steps at most
_NARROW = 1.4  # by which the control parameter falls from one surrogate to the next, GTSAM's default
_ROUGH = SolveOptions(step_tolerance=1.0, max_iterations=1)  # of one surrogate
_FIRST = SolveOptions(step_tolerance=1.0)


def optimize_robust(problem: Problem, initial: State, options: SolveOptions) -> Optimum:
    """
    Values that minimize the cost of a problem under its loss, by graduated non-convexity if that says so, and how it went.

    The step, of iteratively re-weighted least squares, always points downhill, but is too short where the losses
    are flatter than their weights say, and too long where rotations turn far: a line search doubles or halves it.

    Graduated, the least-squares optimum comes first; its largest residual r gives the first control parameter
    2 r²/k², for which the surrogate is convex over all residuals. It falls by a factor of 1.4 from one
    surrogate to the next, each descended by one step, until it is 1 and the surrogate the loss.
    """
    loss = problem.loss
    if loss is None:
        return optimize(problem, initial, options)
    options = replace(options, max_iterations=max(options.max_iterations, ROBUST_STEPS))
    if not loss.graduated:
        return _descend(problem, initial, options)
    progress, state = _descend_steps(problem.under(None), initial, _FIRST)
    steps = progress.iterations
    largest = float(np.abs(problem.whitened(state)).max(initial=0.0))
    control = 2.0 * (largest / loss.scale) ** 2
    while control > 1.0 and not progress.singular:
        surrogate = problem.under(replace(loss, scale=loss.scale * np.sqrt(control)))
        progress, state = _descend_steps(surrogate, state, _ROUGH)
        steps += progress.iterations
        control /= _NARROW
    end = _descend(problem, state, options)
    taken, cost = steps + end.progress.iterations, problem.cost(initial)
    return end._replace(progress=replace(end.progress, iterations=taken, initial_cost=cost))


def _descend(problem: Problem, initial: State, options: SolveOptions) -> Optimum:
    """Steps along the line search, then a proof of convergence or of the want of it."""
    progress, state = _descend_steps(problem, initial, options)
    if progress.singular or not np.isfinite(progress.final_cost):
        return Optimum(state, progress)
    # one full step more is the proof; some more where costs no longer differ, but steps do
    end = optimize(problem, state, replace(options, max_iterations=_POLISH))
    proof = end.progress
    if not proof.final_cost <= proof.initial_cost + 1e-9 * (1.0 + proof.initial_cost):
        end, proof = Optimum(state, proof), replace(proof, final_cost=proof.initial_cost, last_step=np.nan)
    taken = progress.iterations + proof.iterations
    return end._replace(progress=replace(proof, iterations=taken, initial_cost=progress.initial_cost))


def _descend_steps(problem: Problem, initial: State, options: SolveOptions) -> tuple[Progress, State]:
    """Steps along the line search; their progress is without gradient and decrement."""
    state, cost = initial, problem.cost(initial)
    progress = Progress(iterations=0, initial_cost=cost, final_cost=cost)
    for iteration in range(1, options.max_iterations + 1):
        equations = problem.linearize(state)
        factor = equations.factorize()
        if factor is None:
            return replace(progress, singular=True), state
        step = factor.solve(-equations.gradient)
        lower, lower_cost = _along(problem, state, step, cost)
        if lower is None:
            break
        state, cost = lower, lower_cost
        largest = float(np.abs(step).max())
        progress = replace(progress, iterations=iteration, final_cost=cost, last_step=largest)
        if largest <= options.step_tolerance:
            break
    return progress, state


def _along(
    problem: Problem, state: State, step: NDArray[np.float64], cost: float
) -> tuple[State | None, float]:
    """State of lowest cost among multiples of a step that are powers of two; None if none lowers it."""
    factor, best = 1.0, state.moved(problem.structure, step)
    lowest = problem.cost(best)
    if lowest < cost:
        while factor < _LONGEST:
            factor *= 2.0
            trial = state.moved(problem.structure, factor * step)
            trial_cost = problem.cost(trial)
            if not trial_cost < lowest:
                break
            best, lowest = trial, trial_cost
        return best, lowest
    while factor > _SHORTEST:
        factor *= 0.5
        trial = state.moved(problem.structure, factor * step)
        trial_cost = problem.cost(trial)
        if trial_cost < cost:
            return trial, trial_cost
    return None, cost
