"""Incremental estimation by iSAM2: factors enter in the order of time, one update for each ping."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues, check_graph, check_values
from pymantaray.estimation.solvers.losses import Loss
from pymantaray.estimation.solvers.optimize import Optimum, check_convergence
from pymantaray.estimation.solvers.problems import GraphState, Problem, distance_problem
from pymantaray.estimation.solvers.solution import (
    GraphSolution,
    SolveOptions,
    SolveProgress,
    gate,
    make_solution,
)
from pymantaray.estimation.solvers.trilateration import determined_times


@dataclass(frozen=True, eq=False)
class IncrementalResult:
    """
    Final solution of an incremental estimator, and its estimates and latencies during the mission.
    """

    # after the last update, without bounds on the cost; its iterations are updates
    solution: GraphSolution
    optimum: Optimum  # final state, with the next step of a batch solver (not applied)
    update_time: Array  # since the start of the mission, (n_updates,) [s]
    seconds: Array  # duration of each update; NaN after a failed update
    # each position at its own time: after an update, or dead-reckoned from the last one [m]
    position: Array


def solve_incrementally(
    graph: FactorGraph,
    initial: GraphValues,
    *,
    loss: Loss | None = None,
    options: SolveOptions | None = None,
    problem: Problem | None = None,
) -> IncrementalResult:
    """
    Estimate a graph whose ranges are distances by iSAM2, with factors in the order of their latest
    pose.

    A pose without a prior or an edge from an existing pose enters at its initial value. A landmark
    enters, with all its ranges and sightings so far, as soon as these determine its position.
    """
    from pymantaray.estimation._gtsam.factors import graph_factors, graph_values, values_of
    from pymantaray.estimation._gtsam.incremental import Entering, IncrementalSmoother, timeline

    options = options or SolveOptions()
    check_times(graph, initial, options.incremental.every)
    if loss is not None and not loss.incremental:
        why = "needs all ranges at once" if loss.graduated else "loses ranges far from predictions"
        name = "a graduated loss" if loss.graduated else f"the loss {loss.kind}"
        raise EstimationError(
            f"{name} {why}, so an incremental solve cannot use it; choose another loss"
        )
    factors = graph_factors(graph, loss)
    start = values_of(initial)
    moment = np.concatenate([graph.pose_time, np.full(graph.landmark_name.size, -np.inf)])
    update_time = update_times(graph, moment, options.incremental.every)
    moment[graph.n_poses :] = determined_times(graph, initial)
    line = timeline(factors, moment, update_time)
    if (line.variable_update < 0).any():
        name = graph.variable_name(int(np.argmin(line.variable_update)))
        raise EstimationError(f"{name}: no factor mentions it; give it a prior or an edge")
    smoother = IncrementalSmoother(options.incremental)
    seconds = np.full(update_time.size, np.nan)
    position = np.full((graph.n_poses, 3), np.nan)
    entering = Entering(graph, start, update_time)
    steps = 0
    failed = False
    none = np.empty(0, dtype=int)
    for k in range(update_time.size):
        variables = np.flatnonzero(line.variable_update == k)
        new = entering.values(variables, smoother, k)
        relinearized = smoother.update(factors, np.flatnonzero(line.factor_update == k), new)
        steps += 1
        if relinearized is None:
            failed = True
            break
        seconds[k] = smoother.seconds
        poses = variables[variables < graph.n_poses]
        position[poses] = _positions_now(graph, poses, update_time[k], new, smoother)
    for _ in range(0 if failed else options.incremental.final_updates):
        relinearized = smoother.update(factors, none, entering.values(none, smoother, k))
        steps += 1
        if not relinearized:
            failed = relinearized is None
            break
    problem = problem or distance_problem(graph, loss)
    cost = problem.cost(GraphState.of(initial))
    if failed:
        progress = SolveProgress(steps, cost, np.nan, singular=True)
        optimum = Optimum(GraphState.of(initial), progress)
        solution = make_solution(initial, progress, gate(progress, options))
        return IncrementalResult(solution, optimum, update_time, seconds, position)
    # one batch step, not applied, measures the distance from the optimum
    optimum = check_convergence(problem, GraphState.of(graph_values(smoother.values(), graph)))
    end = replace(optimum.progress, iterations=steps, initial_cost=cost)
    limits = replace(options, end_tolerance=options.incremental.end_tolerance)
    expected = np.nan if loss is not None else graph.degrees_of_freedom / 2.0
    solution = make_solution(optimum.state.values(graph), end, gate(end, limits), expected)
    return IncrementalResult(solution, optimum, update_time, seconds, position)


def _positions_now(
    graph: FactorGraph, poses: Indices, now: float, new: Any, smoother: Any
) -> Array:
    """Positions of poses that entered in an update, (n, 3); earlier poses are dead-reckoned. [m]"""
    return np.array(
        [
            (smoother.pose(key) if graph.pose_time[key] == now else new.atPose3(key)).translation()
            for key in poses.tolist()
        ]
    ).reshape(-1, 3)


def update_times(graph: FactorGraph, moment: Array, every: str) -> Array:
    """Times of the updates: those of all poses, or those of all ranges and the end."""
    if every == "sample":
        return np.unique(graph.pose_time)
    pinged = moment[graph["range"].variables].max(axis=1)
    return np.unique(np.append(pinged[np.isfinite(pinged)], graph.pose_time.max()))


def check_times(graph: FactorGraph, initial: GraphValues, every: str) -> None:
    """Refuse a graph without usable times."""
    check_graph(graph)
    check_values(graph, initial)
    if every not in {"ping", "sample"}:
        raise EstimationError(f"an update every {every!r}; allowed: 'ping', 'sample'")
    if graph.n_poses == 0:
        raise EstimationError(
            "a graph without poses has no times; an incremental solve needs poses"
        )
    fine = np.isfinite(graph.pose_time)
    if not fine.all():
        name = graph.variable_name(int(np.argmin(fine)))
        raise EstimationError(
            f"{name}: its time is not finite; an incremental solve needs the time of every pose"
        )
