"""
What PyFactorGraph reads: isotropic covariances against GTSAM by its rules, and depths as ranges.
"""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from factories import make_fleet
from refusals import refused

from pymantaray.apps.graphs import open_graph, solve_graph
from pymantaray.errors import EstimationError
from pymantaray.estimation import GraphSolver, build_graph, read_pyfg, write_pyfg
from pymantaray.estimation.graph.pyfg import load_pyfg


def precisions(covariance):
    """Precisions as PyFactorGraph's matrix_utils.py computes them from x y z rx ry rz."""
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = covariance
    return 3.0 / np.trace(matrix[:3, :3]), 3.0 / (2.0 * np.trace(matrix[3:, 3:]))


def noise(covariance):
    """
    Noise of GTSAM, rotation first, with twice the rotation's precision, as the authors'
    pyfg_to_gtsam.py has it.
    """
    translation, rotation = precisions(covariance)
    sigmas = [1.0 / np.sqrt(2.0 * rotation)] * 3 + [1.0 / np.sqrt(translation)] * 3
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(sigmas))


def pose(fields):
    x, y, z, qx, qy, qz, qw = map(float, fields)
    return gtsam.Pose3(gtsam.Rot3.Quaternion(qw, qx, qy, qz), np.array([x, y, z]))


def full_noise(covariance):
    """Noise of GTSAM, rotation first, with the file's covariance."""
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = covariance
    matrix = np.triu(matrix) + np.triu(matrix, 1).T
    order = [3, 4, 5, 0, 1, 2]
    return gtsam.noiseModel.Gaussian.Covariance(matrix[np.ix_(order, order)])


def solve_plainly(text, noise):
    """Positions and cost of a GTSAM graph of the lines."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    key = lambda name: gtsam.symbol(name[0], int(name[1:]))
    for word, *f in (line.split() for line in text.splitlines()):
        if word == "VERTEX_SE3:QUAT":
            values.insert(key(f[1]), pose(f[2:]))
        elif word == "VERTEX_XYZ":
            values.insert(key(f[0]), np.array(f[1:], dtype=float))
        elif word == "VERTEX_SE3:QUAT:PRIOR":
            graph.addPriorPose3(key(f[1]), pose(f[2:9]), noise(np.array(f[9:], dtype=float)))
        elif word == "VERTEX_XYZ:PRIOR":
            variance = np.array(f[5:], dtype=float)[[0, 3, 5]].mean()
            graph.addPriorPoint3(
                key(f[1]),
                np.array(f[2:5], dtype=float),
                gtsam.noiseModel.Isotropic.Variance(3, variance),
            )
        elif word == "EDGE_SE3:QUAT":
            model = noise(np.array(f[10:], dtype=float))
            graph.add(gtsam.BetweenFactorPose3(key(f[1]), key(f[2]), pose(f[3:10]), model))
        else:
            model = gtsam.noiseModel.Isotropic.Variance(1, float(f[4]))
            factor = gtsam.RangeFactor3D if f[2][0] == "L" else gtsam.RangeFactorPose3
            graph.add(factor(key(f[1]), key(f[2]), float(f[3]), model))
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(1e-15)
    settings.setAbsoluteErrorTol(1e-15)
    solution = gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
    names = [line.split()[2] for line in text.splitlines() if line.startswith("VERTEX_SE3:QUAT ")]
    positions = np.array([solution.atPose3(key(name)).translation() for name in names])
    return positions, graph.error(solution)


@pytest.fixture
def file(tmp_path):
    fleet = make_fleet(seed=4, n_landmarks=2, gnss_every=6)
    path = tmp_path / "graph.pyfg"
    graph = build_graph(fleet.noisy, "straight")
    write_pyfg(graph, path, initial=fleet.truth)
    return path, graph, fleet.truth


def test_isotropic_covariances_give_the_estimate_by_its_rules(file):
    path, graph, truth = file
    # without fixes, because GTSAM's prior of a pose without rotation is not one of its position
    write_pyfg(graph.with_factors(fix=graph["fix"][:0]), path, initial=truth)
    content = open_graph(path, covariances="isotropic")
    expected, _ = solve_plainly(path.read_text(), noise)
    ours = solve_graph(content, start="file").values.position
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-3)
    full = solve_graph(open_graph(path), start="file").values.position
    assert np.abs(ours - full).max() > 0.1  # the option matters
    assert not content.left_out


def test_a_fix_has_the_mean_variance_on_each_axis(tmp_path):
    """GNSS of 0.1, 0.1 and 0.0033 m becomes 0.082 m."""
    text = (
        "VERTEX_SE3:QUAT 0 A0 0 0 0 0 0 0 1\n"
        "VERTEX_SE3:QUAT:PRIOR 0 A0 0 0 0 0 0 0 1"
        f" 0.01 0.001 0 0 0 0 0.01 0 0 0 0 {0.0033**2} 0 0 0 1e-4 0 0 2e-4 0 3e-4\n"
    )
    (tmp_path / "g.pyfg").write_text(text)
    covariance = (
        open_graph(tmp_path / "g.pyfg", covariances="isotropic").graph["prior"].covariance[0]
    )
    sigma = np.sqrt((2.0 * 0.1**2 + 0.0033**2) / 3.0)
    assert sigma == pytest.approx(0.082, abs=5e-4)
    np.testing.assert_allclose(covariance, np.diag([2e-4] * 3 + [sigma**2] * 3), rtol=1e-12, atol=0)
    line = "covariances 'round'; allowed: full, isotropic"
    refused(EstimationError, line, open_graph, tmp_path / "g.pyfg", covariances="round")


def test_planar_rotations_stay_and_translations_are_averaged(tmp_path):
    (tmp_path / "g.pyfg").write_text(
        "VERTEX_SE2 0 A0 0 0 0\nVERTEX_SE2:PRIOR 0 A0 0 0 0 0.01 0.004 0 0.03 0 0.0005\n"
    )
    variance = open_graph(tmp_path / "g.pyfg", covariances="isotropic").graph["prior"].variance[0]
    assert variance[[2, 3, 4]] == pytest.approx([0.0005, 0.02, 0.02])


@pytest.mark.parametrize("gnss_every", [0, 6])
def test_a_plain_reader_solves_to_the_same_optimum(tmp_path, gnss_every):
    """GTSAM with `PriorFactorPose3` for each pose prior; depths on tilted bodies, km from it."""
    fleet = make_fleet(seed=4, n_landmarks=2, gnss_every=gnss_every)
    graph = build_graph(fleet.noisy, "straight")
    fixes = graph["fix"]  # three times as precise in depth as across
    graph = graph.with_factors(
        fix=replace(fixes, covariance=fixes.covariance * np.diag([1.0, 1.0, 0.1]))
    )
    write_pyfg(graph, tmp_path / "g.pyfg", initial=fleet.truth)
    lines = (tmp_path / "g.pyfg").read_text()
    position, cost = solve_plainly(lines, full_noise)
    ours = GraphSolver().solve(graph, fleet.truth)
    assert cost == pytest.approx(ours.final_cost, rel=1e-4)
    np.testing.assert_allclose(position, ours.position, rtol=0, atol=5e-3)


@pytest.mark.parametrize("place", ["last", "first"])
def test_depths_come_back_from_ranges(file, place):
    path, graph, truth = file
    if place == "first":  # the landmark above, in a file of another program
        lines = path.read_text().splitlines()
        above = next(line for line in lines if line.startswith("VERTEX_XYZ L2 "))
        path.write_text("\n".join([above, *(line for line in lines if line != above)]) + "\n")
    back, values = read_pyfg(path)
    np.testing.assert_allclose(
        back["depth"].measurement, graph["depth"].measurement, rtol=0, atol=1e-7
    )
    np.testing.assert_array_equal(back["depth"].covariance, graph["depth"].covariance)
    np.testing.assert_array_equal(back["range"].variables, graph["range"].variables)
    np.testing.assert_array_equal(values.landmark_position, truth.landmark_position)
    assert load_pyfg(path).depths_from_above == len(graph["depth"])
    # another factor of that landmark: it is a landmark like others
    lines = [*path.read_text().splitlines(), "EDGE_RANGE 0 L0 L2 5e8 1"]
    path.write_text("\n".join(lines) + "\n")
    back, values = read_pyfg(path)
    assert len(back["depth"]) == 0
    assert len(values.landmark_position) == 3
    assert len(back["range"]) == len(graph["range"]) + len(graph["depth"]) + 1


def test_a_range_shorter_than_the_horizontal_distance_is_no_depth(file):
    path, graph, _ = file
    lines = path.read_text().splitlines()
    row = next(
        k for k, line in enumerate(lines) if line.startswith("EDGE_RANGE") and "50000" in line
    )
    lines[row] = " ".join([*lines[row].split()[:4], "1e-3", "1"])
    path.write_text("\n".join(lines) + "\n")
    back, _ = read_pyfg(path)
    assert len(back["depth"]) == 0
    assert len(back["range"]) == len(graph["range"]) + len(graph["depth"])


def test_isotropic_covariances_lose_depth_priors_alone(file):
    path, graph, _ = file
    assert len(open_graph(path, covariances="isotropic").graph["depth"]) == len(graph["depth"])
