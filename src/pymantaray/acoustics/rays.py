"""Ray paths of one link, for pictures: the section, the chord, the eigenrays and a fan around them."""

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.acoustics.eigenrays import as_positions, find_eigenrays
from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.path_integrals import resample
from pymantaray.acoustics.paths import STEEPEST, trace_fan, trace_paths
from pymantaray.errors import AcousticsError

if TYPE_CHECKING:
    import xarray as xr


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
) -> "xr.Dataset":
    """
    Vertical section along one link with its chord, its eigenrays and a fan of other rays.

    Parameters
    ----------
    medium : Medium
        Sound speed and bathymetry.
    source, receiver : array_like, shape (3,)
        Positions ``(north, east, down)``, not the same. [m]
    fan_angles : array_like, shape (n_fan,)
        Launch angles of the fan, from the horizontal, positive down. Those too steep for `trace_fan` are left
        out. [rad]
    n_range, n_depth, n_points : int
        Points of the section along range and depth, and of each ray.
    max_surface_bounces, max_bottom_bounces : int
        Of eigenrays and of the fan's rays.
    spreading_cutoff_db : float or None
        As in `find_eigenrays`.

    Returns
    -------
    xarray.Dataset
        Section ``sound_speed (range, depth)`` and ``sea_floor_depth (range)``; rays ``ray_range``,
        ``ray_depth (ray, point)`` and ``ray_arrives (ray)``; the chord
        ``chord_range``, ``chord_depth (end)``. All lengths in metres.

    Raises
    ------
    AcousticsError
        If the positions coincide or a position is not finite.
    """
    import xarray as xr

    from pymantaray.acoustics._kernels.paths import section_grid
    from pymantaray.acoustics._kernels.workspace import workspace

    a, b = as_positions("source", source)[0], as_positions("receiver", receiver)[0]
    step = b - a
    horizontal = math.hypot(step[0], step[1])
    if not np.any(step):
        raise AcousticsError("source and receiver coincide; a picture needs two places")
    unit = step[:2] / horizontal if horizontal > 0.0 else np.array([1.0, 0.0])
    arrivals = find_eigenrays(medium, a, b, max_surface_bounces, max_bottom_bounces, spreading_cutoff_db)
    rays = [resample(trace_paths(medium, a, b, arrivals), n_points)]
    fan = np.asarray(fan_angles, dtype=float)
    fan = fan[np.abs(fan) <= STEEPEST]
    if fan.size and horizontal > 0.0:
        azimuth = math.atan2(unit[1], unit[0])
        others = trace_fan(
            medium,
            a,
            azimuth,
            fan,
            horizontal,
            max_surface_bounces=max_surface_bounces,
            max_bottom_bounces=max_bottom_bounces,
        )
        rays.append(resample(others, n_points))
    paths = np.concatenate(rays)
    arrives = np.arange(len(paths)) < arrivals.link.size

    packed, work = medium.packed(), workspace(medium.depth.size)
    ranges = np.linspace(0.0, max(horizontal, 1.0), n_range)
    floor = np.empty(n_range)
    surface = np.zeros(1)
    section_grid(
        packed, medium.bed(), a, unit, horizontal, ranges, surface, np.empty((n_range, 1)), floor, work
    )
    depths, c = np.linspace(0.0, 1.03 * floor.max(), n_depth), np.empty((n_range, n_depth))
    section_grid(packed, medium.bed(), a, unit, horizontal, ranges, depths, c, floor, work)
    metres = {"units": "m"}
    return xr.Dataset(
        {
            "sound_speed": (("range", "depth"), c, {"units": "m s-1", "long_name": "sound speed"}),
            "sea_floor_depth": ("range", floor, {**metres, "long_name": "depth of the sea bed"}),
            "ray_range": (
                ("ray", "point"),
                (paths[..., :2] - a[:2]) @ unit,
                {**metres, "long_name": "range along the ray"},
            ),
            "ray_depth": (("ray", "point"), paths[..., 2], {**metres, "long_name": "depth along the ray"}),
            "ray_arrives": (
                "ray",
                arrives.astype(np.int8),
                {"units": "1"},
            ),
            "chord_range": ("end", [0.0, horizontal], metres),
            "chord_depth": ("end", [a[2], b[2]], metres),
        },
        coords={
            "range": ("range", ranges, {**metres, "long_name": "horizontal range from the source"}),
            "depth": ("depth", depths, {**metres, "positive": "down"}),
        },
    )
