"""Whether a fleet can be where its vehicles are asked to be, before anything moves."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import FleetError
from pymantaray.fleet._kernel import LEFT_DOMAIN, Water, floor_depth, place
from pymantaray.fleet.behaviours import FloatCycle, Vehicle, Waypoints


def _check_point(owner: str, what: str, point: NDArray[np.float64], water: Water) -> None:
    north, east, depth = (float(value) for value in point)
    if place(water, north, east, 0.0) == LEFT_DOMAIN:
        span_north = (water.current_north.shape[1] - 1) / water.per_north
        span_east = (water.current_north.shape[2] - 1) / water.per_east
        raise FleetError(
            f"{owner}: {what} is at north {north:g}, east {east:g} m, outside the ocean; north must lie in"
            f" {water.north:g} to {water.north + span_north:g} and east in {water.east:g} to"
            f" {water.east + span_east:g} m: move it or give a larger ocean"
        )
    floor = floor_depth(water, north, east)
    if depth > floor:
        raise FleetError(
            f"{owner}: {what} is {depth:g} m deep; the sea floor at north {north:g}, east {east:g} m is at"
            f" {floor:.9g} m: choose a smaller depth or another place"
        )


def check_placement(vehicle: Vehicle, water: Water) -> None:
    """
    Check a vehicle's start, its target depth there, and its waypoints against the ocean.

    Parameters
    ----------
    vehicle : Vehicle
    water : Water

    Raises
    ------
    FleetError
        If one of them is outside the domain or below the sea floor; the message names the vehicle,
        the place and what is allowed.
    """
    owner = f"vehicle {vehicle.name!r}"
    behaviour = vehicle.behaviour
    _check_point(owner, "the start position", vehicle.position, water)
    if isinstance(behaviour, FloatCycle):
        target = np.array([*vehicle.position[:2], behaviour.target_depth])
        _check_point(owner, "target_depth", target, water)
    elif isinstance(behaviour, Waypoints):
        for index, point in enumerate(behaviour.points):
            _check_point(owner, f"waypoint {index}", point, water)


def check_step(vehicle: Vehicle, physics_step: float) -> None:
    """
    Check that a step is short enough for a vehicle's controller.

    Parameters
    ----------
    vehicle : Vehicle
    physics_step : float
        [s]

    Raises
    ------
    FleetError
        If a float's depth controller would overshoot, or a swimmer could jump over a waypoint.
    """
    behaviour = vehicle.behaviour
    if isinstance(behaviour, FloatCycle):
        limit, why = 1.0 / behaviour.depth_gain, "1 / depth_gain, else its depth would overshoot"
    elif isinstance(behaviour, Waypoints):
        limit = behaviour.capture_radius / behaviour.speed
        why = "capture_radius / speed, else it could jump over a waypoint"
    else:
        return
    if physics_step > limit:
        raise FleetError(
            f"vehicle {vehicle.name!r}: physics_step is {physics_step:g} s; it may be at most {limit:g} s,"
            f" {why}: shorten the step"
        )
