"""Somebody else's graph, from file to estimate."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pymantaray.errors import EstimationError, StudyError
from pymantaray.estimation import FactorGraph, GraphSolver, GraphValues, build_graph, write_pyfg
from pymantaray.estimation.g2o import LEFT_OUT, write_g2o
from pymantaray.estimation.pyfg import GraphFile
from pymantaray.records import SolveStatus
from pymantaray.study import external
from pymantaray.study.external import POOLED, open_graph, solve_graph

AXES = 3


@pytest.fixture
def foreign(tmp_path, make_fleet):
    """A PyFactorGraph file of two vehicles and a landmark, its vertices the truth."""
    fleet = make_fleet(seed=7, n_agents=2, n_times=20, n_landmarks=2)
    truth = GraphValues(
        position=fleet.position.reshape(-1, 3),
        quaternion=fleet.quaternion.reshape(-1, 4),
        landmark_position=fleet.noise_free.landmark_position,
    )
    path = tmp_path / "foreign.pyfg"
    write_pyfg(build_graph(fleet.noisy, "straight"), path, initial=truth)
    return path, fleet, truth


def test_estimate_from_a_file_is_the_estimate_from_the_measurements(foreign):
    path, fleet, truth = foreign
    result = solve_graph(open_graph(path))
    assert result.solution.status == SolveStatus.OK
    ours = GraphSolver().solve(build_graph(fleet.noisy, "straight"), truth)
    np.testing.assert_array_equal(result.values.position, ours.position)


def test_both_starts_end_at_the_same_optimum_far_better_than_dead_reckoning(foreign):
    path, *_ = foreign
    truth_start, reckoned = (solve_graph(open_graph(path), start=s) for s in ("file", "dead-reckoning"))
    np.testing.assert_allclose(reckoned.values.position, truth_start.values.position, atol=1e-3)
    before, after = (
        reckoned.trajectory_errors(v)[POOLED]["rmse_m"] for v in (reckoned.initial, reckoned.values)
    )
    assert after < before / 2, (before, after)
    assert truth_start.trajectory_errors(truth_start.initial)[POOLED]["max_m"] == 0.0
    assert list(reckoned.trajectory_errors(reckoned.values)) == ["A", "B", POOLED]


def test_results_on_disk_are_those_in_memory(foreign, tmp_path):
    path, *_ = foreign
    result = solve_graph(open_graph(path), start="dead-reckoning")
    out = tmp_path / "out"
    out.mkdir()
    result.save(out)
    names = sorted(p.name for p in out.iterdir())
    assert names == ["estimate.nc", "graph.nc", "start.nc", "summary.json", "truth.nc"]
    estimate = GraphValues.load(out / "estimate.nc")
    np.testing.assert_array_equal(estimate.position, result.values.position)
    graph = FactorGraph.load(out / "graph.nc")
    np.testing.assert_array_equal(graph.range_distance, result.graph.range_distance)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] == "OK"
    assert summary["final_cost"] == result.solution.final_cost
    pooled = np.linalg.norm(estimate.position - GraphValues.load(out / "truth.nc").position, axis=1)
    assert summary["trajectory_error"][POOLED]["rmse_m"] == pytest.approx(
        np.sqrt((pooled**2).mean()), rel=1e-12
    )


def test_estimators_join_by_name(foreign, monkeypatch):
    path, *_ = foreign
    asked = []

    def spy(graph, initial):
        asked.append(graph)
        return external.ESTIMATORS["batch"](graph, initial)

    monkeypatch.setitem(external.ESTIMATORS, "spy", spy)
    assert solve_graph(open_graph(path), estimator="spy").estimator == "spy"
    assert len(asked) == 1
    with pytest.raises(StudyError, match="estimator 'magic'; allowed: batch"):
        solve_graph(open_graph(path), estimator="magic")
    with pytest.raises(StudyError, match="start 'truth'; allowed: file, dead-reckoning"):
        solve_graph(open_graph(path), start="truth")


def test_robust_losses_keep_out_a_late_range_and_least_squares_does_not(foreign):
    path, *_ = foreign
    file = open_graph(path)
    late = file.graph.range_distance.copy()
    late[0] += 300.0
    spoilt = file._replace(graph=replace(file.graph, range_distance=late))
    clean = solve_graph(file)
    moved = {}
    for name in external.ESTIMATORS:
        result = solve_graph(spoilt, estimator=name, start="dead-reckoning")
        assert result.solution.usable, (name, result.diagnosis)
        moved[name] = np.abs(result.values.position - clean.values.position).max()
    assert moved["incremental"] == pytest.approx(moved["batch"], abs=0.01)
    for name in ("cauchy", "geman-mcclure", "gnc"):
        assert moved[name] < 0.1 * moved["batch"], moved
    assert moved["huber"] < 0.5 * moved["batch"], moved


def test_g2o_graph_needs_an_anchor_and_has_no_truth_of_its_own(foreign, tmp_path):
    path, *_ = foreign
    file = open_graph(path)
    write_g2o(file.graph, tmp_path / "g.g2o", initial=file.values, leave_out=LEFT_OUT, symbols=True)
    floating = open_graph(tmp_path / "g.g2o")
    with pytest.raises(EstimationError, match=r"^A0: no first-pose prior"):
        solve_graph(floating)
    result = solve_graph(floating, anchor=True, truth=False)
    assert [result.graph.variable_name(int(p)) for p in result.anchored] == ["A0", "B0"]
    assert result.solution.usable
    assert result.trajectory_errors(result.values) == {}
    # nothing but odometry is left: the optimum is dead reckoning
    reckoned = solve_graph(floating, anchor=True, start="dead-reckoning", truth=False)
    np.testing.assert_allclose(reckoned.values.position, reckoned.initial.position, atol=1e-6)
    assert reckoned.solution.final_cost < 1e-9


def without_ranges(graph):
    return replace(graph, range_first=[], range_second=[], range_distance=[], range_variance=[])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda g: replace(g, edge_covariance=g.edge_covariance * 1e-20), None),
        (
            lambda g: replace(without_ranges(g), edge_from=g.edge_from[1:], edge_to=g.edge_to[1:],
                              edge_quaternion=g.edge_quaternion[1:], edge_translation=g.edge_translation[1:],
                              edge_covariance=g.edge_covariance[1:]),
            "^A1: no first-pose prior",
        ),
    ],
)  # fmt: skip
def test_graphs_that_cannot_be_solved_say_why_in_one_line(foreign, change, message):
    file = open_graph(foreign[0])
    file = GraphFile(change(file.graph), file.values, {})
    if message is not None:
        with pytest.raises(EstimationError, match=message):
            solve_graph(file)
        return
    result = solve_graph(file)
    assert not result.solution.usable
    assert np.isnan(result.values.position).all()
    assert "\n" not in result.diagnosis
    assert result.summary()["usable"] is False
    assert result.summary()["trajectory_error"][POOLED]["rmse_m"] is None


def test_fewer_measurements_than_unknowns_is_said_before_the_solver_is_asked(foreign):
    graph, values, _ = open_graph(foreign[0])
    bare = replace(
        without_ranges(graph),
        edge_from=[], edge_to=[], edge_quaternion=np.empty((0, 4)), edge_translation=np.empty((0, 3)),
        edge_covariance=np.empty((0, 6, 6)), fix_pose=np.arange(graph.n_poses),
        fix_position=values.position, fix_covariance=np.tile(np.eye(AXES), (graph.n_poses, 1, 1)),
    )  # fmt: skip
    assert bare.degrees_of_freedom < 0
    with pytest.raises(EstimationError, match=r"^A1: .*do not determine its rotation: nothing measures it"):
        solve_graph(GraphFile(bare, values, {}))
