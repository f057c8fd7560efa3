"""Coarse sea floor from what is valid or a finer one from a file, and values below it for the interpolants."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import RegularGridInterpolator

from pymantaray.errors import OceanError
from pymantaray.ocean.schema import layer_edges
from pymantaray.ocean.window import Window

Array = NDArray[np.float64]
MAX_FLOOR_NODES = 1_000_000
"""Nodes of a finer sea floor in the local frame at most; with more its spacing is widened."""
_SAME_SPACING = 1.01  # a file as fine as the ocean's grid to within 1 % is not coarser
_MIN_CELLS = 2  # on either side of the centre


def sea_floor_depth(ocean: xr.Dataset) -> xr.DataArray:
    """
    Sea floor that the levels of a model imply: half-way from the deepest valid level to the next.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.

    Returns
    -------
    xarray.DataArray, shape (lat, lon)
        Depth of the sea floor; 0 on land, the deepest level itself where that is valid. [m]
    """
    depth = np.asarray(ocean["depth"].values, dtype=float)
    levels = np.isfinite(ocean["water_temp"].values).sum(axis=0)
    return xr.DataArray(
        layer_edges(depth)[levels],
        coords={"lat": ocean["lat"], "lon": ocean["lon"]},
        dims=("lat", "lon"),
        name="sea_floor_depth",
        attrs={"standard_name": "sea_floor_depth_below_sea_surface", "units": "m"},
    )


def fill_below_sea_bed(field: NDArray[np.floating], lat: Array) -> Array:
    """
    A field (depth, lat, lon) without its NaN, so that interpolants near the sea bed and the coast see no gap.

    In a wet column the deepest valid value is carried downward; a land column takes the filled column of the nearest
    wet one, a degree of longitude being shortened as at the middle latitude. Nothing is meant to be there.
    """
    filled = np.array(field, dtype=float)
    wet = np.isfinite(filled[0])
    if not wet.any():
        raise OceanError("ocean: no wet column in the window; choose a window over water")
    for k in range(1, len(filled)):
        filled[k] = np.where(np.isfinite(filled[k]), filled[k], filled[k - 1])
    if wet.all():
        return filled
    aspect = max(float(np.cos(np.radians(np.mean(lat)))), 1e-3)
    rows, columns = ndimage.distance_transform_edt(
        ~wet, sampling=(1.0, aspect), return_distances=False, return_indices=True
    )
    return np.ascontiguousarray(filled[:, rows, columns])


@dataclass(frozen=True, eq=False)
class FinerFloor:
    """Sea floor of a file on a grid of its own in the local frame."""

    north: Array
    """Shape (n_north,). [m]"""
    east: Array
    """Shape (n_east,). [m]"""
    depth: Array
    """Shape (n_north, n_east), positive down. [m]"""
    spacing: tuple[float, float]
    """Of the file at the frame's centre, north and east. [m]"""
    widened: bool
    """Whether the nodes lie farther apart than the file's points, to keep within `MAX_FLOOR_NODES`."""
    averaged: int
    """Points of the file in each direction that were averaged for one node; 1 if none had to be."""


def is_finer(sea_floor: xr.DataArray, window: Window) -> bool:
    """Whether a sea floor's grid is as fine as the ocean's, or finer, by the area of a cell at the frame's centre."""
    theirs = Window(sea_floor["lat"].values, sea_floor["lon"].values, window.frame)
    cells = [np.prod(w.native_spacing()) for w in (theirs, window)]
    return bool(np.sqrt(cells[0]) <= _SAME_SPACING * np.sqrt(cells[1]))


def local_floor(sea_floor: xr.DataArray, window: Window, half_extent: tuple[float, float]) -> FinerFloor:
    """
    Sea floor of a file on a regular grid of the local frame, bilinear between the file's points and spaced about as they.

    With more than `MAX_FLOOR_NODES` at the file's own spacing the nodes are set wider apart, and the file is averaged over
    as many points first.
    """
    theirs = Window(sea_floor["lat"].values, sea_floor["lon"].values, window.frame)
    if not theirs.holds(*half_extent):
        lat, lon = theirs.lat, theirs.lon
        raise OceanError(
            f"sea floor {sea_floor.attrs.get('source', '')}: covers latitude {lat[0]:g} to {lat[-1]:g}, longitude"
            f" {lon[0]:g} to {lon[-1]:g}, not the domain of +-{half_extent[0] / 1e3:g} km by"
            f" +-{half_extent[1] / 1e3:g} km; fetch a larger window or shrink half_extent"
        )
    spacing = theirs.native_spacing()
    wider = 1.0
    while True:
        cells = [max(_MIN_CELLS, round(h / (wider * s))) for h, s in zip(half_extent, spacing, strict=True)]
        if np.prod([2.0 * n + 1.0 for n in cells]) <= MAX_FLOOR_NODES:
            break
        wider *= 1.1
    north, east = (np.linspace(-h, h, 2 * n + 1) for h, n in zip(half_extent, cells, strict=True))
    depth = np.asarray(sea_floor.values, dtype=float)
    averaged = 2 * (int(0.5 * wider)) + 1
    if averaged > 1:
        depth = ndimage.uniform_filter(depth, averaged, mode="nearest")
    bilinear = RegularGridInterpolator((theirs.lat, theirs.lon), depth, bounds_error=False, fill_value=None)
    at_lat, at_lon = theirs.geographic(north[:, None], east[None, :])
    at_lat = np.clip(at_lat, theirs.lat[0], theirs.lat[-1])  # a side may lie on the window's edge
    at_lon = np.clip(at_lon, theirs.lon[0], theirs.lon[-1])
    nodes = np.clip(bilinear((at_lat, at_lon)), depth.min(), depth.max())
    return FinerFloor(north, east, nodes, spacing, wider > 1.0, averaged)


def levels_to(depth: Array, deepest: float) -> Array:
    """
    Levels that a sea floor beneath an ocean's deepest one asks for, none if the levels reach it. [m]

    Evenly spaced, not wider than the ocean's last two levels, the last one at the deepest point.
    """
    missing = deepest - depth[-1]
    if missing <= 0.0:
        return np.empty(0)
    count = int(np.ceil(missing / (depth[-1] - depth[-2]) - 1e-9))
    return np.asarray(np.linspace(depth[-1], deepest, count + 1)[1:])


def window_of(ocean: xr.Dataset) -> tuple[float, float, float, float]:
    """South, north, west and east of an ocean, to ask a file of the sea floor for. [degrees]"""
    lat, lon = ocean["lat"].values, ocean["lon"].values
    return float(lat[0]), float(lat[-1]), float(lon[0]), float(lon[-1])
