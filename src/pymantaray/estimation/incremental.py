"""On-line operation replayed: the factors of a graph in the order of time, one update for each ping."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.gate import Progress, SolveOptions
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph, check_values
from pymantaray.estimation.losses import Loss
from pymantaray.estimation.robust import robust_solution
from pymantaray.estimation.solution import Solution
from pymantaray.geometry.se3 import quaternion_from_matrix

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReplayOptions:
    """
    Limits of a replay.

    Parameters
    ----------
    every : {"ping", "sample"}
        When to update: at each time with a range and at the end, or at each time with a pose.
    relinearize : float
        Variables that moved by more than this are linearized again. [m, rad]
    wildfire : float
        A change smaller than this is not passed on to the next variables. [m, rad]
    final_updates : int
        Updates without new factors after the last one, at most; they end when nothing is linearized again.
    step_tolerance : float
        Largest component of the step that a batch solver would take from the end. [m, rad]
    decrement_tolerance : float
        Cost that this step may promise to take away. [-]
    """

    every: Literal["ping", "sample"] = "ping"
    relinearize: float = 1e-3
    wildfire: float = 1e-5
    final_updates: int = 10
    step_tolerance: float = 1e-2
    decrement_tolerance: float = 1e-3


@dataclass(frozen=True, eq=False)
class Replay:
    """
    What an on-line estimator knew and when, and what it ended with.

    Parameters
    ----------
    solution : Solution
        After the last update, as a batch solve gives it; ``iterations`` counts updates, ``initial_cost`` is of the
        starting values.
    update_time : ndarray, shape (n_updates,)
        Time since the start of the mission. [s]
    seconds : ndarray, shape (n_updates,)
        That the update took; NaN for those not reached because one failed. [s]
    relinearized : ndarray of int, shape (n_updates,)
        Variables linearized again.
    position : ndarray, shape (n_poses, 3)
        Each pose as it was believed at its own time: after the update at that time, or dead reckoned from the last
        update before it. [m]
    quaternion : ndarray, shape (n_poses, 4)
        The same of the orientations.
    before : ndarray, shape (n_poses, 3)
        Each pose before the update that it came with: dead reckoned from the last one. [m]
    """

    solution: Solution
    update_time: Array
    seconds: Array
    relinearized: NDArray[np.intp]
    position: Array
    quaternion: Array
    before: Array


def replay(
    graph: FactorGraph,
    initial: GraphValues,
    *,
    loss: Loss | None = None,
    options: ReplayOptions | None = None,
) -> Replay:
    """
    Feed the factors of a graph to iSAM2 in the order of their time.

    Parameters
    ----------
    graph : FactorGraph
        Its ranges are taken as distances. A factor belongs to the time of its latest pose.
    initial : GraphValues
        Where variables start that have no prior and no edge from a pose that is there already.
    loss : Loss, optional
        Of the ranges; must not be graduated, which needs all ranges at once.
    options : ReplayOptions, optional

    Returns
    -------
    Replay
        Its solution has passed the health gate of the batch solves, with the tolerances of ``options`` and without
        bounds on the cost; an update whose linear system cannot be solved makes it FAILED.

    Raises
    ------
    EstimationError
        If the graph or the starting values cannot be used, a pose has no time, no factor mentions a variable, or
        the loss is graduated.

    Notes
    -----
    Every variable must be determined by what is known when it enters: a landmark without a prior of its own is
    not, by its first range.
    """
    from pymantaray.estimation._gtsam.factors import FactorBuilder, to_graph_values
    from pymantaray.estimation._gtsam.incremental import Entering, IncrementalSmoother, timeline
    from pymantaray.estimation._gtsam.optimize import optimize
    from pymantaray.estimation._gtsam.robust import robust_factors

    o = options or ReplayOptions()
    _check(graph, initial, loss, o)
    builder = FactorBuilder()
    factors, start = robust_factors(builder, builder.base(graph), graph, loss), builder.values(initial)
    always = np.full(graph.landmark_name.size, -np.inf)
    moment = np.concatenate([graph.pose_time, always])
    update_time = _update_times(graph, moment, o.every)
    line = timeline(factors, moment, update_time)
    if (line.variable_update < 0).any():
        name = graph.variable_name(int(np.argmin(line.variable_update)))
        raise EstimationError(f"{name}: no factor mentions it; a replay needs a prior or an edge for it")
    smoother = IncrementalSmoother(o.relinearize, o.wildfire)
    kept = _Kept(graph, update_time)
    entering = Entering(graph, start)
    steps, failed, none = 0, False, np.empty(0, dtype=int)
    for k in range(update_time.size):
        variables = np.flatnonzero(line.variable_update == k)
        new = entering.values(variables, smoother)
        done = smoother.update(factors, np.flatnonzero(line.factor_update == k), new)
        steps += 1
        if done is None:
            failed = True
            break
        kept.note(k, variables[variables < graph.n_poses], new, smoother, done)
    for _ in range(0 if failed else o.final_updates):
        done = smoother.update(factors, none, entering.values(none, smoother))
        steps += 1
        if done is None or done[1] == 0:
            failed = done is None
            break
    cost = float(factors.error(start))
    if failed:
        progress = Progress(steps, cost, np.nan, singular=True)
        return kept.replay(robust_solution(initial, progress, SolveOptions()))
    values = smoother.values()
    # one step of a batch solver, not taken: it says how far the end is from the optimum
    _, proof = optimize(factors, values, builder.ordering(graph, factors), SolveOptions(max_iterations=1))
    end = replace(proof, iterations=steps, initial_cost=cost, final_cost=proof.initial_cost)
    limits = SolveOptions(step_tolerance=o.step_tolerance, decrement_tolerance=o.decrement_tolerance)
    solution = robust_solution(to_graph_values(values, initial), end, limits)
    if loss is None:
        solution = replace(solution, expected_cost=graph.degrees_of_freedom / 2.0)
    return kept.replay(solution)


class _Kept:
    """Estimates as they were, update by update."""

    def __init__(self, graph: FactorGraph, update_time: Array) -> None:
        n = graph.n_poses
        self._pose_time, self._time = graph.pose_time, update_time
        self._seconds = np.full(update_time.size, np.nan)
        self._relinearized = np.zeros(update_time.size, dtype=int)
        self._before, self._position = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
        self._rotation = np.full((n, 3, 3), np.nan)

    def note(
        self, update: int, poses: NDArray[np.intp], new: Any, smoother: Any, done: tuple[float, int]
    ) -> None:
        self._seconds[update], self._relinearized[update] = done
        now = self._time[update]
        for key in poses.tolist():
            before = new.atPose3(key)
            pose = smoother.pose(key) if self._pose_time[key] == now else before
            self._before[key] = before.translation()
            self._position[key], self._rotation[key] = pose.translation(), pose.rotation().matrix()

    def replay(self, solution: Solution) -> Replay:
        quaternion = np.full((self._rotation.shape[0], 4), np.nan)
        reached = ~np.isnan(self._rotation[:, 0, 0])
        quaternion[reached] = quaternion_from_matrix(self._rotation[reached])
        return Replay(
            solution, self._time, self._seconds, self._relinearized, self._position, quaternion, self._before
        )


def _update_times(graph: FactorGraph, moment: Array, every: str) -> Array:
    latest = float(graph.pose_time.max())
    if every == "sample":
        return np.unique(graph.pose_time)
    pinged = np.maximum(moment[graph.range_first], moment[graph.range_second])
    return np.unique(np.append(pinged[np.isfinite(pinged)], latest))


def _check(graph: FactorGraph, initial: GraphValues, loss: Loss | None, o: ReplayOptions) -> None:
    check_graph(graph)
    check_values(graph, initial)
    if o.every not in {"ping", "sample"}:
        raise EstimationError(f"replay with an update every {o.every!r}; allowed are 'ping' and 'sample'")
    if graph.n_poses == 0:
        raise EstimationError("a graph without poses has no time to replay")
    fine = np.isfinite(graph.pose_time)
    if not fine.all():
        name = graph.variable_name(int(np.argmin(fine)))
        raise EstimationError(f"{name}: its time is not finite; a replay needs the time of every pose")
    if loss is not None and loss.graduated:
        raise EstimationError(
            "a replay cannot graduate a loss, which takes all ranges at once; choose huber, cauchy or geman-mcclure"
        )
