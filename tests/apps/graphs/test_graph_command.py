"""The commands `mantaray graph`: what they print and write, and what they refuse in one line."""

import json
import re
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from two_minima import ring

from pymantaray.estimation import GraphSolver, read_pyfg
from pymantaray.estimation.solve import METHODS
from pymantaray.estimation.solvers.solution import SolveOptions

NOISE = "0.01 0 0 0 0 0 0.01 0 0 0 0 0.01 0 0 0 1e-4 0 0 1e-4 0 1e-4"
TEXT = f"""\
VERTEX_SE3:QUAT 0 A0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 A1 10 0 0 0 0 0 1
VERTEX_SE3:QUAT 2 A2 20 0 0 0 0 0 1
VERTEX_SE3:QUAT 0 B0 0 9 0 0 0 0 1
VERTEX_SE3:QUAT 1 B1 10 9 0 0 0 0 1
VERTEX_XYZ L2 5 6 7
VERTEX_SE3:QUAT:PRIOR 0 A0 0 0 0 0 0 0 1 {NOISE}
VERTEX_XYZ:PRIOR 0 L2 5 6 7 0.5 0 0 0.5 0 0.5
EDGE_SE3:QUAT 1 A0 A1 10.1 0 0 0 0 0 1 {NOISE}
EDGE_SE3:QUAT 2 A1 A2 10.1 0 0 0 0 0 1 {NOISE}
EDGE_SE3:QUAT 1 B0 B1 9.9 0.1 0 0 0 0 1 {NOISE}
EDGE_SE3:QUAT 2 A0 A2 20 0 0 0 0 0 1 {NOISE}
EDGE_SE3:QUAT 1 A1 B1 0 9 0 0 0 0 1 {NOISE}
EDGE_RANGE 1 A1 B1 9.05 0.01
EDGE_RANGE 1 A2 L2 17.7 0.01
EDGE_SE3_XYZ 1 A1 L2 -5 6 7 0.1 0 0 0.1 0 0.1
"""


@pytest.fixture
def graph(mantaray):
    """A command that has to succeed."""

    def run(*arguments):
        done = mantaray("graph", *arguments)
        assert done.code == 0, done.err
        return done

    return run


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "g.pyfg"
    path.write_text("".join(line + "\n" for line in TEXT.splitlines() if "SE3_XYZ" not in line))
    return path


def test_show_counts_what_is_there(graph, told, file, as_stored):
    out = graph("show", file).out.replace("loop closures", "loops")
    expected = {
        "vehicles": "A (3 poses), B (2 poses)",
        "landmarks": "L2",
        "odometry": "3",
        "loops": "1 of one vehicle, 1 between two",
        "ranges": "1 between poses, 1 to landmarks, 0 between landmarks",
        "priors": "pose priors 1, landmark priors 1",
        "determined": "yes",
    }
    assert dict(line.split(maxsplit=1) for line in out.splitlines()).items() >= expected.items()
    counts = told("graph", "show", file)
    assert counts["vehicles"] == [{"name": "A", "poses": 3}, {"name": "B", "poses": 2}]
    expected = {
        "landmarks": ["L2"],
        "odometry": 3,
        "loop_closures": 2,
        "ranges": 2,
        "determined": True,
    }
    assert counts.items() >= expected.items()
    as_stored(out, name="text")


def test_a_graph_in_the_plane_is_shown_with_two_dimensions(graph, told, tmp_path):
    path = tmp_path / "flat.g2o"
    vertices = [f"VERTEX_SE2 {k} {10 * k} 0 0" for k in range(3)]
    edges = [f"EDGE_SE2 {k} {k + 1} 10 0 0 4 0 0 4 0 100" for k in range(2)]
    path.write_text("\n".join([*vertices, *edges, ""]))
    assert graph("show", path).out.splitlines()[0].split() == ["dimensions", "two"]
    assert told("graph", "show", path)["dimensions"] == 2
    path.write_text("\n".join([*edges, ""]))
    lines = graph("show", path).out.splitlines()
    assert "values             none in the file; by chordal initialization" in lines


@pytest.mark.parametrize(("how", "name", "expected"), [
    ("repair", "repaired", {"EDGE_SE2": 1}),
    ("drop", "left_out", {"EDGE_SE2 (indefinite matrix)": 1}),
])  # fmt: skip
def test_indefinite_matrices_are_told(mantaray, tmp_path, how, name, expected):
    path = tmp_path / "g.g2o"
    edges = [f"EDGE_SE2 0 1 {step} 0 0 {m}" for step, m in ((1, "4 0 0 4 0 4"), (3, "0 0 0 1 0 1"))]
    path.write_text("\n".join(["VERTEX_SE2 0 0 0 0", "VERTEX_SE2 1 1 0 0", *edges, ""]))
    for command in ("show", "solve"):
        done = mantaray("graph", command, path, "--indefinite", how, "--json")
        assert json.loads(done.out)[name] == expected


@pytest.mark.parametrize("start", ["file", "dead-reckoning"])
def test_solve_writes_trajectories_and_a_summary(
    mantaray, told, graph, file, tmp_path, start, as_stored
):
    out = tmp_path / "out"
    done = graph("solve", file, "--out", out, "--start", start)
    assert done.out.splitlines()[-1] == str(out)
    assert "RMSE" in done.out
    assert sorted(p.name for p in out.iterdir()) == [
        "estimate-A.tum", "estimate-B.tum", "estimate.nc", "graph.nc", "start-A.tum", "start-B.tum",
        "start.nc",
        "summary.json", "truth-A.tum", "truth-B.tum", "truth.nc",
    ]  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    estimate, truth = (np.loadtxt(out / f"{name}-A.tum") for name in ("estimate", "truth"))
    error = np.linalg.norm(estimate[:, 1:4] - truth[:, 1:4], axis=1)
    assert summary["trajectory_error"]["A"]["max_m"] == pytest.approx(error.max(), rel=1e-12)
    result = told("graph", "solve", file, "--start", start)
    assert result["trajectory_error"][0]["max_m"] == pytest.approx(error.max(), rel=1e-12)
    assert (result["status"], result["start"], "folder" in result) == ("OK", start, False)
    assert result["cost"] == result["final_cost"] == summary["cost"]
    for row in result["trajectory_error"]:  # from 1 to three degrees of freedom a pose
        assert 1.0 < 0.5 * (row["rmse_m"] / row["rmse_standard_error_m"]) ** 2 < 3.0 * row["n"]
        assert (
            summary["trajectory_error"][row["vehicle"]]["rmse_standard_error_m"]
            == row["rmse_standard_error_m"]
        )
    robust = told("graph", "solve", file, "--start", start, "--estimator", "huber")
    assert "rmse_standard_error_m" not in robust["trajectory_error"][0]
    refused = mantaray("graph", "solve", file, "--out", out)
    assert refused.code == 2
    assert refused.err == f"error: {out}: folder is not empty; give a new or empty folder\n"
    if start == "dead-reckoning":
        as_stored(out, without="/(truth|graph)")
        as_stored(done.out, name="text")


READING = (
    *("--leave-out", "EDGE_SE3_XYZ", "--leave-out", "FIX", "--skip-unknown", "--isam"),
    *("--half-angles", "--indefinite", "repair", "--covariances", "isotropic"),
)


@pytest.mark.parametrize("words", [
    ("show", "g.pyfg"),
    ("solve", "g.pyfg"),
    ("convert", "g.pyfg", "new.pyfg", "--leave-out", "ranges", "--leave-out", "all"),
], ids=["show", "solve", "convert"])  # fmt: skip
def test_every_option_reaches_the_reader_of_a_graph(reached, file, words, monkeypatch):
    monkeypatch.chdir(file.parent)
    opened = "pymantaray.apps.graphs.open_graph"
    given = reached(opened, "graph", *words, *READING)
    assert given[0] == Path("g.pyfg")
    if words[0] == "show":
        reached("pymantaray.apps.graphs.command.printer", "graph", *words, "--json")


@pytest.fixture
def shown_steps(monkeypatch):
    """Progress of a solve as in a terminal."""
    monkeypatch.setattr(
        "pymantaray.cli.output.step_line", lambda *, quiet: nullcontext(None if quiet else print)
    )


SOLVING = (
    *("--start", "best", "--random-starts", 3, "--seed", 7, "--estimator", "huber", "--anchor"),
    *("--no-truth", "--no-certify"),
)


def test_every_option_reaches_the_solve_of_a_graph(reached, file, tmp_path, shown_steps):
    solved = "pymantaray.apps.graphs.solve_graph"
    reached(solved, "graph", "solve", file, *SOLVING, without="^0")
    words = ("graph", "solve", file, "--start", "file", "--worst", 2, "--estimator", "huber")
    out = tmp_path / "out"
    saved = "pymantaray.apps.graphs.external.GraphResult.save"
    given = reached(saved, *words, "--out", out, without=r"^[01]|B\.|all")
    assert given[1].parent == tmp_path
    assert given[1] != out  # until it is whole
    reached("pymantaray.estimation.solvers.influence.factor_influence", *words, without="^0")
    reached("pymantaray.estimation.solvers.influence.worst_factors", *words, without="^0")
    reached("pymantaray.cli.options.printer", *words, "--json", "--quiet", "--to", "latex")


@pytest.mark.parametrize("words", [
    (), ("--quiet", "--truth", "--certify"), ("--no-truth", "--no-certify"),
], ids=["default", "yes", "no"])  # fmt: skip
def test_every_flag_reaches_the_solve_of_a_graph(reached, file, shown_steps, words):
    certified = "pymantaray.apps.graphs.external.with_certificate"
    reached(certified, "graph", "solve", file, *words, without="^0")
    solved = "pymantaray.apps.graphs.solve_graph"
    reached(solved, "graph", "solve", file, *words, without="^0")


@pytest.mark.parametrize(("words", "known"), [((), False), (("--truth",), True)])
def test_vertices_of_a_pose_graph_are_no_truth(reached, tmp_path, words, known):
    path = tmp_path / "ring.g2o"
    path.write_text(ring(6, 1, 9, 0.9, 20.0))
    solved = "pymantaray.apps.graphs.solve_graph"
    assert reached(solved, "graph", "solve", path, *words, without="^0")["truth"] is known


@pytest.mark.parametrize("words", [
    ("g.g2o", "--leave-out", "all", "--symbols"),
    ("g.g2o", "--leave-out", "ranges", "--leave-out", "EDGE_SE3:QUAT", "--half-angles"),
    ("g.pyfg",),
    ("g.tum",),
], ids=["all", "ranges", "pyfg", "tum"])  # fmt: skip
def test_every_option_reaches_the_writer_of_a_graph(reached, file, tmp_path, words):
    name = {
        ".g2o": "pymantaray.apps.graphs.g2o.write_g2o",
        ".pyfg": "pymantaray.estimation.write_pyfg",
        ".tum": "pymantaray.exchange.write_graph_tum",
    }[Path(words[0]).suffix]
    out = tmp_path / "new" / words[0]
    out.parent.mkdir()
    out.write_text("7\n")
    words = (*words[1:], "--force")
    given = reached(name, "graph", "convert", file, out, *words, without=r"^0|^1\.factors")
    assert out in given.values()


def test_converted_files_are_replaced_by_force(graph, file, tmp_path):
    for name, more in (("a.g2o", ()), ("a.pyfg", ()), ("a.tum", ("a-A.tum", "a-B.tum"))):
        out = tmp_path / name
        for _ in range(2):
            done = graph("convert", file, out, "--leave-out", "all", "--force").out
        assert done.splitlines() == [str(tmp_path / word) for word in more or (name,)]


def test_a_graph_is_not_converted_onto_itself(mantaray, file):
    done = mantaray("graph", "convert", file, file, "--force")
    assert done.err == f"error: {file}: is the input; give another name\n"
    own = file.rename(file.with_name("g-A.tum"))  # which has the name of an output
    done = mantaray("graph", "convert", own, own.with_name("g.tum"), "--force")
    assert done.err == f"error: {own}: is the input; give another name\n"


def test_incremental_least_squares_have_standard_errors(graph, file):
    words = ("--estimator", "incremental", "--start", "file", "--json")
    rows = json.loads(graph("solve", file, *words).out)["trajectory_error"]
    assert all(row["rmse_standard_error_m"] > 0.0 for row in rows)


def test_without_a_folder_nothing_is_written(graph, file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    graph("solve", file, "--no-truth")
    assert [p.name for p in tmp_path.iterdir()] == ["g.pyfg"]


def test_unknown_lines_are_named_with_a_count_and_skipped_by_choice(
    mantaray, graph, tmp_path, as_stored
):
    (tmp_path / "s.pyfg").write_text(TEXT + "FIX 0\nFIX 1\n")
    refused = mantaray("graph", "show", tmp_path / "s.pyfg")
    assert (refused.code, len(refused.err.splitlines())) == (2, 1)
    assert "unknown lines: 2 of 'FIX' (line 17)" in refused.err
    for command in ("show", "solve"):
        done = graph(
            command, tmp_path / "s.pyfg", "--skip-unknown", "--leave-out", "EDGE_SE3_XYZ"
        ).err
        assert [line.split()[-2:] for line in done.splitlines() if line.startswith("left out")] == [
            ["1", "EDGE_SE3_XYZ"],
            ["2", "FIX"],
        ]
    done = graph(
        "convert", tmp_path / "s.pyfg", tmp_path / "s.g2o", "--skip-unknown", "--leave-out", "all"
    )
    assert "left out: 2 FIX" in done.err
    assert "EDGE_SE3_TRACKXYZ 1 5 0 -5 6 7 10 0 0 10 0 10\n" in (tmp_path / "s.g2o").read_text()
    as_stored(tmp_path / "s.g2o")


def test_ranges_are_not_left_out_of_a_solve_in_silence(mantaray, file):
    refused = mantaray("graph", "solve", file, "--leave-out", "ranges")
    message = (
        f"error: {file}: no line begins with 'ranges'; allowed: words of the file to leave out\n"
    )
    assert (refused.code, refused.err) == (2, message)


def test_a_folder_that_is_taken_is_refused_before_the_solve(mantaray, file, tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").touch()
    monkeypatch.setattr(GraphSolver, "solve", lambda *_, **__: pytest.fail("solved for nothing"))
    assert mantaray("graph", "solve", file, "--out", tmp_path / "out").code == 2


@pytest.mark.parametrize("estimator", METHODS)
def test_estimators_are_chosen_by_name(graph, file, estimator, as_stored):
    done = graph("solve", file, "--estimator", estimator, "--start", "dead-reckoning")
    assert done.out.startswith(f"{estimator}, start dead-reckoning: OK")
    assert "nan" not in done.out
    as_stored(done.out)


def test_convert_there_and_back(mantaray, graph, file, tmp_path, as_stored):
    refused = mantaray("graph", "convert", file, tmp_path / "g.g2o")
    assert (refused.code, len(refused.err.splitlines())) == (2, 1)
    assert "1 landmark priors, 2 ranges" in refused.err
    done = graph("convert", file, tmp_path / "g.g2o", "--leave-out", "all", "--symbols")
    assert "left out: 2 ranges" in done.err
    graph("convert", tmp_path / "g.g2o", tmp_path / "back.pyfg")
    back, values = read_pyfg(tmp_path / "back.pyfg")
    assert back.vehicle_name.tolist() == ["A", "B"]
    np.testing.assert_array_equal(values.position, read_pyfg(file)[1].position)
    anchored = graph("solve", tmp_path / "g.g2o")
    assert "anchored because there is no prior: A0" in anchored.out
    shown = graph("show", tmp_path / "g.g2o").out
    assert "anchor             none; solve gives a prior to A0" in shown
    assert "degrees of freedom 6 with the anchor" in shown  # of 5 edges, 5 poses and a prior
    assert "determined         yes" in shown
    done = mantaray("graph", "convert", file, tmp_path / "t.tum")
    assert done.out.splitlines() == [str(tmp_path / "t-A.tum"), str(tmp_path / "t-B.tum")]
    again = mantaray("graph", "convert", file, tmp_path / "t.tum")
    assert (
        again.err
        == f"error: {tmp_path / 't-A.tum'}: already exists; give another name or --force\n"
    )
    graph("convert", file, tmp_path / "t.tum", "--force")
    again = mantaray("graph", "convert", file, tmp_path / "g.g2o")
    assert (
        again.err == f"error: {tmp_path / 'g.g2o'}: already exists; give another name or --force\n"
    )
    for name in ("g.g2o", "back.pyfg", "t-A.tum"):
        as_stored(tmp_path / name, name=name)
    as_stored([anchored.out, shown], name="text")


@pytest.mark.parametrize(("old", "new", "said"), [
    (("VERTEX_SE3:QUAT:PRIOR 0 A0 0 0 0 0 0 0 1"
     f" {NOISE}\n"), "", "B0: priors, odometry and ranges do not"),
    ("A0 A1 10.1 0 0 0 0 0 1 0.01", "A0 A1 10.1 0 0 0 0 0 1 0", "A1: odometry variance is"),
    ("VERTEX_SE3:QUAT 0 B0",
     "VERTEX_SE2 0 B0", "line 4: VERTEX_SE2 in a graph in three dimensions"),
], ids=["no prior", "no variance", "two dimensions"])  # fmt: skip
def test_what_cannot_be_solved_is_one_line_with_a_name(mantaray, file, old, new, said):
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    done = mantaray("graph", "solve", file)
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert said in done.err


def test_free_parts_beside_one_with_a_prior_are_anchored_on_request(
    mantaray, graph, file, as_stored
):
    lines = [line for line in file.read_text().splitlines() if "A1 B1" not in line]
    file.write_text("\n".join([*lines, ""]))
    line = mantaray("graph", "solve", file).err
    assert line.startswith(f"error: {file}: B0: no first-pose prior")
    done = graph("solve", file, "--anchor")
    assert "anchored because there is no prior: B0" in done.out
    as_stored(done.out)


def test_a_failed_solve_writes_nothing_and_an_unconverged_one_exits_1(
    mantaray, file, tmp_path, monkeypatch
):
    whole = file.read_text()
    file.write_text(whole.replace(f"VERTEX_SE3:QUAT:PRIOR 0 A0 0 0 0 0 0 0 1 {NOISE}\n", ""))
    out = tmp_path / "out"
    failed = mantaray("graph", "solve", file, "--json", "--out", out)
    assert (failed.code, failed.out, out.exists()) == (2, "", False)
    file.write_text(whole)
    monkeypatch.setattr(
        "pymantaray.apps.graphs.external.SolveOptions", partial(SolveOptions, max_iterations=1)
    )
    done = mantaray("graph", "solve", file, "--json", "--out", out, "--start", "dead-reckoning")
    assert done.code == 1
    result = json.loads(done.out)
    assert (result["status"], result["start"]) == ("NOT_CONVERGED", "dead-reckoning")
    assert done.err.startswith(f"error: {file}: not converged after 1 iterations")
    assert (out / "last.nc").is_file()
    assert not (out / "estimate.nc").exists()


def test_convert_says_where_names_are_and_refuses_an_existing_table(
    mantaray, graph, file, tmp_path
):
    (tmp_path / "g.names.csv").write_text("symbol,name\nA,north-wind\nB,b_2\nL2,buoy\n")
    done = mantaray("graph", "convert", file, tmp_path / "again.pyfg")
    assert done.out.splitlines() == [
        str(tmp_path / "again.pyfg"),
        str(tmp_path / "again.names.csv"),
    ]
    assert read_pyfg(tmp_path / "again.pyfg")[0].vehicle_name.tolist() == ["north-wind", "b_2"]
    (tmp_path / "new.names.csv").write_text("mine")
    refused = mantaray("graph", "convert", file, tmp_path / "new.pyfg")
    assert refused.err.endswith("new.names.csv: already exists; give another name or --force\n")
    graph("solve", file, "--out", tmp_path / "out")
    assert (tmp_path / "out/estimate-north-wind.tum").is_file()


@pytest.mark.parametrize(("scale", "status", "said"), [
    (1e-3, "OVER_CHI_SQUARE", "larger standard deviations"),
    (1e6, "UNDER_CHI_SQUARE", "smaller standard deviations"),
])  # fmt: skip
def test_costs_outside_their_bounds_have_advice(graph, told, file, scale, status, said):
    """
    Many edges, all 1 m too long or short by turns, at variances that are far too small or too
    large.
    """
    edge = (
        "EDGE_SE3:QUAT 1 A0 A1 {} 0 0 0 0 0 1 "
        + " ".join(f"{float(v) * scale:g}" for v in NOISE.split())
        + "\n"
    )
    file.write_text(
        file.read_text() + "".join(edge.format(10 + (-1) ** k * 0.1) for k in range(40))
    )
    lines = graph("solve", file).out.splitlines()
    assert f": {status}, " in lines[0]
    assert lines[1].startswith(f"{status}: converged, but the cost is ")
    assert said in lines[1]
    result = told("graph", "solve", file)
    assert (result["status"], f"{status}: {result['advice']}") == (status, lines[1])


@pytest.fixture
def ranged(file):
    """File of a graph whose landmark has ranges alone, all from one line."""
    text = file.read_text()
    prior = next(line for line in text.splitlines() if "XYZ:PRIOR" in line)
    file.write_text(
        text.replace(prior, "")
        + "".join(
            f"EDGE_RANGE 1 {a} L2 {d} 0.01\n"
            for a, d in (("A0", 10.49), ("A1", 10.49), ("B0", 9.11), ("B1", 9.11))
        )
    )
    return file


AS_IN_FILE = (
    "started at the file's values, because only ranges constrain them: 0 poses, 1 of 1 landmarks"
)


def test_a_landmark_that_starts_as_in_the_file_is_counted(graph, ranged):
    words = ("--start", "dead-reckoning", "--no-certify")
    assert AS_IN_FILE in graph("solve", ranged, *words).out.splitlines()


@pytest.mark.slow
@pytest.mark.parametrize("start", ["dead-reckoning", "chordal"])
def test_variables_that_start_as_in_the_file_are_counted(graph, told, ranged, start):
    """L2 has one range and B0 nothing before it: of 5 poses the edge A1 B1 places both of B."""
    file = ranged
    lines = graph("solve", file, "--start", start).out.splitlines()
    assert AS_IN_FILE in lines
    assert told("graph", "solve", file, "--start", start)["as_in_file"] == {
        "poses": 0,
        "landmarks": 1,
    }
    assert told("graph", "solve", file)["as_in_file"] == {"poses": 0, "landmarks": 0}


def test_all_starts_a_second_minimum_and_the_certificate_are_reported(
    mantaray, told, graph, tmp_path
):
    path = tmp_path / "ring.g2o"
    path.write_text(ring(6, 1, 9, 0.9, 20.0))
    done = graph("solve", path, "--random-starts", "2")
    assert "two minima fit the measurements" in done.err
    assert "not certified: least eigenvalue" in done.out
    result = told("graph", "solve", path, "--random-starts", "2", "--out", tmp_path / "out")
    names = [row["start"] for row in result["starts"]]
    assert names == ["file", "dead-reckoning", "chordal", "random-1", "random-2", "relaxation"]
    assert result["cost"] == pytest.approx(min(row["cost"] for row in result["starts"]), rel=1e-9)
    assert (result["start"], result["status"]) == ("file", "SECOND_MINIMUM")
    assert result["certificate"]["certified"] is False
    assert result["certificate"]["least_eigenvalue"] < 0.0
    assert (tmp_path / "out" / "alternative.tum").is_file()
    only = told("graph", "solve", path, "--start", "file", "--no-certify")
    assert "starts" not in only
    assert "certificate" not in only
    refused = mantaray("graph", "solve", path, "--start", "file", "--random-starts", "2")
    assert (refused.code, len(refused.err.splitlines())) == (2, 1)
    assert "--start best" in refused.err


def test_solve_lists_the_worst_factors_by_each_measure(graph, mantaray, tmp_path, as_stored):
    path = tmp_path / "g.pyfg"
    path.write_text(TEXT)
    done = json.loads(graph("solve", path, "--worst", 2, "--json").out)
    for measure in ("residual_sigmas", "leverage", "cook_distance"):
        rows = (
            done["tables"][f"largest_{measure}"] if "tables" in done else done[f"largest_{measure}"]
        )
        assert len(rows) == 2
        assert rows[0][measure] >= rows[1][measure]
        assert {row["kind"] for row in rows} <= {
            "range",
            "sighting",
            "odometry",
            "first-pose prior",
            "landmark prior",
        }
    assert "Cook's distance" in graph("solve", path, "--worst", 2).out
    as_stored(done)


def test_covariances_may_be_those_that_pyfactorgraph_reads(graph, tmp_path, as_stored):
    path = tmp_path / "g.pyfg"
    depth = (
        "VERTEX_SE3:QUAT:PRIOR 1 A1 0 0 3 0 0 0 1"
        f" {NOISE.replace('0.01', '1e12', 2).replace('1e-4', '1e12')}\n"
    )
    path.write_text(TEXT.replace(NOISE, NOISE.replace("0.01", "0.04", 1), 1) + depth)
    done = json.loads(graph("solve", path, "--covariances", "isotropic", "--json").out)
    assert done["left_out"] == {"depth priors (PyFactorGraph reads precision 0)": 1}
    as_stored(done)


def test_convert_writes_depths_as_ranges(graph, tmp_path, as_stored):
    path, out = tmp_path / "g.pyfg", tmp_path / "out.pyfg"
    depth = (
        "VERTEX_SE3:QUAT:PRIOR 1 A1 0 0 3 0 0 0 1"
        f" {NOISE.replace('0.01', '1e12', 2).replace('1e-4', '1e12')}\n"
    )
    path.write_text(TEXT + depth)
    assert graph("convert", path, out).err == ""
    assert "1e12" not in out.read_text()
    assert read_pyfg(out)[0]["depth"].measurement == pytest.approx(3.0, abs=1e-7)
    as_stored(out)


def test_short_ranges_with_metres_of_noise_are_explained(told, file):
    """Residuals of less than 5 m are never a large share, as they are of times of 5 m."""
    text = file.read_text().replace("9.05 0.01", "6 4").replace("17.7 0.01", "14 4")
    file.write_text(text)
    assert told("graph", "solve", file, "--no-truth")["unexplained"] is None


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"9.05": "60", "17.7": "150"}, "% of what was measured"),
        ({"A2 20 ": "A2 20000 ", "EDGE_RANGE": "#"}, "rms residual is "),
        (
            {"9.05 0.01": "7.05 1e-4\nEDGE_RANGE 1 A1 B1 11.05 1e-4", "EDGE_RANGE 1 A2": "#"},
            "median residual is 200 stated standard deviations",
        ),
    ],
)
def test_an_optimum_that_explains_nothing_exits_1(mantaray, told, file, tmp_path, changes, said):
    text = file.read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    file.write_text("".join(line + "\n" for line in text.splitlines() if line[0] != "#"))
    done = mantaray("graph", "solve", file, "--no-truth", "--out", tmp_path / "out")
    assert done.code == 1
    assert f"error: {file}: not explained: " in done.err
    assert said in done.err
    assert ": UNEXPLAINED, " in done.out.splitlines()[0]
    result = told("graph", "solve", file, "--no-truth", code=1)
    assert result["status"] == "UNEXPLAINED"
    assert said in result["unexplained"]
    if ratio := re.search(r"rms residual is (\S+) stated", result["unexplained"]):
        expected = np.sqrt(result["final_cost"] / result["expected_cost"])
        assert float(ratio[1]) == pytest.approx(expected, rel=5e-3)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["status"], summary["usable"]) == ("UNEXPLAINED", False)
    assert (tmp_path / "out" / "estimate.nc").is_file()


def test_one_wrong_depth_of_a_chain_is_not_explained(mantaray, tmp_path):
    """One degree of freedom, so the cost to expect is a half."""
    poses = [f"VERTEX_SE3:QUAT {k} A{k} {10 * k} 0 0 0 0 0 1" for k in range(2)]
    tied = [
        f"VERTEX_SE3:QUAT:PRIOR 0 A0 0 0 0 0 0 0 1 {NOISE}",
        f"EDGE_SE3:QUAT 1 A0 A1 10 0 0 0 0 0 1 {NOISE}",
        "VERTEX_SE3:QUAT:PRIOR 1 A1 0 0 20 0 0 0 1 "
        + NOISE.replace("0.01", "1e12", 2).replace("1e-4", "1e12"),
    ]
    path = tmp_path / "g.pyfg"
    path.write_text("\n".join([*poses, *tied, ""]))
    done = mantaray("graph", "solve", path, "--start", "file", "--no-certify", "--json")
    result = json.loads(done.out)
    assert (done.code, result["expected_cost"]) == (1, 0.5)
    ratio = np.sqrt(result["final_cost"] / 0.5)
    assert f"the rms residual is {ratio:.3g} stated standard dev" in result["unexplained"]


def test_a_cost_above_its_bounds_is_a_warning_not_silence(mantaray, told, file):
    """Three edges of 1 m more or less at a sigma of 0.1 m: explained, and not by their noise."""
    file.write_text(file.read_text().replace("A0 A2 20 ", "A0 A2 22.5 "))
    done = mantaray("graph", "solve", file, "--no-truth")
    assert done.code == 0
    assert "warning: OVER_CHI_SQUARE: the cost is " in done.err
    result = told("graph", "solve", file, "--no-truth")
    assert (result["status"], result["unexplained"]) == ("OVER_CHI_SQUARE", None)
    assert len(result["warnings"]) == 1
