"""Whether a ping is heard: the sonar equation gives a probability, a random draw decides."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics import (
    Absorption,
    Medium,
    Sonar,
    transmission_loss,
)
from pymantaray.errors import SensingError
from pymantaray.geometry.boundary import Reflection
from pymantaray.records import Arrivals, Measurements, RayPaths, RayStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.records.status import ARRIVES
from pymantaray.sensing.schedule import chances

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Hearing(Record):
    """Probability that each range attempt is heard, row by row the attempts of a `Measurements` record."""

    kind: ClassVar[str] = "hearing"

    probability: Column = column("range", "1", "probability of detection, NaN where no arrival exists")


@dataclass(frozen=True, eq=False)
class Detector:
    """
    Everything that decides how loud an arrival is, and how loud it has to be.

    Parameters
    ----------
    sonar : Sonar
        Levels, band, noise and threshold; every modem is alike.
    absorption : Absorption, optional
        By default the water absorbs nothing.
    bottom : Reflection, optional
        Reflection at the sea bed; by default that of the medium's bed.
    surface : Reflection, optional
        Reflection at the surface; by default that of the medium's surface.
    """

    sonar: Sonar
    absorption: Absorption | None = None
    bottom: Reflection | None = None
    surface: Reflection | None = None

    def loss_db(
        self, medium: Medium, source: Array, receiver: Array, arrivals: Arrivals, paths: RayPaths
    ) -> Array:
        """Transmission loss of each arrival, whose paths `trace_paths` gave, at the middle of the sonar's band. [dB]"""
        loss = transmission_loss(
            medium,
            source,
            receiver,
            arrivals,
            self.sonar.frequency_hz,
            absorption=self.absorption,
            bottom=self.bottom,
            surface=self.surface,
            paths=paths,
        )
        total: Array = loss.total_db
        return total


def draw_unheard(
    measurements: Measurements, probability: ArrayLike, *, root_seed: int, realization: int
) -> Measurements:
    """
    Let chance decide which of the arrivals are heard: the others are UNHEARD, with a refracted range of NaN.

    Probabilities are read where something arrives. A higher one only ever adds ranges, and nothing else moves. What leaks
    and is heard has status OK: the receiver knows no better.
    """
    o = measurements
    p = np.asarray(probability, dtype=float)
    ok = np.isin(o.range_status, ARRIVES)
    if p.shape != ok.shape:
        raise SensingError(f"probability: shape {p.shape}; {ok.size} range attempts need one value each")
    wrong = ok & ~((p >= 0.0) & (p <= 1.0))
    if wrong.any():
        raise SensingError(
            f"probability: {np.count_nonzero(wrong)} attempts with an arrival have none in 0 to 1, the first is"
            f" {p[wrong][0]:g}"
        )
    lost = ok & ~(chances(o, root_seed=root_seed, realization=realization) < p)
    return replace(
        o,
        range_status=np.where(
            lost, np.int8(RayStatus.UNHEARD), np.where(ok, np.int8(RayStatus.OK), o.range_status)
        ),
        refracted_range=np.where(lost, np.nan, o.refracted_range),
    )
