"""Somebody else's graph, from file to estimate."""

import json
from dataclasses import replace

import numpy as np
import pytest
from factories import values_at, without
from refusals import refused

from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    FactorGraph,
    GraphSolver,
    GraphValues,
    SolveOptions,
    build_graph,
    open_graph,
    solve_graph,
    write_pyfg,
)
from pymantaray.estimation.g2o import LEFT_OUT, write_g2o
from pymantaray.estimation.pyfg import GraphFile
from pymantaray.evaluation import graph_errors
from pymantaray.records import SolveStatus

POOLED = "(all)"


@pytest.fixture
def foreign(tmp_path, make_fleet):
    """A PyFactorGraph file of two vehicles and a landmark, its vertices the truth."""
    fleet = make_fleet(seed=7, n_agents=2, n_times=20, n_landmarks=2)
    truth = values_at(fleet.noise_free, *fleet.start)
    path = tmp_path / "foreign.pyfg"
    write_pyfg(build_graph(fleet.noisy, "straight"), path, initial=truth)
    return path, fleet, truth


def test_both_starts_end_at_the_optimum_of_the_measurements_far_better_than_dead_reckoning(foreign):
    path, fleet, truth = foreign
    from_file, reckoned = (solve_graph(open_graph(path), start=s) for s in ("file", "dead-reckoning"))
    assert from_file.solution.status == SolveStatus.OK
    ours = GraphSolver().solve(build_graph(fleet.noisy, "straight"), truth)
    np.testing.assert_array_equal(from_file.values.position, ours.position)
    np.testing.assert_allclose(reckoned.values.position, ours.position, atol=1e-3)
    errors = {name: graph_errors(reckoned.graph, v, truth) for name, v in reckoned.trajectories.items()}
    assert errors["estimate"][POOLED]["rmse_m"] < errors["start"][POOLED]["rmse_m"] / 2
    assert errors["truth"][POOLED]["max_m"] == 0.0
    assert list(errors["estimate"]) == ["A", "B", POOLED]


def test_results_on_disk_are_those_in_memory(foreign, tmp_path):
    path, *_ = foreign
    result = solve_graph(open_graph(path), start="dead-reckoning")
    out = tmp_path / "out"
    out.mkdir()
    result.save(out, more={"errors": graph_errors(result.graph, result.values, result.truth), "none": np.nan})
    names = sorted(p.name for p in out.iterdir())
    assert names == ["estimate.nc", "graph.nc", "start.nc", "summary.json", "truth.nc"]
    estimate = GraphValues.load(out / "estimate.nc")
    np.testing.assert_array_equal(estimate.position, result.values.position)
    graph = FactorGraph.load(out / "graph.nc")
    np.testing.assert_array_equal(graph["range"].measured, result.graph["range"].measured)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "OK"
    assert summary["final_cost"] == result.solution.final_cost
    pooled = np.linalg.norm(estimate.position - GraphValues.load(out / "truth.nc").position, axis=1)
    assert summary["none"] is None
    assert summary["errors"][POOLED]["rmse_m"] == pytest.approx(np.sqrt((pooled**2).mean()), rel=1e-12)


def test_an_estimator_has_a_name_or_is_a_function(foreign):
    file = open_graph(foreign[0])

    def mine(graph, initial):
        return GraphSolver().solve(graph, initial)

    result = solve_graph(file, estimator=mine)
    assert (result.estimator, result.solution.status) == ("mine", SolveStatus.OK)
    refused(EstimationError, "estimator 'magic'; allowed: batch", solve_graph, file, estimator="magic")
    refused(
        EstimationError,
        "start 'truth'; allowed: file, dead-reckoning, chordal",
        solve_graph,
        file,
        start="truth",
    )


def test_g2o_graph_is_anchored_by_itself_and_has_no_truth_of_its_own(foreign, tmp_path):
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


def test_graphs_that_cannot_be_solved_say_why_in_one_line(foreign):
    graph, values = open_graph(foreign[0])[:2]
    edge = graph["edge"]
    loose = without(graph, "range").with_factors(edge=edge[1:])
    refused(EstimationError, r"^A1: no first-pose prior", solve_graph, GraphFile(loose, values, {}))
    stiff = graph.with_factors(
        edge=edge[:1].joined(replace(edge[1:], covariance=edge.covariance[1:] * 1e-20))
    )
    line = r"^[AB]\d+: odometry variance .* of the median, .*: badly conditioned"
    refused(EstimationError, line, solve_graph, GraphFile(stiff, values, {}))

    def hasty(graph, initial):
        return GraphSolver(SolveOptions(max_iterations=1)).solve(graph, initial)

    result = solve_graph(GraphFile(graph, values, {}), estimator=hasty)
    assert not result.solution.usable
    assert np.isnan(result.values.position).all()
    assert "\n" not in result.diagnosis
    assert result.summary()["usable"] is False
    assert list(result.trajectories) == ["start", "truth"]


def test_fewer_measurements_than_unknowns_is_said_before_the_solver_is_asked(foreign):
    graph, values = open_graph(foreign[0])[:2]
    unit = np.tile(np.eye(3), (graph.n_poses, 1, 1))
    fixes = graph["fix"].kind.table(np.arange(graph.n_poses), [values.position], unit)
    bare = without(graph, "range", "edge").with_factors(fix=fixes)
    assert bare.degrees_of_freedom < 0
    with pytest.raises(EstimationError, match=r"^A1: .*do not determine its rotation: nothing measures it"):
        solve_graph(GraphFile(bare, values, {}))
