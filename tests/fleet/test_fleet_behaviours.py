"""Every parameter of a behaviour is checked where it is given."""

import numpy as np
import pytest
from refusals import refused

from pymantaray.errors import FleetError
from pymantaray.fleet import ConstantTwist, FloatCycle, StationKeeping, Vehicle, Waypoints

STATION = StationKeeping(0.5)
POINT = [[0, 0, 1.0]]

BAD = {
    "FloatCycle: target_depth is -5 m; it must be finite and zero or positive": (
        lambda: FloatCycle(-5.0)
    ),
    "target_depth is 0.005 m; it must be greater than surface_depth 0.01 m": (
        lambda: FloatCycle(0.005)
    ),
    "start_delay is -1 s; .* zero or positive": lambda: FloatCycle(100.0, start_delay=-1.0),
    "hold_depth_time is nan s": lambda: FloatCycle(100.0, hold_depth_time=np.nan),
    "hold_surface_time is inf s": lambda: FloatCycle(100.0, hold_surface_time=np.inf),
    "surface_depth is -0.5 m": lambda: FloatCycle(100.0, surface_depth=-0.5),
    "vertical_speed is 0 m/s; .* finite and positive": (
        lambda: FloatCycle(100.0, vertical_speed=0.0)
    ),
    "depth_gain is 0 1/s; it must be finite and positive": (
        lambda: FloatCycle(100.0, depth_gain=0.0)
    ),
    "StationKeeping: depth is -1 m": lambda: StationKeeping(-1.0),
    r"ConstantTwist: twist: shape is \(3,\); it must be \(6,\)": lambda: ConstantTwist([0, 0, 1]),
    "ConstantTwist: twist: 1 of 6 values are not finite": (
        lambda: ConstantTwist([0, 0, 0, np.inf, 0, 0])
    ),
    r"points: shape is \(3,\); it must be \(n, 3\)": lambda: Waypoints([0, 0, 1], 1.0, 0.1),
    r"points: shape is \(0, 3\)": lambda: Waypoints(np.empty((0, 3)), 1.0, 0.1),
    "a waypoint has depth -2 m; depth must be positive down": (
        lambda: Waypoints([[0, 0, -2.0]], 1.0, 0.1)
    ),
    "speed is 0 m/s": lambda: Waypoints(POINT, 0.0, 0.1),
    "turn_rate is -0.1 rad/s": lambda: Waypoints(POINT, 1.0, -0.1),
    "capture_radius is 5 m; .* radius speed / turn_rate = 20 m; increase it": (
        lambda: Waypoints(POINT, 2.0, 0.1, 5.0)
    ),
    "Vehicle: the name is empty": lambda: Vehicle("", (0, 0, 0.5), STATION),
    r"vehicle 'A': position: shape is \(2,\)": lambda: Vehicle("A", (0, 0), STATION),
    "vehicle 'A': position: 1 of 3 values are not finite": (
        lambda: Vehicle("A", (0, np.nan, 0), STATION)
    ),
    "vehicle 'A': start depth is -3 m; depth must be positive down": (
        lambda: Vehicle("A", (0, 0, -3.0), STATION)
    ),
    "vehicle 'A': heading is nan rad": lambda: Vehicle("A", (0, 0, 0.5), STATION, heading=np.nan),
    "vehicle 'A': start depth is 9 m, and StationKeeping keeps 0.5 m": (
        lambda: Vehicle("A", (0, 0, 9.0), STATION)
    ),
}  # fmt: skip


@pytest.mark.parametrize("message", BAD)
def test_bad_values_are_refused_in_one_line(message):
    refused(FleetError, message, BAD[message])


def test_arrays_are_copied_and_frozen():
    points = np.array([[0.0, 0.0, 10.0]])
    behaviour = Waypoints(points, 1.0, 0.1)
    points[:] = 99.0
    np.testing.assert_array_equal(behaviour.points, [[0.0, 0.0, 10.0]])
    with pytest.raises(ValueError, match="read-only"):
        behaviour.points[0, 0] = 1.0


def test_defaults_are_the_papers_mission():
    cycle = FloatCycle(250.0)
    assert (cycle.hold_depth_time, cycle.hold_surface_time, cycle.vertical_speed) == (
        86_400.0,
        3_600.0,
        0.5,
    )
