"""
Error-state extended Kalman filter: the latest pose of each vehicle and all landmarks, one update
for each sample.
"""

from dataclasses import replace
from itertools import pairwise
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.linalg.lapack import dpotrf

from pymantaray.arrays import Array, Indices
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import FactorGraph, Factors, GraphValues, check_graph
from pymantaray.estimation.ranges.range_models import ModelRanges, chord
from pymantaray.estimation.solvers.covariance import EpochCovariances
from pymantaray.estimation.solvers.solution import GraphSolution, SolveProgress, make_solution
from pymantaray.geometry.se3 import (
    hat,
    matrix_from_quaternion,
    quaternion_from_matrix,
    so3_exp,
    so3_log,
)
from pymantaray.records import SolveStatus

_NOTHING = np.empty(0), np.empty((0, 0)), np.empty((0, 0))  # measurements of a time without any
SIZE = 6  # errors of a pose: rotation in the body's axes [rad], position in the world's axes [m]


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
    steps = _steps(graph, timeline)
    state = _first_state(graph, timeline)
    updates = _Updates(graph, timeline)
    ranges = _Ranges(graph, timeline, model_ranges)
    log = _Log(graph, timeline, covariance_poses)
    done = True
    seconds = np.full(timeline.pose.shape[0], np.nan)
    for k in range(seconds.size):
        begin = process_time()
        if k:
            state.move(steps, k - 1)
        done = state.update(*updates.at(state, k)) and state.update(
            *ranges.at(state, k), ranges=True
        )
        seconds[k] = process_time() - begin
        if not done:
            break
        log.note(state, k)
    values = log.values(state)
    rows = (graph.degrees_of_freedom - ranges.gated) / 2.0
    good = done and bool(np.isfinite(values.position).all())
    status = SolveStatus.OK if good else SolveStatus.FAILED
    cost = state.cost if good else np.nan
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
        taken = {"range", "survey"}
        for name, table in graph.tables.items():
            if len(table) and not (name in taken or set(table.kind.ends) == {"pose"}):
                raise EstimationError(
                    f"a Kalman filter takes no {table.kind.plural}; choose another solver"
                )
        if sorted(graph["survey"].subject.tolist()) != list(
            range(graph.n_poses, graph.n_variables)
        ):
            raise EstimationError(
                "a Kalman filter needs landmarks with one prior each; choose another solver"
            )
        return cls(pose, sample)


class _Steps(NamedTuple):
    """
    Motion from sample to sample (n_times - 1, n_vehicles): rotation, translation, and covariance in
    the second body's tangent.
    """

    rotation: Array
    translation: Array
    covariance: Array
    cost: (
        Array  # half the squared normalized innovations of the velocities (n_times - 1, n_vehicles)
    )


def _steps(graph: FactorGraph, timeline: _Timeline) -> _Steps:
    """Steps of the odometry, combined with velocities."""
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
    translation = edge.column("position")[at].copy()
    covariance = edge.covariance[at].copy()
    steps = _Steps(rotation, translation, covariance, np.zeros(shape))
    for name, table in graph.tables.items():
        if table.kind.ends == ("pose", "pose") and name != "edge":
            _combine(steps, table, _rows_of_steps(graph, name, timeline))
    return steps


def _combine(steps: _Steps, table: Factors, rows: tuple[Any, Any]) -> None:
    """
    Update steps by other measurements of the same steps: of their translations, or of both parts.
    """
    rotation, translation, covariance, cost = steps
    place = table.column("position")
    whole = "quaternion" in table.kind.columns_at
    turn = matrix_from_quaternion(table.column("quaternion")) if whole else np.empty((0, 3, 3))
    for i, (k, a) in enumerate(zip(*rows, strict=True)):
        innovation = place[i] - translation[k, a]
        if whole:  # in the tangent of the second body
            by = np.eye(SIZE)
            own = np.swapaxes(rotation[k, a], 0, 1)
            innovation = np.concatenate([so3_log((own @ turn[i])[None])[0], own @ innovation])
        else:
            by = np.concatenate([np.zeros((3, 3)), rotation[k, a]], axis=1)
        weight = covariance[k, a] @ by.T
        variance = by @ weight + table.covariance[i]
        gain = np.linalg.solve(variance, weight.T).T
        error = gain @ innovation
        cost[k, a] += 0.5 * innovation @ np.linalg.solve(variance, innovation)
        translation[k, a] += rotation[k, a] @ error[3:]
        rotation[k, a] = rotation[k, a] @ so3_exp(error[:3])
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


class _State:
    """
    Latest poses, landmarks as poses without rotation, and the joint covariance of their errors.
    """

    def __init__(self, rotation: Array, position: Array, covariance: Array) -> None:
        self.rotation = rotation
        self.position = position
        self.covariance = covariance
        self.cost = 0.0
        self.range_nis, self.range_dimension = np.nan, 0
        """Squared normalized innovation of the ranges of the last update, and their number."""

    def move(self, steps: _Steps, k: int) -> None:
        """Move all vehicles by their k-th steps."""
        n = steps.rotation.shape[1]
        rotation, position, by_pose, by_step = moved(
            self.rotation[:n], self.position[:n], steps.rotation[k], steps.translation[k]
        )
        self.rotation[:n] = rotation
        self.position[:n] = position
        blocks = self.covariance.reshape(-1, SIZE, self.covariance.shape[1])
        blocks[:n] = by_pose @ blocks[:n]
        columns = (
            np.swapaxes(blocks.reshape(self.covariance.shape), 0, 1).reshape(blocks.shape).copy()
        )
        columns[:n] = by_pose @ columns[:n]
        self.covariance = columns.reshape(self.covariance.shape)
        noise = by_step @ steps.covariance[k] @ np.swapaxes(by_step, 1, 2)
        square = self.covariance.reshape(-1, SIZE, len(blocks), SIZE)
        np.einsum("iaib->iab", square)[:n] += noise  # a view of the diagonal blocks
        self.cost += float(steps.cost[k].sum())

    def update(
        self, residual: Array, by_errors: Array | Indices, variance: Array, *, ranges: bool = False
    ) -> bool:
        """
        Update by measurements with residuals predicted minus measured (m,), derivatives as in
        `corrected`, and covariance (m, m).

        False if the covariance of the innovations is not positive definite.
        """
        if ranges:
            self.range_nis = np.nan
            self.range_dimension = residual.size
        if not residual.size:
            return True
        after = corrected(
            self.rotation, self.position, self.covariance, residual, by_errors, variance
        )
        if after is None:
            return False
        self.rotation, self.position, self.covariance, nis = after
        self.cost += 0.5 * nis
        if ranges:
            self.range_nis = nis
        return True


def moved(
    rotation: Array, position: Array, turn: Array, step: Array
) -> tuple[Array, Array, Array, Array]:
    """
    Poses after steps, and the derivatives of their errors by the errors before (n, 6, 6) and by
    those of the steps (n, 6, 6).

    Errors of poses are rotations in the body's axes and displacements in the world's; those of
    steps are in the tangent of the second body.
    """
    after = rotation @ turn
    at = position + np.einsum("nij,nj->ni", rotation, step)
    by_pose, by_step = np.zeros((2, len(rotation), SIZE, SIZE))
    by_pose[:, :3, :3] = np.swapaxes(turn, 1, 2)
    by_pose[:, 3:, :3] = -rotation @ hat(step)
    by_pose[:, 3:, 3:] = by_step[:, :3, :3] = np.eye(3)
    by_step[:, 3:, 3:] = after
    return after, at, by_pose, by_step


def corrected(
    rotation: Array,
    position: Array,
    covariance: Array,
    residual: Array,
    by_errors: Array | Indices,
    variance: Array,
) -> tuple[Array, Array, Array, float] | None:
    """
    Poses and covariance after an update, as `_State.update`, and the squared normalized innovation.

    by_errors contains derivatives (m, 6 n), or the columns (m,) of errors that are measured
    themselves. None if the covariance of the innovations is not positive definite.
    """
    if by_errors.ndim == 1:
        measured = by_errors.astype(np.intp, copy=False)
        weight = covariance.take(measured, axis=0)
        spread = weight.take(measured, axis=1)
    else:
        weight = by_errors @ covariance
        spread = weight @ by_errors.T
    root, failed = dpotrf(spread + variance, lower=1)
    if failed or not np.isfinite(root[-1, -1]):
        return None
    # LAPACK's solver starts all threads of OpenBLAS even for one row, which costs milliseconds on a
    # busy machine
    white = dtrsm(1.0, root, residual[:, None], lower=1)[:, 0]
    gain = dtrsm(1.0, root, weight, lower=1)
    error = -(gain.T @ white).reshape(-1, SIZE)
    reduced = covariance - gain.T @ gain
    return (
        rotation @ so3_exp(error[:, :3]),
        position + error[:, 3:],
        0.5 * (reduced + reduced.T),
        float(white @ white),
    )


def _first_state(graph: FactorGraph, timeline: _Timeline) -> _State:
    """Priors of the first poses and of the landmarks."""
    n = timeline.pose.shape[1]
    n_landmarks = graph.landmark_name.size
    prior = graph["prior"]
    survey = graph["survey"]
    row = np.argsort(graph.pose_vehicle[prior.subject])
    rotation = np.tile(np.eye(3), (n + n_landmarks, 1, 1))
    rotation[:n] = matrix_from_quaternion(prior.column("quaternion"))[row]
    place = np.zeros((n + n_landmarks, 3))
    place[:n] = prior.column("position")[row]
    covariance = np.zeros((n + n_landmarks, SIZE, n + n_landmarks, SIZE))
    to_world = np.zeros((n, SIZE, SIZE))
    to_world[:, :3, :3] = np.eye(3)
    to_world[:, 3:, 3:] = rotation[:n]
    vehicles = np.arange(n)
    covariance[vehicles, :, vehicles, :] = (
        to_world @ prior.covariance[row] @ np.swapaxes(to_world, 1, 2)
    )
    landmark = survey.subject.astype(np.intp) - graph.n_poses
    place[n + landmark] = survey.column("position")
    covariance[n + landmark, 3:, n + landmark, 3:] = survey.covariance
    size = SIZE * (n + n_landmarks)
    return _State(rotation, place, covariance.reshape(size, size))


class _Updates:
    """Measurements of single poses by time, of all kinds but the priors of the first poses."""

    def __init__(self, graph: FactorGraph, timeline: _Timeline) -> None:
        tables = [
            t for name, t in graph.tables.items() if t.kind.ends == ("pose",) and name != "prior"
        ]
        self._parts = [_OfPoses(graph, table) for table in tables if len(table)]
        n_times = len(timeline.pose)
        self._rows = [
            _by_time(timeline.sample[part.table.subject], n_times) for part in self._parts
        ]
        self._columns: dict[tuple[bytes, ...], Indices] = {}

    def at(self, state: _State, k: int) -> tuple[Array, Array | Indices, Array]:
        """
        Residuals of a time, columns of the measured errors, and the covariance of the residuals.
        """
        some = [(part, rows[k]) for part, rows in zip(self._parts, self._rows, strict=True)]
        if not any(rows.size for _, rows in some):
            return _NOTHING
        residual = np.concatenate([part.residual(state, rows) for part, rows in some])
        columns = self._measured([(part, part.vehicle[rows]) for part, rows in some])
        if all(part.table.kind.rows == 1 for part, rows in some if rows.size):  # the usual case
            return (
                residual,
                columns,
                np.diag(np.concatenate([part.variance[rows] for part, rows in some if rows.size])),
            )
        variance = np.zeros((residual.size, residual.size))
        start = 0
        for part, rows in some:
            for block in part.covariance[rows]:
                end = start + len(block)
                variance[start:end, start:end] = block
                start = end
        return residual, columns, variance

    def _measured(self, of: list[tuple["_OfPoses", Indices]]) -> Indices:
        """Columns of the errors that are measured; the same vehicles measure at most times."""
        key = tuple(vehicles.tobytes() for _, vehicles in of)
        if key not in self._columns:
            columns = [(SIZE * vehicles[:, None] + part.errors).ravel() for part, vehicles in of]
            self._columns[key] = np.concatenate(columns)
        return self._columns[key]


class _OfPoses:
    """
    Factors of one kind of single poses: their vehicles, the errors of a pose that they measure, and
    covariances of these.

    Rotations are measured in the body's axes, positions in the world's.
    """

    def __init__(self, graph: FactorGraph, table: Factors) -> None:
        self.table = table
        self.vehicle = graph.pose_vehicle[table.subject]
        columns = table.kind.columns_at
        self._turn = (
            matrix_from_quaternion(table.column("quaternion")) if "quaternion" in columns else None
        )
        self._place = next(
            (table.column(name) for name in ("position", "depth") if name in columns), None
        )
        errors = [0, 1, 2] if self._turn is not None else []
        if self._place is not None:
            errors += [5] if self._place.ndim == 1 else [3, 4, 5]
        self.errors = np.array(errors)
        self.covariance = table.covariance
        self.variance = table.variance
        if self._turn is not None and self._place is not None:  # a prior is in the body's tangent
            to_world = np.tile(np.eye(SIZE), (len(table), 1, 1))
            to_world[:, 3:, 3:] = self._turn
            self.covariance = to_world @ table.covariance @ np.swapaxes(to_world, 1, 2)

    def residual(self, state: _State, rows: Indices) -> Array:
        """Estimated minus measured, factor by factor."""
        if not rows.size:
            return np.empty(0)
        vehicle = self.vehicle[rows]
        parts = []
        if self._turn is not None:
            turned = np.swapaxes(self._turn[rows], 1, 2) @ state.rotation[vehicle]
            parts.append(np.asarray(so3_log(turned)))
        if self._place is not None:
            at = state.position[vehicle][
                :, self.errors[-1:] - 3 if self._place.ndim == 1 else slice(None)
            ]
            parts.append(at - self._place[rows].reshape(at.shape))
        return np.concatenate(parts, axis=1).ravel()


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
        self._model = model_ranges
        self._variance = table.variance
        self._distance = np.asarray(table.column("distance"))
        ends = table.variables.astype(np.intp)
        if model_ranges is not None:
            ends = np.stack([model_ranges.ranges.transmitter, model_ranges.ranges.receiver], axis=1)
        # a landmark exists at all times
        sample = np.append(timeline.sample, np.full(graph.landmark_name.size, -1))[ends]
        if ((sample[:, 0] != sample[:, 1]) & (sample.min(axis=1, initial=0) >= 0)).any():
            raise EstimationError("a Kalman filter needs ranges between poses of the same time")
        self._rows = _by_time(sample.max(axis=1, initial=-1), len(timeline.pose))
        member = np.append(graph.pose_vehicle, n + np.arange(graph.landmark_name.size))
        self._ends = member[ends].astype(np.intp)
        self.gated = 0

    def at(self, state: _State, k: int) -> tuple[Array, Array, Array]:
        """Residuals of a time, their derivatives by the errors, and their covariance."""
        rows = self._rows[k]
        if not rows.size:
            return _NOTHING
        a, b = (state.position[self._ends[rows, end]] for end in (0, 1))
        if self._model is None:
            distance, unit = chord(a, b)
            residual = distance - self._distance[rows]
            by_a = -unit
            by_b = unit
        else:
            timed = self._model.ranges
            links = timed.links(a, b)
            links = links._replace(time=timed.time[rows], sound_speed=timed.sound_speed[rows])
            prediction, _ = self._model.predict(links, rows, np.empty(0))
            fine = prediction.possible
            speed = links.sound_speed
            self.gated += int(np.count_nonzero(~fine))
            rows = rows[fine]
            residual = (speed * (prediction.travel_time - timed.travel_time[self._rows[k]]))[fine]
            by_a, by_b = (
                (speed[:, None] * gradient)[fine]
                for gradient in (prediction.transmitter_gradient, prediction.receiver_gradient)
            )
        by_errors = np.zeros((rows.size, len(state.position), SIZE))
        row = np.arange(rows.size)
        by_errors[row, self._ends[rows, 0], 3:] += by_a
        by_errors[row, self._ends[rows, 1], 3:] += by_b
        return (
            residual,
            by_errors.reshape(rows.size, SIZE * len(state.position)),
            np.diag(self._variance[rows]),
        )


def _by_time(sample: Indices, n_times: int) -> list[Indices]:
    """Rows of each time index."""
    order = np.argsort(sample, kind="stable")
    edges = np.searchsorted(sample[order], np.arange(n_times + 1))
    return [order[a:b] for a, b in pairwise(edges)]


class _Log:
    """Estimates of all poses, and covariances at the requested epochs."""

    def __init__(self, graph: FactorGraph, timeline: _Timeline, poses: Indices | None) -> None:
        self._pose = timeline.pose
        self._n = graph.n_poses
        self._position, self._rotation = (
            np.full((self._n, 3), np.nan),
            np.full((self._n, 3, 3), np.nan),
        )
        self._poses = poses
        self._epoch = (
            {}
            if poses is None
            else {int(timeline.sample[row[0]]): e for e, row in enumerate(poses)}
        )
        self._vehicle = graph.pose_vehicle
        self._out = None if poses is None else EpochCovariances.unknown(*poses.shape)

    def note(self, state: _State, k: int) -> None:
        """Keep the estimates of one time."""
        n = self._pose.shape[1]
        self._position[self._pose[k]] = state.position[:n]
        self._rotation[self._pose[k]] = state.rotation[:n]
        if self._out is None or self._poses is None or k not in self._epoch:
            return
        e = self._epoch[k]
        who = self._vehicle[self._poses[e]]
        blocks = state.covariance.reshape(len(state.position), SIZE, len(state.position), SIZE)
        self._out.position[e] = blocks[who][:, 3:][:, :, who][..., 3:]
        to_body = np.zeros((who.size, SIZE, SIZE))
        to_body[:, :3, :3], to_body[:, 3:, 3:] = np.eye(3), np.swapaxes(state.rotation[who], 1, 2)
        self._out.pose[e] = to_body @ blocks[who, :, who, :] @ np.swapaxes(to_body, 1, 2)
        if state.range_dimension:
            self._out.range_nis[e] = state.range_nis
            self._out.range_dimension[e] = state.range_dimension

    def values(self, state: _State) -> GraphValues:
        """Estimates of all variables."""
        quaternion = np.full((self._n, 4), np.nan)
        fine = np.isfinite(self._rotation).all(axis=(1, 2))
        quaternion[fine] = quaternion_from_matrix(self._rotation[fine])
        return GraphValues(self._position, quaternion, state.position[self._pose.shape[1] :])

    def with_covariances(self, solution: GraphSolution, gated: int) -> GraphSolution:
        """Return the solution with the covariances and the number of gated links."""
        if not solution.usable:
            return solution
        return replace(solution, covariances=self._out, gated_links=gated)
