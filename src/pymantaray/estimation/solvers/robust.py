"""Descent under a robust loss: re-weighted steps with a line search, graduated or not."""

from dataclasses import replace

import numpy as np

from pymantaray.arrays import Array
from pymantaray.estimation.solvers.optimize import Optimum, optimize
from pymantaray.estimation.solvers.problems import GraphState, Problem
from pymantaray.estimation.solvers.solution import SolveOptions, SolveProgress

ROBUST_STEPS = 300  # smallest limit: re-weighting takes more steps than least squares
_MAX_STEP_FACTOR = 64.0  # times the step of the re-weighted system
_MIN_STEP_FACTOR = 1e-4
_POLISH_STEPS = 50  # full steps at most
_CONTROL_RATIO = 1.4  # ratio of control parameters of successive surrogates, GTSAM's default
_SURROGATE_OPTIONS = SolveOptions(step_tolerance=1.0, max_iterations=1)  # of one surrogate
_LEAST_SQUARES_OPTIONS = SolveOptions(step_tolerance=1.0)


def optimize_robust(problem: Problem, initial: GraphState, options: SolveOptions) -> Optimum:
    """
    Minimize the cost of a problem under its loss, by graduated non-convexity if the loss is
    graduated.

    The step of iteratively re-weighted least squares always reduces the cost, but is too short if
    the losses are flatter than their weights imply, and too long if rotations change much: a line
    search doubles or halves it.

    A graduated loss begins with the least-squares optimum. Its largest residual r gives the first
    control parameter 2 r²/k², for which the surrogate is convex over all residuals. Each surrogate
    takes one step; the parameter decreases by a factor of 1.4 until it is 1 and the surrogate
    equals the loss.
    """
    loss = problem.loss
    if loss is None:
        return optimize(problem, initial, options)
    options = replace(options, max_iterations=max(options.max_iterations, ROBUST_STEPS))
    if not loss.graduated:
        return _descend(problem, initial, options)
    progress, state = _descend_steps(problem.under(None), initial, _LEAST_SQUARES_OPTIONS)
    steps = progress.iterations
    largest = float(np.abs(problem.ranges.whitened(state)).max(initial=0.0))
    control = 2.0 * (largest / loss.scale) ** 2
    while control > 1.0 and not progress.singular:
        surrogate = problem.under(replace(loss, scale=loss.scale * np.sqrt(control)))
        progress, state = _descend_steps(surrogate, state, _SURROGATE_OPTIONS)
        steps += progress.iterations
        control /= _CONTROL_RATIO
    end = _descend(problem, state, options)
    taken = steps + end.progress.iterations
    cost = problem.cost(initial)
    return end._replace(progress=replace(end.progress, iterations=taken, initial_cost=cost))


def _descend(problem: Problem, initial: GraphState, options: SolveOptions) -> Optimum:
    """Descend with a line search, then measure convergence."""
    progress, state = _descend_steps(problem, initial, options)
    if progress.singular or not np.isfinite(progress.final_cost):
        return Optimum(state, progress)
    # further full steps measure convergence when costs no longer differ
    end = optimize(problem, state, replace(options, max_iterations=_POLISH_STEPS))
    proof = end.progress
    if not proof.final_cost <= proof.initial_cost + 1e-9 * (1.0 + proof.initial_cost):
        end = Optimum(state, proof)
        proof = replace(proof, final_cost=proof.initial_cost, last_step=np.nan)
    taken = progress.iterations + proof.iterations
    return end._replace(
        progress=replace(proof, iterations=taken, initial_cost=progress.initial_cost)
    )


def _descend_steps(
    problem: Problem, initial: GraphState, options: SolveOptions
) -> tuple[SolveProgress, GraphState]:
    """Descend with a line search; progress has no gradient and decrement."""
    state = initial
    cost = problem.cost(initial)
    progress = SolveProgress(iterations=0, initial_cost=cost, final_cost=cost)
    for iteration in range(1, options.max_iterations + 1):
        solved = problem.linearize(state, begin=True).step()
        if solved is None:
            return replace(progress, singular=True), state
        _, step = solved
        lower, lower_cost = _along(problem, state, step, cost)
        if lower is None:
            break
        state = lower
        cost = lower_cost
        largest = float(np.abs(step).max())
        progress = replace(progress, iterations=iteration, final_cost=cost, last_step=largest)
        if largest <= options.step_tolerance:
            break
    return progress, state


def _along(
    problem: Problem, state: GraphState, step: Array, cost: float
) -> tuple[GraphState | None, float]:
    """State of lowest cost among power-of-two multiples of a step; None if none lowers the cost."""
    factor = 1.0
    best = state.after_step(problem.structure, step)
    lowest = problem.cost(best)
    if lowest < cost:
        while factor < _MAX_STEP_FACTOR:
            factor *= 2.0
            trial = state.after_step(problem.structure, factor * step)
            trial_cost = problem.cost(trial)
            if not trial_cost < lowest:
                break
            best = trial
            lowest = trial_cost
        return best, lowest
    while factor > _MIN_STEP_FACTOR:
        factor *= 0.5
        trial = state.after_step(problem.structure, factor * step)
        trial_cost = problem.cost(trial)
        if trial_cost < cost:
            return trial, trial_cost
    return None, cost
