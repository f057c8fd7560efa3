"""From configuration to the objects that the other folders work with."""

import math
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import (
    Sonar,
)
from pymantaray.config.sections import (
    AnyVehicle,
    DriftingVehicle,
    FloatSection,
    FloatVehicle,
    PingsSection,
    RangingSection,
    SlotsSection,
    StationVehicle,
    StudyConfig,
    TwistVehicle,
)
from pymantaray.exchange.table import read_pings
from pymantaray.fleet import (
    Behaviour,
    ConstantTwist,
    Drifting,
    FloatCycle,
    StationKeeping,
    Vehicle,
    Waypoints,
)
from pymantaray.fleet.simulate import fleet_refusals
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.ocean.schema import Finding
from pymantaray.records import Trajectories
from pymantaray.sensing import (
    Landmark,
    Picker,
    PingSchedule,
    Schedule,
    SlotSchedule,
)
from pymantaray.study.tracks import read_fleet
from pymantaray.water.instants import utc_instant
from pymantaray.water.ocean import OceanFields, local_ocean


def gnss_depth(config: StudyConfig, ocean: OceanFields, truth: Trajectories) -> float | NDArray[np.float64]:
    """Depth above which vehicles have a GNSS fix: that of the mission, 0 under ice. [m]"""
    if "sea_ice_draft" not in ocean.local:
        return config.mission.gnss_depth
    surface = BoundarySurface.from_dataset(ocean.local, "sea_ice_draft")
    if surface.depth.size == 1:
        return 0.0 if surface.depth.any() else config.mission.gnss_depth
    draft = surface.depth_at(truth.position.reshape(-1, 3)).reshape(truth.position.shape[:2])
    return np.where(draft > 0.0, 0.0, config.mission.gnss_depth)


def altitude(ocean: OceanFields, truth: Trajectories) -> NDArray[np.float64]:
    """Height of each vehicle above the sea floor at each sample. [m]"""
    bed = BoundarySurface.from_dataset(ocean.local, "sea_floor_depth")
    depth = bed.depth_at(truth.position.reshape(-1, 3)).reshape(truth.position.shape[:2])
    return np.asarray(depth - truth.position[..., 2])


def build_fleet(config: StudyConfig) -> list[Vehicle]:
    """Vehicles of a study, in the configured order."""
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


def fleet_plan(config: StudyConfig) -> dict[str, NDArray[np.float64]]:
    """
    Points (n, 3) that each vehicle and landmark starts from and plans to reach, drift not foreseen; of trajectories, all. [m]

    Those that have latitudes and longitudes need the frame's centre in the configuration, see `with_tracks`.
    """
    marks = {mark.name: np.array([[mark.north, mark.east, mark.depth]]) for mark in config.landmarks}
    plan = {vehicle.name: [tuple(vehicle.position)] for vehicle in build_fleet(config)}
    for vehicle in config.fleet.vehicles:
        if vehicle.kind == "float":
            plan[vehicle.name].append((vehicle.north, vehicle.east, vehicle.target_depth))
        elif vehicle.kind == "waypoints":
            plan[vehicle.name].extend(vehicle.points)
    if config.fleet.trajectories:
        tracks = read_fleet(config.fleet)
        frame = LocalFrame(*(config.ocean.centre or (0.0, 0.0)))  # of places in the frame itself any will do
        return {p.name: p.place for p in tracks.in_frame(frame)} | marks
    return {name: np.array(points, dtype=float) for name, points in plan.items()} | marks


def fleet_findings(
    config: StudyConfig, geographic: xr.Dataset, sea_floor: xr.DataArray | None
) -> list[Finding]:
    """What a run of a study in an ocean would refuse of its vehicles, by the run's own check; nothing of given trajectories."""
    local = local_ocean(config.ocean, geographic, sea_floor)
    refusals = fleet_refusals(build_fleet(config), local, config.mission.physics_step_s)
    return [Finding("wrong", "fleet", str(refusal)) for refusal in refusals]


def build_schedule(config: StudyConfig) -> Schedule:
    """Who pings when in a study."""
    schedule = config.mission.schedule
    if isinstance(schedule, SlotsSection):
        return SlotSchedule(schedule.slots, schedule.slot_s, schedule.start_s)
    if isinstance(schedule, PingsSection):
        start = None if config.ocean.time is None else utc_instant(config.ocean.time)
        if config.fleet.trajectories:
            start = read_fleet(config.fleet).start
        return read_pings(Path(schedule.file), start)
    return PingSchedule(interval=config.mission.ping_interval_h * 3600.0)


def build_landmarks(config: StudyConfig) -> list[Landmark]:
    """Landmarks of a study, in the configured order."""
    return [
        Landmark(name=mark.name, position=np.array([mark.north, mark.east, mark.depth]), sigma=mark.sigma)
        for mark in config.landmarks
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
    if isinstance(vehicle, DriftingVehicle):
        drogue = vehicle.depth if vehicle.drogue_depth is None else vehicle.drogue_depth
        return Drifting(depth=vehicle.depth, drogue_depth=drogue)
    if isinstance(vehicle, TwistVehicle):
        return ConstantTwist(twist=np.array(vehicle.twist), current=vehicle.current)
    return Waypoints(
        points=np.array(vehicle.points),
        speed=vehicle.speed,
        turn_rate=math.radians(vehicle.turn_rate_deg),
        capture_radius=vehicle.capture_radius,
        loop=vehicle.loop,
        current=vehicle.current,
    )


def build_picker(section: RangingSection, sonar: Sonar | None) -> Picker | None:
    """Rule by which a study's receivers take an arrival for the direct one; None if they never err."""
    if section.mistaken == "none":
        return None
    return Picker(
        rule=section.mistaken,
        sonar=sonar,
        below_strongest_db=section.below_strongest_db,
    )
