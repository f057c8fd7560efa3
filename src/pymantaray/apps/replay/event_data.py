"""Events and their candidates as arrays, for passes in order of time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.apps.replay.tracks import EventCandidates, bounces_of
from pymantaray.arrays import Array, Indices

HOUR = 3600.0
CLUTTER = 0.02
"""Share of receptions that no candidate explains."""
CLUTTER_WIDTH = 0.1
"""Width of the distribution of their times. [s]"""


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
            bounces=bounces_of(candidates),
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
