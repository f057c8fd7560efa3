"""
Floats in currents that vary in time against closed forms, and a sea floor finer than the ocean's
grid.
"""

import numpy as np
import pytest
from factories import over_time
from refusals import refused
from scipy.interpolate import RegularGridInterpolator

from pymantaray.errors import FleetError
from pymantaray.fleet.kernel import TOUCH, surface_depth
from pymantaray.records import VehicleStatus

BOX, FLOOR = 5000.0, 1000.0  # m; half the side and the depth of the domain that conftest builds


def test_between_snapshots_the_current_is_linear_in_time(run, make_float, make_ocean):
    """
    Random currents at uneven instants, all ends of steps: the drift is the area under the polygon.
    """
    times = np.array([-40.0, 0.0, 100.0, 130.0, 900.0, 2500.0, 2501.0, 4000.0])
    speed = np.random.default_rng(1).uniform(-1.0, 1.0, (times.size, 2))
    water = over_time(times, [make_ocean(uniform=tuple(u)) for u in speed])
    truth = run(make_float(), water=water, physics_step=0.5)
    fine = np.arange(0.0, 4000.1, 0.5)
    now = np.stack([np.interp(fine, times, u) for u in speed.T])
    area = np.concatenate(
        [np.zeros((2, 1)), np.cumsum(0.25 * (now[:, 1:] + now[:, :-1]), axis=1)], axis=1
    )
    np.testing.assert_allclose(truth.position[0, :, :2], area[:, ::100].T, rtol=0, atol=1e-8)


def test_equal_snapshots_are_still_water_to_the_last_digit(run, make_float, make_ocean):
    ocean = make_ocean(rotation=3e-4, shear=1e-4, uniform=(0.1, -0.2), slope=0.1)
    fleet = [make_float("B", 100.0), make_float("C", -700.0, 900.0, target_depth=700.0)]
    still = run(*fleet, water=ocean, duration=20_000.0)
    varying = run(*fleet, water=over_time([-100.0, 333.0, 2e4], [ocean] * 3), duration=20_000.0)
    np.testing.assert_array_equal(varying.position, still.position)
    np.testing.assert_array_equal(varying.status, still.status)
    assert np.ptp(still.position[..., 0]) > 2000.0  # several cells of the ocean
    assert (
        len({types[0] for types in surface_depth.signatures}) == 1
    )  # kernels are compiled for one kind of water


@pytest.mark.parametrize(("slow", "fast"), [(1e-3, 1e-3), (5e-4, 2e-3)])
def test_drift_in_rotation_is_a_circle_to_second_order(run, make_float, make_ocean, slow, fast):
    """
    x' = r(t) J x turns by the integral of r; of a steady r the error is that of Adams and
    Bashforth's two steps.
    """
    radius, duration, errors = 2000.0, 4000.0, []
    water = over_time([0.0, duration], [make_ocean(rotation=rate) for rate in (slow, fast)])
    for step in (2.5, 5.0, 10.0):
        truth = run(make_float(north=radius, start_delay=1e9), water=water, physics_step=step)
        angle = slow * truth.time + (fast - slow) * truth.time**2 / (2.0 * duration)
        circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        errors.append(np.linalg.norm(truth.position[0, :, :2] - circle, axis=-1).max())
        if slow == fast:
            stated = radius * slow * duration * 5 / 12 * (slow * step) ** 2
            assert errors[-1] == pytest.approx(stated, rel=0.1)
    np.testing.assert_allclose(np.log2(np.array(errors[1:]) / errors[:-1]), 2.0, rtol=0, atol=0.1)
    assert errors[0] < 0.1  # m, of a way of 10 km


def test_order_of_the_dimensions_does_not_matter(run, make_float, make_ocean):
    water = over_time(
        [0.0, 5000.0], [make_ocean(rotation=1e-4), make_ocean(rotation=3e-4, shear=1e-4)]
    )
    turned = water.transpose("depth", "east", "time", "north")
    np.testing.assert_array_equal(
        run(make_float(), water=water).position, run(make_float(), water=turned).position
    )


def with_own_floor(ocean, north, east, depth):
    return ocean.drop_vars("sea_floor_depth").assign(
        sea_floor_depth=(("floor_north", "floor_east"), depth), floor_north=north, floor_east=east
    )


def own_floor_from(north, depth):
    """A change of the ocean: a level sea floor on axes of its own that begins at some north."""
    axes = np.linspace(north, BOX, 11), np.linspace(-BOX, BOX, 9)
    return lambda o: with_own_floor(o, *axes, np.full((11, 9), depth))


BAD = {
    "currents cover 0 to 1000 s, and the mission lasts from 0 to 4000 s; use": lambda o: o.isel(
        time=[0, 1]
    ),
    "currents cover 1 to 5001 s": lambda o: o.assign_coords(time=o.time + 1.0),
    "axis 'time': values do not increase": lambda o: o.isel(time=[1, 0, 2]),
    "axis 'time' has 1 value;": lambda o: o.isel(time=[0]),
    "time has type datetime64": lambda o: o.assign_coords(time=o.time.astype("datetime64[ns]")),
    "current_east has dimensions": lambda o: o.assign(current_east=o.current_east[0]),
    "missing values": lambda o: o.where(o.time < 2000.0).assign(sea_floor_depth=o.sea_floor_depth),
    "sea_floor_depth: north -4000 to 5000 m; it must extend over the water, -5000 to 5000 m": (
        own_floor_from(-4000.0, FLOOR)
    ),
    "target_depth is 100 m deep, below the sea floor at 60 m .*; use": own_floor_from(-BOX, 60.0),
}


@pytest.mark.parametrize("message", BAD)
def test_currents_that_do_not_cover_the_mission_are_refused(run, make_float, make_ocean, message):
    water = over_time([0.0, 1000.0, 5000.0], [make_ocean(uniform=(0.1 * k, 0.0)) for k in range(3)])
    refused(FleetError, message, run, make_float(), water=BAD[message](water))


@pytest.mark.parametrize("n", [(11, 9), (101, 9), (23, 47), (6, 4)])
def test_a_floor_of_random_heights_stops_floats_where_it_lies(run, make_float, make_ocean, n):
    """
    On any axes: above the bilinear floor at every sample, and where a float grounds the next step
    is into it.
    """
    rng = np.random.default_rng(sum(n))
    axes = [np.linspace(-BOX, BOX, k) for k in n]
    heights = rng.uniform(90.0, 400.0, n)
    heights[:, 0] = 90.0  # where all drift to
    water = with_own_floor(make_ocean(uniform=(0.4, -0.3)), *axes, heights)
    floor = RegularGridInterpolator(axes, heights)
    targets = 85.0 + 15.0 * np.arange(9)
    starts = np.linspace([-3000.0, 2500.0], [2000.0, -1500.0], 9)
    fleet = [
        make_float(name, *start, target_depth=target, hold_depth_time=1e9)
        for name, start, target in zip("BCDEFGHIJ", starts, targets, strict=True)
        if target < floor(start)
    ]
    truth = run(*fleet, water=water, duration=8000.0)
    assert (truth.position[..., 2] <= floor(truth.position[..., :2]) + TOUCH).all()
    grounded = truth.status[:, -1] == VehicleStatus.GROUNDED
    assert 0 < grounded.sum() < len(fleet)
    last = truth.position[grounded, -1]
    ahead = floor(last[:, :2] + 0.5 * np.array([0.4, -0.3]))  # half a second on
    assert (last[:, 2] + 0.25 > ahead).all()
