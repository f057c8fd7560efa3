"""Covariances of poses: against dense inverses, GTSAM's own marginals, closed forms and each other."""

from dataclasses import replace
from pathlib import Path

import gtsam
import numpy as np
import pytest
from factories import without

from pymantaray.errors import EstimationError
from pymantaray.estimation import LOSSES, GraphSolver, Method, build_graph, collect_covariances, fixed_epochs
from pymantaray.estimation._gtsam.factors import FactorBuilder
from pymantaray.estimation.covariance import graph_covariances, reckoned_covariances
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records.covariances import PoseCovariances

SAMPLES = np.array([10, 20, 29])


def poses_at(o, samples=SAMPLES):
    return np.arange(o.depth.size).reshape(o.depth.shape)[:, samples].T


def solved(fleet, o, ranges="straight"):
    graph = build_graph(o, ranges)
    found = GraphSolver().solve(graph, fleet.truth)
    assert found.usable
    return graph, found.values


def in_world(pose, values, poses):
    turn = matrix_from_quaternion(values.quaternion[poses])
    return np.einsum("eaij,eajk,ealk->eail", turn, pose[..., 3:, 3:], turn)


@pytest.mark.parametrize("n_landmarks", [0, 2])
def test_blocks_are_those_of_the_dense_inverse_of_the_information_matrix(make_fleet, n_landmarks):
    fleet = make_fleet(seed=11, n_landmarks=n_landmarks)
    graph, values = solved(fleet, fleet.noisy)
    poses = poses_at(fleet.noisy)
    found = graph_covariances(graph, values, poses)
    builder = FactorBuilder()
    linear = builder.factors(graph).linearize(builder.values(values))
    order = gtsam.Ordering()
    for key in range(graph.n_poses + n_landmarks):
        order.push_back(key)
    information = linear.hessian(order)[0]
    scale = 1.0 / np.sqrt(np.diag(information))
    dense = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    for e, a in np.ndindex(poses.shape):
        i = 6 * poses[e, a]
        block = dense[i : i + 6, i : i + 6]
        unit = np.sqrt(np.outer(np.diag(block), np.diag(block)))
        np.testing.assert_allclose(found.pose[e, a] / unit, block / unit, rtol=0, atol=1e-6)
    turn = matrix_from_quaternion(values.quaternion)
    for a, b in ((0, 1), (2, 0)):  # across vehicles, at one epoch
        i, j = poses[1, a], poses[1, b]
        world = turn[i] @ dense[6 * i + 3 : 6 * i + 6, 6 * j + 3 : 6 * j + 6] @ turn[j].T
        np.testing.assert_allclose(found.position[1, a, :, b], world, rtol=1e-6, atol=1e-8)


def test_blocks_are_those_of_gtsams_marginals_and_joint_marginals(make_fleet):
    fleet = make_fleet(seed=12, gnss_every=10)
    graph, values = solved(fleet, fleet.noisy)
    poses = poses_at(fleet.noisy)
    found = graph_covariances(graph, values, poses)
    builder = FactorBuilder()
    own = gtsam.Marginals(builder.factors(graph), builder.values(values))
    for e, a in np.ndindex(poses.shape):
        block = own.marginalCovariance(int(poses[e, a]))
        unit = np.sqrt(np.outer(np.diag(block), np.diag(block)))
        np.testing.assert_allclose(found.pose[e, a] / unit, block / unit, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        in_world(found.pose, values, poses), np.einsum("eaiaj->eaij", found.position), rtol=1e-9, atol=1e-12
    )


def test_covariances_under_a_loss_are_gtsams_with_its_weights(make_fleet):
    fleet = make_fleet(seed=13, gnss_every=10)
    late = np.zeros(fleet.noisy.range_status.size)
    late[::7] = 80.0
    o = replace(fleet.noisy, refracted_range=fleet.noisy.straight_range + late)
    graph, start = build_graph(o, "refracted"), fleet.truth
    poses, loss = poses_at(o), LOSSES["cauchy"]
    solver = GraphSolver()
    robust, plain = (
        solver.solve(graph, start, method=Method(under), model_is_right=False, covariance_poses=poses)
        for under in (loss, None)
    )
    builder = FactorBuilder()
    factors, end = builder.factors(graph, loss), robust.values
    marginals = gtsam.Marginals(factors, builder.values(end))
    for e, a in np.ndindex(poses.shape):
        expected = marginals.marginalCovariance(int(poses[e, a]))
        unit = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        np.testing.assert_allclose(robust.covariances.pose[e, a] / unit, expected / unit, rtol=0, atol=1e-6)
    # ranges that it does not believe tell it nothing, and its innovations have no chi-square distribution
    horizontal = [np.trace(s.covariances.position[1, 0, :2, 0, :2]) for s in (robust, plain)]
    assert horizontal[0] > horizontal[1]
    assert np.isnan(robust.covariances.range_nis).all()
    assert np.isfinite(plain.covariances.range_nis[:2]).all()


def test_replay_has_the_covariances_of_the_batch_at_its_end(make_fleet):
    fleet = make_fleet(seed=14, gnss_every=10)
    graph = build_graph(fleet.noisy, "straight")
    start = fleet.truth
    batch, replayed = (
        GraphSolver()
        .solve(graph, start, method=Method(incremental=i), covariance_poses=poses_at(fleet.noisy))
        .covariances
        for i in (False, True)
    )
    unit = np.sqrt(np.einsum("eaii->eai", batch.pose))
    unit = unit[..., :, None] * unit[..., None, :]
    np.testing.assert_allclose(replayed.pose / unit, batch.pose / unit, rtol=0, atol=1e-3)
    np.testing.assert_allclose(replayed.range_nis, batch.range_nis, rtol=1e-2)


def test_dead_reckoning_has_the_covariance_of_a_graph_of_odometry_alone(make_fleet):
    fleet = make_fleet(seed=13, turn=0.3)
    o, bare = fleet.noisy, without(build_graph(fleet.noisy), "depth")
    graph, own = graph_covariances(bare, fleet.reckoned, poses_at(o)), reckoned_covariances(o, SAMPLES)
    for a, b in ((own.pose, graph.pose), (own.position.reshape(3, 9, 9), graph.position.reshape(3, 9, 9))):
        diagonal = np.diagonal(b, axis1=-2, axis2=-1)
        unit = np.sqrt(diagonal[..., :, None] * diagonal[..., None, :])
        np.testing.assert_allclose(a / unit, b / unit, rtol=0, atol=1e-6)
    assert (own.range_dimension == 0).all()
    assert np.isnan(own.range_nis).all()


def test_straight_track_without_turning_spreads_like_a_random_walk(make_fleet):
    o = make_fleet(seed=14, turn=0.0).noise_free
    certain = np.array(o.odometry_sigma)
    certain[..., :3] = 1e-12
    first = np.tile([1e-12] * 3 + [0.1] * 3, (3, 1))
    found = reckoned_covariances(replace(o, odometry_sigma=certain, first_sigma=first), SAMPLES)
    for e, k in enumerate(SAMPLES):
        expected = 0.1**2 + np.sum(certain[:, :k, 3:] ** 2, axis=1)
        np.testing.assert_allclose(
            np.diagonal(found.pose[e, :, 3:, 3:], axis1=1, axis2=2), expected, rtol=1e-6
        )


def test_range_statistic_is_the_innovation_predicted_from_everything_else(make_fleet):
    """Normalized residuals at the optimum against a second solve that never saw the ranges of the epoch."""
    fleet = make_fleet(seed=15, gnss_every=10, n_landmarks=1)
    o = fleet.noisy
    sample = 10
    graph, values = solved(fleet, o)
    found = graph_covariances(graph, values, poses_at(o, [sample]))
    assert found.range_dimension[0] == np.count_nonzero(o.range_sample == sample)
    without = replace(
        o, **{
            name: getattr(o, name)[o.range_sample != sample]
            for name in ("range_transmitter", "range_receiver", "range_sample", "range_status", "transmitter_sound_speed", "straight_range", "refracted_range",
                         "range_sigma")
        }
    )  # fmt: skip
    other, before = solved(fleet, without)
    builder = FactorBuilder()
    linear = builder.factors(other).linearize(builder.values(before))
    n = 6 * graph.n_poses + 3
    order = gtsam.Ordering()
    for key in range(graph.n_poses + 1):
        order.push_back(key)
    covariance = np.linalg.inv(linear.hessian(order)[0])
    rows = np.flatnonzero(o.range_sample == sample)
    place = np.concatenate([before.position, before.landmark_position])
    jacobian, innovation = np.zeros((rows.size, n)), np.zeros(rows.size)
    turn = matrix_from_quaternion(before.quaternion)
    for i, row in enumerate(rows):
        ends = [
            p * o.time.size + sample if p < o.name.size else graph.n_poses
            for p in (o.range_transmitter[row], o.range_receiver[row])
        ]
        way = place[ends[1]] - place[ends[0]]
        innovation[i] = o.straight_range[row] - np.linalg.norm(way)
        unit = way / np.linalg.norm(way)
        for end, sign in zip(ends, (-1.0, 1.0), strict=True):
            if end < graph.n_poses:
                jacobian[i, 6 * end + 3 : 6 * end + 6] = sign * unit @ turn[end]
            else:
                jacobian[i, 6 * end : 6 * end + 3] = sign * unit
    spread = np.diag(o.range_sigma[rows] ** 2) + jacobian @ covariance @ jacobian.T
    expected = innovation @ np.linalg.solve(spread, innovation)
    # both are linear expansions, about optima some metres apart over links of kilometres
    assert found.range_nis[0] == pytest.approx(expected, rel=0.02)


def test_epochs_without_ranges_have_no_innovation(make_fleet):
    fleet = make_fleet(seed=16)
    graph, values = solved(fleet, fleet.noisy)
    found = graph_covariances(graph, values, poses_at(fleet.noisy, [10, 12]))
    assert found.range_dimension.tolist() == [6, 0]
    assert np.isfinite(found.range_nis[0])
    assert np.isnan(found.range_nis[1])


def test_singular_graph_has_no_covariance_and_stops_nothing(make_fleet):
    fleet = make_fleet(seed=17)
    o = fleet.noise_free
    loose = without(build_graph(o), "prior")
    found = graph_covariances(loose, fleet.truth, poses_at(o))
    assert np.isnan(found.pose).all()
    assert np.isnan(found.position).all()
    assert np.isnan(found.range_nis).all()


def test_one_free_vehicle_is_found_though_its_poses_are_eliminated(make_fleet):
    fleet = make_fleet(seed=18)
    o = fleet.noise_free
    graph = build_graph(o)
    prior = graph["prior"]
    loose = graph.with_factors(prior=prior[prior.subject != 0])
    found = graph_covariances(loose, fleet.truth, poses_at(o)[:, 1:])
    assert np.isnan(found.pose).all()


def test_vehicle_that_may_be_anywhere_counts_as_free(make_fleet):
    """A prior of ten thousand kilometres: the system can be inverted, and its covariance means nothing."""
    fleet = make_fleet(seed=18)
    o = fleet.noise_free
    graph = build_graph(o)
    wide = np.array(graph["prior"].covariance)
    wide[0, 3:, 3:] = np.diag([1e14] * 3)
    graph = graph.with_factors(prior=replace(graph["prior"], covariance=wide))
    found = graph_covariances(graph, fleet.truth, poses_at(o)[:, 1:])
    assert np.isnan(found.pose).all()


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        ([[0, 0]], "chosen twice"),
        ([[-1]], "variable -1 is no pose"),
        ([[10**6]], "variable 1000000 is no pose"),
    ],
)
def test_wrong_poses_are_refused(make_fleet, poses, message):
    fleet = make_fleet(seed=19)
    o = fleet.noise_free
    with pytest.raises(EstimationError, match=message):
        graph_covariances(build_graph(o), fleet.truth, np.array(poses))


def test_fixed_epochs_are_multiples_and_the_end():
    time = 200.0 * np.arange(433)  # 24 h
    np.testing.assert_array_equal(time[fixed_epochs(time, 6 * 3600.0)] / 3600.0, [6, 12, 18, 24])
    np.testing.assert_array_equal(fixed_epochs(time[:100], 6 * 3600.0), [99])
    np.testing.assert_array_equal(fixed_epochs(time[:401], 12 * 3600.0), [216, 400])
    with pytest.raises(EstimationError, match="interval of epochs is 0 s"):
        fixed_epochs(time, 0.0)


def test_record_goes_to_disk_and_back_with_nan_for_what_is_missing(make_fleet, tmp_path: Path):
    o = make_fleet(seed=20).noisy
    own = reckoned_covariances(o, SAMPLES)
    record = collect_covariances(o, SAMPLES, [{"odometry": own, "x": None}, {"odometry": own, "x": own}])
    record.save(tmp_path / "covariances.nc")
    again = PoseCovariances.load(tmp_path / "covariances.nc")
    np.testing.assert_array_equal(again.position_covariance, record.position_covariance)
    np.testing.assert_array_equal(again.pose_covariance[0, 1], own.pose)
    assert np.isnan(again.pose_covariance[1, 0]).all()
    assert np.isfinite(again.pose_covariance[1, 1]).all()
    np.testing.assert_array_equal(again.time, o.time[SAMPLES])
    with pytest.raises(EstimationError, match="same conditions"):
        collect_covariances(o, SAMPLES, [{"odometry": own}, {"x": own}])
