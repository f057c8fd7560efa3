"""Mission without noise: ocean, fleet, rays and measurements, each a timed stage."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Medium, ray_picture, select
from pymantaray.acoustics.ocean_fields import OceanFields
from pymantaray.apps.study.manifest import Stopwatch
from pymantaray.arrays import Array
from pymantaray.config.door.fleet import MissionFleet
from pymantaray.config.door.study import MissionRanging, Study
from pymantaray.errors import MantaRayError, StudyError
from pymantaray.exchange import Tracks
from pymantaray.exchange.tracks import union_of_times, with_times
from pymantaray.fleet import simulate
from pymantaray.fleet.simulation import fleet_refusals
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.geometry.sphere import flat_earth_note
from pymantaray.jobs.progress import CountProgress, Progress
from pymantaray.ocean.internal_tide import displaced, has_internal_tide
from pymantaray.ocean.schema import Finding, latitude, longitude
from pymantaray.records import Arrivals, Measurements, RangingTruth, RayStatus, Trajectories
from pymantaray.sensing import (
    Candidates,
    Hearing,
    Links,
    Ranging,
    RangingDraws,
    Schedule,
    assemble,
    find_candidates,
    measure_ranges,
)
from pymantaray.sensing.transmission import EarlierLinks

if TYPE_CHECKING:
    from pymantaray.apps.study.store import Run

LOG = logging.getLogger(__name__)
FAN = np.radians(np.linspace(-15.0, 15.0, 41))
"""Launch angles of the fan behind the eigenrays, about the chord, as in the paper. [rad]"""


@dataclass(frozen=True, eq=False)
class Mission:
    """Data that all realizations of a study share."""

    ocean: OceanFields
    truth: Trajectories
    links: Links
    arrivals: Arrivals
    measurements: Measurements
    ranging_truth: RangingTruth
    hearing: Hearing | None
    """Detection probability of each attempt; None if every arrival is detected."""
    picture: xr.Dataset | None = None
    """Section through the water along one link, with its rays; None if no link has a ray."""
    candidates: Candidates | None = None
    """
    Arrivals that each attempt may mistake for the direct one; None if no receiver makes mistakes.
    """
    draws: RangingDraws | None = None
    """
    Ranges of every realization, if each has its own ice; the other data are then those of the
    first.
    """


def simulate_mission(
    study: Study,
    watch: Stopwatch,
    progress: Progress,
    *,
    tracks: Tracks | None = None,
    schedule: Schedule | None = None,
    data: xr.Dataset | None = None,
) -> Mission:
    """
    Run a mission up to its measurements without noise; the stopwatch records the duration of each
    stage.

    ``tracks``, ``schedule`` and ``data`` (the ocean) replace those of the study if they are in
    memory.
    """
    landmarks = [mark.name for mark in study.ranging.landmarks]
    names = study.fleet.names if tracks is None else tracks.names
    if not study.solves and len(names) + len(landmarks) < 2:
        raise StudyError(
            f"no ranges: {names[0]} is the only vehicle and there is no landmark; add the"
            " trajectory of another vehicle, or a landmark: [[landmarks]] with name, north, east"
            " and depth"
        )
    # a schedule must name participants of the mission
    if schedule is not None or study.ranging.pings.own is not None:
        (schedule or study.schedule).check_names(names, landmarks)
    progress("ocean", 0, 1)
    with watch.stage("ocean"):
        ocean = study.ocean.open(study.sound.interpolation, data)
    progress("ocean", 1, 1)

    progress("fleet", 0, 1)
    with watch.stage("fleet"):
        truth = simulate_fleet(study.fleet, ocean, tracks=tracks, schedule=schedule)
    progress("fleet", 1, 1)

    progress("rays", 0, 1)
    with watch.stage("medium"):
        medium = study.sound.medium(ocean)
        ocean = with_notes(ocean, medium)
    with watch.stage("rays"):
        count = study.ice_draws
        ranging = range_fleet(
            study.ranging,
            ocean,
            medium,
            truth,
            lambda done, total: progress("rays", done, count * max(total, 1)),
            schedule=schedule,
        )
        mission = assemble_mission(study, ocean, truth, ranging)
        draws = range_draws(
            study,
            ocean,
            (medium, truth, ranging),
            lambda done, total: progress("rays", done, max(total, 1)),
            schedule=schedule,
        )
        mission = replace(mission, draws=draws)
    # a flat Earth may be too coarse for the longest links
    if note := earth_note(study, mission.truth, mission.ranging_truth):
        LOG.warning(note)
    with watch.stage("picture"):
        mission = replace(mission, picture=mission_picture(study, mission, medium))
    if not ranging.status.size:  # no pair
        progress("rays", 1, 1)
    return mission


def with_notes(ocean: OceanFields, medium: Medium | Callable[[float], Medium]) -> OceanFields:
    """Ocean whose local attributes have its notes and those of its medium, for files of a run."""
    notes = notes_of(ocean, medium)
    if not notes:
        return ocean
    return replace(ocean, local=ocean.local.assign_attrs(notes="\n".join(notes)))


def notes_of(ocean: OceanFields, medium: Medium | Callable[[float], Medium]) -> list[str]:
    """Notes about the files of an ocean, and about the interpolation of its sound speed."""
    first = medium(0.0) if callable(medium) else medium
    return list(dict.fromkeys([*ocean.notes, *first.notes]))


def earth_note(study: Study, truth: Trajectories, ranging: RangingTruth) -> str | None:
    """
    Sentence about the error of a flat Earth; None if it is small or the study's Earth is a sphere.
    """
    if study.sound.earth != "flat":
        return None
    farthest = np.hypot(truth.position[..., 0], truth.position[..., 1])
    return flat_earth_note(_largest(ranging.distance), _largest(farthest))


def _largest(lengths: NDArray[np.float64]) -> float:
    """Largest of some lengths that is known, zero without one. [m]"""
    return float(np.max(lengths, initial=0.0, where=np.isfinite(lengths)))


def simulate_fleet(
    fleet: MissionFleet,
    ocean: OceanFields,
    *,
    tracks: Tracks | None = None,
    schedule: Schedule | None = None,
) -> Trajectories:
    """Trajectories of the vehicles of a mission, with additional samples at every ping."""
    pings = fleet.sampled_pings
    if schedule is None and pings is not None:
        schedule = pings.schedule
    if fleet.existing is not None:
        assert schedule is not None  # of existing trajectories, all pings are sampled
        return sample_tracks(
            tracks or fleet.existing.tracks,
            fleet.duration,
            fleet.sampling_period,
            schedule.times(fleet.duration),
            ocean.local,
        )
    truth = simulate(
        fleet.vehicles,
        ocean.drift,
        duration=fleet.duration,
        physics_step=fleet.physics_step,
        sampling_period=fleet.sampling_period,
        start=fleet.start,
    )
    return truth if schedule is None else with_times(truth, schedule.times(fleet.duration))


def range_fleet(
    ranging: MissionRanging,
    ocean: OceanFields,
    medium: Medium | Callable[[float], Medium],
    truth: Trajectories,
    progress: CountProgress | None = None,
    *,
    schedule: Schedule | None = None,
    solved: EarlierLinks | None = None,
) -> Ranging:
    """
    Ranges of a mission without noise, with all of its rays; ``solved`` remembers links of earlier
    missions.
    """
    sound = ranging.sound
    return measure_ranges(
        truth,
        ranging.landmarks,
        medium,
        schedule or ranging.pings.schedule,
        sound.reception(ocean)._replace(solved=solved),
        currents=sound.currents_in(ocean),
        timing=sound.timing,
        progress=progress,
    )


def range_draws(
    study: Study,
    ocean: OceanFields,
    first: tuple[Medium | Callable[[float], Medium], Trajectories, Ranging],
    progress: CountProgress | None = None,
    *,
    schedule: Schedule | None = None,
) -> RangingDraws | None:
    """
    Ranges of every realization under its own ice, from medium, trajectories and ranges of the
    first; None if all have the same ice.
    """
    if not study.ocean.own_ice:
        return None
    medium, truth, ranging = first
    count = study.ice_draws
    rangings = [ranging]
    for draw in range(1, count):

        def tell(done: int, total: int, draw: int = draw) -> None:
            if progress is not None:
                progress(draw * total + done, count * total)

        rangings.append(
            range_fleet(
                study.ranging, ocean, _under_draw(medium, draw), truth, tell, schedule=schedule
            )
        )
    return RangingDraws.of(rangings)


def _under_draw(medium: Any, draw: int) -> Any:
    """Medium, or a function that returns it, with another draw of its rough ice."""
    if callable(medium):
        return lambda time: _under_draw(medium(time), draw)
    roughness = medium.surface.roughness
    assert roughness is not None
    return replace(medium, surface=medium.surface.with_roughness(roughness.with_draw(draw)))


def assemble_mission(
    study: Study, ocean: OceanFields, truth: Trajectories, ranging: Ranging
) -> Mission:
    """
    Data that all realizations of a study share, built from its ranges, without the ray picture.
    """
    picker = study.picker
    return Mission(
        ocean=ocean,
        truth=truth,
        links=ranging.links,
        arrivals=ranging.arrivals,
        measurements=assemble(
            truth,
            study.ranging.landmarks,
            ranging,
            study.noise,
            gnss_depth=gnss_depth(study.gnss_depth, ocean, truth),
            altitude=altitude(ocean, truth),
            sensors=study.sensors,
        ),
        ranging_truth=ranging.truth,
        hearing=None if ranging.probability is None else Hearing(probability=ranging.probability),
        candidates=None
        if picker is None
        else find_candidates(ranging, truth, picker, timing=study.sound.timing),
    )


def mission_picture(
    study: Study, mission: Mission, medium: Medium | Callable[[float], Medium]
) -> xr.Dataset | None:
    """Picture of the most bent link of a mission."""
    return picture_of_most_bent_link(
        medium,
        mission.truth,
        mission.links,
        mission.arrivals,
        spreading_cutoff_db=study.sound.options.spreading_cutoff_db,
    )


def medium_of_run(run: "Run") -> Callable[[float], Medium] | None:
    """
    Medium of a finished run as a function of the time since its start [s].

    A run stores the ocean at the start only, so an ocean that varies is read again from its files.
    None if these are missing or have changed.
    """
    study = run.study
    at_start = run.ocean
    sound = study.sound
    medium_of = partial(Medium.from_dataset, interpolation=sound.interpolation, earth=sound.earth)
    if study.ocean.time_varying:
        try:
            ocean = study.ocean.open(sound.interpolation)
        except MantaRayError:
            return None
        same = ocean.local["sound_speed"].shape == at_start["sound_speed"].shape
        if not same or not np.array_equal(ocean.local["sound_speed"], at_start["sound_speed"]):
            return None
        local_at = ocean.local_at
    elif has_internal_tide(at_start):
        local_at = partial(displaced, at_start)
    else:
        still = medium_of(at_start)
        return lambda _: still
    return lru_cache(maxsize=1)(lambda time: medium_of(local_at(time)))


def picture_of_most_bent_link(
    medium: Medium | Callable[[float], Medium],
    truth: Trajectories,
    links: Links,
    arrivals: Arrivals,
    *,
    spreading_cutoff_db: float | None,
) -> xr.Dataset | None:
    """
    Picture of the link between vehicles whose ray gains most time on the chord, in the water at its
    ping.
    """
    first = select(arrivals, "direct")
    gain = first.chord_travel_time - first.travel_time
    n_vehicles = truth.name.size
    drawn = (
        (first.status == RayStatus.OK) & (links.first < n_vehicles) & (links.second < n_vehicles)
    )
    if not np.any(drawn & (first.travel_time > 0.0)):
        return None
    row = int(np.nanargmax(np.where(drawn & (first.travel_time > 0.0), gain, np.nan)))
    sample = int(links.sample[row])
    a = int(links.first[row])
    b = int(links.second[row])
    source = truth.position[a, sample]
    receiver = truth.position[b, sample]
    step = receiver - source
    slope = float(np.arctan2(step[2], np.hypot(step[0], step[1])))
    water = medium(float(truth.time[sample])) if callable(medium) else medium
    picture = ray_picture(
        water, source, receiver, fan_angles=slope + FAN, spreading_cutoff_db=spreading_cutoff_db
    )
    return picture.assign_attrs(
        source=str(truth.name[a]),
        receiver=str(truth.name[b]),
        time_h=float(truth.time[sample]) / 3600.0,
    )


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


def fleet_findings(study: Study) -> list[Finding]:
    """Findings of the check of a run's vehicles in its ocean; none for existing trajectories."""
    fleet = study.fleet
    refusals = fleet_refusals(fleet.vehicles, study.ocean.local_start(), fleet.physics_step)
    return [Finding("wrong", "fleet", str(refusal)) for refusal in refusals]


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
