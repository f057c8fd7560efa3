"""Blocks of six against dense algebra, and residuals against GTSAM's of the same graph."""

import gtsam
import numpy as np
import pytest
from factories import make_fleet, values_at

from pymantaray.estimation import LOSSES, GraphSolver, build_graph, to_gtsam
from pymantaray.estimation.normal_equations import SIZE, NormalEquations, Structure
from pymantaray.estimation.problems import State, distance_problem
from pymantaray.geometry.se3 import quaternion_from_matrix, so3_exp


def random_equations(rng, n=14, links=30):
    """Positive definite equations of variables of which few are connected, and their matrix."""
    pairs = np.array([rng.choice(n, 2, replace=False) for _ in range(links)])
    equations = NormalEquations(Structure(n, pairs))
    dense = np.zeros((SIZE * n, SIZE * n))
    for pair in [*pairs, *np.arange(n)[:, None]]:
        root = rng.normal(size=(SIZE * len(pair),) * 2)
        equations.add(pair, root @ root.T, np.zeros(SIZE * len(pair)))
        at = (SIZE * pair[:, None] + np.arange(SIZE)).ravel()
        dense[np.ix_(at, at)] += root @ root.T
    return equations, dense, pairs


@pytest.mark.parametrize("seed", range(5))
def test_solutions_and_blocks_of_the_inverse_are_those_of_the_dense_matrix(seed):
    rng = np.random.default_rng(seed)
    equations, dense, pairs = random_equations(rng)
    row, n = equations.structure.row, len(dense) // SIZE
    np.testing.assert_allclose(equations.information().toarray(), dense, rtol=0, atol=1e-12)
    factor, right = equations.factorize(), rng.normal(size=(n, SIZE))
    expected = np.linalg.solve(dense, right.ravel()).reshape(n, SIZE)
    by_row = np.empty_like(right)
    by_row[row] = right
    np.testing.assert_allclose(factor.solve(by_row)[row], expected, rtol=1e-8, atol=1e-10)
    inverse = np.linalg.inv(dense)
    for pair, block in zip(pairs, factor.inverse(list(pairs)), strict=True):
        at = (SIZE * pair[:, None] + np.arange(SIZE)).ravel()
        np.testing.assert_allclose(block, inverse[np.ix_(at, at)], rtol=1e-8, atol=1e-10)


def test_a_direction_that_nothing_measures_is_not_factorized():
    equations, _, pairs = random_equations(np.random.default_rng(9))
    free = int(pairs[0, 0])
    equations.diagonal[equations.structure.row[free]] -= np.diag([0.0, 0.0, 1e9, 0.0, 0.0, 0.0])
    assert equations.factorize() is None


@pytest.mark.parametrize("turn", [1e-3, 1.0, 3.0])
@pytest.mark.parametrize("loss", [None, LOSSES["cauchy"]])
def test_cost_and_step_are_gtsams_however_far_poses_turned(turn, loss):
    """Residuals to rounding, and the step of the normal equations in the tangent of each pose."""
    fleet = make_fleet(seed=6, n_landmarks=2, gnss_every=7, turn=0.4)
    rng = np.random.default_rng(7)
    turned = so3_exp(turn * rng.normal(size=(*fleet.position.shape[:2], 3)) / np.sqrt(3.0))
    start = values_at(
        fleet.noisy, fleet.position + rng.normal(0, 30.0, fleet.position.shape), fleet.quaternion
    )
    state = State.of(start)
    state.rotation[: len(start.position)] @= turned.reshape(-1, 3, 3)
    graph = build_graph(fleet.noisy, "straight")
    wide = graph["edge"].covariance + 1e-3 * np.ones((6, 6))  # rows that are not independent
    graph = graph.with_factors(
        edge=type(graph["edge"])(graph["edge"].kind, graph["edge"].variables, graph["edge"].measured, wide)
    )
    start = state.values(graph)
    problem, (factors, values) = distance_problem(graph, loss), to_gtsam(graph, start, loss)
    assert problem.cost(state) == pytest.approx(factors.error(values), rel=1e-10)
    equations = problem.linearize(state)
    assert equations.cost == pytest.approx(factors.error(values), rel=1e-10)
    step = equations.factorize().solve(-equations.gradient)[problem.structure.row]
    theirs = factors.linearize(values).optimize(gtsam.Ordering.ColamdNonlinearFactorGraph(factors))
    n = graph.n_poses
    tangent = np.array([theirs.at(i) for i in range(n)])
    moved = np.einsum("nij,nj->ni", state.rotation[:n], tangent[:, 3:])
    scale = np.abs(moved).max()
    np.testing.assert_allclose(step[:n, :3], tangent[:, :3], rtol=0, atol=1e-6 * np.abs(tangent[:, :3]).max())
    np.testing.assert_allclose(step[:n, 3:], moved, rtol=0, atol=1e-6 * scale)
    np.testing.assert_allclose(step[n:, 3:], [theirs.at(n), theirs.at(n + 1)], rtol=0, atol=1e-6 * scale)
    small = 1e-3 * step / np.abs(step).max()
    by_row = np.empty_like(small)
    by_row[problem.structure.row] = small
    ours = state.moved(problem.structure, by_row).values(graph)
    np.testing.assert_allclose(ours.position, state.place[:n] + small[:n, 3:], rtol=0, atol=1e-12)
    expected = quaternion_from_matrix(state.rotation[:n] @ so3_exp(small[:n, :3]))
    np.testing.assert_allclose(ours.quaternion, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", [7, 8])
def test_near_the_optimum_of_ranges_that_conflict_curvature_leaves_less_than_half_of_the_error(seed):
    """What Gauss-Newton leaves after a step is what its matrix lacks of the second derivative."""
    fleet = make_fleet(seed=seed, range_error=30.0)
    graph = build_graph(fleet.noisy, "refracted")
    optimum = State.of(GraphSolver().solve(graph, fleet.truth, model_is_right=False).values)
    problem, rng = distance_problem(graph), np.random.default_rng(1)
    offset = rng.normal(size=(len(optimum.place), SIZE)) * np.repeat([1e-5, 1e-2], 3)  # rad, m
    start = optimum.moved(problem.structure, offset)
    left = []
    for order in (1, 3):
        equations = problem.linearize(start, order=order)
        end = start.moved(problem.structure, equations.factorize().solve(-equations.gradient))
        left.append(np.abs(end.place - optimum.place).max())
    assert left[1] < 0.5 * left[0]
