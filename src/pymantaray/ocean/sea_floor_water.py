"""Comparison of a sea floor from a file with the water of an ocean: gaps, sign and unit."""

from contextlib import suppress

import numpy as np
import xarray as xr

from pymantaray.arrays import Array, Indices, Mask
from pymantaray.errors import OceanError
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.ocean.schema import place_text

SIGN_REMEDY = (
    "set the attribute positive of its depths to 'down' or of its heights to 'up', or use another"
    " file"
)
"""Remedy for a file whose sign is wrong."""
_NOT_WATER = 0.02  # median ratio of a file's depths to those of the water: land, or another unit
_SHALLOW = 0.5
_MIN_AROUND = 4  # points around a gap for a linear interpolation
_SHORE = 50.0  # m; land where the water is deeper than this is no matter of the coast


def sea_floor_notes(sea_floor: xr.DataArray | None) -> tuple[str, ...]:
    """Notes of `open_sea_floor` about a sea floor; empty without one."""
    return () if sea_floor is None else tuple(sea_floor.attrs.get("notes", ()))


def in_water(
    depth: Array, lat: Array, lon: Array, ocean: xr.Dataset, own: Array, name: str
) -> tuple[Array, list[str]]:
    """
    Depths of a file (lat, lon) without gaps in the water of an ocean, and notes; a file that is
    land in most of the water raises an error.

    Gaps that reach the edge have the depth ``own`` of the ocean (its lat, lon); others are filled
    from the points around them.
    """
    notes: list[str] = []
    # axes and depths of the ocean's water, by the file's longitudes
    axes = [np.asarray(ocean[axis].values, dtype=float) for axis in ("lat", "lon")]
    apart = 0.5 * (lon[0] + lon[-1] - axes[1][0] - axes[1][-1])
    axes[1] = axes[1] + 360.0 * np.round(apart / 360.0)
    levels = np.isfinite(ocean["water_temp"].values).sum(axis=0)
    water = np.asarray(ocean["depth"].values, dtype=float)[np.maximum(levels, 1) - 1]
    nearest = np.ix_(*(_nearest(own, at) for own, at in zip(axes, (lat, lon), strict=True)))
    # gaps that reach the edge
    outside = _reaching_the_edge(np.isnan(depth))
    if outside.any():
        depth, note = _with_own(depth, outside, (lat, lon), (axes[0], axes[1]), own)
        notes.append(note)
    # gaps inside
    gaps = np.isnan(depth) & (levels[nearest] > 0)
    if gaps.any():
        count = int(np.count_nonzero(gaps))
        total = int(np.count_nonzero(levels[nearest]))
        lacking = f"no value at {count} of {total} points in the ocean's water"
        if 2 * count > total:
            raise OceanError(f"{name}: {lacking}; use a file that covers it")
        notes.append(f"{lacking}; filled from the points around them")
        depth = depth.copy()
        depth[gaps] = _from_around(depth, gaps)
    depth = np.nan_to_num(depth)
    # land, or depths that do not match those of the ocean
    ratio = _ratio(depth, (lat, lon), water, (axes[0], axes[1]))
    deep = water[nearest] > min(_SHORE, 0.5 * water.max())
    land = f"{np.count_nonzero(deep & (depth <= 0.0))} of {np.count_nonzero(deep)} points where the"
    land += f" ocean has water down to {water.max():g} m"
    if ratio < _NOT_WATER and 2 * np.count_nonzero(deep & (depth <= 0.0)) >= deep.sum():
        raise OceanError(f"{name}: is land at {land}; {SIGN_REMEDY}")
    if ratio < _NOT_WATER:
        raise OceanError(
            f"{name}: is {depth.min():g} to {depth.max():g} m deep where the ocean has water down"
            f" to {water.max():g} m; check its unit, which must be metres"
        )
    if np.any(deep & (depth <= 0.0)):
        notes.append(f"land at {land}")
    if ratio < _SHALLOW:
        notes.append(
            f"in the median, {ratio:.2g} times as deep as the ocean's water; check that it belongs"
            " to this region and is in metres"
        )
    return depth, notes


def _reaching_the_edge(missing: Mask) -> Mask:
    """Missing points that are connected with the edge of a grid."""
    from scipy import ndimage

    labels, _ = ndimage.label(missing)
    edge = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    return missing & np.isin(labels, edge[edge > 0])


def _with_own(
    depth: Array,
    outside: Mask,
    at: tuple[Array, Array],
    axes: tuple[Array, Array],
    own: Array,
) -> tuple[Array, str]:
    """Depths with those of an ocean at points outside a file, and a note with the step between."""
    places = np.stack(np.meshgrid(*at, indexing="ij"), axis=-1)
    theirs = linear_interpolator(axes, own)(places)
    both = np.where(outside, theirs, depth)
    steps = [0.0]
    for axis in (0, 1):
        seam = np.diff(outside.astype(int), axis=axis) != 0
        steps.append(np.max(np.abs(np.diff(both, axis=axis)), initial=0.0, where=seam))
    inside = ~outside
    lat, lon = (axis[inside.any(axis=k)][[0, -1]] for axis, k in zip(at, (1, 0), strict=True))
    return both, (
        f"covers {100.0 * inside.mean():.3g} % of the ocean, from {place_text(lat[0], lon[0])} to"
        f" {place_text(lat[1], lon[1])}; elsewhere the sea floor is that of the ocean, with steps"
        f" of up to {np.nanmax(steps):.0f} m at the edge"
    )


def _nearest(axis: Array, points: Array) -> Indices:
    """Index of the nearest entry of an increasing axis for each point."""
    return np.searchsorted(0.5 * (axis[1:] + axis[:-1]), points)


def _from_around(depth: Array, gaps: Mask) -> Array:
    """
    Depths at gaps, interpolated linearly between the points around them, or of the nearest point.
    """
    from scipy import ndimage
    from scipy.interpolate import griddata
    from scipy.spatial import QhullError

    known = np.isfinite(depth)
    nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    values = depth[tuple(np.asarray(nearest)[:, gaps])]
    around = np.argwhere(ndimage.binary_dilation(gaps, iterations=2) & known)
    if len(around) < _MIN_AROUND or np.any(np.ptp(around, axis=0) == 0):
        return np.asarray(values)
    with suppress(QhullError):  # points on one line
        linear = griddata(around, depth[tuple(around.T)], np.argwhere(gaps))
        values = np.where(np.isnan(linear), values, linear)
    return np.asarray(values)


def _ratio(
    depth: Array, at: tuple[Array, Array], water: Array, places: tuple[Array, Array]
) -> float:
    """
    Median ratio of a sea floor on latitudes and longitudes to the depth of water (lat, lon) at
    other ones; 1 without common water.
    """
    there = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1)
    inside = (water > 0.0) & np.all(
        [(there[..., k] >= axis[0]) & (there[..., k] <= axis[-1]) for k, axis in enumerate(at)],
        axis=0,
    )
    if not inside.any():
        return 1.0
    return float(np.median(linear_interpolator(at, depth)(there[inside]) / water[inside]))
