"""Who pings when: ping epochs and the range attempts of each."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.geometry.checks import check_fields, check_number
from pymantaray.records import Measurements

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Attempts(NamedTuple):
    """Range attempts by epoch, transmitter and receiver; landmarks count on after the vehicles."""

    sample: Indices
    transmitter: Indices
    receiver: Indices


@dataclass(frozen=True)
class PingSchedule:
    """All vehicles ping at every whole multiple of an interval [s], the first time after one interval."""

    interval: float

    def __post_init__(self) -> None:
        """Check the interval."""
        check_fields(SensingError, self, "s", "interval", positive=True)

    def samples(self, time: NDArray[np.float64]) -> Indices:
        """Sample index of each epoch, for increasing sample times from 0. [s]"""
        count = math.floor(float(time[-1]) / self.interval * (1.0 + 1e-12))
        if count < 1:
            raise SensingError(
                f"PingSchedule: interval is {self.interval:g} s, the mission lasts {time[-1]:g} s; at least one"
                " ping must fit: shorten the interval or lengthen the mission"
            )
        epochs = self.interval * np.arange(1, count + 1)
        right = np.clip(np.searchsorted(time, epochs), 1, time.size - 1)
        nearest = np.where(epochs - time[right - 1] < time[right] - epochs, right - 1, right)
        off = np.abs(time[nearest] - epochs)
        if (off > 1e-6).any():
            epoch = epochs[np.argmax(off > 1e-6)]
            raise SensingError(
                f"PingSchedule: the epoch at {epoch:g} s is no sample time; with interval {self.interval:g} s"
                f" and samples every {time[1] - time[0]:g} s it must be one: make the interval a whole number"
                " of sampling periods"
            )
        return nearest.astype(np.int64)


def attempts(n_agents: int, n_landmarks: int, epochs: Indices) -> Attempts:
    """At every epoch each vehicle transmits to every other vehicle and to every landmark; by epoch, transmitter, receiver."""
    transmitter, receiver = np.divmod(
        np.arange(n_agents * (n_agents + n_landmarks)), max(n_agents + n_landmarks, 1)
    )
    other = transmitter != receiver
    transmitter, receiver = transmitter[other], receiver[other]
    return Attempts(
        sample=np.repeat(np.asarray(epochs, dtype=np.int64), transmitter.size),
        transmitter=np.tile(transmitter, len(epochs)),
        receiver=np.tile(receiver, len(epochs)),
    )


def by_pair(measurements: Measurements, draw: Callable[[str, str, int], Array]) -> Array:
    """One number a range attempt, drawn for each transmitter and receiver and the number of their attempts."""
    m = measurements
    names = [str(name) for name in (*m.name, *m.landmark_name)]
    pair = m.range_transmitter.astype(np.int64) * len(names) + m.range_receiver
    order = np.argsort(pair, kind="stable")
    keys, first = np.unique(pair[order], return_index=True)
    drawn = np.empty(pair.size)
    for key, rows in zip(keys, np.split(order, first[1:]), strict=False):
        transmitter, receiver = divmod(int(key), len(names))
        drawn[rows] = draw(names[transmitter], names[receiver], rows.size)
    return drawn


def chances(
    measurements: Measurements, *, root_seed: int, realization: int, correlation_time: float = 0.0
) -> Array:
    r"""
    Uniform draws that decide what becomes of each attempt, arrival or not; each ordered pair has its own stream.

    With a correlation time :math:`\tau` [s] an attempt has the number of the one before it of the same ordered pair, a time
    :math:`\Delta` ago, with probability :math:`e^{-\Delta / \tau}`, else a new one: a Markov chain of which every number is
    uniform.
    """
    check_number(SensingError, "correlation_time", correlation_time, "s")

    def uniform(use: str) -> Array:
        return by_pair(
            measurements,
            lambda transmitter, receiver, n: stream(
                root_seed, realization, "sensing", transmitter, use, receiver
            ).random(n),
        )

    fresh = uniform("heard")
    if correlation_time == 0.0:
        return fresh
    m = measurements
    time = m.time[m.range_sample]
    order = np.lexsort((time, m.range_receiver, m.range_transmitter))
    pair = np.stack([m.range_transmitter, m.range_receiver])[:, order]
    again = np.all(pair[:, 1:] == pair[:, :-1], axis=0)
    stays = uniform("stays")[order][1:] < np.exp(
        -np.diff(time[order]) / correlation_time, where=again, out=np.zeros(again.size)
    )
    origin = np.arange(order.size)
    origin[1:][again & stays] = 0
    drawn = np.empty(order.size)
    drawn[order] = fresh[order][np.maximum.accumulate(origin)]
    return drawn
