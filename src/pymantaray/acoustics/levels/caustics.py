"""Field near caustics: pairs of rays of a fold, and the sound on its dark side by continuation."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from pymantaray.acoustics.eigenrays import find_eigenrays
from pymantaray.acoustics.levels.loss import TransmissionLoss, transmission_loss
from pymantaray.acoustics.medium import Medium
from pymantaray.arrays import Array, Indices
from pymantaray.geometry.boundary import Reflection
from pymantaray.records import Arrivals

_DOWN = np.array([0.0, 0.0, 1.0])
# caustic widths above and below a receiver at which folds are looked for
_OFFSETS = 0.75 * 2.0 ** np.arange(0.0, 3.1, 0.5)
_WIDTH = 2.5  # m at Hz; width of a caustic of rays that curve with a radius of 88 km
_WIDTH_HZ = 12e3
# widths inside the caustic; its field is continued from the last three, or the first
_INSIDE = np.array([0.2, 0.4, 0.7, 1.4])
_FARTHEST = 4.0  # widths of the caustic; maximum distance on its dark side
_WIDEST = 40.0  # rad; between the two rays of a fold


class Waves(NamedTuple):
    """Arrivals as pressures re 1 m, without the phase of their travel time."""

    time: Array
    """[s]"""
    log_size: Array
    """Natural logarithm of the magnitude; minus infinity for silence."""
    phase: Array
    """[rad]"""

    def at(self, rows: Indices) -> Waves:
        """Waves in some rows."""
        return Waves(self.time[rows], self.log_size[rows], self.phase[rows])


class Fold(NamedTuple):
    """Field of the two rays of a fold; every column is smooth across the caustic."""

    time: Array
    """Mean travel time of both rays. [s]"""
    argument: Array
    """Argument of Airy's function, positive on the lit side."""
    size: Array
    """Sum of both pressures, times the fourth root of the argument."""
    skew: Array
    """Late minus early pressure, divided by the fourth root of the argument."""
    phase: Array
    """Launch angle of the early ray. [rad]"""

    def wave(self) -> Waves:
        """Field of both rays together."""
        from scipy.special import airy

        ai, slope, _, _ = airy(-self.argument)
        field = math.sqrt(math.pi) * (self.size * ai + 1j * self.skew * slope)
        with np.errstate(divide="ignore"):
            return Waves(
                self.time, np.log(np.abs(field)), self.phase - 0.25 * math.pi + np.angle(field)
            )


class Tails(NamedTuple):
    """Sound on the dark side of caustics, one row per caustic near a receiver."""

    link: Indices
    waves: Waves


def waves_of(arrivals: Arrivals, loss: TransmissionLoss) -> Waves:
    """Pressures from losses; each caustic reduces the phase by a quarter of a cycle."""
    size = -loss.total_db * math.log(10.0) / 20.0
    return Waves(
        arrivals.travel_time, size, loss.boundary_phase - 0.5 * math.pi * arrivals.caustics
    )


def fold_between(early: Waves, late: Waves, frequency_hz: float) -> Fold:
    """Fold of pairs of rays."""
    half = math.pi * frequency_hz * (late.time - early.time)
    x = np.maximum(1.5 * half, 1e-12) ** (2.0 / 3.0)
    a = np.exp(early.log_size)
    b = np.exp(late.log_size)
    return Fold(
        0.5 * (early.time + late.time), x, (a + b) * x**0.25, (b - a) * x**-0.25, early.phase
    )


def fold_pairs(arrivals: Arrivals, frequency_hz: float, widest: float) -> Indices:
    """
    Rows (n, 2) of the early and the late ray of folds up to a phase between them [rad], in
    ascending order of this phase.

    Both rays have the same reflections and adjacent launch angles, and the late ray has passed one
    more caustic.
    """
    keys = (arrivals.launch_angle, arrivals.bottom_bounces, arrivals.surface_bounces, arrivals.link)
    order = np.lexsort(keys)
    a = order[:-1]
    b = order[1:]
    late = arrivals.travel_time[a] > arrivals.travel_time[b]
    a, b = np.where(late, b, a), np.where(late, a, b)
    same = np.logical_and.reduce([key[a] == key[b] for key in keys[1:]])
    phase = 2.0 * math.pi * frequency_hz * (arrivals.travel_time[b] - arrivals.travel_time[a])
    fold = np.flatnonzero(
        same & (arrivals.caustics[b] == arrivals.caustics[a] + 1) & (phase < widest)
    )
    taken: set[int] = set()
    pairs = []
    for row in fold[np.argsort(phase[fold], kind="stable")].tolist():
        if taken.isdisjoint((a[row], b[row])):
            taken |= {int(a[row]), int(b[row])}
            pairs.append((a[row], b[row]))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def find_tails(
    medium: Medium,
    source: Array,
    receiver: Array,
    arrivals: Arrivals,
    frequency_hz: float,
    *,
    bounces: tuple[int, int] = (0, 0),
    bottom: Reflection | None = None,
    surface: Reflection | None = None,
    threads: int | None = None,
) -> Tails:
    r"""
    Find the sound of caustics whose dark side contains a receiver.

    Parameters
    ----------
    medium : Medium
    source, receiver : ndarray, shape (n_links, 3)
        Ends of links. [m]
    arrivals : Arrivals
        Eigenrays of these links.
    frequency_hz : float
        Centre of the signal's band. [Hz]
    bounces : tuple of int
        Maximum numbers of reflections of the rays of a caustic at the surface and at the sea bed.
    bottom, surface : Reflection, optional
        As in `transmission_loss`.
    threads : int, optional
        As in `find_eigenrays`.

    Returns
    -------
    Tails
        Sound without absorption.

    Notes
    -----
    Beside a fold, the argument x of Airy's function (see `received_loss_db`), :math:`(A_a + A_b)
    x^{1/4}`, :math:`(A_b - A_a) x^{-1/4}` and the mean time are smooth functions of depth. They are
    computed from the two rays at three depths inside the caustic (0.4, 0.7 and 1.4 widths; beside a
    cusp, where the fold is narrow, 0.2, 0.4 and 0.7) and extrapolated to the receiver, where x is
    negative: x and the time quadratically, because the phase needs a fraction of a cycle, the
    amplitudes linearly.

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.acoustics import Medium, find_eigenrays, find_tails
    >>> z = np.arange(0.0, 5001.0, 25.0)
    >>> eta = 2.0 * (z - 1300.0) / 1300.0
    >>> speed = 1500.0 * (1.0 + 0.00737 * (eta + np.exp(-eta) - 1.0))
    >>> water = Medium.from_profile(z, speed, bottom_depth=5000.0)
    >>> source, receiver = np.array([[0.0, 0.0, 300.0]]), np.array([[25e3, 0.0, 3150.0]])
    >>> arrivals = find_eigenrays(water, source, receiver)
    >>> tails = find_tails(water, source, receiver, arrivals, 200.0)
    >>> arrivals.link.size, tails.link.size
    (0, 1)
    """
    folds = _search(medium, source, receiver, arrivals, frequency_hz, bounces, threads)
    if not folds:
        return Tails(np.zeros(0, dtype=np.int64), Waves(*np.zeros((3, 0))))
    link = np.array([fold.link for fold in folds])
    place = np.array([[fold.edge + step * fold.width for step in _INSIDE] for fold in folds])
    n = _INSIDE.size
    ends = np.repeat(source[link], n, axis=0), np.repeat(receiver[link], n, axis=0)
    ends[1][:, 2] += place.ravel()
    rays = find_eigenrays(medium, *ends, *bounces, None, threads=threads)
    waves = waves_of(
        rays, transmission_loss(medium, *ends, rays, frequency_hz, bottom=bottom, surface=surface)
    )
    pairs = fold_pairs(rays, frequency_hz, _WIDEST)
    found: list[tuple[int, Fold]] = []
    for row, fold in enumerate(folds):
        at = [_nearest(rays, pairs, n * row + k, fold) for k in range(n)]
        for k in (1, 0):
            three = _nested(rays, pairs, at[k : k + 3])
            if three is not None:
                inside = fold_between(waves.at(three[:, 0]), waves.at(three[:, 1]), frequency_hz)
                found.append((fold.link, _continued(inside, place[row, k : k + 3])))
                break
    kept: list[tuple[int, Fold]] = []
    for link_row, fold_here in found:
        others = [other for i, other in kept if i == link_row]
        if -_FARTHEST < fold_here.argument[0] < 0.0 and not any(
            _equal(fold_here, o, frequency_hz) for o in others
        ):
            kept.append((link_row, fold_here))
    columns = [np.array([getattr(fold, name)[0] for _, fold in kept]) for name in Fold._fields]
    return Tails(np.array([i for i, _ in kept], dtype=np.int64), Fold(*columns).wave())


class _Edge(NamedTuple):
    """Edge of a caustic near a receiver."""

    link: int
    edge: float
    """Depth relative to the receiver. [m]"""
    width: float
    """Width of the caustic, with the sign of the direction to the lit side. [m]"""
    bounces: tuple[int, int]
    angle: float
    """Launch angle of the rays there. [rad]"""


def _search(
    medium: Medium,
    source: Array,
    receiver: Array,
    arrivals: Arrivals,
    frequency_hz: float,
    bounces: tuple[int, int],
    threads: int | None,
) -> list[_Edge]:
    """Edges of caustics with receivers on their dark side."""
    n = len(source)
    steps = _OFFSETS * _WIDTH * (_WIDTH_HZ / frequency_hz) ** (2.0 / 3.0)
    offset = np.concatenate([steps, -steps])
    link = np.tile(np.arange(n), offset.size)
    place = receiver[link] + np.repeat(offset, n)[:, None] * _DOWN
    rays = find_eigenrays(medium, source[link], place, *bounces, None, threads=threads)
    pairs = fold_pairs(rays, frequency_hz, _WIDEST)
    groups: dict[int, list[Indices]] = {}
    for pair in pairs:
        groups.setdefault(int(rays.link[pair[0]]), []).append(pair)
    edges: list[_Edge] = []
    for i in range(n):
        for side in (0, _OFFSETS.size):
            for k in range(side, side + _OFFSETS.size - 1):
                near = groups.get(k * n + i, [])
                far = groups.get((k + 1) * n + i, [])
                new = [
                    edge
                    for a in near
                    for b in far
                    if (edge := _edge(rays, (a, b), (offset[k], offset[k + 1]), frequency_hz, i))
                    is not None
                    and not _has_rays(arrivals, edge, rays.launch_angle[a])
                    and not any(_same(edge, other) for other in edges)
                ]
                edges += new
    return edges


def _edge(
    rays: Arrivals,
    pairs: tuple[Indices, Indices],
    offsets: tuple[float, float],
    frequency_hz: float,
    link: int,
) -> _Edge | None:
    """
    Edge from the same fold at two places, the nearer first; None for two different folds, or if the
    dark side is elsewhere.
    """
    a, b = pairs
    counts = [
        (int(rays.surface_bounces[p[0]]), int(rays.bottom_bounces[p[0]]), int(rays.caustics[p[0]]))
        for p in pairs
    ]
    if counts[0] != counts[1] or not _contains(rays, b, a):
        return None
    x, y = (
        (1.5 * math.pi * frequency_hz * float(rays.travel_time[p[1]] - rays.travel_time[p[0]]))
        ** (2.0 / 3.0)
        for p in pairs
    )
    width = (offsets[1] - offsets[0]) / (y - x) if y > x else 0.0
    edge = offsets[0] - x * width
    if width == 0.0 or edge * width < 0.0 or edge / width > _FARTHEST:
        return None
    return _Edge(link, edge, width, counts[0][:2], float(rays.launch_angle[a].mean()))


def _contains(rays: Arrivals, outer: Indices, inner: Indices) -> bool:
    """True if the launch angles of a fold enclose those of the same fold nearer to its caustic."""
    far = rays.launch_angle[outer]
    near = rays.launch_angle[inner]
    return bool(far.min() <= near.min() and near.max() <= far.max())


def _has_rays(arrivals: Arrivals, edge: _Edge, angle: Array) -> bool:
    """True if a receiver has rays with the launch angles of a fold."""
    rows = (arrivals.link == edge.link) & (arrivals.surface_bounces == edge.bounces[0])
    rows &= (arrivals.bottom_bounces == edge.bounces[1]) & (arrivals.launch_angle > angle.min())
    return bool((rows & (arrivals.launch_angle < angle.max())).any())


def _same(edge: _Edge, other: _Edge) -> bool:
    """True if two edges, found at different places, belong to one caustic."""
    near = abs(edge.edge - other.edge) < 0.5 * abs(edge.width)
    return (
        edge.link == other.link
        and edge.bounces == other.bounces
        and near
        and edge.width * other.width > 0.0
    )


def _equal(fold: Fold, other: Fold, frequency_hz: float) -> bool:
    """True if two folds, found at different places, are the same."""
    cycles = frequency_hz * abs(float(fold.time[0] - other.time[0]))
    return cycles < 0.2 and abs(float(fold.argument[0] - other.argument[0])) < 0.5


def _nearest(rays: Arrivals, pairs: Indices, link: int, edge: _Edge) -> int | None:
    """Pair of rays at a place that belongs to an edge, or None."""
    early = pairs[:, 0]
    fits = (rays.link[early] == link) & (rays.surface_bounces[early] == edge.bounces[0])
    fits &= rays.bottom_bounces[early] == edge.bounces[1]
    at = np.flatnonzero(fits)
    if not at.size:
        return None
    apart = np.abs(rays.launch_angle[pairs[at]].mean(axis=1) - edge.angle)
    return int(at[np.argmin(apart)])


def _nested(rays: Arrivals, pairs: Indices, at: list[int | None]) -> Indices | None:
    """
    Rows (3, 2) of the rays of a fold at three places, from its caustic inwards; None if they do not
    belong to one fold.
    """
    rows = np.array([row for row in at if row is not None], dtype=np.int64)
    chosen = pairs[rows]
    if rows.size < len(at) or not all(
        _contains(rays, far, near) for near, far in itertools.pairwise(chosen)
    ):
        return None
    return chosen


def _continued(inside: Fold, place: Array) -> Fold:
    """
    Fold at offset 0 from three places: time and argument are extrapolated quadratically, the others
    linearly from the last two.
    """
    share = place[2] / (place[2] - place[1])
    size, skew = (
        np.array([share * c[1] + (1.0 - share) * c[2]]) for c in (inside.size, inside.skew)
    )
    others = [(place[[1, 2]], place[0]), (place[[0, 2]], place[1]), (place[[0, 1]], place[2])]
    weight = [float(np.prod(a / (a - b))) for a, b in others]
    time, argument = (np.array([np.dot(weight, c)]) for c in (inside.time, inside.argument))
    return Fold(time, argument, size, skew, inside.phase[:1])
