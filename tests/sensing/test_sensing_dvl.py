"""Velocities over ground: truth, reach, noise, bias and beams, and what a graph makes of them."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused
from scipy.stats import binom

from pymantaray.errors import SensingError
from pymantaray.estimation import GraphSolver, build_graph
from pymantaray.estimation.graph.graph import GraphValues
from pymantaray.estimation.graph.pyfg import read_pyfg, write_pyfg
from pymantaray.geometry import stream
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import Measurements, RangingTruth
from pymantaray.sensing import NoiseModel, Ranging, assemble, perturb
from pymantaray.sensing.dvl import three_beam_factor
from pymantaray.sensing.schedule import Attempts

SIGMA = 0.004
EDGES = 12


@pytest.fixture(scope="module")
def fleet(make_truth):
    return make_truth("AB")


def measured(truth, altitude=0.0, dvl_sigma=SIGMA, **levels):
    nothing = np.empty(0, dtype=int)
    ranging = Ranging(
        Attempts(nothing, nothing, nothing),
        nothing.astype(np.int8),
        RangingTruth(*np.empty((4, 0))),
        links=None,
        arrivals=None,
        receptions=None,
        link=nothing,
    )
    return assemble(
        truth, [], ranging, NoiseModel(dvl_sigma=dvl_sigma, **levels), altitude=altitude
    )


def test_velocities_turned_to_the_world_add_up_to_the_true_way(fleet):
    m = measured(fleet)
    assert m.dvl_vehicle.size == 2 * EDGES
    rotation = matrix_from_quaternion(fleet.quaternion[m.dvl_vehicle, m.dvl_sample])
    step = np.einsum("nij,nj->ni", rotation, m.dvl_velocity) * 200.0
    for k in range(2):
        way = fleet.position[k, 0] + np.cumsum(step[m.dvl_vehicle == k], axis=0)
        np.testing.assert_allclose(way, fleet.position[k, 1:], rtol=0, atol=1e-9)


def test_there_is_no_sensor_without_a_level_and_no_velocity_far_away(fleet):
    m = measured(fleet)
    assert measured(fleet, dvl_reach=30.0, altitude=31.0).dvl_vehicle.size == 0
    altitude = np.full(fleet.status.shape, 10.0)
    altitude[1, 5] = 500.0
    some = measured(fleet, altitude)
    gone = (m.dvl_vehicle == 1) & np.isin(m.dvl_sample, (4, 5))
    np.testing.assert_array_equal(some.dvl_velocity, m.dvl_velocity[~gone])
    without = measured(fleet, dvl_sigma=0.0)
    assert without.dvl_vehicle.size == 0
    assert perturb(without, root_seed=1, realization=0).dvl_vehicle.size == 0


def test_noise_and_bias_are_draws_of_their_own_streams(fleet):
    m = measured(fleet, dvl_bias_sigma=0.01)
    noisy = perturb(m, root_seed=3, realization=2)
    for k, name in enumerate("AB"):
        noise = stream(3, 2, "sensing", name, "dvl").standard_normal((EDGES, 3)) * SIGMA
        bias = stream(3, 2, "sensing", name, "dvl bias").standard_normal(3) * 0.01
        off = (noisy.dvl_velocity - m.dvl_velocity)[m.dvl_vehicle == k]
        np.testing.assert_allclose(off, noise + bias, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(noisy.dvl_sigma, m.dvl_sigma)


def test_lost_beams_remove_velocities_and_precision_at_random(make_truth):
    """
    Of four beams at least three are left with the binomial probability; of three, one axis is
    weaker by geometry.
    """
    loss, edges = 0.2, 4000
    m = measured(make_truth("AB", n_time=edges + 1), dvl_beam_loss=loss)
    noisy = perturb(m, root_seed=5, realization=0)
    n, p = 2 * edges, binom(4, 1.0 - loss)
    three, four = p.pmf(3), p.pmf(4)
    kept = noisy.dvl_vehicle.size / n
    assert kept == pytest.approx(three + four, abs=4.0 * np.sqrt(kept * (1 - kept) / n))
    wide = noisy.dvl_sigma[:, 0] > SIGMA
    assert wide.sum() / n == pytest.approx(three, abs=4.0 * np.sqrt(three * (1 - three) / n))
    np.testing.assert_allclose(
        noisy.dvl_sigma[wide], SIGMA * np.tile(three_beam_factor(), (wide.sum(), 1))
    )
    row = noisy.dvl_vehicle * edges + noisy.dvl_sample
    whitened = (noisy.dvl_velocity - m.dvl_velocity[row]) / noisy.dvl_sigma
    assert np.std(whitened, axis=0) == pytest.approx(1.0, abs=0.05)


def test_three_beams_by_simulated_least_squares():
    """
    Radial velocities with independent noise, solved for the velocity; the first of four beams at 45
    degrees is lost.
    """
    azimuth, tilt = np.radians([45.0, 135.0, 225.0, 315.0]), np.radians(30.0)
    beams = np.array(
        [[np.sin(tilt) * np.cos(a), np.sin(tilt) * np.sin(a), np.cos(tilt)] for a in azimuth]
    )
    noise = np.random.default_rng(7).standard_normal((4, 40000))
    spread = [
        np.std(np.linalg.lstsq(b, n, rcond=None)[0], axis=1)
        for b, n in ((beams[1:], noise[1:]), (beams, noise))
    ]
    np.testing.assert_allclose(three_beam_factor(), spread[0] / spread[1], rtol=0.02)


def test_a_graph_weights_velocities_and_odometry_by_variance(fleet):
    """
    With rotations known, each axis of each stride is the mean of both, weighted by precision; so is
    its variance.
    """
    still = replace(fleet, quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (*fleet.status.shape, 1)))
    levels = {
        "odometry_rotation_drift": 1e-12,
        "odometry_rotation_fraction": 0.0,
        "first_rotation_sigma": 1e-9,
    }
    m = measured(still, **levels, depth_sigma=1e4, odometry_translation_drift=0.005)
    m = replace(m, odometry_sigma=np.tile([1e-9] * 3 + [1.0] * 3, (2, EDGES, 1)))
    off = replace(m, dvl_velocity=m.dvl_velocity + np.array([0.01, -0.02, 0.03]))
    start = GraphValues(
        position=still.position.reshape(-1, 3),
        quaternion=still.quaternion.reshape(-1, 4),
        landmark_position=np.empty((0, 3)),
    )
    solution = GraphSolver().solve(build_graph(off), start, model_is_right=False)
    dvl, odometry = 1.0 / (200.0 * SIGMA) ** 2, 1.0
    share = dvl / (dvl + odometry)
    moved = (solution.position - start.position).reshape(2, -1, 3)
    expected = share * 200.0 * np.array([0.01, -0.02, 0.03])
    np.testing.assert_allclose(
        np.diff(moved, axis=1), np.broadcast_to(expected, (2, EDGES, 3)), atol=1e-5
    )


def test_graph_files_keep_velocities_beside_odometry(fleet, tmp_path):
    graph = build_graph(perturb(measured(fleet, dvl_beam_loss=0.1), root_seed=1, realization=0))
    values = GraphValues(
        position=fleet.position.reshape(-1, 3),
        quaternion=fleet.quaternion.reshape(-1, 4),
        landmark_position=np.empty((0, 3)),
    )
    write_pyfg(graph, tmp_path / "graph.pyfg", initial=values)
    again, _ = read_pyfg(tmp_path / "graph.pyfg")
    assert 0 < len(graph["dvl"]) <= len(graph["edge"])
    for name in ("dvl", "edge"):
        for part in ("variables", "measurement", "covariance"):
            np.testing.assert_array_equal(getattr(again[name], part), getattr(graph[name], part))


def test_older_files_without_the_sensor_are_read(fleet, tmp_path):
    data = measured(fleet).to_dataset()
    older = data.drop_vars([name for name in data.variables if str(name).startswith("dvl_")])
    older.to_netcdf(tmp_path / "old.nc")
    assert Measurements.load(tmp_path / "old.nc").dvl_velocity.shape == (0, 3)


def test_levels_that_make_no_sensor_are_refused():
    refused(
        SensingError,
        r"dvl_beam_loss is 1\.5; it is a probability",
        NoiseModel,
        dvl_sigma=0.01,
        dvl_beam_loss=1.5,
    )
    refused(
        SensingError, "without a sensor; set dvl_sigma above zero", NoiseModel, dvl_bias_sigma=0.01
    )
