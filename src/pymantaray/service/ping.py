"""One ping: who hears what when, by the same rays, rules and losses as the ranges of a study."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import Medium
from pymantaray.acoustics.selection import choose_arrivals
from pymantaray.records import Arrivals, RayStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.sensing import Sound, TwoWay, sound_between
from pymantaray.sensing.timing import Leg, half_round_trip
from pymantaray.water import Water

Array = NDArray[np.float64]
_INSTANTS = 4  # whose water stays in memory; that of a basin takes 15 MB


class Ends(NamedTuple):
    """Who takes part in a ping, where and how fast, in the local frame."""

    time: float
    source: Array
    """Shape (3,). [m]"""
    receivers: Array
    """Shape (n, 3). [m]"""
    receiver_velocities: Array
    """Shape (n, 3). [m/s]"""
    source_velocity: Array
    """Shape (3,). [m/s]"""


@dataclass(frozen=True, eq=False)
class Ping(Record):
    """
    What becomes of a ping at each of its receivers, a row each; without noise, NaN where there is none.

    Attributes
    ----------
    arrivals : Arrivals
        All that reaches the receivers; ``link`` is the receiver's row. Their travel times are those in water at rest.
    delay : ndarray, shape (n_arrivals,), or None
        What the current adds to each travel time; None where the water is at rest. [s]
    loss_db : ndarray, shape (n_arrivals,), or None
        Transmission loss of each; None without a sonar. [dB]
    """

    kind: ClassVar[str] = "ping"

    arrivals: Arrivals
    delay: Array | None
    loss_db: Array | None
    status: Column = column("receiver", "1", "what becomes of the ping", "i1", flags=RayStatus)
    travel_time: Column = column(
        "receiver", "s", "travel time of the arrival ranged on, two-way half of the round trip"
    )
    arrival_time: Column = column(
        "receiver", "s", "when the receiver hears the ping, two-way the source the answer"
    )
    refracted_range: Column = column("receiver", "m", "travel time times the sound speed at the source")
    straight_range: Column = column("receiver", "m", "distance of the ends at the ping")
    source_sound_speed: Column = column("receiver", "m s-1", "sound speed at the source")
    chord_travel_time: Column = column("receiver", "s", "travel time along the straight chord")
    level_db: Column = column(
        "receiver", "1", "received level in the band, in dB re 1 uPa, of what the receiver ranges on"
    )
    probability: Column = column("receiver", "1", "that it is heard, two-way the ping and the answer")


class Pinger:
    """
    Pings through one water, in one process and by any number of threads.

    Where the ocean varies, its water is that of the last whole multiple of an interval; with 0 that of each ping. [s]
    """

    def __init__(self, water: Water, interval: float = 0.0) -> None:
        self._water, self._interval = water, interval
        self._at = lru_cache(_INSTANTS)(water.at)
        self(self.down_the_deepest())  # what compiles does so now

    def __call__(self, ends: Ends) -> Ping:
        """What becomes of a ping."""
        water, source = self._water, np.broadcast_to(ends.source, ends.receivers.shape)
        medium, currents = self._at(self._instant(ends.time))
        sound = sound_between(source, ends.receivers, medium, water.reception, currents=currents)
        there, time = sound.there, sound.there.travel_time
        arrival_time = ends.time + time
        if isinstance(water.timing, TwoWay):
            ways = np.stack([there.travel_time, sound.back.travel_time])
            ping, answer = (
                Leg(t, gradient[:, 0], gradient[:, 1])
                for t, gradient in zip(ways, np.moveaxis(sound.gradient, 1, 0), strict=True)
            )
            velocity = np.broadcast_to(ends.source_velocity, source.shape)
            time = half_round_trip(water.timing, ping, answer, velocity, ends.receiver_velocities)
            arrival_time = ends.time + 2.0 * time + water.timing.turn_around
        return Ping(
            status=there.status,
            travel_time=time,
            arrival_time=arrival_time,
            refracted_range=there.source_sound_speed * time,
            straight_range=np.linalg.norm(ends.receivers - source, axis=-1),
            source_sound_speed=there.source_sound_speed,
            chord_travel_time=there.chord_travel_time,
            level_db=self._level(sound),
            probability=self._probability(sound),
            arrivals=sound.arrivals,
            delay=sound.delay,
            loss_db=sound.loss_db,
        )

    def _instant(self, time: float) -> float:
        """Time of the water that a ping runs through; that of one that stands still is the same at all times."""
        if not self._water.varies:
            return 0.0
        self._water.require(time)
        return max(time - time % self._interval, self._water.span[0]) if self._interval else time

    def _level(self, sound: Sound) -> Array:
        """Received level of what each receiver ranges on, an arrival or what leaks to it. [dB]"""
        reception, n = self._water.reception, sound.there.status.size
        if reception.detector is None or sound.loss_db is None:
            return np.full(n, np.nan)
        loss = np.full(n, np.nan) if sound.leak_loss_db is None else sound.leak_loss_db.copy()
        link, row = choose_arrivals(
            sound.arrivals, reception.arrival, loss_db=sound.loss_db, delay=sound.delay
        )
        loss[link] = sound.loss_db[row]
        return np.asarray(reception.detector.sonar.source_level_db - loss)

    def _probability(self, sound: Sound) -> Array:
        if sound.probability is None:
            return np.full(sound.there.status.size, np.nan)
        both = isinstance(self._water.timing, TwoWay)
        return np.asarray(sound.probability.prod(axis=-1) if both else sound.probability[:, 0])

    def down_the_deepest(self) -> Ends:
        """Who pings straight down in the deepest place, where sound surely goes."""
        time = max(self._water.span[0], 0.0)
        medium, _ = self._at(self._instant(time))
        ends = _deepest(medium)
        return Ends(time, ends[0], ends[1:], np.zeros((1, 3)), np.zeros(3))


def _deepest(medium: Medium) -> Array:
    """Two places (2, 3), one above the other, in the deepest water. [m]"""
    row, col = np.unravel_index(np.argmax(medium.bed.depth), medium.bed.depth.shape)
    north, east = (
        np.clip(bed[k], axis[0], axis[-1]) if axis.size > 1 else 0.0
        for bed, k, axis in ((medium.bed.north, row, medium.north), (medium.bed.east, col, medium.east))
    )
    top, bed = medium.surface_depth((north, east))[0], medium.bottom_depth((north, east))[0]
    return np.array([[north, east, top + share * (bed - top)] for share in (0.25, 0.75)])
