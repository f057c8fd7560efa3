"""
Options of a run of Bellhop. The writer of its files is in another module, because the command line
imports this one at each start.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from pymantaray.errors import AcousticsError

BottomKind = Literal["rigid", "vacuum", "matching"]
BellhopOutput = Literal["arrivals", "arrivals-binary", "rays", "eigenrays"]
_MAX_BEAMS = 10_000


@dataclass(frozen=True)
class HalfSpace:
    """
    Sea bed as an acousto-elastic half-space.

    Parameters
    ----------
    sound_speed : float
        Speed of compressional waves. [m/s]
    density_g_per_cm3 : float
        Density. [g/cm³]
    attenuation_db_per_wavelength : float
        Attenuation of compressional waves. [dB per wavelength]
    shear_speed : float
        Speed of shear waves; 0 for a fluid. [m/s]
    shear_attenuation_db_per_wavelength : float
        Attenuation of shear waves. [dB per wavelength]

    Raises
    ------
    AcousticsError
        If a value is negative or not finite, or the sound speed or density is 0.

    Examples
    --------
    >>> from pymantaray.apps.bellhop import BellhopOptions, HalfSpace
    >>> sand = HalfSpace(sound_speed=1650.0, density_g_per_cm3=1.9)
    >>> BellhopOptions(bottom=sand).bottom.sound_speed
    1650.0
    """

    sound_speed: float
    density_g_per_cm3: float
    attenuation_db_per_wavelength: float = 0.0
    shear_speed: float = 0.0
    shear_attenuation_db_per_wavelength: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            least = 1e-300 if name in ("sound_speed", "density_g_per_cm3") else 0.0
            if not least <= value < math.inf:
                allowed = "0 or more" if least == 0.0 else "positive"
                raise AcousticsError(
                    f"half-space: {name} is {value}; it must be finite and {allowed}"
                )


@dataclass(frozen=True)
class BellhopOptions:
    """
    Options of a run of Bellhop for a link.

    Parameters
    ----------
    run : {"arrivals", "arrivals-binary", "rays", "eigenrays"}
        Output of Bellhop: arrivals as text or binary (`.arr`), rays or eigenrays (`.ray`).
    beams : int
        Number of beams in each of declination and bearing.
    cone : float
        Half width of the fan about the chord, in each of declination and bearing. [rad]
    frequency : float
        Frequency. Bellhop merges arrivals that differ by less than 0.05/(2 pi frequency) seconds.
        [Hz]
    bottom : {"rigid", "vacuum", "matching"} or HalfSpace
        Type of the sea bed: rigid, vacuum (reflections change the sign), matching (no contrast to
        the water), or a half-space.
    step : float
        Step along the rays; 0 for Bellhop's default, a tenth of the last level, whose travel times
        can be wrong by milliseconds. [m]

    Raises
    ------
    AcousticsError
        If a value is not allowed.

    Examples
    --------
    >>> from pymantaray.apps.bellhop import BellhopOptions
    >>> BellhopOptions(run="eigenrays", beams=200).beams
    200
    """

    run: BellhopOutput = "arrivals"
    beams: int = 100
    cone: float = math.radians(15.0)
    frequency: float = 10_000.0
    bottom: BottomKind | HalfSpace = "rigid"
    step: float = 50.0

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("run", self.run, BellhopOutput),
            ("bottom", self.bottom, BottomKind),
        ):
            if value not in get_args(allowed) and not (
                name == "bottom" and isinstance(value, HalfSpace)
            ):
                raise AcousticsError(f"{name}: {value!r}; allowed: {', '.join(get_args(allowed))}")
        if not 2 <= self.beams <= _MAX_BEAMS or not 0.0 < self.cone <= math.pi:
            raise AcousticsError(
                f"beams {self.beams}, cone {self.cone:g} rad; allowed: 2 to {_MAX_BEAMS} beams,"
                " and a cone up to pi"
            )
        if not (0.0 < self.frequency < math.inf and 0.0 <= self.step < math.inf):
            raise AcousticsError(
                f"frequency {self.frequency} Hz, step {self.step} m; the frequency must be"
                " positive, the step 0 or more"
            )
