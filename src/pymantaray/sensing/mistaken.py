"""Ranges on another arrival than the direct one: the candidates of each attempt, and which of them chance takes."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import SensingError
from pymantaray.geometry import stream
from pymantaray.records import Observations, RayStatus
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
                f"candidates of attempt {self.attempt.max()}; the observations have {u.size} range attempts"
            )
        taken, total = np.full(u.size, -1), np.zeros(u.size)
        for rows in by_rank(self.attempt):
            of = self.attempt[rows]
            total[of] += self.probability[rows]
            now = (taken[of] < 0) & (u[of] < total[of])
            taken[of[now]] = rows[now]
        return taken


def draw_taken(
    observations: Observations, candidates: Candidates, *, root_seed: int, realization: int
) -> Indices:
    """
    Let chance decide what each attempt of one realization takes for the direct arrival.

    Parameters
    ----------
    observations : Observations
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
        If the candidates are not those of the observations.

    Notes
    -----
    The draws are those of `draw_unheard`. Since the direct candidate comes first, an attempt whose direct arrival is
    the earliest and is heard without mistakes is heard with them too, by ``first-detected``: mistakes come
    in the place of what was not heard.
    """
    chance = np.ones(observations.range_status.size)
    for transmitter, receiver, rows in ranged_pairs(observations):
        generator = stream(root_seed, realization, "sensing", transmitter, "heard", receiver)
        chance[rows] = generator.random(rows.size)
    return candidates.taken_by(chance)


def take_arrivals(
    observations: Observations, candidates: Candidates, *, root_seed: int, realization: int
) -> Observations:
    """
    Range on what each attempt of one realization takes for the direct arrival.

    Parameters
    ----------
    observations : Observations
        Without noise.
    candidates, root_seed, realization
        As for `draw_taken`.

    Returns
    -------
    Observations
        Where another arrival was taken, travel time and refracted range are its own, and the status is OK: the
        receiver knows no better. Where nothing was, an arrival that there is has status UNHEARD and a refracted
        range of NaN. Straight ranges stay.

    Raises
    ------
    SensingError
        If the candidates are not those of the observations.
    """
    o = observations
    taken = draw_taken(o, candidates, root_seed=root_seed, realization=realization)
    lost = (taken < 0) & (o.range_status == RayStatus.OK)
    wrong = np.flatnonzero(taken >= 0)
    wrong = wrong[candidates.direct[taken[wrong]] == 0]
    status, time, refracted = o.range_status.copy(), o.travel_time.copy(), o.refracted_range.copy()
    status[wrong], time[wrong] = RayStatus.OK, candidates.travel_time[taken[wrong]]
    refracted[wrong] = o.transmitter_sound_speed[wrong] * time[wrong]
    status[lost], refracted[lost] = RayStatus.UNHEARD, np.nan
    return replace(o, range_status=status, travel_time=time, refracted_range=refracted)
