"""Sound of a study: medium of the rays, their search, losses and detection, and timing."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from pymantaray.acoustics import Currents, Medium
from pymantaray.acoustics.medium import Interpolation
from pymantaray.acoustics.ocean_fields import OceanFields, build_currents, build_medium
from pymantaray.config.sections import SoundConfig
from pymantaray.geometry.sphere import Earth
from pymantaray.sensing import ReceptionOptions, Timing


@dataclass(frozen=True, eq=False)
class SoundOptions:
    """Medium of the rays, and what receivers hear of them."""

    interpolation: Interpolation
    earth: Earth
    currents: bool
    """True if currents change travel times along the rays."""
    options: ReceptionOptions
    """Search, losses and detection, without absorption."""
    absorption: str
    """Formula of the absorption, or ``none``."""
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
        absorption = ocean.absorption(self.absorption, self.centre)
        return self.options._replace(detector=replace(self.options.detector, absorption=absorption))


def build_sound(config: SoundConfig) -> SoundOptions:
    """Medium and reception of a configuration."""
    return SoundOptions(
        interpolation=config.acoustics.interpolation,
        earth=config.acoustics.earth,
        currents=config.acoustics.currents,
        options=config.build_reception(None),
        absorption="none" if config.detection is None else config.detection.absorption,
        centre=config.ocean.centre,
        timing=config.ranging.build_timing(),
    )
