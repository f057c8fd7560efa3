"""Somebody else's graph, from file to estimate."""

import json
from dataclasses import replace

import numpy as np
import pytest
from factories import values_at, without
from refusals import refused

from pymantaray.apps.graphs import open_graph, solve_graph
from pymantaray.apps.graphs.diagnose import diagnose
from pymantaray.apps.graphs.g2o import LEFT_OUT, write_g2o
from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    FactorGraph,
    GraphSolver,
    GraphValues,
    SolveOptions,
    build_graph,
    write_pyfg,
)
from pymantaray.estimation.graph.graph import KINDS
from pymantaray.estimation.graph.pyfg import GraphFile
from pymantaray.estimation.solvers.problems import FactorsExceptRanges, GraphState
from pymantaray.evaluation import graph_errors
from pymantaray.records import SolveStatus

POOLED = "(all)"


@pytest.fixture
def foreign(tmp_path, make_fleet):
    """A PyFactorGraph file of two vehicles and a landmark, its vertices the truth."""
    fleet = make_fleet(seed=7, n_vehicles=2, n_times=20, n_landmarks=2)
    truth = values_at(fleet.noise_free, *fleet.start)
    path = tmp_path / "foreign.pyfg"
    write_pyfg(build_graph(fleet.noisy, "straight"), path, initial=truth)
    return path, fleet, truth


def test_both_starts_end_at_the_optimum_far_below_dead_reckoning(foreign, as_stored):
    path, fleet, truth = foreign
    from_file, reckoned = (
        solve_graph(open_graph(path), start=s) for s in ("file", "dead-reckoning")
    )
    assert from_file.solution.status == SolveStatus.OK
    ours = GraphSolver().solve(build_graph(fleet.noisy, "straight"), truth)
    np.testing.assert_allclose(
        from_file.values.position, ours.position, rtol=0, atol=2e-7
    )  # depths
    np.testing.assert_allclose(reckoned.values.position, ours.position, atol=1e-3)
    errors = {
        name: graph_errors(reckoned.graph, v, truth) for name, v in reckoned.trajectories.items()
    }
    assert errors["estimate"][POOLED]["rmse_m"] < errors["start"][POOLED]["rmse_m"] / 2
    assert errors["truth"][POOLED]["max_m"] == 0.0
    assert list(errors["estimate"]) == ["A", "B", POOLED]
    as_stored(errors)
    as_stored([from_file.summary(), from_file.values], name="result", without="gradient")


def test_results_on_disk_are_those_in_memory(foreign, tmp_path):
    path, *_ = foreign
    steps = []
    result = solve_graph(
        open_graph(path), start="dead-reckoning", report=lambda *step: steps.append(step)
    )
    assert steps[-1][1] == pytest.approx(result.solution.final_cost)
    out = tmp_path / "out"
    out.mkdir()
    result.save(
        out,
        more={"errors": graph_errors(result.graph, result.values, result.truth), "none": np.nan},
    )
    names = sorted(p.name for p in out.iterdir())
    assert names == ["estimate.nc", "graph.nc", "start.nc", "summary.json", "truth.nc"]
    estimate = GraphValues.load(out / "estimate.nc")
    np.testing.assert_array_equal(estimate.position, result.values.position)
    graph = FactorGraph.load(out / "graph.nc")
    np.testing.assert_array_equal(graph["range"].measurement, result.graph["range"].measurement)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "OK"
    assert summary["final_cost"] == result.solution.final_cost
    pooled = np.linalg.norm(estimate.position - GraphValues.load(out / "truth.nc").position, axis=1)
    assert summary["none"] is None
    assert summary["errors"][POOLED]["rmse_m"] == pytest.approx(
        np.sqrt((pooled**2).mean()), rel=1e-12
    )


def test_an_estimator_has_a_name_or_is_a_function(foreign):
    file = open_graph(foreign[0])

    def mine(graph, initial):
        return GraphSolver().solve(graph, initial)

    result = solve_graph(file, estimator=mine)
    assert (result.estimator, result.solution.status) == ("mine", SolveStatus.OK)
    refused(
        EstimationError, "estimator 'magic'; allowed: batch", solve_graph, file, estimator="magic"
    )
    refused(
        EstimationError,
        "start 'truth'; allowed: file, dead-reckoning, chordal, best",
        solve_graph,
        file,
        start="truth",
    )


def test_a_solver_that_gives_up_says_why_in_one_line(foreign):
    def lost(*_):
        raise RuntimeError("no memory\nat all")

    message = "^the solver gave up: no memory$"
    refused(EstimationError, message, solve_graph, open_graph(foreign[0]), estimator=lost)


def test_g2o_graph_is_anchored_by_itself_and_has_no_truth_of_its_own(foreign, tmp_path, as_stored):
    path, *_ = foreign
    file = open_graph(path)
    write_g2o(file.graph, tmp_path / "g.g2o", initial=file.values, leave_out=LEFT_OUT, symbols=True)
    floating = open_graph(tmp_path / "g.g2o")
    result = solve_graph(floating, truth=False)
    assert [result.graph.variable_name(int(p)) for p in result.anchored] == ["A0", "B0"]
    assert result.solution.usable
    assert result.truth is None
    assert graph_errors(result.graph, result.values, result.truth) == {}
    # nothing but odometry is left: the optimum is dead reckoning
    reckoned = solve_graph(floating, start="dead-reckoning", truth=False)
    np.testing.assert_allclose(reckoned.values.position, reckoned.initial.position, atol=1e-6)
    assert reckoned.solution.final_cost < 1e-9
    as_stored(result.summary(), without="gradient")
    as_stored(tmp_path / "g.g2o", name="file")


def test_graphs_that_cannot_be_solved_say_why_in_one_line(foreign, as_stored):
    graph, values = open_graph(foreign[0])[:2]
    edge = graph["edge"]
    loose = without(graph, "range").with_factors(edge=edge[1:])
    refused(EstimationError, r"^A1: no first-pose prior", solve_graph, GraphFile(loose, values, {}))
    stiff = graph.with_factors(
        edge=edge[:1].append(replace(edge[1:], covariance=edge.covariance[1:] * 1e-20))
    )
    line = r"^[AB]\d+: odometry variance .* of the median, .*: badly conditioned"
    refused(EstimationError, line, solve_graph, GraphFile(stiff, values, {}))

    def hasty(graph, initial):
        return GraphSolver(SolveOptions(max_iterations=1)).solve(graph, initial)

    result = solve_graph(GraphFile(graph, values, {}), estimator=hasty)
    assert not result.solution.usable
    assert np.isnan(result.solution.position).all()
    assert np.isfinite(result.values.position).all()
    assert "\n" not in result.diagnosis
    assert result.summary()["usable"] is False
    assert list(result.trajectories) == ["start", "last", "truth"]
    as_stored(result.summary())


def test_too_few_measurements_are_refused_before_the_solve(foreign):
    graph, values = open_graph(foreign[0])[:2]
    unit = np.tile(np.eye(3), (graph.n_poses, 1, 1))
    fixes = graph["fix"].kind.table(np.arange(graph.n_poses), [values.position], unit)
    bare = without(graph, "range", "edge").with_factors(fix=fixes)
    assert bare.degrees_of_freedom < 0
    with pytest.raises(
        EstimationError, match=r"^A1: .*do not determine its rotation: nothing measures it"
    ):
        solve_graph(GraphFile(bare, values, {}))


def bare_graph(place, landmarks=(), **factors):
    """Graph of one level vehicle at some places, and its values."""
    n = len(place)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    graph = FactorGraph(
        vehicle_name=np.array(["A"]),
        landmark_name=np.array([f"L{k}" for k in range(len(landmarks))], dtype=str),
        pose_vehicle=np.zeros(n, dtype=int),
        pose_number=np.arange(n),
        pose_time=np.arange(n, dtype=float),
        factors={name: KINDS[name].table(*table) for name, table in factors.items()},
    )
    return graph, GraphValues(place, level, np.reshape(landmarks, (-1, 3)))


def test_a_long_chain_is_determined_despite_a_weak_direction(as_stored):
    """
    The least eigenvalue of a chain falls with the fourth power of its length: here below rounding
    of the largest.
    """
    n = 100_000
    place, level, unit = (
        np.zeros((n, 3)),
        np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        np.tile(np.diag([0.01] * 3 + [1.0] * 3), (n, 1, 1)),
    )
    place[:, 0] = np.arange(n)
    ends = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    graph, values = bare_graph(
        place,
        prior=([0], [place[:1], level[:1]], unit[:1]),
        edge=(ends, [np.diff(place, axis=0), level[1:]], unit[1:]),
    )
    assert diagnose(graph, values) is None
    bent = replace(values, position=place + np.random.default_rng(1).normal(0, 10.0, place.shape))

    def hasty(graph, _):
        return GraphSolver(SolveOptions(max_iterations=1)).solve(graph, bent)

    result = solve_graph(GraphFile(graph, values, {}), estimator=hasty)
    assert not result.solution.usable
    assert "add a prior" not in result.diagnosis
    assert "try another start" in result.diagnosis
    as_stored(result.diagnosis)


@pytest.mark.parametrize("height", [0.0, 5.0])
def test_an_aligned_start_differs_from_an_undetermined_graph(height):
    """
    Of a landmark in one plane with all poses nothing says on which side it is; above the plane it
    is determined.
    """
    place, mark = (
        np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [20.0, 30.0, 0.0]]),
        np.array([10.0, 10.0, 10.0]),
    )
    level, tight = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)), np.tile(1e-4 * np.eye(6), (3, 1, 1))
    graph, values = bare_graph(
        place,
        [[12.0, 11.0, height]],
        prior=(np.arange(3), [place, level], tight),
        range=(
            [[k, 3] for k in range(3)],
            [np.linalg.norm(mark - place, axis=1)],
            np.ones((3, 1, 1)),
        ),
    )
    assert diagnose(graph, values) is None
    result = solve_graph(GraphFile(graph, values, {}), start="file")
    if height:
        np.testing.assert_allclose(result.values.landmark_position, [mark], atol=1e-6)
    else:
        assert result.solution.status == SolveStatus.FAILED
        assert result.diagnosis.startswith(
            "L0: its position is not determined at the start, but near it"
        )


@pytest.mark.parametrize("start", ["dead-reckoning", "chordal"])
def test_landmarks_with_ranges_only_start_at_the_file_and_are_counted(foreign, start, as_stored):
    """
    The file's values are the truth here: such a start knows where the landmarks are, and says so.
    """
    graph, truth = open_graph(foreign[0])[:2]
    graph = graph.with_factors(survey=graph["survey"][:1])  # L1 has ranges alone
    result = solve_graph(GraphFile(graph, truth, {}), start=start)
    assert [graph.variable_name(v) for v in result.as_in_file] == ["L1"]
    assert result.summary()["started_as_in_the_file"] == {"poses": 0, "landmarks": 1}
    np.testing.assert_array_equal(result.initial.landmark_position[1], truth.landmark_position[1])
    assert np.abs(result.initial.landmark_position[0] - truth.landmark_position[0]).max() > 1e-3
    as_stored(result.initial)


def coincident(scale=1.0):
    """
    One pose and one landmark whose vertices are at one place, and a range of 50 m; covariances
    times ``scale``.
    """
    pose = " ".join(f"{v:.17g}" for v in (scale * 0.01 * np.eye(6))[np.triu_indices(6)])
    landmark = " ".join(f"{v:.17g}" for v in (scale * 100.0 * np.eye(3))[np.triu_indices(3)])
    return (
        "VERTEX_SE3:QUAT 0 A0 1 2 3 0 0 0 1\nVERTEX_XYZ L0 1 2 3\n"
        f"VERTEX_SE3:QUAT:PRIOR 0 A0 1 2 3 0 0 0 1 {pose}\n"
        f"VERTEX_XYZ:PRIOR 0 L0 1 2 3 {landmark}\n"
        f"EDGE_RANGE 0 A0 L0 50 {scale:.17g}\n"
    )


@pytest.mark.parametrize("estimator", ["batch", "gtsam", "cauchy", "incremental"])
def test_a_range_between_ends_at_one_place_leaves_it(tmp_path, estimator):
    (tmp_path / "g.pyfg").write_text(coincident())
    result = solve_graph(open_graph(tmp_path / "g.pyfg"), start="file", estimator=estimator)
    length = np.linalg.norm(result.values.landmark_position[0] - result.values.position[0])
    assert length > 1.0
    if estimator != "cauchy":  # along the line, in closed form
        variance = 100.0 + 0.01
        assert length == pytest.approx(50.0 * variance / (1.0 + variance), rel=1e-6)
        assert result.solution.final_cost == pytest.approx(0.5 * 2500.0 / (1.0 + variance))


def test_the_worst_of_equal_factors_is_the_first(tmp_path):
    """A pose prior and a landmark prior without any error; the messages of failures name it."""
    (tmp_path / "g.pyfg").write_text(coincident(1e-12))
    content = open_graph(tmp_path / "g.pyfg")
    factors = FactorsExceptRanges(content.graph)
    assert factors.worst(GraphState.of(content.values)) == ([0], 0.0)
    solution = solve_graph(content, start="file").solution
    assert isinstance(solution.status, SolveStatus)
