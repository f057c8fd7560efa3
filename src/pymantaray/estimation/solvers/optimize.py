"""Gauss-Newton on normal equations, with Levenberg-Marquardt if it does not descend."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array
from pymantaray.estimation.solvers.normal_equations import Factor, NormalEquations
from pymantaray.estimation.solvers.problems import GraphState, Problem
from pymantaray.estimation.solvers.solution import SolveOptions, SolveProgress

_COST_ROUNDING = 1e-9  # relative; smaller increases of the cost are rounding
# Successive steps that may leave the cost above its lowest value: a full step from far away
# overshoots the rotations, and the next one compensates. (A damped solve from there costs ten full
# steps.)
_MAX_RISES = 2
_CURVATURE_GAIN = 100.0  # factor by which a step with curvature shortens the next step
_HIGHEST_ORDER = 3  # of the matrices of undamped steps
_FULL_ORDER = 4  # of those of damped steps
_SLOW = 0.5  # ratio of successive steps with curvature; with large residuals it approaches 1
_MAX_SLOW = 3  # such steps before the curvature is given up
_MAX_STALLED = 10  # such steps without curvature before damped steps take over
_MAX_INDEFINITE = 2  # indefinite matrices of an order before it is given up
# relative decrease of the cost at which damped steps from a singular start end
_STALLED_FALL = 1e-9
_FIRST_DAMPING = 1e-5  # of the diagonal
_MAX_DAMPING = 1e5
_SMALL_FALL = 0.01  # relative decrease of the cost below which damped steps use full curvature
_RATE_STEPS = 10  # damped steps whose mean decrease of the cost is compared with a rival's cost


class LastStep(NamedTuple):
    """Last undamped step: its starting state, factor and step, in the order of rows."""

    state: GraphState
    factor: Factor
    step: Array


class Optimum(NamedTuple):
    """Final state of an optimization and its progress."""

    state: GraphState
    progress: SolveProgress
    last: LastStep | None = None


def optimize(problem: Problem, initial: GraphState, options: SolveOptions) -> Optimum:
    """
    Minimize a least-squares cost.

    If Gauss-Newton does not fall below its lowest cost within three steps, meets a singular system,
    or takes ten steps that do not become shorter, damped steps take over, from the start or,
    without ranges or after such steps, from the state of lowest cost. Gauss-Newton then refines
    their result, unless it diverges because of large residuals. The last system is undamped, and
    its step measures convergence. Damped steps that fall too slowly to reach the rival's cost end
    the descent without convergence.
    """
    first, lowest = _gauss_newton(problem, initial, options)
    progress = first.progress
    stalled = progress.iterations >= _MAX_STALLED
    if not (progress.singular or np.isnan(progress.last_step)):
        return first
    # with ranges, the lowest state may be in the basin of another minimum: damp from the start
    begin = initial
    taken = 0
    if (problem.without_ranges or stalled) and not progress.singular:
        begin = lowest
        taken = progress.iterations
    damped, iterations, given_up = _levenberg_marquardt(
        problem, begin, options, taken, singular=progress.singular
    )
    if iterations == 0 and begin is initial:
        return Optimum(initial, replace(progress, iterations=0, final_cost=progress.initial_cost))
    if given_up:
        cost = problem.cost(damped)
        taken += iterations
        return Optimum(damped, replace(progress, iterations=taken, final_cost=cost, singular=False))
    end, _ = _gauss_newton(problem, damped, options, taken + iterations)
    # undamped steps left the minimum of large residuals, or are about to: keep the damped result
    if not (end.progress.singular or end.progress.last_step <= options.step_tolerance):
        end = check_convergence(problem, damped)
    taken += iterations + end.progress.iterations
    return end._replace(
        progress=replace(end.progress, iterations=taken, initial_cost=progress.initial_cost)
    )


def check_convergence(problem: Problem, state: GraphState) -> Optimum:
    """
    Compute the next undamped step from a state, without applying it, as a measure of convergence.
    """
    equations = problem.linearize(state)
    progress = SolveProgress(iterations=0, initial_cost=equations.cost, final_cost=equations.cost)
    solved = equations.step()
    if solved is None:
        return Optimum(state, replace(progress, singular=True))
    return _with_convergence(state, progress, equations, LastStep(state, *solved))


def _gauss_newton(
    problem: Problem, initial: GraphState, options: SolveOptions, taken: int = 0
) -> tuple[Optimum, GraphState]:
    """
    Undamped steps; returns the optimum and the state of lowest cost. ``last_step`` is NaN if the
    cost stays above its lowest.

    With the curvature of odometry a step leaves 1 % of the error, without it a sixth. The curvature
    of distances, used from the second step on, matters if range residuals exceed the uncertainty of
    odometry. A step omits each with which its matrix is not positive definite, as it often is at
    the start of a long mission. The next step tries again; after the second time it is omitted for
    good. Both are omitted in the last step, which measures convergence, and after three steps with
    curvature of which each is longer than half of the one before: both are upper bounds, too large
    if residuals are.
    """
    state = initial
    equations = problem.linearize(initial, 2, begin=True)
    most = _HIGHEST_ORDER
    indefinite = [0] * (_HIGHEST_ORDER + 1)
    lowest = equations.cost
    above = 0
    best = initial
    slow = 0
    longest = np.inf
    spare: GraphState | None = None  # its arrays are free once the next step begins
    progress = SolveProgress(iterations=0, initial_cost=lowest, final_cost=lowest)
    for iteration in range(1, options.max_iterations + 1):
        solved = equations.step()
        # Curvature of large residuals makes the matrix indefinite; its Newton step would not
        # descend. Omit the highest order until the matrix is positive definite.
        while solved is None and equations.order > 1:
            indefinite[equations.order] += 1
            if indefinite[equations.order] == _MAX_INDEFINITE:
                most = min(most, equations.order - 1)
            equations = problem.linearize(state, equations.order - 1, equations, begin=True)
            solved = equations.step()
        if solved is None:  # even Gauss-Newton's matrix is singular: damped steps take over
            return Optimum(state, replace(progress, singular=True, last_step=np.nan)), best
        last = LastStep(state, *solved)
        largest = _largest(last.step)
        trial = state.after_step(problem.structure, last.step, into=spare)
        slow = slow + 1 if largest > _SLOW * longest else 0
        longest = largest
        # only a step without curvature measures convergence
        ended = equations.order == 1 and largest <= options.step_tolerance
        final = ended or iteration == options.max_iterations  # then its factor is kept
        if largest <= _CURVATURE_GAIN * options.step_tolerance:
            most = 1  # the next step may be the last, which has no curvature
        elif most > 1 and slow >= _MAX_SLOW:
            most = 1  # the curvature is too large: an upper bound far above that of the residuals
            slow = 0
        ahead = None if final else problem.linearize(trial, most, equations, begin=True)
        cost = problem.cost(trial) if ahead is None else ahead.cost
        # a full step from far away may overshoot the rotations; the next ones have to compensate
        above = 0 if cost <= lowest + _COST_ROUNDING * (1.0 + lowest) else above + 1
        stalled = most == 1 and slow >= _MAX_STALLED
        # further full steps would not come back, so damped steps take over
        if above > _MAX_RISES or stalled or not np.isfinite(cost):
            return Optimum(state, replace(progress, last_step=np.nan)), best
        best = trial if cost < lowest else best
        spare = None if state is initial or state is best else state  # both may be returned
        state = trial
        lowest = min(lowest, cost)
        progress = replace(progress, iterations=iteration, final_cost=cost)
        if options.report is not None:
            options.report(taken + iteration, cost)
        # a short step at a higher cost than before is no minimum
        if (ended and above == 0) or iteration == options.max_iterations:
            break
        # a short step at a higher cost goes on without curvature
        equations = ahead or problem.linearize(trial, 1, equations, begin=True)
    return _with_convergence(state, progress, equations, last), best


def _with_convergence(
    state: GraphState, progress: SolveProgress, equations: NormalEquations, last: LastStep
) -> Optimum:
    """Add the convergence measures of the last undamped system."""
    progress = replace(
        progress,
        last_step=_largest(last.step),
        gradient_norm=_largest(equations.gradient),
        newton_decrement=-0.5 * float(np.einsum("ij,ij", equations.gradient, last.step)),
    )
    return Optimum(state, progress, last)


def _largest(values: Array) -> float:
    """Largest absolute value, without an array of all of them."""
    return float(max(values.max(), -values.min()))


class _DampedSteps(NamedTuple):
    """End of damped steps, their number, and true if they stay above the rival's cost."""

    state: GraphState
    iterations: int
    given_up: bool = False


def _levenberg_marquardt(
    problem: Problem, initial: GraphState, options: SolveOptions, taken: int, *, singular: bool
) -> _DampedSteps:
    """
    Damped steps until a minimum, until no damping lowers the cost, until a singular graph stalls,
    or until the rival's cost is out of reach.

    Without ranges poses move along arcs, so that a chain can rotate as a whole. Ranges tie chains
    to each other; arcs from far away then lead to other minima. If a step gained little,
    Gauss-Newton's matrix is a poor model of the cost, and the matrix with full curvature is tried
    first. It is not positive definite far from a minimum.
    """
    state = initial
    damping = _FIRST_DAMPING
    fall = np.inf
    most = 10 * options.max_iterations
    costs: list[float] = []
    plain: NormalEquations | None = None
    curved: NormalEquations | None = None
    for iteration in range(most):
        plain = problem.linearize(state, 1, plain)
        matrices = [plain]
        if fall <= _SMALL_FALL and not singular:
            curved = problem.linearize(state, _FULL_ORDER, curved)
            matrices.insert(0, curved)
        before = matrices[0].cost
        damped = _damped_step(problem, state, matrices, damping, options.step_tolerance)
        if damped is None:
            return _DampedSteps(state, iteration)
        state, cost, damping = damped
        fall = (before - cost) / before
        if options.report is not None:
            options.report(taken + iteration + 1, cost)
        if singular and fall <= _STALLED_FALL:
            return _DampedSteps(state, iteration + 1)
        costs.append(cost)
        if len(costs) > _RATE_STEPS:
            # the cost stays above the rival's at the mean rate of the last steps
            rate = (costs[-1 - _RATE_STEPS] - cost) / _RATE_STEPS
            if cost - (most - iteration - 1) * rate > options.rival_cost:
                return _DampedSteps(state, iteration + 1, given_up=True)
        damping *= 0.1
    return _DampedSteps(state, most)


def _damped_step(
    problem: Problem,
    state: GraphState,
    matrices: list[NormalEquations],
    damping: float,
    tolerance: float,
) -> tuple[GraphState, float, float] | None:
    """
    Increase damping until a step lowers the cost, and return state, cost and damping; None if none
    does, or if a weakly damped step is within tolerance.

    The first of two matrices is dropped once it is not positive definite.
    """
    while damping <= _MAX_DAMPING:
        for equations in list(matrices):
            solved = equations.with_damping(damping).step()
            if solved is None and len(matrices) > 1:
                matrices.remove(equations)
            elif solved is not None:
                factor, step = solved
                factor.release()
                if damping <= _FIRST_DAMPING and _largest(step) <= tolerance:
                    return None
                trial = state.after_step(problem.structure, step, arc=problem.without_ranges)
                cost = problem.cost(trial)
                if cost < equations.cost:
                    return trial, cost, damping
        damping *= 10.0
    return None
