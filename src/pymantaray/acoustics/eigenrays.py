"""
Find all eigenrays between pairs of positions, in threads.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Generator
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.levels.rough import Ends, realized, with_rough_rays
from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.near_ends import (
    of_one_instrument,
    separated,
    with_direct_rays,
    with_echoes,
)
from pymantaray.acoustics.solving import as_positions, solve_on_processor
from pymantaray.arrays import Array
from pymantaray.errors import AcousticsError
from pymantaray.geometry.sphere import EarthSphere
from pymantaray.jobs.progress import CountProgress
from pymantaray.records import Arrivals

if TYPE_CHECKING:
    from pymantaray.acoustics._kernels.layout import Results

T = TypeVar("T")


def find_eigenrays(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    max_surface_bounces: int = 0,
    max_bottom_bounces: int = 0,
    spreading_cutoff_db: float | None = 15.0,
    *,
    tolerance: float = 1e-3,
    canonical: bool = True,
    threads: int | None = None,
    progress: CountProgress | None = None,
) -> Arrivals:
    """
    Find all eigenrays between pairs of positions.

    Parameters
    ----------
    medium : Medium
        Sound speed and bathymetry, and the shape of the Earth.
    source, receiver : array_like, shape (n_links, 3) or (3,)
        Positions ``(north, east, down)`` in the local frame. [m]
    max_surface_bounces, max_bottom_bounces : int
        Maximum numbers of reflections of an arrival, up to 15 each. The surface is flat or the
        underside of ice. Ice and sea bed are bilinear between grid points. All boundaries reflect
        without loss.
    spreading_cutoff_db : float or None
        Eigenrays weaker than spherical spreading over the straight distance by more than this are
        discarded, except on links shorter than 1 m, whose echoes return to one instrument. None
        keeps every ray. [dB]
    tolerance : float
        Allowed error of the integration at the end of a ray. [m]
    canonical : bool
        Solve each link from its deeper end, so that travel times are reciprocal to the last digit,
        and from the other end as well if the search is not complete. False solves from the source
        only (for tests of reciprocity).
    threads : int, optional
        Number of threads; the result does not depend on it. Default: all processors.
    progress : callable, optional
        Called after each block with the number of solved links and the total.

    Returns
    -------
    Arrivals
        One row per eigenray, by link and travel time, and the outcome of each link. The direct ray
        between equal positions has travel time 0 and slowness NaN; its echoes are rays as others.
        ``complete`` is False for a link if intervals of launch angles that may contain more rays
        could not be resolved from either end; without an arrival, its status is then UNRESOLVED.

    Raises
    ------
    AcousticsError
        If positions are not finite, the shapes differ, or a number of bounces is out of range.

    Warns
    -----
    RuntimeWarning
        If a link has more eigenrays than are stored (64), as on the axis of a piecewise linear
        duct.

    Notes
    -----
    Rays of a fan are integrated with their derivatives by the launch angle. Intervals of the fan
    are halved until each contains one root of the miss distance or none. Newton's method, with
    horizontal refraction, refines the roots. The contribution of the remaining miss is removed from
    the travel time (Fermat).

    On a spherical Earth rays run in flattened water (see `pymantaray.geometry.EarthSphere`). Travel
    times and angles are then those of the sphere, slowness vectors are the gradients by the
    positions in the frame, and spreading and miss are those of flattened water (their difference is
    below 0.001 dB at 1 km depth).

    Examples
    --------
    >>> from pymantaray import Medium, find_eigenrays
    >>> medium = Medium.from_profile([0, 100, 1000], [1450.0, 1460.0, 1475.0], bottom_depth=1000.0)
    >>> arrivals = find_eigenrays(medium, [0, 0, 50], [3000, 0, 400], max_surface_bounces=1)
    >>> print(arrivals.travel_time.round(4), arrivals.surface_bounces)
    [2.0659 2.0774] [0 1]
    """
    a = as_positions("source", source)
    b = as_positions("receiver", receiver)
    if a.shape != b.shape:
        raise AcousticsError(
            f"source has shape {a.shape}, receiver {b.shape}; they must be equal: repeat a single"
            " position for every link"
        )
    if not (tolerance > 0.0 and math.isfinite(tolerance)):
        raise AcousticsError(f"tolerance is {tolerance}; it must be a positive length in metres")
    from pymantaray.acoustics._kernels.layout import MAX_BOUNCES

    for name, number in (
        ("max_surface_bounces", max_surface_bounces),
        ("max_bottom_bounces", max_bottom_bounces),
    ):
        if number not in range(MAX_BOUNCES + 1):
            raise AcousticsError(
                f"{name} is {number!r}; it must be a whole number from 0 to {MAX_BOUNCES}"
            )
    cutoff = math.inf if spreading_cutoff_db is None else float(spreading_cutoff_db)
    apart, near = separated(medium, a, b)
    ends = Ends(a, apart, (int(max_surface_bounces), int(max_bottom_bounces)), cutoff)
    options: dict[str, Any] = {"tolerance": float(tolerance), "canonical": canonical}
    find = _solved if medium.surface.roughness is None else _under_rough_surface
    arrivals = find(medium, ends, threads=threads, progress=progress, **options)
    arrivals = with_direct_rays(arrivals, a, b, near)
    own = (
        of_one_instrument(a, b)
        if cutoff < math.inf and any(ends.bounces)
        else np.empty(0, dtype=np.intp)
    )
    if not own.size:
        return arrivals
    echoes = find_eigenrays(medium, a[own], b[own], *ends.bounces, None, threads=threads, **options)
    return with_echoes(arrivals, own, echoes)


def _solved(
    medium: Medium,
    links: Ends,
    *,
    tolerance: float,
    canonical: bool,
    threads: int | None,
    progress: CountProgress | None,
) -> Arrivals:
    """Solve links whose ends differ under a smooth surface, block by block."""
    from pymantaray.acoustics._kernels.layout import Settings
    from pymantaray.acoustics.both_ends import merged, unresolved_links, without_certificate

    a, b, most, cutoff = links
    bounces = most if any(most) else None
    settings = Settings(cutoff, tolerance, canonical, shallower=False)
    solve = partial(solve_on_processor, threads=threads)
    domain = medium.domain()
    ends = (a, b) if medium.earth is None else medium.earth.flattened_ends(a, b)
    results = _collected(solve(domain, bounces, settings, *ends), len(a), progress)
    unresolved = unresolved_links(results)
    if canonical and unresolved.size:
        other = settings._replace(shallower=True)
        again = solve(domain, None, other, ends[0][unresolved], ends[1][unresolved])
        results = merged(results, unresolved, _collected(again, unresolved.size, None))
    arrivals = _arrivals(without_certificate(results))
    return (
        arrivals if medium.earth is None else _on_sphere(arrivals, medium.earth, a[:, 2], b[:, 2])
    )


def _collected(
    solving: Generator[Results, None, None], n_links: int, progress: CountProgress | None
) -> Results:
    """Results of all blocks."""
    blocks: list[Results] = []
    done = 0
    with closing(solving):
        for block in solving:
            blocks.append(block)
            done += block.counts.size
            if progress is not None:
                progress(done, n_links)
    return type(blocks[0])(*(np.concatenate(columns) for columns in zip(*blocks, strict=True)))


def _on_sphere(arrivals: Arrivals, earth: EarthSphere, source: Array, receiver: Array) -> Arrivals:
    """
    Arrivals of flattened water at true depths [m]: gradients by the positions in the frame, and
    true sound speeds.
    """
    values: dict[str, Array] = {}
    for end, depth in (("source", source), ("receiver", receiver)):
        stretch = earth.stretch(depth)
        slowness = getattr(arrivals, f"{end}_slowness").copy()
        slowness[:, 2] *= stretch[arrivals.link]
        values[f"{end}_slowness"] = slowness
        values[f"{end}_sound_speed"] = getattr(arrivals, f"{end}_sound_speed") / stretch
    return replace(arrivals, **values)


def _under_rough_surface(
    medium: Medium, ends: Ends, *, threads: int | None, **options: Any
) -> Arrivals:
    """
    Find the eigenrays of links under a rough surface; rays that do not meet the surface are those
    under its mean depth.
    """
    flat = replace(medium, surface=medium.surface.with_roughness(None))
    if ends.bounces[0] == 0 or not len(ends.source):
        return find_eigenrays(
            flat, *ends[:2], *ends.bounces, ends.cutoff_db, threads=threads, **options
        )
    flat_bed = bool((medium.bed.depth == medium.bed.depth[0, 0]).all())
    if not (medium.uniform and flat_bed):
        return find_eigenrays(
            realized(medium, ends),
            *ends[:2],
            *ends.bounces,
            ends.cutoff_db,
            threads=threads,
            **options,
        )
    direct = find_eigenrays(
        flat, *ends[:2], 0, ends.bounces[1], ends.cutoff_db, threads=threads, **options
    )
    return with_rough_rays(medium, ends, direct, solved_backwards(*ends[:2]), threads)


def _arrivals(results: Results) -> Arrivals:
    from pymantaray.acoustics._kernels import layout

    table = results.rows
    info = results.info
    short = int(np.count_nonzero(info[:, layout.COMPLETE] == 0.0))
    if short:
        warnings.warn(
            f"{short} of {len(info)} links have more eigenrays than are stored; the latest or"
            " shallowest are omitted",
            RuntimeWarning,
            stacklevel=3,
        )
    source = layout.SOURCE_SLOWNESS
    receiver = layout.RECEIVER_SLOWNESS
    return Arrivals(
        link=np.repeat(np.arange(len(info)), results.counts),
        travel_time=table[:, layout.TRAVEL_TIME],
        surface_bounces=table[:, layout.SURFACE_BOUNCES],
        bottom_bounces=table[:, layout.BOTTOM_BOUNCES],
        turning_points=table[:, layout.TURNING_POINTS],
        caustics=table[:, layout.CAUSTICS],
        launch_angle=table[:, layout.LAUNCH_ANGLE],
        arrival_angle=table[:, layout.ARRIVAL_ANGLE],
        spreading_db=table[:, layout.SPREADING_DB],
        source_slowness=table[:, source : source + 3],
        receiver_slowness=table[:, receiver : receiver + 3],
        ray_axis=table[:, layout.RAY_AXIS],
        status=results.status,
        chord_travel_time=info[:, layout.CHORD_TIME],
        source_sound_speed=info[:, layout.SOURCE_SPEED],
        receiver_sound_speed=info[:, layout.RECEIVER_SPEED],
        shadow_margin=info[:, layout.MARGIN],
        complete=info[:, layout.RESOLVED] > 0.0,
    )


def solved_backwards(source: Array, receiver: Array) -> NDArray[np.bool_]:
    """
    True for each link that the solver starts from the receiver: the deeper end (ties: north, east).
    """
    down, north, east = (source[:, k] - receiver[:, k] for k in (2, 0, 1))
    return np.where(down != 0.0, down < 0.0, np.where(north != 0.0, north < 0.0, east < 0.0))
