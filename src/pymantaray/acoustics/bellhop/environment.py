"""The `.env` file: frequency, profile, boundaries, positions, run type, fan and box of one run."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.bellhop.listing import in_kilometres, plain, row
from pymantaray.acoustics.medium import Interpolation
from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]
INTERPOLATIONS: dict[str, Interpolation] = {"C": "linear", "H": "linear", "S": "smooth"}


@dataclass(frozen=True)
class HalfSpace:
    """
    Sea bed as an acousto-elastic half-space.

    Attributes
    ----------
    sound_speed : float
        Of compressional waves. [m s⁻¹]
    density_g_per_cm3 : float
        In Bellhop's unit. [g cm⁻³]
    attenuation_db_per_wavelength : float
        Of compressional waves. [dB per wavelength]
    shear_speed : float
        0 for a fluid. [m s⁻¹]
    shear_attenuation_db_per_wavelength : float
        [dB per wavelength]
    """

    sound_speed: float
    density_g_per_cm3: float
    attenuation_db_per_wavelength: float = 0.0
    shear_speed: float = 0.0
    shear_attenuation_db_per_wavelength: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what no sediment is."""
        values = vars(self)
        wrong = [name for name, value in values.items() if not (math.isfinite(value) and value >= 0.0)]
        wrong += [name for name in ("sound_speed", "density_g_per_cm3") if values[name] == 0.0]
        if wrong:
            raise AcousticsError(
                f"half-space: {wrong[0]} is {values[wrong[0]]}; it must be finite and positive"
            )


@dataclass(frozen=True, eq=False)
class Environment:
    """
    Content of one `.env` file in SI units, along Bellhop's axes x and y.

    Attributes
    ----------
    title : str
    frequency : float
        [Hz]
    profile : {"C", "S", "H"}
        Straight lines between levels, a spline, or a grid in a `.ssp` file.
    depth, sound_speed : ndarray, shape (n_depth,)
        Levels and speeds in the `.env` itself; with "H" the `.ssp` file replaces them. [m, m s⁻¹]
    bottom : str
        "R" rigid, "V" vacuum, "A" half-space, or another of Bellhop's letters as read.
    half_space : HalfSpace or None
        Properties with "A".
    bathymetry_file : bool
        Whether a `.bty` file holds the sea bed; else it is flat at the last level.
    source_x, source_y, source_depth : ndarray
        Sources are all combinations; x and y are 0 in a 2-D file. [m]
    receiver_depth, receiver_range, receiver_bearing : ndarray
        Receivers are all combinations, by range and bearing (from x towards y) about each source; the
        bearing is 0 in a 2-D file. [m, m, rad]
    run_type : str
        Bellhop's letters, such as "AG RR3".
    declination, bearing : ndarray
        Launch angles of the fan, positive down, and from x towards y. [rad]
    step : float
        Step along the rays; 0 leaves it to Bellhop. [m]
    box : tuple of float
        Half-widths in x and y about the source, and the greatest depth. [m]
    three_d : bool
        Whether the file is one of BELLHOP3D.
    """

    title: str
    frequency: float
    profile: str
    depth: Array
    sound_speed: Array
    bottom: str
    half_space: HalfSpace | None
    bathymetry_file: bool
    source_x: Array
    source_y: Array
    source_depth: Array
    receiver_depth: Array
    receiver_range: Array
    receiver_bearing: Array
    run_type: str
    declination: Array
    bearing: Array
    step: float
    box: tuple[float, float, float]
    three_d: bool = True

    @property
    def interpolation(self) -> Interpolation:
        """The medium's interpolation that the profile option means."""
        return INTERPOLATIONS[self.profile]

    def text(self) -> str:
        """
        Write the environment as a `.env` file of BELLHOP3D.

        Returns
        -------
        str
            With a flat surface next to a vacuum, and attenuation in dB per wavelength.
        """
        levels = [f"{plain(z)} {plain(c)} /" for z, c in zip(self.depth, self.sound_speed, strict=True)]
        bed = []
        if self.half_space is not None:
            h = self.half_space
            values = (h.sound_speed, h.shear_speed, h.density_g_per_cm3)
            losses = (h.attenuation_db_per_wavelength, h.shear_attenuation_db_per_wavelength)
            bed = [row((self.depth[-1], *values, *losses))]
        box = (in_kilometres(self.box[0]), in_kilometres(self.box[1]), plain(self.box[2]))
        limits = " ".join((plain(self.step), *box))
        lines = [
            f"'{self.title.replace(chr(39), ' ')}'",
            f"{plain(self.frequency)} ! frequency [Hz]",
            "1 ! media",
            f"'{self.profile}VW' ! profile, vacuum above, attenuation in dB per wavelength",
            f"{self.depth.size} 0.0 {plain(self.depth[-1])} ! levels, roughness [m], last level [m]",
            *levels,
            f"'{self.bottom}{'~' if self.bathymetry_file else ' '}' 0.0 ! sea bed, roughness [m]",
            *bed,
            *_vector(self.source_x, "source x [km]", kilometres=True),
            *_vector(self.source_y, "source y [km]", kilometres=True),
            *_vector(self.source_depth, "source depth [m]"),
            *_vector(self.receiver_depth, "receiver depth [m]"),
            *_vector(self.receiver_range, "receiver range [km]", kilometres=True),
            *_vector(np.degrees(self.receiver_bearing), "receiver bearing [deg] from x towards y"),
            f"'{self.run_type}' ! run type",
            *_vector(np.degrees(self.declination), "declination [deg], positive down"),
            *_vector(np.degrees(self.bearing), "bearing [deg] from x towards y"),
            f"{limits} ! step [m], box x [km], y [km], z [m]",
        ]
        return "\n".join(lines) + "\n"


def _vector(values: Array, what: str, *, kilometres: bool = False) -> list[str]:
    return [f"{values.size} ! {what}", row(values, kilometres=kilometres)]
