"""From vehicles and an ocean to their true trajectories."""

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import FleetError
from pymantaray.fleet import _kernel, _kernel_float
from pymantaray.fleet.behaviours import ConstantTwist, FloatCycle, Vehicle, Waypoints, unique_names
from pymantaray.fleet.placement import check_placement, check_step
from pymantaray.fleet.water import water_from_dataset
from pymantaray.records import Trajectories

Array = NDArray[np.float64]


def _whole(name: str, value: float, unit_name: str, unit: float) -> int:
    """Count how often one time fits into another, exactly."""
    count = round(value / unit)
    if count < 1 or abs(value - count * unit) > 1e-9 * value:
        raise FleetError(
            f"simulate: {name} is {value:g} s, {value / unit:.6g} times {unit_name} ({unit:g} s); it must be"
            " a whole number of times, at least once: change one of them"
        )
    return count


def _start_quaternion(heading: float) -> tuple[float, float, float, float]:
    half = 0.5 * math.remainder(heading, 2.0 * math.pi)
    return math.cos(half), 0.0, 0.0, math.sin(half)


def _run(
    vehicle: Vehicle,
    water: _kernel.Water,
    step: float,
    steps: int,
    position: Array,
    quaternion: Array,
    status: NDArray[np.int8],
) -> None:
    """Fill one vehicle's rows, which hold its start pose everywhere."""
    behaviour = vehicle.behaviour
    if isinstance(behaviour, FloatCycle):
        cycle = _kernel_float.Cycle(
            target=float(behaviour.target_depth),
            surface=float(behaviour.surface_depth),
            speed=float(behaviour.vertical_speed),
            gain=float(behaviour.depth_gain),
            tolerance=float(behaviour.arrival_tolerance),
            delay=round(behaviour.start_delay / step),
            hold_depth=round(behaviour.hold_depth_time / step),
            hold_surface=round(behaviour.hold_surface_time / step),
        )
        _kernel_float.run_float(water, cycle, step, steps, position, status)
    elif isinstance(behaviour, ConstantTwist):
        _kernel.run_twist(water, behaviour.twist, step, steps, position, quaternion, status)
    elif isinstance(behaviour, Waypoints):
        _kernel.run_waypoints(
            water,
            behaviour.points,
            float(behaviour.speed),
            float(behaviour.turn_rate),
            float(behaviour.capture_radius),
            behaviour.loop,
            step,
            steps,
            position,
            quaternion,
            status,
        )


def simulate(
    vehicles: Sequence[Vehicle],
    ocean: xr.Dataset,
    *,
    duration: float,
    physics_step: float,
    sampling_period: float,
) -> Trajectories:
    """
    True poses of a fleet, sampled at 0, T, 2T, ..., duration.

    Parameters
    ----------
    vehicles : sequence of Vehicle
        Names must be unique.
    ocean : xarray.Dataset
        Local data set: uniform axes ``north`` and ``east``, levels ``depth`` [m]; ``current_north``,
        ``current_east`` (north, east, depth) [m s⁻¹]; ``sea_floor_depth`` (north, east) or
        (floor_north, floor_east) [m]. Currents with a further axis ``time``, seconds from the mission's
        start, are linear between its instants, which must enclose the mission.
    duration : float
        Length of the mission, a whole number of sampling periods. [s]
    physics_step : float
        Step of the integration. [s]
    sampling_period : float
        Time between samples, a whole number of steps. [s]

    Returns
    -------
    Trajectories
        One row per vehicle, in the order given. A vehicle that leaves the ocean or meets the sea floor
        keeps its last pose inside, and its status says so from the next sample on.

    Raises
    ------
    FleetError
        If the times do not fit each other or the ocean's, a vehicle starts outside the ocean or below the sea floor,
        has its target there, shares its name, or needs a shorter step; one line with the remedy.

    Notes
    -----
    Every step a vehicle commands a body twist, which the exponential map carries over the step
    exactly. A float commands the current at the middle of the step, in place and time, the place predicted
    with the previous step's current: second order in the step. Hold times and delays are rounded to whole steps.
    """
    for name, value in (
        ("duration", duration),
        ("physics_step", physics_step),
        ("sampling_period", sampling_period),
    ):
        if not math.isfinite(value) or value <= 0.0:
            raise FleetError(f"simulate: {name} is {value:g} s; it must be finite and positive")
    steps = _whole("sampling_period", sampling_period, "physics_step", physics_step)
    periods = _whole("duration", duration, "sampling_period", sampling_period)
    names = unique_names(vehicles)
    water = water_from_dataset(ocean)
    if water.time.size > 1 and not (water.time[0] <= 0.0 and duration <= water.time[-1]):
        raise FleetError(
            f"simulate: the currents are given from {water.time[0]:g} to {water.time[-1]:g} s; the mission takes 0 to"
            f" {duration:g} s: give snapshots that enclose it"
        )
    for vehicle in vehicles:
        check_placement(vehicle, water)
        check_step(vehicle, physics_step)

    position = np.empty((len(vehicles), periods + 1, 3))
    quaternion = np.empty((len(vehicles), periods + 1, 4))
    status = np.zeros((len(vehicles), periods + 1), dtype=np.int8)
    for row, vehicle in enumerate(vehicles):
        position[row] = vehicle.position
        quaternion[row] = _start_quaternion(vehicle.heading)
        _run(vehicle, water, float(physics_step), steps, position[row], quaternion[row], status[row])
    return Trajectories(
        name=np.array(names),
        role=np.array([vehicle.behaviour.role for vehicle in vehicles]),
        time=np.arange(periods + 1) * float(sampling_period),
        position=position,
        quaternion=quaternion,
        status=status,
    )
