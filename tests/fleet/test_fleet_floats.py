"""
Floats and station keepers against closed forms: sampling, cycle times, speed limits and drift.
"""

import numpy as np
import pytest

from pymantaray.fleet import StationKeeping, Vehicle
from pymantaray.records import VehicleStatus

BOX = 5000.0  # m; half the side of the domain that conftest builds


def test_paths_are_the_same_however_often_they_are_sampled(run, make_float, make_ocean):
    water = make_ocean(rotation=1e-4, uniform=(0.1, -0.2))
    often, seldom = (
        run(make_float(), water=water, sampling_period=period) for period in (50.0, 400.0)
    )
    np.testing.assert_array_equal(often.time, np.arange(81) * 50.0)
    np.testing.assert_array_equal(often.position[0, 0], [0.0, 0.0, 0.5])
    np.testing.assert_array_equal(often.position[:, ::8], seldom.position)


def approach_time(distance, speed, gain, step):
    """
    Time of a saturated proportional controller until its target is reached.

    Full speed to ``speed / gain`` from the target, and then exponential to 1 um. A step that a
    larger gain would carry past the target ends there, so that the time is that at full speed,
    rounded up to whole steps.
    """
    if gain * step >= 1.0:
        return np.ceil(distance / (speed * step) - 1e-9) * step
    near = speed / gain
    return (distance - near) / speed + np.log(near / 1e-6) * step / -np.log1p(-gain * step)


@pytest.mark.parametrize(
    ("gain", "step"), [(0.1, 0.05), (1.0, 0.05), (10.0, 0.125), (10.0, 0.1), (50.0, 1.0)]
)
def test_cycle_keeps_its_times(run, make_float, gain, step):
    """Delay, descent, hold, ascent, surface hold: each leg starts when its closed form says."""
    speed = 0.5
    vehicle = make_float(start_delay=200.0, depth_gain=gain, vertical_speed=speed)
    truth = run(vehicle, duration=4000.0, physics_step=step, sampling_period=1.0)
    depth = truth.position[0, :, 2]
    travel = approach_time(99.5, speed, gain, step)
    leave = [200.0]
    for hold in (600.0, 300.0, 600.0, 300.0, 600.0):
        leave.append(leave[-1] + travel + hold)
    moved = np.abs(np.diff(depth)) > 0.45  # starts at full speed, ends in the exponential approach
    starts = np.flatnonzero(moved & ~np.concatenate([[False], moved[:-1]]))
    starts = starts[np.diff(starts, prepend=-np.inf) > 100.0]
    expected = [time for time in leave if time < 3990.0]
    np.testing.assert_allclose(starts, expected, rtol=0, atol=1.0)  # s, the sampling
    assert depth[int(leave[1]) - 5] == pytest.approx(100.0, abs=1e-5)
    assert depth[int(leave[2]) - 5] == pytest.approx(0.5, abs=1e-5)


@pytest.mark.parametrize("gain", [0.1, 10.0])
@pytest.mark.parametrize("physics_step", [0.125, 1.0, 10.0])
def test_depth_never_overshoots_nor_exceeds_the_vertical_speed(run, make_float, physics_step, gain):
    """Whatever gain times step, which is 100 at most here."""
    vehicle = make_float(depth=30.0, start_delay=200.0, vertical_speed=0.4, depth_gain=gain)
    truth = run(vehicle, duration=6000.0, physics_step=physics_step, sampling_period=physics_step)
    depth = truth.position[0, :, 2]
    assert depth.max() <= 100.0 + 1e-12
    assert depth.min() >= 0.5 - 1e-12
    assert np.abs(np.diff(depth)).max() <= 0.4 * physics_step * (1 + 1e-9)
    assert depth.max() > 100.0 - 1e-6


def test_drift_in_a_uniform_current_is_current_times_time(run, make_float, make_ocean):
    truth = run(make_float(heading=1.0), water=make_ocean(uniform=(0.3, -0.2)))
    np.testing.assert_allclose(truth.position[0, :, 0], 0.3 * truth.time, rtol=0, atol=1e-8)
    np.testing.assert_allclose(truth.position[0, :, 1], -0.2 * truth.time, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(
        truth.quaternion[0], np.tile([np.cos(0.5), 0, 0, np.sin(0.5)], (81, 1))
    )


def test_drift_integrates_a_current_that_is_linear_in_depth(run, make_float, make_ocean):
    """
    While sinking at a steady speed the current is linear in time; the midpoint rule is exact for
    it.
    """
    water = make_ocean(shear=1e-3)
    truth = run(make_float(target_depth=900.0), water=water, duration=1500.0, physics_step=0.5)
    depth, time = truth.position[0, :, 2], truth.time
    expected = 1e-3 * (0.5 * time + 0.25 * time**2)
    np.testing.assert_allclose(depth, 0.5 + 0.5 * time, rtol=0, atol=1e-9)
    np.testing.assert_allclose(truth.position[0, :, 0], expected, rtol=1e-12, atol=1e-9)


def test_current_is_trilinear_between_grid_points(run, make_float, make_ocean):
    """On a current of random grid values, the first metres follow a hand-written interpolation."""
    water = make_ocean()
    rng = np.random.default_rng(2)
    for way in ("current_north", "current_east"):
        water[way] = water[way].dims, rng.uniform(-0.5, 0.5, water[way].shape)
    for _ in range(5):
        start = np.array([*rng.uniform(-BOX, BOX, 2) * 0.95, rng.uniform(1.0, 900.0)])
        vehicle = make_float(north=start[0], east=start[1], depth=start[2], surface_depth=start[2],
                          target_depth=start[2] + 1.0, start_delay=1e9)  # fmt: skip
        truth = run(vehicle, water=water, duration=1e-3, physics_step=1e-3, sampling_period=1e-3)
        at = {"north": start[0], "east": start[1], "depth": start[2]}
        expected = [float(water[f"current_{way}"].interp(at)) for way in ("north", "east")]
        np.testing.assert_allclose(
            np.diff(truth.position[0, :, :2], axis=0)[0] / 1e-3, expected, atol=1e-6
        )


def test_station_keeps_in_any_current(run, make_ocean):
    truth = run(
        Vehicle("A", (10.0, 20.0, 0.5), StationKeeping(0.5)), water=make_ocean(uniform=(1.0, 1.0))
    )
    np.testing.assert_array_equal(truth.position[0], np.tile([10.0, 20.0, 0.5], (81, 1)))
    assert (truth.status == VehicleStatus.ACTIVE).all()
