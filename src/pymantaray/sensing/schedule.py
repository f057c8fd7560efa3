"""Who pings when: ping epochs and the range attempts of each."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.geometry.checks import check_fields, check_number, checked_array
from pymantaray.records import Measurements

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Attempts(NamedTuple):
    """Range attempts by epoch, transmitter and receiver; landmarks count on after the vehicles."""

    sample: Indices
    transmitter: Indices
    receiver: Indices


class Schedule(ABC):
    """Who pings when and who listens: the one thing that range attempts come from."""

    @abstractmethod
    def times(self, duration: float) -> Array:
        """When somebody pings in a mission that lasts so long, rising, each time once. [s]"""

    @abstractmethod
    def at(self, pings: Indices, vehicles: Sequence[str], landmarks: Sequence[str]) -> Attempts:
        """Attempts of pings by the samples at which they are, one for each of `times`."""

    def check_names(self, vehicles: Sequence[str], landmarks: Sequence[str]) -> None:
        """Refuse names that are none of a vehicle or a landmark."""
        for name in self.names():
            _number(str(self), name, [*vehicles, *landmarks])

    def names(self) -> Iterable[str]:
        """Who is named; at an interval nobody is."""
        return ()

    def samples(self, time: Array) -> Indices:
        """Sample index of each of `times`, for increasing sample times from 0. [s]"""
        epochs = self.times(float(time[-1]))
        if not epochs.size:
            raise SensingError(
                f"{self}, the mission lasts {time[-1]:g} s; at least one ping must fit: ping earlier or lengthen the mission"
            )
        right = np.clip(np.searchsorted(time, epochs), 1, time.size - 1)
        nearest = np.where(epochs - time[right - 1] < time[right] - epochs, right - 1, right)
        off = np.abs(time[nearest] - epochs)
        if (off > 1e-6).any():
            epoch = epochs[np.argmax(off > 1e-6)]
            raise SensingError(
                f"{self}: the ping at {epoch:g} s is no sample time; samples are every {time[1] - time[0]:g} s: make the"
                " pings whole numbers of sampling periods, or give the truth samples there"
            )
        return nearest.astype(np.int64)

    def attempts(self, time: Array, vehicles: Sequence[str], landmarks: Sequence[str]) -> Attempts:
        """Range attempts of a fleet sampled at times [s], by sample, transmitter, receiver, each once."""
        table = self.at(self.samples(time), vehicles, landmarks)
        return Attempts(*np.unique(np.stack(table, axis=-1), axis=0).T)


@dataclass(frozen=True)
class PingSchedule(Schedule):
    """All vehicles ping at every whole multiple of an interval [s], the first time after one interval."""

    interval: float

    def __post_init__(self) -> None:
        """Check the interval."""
        check_fields(SensingError, self, "s", "interval", positive=True)

    def __str__(self) -> str:
        """Say it in refusals."""
        return f"PingSchedule: interval is {self.interval:g} s"

    def times(self, duration: float) -> Array:
        """Whole multiples of the interval."""
        count = math.floor(duration / self.interval * (1.0 + 1e-12))
        return np.asarray(self.interval * np.arange(1, count + 1))

    def at(self, pings: Indices, vehicles: Sequence[str], landmarks: Sequence[str]) -> Attempts:
        """All pairs, both ways, and every landmark."""
        return attempts(len(vehicles), len(landmarks), pings)


@dataclass(frozen=True)
class SlotSchedule(Schedule):
    """
    One pings in each slot, and they begin anew after the last (TDMA); all others listen.

    ``slots`` are names of vehicles and of landmarks that transmit, in their order; a name may come twice. A slot lasts ``slot``
    seconds, and its ping is when it begins; the first begins ``start`` seconds after the mission.
    """

    slots: tuple[str, ...]
    slot: float
    start: float = 0.0

    def __post_init__(self) -> None:
        """Check lengths and names."""
        check_fields(SensingError, self, "s", "slot", positive=True)
        check_fields(SensingError, self, "s", "start")
        if not self.slots:
            raise SensingError("SlotSchedule: there are no slots; name at least one vehicle or landmark")

    def __str__(self) -> str:
        """Say it in refusals."""
        return f"SlotSchedule: slots of {self.slot:g} s from {self.start:g} s on"

    def names(self) -> Iterable[str]:
        """Who has a slot."""
        return dict.fromkeys(self.slots)

    def times(self, duration: float) -> Array:
        """Beginnings of the slots."""
        count = math.floor((duration - self.start) / self.slot * (1.0 + 1e-12)) + 1
        return np.asarray(self.start + self.slot * np.arange(max(count, 0)))

    def at(self, pings: Indices, vehicles: Sequence[str], landmarks: Sequence[str]) -> Attempts:
        """From who has each slot to all others."""
        turns = np.array([_number(str(self), name, [*vehicles, *landmarks]) for name in self.slots])
        return _to_all(pings, turns[np.arange(pings.size) % turns.size], len(vehicles), len(landmarks))


@dataclass(frozen=True, eq=False)
class PingList(Schedule):
    """
    Pings one by one: when [s], who, and who listens; `read_pings` makes it of a table.

    Both are vehicles or landmarks, at most one of them a landmark; no listener means everybody. Pings after the mission's end are
    left out.
    """

    time: tuple[float, ...]
    transmitter: tuple[str, ...]
    receivers: tuple[tuple[str, ...], ...] = ()
    """By ping; none at all: everybody listens to every ping."""

    def __post_init__(self) -> None:
        """Check lengths and times."""
        checked_array(SensingError, "PingList: time", self.time, (None,))
        if min(self.time) < 0.0:
            raise SensingError(
                f"PingList: a ping is at {min(self.time):g} s; the mission begins at 0: leave it out"
            )
        for name in ("transmitter", "receivers"):
            size = len(getattr(self, name))
            if size != len(self.time) and (size or name == "transmitter"):
                raise SensingError(f"PingList: {size} {name} of {len(self.time)} pings; give one for each")

    def __str__(self) -> str:
        """Say it in refusals."""
        return f"PingList: the first of {len(self.time)} pings is at {min(self.time):g} s"

    def names(self) -> Iterable[str]:
        """Who pings, and who listens."""
        return dict.fromkeys(chain(self.transmitter, *self.receivers))

    def times(self, duration: float) -> Array:
        """Times of the pings."""
        times = np.unique(np.asarray(self.time, dtype=float))
        return times[times <= duration * (1.0 + 1e-12)]

    def at(self, pings: Indices, vehicles: Sequence[str], landmarks: Sequence[str]) -> Attempts:
        """From each transmitter to those that listen."""
        row = np.searchsorted(np.unique(np.asarray(self.time, dtype=float)), self.time)
        inside = np.flatnonzero(row < pings.size)
        names, n = [*vehicles, *landmarks], len(vehicles)
        who = np.array([_number(str(self), self.transmitter[i], names) for i in inside], dtype=np.int64)
        if not self.receivers:
            return _to_all(pings[row[inside]], who, n, len(landmarks))
        rows: list[tuple[int, int, int]] = []
        for i, transmitter in zip(inside, who.tolist(), strict=True):
            heard = [_number(str(self), name, names) for name in self.receivers[i]]
            if transmitter in heard:
                raise SensingError(
                    f"{self}: {names[transmitter]} listens to itself; leave it out of its receivers"
                )
            fixed = [k for k in heard if min(k, transmitter) >= n]
            if fixed:
                raise SensingError(
                    f"{self}: {names[fixed[0]]} listens to {names[transmitter]}, both landmarks; one has to be a vehicle"
                )
            everybody = range(len(names) if transmitter < n else n)
            rows += [(pings[row[i]], transmitter, k) for k in heard or everybody if k != transmitter]
        return Attempts(*np.array(rows, dtype=np.int64).reshape(-1, 3).T)


def attempts(n_vehicles: int, n_landmarks: int, epochs: Indices) -> Attempts:
    """At every epoch each vehicle transmits to every other vehicle and to every landmark; by epoch, transmitter, receiver."""
    epochs = np.asarray(epochs, dtype=np.int64)
    senders = np.tile(np.arange(n_vehicles), epochs.size)
    return _to_all(np.repeat(epochs, n_vehicles), senders, n_vehicles, n_landmarks)


def _to_all(samples: Indices, transmitter: Indices, n_vehicles: int, n_landmarks: int) -> Attempts:
    """One ping a row, to all participants but the one that sends it; from landmarks to vehicles alone."""
    n = n_vehicles + n_landmarks
    receiver = np.tile(np.arange(n), samples.size)
    sample, sender = np.repeat(samples, n), np.repeat(transmitter, n)
    other = (receiver != sender) & (np.minimum(receiver, sender) < n_vehicles)
    return Attempts(sample[other], sender[other], receiver[other])


def _number(schedule: str, name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise SensingError(
            f"{schedule}: there is no vehicle and no landmark {name!r}; there is {', '.join(names)}"
        )
    return list(names).index(name)


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
