"""Pose graphs as g2o text: there and back, as GTSAM reads it, and what the format cannot hold."""

from dataclasses import replace
from pathlib import Path

import gtsam
import numpy as np
import pytest
from refusals import refused

from pymantaray.apps.graphs import open_graph, solve_graph
from pymantaray.apps.graphs.g2o import LEFT_OUT, load_g2o, write_g2o
from pymantaray.errors import EstimationError
from pymantaray.estimation import build_graph
from pymantaray.geometry.se3 import matrix_from_quaternion

HAND = """\
# a comment

VERTEX_SE3:QUAT 3 1 2 3 0 0 0 1
VERTEX_SE3:QUAT 7 11 2 3 0 0 0.6 0.8
EDGE_SE3:QUAT 3 7 10 0 0 0 0 0.6 0.8 4 0 0 0 0 0.5 5 0 0 0 0 6 0 0 0 100 0 0 200 0 400
"""


@pytest.fixture
def pose_graph(make_fleet):
    """Poses and edges of two vehicles, with full covariances, and their values."""
    fleet = make_fleet(seed=5, n_vehicles=2, n_times=6, n_landmarks=1, gnss_every=3)
    graph = build_graph(fleet.noisy, "straight")
    rng = np.random.default_rng(0)
    root = rng.normal(0, 1, (len(graph["edge"]), 6, 6))
    scale = np.array([1e-3] * 3 + [2.0] * 3)
    covariance = (root @ np.swapaxes(root, 1, 2) + np.eye(6)) * scale[:, None] * scale
    return graph.with_factors(edge=replace(graph["edge"], covariance=covariance)), fleet.truth


@pytest.mark.parametrize("half_angles", [False, True])
@pytest.mark.parametrize("symbols", [False, True])
def test_poses_and_edges_come_back(tmp_path, pose_graph, symbols, half_angles, as_stored):
    graph, values = pose_graph
    path = tmp_path / "g.g2o"
    write_g2o(
        graph, path, initial=values, leave_out=LEFT_OUT, symbols=symbols, half_angles=half_angles
    )
    again, where, left_out, _ = load_g2o(path, half_angles=half_angles)[:4]
    assert left_out == {}
    assert again.vehicle_name.tolist() == (["A", "B"] if symbols else ["A"])
    np.testing.assert_array_equal(where.position, values.position)
    np.testing.assert_array_equal(where.quaternion, values.quaternion)
    for name in ("variables", "measurement"):
        np.testing.assert_array_equal(getattr(again["edge"], name), getattr(graph["edge"], name))
    sigma = np.sqrt(graph["edge"].variance)
    difference = (
        (again["edge"].covariance - graph["edge"].covariance)
        / sigma[:, :, None]
        / sigma[:, None, :]
    )
    assert np.abs(difference).max() < 1e-12  # two inversions
    if symbols:
        np.testing.assert_array_equal(again.pose_number, graph.pose_number)
    as_stored(path)


def test_gtsam_reads_the_same_graph(tmp_path, pose_graph):
    graph, values = pose_graph
    write_g2o(graph, tmp_path / "g.g2o", initial=values, leave_out=LEFT_OUT)
    factors, read = gtsam.readG2o(str(tmp_path / "g.g2o"), True)
    edge = graph["edge"]
    assert factors.size() == len(edge)
    for i in range(factors.size()):
        factor = factors.at(i)
        assert list(factor.keys()) == edge.variables[i].tolist()
        root = factor.noiseModel().R()
        np.testing.assert_allclose(
            root.T @ root, np.linalg.inv(edge.covariance[i]), rtol=1e-6, atol=1e-6
        )
        np.testing.assert_allclose(
            factor.measured().translation(), edge.column("position")[i], atol=1e-12
        )
    rotation = matrix_from_quaternion(values.quaternion)
    for i in range(graph.n_poses):
        np.testing.assert_allclose(read.atPose3(i).matrix()[:3, :3], rotation[i], atol=1e-12)


def test_we_read_what_gtsam_writes(tmp_path, pose_graph):
    graph, values = pose_graph
    write_g2o(graph, tmp_path / "ours.g2o", initial=values, leave_out=LEFT_OUT)
    gtsam.writeG2o(*gtsam.readG2o(str(tmp_path / "ours.g2o"), True), str(tmp_path / "theirs.g2o"))
    again, where = load_g2o(tmp_path / "theirs.g2o")[:2]
    both = (
        (where.position, values.position),
        (again["edge"].column("position"), graph["edge"].column("position")),
    )
    for theirs, ours in both:  # it rounds to six digits
        np.testing.assert_allclose(theirs, ours, rtol=1e-5, atol=1e-4)


def test_hand_written_file_means_what_it_says(tmp_path):
    (tmp_path / "g.g2o").write_text(HAND)
    graph, values = load_g2o(tmp_path / "g.g2o")[:2]
    assert [graph.variable_name(i) for i in range(2)] == ["A3", "A7"]
    np.testing.assert_array_equal(values.quaternion[1], [0.8, 0, 0, 0.6])
    half = open_graph(tmp_path / "g.g2o", half_angles=True).graph
    whole, quarter = (
        np.linalg.inv(g["edge"].covariance[0]) for g in (graph, half)
    )  # rotation first
    np.testing.assert_allclose(np.diagonal(whole), [100, 200, 400, 4, 5, 6], rtol=1e-12)
    np.testing.assert_allclose(np.diagonal(quarter), [25, 50, 100, 4, 5, 6], rtol=1e-12)
    assert whole[2, 3] == pytest.approx(0.5, rel=1e-12)


def test_what_the_format_cannot_hold_is_refused_or_counted(tmp_path, pose_graph):
    graph, values = pose_graph
    path = tmp_path / "g.g2o"
    most = [what for what in LEFT_OUT if what != "depth priors"]
    named = replace(graph, vehicle_name=np.array(["glider", "float"]))
    all_of_them = (
        "1 landmarks, 2 pose priors, 4 fixes, 12 depth priors, 1 landmark priors, 6 ranges"
    )
    for case, options, message in (
        (graph, {}, all_of_them),
        (graph, {"leave_out": most}, "the graph also has 12 depth priors"),
        (graph, {"leave_out": ["edges"]}, r"leave out \['edges'\]; allowed: landmarks,"),
        (named, {"leave_out": LEFT_OUT, "symbols": True}, "by one letter; found glider, float"),
    ):
        refused(EstimationError, message, write_g2o, case, path, initial=values, **options)
    assert list(tmp_path.iterdir()) == []
    lost = write_g2o(graph, path, initial=values, leave_out=LEFT_OUT)
    assert ", ".join(f"{count} {what}" for what, count in lost.items()) == all_of_them


@pytest.mark.parametrize(("old", "new", "message"), [
    ("VERTEX_SE3:QUAT 7",
     "VERTEX_SE3:QUAT 3", "line 4: second VERTEX_SE3:QUAT 3; allowed: one of each id"),
    ("VERTEX_SE3:QUAT 7",
     "VERTEX_SE3:QUAT -7", "line 4: id '-7'; allowed: integers up to 2147483647"),
    ("VERTEX_SE3:QUAT 7", f"VERTEX_SE3:QUAT {'7' * 5000}", "line 4: id '7+'"),
    ("VERTEX_SE3:QUAT 7", "VERTEX_SE3:QUAT 2147483648", "line 4: id '2147483648'"),
    ("VERTEX_SE3:QUAT 7", "VERTEX_TRACKXYZ 7", "line 4: VERTEX_TRACKXYZ with 9 fields; allowed: 5"),
    ("EDGE_SE3:QUAT 3 7", "EDGE_SE3:QUAT 3 8", "line 5: id 8; allowed: ids of the file's poses"),
    ("EDGE_SE3:QUAT 3 7", "EDGE_SE3:QUAT 3 3", "line 5: EDGE_SE3:QUAT from 3 to itself"),
    ("0 0 0.6 0.8 4", "0 0 0.6 0.9 4", r"line 5: EDGE_SE3:QUAT: quaternion"),
    ("0.8 4", "0.8 0", "line 5: EDGE_SE3:QUAT with information 0; allowed: a positive diagonal"),
    ("0.8 4", "0.8 1e-4", "line 5: EDGE_SE3:QUAT with singular information"),
    ("200 0 400", "200 0 nan", "line 5: EDGE_SE3:QUAT with a value that is not finite"),
    ("200 0 400", "200 0 x", "line 5: EDGE_SE3:QUAT: could not convert"),
    ("200 0 400", "200 0", "line 5: EDGE_SE3:QUAT with 30 fields; allowed: 31"),
    ("200 0 400", "200 0 1e-200",
     "line 5: EDGE_SE3:QUAT with information 1e-200; allowed: 1e-30 to 1e.30; or drop"),
    (HAND, "", "no VERTEX_SE3:QUAT, EDGE_SE3:QUAT, VERTEX_SE2 or EDGE_SE2 in the file"),
    ("# a comment", "TAG 3\nTAG 7\nPRIOR",
     r"unknown lines: 2 of 'TAG' \(line 1\), 1 of 'PRIOR' \(line 3\); allowed: VERTEX_.*`skip"),
])  # fmt: skip
def test_fault_is_one_line_that_names_the_place(tmp_path, old, new, message):
    assert old in HAND
    (tmp_path / "g.g2o").write_text(HAND.replace(old, new, 1))
    refused(EstimationError, message, load_g2o, tmp_path / "g.g2o")


def test_a_fault_deep_in_a_long_file_is_named_by_its_line_and_value(tmp_path):
    """Columns are converted as a whole; the line has to come out of them."""
    lines = [f"VERTEX_SE3:QUAT {k} {k} 0 0 0 0 0 1\n" for k in range(3000)]
    path = tmp_path / "g.g2o"
    for field, said in (
        ("1e10", "with 1e+10; allowed: positions of at most 1e+09 m"),
        ("1_0", "with an underscore"),
        ("1,5", "could not convert string to float: '1,5'; allowed: numbers"),
    ):
        lines[2345] = f"VERTEX_SE3:QUAT 2345 0 {field} 0 0 0 0 1\n"
        path.write_text("".join(lines))
        with pytest.raises(EstimationError) as caught:
            load_g2o(path)
        assert f"{path}, line 2346: VERTEX_SE3:QUAT" in str(caught.value)
        assert said in str(caught.value)


def test_g2o_is_recognized_by_its_lines_if_its_name_does_not_tell(tmp_path):
    for name in ("graph.g2o", "graph.txt"):
        (tmp_path / name).write_text(HAND)
    one, other = (open_graph(tmp_path / name) for name in ("graph.g2o", "graph.txt"))
    np.testing.assert_array_equal(one.values.position, other.values.position)
    (tmp_path / "graph.pyfg").write_text(HAND)
    refused(EstimationError, "graph.pyfg, line 3", open_graph, tmp_path / "graph.pyfg")
    (tmp_path / "text").write_text("VERTEX_SE3:QUAT 0 A0 1 2 3 0 0 0 1\n")
    assert open_graph(tmp_path / "text").graph.vehicle_name.tolist() == ["A"]


def test_toro_in_two_dimensions_is_read_as_gtsam_reads_it():
    path = Path(gtsam.__file__).parent / "Data" / "w100.graph"
    graph, values, left_out, _ = open_graph(path, skip_unknown=True)[:4]
    factors, read = gtsam.load2D(str(path))
    assert (graph.planar, len(graph["edge"]), left_out) == (True, factors.size(), {"EQUIV": 40})
    for i in range(factors.size()):
        factor, measured = factors.at(i), graph["edge"].column("position")[i]
        assert list(factor.keys()) == graph["edge"].variables[i].tolist()
        np.testing.assert_allclose(
            [factor.measured().x(), factor.measured().y(), 0.0], measured, atol=1e-12
        )
        root = factor.noiseModel().R()
        covariance = graph["edge"].covariance[i][[3, 4, 2]][:, [3, 4, 2]]
        np.testing.assert_allclose(np.linalg.inv(root.T @ root), covariance, rtol=1e-9, atol=1e-12)
    where = np.array(
        [[read.atPose2(i).x(), read.atPose2(i).y(), 0.0] for i in range(graph.n_poses)]
    )
    np.testing.assert_allclose(values.position, where, atol=1e-12)


def test_toro_in_two_dimensions_has_an_order_of_its_own(tmp_path):
    """A triangle 11 12 22 33 13 23; the public file above is diagonal."""
    (tmp_path / "t.graph").write_text(
        "VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0 4 0.5 5 9 0.25 0.125\n"
    )
    information = np.linalg.inv(
        open_graph(tmp_path / "t.graph").graph["edge"].covariance[0][[3, 4, 2]][:, [3, 4, 2]]
    )
    np.testing.assert_allclose(
        information, [[4, 0.5, 0.25], [0.5, 5, 0.125], [0.25, 0.125, 9]], rtol=1e-12
    )


def test_toro_in_three_dimensions_is_read_as_gtsam_reads_it():
    """The sphere has edges alone, and its first three of the information are the translation's."""
    path = Path(gtsam.__file__).parent / "Data" / "sphere2500.txt"
    file = open_graph(path)
    factors, _ = gtsam.load3D(str(path))
    edge = file.graph["edge"]
    assert (file.valueless, len(edge)) == (True, factors.size())
    turn = matrix_from_quaternion(edge.column("quaternion"))
    for i in range(factors.size()):
        measured = factors.at(i).measured()
        np.testing.assert_allclose(measured.rotation().matrix(), turn[i], atol=1e-12)
        np.testing.assert_allclose(measured.translation(), edge.column("position")[i], atol=1e-12)
    np.testing.assert_allclose(1.0 / edge.variance[0], [100, 100, 25, 10, 10, 10], rtol=1e-12)


def test_words_of_g2o_and_toro_are_not_mixed(tmp_path):
    path = tmp_path / "m.g2o"
    path.write_text("VERTEX_SE2 0 0 0 0\nVERTEX2 1 1 0 0\n")
    refused(
        EstimationError,
        "line 2: VERTEX_SE2 and VERTEX2 in one file; allowed: words of g2o, or",
        load_g2o,
        path,
    )


def test_lines_of_other_kinds_are_left_out_by_choice(tmp_path):
    (tmp_path / "g.g2o").write_text(HAND + "FIX 3\nVERTEX_TRACKXYZ 9 1 2 3\n")
    left_out = load_g2o(tmp_path / "g.g2o", leave_out=["FIX", "VERTEX_TRACKXYZ"]).left_out
    assert left_out == {"FIX": 1, "VERTEX_TRACKXYZ": 1}


@pytest.mark.parametrize(("name", "matrix"), [("g.g2o", "0 0 0 1 0 1"), ("g.pyfg", "1 2 0 1 0 1")])
def test_indefinite_matrices_are_refused_dropped_or_repaired(tmp_path, name, matrix, as_stored):
    ids = ["0", "1"] if name == "g.g2o" else ["A0", "A1"]
    time = "" if name == "g.g2o" else "0 "
    lines = [f"VERTEX_SE2 {time}{ids[0]} 0 0 0", f"VERTEX_SE2 {time}{ids[1]} 1 0 0"]
    for step, m in ((1.0, "4 0 0 4 0 4"), (1.2, "4 0 0 4 0 4"), (3.0, matrix)):
        lines.append(f"EDGE_SE2 {time}{ids[0]} {ids[1]} {step} 0 0 {m}")
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n")
    refused(EstimationError, "positive d", open_graph, path)
    dropped, repaired = (open_graph(path, indefinite=how) for how in ("drop", "repair"))
    assert (len(dropped.graph["edge"]), dropped.left_out) == (
        2,
        {"EDGE_SE2 (indefinite matrix)": 1},
    )
    assert (len(repaired.graph["edge"]), dict(repaired.repaired)) == (3, {"EDGE_SE2": 1})
    assert np.linalg.eigvalsh(repaired.graph["edge"].covariance).min() > 0.0
    assert solve_graph(dropped, truth=False).values.position[1, 0] == pytest.approx(1.1, abs=1e-6)
    if name == "g.g2o":  # an axis without information hardly counts
        assert solve_graph(repaired, truth=False).values.position[1, 0] == pytest.approx(
            1.1, abs=1e-5
        )
    as_stored([dropped.graph.to_dataset(), repaired.graph.to_dataset()])


def read_text(folder, text):
    """Read a graph from text."""
    (folder / "g.g2o").write_text(text)
    return open_graph(folder / "g.g2o")


def test_fixed_vertices_and_priors_are_read_with_their_sensor_offset(tmp_path, as_stored):
    """
    A prior of a sensor that is 1 m ahead of the body, turned by 90 degrees: the body is 1 m behind
    it.
    """
    half = 0.5**0.5
    text = f"""\
PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1
PARAMS_SE3OFFSET 1 1 0 0 0 0 {half} {half}
VERTEX_SE3:QUAT 0 1 2 3 0 0 0 1
VERTEX_SE3:QUAT 1 2 2 3 0 0 0 1
VERTEX_SE3:QUAT 2 3 2 3 0 0 0 1
VERTEX_TRACKXYZ 9 5 5 5
FIX 0 9
EDGE_SE3_PRIOR 1 0 2.1 2 3 0 0 0 1 100 0 0 0 0 0 100 0 0 0 0 100 0 0 0 400 0 0 400 0 400
EDGE_SE3_PRIOR 2 1 4.1 2 3 0 0 {half} {half} 100 0 0 0 0 0 25 0 0 0 0 4 0 0 0 1e4 0 0 1e4 0 1e4
EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 100 0 0 0 0 0 100 0 0 0 0 100 0 0 0 400 0 0 400 0 400
EDGE_SE3:QUAT 1 2 1 0 0 0 0 0 1 100 0 0 0 0 0 100 0 0 0 0 100 0 0 0 400 0 0 400 0 400
EDGE_SE3_TRACKXYZ 1 9 0 3 3 2 1 0 0 1 0 1
"""
    (tmp_path / "a.g2o").write_text(text)
    graph = open_graph(tmp_path / "a.g2o").graph
    prior = graph["prior"]
    assert prior.subject.tolist() == [1, 2, 0]
    np.testing.assert_allclose(
        prior.column("position"), [[2.1, 2, 3], [3.1, 2, 3], [1, 2, 3]], atol=1e-12
    )
    np.testing.assert_allclose(prior.column("quaternion"), [[1, 0, 0, 0]] * 3, atol=1e-12)
    np.testing.assert_allclose(prior.variance[0], [1 / 400] * 3 + [0.01] * 3)
    # x of the sensor is y of the body; a rotation of the body about down moves the sensor by its
    # arm of 1 m
    np.testing.assert_allclose(
        prior.variance[1], [1e-4, 1e-4, 1e-4, 1 / 25, 0.01 + 1e-4, 0.25 + 1e-4]
    )
    np.testing.assert_allclose(prior.variance[2], 1e-6)
    assert graph["survey"].subject.tolist() == [3]
    solved = solve_graph(open_graph(tmp_path / "a.g2o"), start="file", truth=False)
    assert np.linalg.norm(solved.values.position[0] - [1, 2, 3]) < 1e-3
    refused(
        EstimationError,
        "line 7: id 8; allowed: ids of the file's vertices",
        read_text,
        tmp_path,
        text.replace("FIX 0 9", "FIX 0 8"),
    )
    as_stored([graph.to_dataset(), solved.summary()])


def test_a_planar_prior_and_fix_are_read(tmp_path, as_stored):
    text = """\
VERTEX_SE2 0 1 2 0.5
VERTEX_SE2 1 2 2 0.5
FIX 0
EDGE_PRIOR_SE2 1 2 2 0.5 4 0 0 9 0 16
EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1
"""
    (tmp_path / "a.g2o").write_text(text)
    prior = open_graph(tmp_path / "a.g2o").graph["prior"]
    assert prior.subject.tolist() == [1, 0]
    np.testing.assert_allclose(prior.variance[0][[3, 4, 2]], [1 / 4, 1 / 9, 1 / 16])
    as_stored(open_graph(tmp_path / "a.g2o").graph.to_dataset())


def test_words_of_isam_have_the_root_of_the_information_by_rows(tmp_path, as_stored):
    root = np.array([[10.0, 1.0, 2.0], [0.0, 20.0, 3.0], [0.0, 0.0, 30.0]])
    entries = " ".join(f"{x:g}" for x in root[np.triu_indices(3)])
    text = f"""\
ODOMETRY 0 1 1 0 0.1 {entries}
ODOMETRY 1 2 1 0 0.1 {entries}
EDGE2 0 2 2 0.1 0.2 {entries}
LANDMARK 1 0 3 4 2 0.5 4
"""
    (tmp_path / "victoria.txt").write_text(text)
    file = open_graph(tmp_path / "victoria.txt")
    edge, sighting = file.graph["edge"], file.graph["sighting"]
    assert file.graph.planar
    assert file.valueless
    assert edge.variables.tolist() == [[0, 1], [1, 2], [0, 2]]
    expected = np.linalg.inv(root.T @ root)  # x, y, angle
    own = [3, 4, 2]
    for k in range(3):
        np.testing.assert_allclose(edge.covariance[k][np.ix_(own, own)], expected, rtol=1e-9)
    root = np.array([[2.0, 0.5], [0.0, 4.0]])
    np.testing.assert_allclose(
        sighting.covariance[0][:2, :2], np.linalg.inv(root.T @ root), rtol=1e-9
    )
    only = "\n".join(line for line in text.splitlines() if line.startswith("EDGE2")) + "\n"
    (tmp_path / "e.g2o").write_text(only)
    stated = open_graph(tmp_path / "e.g2o", isam=True).graph["edge"]
    np.testing.assert_allclose(stated.covariance[0][np.ix_(own, own)], expected, rtol=1e-9)
    (tmp_path / "e.g2o").write_text("EDGE2 0 1 1 0 0 10 0 20 30 0 0\n")  # TORO: 11 12 22 33 13 23
    toro = open_graph(tmp_path / "e.g2o").graph["edge"]
    np.testing.assert_allclose(toro.variance[0][own], [1 / 10, 1 / 20, 1 / 30])
    as_stored([file.graph.to_dataset(), stated.covariance, toro.covariance])


def test_information_that_no_covariance_can_hold_is_refused(tmp_path):
    text = "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1e-320 0 0 1 0 1\n"
    refused(
        EstimationError,
        r"line 3: EDGE_SE2 with information .*e-32[01]; allowed: 1e-30 to 1e\+30",
        read_text,
        tmp_path,
        text,
    )
