"""A study as objects of the library: its stages, noise, conditions and provenance."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pymantaray.arrays import Array
from pymantaray.config.door.estimators import Condition, build_condition
from pymantaray.config.door.fleet import (
    MissionFleet,
    MissionPings,
    build_fleet,
    build_pings,
    planned_points,
)
from pymantaray.config.door.ocean import MissionOcean, build_mission_ocean
from pymantaray.config.door.sound import SoundOptions, build_picker, build_sound
from pymantaray.config.sections import StudyConfig
from pymantaray.config.text import study_toml
from pymantaray.sensing import (
    ClockModel,
    Landmark,
    NoiseModel,
    Picker,
    Schedule,
)
from pymantaray.sensing.other_packages import other_sensors


@dataclass(frozen=True, eq=False)
class MissionRanging:
    """Participants with known positions, pings and sound of a mission."""

    landmarks: tuple[Landmark, ...]
    pings: MissionPings
    sound: SoundOptions

    @property
    def files(self) -> tuple[str, ...]:
        """Files of the pings."""
        return self.pings.files


@dataclass(frozen=True, eq=False)
class Study:
    """
    Study as objects of the library; `build_study` makes it of a configuration.

    ``ocean``, ``fleet`` and ``ranging`` are all that the stages of a mission read, in this order.
    """

    config: StudyConfig
    """Configuration, for provenance."""
    name: str
    description: str
    seed: int
    realizations: int
    ocean: MissionOcean
    fleet: MissionFleet
    ranging: MissionRanging
    gnss_depth: float
    """Depth above which vehicles have GNSS fixes. [m]"""
    sensors: dict[str, dict[str, float]]
    """Sensors of other packages, and the noise levels of each that are not its defaults."""
    noise: NoiseModel
    clocks: ClockModel | None
    """Clocks of vehicles; None if they are synchronous."""
    picker: Picker | None
    """Rule by which receivers mistake arrivals; None if they do not."""
    pick_correlation_time: float
    """Correlation time of the choice of an arrival. [s]"""
    conditions: tuple[Condition, ...]
    covariance_interval: float
    """Interval of stored covariances of poses. [s]"""
    files: tuple[str, ...]
    """All input files, each once."""

    @property
    def solves(self) -> bool:
        """True if there are conditions to estimate; a study without conditions has ranges only."""
        return bool(self.conditions)

    @property
    def duration(self) -> float:
        """Duration of the mission. [s]"""
        return self.fleet.duration

    @property
    def sound(self) -> SoundOptions:
        """Medium of the rays, and what receivers hear of them."""
        return self.ranging.sound

    @property
    def schedule(self) -> Schedule:
        """Schedule of the pings."""
        return self.ranging.pings.schedule

    @property
    def ice_draws(self) -> int:
        """Number of different draws of rough ice in the realizations."""
        return self.realizations if self.ocean.own_ice else 1

    @property
    def detects(self) -> bool:
        """True if arrivals have a probability of detection."""
        return self.sound.options.detector is not None

    @cached_property
    def planned(self) -> dict[str, Array]:
        """Points (n, 3) of each vehicle and landmark without drift, see `planned_points`. [m]"""
        return planned_points(self.config)

    @cached_property
    def toml(self) -> str:
        """TOML text of the resolved configuration."""
        return study_toml(self.config)

    @cached_property
    def tree(self) -> dict[str, Any]:
        """All keys of the configuration with their values, as in JSON."""
        return self.config.model_dump(mode="json")


def build_landmarks(config: StudyConfig) -> tuple[Landmark, ...]:
    """Landmarks of a configuration."""
    return tuple(
        Landmark(mark.name, np.array([mark.north, mark.east, mark.depth]), mark.sigma)
        for mark in config.landmarks
    )


def build_study(config: StudyConfig) -> Study:
    """
    Study of a configuration that is complete, see `with_tracks`.

    Examples
    --------
    >>> from pymantaray.config import load_study
    >>> from pymantaray.config.door import build_study
    >>> study = build_study(load_study("quick"))
    >>> study.duration, study.realizations, len(study.conditions)
    (86400.0, 3, 3)
    """
    sensors = {name: config.noise.of_other(name) for name in config.mission.sensors}
    other_sensors(sensors)  # all of them can be imported
    return Study(
        config=config,
        name=config.study.name,
        description=config.study.description,
        seed=config.study.seed,
        realizations=config.study.realizations,
        ocean=build_mission_ocean(config),
        fleet=build_fleet(config),
        ranging=MissionRanging(
            landmarks=build_landmarks(config),
            pings=build_pings(config),
            sound=build_sound(config),
        ),
        gnss_depth=config.mission.gnss_depth,
        sensors=sensors,
        noise=config.noise.model,
        clocks=config.noise.clocks,
        picker=build_picker(config),
        pick_correlation_time=config.ranging.mistaken_correlation_s,
        conditions=tuple(build_condition(section) for section in config.conditions),
        covariance_interval=config.estimator.covariance_interval_h * 3600.0,
        files=config.files,
    )
