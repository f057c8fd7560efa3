"""What was true of every range attempt, which no estimator is given."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pymantaray.records.base import Column, Record, column


@dataclass(frozen=True, eq=False)
class RangingTruth(Record):
    """
    True distance and travel times of all range attempts, row by row those of a `Measurements` record.

    NaN where there is none: no travel time without an admitted arrival; no chord and no sound speed where an end
    lies outside the water. Two-way, ``travel_time`` is half the round trip, less half the turn-around time. Where ``near_cutoff``
    is 1, a cut-off of the rays' spreading 1 dB higher or lower would take another arrival, or none: there travel times jump.
    """

    kind: ClassVar[str] = "ranging_truth"

    distance: Column = column("range", "m", "straight distance")
    sound_speed: Column = column("range", "m s-1", "sound speed at the transmitter")
    travel_time: Column = column("range", "s", "travel time of the admitted arrival, current included")
    chord_travel_time: Column = column("range", "s", "travel time along the straight chord in water at rest")
    near_cutoff: Column = column(
        "range",
        "1",
        "1 where 1 dB of the cut-off decides which arrival is ranged on, else 0",
        "i1",
        default=0,
    )

    @property
    def refracted_range(self) -> NDArray[np.float64]:
        """Sound speed at the transmitter times travel time. [m]"""
        return np.asarray(self.sound_speed * self.travel_time)
