"""Two-point travel times: all eigenrays between pairs of positions."""

import math
import warnings
from collections.abc import Callable
from contextlib import closing
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.solvers import Device, Solved, on_cuda, solve_on_cuda, solve_on_processor
from pymantaray.errors import AcousticsError
from pymantaray.records import Arrivals

Array = NDArray[np.float64]


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
    device: Device = "auto",
    progress: Callable[[int, int], None] | None = None,
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
        Reflections that an arrival may have, at most 15 each. The surface is flat, the sea bed bilinear between
        grid points; both reflect without loss.
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
    device : {"auto", "cpu", "cuda"}
        Where to solve. "auto" takes a CUDA device, where there is one, for 50,000 links or more; its last
        digits differ from the processor's.
    progress : callable, optional
        Called after each block with the number of links solved and of all links.

    Returns
    -------
    Arrivals
        One row per eigenray, by link and travel time, and the outcome of each link. Equal positions have
        travel time 0 and slowness NaN.

    Raises
    ------
    AcousticsError
        If positions are not finite, the shapes do not fit, a number of bounces is not allowed, or there
        is no CUDA device.

    Warns
    -----
    RuntimeWarning
        If a link has more eigenrays than are kept (64), as on the axis of a piecewise linear duct.

    Notes
    -----
    A fan of rays, integrated with their variation by the launch angle, is subdivided until each interval
    holds one root of the miss distance or none; roots are polished by Newton's method with horizontal
    refraction included; the remaining miss is taken off the travel time to first order (Fermat).
    """
    a, b = as_positions("source", source), as_positions("receiver", receiver)
    if a.shape != b.shape:
        raise AcousticsError(f"source has shape {a.shape}, receiver {b.shape}; they must be equal")
    if not (tolerance > 0.0 and math.isfinite(tolerance)):
        raise AcousticsError(f"tolerance: {tolerance}; a positive length in metres is needed")
    from pymantaray.acoustics._kernels.trace import MOST_BOUNCES

    for name, bounces in (
        ("max_surface_bounces", max_surface_bounces),
        ("max_bottom_bounces", max_bottom_bounces),
    ):
        if bounces not in range(MOST_BOUNCES + 1):
            raise AcousticsError(f"{name}: {bounces!r}; a whole number from 0 to {MOST_BOUNCES} is needed")
    cutoff = math.inf if spreading_cutoff_db is None else float(spreading_cutoff_db)
    most = (int(max_surface_bounces), int(max_bottom_bounces))
    settings = (most if any(most) else None, cutoff, float(tolerance), canonical)
    solve = solve_on_cuda if on_cuda(device, len(a)) else partial(solve_on_processor, threads=threads)
    blocks: list[Solved] = []
    done = 0
    with closing(solve(medium, a, b, settings)) as solving:
        for block in solving:
            blocks.append(block)
            done += block.counts.size
            if progress is not None:
                progress(done, len(a))
    solved = Solved(*(np.concatenate(columns) for columns in zip(*blocks, strict=True)))
    blocks.clear()  # at most two copies of the result at a time
    return _arrivals(solved)


def _arrivals(solved: Solved) -> Arrivals:
    table, info = solved.rows, solved.info
    short = int(np.count_nonzero(info[:, 5] == 0.0))
    if short:
        warnings.warn(
            f"{short} of {len(info)} links have more eigenrays than are kept; the latest or shallowest are left out",
            RuntimeWarning,
            stacklevel=3,
        )
    return Arrivals(
        link=np.repeat(np.arange(len(info)), solved.counts),
        travel_time=table[:, 0],
        surface_bounces=table[:, 11],
        bottom_bounces=table[:, 12],
        turning_points=table[:, 4],
        launch_angle=table[:, 1],
        arrival_angle=table[:, 2],
        spreading_db=table[:, 3],
        source_slowness=table[:, 5:8],
        receiver_slowness=table[:, 8:11],
        status=solved.status,
        chord_travel_time=info[:, 0],
        source_sound_speed=info[:, 1],
        receiver_sound_speed=info[:, 2],
        shadow_margin=info[:, 3],
    )


def solved_backwards(source: Array, receiver: Array) -> NDArray[np.bool_]:
    """
    Whether the solver starts from the receiver: a link is solved from its deeper end (ties: north, east).

    Parameters
    ----------
    source, receiver : ndarray, shape (n_links, 3)
        [m]

    Returns
    -------
    ndarray of bool, shape (n_links,)
    """
    down, north, east = (source[:, k] - receiver[:, k] for k in (2, 0, 1))
    return np.where(down != 0.0, down < 0.0, np.where(north != 0.0, north < 0.0, east < 0.0))


def as_positions(name: str, values: ArrayLike) -> Array:
    """
    Positions as an array of floats, checked.

    Parameters
    ----------
    name : str
        For messages.
    values : array_like, shape (n_links, 3) or (3,)
        [m]

    Returns
    -------
    ndarray, shape (n_links, 3)

    Raises
    ------
    AcousticsError
        If the shape is another or a coordinate is not finite.
    """
    points = np.atleast_2d(np.array(values, dtype=float))
    if points.ndim != 2 or points.shape[1] != 3:
        raise AcousticsError(f"{name}: shape {points.shape}; needs (n_links, 3): north, east, down in metres")
    if not np.all(np.isfinite(points)):
        raise AcousticsError(f"{name}: {np.count_nonzero(~np.isfinite(points))} coordinates are not finite")
    return points
