"""Ambient noise of the ocean by Wenz's four sources."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]
_NODES = 32  # Gauss-Legendre points of a band, in the logarithm of frequency


@dataclass(frozen=True)
class WenzNoise:
    r"""
    Noise of turbulence, distant ships, wind and thermal agitation.

    Parameters
    ----------
    wind_speed : float
        [m/s]
    shipping : float
        Activity, 0 (none near) to 1 (heavy). [-]

    Raises
    ------
    AcousticsError
        If the wind is negative or not finite, or the activity outside 0 to 1.

    Notes
    -----
    Levels in dB re 1 µPa²/Hz, f in kHz, s the shipping and w the wind: :math:`17 - 30 \lg f`;
    :math:`40 + 20 (s - 0.5) + 26 \lg f - 60 \lg(f + 0.03)`;
    :math:`50 + 7.5 \sqrt w + 20 \lg f - 40 \lg(f + 0.4)`; :math:`-15 + 20 \lg f`. The powers add. Deep open
    water from about 1 Hz to 100 kHz; rain, ice, animals and the vehicle's own noise are not in it.

    References
    ----------
    .. [1] Coates, R. (1990), Underwater Acoustic Systems, as quoted by Stojanovic and in papers after her,
       which were read instead; after Wenz, G. M. (1962), J. Acoust. Soc. Am. 34, 1936-1956.

    Examples
    --------
    >>> print(f"{float(WenzNoise(wind_speed=5.0).level_db(25e3)):.1f}")
    38.5
    """

    wind_speed: float = 5.0
    shipping: float = 0.5

    def __post_init__(self) -> None:
        """Check both values."""
        if not (math.isfinite(self.wind_speed) and self.wind_speed >= 0.0):
            raise AcousticsError(
                f"WenzNoise: wind_speed is {self.wind_speed:g} m/s; must be finite and not negative"
            )
        if not 0.0 <= self.shipping <= 1.0:
            raise AcousticsError(f"WenzNoise: shipping is {self.shipping:g}; must lie in 0 to 1")

    def components_db(self, frequency_hz: ArrayLike) -> Array:
        """
        Spectral level of each source.

        Parameters
        ----------
        frequency_hz : array_like, shape (...)
            Positive. [Hz]

        Returns
        -------
        ndarray, shape (4, ...)
            Turbulence, shipping, wind, thermal. [dB re 1 µPa²/Hz]

        Raises
        ------
        AcousticsError
            If a frequency is not positive.
        """
        f = np.asarray(frequency_hz, dtype=float) / 1000.0
        if np.any(~(f > 0.0)):
            raise AcousticsError(f"frequency_hz: {np.min(f) * 1000.0:g}; must be positive")
        lg = np.log10(f)
        return np.stack(
            [
                17.0 - 30.0 * lg,
                40.0 + 20.0 * (self.shipping - 0.5) + 26.0 * lg - 60.0 * np.log10(f + 0.03),
                50.0 + 7.5 * math.sqrt(self.wind_speed) + 20.0 * lg - 40.0 * np.log10(f + 0.4),
                -15.0 + 20.0 * lg,
            ]
        )

    def level_db(self, frequency_hz: ArrayLike) -> Array:
        """
        Spectral level of all sources together.

        Parameters
        ----------
        frequency_hz : array_like, shape (...)
            Positive. [Hz]

        Returns
        -------
        ndarray, shape (...)
            [dB re 1 µPa²/Hz]

        Raises
        ------
        AcousticsError
            If a frequency is not positive.
        """
        return np.asarray(10.0 * np.log10(np.sum(10.0 ** (self.components_db(frequency_hz) / 10.0), axis=0)))

    def band_level_db(self, frequency_hz: float, bandwidth_hz: float) -> float:
        """
        Level in a band: the spectrum's integral.

        Parameters
        ----------
        frequency_hz, bandwidth_hz : float
            Middle and width; the band must not reach down to 0. [Hz]

        Returns
        -------
        float
            [dB re 1 µPa²]

        Raises
        ------
        AcousticsError
            If the width is not positive or the band reaches down to 0 Hz.
        """
        low, high = check_band(frequency_hz, bandwidth_hz)
        x, weight = np.polynomial.legendre.leggauss(_NODES)
        half = 0.5 * math.log(high / low)
        f = math.sqrt(low * high) * np.exp(half * x)
        power = np.sum(weight * half * f * 10.0 ** (self.level_db(f) / 10.0))
        return float(10.0 * np.log10(power))


def check_band(frequency_hz: float, bandwidth_hz: float) -> tuple[float, float]:
    """
    Ends of a band.

    Parameters
    ----------
    frequency_hz, bandwidth_hz : float
        Middle and width. [Hz]

    Returns
    -------
    low, high : float
        [Hz]

    Raises
    ------
    AcousticsError
        If the width is not positive or the band reaches down to 0 Hz.
    """
    low, high = frequency_hz - 0.5 * bandwidth_hz, frequency_hz + 0.5 * bandwidth_hz
    if not (bandwidth_hz > 0.0 and low > 0.0 and math.isfinite(high)):
        raise AcousticsError(
            f"band of {bandwidth_hz:g} Hz about {frequency_hz:g} Hz; must be wider than 0 and stay above 0 Hz"
        )
    return low, high
