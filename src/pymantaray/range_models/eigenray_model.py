"""
The range model that traces rays: travel times and slowness vectors of the direct arrival in a
believed medium.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import (
    Currents,
    Medium,
    RayPaths,
    choose_arrivals,
    current_delays,
    find_eigenrays,
    trace_paths,
)
from pymantaray.acoustics.eigenrays import solved_backwards
from pymantaray.acoustics.paths import quadrature
from pymantaray.arrays import Array
from pymantaray.estimation import Prediction, RangeEndpoints, RangeModel
from pymantaray.records import Arrivals


class Pairs(NamedTuple):
    """Links as unordered pairs of positions, each pair once."""

    source: Array
    receiver: Array
    pair: NDArray[np.intp]
    """Row of the pair of each link."""
    backward: NDArray[np.bool_]
    """True if the link runs from the pair's receiver to its source."""


class EigenrayModel(RangeModel):
    """
    Travel time of the earliest direct eigenray in the ocean that is believed.

    The cut-off [dB] is that of `find_eigenrays`; currents have their first-order effect, none is
    water at rest. All links are solved in one call, reciprocal pairs once. A link without an
    arrival is not possible. The first and the last answers are kept: realizations of a study start
    at the same place.
    """

    def __init__(
        self,
        medium: Medium,
        *,
        spreading_cutoff_db: float | None = 15.0,
        currents: Currents | None = None,
    ) -> None:
        self.medium = medium
        self._cutoff = spreading_cutoff_db
        self._currents = currents
        self._latest: dict[bytes, Arrivals] = {}

    def through(self, medium: Medium) -> "EigenrayModel":
        """Give the same model in another medium."""
        return EigenrayModel(medium, spreading_cutoff_db=self._cutoff, currents=self._currents)

    def predict(self, links: RangeEndpoints) -> Prediction:
        """
        Travel times, with the slowness vectors at the ends as gradients, the current's part in
        these left out.
        """
        pairs = pairs_of(links, self.medium)
        arrivals = self._solved(pairs)
        n = pairs.source.shape[0]
        delay = self._delays(pairs, arrivals)
        out = []
        for sign in (1.0, -1.0):
            link, row = choose_arrivals(arrivals, "direct", delay=sign * delay)
            time = np.full(n, np.nan)
            ends = np.full((2, n, 3), np.nan)
            time[link] = arrivals.travel_time[row] + sign * delay[row]
            ends[0, link] = -arrivals.source_slowness[row]
            ends[1, link] = arrivals.receiver_slowness[row]
            ends[:, time == 0.0] = 0.0  # equal positions
            out.append((time, ends))
            if self._currents is None:
                out *= 2
                break
        (time, ends), (time_back, ends_back) = out
        p = pairs.pair
        back = pairs.backward
        travel_time = np.where(back, time_back[p], time[p])
        return Prediction(
            travel_time=travel_time,
            transmitter_gradient=np.where(back[:, None], ends_back[1, p], ends[0, p]),
            receiver_gradient=np.where(back[:, None], ends_back[0, p], ends[1, p]),
            possible=np.isfinite(travel_time),
        )

    def paths(self, pairs: Pairs) -> tuple[RayPaths, NDArray[np.int64]]:
        """
        Paths of the direct arrivals, and the pair of each; a pair without an arrival has none.
        """
        arrivals = self._solved(pairs)
        pair, row = choose_arrivals(arrivals, "direct")
        direct = arrivals.at({"arrival": row})
        return trace_paths(self.medium, pairs.source, pairs.receiver, direct), pair

    def _solved(self, pairs: Pairs) -> Arrivals:
        key = pairs.source.tobytes() + pairs.receiver.tobytes()
        if key not in self._latest:
            while len(self._latest) > 1:
                self._latest.pop(list(self._latest)[1])
            self._latest[key] = find_eigenrays(
                self.medium,
                pairs.source,
                pairs.receiver,
                spreading_cutoff_db=self._cutoff,
            )
        return self._latest[key]

    def _delays(self, pairs: Pairs, arrivals: Arrivals) -> Array:
        if self._currents is None or not arrivals.link.size:
            return np.zeros(arrivals.link.size)
        paths = trace_paths(self.medium, pairs.source, pairs.receiver, arrivals)
        return current_delays(quadrature(paths), self._currents, arrivals.link.size)


def pairs_of(links: RangeEndpoints, medium: Medium) -> Pairs:
    """
    Unordered pairs of the links' ends, sorted by position, each from the end from which it is
    solved.

    The estimate of a vehicle at the surface can be above it by the noise of its depth sensor. Such
    an end is moved down to the surface.
    """
    transmitter, receiver = (
        np.column_stack([end[:, :2], np.fmax(end[:, 2], medium.surface_depth(end))])
        for end in (links.transmitter, links.receiver)
    )
    backward = solved_backwards(transmitter, receiver)
    source = np.where(backward[:, None], receiver, transmitter)
    receiver = np.where(backward[:, None], transmitter, receiver)
    distinct, pair = np.unique(np.hstack([source, receiver]), axis=0, return_inverse=True)
    return Pairs(
        np.ascontiguousarray(distinct[:, :3]),
        np.ascontiguousarray(distinct[:, 3:]),
        pair.reshape(-1),
        backward,
    )
