"""The paths of rays: of the eigenrays that the solver found, and of a fan."""

import math
import threading
from contextlib import closing

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.blocks import in_blocks
from pymantaray.acoustics.eigenrays import as_positions, solved_backwards
from pymantaray.acoustics.medium import Medium
from pymantaray.errors import AcousticsError
from pymantaray.records import Arrivals, RayPaths

Array = NDArray[np.float64]
STEEPEST = 1.5  # rad; a ray of a fan may not be launched steeper
_NODE_COLUMNS = 8  # travel time, position, slowness, boundary
_LONGEST = 4  # paths of most nodes for which a thread has room


def trace_paths(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    arrivals: Arrivals,
    *,
    tolerance: float = 1e-3,
    threads: int | None = None,
) -> RayPaths:
    """
    Paths of eigenrays.

    Parameters
    ----------
    medium : Medium
    source, receiver : array_like, shape (n_links, 3) or (3,)
        The positions for which the arrivals were found. [m]
    arrivals : Arrivals
        From `find_eigenrays`, for the same medium and positions.
    tolerance : float
        As in `find_eigenrays`. [m]
    threads : int, optional
        Threads over blocks of arrivals; the result does not depend on it. Default: all processors.

    Returns
    -------
    RayPaths
        ``arrival`` is the row of ``arrivals``; from the source to the receiver. A ray between equal positions
        has one node.

    Raises
    ------
    AcousticsError
        If the positions do not fit the arrivals.
    """
    from pymantaray.acoustics._kernels.paths import trace_arrivals
    from pymantaray.acoustics._kernels.workspace import workspace

    a, b = as_positions("source", source), as_positions("receiver", receiver)
    if not a.shape == b.shape == (arrivals.status.size, 3):
        raise AcousticsError(
            f"source has shape {a.shape}, receiver {b.shape}; the arrivals are of {arrivals.status.size} links"
        )
    packed, bed = medium.packed(), medium.bed()
    backwards = solved_backwards(a, b)
    directions = np.array([_unit(step) for step in np.where(backwards[:, None], a - b, b - a)[:, :2]])
    ends, units, turned = (
        np.stack([a, b], axis=1)[arrivals.link],
        directions[arrivals.link],
        backwards[arrivals.link],
    )
    slowness = np.where(turned[:, None], -arrivals.receiver_slowness, arrivals.source_slowness)
    bounces = np.stack([arrivals.surface_bounces, arrivals.bottom_bounces], axis=-1, dtype=np.int64)
    counts = np.zeros(arrivals.link.size, dtype=np.int64)
    own = threading.local()

    def trace(start: int, stop: int) -> Array:
        if not hasattr(own, "work"):
            own.work = workspace(medium.depth.size)
            own.nodes = np.empty((_LONGEST * len(own.work.path), _NODE_COLUMNS))
        done: list[Array] = [own.nodes[:0]]
        while start < stop:
            part = slice(start, stop)
            traced = trace_arrivals(
                packed,
                bed,
                ends[part],
                units[part],
                turned[part],
                slowness[part],
                arrivals.travel_time[part],
                bounces[part],
                tolerance,
                own.work,
                own.nodes,
                counts[part],
            )
            done.append(own.nodes[: counts[start : start + traced].sum()].copy())
            start += traced
        return np.concatenate(done)

    with closing(in_blocks(trace, arrivals.link.size, threads=threads)) as blocks:
        table = np.concatenate(list(blocks))
    return _as_paths(table, counts)


def trace_fan(
    medium: Medium,
    source: ArrayLike,
    azimuth: float,
    launch_angles: ArrayLike,
    distance: float,
    *,
    max_surface_bounces: int = 0,
    max_bottom_bounces: int = 0,
    tolerance: float = 1e-3,
) -> RayPaths:
    """
    Paths of rays launched from one place in one vertical plane.

    Parameters
    ----------
    medium : Medium
    source : array_like, shape (3,)
        Position ``(north, east, down)``. [m]
    azimuth : float
        Direction of the plane, clockwise from north. [rad]
    launch_angles : array_like, shape (n_rays,)
        From the horizontal, positive down, at most 1.5 either way. [rad]
    distance : float
        Horizontal distance to which rays are traced; its end must lie in the medium's domain. [m]
    max_surface_bounces, max_bottom_bounces : int
        A ray ends where it would be reflected once more.
    tolerance : float
        As in `find_eigenrays`. [m]

    Returns
    -------
    RayPaths
        ``arrival`` is the number of the ray. Horizontal refraction takes rays out of the plane.

    Raises
    ------
    AcousticsError
        If the source or the end of the plane is outside the medium, an angle is too steep, or the distance is not
        positive.
    """
    from pymantaray.acoustics._kernels.paths import trace_launches
    from pymantaray.acoustics._kernels.workspace import workspace

    start = as_positions("source", source)
    angles = np.atleast_1d(np.array(launch_angles, dtype=float))
    if start.shape != (1, 3) or angles.ndim != 1:
        raise AcousticsError(f"source has shape {np.shape(source)}; a fan starts from one position (3,)")
    if not np.all(np.abs(angles) <= STEEPEST):
        raise AcousticsError(
            f"launch_angles: up to {np.max(np.abs(angles)):g} rad; a fan goes to {STEEPEST} rad from the horizontal"
        )
    if not (distance > 0.0 and math.isfinite(distance)):
        raise AcousticsError(f"distance: {distance}; a positive length in metres is needed")
    unit = np.array([math.cos(azimuth), math.sin(azimuth)])
    end = start[0] + distance * np.array([*unit, 0.0])
    for name, axis, k in (("north", medium.north, 0), ("east", medium.east, 1)):
        for place in (start[0], end):
            if axis.size > 1 and not axis[0] <= place[k] <= axis[-1]:
                raise AcousticsError(
                    f"fan: {name} {place[k]:g} m is outside the medium, {axis[0]:g} to {axis[-1]:g} m; shorten it"
                )
    bed = medium.bottom_depth(start)[0]
    if not 0.0 <= start[0, 2] <= bed:
        raise AcousticsError(f"source: depth {start[0, 2]:g} m; the water there reaches from 0 to {bed:g} m")
    packed, work = medium.packed(), workspace(medium.depth.size)
    nodes = np.empty((_LONGEST * len(work.path), _NODE_COLUMNS))
    counts = np.zeros(angles.size, dtype=np.int64)
    done, table = 0, [nodes[:0]]
    while done < angles.size:
        traced = trace_launches(
            packed,
            medium.bed(),
            start[0],
            (unit[0], unit[1]),
            float(distance),
            angles[done:],
            max_surface_bounces,
            max_bottom_bounces,
            tolerance,
            work,
            nodes,
            counts[done:],
        )
        table.append(nodes[: counts[done : done + traced].sum()].copy())
        done += traced
    return _as_paths(np.concatenate(table), counts)


def _unit(step: Array) -> tuple[float, float]:
    """Direction of a horizontal step, north for none."""
    length = math.hypot(*step)
    return (step[0] / length, step[1] / length) if length > 0.0 else (1.0, 0.0)


def _as_paths(table: Array, counts: NDArray[np.int64]) -> RayPaths:
    return RayPaths(
        arrival=np.repeat(np.arange(counts.size), counts),
        travel_time=table[:, 0],
        position=table[:, 1:4],
        slowness=table[:, 4:7],
        boundary=table[:, 7],
    )
