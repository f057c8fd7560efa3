"""Ping schedules: times of pings and the range attempts of each."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices
from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.quantities.checks import check_fields, check_number, checked_array
from pymantaray.records import Measurements


class Attempts(NamedTuple):
    """
    Range attempts by epoch, transmitter and receiver.

    The numbers of landmarks follow those of vehicles.
    """

    sample: Indices
    transmitter: Indices
    receiver: Indices


class Schedule(ABC):
    """Times, transmitters and receivers of pings; the only source of range attempts."""

    @abstractmethod
    def times(self, duration: float) -> Array:
        """
        Times of pings in a mission.

        Parameters
        ----------
        duration : float
            Duration of the mission. [s]

        Returns
        -------
        ndarray, shape (n_pings,)
            Distinct times in ascending order. [s]
        """

    @abstractmethod
    def at(self, pings: Indices, vehicles: Sequence[str], landmarks: Sequence[str]) -> Attempts:
        """
        Range attempts of pings.

        Parameters
        ----------
        pings : ndarray of int, shape (n_pings,)
            Sample of each of `times`.
        vehicles : sequence of str
            Names of the vehicles.
        landmarks : sequence of str
            Names of the landmarks.

        Returns
        -------
        Attempts
            Samples, transmitters and receivers.
        """

    def check_names(self, vehicles: Sequence[str], landmarks: Sequence[str]) -> None:
        """
        Raise an error for names that are not those of a vehicle or landmark.

        Parameters
        ----------
        vehicles : sequence of str
            Names of the vehicles.
        landmarks : sequence of str
            Names of the landmarks.
        """
        for name in self.names():
            _number(str(self), name, [*vehicles, *landmarks])

    def names(self) -> Iterable[str]:
        """Names in the schedule; an interval has none."""
        return ()

    def samples(self, time: Array) -> Indices:
        """
        Sample index of each of `times`.

        Parameters
        ----------
        time : ndarray, shape (n_samples,)
            Increasing sample times from 0. [s]

        Returns
        -------
        ndarray of int, shape (n_pings,)
        """
        epochs = self.times(float(time[-1]))
        if not epochs.size:
            raise SensingError(
                f"{self}, the mission lasts {time[-1]:g} s; at least one ping must fit: ping"
                " earlier or lengthen the mission"
            )
        right = np.clip(np.searchsorted(time, epochs), 1, time.size - 1)
        nearest = np.where(epochs - time[right - 1] < time[right] - epochs, right - 1, right)
        deviation = np.abs(time[nearest] - epochs)
        if (deviation > 1e-6).any():
            epoch = epochs[np.argmax(deviation > 1e-6)]
            raise SensingError(
                f"{self}: the ping at {epoch:g} s is not at a sample time; samples are every"
                f" {time[1] - time[0]:g} s: ping at multiples of the sampling period, or add"
                " samples to the truth at the pings"
            )
        return nearest.astype(np.int64)

    def attempts(self, time: Array, vehicles: Sequence[str], landmarks: Sequence[str]) -> Attempts:
        """
        Range attempts of a fleet, sorted by sample, transmitter and receiver, without duplicates.

        Parameters
        ----------
        time : ndarray, shape (n_samples,)
            Sample times. [s]
        vehicles : sequence of str
            Names of the vehicles.
        landmarks : sequence of str
            Names of the landmarks.

        Returns
        -------
        Attempts
            Samples, transmitters and receivers.
        """
        table = self.at(self.samples(time), vehicles, landmarks)
        return Attempts(*np.unique(np.stack(table, axis=-1), axis=0).T)


@dataclass(frozen=True)
class PingSchedule(Schedule):
    """
    Schedule in which all vehicles ping at an interval.

    Parameters
    ----------
    interval : float
        Time between pings. [s]
    start : float, optional
        Time of the first ping. Default: one interval after the start of the mission. [s]

    Examples
    --------
    >>> from pymantaray.sensing import PingSchedule
    >>> print(PingSchedule(interval=600.0).times(duration=1800.0))
    [ 600. 1200. 1800.]
    """

    interval: float
    start: float | None = None

    def __post_init__(self) -> None:
        """Check interval and start."""
        check_fields(SensingError, self, "s", "interval", positive=True)
        if self.start is not None:
            check_fields(SensingError, self, "s", "start")

    def __str__(self) -> str:
        """Return the schedule as error messages name it."""
        return f"PingSchedule: interval is {self.interval:g} s"

    def times(self, duration: float) -> Array:
        """
        Times of the start and of whole intervals after it, or of whole intervals after 0.

        Parameters are those of `Schedule.times`.
        """
        first, start = (1, 0.0) if self.start is None else (0, self.start)
        count = math.floor((duration - start) / self.interval * (1.0 + 1e-12))
        return np.asarray(start + self.interval * np.arange(first, count + 1))

    def at(self, pings: Indices, vehicles: Sequence[str], landmarks: Sequence[str]) -> Attempts:
        """
        Range attempts between all vehicles in both directions, and from these to all landmarks.

        Parameters are those of `Schedule.at`.
        """
        return attempts(len(vehicles), len(landmarks), pings)


@dataclass(frozen=True)
class SlotSchedule(Schedule):
    """
    Schedule in which one participant pings in each slot and all others listen; slots repeat (TDMA).

    Parameters
    ----------
    slots : sequence of str
        Names of the transmitting vehicles and landmarks in order; a name may occur twice.
    slot : float
        Length of a slot, whose ping is at its start. [s]
    start : float
        Start of the first slot, from the start of the mission. [s]

    Examples
    --------
    >>> from pymantaray.sensing import SlotSchedule
    >>> schedule = SlotSchedule(("A", "B", "L"), slot=20.0)
    >>> schedule.times(duration=90.0)
    array([ 0., 20., 40., 60., 80.])
    """

    slots: tuple[str, ...]
    slot: float
    start: float = 0.0

    def __post_init__(self) -> None:
        """Check lengths and names."""
        check_fields(SensingError, self, "s", "slot", positive=True)
        check_fields(SensingError, self, "s", "start")
        if not self.slots:
            raise SensingError(
                "SlotSchedule: there are no slots; name at least one vehicle or landmark"
            )

    def __str__(self) -> str:
        """Return the schedule as error messages name it."""
        return f"SlotSchedule: slots of {self.slot:g} s from {self.start:g} s on"

    def names(self) -> Iterable[str]:
        """Names of those with a slot."""
        return dict.fromkeys(self.slots)

    def times(self, duration: float) -> Array:
        """Starts of the slots; parameters as in `Schedule.times`."""
        count = math.floor((duration - self.start) / self.slot * (1.0 + 1e-12)) + 1
        return np.asarray(self.start + self.slot * np.arange(max(count, 0)))

    def at(self, pings: Indices, vehicles: Sequence[str], landmarks: Sequence[str]) -> Attempts:
        """
        Range attempts from the owner of each slot to all other participants.

        Parameters are those of `Schedule.at`.
        """
        owner = np.array([_number(str(self), name, [*vehicles, *landmarks]) for name in self.slots])
        return _to_all(
            pings, owner[np.arange(pings.size) % owner.size], len(vehicles), len(landmarks)
        )


@dataclass(frozen=True, eq=False)
class PingList(Schedule):
    """
    Schedule from a list of pings; `read_pings` reads it from a table.

    Parameters
    ----------
    time : sequence of float
        Time of each ping; pings after the end of the mission are omitted. [s]
    transmitter : sequence of str
        Vehicle or landmark that transmits each ping.
    receivers : sequence of sequence of str
        Vehicles or landmarks that listen to each ping; empty if all others listen. A landmark does
        not listen to a landmark.

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import PingList, measure_ranges
    >>> pings = PingList(time=(0.0, 600.0), transmitter=("A", "B"))
    >>> attempts = measure_ranges(truth, [], medium, pings).attempts
    >>> attempts.transmitter.tolist(), attempts.receiver.tolist()
    ([0, 1], [1, 0])
    """

    time: tuple[float, ...]
    transmitter: tuple[str, ...]
    receivers: tuple[tuple[str, ...], ...] = ()
    """Receivers of each ping; empty if everybody listens to every ping."""

    def __post_init__(self) -> None:
        """Check lengths and times."""
        checked_array(SensingError, "PingList: time", self.time, (None,))
        if min(self.time) < 0.0:
            raise SensingError(
                f"PingList: a ping is at {min(self.time):g} s; the mission starts at 0: remove the"
                " ping"
            )
        for name in ("transmitter", "receivers"):
            size = len(getattr(self, name))
            if size != len(self.time) and (size or name == "transmitter"):
                raise SensingError(
                    f"PingList: {size} {name} of {len(self.time)} pings; give one for each"
                )

    def __str__(self) -> str:
        """Return the schedule as error messages name it."""
        return f"PingList: the first of {len(self.time)} pings is at {min(self.time):g} s"

    def names(self) -> Iterable[str]:
        """Names of transmitters and receivers."""
        return dict.fromkeys(chain(self.transmitter, *self.receivers))

    def times(self, duration: float) -> Array:
        """Distinct times of the pings in the mission; parameters as in `Schedule.times`."""
        times = np.unique(np.asarray(self.time, dtype=float))
        return times[times <= duration * (1.0 + 1e-12)]

    def at(self, pings: Indices, vehicles: Sequence[str], landmarks: Sequence[str]) -> Attempts:
        """Range attempts from each transmitter to its receivers; parameters as in `Schedule.at`."""
        row = np.searchsorted(np.unique(np.asarray(self.time, dtype=float)), self.time)
        inside = np.flatnonzero(row < pings.size)
        names = [*vehicles, *landmarks]
        n = len(vehicles)
        transmitters = np.array(
            [_number(str(self), self.transmitter[i], names) for i in inside], dtype=np.int64
        )
        if not self.receivers:
            return _to_all(pings[row[inside]], transmitters, n, len(landmarks))
        rows: list[tuple[int, int, int]] = []
        for i, transmitter in zip(inside, transmitters.tolist(), strict=True):
            listeners = [_number(str(self), name, names) for name in self.receivers[i]]
            if transmitter in listeners:
                raise SensingError(
                    f"{self}: {names[transmitter]} listens to itself; remove it from its receivers"
                )
            landmarks_only = [k for k in listeners if min(k, transmitter) >= n]
            if landmarks_only:
                raise SensingError(
                    f"{self}: {names[landmarks_only[0]]} listens to {names[transmitter]}, both"
                    " landmarks; one has to be a vehicle"
                )
            everybody = range(len(names) if transmitter < n else n)
            rows += [
                (pings[row[i]], transmitter, k) for k in listeners or everybody if k != transmitter
            ]
        return Attempts(*np.array(rows, dtype=np.int64).reshape(-1, 3).T)


def attempts(n_vehicles: int, n_landmarks: int, epochs: Indices) -> Attempts:
    """
    Attempts of every vehicle to all others and to every landmark at every epoch.

    They are sorted by epoch, transmitter and receiver.
    """
    epochs = np.asarray(epochs, dtype=np.int64)
    senders = np.tile(np.arange(n_vehicles), epochs.size)
    return _to_all(np.repeat(epochs, n_vehicles), senders, n_vehicles, n_landmarks)


def _to_all(samples: Indices, transmitter: Indices, n_vehicles: int, n_landmarks: int) -> Attempts:
    """Attempts of one ping per row to all other participants; from landmarks to vehicles only."""
    n = n_vehicles + n_landmarks
    receiver = np.tile(np.arange(n), samples.size)
    sample = np.repeat(samples, n)
    sender = np.repeat(transmitter, n)
    other = (receiver != sender) & (np.minimum(receiver, sender) < n_vehicles)
    return Attempts(sample[other], sender[other], receiver[other])


def _number(schedule: str, name: str, names: Sequence[str]) -> int:
    if name not in names:
        raise SensingError(
            f"{schedule}: no vehicle or landmark is called {name!r}; allowed: {', '.join(names)}"
        )
    return list(names).index(name)


def by_pair(measurements: Measurements, draw: Callable[[str, str, int], Array]) -> Array:
    """
    One number per range attempt.

    ``draw`` gets each transmitter and receiver and the number of their attempts.
    """
    names = [str(name) for name in (*measurements.name, *measurements.landmark_name)]
    pair = (
        measurements.range_transmitter.astype(np.int64) * len(names) + measurements.range_receiver
    )
    order = np.argsort(pair, kind="stable")
    keys, first = np.unique(pair[order], return_index=True)
    values = np.empty(pair.size)
    for key, rows in zip(keys, np.split(order, first[1:]), strict=False):
        transmitter, receiver = divmod(int(key), len(names))
        values[rows] = draw(names[transmitter], names[receiver], rows.size)
    return values


def chances(
    measurements: Measurements, *, root_seed: int, realization: int, correlation_time: float = 0.0
) -> Array:
    r"""
    Uniform draws that determine the outcome of each attempt, with an arrival or not.

    Each ordered pair has its own stream.

    With a correlation time :math:`\tau` [s], an attempt has the number of the previous attempt of
    the same ordered pair, a time
    :math:`\Delta` before, with probability :math:`e^{-\Delta / \tau}`, else a new one: a Markov
    chain of uniform numbers.
    """
    check_number(SensingError, "correlation_time", correlation_time, "s")

    def uniform(use: str) -> Array:
        def draw(transmitter: str, receiver: str, count: int) -> Array:
            names = ("sensing", transmitter, use, receiver)
            return stream(root_seed, realization, *names).random(count)

        return by_pair(measurements, draw)

    new_values = uniform("heard")
    if correlation_time == 0.0:
        return new_values
    time = measurements.time[measurements.range_sample]
    order = np.lexsort((time, measurements.range_receiver, measurements.range_transmitter))
    pair = np.stack([measurements.range_transmitter, measurements.range_receiver])[:, order]
    same_pair = np.all(pair[:, 1:] == pair[:, :-1], axis=0)
    keeps = uniform("stays")[order][1:] < np.exp(
        -np.diff(time[order]) / correlation_time, where=same_pair, out=np.zeros(same_pair.size)
    )
    # row of the last new number before each attempt
    origin = np.arange(order.size)
    origin[1:][same_pair & keeps] = 0
    values = np.empty(order.size)
    values[order] = new_values[order][np.maximum.accumulate(origin)]
    return values
