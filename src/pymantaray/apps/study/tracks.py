"""Trajectories of other programs as the fleet of a study."""

from collections.abc import Hashable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.config.fleet import FleetSection
from pymantaray.config.mission import SlotsSection
from pymantaray.config.sections import StudyConfig
from pymantaray.errors import StudyError
from pymantaray.exchange import Tracks, read_trajectories
from pymantaray.exchange.tracks import union_of_times
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.schema import latitude, longitude
from pymantaray.records import Trajectories


def read_fleet(fleet: FleetSection) -> Tracks:
    """
    Trajectories of a fleet's files; the latest stay in memory as long as their files do not change.
    """
    stamps = []
    for file in fleet.trajectories:
        try:
            status = Path(file).stat()
        except OSError as error:
            raise StudyError(f"{file}: cannot be read: {error.strerror}") from None
        stamps.append((status.st_mtime_ns, status.st_size))
    return _read(fleet.trajectories, tuple(stamps), enu=fleet.enu, names=fleet.names)


@lru_cache(maxsize=1)
def _read(
    files: tuple[str, ...],
    _stamps: tuple[tuple[int, int], ...],
    *,
    enu: bool,
    names: tuple[str, ...],
) -> Tracks:
    return read_trajectories(files, enu=enu, names=names)


class MissionSize(NamedTuple):
    """Amount of work of a mission, known before it runs."""

    vehicles: int
    samples: float
    """Number of samples of each vehicle, without those at pings."""
    steps: float
    """Integration steps of each vehicle; 0 for existing trajectories."""
    pings: float
    """Number of pings of all vehicles; 0 for a table of pings."""


def mission_size(config: StudyConfig) -> MissionSize:
    """Size of a mission from its configuration and, if they exist, its trajectories."""
    mission = config.mission
    own = bool(config.fleet.trajectories)
    vehicles = len(read_fleet(config.fleet).poses) if own else len(config.fleet.vehicles)
    duration = mission.duration_h * 3600.0
    schedule = mission.schedule
    pings = vehicles * duration / (mission.ping_interval_h * 3600.0)
    if schedule is not None:
        pings = duration / schedule.slot_s if isinstance(schedule, SlotsSection) else 0.0
    steps = 0.0 if own else duration / mission.physics_step_s
    return MissionSize(vehicles, duration / mission.sampling_period_s, steps, pings)


def with_tracks(config: StudyConfig, tracks: Tracks | None = None) -> StudyConfig:
    """
    Complete a configuration from its fleet's trajectories; a configuration with simulated vehicles
    is unchanged.

    The trajectories set the duration of the mission and the dates of water that varies. The frame's
    centre is the one in a file, or the middle of their latitudes and longitudes.
    """
    if not config.fleet.trajectories:
        return config
    tracks = read_fleet(config.fleet) if tracks is None else tracks
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


def centre_note(config: StudyConfig, ocean: Mapping[Hashable, Any], tracks: Tracks) -> str | None:
    """
    Message with the centre of the frame of local positions; None if a file or the configuration
    gives it.
    """
    if tracks.geodetic or config.ocean.centre is not None or tracks.centre is not None:
        return None
    if "centre_latitude_deg" not in ocean:
        return None  # the water is the same everywhere
    lat = float(ocean["centre_latitude_deg"])
    lon = float(ocean["centre_longitude_deg"])
    return (
        f"{tracks.poses[0].file}: positions are local and no file gives the centre of their frame;"
        f" the middle of the ocean is used, {latitude(lat)}, {longitude(lon)}; for another centre"
        " give `centre` (in a study: ocean.centre_lat and ocean.centre_lon)"
    )


def sample_tracks(
    tracks: Tracks, duration: float, period: float, pings: Array, local: xr.Dataset
) -> Trajectories:
    """
    Trajectories in a local ocean, sampled every period [s] from the first pose, at the end and at
    every ping.
    """
    # water without a location has tracks in its own frame, which does not depend on the centre
    frame = LocalFrame(
        *(local.attrs.get(f"centre_{axis}_deg", 0.0) for axis in ("latitude", "longitude"))
    )
    grid = np.append(np.arange(0.0, duration * (1.0 - 1e-12), period), duration)
    truth = tracks.at(union_of_times(grid, pings), frame)
    place = truth.position[..., :2]
    low, high = ([float(local[axis][end]) for axis in ("north", "east")] for end in (0, -1))
    if not ((place >= low) & (place <= high)).all(axis=-1).any():
        (north, east), (far_north, far_east) = (
            place.min(axis=(0, 1)) / 1e3,
            place.max(axis=(0, 1)) / 1e3,
        )
        raise StudyError(
            f"{tracks.poses[0].file}: no pose is in the ocean: poses are {north:.1f} to"
            f" {far_north:.1f} km north, {east:.1f} to {far_east:.1f} km east of"
            f" {latitude(frame.latitude_deg)}, {longitude(frame.longitude_deg)}; the ocean reaches"
            f" {low[0] / 1e3:.1f} to {high[0] / 1e3:.1f} and {low[1] / 1e3:.1f} to"
            f" {high[1] / 1e3:.1f}; give another ocean or centre"
        )
    return truth
