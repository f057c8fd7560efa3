"""Which part of a data set's grid a window takes, and in which blocks it is read."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.geometry.longitude import contiguous

Array = NDArray[np.float64]
GeographicWindow = tuple[float, float, float, float]
"""South, north, west, east. [degrees]"""
SAME_DEGREES = 1e-3
"""HYCOM's coordinates are off the exact grid by 3e-5. [degrees]"""
_MOST_BLOCKS = 8


@dataclass(frozen=True)
class Selection:
    """Grid points of a window: what to read from the file, and how to put it in order."""

    lat: Array
    """Rising. [degrees]"""
    lon: Array
    """Rising, with the middle in -180 to 180. [degrees]"""
    rows: slice
    """Of the file."""
    falling: bool
    """Whether latitudes fall in the file."""
    blocks: tuple[slice, ...]
    """Columns of the file."""
    order: NDArray[np.intp]
    """Puts the columns of the blocks, one after the other, in a row."""


def checked_window(window: GeographicWindow) -> GeographicWindow:
    """
    Check a window.

    Parameters
    ----------
    window : tuple of float
        South, north, west, east; west may be the greater, across the antimeridian. [degrees]

    Returns
    -------
    tuple of float

    Raises
    ------
    OceanError
        If it is not four numbers, or south is not below north.
    """
    try:
        south, north, west, east = (float(v) for v in window)
    except (TypeError, ValueError):
        raise OceanError(
            f"window {window!r} is not four numbers: south, north, west, east in degrees"
        ) from None
    if not np.all(np.isfinite([south, north, west, east])) or not -90.0 <= south < north <= 90.0:
        raise OceanError(
            f"window {window!r}: needs south, north, west, east in degrees, south below north within -90 to 90"
        )
    return south, north, west, east


def select(lat: Array, lon: Array, window: GeographicWindow | None, where: str) -> Selection:
    """
    Choose the grid points of a window.

    Parameters
    ----------
    lat, lon : ndarray, shapes (lat,), (lon,)
        As in the file: latitudes rise or fall, longitudes are counted in any way. [degrees]
    window : tuple of float, optional
        South, north, west, east; by default everything. [degrees]
    where : str
        File, for messages.

    Returns
    -------
    Selection

    Raises
    ------
    OceanError
        If an axis is not one of latitude or longitude, or the window holds no point.
    """
    for name, axis, bound in (("latitude", lat, 90.0), ("longitude", lon, 720.0)):
        if axis.size == 0 or not np.all(np.isfinite(axis)):
            raise OceanError(f"{where}: {name} is empty or has values that are missing; correct the axis")
        if np.max(np.abs(axis)) > bound + SAME_DEGREES:
            raise OceanError(f"{where}: {name} reaches {np.max(np.abs(axis)):g}; is it in degrees?")
    steps = np.diff(lat)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise OceanError(f"{where}: latitude neither rises nor falls throughout; sort it and drop duplicates")
    rows, columns = np.arange(lat.size), np.arange(lon.size)
    if window is not None:
        south, north, west, east = checked_window(window)
        rows = rows[(lat >= south - SAME_DEGREES) & (lat <= north + SAME_DEGREES)]
        width = 360.0 if east - west >= 360.0 else (east - west) % 360.0
        columns = columns[(lon - west + SAME_DEGREES) % 360.0 <= width + 2.0 * SAME_DEGREES]
        if rows.size == 0 or columns.size == 0:
            raise OceanError(
                f"{where}: no grid point in the window {south:g} to {north:g} N, {west:g} to {east:g} E; the data"
                f" reach from {lat.min():g} to {lat.max():g} N and {lon.min():g} to {lon.max():g} E"
            )
    runs = np.split(columns, np.flatnonzero(np.diff(columns) != 1) + 1)
    if len(runs) > _MOST_BLOCKS:  # longitudes in no order: read all between the outermost
        runs = [np.arange(columns[0], columns[-1] + 1)]
    read = np.concatenate(runs)
    order, rising = contiguous(lon[columns])
    falling = bool(steps.size and steps[0] < 0.0)
    taken = lat[rows[0] : rows[-1] + 1]
    return Selection(
        np.ascontiguousarray(taken[::-1] if falling else taken),
        rising,
        slice(int(rows[0]), int(rows[-1]) + 1),
        falling,
        tuple(slice(int(run[0]), int(run[-1]) + 1) for run in runs),
        np.searchsorted(read, columns)[order],
    )


def crop(ocean: xr.Dataset, window: GeographicWindow | None) -> xr.Dataset:
    """
    Part of a valid ocean that lies in a window.

    Parameters
    ----------
    ocean : xarray.Dataset
    window : tuple of float, optional
        As in `select`.

    Returns
    -------
    xarray.Dataset
        The same one without a window.

    Raises
    ------
    OceanError
        If the window holds no point.
    """
    if window is None:
        return ocean
    chosen = select(ocean["lat"].values, ocean["lon"].values, window, str(ocean.attrs["title"]))
    columns = np.concatenate([np.r_[block] for block in chosen.blocks])[chosen.order]
    return ocean.isel(lat=chosen.rows, lon=columns)
