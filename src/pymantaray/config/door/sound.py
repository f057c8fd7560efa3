"""Sound of a study: medium of the rays, their search, losses and detection, and timing."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from pymantaray.acoustics import (
    Absorption,
    Currents,
    IceCover,
    Leakage,
    Medium,
    SeaSurface,
    Sonar,
    WenzNoise,
)
from pymantaray.acoustics.medium import Interpolation
from pymantaray.acoustics.ocean_fields import OceanFields, build_currents, build_medium
from pymantaray.acoustics.reflection import bed_reflection
from pymantaray.config.sections import (
    AbsorptionName,
    DetectionSection,
    RangingSection,
    SoundConfig,
)
from pymantaray.errors import StudyError
from pymantaray.geometry.sphere import Earth
from pymantaray.sensing import Detector, OneWay, Picker, ReceptionOptions, Timing, TwoWay


@dataclass(frozen=True, eq=False)
class SoundOptions:
    """Medium of the rays, and what receivers hear of them."""

    interpolation: Interpolation
    earth: Earth
    currents: bool
    """True if currents change travel times along the rays."""
    options: ReceptionOptions
    """Search, losses and detection, without absorption."""
    absorption: AbsorptionName
    centre: tuple[float, float] | None
    """Latitude and longitude where the absorption is computed; None for the middle. [degrees]"""
    timing: Timing

    def medium(self, ocean: OceanFields) -> Medium | Callable[[float], Medium]:
        """Medium of the rays; if the ocean varies, a function of the time [s]."""
        return build_medium(ocean, self.interpolation, self.earth)

    def currents_in(self, ocean: OceanFields) -> Currents | Callable[[float], Currents] | None:
        """Currents along the rays, as in `medium`; None if they change no travel times."""
        return build_currents(ocean) if self.currents else None

    def reception(self, ocean: OceanFields) -> ReceptionOptions:
        """Reception with the absorption of the ocean's first snapshot."""
        if self.options.detector is None:
            return self.options
        detector = replace(self.options.detector, absorption=self._absorption(ocean))
        return self.options._replace(detector=detector)

    def _absorption(self, ocean: OceanFields) -> Absorption | None:
        """Absorption in the ocean; most formulas need temperature and salinity."""
        if self.absorption == "none":
            return None
        if self.absorption == "thorp":
            return Absorption.thorp()
        if ocean.geographic is not None:
            return Absorption.from_dataset(
                ocean.geographic, centre=self.centre, formula=self.absorption
            )
        cast = ocean.cast
        if cast is None or cast.water is None:
            raise StudyError(
                f"detection.absorption is {self.absorption}, but"
                f" {ocean.local.attrs.get('title', 'the water')} has no temperature or salinity;"
                " set detection.absorption to thorp or none"
            )
        return Absorption.from_profile(cast.depth, *cast.water, formula=self.absorption)


def build_sonar(detection: DetectionSection | None) -> Sonar | None:
    """Modems of a section; None if every arrival is detected."""
    if detection is None:
        return None
    noise: WenzNoise | float | None = detection.noise_spectral_level_db
    if noise is None:
        shipping = 0.5 if detection.shipping is None else detection.shipping
        noise = WenzNoise(wind_speed=detection.wind_speed, shipping=shipping)
    return Sonar(
        source_level_db=detection.source_level_db,
        frequency_hz=detection.frequency_hz,
        bandwidth_hz=detection.bandwidth_hz,
        noise=noise,
        processing_gain_db=detection.processing_gain_db,
        threshold_db=detection.threshold_db,
        spread_db=detection.spread_db,
    )


def build_timing(ranging: RangingSection) -> Timing:
    """Timing scheme of a section."""
    return OneWay() if ranging.timing == "one-way" else TwoWay(turn_around=ranging.turn_around_s)


def build_picker(config: SoundConfig) -> Picker | None:
    """Rule by which receivers select the direct arrival; None if they make no mistakes."""
    ranging = config.ranging
    if ranging.mistaken == "none":
        return None
    return Picker(ranging.mistaken, build_sonar(config.detection), ranging.below_strongest_db)


def build_sound(config: SoundConfig) -> SoundOptions:
    """Medium and reception of a configuration."""
    search = config.acoustics
    detection = config.detection
    options = ReceptionOptions(
        search.cutoff_db,
        search.max_surface_bounces,
        search.max_bottom_bounces,
        search.arrival,
        cone=None if search.cone_deg is None else math.radians(search.cone_deg),
    )
    if detection is not None and (sonar := build_sonar(detection)) is not None:
        surface: IceCover | SeaSurface | None = None
        if search.ice_loss_db is not None:
            surface = IceCover(search.ice_loss_db)
        elif search.surface_loss != "none":
            surface = SeaSurface(detection.wind_speed, search.surface_loss)
        options = options._replace(
            detector=Detector(
                sonar=sonar,
                absorption=None,
                bottom=bed_reflection(search.sediment),
                surface=surface,
                coherent=detection.coherent,
            ),
            leakage=Leakage(detection.leakage_reach_m, detection.scatter_db)
            if detection.leakage
            else None,
        )
    return SoundOptions(
        interpolation=search.interpolation,
        earth=search.earth,
        currents=search.currents,
        options=options,
        absorption="none" if detection is None else detection.absorption,
        centre=config.ocean.centre,
        timing=build_timing(config.ranging),
    )
