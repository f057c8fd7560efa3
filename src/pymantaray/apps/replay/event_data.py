"""
Events and their candidates as arrays, for passes in order of time, and arrivals that receivers
follow from one reception to the next.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.arrays import Array, Indices
from pymantaray.estimation.ranges.picks import persist, stay_probability
from pymantaray.sensing.picking import LEVEL_SPREAD_DB

HOUR = 3600.0
# s; candidates of successive events are the same arrival if their delays differ by about this
_MATCH = 1e-3
_OTHER_BOUNCES = 0.1  # weight of a match with other bounces
_LOST = 1e-3  # probability that the next event does not have an arrival
_MIN_WEIGHT = 1e-3  # of the candidates of a reception, relative to the most probable one
_REMEMBERED = 24  # receptions of a pair, in both directions
_OWN_WEIGHT = 5.0  # receptions of a pair that weigh as much as the probability by level
_LEVEL_OFFSET_DB = 1e3  # dB; prior standard deviation of source level and gain


class EventCandidates(NamedTuple):
    """Candidates of one event: what identifies an arrival, and its probability by level."""

    time: float
    """Of the event. [s]"""
    delay: Array
    """Over the straight path. [s]"""
    bounces: Array
    prior: Array
    """Probability that each is the first that a receiver detects."""
    loss_db: Array
    level_db: float
    """Measured level; NaN if unknown."""


class Reception(NamedTuple):
    """Candidates of an earlier reception with the probability that it was each of them."""

    time: float
    delay: Array
    bounces: Array
    weight: Array


@dataclass
class ArrivalTracks:
    """
    Probabilities of candidates from the receptions before.

    Parameters
    ----------
    persistence : float
        Time constant with which a receiver leaves an arrival for a new choice; 0 for independent
        choices. [s]
    memory : float
        Time constant with which earlier receptions of a pair, in both directions, lose weight for
        new choices; 0 for new choices by level alone. [s]
    """

    persistence: float
    memory: float = 0.0
    _last: dict[tuple[str, str], Reception] = field(default_factory=dict)
    _pairs: dict[frozenset[str], deque[Reception]] = field(default_factory=dict)
    _levels: dict[tuple[str, str], tuple[float, float]] = field(default_factory=dict)

    def expect(self, way: tuple[str, str], event: EventCandidates) -> Array:
        """Probability of each candidate of an event of a source and a receiver."""
        choice = self._with_level(way, event, self._new_choice(way, event))
        before = self._last.get(way)
        if before is None or self.persistence <= 0.0:
            return choice
        same = self._with_level(way, event, passed([before], event, event.prior)[0])
        stay = stay_probability(abs(event.time - before.time), self.persistence)
        return persist(same, choice, stay)

    def learn(self, way: tuple[str, str], event: EventCandidates, weight: Array) -> None:
        """Remember a reception, with the probability of each candidate after its measurement."""
        kept = weight > _MIN_WEIGHT * weight.max()
        reception = Reception(event.time, event.delay[kept], event.bounces[kept], weight[kept])
        self._last[way] = reception
        if self.memory > 0.0:
            of_pair = self._pairs.setdefault(frozenset(way), deque(maxlen=_REMEMBERED))
            of_pair.append(reception)
        if np.isfinite(event.level_db):
            share = weight / weight.sum()
            mean, variance = self._levels.get(way, (0.0, _LEVEL_OFFSET_DB**2))
            offset = event.level_db + float(share @ event.loss_db) - mean
            gain = variance / (variance + LEVEL_SPREAD_DB**2)
            self._levels[way] = mean + gain * offset, variance * (1.0 - gain)

    def _new_choice(self, way: tuple[str, str], event: EventCandidates) -> Array:
        """Probability of each candidate for a receiver that chooses anew."""
        of_pair = self._pairs.get(frozenset(way))
        if not of_pair:
            return event.prior
        age = np.array([abs(event.time - reception.time) for reception in of_pair])
        weight = np.exp(-age / self.memory)
        earlier = weight @ passed(list(of_pair), event, event.prior)
        return np.asarray((_OWN_WEIGHT * event.prior + earlier) / (_OWN_WEIGHT + weight.sum()))

    def _with_level(self, way: tuple[str, str], event: EventCandidates, choice: Array) -> Array:
        """Probabilities by the measured level as well, if the way has had levels before."""
        if not np.isfinite(event.level_db) or way not in self._levels:
            return choice
        mean, variance = self._levels[way]
        off = event.level_db - (mean - event.loss_db)
        fits = choice * np.exp(-0.5 * off**2 / (variance + LEVEL_SPREAD_DB**2))
        total = float(fits.sum())
        return fits / total if total > 0.0 else choice


def passed(before: list[Reception], event: EventCandidates, prior: Array) -> Array:
    """
    Probability of each candidate if the receiver has the arrival of each of some receptions before,
    shape (n_receptions, n_candidates).
    """
    delay = np.concatenate([reception.delay for reception in before])
    bounces = np.concatenate([reception.bounces for reception in before])
    weight = np.concatenate([reception.weight / reception.weight.sum() for reception in before])
    match = np.exp(-0.5 * ((event.delay[None, :] - delay[:, None]) / _MATCH) ** 2)
    match *= np.where(event.bounces[None, :] == bounces[:, None], 1.0, _OTHER_BOUNCES)
    total = match.sum(axis=1, keepdims=True)
    each = weight[:, None] * (match + _LOST * prior[None, :]) / (total + _LOST)
    start = np.cumsum([0, *(reception.delay.size for reception in before[:-1])])
    return np.asarray(np.add.reduceat(each, start, axis=0))


class Components(NamedTuple):
    """Normal distributions of travel times, one row each, by event."""

    event: Indices
    time: Array
    """[s]"""
    sigma: Array
    """[s]"""
    probability: Array
    """Of those of an event, the sum is 1, or 0 without any."""

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Distributions of several tables by event."""
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        order = np.argsort(columns[0], kind="stable")
        return cls(*(column[order] for column in columns))

    def scaled(self, share: Array) -> Self:
        """Distributions whose probability is multiplied by a share of each event."""
        return self._replace(probability=self.probability * share[self.event])

    def density(self, rows: slice, measured: float) -> Array:
        """Probability density of a measured time by some rows."""
        off = (measured - self.time[rows]) / self.sigma[rows]
        fits = np.exp(-0.5 * np.minimum(off**2, 1400.0)) / (np.sqrt(2.0 * np.pi) * self.sigma[rows])
        return np.asarray(self.probability[rows] * fits)


@dataclass(frozen=True, eq=False)
class EventData:
    """Events and candidates as arrays, for repeated passes."""

    order: Indices
    """Events with candidates in order of time."""
    time: Array
    measured: Array
    start: Indices
    stop: Indices
    ways: list[tuple[str, str]]
    candidate_time: Array
    known_sigma: Array
    """Standard deviation of each candidate without learned errors. [s]"""
    prior: Array
    delay: Array
    bounces: Array
    loss_db: Array
    level_db: Array

    @classmethod
    def of(
        cls,
        events: pd.DataFrame,
        candidates: pd.DataFrame,
        known_sigma: Array,
        prior: Array,
        **more: Any,
    ) -> Self:
        """Return arrays of the tables of a `Replay`."""
        at = candidates["event"].to_numpy(dtype=np.int64)
        rows = np.arange(len(events))
        start, stop = (np.searchsorted(at, rows, side=side) for side in ("left", "right"))
        time = events["time_s"].to_numpy(dtype=float)
        order = np.argsort(time, kind="stable")
        chord = (events["distance_m"] / events["sound_speed_m_s"]).to_numpy()
        level = events.get("measured_level_db", pd.Series(np.nan, index=events.index))
        candidate_time = candidates["travel_time_s"].to_numpy()
        surface, bottom = (candidates[f"{end}_bounces"].to_numpy() for end in ("surface", "bottom"))
        return cls(
            order=order[stop[order] > start[order]],
            time=time,
            measured=events["measured_s"].to_numpy(),
            start=start,
            stop=stop,
            ways=list(zip(events["source"], events["receiver"], strict=True)),
            candidate_time=candidate_time,
            known_sigma=known_sigma,
            prior=prior,
            delay=candidate_time - chord[at],
            bounces=(64 * surface + bottom).astype(float),
            loss_db=candidates["loss_db"].to_numpy(),
            level_db=np.asarray(level, dtype=float),
            **more,
        )

    def rows(self, event: int) -> slice:
        """Candidates of an event."""
        return slice(self.start[event], self.stop[event])

    @property
    def ends_hour(self) -> NDArray[np.bool_]:
        """True for the last event of each hour with events."""
        hour = np.floor(self.time[self.order] / HOUR)
        last = np.append(hour[1:] != hour[:-1], [True])
        flags = np.zeros(self.time.size, dtype=bool)
        flags[self.order] = last[: self.order.size]
        return flags

    def candidates_of(self, event: int) -> EventCandidates:
        """Candidates of an event, for tracks."""
        rows = self.rows(event)
        return EventCandidates(
            self.time[event],
            self.delay[rows],
            self.bounces[rows],
            self.prior[rows],
            self.loss_db[rows],
            float(self.level_db[event]),
        )
