"""Two-point travel times: all direct eigenrays between pairs of positions."""

import math
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.medium import Medium
from pymantaray.errors import AcousticsError
from pymantaray.records import Arrivals

Array = NDArray[np.float64]
MAX_ARRIVALS = 64  # kept per link
BLOCK = 64  # links per task


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
) -> Arrivals:
    """
    All eigenrays between pairs of positions.

    Parameters
    ----------
    medium : Medium
        Sound speed and bathymetry.
    source, receiver : array_like, shape (n_links, 3) or (3,)
        Positions ``(north, east, down)`` in the local frame. [m]
    max_surface_bounces, max_bottom_bounces : int
        Reflections that an arrival may have. Only 0 is supported.
    spreading_cutoff_db : float or None
        Eigenrays weaker than spherical spreading by more than this are no arrivals. None keeps every ray.
        [dB]
    tolerance : float
        Error allowed at the end of a ray by the integration. [m]
    canonical : bool
        Solve each link from its deeper end, so that travel times are reciprocal to the last digit. False
        solves from the source as given (tests of reciprocity).
    threads : int, optional
        Threads over blocks of links; the result does not depend on it. Default: all processors.

    Returns
    -------
    Arrivals
        One row per eigenray, by link and travel time, and the outcome of each link. Equal positions have
        travel time 0 and slowness NaN.

    Raises
    ------
    AcousticsError
        If positions are not finite, the shapes do not fit, or bounces are asked for.

    Notes
    -----
    A fan of rays, integrated with their variation by the launch angle, is subdivided until each interval
    holds one root of the miss distance or none; roots are polished by Newton's method with horizontal
    refraction included; the remaining miss is taken off the travel time to first order (Fermat).
    """
    if max_surface_bounces or max_bottom_bounces:
        raise AcousticsError(
            f"max_surface_bounces {max_surface_bounces}, max_bottom_bounces {max_bottom_bounces}:"
            " only direct rays (0, 0) are supported"
        )
    a, b = _positions("source", source), _positions("receiver", receiver)
    if a.shape != b.shape:
        raise AcousticsError(f"source has shape {a.shape}, receiver {b.shape}; they must be equal")
    if not (tolerance > 0.0 and math.isfinite(tolerance)):
        raise AcousticsError(f"tolerance: {tolerance}; a positive length in metres is needed")
    from pymantaray.acoustics._kernels.link import N_COLUMNS, solve_links

    n = a.shape[0]
    rows = np.empty((n, MAX_ARRIVALS, N_COLUMNS))
    counts = np.zeros(n, dtype=np.int64)
    status = np.zeros(n, dtype=np.int8)
    info = np.empty((n, 5))
    cutoff = math.inf if spreading_cutoff_db is None else float(spreading_cutoff_db)
    packed = medium.packed()

    def solve(start: int) -> None:
        part = slice(start, min(start + BLOCK, n))
        solve_links(
            packed,
            medium.bathymetry,
            a[part],
            b[part],
            cutoff,
            tolerance,
            canonical,
            rows[part],
            counts[part],
            status[part],
            info[part],
        )

    starts = range(0, n, BLOCK)
    workers = min(threads or os.cpu_count() or 1, len(starts))
    if workers <= 1:
        for start in starts:
            solve(start)
    else:
        solve(0)  # compiles once before the threads start
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(solve, starts[1:]))
    table = rows[np.arange(MAX_ARRIVALS) < counts[:, None]]
    zeros = np.zeros(len(table), dtype=np.int16)
    return Arrivals(
        link=np.repeat(np.arange(n), counts),
        travel_time=table[:, 0],
        surface_bounces=zeros,
        bottom_bounces=zeros,
        turning_points=table[:, 4],
        launch_angle=table[:, 1],
        arrival_angle=table[:, 2],
        spreading_db=table[:, 3],
        source_slowness=table[:, 5:8],
        receiver_slowness=table[:, 8:11],
        status=status,
        chord_travel_time=info[:, 0],
        source_sound_speed=info[:, 1],
        receiver_sound_speed=info[:, 2],
        shadow_margin=info[:, 3],
    )


def _positions(name: str, values: ArrayLike) -> Array:
    points = np.atleast_2d(np.array(values, dtype=float))
    if points.ndim != 2 or points.shape[1] != 3:
        raise AcousticsError(f"{name}: shape {points.shape}; needs (n_links, 3): north, east, down in metres")
    if not np.all(np.isfinite(points)):
        raise AcousticsError(f"{name}: {np.count_nonzero(~np.isfinite(points))} coordinates are not finite")
    return points
