"""Behaviours of vehicles as frozen, checked parameter sets, and checks of start positions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pymantaray.arrays import Array
from pymantaray.errors import FleetError
from pymantaray.fleet.kernel import GROUNDED, LEFT_DOMAIN, OceanArrays, bed_depth, place
from pymantaray.quantities.checks import check_fields, checked_array, distinct_digits


@dataclass(frozen=True)
class FloatCycle:
    """
    Argo cycle: hold at the surface, descend, hold at depth, ascend, repeat.

    The vehicle stays at its start depth until `start_delay`. A proportional controller keeps its
    depth, and a hold begins when its depth is reached. Its horizontal motion is the current at its
    position.

    Parameters
    ----------
    target_depth : float
        Depth of the deep hold. Must be greater than `surface_depth`. [m]
    start_delay : float
        Time of the first descent. [s]
    hold_depth_time, hold_surface_time : float
        Length of the holds, from the arrival. [s]
    vertical_speed : float
        Maximum vertical speed, up and down. [m/s]
    surface_depth : float
        Depth of the surface hold. [m]
    depth_gain : float
        Commanded vertical speed per metre of distance from the target depth. In a step, the float
        moves at most to the target depth. [1/s]

    Examples
    --------
    Continues the example of `pymantaray.fleet`:

    >>> from pymantaray.fleet import FloatCycle, Vehicle, simulate
    >>> profiler = Vehicle("F", [0.0, 0.0, 5.0], FloatCycle(target_depth=500.0, start_delay=600.0))
    >>> print(simulate([profiler], sea, **steps).position[0, :, 2].round(1))
    [  5.   5. 305. 500.]
    """

    role: ClassVar[str] = "float"

    target_depth: float
    start_delay: float = 0.0
    hold_depth_time: float = 86_400.0
    hold_surface_time: float = 3_600.0
    vertical_speed: float = 0.5
    surface_depth: float = 0.01
    depth_gain: float = 10.0

    def __post_init__(self) -> None:
        """Check every value."""
        check_fields(FleetError, self, "s", "start_delay", "hold_depth_time", "hold_surface_time")
        check_fields(FleetError, self, "m", "target_depth", "surface_depth")
        check_fields(FleetError, self, "m/s", "vertical_speed", positive=True)
        check_fields(FleetError, self, "1/s", "depth_gain", positive=True)
        if self.target_depth <= self.surface_depth:
            raise FleetError(
                f"FloatCycle: target_depth is {self.target_depth:g} m; it must be greater than"
                f" surface_depth {self.surface_depth:g} m"
            )


@dataclass(frozen=True)
class StationKeeping:
    """
    Stay at the start position in any current.

    Parameters
    ----------
    depth : float
        Depth, which must equal the vehicle's start depth. [m]

    Examples
    --------
    Continues the example of `pymantaray.fleet`:

    >>> from pymantaray.fleet import StationKeeping, Vehicle, simulate
    >>> anchored = Vehicle("S", [100.0, 0.0, 20.0], StationKeeping(depth=20.0))
    >>> print(simulate([anchored], sea, **steps).position[0, -1])
    [100.   0.  20.]
    """

    role: ClassVar[str] = "station"

    depth: float

    def __post_init__(self) -> None:
        """Check the depth."""
        check_fields(FleetError, self, "m", "depth")


@dataclass(frozen=True)
class Drifting:
    """
    Drift with the current at a constant depth, as a buoy with or without a drogue.

    Parameters
    ----------
    depth : float
        Depth, which must equal the vehicle's start depth. [m]
    drogue_depth : float, optional
        Depth of the current that moves the vehicle. Default: ``depth``. [m]

    Examples
    --------
    Continues the example of `pymantaray.fleet`:

    >>> from pymantaray.fleet import Drifting, Vehicle, simulate
    >>> buoy = Vehicle("D", [0.0, 0.0, 15.0], Drifting(depth=15.0, drogue_depth=50.0))
    >>> print(simulate([buoy], sea, **steps).position[0, -1].round(1))
    [-31.3 -66.9  15. ]
    """

    role: ClassVar[str] = "drifting"

    depth: float
    drogue_depth: float = float("nan")

    def __post_init__(self) -> None:
        """Check the depths."""
        if math.isnan(self.drogue_depth):
            object.__setattr__(self, "drogue_depth", self.depth)
        check_fields(FleetError, self, "m", "depth", "drogue_depth")


@dataclass(frozen=True, eq=False)
class ConstantTwist:
    """
    Move with a constant body twist over ground: a helix.

    Parameters
    ----------
    twist : array_like, shape (6,)
        Twist ``[omega, v]`` in the body frame. [rad/s, m/s]
    current : bool
        If True, the twist is relative to the water, and the current moves the vehicle in addition.

    Examples
    --------
    Continues the example of `pymantaray.fleet`:

    >>> from pymantaray.fleet import ConstantTwist, Vehicle, simulate
    >>> circling = Vehicle("C", [0.0, 0.0, 20.0], ConstantTwist([0.0, 0.0, 0.01, 1.0, 0.0, 0.0]))
    >>> print(simulate([circling], sea, **steps).position[0].round(1))
    [[  0.    0.   20. ]
     [-27.9   4.   20. ]
     [-53.7  15.6  20. ]
     [-75.1  34.   20. ]]
    """

    role: ClassVar[str] = "twist"

    twist: Array
    current: bool = False

    def __post_init__(self) -> None:
        """Check and freeze the twist."""
        object.__setattr__(
            self, "twist", checked_array(FleetError, "ConstantTwist: twist", self.twist, (6,))
        )


@dataclass(frozen=True, eq=False)
class Waypoints:
    """
    Swim from waypoint to waypoint at constant speed along body x, with a limited turn rate.

    A waypoint counts as reached within `capture_radius`, which must be at least the turning radius;
    otherwise the vehicle could circle a waypoint forever. The vehicle turns body x towards the
    waypoint and does not compensate for the current. Without `current`, the speed is over ground.
    With `current`, the speed is relative to the water and the current moves the vehicle in
    addition. It then approaches a waypoint on a curve from down-current, is carried away by a
    current that is faster than its speed, and drifts after its last waypoint.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Waypoints ``(north, east, down)``. [m]
    speed : float
        Forward speed. [m/s]
    turn_rate : float
        Maximum angular speed. [rad/s]
    capture_radius : float
        Distance at which a waypoint counts as reached. [m]
    loop : bool
        If True, continue with the first waypoint after the last; otherwise stop there.
    current : bool
        If True, the current moves the vehicle.

    Examples
    --------
    Continues the example of `pymantaray.fleet`:

    >>> from pymantaray.fleet import Vehicle, Waypoints, simulate
    >>> route = Waypoints([[500.0, 0.0, 50.0], [500.0, 900.0, 50.0]], speed=1.0, turn_rate=0.1)
    >>> print(simulate([Vehicle("W", [0.0, 0.0, 20.0], route)], sea, **steps).position[0].round())
    [[  0.   0.  20.]
     [500. 104.  50.]
     [500. 704.  50.]
     [500. 884.  50.]]
    """

    role: ClassVar[str] = "waypoints"

    points: Array
    speed: float
    turn_rate: float
    capture_radius: float = 20.0
    loop: bool = False
    current: bool = False

    def __post_init__(self) -> None:
        """Check every value and freeze the points."""
        points = checked_array(FleetError, "Waypoints: points", self.points, (None, 3))
        object.__setattr__(self, "points", points)
        check_fields(FleetError, self, "m/s", "speed", positive=True)
        check_fields(FleetError, self, "rad/s", "turn_rate", positive=True)
        check_fields(FleetError, self, "m", "capture_radius", positive=True)
        shallowest = float(self.points[:, 2].min())
        if shallowest < 0.0:
            raise FleetError(
                f"Waypoints: a waypoint has depth {shallowest:g} m; depth must be positive down, 0"
                " at the surface"
            )
        radius = self.speed / self.turn_rate
        if self.capture_radius < radius:
            raise FleetError(
                f"Waypoints: capture_radius is {self.capture_radius:g} m; it must be at least the"
                f" turning radius speed / turn_rate = {radius:g} m; increase it or turn_rate, or"
                " reduce speed"
            )


Behaviour = FloatCycle | StationKeeping | Drifting | ConstantTwist | Waypoints
"""Any behaviour of a vehicle."""


@dataclass(frozen=True, eq=False)
class Vehicle:
    """
    A vehicle with its name, start position and behaviour.

    Parameters
    ----------
    name : str
        Name, unique in the fleet.
    position : array_like, shape (3,)
        Start position ``(north, east, down)`` in the local frame. [m]
    behaviour : FloatCycle, StationKeeping, Drifting, ConstantTwist or Waypoints
        Behaviour.
    heading : float
        Bearing of body x at the start, clockwise from grid north; pitch and roll are zero. [rad]

    Examples
    --------
    Continues the example of `pymantaray.fleet`:

    >>> from pymantaray.fleet import StationKeeping, Vehicle, simulate
    >>> fleet = [Vehicle(name, [0.0, 0.0, 20.0], StationKeeping(20.0)) for name in ("A", "B")]
    >>> simulate(fleet, sea, **steps).name.tolist()
    ['A', 'B']
    """

    name: str
    position: Array
    behaviour: Behaviour
    heading: float = 0.0

    def __post_init__(self) -> None:
        """Check every value and freeze the position."""
        if not self.name:
            raise FleetError("Vehicle: the name is empty; give every vehicle a unique name")
        owner = f"vehicle {self.name!r}"
        position = checked_array(FleetError, f"{owner}: position", self.position, (3,))
        object.__setattr__(self, "position", position)
        depth = float(self.position[2])
        if depth < 0.0:
            raise FleetError(
                f"{owner}: start depth is {depth:g} m; depth must be positive down, 0 at the"
                " surface"
            )
        if not math.isfinite(self.heading):
            raise FleetError(f"{owner}: heading is {self.heading:g} rad; it must be finite")
        if isinstance(self.behaviour, StationKeeping | Drifting) and depth != self.behaviour.depth:
            start, keeps = distinct_digits(depth, self.behaviour.depth)
            raise FleetError(
                f"{owner}: start depth is {start} m, and {type(self.behaviour).__name__} keeps"
                f" {keeps} m; they must be equal"
            )


def unique_names(vehicles: Sequence[Vehicle]) -> list[str]:
    """Names of a fleet; raise an error if two vehicles have one name."""
    names = [vehicle.name for vehicle in vehicles]
    if not names:
        raise FleetError("fleet: no vehicles; give at least one")
    duplicates = sorted({name for name in names if names.count(name) > 1})
    if duplicates:
        raise FleetError(f"vehicle {duplicates[0]!r}: two vehicles have this name; rename one")
    return names


def check_placement(vehicle: Vehicle, water: OceanArrays) -> None:
    """Raise an error if start, target or waypoint is outside the ocean or below the sea floor."""
    owner = f"vehicle {vehicle.name!r}"
    behaviour = vehicle.behaviour
    north, east, _ = vehicle.position
    _check_point(owner, "the start position", vehicle.position, water)
    if isinstance(behaviour, FloatCycle):
        _check_point(owner, "target_depth", np.array([north, east, behaviour.target_depth]), water)
    elif isinstance(behaviour, Drifting):
        _check_point(owner, "drogue_depth", np.array([north, east, behaviour.drogue_depth]), water)
    elif isinstance(behaviour, Waypoints):
        for index, point in enumerate(behaviour.points):
            _check_point(owner, f"waypoint {index}", point, water)


def _check_point(owner: str, what: str, point: Array, water: OceanArrays) -> None:
    north, east, depth = (float(value) for value in point)
    state = place(water, north, east, depth)
    if state == LEFT_DOMAIN:
        y, south, top = distinct_digits(north, water.north[0], water.north[-1])
        x, west, right = distinct_digits(east, water.east[0], water.east[-1])
        raise FleetError(
            f"{owner}: {what} is at north {y}, east {x} m, outside the ocean; allowed: north"
            f" {south} to {top} m, east {west} to {right} m; move it, or use a larger ocean"
        )
    if state == GROUNDED:
        deep, floor = distinct_digits(depth, bed_depth(water, north, east))
        raise FleetError(
            f"{owner}: {what} is {deep} m deep, below the sea floor at {floor} m (north {north:g},"
            f" east {east:g} m); use a smaller depth or another place"
        )


def check_step(vehicle: Vehicle, physics_step: float, water: OceanArrays) -> None:
    """Raise an error if a step [s] is so long that a swimmer could miss a waypoint."""
    behaviour = vehicle.behaviour
    if not isinstance(behaviour, Waypoints):
        return
    currents = (
        np.hypot(water.current_north, water.current_east) if behaviour.current else np.zeros(1)
    )
    limit = behaviour.capture_radius / (behaviour.speed + float(currents.max()))
    if physics_step > limit:
        raise FleetError(
            f"vehicle {vehicle.name!r}: physics_step is {physics_step:g} s; it must be at most"
            f" {limit:g} s, capture_radius / speed (current included), so that the vehicle does not"
            " miss a waypoint"
        )
