"""Vehicles, existing trajectories and pings of a mission."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pymantaray.arrays import Array
from pymantaray.config.common import utc_instant
from pymantaray.config.fleet import (
    AnyVehicle,
    DriftingVehicle,
    FleetSection,
    FloatSection,
    FloatVehicle,
    StationVehicle,
    TwistVehicle,
    WaypointVehicle,
)
from pymantaray.config.mission import AnySchedule, PingsSection, SlotsSection
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import StudyError
from pymantaray.exchange import Tracks, read_trajectories
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
from pymantaray.geometry import LocalFrame
from pymantaray.jobs.keys import file_stamp
from pymantaray.sensing import PingSchedule, Schedule, SlotSchedule


@dataclass(frozen=True)
class TrackFiles:
    """Files with existing trajectories."""

    files: tuple[str, ...]
    enu: bool
    """True if TUM, EuRoC and KITTI files use ROS's axes."""
    names: tuple[str, ...]
    """Vehicles of the files to use; all if there are none."""

    @property
    def tracks(self) -> Tracks:
        """
        Trajectories of the files; the latest stay in memory as long as the files do not change.
        """
        stamps = []
        for file in self.files:
            try:
                stamps.append(file_stamp(Path(file)))
            except OSError as error:
                raise StudyError(f"{file}: cannot be read: {error.strerror}") from None
        return _read(self, tuple(stamps))


@lru_cache(maxsize=1)
def _read(own: TrackFiles, _stamps: tuple[str, ...]) -> Tracks:
    return read_trajectories(own.files, enu=own.enu, names=own.names)


def build_vehicles(fleet: FleetSection) -> tuple[Vehicle, ...]:
    """Vehicles of a section in their order; none for existing trajectories."""
    return tuple(
        Vehicle(
            name=section.name,
            position=_start_and_waypoints(section, fleet.floats)[0],
            behaviour=_behaviour(section, fleet.floats),
            heading=math.radians(section.heading_deg),
        )
        for section in fleet.vehicles
    )


def _behaviour(section: AnyVehicle, floats: FloatSection) -> Behaviour:
    """Behaviour of a vehicle; a float's own values replace those of all floats."""
    if isinstance(section, FloatVehicle):
        own = {name: getattr(section, name) for name in FloatSection.model_fields}
        of = floats.model_copy(update={name: v for name, v in own.items() if v is not None})
        return FloatCycle(
            target_depth=section.target_depth,
            start_delay=section.start_delay_h * 3600.0,
            hold_depth_time=of.hold_depth_h * 3600.0,
            hold_surface_time=of.hold_surface_h * 3600.0,
            vertical_speed=of.vertical_speed,
            surface_depth=of.surface_depth,
            depth_gain=of.depth_gain,
        )
    if isinstance(section, StationVehicle):
        return StationKeeping(depth=section.depth)
    if isinstance(section, DriftingVehicle):
        drogue = section.depth if section.drogue_depth is None else section.drogue_depth
        return Drifting(depth=section.depth, drogue_depth=drogue)
    if isinstance(section, TwistVehicle):
        return ConstantTwist(twist=np.array(section.twist), current=section.current)
    return Waypoints(
        points=np.array(section.points),
        speed=section.speed,
        turn_rate=math.radians(section.turn_rate_deg),
        capture_radius=section.capture_radius,
        loop=section.loop,
        current=section.current,
    )


def _start_and_waypoints(section: AnyVehicle, floats: FloatSection) -> Array:
    """Initial position of a vehicle, and its waypoints or the lower hold of a float (n, 3). [m]"""
    depth = section.depth
    more: list[tuple[float, float, float]] = []
    if isinstance(section, FloatVehicle):
        surface = floats.surface_depth if section.surface_depth is None else section.surface_depth
        depth = surface if depth is None else depth
        more = [(section.north, section.east, section.target_depth)]
    elif isinstance(section, WaypointVehicle):
        more = [*section.points]
    return np.array([(section.north, section.east, depth), *more], dtype=float)


@dataclass(frozen=True, eq=False)
class MissionPings:
    """Pings of a mission: of all vehicles at an interval, or by a schedule of its own."""

    interval: float
    """[s]"""
    first: float | None
    """Time of the first ping; None for the interval. [s]"""
    own: AnySchedule | None
    """Schedule instead of the interval."""
    start: np.datetime64 | None
    """Start of the mission, for pings with dates; None if it is unknown."""
    existing: TrackFiles | None
    """Existing trajectories, whose start is that of the mission."""

    @property
    def files(self) -> tuple[str, ...]:
        """Files of the pings and of the trajectories, which have their start."""
        own = (self.own.file,) if isinstance(self.own, PingsSection) else ()
        return (*own, *(() if self.existing is None else self.existing.files))

    @cached_property
    def schedule(self) -> Schedule:
        """Times, transmitters and receivers of the pings, read from a file if they are in one."""
        if self.own is None:
            return PingSchedule(interval=self.interval, start=self.first)
        if isinstance(self.own, SlotsSection):
            return SlotSchedule(self.own.slots, self.own.slot_s, self.own.start_s)
        start = self.start if self.existing is None else self.existing.tracks.start
        return read_pings(Path(self.own.file), start)

    def count(self, vehicles: int, duration: float) -> float:
        """Number of pings of some vehicles in a mission [s]; 0 for a table of pings."""
        if self.own is None:
            return vehicles * duration / self.interval
        return duration / self.own.slot_s if isinstance(self.own, SlotsSection) else 0.0


@dataclass(frozen=True, eq=False)
class MissionFleet:
    """Vehicles of a mission, simulated or with existing trajectories, and their sampling."""

    vehicles: tuple[Vehicle, ...]
    """Vehicles to simulate; none for existing trajectories."""
    existing: TrackFiles | None
    duration: float
    """[s]"""
    physics_step: float
    """Step of the vehicles' motion. [s]"""
    sampling_period: float
    """[s]"""
    start: np.datetime64 | None
    """Start of the mission; None for the time of the ocean."""
    sampled_pings: MissionPings | None
    """Pings at which poses have more samples; None if all pings are at samples anyway."""

    @property
    def files(self) -> tuple[str, ...]:
        """Files of the trajectories, and of the pings at which poses are sampled."""
        own = () if self.existing is None else self.existing.files
        pings = () if self.sampled_pings is None else self.sampled_pings.files
        return tuple(dict.fromkeys([*own, *pings]))

    @property
    def names(self) -> list[str]:
        """Names of the vehicles in order."""
        if self.existing is not None:
            return list(self.existing.tracks.names)
        return [vehicle.name for vehicle in self.vehicles]

    @property
    def count(self) -> int:
        """Number of vehicles."""
        return len(self.vehicles if self.existing is None else self.existing.tracks.poses)

    @property
    def steps(self) -> float:
        """Integration steps of each vehicle; 0 for existing trajectories."""
        return self.duration / self.physics_step if self.existing is None else 0.0

    @property
    def samples(self) -> float:
        """Number of samples of each vehicle, without those at pings."""
        return self.duration / self.sampling_period


def track_files(fleet: FleetSection) -> TrackFiles | None:
    """Files with existing trajectories of a section; None for simulated vehicles."""
    if not fleet.trajectories:
        return None
    return TrackFiles(fleet.trajectories, fleet.enu, fleet.names)


def build_pings(config: StudyConfig) -> MissionPings:
    """Pings of a study."""
    mission = config.mission
    return MissionPings(
        interval=mission.ping_interval_h * 3600.0,
        first=None if mission.ping_start_h is None else mission.ping_start_h * 3600.0,
        own=mission.schedule,
        start=_start(config),
        existing=track_files(config.fleet),
    )


def build_fleet(config: StudyConfig) -> MissionFleet:
    """Fleet of a study."""
    mission = config.mission
    existing = track_files(config.fleet)
    sampled = existing is not None or mission.schedule is not None
    return MissionFleet(
        vehicles=build_vehicles(config.fleet),
        existing=existing,
        duration=mission.duration_h * 3600.0,
        physics_step=mission.physics_step_s,
        sampling_period=mission.sampling_period_s,
        start=_start(config),
        sampled_pings=build_pings(config) if sampled else None,
    )


def _start(config: StudyConfig) -> np.datetime64 | None:
    return None if config.ocean.time is None else utc_instant(config.ocean.time)


def planned_points(config: StudyConfig) -> dict[str, Array]:
    """
    Start and waypoints (n, 3) of each vehicle and landmark without drift; all points of an existing
    trajectory. [m]

    Points with latitudes and longitudes require the frame's centre in the configuration, see
    `with_tracks`.
    """
    marks = {
        mark.name: np.array([[mark.north, mark.east, mark.depth]]) for mark in config.landmarks
    }
    existing = track_files(config.fleet)
    if existing is not None:
        frame = LocalFrame(*(config.ocean.centre or (0.0, 0.0)))  # local points do not depend on it
        return {p.name: p.place for p in existing.tracks.in_frame(frame)} | marks
    fleet = config.fleet
    return {v.name: _start_and_waypoints(v, fleet.floats) for v in fleet.vehicles} | marks


def with_tracks(config: StudyConfig, tracks: Tracks | None = None) -> StudyConfig:
    """
    Complete a configuration from its fleet's trajectories; a configuration with simulated vehicles
    is unchanged.

    The trajectories set the duration of the mission and the dates of water that varies. The frame's
    centre is the one in a file, or the middle of their latitudes and longitudes.
    """
    existing = track_files(config.fleet)
    if existing is None:
        return config
    tracks = existing.tracks if tracks is None else tracks
    lasts = tracks.duration / 3600.0
    ocean = config.ocean
    if "duration_h" not in config.mission.model_fields_set:
        mission = config.mission.model_copy(update={"duration_h": lasts})
        config = config.model_copy(update={"mission": mission})
    elif config.mission.duration_h > lasts * (1.0 + 1e-9):
        raise StudyError(
            f"mission.duration_h is {config.mission.duration_h:g} h, but the trajectories last"
            f" {lasts:.6g} h; remove the key"
        )
    place: dict[str, Any] = {}
    if ocean.centre is None and tracks.centre is not None:
        place |= dict(zip(("centre_lat", "centre_lon"), tracks.centre, strict=True))
    if ocean.time_varying and ocean.time is None and tracks.start is not None:
        place["time"] = tracks.start.astype("datetime64[us]").item()
    names = [*tracks.names, *(mark.name for mark in config.landmarks)]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise StudyError(
            f"names of vehicles and landmarks must differ; found {twice} more than once"
        )
    return config.model_copy(update={"ocean": ocean.model_copy(update=place)})
