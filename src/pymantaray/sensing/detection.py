"""Detection of pings: probability by the sonar equation, outcome by a random draw."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.acoustics import (
    Absorption,
    Coherent,
    Medium,
    RayPaths,
    Sonar,
    Tails,
    find_tails,
    received_loss_db,
    transmission_loss,
)
from pymantaray.acoustics.levels.loss import Losses, loss_under_rough_surface
from pymantaray.arrays import Array, Mask
from pymantaray.errors import SensingError
from pymantaray.geometry.boundary import Reflection
from pymantaray.records import Arrivals, Measurements, RayStatus
from pymantaray.records.base import Column, Record, column
from pymantaray.records.status import ARRIVES
from pymantaray.sensing.schedule import chances


@dataclass(frozen=True, eq=False)
class Hearing(Record):
    """
    Detection probability of each range attempt, row by row those of a `Measurements` record.

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.acoustics import Sonar
    >>> from pymantaray.sensing import Detector, Hearing, ReceptionOptions, measure_ranges
    >>> sonar = Sonar(source_level_db=150.0, frequency_hz=25e3, bandwidth_hz=5e3, noise=40.0)
    >>> reception = ReceptionOptions(detector=Detector(sonar))
    >>> hearing = Hearing(measure_ranges(truth, [], medium, schedule, reception).probability)
    >>> print(hearing.probability.round(2))
    [0.28 0.28]
    """

    kind: ClassVar[str] = "hearing"

    probability: Column = column(
        "range", "1", "probability of detection, NaN where no arrival exists"
    )


@dataclass(frozen=True, eq=False)
class Detector:
    """
    Levels, losses and threshold that determine the detection of an arrival.

    Parameters
    ----------
    sonar : Sonar
        Levels, band, noise and threshold, the same for every modem.
    absorption : Absorption, optional
        By default the water absorbs nothing.
    bottom : Reflection, optional
        Reflection at the sea bed; by default that of the medium's bed.
    surface : Reflection, optional
        Reflection at the surface; by default that of the medium's surface.
    coherent : bool or "auto"
        Interference of the arrivals of a link, see `pymantaray.acoustics.received_loss_db`; by
        default, arrivals interfere if the sonar's band does not separate them.

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.acoustics import Absorption, Sonar
    >>> from pymantaray.sensing import Detector, ReceptionOptions, measure_ranges
    >>> sonar = Sonar(source_level_db=165.0, frequency_hz=25e3, bandwidth_hz=5e3, noise=40.0)
    >>> reception = ReceptionOptions(detector=Detector(sonar, Absorption.thorp()))
    >>> print(measure_ranges(truth, [], medium, schedule, reception).probability.round(2))
    [0.43 0.43]
    """

    sonar: Sonar
    absorption: Absorption | None = None
    bottom: Reflection | None = None
    surface: Reflection | None = None
    coherent: Coherent = "auto"

    def loss_db(
        self,
        medium: Medium,
        source: Array,
        receiver: Array,
        arrivals: Arrivals,
        paths: RayPaths | None,
        tails: Tails | None = None,
    ) -> Array:
        """
        Transmission loss at which each arrival is received, at the centre of the sonar's band.

        Parameters
        ----------
        medium : Medium
            Water.
        source, receiver : ndarray, shape (n, 3)
            Ends of the links: north, east, down. [m]
        arrivals : Arrivals
            Arrivals of the links.
        paths : RayPaths or None
            Paths of the arrivals from `trace_paths`; None under a rough surface.
        tails : Tails, optional
            Sound behind caustics, from this detector's `tails`.

        Returns
        -------
        ndarray, shape (n_arrivals,)
            Loss. [dB]
        """
        if paths is None:
            losses = Losses(self.absorption, self.bottom, self.surface)
            return loss_under_rough_surface(
                medium, (source, receiver), arrivals, self.sonar.frequency_hz, losses
            )
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
        band = self.sonar.frequency_hz, self.sonar.bandwidth_hz
        return received_loss_db(arrivals, loss, *band, coherent=self.coherent, tails=tails)

    def tails(
        self,
        medium: Medium,
        source: Array,
        receiver: Array,
        arrivals: Arrivals,
        bounces: tuple[int, int],
        threads: int | None,
    ) -> Tails | None:
        """
        Find the sound behind caustics near the receivers.

        Parameters
        ----------
        medium : Medium
            Water.
        source, receiver : ndarray, shape (n, 3)
            Ends of the links: north, east, down. [m]
        arrivals : Arrivals
            Arrivals of the links.
        bounces : tuple of int
            Maximum numbers of reflections at the surface and at the bottom.
        threads : int or None
            Number of threads; None for all.

        Returns
        -------
        Tails or None
            None if arrivals do not interfere.
        """
        if self.coherent is False:
            return None
        return find_tails(
            medium,
            source,
            receiver,
            arrivals,
            self.sonar.frequency_hz,
            bounces=bounces,
            bottom=self.bottom,
            surface=self.surface,
            threads=threads,
        )


def draw_unheard(
    measurements: Measurements, probability: ArrayLike, *, root_seed: int, realization: int
) -> Measurements:
    """
    Draw which arrivals are detected: the others have status UNHEARD and a refracted range of NaN.

    Only probabilities of attempts with an arrival count. A higher probability only adds ranges and
    changes nothing else. Detected sound without a ray has status OK, because the receiver cannot
    tell the difference.
    """
    probabilities = np.asarray(probability, dtype=float)
    ok = np.isin(measurements.range_status, ARRIVES)
    if probabilities.shape != ok.shape:
        raise SensingError(
            f"probability: shape {probabilities.shape}; {ok.size} range attempts need one value"
            " each"
        )
    wrong = ok & ~((probabilities >= 0.0) & (probabilities <= 1.0))
    if wrong.any():
        raise SensingError(
            f"probability: {np.count_nonzero(wrong)} attempts with an arrival have one outside 0 to"
            f" 1, the first is {probabilities[wrong][0]:g}"
        )
    draws = chances(measurements, root_seed=root_seed, realization=realization)
    return mark_unheard(measurements, ok & ~(draws < probabilities))


def mark_unheard(measurements: Measurements, lost: Mask) -> Measurements:
    """Give lost arrivals status UNHEARD and a refracted range of NaN, and all others status OK."""
    status = measurements.range_status.copy()
    status[np.isin(status, ARRIVES)] = RayStatus.OK
    status[lost] = RayStatus.UNHEARD
    return replace(
        measurements,
        range_status=status,
        refracted_range=np.where(lost, np.nan, measurements.refracted_range),
    )
