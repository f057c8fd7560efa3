"""
Attitudes by a heading reference, from their noise to the heading that a graph gives, its covariance
and its file.
"""

from dataclasses import fields, replace

import numpy as np
import pytest
from factories import assert_same, estimates
from scipy import stats

from pymantaray.errors import SensingError
from pymantaray.estimation import (
    GraphSolver,
    GraphValues,
    build_graph,
    covariances_at,
    read_pyfg,
    write_pyfg,
)
from pymantaray.evaluation import attitude_table
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, so3_exp, so3_log
from pymantaray.records import SolveStatus
from pymantaray.sensing import NoiseModel, perturb

TILT, HEADING, STEP = (
    0.01,
    0.03,
    0.02,
)  # rad; of the attitude and of odometry from a sample to the next
BAD_ODOMETRY = {"odometry_rotation_drift": STEP / 200.0, "odometry_rotation_fraction": 0.0}
AHRS = NoiseModel(attitude_tilt_sigma=TILT, attitude_heading_sigma=HEADING, **BAD_ODOMETRY)
EPOCHS = np.array([15, 25, 35, 45])  # further apart than headings are correlated


def turn_between(one, other):
    """Rotation vectors in the world's axes that lead from one attitude to the other. [rad]"""
    one, other = matrix_from_quaternion(one), matrix_from_quaternion(other)
    return so3_log(other @ np.swapaxes(one, -1, -2))


def assert_variance(values, expected):
    """Within the two-sided 1e-3 bounds of independent normal values."""
    low, high = stats.chi2.ppf([5e-4, 1 - 5e-4], values.size) / values.size
    assert low < np.mean(values**2) / expected < high


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth("AB", n_time=61)


@pytest.fixture(scope="module")
def measured(make_measurements):
    def make(noise=AHRS, **options):
        return make_measurements("AB", n_time=61, noise=noise, **options)

    return make


def solved(m, truth):
    graph = build_graph(m)
    start = GraphValues(
        truth.position.reshape(-1, 3), truth.quaternion.reshape(-1, 4), m.landmark_position
    )
    solution = GraphSolver().solve(graph, start)
    assert solution.usable
    poses = np.arange(truth.status.size).reshape(truth.status.shape)[:, EPOCHS].T
    covariance = covariances_at(graph, solution.values, poses).pose[..., :3, :3]
    body = matrix_from_quaternion(solution.values.quaternion[poses])
    found = solution.values.quaternion[poses]
    error = turn_between(found, np.swapaxes(truth.quaternion[:, EPOCHS], 0, 1))
    return error, body @ covariance @ np.swapaxes(body, -1, -2)  # both in the world's axes


def test_without_levels_there_is_no_sensor_and_no_draw_moves(measured):
    off, on = measured(NoiseModel(**BAD_ODOMETRY)), measured()
    assert off.attitude_vehicle.size == 0
    assert on.attitude_vehicle.size == 2 * 61
    noisy = [perturb(m, root_seed=1, realization=0) for m in (off, on)]
    assert_same(*noisy, but=[f.name for f in fields(off) if f.name.startswith("attitude")])
    assert "attitude" not in {
        name for name, table in build_graph(off).factors.items() if len(table)
    }


def test_noise_is_about_world_axes_and_each_vehicle_has_a_bias(measured):
    clean = measured(replace(AHRS, attitude_heading_bias_sigma=0.5))
    n = 60
    turns = np.stack(
        [
            turn_between(
                clean.attitude_quaternion,
                perturb(clean, root_seed=4, realization=r).attitude_quaternion,
            ).reshape(2, 61, 3)
            for r in range(n)
        ]
    )
    bias = turns[..., 2].mean(axis=2)
    assert_variance(bias, 0.5**2 + HEADING**2 / 61)
    assert np.unique(bias).size == bias.size
    for axis in range(2):
        assert_variance(turns[..., axis], TILT**2)
    assert_variance(turns[..., 2] - bias[..., None], HEADING**2 * 60 / 61)


def test_heading_is_as_good_as_theory_says(measured, truth):
    """
    A random walk of step q, seen at each sample with sigma h: sigma h (1 + 4 h² / q²)^(-1/4) far
    from both ends.

    Without the sensor the walk's variance grows by q² a sample from the first pose on.
    """
    with_it, without = (
        solved(perturb(measured(noise), root_seed=2, realization=0), truth)[1]
        for noise in (AHRS, NoiseModel(**BAD_ODOMETRY))
    )
    theory = HEADING * (1.0 + 4.0 * HEADING**2 / STEP**2) ** -0.25
    np.testing.assert_allclose(np.sqrt(with_it[..., 2, 2]), theory, rtol=0.01)
    grown = STEP * np.sqrt(EPOCHS)[:, None]
    np.testing.assert_allclose(
        np.sqrt(without[..., 2, 2]), np.broadcast_to(grown, without.shape[:2]), rtol=0.05
    )


def nees(m, truth, realizations=12):
    """Sum of the rotations' squared errors in their covariances, and how many numbers that is."""
    total = 0.0
    for r in range(realizations):
        error, covariance = solved(perturb(m, root_seed=7, realization=r), truth)
        total += float(np.einsum("eai,eaij,eaj->", error, np.linalg.inv(covariance), error))
    return total, realizations * EPOCHS.size * 2 * 3


def test_errors_are_consistent_without_a_bias_and_a_bias_shows(measured, truth):
    squared, n = nees(measured(), truth)
    low, high = stats.chi2.ppf([5e-4, 1 - 5e-4], n)
    assert low < squared < high
    biased, _ = nees(measured(replace(AHRS, attitude_heading_bias_sigma=2 * HEADING)), truth)
    assert biased > 2.0 * high


def test_a_graph_file_gives_attitudes_back_as_such(measured, truth, tmp_path):
    graph = build_graph(perturb(measured(gnss_depth=1e9), root_seed=3, realization=0))
    start = GraphValues(
        truth.position.reshape(-1, 3), truth.quaternion.reshape(-1, 4), np.zeros((2, 3))
    )
    write_pyfg(graph, tmp_path / "g.pyfg", initial=start)
    again, _ = read_pyfg(tmp_path / "g.pyfg")
    for name, table in graph.factors.items():
        np.testing.assert_array_equal(again[name].variables, table.variables, err_msg=name)
        np.testing.assert_allclose(
            again[name].measurement,
            table.measurement,
            rtol=1e-15,
            atol=1e-7 if name == "depth" else 1e-15,
        )
        np.testing.assert_array_equal(again[name].covariance, table.covariance)
    assert len(again["attitude"]) == 2 * 61


def test_the_reports_table_tells_tilt_from_heading(truth):
    turned = so3_exp([0.0, 0.01, -0.03]) @ matrix_from_quaternion(truth.quaternion)
    quaternion = quaternion_from_matrix(turned)[None, None]
    found = estimates(truth, truth.position[None, None], ["straight"], quaternion=quaternion)
    table = attitude_table(truth, found)
    assert table["tilt_rmse_deg"].item() == pytest.approx(np.degrees(0.01 / np.sqrt(2.0)), rel=1e-4)
    assert table["heading_rmse_deg"].item() == pytest.approx(np.degrees(0.03), rel=1e-4)
    lost = replace(found, solve_status=np.full((1, 1), SolveStatus.FAILED))
    assert attitude_table(truth, lost)[["tilt_rmse_deg", "heading_rmse_deg"]].isna().all(axis=None)


@pytest.mark.parametrize("levels", [(0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01)])
def test_half_a_sensor_is_refused(levels):
    names = ("attitude_tilt_sigma", "attitude_heading_sigma", "attitude_heading_bias_sigma")
    with pytest.raises(SensingError, match="a sensor needs tilt and heading above zero"):
        NoiseModel(**dict(zip(names, levels, strict=True)))
