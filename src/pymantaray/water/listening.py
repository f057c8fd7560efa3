"""From configuration to what receivers listen for: sonar, losses, reflections and timing."""

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
from pymantaray.sensing import Detector, OneWay, Reception, Timing, TwoWay
from pymantaray.water.ocean import OceanFields


def build_timing(section: RangingSection) -> Timing:
    """Timing scheme of a study."""
    return OneWay() if section.timing == "one-way" else TwoWay(turn_around=section.turn_around_s)


def build_detector(config: SoundConfig, ocean: OceanFields) -> Detector | None:
    """Sonar and losses of a study, absorption by its first snapshot; None if every arrival is heard."""
    s = config.detection
    if s is None:
        return None
    return detector_of(s, config.acoustics, absorption_of(s, ocean, config.ocean.centre))


def detector_of(s: DetectionSection, losses: AcousticsSection, absorption: Absorption | None) -> Detector:
    """Sonar and losses of sections in water of some absorption."""
    return Detector(
        sonar=sonar_of(s),
        absorption=absorption,
        bottom=bed_reflection(losses.sediment),
        surface=_surface(s, losses),
    )


def build_reception(config: SoundConfig, ocean: OceanFields) -> Reception:
    """What the receivers of a study listen for."""
    acoustics = config.acoustics
    return Reception(
        spreading_cutoff_db=acoustics.cutoff_db,
        max_surface_bounces=acoustics.max_surface_bounces,
        max_bottom_bounces=acoustics.max_bottom_bounces,
        arrival=acoustics.arrival,
        detector=build_detector(config, ocean),
        leakage=leakage_of(config.detection),
    )


def leakage_of(s: DetectionSection | None) -> Leakage | None:
    """What arrives where no ray does; None if nothing."""
    return Leakage(s.leakage_reach_m, s.scatter_db) if s is not None and s.leakage else None


def build_sonar(s: DetectionSection | None) -> Sonar | None:
    """Modems of a study; None if every arrival is heard."""
    return None if s is None else sonar_of(s)


def sonar_of(s: DetectionSection) -> Sonar:
    """Modems of a section."""
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
    """Absorption of a section in an ocean or a cast, which must have temperature and salinity for most formulas."""
    if s.absorption == "none":
        return None
    if s.absorption == "thorp":
        return Absorption.thorp()
    if ocean.geographic is not None:
        return Absorption.from_dataset(ocean.geographic, centre=centre, formula=s.absorption)
    if ocean.cast is None or ocean.cast.water is None:
        raise StudyError(
            f"detection.absorption is {s.absorption}, but {ocean.local.attrs.get('title', 'the water')} lacks temperature or"
            " salinity; take thorp or none"
        )
    return Absorption.from_profile(ocean.cast.depth, *ocean.cast.water, formula=s.absorption)
