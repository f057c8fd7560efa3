"""
Sound at receivers that no ray reaches: diffraction from the nearest ray, and scattered sound as a
lower bound.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.eigenrays import find_eigenrays
from pymantaray.acoustics.levels.creeping import creep_along_surface
from pymantaray.acoustics.levels.sonar import link_loss_db
from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.selection import choose_arrivals
from pymantaray.arrays import Array, Indices
from pymantaray.errors import AcousticsError
from pymantaray.quantities.checks import check_fields, check_number
from pymantaray.records import Arrivals

Solve = Callable[[Indices, Array], Arrivals]
_RUNGS = 9  # distances of the search for rays, each half of the next
_DOWN = np.array([0.0, 0.0, 1.0])
_SHARP = 0.02  # m; accuracy of an edge
_INSIDE = 2.0  # m; distance inside the edge at which rays are compared
_WEAKEST = 40.0  # dB; weaker rays (by spreading beyond spherical) are weaker than leaked sound
_PAIR = 1e-3  # s; maximum time between rays of one fold there


@dataclass(frozen=True)
class Leakage:
    r"""
    Model of sound that arrives without a ray.

    Parameters
    ----------
    reach : float
        Maximum vertical distance of the nearest ray from the receiver. [m]
    scatter_db : float, optional
        Level of scattered sound below spherical spreading, independent of leakage. Default: no
        scattered sound. [dB]

    Notes
    -----
    The nearest ray arrives above or below the receiver at the smallest distance m, at the edge of
    the lit region. Its slowness gives the travel time at the receiver (Fermat). Its level decreases
    by one of three laws:

    - If two rays merge at the edge, as on the dark side of a caustic, Airy's law [1]_: with the
      time :math:`\Delta T` between both rays at
      :math:`\delta` inside the edge and their mean intensity I there,

      .. math:: l = \delta \left(\tfrac34 \omega \Delta T\right)^{-2/3}, \qquad
         \overline{|p|^2} = 4 \pi I \sqrt{\delta / l} \; \mathrm{Ai}^2(m / l).

      l is the width of the caustic, 2.5 m at 12 kHz and 13 m at 1 kHz for rays that curve with a
      radius of 88 km.
    - Otherwise, as behind a seamount or where rays diverge, the law of a straight edge at half the
      distance d [2]_: :math:`J(\nu)` below
      the ray just inside, :math:`\nu = m \sqrt{2 / \lambda d}`, which is 6 dB at the edge, and a
      path longer by :math:`m^2 / d`. The level behind a smooth boundary is lower, so this law is an
      upper bound.
    - If the surface causes the shadow (sound speed increases towards the surface above both ends),
      sound creeps along the surface. Its
      level is that of the wave equation in the mean column of the link (`creeping.py`).

    A ray that reaches the receiver with a spreading beyond the cut-off, but at most 40 dB beyond
    spherical, replaces leaked sound if it is stronger.

    References
    ----------
    .. [1] The uniform field at a smooth caustic is in textbooks (Brekhovskikh and Lysanov,
       Fundamentals of Ocean Acoustics; not at hand); derived here from its limit: far inside, two
       rays of equal intensity with a phase between them of :math:`\omega \Delta T - \pi / 2`.
    .. [2] Recommendation ITU-R P.526, single knife-edge obstacle: :math:`J = 6.9 + 20
       \lg(\sqrt{(\nu - 0.1)^2 + 1} + \nu - 0.1)` dB; quoted from memory of it, checked against the
       Fresnel integral in the tests.
    """

    reach: float = 200.0
    scatter_db: float | None = None

    def __post_init__(self) -> None:
        """Check both values."""
        check_fields(AcousticsError, self, "m", "reach", positive=True)
        if self.scatter_db is not None:
            check_number(AcousticsError, "Leakage: scatter_db", self.scatter_db, "dB")


class Leaks(NamedTuple):
    """Arrivals on links without a ray, at most one per link."""

    link: Indices
    """Index of the link."""
    place: Array
    """Position (n, 3) at which the nearest ray arrives. [m]"""
    arrivals: Arrivals
    """
    Nearest ray of each link, from the source to its position; its spreading is that at the
    receiver.
    """
    shift: Array
    """Additional travel time from there to the receiver. [s]"""
    scattered: NDArray[np.bool_]
    """True if scattered sound is louder than leaked sound."""


def find_leaks(
    medium: Medium,
    source: Array,
    receiver: Array,
    leakage: Leakage,
    frequency_hz: float,
    *,
    bounces: tuple[int, int] = (0, 0),
    spreading_cutoff_db: float | None = 15.0,
    threads: int | None = None,
) -> Leaks:
    """
    Find the sound that leaks to receivers without a ray.

    Parameters
    ----------
    medium : Medium
    source, receiver : ndarray, shape (n_links, 3)
        Ends of links without an arrival. [m]
    leakage : Leakage
    frequency_hz : float
        Middle of the signal's band. [Hz]
    bounces : tuple of int
        Maximum numbers of reflections of the nearest ray at the surface and at the sea bed.
    spreading_cutoff_db : float or None
        Cut-off for the nearest ray, as in `find_eigenrays`. [dB]
    threads : int, optional
        As in `find_eigenrays`.

    Returns
    -------
    Leaks
        Leaks of those links that have a ray within reach.

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.acoustics import Leakage, Medium, find_leaks
    >>> water = Medium.from_profile([0.0, 1000.0], [1480.0, 1450.0], bottom_depth=1000.0)
    >>> source, receiver = np.array([[0.0, 0.0, 50.0]]), np.array([[4000.0, 0.0, 20.0]])
    >>> leaks = find_leaks(water, source, receiver, Leakage(reach=100.0), 1000.0)
    >>> print(leaks.place[:, 2].round(1), leaks.arrivals.spreading_db.round(1))
    [32.1] [20.9]
    """
    check_number(AcousticsError, "frequency_hz", frequency_hz, "Hz", positive=True)

    def solve(
        link: Indices, offset: Array, cutoff_db: float | None = spreading_cutoff_db
    ) -> Arrivals:
        """Arrivals at positions below the receivers of links by an offset. [m]"""
        place = receiver[link] + offset[:, None] * _DOWN
        return find_eigenrays(medium, source[link], place, *bounces, cutoff_db, threads=threads)

    room = (
        medium.bottom_depth(receiver) - receiver[:, 2],
        receiver[:, 2] - medium.surface_depth(receiver),
    )
    dark, edge = _edges(solve, np.clip(np.stack(room), 0.0, leakage.reach), leakage.reach)
    at_edge = _strongest(solve(dark, edge))
    inside = solve(dark, edge + np.copysign(_INSIDE, edge))
    level, delay = _beyond(
        medium, (source[dark], receiver[dark]), edge, at_edge, inside, frequency_hz
    )
    n = len(source)
    weakest = None if spreading_cutoff_db is None else max(spreading_cutoff_db, _WEAKEST)
    weak = solve(np.arange(n), np.zeros(n), weakest)
    weak_db = link_loss_db(weak.spreading_db, weak.link, n)  # infinite without a ray
    leak_db = np.full(n, np.inf)
    offset = np.zeros(n)
    shift = np.zeros(n)
    leak_db[dark] = level
    leaks = leak_db < weak_db
    offset[dark], shift[dark] = np.where(leaks[dark], edge, 0.0), np.where(leaks[dark], delay, 0.0)
    link = np.flatnonzero(np.isfinite(np.minimum(leak_db, weak_db)))
    spreading = np.minimum(leak_db, weak_db)[link]
    scattered = np.zeros(link.size, dtype=bool)
    if leakage.scatter_db is not None:
        scattered = spreading > leakage.scatter_db
        spreading = np.minimum(spreading, leakage.scatter_db)
    place = receiver[link] + offset[link, None] * _DOWN
    nearest = replace(_strongest(solve(link, offset[link], weakest)), spreading_db=spreading)
    return Leaks(link, place, nearest, shift[link], scattered)


def _beyond(
    medium: Medium,
    ends: tuple[Array, Array],
    edge: Array,
    at_edge: Arrivals,
    inside: Arrivals,
    frequency_hz: float,
) -> tuple[Array, Array]:
    """Spreading at receivers beyond an edge [dB], and the additional travel time from there [s]."""
    level = np.empty(edge.size)
    delay = -edge * at_edge.receiver_slowness[:, 2]
    chord = np.linalg.norm(ends[1] - ends[0], axis=-1)
    for i, (m, d) in enumerate(zip(np.abs(edge).tolist(), chord.tolist(), strict=True)):
        rays = np.flatnonzero(inside.link == i)
        rays = rays[np.argsort(np.abs(inside.travel_time[rays] - at_edge.travel_time[i]))]
        if _is_fold(inside, rays):
            apart = abs(float(np.diff(inside.travel_time[rays[:2]])[0]))
            phase = 2.0 * math.pi * frequency_hz * apart
            level[i] = airy_spreading_db(m, phase, inside.spreading_db[rays[:2]])
            continue
        creep = creep_along_surface(medium, ends[0][i], ends[1][i], frequency_hz)
        if creep is not None:
            level[i] = creep.spreading_db
            delay[i] = creep.travel_time - at_edge.travel_time[i]
            continue
        speed = at_edge.receiver_sound_speed[i]
        before = inside.spreading_db[rays[0]] if rays.size else at_edge.spreading_db[i]
        level[i] = before + knife_edge_db(m * math.sqrt(2.0 * frequency_hz / (speed * d)))
        # the path via an edge at half the distance, as in Fresnel's parameter
        delay[i] += m * m / (speed * d)
    return level, delay


def airy_spreading_db(distance: float, phase: float, spreading_db: Array) -> float:
    """
    Spreading at a distance [m] on the dark side of a caustic. [dB]

    It depends on the phase between the two rays [rad] and on their spreading [dB], both at
    `_INSIDE` on the other side.
    """
    from scipy.special import airye

    width = _INSIDE * (0.75 * phase) ** (-2.0 / 3.0)
    x = distance / width
    scaled = float(airye(x)[0])  # Ai(x) exp(2/3 x^1.5)
    decay = 20.0 * math.log10(scaled) - 40.0 / 3.0 * x**1.5 / math.log(10.0)
    intensity = float(np.mean(10.0 ** (-0.1 * spreading_db)))
    return float(-decay - 10.0 * math.log10(4.0 * math.pi * math.sqrt(_INSIDE / width) * intensity))


def knife_edge_db(nu: float) -> float:
    """Loss behind a straight edge, by Fresnel's parameter, 0 at the shadow's border. [dB]"""
    return 6.9 + 20.0 * math.log10(math.sqrt((nu - 0.1) ** 2 + 1.0) + nu - 0.1)


def _edges(solve: Solve, room: Array, reach: float) -> tuple[Indices, Array]:
    """
    Links within reach of a ray, and the depth of the nearest lit position below the receiver. [m]

    ``room`` (2, n_links) is the extent of the water below and above the receivers. [m]
    """

    def lit(link: Indices, offset: Array) -> NDArray[np.bool_]:
        return np.bincount(solve(link, offset).link, minlength=link.size) > 0

    every = np.arange(room.shape[1])
    nearest = np.full(room.shape[1], np.inf)
    rungs = reach * 0.5 ** np.arange(_RUNGS)[::-1]
    for before, rung in zip(np.concatenate([[0.0], rungs]), rungs, strict=False):
        dark = every[np.isinf(nearest)]
        link = np.tile(dark, 2)
        down = np.repeat([True, False], dark.size)
        high = np.minimum(rung, np.where(down, room[0, link], room[1, link]))
        sign = np.where(down, 1.0, -1.0)
        reached = (high > before) & lit(link, sign * high)
        link = link[reached]
        sign = sign[reached]
        high = high[reached]
        low = np.full(link.size, before)
        # each link until it is sharp itself, so that it does not depend on the others
        while (wide := np.flatnonzero(high - low - 1e-3 * high > _SHARP)).size:
            middle = 0.5 * (low[wide] + high[wide])
            inside = lit(link[wide], sign[wide] * middle)
            low[wide] = np.where(inside, low[wide], middle)
            high[wide] = np.where(inside, middle, high[wide])
        order = np.argsort(-high, kind="stable")
        nearest[link[order]] = (sign * high)[order]
    known = np.flatnonzero(np.isfinite(nearest))
    return known, nearest[known]


def _is_fold(inside: Arrivals, rays: Indices) -> bool:
    """True if the two rays that are nearest in time belong to one fold."""
    if rays.size < 2:
        return False
    a, b = rays[:2]
    counts = inside.surface_bounces, inside.bottom_bounces
    same = all(count[a] == count[b] for count in counts)
    return bool(same and 0.0 < abs(inside.travel_time[a] - inside.travel_time[b]) < _PAIR)


def _strongest(arrivals: Arrivals) -> Arrivals:
    """Strongest arrival of each link; every link has at least one."""
    return arrivals.at({"arrival": choose_arrivals(arrivals, "strongest").row})
