"""
Sonar equation: from transmission loss and the noise of the sea to the detection probability of a
ping.

The theory page on loss lists the sources.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.quantities.checks import check_fields, check_number

_LEVELS = ("source_level_db", "processing_gain_db", "threshold_db", "spread_db")
_NODES = 32  # Gauss-Legendre points of a band, in the logarithm of frequency


@dataclass(frozen=True)
class WenzNoise:
    r"""
    Noise of turbulence, distant ships, wind and thermal agitation, by Wenz (1962) in the form of
    Coates (1990).

    Parameters
    ----------
    wind_speed : float
        Wind speed. [m/s]
    shipping : float
        Shipping activity, from 0 (no ships near) to 1 (heavy traffic). [-]

    Notes
    -----
    Levels in dB re 1 µPa²/Hz, f in kHz, s the shipping and w the wind: :math:`17 - 30 \lg f`;
    :math:`40 + 20 (s - 0.5) + 26 \lg f - 60 \lg(f + 0.03)`;
    :math:`50 + 7.5 \sqrt w + 20 \lg f - 40 \lg(f + 0.4)`; :math:`-15 + 20 \lg f`. The powers are
    added. The model applies to deep open water from about 1 Hz to 100 kHz, without rain, ice,
    animals and noise of the vehicle itself.

    Examples
    --------
    >>> print(f"{float(WenzNoise(wind_speed=5.0).level_db(25e3)):.1f}")
    38.5
    """

    wind_speed: float = 5.0
    shipping: float = 0.5

    def __post_init__(self) -> None:
        check_fields(AcousticsError, self, "m/s", "wind_speed")
        if not 0.0 <= self.shipping <= 1.0:
            raise AcousticsError(
                f"WenzNoise: shipping is {self.shipping:g}; it must be from 0 to 1"
            )

    def components_db(self, frequency_hz: ArrayLike) -> Array:
        """
        Return the spectral levels of turbulence, shipping, wind and thermal agitation.

        Parameters
        ----------
        frequency_hz : array_like, shape (...)
            Frequencies. [Hz]

        Returns
        -------
        ndarray, shape (4, ...)
            Levels. [dB re 1 µPa²/Hz]
        """
        f = np.asarray(frequency_hz, dtype=float) / 1000.0
        check_number(AcousticsError, "frequency_hz", 1000.0 * float(f.min()), "Hz", positive=True)
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
        Return the spectral level of all sources together.

        Parameters
        ----------
        frequency_hz : array_like, shape (...)
            Frequencies. [Hz]

        Returns
        -------
        ndarray, shape (...)
            Level. [dB re 1 µPa²/Hz]
        """
        return np.asarray(
            10.0 * np.log10(np.sum(10.0 ** (self.components_db(frequency_hz) / 10.0), axis=0))
        )

    def band_level_db(self, frequency_hz: float, bandwidth_hz: float) -> float:
        """
        Return the level in a band, which is the integral of the spectrum.

        Parameters
        ----------
        frequency_hz : float
            Middle of the band. [Hz]
        bandwidth_hz : float
            Width of the band. [Hz]

        Returns
        -------
        float
            Level. [dB re 1 µPa²]
        """
        low, high = _band(frequency_hz, bandwidth_hz)
        x, weight = np.polynomial.legendre.leggauss(_NODES)
        half = 0.5 * math.log(high / low)
        f = math.sqrt(low * high) * np.exp(half * x)
        power = np.sum(weight * half * f * 10.0 ** (self.level_db(f) / 10.0))
        return float(10.0 * np.log10(power))


@dataclass(frozen=True)
class Sonar:
    r"""
    Transmitter and receiver of a modem, and the noise.

    Parameters
    ----------
    source_level_db : float
        Level of a ping at 1 m, in the band. [dB re 1 µPa]
    frequency_hz, bandwidth_hz : float
        Middle and width of the band. [Hz]
    noise : WenzNoise or float
        Noise of the sea, or a spectral level at the receiver, constant in the band. [dB re 1
        µPa²/Hz]
    processing_gain_db : float
        Gain in signal-to-noise ratio by pulse compression and directivity. [dB]
    threshold_db : float
        Signal-to-noise ratio at which half of the pings are detected. [dB]
    spread_db : float
        Standard deviation of the level around its prediction (fading, aspect, errors of the model).
        With 0 detection is certain or impossible. [dB]

    Notes
    -----
    The excess is :math:`E = SL - TL - NL + PG - DT` with the noise level NL of the whole band. The
    level in decibels has a normal distribution with standard deviation :math:`\sigma`, so :math:`P
    = \Phi(E / \sigma)`. Draw a detection with ``detected = uniform < probability``. The default
    spread of 6 dB is close to 5.6 dB, that of the intensity of a fully saturated (Rayleigh) signal
    in decibels.

    Examples
    --------
    >>> sonar = Sonar(source_level_db=185.0, frequency_hz=25e3, bandwidth_hz=5e3, noise=50.0)
    >>> sonar.detection_probability(sonar.figure_of_merit_db)
    array(0.5)
    """

    source_level_db: float
    frequency_hz: float
    bandwidth_hz: float
    noise: WenzNoise | float = field(default_factory=WenzNoise)
    processing_gain_db: float = 0.0
    threshold_db: float = 10.0
    spread_db: float = 6.0

    def __post_init__(self) -> None:
        _band(self.frequency_hz, self.bandwidth_hz)
        values = {name: getattr(self, name) for name in _LEVELS}
        if not isinstance(self.noise, WenzNoise):
            values["noise"] = self.noise
        for name, value in values.items():
            if not math.isfinite(value):
                raise AcousticsError(f"Sonar: {name} is {value}; it must be finite")
        check_fields(AcousticsError, self, "dB", "spread_db")

    @property
    def noise_level_db(self) -> float:
        """Noise in the band. [dB re 1 µPa²]"""
        if isinstance(self.noise, WenzNoise):
            return self.noise.band_level_db(self.frequency_hz, self.bandwidth_hz)
        return self.noise + 10.0 * math.log10(self.bandwidth_hz)

    @property
    def figure_of_merit_db(self) -> float:
        """Transmission loss at which half of the pings are detected. [dB]"""
        return (
            self.source_level_db - self.noise_level_db + self.processing_gain_db - self.threshold_db
        )

    def snr_db(self, loss_db: ArrayLike) -> Array:
        """
        Return the signal-to-noise ratio after processing.

        Parameters
        ----------
        loss_db : array_like, shape (n,)
            Transmission loss. [dB]

        Returns
        -------
        ndarray, shape (n,)
            Signal-to-noise ratio. [dB]
        """
        return np.asarray(
            self.figure_of_merit_db + self.threshold_db - np.asarray(loss_db, dtype=float)
        )

    def detection_probability(self, loss_db: ArrayLike) -> Array:
        """
        Return the probability of detection.

        Parameters
        ----------
        loss_db : array_like, shape (n,)
            Transmission loss of arrivals or links; may be infinite. [dB]

        Returns
        -------
        ndarray, shape (n,)
            Probability; 0 at infinite loss. [-]
        """
        return probability_of_excess(self.snr_db(loss_db) - self.threshold_db, self.spread_db)


def probability_of_excess(excess_db: ArrayLike, spread_db: float) -> Array:
    """
    Return the probability that a level with a normal distribution about its prediction exceeds a
    threshold.

    Parameters
    ----------
    excess_db : array_like
        Predicted level minus threshold. [dB]
    spread_db : float
        Standard deviation of the level; 0 gives a step to 1 at an excess of 0. [dB]

    Returns
    -------
    ndarray
        As ``excess_db``.

    Examples
    --------
    >>> from pymantaray.acoustics import probability_of_excess
    >>> print(probability_of_excess([-6.0, 0.0, 6.0], 6.0).round(2))
    [0.16 0.5  0.84]
    """
    excess = np.asarray(excess_db, dtype=float)
    if spread_db == 0.0:
        return np.where(np.isnan(excess), np.nan, (excess >= 0.0).astype(float))
    from scipy.special import ndtr

    return np.asarray(ndtr(excess / spread_db))


def link_loss_db(
    loss_db: ArrayLike,
    link: ArrayLike,
    n_links: int,
    *,
    combine: Literal["strongest", "sum"] = "strongest",
) -> Array:
    r"""
    Transmission loss of each link from that of its arrivals.

    Parameters
    ----------
    loss_db : array_like, shape (n_arrivals,)
        Transmission loss of each arrival. [dB]
    link : array_like, shape (n_arrivals,)
        Row of its link.
    n_links : int
        Number of links.
    combine : {"strongest", "sum"}
        ``strongest``: that of the strongest arrival, because the band of a ranging modem
        (kilohertz) separates arrivals that are a millisecond apart and each has to be detected
        alone. ``sum``: the mean power over the phases of arrivals that overlap,
        :math:`-10 \lg \sum 10^{-TL/10}`.

    Returns
    -------
    ndarray, shape (n_links,)
        Infinite for a link without an arrival. [dB]

    Examples
    --------
    >>> from pymantaray.acoustics import link_loss_db
    >>> print(link_loss_db([76.0, 70.0, 80.0], [0, 0, 1], 3))
    [70. 80. inf]
    """
    loss = np.asarray(loss_db, dtype=float)
    row = np.asarray(link, dtype=np.int64)
    if loss.ndim != 1 or loss.shape != row.shape:
        raise AcousticsError(
            f"loss_db has shape {loss.shape}, link {row.shape}; both must be (n_arrivals,)"
        )
    if row.size and (row.min() < 0 or row.max() >= n_links):
        raise AcousticsError(f"link: {row.min()} to {row.max()}; must lie in 0 to {n_links - 1}")
    best = np.full(n_links, np.inf)
    with np.errstate(invalid="ignore"):
        np.minimum.at(best, row, loss)  # NaN stays NaN
    if combine == "strongest":
        return best
    if combine != "sum":
        raise AcousticsError(f"combine: {combine!r}; allowed are 'strongest' and 'sum'")
    level = np.full(n_links, -np.inf)
    neper = 10.0 / math.log(10.0)
    with np.errstate(invalid="ignore"):
        np.logaddexp.at(level, row, -loss / neper)
    return np.asarray(np.minimum(best, -neper * level))


def _band(frequency_hz: float, bandwidth_hz: float) -> tuple[float, float]:
    """Ends of a band by its middle and width; it must not reach down to 0. [Hz]"""
    low = frequency_hz - 0.5 * bandwidth_hz
    high = frequency_hz + 0.5 * bandwidth_hz
    if not (bandwidth_hz > 0.0 and low > 0.0 and math.isfinite(high)):
        raise AcousticsError(
            f"band of {bandwidth_hz:g} Hz about {frequency_hz:g} Hz; must be wider than 0 and stay"
            " above 0 Hz"
        )
    return low, high
