"""The paths of rays: of the eigenrays that the solver found, and of a fan."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.eigenrays import as_positions, solved_backwards
from pymantaray.acoustics.medium import Medium
from pymantaray.errors import AcousticsError
from pymantaray.records import Arrivals, RayPaths
from pymantaray.records.ray_paths import AT_SURFACE

Array = NDArray[np.float64]
STEEPEST = 1.5  # rad; a ray of a fan may not be launched steeper
_NODE_COLUMNS = 8  # travel time, position, slowness, boundary


def trace_paths(
    medium: Medium, source: ArrayLike, receiver: ArrayLike, arrivals: Arrivals, *, tolerance: float = 1e-3
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
    from pymantaray.acoustics._kernels.paths import trace_arrival
    from pymantaray.acoustics._kernels.workspace import workspace

    a, b = as_positions("source", source), as_positions("receiver", receiver)
    if not a.shape == b.shape == (arrivals.status.size, 3):
        raise AcousticsError(
            f"source has shape {a.shape}, receiver {b.shape}; the arrivals are of {arrivals.status.size} links"
        )
    packed, work = medium.packed(), workspace(medium.depth.size)
    turned = solved_backwards(a, b)
    rows: list[Array] = []
    for i, link in enumerate(arrivals.link):
        if not np.all(np.isfinite(arrivals.source_slowness[i])):
            rows.append(np.array([[0.0, *a[link], math.nan, math.nan, math.nan, 0.0]]))
            continue
        start, end, slowness = a[link], b[link], arrivals.source_slowness[i]
        if turned[link]:
            start, end, slowness = end, start, -arrivals.receiver_slowness[i]
        steps, c = trace_arrival(
            packed,
            medium.bathymetry,
            start,
            end,
            slowness,
            int(arrivals.surface_bounces[i]),
            int(arrivals.bottom_bounces[i]),
            tolerance,
            work,
        )
        nodes = _nodes(work.path[: steps + 1], start, end, c)
        nodes[-1, 0], nodes[-1, 1:4] = arrivals.travel_time[i], end
        if turned[link]:
            nodes = nodes[::-1].copy()
            nodes[:, 0] = arrivals.travel_time[i] - nodes[:, 0]
            nodes[:, 4:7] *= -1.0
        nodes[0, 1:4], nodes[-1, 1:4] = a[link], b[link]
        rows.append(nodes)
    return _assemble(rows)


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
    from pymantaray.acoustics._kernels.paths import trace_launch
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
    rows = []
    for angle in angles:
        steps, c = trace_launch(
            packed,
            medium.bathymetry,
            start[0],
            (unit[0], unit[1]),
            float(distance),
            float(angle),
            max_surface_bounces,
            max_bottom_bounces,
            tolerance,
            work,
        )
        rows.append(_nodes(work.path[: steps + 1], start[0], end, c))
    return _assemble(rows)


def _nodes(path: Array, start: Array, end: Array, c: float) -> Array:
    """Rows of the kernels' path in the local frame; a reflection becomes two nodes that are both flagged."""
    step = end[:2] - start[:2]
    length = math.hypot(*step)
    u = step / length if length > 0.0 else np.array([1.0, 0.0])
    time, r, z, y, p_r, p_z, p_y, boundary = path.T
    z = np.where(boundary == AT_SURFACE, 0.0, z)  # the kernel's last nanometres
    north, east = start[0] + r * u[0] - y * u[1], start[1] + r * u[1] + y * u[0]
    p_n, p_e = p_r * u[0] - p_y * u[1], p_r * u[1] + p_y * u[0]
    return np.stack([time / c, north, east, z, p_n / c, p_e / c, p_z / c, boundary], axis=-1)


def _assemble(rows: list[Array]) -> RayPaths:
    table = np.concatenate(rows) if rows else np.empty((0, _NODE_COLUMNS))
    return RayPaths(
        arrival=np.repeat(np.arange(len(rows)), [len(nodes) for nodes in rows]),
        travel_time=table[:, 0],
        position=table[:, 1:4],
        slowness=table[:, 4:7],
        boundary=table[:, 7],
    )
