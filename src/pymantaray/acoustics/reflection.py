"""Rayleigh reflection of plane waves from a fluid sea bed."""

import math
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]
WATER_DENSITY = 1025.0
"""Of sea water, where none is given. [kg/m3]"""
_SEDIMENTS = {  # sound speed [m/s], density [kg/m3], attenuation [dB per wavelength]
    "clay": (1500.0, 1500.0, 0.2),
    "silt": (1575.0, 1700.0, 1.0),
    "sand": (1650.0, 1900.0, 0.8),
    "gravel": (1800.0, 2000.0, 0.6),
    "moraine": (1950.0, 2100.0, 0.4),
}


@dataclass(frozen=True)
class FluidBottom:
    """
    Sea bed as a homogeneous fluid half space.

    Parameters
    ----------
    sound_speed : float
        [m/s]
    density : float
        [kg/m3]
    attenuation_db_per_wavelength : float
        Of compressional waves in the sediment.

    Raises
    ------
    AcousticsError
        If speed or density is not positive, or the attenuation negative.
    """

    sound_speed: float
    density: float
    attenuation_db_per_wavelength: float = 0.0

    def __post_init__(self) -> None:
        """Check every value."""
        for f in fields(self):
            value = getattr(self, f.name)
            zero_allowed = f.name.startswith("attenuation")
            if not math.isfinite(value) or value < 0.0 or (value == 0.0 and not zero_allowed):
                allowed = "finite and not negative" if zero_allowed else "finite and positive"
                raise AcousticsError(f"FluidBottom: {f.name} is {value:g}; must be {allowed}")

    @classmethod
    def standard(cls, name: str) -> Self:
        """
        One of five sediments of the standard table.

        Parameters
        ----------
        name : {"clay", "silt", "sand", "gravel", "moraine"}

        Returns
        -------
        FluidBottom

        Raises
        ------
        AcousticsError
            If the name is unknown.

        Notes
        -----
        The table's shear is left out. It is slow in these (50 to 600 m/s); rock, where it is not, is not a
        fluid and is left out too.

        References
        ----------
        .. [1] Jensen, F. B., Kuperman, W. A., Porter, M. B. and Schmidt, H., Computational Ocean Acoustics,
           table 1.3, for water of 1500 m/s and 1000 kg/m3; after Hamilton. Taken from code that cites it.
        """
        if name not in _SEDIMENTS:
            raise AcousticsError(f"sediment {name!r} is unknown; there are {', '.join(_SEDIMENTS)}")
        return cls(*_SEDIMENTS[name])


def reflection_coefficient(
    grazing_angle: ArrayLike,
    bottom: FluidBottom,
    *,
    sound_speed: ArrayLike,
    density: ArrayLike = WATER_DENSITY,
) -> NDArray[np.complex128]:
    r"""
    Rayleigh's plane-wave reflection coefficient of pressure at a fluid half space.

    Parameters
    ----------
    grazing_angle : array_like, shape (...)
        Between ray and sea bed, 0 to pi/2. [rad]
    bottom : FluidBottom
    sound_speed, density : array_like, shape (...)
        Of the water at the sea bed. [m/s, kg/m3]

    Returns
    -------
    ndarray of complex, shape (...)
        For time dependence :math:`e^{-i\omega t}`; its argument is the phase that the bounce adds.

    Notes
    -----
    With :math:`m = \rho_b/\rho`, :math:`n = (c/c_b)(1 + i\delta)`, attenuation
    :math:`\delta = \ln 10\, \alpha_\lambda / 40\pi`,
    :math:`R = (m \sin\gamma - q)/(m \sin\gamma + q)`, :math:`q = \sqrt{n^2 - \cos^2\gamma}`, Im q >= 0.
    It does not depend on frequency, because attenuation per wavelength does not.

    References
    ----------
    .. [1] Brekhovskikh, L. M. and Lysanov, Yu. P., Fundamentals of Ocean Acoustics, eq. 3.1.12, as quoted in
       the documentation of other codes.
    """
    angle = np.asarray(grazing_angle, dtype=float)
    loss_tangent = math.log(10.0) * bottom.attenuation_db_per_wavelength / (40.0 * math.pi)
    n = np.asarray(sound_speed, dtype=float) / bottom.sound_speed * (1.0 + 1j * loss_tangent)
    q = np.sqrt(n**2 - np.cos(angle) ** 2)
    m_sin = bottom.density / np.asarray(density, dtype=float) * np.sin(angle)
    return np.asarray((m_sin - q) / (m_sin + q))


def critical_angle(bottom: FluidBottom, *, sound_speed: ArrayLike) -> Array:
    """
    Grazing angle below which a lossless sea bed reflects everything.

    Parameters
    ----------
    bottom : FluidBottom
    sound_speed : array_like, shape (...)
        Of the water at the sea bed. [m/s]

    Returns
    -------
    ndarray, shape (...)
        NaN where the sea bed is not faster than the water: there is none. [rad]
    """
    ratio = np.asarray(sound_speed, dtype=float) / bottom.sound_speed
    return np.where(ratio < 1.0, np.arccos(np.minimum(ratio, 1.0)), np.nan)
