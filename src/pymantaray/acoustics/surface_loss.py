"""Loss of a bounce at the wind-roughened surface."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]
_GRAVITY = 9.81


@dataclass(frozen=True)
class SeaSurface:
    """
    Surface under wind.

    Parameters
    ----------
    wind_speed : float
        At 10 m. [m/s]
    model : {"bubbles", "coherent"}
        What is lost: the energy that bubbles absorb, or all that is not reflected specularly and in phase.

    Raises
    ------
    AcousticsError
        If the wind is negative or not finite, or the model unknown.
    """

    wind_speed: float
    model: Literal["bubbles", "coherent"] = "bubbles"

    def __post_init__(self) -> None:
        """Check both values."""
        _wind(self.wind_speed)
        if self.model not in ("bubbles", "coherent"):
            raise AcousticsError(f"SeaSurface: model {self.model!r}; allowed are 'bubbles' and 'coherent'")

    def loss_db(self, grazing_angle: ArrayLike, frequency_hz: float, *, sound_speed: ArrayLike) -> Array:
        """
        Loss of one bounce.

        Parameters
        ----------
        grazing_angle : array_like, shape (...)
            Between ray and surface, 0 to pi/2. [rad]
        frequency_hz : float
            [Hz]
        sound_speed : array_like, shape (...)
            Of the water at the surface. [m/s]

        Returns
        -------
        ndarray, shape (...)
            Not negative. [dB]
        """
        if self.model == "bubbles":
            return bubble_loss_db(grazing_angle, frequency_hz, wind_speed=self.wind_speed)
        return coherent_surface_loss_db(
            grazing_angle, frequency_hz, wind_speed=self.wind_speed, sound_speed=sound_speed
        )


def wave_height_rms(wind_speed: ArrayLike) -> Array:
    r"""
    Standard deviation of the surface elevation of a fully developed sea.

    Parameters
    ----------
    wind_speed : array_like, shape (...)
        At 10 m. [m/s]

    Returns
    -------
    ndarray, shape (...)
        [m]

    Raises
    ------
    AcousticsError
        If a wind is negative or not finite.

    Notes
    -----
    The integral of the Pierson-Moskowitz spectrum
    :math:`\alpha g^2 \omega^{-5} \exp[-\beta (g/U\omega)^4]` with :math:`\alpha = 0.0081, \beta = 0.74` is
    :math:`\sigma^2 = \alpha U^4 / 4 \beta g^2`; its U is at 19.5 m, 1.026 times that at 10 m.

    References
    ----------
    .. [1] Pierson, W. J. and Moskowitz, L. (1964), J. Geophys. Res. 69, 5181-5190 (not at hand; the
       spectrum is in every textbook of ocean waves).
    """
    return np.asarray((1.026 * _wind(wind_speed)) ** 2 / (2.0 * _GRAVITY) * math.sqrt(0.0081 / 0.74))


def coherent_surface_loss_db(
    grazing_angle: ArrayLike, frequency_hz: ArrayLike, *, wind_speed: ArrayLike, sound_speed: ArrayLike
) -> Array:
    r"""
    Loss of the specular, in-phase part of the field at a rough surface.

    Parameters
    ----------
    grazing_angle : array_like, shape (...)
        0 to pi/2. [rad]
    frequency_hz, wind_speed, sound_speed : array_like, shape (...)
        [Hz, m/s at 10 m, m/s]

    Returns
    -------
    ndarray, shape (...)
        [dB]

    Raises
    ------
    AcousticsError
        If a wind is negative or not finite.

    Notes
    -----
    Kirchhoff's :math:`|R| = \exp(-2 k^2 \sigma^2 \sin^2\gamma)` for Gaussian elevations. What is lost here is
    scattered, not gone: at modem frequencies the scattered part is what arrives.
    """
    k = 2.0 * math.pi * np.asarray(frequency_hz, dtype=float) / np.asarray(sound_speed, dtype=float)
    rayleigh = k * wave_height_rms(wind_speed) * np.sin(grazing_angle)
    return np.asarray(40.0 / math.log(10.0) * rayleigh**2)


def bubble_loss_db(
    grazing_angle: ArrayLike,
    frequency_hz: ArrayLike,
    *,
    wind_speed: ArrayLike,
    ceiling_db: float = 15.0,
) -> Array:
    r"""
    Energy that the bubbles under a breaking sea absorb from a surface-reflected path.

    Parameters
    ----------
    grazing_angle : array_like, shape (...)
        0 to pi/2. [rad]
    frequency_hz, wind_speed : array_like, shape (...)
        [Hz, m/s at 10 m]
    ceiling_db : float
        Largest loss: past it, scattering from beneath the bubbles carries on. Secondary sources give 15 and
        30 for it. [dB]

    Returns
    -------
    ndarray, shape (...)
        [dB]

    Raises
    ------
    AcousticsError
        If a wind is negative or not finite.

    Notes
    -----
    :math:`1.26 \cdot 10^{-3} U^{1.57} f^{0.85} / \sin\gamma` with f in kHz from 6 m/s on, below that the
    value at 6 m/s times :math:`e^{1.2 (U - 6)}`. A fit to data of 20 to 40 kHz within 3 dB.

    References
    ----------
    .. [1] APL-UW High-Frequency Ocean Environmental Acoustic Models Handbook, TR 9407, 1994, section II,
       eqs. 28a, 28b; the report was not at hand, two independent codes agree on the formula.
    """
    wind = _wind(wind_speed)
    breaking = 1.26e-3 * np.maximum(wind, 6.0) ** 1.57 * np.exp(1.2 * np.minimum(wind - 6.0, 0.0))
    khz = np.asarray(frequency_hz, dtype=float) / 1000.0
    sine = np.maximum(np.sin(grazing_angle), 1e-12)
    return np.minimum(breaking * khz**0.85 / sine, ceiling_db)


def _wind(wind_speed: ArrayLike) -> Array:
    wind = np.asarray(wind_speed, dtype=float)
    if not np.all(np.isfinite(wind)) or np.any(wind < 0.0):
        raise AcousticsError(f"wind_speed: {np.min(wind):g} m/s; must be finite and not negative")
    return wind
