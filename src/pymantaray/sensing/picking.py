"""Mistaken arrivals: candidates of a receiver, their probabilities and random choice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.acoustics import Sonar, probability_of_excess
from pymantaray.arrays import Array, Indices, Mask
from pymantaray.errors import SensingError
from pymantaray.records import Measurements, RayStatus, Trajectories
from pymantaray.records.base import Column, Record, column
from pymantaray.records.status import ARRIVES
from pymantaray.sensing.exchanges import (
    all_exchanges,
    exchange_times,
    exchange_values,
    velocities_of,
)
from pymantaray.sensing.ranging import Ranging
from pymantaray.sensing.receptions import Direction, Receptions
from pymantaray.sensing.schedule import Attempts, chances
from pymantaray.sensing.timing import ONE_WAY, Timing

PickRule = Literal["first-detected", "strongest-detected"]
LEVEL_SPREAD_DB = 6.0  # dB; standard deviation of an arrival's level without a sonar
_FAR_DB = 1e4  # dB; replaces an infinite loss
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_TAIL = 8.0  # standard deviations; limit of normal levels in integrals


@dataclass(frozen=True)
class Picker:
    r"""
    Rule by which a receiver picks one arrival of a ping.

    Parameters
    ----------
    rule : {"first-detected", "strongest-detected"}
        The earliest of the detected arrivals, or the loudest.
    sonar : Sonar, optional
        Detection threshold, and spread of levels about the predicted ones.
    below_strongest_db : float, optional
        Without a sonar, for ``first-detected``: level below the link's strongest arrival at which
        an arrival is detected with probability 0.5. [dB]

    Notes
    -----
    The level of each arrival is normal in decibels about the predicted one with standard deviation
    :math:`\sigma`, independently of the others. With the mean excess :math:`e_k` over the threshold
    and :math:`p_k = \Phi(e_k / \sigma)`, arrival k in order of time is taken with probability

    .. math:: p_k \prod_{j < k} (1 - p_j)

    by ``first-detected`` and, of all orders,

    .. math:: \int_{-e_k / \sigma}^\infty \varphi(z) \prod_{j \ne k} \Phi\left(z + (e_k - e_j) /
       \sigma\right) dz

    by ``strongest-detected``. Both add up to :math:`1 - \prod_k (1 - p_k)`: with a sonar, it is
    possible that nothing is detected. Without a sonar something always is: the threshold lies
    `below_strongest_db` below the predicted level of the strongest, :math:`\sigma` is 6 dB, and if
    nothing passes the receiver takes the arrival predicted to be strongest; ``strongest-detected``
    has no threshold then.

    Examples
    --------
    >>> from pymantaray.sensing import Picker
    >>> picker = Picker("first-detected", below_strongest_db=6.0)
    >>> print(picker.probabilities([80.0, 75.0], link=[0, 0], travel_time=[2.0, 2.1]).round(2))
    [0.57 0.43]
    """

    rule: PickRule
    sonar: Sonar | None = None
    below_strongest_db: float | None = None

    def __post_init__(self) -> None:
        """Check the rule and its threshold."""
        if self.rule not in get_args(PickRule):
            raise SensingError(
                f"Picker: rule {self.rule!r}; allowed are {', '.join(get_args(PickRule))}"
            )
        needs_level = self.rule == "first-detected" and self.sonar is None
        if needs_level != (self.below_strongest_db is not None):
            raise SensingError(
                f"Picker: below_strongest_db is {self.below_strongest_db}; first-detected without a"
                " sonar needs it, nothing else does"
            )

    def probabilities(self, loss_db: ArrayLike, link: ArrayLike, travel_time: ArrayLike) -> Array:
        """
        Probability that the receiver picks each arrival; arrivals of the same link compete.

        Parameters
        ----------
        loss_db : ndarray, shape (n_arrivals,)
            Transmission loss; NaN counts as infinite. Without a sonar, only differences within a
            link matter. [dB]
        link : ndarray of int, shape (n_arrivals,)
            Link of each arrival.
        travel_time : ndarray, shape (n_arrivals,)
            Travel times. [s]

        Returns
        -------
        ndarray, shape (n_arrivals,)
            Probabilities. [-]
        """
        links = np.asarray(link, dtype=np.int64)
        order = np.lexsort((np.asarray(travel_time, dtype=float), links))
        loss = np.nan_to_num(
            np.asarray(loss_db, dtype=float), nan=_FAR_DB, posinf=_FAR_DB, neginf=-_FAR_DB
        )[order]
        ranks = by_rank(links[order])
        _, link_without_gaps = np.unique(links, return_inverse=True)
        competes = link_without_gaps[order]
        least = np.full(competes.max(initial=-1) + 1, np.inf)
        np.minimum.at(least, competes, loss)
        if self.sonar is not None:
            spread = self.sonar.spread_db
            excess = self.sonar.figure_of_merit_db - loss
        else:
            spread = LEVEL_SPREAD_DB
            excess = (self.below_strongest_db or 0.0) + least[competes] - loss
        strongest = _earliest(ranks, competes, loss == least[competes])
        if self.rule == "first-detected":
            detection = probability_of_excess(excess, spread)
            probability, p_none = detected_first(ranks, competes, detection)
            if self.sonar is None:
                probability[strongest] += p_none[competes[strongest]]
        elif spread == 0.0:
            is_strongest = np.isin(np.arange(loss.size), strongest)
            probability = np.where((excess >= 0.0) & is_strongest, 1.0, 0.0)
        else:
            lowest = None if self.sonar is None else -excess / spread
            probability = _loudest(ranks, competes, excess / spread, lowest)
        result = np.empty(loss.size)
        result[order] = probability
        return result


def by_rank(group: Indices) -> list[Indices]:
    """
    First rows of all groups, then second rows of groups with two or more, and so on.

    Rows of a group are consecutive.
    """
    _, start, count = np.unique(group, return_index=True, return_counts=True)
    return [start[count > rank] + rank for rank in range(int(count.max(initial=0)))]


def _earliest(ranks: list[Indices], link: Indices, mask: Mask) -> Indices:
    """First marked row of each link."""
    row = np.full(link.max(initial=-1) + 1, -1)
    for rows in ranks:
        new = rows[mask[rows] & (row[link[rows]] < 0)]
        row[link[new]] = new
    return row


def detected_first(ranks: list[Indices], link: Indices, p_detection: Array) -> tuple[Array, Array]:
    """
    Probability that each row is detected first, and probability that no row of a link is detected;
    ``ranks`` as from `by_rank`.
    """
    first = np.empty(p_detection.size)
    p_none = np.ones(link.max(initial=-1) + 1)
    for rows in ranks:
        first[rows] = p_detection[rows] * p_none[link[rows]]
        p_none[link[rows]] *= 1.0 - p_detection[rows]
    return first, p_none


def _loudest(ranks: list[Indices], link: Indices, level: Array, lowest: Array | None) -> Array:
    """
    Probability that each row is the loudest and above the lowest level.

    Levels have a standard deviation of 1.
    """
    from scipy.special import ndtr

    low = np.full(level.size, -_TAIL) if lowest is None else np.clip(lowest, -_TAIL, _TAIL)
    half = 0.5 * (_TAIL - low)
    z = low[:, None] + half[:, None] * (_NODES + 1.0)
    integrand = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    for ranked in ranks:
        other = np.full(link.max(initial=-1) + 1, -1)
        other[link[ranked]] = ranked
        rival = other[link]
        rows = np.flatnonzero((rival >= 0) & (rival != np.arange(level.size)))
        integrand[rows] *= ndtr(z[rows] + (level[rows] - level[rival[rows]])[:, None])
    return np.asarray(half * (integrand @ _WEIGHTS))


@dataclass(frozen=True, eq=False)
class Candidates(Record):
    """
    Arrivals that each range attempt can mistake for its direct one.

    Rows of an attempt are consecutive, the direct one first.

    Two-way, a candidate is an arrival of the ping with one of the answer.
    """

    kind: ClassVar[str] = "candidates"

    attempt: Column = column("candidate", "1", "row of the range table", "i8")
    travel_time: Column = column(
        "candidate", "s", "travel time; two-way, half of the round trip as in the range table"
    )
    probability: Column = column(
        "candidate", "1", "probability that the receiver picks this arrival"
    )
    direct: Column = column(
        "candidate", "1", "1 for the arrival of a range without mistakes, else 0", "i1"
    )
    bounces: Column = column("candidate", "1", "reflections; two-way, those of both legs", "i2")

    @property
    def expected_mistaken(self) -> float:
        """Mean number of attempts in a realization that mistake another arrival for the direct."""
        return float(np.sum(self.probability[self.direct == 0]))

    def picks(self, chance: ArrayLike) -> Indices:
        """
        Candidate of each attempt from a uniform random number.

        It is the first with a greater cumulative probability.

        Parameters
        ----------
        chance : array_like, shape (n_ranges,)
            Uniform numbers in 0 to 1, one per range attempt.

        Returns
        -------
        ndarray of int, shape (n_ranges,)
            Row of the candidate; -1 for none.
        """
        chances = np.asarray(chance, dtype=float)
        if self.attempt.size and self.attempt.max() >= chances.size:
            raise SensingError(
                f"candidates of attempt {self.attempt.max()}; the measurements have"
                f" {chances.size} range attempts"
            )
        picks = np.full(chances.size, -1)
        total = np.zeros(chances.size)
        for rows in by_rank(self.attempt):
            attempt = self.attempt[rows]
            total[attempt] += self.probability[rows]
            hit = (picks[attempt] < 0) & (chances[attempt] < total[attempt])
            picks[attempt[hit]] = rows[hit]
        return picks

    def mistaken(self, picks: Indices) -> Mask:
        """
        Attempts that mistake another arrival for the direct one.

        Parameters
        ----------
        picks : ndarray of int, shape (n_ranges,)
            Result of `picks`.

        Returns
        -------
        ndarray of bool, shape (n_ranges,)
            True if the pick is not the direct arrival.
        """
        return np.asarray((picks >= 0) & (np.append(self.direct, 1)[picks] == 0))


def find_candidates(
    ranging: Ranging, truth: Trajectories, picker: Picker, *, timing: Timing = ONE_WAY
) -> Candidates:
    """
    List the arrivals that each range attempt can mistake for the direct one, and the direct one.

    Parameters
    ----------
    ranging : Ranging
        Ranges with the rule ``direct``, with a detector if the picker has a sonar, and with the
        same timing.
    truth : Trajectories
        True poses of the vehicles.
    picker : Picker
        Rule by which receivers pick an arrival.
    timing : OneWay or TwoWay
        Timing of the ranges.

    Returns
    -------
    Candidates
        A link without a direct arrival has its reflected ones; attempts of a stopped vehicle have
        none.

    Notes
    -----
    Without a sonar, losses consist only of the spreading of the arrivals, without reflection and
    absorption. Two-way, the receivers pick ping and answer independently.

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import Picker, ReceptionOptions, find_candidates, measure_ranges
    >>> reception = ReceptionOptions(max_surface_bounces=1)
    >>> ranging = measure_ranges(truth, [], medium, schedule, reception)
    >>> candidates = find_candidates(ranging, truth, Picker("strongest-detected"))
    >>> print(candidates.attempt, candidates.probability.round(2))
    [0 0 1 1] [0.49 0.51 0.49 0.51]
    """
    attempts = ranging.attempts
    receptions = pick_receptions(ranging.receptions, picker)
    forth = (attempts.transmitter > attempts.receiver).astype(np.int64)
    attempt, exchanges = all_exchanges(receptions, ranging.link, forth, timing)
    velocity = velocities_of(truth, Attempts(*(values[attempt] for values in attempts)), timing)
    time = exchange_times(receptions, exchanges, timing, velocity)
    probability, direct, bounces = (
        exchange_values(values, exchanges, timing)
        for values in (
            receptions.probability,
            receptions.selected,
            receptions.surface_bounces + receptions.bottom_bounces,
        )
    )
    columns = {
        "attempt": attempt,
        "travel_time": time,
        "probability": np.prod(probability, axis=0),
        "direct": np.prod(direct, axis=0),
        "bounces": np.sum(bounces, axis=0),
    }
    order = np.lexsort((time, -columns["direct"], attempt))
    return Candidates(**{name: values[order] for name, values in columns.items()})


def pick_receptions(receptions: Receptions, picker: Picker) -> Receptions:
    """
    Receptions with the probability of being picked.

    Receptions of the same link and direction compete.
    """
    lossless = bool(np.isnan(receptions.loss_db).all())
    if picker.sonar is not None and lossless and receptions.link.size:
        raise SensingError(
            "find_candidates: a picker with a sonar needs ranges that were measured with a detector"
        )
    loss = receptions.spreading_db if picker.sonar is None else receptions.loss_db
    probability = np.empty(loss.size)
    for direction in Direction:
        rows = receptions.direction == direction
        probability[rows] = picker.probabilities(
            loss[rows], receptions.link[rows], receptions.travel_time[rows]
        )
    return replace(receptions, probability=probability)


def draw_picks(
    measurements: Measurements,
    candidates: Candidates,
    *,
    root_seed: int,
    realization: int,
    correlation_time: float = 0.0,
) -> Indices:
    """
    Draw the candidate of each attempt in one realization.

    Parameters
    ----------
    measurements : Measurements
        Range attempts.
    candidates : Candidates
        Candidates of these attempts.
    root_seed : int
        Seed of the study.
    realization : int
        Index of the realization.
    correlation_time : float
        Correlation time of successive picks of a receiver, see `chances`; it does not change the
        distribution of each pick. [s]

    Returns
    -------
    ndarray of int, shape (n_ranges,)
        Row of the candidate; -1 for none.

    Notes
    -----
    The draws are those of `draw_unheard`, and the direct candidate is first. With the rule
    ``first-detected``, an attempt whose direct arrival is the earliest is therefore detected with
    mistakes if it is detected without them: mistakes replace missed detections.

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import Picker, draw_picks, find_candidates
    >>> candidates = find_candidates(ranging, truth, Picker("strongest-detected"))
    >>> draw_picks(measurements, candidates, root_seed=1, realization=0)
    array([0, 1])
    """
    return candidates.picks(
        chances(
            measurements,
            root_seed=root_seed,
            realization=realization,
            correlation_time=correlation_time,
        )
    )


def range_on_picks(
    measurements: Measurements, candidates: Candidates, picks: Indices
) -> Measurements:
    """
    Replace refracted ranges by those of the picks of `draw_picks`; straight ranges stay.

    An attempt with a mistaken arrival has the refracted range of that arrival and status OK, as has
    sound without a ray, because the receiver cannot tell the difference. An existing arrival that
    was not detected has status UNHEARD and a refracted range of NaN.
    """
    is_mistaken = candidates.mistaken(picks)
    missed = (picks < 0) & np.isin(measurements.range_status, ARRIVES)
    status = measurements.range_status.copy()
    refracted_range = measurements.refracted_range.copy()
    status[picks >= 0] = RayStatus.OK
    status[missed] = RayStatus.UNHEARD
    refracted_range[missed] = np.nan
    refracted_range[is_mistaken] = (
        measurements.transmitter_sound_speed[is_mistaken]
        * candidates.travel_time[picks[is_mistaken]]
    )
    return replace(measurements, range_status=status, refracted_range=refracted_range)
