"""Trajectories of other programs as the fleet of a study."""

from collections.abc import Hashable, Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.config.door.study import Study
from pymantaray.errors import StudyError
from pymantaray.exchange import Tracks
from pymantaray.exchange.tracks import union_of_times
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.schema import latitude, longitude
from pymantaray.records import Trajectories


class MissionSize(NamedTuple):
    """Amount of work of a mission, known before it runs."""

    vehicles: int
    samples: float
    """Number of samples of each vehicle, without those at pings."""
    steps: float
    """Integration steps of each vehicle; 0 for existing trajectories."""
    pings: float
    """Number of pings of all vehicles; 0 for a table of pings."""


def mission_size(study: Study) -> MissionSize:
    """Size of a mission from its study and, if they exist, its trajectories."""
    fleet = study.fleet
    vehicles = fleet.count
    pings = study.ranging.pings.count(vehicles, fleet.duration)
    return MissionSize(vehicles, fleet.samples, fleet.steps, pings)


def centre_note(
    centre: tuple[float, float] | None, ocean: Mapping[Hashable, Any], tracks: Tracks
) -> str | None:
    """
    Message with the centre of the frame of local positions; None if a file gives it, or the study
    by ``centre``. [degrees]
    """
    if tracks.geodetic or centre is not None or tracks.centre is not None:
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
