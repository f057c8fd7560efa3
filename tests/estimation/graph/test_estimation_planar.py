"""
Graphs in two dimensions, and landmarks that are sighted: beside GTSAM's own factors, to its digits.
"""

from dataclasses import replace
from pathlib import Path

import gtsam
import numpy as np
import pytest
from refusals import refused

from pymantaray.apps.graphs import open_graph, solve_graph, to_gtsam
from pymantaray.apps.graphs.g2o import load_g2o, write_g2o
from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    FactorGraph,
    GraphSolver,
    GraphValues,
    SolveOptions,
    read_pyfg,
    write_pyfg,
)
from pymantaray.estimation.graph.graph import KINDS, check_graph, check_values
from pymantaray.estimation.graph.pyfg import GraphFile
from pymantaray.estimation.solve import METHODS
from pymantaray.estimation.solvers.starts import chordal, dead_reckon_graph
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import SolveStatus

TIGHT = SolveOptions(step_tolerance=1e-11)

# the records of the public 2-D range-aided sets: odometry, ranges to landmarks with and without a
# survey, sightings
PLAZA = """\
VERTEX_SE2 0.0 A0 0 0 0.1
VERTEX_SE2 1.0 A1 2 0.3 0.5
VERTEX_SE2 2.0 A2 3.9 1.4 0.9
VERTEX_SE2 3.0 A3 5.0 3.1 -3.0
VERTEX_XY L0 6 -1
VERTEX_XY L1 0 5
VERTEX_XY L2 4 4
VERTEX_SE2:PRIOR 0.0 A0 0 0 0.1 0.01 0.002 0.001 0.02 0 0.003
VERTEX_SE2:PRIOR 2.0 A2 3.8 1.3 0 0.25 0.01 0 0.36 0 1e12
VERTEX_XY:PRIOR 0.0 L0 6 -1 0.04 0.01 0.05
EDGE_SE2 1.0 A0 A1 2.1 0.05 0.42 0.02 0.001 0.0005 0.03 0 0.004
EDGE_SE2 2.0 A1 A2 2.2 0.02 0.37 0.02 0 0 0.03 0 0.004
EDGE_SE2 3.0 A2 A3 2.1 0.1 2.4 0.02 0 0 0.03 0 0.004
EDGE_SE2 3.0 A3 A0 5.3 2.5 3.05 0.2 0.01 0 0.3 0 0.04
EDGE_SE2_XY 1.0 A1 L2 3.5 2.3 0.05 0.02 0.06
EDGE_SE2_XY 2.0 A2 L2 2.2 1.5 0.05 0 0.06
EDGE_RANGE 1.0 A1 L0 4.3 0.01
EDGE_RANGE 2.0 A2 L1 5.2 0.01
EDGE_RANGE 3.0 A3 L1 5.5 0.01
EDGE_RANGE 3.0 A0 L1 5.1 0.04
EDGE_RANGE 3.0 L0 L2 5.3 0.04
EDGE_RANGE 3.0 A0 A3 5.8 0.04
"""


@pytest.fixture
def plaza(tmp_path):
    (tmp_path / "plaza.pyfg").write_text(PLAZA)
    return read_pyfg(tmp_path / "plaza.pyfg")


def sighting_2d(measured, factor, values, jacobians):
    pose, landmark = factor.keys()
    by_pose, by_point = np.zeros((2, 3), order="F"), np.zeros((2, 2), order="F")
    error = (
        values.atPose2(pose).transformTo(values.atPoint2(landmark), by_pose, by_point) - measured
    )
    if jacobians is not None:
        jacobians[0], jacobians[1] = by_pose, by_point
    return error


def gtsam_in_plane(text):
    """GTSAM's factors in SE(2) and values, made of the fields of a text without any of our code."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()

    def noise(fields, n):
        matrix = np.zeros((n, n))
        matrix[np.triu_indices(n)] = fields
        return gtsam.noiseModel.Gaussian.Covariance(matrix + np.triu(matrix, 1).T)

    def key(name):
        return gtsam.symbol(name[0], int(name[1:]))

    for line in text.splitlines():
        word, *fields = line.split()
        names = [key(f) for f in fields if f[0] in "AL"]
        x = [float(f) for f in fields if f[0] not in "AL"][word != "VERTEX_XY" :]
        if word == "VERTEX_SE2":
            values.insert(names[0], gtsam.Pose2(*x))
        elif word == "VERTEX_XY":
            values.insert(names[0], np.array(x))
        elif word == "VERTEX_SE2:PRIOR" and x[8] < 1e12:
            graph.add(gtsam.PriorFactorPose2(names[0], gtsam.Pose2(*x[:3]), noise(x[3:], 3)))
        elif word == "VERTEX_SE2:PRIOR":
            model = noise([x[3], x[4], x[6]], 2)
            graph.add(gtsam.PoseTranslationPrior2D(names[0], gtsam.Pose2(*x[:2], 0.0), model))
        elif word == "VERTEX_XY:PRIOR":
            graph.add(gtsam.PriorFactorPoint2(names[0], np.array(x[:2]), noise(x[2:], 2)))
        elif word == "EDGE_SE2":
            graph.add(gtsam.BetweenFactorPose2(*names, gtsam.Pose2(*x[:3]), noise(x[3:], 3)))
        elif word == "EDGE_SE2_XY":
            measured = np.array(x[:2])
            graph.add(
                gtsam.CustomFactor(
                    noise(x[2:], 2), names, lambda f, v, j, m=measured: sighting_2d(m, f, v, j)
                )
            )
        elif word == "EDGE_RANGE":
            ends = "".join(f[0] for f in fields if f[0] in "AL")
            kind = {
                "AL": gtsam.RangeFactor2D,
                "AA": gtsam.RangeFactorPose2,
                "LL": gtsam.RangeFactor2,
            }[ends]
            graph.add(kind(*names, x[0], noise(x[1:], 1)))
    return graph, values


def test_the_solution_is_gtsams_of_the_problem_in_the_plane(plaza):
    graph, initial = plaza
    ours = GraphSolver(TIGHT).solve(graph, initial, model_is_right=False)
    assert ours.status == SolveStatus.OK
    factors, values = gtsam_in_plane(PLAZA)
    assert ours.initial_cost == pytest.approx(factors.error(values), rel=1e-12)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(0.0)
    parameters.setAbsoluteErrorTol(0.0)
    parameters.setErrorTol(0.0)
    for _ in range(10):
        values = gtsam.LevenbergMarquardtOptimizer(factors, values, parameters).optimize()
    for i in range(4):
        pose = values.atPose2(gtsam.symbol("A", i))
        np.testing.assert_allclose(ours.position[i], [pose.x(), pose.y(), 0.0], rtol=0, atol=1e-9)
        turned = matrix_from_quaternion(ours.quaternion[i])
        np.testing.assert_allclose(turned[:2, :2], pose.rotation().matrix(), rtol=0, atol=1e-9)
        np.testing.assert_array_equal(ours.quaternion[i, 1:3], 0.0)
    for i in range(3):
        point = values.atPoint2(gtsam.symbol("L", i))
        np.testing.assert_allclose(ours.landmark_position[i], [*point, 0.0], rtol=0, atol=1e-9)
    assert ours.final_cost == pytest.approx(factors.error(values), rel=1e-10)
    # 3 + 2 of priors, 2 of the survey, 4 x 3 of edges, 2 x 2 of sightings, 6 ranges; 4 poses and 3
    # landmarks
    assert graph.degrees_of_freedom == 29 - 18
    assert ours.expected_cost == 5.5


def test_a_hand_written_planar_file_is_read_and_written_back(plaza, tmp_path):
    graph, values = plaza
    assert graph.planar
    turned = 2.0 * np.arctan2(values.quaternion[:, 3], values.quaternion[:, 0])
    np.testing.assert_allclose(turned, [0.1, 0.5, 0.9, -3.0], rtol=1e-15)
    np.testing.assert_array_equal(graph["prior"].covariance[0][np.ix_([3, 4, 2], [3, 4, 2])], [
        [0.01, 0.002, 0.001], [0.002, 0.02, 0.0], [0.001, 0.0, 0.003],
    ])  # fmt: skip
    assert [len(graph[name]) for name in KINDS] == [1, 1, 0, 1, 4, 0, 0, 0, 2, 6]
    np.testing.assert_array_equal(graph["sighting"].measurement[0], [3.5, 2.3, 0.0])
    write_pyfg(graph, tmp_path / "again.pyfg", initial=values)
    for ours, theirs in zip(
        (tmp_path / "again.pyfg").read_text().splitlines(),
        sorted(PLAZA.splitlines(), key=order),
        strict=True,
    ):
        assert fields_of(ours) == fields_of(theirs)
    again, _ = read_pyfg(tmp_path / "again.pyfg")
    for name in KINDS:
        for part in ("variables", "covariance"):
            np.testing.assert_array_equal(getattr(again[name], part), getattr(graph[name], part))


def order(line):
    """Place of a line in a file as we write it: by its word, fixes after priors."""
    words = [
        "VERTEX_SE2",
        "VERTEX_XY",
        "VERTEX_SE2:PRIOR",
        "VERTEX_XY:PRIOR",
        "EDGE_SE2",
        "EDGE_SE2_XY",
    ]
    word = line.split()[0]
    return words.index(word) if word in words else len(words)


def fields_of(line):
    """Words and names, and numbers to 15 digits; times of factors are those of their poses."""
    word, *rest = line.split()
    kept = rest if word.startswith("VERTEX_SE2") or word == "VERTEX_XY" else rest[1:]
    return word, [f if f[0] in "AL" else float(f"{float(f):.15g}") for f in kept]


@pytest.mark.parametrize("estimator", METHODS)
def test_every_estimator_solves_in_the_plane(plaza, estimator):
    graph, values = plaza
    at = [
        [0.0, 5.0, 0.0],
        [4.0, 4.0, 0.0],
    ]  # on-line a landmark has to be known before its first range
    survey = graph["survey"].append(KINDS["survey"].table([[5], [6]], [at], [np.eye(3)] * 2))
    graph = graph.with_factors(survey=survey)
    result = solve_graph(GraphFile(graph, values, {}), estimator=estimator)
    assert result.solution.usable
    np.testing.assert_array_equal(result.values.position[:, 2], 0.0)
    if estimator in ("batch", "incremental"):
        batch = GraphSolver(TIGHT).solve(graph, values)
        np.testing.assert_allclose(result.values.position, batch.position, rtol=0, atol=2e-3)


def test_gtsams_own_graph_of_ours_has_the_same_cost_and_optimum(plaza):
    graph, values = plaza
    ours = GraphSolver(TIGHT).solve(graph, values, model_is_right=False)
    factors, start = to_gtsam(graph, values)
    assert factors.error(start) == pytest.approx(ours.initial_cost, rel=1e-12)
    optimum = gtsam.LevenbergMarquardtOptimizer(factors, start).optimize()
    np.testing.assert_allclose(optimum.atPose3(3).translation(), ours.position[3], atol=1e-3)


def test_dead_reckoning_composes_edges_and_places_what_is_sighted(plaza):
    graph, values = plaza
    reckoned, as_in_file = dead_reckon_graph(graph, values)
    pose = gtsam.Pose2(0.0, 0.0, 0.1).compose(gtsam.Pose2(2.1, 0.05, 0.42))
    np.testing.assert_allclose(reckoned.position[1], [pose.x(), pose.y(), 0.0], atol=1e-14)
    seen = pose.transformFrom(np.array([3.5, 2.3]))  # by the first of two
    np.testing.assert_allclose(reckoned.landmark_position[2], [*seen, 0.0], atol=1e-14)
    np.testing.assert_array_equal(reckoned.landmark_position[1], values.landmark_position[1])
    assert as_in_file.size == 1


SIGHTED = """\
PARAMS_SE3OFFSET 4 0.1 -0.2 0.3 0 0 0.6 0.8
PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1
VERTEX_SE3:QUAT 1 0.9 0.1 0.2 0.1 0.1 0.1 0.98488578017961
VERTEX_TRACKXYZ 2 2 1 0
VERTEX_TRACKXYZ 3 1 -1 1
EDGE_SE3:QUAT 0 1 1 0 0.1 0.1 0.1 0.1 0.98488578017961 100 1 0 0 0 0 100 0 0 0 0 100 0 0 0 200 0 0 200 0 200
EDGE_SE3_TRACKXYZ 0 2 0 2.1 0.9 0.1 25 1 0 36 0 49
EDGE_SE3_TRACKXYZ 1 2 0 1.2 0.8 -0.3 25 1 0 36 0 49
EDGE_SE3_TRACKXYZ 0 3 0 1.1 -0.9 1 25 1 0 36 0 49
EDGE_SE3_TRACKXYZ 1 3 0 0.1 -1 1 25 1 0 36 0 49
"""  # noqa: E501  lines of a file


def test_sightings_cost_what_they_should_wherever_poses_are(tmp_path):
    """GTSAM's own reader makes bearings and ranges of them, so that this is by hand."""
    (tmp_path / "g.g2o").write_text(SIGHTED)
    graph, start = open_graph(tmp_path / "g.g2o")[:2]
    assert graph.landmark_name.tolist() == ["L2", "L3"]
    information = np.array([[25.0, 1.0, 0.0], [1.0, 36.0, 0.0], [0.0, 0.0, 49.0]])
    rng = np.random.default_rng(0)
    for _ in range(3):
        values = GraphValues(
            start.position + 0.3 * rng.normal(size=(2, 3)),
            normalized(start.quaternion + 0.3 * rng.normal(size=(2, 4))),
            start.landmark_position + 0.3 * rng.normal(size=(2, 3)),
        )
        poses = [
            gtsam.Pose3(gtsam.Rot3.Quaternion(*q), p)
            for q, p in zip(values.quaternion, values.position, strict=True)
        ]
        expected = 0.0
        for (pose, seen), place in zip(
            graph["sighting"].variables, graph["sighting"].measurement, strict=True
        ):
            off = poses[pose].transformTo(values.landmark_position[seen - 2]) - place
            expected += 0.5 * off @ information @ off
        none = graph["edge"][:0]
        ours = GraphSolver().solve(graph.with_factors(edge=none), values)
        assert ours.initial_cost == pytest.approx(expected, rel=1e-12)
        factors, own = to_gtsam(graph.with_factors(edge=none), values)
        assert factors.error(own) == pytest.approx(expected, rel=1e-12)
    result = solve_graph(GraphFile(graph, start, {}))
    assert [result.graph.variable_name(int(k)) for k in result.anchored] == ["A0"]
    factors, own = to_gtsam(result.graph, start)
    best = gtsam.LevenbergMarquardtOptimizer(factors, own).optimize()
    assert result.solution.status == SolveStatus.OK
    assert result.solution.final_cost == pytest.approx(factors.error(best), rel=1e-5)


def normalized(quaternion):
    return quaternion / np.linalg.norm(quaternion, axis=1)[:, None]


def test_offsets_of_sensors_are_taken_into_what_they_sight(tmp_path):
    (tmp_path / "g.g2o").write_text(SIGHTED.replace("1 3 0 0.1 -1 1", "1 3 4 0.1 -1 1"))
    sighting = load_g2o(tmp_path / "g.g2o").graph["sighting"]
    offset = gtsam.Pose3(gtsam.Rot3.Quaternion(0.8, 0, 0, 0.6), np.array([0.1, -0.2, 0.3]))
    np.testing.assert_allclose(
        sighting.measurement[3], offset.transformFrom(np.array([0.1, -1.0, 1.0])), atol=1e-15
    )
    turn = offset.rotation().matrix()
    np.testing.assert_allclose(
        sighting.covariance[3], turn @ sighting.covariance[2] @ turn.T, atol=1e-15
    )
    text = SIGHTED.replace("1 3 0 0.1 -1 1", "1 3 9 0.1 -1 1")
    (tmp_path / "g.g2o").write_text(text)
    message = "line 11: parameter 9; allowed: ids of the file's PARAMS_SE3OFFSET"
    refused(EstimationError, message, load_g2o, tmp_path / "g.g2o")


@pytest.mark.parametrize("symbols", [False, True])
@pytest.mark.parametrize("text", [PLAZA, SIGHTED], ids=["plane", "space"])
def test_g2o_there_and_back(tmp_path, text, symbols):
    name = "g.pyfg" if text == PLAZA else "g.g2o"
    (tmp_path / name).write_text(text)
    graph, values = open_graph(tmp_path / name)[:2]
    most = ("landmarks", "pose priors", "fixes", "landmark priors", "ranges")
    lost = write_g2o(graph, tmp_path / "again.g2o", initial=values, leave_out=most, symbols=symbols)
    expected = {"landmarks": 2, "pose priors": 1, "fixes": 1, "landmark priors": 1, "ranges": 6}
    assert lost == (expected if graph.planar else {})
    again, where, left_out, valueless = load_g2o(tmp_path / "again.g2o")[:4]
    assert (left_out, valueless, again.planar) == ({}, False, graph.planar)
    np.testing.assert_allclose(where.quaternion, values.quaternion, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(where.position, values.position)
    for kind in ("edge", "sighting"):
        np.testing.assert_allclose(
            again[kind].measurement, graph[kind].measurement, rtol=0, atol=1e-15
        )
        inside = np.ix_(
            range(len(graph[kind])), *[KINDS[kind].rows_in("rad m", planar=graph.planar)] * 2
        )
        np.testing.assert_allclose(
            again[kind].covariance[inside], graph[kind].covariance[inside], rtol=1e-12, atol=1e-18
        )
    if symbols:
        assert again.landmark_name.tolist() == (["L2"] if graph.planar else ["L2", "L3"])
    if graph.planar and not symbols:
        factors, read = gtsam.readG2o(str(tmp_path / "again.g2o"), False)
        edges = [
            factors.at(i) for i in range(factors.size()) if len(list(factors.at(i).keys())) == 2
        ]
        between = [e for e in edges if isinstance(e, gtsam.BetweenFactorPose2)]
        assert len(between) == 4
        assert between[0].measured().equals(gtsam.Pose2(2.1, 0.05, 0.42), 1e-12)
        assert read.atPose2(3).equals(gtsam.Pose2(5.0, 3.1, -3.0), 1e-12)


def test_a_graph_of_edges_alone_starts_from_chordal_initialization(plaza, tmp_path):
    graph, values = plaza
    most = ("landmarks", "pose priors", "fixes", "landmark priors", "ranges")
    write_g2o(graph, tmp_path / "g.g2o", initial=values, leave_out=most)
    lines = (tmp_path / "g.g2o").read_text().splitlines(keepends=True)
    (tmp_path / "edges.g2o").write_text("".join(x for x in lines if x.startswith("EDGE")))
    whole, edges = (open_graph(tmp_path / f"{name}.g2o") for name in ("g", "edges"))
    assert (whole.valueless, edges.valueless) == (False, True)
    np.testing.assert_allclose(edges.values.position[0], 0.0, atol=1e-12)  # the first pose
    result = solve_graph(edges)
    assert (result.start, result.truth) == ("chordal", None)
    assert result.solution.usable
    other = solve_graph(whole, truth=False)
    assert result.solution.final_cost == pytest.approx(other.solution.final_cost, rel=1e-4)


def test_only_a_graph_without_anchors_is_anchored(plaza, tmp_path):
    (tmp_path / "free.pyfg").write_text(
        "".join(x for x in PLAZA.splitlines(True) if ":PRIOR" not in x)
    )
    result = solve_graph(open_graph(tmp_path / "free.pyfg"))
    assert [result.graph.variable_name(int(k)) for k in result.anchored] == ["A0"]
    np.testing.assert_allclose(result.values.position[0], 0.0, atol=1e-9)
    stray = "VERTEX_SE2 0 B0 9 9 0\nVERTEX_SE2 1 B1 9 9 0\nEDGE_SE2 1 B0 B1 0 0 0 1 0 0 1 0 1\n"
    (tmp_path / "stray.pyfg").write_text(PLAZA + stray)
    file = open_graph(tmp_path / "stray.pyfg")
    refused(EstimationError, "^B0: no first-pose prior, .* anchors it", solve_graph, file)
    assert solve_graph(file, anchor=True).solution.usable


def test_a_planar_graph_on_disk_is_planar(plaza, tmp_path):
    graph, _ = plaza
    graph.save(tmp_path / "graph.nc")
    assert FactorGraph.load(tmp_path / "graph.nc").planar


def test_what_leaves_the_plane_is_refused(plaza):
    graph, values = plaza
    depth = KINDS["depth"].table([[0]], [[5.0]], [[[1.0]]])
    edge = graph["edge"]
    tilted = np.array(edge.column("quaternion"))
    tilted[2] = [0.8, 0.6, 0.0, 0.0]
    mixed = np.array(edge.covariance)
    mixed[1, 2, 0] = mixed[1, 0, 2] = 1e-4
    down = np.array([0.0, 0.0, 1.0])
    for bad, message in (
        (graph.with_factors(depth=depth), "depth: 1 in a graph in two dimensions"),
        (
            graph.with_factors(edge=edge.with_columns(quaternion=tilted)),
            "A3: odometry quaternion .* about down",
        ),
        (
            graph.with_factors(edge=edge.with_columns(position=edge.column("position") + down)),
            "A1: odometry down is .1. .4 such",
        ),
        (
            graph.with_factors(edge=replace(edge, covariance=mixed)),
            "A2: odometry covariance between what is in",
        ),
    ):
        refused(EstimationError, message, check_graph, bad)
    up = replace(values, position=values.position + down)
    refused(EstimationError, "A0: depth is .1.", check_values, graph, up)
    turned = np.tile([0.8, 0.0, 0.6, 0.0], (4, 1))
    refused(
        EstimationError, "A0: quaternion", check_values, graph, replace(values, quaternion=turned)
    )


def test_gtsams_public_examples_are_read_whole():
    """Its own data: landmarks counted apart from poses, and one that is seen through an offset."""
    folder = Path(gtsam.__file__).parent / "Data"
    file = open_graph(folder / "known_landmark_localization_3.g2o")
    assert (len(file.graph["edge"]), len(file.graph["sighting"]), file.left_out) == (2, 12, {})
    result = solve_graph(file, truth=False)
    assert result.solution.usable
    # landmarks where the name of the file says they are, once the first pose is
    np.testing.assert_allclose(result.values.landmark_position[0], [4.0, 1.0, 2.0], atol=0.2)
    seen = open_graph(folder / "edge_se3_trackxyz_nonidentity_offset.g2o").graph["sighting"]
    np.testing.assert_allclose(seen.measurement, [[2.1, 1.0, 3.0]], atol=1e-15)


def test_chordal_start_without_angle_information_gives_a_rotation(tmp_path):
    """
    Of a graph that a damaged file gave: an edge with a variance of 1e16 rad^2, beside a prior
    without heading.
    """
    (tmp_path / "g.pyfg").write_text(
        "VERTEX_SE2 0 A0 0 0 0\nVERTEX_SE2 1 A1 10 0 1.5\nVERTEX_SE2 0 B0 0 9 0\nVERTEX_XY L3 5 6\n"
        "VERTEX_SE2:PRIOR 0 A0 0 0 0 0.1 0.01 0 0.1 0 1e-4\nVERTEX_SE2:PRIOR 0 A0 0 0 0 0.1 0.01 0"
        " 0.1 0 1e-4\n"
        "VERTEX_SE2:PRIOR 0 B0 0 9 0 1 0 0 1 0 1e12\n"
        "VERTEX_XY:PRIOR 0 L3 5 6 0.5 0.1 0.6\nEDGE_SE2 1 A0 A1 10 0 1.5 0.25 0.01 0 0.25 0 1e16\n"
        "EDGE_SE2 1 A1 B0 9.6 9.3 -1.5 0.25 0.01 0 0.25 0 1e-4\nEDGE_SE2_XY 1 A1 L3 5.6 5.4 0.1 0"
        " 0.1\n"
        "EDGE_RANGE 1 A1 L3 7.8 4\n"
    )
    graph, values = read_pyfg(tmp_path / "g.pyfg")
    start = chordal(graph, values).values.quaternion
    np.testing.assert_allclose(np.linalg.norm(start, axis=1), 1.0)
    np.testing.assert_array_equal(start[:, 1:3], 0.0)


def test_chordal_start_without_edges_places_sighted_points(tmp_path):
    (tmp_path / "g.pyfg").write_text(
        "VERTEX_SE2 0 A0 1 2 0\nVERTEX_XY L0 0 0\nVERTEX_SE2:PRIOR 0 A0 1 2 1.5707963267948966 0.1"
        " 0 0 0.1 0 1e-4\n"
        "EDGE_SE2_XY 0 A0 L0 3 4 0.1 0 0.1\n"
    )
    graph, values = read_pyfg(tmp_path / "g.pyfg")
    start = chordal(graph, values).values
    np.testing.assert_allclose(start.position[0], [1.0, 2.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(start.landmark_position[0], [-3.0, 5.0, 0.0], atol=1e-12)
