"""Ray paths of one link, for pictures: the section, the chord, the eigenrays and a fan around them."""

import math
from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from pymantaray.acoustics.eigenrays import find_eigenrays
from pymantaray.acoustics.medium import Medium
from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]
_STEEPEST = 1.35  # rad from the chord; beyond it a ray is not traced


def ray_picture(
    medium: Medium,
    source: ArrayLike,
    receiver: ArrayLike,
    *,
    fan_angles: ArrayLike = (),
    n_range: int = 201,
    n_depth: int = 201,
    n_points: int = 401,
    spreading_cutoff_db: float | None = 15.0,
) -> xr.Dataset:
    """
    Vertical section along one link with its chord, its direct eigenrays and a fan of other rays.

    Parameters
    ----------
    medium : Medium
        Sound speed and bathymetry.
    source, receiver : array_like, shape (3,)
        Positions ``(north, east, down)``, not the same. [m]
    fan_angles : array_like, shape (n_fan,)
        Launch angles of the fan, from the horizontal, positive down. Rays steeper than 1.35 rad from the
        chord are left out. [rad]
    n_range, n_depth, n_points : int
        Points of the section along range and depth, and of each ray.
    spreading_cutoff_db : float or None
        As in `find_eigenrays`.

    Returns
    -------
    xarray.Dataset
        Section ``sound_speed (range, depth)`` and ``sea_floor_depth (range)``; rays ``ray_range``,
        ``ray_depth (ray, point)``, NaN once a ray has left the water, and ``ray_arrives (ray)``; the chord
        ``chord_range``, ``chord_depth (end)``. All lengths in metres.

    Raises
    ------
    AcousticsError
        If the positions coincide or a position is not finite.
    """
    from pymantaray.acoustics._kernels.link import workspace
    from pymantaray.acoustics._kernels.paths import section_grid, trace_path

    a, b = np.array(source, dtype=float), np.array(receiver, dtype=float)
    step = b - a
    horizontal, length = math.hypot(step[0], step[1]), float(np.linalg.norm(step))
    if not length > 0.0:
        raise AcousticsError("source and receiver coincide or are not finite; a picture needs two places")
    unit = step[:2] / horizontal if horizontal > 0.0 else np.array([1.0, 0.0])
    slope = math.atan2(step[2], horizontal)
    arrivals = find_eigenrays(medium, a, b, spreading_cutoff_db=spreading_cutoff_db)
    c_source = float(arrivals.source_sound_speed[0])
    launches = []
    for vector in arrivals.source_slowness * c_source:
        forward, side, down = vector[:2] @ unit, vector[1] * unit[0] - vector[0] * unit[1], vector[2]
        launches.append((math.atan2(down, forward), side, True))
    launches += [(float(angle), 0.0, False) for angle in np.asarray(fan_angles, dtype=float)]
    launches = [launch for launch in launches if abs(launch[0] - slope) < _STEEPEST]

    packed, work = medium.packed(), workspace(medium.depth.size)
    paths = np.full((len(launches), n_points, 2), np.nan)
    for i, (angle, side, _) in enumerate(launches):
        steps = trace_path(packed, a, unit, horizontal, slope, length, angle, side, 1e-3, work)
        paths[i] = _resample(work.path[: steps + 1], length, slope, a[2], n_points)
    ranges = np.linspace(0.0, max(horizontal, 1.0), n_range)
    floor = np.empty(n_range)
    surface = np.zeros(1)
    section_grid(
        packed, medium.bathymetry, a, unit, horizontal, ranges, surface, np.empty((n_range, 1)), floor, work
    )
    depths, c = np.linspace(0.0, 1.03 * floor.max(), n_depth), np.empty((n_range, n_depth))
    section_grid(packed, medium.bathymetry, a, unit, horizontal, ranges, depths, c, floor, work)
    for path, (_, _, arrives) in zip(paths, launches, strict=True):
        wet = (path[:, 1] >= 0.0) & (path[:, 1] <= np.interp(path[:, 0], ranges, floor))
        if not arrives and not wet.all():
            path[np.argmin(wet) :] = np.nan
    metres = {"units": "m"}
    return xr.Dataset(
        {
            "sound_speed": (("range", "depth"), c, {"units": "m s-1", "long_name": "sound speed"}),
            "sea_floor_depth": ("range", floor, {**metres, "long_name": "depth of the sea bed"}),
            "ray_range": (("ray", "point"), paths[..., 0], {**metres, "long_name": "range along the ray"}),
            "ray_depth": (("ray", "point"), paths[..., 1], {**metres, "long_name": "depth along the ray"}),
            "ray_arrives": (
                "ray",
                np.array([arrives for *_, arrives in launches], dtype=np.int8),
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


def _resample(path: Array, length: float, slope: float, z_source: float, n_points: int) -> Array:
    """Range and depth at equally spaced distances along the chord, by the steps' cubic Hermite polynomials."""
    s = np.linspace(0.0, length, n_points)
    w = np.full(n_points, np.nan)
    for (s0, w0, d0, _), (s1, w1, d1, _) in pairwise(path):
        h = s1 - s0
        inside = (s >= s0) & (s <= s1)
        if h <= 0.0 or not inside.any():
            continue
        t = (s[inside] - s0) / h
        w[inside] = (
            (1 - 3 * t**2 + 2 * t**3) * w0
            + (t - 2 * t**2 + t**3) * h * d0
            + (3 * t**2 - 2 * t**3) * w1
            + (t**3 - t**2) * h * d1
        )
    return np.stack(
        [s * math.cos(slope) - w * math.sin(slope), z_source + s * math.sin(slope) + w * math.cos(slope)],
        axis=-1,
    )
