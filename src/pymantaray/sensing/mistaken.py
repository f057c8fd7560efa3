"""Ranges on another arrival than the direct one: the candidates of each attempt, and which of them chance takes."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.records import Measurements, RayStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.sensing.noise import ranged_pairs
from pymantaray.sensing.picker import by_rank

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Candidates(Record):
    """
    What each range attempt may take for its direct arrival, rows of an attempt together, the direct one first.

    Two-way a candidate is an arrival of the ping with one of the answer.
    """

    kind: ClassVar[str] = "candidates"

    attempt: Column = column("candidate", "1", "row of the range table", "i8")
    travel_time: Column = column(
        "candidate", "s", "travel time, two-way half of the round trip as in the range table"
    )
    probability: Column = column("candidate", "1", "that the receiver takes this one")
    direct: Column = column("candidate", "1", "1 for what is ranged on without mistakes, else 0", "i1")
    bounces: Column = column("candidate", "1", "reflections, two-way those of both ways", "i2")

    @property
    def expected_mistaken(self) -> float:
        """Mean number of attempts in a realization that take something else for the direct arrival."""
        return float(np.sum(self.probability[self.direct == 0]))

    def taken_by(self, chance: ArrayLike) -> Indices:
        """
        Candidate that each attempt takes.

        Parameters
        ----------
        chance : array_like, shape (n_ranges,)
            In 0 to 1, uniform. An attempt takes the first of its candidates whose probability, added to those
            before it, is greater.

        Returns
        -------
        ndarray of int, shape (n_ranges,)
            Rows of this record, -1 where nothing is taken.

        Raises
        ------
        SensingError
            If there are fewer attempts than the candidates have.
        """
        u = np.asarray(chance, dtype=float)
        if self.attempt.size and self.attempt.max() >= u.size:
            raise SensingError(
                f"candidates of attempt {self.attempt.max()}; the measurements have {u.size} range attempts"
            )
        taken, total = np.full(u.size, -1), np.zeros(u.size)
        for rows in by_rank(self.attempt):
            of = self.attempt[rows]
            total[of] += self.probability[rows]
            now = (taken[of] < 0) & (u[of] < total[of])
            taken[of[now]] = rows[now]
        return taken

    def mistaken(self, taken: Indices) -> NDArray[np.bool_]:
        """Whether each attempt took another arrival than the direct one; `taken` as `taken_by` gives it."""
        return np.asarray((taken >= 0) & (np.append(self.direct, 1)[taken] == 0))


def draw_taken(
    measurements: Measurements, candidates: Candidates, *, root_seed: int, realization: int
) -> Indices:
    """
    Let chance decide what each attempt of one realization takes for the direct arrival.

    Parameters
    ----------
    measurements : Measurements
    candidates : Candidates
        Of its range table.
    root_seed, realization : int
        As for `pymantaray.geometry.stream`.

    Returns
    -------
    ndarray of int, shape (n_ranges,)
        Rows of the candidates, -1 where nothing is taken.

    Raises
    ------
    SensingError
        If the candidates are not those of the measurements.

    Notes
    -----
    The draws are those of `draw_unheard`. Since the direct candidate comes first, an attempt whose direct arrival is
    the earliest and is heard without mistakes is heard with them too, by ``first-detected``: mistakes come
    in the place of what was not heard.
    """
    chance = np.ones(measurements.range_status.size)
    for transmitter, receiver, rows in ranged_pairs(measurements):
        generator = stream(root_seed, realization, "sensing", transmitter, "heard", receiver)
        chance[rows] = generator.random(rows.size)
    return candidates.taken_by(chance)


def take_arrivals(measurements: Measurements, candidates: Candidates, taken: Indices) -> Measurements:
    """
    Range on what each attempt takes for the direct arrival.

    Parameters
    ----------
    measurements : Measurements
        Without noise.
    candidates : Candidates
    taken : ndarray of int, shape (n_ranges,)
        From `draw_taken`.

    Returns
    -------
    Measurements
        Where another arrival was taken, the refracted range is its own, and the status is OK: the receiver knows
        no better. Where nothing was, an arrival that there is has status UNHEARD and a refracted range of NaN.
        Straight ranges stay.
    """
    o, wrong = measurements, candidates.mistaken(taken)
    lost = (taken < 0) & (o.range_status == RayStatus.OK)
    status, refracted = o.range_status.copy(), o.refracted_range.copy()
    status[wrong], status[lost], refracted[lost] = RayStatus.OK, RayStatus.UNHEARD, np.nan
    refracted[wrong] = o.transmitter_sound_speed[wrong] * candidates.travel_time[taken[wrong]]
    return replace(o, range_status=status, refracted_range=refracted)
