"""
Levels of arrivals that a receiver cannot separate: coherent sums, and pairs of rays beside a
caustic.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from pymantaray.acoustics.levels.caustics import Tails, Waves, fold_between, fold_pairs, waves_of
from pymantaray.acoustics.levels.loss import TransmissionLoss
from pymantaray.arrays import Array, Indices
from pymantaray.errors import AcousticsError
from pymantaray.quantities.checks import check_number
from pymantaray.records import Arrivals

Coherent = bool | Literal["auto"]
"""
True: sum all arrivals of a link. False: detect each arrival alone. auto: sum arrivals that the band
does not separate.
"""
_CLOSE = 2.0 * math.pi  # rad; rays of a fold with a smaller phase between them are one arrival


def received_loss_db(
    arrivals: Arrivals,
    loss: TransmissionLoss,
    frequency_hz: float,
    bandwidth_hz: float,
    *,
    coherent: Coherent = "auto",
    tails: Tails | None = None,
) -> Array:
    r"""
    Return the loss of each received arrival, including interference with arrivals that are not
    separated from it.

    Parameters
    ----------
    arrivals : Arrivals
        From `find_eigenrays`.
    loss : TransmissionLoss
        Loss of the same arrivals at the centre of the band.
    frequency_hz, bandwidth_hz : float
        Centre and width of the signal's band. [Hz]
    coherent : bool or "auto"
        False: each arrival alone. True: the sum of all arrivals of a link at the centre of the
        band, as for a continuous tone. auto: the output of a matched filter at the time of each
        arrival.
    tails : Tails, optional
        Sound behind caustics near the receivers, from `find_tails`, which the sums include.

    Returns
    -------
    ndarray, shape (n_arrivals,)
        Loss. [dB]

    Raises
    ------
    AcousticsError
        If the frequency or the bandwidth is not positive, or ``coherent`` is not one of the three
        values.

    Notes
    -----
    The phase of an arrival is :math:`\omega T`, plus that of its reflections, minus a quarter of a
    cycle for each caustic. A rectangular band of width B separates arrivals by their delay: with
    ``auto``, the received pressure of arrival j is

    .. math:: p_j = \Big| \sum_i a_i e^{i \phi_i} \operatorname{sinc}(B (T_i - T_j)) \Big|,

    the coherent sum if the band is much narrower than the inverse of the delays, arrival j alone if
    it is much wider.

    Two rays of one fold, whose phases differ by less than a cycle, are one arrival for any band.
    Its field is the uniform one by Airy's function, which ray theory has as its limit far from the
    caustic. With half the phase between both
    :math:`\xi = \omega (T_b - T_a) / 2`, :math:`x = (3 \xi / 2)^{2/3}` and the pressures A of both,

    .. math:: p = \sqrt \pi e^{-i \pi / 4} \left[(A_a + A_b) x^{1/4} \mathrm{Ai}(-x) + i (A_b - A_a)
       x^{-1/4} \mathrm{Ai}'(-x)\right]

    at the mean of their times. It was derived here by matching to both rays far from the caustic.
    Its general form is in [1]_.

    References
    ----------
    .. [1] NIST Digital Library of Mathematical Functions, section 36.12(i): uniform approximation
       of integrals with coalescing critical points, also by continuation where these are complex.

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import received_loss_db, transmission_loss
    >>> loss = transmission_loss(medium, source, receiver, arrivals, 25e3)
    >>> print(received_loss_db(arrivals, loss, 25e3, 5e3).round(1))
    [70.  69.6]
    >>> print(received_loss_db(arrivals, loss, 25e3, 10.0, coherent=True).round(1))
    [63.8 63.8]
    """
    if not (isinstance(coherent, bool) or coherent == "auto"):
        raise AcousticsError(f"coherent is {coherent!r}; allowed: true, false and 'auto'")
    check_number(AcousticsError, "frequency_hz", frequency_hz, "Hz", positive=True)
    check_number(AcousticsError, "bandwidth_hz", bandwidth_hz, "Hz", positive=True)
    pairs = fold_pairs(arrivals, frequency_hz, _CLOSE)
    waves = _with_folds(waves_of(arrivals, loss), pairs, frequency_hz)
    link = arrivals.link
    if tails is not None and coherent is not False:
        waves = Waves(
            *(np.concatenate(columns) for columns in zip(waves, tails.waves, strict=True))
        )
        link = np.concatenate([link, tails.link])
    order = np.argsort(link, kind="stable")
    width = {True: 0.0, False: math.inf, "auto": bandwidth_hz}[coherent]
    received = np.empty(link.size)
    received[order] = _sums(link[order], waves.at(order), frequency_hz, width)
    together = np.zeros(link.size, dtype=bool)
    if coherent is not False:
        together = np.bincount(link)[link] > 1
    together[pairs.ravel()] = True
    rows = slice(0, arrivals.link.size)
    return np.where(together[rows] & np.isfinite(loss.total_db), received[rows], loss.total_db)


def _with_folds(alone: Waves, pairs: Indices, frequency_hz: float) -> Waves:
    """
    Waves with the joint field of each fold in the rows of both rays; sums exclude the second row.
    """
    if not pairs.size:
        return alone
    a, b = pairs.T
    fold = fold_between(alone.at(a), alone.at(b), frequency_hz).wave()
    time, size, phase = (column.copy() for column in alone)
    time[a] = fold.time
    time[b] = fold.time
    size[a] = fold.log_size
    size[b] = -np.inf
    phase[a] = fold.phase
    return Waves(time, size, phase)


def _sums(link: Indices, waves: Waves, frequency_hz: float, width_hz: float) -> Array:
    """
    Loss of the sum of a link's waves at the time of each wave; a band with a width separates waves
    by their delay. [dB]
    """
    n = link.size
    if not n:
        return np.zeros(0)
    count = np.bincount(link)
    size = np.where(np.isfinite(waves.log_size), waves.log_size, -np.inf)
    largest = np.full(count.size, -np.inf)
    np.maximum.at(largest, link, size)
    scale = np.where(np.isfinite(largest), largest, 0.0)[link]
    value = np.exp(size - scale) * np.exp(
        1j * (2.0 * math.pi * frequency_hz * waves.time + waves.phase)
    )
    total = value.copy()
    for step in range(1, int(count.max())):
        i = np.arange(n - step)
        j = np.arange(step, n)
        together = link[i] == link[j]
        i = i[together]
        j = j[together]
        apart = waves.time[j] - waves.time[i]
        share = (
            np.sinc(width_hz * apart) if math.isfinite(width_hz) else (apart == 0.0).astype(float)
        )
        total[i] += share * value[j]
        total[j] += share * value[i]
    with np.errstate(divide="ignore"):
        return np.asarray(-20.0 / math.log(10.0) * (np.log(np.abs(total)) + scale))
