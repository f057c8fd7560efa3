"""Simulation of true trajectories of vehicles in an ocean."""

import math
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import xarray as xr

from pymantaray.arrays import Array, Codes
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
from pymantaray.quantities.checks import check_number, checked_array
from pymantaray.records import Trajectories

_DIMS = ("north", "east", "depth")
_POSE_BYTES = 114  # pose and status, during the simulation and again in the record


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
    Simulate the true poses of a fleet, sampled at 0, T, 2T, ..., duration.

    Parameters
    ----------
    vehicles : sequence of Vehicle
        Vehicles with unique names.
    ocean : xarray.Dataset
        Local data set: axes ``north``, ``east`` and ``depth`` [m]; ``current_north``,
        ``current_east`` (north, east, depth) [m/s]; ``sea_floor_depth`` (north, east) or
        (floor_north, floor_east) [m]. Currents may have an axis ``time`` in seconds from the start
        of the mission. They are linear between its instants, which must enclose the mission.
        Optional ``sea_ice_draft`` [m], a scalar or on (north, east): vehicles cannot rise into the
        ice. A vehicle that would start in the ice starts at its underside, and a float that
        surfaces holds there.
    duration : float
        Length of the mission, a multiple of the sampling period. [s]
    physics_step : float
        Step of the integration. [s]
    sampling_period : float
        Time between samples, a multiple of the step. [s]
    start : numpy.datetime64, optional
        Date of the mission's start, UTC. Default: attribute ``time`` of the ocean.

    Returns
    -------
    Trajectories
        One row per vehicle in the order of ``vehicles``, with the date of the start and the centre
        of the ocean's frame if the ocean has them. A vehicle that leaves the ocean or reaches the
        sea floor keeps its last pose inside the ocean, and its status changes at the next sample.

    Raises
    ------
    FleetError
        If the times do not match each other or the ocean, a vehicle starts or has its target
        outside the ocean or below the sea floor, two vehicles have one name, a vehicle needs a
        shorter step, or the samples do not fit into memory. The message is one line with the
        remedy.

    Notes
    -----
    In every step, a vehicle commands a body twist, which the exponential map integrates exactly. A
    float commands the current at the middle of the step in space and time. Its position there is
    predicted with the current of the previous step, so the method is second order in the step. For
    a swimmer in a current, the current at the middle of its step adds a displacement. This is also
    second order, and exact in a uniform current. Hold times and delays are rounded to whole steps.

    Examples
    --------
    Continues the example of `pymantaray.fleet`:

    >>> from pymantaray.fleet import Drifting, Vehicle, simulate
    >>> buoy = Vehicle("D", [0.0, 0.0, 15.0], Drifting(depth=15.0))
    >>> truth = simulate([buoy], sea, duration=3600.0, physics_step=10.0, sampling_period=600.0)
    >>> truth.position.shape, truth.status.tolist()
    ((1, 7, 3), [[0, 0, 0, 0, 0, 0, 0]])
    """
    steps, periods = _counts(duration, physics_step, sampling_period)
    names = unique_names(vehicles)
    water = _water(ocean)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    size = len(vehicles) * (periods + 1) * _POSE_BYTES
    if size > memory:
        raise FleetError(
            f"simulate: {len(vehicles)} vehicles x {periods + 1:g} samples x {_POSE_BYTES} bytes"
            f" are {size / 2**30:.3g} GiB of memory; this machine has {memory / 2**30:.3g} GiB;"
            " increase sampling_period"
        )
    if water.time.size > 1 and not (water.time[0] <= 0.0 and duration <= water.time[-1]):
        raise FleetError(
            f"simulate: the currents cover {water.time[0]:g} to {water.time[-1]:g} s, and the"
            f" mission lasts from 0 to {duration:g} s; use snapshots that enclose it"
        )
    for refusal in _refusals(vehicles, water, physics_step):
        raise refusal
    position = np.empty((len(vehicles), periods + 1, 3))
    quaternion = np.empty((len(vehicles), periods + 1, 4))
    status = np.zeros((len(vehicles), periods + 1), dtype=np.int8)
    for row, vehicle in enumerate(vehicles):
        north, east, depth = vehicle.position
        top = kernel.surface_depth(water, float(north), float(east))
        position[row] = [north, east, max(depth, top)]
        half = 0.5 * math.remainder(vehicle.heading, 2.0 * math.pi)
        quaternion[row] = math.cos(half), 0.0, 0.0, math.sin(half)

    def run(row: int) -> None:
        _run(
            vehicles[row],
            water,
            float(physics_step),
            steps,
            position[row],
            quaternion[row],
            status[row],
        )

    # kernels release the GIL, and vehicles do not affect each other
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        _ = list(pool.map(run, range(len(vehicles))))
    centre: tuple[float, float] | None = None
    if "centre_latitude_deg" in ocean.attrs:
        centre = (
            float(ocean.attrs["centre_latitude_deg"]),
            float(ocean.attrs["centre_longitude_deg"]),
        )
    return Trajectories(
        name=np.array(names),
        role=np.array([vehicle.behaviour.role for vehicle in vehicles]),
        time=np.arange(periods + 1) * float(sampling_period),
        position=position,
        quaternion=quaternion,
        status=status,
        start=ocean.attrs.get("time", "NaT") if start is None else start,
        centre=centre,
    )


def fleet_refusals(
    vehicles: Sequence[Vehicle], ocean: xr.Dataset, physics_step: float
) -> list[FleetError]:
    """Errors that `simulate` would raise for vehicles in an ocean, the first of each vehicle."""
    return list(_refusals(vehicles, _water(ocean), physics_step))


def _refusals(
    vehicles: Sequence[Vehicle], water: kernel.OceanArrays, physics_step: float
) -> Iterator[FleetError]:
    for vehicle in vehicles:
        try:
            check_placement(vehicle, water)
            check_step(vehicle, physics_step, water)
        except FleetError as error:
            yield error


def _counts(duration: float, physics_step: float, sampling_period: float) -> tuple[int, int]:
    """Exact numbers of steps per sampling period and sampling periods per mission."""
    times = {"duration": duration, "physics_step": physics_step, "sampling_period": sampling_period}
    for name, value in times.items():
        check_number(FleetError, f"simulate: {name}", value, "s", positive=True)
    counts = []
    for name, unit_name in (("sampling_period", "physics_step"), ("duration", "sampling_period")):
        value = times[name]
        unit = times[unit_name]
        count = value / unit
        if (
            not math.isfinite(count)
            or round(count) < 1
            or abs(value - round(count) * unit) > 1e-9 * value
        ):
            raise FleetError(
                f"simulate: {name} is {value:g} s, {count:.6g} times {unit_name} ({unit:g} s); it"
                " must be an integer multiple, at least one; change one of them"
            )
        counts.append(round(count))
    return counts[0], counts[1]


def _run(
    vehicle: Vehicle,
    water: kernel.OceanArrays,
    step: float,
    steps: int,
    position: Array,
    quaternion: Array,
    status: Codes,
) -> None:
    """Fill the rows of one vehicle, which initially contain its start pose."""
    behaviour = vehicle.behaviour
    if isinstance(behaviour, FloatCycle):
        cycle = kernel.Cycle(
            target=float(behaviour.target_depth),
            surface=float(behaviour.surface_depth),
            start=float(vehicle.position[2]),
            speed=float(behaviour.vertical_speed),
            gain=float(behaviour.depth_gain),
            delay=round(behaviour.start_delay / step),
            hold_depth=round(behaviour.hold_depth_time / step),
            hold_surface=round(behaviour.hold_surface_time / step),
            drogue=0.0,
        )
        kernel.run_float(water, cycle, step, steps, position, status)
    elif isinstance(behaviour, Drifting):
        # a float that holds its first depth forever, and returns to it at once from under ice
        own_depth = float(behaviour.depth)
        cycle = kernel.Cycle(
            target=own_depth,
            surface=own_depth,
            start=own_depth,
            speed=math.inf,
            gain=math.inf,
            delay=sys.maxsize,
            hold_depth=0,
            hold_surface=0,
            drogue=float(behaviour.drogue_depth - behaviour.depth),
        )
        kernel.run_float(water, cycle, step, steps, position, status)
    elif isinstance(behaviour, ConstantTwist):
        twist = behaviour.twist
        kernel.run_twist(water, twist, behaviour.current, step, steps, position, quaternion, status)
    elif isinstance(behaviour, Waypoints):
        route = kernel.Route(
            points=behaviour.points,
            speed=float(behaviour.speed),
            turn_rate=float(behaviour.turn_rate),
            capture_radius=float(behaviour.capture_radius),
            loop=behaviour.loop,
            carried=behaviour.current,
        )
        kernel.run_waypoints(water, route, step, steps, position, quaternion, status)


def _water(ocean: xr.Dataset) -> kernel.OceanArrays:
    """Checked arrays of a local ocean for the integrators."""
    names = [*_DIMS, "current_north", "current_east", "sea_floor_depth"]
    missing = [name for name in names if name not in ocean.variables]
    if missing:
        raise FleetError(
            f"ocean: the data set has no {', '.join(missing)}; a local data set must have"
            f" {', '.join(names)}"
        )
    north, east, depth = (_axis(ocean, name) for name in _DIMS)
    time = _times(ocean)
    bed, surface = (
        BoundarySurface.from_dataset(ocean, name, FleetError)
        if name in ocean
        else BoundarySurface(0.0)
        for name in ("sea_floor_depth", "sea_ice_draft")
    )
    bed.check_extent(north, east, name="ocean: sea_floor_depth", exception=FleetError)
    dims = _DIMS if time.size == 1 else ("time", *_DIMS)
    current_north, current_east = (
        _variable(ocean, name, dims).reshape(time.size, north.size, east.size, depth.size)
        for name in ("current_north", "current_east")
    )
    return kernel.OceanArrays(
        north=north,
        east=east,
        depth=depth,
        time=time,
        current_north=current_north,
        current_east=current_east,
        bed=bed.grid,
        surface=surface.grid,
    )


def _axis(ocean: xr.Dataset, name: str) -> Array:
    axis = checked_array(
        FleetError, f"ocean: axis {name!r}", ocean[name].values, (None,), rising=True
    )
    if axis.size < 2:
        raise FleetError(f"ocean: axis {name!r} has 1 value; it must have at least 2")
    return np.array(axis)  # a copy: read-only arrays would need another compilation


def _variable(ocean: xr.Dataset, name: str, dims: tuple[str, ...]) -> Array:
    if set(ocean[name].dims) != set(dims):
        raise FleetError(f"ocean: {name} has dimensions {ocean[name].dims}; it must have {dims}")
    values = np.ascontiguousarray(ocean[name].transpose(*dims).values, dtype=float)
    if missing := np.count_nonzero(~np.isfinite(values)):
        raise FleetError(
            f"ocean: {name} has {missing} missing values; none are allowed; fill it with"
            " pymantaray.ocean.to_local"
        )
    return values


def _times(ocean: xr.Dataset) -> Array:
    """Instants of the currents; one if they are constant. [s]"""
    if "time" not in ocean["current_north"].dims:
        return np.zeros(1)
    time = ocean["time"].values
    if not np.issubdtype(time.dtype, np.number):
        raise FleetError(
            f"ocean: time has type {time.dtype}; it must be seconds from the start of the mission"
        )
    return _axis(ocean, "time")
