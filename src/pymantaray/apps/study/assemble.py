"""Conversion of a configuration to the objects of other folders."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.ocean_fields import OceanFields
from pymantaray.apps.study.tracks import read_fleet
from pymantaray.config.build.metres import section_in_metres
from pymantaray.config.build.ocean import build_ocean, local_ocean, open_geographic
from pymantaray.config.sections import StudyConfig
from pymantaray.fleet.simulation import fleet_refusals
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.ocean.instants import utc_instant
from pymantaray.ocean.schema import Finding
from pymantaray.records import Trajectories
from pymantaray.sensing import Schedule


def gnss_depth(
    depth: float, ocean: OceanFields, truth: Trajectories
) -> float | NDArray[np.float64]:
    """Maximum depth of a GNSS fix: the argument in open water, 0 under ice. [m]"""
    if "sea_ice_draft" not in ocean.local:
        return depth
    surface = BoundarySurface.from_dataset(ocean.local, "sea_ice_draft")
    if surface.depth.size == 1:
        return 0.0 if surface.depth.any() else depth
    draft = surface.depth_at(truth.position.reshape(-1, 3)).reshape(truth.position.shape[:2])
    return np.where(draft > 0.0, 0.0, depth)


def altitude(ocean: OceanFields, truth: Trajectories) -> NDArray[np.float64]:
    """Height of each vehicle above the sea floor at each sample. [m]"""
    bed = BoundarySurface.from_dataset(ocean.local, "sea_floor_depth")
    depth = bed.depth_at(truth.position.reshape(-1, 3)).reshape(truth.position.shape[:2])
    return np.asarray(depth - truth.position[..., 2])


def fleet_plan(config: StudyConfig) -> dict[str, NDArray[np.float64]]:
    """
    Start and waypoints (n, 3) of each vehicle and landmark without drift; all points of an existing
    trajectory. [m]

    Points with latitudes and longitudes require the frame's centre in the configuration, see
    `with_tracks`.
    """
    marks = {mark.name: mark.position[None] for mark in config.landmarks}
    if config.fleet.trajectories:
        tracks = read_fleet(config.fleet)
        frame = LocalFrame(*(config.ocean.centre or (0.0, 0.0)))  # local points do not depend on it
        return {p.name: p.place for p in tracks.in_frame(frame)} | marks
    return config.fleet.planned() | marks


def fleet_findings(config: StudyConfig) -> list[Finding]:
    """Findings of the check of a run's vehicles in its ocean; none for existing trajectories."""
    section = config.ocean
    if section_in_metres(section):
        local = build_ocean(section, 0.0).local
    else:
        local = local_ocean(section, *open_geographic(section))
    refusals = fleet_refusals(config.fleet.build(), local, config.mission.physics_step_s)
    return [Finding("wrong", "fleet", str(refusal)) for refusal in refusals]


def build_schedule(config: StudyConfig) -> Schedule:
    """Schedule of the pings of a study."""
    start = None if config.ocean.time is None else utc_instant(config.ocean.time)
    if config.fleet.trajectories and config.mission.schedule is not None:
        start = read_fleet(config.fleet).start
    return config.mission.pings(start)
