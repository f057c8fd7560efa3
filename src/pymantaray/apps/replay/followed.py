"""
Arrivals that are followed by their measured times: predictions by persistence, and their
probability beside those of the candidates, learned for each time since the last reception.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pandas as pd

from pymantaray.apps.replay.event_data import Components
from pymantaray.arrays import Array, Indices
from pymantaray.estimation.filters.gauss_markov import CLUTTER, CLUTTER_WIDTH, average_models

SAME = 1e-3
"""Receptions of one arrival differ by less than this, apart from the distance. [s]"""
_ELAPSED = np.array([10.0, 30.0, 120.0, 600.0, 3600.0, 21600.0, 86400.0])  # s; shares are learned
_SCALES = np.geomspace(5e-5, 2e-2, 13)  # s; standard deviations of the error of a prediction
_FIRST_SCALE = 2e-4  # s; expected at the shortest elapsed time
_SCALE_WIDTH = 0.8  # of the expected scales, in logarithms
_PRIOR_SHARE = 0.6  # of followed arrivals, expected at the shortest elapsed time
_PRIOR_EVENTS = 4.0  # that the expected shares weigh, at each elapsed time
_GAIN = 0.1  # of a reception in the long memory, at least
_MOST = 6  # arrivals of a way; the one with the fewest receptions is forgotten
_SHORT, _LONG, _OTHER = range(3)  # last arrival by its last reception or its mean, another arrival


class Followed(NamedTuple):
    """Predictions with followed arrivals."""

    components: Components
    """Of candidates and of followed arrivals."""
    arrivals: pd.DataFrame
    """
    ``event``, ``travel_time_s``, ``sigma_s`` and ``probability`` of each followed arrival, before
    the event is measured.
    """
    log_likelihood: Array
    """Of each event."""
    modelled: Array
    """Probability of the candidates of each event, before it is measured."""


@dataclass
class _Way:
    """Arrivals of a source and a receiver: travel times per distance, and receptions."""

    time: float = -np.inf
    last: int = 0
    explained: float = 1.0
    """Probability that a candidate explained the last reception."""
    short: list[float] = field(default_factory=list)
    long: list[float] = field(default_factory=list)
    count: list[float] = field(default_factory=list)

    def learn(self, time: float, slowness: float, distance: float) -> None:
        """Add a reception to the arrival that it belongs to, or begin another one."""
        off = [abs(value - slowness) * distance for value in self.short]
        if off and min(off) < SAME:
            i = int(np.argmin(off))
            self.short[i] = slowness
            gain = max(1.0 / (self.count[i] + 1.0), _GAIN)
            self.long[i] += gain * (slowness - self.long[i])
            self.count[i] += 1.0
        else:
            if len(off) == _MOST:
                rare = int(np.argmin(self.count))
                for values in (self.short, self.long, self.count):
                    del values[rare]
            i = len(self.short)
            self.short.append(slowness)
            self.long.append(slowness)
            self.count.append(1.0)
        self.time, self.last = time, i


class _Shares:
    """
    Events that each kind of prediction has explained, by the time since the last reception, and by
    whether candidates explained it.
    """

    def __init__(self) -> None:
        """Begin with the errors that are expected at the shortest time."""
        shape = np.exp(-0.5 * (np.log(_SCALES / _FIRST_SCALE) / _SCALE_WIDTH) ** 2)
        self.prior = _PRIOR_SHARE * np.stack([shape / (3.0 * shape.sum())] * 3)
        self.followed = np.zeros((2, _ELAPSED.size, 3, _SCALES.size))
        self.modelled = np.zeros((2, _ELAPSED.size))

    def at(self, elapsed: float, explained: float) -> tuple[Array, Array, float]:
        """
        Weights of both states and the learned times (2, n_times), shares of followed arrivals by
        kind and scale, and of candidates.
        """
        place = np.interp(np.log(max(elapsed, 1e-3)), np.log(_ELAPSED), np.arange(_ELAPSED.size))
        near = np.maximum(1.0 - np.abs(np.arange(_ELAPSED.size) - place), 0.0)
        weight = np.outer([explained, 1.0 - explained], near)
        followed, total = np.zeros((3, _SCALES.size)), 0.0
        expected = self.prior
        for number in range(_ELAPSED.size):
            events = self.followed[:, number] + _PRIOR_EVENTS * expected
            every = self.followed[:, number].sum(axis=(1, 2)) + self.modelled[:, number]
            every += _PRIOR_EVENTS
            followed += np.tensordot(weight[:, number], events, 1)
            total += float(weight[:, number] @ every)
            expected = _wider(events / every[:, None, None])
        return weight, followed / total, 1.0 - float(followed.sum() / total)

    def learn(self, weight: Array, followed: Array, modelled: float) -> None:
        """Add an event by the probabilities that each kind explains it."""
        self.followed += np.multiply.outer(weight, followed)
        self.modelled += weight * modelled


def follow(
    events: pd.DataFrame,
    model: Components,
) -> Followed:
    """
    Add followed arrivals to the predictions of candidates, in order of time.

    Parameters
    ----------
    events : pandas.DataFrame
        Events of a `Replay`.
    model : Components
        Predictions by candidates, by event.

    Returns
    -------
    Followed

    Notes
    -----
    An event of a way (source and receiver) is predicted by the candidates, by the arrival that the
    way received last, with its last time or a mean of its last ones, and by its other arrivals, all
    multiplied by the change of the distance. The error of a followed arrival is a mixture of scales
    from 0.05 to 20 ms. The shares of all these predictions depend on the time since the last
    reception of the way and on the probability that a candidate explained it, and are the numbers
    of earlier events, of all ways, that they explained: a Bayesian mixture of predictors. With
    enough events it is therefore as good as the best of them for each elapsed time. A receiver that
    has taken an arrival that no draw contains is likely to take it again. For a longer time, the
    shares of the shorter one are expected, half of them with errors one scale larger.

    These predictions are averaged with those of the candidates alone, weighted by the likelihood of
    both for earlier events (Bayesian model averaging), so that right candidates stay as they are.
    """
    # columns of the events, and rows of their candidates
    n = len(events)
    time, measured = events["time_s"].to_numpy(dtype=float), events["measured_s"].to_numpy()
    distance = np.where(events["distance_m"] > 0.0, events["distance_m"], 1.0)  # 1 for echoes
    names = list(zip(events["source"], events["receiver"], strict=True))
    start, stop = (np.searchsorted(model.event, np.arange(n), side=s) for s in ("left", "right"))
    # state of each way, and shares of all ways
    ways: dict[tuple[str, str], _Way] = {}
    shares, parts = _Shares(), []
    log_likelihood, modelled = np.full(n, np.nan), np.ones(n)
    order = np.argsort(time, kind="stable")
    alone = 0.5  # probability that the candidates alone predict
    floor = CLUTTER / CLUTTER_WIDTH
    for event in order.tolist():
        # prediction by the candidates alone
        rows = slice(start[event], stop[event])
        way = ways.setdefault(names[event], _Way())
        fits = (1.0 - CLUTTER) * float(model.density(rows, measured[event]).sum())
        has_model = rows.stop > rows.start
        if has_model:
            log_likelihood[event] = np.log(fits + floor)
        # prediction with followed arrivals, which teaches the shares
        if way.short:
            weight, share, modelled[event] = shares.at(time[event] - way.time, way.explained)
            if not has_model:
                share, modelled[event] = share / share.sum(), 0.0
            part, kind = _components(way, event, distance[event], share)
            explained = np.zeros((3, _SCALES.size))
            density = (1.0 - CLUTTER) * part.density(slice(None), measured[event])
            np.add.at(explained.reshape(-1), kind, density)
            total = explained.sum() + modelled[event] * fits + floor
            shares.learn(weight, explained / total, modelled[event] * fits / total)
            # average of both predictions
            without = alone if has_model else 0.0
            modelled[event] = without + (1.0 - without) * modelled[event]
            parts.append(part._replace(probability=(1.0 - without) * part.probability))
            if has_model:
                log_likelihood[event], alone = average_models(
                    np.log(total), log_likelihood[event], alone
                )
            else:
                log_likelihood[event] = np.log(total)
        # the way learns the arrival
        way.learn(time[event], measured[event] / distance[event], distance[event])
        way.explained = fits / (fits + floor)
    scaled = model.scaled(modelled)
    return Followed(Components.joined([scaled, *parts]), _arrivals(parts), log_likelihood, modelled)


def _wider(share: Array) -> Array:
    """Shares of which half have errors that are one scale larger."""
    wider = 0.5 * share
    wider[..., 1:] += 0.5 * share[..., :-1]
    wider[..., -1] += 0.5 * share[..., -1]
    return wider


def _components(way: _Way, event: int, distance: float, share: Array) -> tuple[Components, Indices]:
    """Predictions of a way, and for each the number of its kind and scale."""
    others = np.delete(np.array(way.count), way.last)
    places = [way.short[way.last], way.long[way.last], *np.delete(np.array(way.long), way.last)]
    kind = np.array([_SHORT, _LONG] + [_OTHER] * others.size)
    part = np.array([1.0, 1.0, *(others / max(others.sum(), 1.0))])
    if not others.size:  # a mean of one arrival
        share = np.stack([share[_SHORT], share[_LONG] + share[_OTHER], 0.0 * share[_OTHER]])
    probability = part[:, None] * share[kind]
    size = probability.shape
    numbers = kind[:, None] * _SCALES.size + np.arange(_SCALES.size)
    return Components(
        np.full(probability.size, event),
        np.repeat(np.array(places) * distance, size[1]),
        np.tile(_SCALES, size[0]),
        probability.ravel(),
    ), numbers.ravel()


def _arrivals(parts: Sequence[Components]) -> pd.DataFrame:
    """One row for each place of some predictions."""
    if not parts:
        return pd.DataFrame(columns=["event", "travel_time_s", "sigma_s", "probability"])
    every = Components.joined(parts)
    table = pd.DataFrame(every._asdict()).rename(columns={"time": "travel_time_s"})
    table["power"] = table["probability"] * table["sigma"] ** 2
    sums = table.groupby(["event", "travel_time_s"])[["power", "probability"]].sum().reset_index()
    sums["sigma_s"] = np.sqrt(sums["power"] / sums["probability"].clip(lower=1e-300))
    return sums[["event", "travel_time_s", "sigma_s", "probability"]]
