"""
The range model of a mixture: all arrivals through an assumed ocean that a receiver may take, with
their probabilities.
"""

import numpy as np

from pymantaray.acoustics import Currents, Medium
from pymantaray.arrays import Array
from pymantaray.estimation import (
    CandidateArrivals,
    CandidateModel,
    MixtureOptions,
    RangeEndpoints,
)
from pymantaray.range_models.eigenray_model import first_and_last, pairs_of
from pymantaray.sensing import Picker, ReceptionOptions, Timing
from pymantaray.sensing.exchanges import all_exchanges, exchange_times, exchange_values
from pymantaray.sensing.picking import pick_receptions
from pymantaray.sensing.receptions import Direction, Receptions
from pymantaray.sensing.transmission import find_receptions


class CandidateRays(CandidateModel):
    """
    Arrivals of each link in an assumed ocean, and the probability that the receiver takes each.

    Two-way, a candidate is an arrival of the ping with one of the answer, of vehicles at rest.
    Without a picker all arrivals of a link have equal weights. The standard deviation of a travel
    time is that of a sound speed that has an error of ``sound_speed_sigma`` [m/s] along the whole
    path.
    """

    def __init__(
        self,
        medium: Medium,
        reception: ReceptionOptions,
        timing: Timing,
        mixture: MixtureOptions,
        *,
        picker: Picker | None = None,
        sound_speed_sigma: float = 0.0,
        currents: Currents | None = None,
    ) -> None:
        self.mixture = mixture
        self._medium = medium
        self._reception = reception
        self._timing = timing
        self._picker = picker
        self._sound_speed_sigma = sound_speed_sigma
        self._currents = currents
        self._latest: dict[bytes, Receptions] = {}

    def candidates(self, links: RangeEndpoints) -> CandidateArrivals:
        """Candidates of all links."""
        pairs = pairs_of(links, self._medium)
        receptions = self._receptions(pairs.source, pairs.receiver)
        forth = np.where(pairs.backward, Direction.BACK, Direction.FORTH).astype(np.int64)
        row, exchanges = all_exchanges(receptions, pairs.pair, forth, self._timing)
        rest = np.zeros((row.size, 3))
        time = exchange_times(receptions, exchanges, self._timing, (rest, rest))

        def legs(values: Array) -> tuple[Array, ...]:
            return exchange_values(values, exchanges, self._timing)

        probability = np.prod(legs(receptions.probability), axis=0)
        back = (exchanges.direction == Direction.BACK)[:, None]
        # NaN for equal positions
        at_source = -np.nan_to_num(np.mean(legs(receptions.source_slowness), axis=0))
        at_receiver = np.nan_to_num(np.mean(legs(receptions.receiver_slowness), axis=0))
        bounces = [
            np.sum(legs(n.astype(float)), axis=0).astype(np.intp)
            for n in (receptions.surface_bounces, receptions.bottom_bounces)
        ]
        return CandidateArrivals.of(
            row,
            time,
            (np.where(back, at_receiver, at_source), np.where(back, at_source, at_receiver)),
            probability if self._picker is not None else np.ones(row.size),
            sigma=self._sound_speed_sigma * time / links.sound_speed[row],
            bounces=(bounces[0], bounces[1]),
        )

    def _receptions(self, source: Array, receiver: Array) -> Receptions:
        """
        Receptions between pairs of positions; those of the first and of the last question are kept.
        """

        def find() -> Receptions:
            found = find_receptions(
                source, receiver, self._medium, self._reception, currents=self._currents
            ).receptions
            return found if self._picker is None else pick_receptions(found, self._picker)

        return first_and_last(self._latest, source, receiver, find)
