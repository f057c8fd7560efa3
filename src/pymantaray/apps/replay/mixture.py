"""
Likelihood of measured times as a mixture over candidates, and candidates that persist from one
reception to the next.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.acoustics import probability_of_excess
from pymantaray.acoustics.reflection import wave_height_rms
from pymantaray.apps.replay.event_data import (
    HOUR,
    ArrivalTracks,
    Components,
    EventData,
)
from pymantaray.apps.replay.options import PredictionOptions
from pymantaray.apps.replay.summary import quantile_of, ratio_interval
from pymantaray.arrays import Array, Indices
from pymantaray.estimation.filters.gauss_markov import CLUTTER, CLUTTER_WIDTH
from pymantaray.geometry import stream
from pymantaray.geometry.spread import MAD_TO_SIGMA
from pymantaray.sensing.picking import LEVEL_SPREAD_DB, by_rank, detected_first

_WITHIN_DB = 6.0  # below the strongest: an arrival with this level is detected with probability 0.5
_UNEXPLAINED = np.geomspace(2e-4, 2e-2, 25)  # s; values tried for the error that nothing explains
_COVERED = 0.95  # of the events of even hours, by their intervals
_MIN_EVENTS = 40  # events; with fewer, intervals are those of the mixture
_OUTLIER_SIGMA = 1e-2  # s
_MAX_WIDTH_EVENTS = 500  # latest events that determine the width of a causal interval
_MAX_QUANTILE = 0.9998
_ONE_WAY = np.sqrt(2.0)  # both ends have an error


class Mixture(NamedTuple):
    """
    Prediction of each event by a mixture over its candidates, and the probability of each
    candidate.
    """

    events: pd.DataFrame
    """
    ``sigma_s``, ``low_s`` and ``high_s`` (95 %), ``log_likelihood`` and ``mixture_s``, the median.
    """
    probability: Array
    """Of each candidate before the measured time of its event is known."""
    sigma: Array
    """Standard deviation of the time of each candidate. [s]"""
    unexplained: float
    """Standard deviation that ice, ocean and position do not explain, from even hours. [s]"""


def first_detected(candidates: pd.DataFrame, merit_db: float | None = None) -> Array:
    r"""
    Probability that each candidate is the first that a receiver detects, from its level and share.

    A candidate exists with probability ``share`` and has a level that is normal about the predicted
    one with a standard deviation of 6 dB. It is detected above the figure of merit of a sonar,
    without one from 6 dB below the strongest candidate. With the probability d of both, the
    candidates in order of time have :math:`d_k \prod_{j<k} (1 - d_j)`, scaled to a sum of 1.
    """
    event = candidates["event"].to_numpy(dtype=np.int64)
    loss = candidates["loss_db"].to_numpy()
    share = candidates["share"].to_numpy()
    _, group = np.unique(event, return_inverse=True)
    least = np.full(group.max(initial=-1) + 1, np.inf)
    certain = loss - 10.0 * np.log10(share)  # a rare strong arrival does not hide the others
    np.minimum.at(least, group, certain)
    limit = least[group] + _WITHIN_DB if merit_db is None else merit_db
    detected = np.clip(
        share * probability_of_excess(limit - loss, LEVEL_SPREAD_DB), 1e-9, 1.0 - 1e-9
    )
    first, _ = detected_first(by_rank(event), group, detected)
    return np.asarray(first / np.bincount(group, first)[group])


def predict_mixture(
    events: pd.DataFrame,
    candidates: pd.DataFrame,
    options: PredictionOptions,
    *,
    persistence: float = 0.0,
    merit_db: float | None = None,
    unexplained: float | None = None,
) -> Mixture:
    """
    Predict each event by a mixture over its candidates, with the receptions before it.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay`.
    candidates : pandas.DataFrame
        As from `merge_draws`, by event and time.
    options : PredictionOptions
    persistence : float
        Time constant with which a receiver leaves an arrival for a new choice; 0 for independent
        choices. [s]
    merit_db : float, optional
        Figure of merit of a sonar, for `first_detected`.
    unexplained : float, optional
        Error that nothing else explains; by default estimated from even hours. [s]

    Returns
    -------
    Mixture

    Notes
    -----
    A receiver stays with its arrival for a time t with probability exp(-t / persistence); otherwise
    it takes the first that it detects. The probabilities of the last reception's candidates pass to
    the candidates with the same delay over the straight path and, preferably, the same bounces. A
    prediction uses only earlier receptions of the same source and receiver. The standard deviation
    of a candidate consists of its spread over the draws, the errors of sound speed and position,
    the event's own sigma, and an error that these do not explain: the value with the largest
    likelihood on even hours. Of all receptions, 2 % are assumed to fit no candidate. Intervals are
    the central ones of the mixture with the probability that covers 95 % of the events of even
    hours; with fewer than 40 such events, that is 95 %.
    """
    prior = first_detected(candidates, merit_db)
    known = known_sigma(events, candidates, options)
    data = EventData.of(events, candidates, known, prior)
    even = (np.floor(events["time_s"].to_numpy() / HOUR) % 2) == 0
    even = even if even.any() else ~even
    if unexplained is None:
        scores = []
        for size in _UNEXPLAINED:
            _, log_likelihood = _follow(data, np.hypot(known, size), persistence)
            scores.append(np.nansum(log_likelihood[even]))
        unexplained = float(_UNEXPLAINED[int(np.argmax(scores))])
    sigma = np.hypot(known, unexplained)
    probability, log_likelihood = _follow(data, sigma, persistence)
    at = candidates["event"].to_numpy(dtype=np.int64)
    components = Components(at, data.candidate_time, sigma, probability)
    table = intervals(events, components, lambda far: _width(far[even]))
    return Mixture(table.assign(log_likelihood=log_likelihood), probability, sigma, unexplained)


def known_sigma(
    events: pd.DataFrame, candidates: pd.DataFrame, options: PredictionOptions
) -> Array:
    """
    Standard deviation of each candidate from ice, ocean, position and the event's own sigma. [s]
    """
    at = candidates["event"].to_numpy(dtype=np.int64)
    time = candidates["travel_time_s"].to_numpy()
    is_echo = (events["source"] == events["receiver"]).to_numpy()[at]
    sound_speed = events["sound_speed_m_s"].to_numpy()[at]
    along = events["distance_m"].to_numpy()[at] / time
    speed = np.where(is_echo, sound_speed, along)
    ocean = time * options.sound_speed_sigma / speed
    position = _ONE_WAY * options.position_sigma / speed
    own = np.nan_to_num(events["sigma_s"].to_numpy()[at])
    waves = _wave_sigma(candidates, sound_speed, along, options.wind_speed)
    spread = candidates["spread_s"].to_numpy()
    return np.asarray(np.sqrt(spread**2 + ocean**2 + position**2 + own**2 + waves**2))


def _wave_sigma(
    candidates: pd.DataFrame, sound_speed: Array, speed: Array, wind_speed: float
) -> Array:
    r"""
    Spread of times by waves: :math:`2 \sqrt n\, h \sin\gamma / c` for n reflections and the rms
    height h of `wave_height_rms`. [s]

    The grazing angle is that of a straight path with the candidate's travel time: its cosine is the
    speed along the distance over that of sound; 0 for an echo.
    """
    cosine = np.clip(speed / sound_speed, 0.0, 1.0)
    height = float(wave_height_rms(wind_speed))
    bounces = np.sqrt(candidates["surface_bounces"].to_numpy(dtype=float))
    return np.asarray(2.0 * bounces * height * np.sqrt(1.0 - cosine**2) / sound_speed)


def _follow(data: EventData, sigma: Array, persistence: float) -> tuple[Array, Array]:
    """
    Probability of each candidate before its event, and the log likelihood of each event's measured
    time.
    """
    probability = data.prior.copy()
    log_likelihood = np.full(data.time.size, np.nan)
    tracks = ArrivalTracks(persistence)
    for event in data.order.tolist():
        rows = data.rows(event)
        candidates = data.candidates_of(event)
        way = data.ways[event]
        probability[rows] = tracks.expect(way, candidates)
        off = (data.measured[event] - data.candidate_time[rows]) / sigma[rows]
        density = np.exp(-0.5 * off**2) / (np.sqrt(2.0 * np.pi) * sigma[rows])
        fits = (1.0 - CLUTTER) * probability[rows] * density
        clutter = CLUTTER / CLUTTER_WIDTH
        total = float(fits.sum())
        log_likelihood[event] = np.log(total + clutter)
        if total > clutter:  # else nothing explains it, and the arrival before it still counts
            tracks.learn(way, candidates, fits / total)
    return probability, log_likelihood


def intervals(
    events: pd.DataFrame,
    components: Components,
    width_of: Callable[[Array], Array | float],
    outliers: float = 0.0,
) -> pd.DataFrame:
    """
    Median, standard deviation and 95 % interval of the mixture of each event.

    The probability of the interval is a function of how far each measured time is from the median,
    as the probability between it and the same distance on the other side; NaN without candidates. A
    share of outliers has errors of 10 ms about any candidate.
    """
    from scipy.special import ndtr

    n = len(events)
    at, time, sigma, probability = components
    measured = events["measured_s"].to_numpy()
    mean = np.bincount(at, probability * time, minlength=n)
    has = np.bincount(at, minlength=n) > 0
    spread = np.bincount(at, probability * (sigma**2 + (time - mean[at]) ** 2), minlength=n)

    def below(place: Array) -> Array:
        off = place[at] - time
        share = (1.0 - outliers) * ndtr(off / sigma)
        share += outliers * ndtr(off / np.hypot(sigma, _OUTLIER_SIGMA))
        return np.asarray(np.bincount(at, probability * share, minlength=n))

    def quantile(level: Array | float) -> Array:
        low = np.full(n, np.inf)
        high = np.full(n, -np.inf)
        reach = 10.0 * np.hypot(sigma, _OUTLIER_SIGMA if outliers > 0.0 else 0.0)
        np.minimum.at(low, at, time - reach)
        np.maximum.at(high, at, time + reach)
        for _ in range(50):
            middle = 0.5 * (low + high)
            under = below(np.where(has, middle, 0.0)) < level
            low = np.where(under, middle, low)
            high = np.where(under, high, middle)
        return np.where(has, 0.5 * (low + high), np.nan)

    with np.errstate(invalid="ignore"):
        width = width_of(np.where(has, np.abs(2.0 * below(measured) - 1.0), np.nan))
        columns = {
            "sigma_s": np.where(has, np.sqrt(spread), np.nan),
            "low_s": quantile(0.5 - 0.5 * width),
            "mixture_s": quantile(0.5),
            "high_s": quantile(0.5 + 0.5 * width),
        }
    return pd.DataFrame(columns)


def _width(far: Array) -> float:
    """Probability that covers 95 % of some events; 95 % for a few."""
    known = far[np.isfinite(far)]
    if known.size < _MIN_EVENTS:
        return _COVERED
    return min(float(np.quantile(known, _COVERED)), _MAX_QUANTILE)


def other_width(even: NDArray[np.bool_], group: Indices, far: Array) -> Array:
    """
    Probability that covers 95 % of the events of odd hours, for even hours, and vice versa, by
    groups of events.
    """
    width = np.empty(far.size)
    for mine in (even, ~even):
        for number in np.unique(group[mine]).tolist():
            width[mine & (group == number)] = _group_width(far[~mine], group[~mine] == number)
    return width


def earlier_width(order: Indices, group: Indices, far: Array) -> Array:
    """Probability that covers 95 % of the events before each event, by groups of events."""
    width = np.full(far.size, _COVERED)
    for k in range(_MIN_EVENTS, order.size):
        earlier = order[max(k - _MAX_WIDTH_EVENTS, 0) : k]
        width[order[k]] = _group_width(far[earlier], group[earlier] == group[order[k]])
    return width


def _group_width(far: Array, is_member: NDArray[np.bool_]) -> float:
    """
    Probability that covers 95 % of the members of a group; of a group with few of them that of all
    events, but not less than 95 %.
    """
    if np.isfinite(far[is_member]).sum() >= _MIN_EVENTS:
        return _width(far[is_member])
    return max(_width(far), _COVERED)


def coverage_table(events: pd.DataFrame, *, seed: int) -> pd.DataFrame:
    """
    Residuals and coverage of the predictions of all events, of even hours, from which errors were
    estimated, and of odd hours.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay` with ``prediction_sigma_s``, ``low_s`` and ``high_s``.
    seed : int
        Seed of the bootstrap over pairs.

    Returns
    -------
    pandas.DataFrame
        One row per group: ``events``, ``predicted`` ones, median and 90 % quantile of the size of
        the residual over all events (an event without a prediction counts as infinite) [m], the
        percentage of predicted events with a residual within one and two sigma and within the 95 %
        interval, the latter with its own 95 % interval (``within_95_low`` and ``_high``: 1,000
        bootstrap samples of pairs, NaN for one pair), the median ``sigma_m``, two parts of the
        residuals by their medians (``pair_m``, constant errors of pairs, and ``varying_m``, the
        others), and the mean ``log_likelihood``.
    """
    odd = np.floor(events["time_s"].to_numpy() / HOUR) % 2 == 1
    rows = []
    groups = {"all": np.ones(odd.size, dtype=bool), "even hours": ~odd, "odd hours": odd}
    for name, member in groups.items():
        part = events[member]
        ok = part["residual_s"].notna()
        size = np.where(ok, part["residual_m"].abs(), np.inf)
        speed = (part["residual_m"] / part["residual_s"])[ok]
        sigma = part["prediction_sigma_s"][ok]
        late = part["residual_s"][ok].abs() / sigma
        inside = part["measured_s"].between(part["low_s"], part["high_s"])[ok]
        pair = part["pair"][ok]
        counts = inside.astype(float).groupby(pair).agg(["sum", "size"]).to_numpy()
        rng = stream(seed, 0, "replay", "coverage", name)
        low, high = ratio_interval(counts * [100.0, 1.0], rng)
        # constant errors of pairs about zero, and the rest; by medians, so that a few wrong
        # arrivals do not count
        residual = part["residual_m"][ok]
        by_pair = residual.groupby(pair)
        constant = by_pair.median().abs().median()
        varying = (residual - by_pair.transform("median")).abs().median()
        rows.append(
            {
                "group": name,
                "events": len(part),
                "predicted": int(ok.sum()),
                "median_size_m": quantile_of(size, 0.5),
                "q90_size_m": quantile_of(size, 0.9),
                "within_1_sigma": 100.0 * float((late <= 1.0).mean()),
                "within_2_sigma": 100.0 * float((late <= 2.0).mean()),
                "within_95": 100.0 * float(inside.mean()),
                "within_95_low": low,
                "within_95_high": high,
                "sigma_m": float((speed * sigma).median()),
                "pair_m": MAD_TO_SIGMA * float(constant),
                "varying_m": MAD_TO_SIGMA * float(varying),
                "log_likelihood": float(part["log_likelihood"].mean()),
            }
        )
    return pd.DataFrame(rows)
