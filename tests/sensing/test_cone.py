"""A fan of limited width: rays are lost whose launch angle is too far from the chord."""

import math

import numpy as np
import pytest

from pymantaray import open_water
from pymantaray.acoustics import Medium
from pymantaray.config.door.study import build_study
from pymantaray.config.load import load_study
from pymantaray.errors import MantaRayError
from pymantaray.records import RayStatus
from pymantaray.sensing import ReceptionOptions, find_receptions

GRADIENT, SPEED = 0.05, 1400.0  # 1/s, m/s at the surface


def link(distance):
    """
    Ends at equal depth in water of constant gradient, and the angle between chord and ray: half the
    arc's angle.
    """
    depth = 2000.0
    medium = Medium.from_profile(
        [0.0, 6000.0],
        [SPEED, SPEED + 6000.0 * GRADIENT],
        bottom_depth=6000.0,
        interpolation="linear",
    )
    centre_above = (SPEED + GRADIENT * depth) / GRADIENT  # of the circle that the ray follows
    angle = math.atan(0.5 * distance / centre_above)
    return medium, np.array([[0.0, 0.0, depth]]), np.array([[0.0, distance, depth]]), angle


@pytest.mark.parametrize(("share", "status"), [(1.001, RayStatus.OK), (0.999, RayStatus.SHADOW)])
def test_ray_is_lost_at_the_half_angle_of_the_fan(share, status):
    medium, source, receiver, angle = link(8000.0)
    sound = find_receptions(source, receiver, medium, ReceptionOptions(cone=share * angle))
    assert sound.status[0] == status
    assert np.isfinite(sound.selected("travel_time")).all() == (status == RayStatus.OK)


def test_a_fan_may_lose_one_direction_only():
    depth = np.array([0.0, 100.0, 3000.0])
    medium = Medium.from_profile(
        depth, [1480.0, 1480.0, 1625.0], bottom_depth=3000.0, interpolation="linear"
    )
    source, receiver = np.array([[0.0, 0.0, 50.0]]), np.array([[0.0, 6000.0, 700.0]])
    free = find_receptions(source, receiver, medium)
    slope = math.atan2(650.0, 6000.0)
    away = abs(free.receptions.departure_angle - np.array([slope, -slope]))
    assert abs(away[0] - away[1]) > 0.005
    sound = find_receptions(source, receiver, medium, ReceptionOptions(cone=0.5 * away.sum()))
    received = np.isfinite(sound.selected("travel_time")[:, 0])
    np.testing.assert_array_equal(received, away < 0.5 * away.sum())
    assert sound.status[0] == RayStatus.OK


@pytest.mark.slow
def test_a_study_with_a_narrow_fan_loses_ranges_and_keeps_the_others():
    from pymantaray.apps.study.manifest import Stopwatch
    from pymantaray.apps.study.mission import simulate_mission

    kinds = {}
    for width in ("none", 2.0):
        changes = {"acoustics.cone_deg": width, "mission.duration_h": 12.0}
        config = load_study("quick").with_(**changes, **{"mission.physics_step_s": 1.0})
        mission = simulate_mission(build_study(config), Stopwatch(), lambda *_: None)
        kinds[width] = mission
    free, narrow = kinds["none"], kinds[2.0]
    lost = (free.measurements.range_status == RayStatus.OK) & (
        narrow.measurements.range_status != RayStatus.OK
    )
    assert 0 < lost.sum() < lost.size
    assert set(narrow.measurements.range_status[lost]) == {RayStatus.SHADOW}
    later = narrow.ranging_truth.travel_time - free.ranging_truth.travel_time
    assert (
        np.nanmin(later) == 0.0
    )  # a later ray inside the fan takes the place of an earlier one outside
    assert np.nanmedian(later) == 0.0
    assert np.isnan(narrow.ranging_truth.travel_time[lost]).all()


@pytest.mark.parametrize("width", [0.0, 181.0])
def test_half_angle_of_the_fan_is_0_to_180_degrees(width):
    with pytest.raises(MantaRayError, match="cone_deg"):
        open_water("synthetic:fram", half_extent=20e3, cone_deg=width)
