"""On-line operation replayed: the factors of a graph in the order of time, one update for each ping."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph, check_values
from pymantaray.estimation.losses import Loss
from pymantaray.estimation.optimize import Optimum, prove
from pymantaray.estimation.problems import Problem, State, distance_problem
from pymantaray.estimation.solution import Progress, Solution, SolveOptions, gate, judged
from pymantaray.geometry.se3 import quaternion_from_matrix

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Replay:
    """What an on-line estimator knew and when, and what it ended with."""

    solution: Solution  # after the last update, gated without bounds on the cost; its iterations are updates
    proof: Optimum  # its end, with a step of a batch solver that was not taken
    update_time: Array  # since the start of the mission, (n_updates,) [s]
    seconds: Array  # that each update took; NaN for those not reached because one failed
    relinearized: NDArray[np.intp]  # variables linearized again in each update
    position: (
        Array  # each pose as believed at its own time: after an update, or reckoned from the last one [m]
    )
    quaternion: Array
    before: Array  # each position before the update that the pose came with, reckoned from the last one [m]


def replay(
    graph: FactorGraph,
    initial: GraphValues,
    *,
    loss: Loss | None = None,
    options: SolveOptions | None = None,
    problem: Problem | None = None,
) -> Replay:
    """
    Feed the factors of a graph, whose ranges are distances, to iSAM2 in the order of their latest pose.

    Variables that have no prior and no edge from a pose that is there already enter at their initial value, and have to
    be determined by what is known then: a landmark without a prior is not, by its first range.
    """
    from pymantaray.estimation._gtsam.factors import graph_factors, graph_values, values_of
    from pymantaray.estimation._gtsam.incremental import Entering, IncrementalSmoother, timeline

    options = options or SolveOptions()
    check_replay(graph, initial, options.replay.every)
    if loss is not None and loss.graduated:
        raise EstimationError(
            "a replay cannot graduate a loss, which takes all ranges at once; choose huber, cauchy or geman-mcclure"
        )
    factors, start = graph_factors(graph, loss), values_of(initial)
    moment = np.concatenate([graph.pose_time, np.full(graph.landmark_name.size, -np.inf)])
    update_time = update_times(graph, moment, options.replay.every)
    line = timeline(factors, moment, update_time)
    if (line.variable_update < 0).any():
        name = graph.variable_name(int(np.argmin(line.variable_update)))
        raise EstimationError(f"{name}: no factor mentions it; a replay needs a prior or an edge for it")
    smoother = IncrementalSmoother(options.replay.relinearize, options.replay.wildfire)
    log = _Log(graph, update_time)
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
        log.note(k, variables[variables < graph.n_poses], new, smoother, done)
    for _ in range(0 if failed else options.replay.final_updates):
        done = smoother.update(factors, none, entering.values(none, smoother))
        steps += 1
        if done is None or done[1] == 0:
            failed = done is None
            break
    problem = problem or distance_problem(graph, loss)
    cost = problem.cost(State.of(initial))
    if failed:
        progress = Progress(steps, cost, np.nan, singular=True)
        proof = Optimum(State.of(initial), progress)
        return log.replay(judged(initial, progress, gate(progress, options)), proof)
    # one step of a batch solver, not taken: it says how far the end is from the optimum
    proof = prove(problem, State.of(graph_values(smoother.values(), graph)))
    end = replace(proof.progress, iterations=steps, initial_cost=cost)
    limits = replace(options, end_tolerance=options.replay.end_tolerance)
    expected = np.nan if loss is not None else graph.degrees_of_freedom / 2.0
    solution = judged(proof.state.values(graph), end, gate(end, limits), expected)
    return log.replay(solution, proof)


class _Log:
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

    def replay(self, solution: Solution, proof: Optimum) -> Replay:
        quaternion = np.full((self._rotation.shape[0], 4), np.nan)
        reached = ~np.isnan(self._rotation[:, 0, 0])
        quaternion[reached] = quaternion_from_matrix(self._rotation[reached])
        return Replay(
            solution,
            proof,
            self._time,
            self._seconds,
            self._relinearized,
            self._position,
            quaternion,
            self._before,
        )


def update_times(graph: FactorGraph, moment: Array, every: str) -> Array:
    """Times of the updates: of each pose, or of each range and of the end."""
    if every == "sample":
        return np.unique(graph.pose_time)
    pinged = moment[graph["range"].variables].max(axis=1)
    return np.unique(np.append(pinged[np.isfinite(pinged)], graph.pose_time.max()))


def check_replay(graph: FactorGraph, initial: GraphValues, every: str) -> None:
    """Refuse what cannot be replayed in the order of time."""
    check_graph(graph)
    check_values(graph, initial)
    if every not in {"ping", "sample"}:
        raise EstimationError(f"replay with an update every {every!r}; allowed are 'ping' and 'sample'")
    if graph.n_poses == 0:
        raise EstimationError("a graph without poses has no time to replay")
    fine = np.isfinite(graph.pose_time)
    if not fine.all():
        name = graph.variable_name(int(np.argmin(fine)))
        raise EstimationError(f"{name}: its time is not finite; a replay needs the time of every pose")
