"""Blocks of six against dense algebra, and residuals against GTSAM's of the same graph."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from factories import make_fleet, values_at

from pymantaray.apps.graphs import to_gtsam
from pymantaray.estimation import (
    LOSSES,
    FactorGraph,
    GraphSolver,
    GraphValues,
    SolveOptions,
    build_graph,
)
from pymantaray.estimation._kernels.cholesky import BATCH_ROWS
from pymantaray.estimation.graph.graph import KINDS
from pymantaray.estimation.solvers.normal_equations import SIZE, NormalEquations, Structure
from pymantaray.estimation.solvers.problems import GraphState, distance_problem
from pymantaray.estimation.solvers.starts import anchor_loose_parts, chordal, dead_reckon_graph
from pymantaray.geometry.se3 import quaternion_from_matrix, so3_exp


def factorize(equations):
    """Cholesky factor of equations, None if some direction is not determined."""
    solved = equations.step()
    return None if solved is None else solved[0]


def random_equations(rng, n=14, links=30):
    """Positive definite equations of variables of which few are connected, and their matrix."""
    pairs = np.array([rng.choice(n, 2, replace=False) for _ in range(links)])
    equations = NormalEquations(Structure(n, pairs))
    for part in (equations.diagonal, equations.above, equations.gradient):
        part.fill(0.0)
    dense = np.zeros((SIZE * n, SIZE * n))
    for pair in [*pairs, *np.arange(n)[:, None]]:
        root = rng.normal(size=(SIZE * len(pair),) * 2)
        equations.add(pair, root @ root.T, np.zeros(SIZE * len(pair)))
        at = (SIZE * pair[:, None] + np.arange(SIZE)).ravel()
        dense[np.ix_(at, at)] += root @ root.T
    return equations, dense, pairs


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("links", [6, 14, 30])  # chains, some closed; all connected
def test_solutions_and_blocks_equal_those_of_the_dense_matrix(seed, links):
    rng = np.random.default_rng(seed)
    equations, dense, pairs = random_equations(rng, links=links)
    assert sorted(equations.structure.row) == list(range(14))
    row, n = equations.structure.row, len(dense) // SIZE
    np.testing.assert_allclose(equations.information().toarray(), dense, rtol=0, atol=1e-12)
    factor, right = factorize(equations), rng.normal(size=(n, SIZE))
    expected = np.linalg.solve(dense, right.ravel()).reshape(n, SIZE)
    by_row = np.empty_like(right)
    by_row[row] = right
    np.testing.assert_allclose(factor.solve(by_row)[row], expected, rtol=1e-8, atol=1e-10)
    inverse = np.linalg.inv(dense)
    for pair, block in zip(pairs, factor.inverse(list(pairs)), strict=True):
        at = (SIZE * pair[:, None] + np.arange(SIZE)).ravel()
        np.testing.assert_allclose(block, inverse[np.ix_(at, at)], rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_a_step_equals_the_dense_solution_to_all_digits(seed):
    rng = np.random.default_rng(seed)
    equations, dense, _ = random_equations(rng)
    row = equations.structure.row
    equations.gradient[:] = rng.normal(size=(row.size, SIZE))
    gradient = equations.gradient.copy()
    factor, step = equations.step()
    np.testing.assert_array_equal(equations.gradient, gradient)
    np.testing.assert_array_equal(step, factor.solve(-gradient))
    expected = -np.linalg.solve(dense, gradient[row].ravel()).reshape(-1, SIZE)
    np.testing.assert_allclose(step[row], expected, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("count", [1, 5, 16])
def test_several_right_hand_sides_have_the_digits_of_each_alone(count):
    rng = np.random.default_rng(count)
    equations, dense, _ = random_equations(rng)
    row, factor = equations.structure.row, factorize(equations)
    right = rng.normal(size=(row.size, SIZE, count))
    found = factor.solve(right)
    for k in range(count):
        np.testing.assert_array_equal(found[..., k], factor.solve(right[..., k]))
    expected = np.linalg.solve(dense, right[row].reshape(-1, count))
    np.testing.assert_allclose(found[row].reshape(-1, count), expected, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_equations_over_others_are_those_in_new_arrays(order):
    fleet = make_fleet(seed=3, gnss_every=10, n_landmarks=1)
    problem, state = distance_problem(build_graph(fleet.noisy)), GraphState.of(fleet.reckoned)
    before = problem.linearize(GraphState.of(fleet.truth), 4)
    factorize(before)
    again, new = problem.linearize(state, order, before), problem.linearize(state, order)
    assert again is before
    for name in ("diagonal", "above", "gradient", "cost", "scale", "order"):
        np.testing.assert_array_equal(getattr(again, name), getattr(new, name))


@pytest.fixture(scope="module")
def long_fleet():
    """Enough poses for batches of rows."""
    return make_fleet(seed=4, n_times=150, gnss_every=40, n_landmarks=2, turn=0.0)


@pytest.mark.parametrize("n", [3, 4, 40, 1000])
def test_chains_have_the_least_number_of_blocks(n):
    chain = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    closed = np.concatenate([chain, [[n - 1, 0]], chain[:1]])
    star = np.stack([np.zeros(n - 1, dtype=int), np.arange(1, n)], axis=1)
    assert Structure(n, chain).column.size == n - 1
    assert Structure(n, star).column.size == n - 1
    assert Structure(n, closed).column.size == 2 * n - 3


def test_rows_of_a_batch_share_blocks_within_it_and_the_last_rows(long_fleet):
    graph = build_graph(long_fleet.noisy, "straight")
    ends = graph["range"].variables
    structure = distance_problem(graph).structure
    batch = structure.batch
    assert batch.size >= 4, "several batches"
    assert batch[0] == 0
    assert batch[-1] == graph.n_variables
    assert np.diff(batch)[:-1].max() <= BATCH_ROWS
    assert structure.row[ends].min() >= batch[-2], "rows of ranges come last"
    assert sorted(structure.row) == list(range(graph.n_variables))
    of_row = np.searchsorted(batch[1:], np.arange(graph.n_variables), side="right")
    row = np.repeat(np.arange(graph.n_variables), np.diff(structure.start))
    same = of_row[structure.column] == of_row[row]
    assert np.all(same | (structure.column >= batch[-2]))


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("loss", [None, LOSSES["cauchy"]])
def test_elimination_in_batches_gives_the_factor_of_the_whole_matrix(long_fleet, order, loss):
    graph = build_graph(long_fleet.noisy, "straight")
    problem, state = distance_problem(graph, loss), GraphState.of(long_fleet.truth)
    whole = problem.linearize(state, order)
    gradient = whole.gradient.copy()
    factor, step = whole.step()
    parts = problem.linearize(state, order, problem.linearize(state, order, begin=True), begin=True)
    assert parts.cost == whole.cost
    np.testing.assert_allclose(
        parts.gradient, gradient, rtol=0, atol=1e-12 * np.abs(gradient).max()
    )
    found, found_step = parts.step()
    np.testing.assert_allclose(found_step, step, rtol=0, atol=1e-9 * np.abs(step).max())
    pair = [graph["range"].variables[0].astype(np.intp)]
    (mine,), (theirs,) = found.inverse(pair), factor.inverse(pair)
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-8 * np.abs(theirs).max())


def test_elimination_batch_by_batch_finds_undetermined_directions(long_fleet):
    graph = build_graph(long_fleet.noisy, "straight")
    edge = graph["edge"]
    free = graph.with_factors(
        **{name: graph[name][:0] for name in ("prior", "fix", "survey", "depth")}
    )
    cut = graph.with_factors(edge=edge[np.arange(len(edge)) != 147])  # behind the last ranges
    for damaged in (free, cut):  # found in the last rows, and in a batch
        problem, state = distance_problem(damaged), GraphState.of(long_fleet.truth)
        assert problem.linearize(state).step() is None
        assert problem.linearize(state, begin=True).step() is None
        assert problem.linearize(state, begin=True).cost == problem.linearize(state).cost


def test_nearly_diagonal_covariances_have_the_diagonal_equations():
    fleet = make_fleet(seed=3, gnss_every=10)
    graph, state = build_graph(fleet.noisy), GraphState.of(fleet.reckoned)
    covariance = graph["edge"].covariance.copy()
    covariance[0, 0, 1] = covariance[0, 1, 0] = 1e-12 * covariance[0, 0, 0]
    slanted = graph.with_factors(edge=replace(graph["edge"], covariance=covariance))
    for order in (1, 2):
        one, other = (distance_problem(g).linearize(state, order) for g in (graph, slanted))
        assert one.cost == pytest.approx(other.cost, rel=1e-9)
        for name in ("diagonal", "above", "gradient"):
            mine, theirs = getattr(one, name), getattr(other, name)
            np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-11 * np.abs(theirs).max())


def test_a_direction_that_nothing_measures_is_not_factorized():
    equations, _, pairs = random_equations(np.random.default_rng(9))
    free = int(pairs[0, 0])
    equations.diagonal[equations.structure.row[free]] -= np.diag([0.0, 0.0, 1e9, 0.0, 0.0, 0.0])
    assert factorize(equations) is None


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
    state = GraphState.of(start)
    state.rotation[: len(start.position)] @= turned.reshape(-1, 3, 3)
    graph = build_graph(fleet.noisy, "straight")
    wide = graph["edge"].covariance + 1e-3 * np.ones((6, 6))  # rows that are not independent
    graph = graph.with_factors(
        edge=type(graph["edge"])(
            graph["edge"].kind, graph["edge"].variables, graph["edge"].measurement, wide
        )
    )
    start = state.values(graph)
    problem, (factors, values) = distance_problem(graph, loss), to_gtsam(graph, start, loss)
    assert problem.cost(state) == pytest.approx(factors.error(values), rel=1e-10)
    equations = problem.linearize(state)
    assert equations.cost == pytest.approx(factors.error(values), rel=1e-10)
    step = factorize(equations).solve(-equations.gradient)[problem.structure.row]
    theirs = factors.linearize(values).optimize(gtsam.Ordering.ColamdNonlinearFactorGraph(factors))
    n = graph.n_poses
    tangent = np.array([theirs.at(i) for i in range(n)])
    moved = np.einsum("nij,nj->ni", state.rotation[:n], tangent[:, 3:])
    scale = np.abs(moved).max()
    np.testing.assert_allclose(
        step[:n, :3], tangent[:, :3], rtol=0, atol=1e-6 * np.abs(tangent[:, :3]).max()
    )
    np.testing.assert_allclose(step[:n, 3:], moved, rtol=0, atol=1e-6 * scale)
    np.testing.assert_allclose(
        step[n:, 3:], [theirs.at(n), theirs.at(n + 1)], rtol=0, atol=1e-6 * scale
    )
    small = 1e-3 * step / np.abs(step).max()
    by_row = np.empty_like(small)
    by_row[problem.structure.row] = small
    ours = state.after_step(problem.structure, by_row).values(graph)
    np.testing.assert_allclose(
        ours.position, state.position[:n] + small[:n, 3:], rtol=0, atol=1e-12
    )
    expected = quaternion_from_matrix(state.rotation[:n] @ so3_exp(small[:n, :3]))
    np.testing.assert_allclose(ours.quaternion, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", [7, 8])
def test_curvature_halves_the_error_near_conflicting_ranges(
    seed,
):
    """What Gauss-Newton leaves after a step is what its matrix lacks of the second derivative."""
    fleet = make_fleet(seed=seed, range_error=30.0)
    graph = build_graph(fleet.noisy, "refracted")
    optimum = GraphState.of(GraphSolver().solve(graph, fleet.truth, model_is_right=False).values)
    problem, rng = distance_problem(graph), np.random.default_rng(1)
    offset = rng.normal(size=(len(optimum.position), SIZE)) * np.repeat([1e-5, 1e-2], 3)  # rad, m
    start = optimum.after_step(problem.structure, offset)
    left = []
    for order in (1, 3):
        equations = problem.linearize(start, order=order)
        end = start.after_step(problem.structure, factorize(equations).solve(-equations.gradient))
        left.append(np.abs(end.position - optimum.position).max())
    assert left[1] < 0.5 * left[0]


def wound(rings, angle, length, seed=0):
    """
    A pose graph that winds from pole to pole of a sphere: each pose is seen from the one before and
    from that below.
    """
    rng = np.random.default_rng(seed)
    n = rings * rings
    around, up = 2.0 * np.pi * np.arange(n) / rings, np.pi * ((np.arange(n) + 0.5) / n - 0.5)
    out = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=1)
    east = np.stack([-np.sin(around), np.cos(around), np.zeros(n)], axis=1)
    rotation, place = np.stack([east, np.cross(out, east), out], axis=2), 50.0 * out
    one = np.concatenate([np.arange(n - 1), np.arange(n - rings)])
    other = np.concatenate([np.arange(1, n), np.arange(rings, n)])
    back = np.swapaxes(rotation[one], 1, 2)
    step = np.einsum("nij,nj->ni", back, place[other] - place[one]) + rng.normal(
        0, length, (one.size, 3)
    )
    turn = quaternion_from_matrix(
        back @ rotation[other] @ so3_exp(rng.normal(0, angle, (one.size, 3)))
    )
    root = np.diag([angle] * 3 + [length] * 3) @ (
        np.eye(6) + 0.2 * rng.normal(size=(one.size, 6, 6))
    )
    edges = KINDS["edge"].table(
        np.stack([one, other], axis=1), [step, turn], root @ np.swapaxes(root, 1, 2)
    )
    graph = FactorGraph(
        vehicle_name=np.array(["A"]),
        landmark_name=np.array([], dtype=str),
        pose_vehicle=np.zeros(n, dtype=int),
        pose_number=np.arange(n),
        pose_time=np.arange(n, dtype=float),
        factors={"edge": edges},
    )
    values = GraphValues(place, quaternion_from_matrix(rotation), np.empty((0, 3)))
    return anchor_loose_parts(graph, values)[0], values


@pytest.mark.parametrize("n_ranges", [0, 5], ids=["along arcs", "along lines with ranges"])
def test_the_full_matrix_is_the_second_derivative(n_ranges):
    graph, values = wound(4, 0.3, 2.0)
    graph = graph.with_factors(prior=graph["prior"][:0])  # its own curvature is left out
    rng = np.random.default_rng(1)
    ends = np.stack([np.arange(n_ranges), np.arange(n_ranges) + 7], axis=1)
    distance = rng.uniform(20.0, 60.0, n_ranges)
    graph = graph.with_factors(range=KINDS["range"].table(ends, [distance], np.ones(n_ranges)))
    problem, state = distance_problem(graph), GraphState.of(values)
    equations = problem.linearize(state, 4)
    matrix, gradient = (
        equations.information().toarray(),
        equations.gradient[problem.structure.row].ravel(),
    )
    gauss_newton = problem.linearize(state, 1).information().toarray()
    for _ in range(5):
        direction = rng.normal(size=matrix.shape[0])
        by_row = np.empty((graph.n_poses, SIZE))
        by_row[problem.structure.row] = direction.reshape(-1, SIZE)
        h = 1e-4
        ahead, behind = (
            problem.cost(
                state.after_step(problem.structure, s * h * by_row, arc=problem.without_ranges)
            )
            for s in (1, -1)
        )
        assert (ahead - behind) / (2 * h) == pytest.approx(gradient @ direction, rel=1e-5)
        second = (ahead - 2.0 * equations.cost + behind) / h**2
        assert direction @ matrix @ direction == pytest.approx(second, rel=1e-5)
        assert abs(direction @ gauss_newton @ direction / second - 1.0) > 1e-3


def test_along_arcs_what_turns_as_a_whole_keeps_its_shape():
    graph, values = wound(4, 0.3, 2.0)
    problem, state = distance_problem(graph), GraphState.of(values)
    turn, centre = np.array([0.4, -0.7, 1.1]), np.array([10.0, -20.0, 5.0])
    step = np.concatenate(
        [np.swapaxes(state.rotation, 1, 2) @ turn, np.cross(turn, state.position - centre)], axis=1
    )
    by_row = np.empty_like(step)
    by_row[problem.structure.row] = step
    moved = state.after_step(problem.structure, by_row, arc=True)
    whole = so3_exp(turn)
    np.testing.assert_allclose(moved.rotation, whole @ state.rotation, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        moved.position, centre + (state.position - centre) @ whole.T, rtol=0, atol=1e-11
    )
    small = state.after_step(problem.structure, 1e-4 * by_row, arc=True)  # by series
    by_hand = centre + (state.position - centre) @ so3_exp(1e-4 * turn).T
    np.testing.assert_allclose(small.position, by_hand, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("angle", "start"), [(0.1, "composed"), (0.3, "chordal")])
def test_wound_pose_graphs_are_solved_in_few_steps_to_gtsams_cost(angle, start):
    graph, values = wound(14, angle, 0.2)
    begin = (
        dead_reckon_graph(graph, values)[0]
        if start == "composed"
        else chordal(graph, values).values
    )
    ours = GraphSolver().solve(graph, begin, model_is_right=False)
    assert ours.status.name == "OK"
    assert ours.iterations <= 60
    factors, where = to_gtsam(graph, chordal(graph, values).values)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-12)
    best = gtsam.LevenbergMarquardtOptimizer(factors, where, parameters).optimize()
    assert ours.final_cost <= factors.error(best) * (1.0 + 1e-6)


def test_long_chains_with_loops_take_few_steps_from_a_bad_start():
    fleet = make_fleet(1, n_vehicles=2, n_times=5_000, turn=0.0, gnss_every=400)
    graph = build_graph(fleet.noisy, "straight")
    problem, state = distance_problem(graph), GraphState.of(fleet.truth)
    assert factorize(problem.linearize(state, 2)) is None
    steps = []
    options = SolveOptions(report=lambda _, cost: steps.append(cost))
    solution = GraphSolver(options).solve(graph, fleet.truth)
    assert solution.status.name == "OK"
    assert len(steps) <= 8, steps  # Gauss-Newton without curvature takes 14
    plain, state = [], GraphState.of(fleet.truth)
    for _ in range(20):
        equations = problem.linearize(state)
        plain.append(equations.cost)
        state = state.after_step(problem.structure, factorize(equations).solve(-equations.gradient))
    assert solution.final_cost == pytest.approx(plain[-1], rel=1e-9)
    largest = np.abs(solution.values.position - state.position).max()
    assert largest < 1e-4  # m


def test_steps_are_reported_with_the_cost_behind_them():
    graph, values = wound(8, 0.1, 0.2)
    told = []
    options = SolveOptions(report=lambda step, cost: told.append((step, cost)))
    ours = GraphSolver(options).solve(
        graph, dead_reckon_graph(graph, values)[0], model_is_right=False
    )
    assert [step for step, _ in told] == list(range(1, ours.iterations + 1))
    assert told[-1][1] == ours.final_cost


def test_chordal_initialization_is_as_good_as_that_of_gtsam():
    graph, values = wound(8, 1e-6, 1e-6)
    almost = chordal(graph, values).values
    np.testing.assert_allclose(almost.position, values.position, rtol=0, atol=1e-3)
    graph, values = wound(8, 0.1, 0.2)
    factors, _ = to_gtsam(graph, values)
    theirs = gtsam.InitializePose3.initialize(factors)  # with a step of Gauss-Newton
    problem = distance_problem(graph)
    start = GraphState.of(chordal(graph, values).values)
    equations = problem.linearize(start)
    stepped = start.after_step(problem.structure, factorize(equations).solve(-equations.gradient))
    assert problem.cost(stepped) < 1.2 * factors.error(theirs)
