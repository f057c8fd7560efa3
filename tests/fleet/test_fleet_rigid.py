"""Vehicles that turn: helices in closed form, waypoints, limits, and poses on the group."""

import numpy as np
import pytest

from pymantaray.fleet import ConstantTwist, Vehicle, Waypoints
from pymantaray.geometry.se3 import matrix_from_quaternion, se3_exp, so3_exp, so3_log
from pymantaray.records import VehicleStatus

TWISTS = [
    (0, 0, 0, 1.0, 0.2, 0.05),
    (0, 0, 0.01, 1.0, 0, 0.05),
    (0.02, -0.01, 0.03, 0.5, 0.4, -0.2),
    (1e-8, 0, 1e-8, 1.0, 0, 0),
]


@pytest.mark.parametrize("twist", TWISTS)
@pytest.mark.parametrize("physics_step", [0.125, 1.0, 50.0])
def test_constant_twist_is_a_helix_whatever_the_step(run, twist, physics_step):
    vehicle = Vehicle("T", (0.0, 0.0, 500.0), ConstantTwist(twist), heading=0.7)
    truth = run(vehicle, duration=1000.0, physics_step=physics_step)
    assert (truth.status == VehicleStatus.ACTIVE).all()
    start = so3_exp([0.0, 0.0, 0.7])
    rotation, moved = se3_exp(np.multiply.outer(truth.time, twist))
    expected = np.array([0.0, 0.0, 500.0]) + moved @ start.T
    np.testing.assert_allclose(truth.position[0], expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(
        matrix_from_quaternion(truth.quaternion[0]), start @ rotation, rtol=0, atol=1e-11
    )


def test_poses_stay_on_the_group_over_a_long_run(run):
    truth = run(
        Vehicle("T", (0, 0, 500.0), ConstantTwist((0.3, -0.2, 0.1, 1, 0, 0))),
        duration=50_000.0,
        physics_step=0.125,
        sampling_period=500.0,
    )
    np.testing.assert_allclose(np.linalg.norm(truth.quaternion, axis=-1), 1.0, rtol=0, atol=1e-14)


def test_a_rising_twist_is_held_at_the_surface(run):
    truth = run(Vehicle("T", (0, 0, 10.0), ConstantTwist((0, 0, 0, 1.0, 0, -0.5))), duration=100.0)
    np.testing.assert_array_equal(truth.position[0, :, 2], [10.0, 0.0, 0.0])
    np.testing.assert_allclose(truth.position[0, :, 0], [0.0, 50.0, 100.0], rtol=0, atol=1e-9)
    assert (truth.status == VehicleStatus.ACTIVE).all()


SQUARE = np.array([(500.0, 0, 100.0), (500.0, 500.0, 150.0), (0, 500.0, 60.0), (0, -100.0, 30.0)])


@pytest.fixture(scope="module")
def swim(run):
    def swim_square(**changed):
        parameters = {
            "points": SQUARE,
            "speed": 1.5,
            "turn_rate": 0.1,
            "capture_radius": 20.0,
        } | changed
        vehicle = Vehicle("W", (0.0, 0.0, 50.0), Waypoints(**parameters), heading=2.0)
        return run(vehicle, duration=4000.0, physics_step=0.125, sampling_period=0.125)

    return swim_square


def test_swimmer_reaches_its_points_in_order_and_stops_at_the_last(swim):
    truth = swim()
    away = np.linalg.norm(truth.position[0, :, None] - SQUARE, axis=-1)
    reached = [np.flatnonzero(away[:, k] <= 20.0)[0] for k in range(4)]
    assert (np.diff(reached) > 0).all()
    moving = np.linalg.norm(np.diff(truth.position[0], axis=0), axis=-1) > 0.0
    np.testing.assert_array_equal(np.flatnonzero(moving), np.arange(reached[-1]))
    assert (truth.status == VehicleStatus.ACTIVE).all()


def test_looping_swimmer_comes_back_to_the_first_point(swim):
    truth = swim(loop=True)
    near = np.linalg.norm(truth.position[0] - SQUARE[0], axis=-1) <= 20.0
    visits = np.count_nonzero(near[1:] & ~near[:-1])
    leg = np.linalg.norm(np.diff(SQUARE, axis=0, append=SQUARE[:1]), axis=-1).sum()
    assert visits in (int(4000 * 1.5 / leg), int(4000 * 1.5 / leg) + 1)
    assert (np.linalg.norm(np.diff(truth.position[0, -100:], axis=0), axis=-1) > 0.0).all()


def test_swimmer_keeps_its_speed_along_body_x_and_its_turn_rate(swim):
    truth = swim(loop=True)
    rotation = matrix_from_quaternion(truth.quaternion[0])
    turn = so3_log(np.swapaxes(rotation[:-1], -1, -2) @ rotation[1:])
    rate = np.linalg.norm(turn, axis=-1) / 0.125
    assert rate.max() <= 0.1 * (1 + 1e-7)
    assert rate.max() > 0.0999
    assert np.abs(turn[:, 0]).max() < 1e-9  # never about body x
    forward = 0.5 * (rotation[:-1, :, 0] + rotation[1:, :, 0])
    chord = np.diff(truth.position[0], axis=0) / (1.5 * 0.125)
    np.testing.assert_allclose(
        chord, forward, rtol=0, atol=2e-5
    )  # arc of 0.0125 rad: 1 - cos of it


def test_swimmer_with_its_goal_dead_astern_turns_round(run):
    vehicle = Vehicle("W", (0, 0, 50.0), Waypoints([(-300.0, 0, 50.0)], 1.0, 0.1), heading=0.0)
    truth = run(vehicle, duration=1000.0)
    assert np.linalg.norm(truth.position[0, -1] - [-300.0, 0.0, 50.0]) <= 20.0
