"""Noise-free odometry, depth and GNSS, and the noise levels they are believed to have."""

from dataclasses import fields

import numpy as np
import pytest

from pymantaray.errors import SensingError
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, so3_exp
from pymantaray.sensing import NoiseModel, depth, gnss, odometry
from pymantaray.sensing.sensor import Scene


def seen(sensor, truth, gnss_depth=1.0):
    return sensor.measure(Scene(truth, [], gnss_depth), NoiseModel())


def test_composed_odometry_gives_the_truth_back(make_truth):
    """2,000 edges of a tumbling walk over kilometres, within a nanometre."""
    truth = make_truth(n_time=2001)
    rotation, translation, _ = seen(odometry, truth).values()
    assert rotation.shape == (3, 2000, 4)
    for agent in range(3):
        place, turned = truth.position[agent, 0], matrix_from_quaternion(truth.quaternion[agent, 0])
        for edge in range(2000):
            place = place + turned @ translation[agent, edge]
            turned = turned @ matrix_from_quaternion(rotation[agent, edge])
            np.testing.assert_allclose(place, truth.position[agent, edge + 1], rtol=0, atol=1e-9)
        last = matrix_from_quaternion(truth.quaternion[agent, -1])
        np.testing.assert_allclose(turned, last, rtol=0, atol=1e-12)


def test_odometry_is_in_the_body_frame(make_truth):
    """Turning the whole world leaves what a vehicle feels as it is."""
    truth = make_truth()
    turn = so3_exp([0.3, -0.5, 1.0])
    turned = type(truth)(
        name=truth.name,
        role=truth.role,
        time=truth.time,
        position=truth.position @ turn.T + [10.0, 20.0, 30.0],
        quaternion=quaternion_from_matrix(turn @ matrix_from_quaternion(truth.quaternion)),
        status=truth.status,
    )
    for one, two in zip(*(seen(odometry, t).values() for t in (truth, turned)), strict=True):
        np.testing.assert_allclose(one, two, rtol=0, atol=1e-11)


def test_depth_is_the_third_coordinate(make_truth):
    truth = make_truth()
    np.testing.assert_array_equal(seen(depth, truth)["depth"], truth.position[..., 2])


def test_gnss_fixes_exactly_while_shallow(make_truth):
    truth = make_truth()
    position = truth.position.copy()
    position[0, 3:6, 2] = [0.0, 0.999, 1.0]
    position[2, -1, 2] = 0.5
    truth = type(truth)(truth.name, truth.role, truth.time, position, truth.quaternion, truth.status)
    fixes = seen(gnss, truth)
    agent, sample = fixes["gnss_agent"], fixes["gnss_sample"]
    assert list(zip(agent, sample, strict=True)) == [(0, 3), (0, 4), (2, 12)]
    np.testing.assert_array_equal(fixes["gnss_position"], position[agent, sample])
    assert seen(gnss, truth, 0.0)["gnss_agent"].size == 0
    with pytest.raises(SensingError, match="gnss_depth is -1 m; it must be zero or positive"):
        seen(gnss, truth, -1.0)


def test_composite_sigma_by_hand():
    """An edge of length 3-4-12 -> 13 m with a turn of 0.2 rad in 200 s, then one at rest for 100 s."""
    rotation = quaternion_from_matrix(so3_exp([[0.0, 0.0, 0.2], [0.0, 0.0, 0.0]]))
    sigma = NoiseModel().odometry_sigma(rotation, [[3.0, 4.0, 12.0], [0.0, 0.0, 0.0]], [0.0, 200.0, 300.0])
    turn = np.sqrt((1e-6 * 0.2) ** 2 + (5e-7 * 200) ** 2)
    xy = np.sqrt((0.05 * 13) ** 2 + (0.0125 * 200) ** 2)
    z = np.sqrt((0.001 * 13) ** 2 + (0.0125 * 200) ** 2)
    expected = [[turn, turn, turn, xy, xy, z], [5e-5, 5e-5, 5e-5, 1.25, 1.25, 1.25]]
    np.testing.assert_allclose(sigma, expected, rtol=1e-12)


def test_fractions_and_drifts_act_alone():
    rotation = quaternion_from_matrix(so3_exp([[0.3, 0.0, 0.4]]))
    still = {"odometry_rotation_drift": 0.0, "odometry_translation_drift": 0.0}
    noise = NoiseModel(odometry_rotation_fraction=0.1, **still)
    sigma = noise.odometry_sigma(rotation, [[0.0, 6.0, 8.0]], [0.0, 200.0])
    np.testing.assert_allclose(sigma, [[0.05, 0.05, 0.05, 0.5, 0.5, 0.01]], rtol=1e-12)


def test_defaults_are_the_papers_table():
    noise = NoiseModel()
    assert (noise.range_sigma, noise.depth_sigma, noise.gnss_sigma) == (1.0, 0.01, 0.10)
    assert (noise.odometry_rotation_fraction, noise.odometry_rotation_drift) == (1e-6, 5e-7)
    assert (noise.odometry_xy_fraction, noise.odometry_z_fraction) == (0.05, 0.001)
    assert noise.odometry_translation_drift == 0.0125


@pytest.mark.parametrize("name", [f.name for f in fields(NoiseModel)])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_impossible_noise_is_refused_in_one_line(name, value):
    with pytest.raises(SensingError, match=f"NoiseModel: {name} is .* finite and zero or positive") as error:
        NoiseModel(**{name: value})
    assert "\n" not in str(error.value)
