"""Options of a run of Bellhop, apart from what writes its files because the command line reads them at each start."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from pymantaray.errors import AcousticsError

BottomKind = Literal["rigid", "vacuum", "matching"]
Run = Literal["arrivals", "arrivals-binary", "rays", "eigenrays"]
_MOST_BEAMS = 10_000


@dataclass(frozen=True)
class HalfSpace:
    """
    Sea bed as an acousto-elastic half-space.

    Speeds of compressional waves, and of shear waves, 0 in a fluid [m/s]; density in Bellhop's unit; attenuations of either
    kind of waves.
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
                raise AcousticsError(f"half-space: {name} is {value}; it must be finite and positive")


@dataclass(frozen=True)
class BellhopOptions:
    """
    Options of a run of Bellhop for a link.

    Parameters
    ----------
    run : {"arrivals", "arrivals-binary", "rays", "eigenrays"}
        Output of Bellhop: arrivals as text or binary (`.arr`), rays or eigenrays (`.ray`).
    beams : int
        Number of beams in declination, and in bearing.
    cone : float
        Width of the fan to either side of the chord, in both. [rad]
    frequency : float
        Bellhop joins arrivals nearer than 0.05/(2 pi frequency) seconds. [Hz]
    bottom : {"rigid", "vacuum", "matching"} or HalfSpace
        Type of the sea bed: rigid, vacuum (reflections change the sign) or matching (no contrast to the water); in Python also a
        half-space.
    step : float
        Step along the rays; 0 for Bellhop's default, a tenth of the last level, which can cost milliseconds. [m]
    """

    run: Run = "arrivals"
    beams: int = 100
    cone: float = math.radians(15.0)
    frequency: float = 10_000.0
    bottom: BottomKind | HalfSpace = "rigid"
    step: float = 50.0

    def __post_init__(self) -> None:
        for name, value, allowed in (("run", self.run, Run), ("bottom", self.bottom, BottomKind)):
            if value not in get_args(allowed) and not (name == "bottom" and isinstance(value, HalfSpace)):
                raise AcousticsError(f"{name}: {value!r}; allowed are {', '.join(get_args(allowed))}")
        if not 2 <= self.beams <= _MOST_BEAMS or not 0.0 < self.cone <= math.pi:
            raise AcousticsError(
                f"beams {self.beams}, cone {self.cone:g} rad; 2 to {_MOST_BEAMS} beams and up to pi are allowed"
            )
        if not (0.0 < self.frequency < math.inf and 0.0 <= self.step < math.inf):
            raise AcousticsError(
                f"frequency {self.frequency} Hz, step {self.step} m; the first must be positive, the second not less than 0"
            )
