"""
Covariances of poses: against dense inverses, GTSAM's own marginals, closed forms and each other.
"""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from factories import without

from pymantaray.apps.graphs import to_gtsam
from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    LOSSES,
    GraphSolver,
    Method,
    build_graph,
    collect_covariances,
    covariances_at,
    effective_degrees_of_freedom,
    fixed_epochs,
    rmse_standard_error,
)
from pymantaray.estimation.solvers.covariance import dead_reckoning_covariances
from pymantaray.estimation.solvers.starts import dead_reckon
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import SolveStatus

SAMPLES = np.array([10, 20, 29])


def poses_at(o, samples=SAMPLES):
    return np.arange(o.depth.size).reshape(o.depth.shape)[:, samples].T


def solved(fleet, o, ranges="straight"):
    graph = build_graph(o, ranges)
    found = GraphSolver().solve(graph, fleet.truth)
    assert found.usable
    return graph, found.values


def dense(graph, values):
    """Covariance of all variables, by the inverse of the whole information matrix."""
    order = gtsam.Ordering()
    for key in range(graph.n_variables):
        order.push_back(key)
    factors, at = to_gtsam(graph, values)
    information = factors.linearize(at).hessian(order)[0]
    scale = 1.0 / np.sqrt(np.diag(information))
    return np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)


def assert_same(covariance, expected, atol=1e-6):
    """Equal in units of the standard deviations."""
    sigma = np.sqrt(np.diagonal(expected, axis1=-2, axis2=-1))
    unit = sigma[..., :, None] * sigma[..., None, :]
    np.testing.assert_allclose(covariance / unit, expected / unit, rtol=0, atol=atol)


@pytest.mark.parametrize("n_landmarks", [0, 2])
def test_blocks_are_those_of_the_dense_inverse(make_fleet, n_landmarks):
    fleet = make_fleet(seed=11, n_landmarks=n_landmarks)
    graph, values = solved(fleet, fleet.noisy)
    poses = poses_at(fleet.noisy)
    found = covariances_at(graph, values, poses)
    whole = dense(graph, values)
    for e, a in np.ndindex(poses.shape):
        block = slice(6 * poses[e, a], 6 * poses[e, a] + 6)
        assert_same(found.pose[e, a], whole[block, block])
    turn = matrix_from_quaternion(values.quaternion)
    for a, b in ((0, 0), (0, 1), (2, 0)):  # of one vehicle and across two, at one epoch
        i, j = poses[1, a], poses[1, b]
        world = turn[i] @ whole[6 * i + 3 : 6 * i + 6, 6 * j + 3 : 6 * j + 6] @ turn[j].T
        np.testing.assert_allclose(found.position[1, a, :, b], world, rtol=1e-6, atol=1e-8)


def test_covariances_under_a_loss_are_gtsams_with_its_weights(make_fleet):
    fleet = make_fleet(seed=13, gnss_every=10)
    late = np.where(np.arange(fleet.noisy.range_status.size) % 7, 0.0, 80.0)
    o = replace(fleet.noisy, refracted_range=fleet.noisy.straight_range + late)
    graph, start = build_graph(o, "refracted"), fleet.truth
    poses, loss = poses_at(o), LOSSES["cauchy"]
    solver = GraphSolver()
    robust, plain = (
        solver.solve(
            graph, start, method=Method(under), model_is_right=False, covariance_poses=poses
        )
        for under in (loss, None)
    )
    marginals = gtsam.Marginals(*to_gtsam(graph, robust.values, loss))
    for e, a in np.ndindex(poses.shape):
        assert_same(robust.covariances.pose[e, a], marginals.marginalCovariance(int(poses[e, a])))
    # ranges that it does not believe tell it nothing, and its innovations have no chi-square
    # distribution
    horizontal = [np.trace(s.covariances.position[1, 0, :2, 0, :2]) for s in (robust, plain)]
    assert horizontal[0] > horizontal[1]
    assert np.isnan(robust.covariances.range_nis).all()
    assert np.isfinite(plain.covariances.range_nis[:2]).all()


def test_replay_has_the_covariances_of_the_batch_at_its_end(make_fleet):
    fleet = make_fleet(seed=14, gnss_every=10)
    graph = build_graph(fleet.noisy, "straight")
    batch, replayed = (
        GraphSolver().solve(
            graph, fleet.truth, method=Method(incremental=i), covariance_poses=poses_at(fleet.noisy)
        )
        for i in (False, True)
    )
    batch, replayed = batch.covariances, replayed.covariances
    assert_same(replayed.pose, batch.pose, atol=1e-3)
    np.testing.assert_allclose(replayed.range_nis, batch.range_nis, rtol=1e-2)


def test_dead_reckoning_has_the_covariance_of_an_odometry_graph(make_fleet):
    fleet = make_fleet(seed=13, turn=0.3)
    o, bare = fleet.noisy, without(build_graph(fleet.noisy), "depth")
    graph, own = (
        covariances_at(bare, fleet.reckoned, poses_at(o)),
        dead_reckoning_covariances(o, SAMPLES, dead_reckon(o)),
    )
    for a, b in (
        (own.pose, graph.pose),
        (own.position.reshape(3, 9, 9), graph.position.reshape(3, 9, 9)),
    ):
        assert_same(a, b)
    assert (own.range_dimension == 0).all()
    assert np.isnan(own.range_nis).all()


def test_straight_track_without_turning_spreads_like_a_random_walk(make_fleet):
    o = make_fleet(seed=14, turn=0.0).noise_free
    certain = np.array(o.odometry_sigma)
    certain[..., :3] = 1e-12
    first = np.tile([1e-12] * 3 + [0.1] * 3, (3, 1))
    sure = replace(o, odometry_sigma=certain, first_sigma=first)
    found = dead_reckoning_covariances(sure, SAMPLES, dead_reckon(sure))
    for e, k in enumerate(SAMPLES):
        expected = 0.1**2 + np.sum(certain[:, :k, 3:] ** 2, axis=1)
        variance = np.diagonal(found.pose[e, :, 3:, 3:], axis1=1, axis2=2)
        np.testing.assert_allclose(variance, expected, rtol=1e-6)


def test_the_range_statistic_is_the_innovation_by_all_other_data(make_fleet):
    """
    Normalized residuals at the optimum against a second solve that never saw the ranges of the
    epoch.
    """
    fleet = make_fleet(seed=15, gnss_every=10, n_landmarks=1)
    o = fleet.noisy
    sample = 10
    graph, values = solved(fleet, o)
    found = covariances_at(graph, values, poses_at(o, [sample]))
    assert found.range_dimension[0] == np.count_nonzero(o.range_sample == sample)
    ranges, n = graph["range"], graph.n_poses
    mine = (ranges.variables < n).any(axis=1) & (
        graph.pose_number[ranges.variables[:, 0]] == sample
    )
    other = graph.with_factors(range=ranges[~mine])
    before = GraphSolver().solve(other, fleet.truth).values
    covariance = dense(other, before)
    place = np.concatenate([before.position, before.landmark_position])
    turn = np.concatenate(
        [matrix_from_quaternion(before.quaternion), np.eye(3)[None]]
    )  # a landmark has none
    ends = ranges[mine].variables
    way = np.diff(place[ends], axis=1)[:, 0]
    distance = np.linalg.norm(way, axis=1)
    innovation = ranges[mine].column("distance") - distance
    jacobian = np.zeros((len(ends), len(covariance)))
    for row, unit in enumerate(way / distance[:, None]):
        for end, sign in zip(ends[row], (-1.0, 1.0), strict=True):
            first = 6 * end + 3 * (end < n)  # of the position
            jacobian[row, first : first + 3] = sign * unit @ turn[end]
    spread = np.diag(ranges[mine].variance) + jacobian @ covariance @ jacobian.T
    expected = innovation @ np.linalg.solve(spread, innovation)
    # both are linear expansions, about optima some metres apart over links of kilometres
    assert found.range_nis[0] == pytest.approx(expected, rel=0.02)


def test_epochs_without_ranges_have_no_innovation(make_fleet):
    fleet = make_fleet(seed=16)
    found = covariances_at(*solved(fleet, fleet.noisy), poses_at(fleet.noisy, [10, 12]))
    assert found.range_dimension.tolist() == [6, 0]
    assert np.isfinite(found.range_nis).tolist() == [True, False]


def test_innovations_are_computed_only_if_asked_for(make_fleet, monkeypatch):
    fleet = make_fleet(seed=16)
    graph, values = solved(fleet, fleet.noisy)
    every = covariances_at(graph, values, poses_at(fleet.noisy, [10, 12]))
    monkeypatch.setattr(
        "pymantaray.estimation.solvers.marginals._innovation", lambda *_: pytest.fail("for nothing")
    )
    found = covariances_at(graph, values, poses_at(fleet.noisy, [10, 12]), innovations=False)
    np.testing.assert_array_equal(found.position, every.position)
    np.testing.assert_array_equal(found.pose, every.pose)
    assert np.isnan(found.range_nis).all()


def anywhere(prior):
    """
    A prior of ten thousand kilometres: the system can be inverted, and its covariance means
    nothing.
    """
    wide = np.array(prior.covariance)
    wide[0, 3:, 3:] = np.diag([1e14] * 3)
    return replace(prior, covariance=wide)


@pytest.mark.parametrize(("change", "vehicles"), [
    (lambda prior: prior[:0], slice(None)),
    (lambda prior: prior[1:], slice(1, None)),  # the free one's poses are eliminated
    (anywhere, slice(1, None)),
], ids=["none", "one", "anywhere"])  # fmt: skip
def test_singular_graph_has_no_covariance_and_stops_nothing(make_fleet, change, vehicles):
    fleet = make_fleet(seed=18)
    graph = build_graph(fleet.noise_free)
    loose = graph.with_factors(prior=change(graph["prior"]))
    poses = poses_at(fleet.noise_free)[:, vehicles]
    solution = GraphSolver().solve(loose, fleet.truth, covariance_poses=poses)
    assert (solution.status, solution.covariances) == (SolveStatus.FAILED, None)


@pytest.mark.parametrize("poses", [[[0, 0]], [[-1]], [[10**6]]])
def test_wrong_poses_are_refused(make_fleet, poses):
    fleet = make_fleet(seed=19)
    graph = build_graph(fleet.noise_free)
    with pytest.raises(
        EstimationError, match="covariances: each pose must have a prior or odometry"
    ):
        GraphSolver().solve(
            graph, fleet.truth, model_is_right=False, covariance_poses=np.array(poses)
        )


def test_fixed_epochs_are_multiples_and_the_end():
    time = 200.0 * np.arange(433)  # 24 h
    np.testing.assert_array_equal(time[fixed_epochs(time, 6 * 3600.0)] / 3600.0, [6, 12, 18, 24])
    np.testing.assert_array_equal(fixed_epochs(time[:100], 6 * 3600.0), [99])
    np.testing.assert_array_equal(fixed_epochs(time[:401], 12 * 3600.0), [216, 400])
    with pytest.raises(EstimationError, match="interval of epochs is 0 s"):
        fixed_epochs(time, 0.0)


def test_record_has_nan_for_what_is_missing(make_fleet):
    o = make_fleet(seed=20).noisy
    own = dead_reckoning_covariances(o, SAMPLES, dead_reckon(o))
    record = collect_covariances(
        o, SAMPLES, [{"odometry": own, "x": None}, {"odometry": own, "x": own}]
    )
    np.testing.assert_array_equal(record.pose_covariance[0, 1], own.pose)
    assert np.isnan(record.pose_covariance[1, 0]).all()
    assert np.isfinite(record.pose_covariance[1, 1]).all()
    np.testing.assert_array_equal(record.time, o.time[SAMPLES])
    with pytest.raises(EstimationError, match="same conditions"):
        collect_covariances(o, SAMPLES, [{"odometry": own}, {"x": own}])


def test_the_standard_error_of_an_rmse_is_the_simulated_scatter():
    """
    Correlated errors of 33 rows, 25 realizations each, over 2,000 draws: first order is good to 5
    %.
    """
    rng = np.random.default_rng(0)
    root = rng.normal(size=(33, 6)) @ np.diag([5.0, 3.0, 2.0, 1.0, 1.0, 1.0])
    covariance = root @ root.T + 0.1 * np.eye(33)
    dof = effective_degrees_of_freedom(covariance.reshape(11, 3, 11, 3))
    assert dof < 6.0
    errors = rng.multivariate_normal(np.zeros(33), covariance, size=(2000, 25))
    rmse = np.sqrt(np.mean(errors**2, axis=(1, 2)))
    expected = rmse_standard_error(np.sqrt(np.trace(covariance) / 33), dof, 25)
    assert rmse.std() == pytest.approx(expected, rel=0.05)
    assert effective_degrees_of_freedom(np.eye(7)) == pytest.approx(7.0)
    assert effective_degrees_of_freedom(np.ones((7, 7))) == pytest.approx(1.0)
