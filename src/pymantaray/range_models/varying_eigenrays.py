"""Eigenrays through a believed ocean that varies: each ping in the water of its time."""

from collections.abc import Callable

import numpy as np

from pymantaray.acoustics import Currents, Medium
from pymantaray.arrays import Array
from pymantaray.estimation import Prediction, RangeEndpoints, RangeModel
from pymantaray.range_models.eigenray_model import EigenrayModel


class VaryingEigenrays(RangeModel):
    """
    Travel time of the earliest direct eigenray in the water at each ping, by its time since the
    mission's start [s].

    A medium is made for each ping of each prediction, at its time and around its positions (n, 3)
    [m], and let go again, so that memory does not grow with the pings.
    """

    def __init__(
        self,
        medium_at: Callable[[float, Array], Medium],
        currents_at: Callable[[float], Currents] | None = None,
        *,
        spreading_cutoff_db: float | None = 15.0,
    ) -> None:
        self._medium_at = medium_at
        self._currents_at = currents_at
        self._cutoff = spreading_cutoff_db

    def predict(self, links: RangeEndpoints) -> Prediction:
        """Travel times of the direct arrivals, ping by ping."""
        n = links.time.size
        out = Prediction(
            np.full(n, np.nan), np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.zeros(n, bool)
        )
        for time in np.unique(links.time):
            rows = links.time == time
            ends = np.concatenate([links.transmitter[rows], links.receiver[rows]])
            model = EigenrayModel(
                self._medium_at(float(time), ends),
                spreading_cutoff_db=self._cutoff,
                currents=None if self._currents_at is None else self._currents_at(float(time)),
            )
            of_ping = model.predict(RangeEndpoints(*(column[rows] for column in links)))
            out.travel_time[rows] = of_ping.travel_time
            out.transmitter_gradient[rows] = of_ping.transmitter_gradient
            out.receiver_gradient[rows] = of_ping.receiver_gradient
            out.possible[rows] = of_ping.possible
        return out
