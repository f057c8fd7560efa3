"""
Eigenrays under a rough surface: by skips in horizontally uniform water, which takes a tenth of the
time of the general solver or less (benchmarks/bench_rough.py), and by that solver in other water.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.records import Arrivals, RayStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from pymantaray.acoustics._kernels.skips import SkipLink, SkipWater
    from pymantaray.acoustics.medium import Medium
    from pymantaray.geometry.sphere import EarthSphere

_ZONE = 0.5  # m; spacing of levels above the deck
# depths below the deck, and spacing [m]
_LEVELS = ((150.0, 1.0), (400.0, 2.0), (1500.0, 10.0), (math.inf, 25.0))
_MARGIN = 0.1  # m between the deepest possible surface and the deck
_TABLE = 7500
_STEEPEST = 1.5  # rad; of a table, and of the fan
_SPACING = 5e-4  # rad
_MIN_SPACING = 2e-5
_MAX_RAYS = 512  # of a link
_POINTS_PER_LENGTH = 10.0
_KEPT = 64  # of a link, the strongest
_BEYOND = 0.01  # rad
_GRID_POINTS_PER_LENGTH = 3.0
_MAX_NODES = 4_000_000


class Ends(NamedTuple):
    """
    Links: positions of both ends (n, 3) [m], most reflections at surface and sea bed, and cut-off
    [dB].
    """

    source: Array
    receiver: Array
    bounces: tuple[int, int]
    cutoff_db: float


class SurfaceProfile(NamedTuple):
    """
    Depth of the rough surface as a function of north and east, flattened on a spherical Earth, and
    the spacing at which it is sampled. [m]
    """

    depth: Callable[[Array, Array], Array]
    spacing: float


def with_rough_rays(
    medium: Medium, ends: Ends, direct: Arrivals, turned: NDArray[np.bool_], threads: int | None
) -> Arrivals:
    """
    Add the eigenrays with reflections at a rough surface to those without any.

    Parameters
    ----------
    medium : Medium
        Horizontally uniform water over a flat sea bed, on a flat or spherical Earth.
    ends : Ends
    direct : Arrivals
        Eigenrays of the links without a reflection at the surface.
    turned : ndarray of bool, shape (n_links,)
        True for each link that is solved from its receiver, so both directions give the same rays.
    threads : int, optional
        Number of threads; the result does not depend on it.

    Notes
    -----
    Rays stay in the vertical plane of their link: slopes of the surface across it have no effect.
    The spreading across the plane is that of a flat surface. Rays are refined to 0.1 mm, and their
    times are those of levels 1 m apart in the upper 150 m. Rays in windows of launch angles that
    are narrower than 2e-5 rad may be missing. At most 64 rays of a link, the strongest, are kept.
    """
    from pymantaray.acoustics._kernels.skips import N_RAY, RATE, find_skips

    water = skip_water(medium, ends.bounces[1])
    pair = ends[:2] if medium.earth is None else medium.earth.flattened_ends(*ends[:2])
    a = np.where(turned[:, None], pair[1], pair[0])
    b = np.where(turned[:, None], pair[0], pair[1])
    horizontal = np.hypot(*(b - a)[:, :2].T)
    surface = _surface_of(medium)
    steepest = min(_steepest(water, ends.bounces[1]), _STEEPEST)

    def solve(i: int) -> tuple[Array, float]:
        if direct.status[i] == RayStatus.OUTSIDE or not horizontal[i] > 0.0:
            return np.empty((0, N_RAY)), 1.0
        link = _link(surface, a[i], b[i], ends.bounces)
        length = float(np.linalg.norm(b[i] - a[i]))
        weak = length * 10.0 ** (0.1 * min(ends.cutoff_db, 60.0) + 0.3)
        rows = np.empty((_MAX_RAYS, N_RAY))
        work = np.empty((60, N_RAY))
        speed = np.interp((a[i, 2], b[i, 2]), water.depth, water.speed)
        cosine = min(math.cos(steepest) * speed[0] / water.speed[water.deck], 1.0)
        straight = math.atan((a[i, 2] + b[i, 2]) / link.length)  # one reflection without refraction
        tilt = 2.0 * float(np.abs(link.pieces[:, 1]).max())
        most = min(max(math.acos(cosine), straight) + tilt + _BEYOND, _STEEPEST)
        n = find_skips(water, link, (-most, most, _SPACING, _MIN_SPACING), weak, rows, work)
        spreading = _spreading_db(rows[:n], link.length, length, speed)
        kept = np.flatnonzero(spreading <= ends.cutoff_db)
        kept = kept[np.argsort(spreading[kept], kind="stable")[:_KEPT]]
        rows = rows[kept]
        rows[:, RATE] = spreading[kept]
        return rows, float(speed[0] / speed[1])

    with ThreadPoolExecutor(threads) as pool:
        solved = [rows for rows, _ in pool.map(solve, range(len(a)))]
    return _joined(direct, solved, (a, b), turned, water, medium.earth)


def _joined(
    direct: Arrivals,
    solved: list[Array],
    ends: tuple[Array, Array],
    turned: NDArray[np.bool_],
    water: SkipWater,
    earth: EarthSphere | None,
) -> Arrivals:
    """Arrivals without and with reflections at the surface, by link and time."""
    from pymantaray.acoustics._kernels import skips as at

    link = np.repeat(np.arange(len(solved)), [len(rows) for rows in solved])
    rows = np.concatenate(solved)
    a, b = ends
    unit = (b - a)[:, :2] / np.maximum(np.hypot(*(b - a)[:, :2].T), 1e-300)[:, None]

    def slowness(angle: Array, depth: Array) -> Array:
        speed: Array = np.interp(depth, water.depth, water.speed)[link]
        along = np.cos(angle)[:, None] * unit[link]
        return np.concatenate([along, np.sin(angle)[:, None]], axis=1) / speed[:, None]

    def in_true_water(slowness: Array, depth: Array) -> Array:
        if earth is not None:
            slowness[:, 2] *= earth.stretch(earth.true_depth(depth))[link]
        return slowness

    first = slowness(rows[:, at.ANGLE], a[:, 2])
    last = slowness(rows[:, at.END_ANGLE], b[:, 2])
    # the vertical slowness times the remaining miss in depth corrects the time
    travel_time = rows[:, at.TRAVEL] - last[:, 2] * rows[:, at.MISS]
    first, last = in_true_water(first, a[:, 2]), in_true_water(last, b[:, 2])
    back = turned[link]
    launch = np.where(back, -rows[:, at.END_ANGLE], rows[:, at.ANGLE])
    more: dict[str, Any] = {
        "link": link,
        "travel_time": travel_time,
        "surface_bounces": rows[:, at.SURFACES].astype(np.int64),
        "bottom_bounces": rows[:, at.BOTTOMS].astype(np.int64),
        "turning_points": rows[:, at.TURNED].astype(np.int64),
        "caustics": np.zeros(link.size, dtype=np.int64),
        "launch_angle": launch,
        "arrival_angle": np.where(back, -rows[:, at.ANGLE], rows[:, at.END_ANGLE]),
        "spreading_db": rows[:, at.RATE],
        "source_slowness": np.where(back[:, None], -last, first),
        "receiver_slowness": np.where(back[:, None], -first, last),
        "ray_axis": np.zeros(link.size),
    }
    has = np.bincount(link, minlength=direct.status.size) > 0
    return replace(
        direct.with_more(more),
        status=np.where(has, np.int8(RayStatus.OK), direct.status),
        shadow_margin=np.where(has, 0.0, direct.shadow_margin),
    )


def skip_water(medium: Medium, most_bottom: int) -> SkipWater:
    """Levels and table of skips of horizontally uniform water, flattened on a spherical Earth."""
    from pymantaray.acoustics._kernels.skips import SkipWater, fill_table

    surface = medium.surface
    reach = 0.0 if surface.roughness is None else surface.roughness.reach
    deck = float(surface.depth.max()) + reach + _MARGIN
    bed = float(medium.bed.depth[0, 0])
    if bed < deck + 1.0:
        raise AcousticsError(
            f"rough surface: it reaches {deck:g} m, but the sea bed is at {bed:g} m"
        )
    own = medium.depth[(medium.depth > deck + 1e-3) & (medium.depth < bed - 1e-3)]
    earth = medium.earth
    if earth is not None:
        own = earth.flattened_depth(own)
        deck, bed = earth.flattened_depth([deck, bed]).tolist()
    n = max(math.ceil(deck / _ZONE), 1)
    levels = []
    z = deck
    for below, spacing in _LEVELS:
        stop = min(deck + below, bed)
        levels.append(np.arange(z, stop, spacing))
        z = stop if stop == bed else float(levels[-1][-1]) + spacing
        if stop == bed:
            break
    lower = np.unique(np.concatenate([*levels, own, [bed]]))
    lower = lower[np.append(True, np.diff(lower) > 1e-6)]
    depth = np.concatenate([np.linspace(0.0, deck, n, endpoint=False), lower])
    speed = _speed_at(medium, depth)
    table = np.zeros((4, _TABLE))
    water = SkipWater(
        depth, np.ascontiguousarray(speed), n, deck / n, bed, table, _STEEPEST / (_TABLE - 3)
    )
    fill_table(water, most_bottom)
    return water


def _speed_at(medium: Medium, depth: Array) -> Array:
    """Sound speed of the water without ice at depths, both flattened on a spherical Earth."""
    open_water = replace(medium, surface=BoundarySurface(0.0))
    earth = medium.earth
    places = np.zeros((depth.size, 3))
    places[:, :2] = medium.north[0], medium.east[0]
    places[:, 2] = depth if earth is None else earth.true_depth(depth)
    speed = open_water.sound_speed_at(places)
    return speed if earth is None else speed * earth.stretch(places[:, 2])


def _steepest(water: SkipWater, most_bottom: int) -> float:
    """Steepest angle at the deck of a ray that may come back to it."""
    if most_bottom > 0:
        return _STEEPEST
    fastest = float(water.speed[water.deck :].max())
    return math.acos(min(float(water.speed[water.deck]) / fastest, 1.0))


def _surface_of(medium: Medium) -> SurfaceProfile:
    """Rough surface of a medium."""
    surface = medium.surface
    roughness = medium.surface.roughness
    earth = medium.earth

    def depth(north: Array, east: Array) -> Array:
        mean = surface.depth_at(np.stack([north, east], axis=-1))
        rough = 0.0 if roughness is None else roughness.elevation_at(north, east)
        true = np.maximum(mean + rough, 0.0)
        return true if earth is None else earth.flattened_depth(true)

    if roughness is not None:
        roughness.elevation_at(0.0, 0.0)  # the draw is made before the threads start
    depth(np.zeros(1), np.zeros(1))
    length = np.inf if roughness is None else roughness.length
    steps = [float(np.diff(x).min()) for x in (surface.north, surface.east) if x.size > 1]
    return SurfaceProfile(
        depth, min([length / _POINTS_PER_LENGTH, 20.0, *(0.5 * step for step in steps)])
    )


def _link(surface: SurfaceProfile, a: Array, b: Array, bounces: tuple[int, int]) -> SkipLink:
    """Link with the surface along it."""
    from pymantaray.acoustics._kernels.skips import SkipLink

    length = float(np.hypot(*(b - a)[:2]))
    n = max(math.ceil(length / surface.spacing), 8) + 1
    share = np.linspace(0.0, 1.0, n)
    depth = surface.depth(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
    spacing = length / (n - 1)
    rise = spacing * np.gradient(depth, spacing, edge_order=2)
    return SkipLink(
        float(a[2]), float(b[2]), length, _pieces(depth, rise, spacing), spacing, *bounces
    )


def _pieces(depth: Array, rise: Array, spacing: float) -> Array:
    """
    Cubic Hermite polynomials between points by the range, and the greatest Bernstein coefficient
    of each, which bounds its depth.
    """
    start, end = depth[:-1], depth[1:]
    first, last = rise[:-1], rise[1:]
    square = (3.0 * (end - start) - 2.0 * first - last) / spacing**2
    cube = (2.0 * (start - end) + first + last) / spacing**3
    deepest = np.max([start, start + first / 3.0, end - last / 3.0, end], axis=0)
    return np.ascontiguousarray(np.stack([start, first / spacing, square, cube, deepest], axis=1))


def _spreading_db(
    rows: Array, horizontal: float, distance: float, speed: tuple[float, float]
) -> Array:
    """Spreading of rays beyond spherical, in a plane and with spreading across it by the range."""
    from pymantaray.acoustics._kernels import skips as at

    first = np.cos(rows[:, at.ANGLE])
    last = np.cos(rows[:, at.END_ANGLE])
    area = horizontal * np.abs(rows[:, at.RATE]) * last / first
    ratio = speed[0] / speed[1] * np.maximum(area, 1e-300) / distance**2
    return np.asarray(10.0 * np.log10(ratio))


def realized(medium: Medium, ends: Ends) -> Medium:
    """Medium with its rough surface on a grid about the links, for the general solver."""
    roughness = medium.surface.roughness
    assert roughness is not None
    both = np.concatenate([ends.source, ends.receiver])[:, :2]
    step = roughness.length / _GRID_POINTS_PER_LENGTH
    low = both.min(axis=0) - 20.0 * step
    high = both.max(axis=0) + 20.0 * step
    for k, axis in enumerate((medium.north, medium.east)):
        if axis.size > 1:  # a boundary must cover the water
            low[k] = axis[0]
            high[k] = axis[-1]
    sizes = np.ceil((high - low) / step).astype(int) + 1
    if np.prod(sizes.astype(float)) > _MAX_NODES:
        raise AcousticsError(
            f"rough surface: {sizes[0]} x {sizes[1]} grid points of {step:g} m; at most"
            f" {_MAX_NODES:,} are possible in water that varies horizontally or over a sea bed that"
            " does; use a smaller domain, a longer correlation length or a profile"
        )
    north, east = (np.linspace(low[k], high[k], sizes[k]) for k in range(2))
    mean = medium.surface.depth_at(
        np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1).reshape(-1, 2)
    )
    depth = mean.reshape(sizes) + roughness.elevation_at(north[:, None], east[None, :])
    surface = BoundarySurface(np.maximum(depth, 0.0), north, east, medium.surface.reflection)
    return replace(medium, surface=surface)
