"""Batch solutions: closed forms, equal answers by two roads, statistics, and the health gate."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from pymantaray.estimation import (
    GraphSolver,
    GraphValues,
    SolveOptions,
    build_graph,
    dead_reckon,
    solve_conditions,
)
from pymantaray.estimation._gtsam import optimize
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, so3_exp
from pymantaray.records import SolveStatus

EMPTY = np.empty
NO_LANDMARKS = EMPTY((0, 3))
NO_PRIORS = {
    "prior_pose": EMPTY(0),
    "prior_position": EMPTY((0, 3)),
    "prior_quaternion": EMPTY((0, 4)),
    "prior_covariance": EMPTY((0, 6, 6)),
}
NO_FIXES = {"fix_pose": EMPTY(0), "fix_position": EMPTY((0, 3)), "fix_covariance": EMPTY((0, 3, 3))}
NO_DEPTHS = {"depth_pose": EMPTY(0), "depth": EMPTY(0), "depth_variance": EMPTY(0)}
NO_EDGES = {
    "edge_from": EMPTY(0),
    "edge_to": EMPTY(0),
    "edge_quaternion": EMPTY((0, 4)),
    "edge_translation": EMPTY((0, 3)),
    "edge_covariance": EMPTY((0, 6, 6)),
}
TIGHT = SolveOptions(step_tolerance=1e-9)


def values_of(position, quaternion, landmarks=NO_LANDMARKS):
    return GraphValues(
        position=position.reshape(-1, 3), quaternion=quaternion.reshape(-1, 4), landmark_position=landmarks
    )


def test_odometry_and_first_pose_alone_give_dead_reckoning(fleet):
    graph = replace(build_graph(fleet.noisy), **NO_FIXES, **NO_DEPTHS)
    assert graph.degrees_of_freedom == 0
    solution = GraphSolver(TIGHT).solve(graph, values_of(fleet.position, fleet.quaternion))
    position, quaternion = dead_reckon(fleet.noisy)
    assert solution.status == SolveStatus.OK
    np.testing.assert_allclose(solution.position, position.reshape(-1, 3), rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        matrix_from_quaternion(solution.quaternion),
        matrix_from_quaternion(quaternion.reshape(-1, 4)),
        rtol=0,
        atol=1e-9,
    )


def test_same_optimum_from_the_truth_and_from_dead_reckoning(fleet):
    conditions = ["straight", "refracted", "straight-all", "no-ranges"]
    solver = GraphSolver(TIGHT)
    from_truth = solve_conditions(fleet.noisy, conditions, (fleet.position, fleet.quaternion), solver=solver)
    from_odometry = solve_conditions(fleet.noisy, conditions, solver=solver)
    for name in conditions:
        assert from_truth[name].status == from_odometry[name].status == SolveStatus.OK
        np.testing.assert_allclose(
            from_truth[name].position, from_odometry[name].position, rtol=0, atol=1e-5, err_msg=name
        )
        assert from_truth[name].final_cost == pytest.approx(from_odometry[name].final_cost, rel=1e-9)
        assert from_odometry[name].initial_cost > from_odometry[name].final_cost


def test_default_tolerance_leaves_less_than_a_hundredth_of_a_millimetre(fleet):
    tight, default = (
        solve_conditions(fleet.noisy, ["refracted"], solver=GraphSolver(o))["refracted"]
        for o in (TIGHT, SolveOptions())
    )
    np.testing.assert_allclose(default.position, tight.position, rtol=0, atol=1e-5)


def test_steps_with_a_kept_factorization_end_where_newly_factorized_ones_do(fleet, monkeypatch):
    eliminated, calls = optimize._eliminated, []
    monkeypatch.setattr(optimize, "_eliminated", lambda *a: calls.append(1) or eliminated(*a))
    graph, start = build_graph(fleet.noisy, "refracted"), values_of(fleet.position, fleet.quaternion)
    kept = GraphSolver(TIGHT).solve(graph, start, model_is_right=False)
    assert len(calls) < kept.iterations
    calls.clear()
    monkeypatch.setattr(optimize, "_NEAR", 0.0)
    anew = GraphSolver(TIGHT).solve(graph, start, model_is_right=False)
    assert len(calls) == anew.iterations
    assert kept.status == anew.status == SolveStatus.OK
    assert kept.iterations <= anew.iterations + 1
    np.testing.assert_allclose(kept.position, anew.position, rtol=0, atol=1e-8)
    assert kept.final_cost == pytest.approx(anew.final_cost, rel=1e-12)


@pytest.mark.parametrize("variance", [1e-8, 1e-10, 1e-12])
def test_depths_so_good_that_cholesky_takes_them_for_singular_are_solved(fleet, variance):
    graph = build_graph(fleet.noisy, "straight")
    graph = replace(graph, depth_variance=np.full(graph.depth.size, variance))
    near = GraphSolver().solve(graph, values_of(fleet.position, fleet.quaternion), model_is_right=False)
    assert near.status == SolveStatus.OK
    assert near.iterations < 10
    np.testing.assert_allclose(near.position[:, 2], graph.depth, rtol=0, atol=1e-3)
    looser = replace(graph, depth_variance=np.full(graph.depth.size, 1e-6))  # Cholesky does that
    less = GraphSolver().solve(looser, values_of(fleet.position, fleet.quaternion), model_is_right=False)
    np.testing.assert_allclose(near.position, less.position, rtol=0, atol=0.01)
    if variance == 1e-10:  # damped steps, too
        far = GraphSolver().solve(graph, far_start(fleet), model_is_right=False)
        assert far.status == SolveStatus.OK
        np.testing.assert_allclose(far.position, near.position, rtol=0, atol=1e-4)


def far_start(fleet):
    rng = np.random.default_rng(0)
    turn = so3_exp(rng.normal(0, 1.0, (*fleet.quaternion.shape[:2], 3)))
    turned = matrix_from_quaternion(fleet.quaternion) @ turn
    position = fleet.position + rng.normal(0, 500.0, fleet.position.shape)
    return values_of(position, quaternion_from_matrix(turned))


def test_start_far_away_falls_back_on_damping_and_finds_the_same_optimum(fleet, monkeypatch):
    calls = []
    damped = optimize._levenberg_marquardt
    monkeypatch.setattr(optimize, "_levenberg_marquardt", lambda *a: calls.append(1) or damped(*a))
    graph = build_graph(fleet.noisy, "straight")
    near = GraphSolver(TIGHT).solve(graph, values_of(fleet.position, fleet.quaternion))
    assert not calls
    far = GraphSolver(TIGHT).solve(graph, far_start(fleet))
    assert calls
    assert far.status == SolveStatus.OK
    np.testing.assert_allclose(far.position, near.position, rtol=0, atol=1e-5)


def test_optimizer_that_gives_up_at_once_is_caught(fleet, monkeypatch):
    monkeypatch.setattr(optimize, "_levenberg_marquardt", lambda _graph, initial, *_: (initial, 0))
    solution = GraphSolver().solve(build_graph(fleet.noisy, "straight"), far_start(fleet))
    assert solution.status == SolveStatus.NO_ITERATION
    assert solution.iterations == 0
    assert np.isnan(solution.position).all()


def test_straight_line_with_a_fix_at_its_end_has_a_closed_form(make_fleet):
    o = make_fleet(n_agents=1, n_times=5).noise_free
    s0, s, g, step, fix = 2.0, 3.0, 0.5, 100.0, 415.0
    sigma = np.full((1, 4, 6), s)
    sigma[..., :3] = 1e-9  # so stiff in rotation that the problem is linear
    first_sigma = np.full((1, 6), s0)
    first_sigma[:, :3] = 1e-9
    line = replace(
        o,
        odometry_rotation=np.tile([1.0, 0, 0, 0], (1, 4, 1)),
        odometry_translation=np.tile([step, 0, 0], (1, 4, 1)),
        odometry_sigma=sigma,
        depth=np.zeros((1, 5)),
        depth_sigma=np.full(1, 1e-2),
        gnss_agent=[0],
        gnss_sample=[4],
        gnss_position=[[fix, 0.0, 0.0]],
        gnss_sigma=[g],
        first_position=np.zeros((1, 3)),
        first_quaternion=[[1.0, 0, 0, 0]],
        first_sigma=first_sigma,
    )
    solution = solve_conditions(line, ["no-ranges"])["no-ranges"]
    # the misfit at the end is shared out in proportion to the variances before it
    before = s0**2 + s**2 * np.arange(5)
    expected = step * np.arange(5) + (fix - 4 * step) * before / (before[-1] + g**2)
    np.testing.assert_allclose(solution.position[0, :, 0], expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(solution.position[0, :, 1:], 0.0, rtol=0, atol=1e-6)
    # the cost is half of the squared misfit in its standard deviation
    assert solution.final_cost == pytest.approx(0.5 * (fix - 4 * step) ** 2 / (before[-1] + g**2), rel=1e-6)


@pytest.mark.parametrize(
    "rotation_vector", [(0, 0, 0), (0.7, -0.4, 0.2), (0, np.pi / 2, 0), (2.0, 1.0, -1.0)]
)
def test_depth_moves_a_turned_body_down_and_nowhere_else(make_fleet, rotation_vector):
    o = make_fleet(n_agents=1, n_times=2).noise_free
    rotation = quaternion_from_matrix(so3_exp(np.array(rotation_vector, dtype=float)))
    prior, sigma, depth, depth_sigma = np.array([100.0, -50.0, 300.0]), 5.0, 320.0, 0.01
    first_sigma = np.array([[1e-3] * 3 + [sigma] * 3])
    sunk = replace(
        o,
        depth=[[depth, depth]],
        depth_sigma=[depth_sigma],
        first_position=prior[None],
        first_quaternion=rotation[None],
        first_sigma=first_sigma,
        odometry_rotation=[[[1.0, 0, 0, 0]]],
        odometry_translation=np.zeros((1, 1, 3)),
    )
    graph = replace(build_graph(sunk), **NO_EDGES)
    graph = replace(
        graph,
        pose_agent=[0],
        pose_number=[0],
        pose_time=[0.0],
        depth_pose=[0],
        depth=[depth],
        depth_variance=[depth_sigma**2],
    )
    solution = GraphSolver(TIGHT).solve(graph, values_of(prior, rotation), model_is_right=False)
    weight = depth_sigma**-2 / (depth_sigma**-2 + sigma**-2)
    assert solution.status == SolveStatus.OK
    # the prior's noise lives on the manifold, where turning and shifting mix at second order in its 1e-3 rad
    np.testing.assert_allclose(
        solution.position[0], prior + np.array([0, 0, weight * (depth - prior[2])]), rtol=0, atol=1e-3
    )


def test_two_landmarks_are_found_together_with_the_vehicles(make_fleet):
    exact = make_fleet(n_agents=2, n_landmarks=2)
    solution = solve_conditions(exact.noise_free, ["straight"])["straight"]
    np.testing.assert_allclose(solution.position, exact.position, rtol=0, atol=1e-4)
    np.testing.assert_allclose(
        solution.landmark_position, exact.noise_free.landmark_position, rtol=0, atol=1e-4
    )
    # many ranges from well-known places move a badly surveyed landmark towards where it is
    known = make_fleet(seed=5, n_agents=4, n_landmarks=2, gnss_every=1)
    o = known.noisy
    truth = known.noise_free.landmark_position
    off = replace(o, landmark_position=truth + 30.0, landmark_sigma=np.full(2, 30.0))
    found = solve_conditions(off, ["straight"], (known.position, known.quaternion))["straight"]
    assert found.status == SolveStatus.OK
    assert np.linalg.norm(found.landmark_position - truth, axis=1).max() < 3.0  # ranges of 1 m, about 40 each


def test_cost_is_chi_square_where_the_model_is_right(make_fleet):
    solver, cost, freedom = GraphSolver(), [], []
    for seed in range(30):
        fleet = make_fleet(seed=seed, n_agents=3, n_times=16, gnss_every=5)
        solution = solve_conditions(
            fleet.noisy, ["straight"], (fleet.position, fleet.quaternion), solver=solver
        )["straight"]
        assert solution.status == SolveStatus.OK
        cost.append(2.0 * solution.final_cost)
        freedom.append(round(2 * solution.expected_cost))
    quantile = stats.chi2.cdf(cost, freedom)
    assert 0.005 < stats.chi2.cdf(sum(cost), sum(freedom)) < 0.995, (sum(cost), sum(freedom))
    assert stats.kstest(quantile, "uniform").pvalue > 0.01


def test_a_used_solver_gives_the_same_digits_as_a_new_one(make_fleet):
    used = GraphSolver()
    for seed in (1, 2, 3):
        fleet = make_fleet(seed=seed, gnss_every=10, dropouts=0.1)
        start = fleet.position, fleet.quaternion
        again = solve_conditions(fleet.noisy, ["straight", "refracted"], start, solver=used)
        fresh = solve_conditions(fleet.noisy, ["straight", "refracted"], start)
        for name in again:
            np.testing.assert_array_equal(again[name].position, fresh[name].position)


@pytest.mark.parametrize("noise", ["noisy", "noise_free"])
@pytest.mark.parametrize(
    "removed",
    [
        {**NO_PRIORS, **NO_FIXES},  # the fleet may turn about and be carried sideways as one
        {**NO_PRIORS, **NO_FIXES, **NO_DEPTHS},  # and anywhere
        {**NO_EDGES},  # poses that only depth and some ranges know
    ],
    ids=["no prior", "nothing to hold on to", "no odometry"],
)
def test_unsolvable_graph_started_at_the_truth_is_caught(fleet, noise, removed):
    graph = replace(build_graph(getattr(fleet, noise), "straight"), **removed)
    solution = GraphSolver().solve(graph, values_of(fleet.position, fleet.quaternion))
    assert solution.status == SolveStatus.FAILED
    assert not solution.usable
    assert np.isnan(solution.position).all()
    assert np.isnan(solution.quaternion).all()


def test_iteration_limit_is_reported(fleet):
    start = values_of(*dead_reckon(fleet.noisy))
    solution = GraphSolver(SolveOptions(max_iterations=2)).solve(build_graph(fleet.noisy, "refracted"), start)
    assert solution.status == SolveStatus.NOT_CONVERGED
    assert np.isnan(solution.position).all()
