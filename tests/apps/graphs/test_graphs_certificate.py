"""
The certificate of global optimality, against dense matrices, costs by loops, and descents from many
starts.
"""

import numpy as np
import pytest
from factories import values_at
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from two_minima import FILES, drone, ring

from pymantaray.apps.graphs import certify, open_graph, solve_graph
from pymantaray.apps.graphs.chordal_problem import ChordalProblem
from pymantaray.apps.graphs.staircase import descend, least_eigenpair, relax, rounded
from pymantaray.estimation import build_graph


def planar_ranges(seed=1, *, loops=True):
    """Planar PyFactorGraph text of a square path with ranges to two landmarks."""
    rng = np.random.default_rng(seed)
    corner = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [0.0, 20.0], [0.0, 0.0]])
    place = np.concatenate(
        [corner[k] + (corner[k + 1] - corner[k]) * np.arange(5)[:, None] / 5 for k in range(4)]
    )
    angle = np.repeat(np.arange(4) * np.pi / 2, 5)
    landmark = np.array([[8.0, 12.0], [25.0, 3.0]])
    lines = [
        f"VERTEX_SE2 {k} A{k} {x:.9g} {y:.9g} {angle[k]:.9g}" for k, (x, y) in enumerate(place)
    ]
    lines += [f"VERTEX_XY L{k} {x} {y}" for k, (x, y) in enumerate(landmark)]
    lines.append("VERTEX_SE2:PRIOR 0 A0 0 0 0 1e-4 0 0 1e-4 0 1e-6")
    for a, b in [*((k, k + 1) for k in range(19)), *([(0, 19)] if loops else [])]:
        c, s = np.cos(angle[a]), np.sin(angle[a])
        step = np.array([[c, s], [-s, c]]) @ (place[b] - place[a]) + 0.1 * rng.normal(size=2)
        turn = angle[b] - angle[a] + 0.02 * rng.normal()
        lines.append(
            f"EDGE_SE2 {b} A{a} A{b} {step[0]:.9g} {step[1]:.9g} {turn:.9g} 0.01 0 0 0.01 0 4e-4"
        )
    for k in range(20):
        for j in range(2):
            distance = np.linalg.norm(place[k] - landmark[j]) + 0.2 * rng.normal()
            lines.append(f"EDGE_RANGE {k} A{k} L{j} {distance:.9g} 0.04")
    return "\n".join(lines) + "\n"


def spatial(seed=4):
    """PyFactorGraph text of a few poses with every kind of factor that the certificate has."""
    rng = np.random.default_rng(seed)
    n, sigma = 6, np.array([0.1, 0.11, 0.12, 0.05, 0.06, 0.07])
    place, turn = 10.0 * rng.normal(size=(n, 3)), Rotation.random(n, random_state=seed)
    landmark = np.array([3.0, -4.0, 5.0])

    def upper(s):
        return " ".join(f"{v:.9g}" for v in np.diag(s**2)[np.triu_indices(len(s))])

    def text(*numbers):
        return " ".join(f"{v:.12g}" for v in np.concatenate(numbers))

    lines = [f"VERTEX_SE3:QUAT {k} A{k} {text(place[k], turn[k].as_quat())}" for k in range(n)]
    lines.append(f"VERTEX_XYZ L0 {text(landmark)}")
    lines.append(f"VERTEX_SE3:QUAT:PRIOR 0 A0 {text(place[0], turn[0].as_quat())} {upper(sigma)}")
    fix = np.concatenate([place[3] + 0.1, [0.0, 0.0, 0.0, 1.0]])
    lines.append(f"VERTEX_SE3:QUAT:PRIOR 3 A3 {text(fix)} {upper(np.repeat([0.3, 1e7], 3))}")
    attitude = np.concatenate([np.zeros(3), turn[4].as_quat()])
    lines.append(f"VERTEX_SE3:QUAT:PRIOR 4 A4 {text(attitude)} {upper(np.repeat([1e7, 0.2], 3))}")
    lines.append(f"VERTEX_XYZ:PRIOR 0 L0 {text(landmark + 0.2)} {upper(np.full(3, 0.5))}")
    for a, b in [*((k, k + 1) for k in range(n - 1)), (0, 5), (1, 4)]:
        noise = sigma * rng.normal(size=6)
        step = turn[a].inv().apply(place[b] - place[a]) + noise[:3]
        rotation = turn[a].inv() * turn[b] * Rotation.from_rotvec(noise[3:])
        lines.append(f"EDGE_SE3:QUAT {b} A{a} A{b} {text(step, rotation.as_quat())} {upper(sigma)}")
    sighting = turn[2].inv().apply(landmark - place[2])
    lines.append(f"EDGE_SE3_XYZ 2 A2 L0 {text(sighting)} {upper(np.full(3, 0.2))}")
    lines += [
        f"EDGE_RANGE {k} A{k} L0 {np.linalg.norm(landmark - place[k]) + 0.1:.9g} 0.01"
        for k in range(n)
    ]
    lines.append(f"EDGE_RANGE 2 A2 A5 {np.linalg.norm(place[5] - place[2]):.9g} 0.01")
    return "\n".join(lines) + "\n"


@pytest.fixture
def opened(tmp_path):
    def write(text, name="g.pyfg"):
        (tmp_path / name).write_text(text)
        return open_graph(tmp_path / name)

    return write


def chordal_cost(graph, rotation, place):
    """Cost of the certificate's problem, factor by factor, ranges as distances."""
    d = 2 if graph.planar else 3
    turns = [2] if d == 2 else [0, 1, 2]
    cost = 0.0
    for name in ("prior", "fix", "survey", "edge", "attitude", "sighting"):
        table = graph[name]
        for k, ends in enumerate(table.variables):
            variance = np.diag(table.covariance[k])
            first = (
                (np.eye(d), np.zeros(d)) if len(ends) == 1 else (rotation[ends[0]], place[ends[0]])
            )
            if "quaternion" in table.kind.columns_at:
                q = table.column("quaternion")[k][[1, 2, 3, 0]]
                measured = Rotation.from_quat(q).as_matrix()[:d, :d]
                off = rotation[ends[-1]] - first[0] @ measured
                cost += 0.5 * np.sum(off**2) / (2.0 * variance[turns].mean())
                variance = variance[3:]
            if "position" in table.kind.columns_at:
                off = place[ends[-1]] - first[1] - first[0] @ table.column("position")[k][:d]
                cost += 0.5 * off @ off / variance[:d].mean()
    ranges = graph["range"]
    for (a, b), distance, variance in zip(
        ranges.variables, ranges.column("distance"), ranges.variance, strict=True
    ):
        cost += 0.5 * (np.linalg.norm(place[a] - place[b]) - distance) ** 2 / variance
    return cost


def parts(problem, x):
    """Rotations and positions of a point."""
    rows = problem.rotation_row[:, None] + np.arange(problem.d)
    return np.swapaxes(x[rows], 1, 2), problem.positions(x)


@pytest.mark.parametrize("text", [spatial(), planar_ranges(), drone(wave=20.0)[0]])
def test_matrix_form_has_the_cost_of_the_factors(opened, text):
    file = opened(text)
    problem = ChordalProblem(file.graph)
    x = problem.matrix(file.values)
    assert problem.cost(x) == pytest.approx(chordal_cost(file.graph, *parts(problem, x)), rel=1e-12)


@pytest.mark.parametrize("text", [spatial(), planar_ranges()])
def test_the_cost_is_a_quadratic_form_of_the_certificate_matrix(opened, text, as_stored):
    file = opened(text)
    problem = ChordalProblem(file.graph)
    point, _ = descend(problem, problem.matrix(solve_graph(file).values))
    matrix = problem.certificate_matrix(point).toarray()
    np.testing.assert_allclose(matrix @ point, 0.0, atol=1e-6 * np.abs(matrix).max())
    rng = np.random.default_rng(0)
    for _ in range(5):
        other = problem.matrix(file.values)
        rows = problem.rotation_row[:, None] + np.arange(problem.d)
        turn = Rotation.random(len(rows), random_state=rng).as_matrix()
        if problem.d == 2:
            angle = rng.uniform(-np.pi, np.pi, len(rows))
            turn = np.stack(
                [np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)], 1
            ).reshape(-1, 2, 2)
        other[rows] = turn
        other[problem.position_row] = 20.0 * rng.normal(size=(problem.position_row.size, problem.d))
        unit = rng.normal(size=(problem.unit_row.size, problem.d))
        other[problem.unit_row] = unit / np.linalg.norm(unit, axis=1)[:, None]
        form = 0.5 * np.trace(other.T @ matrix @ other)
        assert problem.cost(other) == pytest.approx(problem.cost(point) + form, rel=1e-9)
    as_stored([problem.cost(point), matrix])


def test_least_eigenvalue_is_that_of_the_dense_schur_complement(opened, as_stored):
    file = opened(planar_ranges())
    problem = ChordalProblem(file.graph)
    for start in (solve_graph(file).values, file.values):
        point = problem.matrix(start)
        dense, c = problem.certificate_matrix(point).toarray(), problem.constrained
        schur = dense[np.ix_(c, c)] - dense[np.ix_(c, ~c)] @ np.linalg.solve(
            dense[np.ix_(~c, ~c)], dense[np.ix_(~c, c)]
        )
        ours, direction = least_eigenpair(problem, point)
        np.testing.assert_allclose(schur @ direction[c], ours * direction[c], atol=1e-5)
        assert ours == pytest.approx(np.linalg.eigvalsh(schur)[0], rel=1e-5, abs=1e-6)
    as_stored(dense)


def test_a_twisted_ring_is_not_certified_and_the_ring_is(opened, as_stored):
    file = opened(ring(24, 1, 0, 0.1, 20.0), "g.g2o")
    result = solve_graph(file, start="best", truth=False)
    certificate = {o.name: certify(result.graph, o.solution.values) for o in result.outcomes}
    assert certificate["chordal"].certified
    assert certificate["chordal"].text.startswith("certified")
    assert not certificate["file"].certified
    assert certificate["file"].least_eigenvalue < -0.1
    assert certificate["file"].lower_bound <= certificate["chordal"].cost < certificate["file"].cost
    assert "least eigenvalue" in certificate["file"].text
    as_stored(certificate)


@pytest.mark.parametrize(
    "text", [pytest.param(planar_ranges(5), marks=pytest.mark.slow), spatial()]
)
def test_no_descent_from_random_points_ends_below_the_certified_cost(opened, text):
    """
    Least squares on rotation vectors and positions, which shares nothing with the certificate.
    """
    file = opened(text)
    result = solve_graph(file, start="best", random_starts=4)
    certificate = certify(result.graph, result.values)
    assert certificate.certified
    assert certificate.lower_bound == pytest.approx(certificate.cost, rel=1e-6)
    problem = ChordalProblem(result.graph)
    n, m, d = result.graph.n_poses, result.graph.n_variables, problem.d
    free = 1 if d == 2 else 3

    def cost(x):
        angle = x[: n * free].reshape(n, free)
        vectors = np.column_stack([np.zeros((n, 2)), angle]) if d == 2 else angle
        rotation = Rotation.from_rotvec(vectors).as_matrix()[:, :d, :d]
        return [np.sqrt(2.0 * chordal_cost(result.graph, rotation, x[n * free :].reshape(m, d)))]

    rng = np.random.default_rng(3)
    ends = []
    for _ in range(2):
        start = np.concatenate([rng.uniform(-1, 1, n * free), 10 * rng.normal(size=m * d)])
        ends.append(least_squares(cost, start, max_nfev=8).cost)
    assert min(ends) >= certificate.lower_bound * (1 - 1e-9)


def test_a_graph_with_depths_has_no_certificate_and_says_why(opened, make_fleet):
    fleet = make_fleet(seed=7, n_vehicles=1, n_times=5, n_landmarks=1)
    graph = build_graph(fleet.noisy, "straight")
    certificate = certify(graph, values_at(fleet.noise_free, *fleet.start))
    assert not certificate.certified
    assert "depth" in certificate.text


@pytest.mark.parametrize(
    "name",
    ["cooperative-2.pyfg", pytest.param("sphere-big-noise-4.g2o", marks=pytest.mark.slow)],
)
def test_a_relaxation_is_a_global_minimum_of_the_dense_dual_problem(opened, name):
    """
    Feasible, with a positive semidefinite dual matrix that is computed densely: the gap is that of
    semidefinite programming.
    """
    result = solve_graph(opened(FILES[name](), name), start="chordal", truth=False)
    problem = ChordalProblem(result.graph)
    relaxation = relax(problem, problem.matrix(result.values))
    x, d = relaxation.point, problem.d
    assert relaxation.rank > d
    assert not relaxation.tight
    blocks = [slice(None, d), *(slice(r, r + d) for r in problem.rotation_row)]
    blocks += [slice(r, r + 1) for r in problem.unit_row]
    quadratic = (problem.root.T @ problem.root).toarray()
    multipliers = np.zeros_like(quadratic)
    for block in blocks:
        np.testing.assert_allclose(x[block] @ x[block].T, np.eye(len(x[block])), atol=1e-9)
        product = (quadratic @ x)[block] @ x[block].T
        multipliers[block, block] = 0.5 * (product + product.T)
    c = problem.constrained
    dual = quadratic - multipliers
    schur = dual[np.ix_(c, c)] - dual[np.ix_(c, ~c)] @ np.linalg.solve(
        dual[np.ix_(~c, ~c)], dual[np.ix_(~c, c)]
    )
    bound = 0.5 * np.trace(multipliers) + 0.5 * np.count_nonzero(c) * min(
        np.linalg.eigvalsh(schur)[0], 0.0
    )
    assert relaxation.cost == pytest.approx(0.5 * np.trace(x.T @ quadratic @ x), rel=1e-9)
    assert bound == pytest.approx(relaxation.cost, rel=2e-3)
    assert relaxation.lower_bound <= relaxation.cost * (1 + 1e-12)
    assert relaxation.cost < problem.cost(problem.matrix(result.values))


def test_rounded_relaxation_of_a_tight_problem_is_its_minimum(opened, as_stored):
    result = solve_graph(opened(ring(24, 0, 0, 0.1, 0.5), "g.g2o"), start="chordal", truth=False)
    problem = ChordalProblem(result.graph)
    relaxation = relax(problem, problem.matrix(result.values))
    assert relaxation.tight
    values = rounded(problem, relaxation.point, result.values)
    assert problem.cost(problem.matrix(values)) == pytest.approx(relaxation.cost, rel=1e-9)
    as_stored([values, relaxation.cost, relaxation.rank])


def test_a_relaxation_certifies_ranges_whose_own_bound_is_loose(opened, as_stored):
    result = solve_graph(
        opened(FILES["cooperative.pyfg"](), "g.pyfg"), start="chordal", truth=False
    )
    certificate = certify(result.graph, result.values)
    assert certificate.least_eigenvalue < -0.5
    assert certificate.certified
    assert certificate.lower_bound == pytest.approx(certificate.cost, rel=1e-3)
    as_stored(certificate)
