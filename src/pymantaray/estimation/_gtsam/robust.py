"""Descent under a robust loss: re-weighted steps with a line search, graduated or not."""

from dataclasses import replace
from typing import Any

import numpy as np

from pymantaray.estimation._gtsam.optimize import Problem, largest_of, optimize, step
from pymantaray.estimation.solution import Progress, SolveOptions

ROBUST_STEPS = 300  # allowed at least: re-weighting takes more of them than least squares
_LONGEST = 64.0  # times the step that the re-weighted system asks for
_SHORTEST = 1e-4
_POLISH = 50  # full steps at most
_NARROW = 1.4  # by which the control parameter falls from one surrogate to the next, GTSAM's default
_ROUGH = SolveOptions(step_tolerance=1.0, max_iterations=1)  # of one surrogate
_FIRST = SolveOptions(step_tolerance=1.0)


def optimize_robust(
    problem: Problem, initial: Any, ordering: Any, options: SolveOptions
) -> tuple[Any, Progress]:
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
        return optimize(problem, initial, ordering, options)
    options = replace(options, max_iterations=max(options.max_iterations, ROBUST_STEPS))
    if not loss.graduated:
        return _descend(problem, initial, ordering, options)
    progress, values = _descend_steps(problem.under(None), initial, ordering, _FIRST)
    steps = progress.iterations
    largest = float(np.abs(problem.whitened(values)).max(initial=0.0))
    control = 2.0 * (largest / loss.scale) ** 2
    while control > 1.0 and not progress.singular:
        surrogate = problem.under(replace(loss, scale=loss.scale * np.sqrt(control)))
        progress, values = _descend_steps(surrogate, values, ordering, _ROUGH)
        steps += progress.iterations
        control /= _NARROW
    values, progress = _descend(problem, values, ordering, options)
    return values, replace(
        progress, iterations=steps + progress.iterations, initial_cost=float(problem.error(initial))
    )


def _descend(problem: Problem, initial: Any, ordering: Any, options: SolveOptions) -> tuple[Any, Progress]:
    """Steps along the line search, then a proof of convergence or of the want of it."""
    progress, values = _descend_steps(problem, initial, ordering, options)
    if progress.singular or not np.isfinite(progress.final_cost):
        return values, progress
    # one full step more is the proof; some more where costs no longer differ, but steps do
    end, proof = optimize(problem, values, ordering, replace(options, max_iterations=_POLISH))
    if not proof.final_cost <= proof.initial_cost + 1e-9 * (1.0 + proof.initial_cost):
        end, proof = values, replace(proof, final_cost=proof.initial_cost, last_step=np.nan)
    return end, replace(
        proof, iterations=progress.iterations + proof.iterations, initial_cost=progress.initial_cost
    )


def _descend_steps(
    problem: Problem, initial: Any, ordering: Any, options: SolveOptions
) -> tuple[Progress, Any]:
    """Steps along the line search; their progress is without gradient and decrement."""
    values, cost = initial, float(problem.error(initial))
    progress = Progress(iterations=0, initial_cost=cost, final_cost=cost)
    for iteration in range(1, options.max_iterations + 1):
        solved = step(problem.linearize(values), ordering)
        if solved is None:
            return replace(progress, singular=True), values
        lower, lower_cost = _along(problem, values, solved[0], cost)
        if lower is None:
            break
        values, cost = lower, lower_cost
        largest = largest_of(solved[0])
        progress = replace(progress, iterations=iteration, final_cost=cost, last_step=largest)
        if largest <= options.step_tolerance:
            break
    return progress, values


def _along(problem: Problem, values: Any, delta: Any, cost: float) -> tuple[Any, float]:
    """Values of lowest cost among multiples of a step that are powers of two; None if none lowers it."""
    factor, best = 1.0, values.retract(delta)
    lowest = float(problem.error(best))
    if lowest < cost:
        while factor < _LONGEST:
            factor *= 2.0
            trial = values.retract(delta.scale(factor))
            trial_cost = float(problem.error(trial))
            if not trial_cost < lowest:
                break
            best, lowest = trial, trial_cost
        return best, lowest
    while factor > _SHORTEST:
        factor *= 0.5
        trial = values.retract(delta.scale(factor))
        trial_cost = float(problem.error(trial))
        if trial_cost < cost:
            return trial, trial_cost
    return None, cost
