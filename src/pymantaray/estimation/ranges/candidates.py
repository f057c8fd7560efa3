"""
Candidate arrivals of ranges: the arrivals that a receiver may have taken, with their probabilities.
"""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from pymantaray.arrays import Array
from pymantaray.errors import EstimationError
from pymantaray.estimation.ranges.range_models import Prediction, RangeEndpoints, RangeModel, Rows


class CandidateArrivals(NamedTuple):
    """
    Arrivals that the ranges of a graph may belong to, one row for each.

    The candidates of a range are consecutive and in order of travel time. The order of the ranges
    is that of the links.
    """

    row: Rows  # range of each candidate
    travel_time: Array  # [s]
    transmitter_gradient: Array  # of the travel time by the transmitter's position, (n, 3) [s/m]
    receiver_gradient: Array  # by the receiver's
    # probability that the receiver takes this candidate, if it takes one; sums to 1 for each range
    weight: Array
    sigma: Array  # standard deviation of the travel time due to the assumed ocean [s]
    surface_bounces: Rows
    bottom_bounces: Rows
    family: Rows  # equal for arrivals of the same kind of path at successive pings

    @classmethod
    def of(
        cls,
        row: Rows,
        travel_time: Array,
        gradients: tuple[Array, Array],
        weight: Array,
        *,
        sigma: Array,
        bounces: tuple[Rows, Rows],
    ) -> Self:
        """
        Sort arrivals by range and travel time, scale their weights to a sum of 1, and number their
        families.

        Arrivals of one family have the same bounces and the same rank in time among the arrivals
        with these bounces. With as many bounces at the surface as at the bottom, they also have the
        same first boundary. If all weights of a range are zero its arrivals have equal ones.

        Parameters
        ----------
        row : ndarray of int, shape (n,)
            Range of each arrival.
        travel_time : ndarray, shape (n,)
            Travel times. [s]
        gradients : tuple of two ndarrays, shape (n, 3)
            Derivatives of the travel time by the positions of transmitter and receiver. [s/m]
        weight : ndarray, shape (n,)
            Weights, not negative.
        sigma : ndarray, shape (n,)
            Standard deviations of the travel times. [s]
        bounces : tuple of two ndarrays of int, shape (n,)
            Reflections at the surface and at the bottom.

        Returns
        -------
        CandidateArrivals
        """
        order = np.lexsort((travel_time, row))
        row = row[order]
        weight = np.asarray(weight, dtype=float)[order]
        n = int(row.max(initial=-1)) + 1
        total = np.bincount(row, weight, n)
        count = np.bincount(row, minlength=n)
        weight = np.where(total[row] > 0.0, weight, 1.0) / np.where(total > 0.0, total, count)[row]
        by_transmitter, by_receiver = (by[order] for by in gradients)
        surface, bottom = (np.asarray(part, dtype=np.intp)[order] for part in bounces)
        down_first = (surface == bottom) & (surface > 0) & (by_transmitter[:, 2] < 0.0)
        kind = (surface * 64 + bottom) * 2 + down_first
        family = kind * 64 + _rank(row, kind)
        times = travel_time[order], by_transmitter, by_receiver
        return cls(row, *times, weight, sigma[order], surface, bottom, family)

    @property
    def prediction(self) -> Prediction:
        """Travel times and gradients of all candidates."""
        return Prediction(
            travel_time=self.travel_time,
            transmitter_gradient=self.transmitter_gradient,
            receiver_gradient=self.receiver_gradient,
            possible=np.ones(self.row.size, dtype=bool),
            bounces=self.surface_bounces + self.bottom_bounces,
        )


def of_picks(prediction: Prediction, picks: Rows) -> Prediction:
    """Prediction of the pick of each range, a row of the prediction of candidates; -1 for none."""
    at = picks >= 0
    time = np.full(picks.size, np.nan)
    ends = np.full((2, picks.size, 3), np.nan)
    time[at] = prediction.travel_time[picks[at]]
    ends[0, at] = prediction.transmitter_gradient[picks[at]]
    ends[1, at] = prediction.receiver_gradient[picks[at]]
    bounces = np.zeros(picks.size, dtype=np.intp)
    if prediction.bounces is not None:
        bounces[at] = prediction.bounces[picks[at]]
    return Prediction(time, ends[0], ends[1], at, bounces)


def _rank(row: Rows, kind: Rows) -> Rows:
    """
    Number of earlier candidates of the same range and kind; rows of a range are in order of time.
    """
    order = np.lexsort((kind, row))  # stable: in order of time within range and kind
    first = np.ones(row.size, dtype=bool)
    first[1:] = (np.diff(row[order]) != 0) | (np.diff(kind[order]) != 0)
    start = np.maximum.accumulate(np.where(first, np.arange(row.size), 0))
    out = np.empty(row.size, dtype=np.intp)
    out[order] = np.arange(row.size) - start
    return out


@dataclass(frozen=True)
class MixtureOptions:
    """
    Probabilities of a mixture of candidates.

    Parameters
    ----------
    null_weight : float
        Probability that a range belongs to none of its candidates, at least 0 and less than 1. [-]
    null_width : float
        Width of the interval over which the error of such a range is uniformly distributed. [m]
    persistence : float
        Time constant with which the receiver of an ordered pair stays with a family of arrivals; 0
        if successive picks are independent. [s]
    gate : float
        While ranges are added ping by ping, candidates whose innovation exceeds this many of its
        standard deviations are discarded. [-]

    Raises
    ------
    EstimationError
        If a value is not in its range.
    """

    null_weight: float = 0.01
    null_width: float = 1000.0
    persistence: float = 0.0
    gate: float = 5.0

    def __post_init__(self) -> None:
        """Refuse values that are no probability or size."""
        limits: Sequence[tuple[str, bool, str]] = (
            ("null_weight", 0.0 <= self.null_weight < 1.0, "at least 0 and less than 1"),
            ("null_width", 0.0 < self.null_width < np.inf, "positive and finite [m]"),
            ("persistence", 0.0 <= self.persistence < np.inf, "zero or positive and finite [s]"),
            ("gate", 0.0 < self.gate < np.inf, "positive and finite, in standard deviations"),
        )
        for name, fine, allowed in limits:
            if not fine:
                raise EstimationError(
                    f"mixture: {name} is {getattr(self, name):g}; it must be {allowed}"
                )


class CandidateModel(RangeModel):
    """
    Base of range models that predict all arrivals that a receiver may take.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import MixtureOptions, RangeEndpoints
    >>> from pymantaray.range_models.candidate_rays import CandidateRays
    >>> from pymantaray.sensing import OneWay, ReceptionOptions
    >>> reception = ReceptionOptions(max_surface_bounces=1)
    >>> model = CandidateRays(medium, reception, OneWay(), MixtureOptions(null_weight=0.05))
    >>> ends = truth.position[0, :1], truth.position[1, :1]
    >>> links = RangeEndpoints(np.zeros(1), *ends, sound_speed=np.array([1452.0]))
    >>> print(model.candidates(links).travel_time.round(4))
    [1.393  1.3993]
    """

    mixture: MixtureOptions

    def predict(self, links: RangeEndpoints) -> Prediction:
        """Predict the candidate of the largest weight; parameters as in `RangeModel.predict`."""
        arrivals = self.candidates(links)
        picks = np.full(links.time.size, -1)
        order = np.lexsort((arrivals.weight, arrivals.row))
        picks[arrivals.row[order]] = order  # the last of a range is the heaviest
        return of_picks(arrivals.prediction, picks)

    @abstractmethod
    def candidates(self, links: RangeEndpoints) -> CandidateArrivals:
        """
        Predict the arrivals of all links of a graph.

        Parameters
        ----------
        links : RangeEndpoints
            Positions of both ends, times and measured sound speeds of the links.

        Returns
        -------
        CandidateArrivals
            Arrivals; a link without one has no rows.
        """
