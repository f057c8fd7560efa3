"""
Models of the reflection of sound at the sea bed and at the surface.

A model has a method ``loss_and_phase`` as in `pymantaray.geometry.boundary.Reflection`; a new model
changes only this module. The theory page on loss has the limits of each model and its sources.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.geometry.boundary import Reflection
from pymantaray.quantities.checks import check_fields

Sediment = Literal[
    "none",
    "clay",
    "silt",
    "sand",
    "gravel",
    "moraine",
    "sandy-gravel",
    "coarse-sand",
    "medium-sand",
    "fine-sand",
    "very-fine-sand",
    "clayey-sand",
    "coarse-silt",
    "sandy-silt",
    "medium-silt",
    "fine-silt",
    "sandy-clay",
    "silty-clay",
]
"""Sediment of a sea bed in a configuration, see `bed_reflection`."""
SurfaceLoss = Literal["bubbles", "coherent"]
_WATER_DENSITY = 1025.0  # kg/m3
_LIGHTEST = 500.0  # kg/m3; of a sediment, so that densities in g/cm3 are refused
_GRAVITY = 9.81
_BUBBLE_CEILING = 15.0  # dB; secondary sources give 15 and 30
_SEDIMENTS = {  # sound speed [m/s], density [kg/m3], attenuation [dB per wavelength]
    "clay": (1500.0, 1500.0, 0.2),
    "silt": (1575.0, 1700.0, 1.0),
    "sand": (1650.0, 1900.0, 0.8),
    "gravel": (1800.0, 2000.0, 0.6),
    "moraine": (1950.0, 2100.0, 0.4),
}


class _FluidHalfSpace(Reflection):
    """Reflection at a fluid half-space with an index of refraction and a ratio of densities."""

    @property
    def density_ratio(self) -> float:
        """Density over that of the water."""
        raise NotImplementedError

    def _index(self, sound_speed: Array) -> NDArray[np.complex128]:
        """Complex index of refraction, by the sound speed of the water at the boundary [m/s]."""
        raise NotImplementedError

    def coefficient(
        self, grazing_angle: ArrayLike, *, sound_speed: ArrayLike
    ) -> NDArray[np.complex128]:
        """
        Return Rayleigh's reflection coefficient of plane waves, see `rayleigh_coefficient`.

        Parameters
        ----------
        grazing_angle : array_like, shape (n,)
            Grazing angles. [rad]
        sound_speed : array_like, shape (n,)
            Sound speed of the water at the boundary. [m/s]

        Returns
        -------
        ndarray of complex, shape (n,)
            Coefficients, with time as exp(-i omega t). [-]
        """
        index = self._index(np.asarray(sound_speed, dtype=float))
        return rayleigh_coefficient(grazing_angle, index, self.density_ratio)

    def loss_and_phase(
        self, grazing_angle: ArrayLike, frequency_hz: float, *, sound_speed: ArrayLike
    ) -> tuple[Array, Array]:
        """
        Loss [dB] and phase [rad] of each reflection; parameters as in `Reflection.loss_and_phase`.
        """
        del frequency_hz
        r = self.coefficient(grazing_angle, sound_speed=sound_speed)
        with np.errstate(divide="ignore"):  # there is no reflection at the angle of intromission
            return -20.0 * np.log10(np.abs(r)), np.angle(r)


class _Scattering(Reflection):
    """Reflection at the surface, with phase pi and a loss."""

    def loss_db(
        self, grazing_angle: ArrayLike, frequency_hz: float, *, sound_speed: ArrayLike
    ) -> Array:
        """
        Loss of each reflection.

        Parameters
        ----------
        grazing_angle : array_like, shape (n,)
            Grazing angles. [rad]
        frequency_hz : float
            Frequency. [Hz]
        sound_speed : array_like, shape (n,)
            Sound speed of the water at the boundary. [m/s]

        Returns
        -------
        ndarray, shape (n,)
            Loss of each reflection. [dB]
        """
        raise NotImplementedError

    def loss_and_phase(
        self, grazing_angle: ArrayLike, frequency_hz: float, *, sound_speed: ArrayLike
    ) -> tuple[Array, Array]:
        """
        Loss [dB] and phase [rad] of each reflection; parameters as in `Reflection.loss_and_phase`.
        """
        loss = self.loss_db(grazing_angle, frequency_hz, sound_speed=sound_speed)
        return loss, np.full(np.shape(loss), np.pi)


@dataclass(frozen=True)
class FluidBottom(_FluidHalfSpace):
    """
    Sea bed as a homogeneous fluid half space.

    Parameters
    ----------
    sound_speed : float
        Sound speed of the sediment. [m/s]
    density : float
        Density of the sediment. [kg/m3]
    attenuation_db_per_wavelength : float
        Attenuation of compressional waves in the sediment. [dB per wavelength]

    Examples
    --------
    >>> from pymantaray.acoustics import FluidBottom
    >>> sand = FluidBottom.standard("sand")
    >>> loss, phase = sand.loss_and_phase([0.2, 0.8], 25e3, sound_speed=1500.0)
    >>> print(loss.round(1))
    [0.8 8.2]
    """

    sound_speed: float
    density: float
    attenuation_db_per_wavelength: float = 0.0

    def __post_init__(self) -> None:
        check_fields(AcousticsError, self, "", "sound_speed", "density", positive=True)
        check_fields(AcousticsError, self, "dB", "attenuation_db_per_wavelength")
        if self.density < _LIGHTEST:
            raise AcousticsError(
                f"FluidBottom: density is {self.density:g} kg/m3; sediments have at least"
                f" {_LIGHTEST:g}; multiply a density in g/cm3 by 1000"
            )

    @classmethod
    def standard(cls, name: str) -> Self:
        """
        Return one of five sediments of the table of Jensen et al. (section 1.3).

        Parameters
        ----------
        name : {"clay", "silt", "sand", "gravel", "moraine"}
            Sediment.

        Returns
        -------
        FluidBottom

        Notes
        -----
        The model neglects shear waves, which are slow in these sediments (50 to 600 m/s). Rock is
        missing because it is not a fluid.
        """
        if name not in _SEDIMENTS:
            raise AcousticsError(f"sediment {name!r} is unknown; allowed: {', '.join(_SEDIMENTS)}")
        return cls(*_SEDIMENTS[name])

    @property
    def density_ratio(self) -> float:
        """Density over that of the water."""
        return self.density / _WATER_DENSITY

    def _index(self, sound_speed: Array) -> NDArray[np.complex128]:
        """Complex index of refraction, by the sound speed of the water at the boundary [m/s]."""
        loss_tangent = math.log(10.0) * self.attenuation_db_per_wavelength / (40.0 * math.pi)
        return np.asarray(
            sound_speed / self.sound_speed * (1.0 + 1j * loss_tangent), dtype=np.complex128
        )


@dataclass(frozen=True)
class SeaSurface(_Scattering):
    """
    Sea surface under wind.

    Parameters
    ----------
    wind_speed : float
        Wind speed at 10 m. [m/s]
    model : {"bubbles", "coherent"}
        Loss: the energy that bubbles absorb, or all energy that is not reflected specularly and in
        phase.

    Examples
    --------
    >>> from pymantaray.acoustics import SeaSurface
    >>> print(SeaSurface(wind_speed=8.0).loss_db([0.1, 0.5], 25e3, sound_speed=1450.0).round(1))
    [5.1 1.1]
    """

    wind_speed: float
    model: SurfaceLoss = "bubbles"

    def __post_init__(self) -> None:
        check_fields(AcousticsError, self, "m/s", "wind_speed")
        if self.model not in ("bubbles", "coherent"):
            raise AcousticsError(
                f"SeaSurface: model {self.model!r}; allowed: 'bubbles' and 'coherent'"
            )

    def loss_db(
        self, grazing_angle: ArrayLike, frequency_hz: float, *, sound_speed: ArrayLike
    ) -> Array:
        """Loss of each reflection [dB]; parameters as in `loss_and_phase`."""
        if self.model == "bubbles":
            return bubble_loss_db(grazing_angle, frequency_hz, wind_speed=self.wind_speed)
        return coherent_surface_loss_db(
            grazing_angle, frequency_hz, wind_speed=self.wind_speed, sound_speed=sound_speed
        )


@dataclass(frozen=True)
class IceCover(_Scattering):
    """
    Underside of ice with a constant loss per reflection.

    Parameters
    ----------
    db_per_bounce : float
        Loss per reflection. Measured values are about 20 dB at steep angles, less beyond 30 degrees
        from the vertical [1]_, and occasionally 15 dB at grazing angles up to 30 degrees under
        undulating ice [2]_. [dB]

    References
    ----------
    .. [1] Langleben, M. P. and Pounder, E. R. (1970), Acoustic attenuation in sea ice, part II,
       AD0707059, abstract: amplitude reflection coefficient about 0.1 near the vertical, 20 to 450
       kHz.
    .. [2] Verrall, R. and Ganton, J. (1977), The reflection of acoustic waves in sea water from an
       ice covered surface, ADA047298, abstract: reflectivities of -15 dB not uncommon, 0.2 to 20
       kHz.

    Examples
    --------
    >>> from pymantaray.acoustics import IceCover
    >>> print(IceCover(db_per_bounce=15.0).loss_db([0.1, 0.5], 25e3, sound_speed=1450.0))
    [15. 15.]
    """

    db_per_bounce: float

    def __post_init__(self) -> None:
        check_fields(AcousticsError, self, "dB", "db_per_bounce")

    def loss_db(
        self,
        grazing_angle: ArrayLike,
        frequency_hz: float,  # noqa: ARG002
        *,
        sound_speed: ArrayLike,  # noqa: ARG002
    ) -> Array:
        """Loss of each reflection [dB], which is constant; parameters as in `loss_and_phase`."""
        return np.full(np.shape(grazing_angle), self.db_per_bounce)


@dataclass(frozen=True)
class GrainSizeBottom(_FluidHalfSpace):
    """
    Sea bed as a fluid half-space with the properties of a sediment of a mean grain size, for 10 to
    100 kHz.

    The handbook of APL-UW [1]_ gives density, sound speed and loss of the upper decimetres relative
    to the water above, by equations 2 to 5. Its beds are softer than those of
    `FluidBottom.standard`, which are for lower frequencies.

    Parameters
    ----------
    grain_size : float
        Mean grain size M, -1 (sandy gravel) to 9 (clay): a diameter of 2**-M mm. [phi units]

    References
    ----------
    .. [1] Applied Physics Laboratory, University of Washington (1994), APL-UW High-Frequency Ocean
       Environmental Acoustic Models Handbook, TR 9407, section IV.

    Examples
    --------
    >>> from pymantaray.acoustics import GrainSizeBottom
    >>> loss, phase = GrainSizeBottom(5.0).loss_and_phase([0.2, 0.8], 25e3, sound_speed=1500.0)
    >>> print(loss.round(1))
    [16.6 22.1]
    """

    grain_size: float

    def __post_init__(self) -> None:
        if not -1.0 <= self.grain_size <= 9.0:
            raise AcousticsError(
                f"GrainSizeBottom: grain_size is {self.grain_size:g} phi; the model is for -1 to 9"
            )

    @property
    def density_ratio(self) -> float:
        """Density over that of the water (equation 2)."""
        if self.grain_size < 1.0:
            return self._polynomial(2.3139, -0.17057, 0.007797)
        if self.grain_size < 5.3:
            return self._polynomial(3.0455, -1.1069031, 0.2290201, -0.0165406)
        return self._polynomial(1.1565, -0.0012973)

    @property
    def sound_speed_ratio(self) -> float:
        """Sound speed over that of the water (equation 3)."""
        if self.grain_size < 1.0:
            return self._polynomial(1.2778, -0.056452, 0.002709)
        if self.grain_size < 5.3:
            return self._polynomial(1.3425, -0.1382798, 0.0213937, -0.0014881)
        return self._polynomial(1.0019, -0.0024324)

    @property
    def attenuation_db_per_m_khz(self) -> float:
        """Attenuation by frequency (equation 5). [dB/(m kHz)]"""
        if self.grain_size < 0.0:
            return 0.4556
        if self.grain_size < 2.6:
            return self._polynomial(0.4556, 0.0245)
        if self.grain_size < 4.5:
            return self._polynomial(0.1978, 0.1245)
        if self.grain_size < 6.0:
            return self._polynomial(8.0399, -2.5228, 0.20098)
        return self._polynomial(0.9431, -0.2041, 0.0117)

    @property
    def loss_tangent(self) -> float:
        """
        Imaginary over real part of the wavenumber, in water of the handbook's 1.528 m/ms (equation
        4).
        """
        per_wavelength = self.attenuation_db_per_m_khz * self.sound_speed_ratio * 1.528  # dB
        return per_wavelength * math.log(10.0) / (40.0 * math.pi)

    def _polynomial(self, *coefficients: float) -> float:
        return float(np.polynomial.polynomial.polyval(self.grain_size, coefficients))

    def _index(self, sound_speed: Array) -> NDArray[np.complex128]:
        """Complex index of refraction, the same at each sound speed of the water."""
        return np.full(
            np.shape(sound_speed), (1.0 + 1j * self.loss_tangent) / self.sound_speed_ratio
        )


_GRAIN_SIZES = {  # phi units
    "sandy-gravel": -1.0,
    "coarse-sand": 0.5,
    "medium-sand": 1.5,
    "fine-sand": 2.5,
    "very-fine-sand": 3.5,
    "clayey-sand": 4.0,
    "coarse-silt": 4.5,
    "sandy-silt": 5.0,
    "medium-silt": 6.0,
    "fine-silt": 6.5,
    "sandy-clay": 7.0,
    "silty-clay": 8.0,
}


def bed_reflection(sediment: Sediment) -> Reflection | None:
    """Reflection at a sea bed of a sediment; None if it reflects all sound."""
    if sediment in _GRAIN_SIZES:
        return GrainSizeBottom(_GRAIN_SIZES[sediment])
    return None if sediment == "none" else FluidBottom.standard(sediment)


def sediment_source(sediment: Sediment) -> str | None:
    """
    Key of the reference for the properties of a sediment, as in a study's list; None if it has
    none.
    """
    if sediment in _GRAIN_SIZES:
        return "apl-uw1994"
    return None if sediment == "none" else "jensen"


def rayleigh_coefficient(
    grazing_angle: ArrayLike, index: ArrayLike, density_ratio: float
) -> NDArray[np.complex128]:
    r"""
    Rayleigh's plane-wave reflection coefficient of pressure at a fluid half-space.

    Parameters
    ----------
    grazing_angle : array_like, shape (n,)
        Angle between the ray and the boundary. [rad]
    index : array_like, shape (n,)
        Complex index of refraction, :math:`n = (c/c_b)(1 + i\delta)` with the sound speeds of water
        and half-space and
        :math:`\delta = \ln 10\, \alpha_\lambda / 40\pi` for an attenuation :math:`\alpha_\lambda`
        in dB per wavelength.
    density_ratio : float
        Density of the half-space over that of the water.

    Returns
    -------
    ndarray, shape (n,)
        :math:`R = (m \sin\gamma - q)/(m \sin\gamma + q)`, :math:`q = \sqrt{n^2 - \cos^2\gamma}`, Im
        q >= 0, for the time dependence :math:`e^{-i\omega t}`. Its argument is the phase of the
        reflection.
    """
    angle = np.asarray(grazing_angle, dtype=float)
    q = np.sqrt(np.asarray(index) ** 2 - np.cos(angle) ** 2)
    m_sin = density_ratio * np.sin(angle)
    return np.asarray((m_sin - q) / (m_sin + q))


def wave_height_rms(wind_speed: ArrayLike) -> Array:
    r"""
    Standard deviation of the surface elevation of a fully developed sea, by the wind at 10 m [m/s].
    [m]

    The integral of the spectrum of Pierson and Moskowitz (1964)
    :math:`\alpha g^2 \omega^{-5} \exp[-\beta (g/U\omega)^4]` with :math:`\alpha = 0.0081, \beta =
    0.74` is
    :math:`\sigma^2 = \alpha U^4 / 4 \beta g^2`; its U is at 19.5 m, 1.026 times that at 10 m.
    """
    return np.asarray(
        (1.026 * np.asarray(wind_speed, dtype=float)) ** 2
        / (2.0 * _GRAVITY)
        * math.sqrt(0.0081 / 0.74)
    )


def coherent_surface_loss_db(
    grazing_angle: ArrayLike,
    frequency_hz: ArrayLike,
    *,
    wind_speed: ArrayLike,
    sound_speed: ArrayLike,
) -> Array:
    r"""
    Loss of the specular, in-phase part of the field at a rough surface. [dB]

    Kirchhoff's :math:`|R| = \exp(-2 k^2 \sigma^2 \sin^2\gamma)` for Gaussian elevations. The lost
    energy is scattered: at modem frequencies, receivers detect the scattered part.
    """
    k = 2.0 * math.pi * np.asarray(frequency_hz, dtype=float) / np.asarray(sound_speed, dtype=float)
    rayleigh = k * wave_height_rms(wind_speed) * np.sin(grazing_angle)
    return np.asarray(40.0 / math.log(10.0) * rayleigh**2)


def bubble_loss_db(
    grazing_angle: ArrayLike, frequency_hz: ArrayLike, *, wind_speed: ArrayLike
) -> Array:
    r"""
    Energy that the bubbles under a breaking sea absorb from a surface-reflected path. [dB]

    After the APL-UW handbook of 1994:
    :math:`1.26 \cdot 10^{-3} U^{1.57} f^{0.85} / \sin\gamma` with f in kHz from 6 m/s on, below
    that the value at 6 m/s times :math:`e^{1.2 (U - 6)}`. It fits data of 20 to 40 kHz within 3 dB.
    The loss has a ceiling, because sound is also scattered below the bubbles.
    """
    wind = np.asarray(wind_speed, dtype=float)
    breaking = 1.26e-3 * np.maximum(wind, 6.0) ** 1.57 * np.exp(1.2 * np.minimum(wind - 6.0, 0.0))
    khz = np.asarray(frequency_hz, dtype=float) / 1000.0
    sine = np.maximum(np.sin(grazing_angle), 1e-12)
    return np.asarray(np.minimum(breaking * khz**0.85 / sine, _BUBBLE_CEILING))
