"""From vehicles and an ocean to their true trajectories."""

import math
import os
import sys
from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import FleetError
from pymantaray.fleet import kernel
from pymantaray.fleet.behaviours import (
    ConstantTwist,
    Drifting,
    FloatCycle,
    Vehicle,
    Waypoints,
    check_placement,
    check_step,
    unique_names,
)
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.geometry.checks import check_number, checked_array
from pymantaray.records import Trajectories

Array = NDArray[np.float64]
_DIMS = ("north", "east", "depth")
_POSE_BYTES = 114  # a pose and its status, twice: as they are made, and in the record


def simulate(
    vehicles: Sequence[Vehicle],
    ocean: xr.Dataset,
    *,
    duration: float,
    physics_step: float,
    sampling_period: float,
    start: np.datetime64 | None = None,
) -> Trajectories:
    """
    True poses of a fleet, sampled at 0, T, 2T, ..., duration.

    Parameters
    ----------
    vehicles : sequence of Vehicle
        Names must be unique.
    ocean : xarray.Dataset
        Local data set: uniform axes ``north`` and ``east``, levels ``depth`` [m]; ``current_north``,
        ``current_east`` (north, east, depth) [m/s]; ``sea_floor_depth`` (north, east) or
        (floor_north, floor_east) [m]. Currents with a further axis ``time``, seconds from the mission's
        start, are linear between its instants, which must enclose the mission. ``sea_ice_draft``, if it is there, one
        value or (north, east): no vehicle rises into the ice, one that would start in it starts at its underside, and a
        float that surfaces holds there. [m]
    duration : float
        Length of the mission, a whole number of sampling periods. [s]
    physics_step : float
        Step of the integration. [s]
    sampling_period : float
        Time between samples, a whole number of steps. [s]
    start : numpy.datetime64, optional
        Date of the mission's start, UTC; by default the ocean's, its attribute ``time``.

    Returns
    -------
    Trajectories
        One row per vehicle, in the order given, with the date of the start and the centre of the ocean's frame if it has
        them. A vehicle that leaves the ocean or meets the sea floor
        keeps its last pose inside, and its status says so from the next sample on.

    Raises
    ------
    FleetError
        If the times do not fit each other or the ocean's, a vehicle starts outside the ocean or below the sea floor,
        has its target there, shares its name, or needs a shorter step, or memory cannot hold the samples; one line with the
        remedy.

    Notes
    -----
    Every step a vehicle commands a body twist, which the exponential map carries over the step
    exactly. A float commands the current at the middle of the step, in place and time, the place predicted
    with the previous step's current: second order in the step. A swimmer that the current carries is moved besides by
    the current at the middle of its step: second order too, and exact where the current is uniform. Hold times and delays are rounded to whole steps.
    """
    steps, periods = _counts(duration, physics_step, sampling_period)
    names, water = unique_names(vehicles), _water(ocean)
    _check_memory(len(vehicles), periods + 1)
    if water.time.size > 1 and not (water.time[0] <= 0.0 and duration <= water.time[-1]):
        raise FleetError(
            f"simulate: the currents are given from {water.time[0]:g} to {water.time[-1]:g} s; the mission takes 0 to"
            f" {duration:g} s: give snapshots that enclose it"
        )
    for refusal in _refusals(vehicles, water, physics_step):
        raise refusal
    position = np.empty((len(vehicles), periods + 1, 3))
    quaternion = np.empty((len(vehicles), periods + 1, 4))
    status = np.zeros((len(vehicles), periods + 1), dtype=np.int8)
    for row, vehicle in enumerate(vehicles):
        top = kernel.surface_depth(water, *map(float, vehicle.position[:2]))
        position[row] = [*vehicle.position[:2], max(vehicle.position[2], top)]
        half = 0.5 * math.remainder(vehicle.heading, 2.0 * math.pi)
        quaternion[row] = math.cos(half), 0.0, 0.0, math.sin(half)
        _run(vehicle, water, float(physics_step), steps, position[row], quaternion[row], status[row])
    return Trajectories(
        name=np.array(names),
        role=np.array([vehicle.behaviour.role for vehicle in vehicles]),
        time=np.arange(periods + 1) * float(sampling_period),
        position=position,
        quaternion=quaternion,
        status=status,
        start=ocean.attrs.get("time", "NaT") if start is None else start,
        centre=_centre(ocean),
    )


def fleet_refusals(vehicles: Sequence[Vehicle], ocean: xr.Dataset, physics_step: float) -> list[FleetError]:
    """Why `simulate` would refuse vehicles in an ocean: where they start or plan to go, or the step; the first of each vehicle."""
    return list(_refusals(vehicles, _water(ocean), physics_step))


def _refusals(vehicles: Sequence[Vehicle], water: kernel.Water, physics_step: float) -> Iterator[FleetError]:
    for vehicle in vehicles:
        try:
            check_placement(vehicle, water)
            check_step(vehicle, physics_step, water)
        except FleetError as error:
            yield error


def _centre(ocean: xr.Dataset) -> tuple[float, float] | None:
    """Latitude and longitude of the centre of the ocean's frame, if it is anywhere on Earth. [degrees]"""
    if "centre_latitude_deg" not in ocean.attrs:
        return None
    return float(ocean.attrs["centre_latitude_deg"]), float(ocean.attrs["centre_longitude_deg"])


def _counts(duration: float, physics_step: float, sampling_period: float) -> tuple[int, int]:
    """Steps in a sampling period and sampling periods in the mission, exactly."""
    named = {"duration": duration, "physics_step": physics_step, "sampling_period": sampling_period}
    for name, value in named.items():
        check_number(FleetError, f"simulate: {name}", value, "s", positive=True)
    counts = []
    for name, unit_name in (("sampling_period", "physics_step"), ("duration", "sampling_period")):
        value, unit = named[name], named[unit_name]
        count = value / unit
        if not math.isfinite(count) or round(count) < 1 or abs(value - round(count) * unit) > 1e-9 * value:
            raise FleetError(
                f"simulate: {name} is {value:g} s, {count:.6g} times {unit_name} ({unit:g} s); it must be"
                " a whole number of times, at least once: change one of them"
            )
        counts.append(round(count))
    return counts[0], counts[1]


def _check_memory(n_vehicles: int, n_samples: int) -> None:
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if n_vehicles * n_samples * _POSE_BYTES > there:
        raise FleetError(
            f"simulate: {n_vehicles} vehicles x {n_samples:g} samples x {_POSE_BYTES} bytes are"
            f" {n_vehicles * n_samples * _POSE_BYTES / 2**30:.3g} GiB of memory; this machine has {there / 2**30:.3g}:"
            " sample less often"
        )


def _run(
    vehicle: Vehicle,
    water: kernel.Water,
    step: float,
    steps: int,
    position: Array,
    quaternion: Array,
    status: NDArray[np.int8],
) -> None:
    """Fill one vehicle's rows, which hold its start pose everywhere."""
    behaviour = vehicle.behaviour
    if isinstance(behaviour, FloatCycle):
        cycle = kernel.Cycle(
            target=float(behaviour.target_depth),
            surface=float(behaviour.surface_depth),
            speed=float(behaviour.vertical_speed),
            gain=float(behaviour.depth_gain),
            tolerance=float(behaviour.arrival_tolerance),
            delay=round(behaviour.start_delay / step),
            hold_depth=round(behaviour.hold_depth_time / step),
            hold_surface=round(behaviour.hold_surface_time / step),
            drogue=0.0,
        )
        kernel.run_float(water, cycle, step, steps, position, status)
    elif isinstance(behaviour, Drifting):
        kernel.run_float(water, _drift_cycle(behaviour, step), step, steps, position, status)
    elif isinstance(behaviour, ConstantTwist):
        twist, current = behaviour.twist, behaviour.current
        kernel.run_twist(water, twist, current, step, steps, position, quaternion, status)
    elif isinstance(behaviour, Waypoints):
        course = kernel.Course(
            points=behaviour.points,
            speed=float(behaviour.speed),
            turn_rate=float(behaviour.turn_rate),
            capture_radius=float(behaviour.capture_radius),
            loop=behaviour.loop,
            carried=behaviour.current,
        )
        kernel.run_waypoints(water, course, step, steps, position, quaternion, status)


def _drift_cycle(behaviour: Drifting, step: float) -> kernel.Cycle:
    """Cycle of a float that holds its first depth for ever, and comes back to it at once from under ice."""
    return kernel.Cycle(
        target=float(behaviour.depth),
        surface=float(behaviour.depth),
        speed=math.inf,
        gain=1.0 / step,
        tolerance=0.0,
        delay=sys.maxsize,
        hold_depth=0,
        hold_surface=0,
        drogue=float(behaviour.drogue_depth - behaviour.depth),
    )


def _water(ocean: xr.Dataset) -> kernel.Water:
    """Arrays of a local ocean data set for the integrators, checked."""
    needed = [*_DIMS, "current_north", "current_east", "sea_floor_depth"]
    absent = [name for name in needed if name not in ocean.variables]
    if absent:
        raise FleetError(
            f"ocean: the data set lacks {', '.join(absent)}; a local data set has {', '.join(needed)}"
        )
    north, east = _axis(ocean, "north", uniform=True), _axis(ocean, "east", uniform=True)
    depth, time = _axis(ocean, "depth", uniform=False), _times(ocean)
    bed, surface = (
        BoundarySurface.from_dataset(ocean, name, FleetError) if name in ocean else BoundarySurface(0.0)
        for name in ("sea_floor_depth", "sea_ice_draft")
    )
    bed.check_extent(north, east, name="ocean: sea_floor_depth", error=FleetError)
    dims = _DIMS if time.size == 1 else ("time", *_DIMS)
    current_north, current_east = (
        _variable(ocean, name, dims).reshape(time.size, north.size, east.size, depth.size)
        for name in ("current_north", "current_east")
    )
    return kernel.Water(
        north=float(north[0]),
        east=float(east[0]),
        per_north=_per_metre(north),
        per_east=_per_metre(east),
        depth=depth,
        time=time,
        current_north=current_north,
        current_east=current_east,
        bed=bed.grid,
        surface=surface.grid,
    )


def _per_metre(axis: Array) -> float:
    """Cells in a metre of a uniform axis."""
    return float((axis.size - 1) / (axis[-1] - axis[0]))


def _axis(ocean: xr.Dataset, name: str, *, uniform: bool) -> Array:
    axis = checked_array(FleetError, f"ocean: axis {name!r}", ocean[name].values, (None,), rising=True)
    if axis.size < 2:
        raise FleetError(f"ocean: axis {name!r} has 1 value; it needs at least 2")
    steps = np.diff(axis)
    if uniform and np.ptp(steps) > 1e-6 * steps.mean():
        raise FleetError(
            f"ocean: axis {name!r} has steps from {steps.min():g} to {steps.max():g} m; they must be equal:"
            " bring the data set to the local frame with pymantaray.ocean.to_local"
        )
    return np.array(axis)  # for arrays that cannot be written to kernels would be compiled again


def _variable(ocean: xr.Dataset, name: str, dims: tuple[str, ...]) -> Array:
    if set(ocean[name].dims) != set(dims):
        raise FleetError(f"ocean: {name} has dimensions {ocean[name].dims}; it needs {dims}")
    values = np.ascontiguousarray(ocean[name].transpose(*dims).values, dtype=float)
    if missing := np.count_nonzero(~np.isfinite(values)):
        raise FleetError(
            f"ocean: {name} has {missing} missing values; none are allowed: fill it with pymantaray.ocean.to_local"
        )
    return values


def _times(ocean: xr.Dataset) -> Array:
    """Instants of the currents, one where they do not vary. [s]"""
    if "time" not in ocean["current_north"].dims:
        return np.zeros(1)
    time = ocean["time"].values
    if not np.issubdtype(time.dtype, np.number):
        raise FleetError(
            f"ocean: time is of type {time.dtype}; it must count seconds from the mission's start"
        )
    return _axis(ocean, "time", uniform=False)
