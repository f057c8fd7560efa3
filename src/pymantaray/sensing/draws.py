"""Ranges without noise that differ between realizations: each has its own rough ice."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from pymantaray.arrays import Codes
from pymantaray.records import Measurements, RangingTruth, RayStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.sensing.ranging import Ranging

_TRUTH_COLUMNS = ("travel_time", "near_cutoff", "departure_angle", "arrival_angle")


@dataclass(frozen=True, eq=False)
class RangingDraws(Record):
    """
    Columns of all range attempts that depend on the ice, by realization.

    Attempts are row by row those of a `Measurements` record.

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import RangingDraws
    >>> print(RangingDraws.of([ranging, ranging]).travel_time.round(4))
    [[1.393 1.393]
     [1.393 1.393]]
    """

    kind: ClassVar[str] = "ranging_draws"

    range_status: Column = column(
        "realization range", "1", "outcome of the attempt", "i1", flags=RayStatus
    )
    travel_time: Column = column("realization range", "s", "travel time of the admitted arrival")
    near_cutoff: Column = column(
        "realization range",
        "1",
        "1 where 1 dB of the cut-off decides which arrival is ranged on, else 0",
        "i1",
    )
    departure_angle: Column = column(
        "realization range", "rad", "angle from the horizontal at the transmitter, positive down"
    )
    arrival_angle: Column = column(
        "realization range", "rad", "angle from the horizontal at the receiver, positive down"
    )
    probability: Column = column(
        "realization range",
        "1",
        "probability of detection, NaN where no arrival exists; 1 without a detector",
    )

    @classmethod
    def of(cls, rangings: Sequence[Ranging]) -> Self:
        """
        Join the ranges of all realizations.

        Parameters
        ----------
        rangings : sequence of Ranging
            One for each realization, in order.

        Returns
        -------
        RangingDraws
        """
        chances = [
            np.ones(ranging.status.size) if ranging.probability is None else ranging.probability
            for ranging in rangings
        ]
        truths = [ranging.truth for ranging in rangings]
        columns = {
            name: np.stack([getattr(truth, name) for truth in truths]) for name in _TRUTH_COLUMNS
        }
        return cls(
            range_status=np.stack([ranging.status for ranging in rangings]),
            probability=np.stack(chances),
            **columns,
        )

    def ranging_truth(self, truth: RangingTruth, realization: int) -> RangingTruth:
        """
        Return the true values of a realization.

        Parameters
        ----------
        truth : RangingTruth
            True values of any realization.
        realization : int
            Index of the realization.

        Returns
        -------
        RangingTruth
        """
        return replace(truth, **{name: getattr(self, name)[realization] for name in _TRUTH_COLUMNS})

    def measurements(
        self, measurements: Measurements, truth: RangingTruth, realization: int
    ) -> Measurements:
        """
        Return the measurements of a realization, without noise.

        Parameters
        ----------
        measurements : Measurements
            Measurements of any realization, without noise.
        truth : RangingTruth
            True values of any realization.
        realization : int
            Index of the realization.

        Returns
        -------
        Measurements
        """
        status: Codes = self.range_status[realization]
        refracted_range = self.ranging_truth(truth, realization).refracted_range
        return replace(measurements, range_status=status, refracted_range=refracted_range)
