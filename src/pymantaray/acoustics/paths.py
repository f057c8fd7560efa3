"""Paths of eigenrays and of fans of rays, integrals along paths, and a section along one link."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics import RayPaths
from pymantaray.acoustics.eigenrays import find_eigenrays, solved_backwards
from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.near_ends import separated
from pymantaray.acoustics.solving import as_positions, in_blocks
from pymantaray.arrays import Array, Indices
from pymantaray.errors import AcousticsError
from pymantaray.quantities.checks import distinct_digits
from pymantaray.records import Arrivals, RayStatus

if TYPE_CHECKING:
    import xarray as xr

Variable = tuple[str | tuple[str, ...], Array, str, str]
"""Dimensions, values, unit and description."""
_STEEPEST = 1.5  # rad; maximum launch angle of a ray of a fan
_FULL_PATHS_PER_THREAD = 4  # paths with the maximum number of nodes in the memory of a thread
_GAUSS_NODES, _GAUSS_WEIGHTS = (
    0.5 * (v + shift)
    for v, shift in zip(np.polynomial.legendre.leggauss(4), (1.0, 0.0), strict=True)
)


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
    Trace the paths of eigenrays.

    Parameters
    ----------
    medium : Medium
    source, receiver : array_like, shape (n_links, 3) or (3,)
        Positions of the arrivals' links. [m]
    arrivals : Arrivals
        From `find_eigenrays`, for the same medium and positions.
    tolerance : float
        As in `find_eigenrays`. [m]
    threads : int, optional
        Threads over blocks of arrivals; the result does not depend on it. Default: all processors.

    Returns
    -------
    RayPaths
        Paths from source to receiver; ``arrival`` is the row of ``arrivals``. A ray between equal
        positions has one node.

    Raises
    ------
    AcousticsError
        If the positions do not match the arrivals, or a ray ends early.

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import trace_paths
    >>> paths = trace_paths(medium, source, receiver, arrivals)
    >>> print(paths.position[paths.boundary == 1].round(1))
    [[276.5   0.    0. ]
     [276.5   0.    0. ]]
    """
    from pymantaray.acoustics._kernels.paths import trace_arrivals

    a = as_positions("source", source)
    b = as_positions("receiver", receiver)
    if not a.shape == b.shape == (arrivals.status.size, 3):
        raise AcousticsError(
            f"source has shape {a.shape}, receiver {b.shape}; the arrivals are of"
            f" {arrivals.status.size} links"
        )
    if medium.surface.roughness is not None and np.any(arrivals.surface_bounces):
        raise AcousticsError(
            "paths of rays under rough ice are not available, only their arrivals; remove the"
            " roughness (`ice_slope_deg`)"
        )
    # launches as the solver found them, with the numbers of their reflections
    domain = medium.domain()
    ends, launch = _ends_and_launches(medium, a, b, arrivals)
    manner = np.stack(
        [arrivals.ray_axis, arrivals.surface_bounces, arrivals.bottom_bounces],
        axis=-1,
        dtype=np.int64,
    )
    counts = np.zeros(arrivals.link.size, dtype=np.int64)
    own = threading.local()

    # each thread has its own room, which holds a few paths at a time
    def trace(start: int, stop: int) -> Array:
        if not hasattr(own, "work"):
            own.work, own.nodes = _room(medium)
        done: list[Array] = [own.nodes[:0]]
        while start < stop:
            part = slice(start, stop)
            out = own.nodes, counts[part]
            times = arrivals.travel_time[part]
            traced = trace_arrivals(
                domain, ends[part], launch[part], manner[part], times, tolerance, own.work, out
            )
            done.append(own.nodes[: counts[start : start + traced].sum()].copy())
            start += traced
        return np.concatenate(done)

    with closing(in_blocks(trace, arrivals.link.size, threads=threads)) as blocks:
        table = np.concatenate(list(blocks))
    # a path without a node ended before its receiver
    if not counts.all():
        broken = np.flatnonzero(counts == 0)
        raise AcousticsError(
            f"{broken.size} arrivals, first {broken[0]}, have no path, because rays with their"
            " launch angles end early; compute the arrivals with canonical=True in the same medium"
        )
    return _as_paths(table, counts, medium)


def _ends_and_launches(
    medium: Medium, source: Array, receiver: Array, arrivals: Arrivals
) -> tuple[Array, Array]:
    """
    Ends of the ray of each arrival (n, 2, 3) [m], and its slowness at the end where its search
    began [s/m] with 1 if that is the receiver, else 0 (n, 4).
    """
    link = arrivals.link
    apart, near = separated(medium, source, receiver)
    backwards = solved_backwards(source, apart)[link, None]
    flat = (source, apart) if medium.earth is None else medium.earth.flattened_ends(source, apart)
    ends = np.stack(flat, axis=1)[link]
    without_length = near[link] & (arrivals.surface_bounces == 0) & (arrivals.bottom_bounces == 0)
    ends[without_length, 1] = ends[without_length, 0]
    slowness = np.where(backwards, -arrivals.receiver_slowness, arrivals.source_slowness)
    if medium.earth is not None:
        start = np.where(backwards[:, 0], receiver[link, 2], source[link, 2])
        slowness[:, 2] /= medium.earth.stretch(start)
    slowness[without_length] = np.nan
    return ends, np.concatenate([slowness, backwards], axis=1)


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
    Trace rays from one position in one vertical plane.

    Parameters
    ----------
    medium : Medium
    source : array_like, shape (3,)
        Position ``(north, east, down)``. [m]
    azimuth : float
        Direction of the plane, clockwise from north. [rad]
    launch_angles : array_like, shape (n_rays,)
        Angles from the horizontal, positive down, of magnitude 1.5 at most. [rad]
    distance : float
        Horizontal length of the rays; their end must be in the medium's domain. [m]
    max_surface_bounces, max_bottom_bounces : int
        Maximum numbers of reflections; a ray ends at the next one.
    tolerance : float
        As in `find_eigenrays`. [m]

    Returns
    -------
    RayPaths
        Paths; ``arrival`` is the number of the ray. Horizontal refraction moves rays out of the
        plane.

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import trace_fan
    >>> fan = trace_fan(medium, source, 0.0, np.radians([2.0, 5.0, 10.0]), 3000.0)
    >>> [float(fan.position[fan.arrival == ray][-1, 2].round(1)) for ray in range(3)]
    [0.0, 187.3, 493.0]
    """
    from pymantaray.acoustics._kernels.paths import trace_launches

    start = as_positions("source", source)
    angles = np.atleast_1d(np.array(launch_angles, dtype=float))
    if start.shape != (1, 3) or angles.ndim != 1:
        raise AcousticsError(
            f"source has shape {np.shape(source)}; a fan starts from one position (3,)"
        )
    if not np.all(np.abs(angles) <= _STEEPEST):
        raise AcousticsError(
            f"launch_angles: up to {np.max(np.abs(angles)):g} rad; they must be within {_STEEPEST}"
            " rad of the horizontal"
        )
    if not (distance > 0.0 and math.isfinite(distance)):
        raise AcousticsError(f"distance: {distance}; a positive length in metres is needed")
    # the whole fan must be inside the medium, its source in the water
    unit = math.cos(azimuth), math.sin(azimuth)
    end = start[0] + distance * np.array([*unit, 0.0])
    for name, axis, k in (("north", medium.north, 0), ("east", medium.east, 1)):
        for place in (start[0], end):
            if axis.size > 1 and not axis[0] <= place[k] <= axis[-1]:
                end_at, low, high = distinct_digits(place[k], axis[0], axis[-1])
                raise AcousticsError(
                    f"fan: {name} {end_at} m is outside the medium, {low} to {high} m; reduce the"
                    " distance"
                )
    top = medium.surface_depth(start)[0]
    bed = medium.bottom_depth(start)[0]
    if not top <= start[0, 2] <= bed:
        depth, low, high = distinct_digits(start[0, 2], top, bed)
        raise AcousticsError(
            f"source: depth {depth} m; the water there reaches from {low} to {high} m"
        )
    # rays of all launch angles, as many at a time as their nodes have room
    if medium.earth is not None:
        start[:, 2] = medium.earth.flattened_depth(start[:, 2])
    domain, (work, nodes) = medium.domain(), _room(medium)
    counts = np.zeros(angles.size, dtype=np.int64)
    bounces = (max_surface_bounces, max_bottom_bounces)
    fan = (start[0], unit, float(distance))
    done = 0
    table = [nodes[:0]]
    while done < angles.size:
        traced = trace_launches(
            domain, fan, angles[done:], bounces, tolerance, work, (nodes, counts[done:])
        )
        table.append(nodes[: counts[done : done + traced].sum()].copy())
        done += traced
    return _as_paths(np.concatenate(table), counts, medium)


def _room(medium: Medium) -> tuple[tuple[Array, ...], Array]:
    """Workspaces of one thread, and an array for the nodes of a few paths."""
    from pymantaray.acoustics._kernels.layout import N_NODE, workspace

    work = workspace(medium.depth.size)
    return work, np.empty((_FULL_PATHS_PER_THREAD * len(work.path), N_NODE))


def _as_paths(table: Array, counts: NDArray[np.int64], medium: Medium) -> RayPaths:
    """
    Paths from a table of nodes; on a spherical Earth, depths are true, but horizontal positions are
    those of flattened water.
    """
    from pymantaray.acoustics._kernels.layout import (
        NODE_BOUNDARY,
        NODE_POSITION,
        NODE_SLOWNESS,
        NODE_TIME,
    )

    if medium.earth is not None:
        table[:, NODE_POSITION + 2] = medium.earth.true_depth(table[:, NODE_POSITION + 2])
    return RayPaths(
        arrival=np.repeat(np.arange(counts.size), counts),
        travel_time=table[:, NODE_TIME],
        position=table[:, NODE_POSITION : NODE_POSITION + 3],
        slowness=table[:, NODE_SLOWNESS : NODE_SLOWNESS + 3],
        boundary=table[:, NODE_BOUNDARY],
    )


class Quadrature(NamedTuple):
    """Points along rays with weights that integrate over arc length."""

    arrival: NDArray[np.int64]
    position: Array
    slowness: Array
    weight: Array


def quadrature(paths: RayPaths) -> Quadrature:
    """
    Return Gauss-Legendre points along paths, four on every segment.

    Between nodes, a path is a cubic Hermite polynomial in time.

    Parameters
    ----------
    paths : RayPaths
        From `trace_paths` or `trace_fan`.

    Returns
    -------
    Quadrature
        ``arrival`` (n,), the row of the ray; ``position`` (n, 3) [m]; ``slowness`` (n, 3) along the
        ray [s/m]; ``weight`` (n,), the arc length of each point [m].

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import quadrature
    >>> nodes = quadrature(paths)
    >>> print(np.bincount(nodes.arrival, nodes.weight).round(2))
    [3020.53 3033.99]
    """
    a = np.flatnonzero((np.diff(paths.arrival) == 0) & (np.diff(paths.travel_time) > 0.0))
    h, x0, v0, x1, v1 = (part[:, None] for part in _segments(paths, a))
    t = _GAUSS_NODES[None, :, None]
    position = _hermite(t, h, x0, v0, x1, v1)
    velocity = (
        (6.0 * t**2 - 6.0 * t) * (x0 - x1) / h
        + (1.0 - 4.0 * t + 3.0 * t**2) * v0
        + (3.0 * t**2 - 2.0 * t) * v1
    )
    speed = np.linalg.norm(velocity, axis=-1)
    weight = speed * h[..., 0] * _GAUSS_WEIGHTS
    return Quadrature(
        np.repeat(paths.arrival[a], t.shape[1]),
        position.reshape(-1, 3),
        (velocity / speed[..., None] ** 2).reshape(-1, 3),
        weight.reshape(-1),
    )


def resample(paths: RayPaths, n_points: int) -> Array:
    """Positions (n_rays, n_points, 3) at equal steps of travel time along every ray. [m]"""
    starts = np.flatnonzero(np.diff(paths.arrival, prepend=-1))
    out = np.empty((starts.size, n_points, 3))
    for i, nodes in enumerate(np.split(np.arange(paths.arrival.size), starts)[1:]):
        # the second node of a reflection
        nodes = nodes[np.append(np.diff(paths.travel_time[nodes]) > 0.0, True)]
        if nodes.size < 2:
            out[i] = paths.position[nodes[0]]
            continue
        times = np.linspace(paths.travel_time[nodes[0]], paths.travel_time[nodes[-1]], n_points)
        k = np.clip(
            np.searchsorted(paths.travel_time[nodes], times, side="right") - 1, 0, nodes.size - 2
        )
        # a segment ends at the next node, before a reflection
        h, *ends = _segments(paths, nodes[k])
        t = (times - paths.travel_time[nodes[k]])[:, None] / h
        out[i] = _hermite(t, h, *ends)
    return out


def path_integrals(paths: RayPaths, integrand: Callable[[Array], Array]) -> Array:
    """
    Integrate functions of position over the arc length of every ray.

    Parameters
    ----------
    paths : RayPaths
        From `trace_paths` or `trace_fan`.
    integrand : callable
        Function of positions (n, 3) [m] that returns values (n,) or (n, k).

    Returns
    -------
    ndarray, shape (n_rays, k)
        Integrals. [unit of the integrand times m]

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import path_integrals
    >>> length, time = path_integrals(
    ...     paths, lambda p: np.stack([np.ones(len(p)), 1.0 / medium.sound_speed_at(p)], axis=-1)
    ... ).T
    >>> print(length.round(2), time.round(4))
    [3020.53 3033.99] [2.0659 2.0774]
    """
    points = quadrature(paths)
    return _gather(paths, points, _values(integrand, points.position) * points.weight[:, None])


def travel_time_sensitivity(paths: RayPaths, basis: Callable[[Array], Array]) -> Array:
    r"""
    Return the first-order change of travel times by a small change of sound speed.

    Parameters
    ----------
    paths : RayPaths
        From `trace_paths`.
    basis : callable
        Shapes of the change: function of positions (n, 3) [m] that returns values (n,) or (n, k).

    Returns
    -------
    ndarray, shape (n_rays, k)
        Derivative of the travel time by the amplitude of each shape. [s per m/s]

    Notes
    -----
    For :math:`c + \epsilon \phi`, :math:`\partial t / \partial \epsilon = -\int \phi / c^2 \, ds`
    along the unperturbed ray: by Fermat's principle, the displacement of the ray has no first-order
    effect.

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import travel_time_sensitivity
    >>> print(travel_time_sensitivity(paths, lambda position: np.ones(len(position))).round(6))
    [[-0.001413]
     [-0.001422]]
    """
    points = quadrature(paths)
    squared = np.sum(points.slowness**2, axis=-1)
    return -_gather(
        paths, points, _values(basis, points.position) * (points.weight * squared)[:, None]
    )


def ray_picture(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    *,
    fan_angles: ArrayLike = (),
    n_range: int = 201,
    n_depth: int = 201,
    n_points: int = 401,
    max_surface_bounces: int = 0,
    max_bottom_bounces: int = 0,
    spreading_cutoff_db: float | None = 15.0,
) -> xr.Dataset:
    """
    Return a vertical section along one link with its chord, its eigenrays and a fan of other rays.

    Parameters
    ----------
    medium : Medium
        Sound speed and bathymetry.
    source, receiver : array_like, shape (3,)
        Positions ``(north, east, down)``; the section of equal ones is to the north. [m]
    fan_angles : array_like, shape (n_fan,)
        Launch angles of the fan, from the horizontal, positive down. Angles that are too steep for
        `trace_fan` are omitted. [rad]
    n_range, n_depth, n_points : int
        Numbers of points of the section along range and depth, and of each ray.
    max_surface_bounces, max_bottom_bounces : int
        Maximum numbers of reflections of eigenrays and of the rays of the fan.
    spreading_cutoff_db : float or None
        As in `find_eigenrays`. [dB]

    Returns
    -------
    xarray.Dataset
        Section ``sound_speed (range, depth)``, ``sea_floor_depth`` and ``sea_ice_draft (range)``;
        rays ``ray_range``, ``ray_depth (ray, point)`` and, of dimension ray, ``ray_arrives``,
        ``ray_travel_time`` [s], ``ray_surface_bounces``, ``ray_bottom_bounces`` and
        ``ray_spreading`` [dB beyond spherical; NaN in the fan]; eigenrays come first, by travel
        time; chord ``chord_range``, ``chord_depth (end)`` and ``chord_travel_time`` [s]. All
        lengths are in metres. The attribute ``status`` is the name of the link's `RayStatus`.

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import ray_picture
    >>> picture = ray_picture(medium, source, receiver, fan_angles=np.radians([5.0, 10.0]))
    >>> picture.attrs["status"], picture["ray_arrives"].values.tolist()
    ('OK', [1, 0, 0])
    """
    import xarray as xr

    variables, status = next(
        picture_variables(
            medium,
            source,
            receiver,
            fan_angles=fan_angles,
            shape=(n_range, n_depth, n_points),
            bounces=(max_surface_bounces, max_bottom_bounces),
            spreading_cutoff_db=spreading_cutoff_db,
        )
    )
    picture = xr.Dataset(
        {
            name: (dims, values, {"units": units, "long_name": words})
            for name, (dims, values, units, words) in variables.items()
        }
    ).set_coords(["range", "depth"])
    picture["depth"].attrs |= {"standard_name": "depth", "positive": "down"}
    return picture.assign_attrs(status=status.name)


def picture_variables(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    *,
    fan_angles: ArrayLike = (),
    shape: tuple[int, int, int],
    bounces: tuple[int, int],
    spreading_cutoff_db: float | None,
) -> Iterator[tuple[dict[str, Variable], RayStatus]]:
    """
    Yield the variables of `ray_picture` as arrays, and the status, of each of many links.

    The shape has its numbers of points along range, depth and rays; the bounces are at the surface
    and at the bed.
    """
    sources = as_positions("source", source)
    receivers = as_positions("receiver", receiver)
    n_range, n_depth, n_points = shape
    arrivals = find_eigenrays(medium, sources, receivers, *bounces, spreading_cutoff_db)
    eigenrays = _at_steps(trace_paths(medium, sources, receivers, arrivals), n_points)
    eigenrays = eigenrays._replace(travel_time=arrivals.travel_time)
    ends = np.searchsorted(arrivals.link, np.arange(len(sources) + 1))
    fan = np.asarray(fan_angles, dtype=float)
    fan = fan[np.abs(fan) <= _STEEPEST]
    for link, (a, b) in enumerate(zip(sources, receivers, strict=True)):
        step = b - a
        horizontal = math.hypot(step[0], step[1])
        unit = step[:2] / horizontal if horizontal > 0.0 else np.array([1.0, 0.0])
        own = slice(ends[link], ends[link + 1])
        rays = [eigenrays.part(own)]
        if fan.size and horizontal > 0.0:
            azimuth = math.atan2(unit[1], unit[0])
            most = {"max_surface_bounces": bounces[0], "max_bottom_bounces": bounces[1]}
            others = trace_fan(medium, a, azimuth, fan, horizontal, **most)
            rays.append(_at_steps(others, n_points))
        chord_time = arrivals.chord_travel_time[link]
        variables: dict[str, Variable] = {
            **_section(medium, a, unit, horizontal, n_range, n_depth),
            **_ray_variables(rays, arrivals.spreading_db[own], a, unit),
            "chord_travel_time": ((), chord_time, "s", "travel time along the chord"),
            "chord_range": ("end", np.array([0.0, horizontal]), "m", "range of the ends"),
            "chord_depth": ("end", np.array([a[2], b[2]]), "m", "depth of the ends"),
        }
        yield variables, RayStatus(int(arrivals.status[link]))


def _section(
    medium: Medium, start: Array, unit: Array, horizontal: float, n_range: int, n_depth: int
) -> dict[str, Variable]:
    """Water, sea bed and ice from a position along a horizontal direction."""
    from pymantaray.acoustics._kernels.paths import section_grid

    domain, (work, _) = medium.domain(), _room(medium)
    line = start, (unit[0], unit[1]), horizontal
    ranges = np.linspace(0.0, max(horizontal, 1.0), n_range)
    floor = np.empty(n_range)
    ice = np.empty(n_range)
    section_grid(domain, line, ranges, np.zeros(1), work, (np.empty((n_range, 1)), floor, ice))
    depths = np.linspace(0.0, 1.03 * floor.max(), n_depth)
    c = np.empty((n_range, n_depth))
    section_grid(domain, line, ranges, depths, work, (c, floor, ice))
    if medium.earth is not None:
        depths, floor, ice = (medium.earth.true_depth(x) for x in (depths, floor, ice))
        c = c / medium.earth.stretch(depths)
    return {
        "sound_speed": (("range", "depth"), c, "m s-1", "sound speed"),
        "sea_floor_depth": ("range", floor, "m", "depth of the sea bed"),
        "sea_ice_draft": ("range", ice, "m", "depth of the ice's underside"),
        "range": ("range", ranges, "m", "horizontal range from the source"),
        "depth": ("depth", depths, "m", "depth, positive down"),
    }


class _Rays(NamedTuple):
    """Rays at equal steps of travel time."""

    position: Array
    """Shape (rays, points, 3). [m]"""
    travel_time: Array
    """To the ends of the rays. [s]"""
    surface_bounces: NDArray[np.int64]
    bottom_bounces: NDArray[np.int64]

    def part(self, rays: slice) -> _Rays:
        """Some of the rays."""
        return _Rays(
            self.position[rays],
            self.travel_time[rays],
            self.surface_bounces[rays],
            self.bottom_bounces[rays],
        )


def _at_steps(paths: RayPaths, n_points: int) -> _Rays:
    """Rays with this number of points each."""
    surface, bottom = (  # a bounce has two nodes
        _per_ray(paths.boundary == where, paths, np.add) // 2 for where in (1, 2)
    )
    time = _per_ray(paths.travel_time, paths, np.maximum)
    return _Rays(resample(paths, n_points), time, surface, bottom)


def _ray_variables(
    rays: Sequence[_Rays], spreading_db: Array, start: Array, unit: Array
) -> dict[str, Variable]:
    """Rays in a vertical section, first the eigenrays with a geometric spreading."""
    paths, last, surface, bottom = (np.concatenate(columns) for columns in zip(*rays, strict=True))
    arrives = np.arange(len(paths)) < spreading_db.size
    spreading = np.full(len(paths), np.nan)
    spreading[arrives] = spreading_db
    ranges = (paths[..., :2] - start[:2]) @ unit
    return {
        "ray_range": (("ray", "point"), ranges, "m", "range along the ray"),
        "ray_depth": (("ray", "point"), paths[..., 2], "m", "depth along the ray"),
        "ray_arrives": ("ray", arrives.astype(np.int8), "1", "whether the ray is an eigenray"),
        "ray_travel_time": ("ray", last, "s", "travel time to the ray's end"),
        "ray_surface_bounces": ("ray", surface.astype(np.int16), "1", "reflections at the surface"),
        "ray_bottom_bounces": ("ray", bottom.astype(np.int16), "1", "reflections at the sea bed"),
        "ray_spreading": ("ray", spreading, "1", "geometric spreading beyond spherical, in dB"),
    }


def _per_ray(values: NDArray[Any], paths: RayPaths, reduce: np.ufunc) -> NDArray[Any]:
    """One value per ray from the values of its nodes."""
    starts = np.flatnonzero(np.diff(paths.arrival, prepend=-1))
    return np.asarray(
        reduce.reduceat(values, starts, dtype=np.result_type(values, np.int64))
        if starts.size
        else starts
    )


def _segments(paths: RayPaths, first: Indices) -> tuple[Array, ...]:
    """
    Durations (n, 1) of segments that begin at the first nodes, and positions and velocities of
    their ends, as `_hermite` takes them.
    """
    last = first + 1
    v0, v1 = (
        p / np.sum(p * p, axis=-1, keepdims=True)
        for p in (paths.slowness[first], paths.slowness[last])
    )
    duration = (paths.travel_time[last] - paths.travel_time[first])[:, None]
    return duration, paths.position[first], v0, paths.position[last], v1


def _hermite(t: Array, h: Array, x0: Array, v0: Array, x1: Array, v1: Array) -> Array:
    """
    Cubic Hermite polynomial at the fraction t of a segment of duration h, from positions and
    velocities at its ends.
    """
    return np.asarray(
        (1.0 - 3.0 * t**2 + 2.0 * t**3) * x0
        + (t - 2.0 * t**2 + t**3) * h * v0
        + (3.0 * t**2 - 2.0 * t**3) * x1
        + (t**3 - t**2) * h * v1
    )


def _values(function: Callable[[Array], Array], position: Array) -> Array:
    values = np.asarray(function(position), dtype=float)
    if values.shape[:1] != position.shape[:1] or values.ndim > 2:
        raise AcousticsError(
            f"integrand returned shape {values.shape} for positions {position.shape}; it must"
            f" return ({position.shape[0]}, k)"
        )
    return values if values.ndim == 2 else values[:, None]


def _gather(paths: RayPaths, points: Quadrature, values: Array) -> Array:
    n_rays = int(paths.arrival[-1]) + 1 if paths.arrival.size else 0
    total = np.zeros((n_rays, values.shape[1]))
    np.add.at(total, points.arrival, values)
    return total
