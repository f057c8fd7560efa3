"""One ping: arrival times at all receivers, by the same steps as the ranges of a study."""

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, NamedTuple

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.arrays import Array
from pymantaray.records import Arrivals, RayStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.sensing import Receptions, TwoWay, find_receptions
from pymantaray.sensing.exchanges import exchange_times, exchange_values, selected_exchanges
from pymantaray.sensing.water import Water

_INSTANTS = 4  # number of waters in memory; that of a basin takes 15 MB


class Participants(NamedTuple):
    """Positions and velocities of the participants of a ping, in the local frame."""

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
    Outcome of a ping, one row per receiver; without noise, NaN without an arrival.

    Attributes
    ----------
    arrivals : Arrivals
        All eigenrays to the receivers; ``link`` is the receiver's row. Their travel times are those
        in water at rest.
    receptions : Receptions
        All receptions of the ping, and of the answers in the other direction; ``link`` is the
        receiver's row. Their travel times include the current.
    """

    kind: ClassVar[str] = "ping"

    arrivals: Arrivals
    receptions: Receptions
    status: Column = column("receiver", "1", "outcome of the ping", "i1", flags=RayStatus)
    travel_time: Column = column(
        "receiver", "s", "travel time of the selected arrival, two-way half of the round trip"
    )
    arrival_time: Column = column(
        "receiver",
        "s",
        "time at which the receiver detects the ping, two-way the source the answer",
    )
    refracted_range: Column = column(
        "receiver", "m", "travel time times the sound speed at the source"
    )
    straight_range: Column = column("receiver", "m", "distance between both ends at the ping")
    source_sound_speed: Column = column("receiver", "m s-1", "sound speed at the source")
    chord_travel_time: Column = column("receiver", "s", "travel time along the straight chord")
    level_db: Column = column(
        "receiver", "1", "received level in the band, in dB re 1 uPa, of the selected arrival"
    )
    probability: Column = column(
        "receiver", "1", "probability of detection, two-way of the ping and the answer"
    )


class Pinger:
    """
    Pings through one water, in one process and by any number of threads.

    If the ocean varies, the water of a ping is that of the last whole multiple of an interval; with
    0 that of its own time. [s]
    """

    def __init__(self, water: Water, interval: float = 0.0) -> None:
        self._water = water
        self._interval = interval
        self._at = lru_cache(_INSTANTS)(water.at)
        self(self.down_the_deepest())  # compiles the kernels

    def __call__(self, participants: Participants) -> Ping:
        """Return the outcome of a ping."""
        water = self._water
        receivers = participants.receivers
        n = len(receivers)
        source, velocity = (
            np.repeat(x[None], n, axis=0)
            for x in (participants.source, participants.source_velocity)
        )
        medium, currents = self._at(self._instant(participants.time))
        sound = find_receptions(source, receivers, medium, water.reception, currents=currents)
        exchanges = selected_exchanges(
            sound.receptions, n, np.arange(n), np.zeros(n, dtype=np.int64)
        )
        time = exchange_times(
            sound.receptions, exchanges, water.timing, (velocity, participants.receiver_velocities)
        )
        arrival_time = participants.time + time
        if isinstance(water.timing, TwoWay):
            arrival_time = participants.time + 2.0 * time + water.timing.turn_around
        level = probability = np.full(n, np.nan)
        if water.reception.detector is not None:
            level = water.reception.detector.sonar.source_level_db - sound.selected("loss_db")[0]
            chances = exchange_values(sound.receptions.probability, exchanges, water.timing)
            probability = np.prod(chances, axis=0)
        speed = sound.arrivals.source_sound_speed
        return Ping(
            status=sound.status,
            travel_time=time,
            arrival_time=arrival_time,
            refracted_range=speed * time,
            straight_range=medium.straight_distance(source, receivers),
            source_sound_speed=speed,
            chord_travel_time=sound.arrivals.chord_travel_time,
            level_db=level,
            probability=probability,
            arrivals=sound.arrivals,
            receptions=sound.receptions,
        )

    def _instant(self, time: float) -> float:
        """Time of the water of a ping; always 0 if the water does not vary."""
        if not self._water.varies:
            return 0.0
        self._water.require(time)
        return max(time - time % self._interval, self._water.span[0]) if self._interval else time

    def down_the_deepest(self) -> Participants:
        """Participants of a ping straight down in the deepest water, which always arrives."""
        time = max(self._water.span[0], 0.0)
        medium, _ = self._at(self._instant(time))
        ends = _deepest(medium)
        return Participants(time, ends[0], ends[1:], np.zeros((1, 3)), np.zeros(3))


def _deepest(medium: Medium) -> Array:
    """Two positions (2, 3), one above the other, in the deepest water. [m]"""
    row, col = np.unravel_index(np.argmax(medium.bed.depth), medium.bed.depth.shape)
    north, east = (
        np.clip(bed[k], axis[0], axis[-1]) if axis.size > 1 else 0.0
        for bed, k, axis in (
            (medium.bed.north, row, medium.north),
            (medium.bed.east, col, medium.east),
        )
    )
    top = medium.surface_depth((north, east))[0]
    bed = medium.bottom_depth((north, east))[0]
    return np.array([[north, east, top + share * (bed - top)] for share in (0.25, 0.75)])
