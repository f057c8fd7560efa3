"""Fixed-lag smoothing: factors enter in the order of time, and old poses are marginalized."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.covariance import EpochCovariances
from pymantaray.estimation.graph import FactorGraph, GraphValues
from pymantaray.estimation.incremental import check_times, update_times
from pymantaray.estimation.normal_equations import Indices
from pymantaray.estimation.problems import GraphState, distance_problem
from pymantaray.estimation.solution import GraphSolution, IncrementalOptions, SolveProgress, make_solution
from pymantaray.estimation.trilateration import determined_times
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import SolveStatus

Array = NDArray[np.float64]


def smooth_with_lag(
    graph: FactorGraph,
    initial: GraphValues,
    lag: float,
    *,
    incremental: bool = False,
    options: IncrementalOptions | None = None,
    covariance_poses: Indices | None = None,
) -> GraphSolution:
    """
    Estimate a graph whose ranges are distances by a fixed-lag smoother, one update for each ping.

    Parameters
    ----------
    lag : float
        Poses older than this are marginalized at their last linearization; at least the time between updates. [s]
    incremental : bool
        Use iSAM2 with an update at each sample, instead of a batch optimization of the lag at each ping. Old poses are
        marginalized sample by sample, so the time of an update is bounded, and that at a ping is short.
    covariance_poses : ndarray of int, shape (n_epochs, n_vehicles), optional
        Poses whose joint covariances to compute; the poses of an epoch have one time.

    Returns
    -------
    GraphSolution
        The last estimate of each pose and its covariance, which uses the measurements up to one lag later. The status is OK
        if every update succeeded; there is no expected cost.

    Raises
    ------
    EstimationError
        If the lag is shorter than the time between updates.
    """
    from pymantaray.estimation._gtsam.factors import graph_factors, graph_values, values_of
    from pymantaray.estimation._gtsam.fixed_lag import LaggedSmoother
    from pymantaray.estimation._gtsam.incremental import Entering, Options, timeline

    options = options or IncrementalOptions()
    check_times(graph, initial, options.every)
    n = graph.n_poses
    moment = np.concatenate([graph.pose_time, np.full(graph.landmark_name.size, -np.inf)])
    times = update_times(graph, moment, "sample" if incremental else options.every)
    if times.size > 1 and lag < (longest := float(np.diff(times).max())):
        raise EstimationError(
            f"lag is {lag:g} s, but pings are up to {longest:g} s apart; give at least that"
        )
    factors, start = graph_factors(graph), values_of(initial)
    moment[n:] = determined_times(graph, initial)
    line = timeline(factors, moment, times)
    isam2 = Options(options.relinearize, options.wildfire) if incremental else None
    seconds = np.full(times.size, np.nan)
    smoother, entering = LaggedSmoother(lag, isam2), Entering(graph, start, times)
    poses = np.empty((0, 0), dtype=np.intp) if covariance_poses is None else covariance_poses
    epoch_time = graph.pose_time[poses].max(axis=1, initial=-np.inf)
    joint: dict[int, Array] = {}
    problem = distance_problem(graph)
    cost, done = problem.cost(GraphState.of(initial)), True
    for k, now in enumerate(times.tolist()):
        variables = np.flatnonzero(line.variable_update == k)
        there = np.flatnonzero(line.variable_update[n:] <= k) + n  # landmarks are never marginalized
        time = {int(v): float(moment[v]) if v < n else now for v in (*variables, *there)}
        rows = np.flatnonzero(line.factor_update == k)
        done = smoother.update(factors, rows, entering.values(variables, smoother, k), time)
        seconds[k] = smoother.seconds
        if not done:
            break
        gone = times[k + 1] - lag if k + 1 < times.size else np.inf  # poses before are marginalized next
        for epoch in np.flatnonzero((epoch_time <= now) & (epoch_time < gone)):
            if epoch not in joint and (own := smoother.covariance(poses[epoch])) is not None:
                joint[int(epoch)] = own
    for _ in range(options.final_updates if done and incremental else 0):
        none = np.empty(0, dtype=int)
        done = smoother.update(factors, none, entering.values(none, smoother, times.size - 1), {})
    if not done:
        return make_solution(
            initial, SolveProgress(times.size, cost, np.nan, singular=True), SolveStatus.FAILED
        )
    values = graph_values(smoother.latest, graph)
    progress = SolveProgress(times.size, cost, problem.cost(GraphState.of(values)))
    solution = replace(make_solution(values, progress, SolveStatus.OK), update_seconds=seconds)
    if covariance_poses is None:
        return solution
    return replace(solution, covariances=_covariances(values, poses, joint))


def _covariances(values: GraphValues, poses: Indices, joint: dict[int, Array]) -> EpochCovariances:
    """Joint covariances of each epoch, positions in the world's axes."""
    n_epochs, n_vehicles = poses.shape
    out = EpochCovariances.unknown(n_epochs, n_vehicles)
    vehicles = np.arange(n_vehicles)
    for epoch, matrix in joint.items():
        blocks = matrix.reshape(n_vehicles, 6, n_vehicles, 6)
        rotation = matrix_from_quaternion(values.quaternion[poses[epoch]])
        out.pose[epoch] = blocks[vehicles, :, vehicles, :]
        out.position[epoch] = np.einsum(
            "aik,akbl,bjl->aibj", rotation, blocks[:, 3:, :, 3:], rotation, optimize=True
        )
    return out
