"""
A smoother with a lag: the batch where it forgets nothing and where all is linear, and its
statistics where it is not.
"""

from dataclasses import fields, replace

import factories
import gtsam
import numpy as np
import pytest
from refusals import refused

from pymantaray.apps.graphs import to_gtsam
from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    LOSSES,
    GraphSolver,
    IncrementalOptions,
    Method,
    SolveOptions,
    build_graph,
)
from pymantaray.evaluation.consistency import nees
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import SolveStatus

PING = 5 * factories.PERIOD
EVERY_SAMPLE = SolveOptions(step_tolerance=1e-9, incremental=IncrementalOptions(every="sample"))


def poses_at(o, samples):
    return np.arange(o.depth.size).reshape(o.depth.shape)[:, samples].T


def lagged(graph, start, lag, options=None, samples=None, o=None):
    poses = None if samples is None else poses_at(o, samples)
    return GraphSolver(options).solve(graph, start, method=Method(lag=lag), covariance_poses=poses)


def test_a_filter_of_a_linear_chain_is_the_batch_of_what_it_has_heard():
    fleet = factories.make_fleet(seed=3, turn=0.0, gnss_every=4, n_vehicles=2)
    sure = np.full(3, 1e-7)  # of attitudes: all else is linear in the positions
    o = replace(
        fleet.noise_free,
        odometry_sigma=np.concatenate(
            [
                0 * fleet.noise_free.odometry_sigma[..., :3] + sure,
                fleet.noise_free.odometry_sigma[..., 3:],
            ],
            axis=2,
        ),
        first_sigma=np.concatenate(
            [np.tile(sure, (2, 1)), fleet.noise_free.first_sigma[:, 3:]], axis=1
        ),
    )
    o = factories.add_noise(o, 4)
    graph = factories.without(build_graph(o), "range")
    last = o.time.size - 1
    end = lagged(graph, fleet.truth, factories.PERIOD, EVERY_SAMPLE, [last], o)
    batch = GraphSolver(EVERY_SAMPLE).solve(
        graph, fleet.truth, covariance_poses=poses_at(o, [last])
    )
    assert end.status == batch.status == SolveStatus.OK
    now = poses_at(o, [last]).ravel()
    np.testing.assert_allclose(end.position[now], batch.position[now], rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        end.covariances.position, batch.covariances.position, rtol=1e-6, atol=1e-9
    )
    assert np.abs(end.position - batch.position).max() > 0.1, (
        "earlier poses have not heard of later fixes"
    )


def test_a_lag_as_long_as_the_mission_ends_at_the_batch_optimum(make_fleet, as_stored):
    fleet = make_fleet(seed=4, gnss_every=10, n_landmarks=1)
    graph, samples = build_graph(fleet.noisy, "straight"), [10, 20]
    batch = GraphSolver(SolveOptions(step_tolerance=1e-7)).solve(
        graph, fleet.truth, covariance_poses=poses_at(fleet.noisy, samples)
    )
    end = lagged(graph, fleet.reckoned, 1e9, samples=samples, o=fleet.noisy)
    np.testing.assert_allclose(end.position, batch.position, rtol=0, atol=1e-3)
    np.testing.assert_allclose(end.landmark_position, batch.landmark_position, rtol=0, atol=1e-3)
    np.testing.assert_allclose(
        end.covariances.position, batch.covariances.position, rtol=1e-3, atol=1e-6
    )
    np.testing.assert_allclose(end.covariances.pose, batch.covariances.pose, rtol=1e-2, atol=1e-6)
    assert end.final_cost == pytest.approx(batch.final_cost, rel=1e-6)
    as_stored(end)


def test_its_errors_have_the_covariances_that_it_gives(make_fleet, as_stored):
    free, samples, ratio = make_fleet(seed=6, turn=0.0, gnss_every=15), [10, 20, 29], []
    for seed in range(12):
        o = factories.add_noise(free.noise_free, seed)
        end = lagged(build_graph(o, "straight"), free.truth, 2 * PING, samples=samples, o=o)
        error = end.position[poses_at(o, samples)] - free.position[:, samples].swapaxes(0, 1)
        joint = end.covariances.position.reshape(3, 9, 9)
        ratio.append(nees(error.reshape(3, 9), joint) / 9)
    # 12 draws of 9 degrees of freedom
    np.testing.assert_allclose(np.mean(ratio, axis=0), 1.0, atol=4.0 * np.sqrt(2.0 / (9 * 12)))
    as_stored(end)


def test_bad_requests_are_refused(make_fleet):
    fleet = make_fleet(seed=6)
    graph = build_graph(fleet.noisy, "straight")
    refused(
        EstimationError,
        "lag is 10 s, but pings are up to 1000 s apart",
        lagged,
        graph,
        fleet.truth,
        10.0,
    )
    method = Method(LOSSES["huber"], lag=PING)
    with pytest.raises(EstimationError, match="no robust loss"):
        GraphSolver().solve(graph, fleet.truth, method=method)


def test_the_smoother_equals_the_batch_if_its_lag_covers_the_mission(
    make_fleet,
):
    fleet = make_fleet(seed=4, gnss_every=10, n_landmarks=1)
    graph, poses = build_graph(fleet.noisy, "straight"), poses_at(fleet.noisy, [20])
    batch = GraphSolver().solve(graph, fleet.truth, covariance_poses=poses)
    end = GraphSolver().solve(
        graph, fleet.reckoned, method=Method(lag=1e9, incremental=True), covariance_poses=poses
    )
    assert end.status == SolveStatus.OK
    np.testing.assert_allclose(end.position, batch.position, rtol=0, atol=1e-2)
    np.testing.assert_allclose(end.landmark_position, batch.landmark_position, rtol=0, atol=1e-2)
    np.testing.assert_allclose(
        end.covariances.position, batch.covariances.position, rtol=1e-2, atol=1e-4
    )
    assert end.update_seconds.size == fleet.noisy.time.size
    assert np.isfinite(end.update_seconds).all()


def test_both_smoothers_with_a_short_lag_agree_to_a_fraction_of_sigma(make_fleet, as_stored):
    fleet = make_fleet(seed=4, gnss_every=10, n_landmarks=1)
    graph, poses = build_graph(fleet.noisy, "straight"), poses_at(fleet.noisy, [10, 20])
    ends = [
        GraphSolver(EVERY_SAMPLE).solve(
            graph,
            fleet.reckoned,
            method=Method(lag=2 * PING, incremental=incremental),
            covariance_poses=poses,
        )
        for incremental in (False, True)
    ]
    sigma = np.sqrt(np.einsum("eaiai->eai", ends[0].covariances.position))
    difference = np.abs(ends[0].position - ends[1].position)[poses]
    assert difference.max() > 0.0
    assert (difference < 0.1 * sigma).all()
    as_stored(ends)


@pytest.mark.slow
def test_a_lag_of_an_hour_lacks_information_of_the_batch(make_fleet):
    """
    Of two optimal estimates, the one with fewer measurements differs by the difference of their
    covariances.
    """
    hour, samples = (
        3600.0,
        [10, 20],
    )  # 1.9 and 0.8 h before the next fix, which the lag therefore lacks
    free = make_fleet(seed=6, n_times=60, turn=0.0, gnss_every=45)
    distance, expected, seeds = [], [], 40
    for seed in range(seeds):
        o = factories.add_noise(free.noise_free, seed)
        graph, poses = build_graph(o, "straight"), poses_at(o, samples)
        lagging, batch, online = (
            GraphSolver().solve(graph, free.truth, method=method, covariance_poses=poses)
            for method in (Method(lag=hour, incremental=True), Method(), Method(kalman=True))
        )
        apart = (lagging.position - batch.position)[poses]
        variance = [
            np.einsum("eaiai->ea", one.covariances.position) for one in (lagging, batch, online)
        ]
        assert (variance[1] < variance[0]).all()
        assert (variance[0] < variance[2]).all(), "a lag knows more than a filter"
        distance.append(np.sum(apart**2, axis=-1))
        expected.append(lagging.covariances.position - batch.covariances.position)
        assert (distance[-1] < 16.0 * variance[0]).all(), "four standard deviations"
    # errors are common to all vehicles: with the effective degrees of freedom of a realization
    matrix = np.mean(expected, axis=0).reshape(2, 9, 9)
    trace = np.trace(matrix, axis1=1, axis2=2)
    freedom = trace**2 / np.trace(matrix @ matrix, axis1=1, axis2=2)
    ratio = np.mean(distance, axis=0).sum(axis=1) / trace
    assert (np.abs(ratio - 1.0) < 4.0 * np.sqrt(2.0 / (freedom * seeds))).all()


def gtsams(graph, start, lag):
    """
    Positions and rotations of GTSAM's batch fixed-lag smoother, each when it was last in the
    window.
    """
    factors, values = to_gtsam(graph, start)
    factors = [factors.at(i) for i in range(factors.size())]
    enters = [graph.pose_time[list(factor.keys())].max() for factor in factors]
    steps = gtsam.LevenbergMarquardtParams()
    steps.setRelativeErrorTol(1e-12)
    steps.setAbsoluteErrorTol(1e-12)
    smoother, latest, before = gtsam.BatchFixedLagSmoother(lag, steps), gtsam.Values(), -np.inf
    for now in np.unique(graph.pose_time[graph["range"].variables]):
        added, new, time = gtsam.NonlinearFactorGraph(), gtsam.Values(), {}
        for factor, when in zip(factors, enters, strict=True):
            if before < when <= now:
                added.add(factor)
        for key in np.flatnonzero((graph.pose_time > before) & (graph.pose_time <= now)).tolist():
            new.insert(key, values.atPose3(key))
            time[key] = float(graph.pose_time[key])
        smoother.update(added, new, time)
        latest.insert_or_assign(smoother.calculateEstimate())
        before = now
    poses = [latest.atPose3(key) for key in range(graph.n_poses) if latest.exists(key)]
    return np.array([p.translation() for p in poses]), np.array(
        [p.rotation().matrix() for p in poses]
    )


@pytest.mark.parametrize("scale", [1.0, 0.1])
def test_the_smoother_differs_from_gtsam_by_curvature_only(make_fleet, scale):
    """
    GTSAM linearizes measurements beside marginalized poses once, which is of second order in the
    errors.
    """
    fleet = make_fleet(seed=4, n_times=41, gnss_every=40)
    names = [f.name for f in fields(fleet.noise_free) if f.name.endswith("_sigma")]
    smaller = {name: scale * np.asarray(getattr(fleet.noise_free, name)) for name in names}
    o = factories.add_noise(replace(fleet.noise_free, **smaller), 7)
    graph, samples = build_graph(o, "straight"), list(range(0, 41, 5))
    end = lagged(graph, fleet.truth, 2 * PING, samples=samples, o=o)
    position, rotation = gtsams(graph, fleet.truth, 2 * PING)
    assert len(position) == graph.n_poses
    sigma = np.sqrt(np.einsum("eaiai->eai", end.covariances.position))
    apart = np.abs(end.position - position)[poses_at(o, samples)]
    assert (apart < 5e-3 * scale * sigma).all()
    turned = np.linalg.norm(matrix_from_quaternion(end.quaternion) - rotation, axis=(1, 2))
    assert turned.max() < 1e-5 * scale**2
    batch = GraphSolver().solve(graph, fleet.truth)
    assert np.abs(batch.position - end.position).max() > 0.1 * scale, (
        "a batch knows what comes later"
    )
