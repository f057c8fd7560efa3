"""Builders of sonar, losses, reception and timing from a configuration."""

import math

from pymantaray.acoustics import (
    Absorption,
    IceCover,
    Leakage,
    SeaSurface,
    Sonar,
    WenzNoise,
)
from pymantaray.acoustics.reflection import bed_reflection
from pymantaray.config.sections import AcousticsSection, DetectionSection, RangingSection, SoundConfig
from pymantaray.errors import StudyError
from pymantaray.sensing import Detector, OneWay, ReceptionOptions, Timing, TwoWay
from pymantaray.water.ocean import OceanFields


def build_timing(section: RangingSection) -> Timing:
    """Build the timing scheme of a study."""
    return OneWay() if section.timing == "one-way" else TwoWay(turn_around=section.turn_around_s)


def build_detector(config: SoundConfig, ocean: OceanFields) -> Detector | None:
    """Build sonar and losses of a study, with the absorption of its first snapshot; None if every arrival is detected."""
    s = config.detection
    if s is None:
        return None
    return detector_of(s, config.acoustics, absorption_of(s, ocean, config.ocean.centre))


def detector_of(s: DetectionSection, losses: AcousticsSection, absorption: Absorption | None) -> Detector:
    """Build sonar and losses from sections and an absorption."""
    return Detector(
        sonar=sonar_of(s),
        absorption=absorption,
        bottom=bed_reflection(losses.sediment),
        surface=_surface(s, losses),
    )


def build_reception(config: SoundConfig, ocean: OceanFields) -> ReceptionOptions:
    """Build the reception of a study."""
    acoustics = config.acoustics
    return ReceptionOptions(
        spreading_cutoff_db=acoustics.cutoff_db,
        max_surface_bounces=acoustics.max_surface_bounces,
        max_bottom_bounces=acoustics.max_bottom_bounces,
        arrival=acoustics.arrival,
        detector=build_detector(config, ocean),
        leakage=leakage_of(config.detection),
        cone=None if acoustics.cone_deg is None else math.radians(acoustics.cone_deg),
    )


def leakage_of(s: DetectionSection | None) -> Leakage | None:
    """Build the model of sound that arrives without a ray; None if there is none."""
    return Leakage(s.leakage_reach_m, s.scatter_db) if s is not None and s.leakage else None


def build_sonar(s: DetectionSection | None) -> Sonar | None:
    """Build the modems of a study; None if every arrival is detected."""
    return None if s is None else sonar_of(s)


def sonar_of(s: DetectionSection) -> Sonar:
    """Build the modems of a section."""
    noise: WenzNoise | float
    if s.noise_spectral_level_db is None:
        noise = WenzNoise(wind_speed=s.wind_speed, shipping=0.5 if s.shipping is None else s.shipping)
    else:
        noise = s.noise_spectral_level_db
    return Sonar(
        source_level_db=s.source_level_db,
        frequency_hz=s.frequency_hz,
        bandwidth_hz=s.bandwidth_hz,
        noise=noise,
        processing_gain_db=s.processing_gain_db,
        threshold_db=s.threshold_db,
        spread_db=s.spread_db,
    )


def _surface(s: DetectionSection, losses: AcousticsSection) -> SeaSurface | IceCover | None:
    if losses.ice_loss_db is not None:
        return IceCover(losses.ice_loss_db)
    return (
        None
        if losses.surface_loss == "none"
        else SeaSurface(wind_speed=s.wind_speed, model=losses.surface_loss)
    )


def absorption_of(
    s: DetectionSection, ocean: OceanFields, centre: tuple[float, float] | None
) -> Absorption | None:
    """Absorption in an ocean or a cast; most formulas need temperature and salinity."""
    if s.absorption == "none":
        return None
    if s.absorption == "thorp":
        return Absorption.thorp()
    if ocean.geographic is not None:
        return Absorption.from_dataset(ocean.geographic, centre=centre, formula=s.absorption)
    if ocean.cast is None or ocean.cast.water is None:
        raise StudyError(
            f"detection.absorption is {s.absorption}, but {ocean.local.attrs.get('title', 'the water')} has no temperature or"
            " salinity; set detection.absorption to thorp or none"
        )
    return Absorption.from_profile(ocean.cast.depth, *ocean.cast.water, formula=s.absorption)
