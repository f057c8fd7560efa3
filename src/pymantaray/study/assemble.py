"""From configuration to the objects that the other folders work with."""

import datetime as dt
import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from pymantaray.fleet import Behaviour, ConstantTwist, FloatCycle, StationKeeping, Vehicle, Waypoints
from pymantaray.ocean import open_ocean, region_table, sound_speed_profile_spread, to_local
from pymantaray.study.config import OceanSection, StudyConfig
from pymantaray.study.config_fleet import AnyVehicle, FloatSection, FloatVehicle, StationVehicle, TwistVehicle


@dataclass(frozen=True, eq=False)
class StudyOcean:
    """The water that a study takes place in, and what there is to say about where it comes from."""

    geographic: xr.Dataset
    """Temperature, salinity and currents as the source has them: depth, lat, lon."""
    local: xr.Dataset
    """Dimensions north, east, depth."""
    profile: xr.Dataset
    """Mean, least and greatest sound speed of each level over the region."""
    region: pd.DataFrame
    """Properties of the region, one row each."""


def build_ocean(section: OceanSection) -> StudyOcean:
    """
    Ocean of a study, in its local frame.

    Parameters
    ----------
    section : OceanSection

    Returns
    -------
    StudyOcean

    Raises
    ------
    OceanError
        If the source cannot be read, is not a valid ocean or does not hold the domain asked for.
    """
    time = section.time
    if time is not None and time.tzinfo is not None:
        time = time.astimezone(dt.UTC).replace(tzinfo=None)
    geographic = open_ocean(section.source, time=None if time is None else np.datetime64(time, "ns"))
    return StudyOcean(
        geographic=geographic,
        local=to_local(geographic, centre=section.centre, half_extent=section.half_extent),
        profile=sound_speed_profile_spread(geographic),
        region=region_table(geographic),
    )


def build_fleet(config: StudyConfig) -> list[Vehicle]:
    """
    Vehicles of a study, in the configured order.

    Parameters
    ----------
    config : StudyConfig

    Returns
    -------
    list of Vehicle

    Raises
    ------
    FleetError
        If a vehicle's parameters do not fit each other.
    """
    floats = config.fleet.floats
    return [
        Vehicle(
            name=vehicle.name,
            position=np.array([vehicle.north, vehicle.east, _start_depth(vehicle, floats)]),
            behaviour=_behaviour(vehicle, floats),
            heading=math.radians(vehicle.heading_deg),
        )
        for vehicle in config.fleet.vehicles
    ]


def _start_depth(vehicle: AnyVehicle, floats: FloatSection) -> float:
    if isinstance(vehicle, FloatVehicle):
        return floats.surface_depth if vehicle.surface_depth is None else vehicle.surface_depth
    return vehicle.depth


def _behaviour(vehicle: AnyVehicle, floats: FloatSection) -> Behaviour:
    if isinstance(vehicle, FloatVehicle):
        own = {name: getattr(vehicle, name) for name in FloatSection.model_fields}
        merged = floats.model_copy(update={name: value for name, value in own.items() if value is not None})
        return FloatCycle(
            target_depth=vehicle.target_depth,
            start_delay=vehicle.start_delay_h * 3600.0,
            hold_depth_time=merged.hold_depth_h * 3600.0,
            hold_surface_time=merged.hold_surface_h * 3600.0,
            vertical_speed=merged.vertical_speed,
            surface_depth=merged.surface_depth,
            depth_gain=merged.depth_gain,
            arrival_tolerance=merged.arrival_tolerance,
        )
    if isinstance(vehicle, StationVehicle):
        return StationKeeping(depth=vehicle.depth)
    if isinstance(vehicle, TwistVehicle):
        return ConstantTwist(twist=np.array(vehicle.twist))
    return Waypoints(
        points=np.array(vehicle.points),
        speed=vehicle.speed,
        turn_rate=math.radians(vehicle.turn_rate_deg),
        capture_radius=vehicle.capture_radius,
        loop=vehicle.loop,
    )
