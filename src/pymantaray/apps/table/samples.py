"""
Mean slowness of the selected arrival between two depths at a horizontal range, with its
derivatives.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics import ArrivalRule, Medium, choose_arrivals, find_eigenrays
from pymantaray.apps.table.cells import REFERENCE_SLOWNESS
from pymantaray.arrays import Array
from pymantaray.jobs.progress import CountProgress
from pymantaray.records import RayStatus

NO_ARRIVAL, OUTSIDE = -1, -2
"""Families of places without an arrival, and outside the water."""


class Samples(NamedTuple):
    """
    Selected arrival at ``n`` places: source depth, receiver depth and horizontal range.

    Attributes
    ----------
    value : ndarray, shape (n,)
        Relative difference of the mean slowness (travel time over straight distance) from 1/1500
        s/m; NaN without an arrival.
    gradient : ndarray, shape (n, 3)
        Its derivatives by source depth, receiver depth and range. [1/m]
    straight : ndarray, shape (n,)
        Straight distance. [m]
    slowness : ndarray, shape (n,)
        Horizontal component of the slowness at the receiver, the derivative of travel time by
        range. [s/m]
    family : ndarray of int, shape (n,)
        Number that is equal for arrivals with equal numbers of reflections and caustics; negative
        without an arrival.
    bounces : ndarray of int, shape (n, 2)
        Reflections at the surface and at the bottom.
    several : ndarray of bool, shape (n,)
        True if other arrivals have the same numbers of reflections.
    lead : ndarray, shape (n,)
        Time until the next arrival that the rule could select; infinite without one, and for the
        rule ``strongest``. [s]
    lead_gradient : ndarray, shape (n, 3)
        Its derivatives by source depth, receiver depth and range. [s/m]
    """

    value: Array
    gradient: Array
    straight: Array
    slowness: Array
    family: NDArray[np.int64]
    bounces: NDArray[np.int64]
    several: NDArray[np.bool_]
    lead: Array
    lead_gradient: Array


Sampler = Callable[[Array, CountProgress | None], Samples]
"""
Solves places, shape (n, 3): source depth, receiver depth and horizontal range [m]. The callback, if
any, is called with the number of solved places and the total, or with those of a part of them.
"""


@dataclass(frozen=True)
class Radial:
    """
    Vertical plane through a node along a bearing, in which a table is valid.

    Attributes
    ----------
    medium : Medium
        Sound speed and sea bed.
    rule : {"direct", "first", "strongest", "direct-or-first"}
        Selection of the arrival.
    max_surface_bounces, max_bottom_bounces : int
        Allowed reflections.
    cutoff_db : float or None
        Spreading cut-off.
    north, east : float
        Position of the node, which is the source. [m]
    bearing : float
        Direction from the node to the receivers, clockwise from north. [rad]
    """

    medium: Medium
    rule: ArrivalRule = "direct"
    max_surface_bounces: int = 0
    max_bottom_bounces: int = 0
    cutoff_db: float | None = 15.0
    north: float = 0.0
    east: float = 0.0
    bearing: float = 0.0

    def __call__(self, places: Array, progress: CountProgress | None = None) -> Samples:
        """Solve places; once if they differ by an exchange of both depths, where both are alike."""
        if not self._reciprocal:
            return self._solved(places, progress)
        exchanged = places[:, 0] < places[:, 1]
        ordered = np.where(exchanged[:, None], places[:, [1, 0, 2]], places)
        once, row = np.unique(ordered, axis=0, return_inverse=True)
        samples = Samples._make(column[row] for column in self._solved(once, progress))
        for gradient in (samples.gradient, samples.lead_gradient):
            gradient[exchanged] = gradient[exchanged][:, [1, 0, 2]]
        return samples

    @property
    def _reciprocal(self) -> bool:
        """True if the arrival does not change when both depths are exchanged."""
        medium = self.medium
        flat = medium.bed.depth.size == 1 and medium.surface.depth.size == 1
        return medium.uniform and flat and medium.surface.roughness is None

    def _solved(self, places: Array, progress: CountProgress | None) -> Samples:
        """Solve places one by one."""
        source_depth, receiver_depth, distance = places.T
        along = np.array([np.cos(self.bearing), np.sin(self.bearing)])
        source = np.column_stack(
            [np.full(len(places), self.north), np.full(len(places), self.east), source_depth]
        )
        receiver = np.column_stack([source[:, :2] + distance[:, None] * along, receiver_depth])
        bounces_and_cutoff = self.max_surface_bounces, self.max_bottom_bounces, self.cutoff_db
        # warnings of more arrivals than are stored, of which the selected one is not omitted
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            arrivals = find_eigenrays(
                self.medium, source, receiver, *bounces_and_cutoff, progress=progress
            )
        link, row = choose_arrivals(arrivals, self.rule)
        time = np.full(len(places), np.nan)
        by_place = np.full((len(places), 3), np.nan)
        derivatives = np.column_stack(
            [
                -arrivals.source_slowness[:, 2],
                arrivals.receiver_slowness[:, 2],
                arrivals.receiver_slowness[:, :2] @ along,
            ]
        )
        time[link] = arrivals.travel_time[row]
        by_place[link] = derivatives[row]
        bounces = np.zeros((len(places), 2), dtype=np.int64)
        bounces[link] = np.column_stack(
            [arrivals.surface_bounces[row], arrivals.bottom_bounces[row]]
        )
        family = np.where(arrivals.status == RayStatus.OUTSIDE, OUTSIDE, NO_ARRIVAL).astype(
            np.int64
        )
        family[link] = (bounces[link] @ [16, 1]) * 64 + np.minimum(arrivals.caustics[row], 63)
        alike = (arrivals.surface_bounces == bounces[arrivals.link, 0]) & (
            arrivals.bottom_bounces == bounces[arrivals.link, 1]
        )
        several = np.bincount(arrivals.link[alike], minlength=len(places)) > 1
        lead = np.full(len(places), np.inf)
        lead_gradient = np.zeros((len(places), 3))
        if self.rule != "strongest":
            others = np.ones(arrivals.link.size, dtype=bool)
            others[row] = False
            if self.rule == "direct-or-first":  # a reflection never replaces a direct arrival
                reflected = (arrivals.surface_bounces > 0) | (arrivals.bottom_bounces > 0)
                others &= reflected == bounces[arrivals.link].any(axis=1)
            later, next_row = choose_arrivals(arrivals, self.rule, detected=others)
            lead[later] = arrivals.travel_time[next_row] - time[later]
            lead_gradient[later] = derivatives[next_row] - by_place[later]
        mean = _mean_slowness(places, time, by_place)
        return Samples(*mean, by_place[:, 2], family, bounces, several, lead, lead_gradient)


def _mean_slowness(places: Array, time: Array, by_place: Array) -> tuple[Array, Array, Array]:
    """
    Convert travel times and their derivatives to the relative difference of the mean slowness and
    its derivatives.
    """
    down = places[:, 1] - places[:, 0]
    distance = places[:, 2]
    straight = np.hypot(down, distance)
    unit = np.column_stack([-down, down, distance]) / straight[:, None]
    mean = time / straight
    gradient = (by_place - mean[:, None] * unit) / straight[:, None]
    return mean / REFERENCE_SLOWNESS - 1.0, gradient / REFERENCE_SLOWNESS, straight
