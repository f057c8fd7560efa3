"""One mission without noise: ocean, fleet, rays and measurements, each a timed stage."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymantaray.fleet import simulate
from pymantaray.records import Arrivals, Observations, Trajectories
from pymantaray.sensing import (
    Hearing,
    Landmark,
    Links,
    NoiseModel,
    PingSchedule,
    assemble,
    measure_ranges,
)
from pymantaray.sensing.candidates import find_candidates
from pymantaray.sensing.mistaken import Candidates
from pymantaray.study.assemble import StudyOcean, build_fleet, build_ocean
from pymantaray.study.assemble_ranging import (
    build_currents,
    build_detector,
    build_medium,
    build_picker,
    build_timing,
)
from pymantaray.study.config import StudyConfig
from pymantaray.study.manifest import Stopwatch
from pymantaray.study.picture import picture_of_most_bent_link

Progress = Callable[[str, int, int], None]
"""Told the name of a stage, how many of its parts are done, and how many there are."""


@dataclass(frozen=True, eq=False)
class Mission:
    """Everything that all realizations of a study share."""

    ocean: StudyOcean
    truth: Trajectories
    links: Links
    arrivals: Arrivals
    observations: Observations
    hearing: Hearing | None
    """Probability of each attempt to be heard; None if every arrival is."""
    picture: xr.Dataset | None
    """Section through the water along one link, with its rays; None if no ray arrives anywhere."""
    candidates: Candidates | None = None
    """What each attempt may take for its direct arrival; None if no receiver errs."""


def simulate_mission(config: StudyConfig, watch: Stopwatch, progress: Progress) -> Mission:
    """
    Run a mission up to its measurements without noise.

    Parameters
    ----------
    config : StudyConfig
    watch : Stopwatch
        Gets the duration of each stage.
    progress : callable
        Told of each stage's begin and end, and in between of the links whose rays are found.

    Returns
    -------
    Mission

    Raises
    ------
    OceanError, FleetError, SensingError, AcousticsError
        If the ocean cannot be used, or the fleet does not fit into it.
    """
    landmarks = [
        Landmark(name=mark.name, position=np.array([mark.north, mark.east, mark.depth]))
        for mark in config.landmarks
    ]
    vehicles = build_fleet(config)
    mission, noise = config.mission, NoiseModel(**config.noise.model_dump())

    progress("ocean", 0, 1)
    with watch.stage("ocean"):
        ocean = build_ocean(config.ocean, mission.duration_h * 3600.0)
    progress("ocean", 1, 1)

    progress("fleet", 0, 1)
    with watch.stage("fleet"):
        truth = simulate(
            vehicles,
            ocean.drift,
            duration=mission.duration_h * 3600.0,
            physics_step=mission.physics_step_s,
            sampling_period=mission.sampling_period_s,
        )
    progress("fleet", 1, 1)

    progress("rays", 0, 1)
    with watch.stage("medium"):
        medium, currents = build_medium(config, ocean), build_currents(config, ocean)
        timing, detector = build_timing(config.ranging), build_detector(config, ocean)
        picker = build_picker(config.ranging, detector)
    with watch.stage("rays"):
        ranging = measure_ranges(
            truth,
            landmarks,
            medium,
            PingSchedule(interval=mission.ping_interval_h * 3600.0),
            spreading_cutoff_db=config.acoustics.cutoff_db,
            max_surface_bounces=config.acoustics.max_surface_bounces,
            max_bottom_bounces=config.acoustics.max_bottom_bounces,
            arrival=config.acoustics.arrival,
            currents=currents,
            timing=timing,
            detector=detector,
            progress=lambda done, total: progress("rays", done, max(total, 1)),
        )
        observations = assemble(truth, landmarks, ranging, noise, gnss_depth=mission.gnss_depth)
        candidates = None if picker is None else find_candidates(ranging, truth, picker, timing=timing)
    with watch.stage("picture"):
        picture = picture_of_most_bent_link(
            medium, truth, ranging.links, ranging.arrivals, spreading_cutoff_db=config.acoustics.cutoff_db
        )
    if not ranging.status.size:  # no pair
        progress("rays", 1, 1)
    return Mission(
        ocean=ocean,
        truth=truth,
        links=ranging.links,
        arrivals=ranging.arrivals,
        observations=observations,
        hearing=None if ranging.probability is None else Hearing(probability=ranging.probability),
        picture=picture,
        candidates=candidates,
    )
