"""From configuration to what ranging needs: currents, detector, timing scheme, clocks and what a receiver mistakes."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import xarray as xr

from pymantaray.acoustics import Medium
from pymantaray.acoustics.absorption_field import Absorption
from pymantaray.acoustics.ambient_noise import WenzNoise
from pymantaray.acoustics.moving_water import Currents
from pymantaray.acoustics.reflection import FluidBottom
from pymantaray.acoustics.sonar import Sonar
from pymantaray.acoustics.surface_loss import SeaSurface
from pymantaray.sensing import ClockModel, Detector, OneWay, Timing, TwoWay
from pymantaray.sensing.picker import Picker
from pymantaray.study.config import StudyConfig
from pymantaray.study.config_acoustics import DetectionSection, RangingSection

if TYPE_CHECKING:
    from pymantaray.study.assemble import StudyOcean


def build_timing(section: RangingSection) -> Timing:
    """
    Timing scheme of a study.

    Parameters
    ----------
    section : RangingSection

    Returns
    -------
    OneWay or TwoWay
    """
    return OneWay() if section.timing == "one-way" else TwoWay(turn_around=section.turn_around_s)


def build_clocks(section: RangingSection) -> ClockModel | None:
    """
    Clocks of a study's vehicles.

    Parameters
    ----------
    section : RangingSection

    Returns
    -------
    ClockModel or None
        None if they are synchronous.
    """
    if section.clock_offset_sigma == 0.0 and section.clock_skew_sigma == 0.0:
        return None
    return ClockModel(offset_sigma=section.clock_offset_sigma, skew_sigma=section.clock_skew_sigma)


def build_picker(section: RangingSection, detector: Detector | None) -> Picker | None:
    """
    Rule by which a study's receivers take an arrival for the direct one.

    Parameters
    ----------
    section : RangingSection
    detector : Detector or None
        What `build_detector` returned.

    Returns
    -------
    Picker or None
        None if they never err.
    """
    if section.mistaken == "off":
        return None
    return Picker(
        rule=section.mistaken,
        sonar=None if detector is None else detector.sonar,
        below_strongest_db=section.below_strongest_db,
    )


def build_medium(config: StudyConfig, ocean: "StudyOcean") -> Medium | Callable[[float], Medium]:
    """
    Medium of a study's rays.

    Parameters
    ----------
    config : StudyConfig
    ocean : StudyOcean

    Returns
    -------
    Medium or callable
        A function of the time since the mission's start [s] if the ocean varies.
    """

    def at(time: float) -> Medium:
        return Medium.from_dataset(ocean.local_at(time), interpolation=config.acoustics.interpolation)

    return at(0.0) if ocean.series is None else at


def build_currents(config: StudyConfig, ocean: "StudyOcean") -> Currents | Callable[[float], Currents] | None:
    """
    Currents along the rays of a study.

    Parameters
    ----------
    config : StudyConfig
    ocean : StudyOcean

    Returns
    -------
    Currents, callable or None
        None if rays are to run through water at rest; a function of the time since the mission's start [s] if
        the ocean varies.
    """
    if not config.acoustics.currents:
        return None

    def at(time: float) -> Currents:
        return Currents.from_dataset(ocean.local_at(time))

    return at(0.0) if ocean.series is None else at


def build_detector(config: StudyConfig, ocean: "StudyOcean") -> Detector | None:
    """
    Sonar and losses of a study.

    Parameters
    ----------
    config : StudyConfig
    ocean : StudyOcean
        Absorption is that of its first snapshot, also where the ocean varies.

    Returns
    -------
    Detector or None
        None if every arrival is heard.

    Raises
    ------
    AcousticsError
        If a value is impossible.
    """
    s = config.detection
    if s is None:
        return None
    noise: WenzNoise | float
    if s.noise_spectral_level_db is None:
        noise = WenzNoise(wind_speed=s.wind_speed, shipping=0.5 if s.shipping is None else s.shipping)
    else:
        noise = s.noise_spectral_level_db
    return Detector(
        sonar=Sonar(
            source_level_db=s.source_level_db,
            frequency_hz=s.frequency_hz,
            bandwidth_hz=s.bandwidth_hz,
            noise=noise,
            processing_gain_db=s.processing_gain_db,
            threshold_db=s.threshold_db,
            spread_db=s.spread_db,
        ),
        absorption=_absorption(s, ocean.geographic, config.ocean.centre),
        bottom=None if s.sediment == "none" else FluidBottom.standard(s.sediment),
        surface=None
        if s.surface_loss == "none"
        else SeaSurface(wind_speed=s.wind_speed, model=s.surface_loss),
    )


def _absorption(
    s: DetectionSection, geographic: xr.Dataset, centre: tuple[float, float] | None
) -> Absorption | None:
    if s.absorption == "none":
        return None
    if s.absorption == "thorp":
        return Absorption.thorp()
    return Absorption.from_dataset(geographic, centre=centre, formula=s.absorption)
