"""Fixed-lag smoothing: factors enter in the order of time, and old poses are marginalized."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.filters.incremental import check_times, update_times
from pymantaray.estimation.filters.lag_window import LagWindow
from pymantaray.estimation.graph.graph import FactorGraph, GraphValues
from pymantaray.estimation.solvers.covariance import EpochCovariances
from pymantaray.estimation.solvers.normal_equations import POSITION
from pymantaray.estimation.solvers.problems import GraphState, distance_problem
from pymantaray.estimation.solvers.solution import (
    GraphSolution,
    SolveOptions,
    SolveProgress,
    make_solution,
)
from pymantaray.estimation.solvers.trilateration import determined_times
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import SolveStatus

if TYPE_CHECKING:
    from pymantaray.estimation._gtsam.incremental import LaggedSmoother


def smooth_with_lag(
    graph: FactorGraph,
    initial: GraphValues,
    lag: float,
    *,
    incremental: bool = False,
    options: SolveOptions | None = None,
    covariance_poses: Indices | None = None,
) -> GraphSolution:
    """
    Estimate a graph whose ranges are distances by a fixed-lag smoother, one update for each ping.

    Parameters
    ----------
    lag : float
        Poses older than this are marginalized at their last linearization; at least the time
        between updates. [s]
    incremental : bool
        Use iSAM2 with an update at each sample, instead of a batch optimization of the lag at each
        ping. Old poses are marginalized sample by sample, so the time of an update is bounded, and
        that at a ping is short.
    covariance_poses : ndarray of int, shape (n_epochs, n_vehicles), optional
        Poses whose joint covariances to compute; the poses of an epoch have one time.

    Returns
    -------
    GraphSolution
        The last estimate of each pose and its covariance, which uses the measurements up to one lag
        later. The status is OK if every update succeeded; there is no expected cost.

    Raises
    ------
    EstimationError
        If the lag is shorter than the time between updates.
    """
    options = options or SolveOptions()
    every = options.incremental.every
    check_times(graph, initial, every)
    n = graph.n_poses
    moment = np.concatenate([graph.pose_time, np.full(graph.landmark_name.size, -np.inf)])
    times = update_times(graph, moment, "sample" if incremental else every)
    if times.size > 1 and lag < (longest := float(np.diff(times).max())):
        raise EstimationError(
            f"lag is {lag:g} s, but pings are up to {longest:g} s apart; give at least that"
        )
    moment[n:] = determined_times(graph, initial)
    smoother: LagWindow | LaggedSmoother = LagWindow(graph, initial, moment, times, lag, options)
    if incremental:
        from pymantaray.estimation._gtsam.incremental import LaggedSmoother

        smoother = LaggedSmoother(graph, initial, moment, times, lag, options.incremental)
    seconds = np.full(times.size, np.nan)
    poses = (
        np.empty((0, 0), dtype=np.intp)
        if covariance_poses is None
        else covariance_poses.astype(np.intp)
    )
    epoch_time = graph.pose_time[poses].max(axis=1, initial=-np.inf)
    joint: dict[int, Array] = {}
    problem = distance_problem(graph)
    cost = problem.cost(GraphState.of(initial))
    done = True
    for k, now in enumerate(times.tolist()):
        # poses before this time are marginalized next
        gone = times[k + 1] - lag if k + 1 < times.size else np.inf
        ready = (epoch_time <= now) & (epoch_time < gone)
        epochs = [epoch for epoch in np.flatnonzero(ready).tolist() if epoch not in joint]
        done = smoother.update(k, [poses[epoch] for epoch in epochs])
        seconds[k] = smoother.seconds
        if not done:
            break
        for epoch in epochs:
            if (own := smoother.covariance(poses[epoch])) is not None:
                joint[epoch] = own
    if not (done and smoother.finish(options.incremental.final_updates)):
        return make_solution(
            initial, SolveProgress(times.size, cost, np.nan, singular=True), SolveStatus.FAILED
        )
    values = smoother.values()
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
            "aik,akbl,bjl->aibj",
            rotation,
            blocks[:, POSITION, :, POSITION],
            rotation,
            optimize=True,
        )
    return out
