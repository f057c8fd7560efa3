"""
The Kalman filter: the batch of what it has heard where all is nearly linear, its statistics, and
what it refuses.
"""

from dataclasses import replace

import factories
import numpy as np
import pytest
from refusals import refused

from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    Estimator,
    GraphSolver,
    Method,
    RangeModel,
    SolveOptions,
    TransmitterSpeed,
    build_graph,
    dead_reckon,
    solve_conditions,
)
from pymantaray.estimation.filters.error_state import propagate
from pymantaray.estimation.graph.graph import KINDS
from pymantaray.evaluation.consistency import nees
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, so3_exp, so3_log
from pymantaray.records import RayStatus, SolveStatus

KALMAN = Method(kalman=True)


def poses_at(o, samples):
    return np.arange(o.depth.size).reshape(o.depth.shape)[:, samples].T


def nearly_linear(fleet):
    """
    Measurements of a fleet whose noise is so small that one linearization of each measurement is
    enough.
    """
    o = fleet.noise_free
    small = {
        name: 1e-3 * getattr(o, name)
        for name in ("odometry_sigma", "first_sigma", "depth_sigma", "gnss_sigma", "range_sigma")
    }
    return factories.add_noise(replace(o, **small, landmark_sigma=1e-3 * o.landmark_sigma), 5)


def with_more_sensors(o, fleet, rng):
    """
    Measurements with velocities of a Doppler log on every step of every vehicle, and attitudes on
    every fourth sample.
    """
    free = fleet.noise_free
    n, m = o.depth.shape
    vehicle, sample = (index.ravel() for index in np.indices((n, m - 1)))
    step = free.odometry_translation[vehicle, sample] / factories.PERIOD
    sigma = 0.3 * o.odometry_sigma[vehicle, sample, 3:] / factories.PERIOD
    who, when = (index.ravel() for index in np.meshgrid(np.arange(n), np.arange(0, m, 4)))
    turn = 1e-6 * rng.standard_normal((who.size, 3))
    attitude = matrix_from_quaternion(fleet.quaternion[who, when])
    return replace(
        o,
        attitude_vehicle=who,
        attitude_sample=when,
        attitude_quaternion=quaternion_from_matrix(so3_exp(turn) @ attitude),
        attitude_sigma=np.full((who.size, 3), 1e-6),
        attitude_bias_sigma=np.zeros(who.size),
        dvl_vehicle=vehicle,
        dvl_sample=sample,
        dvl_velocity=step + sigma * rng.standard_normal(step.shape),
        dvl_sigma=sigma,
        dvl_bias_sigma=np.zeros(vehicle.size),
        dvl_beam_loss=np.zeros(vehicle.size),
    )


@pytest.mark.parametrize("more", [False, True])
def test_nearly_linear_filters_equal_the_batch_at_the_last_pose(make_fleet, more, as_stored):
    fleet = make_fleet(seed=4, gnss_every=8, n_landmarks=2, n_vehicles=2)
    o = nearly_linear(fleet)
    o = with_more_sensors(o, fleet, np.random.default_rng(8)) if more else o
    last = [o.time.size - 1]
    graph, poses = build_graph(o, "straight"), poses_at(o, last)
    start = factories.values_at(o, *dead_reckon(o))
    batch = GraphSolver(SolveOptions(step_tolerance=1e-9)).solve(
        graph, start, covariance_poses=poses
    )
    end = GraphSolver().solve(graph, start, method=KALMAN, covariance_poses=poses)
    assert end.status == batch.status == SolveStatus.OK
    sigma = np.sqrt(np.einsum("eaiai->eai", batch.covariances.position))
    assert (np.abs(end.position[poses] - batch.position[poses]) < 0.02 * sigma).all()
    scale = np.abs(batch.covariances.position).max()
    np.testing.assert_allclose(
        end.covariances.position, batch.covariances.position, rtol=0, atol=1e-3 * scale
    )
    tangent = np.sqrt(np.einsum("eaii->eai", batch.covariances.pose))
    off = (end.covariances.pose - batch.covariances.pose) / (
        tangent[..., :, None] * tangent[..., None, :]
    )
    assert np.abs(off).max() < 1e-2
    assert end.final_cost == pytest.approx(batch.final_cost, rel=1e-2)
    assert end.expected_cost == batch.expected_cost
    assert np.abs(end.position - batch.position).max() > 5.0 * sigma.min(), (
        "earlier poses hear nothing later"
    )
    as_stored(end)


def test_derivatives_of_a_step_are_those_of_finite_differences():
    rng = np.random.default_rng(2)
    rotation, turn = so3_exp(rng.normal(0, 1.0, (4, 3))), so3_exp(rng.normal(0, 0.5, (4, 3)))
    position, step = rng.normal(0, 100.0, (2, 4, 3))
    after, at, by_pose, by_step = propagate(rotation, position, turn, step)
    h = 1e-6

    def error(before, own):
        """Error after a step from errors before and of the step, in their conventions."""
        out = propagate(
            rotation @ so3_exp(before[:, :3]),
            position + before[:, 3:],
            turn @ so3_exp(own[:, :3]),
            step + np.einsum("nij,nj->ni", turn, own[:, 3:]),
        )
        return np.concatenate([so3_log(np.swapaxes(after, 1, 2) @ out[0]), out[1] - at], axis=1)

    for i in range(6):
        push, none = np.zeros((2, 4, 6))
        push[:, i] = h
        for analytic, (one, other) in ((by_pose, (push, none)), (by_step, (none, push))):
            slope = (error(one, other) - error(-one, -other)) / (2.0 * h)
            np.testing.assert_allclose(analytic[:, :, i], slope, rtol=0, atol=1e-6)


def test_its_errors_have_the_covariances_that_it_gives(make_fleet):
    free, samples, ratio = make_fleet(seed=6, turn=0.0, gnss_every=15), [10, 20, 29], []
    for seed in range(12):
        o = factories.add_noise(free.noise_free, seed)
        end = GraphSolver().solve(
            build_graph(o, "straight"),
            free.truth,
            method=KALMAN,
            covariance_poses=poses_at(o, samples),
        )
        error = end.position[poses_at(o, samples)] - free.position[:, samples].swapaxes(0, 1)
        ratio.append(nees(error.reshape(3, 9), end.covariances.position.reshape(3, 9, 9)) / 9)
    # 12 draws of 9 degrees of freedom
    np.testing.assert_allclose(np.mean(ratio, axis=0), 1.0, atol=4.0 * np.sqrt(2.0 / (9 * 12)))


def test_innovations_of_ranges_have_their_expected_size(make_fleet, as_stored):
    free, nis, rows = make_fleet(seed=6, turn=0.0, gnss_every=15), 0.0, 0
    for seed in range(12):
        o = factories.add_noise(free.noise_free, seed)
        end = GraphSolver().solve(
            build_graph(o, "straight"),
            free.truth,
            method=KALMAN,
            covariance_poses=poses_at(o, [5, 20, 21]),
        )
        own = end.covariances
        assert np.isnan(own.range_nis[2]), "sample 21 has no ranges"
        nis, rows = nis + own.range_nis[:2].sum(), rows + own.range_dimension.sum()
    assert nis / rows == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / rows))
    as_stored(end)


def test_a_range_model_gives_the_estimate_of_its_distances(make_fleet, as_stored):
    o = make_fleet(seed=3, gnss_every=10, n_landmarks=1).noisy
    distances, times = (
        solve_conditions(o, {"e": Estimator("refracted", method=KALMAN, model=model)})["e"]
        for model in (None, Asked())
    )
    np.testing.assert_allclose(times.position, distances.position, rtol=0, atol=1e-6)
    as_stored(times)


class Asked(RangeModel):
    """
    The transmitter's speed as a model that is asked for travel times, of which some may not be
    possible.
    """

    def __init__(self, possible=None):
        self.possible = possible

    def predict(self, links):
        out = TransmitterSpeed().predict(links)
        return out if self.possible is None else out._replace(possible=self.possible(links))


def test_links_without_an_arrival_are_left_out_and_counted(make_fleet, as_stored):
    o = make_fleet(seed=3, gnss_every=10, n_landmarks=1).noisy
    gate = Asked(lambda links: links.time != 10 * factories.PERIOD)
    end = solve_conditions(o, {"e": Estimator("refracted", method=KALMAN, model=gate)})["e"]
    late = o.range_sample == 10
    assert end.gated_links == np.count_nonzero(late)
    lost = replace(
        o,
        range_status=np.where(late, RayStatus.SHADOW, o.range_status),
        refracted_range=np.where(late, np.nan, o.refracted_range),
    )
    without = solve_conditions(lost, {"e": Estimator("refracted", method=KALMAN)})["e"]
    np.testing.assert_allclose(end.position, without.position, rtol=0, atol=1e-6)
    assert end.expected_cost == without.expected_cost
    as_stored(end)


def test_a_fitted_sigma_meets_the_expected_innovations(make_fleet, as_stored):
    o, rng = make_fleet(seed=7, gnss_every=10).noisy, np.random.default_rng(1)
    wild = replace(
        o, refracted_range=o.straight_range + 25.0 * rng.standard_normal(o.range_sigma.size)
    )
    fitted = solve_conditions(
        wild, {"e": Estimator("refracted", method=KALMAN, range_sigma="fitted")}
    )["e"]
    assert fitted.final_cost == pytest.approx(fitted.expected_cost, rel=1e-2)
    assert fitted.unknowns.value[0] == pytest.approx(
        25.0, rel=5.0 / np.sqrt(2.0 * o.range_sigma.size)
    )
    as_stored(fitted)


def test_graphs_that_a_filter_cannot_take_are_refused(make_fleet):
    fleet = make_fleet(seed=6, n_landmarks=1)
    graph = build_graph(fleet.noisy, "straight")

    def solve(changed, **method):
        GraphSolver().solve(changed, fleet.truth, method=Method(kalman=True, **method))

    refused(EstimationError, "no robust loss and no lag", solve, graph, lag=100.0)
    refused(
        EstimationError,
        "A0: a Kalman filter needs one prior",
        solve,
        factories.without(graph, "prior"),
    )
    refused(
        EstimationError,
        "needs landmarks with one prior each",
        solve,
        factories.without(graph, "survey"),
    )
    edge = graph["edge"]
    closure = edge[:1].kind.table([[0, 7]], [[[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0, 0.0]]], np.eye(6))
    refused(
        EstimationError,
        "A7: odometry does not start at the previous pose",
        solve,
        graph.with_factors(edge=edge.append(closure)),
    )
    refused(
        EstimationError,
        "one odometry edge between each two",
        solve,
        graph.with_factors(edge=edge[1:]),
    )
    pose = graph["range"].kind.table([[0, 40]], [[3.0]], [[[1.0]]])
    refused(
        EstimationError,
        "ranges between poses of the same time",
        solve,
        graph.with_factors(range=graph["range"].append(pose)),
    )


@pytest.mark.parametrize(
    ("like", "axes"), [("attitude", (2,)), ("fix", (3, 4)), ("edge", ()), ("dvl", (3,))]
)
def test_a_part_of_a_pose_moves_the_filter_as_the_batch(monkeypatch, like, axes):
    fleet = factories.make_fleet(n_vehicles=1, n_times=6, n_landmarks=1)
    kinds = dict(KINDS)
    kind = replace(KINDS[like], what="part", plural="parts", word=None, axes=axes, source=None)
    monkeypatch.setattr(
        "pymantaray.estimation.graph.graph.KINDS",
        {**kinds, "part": kind, "range": kinds.pop("range")},
    )
    graph = build_graph(fleet.noise_free, "straight")
    last = graph.n_poses - 1
    turn = matrix_from_quaternion(fleet.truth.quaternion)
    rotation, place = turn[last], fleet.truth.position[last]
    if len(kind.ends) == 2:
        rotation = turn[last - 1].T @ rotation
        place = turn[last - 1].T @ (place - fleet.truth.position[last - 1])
    rotation = rotation @ so3_exp(np.array([[1e-4, -2e-4, 3e-4]]))
    parts = {
        "position": place + np.array([1e-3, -2e-3, 3e-3]),
        "quaternion": quaternion_from_matrix(rotation),
    }
    table = kind.table(
        [[last - 1, last][-len(kind.ends) :]],
        [parts[name] for name, *_ in kind.columns],
        [np.diag((1e-3 * 2.0 ** np.arange(kind.rows)) ** 2)],
    )
    shifts, costs = [], []
    for method in (Method(), KALMAN):
        before, after = (
            GraphSolver(SolveOptions(step_tolerance=1e-9)).solve(
                g, fleet.truth, method=method, model_is_right=False
            )
            for g in (graph, graph.with_factors(part=table))
        )
        turned = matrix_from_quaternion(before.quaternion[last]).T @ matrix_from_quaternion(
            after.quaternion[last]
        )
        shifts.append([*(after.position - before.position)[last], *so3_log(turned[None])[0]])
        costs.append(after.final_cost - before.final_cost)
    assert np.abs(shifts[0]).max() > 1e-5
    np.testing.assert_allclose(shifts[1], shifts[0], rtol=0, atol=0.01 * np.abs(shifts[0]).max())
    assert costs[1] == pytest.approx(costs[0], rel=0.01)


def test_a_measured_pose_is_uncertain_in_the_axes_of_the_body(monkeypatch, as_stored):
    """Uneven standard deviations on a tilted body: the last pose is that of the batch."""
    fleet = factories.make_fleet(n_vehicles=1, n_times=6, n_landmarks=1)
    kinds = dict(KINDS)
    kind = replace(KINDS["prior"], what="pose", plural="poses", word=None, axes=())
    monkeypatch.setattr(
        "pymantaray.estimation.graph.graph.KINDS",
        {**kinds, "pose": kind, "range": kinds.pop("range")},
    )
    graph = build_graph(fleet.noise_free, "straight")
    last = graph.n_poses - 1
    sigma = 1e-3 * 4.0 ** np.arange(6)
    measured = fleet.truth.position[last] + 1e-3, fleet.truth.quaternion[last]
    table = kind.table([[last]], measured, [np.diag(sigma**2)])
    shifts = []
    for method in (Method(), KALMAN):
        before, after = (
            GraphSolver().solve(g, fleet.truth, method=method, model_is_right=False).position[last]
            for g in (graph, graph.with_factors(pose=table))
        )
        shifts.append(after - before)
    np.testing.assert_allclose(shifts[1], shifts[0], rtol=0, atol=0.01 * np.abs(shifts[0]).max())
    as_stored(shifts)
    partial = replace(kind, axes=(0, 3)).table([[last]], measured, [np.eye(2)])
    fault = "a Kalman filter cannot use poses, which measure a part of a pose; choose solver batch"
    changed = graph.with_factors(pose=partial)
    refused(EstimationError, fault, GraphSolver().solve, changed, fleet.truth, method=KALMAN)
