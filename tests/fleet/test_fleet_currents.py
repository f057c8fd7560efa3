"""Vehicles that the current carries: swimmers that steer through moving water, and buoys."""

import numpy as np
import pytest
from factories import over_time
from refusals import refused

from pymantaray.acoustics import Currents
from pymantaray.errors import FleetError
from pymantaray.fleet import ConstantTwist, Drifting, Vehicle, Waypoints
from pymantaray.geometry.se3 import matrix_from_quaternion, se3_exp, so3_exp
from pymantaray.records import VehicleStatus

POINTS = np.array([(800.0, 0.0, 60.0), (800.0, 900.0, 40.0), (-300.0, 500.0, 80.0)])


def swimmer(
    start,
    points,
    speed=1.5,
    turn_rate=10.0,
    capture_radius=1.0,
    *,
    heading=0.0,
    current=True,
    loop=False,
):
    course = Waypoints(
        points, speed, turn_rate, capture_radius=capture_radius, loop=loop, current=current
    )  # fmt: skip
    return Vehicle("W", start, course, heading=heading)


def test_in_still_water_nothing_changes_to_the_last_digit(run):
    twist = (0.001, 0.002, 0.003, 1.0, 0.1, 0.0)
    for one, other in (
        (ConstantTwist(twist), ConstantTwist(twist, current=True)),
        (Waypoints(POINTS, 1.5, 0.1), Waypoints(POINTS, 1.5, 0.1, current=True)),
        (
            Waypoints(POINTS, 1.5, 0.1, loop=True),
            Waypoints(POINTS, 1.5, 0.1, loop=True, current=True),
        ),
    ):
        a, b = (
            run(Vehicle("V", (0.0, 0.0, 50.0), behaviour, heading=2.0))
            for behaviour in (one, other)
        )
        np.testing.assert_array_equal(a.position, b.position)
        np.testing.assert_array_equal(a.quaternion, b.quaternion)


def test_a_uniform_current_adds_its_way_to_a_helix(run, make_ocean):
    twist = np.array([0.02, -0.01, 0.03, 0.5, 0.4, -0.2])
    vehicle = Vehicle("T", (0.0, 0.0, 500.0), ConstantTwist(twist, current=True), heading=0.7)
    truth = run(vehicle, water=make_ocean(uniform=(0.6, -0.3)))
    start = so3_exp([0.0, 0.0, 0.7])
    rotation, moved = se3_exp(np.multiply.outer(truth.time, twist))
    expected = [0.0, 0.0, 500.0] + moved @ start.T + truth.time[:, None] * [0.6, -0.3, 0.0]
    np.testing.assert_allclose(truth.position[0], expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(
        matrix_from_quaternion(truth.quaternion[0]), start @ rotation, atol=1e-10
    )


@pytest.mark.parametrize("share", [0.2, 0.6, 0.9])
def test_a_swimmer_across_a_current_follows_the_curve_of_pursuit(run, make_ocean, share):
    """
    y = d/2 ((x/d)^(1-k) - (x/d)^(1+k)), k the current by the speed; there after d v / (v² - u²).
    """
    away, speed, dt = 1000.0, 1.5, 0.125
    vehicle = swimmer((-away, 0.0, 50.0), [(0.0, 0.0, 50.0)])
    water = make_ocean(uniform=(0.0, share * speed))
    truth = run(vehicle, water=water, duration=6000.0, physics_step=dt, sampling_period=dt)
    place, time = truth.position[0], truth.time
    there = int(np.argmax(np.linalg.norm(place - [0.0, 0.0, 50.0], axis=-1) <= 1.0))
    left = -place[:there, 0] / away
    left = left[left > 0.02]  # later the curve has no slope
    aside = 0.5 * away * (left ** (1.0 - share) - left ** (1.0 + share))
    np.testing.assert_allclose(
        place[: left.size, 1], aside, rtol=0, atol=0.3
    )  # the aim lags by half a step
    arrival = away * speed / (speed**2 - (share * speed) ** 2)
    assert time[there] == pytest.approx(arrival, abs=2.0 / (speed * (1.0 - share)))
    speed_through_water = np.diff(place[:there], axis=0) / dt - [0.0, share * speed, 0.0]
    np.testing.assert_allclose(np.linalg.norm(speed_through_water, axis=-1), speed, rtol=1e-2)
    # beyond its last point it drifts
    drift = np.diff(place[there + 1 :], axis=0) / dt
    np.testing.assert_allclose(
        drift, np.broadcast_to([0.0, share * speed, 0.0], drift.shape), atol=1e-9
    )


def test_points_are_reached_in_a_current_slower_than_the_swimmer(run, make_ocean):
    rng = np.random.default_rng(4)
    water = make_ocean(uniform=(0.9, -0.6))  # 1.08 of 1.5 m/s
    for _ in range(25):
        start = np.array([*rng.uniform(-1000.0, 1000.0, 2), 50.0])
        points = start + rng.uniform(-60.0, 60.0, (3, 3)) * [1.0, 1.0, 0.5]
        vehicle = swimmer(
            start, points, turn_rate=0.1, capture_radius=15.0, heading=rng.uniform(-3.0, 3.0)
        )
        truth = run(
            vehicle, water=water, duration=2000.0, physics_step=0.125, sampling_period=0.125
        )
        away = np.linalg.norm(truth.position[0, :, None] - points, axis=-1) <= 15.0
        first = np.argmax(away[:, 0])
        second = first + np.argmax(away[first:, 1])
        assert away[first, 0]
        assert away[second, 1]
        assert away[second:, 2].any()


def test_a_current_faster_than_the_swimmer_carries_it_off_head_on(run, make_ocean):
    vehicle = swimmer((0.0, -500.0, 50.0), [(0.0, 0.0, 50.0)], speed=1.0)
    truth = run(
        vehicle, water=make_ocean(uniform=(1.25, 0.0)), duration=30_000.0, physics_step=0.25
    )
    assert np.linalg.norm(truth.position[0], axis=-1).min() > 100.0
    last = np.flatnonzero(truth.status[0] == VehicleStatus.ACTIVE)[-1]
    assert truth.status[0, -1] == VehicleStatus.LEFT_DOMAIN
    speed = np.diff(truth.position[0, : last + 1], axis=0)[-1] / 50.0
    np.testing.assert_allclose(speed, [0.25, 0.0, 0.0], atol=2e-3)
    heading = matrix_from_quaternion(truth.quaternion[0, last])[:, 0]
    np.testing.assert_allclose(heading, [-1.0, 0.0, 0.0], atol=2e-2)


def test_a_buoy_goes_the_way_of_a_float_that_stays_up(run, make_float, make_ocean):
    water = make_ocean(rotation=3e-4, shear=1e-4, uniform=(0.1, -0.2))
    buoy = Vehicle("D", (100.0, -400.0, 7.0), Drifting(7.0))
    stays = make_float("D", 100.0, -400.0, depth=7.0, surface_depth=7.0, start_delay=1e9)
    for ocean in (
        water,
        over_time([0.0, 1234.0, 4000.0], [water, make_ocean(rotation=1e-4), water]),
    ):
        one, other = run(buoy, water=ocean), run(stays, water=ocean)
        np.testing.assert_array_equal(one.position, other.position)
        assert np.ptp(one.position[0, :, :2]) > 100.0
    assert one.role.tolist() == ["drifting"]


def test_a_drogue_is_carried_by_the_water_at_its_depth(run, make_ocean):
    buoy = Vehicle("D", (0.0, 0.0, 0.5), Drifting(0.5, drogue_depth=90.0))
    truth = run(buoy, water=make_ocean(uniform=(0.05, 0.1), shear=2e-3))
    expected = np.array([0.0, 0.0, 0.5]) + np.outer(truth.time, [0.05 + 90.0 * 2e-3, 0.1, 0.0])
    np.testing.assert_allclose(truth.position[0], expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize(("slow", "fast"), [(1e-3, 1e-3), (5e-4, 2e-3)])
def test_drift_follows_a_circular_current_to_second_order(run, make_ocean, slow, fast):
    radius, duration, errors = 2000.0, 4000.0, []
    water = over_time([0.0, duration], [make_ocean(rotation=rate) for rate in (slow, fast)])
    for step in (5.0, 10.0, 25.0):
        still = Vehicle("T", (radius, 0.0, 50.0), ConstantTwist(np.zeros(6), current=True))
        truth = run(still, water=water, physics_step=step)
        angle = slow * truth.time + (fast - slow) * truth.time**2 / (2.0 * duration)
        circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        errors.append(np.linalg.norm(truth.position[0, :, :2] - circle, axis=-1).max())
    np.testing.assert_allclose(np.diff(np.log(errors)) / np.log([2.0, 2.5]), 2.0, rtol=0, atol=0.1)
    assert errors[0] < 0.1  # m, of a way of 10 km


def test_between_snapshots_a_swimmers_current_is_linear_in_time(run, make_ocean):
    times = np.array([-40.0, 0.0, 100.0, 130.0, 900.0, 2500.0, 2501.0, 4000.0])
    speed = np.random.default_rng(1).uniform(-1.0, 1.0, (times.size, 2))
    water = over_time(times, [make_ocean(uniform=tuple(u)) for u in speed])
    truth = run(
        Vehicle("T", (0.0, 0.0, 50.0), ConstantTwist(np.zeros(6), current=True)), water=water
    )
    fine = np.arange(0.0, 4000.1, 0.5)
    now = np.stack([np.interp(fine, times, u) for u in speed.T])
    area = np.concatenate(
        [np.zeros((2, 1)), np.cumsum(0.25 * (now[:, 1:] + now[:, :-1]), axis=1)], axis=1
    )
    np.testing.assert_allclose(truth.position[0, :, :2], area[:, ::100].T, rtol=0, atol=1e-8)


def test_a_swimmer_feels_the_current_of_its_depth(run, make_ocean):
    """
    Down at 45 degrees through a shear: the current's way is that of the mean depth, linear in it.
    """
    vehicle = Vehicle("T", (0.0, 0.0, 20.0), ConstantTwist((0, 0, 0, 0.0, 0.0, 0.1), current=True))
    truth = run(vehicle, water=make_ocean(shear=1e-3))
    expected = 1e-3 * (20.0 * truth.time + 0.05 * truth.time**2)
    np.testing.assert_allclose(truth.position[0, :, 0], expected, rtol=0, atol=1e-8)


def test_a_buoy_is_held_under_ice_and_comes_back(run, make_ocean):
    ocean = make_ocean(uniform=(0.5, 0.0))
    draft = np.where(
        np.abs(ocean["north"].values - 1000.0) < 1.0, 8.0, 0.0
    )  # a keel 2 km wide at its foot
    ocean = ocean.assign(sea_ice_draft=(("north", "east"), np.repeat(draft[:, None], 9, axis=1)))
    truth = run(Vehicle("D", (-500.0, 0.0, 0.5), Drifting(0.5)), water=ocean, duration=8000.0)
    north, depth = truth.position[0, :, 0], truth.position[0, :, 2]
    keel = np.interp(north, ocean["north"].values, draft)
    assert np.all(depth >= keel - 1e-9)
    np.testing.assert_allclose(
        depth, np.maximum(keel, 0.5), rtol=0, atol=3e-3
    )  # a step behind the keel
    assert depth.max() > 7.5
    assert depth[-1] == 0.5


def test_what_is_carried_out_of_the_ocean_or_aground_stays_there(run, make_ocean):
    buoy = Vehicle("D", (0.0, 0.0, 700.0), Drifting(700.0))
    truth = run(buoy, water=make_ocean(uniform=(1.0, 0.0), slope=0.1), duration=6000.0)
    assert truth.status[0, -1] == VehicleStatus.GROUNDED
    np.testing.assert_allclose(truth.position[0, -1], [3000.0, 0.0, 700.0], atol=1.0)
    swims = Vehicle("T", (0.0, 0.0, 50.0), ConstantTwist((0, 0, 0, 1.0, 0, 0), current=True))
    truth = run(swims, water=make_ocean(uniform=(1.0, 0.0)), duration=6000.0)
    assert truth.status[0, -1] == VehicleStatus.LEFT_DOMAIN
    assert 4990.0 < truth.position[0, -1, 0] <= 5000.0


def test_what_cannot_be_done_is_refused_in_one_line(run, make_ocean):
    refused(FleetError, "drogue_depth is -1 m", Drifting, 0.5, -1.0)
    refused(
        FleetError,
        "start depth is 2 m, and Drifting keeps 0.5 m",
        Vehicle,
        "D",
        (0, 0, 2.0),
        Drifting(0.5),
    )
    deep = Vehicle("D", (0.0, 0.0, 0.5), Drifting(0.5, 2000.0))
    refused(
        FleetError, "'D': drogue_depth is 2000 m deep, below the sea floor at 1000 m", run, deep
    )
    jumpy = swimmer((0.0, 0.0, 50.0), POINTS, capture_radius=1.0)
    water = make_ocean(uniform=(0.0, 2.5))
    refused(
        FleetError,
        r"at most 0.25 s, capture_radius / speed \(current included\)",
        run,
        jumpy,
        water=water,
        physics_step=0.5,
    )
    assert run(jumpy, water=make_ocean(), physics_step=0.5).status.max() == VehicleStatus.ACTIVE


def test_vehicles_and_rays_have_the_same_current_at_random_positions(run, make_ocean):
    water, rng = make_ocean(), np.random.default_rng(20140715)
    for name in ("current_north", "current_east"):
        water[name] = water[name].dims, rng.uniform(-0.5, 0.5, water[name].shape)
    water["sea_floor_depth"][:] = 4000.0
    places = rng.uniform((-4990.0, -4990.0, 0.0), (4990.0, 4990.0, 990.0), (20, 3))
    step = 0.01  # s; the current changes by less than 1e-5 m/s on the way
    drogues = np.where(
        np.arange(20) < 5, 3000.0, places[:, 2]
    )  # the first five are below the deepest level
    buoys = [
        Vehicle(f"B{k}", place, Drifting(place[2], drogue))
        for k, (place, drogue) in enumerate(zip(places, drogues, strict=True))
    ]
    swimmers = [
        Vehicle(f"S{k}", place, ConstantTwist(np.zeros(6), current=True))
        for k, place in enumerate(places)
    ]
    truth = run(
        *buoys, *swimmers, water=water, duration=step, physics_step=step, sampling_period=step
    )
    speed = (truth.position[:, -1] - truth.position[:, 0])[:, :2] / step
    of_buoys = np.column_stack([places[:, :2], drogues])
    expected = Currents.from_dataset(water).at(np.concatenate([of_buoys, places]))[:, :2]
    np.testing.assert_allclose(speed, expected, rtol=0.0, atol=1e-5)
    assert np.abs(expected).max() > 0.3
