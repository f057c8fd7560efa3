"""Batch solutions: closed forms, equal answers by two roads, statistics, and the health gate."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from factories import add_noise, far_from, values_at, without
from refusals import refused
from scipy import stats

from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    CONDITIONS,
    GraphSolver,
    GraphValues,
    SolveOptions,
    build_graph,
    collect_estimates,
    dead_reckon,
    solve_conditions,
)
from pymantaray.estimation.solvers.normal_equations import NormalEquations
from pymantaray.estimation.solvers.solution import SolveProgress, gate
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, so3_exp
from pymantaray.records import SolveStatus

TIGHT = SolveOptions(step_tolerance=1e-9)


def test_odometry_and_first_pose_alone_give_dead_reckoning(fleet):
    graph = without(build_graph(fleet.noisy), "fix", "depth")
    assert graph.degrees_of_freedom == 0
    solution = GraphSolver(TIGHT).solve(graph, fleet.truth)
    position, quaternion = dead_reckon(fleet.noisy)
    assert solution.status == SolveStatus.OK
    np.testing.assert_allclose(solution.position, position.reshape(-1, 3), rtol=0, atol=1e-6)
    turns = (matrix_from_quaternion(q) for q in (solution.quaternion, quaternion.reshape(-1, 4)))
    np.testing.assert_allclose(*turns, rtol=0, atol=1e-9)


def test_same_optimum_from_the_truth_and_from_dead_reckoning(fleet):
    conditions = ["straight", "refracted", "straight-all", "no-ranges"]
    solver = GraphSolver(TIGHT)
    truth, odometry = (
        solve_conditions(fleet.noisy, conditions, start, solver=solver)
        for start in (fleet.start, None)
    )
    for name in conditions:
        a, b = truth[name], odometry[name]
        assert a.status == b.status == SolveStatus.OK
        np.testing.assert_allclose(a.position, b.position, rtol=0, atol=1e-5, err_msg=name)
        assert a.final_cost == pytest.approx(b.final_cost, rel=1e-9)
        assert b.initial_cost > b.final_cost
    default = solve_conditions(fleet.noisy, ["refracted"])["refracted"]
    np.testing.assert_allclose(default.position, odometry["refracted"].position, rtol=0, atol=1e-5)


def test_a_start_far_away_is_damped_to_the_same_optimum(fleet, damped):
    graph = build_graph(fleet.noisy, "straight")
    near = GraphSolver(TIGHT).solve(graph, fleet.truth)
    assert not damped
    far = GraphSolver(TIGHT).solve(graph, values_at(fleet.noisy, *far_from(fleet, 9)))
    assert damped
    assert far.status == SolveStatus.OK
    np.testing.assert_allclose(far.position, near.position, rtol=0, atol=1e-5)


def test_optimizer_that_gives_up_at_once_is_caught(fleet, monkeypatch):
    unsolvable = SimpleNamespace(step=lambda: None)
    monkeypatch.setattr(NormalEquations, "with_damping", lambda *_: unsolvable)
    start = values_at(fleet.noisy, *far_from(fleet, 9))
    solution = GraphSolver().solve(build_graph(fleet.noisy, "straight"), start)
    assert solution.status in {SolveStatus.NO_ITERATION, SolveStatus.NOT_CONVERGED}
    assert np.isnan(solution.position).all()


def test_straight_line_with_a_fix_at_its_end_has_a_closed_form(make_fleet):
    o = make_fleet(n_vehicles=1, n_times=5).noise_free
    s0, s, g, step, fix = 2.0, 3.0, 0.5, 100.0, 415.0
    stiff = [1e-9] * 3  # in rotation, so that the problem is linear
    line = replace(
        o,
        odometry_rotation=np.tile([1.0, 0, 0, 0], (1, 4, 1)),
        odometry_translation=np.tile([step, 0, 0], (1, 4, 1)),
        odometry_sigma=np.tile([*stiff, s, s, s], (1, 4, 1)),
        depth=np.zeros((1, 5)),
        depth_sigma=np.full(1, 1e-2),
        gnss_vehicle=[0],
        gnss_sample=[4],
        gnss_position=[[fix, 0.0, 0.0]],
        gnss_sigma=[g],
        first_position=np.zeros((1, 3)),
        first_quaternion=[[1.0, 0, 0, 0]],
        first_sigma=[[*stiff, s0, s0, s0]],
    )
    solution = solve_conditions(line, ["no-ranges"])["no-ranges"]
    # the misfit at the end is shared out in proportion to the variances before it
    before = s0**2 + s**2 * np.arange(5)
    expected = step * np.arange(5) + (fix - 4 * step) * before / (before[-1] + g**2)
    np.testing.assert_allclose(solution.position[0, :, 0], expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(solution.position[0, :, 1:], 0.0, rtol=0, atol=1e-6)
    # the cost is half of the squared misfit in its standard deviation
    assert solution.final_cost == pytest.approx(
        0.5 * (fix - 4 * step) ** 2 / (before[-1] + g**2), rel=1e-6
    )


@pytest.mark.parametrize(
    "rotation_vector", [(0, 0, 0), (0.7, -0.4, 0.2), (0, np.pi / 2, 0), (2.0, 1.0, -1.0)]
)
def test_depth_moves_a_turned_body_down_and_nowhere_else(make_fleet, rotation_vector):
    o = make_fleet(n_vehicles=1, n_times=2).noise_free
    rotation = quaternion_from_matrix(so3_exp(np.array(rotation_vector, dtype=float)))
    prior, sigma, depth, depth_sigma = np.array([100.0, -50.0, 300.0]), 5.0, 320.0, 0.01
    sunk = replace(
        o,
        depth=[[depth, depth]],
        depth_sigma=[depth_sigma],
        first_position=prior[None],
        first_quaternion=rotation[None],
        first_sigma=[[1e-3] * 3 + [sigma] * 3],
        odometry_translation=np.zeros((1, 1, 3)),
    )
    graph = without(build_graph(sunk), "edge")
    graph = replace(graph, pose_vehicle=[0], pose_number=[0], pose_time=[0.0])
    graph = graph.with_factors(depth=graph["depth"][:1])
    start = GraphValues(prior[None], rotation[None], np.empty((0, 3)))
    solution = GraphSolver(TIGHT).solve(graph, start, model_is_right=False)
    assert solution.status == SolveStatus.OK
    weight = depth_sigma**-2 / (depth_sigma**-2 + sigma**-2)
    expected = prior + np.array([0, 0, weight * (depth - prior[2])])
    # the prior's noise lives on the manifold, where turning and shifting mix at second order in its
    # 1e-3 rad
    np.testing.assert_allclose(solution.position[0], expected, rtol=0, atol=1e-3)


def test_badly_surveyed_landmarks_are_located_with_the_vehicles(make_fleet):
    # many ranges from well-known places move a badly surveyed landmark towards where it is
    known = make_fleet(seed=5, n_vehicles=4, n_landmarks=2, gnss_every=1)
    o = known.noisy
    truth = known.noise_free.landmark_position
    off = replace(o, landmark_position=truth + 30.0, landmark_sigma=np.full(2, 30.0))
    found = solve_conditions(off, ["straight"], known.start)["straight"]
    assert found.status == SolveStatus.OK
    assert (
        np.linalg.norm(found.landmark_position - truth, axis=1).max() < 3.0
    )  # ranges of 1 m, about 40 each


def test_cost_is_chi_square_where_the_model_is_right(make_fleet):
    solver, cost, freedom = GraphSolver(), [], []
    for seed in range(30):
        fleet = make_fleet(seed=seed, n_vehicles=3, n_times=16, gnss_every=5)
        solution = solve_conditions(fleet.noisy, ["straight"], fleet.start, solver=solver)[
            "straight"
        ]
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
        again, fresh = (
            solve_conditions(fleet.noisy, ["straight", "refracted"], fleet.start, solver=solver)
            for solver in (used, None)
        )
        for name in again:
            np.testing.assert_array_equal(again[name].position, fresh[name].position)


def test_iteration_limit_is_reported(fleet):
    graph = build_graph(fleet.noisy, "refracted")
    solution = GraphSolver(SolveOptions(max_iterations=2)).solve(graph, fleet.reckoned)
    assert solution.status == SolveStatus.NOT_CONVERGED
    assert np.isnan(solution.position).all()


@pytest.mark.parametrize("sigma", [1e-4, 1e-6])
def test_very_precise_depths_hold_rolled_vehicles(fleet, sigma):
    graph = build_graph(fleet.noisy, "straight")
    good, sharp = (
        graph.with_factors(depth=replace(graph["depth"], covariance=np.full((90, 1, 1), s**2)))
        for s in (1e-3, sigma)
    )
    near, at = (
        GraphSolver(TIGHT).solve(g, fleet.truth, model_is_right=False) for g in (good, sharp)
    )
    assert near.usable
    assert at.usable
    off = at.position[:, 2] - graph["depth"].column("depth")
    assert np.abs(off).max() < 5.0 * sigma
    np.testing.assert_allclose(
        at.position, near.position, rtol=0, atol=5e-3
    )  # five of the larger sigma


GOOD = SolveProgress(
    iterations=4,
    initial_cost=900.0,
    final_cost=100.0,
    gradient_norm=1e-3,
    newton_decrement=1e-9,
    last_step=1e-6,
)


@pytest.mark.parametrize(("change", "status"), [
    ({}, SolveStatus.OK),
    ({"iterations": 0}, SolveStatus.NO_ITERATION),
    ({"final_cost": 901.0}, SolveStatus.COST_ROSE),
    ({"last_step": 1.0}, SolveStatus.NOT_CONVERGED),
    ({"last_step": np.nan}, SolveStatus.NOT_CONVERGED),
    ({"newton_decrement": 0.1}, SolveStatus.NOT_CONVERGED),
    ({"newton_decrement": np.nan}, SolveStatus.NOT_CONVERGED),
    ({"singular": True}, SolveStatus.FAILED),
    ({"final_cost": np.nan}, SolveStatus.FAILED),
    ({"final_cost": 151.0}, SolveStatus.OVER_CHI_SQUARE),  # expected 100, standard deviation 10
    ({"final_cost": 49.0}, SolveStatus.UNDER_CHI_SQUARE),
    ({"final_cost": 51.0}, SolveStatus.OK),
    ({"final_cost": 149.0}, SolveStatus.OK),
])  # fmt: skip
def test_gate_has_a_verdict_for_each_way_to_end(change, status):
    assert gate(replace(GOOD, **change), SolveOptions(), expected_cost=100.0) == status


def test_a_cost_out_of_bounds_is_a_status_or_a_finding(make_fleet):
    fleet = make_fleet(seed=1, range_error=30.0, gnss_every=10)
    solved = solve_conditions(fleet.noisy, ["straight", "refracted"], fleet.start)
    assert solved["straight"].status == solved["refracted"].status == SolveStatus.OK
    assert solved["refracted"].final_cost > 5 * solved["refracted"].expected_cost
    sure = replace(fleet.noisy, range_sigma=np.full(fleet.noisy.range_sigma.size, 0.1))
    solution = solve_conditions(sure, ["straight"])["straight"]
    assert solution.status == SolveStatus.OVER_CHI_SQUARE
    assert np.isfinite(solution.position).all()
    unsure = replace(fleet.noisy, range_sigma=np.full(fleet.noisy.range_sigma.size, 1e3))
    unsure = replace(unsure, odometry_sigma=10.0 * fleet.noisy.odometry_sigma)
    solution = solve_conditions(unsure, ["straight"])["straight"]
    assert solution.status == SolveStatus.UNDER_CHI_SQUARE
    assert np.isfinite(solution.position).all()


def test_a_wrong_basin_is_left_for_a_lower_one_with_a_status(make_fleet):
    free = make_fleet(seed=3, gnss_every=29, turn=0.0)
    worse = free.noise_free.odometry_sigma * [10, 10, 10, 20, 20, 20]
    o = add_noise(replace(free.noise_free, odometry_sigma=worse), 53)
    graph, reckoned = build_graph(o, "refracted"), values_at(o, *dead_reckon(o))
    first = GraphSolver().solve(graph, reckoned, model_is_right=False)
    assert first.status == SolveStatus.OK, "nothing of it shows that it is wrong"
    solved = solve_conditions(o, ["refracted"])["refracted"]
    assert solved.status == SolveStatus.SECOND_MINIMUM
    assert solved.final_cost < 0.99 * first.final_cost
    from_truth = solve_conditions(o, ["refracted"], free.start)["refracted"]
    assert solved.final_cost == pytest.approx(from_truth.final_cost, rel=1e-6)
    assert from_truth.status == SolveStatus.OK
    assert np.isfinite(solved.position).all()


@pytest.mark.parametrize("steps", [4, 10, 20])
def test_the_lower_descent_is_finished_if_steps_end_early(make_fleet, steps):
    free = make_fleet(seed=3, gnss_every=29, turn=0.0)
    worse = free.noise_free.odometry_sigma * [10, 10, 10, 20, 20, 20]
    noisy = add_noise(replace(free.noise_free, odometry_sigma=worse), 53)
    expected = solve_conditions(noisy, ["refracted"], free.start)["refracted"]
    few = GraphSolver(SolveOptions(max_iterations=steps))
    solved = solve_conditions(noisy, ["refracted"], solver=few)["refracted"]
    assert solved.usable
    assert solved.final_cost == pytest.approx(expected.final_cost, rel=1e-6)


def test_estimates_hold_every_condition_and_realization(make_fleet):
    runs = [
        make_fleet(seed=s, n_vehicles=2, n_times=12, n_landmarks=1, gnss_every=5) for s in (0, 1)
    ]
    solved = [solve_conditions(r.noisy, list(CONDITIONS)) for r in runs]
    estimates = collect_estimates(runs[0].noisy, solved)
    assert estimates.condition.tolist() == list(CONDITIONS)
    assert estimates.position.shape == (len(CONDITIONS), 2, 2, 12, 3)
    assert estimates.landmark_position.shape == (len(CONDITIONS), 2, 1, 3)
    np.testing.assert_array_equal(estimates.position[0, 1], dead_reckon(runs[1].noisy)[0])
    assert np.isnan(estimates.final_cost[0]).all()
    assert np.isfinite(estimates.final_cost[1:]).all()
    with pytest.raises(EstimationError, match="realization 1 has conditions"):
        collect_estimates(runs[0].noisy, [solved[0], {"odometry": solved[1]["odometry"]}])
    refused(EstimationError, "at least one", collect_estimates, runs[0].noisy, [])


def test_bad_requests_are_refused(fleet):
    with pytest.raises(EstimationError, match="unknown condition 'bent'; allowed are odometry"):
        solve_conditions(fleet.noisy, ["bent"])
    with pytest.raises(
        EstimationError, match="values for 30 poses and 0 landmarks; the graph has 90 and 0"
    ):
        solve_conditions(fleet.noisy, ["straight"], (fleet.position[:1], fleet.quaternion[:1]))
