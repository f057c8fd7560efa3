"""Ranges on another arrival than the direct one: which arrivals a receiver may take, how probably, and which by chance."""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics import Sonar, probability_of_excess
from pymantaray.errors import SensingError
from pymantaray.records import Measurements, RayStatus, Trajectories
from pymantaray.records.base import Column, Record, column
from pymantaray.records.status import ARRIVES
from pymantaray.sensing.exchanges import all_exchanges, exchange_times, exchange_values, velocities_of
from pymantaray.sensing.ranging import Ranging
from pymantaray.sensing.receptions import Direction, Receptions
from pymantaray.sensing.schedule import Attempts, chances
from pymantaray.sensing.timing import ONE_WAY, Timing

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
PickRule = Literal["first-detected", "strongest-detected"]
_SPREAD_DB = 6.0  # of an arrival's level where no sonar says another
_FAR_DB = 1e4  # stands for an infinite loss
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(64)
_TAIL = 8.0  # standard deviations beyond which a normal level does not go


@dataclass(frozen=True)
class Picker:
    r"""
    Rule by which a receiver picks one of the arrivals of a ping.

    Parameters
    ----------
    rule : {"first-detected", "strongest-detected"}
        The earliest of the arrivals that it detects, or the loudest of them.
    sonar : Sonar, optional
        What it detects, and how much levels spread about the predicted ones.
    below_strongest_db : float, optional
        Without a sonar, for ``first-detected``: an arrival predicted to be so much weaker than the link's strongest
        is detected half the time. [dB]

    Notes
    -----
    The level of each arrival is normal in decibels about the predicted one with standard deviation
    :math:`\sigma`, independently of the others. With the mean excess :math:`e_k` over the threshold and :math:`p_k =
    \Phi(e_k / \sigma)`, arrival k in order of time is taken with probability

    .. math:: p_k \prod_{j < k} (1 - p_j)

    by ``first-detected`` and, of all orders,

    .. math:: \int_{-e_k / \sigma}^\infty \varphi(z) \prod_{j \ne k} \Phi\left(z + (e_k - e_j) / \sigma\right) dz

    by ``strongest-detected``. Both add up to :math:`1 - \prod_k (1 - p_k)`: with a sonar, nothing may be heard.
    Without one, as everywhere, something is: the threshold lies `below_strongest_db` below the predicted level of
    the strongest, :math:`\sigma` is 6 dB, and if nothing passes the receiver takes the predicted strongest;
    ``strongest-detected`` has no threshold then.
    """

    rule: PickRule
    sonar: Sonar | None = None
    below_strongest_db: float | None = None

    def __post_init__(self) -> None:
        """Check the rule and that it has its threshold."""
        if self.rule not in get_args(PickRule):
            raise SensingError(f"Picker: rule {self.rule!r}; allowed are {', '.join(get_args(PickRule))}")
        needed = self.rule == "first-detected" and self.sonar is None
        if needed != (self.below_strongest_db is not None):
            raise SensingError(
                f"Picker: below_strongest_db is {self.below_strongest_db}; first-detected without a sonar needs it,"
                " nothing else does"
            )

    def probabilities(self, loss_db: ArrayLike, link: ArrayLike, travel_time: ArrayLike) -> Array:
        """
        Probability that each arrival is the one that its receiver takes; arrivals of the same link compete.

        A loss of NaN counts as infinite. Without a sonar only differences within a link matter. [dB]
        """
        links = np.asarray(link, dtype=np.int64)
        order = np.lexsort((np.asarray(travel_time, dtype=float), links))
        loss = np.nan_to_num(np.asarray(loss_db, dtype=float), nan=_FAR_DB, posinf=_FAR_DB, neginf=-_FAR_DB)[
            order
        ]
        ranks = by_rank(links[order])
        competes = np.unique(links, return_inverse=True)[1][order]  # links without gaps between them
        least = np.full(competes.max(initial=-1) + 1, np.inf)
        np.minimum.at(least, competes, loss)
        if self.sonar is not None:
            spread, excess = self.sonar.spread_db, self.sonar.figure_of_merit_db - loss
        else:
            spread, excess = _SPREAD_DB, (self.below_strongest_db or 0.0) + least[competes] - loss
        strongest = _earliest(ranks, competes, loss == least[competes])
        if self.rule == "first-detected":
            picked, missed = _first(ranks, competes, probability_of_excess(excess, spread))
            if self.sonar is None:
                picked[strongest] += missed[competes[strongest]]
        elif spread == 0.0:
            picked = np.where((excess >= 0.0) & np.isin(np.arange(loss.size), strongest), 1.0, 0.0)
        else:
            lowest = None if self.sonar is None else -excess / spread
            picked = _loudest(ranks, competes, excess / spread, lowest)
        result = np.empty(loss.size)
        result[order] = picked
        return result


def by_rank(group: NDArray[np.int64]) -> list[Indices]:
    """The first row of each group, the second of each that has so many, and so on; rows of a group stand together."""
    _, start, count = np.unique(group, return_index=True, return_counts=True)
    return [start[count > rank] + rank for rank in range(int(count.max(initial=0)))]


def _earliest(ranks: list[Indices], link: Indices, marked: NDArray[np.bool_]) -> Indices:
    """First marked row of each link."""
    row = np.full(link.max(initial=-1) + 1, -1)
    for rows in ranks:
        new = rows[marked[rows] & (row[link[rows]] < 0)]
        row[link[new]] = new
    return row


def _first(ranks: list[Indices], link: Indices, detected: Array) -> tuple[Array, Array]:
    """Probability of each row to be the first detected, and of each link that none is."""
    first, missed = np.empty(detected.size), np.ones(link.max(initial=-1) + 1)
    for rows in ranks:
        first[rows] = detected[rows] * missed[link[rows]]
        missed[link[rows]] *= 1.0 - detected[rows]
    return first, missed


def _loudest(ranks: list[Indices], link: Indices, level: Array, lowest: Array | None) -> Array:
    """Probability of each row to be the loudest, above its lowest level; levels have standard deviation 1."""
    from scipy.special import ndtr

    low = np.full(level.size, -_TAIL) if lowest is None else np.clip(lowest, -_TAIL, _TAIL)
    half = 0.5 * (_TAIL - low)
    z = low[:, None] + half[:, None] * (_NODES + 1.0)
    integrand = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    for rows in ranks:
        other = np.full(link.max(initial=-1) + 1, -1)
        other[link[rows]] = rows
        rival = other[link]
        beaten = np.flatnonzero((rival >= 0) & (rival != np.arange(level.size)))
        integrand[beaten] *= ndtr(z[beaten] + (level[beaten] - level[rival[beaten]])[:, None])
    return np.asarray(half * (integrand @ _WEIGHTS))


@dataclass(frozen=True, eq=False)
class Candidates(Record):
    """
    What each range attempt may take for its direct arrival, rows of an attempt together, the direct one first.

    Two-way a candidate is an arrival of the ping with one of the answer.
    """

    kind: ClassVar[str] = "candidates"

    attempt: Column = column("candidate", "1", "row of the range table", "i8")
    travel_time: Column = column(
        "candidate", "s", "travel time, two-way half of the round trip as in the range table"
    )
    probability: Column = column("candidate", "1", "that the receiver takes this one")
    direct: Column = column("candidate", "1", "1 for what is ranged on without mistakes, else 0", "i1")
    bounces: Column = column("candidate", "1", "reflections, two-way those of both ways", "i2")

    @property
    def expected_mistaken(self) -> float:
        """Mean number of attempts in a realization that take something else for the direct arrival."""
        return float(np.sum(self.probability[self.direct == 0]))

    def picks(self, chance: ArrayLike) -> Indices:
        """
        Candidate that each attempt takes by a uniform number in 0 to 1, -1 for none.

        It is the first whose probability, added to those before it, is greater than the number.
        """
        u = np.asarray(chance, dtype=float)
        if self.attempt.size and self.attempt.max() >= u.size:
            raise SensingError(
                f"candidates of attempt {self.attempt.max()}; the measurements have {u.size} range attempts"
            )
        picks, total = np.full(u.size, -1), np.zeros(u.size)
        for rows in by_rank(self.attempt):
            of = self.attempt[rows]
            total[of] += self.probability[rows]
            now = (picks[of] < 0) & (u[of] < total[of])
            picks[of[now]] = rows[now]
        return picks

    def mistaken(self, picks: Indices) -> NDArray[np.bool_]:
        """Whether each attempt took another arrival than the direct one, by what `picks` gives."""
        return np.asarray((picks >= 0) & (np.append(self.direct, 1)[picks] == 0))


def find_candidates(
    ranging: Ranging, truth: Trajectories, picker: Picker, *, timing: Timing = ONE_WAY
) -> Candidates:
    """
    List the arrivals that each range attempt can mistake for the direct one, and the direct one.

    ``ranging`` was measured by the rule ``direct``, with a detector if the picker has a sonar, and by the same timing. A
    link without a direct arrival has its reflected ones; attempts of a stopped vehicle have none. Without a sonar the losses
    are the arrivals' spreading alone, without reflection and absorption. Two-way, ping and answer are picked
    independently.
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
    columns = time, np.prod(probability, axis=0), np.prod(direct, axis=0), np.sum(bounces, axis=0)
    order = np.lexsort((time, -columns[2], attempt))
    return Candidates(attempt[order], *(values[order] for values in columns))


def pick_receptions(receptions: Receptions, picker: Picker) -> Receptions:
    """Receptions with the probability that the picker takes each; those of a link and direction compete."""
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
    Let chance decide what each attempt of one realization takes for the direct arrival: rows of candidates, -1 for nothing.

    The draws are those of `draw_unheard`. Since the direct candidate comes first, an attempt whose direct arrival is
    the earliest and is heard without mistakes is heard with them too, by ``first-detected``: mistakes come
    in the place of what was not heard. With a correlation time [s] a receiver stays with its pick for about so long, see
    `chances`; each attempt for itself picks as without.
    """
    return candidates.picks(
        chances(
            measurements,
            root_seed=root_seed,
            realization=realization,
            correlation_time=correlation_time,
        )
    )


def range_on_picks(measurements: Measurements, candidates: Candidates, picks: Indices) -> Measurements:
    """
    Range on what each attempt takes for the direct arrival, by `draw_picks`; straight ranges stay.

    Where another arrival was taken, the refracted range is its own, and the status is OK, as of what leaked: the receiver knows
    no better. Where nothing was, an arrival that there is has status UNHEARD and a refracted range of NaN.
    """
    o, wrong = measurements, candidates.mistaken(picks)
    lost = (picks < 0) & np.isin(o.range_status, ARRIVES)
    status, refracted = o.range_status.copy(), o.refracted_range.copy()
    status[picks >= 0], status[lost], refracted[lost] = RayStatus.OK, RayStatus.UNHEARD, np.nan
    refracted[wrong] = o.transmitter_sound_speed[wrong] * candidates.travel_time[picks[wrong]]
    return replace(o, range_status=status, refracted_range=refracted)
