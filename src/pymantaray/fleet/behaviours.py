"""What a vehicle does, each behaviour a frozen, checked set of parameters, and whether it can be done where it starts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import FleetError
from pymantaray.fleet.kernel import GROUNDED, LEFT_DOMAIN, Water, bed_depth, place
from pymantaray.geometry.checks import check_fields, checked_array, told_apart

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FloatCycle:
    """
    Argo cycle: hold at the surface, descend, hold at depth, ascend, and again.

    The vehicle starts in the surface hold, which lasts until `start_delay`. Its depth is kept by a
    proportional controller, its horizontal motion is the current at its place and nothing else.

    Parameters
    ----------
    target_depth : float
        Depth of the hold below. Must exceed `surface_depth`. [m]
    start_delay : float
        Time of the first descent. [s]
    hold_depth_time, hold_surface_time : float
        Length of the holds, counted from the arrival. [s]
    vertical_speed : float
        Limit of the vertical speed, up and down. [m/s]
    surface_depth : float
        Depth that counts as surfaced. [m]
    depth_gain : float
        Vertical speed commanded per metre from the depth aimed at. [1/s]
    arrival_tolerance : float
        Distance from the depth aimed at at which a hold begins: the controller's approach is
        exponential and never ends. [m]
    """

    role: ClassVar[str] = "float"

    target_depth: float
    start_delay: float = 0.0
    hold_depth_time: float = 86_400.0
    hold_surface_time: float = 3_600.0
    vertical_speed: float = 0.5
    surface_depth: float = 0.5
    depth_gain: float = 0.1
    arrival_tolerance: float = 0.1

    def __post_init__(self) -> None:
        """Check every value."""
        check_fields(FleetError, self, "s", "start_delay", "hold_depth_time", "hold_surface_time")
        check_fields(FleetError, self, "m", "target_depth", "surface_depth")
        check_fields(FleetError, self, "m/s", "vertical_speed", positive=True)
        check_fields(FleetError, self, "1/s", "depth_gain", positive=True)
        check_fields(FleetError, self, "m", "arrival_tolerance", positive=True)
        if self.target_depth <= self.surface_depth:
            raise FleetError(
                f"FloatCycle: target_depth is {self.target_depth:g} m; it must lie below surface_depth"
                f" {self.surface_depth:g} m: give a deeper target"
            )


@dataclass(frozen=True)
class StationKeeping:
    """Stay at the start position, whatever the current; the depth that is kept [m] is the vehicle's at the start."""

    role: ClassVar[str] = "station"

    depth: float

    def __post_init__(self) -> None:
        """Check the depth."""
        check_fields(FleetError, self, "m", "depth")


@dataclass(frozen=True)
class Drifting:
    """
    Drift with the current at one depth: a buoy, on a drogue or without.

    Parameters
    ----------
    depth : float
        That is kept, the vehicle's at the start. [m]
    drogue_depth : float, optional
        Depth of the water that carries it. Default: its own. [m]
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
    Move with one body twist ``[omega, v]`` [rad/s, m/s] for ever: a helix, over ground.

    With ``current`` the twist is through the water, and the current carries the vehicle besides.
    """

    role: ClassVar[str] = "twist"

    twist: Array
    current: bool = False

    def __post_init__(self) -> None:
        """Check and freeze the twist."""
        object.__setattr__(self, "twist", checked_array(FleetError, "ConstantTwist: twist", self.twist, (6,)))


@dataclass(frozen=True, eq=False)
class Waypoints:
    """
    Swim from point to point at constant speed along body x, turning with a limited rate.

    A point counts as reached within `capture_radius`; it may not be smaller than the turning radius, else the vehicle
    could circle a point for ever. Body x is turned towards the point, whatever the current. Without `current` that does not
    act, and the speed is over ground. With it the speed is through the water, and the current carries the vehicle: it comes
    to its point on a bow from down-current, is carried off where the current is faster than it swims, and
    drifts after its last point.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Positions ``(north, east, down)``. [m]
    speed : float
        Forward speed. [m/s]
    turn_rate : float
        Limit of the angular speed. [rad/s]
    capture_radius : float
        Distance at which a point counts as reached. [m]
    loop : bool
        After the last point go on to the first; otherwise stop there.
    current : bool
        Whether the current carries the vehicle.
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
                f"Waypoints: a point has depth {shallowest:g} m; depth is positive down, 0 at the surface"
            )
        radius = self.speed / self.turn_rate
        if self.capture_radius < radius:
            raise FleetError(
                f"Waypoints: capture_radius is {self.capture_radius:g} m; it must be at least the turning"
                f" radius speed / turn_rate = {radius:g} m: enlarge it, turn faster or swim slower"
            )


Behaviour = FloatCycle | StationKeeping | Drifting | ConstantTwist | Waypoints
"""What a vehicle does."""


@dataclass(frozen=True, eq=False)
class Vehicle:
    """
    One vehicle: who it is, where it starts and what it does.

    Parameters
    ----------
    name : str
        Unique in the fleet.
    position : array_like, shape (3,)
        Start ``(north, east, down)`` in the local frame. [m]
    behaviour : FloatCycle, StationKeeping, Drifting, ConstantTwist or Waypoints
    heading : float
        Bearing of body x at the start, clockwise from grid north; pitch and roll are zero. [rad]
    """

    name: str
    position: Array
    behaviour: Behaviour
    heading: float = 0.0

    def __post_init__(self) -> None:
        """Check every value and freeze the position."""
        if not self.name:
            raise FleetError("Vehicle: the name is empty; every vehicle needs its own name")
        owner = f"vehicle {self.name!r}"
        position = checked_array(FleetError, f"{owner}: position", self.position, (3,))
        object.__setattr__(self, "position", position)
        depth = float(self.position[2])
        if depth < 0.0:
            raise FleetError(
                f"{owner}: start depth is {depth:g} m; depth is positive down, 0 at the surface: start deeper"
            )
        if not math.isfinite(self.heading):
            raise FleetError(f"{owner}: heading is {self.heading:g} rad; it must be finite")
        if isinstance(self.behaviour, StationKeeping | Drifting) and depth != self.behaviour.depth:
            start, keeps = told_apart(depth, self.behaviour.depth)
            raise FleetError(
                f"{owner}: start depth is {start} m, {type(self.behaviour).__name__} keeps {keeps} m;"
                " they must be equal: it neither rises nor sinks"
            )


def unique_names(vehicles: Sequence[Vehicle]) -> list[str]:
    """Names of a fleet, none of them twice."""
    names = [vehicle.name for vehicle in vehicles]
    if not names:
        raise FleetError("fleet: there are no vehicles; at least one is needed")
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise FleetError(f"vehicle {double[0]!r}: the name is used twice; names must be unique: rename one")
    return names


def check_placement(vehicle: Vehicle, water: Water) -> None:
    """Refuse a start, a target depth there, or a waypoint outside the ocean or below the sea floor."""
    owner = f"vehicle {vehicle.name!r}"
    behaviour = vehicle.behaviour
    _check_point(owner, "the start position", vehicle.position, water)
    if isinstance(behaviour, FloatCycle):
        target = np.array([*vehicle.position[:2], behaviour.target_depth])
        _check_point(owner, "target_depth", target, water)
    elif isinstance(behaviour, Drifting):
        drogue = np.array([*vehicle.position[:2], behaviour.drogue_depth])
        _check_point(owner, "drogue_depth", drogue, water)
    elif isinstance(behaviour, Waypoints):
        for index, point in enumerate(behaviour.points):
            _check_point(owner, f"waypoint {index}", point, water)


def _check_point(owner: str, what: str, point: Array, water: Water) -> None:
    north, east, depth = (float(value) for value in point)
    state = place(water, north, east, depth)
    if state == LEFT_DOMAIN:
        far_north = water.north + (water.current_north.shape[1] - 1) / water.per_north
        far_east = water.east + (water.current_north.shape[2] - 1) / water.per_east
        (x, south, top), (y, west, right) = (
            told_apart(*axis) for axis in ((north, water.north, far_north), (east, water.east, far_east))
        )
        raise FleetError(
            f"{owner}: {what} is at north {x}, east {y} m, outside the ocean; north must lie in {south} to {top} and"
            f" east in {west} to {right} m: move it or give a larger ocean"
        )
    if state == GROUNDED:
        deep, floor = told_apart(depth, bed_depth(water, north, east))
        raise FleetError(
            f"{owner}: {what} is {deep} m deep; the sea floor at north {north:g}, east {east:g} m is at {floor} m:"
            " choose a smaller depth or another place"
        )


def check_step(vehicle: Vehicle, physics_step: float, water: Water) -> None:
    """Refuse a step [s] by which a float's depth would overshoot, or a swimmer could jump over a waypoint."""
    behaviour = vehicle.behaviour
    if isinstance(behaviour, FloatCycle):
        limit, why = 1.0 / behaviour.depth_gain, "1 / depth_gain, else its depth would overshoot"
    elif isinstance(behaviour, Waypoints):
        currents = np.hypot(water.current_north, water.current_east) if behaviour.current else np.zeros(1)
        limit = behaviour.capture_radius / (behaviour.speed + float(currents.max()))
        why = "capture_radius / speed, a current added, else it could jump over a waypoint"
    else:
        return
    if physics_step > limit:
        raise FleetError(
            f"vehicle {vehicle.name!r}: physics_step is {physics_step:g} s; it may be at most {limit:g} s,"
            f" {why}: shorten the step"
        )
