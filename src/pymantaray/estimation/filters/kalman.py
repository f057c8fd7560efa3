"""
Error-state extended Kalman filter of a factor graph: its factors in the order of their times, one
update for each sample.
"""

from dataclasses import replace
from itertools import pairwise
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.filters.error_state import (
    POSITION,
    ROTATION,
    SIZE,
    Innovation,
    Motion,
    State,
    predict,
    range_innovation,
    to_world_axes,
    update,
)
from pymantaray.estimation.graph.graph import (
    FactorGraph,
    Factors,
    GraphValues,
    Residual,
    check_graph,
)
from pymantaray.estimation.ranges.range_models import (
    ConstantSpeed,
    ModelRanges,
    RangeEndpoints,
    TimedRanges,
)
from pymantaray.estimation.solvers.covariance import EpochCovariances
from pymantaray.estimation.solvers.solution import GraphSolution, SolveProgress, make_solution
from pymantaray.geometry.se3 import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    so3_exp,
    so3_log,
)
from pymantaray.records import SolveStatus

_NOTHING = Innovation(np.empty(0), np.empty((0, 0)), np.empty((0, 0)))
"""Measurements of a time without any."""


def filter_graph(
    graph: FactorGraph,
    *,
    model_ranges: ModelRanges | None = None,
    covariance_poses: Indices | None = None,
) -> GraphSolution:
    """
    Estimate the poses of a fleet by an error-state extended Kalman filter.

    Odometry, with the velocities of a Doppler log, moves the poses from sample to sample; all other
    measurements of a sample update them, ranges last. Each measurement is linearized once, at the
    latest estimate. Errors are in the tangent of the estimate, as in [1]_.

    Parameters
    ----------
    graph : FactorGraph
        Every vehicle has a pose at every time, a prior on its first pose, and odometry between
        successive poses.
    model_ranges : ModelRanges, optional
        Range model and measured travel times, without unknowns. By default the graph's ranges are
        distances.
    covariance_poses : ndarray of int, shape (n_epochs, n_vehicles), optional
        Poses whose joint covariances to compute; the poses of an epoch have one time.

    Returns
    -------
    GraphSolution
        The estimate of each pose from all measurements up to its time. Costs are half the sum of
        squared normalized innovations.

    Raises
    ------
    EstimationError
        If the graph has other poses, factors between poses that are not successive, sightings, or a
        landmark without a prior.

    References
    ----------
    .. [1] Solà, J., Quaternion kinematics for the error-state Kalman filter, arXiv:1711.02508,
       2017.
    """
    check_graph(graph)
    timeline = _Timeline.of(graph)
    steps, step_cost = _steps(graph, timeline)
    state = _first_state(graph)
    updates = _Updates(graph, timeline)
    ranges = _Ranges(graph, timeline, model_ranges)
    log = _Log(graph, timeline, covariance_poses)
    seconds = np.full(timeline.pose.shape[0], np.nan)
    cost = 0.0
    failed = False
    for k in range(seconds.size):
        begin = process_time()
        if k:
            step = Motion(*(part[k - 1] for part in steps))
            state = predict(state, slice(0, timeline.pose.shape[1]), step)
            cost += float(step_cost[k - 1].sum())
        for innovations in (updates.at, ranges.at):  # ranges are linearized after all others
            innovation = innovations(state, k)
            nis = np.nan
            if innovation.residual.size:
                posterior = update(state, innovation)
                failed = posterior is None
                if posterior is None:  # its covariance is not positive definite
                    break
                state, nis = posterior
                cost += 0.5 * nis
        seconds[k] = process_time() - begin
        if failed:
            break
        log.note(state, k, range_nis=nis, range_dimension=innovation.residual.size)
    values = log.values(state)
    rows = (graph.degrees_of_freedom - ranges.gated) / 2.0
    good = not failed and bool(np.isfinite(values.position).all())
    status = SolveStatus.OK if good else SolveStatus.FAILED
    cost = cost if good else np.nan
    solution = make_solution(values, SolveProgress(seconds.size, np.nan, cost), status, rows)
    return log.with_covariances(replace(solution, update_seconds=seconds), ranges.gated)


class _Timeline(NamedTuple):
    """Pose of each vehicle at each time (n_times, n_vehicles), and the time index of each pose."""

    pose: Indices
    sample: Indices

    @classmethod
    def of(cls, graph: FactorGraph) -> "_Timeline":
        times, sample = np.unique(graph.pose_time, return_inverse=True)
        pose = np.full((times.size, graph.vehicle_name.size), -1, dtype=np.intp)
        pose[sample, graph.pose_vehicle] = np.arange(graph.n_poses)
        if graph.planar or (pose < 0).any() or pose.size != graph.n_poses or not pose.size:
            raise EstimationError(
                "a Kalman filter needs poses in three dimensions, one of each vehicle at each"
                " time; choose another solver"
            )
        priors = graph["prior"].subject
        lacking = np.setdiff1d(pose[0], priors)
        if lacking.size or priors.size != pose.shape[1]:
            odd = lacking if lacking.size else np.setdiff1d(priors, pose[0])
            name = graph.variable_name(int(odd[0] if odd.size else priors[0]))
            raise EstimationError(
                f"{name}: a Kalman filter needs one prior on the first pose of each vehicle, and"
                " none on later poses"
            )
        for table in graph.tables.values():
            kind = table.kind
            of_one_type = set(kind.ends) in ({"pose"}, {"landmark"})
            if len(table) and not (of_one_type or kind.residual is Residual.DISTANCE):
                raise EstimationError(
                    f"a Kalman filter takes no {kind.plural}; choose another solver"
                )
        surveys = _surveys(graph)
        surveyed = sorted(landmark for table in surveys for landmark in table.subject.tolist())
        if surveyed != list(range(graph.n_poses, graph.n_variables)):
            found = ", ".join(f"{len(table)} {table.kind.plural}" for table in surveys) or "none"
            raise EstimationError(
                f"a Kalman filter needs landmarks with one prior each; found {found}; choose"
                " another solver"
            )
        return cls(pose, sample)


def _steps(graph: FactorGraph, timeline: _Timeline) -> tuple[Motion, Array]:
    """
    Motion from sample to sample, with arrays (n_times - 1, n_vehicles, ...), by the odometry
    combined with velocities, and half the squared normalized innovations of the velocities.
    """
    n_times, n_vehicles = timeline.pose.shape
    shape = (n_times - 1, n_vehicles)
    row = _rows_of_steps(graph, "edge", timeline)
    at = np.full(shape, -1)
    at[row] = np.arange(len(graph["edge"]))
    if (at < 0).any() or len(graph["edge"]) != at.size:
        raise EstimationError(
            "a Kalman filter needs one odometry edge between each two successive poses"
        )
    edge = graph["edge"]
    rotation = matrix_from_quaternion(edge.column("quaternion"))[at]
    steps = Motion(rotation, edge.column("position")[at].copy(), edge.covariance[at].copy())
    cost = np.zeros(shape)
    for name, table in graph.tables.items():
        if table.kind.ends == ("pose", "pose") and name != "edge":
            _combine(steps, cost, table, _rows_of_steps(graph, name, timeline))
    return steps, cost


def _combine(steps: Motion, cost: Array, table: Factors, rows: tuple[Any, Any]) -> None:
    """
    Update steps by other measurements of the same steps: of their translations, or of both parts.
    """
    rotation, translation, covariance = steps
    translation_of = table.column("position")
    measured = table.kind.measured
    rotation_of = None
    if "quaternion" in table.kind.columns_at:
        rotation_of = matrix_from_quaternion(table.column("quaternion"))
    for i, (k, a) in enumerate(zip(*rows, strict=True)):
        innovation = translation_of[i] - translation[k, a]
        if rotation_of is not None:  # in the tangent of the second body
            by_errors = np.eye(SIZE)
            own = np.swapaxes(rotation[k, a], 0, 1)
            innovation = np.concatenate(
                [so3_log((own @ rotation_of[i])[None])[0], own @ innovation]
            )
        else:
            by_errors = np.concatenate([np.zeros((3, 3)), rotation[k, a]], axis=1)
        innovation, by_errors = innovation[measured], by_errors[measured]
        weight = covariance[k, a] @ by_errors.T
        variance = by_errors @ weight + table.covariance[i]
        gain = np.linalg.solve(variance, weight.T).T
        error = gain @ innovation
        cost[k, a] += 0.5 * innovation @ np.linalg.solve(variance, innovation)
        translation[k, a] += rotation[k, a] @ error[POSITION]
        rotation[k, a] = rotation[k, a] @ so3_exp(error[ROTATION])
        reduced = covariance[k, a] - gain @ weight.T
        covariance[k, a] = 0.5 * (reduced + reduced.T)


def _rows_of_steps(graph: FactorGraph, kind: str, timeline: _Timeline) -> tuple[Any, Any]:
    """Time index and vehicle of each factor between successive poses."""
    first, second = graph[kind].variables.T
    k = timeline.sample[first]
    a = graph.pose_vehicle[first]
    successive = (graph.pose_vehicle[second] == a) & (timeline.sample[second] == k + 1)
    if not successive.all():
        name = graph.variable_name(int(second[np.argmin(successive)]))
        raise EstimationError(
            f"{name}: {graph[kind].kind.what} does not start at the previous pose of its vehicle;"
            " a Kalman filter takes no other"
        )
    return k, a


def _first_state(graph: FactorGraph) -> State:
    """Priors of the first poses and of the landmarks."""
    prior = graph["prior"]
    by_vehicle = prior[np.argsort(graph.pose_vehicle[prior.subject])]
    n_landmarks = graph.landmark_name.size
    landmark_position = np.zeros((n_landmarks, 3))
    landmark_covariance = np.zeros((n_landmarks, 3, 3))
    for survey in _surveys(graph):
        landmark = survey.subject - graph.n_poses
        landmark_position[landmark] = survey.column("position")
        landmark_covariance[landmark] = survey.covariance
    return State.at_start(
        matrix_from_quaternion(by_vehicle.column("quaternion")),
        by_vehicle.column("position"),
        by_vehicle.covariance,
        landmark_position,
        landmark_covariance,
    )


def _surveys(graph: FactorGraph) -> list[Factors]:
    """Priors of landmarks, of all kinds."""
    return [table for table in graph.of_ends(("landmark",)) if len(table)]


class _Updates:
    """Measurements of single poses by time, of all kinds but the priors of the first poses."""

    def __init__(self, graph: FactorGraph, timeline: _Timeline) -> None:
        tables = [
            table
            for name, table in graph.tables.items()
            if table.kind.ends == ("pose",) and name != "prior"
        ]
        self._parts = [_PoseMeasurements(graph, table) for table in tables if len(table)]
        n_times = len(timeline.pose)
        self._rows = [
            _by_time(timeline.sample[part.table.subject], n_times) for part in self._parts
        ]
        self._columns: dict[tuple[bytes, ...], Indices] = {}

    def at(self, state: State, k: int) -> Innovation:
        """Innovation of a time, with the columns of the measured errors."""
        some = [(part, rows[k]) for part, rows in zip(self._parts, self._rows, strict=True)]
        if not any(rows.size for _, rows in some):
            return _NOTHING
        residual = np.concatenate([part.residual(state, rows) for part, rows in some])
        # the same vehicles measure at most times
        measured = [(part, part.vehicle[rows]) for part, rows in some]
        key = tuple(vehicles.tobytes() for _, vehicles in measured)
        if key not in self._columns:
            errors = [
                (SIZE * vehicles[:, None] + part.errors).ravel() for part, vehicles in measured
            ]
            self._columns[key] = np.concatenate(errors)
        columns = self._columns[key]
        if all(part.table.kind.rows == 1 for part, rows in some if rows.size):  # the usual case
            diagonal = np.concatenate([part.variance[rows] for part, rows in some if rows.size])
            return Innovation(residual, columns, np.diag(diagonal))
        variance = np.zeros((residual.size, residual.size))
        start = 0
        for part, rows in some:
            for block in part.covariance[rows]:
                end = start + len(block)
                variance[start:end, start:end] = block
                start = end
        return Innovation(residual, columns, variance)


class _PoseMeasurements:
    """
    Factors of one kind of single poses: their vehicles, the errors of a pose that they measure, and
    covariances of these.

    Rotations are measured in the body's axes, positions in the world's.
    """

    def __init__(self, graph: FactorGraph, table: Factors) -> None:
        self.table = table
        self.vehicle = graph.pose_vehicle[table.subject]
        columns = table.kind.columns_at
        self._rotation = (
            matrix_from_quaternion(table.column("quaternion")) if "quaternion" in columns else None
        )
        self._position = next(
            (table.column(name) for name in ("position", "depth") if name in columns), None
        )
        errors = [0, 1, 2] if self._rotation is not None else []
        if self._position is not None:
            errors += [5] if self._position.ndim == 1 else [3, 4, 5]
        self._measured = table.kind.measured
        self.errors = np.array(errors)[self._measured]
        self.covariance = table.covariance
        self.variance = table.variance
        if self._rotation is not None and self._position is not None:  # in the body's tangent
            if table.kind.is_partial:
                raise EstimationError(
                    f"a Kalman filter cannot use {table.kind.plural}, which measure a part of a"
                    " pose; choose solver batch"
                )
            self.covariance = to_world_axes(self._rotation, table.covariance)

    def residual(self, state: State, rows: Indices) -> Array:
        """Estimated minus measured, factor by factor."""
        if not rows.size:
            return np.empty(0)
        vehicle = self.vehicle[rows]
        parts = []
        if self._rotation is not None:
            error = np.swapaxes(self._rotation[rows], 1, 2) @ state.rotation[vehicle]
            parts.append(so3_log(error))
        if self._position is not None:
            axes = slice(2, None) if self._position.ndim == 1 else slice(None)
            estimated = state.position[vehicle][:, axes]
            parts.append(estimated - self._position[rows].reshape(estimated.shape))
        return np.concatenate(parts, axis=1)[:, self._measured].ravel()


class _Ranges:
    """
    Ranges by time, as distances or as travel times of a model; ``gated`` counts those without an
    arrival.
    """

    def __init__(
        self, graph: FactorGraph, timeline: _Timeline, model_ranges: ModelRanges | None
    ) -> None:
        if model_ranges is not None and (
            model_ranges.n_unknowns or model_ranges.uncertainty is not None
        ):
            raise EstimationError(
                "a Kalman filter estimates no unknowns of ranges and uses a fixed variance; choose"
                " solver batch"
            )
        table = graph["range"]
        n = timeline.pose.shape[1]
        self._model = model_ranges or _distances(table)
        self._variance = table.variance
        timed = self._model.ranges
        ends = np.stack([timed.transmitter, timed.receiver], axis=1)
        # a landmark exists at all times
        sample = np.append(timeline.sample, np.full(graph.landmark_name.size, -1))[ends]
        if ((sample[:, 0] != sample[:, 1]) & (sample.min(axis=1, initial=0) >= 0)).any():
            raise EstimationError("a Kalman filter needs ranges between poses of the same time")
        self._rows = _by_time(sample.max(axis=1, initial=-1), len(timeline.pose))
        member = np.append(graph.pose_vehicle, n + np.arange(graph.landmark_name.size))
        self._ends = member[ends].astype(np.intp)
        self.gated = 0

    def at(self, state: State, k: int) -> Innovation:
        """Innovation of the ranges of a time that have an arrival."""
        rows = self._rows[k]
        if not rows.size:
            return _NOTHING
        timed = self._model.ranges
        ends = self._ends[rows]
        links = RangeEndpoints(
            time=timed.time[rows],
            transmitter=state.position[ends[:, 0]],
            receiver=state.position[ends[:, 1]],
            sound_speed=timed.sound_speed[rows],
        )
        prediction, _ = self._model.predict(links, rows, np.empty(0))
        possible = prediction.possible
        self.gated += int(np.count_nonzero(~possible))
        ranges = prediction.scaled(links.sound_speed)
        residual = links.sound_speed * (prediction.travel_time - timed.travel_time[rows])
        return range_innovation(
            state,
            ends[possible],
            residual[possible],
            (ranges.transmitter_gradient[possible], ranges.receiver_gradient[possible]),
            self._variance[rows][possible],
        )


def _distances(table: Factors) -> ModelRanges:
    """Ranges as distances: travel times at a sound speed of 1 m/s."""
    transmitter, receiver = table.variables.T.astype(np.intp)
    none = np.zeros(len(table))
    speed = np.ones(len(table))
    timed = TimedRanges(
        transmitter, receiver, none.astype(np.intp), none, speed, table.column("distance")
    )
    return ModelRanges(ConstantSpeed(1.0), timed)


def _by_time(sample: Indices, n_times: int) -> list[Indices]:
    """Rows of each time index."""
    order = np.argsort(sample, kind="stable")
    edges = np.searchsorted(sample[order], np.arange(n_times + 1))
    return [order[a:b] for a, b in pairwise(edges)]


class _Log:
    """Estimates of all poses, and covariances at the requested epochs."""

    def __init__(self, graph: FactorGraph, timeline: _Timeline, poses: Indices | None) -> None:
        self._graph = graph
        self._pose = timeline.pose
        self._position = np.full((graph.n_poses, 3), np.nan)
        self._rotation = np.full((graph.n_poses, 3, 3), np.nan)
        self._poses = poses
        self._epoch = (
            {}
            if poses is None
            else {int(timeline.sample[row[0]]): epoch for epoch, row in enumerate(poses)}
        )
        self._out = None if poses is None else EpochCovariances.unknown(*poses.shape)

    def note(self, state: State, k: int, *, range_nis: float, range_dimension: int) -> None:
        """
        Keep the estimates of one time, the squared normalized innovation of its ranges, and their
        number.
        """
        n = self._pose.shape[1]
        self._position[self._pose[k]] = state.position[:n]
        self._rotation[self._pose[k]] = state.rotation[:n]
        if self._out is None or self._poses is None or k not in self._epoch:
            return
        epoch = self._epoch[k]
        vehicles = self._graph.pose_vehicle[self._poses[epoch]]
        blocks = state.covariance.reshape(len(state.position), SIZE, len(state.position), SIZE)
        self._out.position[epoch] = blocks[vehicles][:, POSITION][:, :, vehicles][..., POSITION]
        to_body = np.zeros((vehicles.size, SIZE, SIZE))
        to_body[:, ROTATION, ROTATION] = np.eye(3)
        to_body[:, POSITION, POSITION] = np.swapaxes(state.rotation[vehicles], 1, 2)
        self._out.pose[epoch] = (
            to_body @ blocks[vehicles, :, vehicles, :] @ np.swapaxes(to_body, 1, 2)
        )
        if range_dimension:
            self._out.range_nis[epoch] = range_nis
            self._out.range_dimension[epoch] = range_dimension

    def values(self, state: State) -> GraphValues:
        """Estimates of all variables."""
        quaternion = np.full((self._graph.n_poses, 4), np.nan)
        fine = np.isfinite(self._rotation).all(axis=(1, 2))
        quaternion[fine] = quaternion_from_matrix(self._rotation[fine])
        return GraphValues(self._position, quaternion, state.position[self._pose.shape[1] :])

    def with_covariances(self, solution: GraphSolution, gated: int) -> GraphSolution:
        """Return the solution with the covariances and the number of gated links."""
        if not solution.usable:
            return solution
        return replace(solution, covariances=self._out, gated_links=gated)
