"""True values of every range attempt; estimators have no access to them."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pymantaray.arrays import Array
from pymantaray.records.base import Column, Record, column


@dataclass(frozen=True, eq=False)
class RangingTruth(Record):
    """
    True distance and travel times of range attempts, row by row those of `Measurements`.

    A missing value is NaN: the travel time and the angles without an admitted arrival; the travel
    time along the chord and the sound speed if an end lies outside the water. Two-way,
    ``travel_time`` is half the round trip minus half the turn-around time, and the angles are those
    of the ping. If ``near_cutoff`` is 1, a cut-off of the rays' spreading 1 dB higher or lower
    selects another arrival, or none: there travel times jump.
    """

    kind: ClassVar[str] = "ranging_truth"

    distance: Column = column("range", "m", "straight distance")
    sound_speed: Column = column("range", "m s-1", "sound speed at the transmitter")
    travel_time: Column = column(
        "range", "s", "travel time of the admitted arrival, current included"
    )
    chord_travel_time: Column = column(
        "range", "s", "travel time along the straight chord in water at rest"
    )
    near_cutoff: Column = column(
        "range",
        "1",
        "1 where 1 dB of the cut-off decides which arrival is ranged on, else 0",
        "i1",
        default=0,
    )
    departure_angle: Column = column(
        "range",
        "rad",
        "angle from the horizontal at the transmitter, positive down",
        default=np.nan,
    )
    arrival_angle: Column = column(
        "range", "rad", "angle from the horizontal at the receiver, positive down", default=np.nan
    )

    @property
    def refracted_range(self) -> Array:
        """Sound speed at the transmitter times travel time. [m]"""
        return np.asarray(self.sound_speed * self.travel_time)
