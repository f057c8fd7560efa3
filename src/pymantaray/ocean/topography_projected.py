"""Sea floors on the axes of a map projection, such as IBCAO's, put on latitude and longitude."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pyproj
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from pymantaray.errors import OceanError
from pymantaray.geometry.longitude import eastward, whole_turns
from pymantaray.ocean.files import file_name, text
from pymantaray.ocean.grid import GeographicWindow

Array = NDArray[np.float64]
MAX_NODES = 16_000_000
"""Nodes of the geographic grid at most."""
_DEGREE = 111_195.0  # m, of latitude on the mean sphere
_UNITS = {"m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "km": 1e3, "kilometer": 1e3}
_REMEDY = 'name it with crs, "EPSG:3996" for IBCAO, or use the geographic version of the file'


def axis_metres(file: xr.Dataset, axis: str) -> float | None:
    """
    Length of an axis' unit, if it is one of length.

    Parameters
    ----------
    file : xarray.Dataset
    axis : str
        Name of a variable in it.

    Returns
    -------
    float or None
        None if the unit is not stated or is none of length. [m]
    """
    return _UNITS.get(text(file.variables[axis], "units").lower())


def mapping_of(file: xr.Dataset, variable: str, crs: str | None) -> pyproj.CRS:
    """
    Coordinate reference system of a variable on projected axes.

    Parameters
    ----------
    file : xarray.Dataset
    variable : str
        Its attribute ``grid_mapping`` names a variable of the file (CF conventions, section 5.6); else the
        only variable with a grid mapping's attributes is taken.
    crs : str or None
        What the user says; it comes first.

    Returns
    -------
    pyproj.CRS

    Raises
    ------
    OceanError
        If there is none, or it cannot be understood.
    """
    if crs is not None:
        try:
            return pyproj.CRS.from_user_input(crs)
        except pyproj.exceptions.CRSError:
            raise OceanError(f"crs {crs!r} is unknown to PROJ; write it as EPSG:3996") from None
    named = text(file.variables[variable], "grid_mapping")
    candidates = [named] if named in file.variables else list(file.variables)
    attributes = [file.variables[name].attrs for name in candidates]
    mappings = [a for a in attributes if {"grid_mapping_name", "crs_wkt", "spatial_ref"} & set(a)]
    if len(mappings) != 1:
        raise OceanError(
            f"{file_name(file)}: axes of {variable} are projected, and {len(mappings)} grid mappings are given;"
            f" {_REMEDY}"
        )
    try:
        return pyproj.CRS.from_cf(_plain(mappings[0]))
    except (pyproj.exceptions.CRSError, KeyError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split())[:100]
        raise OceanError(
            f"{file_name(file)}: its grid mapping cannot be understood ({reason}); {_REMEDY}"
        ) from None


def _plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Numpy's scalars as Python's, which pyproj wants."""
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in attributes.items()}


def geographic_grid(
    axes: tuple[Array, Array, float],
    read: Callable[[slice, slice], Array],
    crs: pyproj.CRS,
    window: GeographicWindow,
    file: str,
) -> tuple[Array, Array, Array]:
    """
    Field on projected axes, bilinear at the nodes of a grid of latitude and longitude.

    Parameters
    ----------
    axes : tuple of ndarray, ndarray and float
        Axes along y and x, monotone, and the length of their unit. [unit, unit, m]
    read : callable
        Gives a rectangle of the file from slices along y and x.
    crs : pyproj.CRS
        Of these axes.
    window : tuple of float
        South, north, west, east. [degrees]
    file : str
        Name for messages.

    Returns
    -------
    lat, lon : ndarray, shape (lat,), (lon,)
        Spaced as the file is at the window's middle. [degrees]
    values : ndarray, shape (lat, lon)
        NaN where the file does not reach. In the file's unit.

    Raises
    ------
    OceanError
        If the window holds too many nodes or does not meet the file.
    """
    y, x, unit = axes
    spacing = unit * float(np.median(np.abs(np.diff(x))))
    lat, lon = _nodes(window, spacing, file)
    to_file = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    at_x, at_y = to_file.transform(*np.meshgrid(lon, lat))
    at_x, at_y = at_x / unit, at_y / unit
    rows, columns = _reach(y, at_y), _reach(x, at_x)
    if rows.stop - rows.start < 2 or columns.stop - columns.start < 2:
        raise OceanError(f"{file}: the window {window} is not in it; fetch the grid that covers it")
    if (rows.stop - rows.start) * (columns.stop - columns.start) > MAX_NODES:
        raise OceanError(
            f"{file}: the window needs more than {MAX_NODES:,} of its points; choose a smaller one"
        )
    values = read(rows, columns)[:: 1 if y[-1] > y[0] else -1, :: 1 if x[-1] > x[0] else -1]
    bilinear = RegularGridInterpolator(
        (np.sort(y[rows]), np.sort(x[columns])), values, bounds_error=False, fill_value=np.nan
    )
    return lat, lon, np.asarray(bilinear((at_y, at_x)))


def _nodes(window: GeographicWindow, spacing: float, file: str) -> tuple[Array, Array]:
    south, north, west, east = window
    east = eastward(west, east)
    middle = float(np.cos(np.radians(0.5 * (south + north))))
    n_lat = 1 + max(1, round((north - south) * _DEGREE / spacing))
    n_lon = 1 + max(1, round((east - west) * _DEGREE * max(middle, 1e-3) / spacing))
    if n_lat * n_lon > MAX_NODES:
        raise OceanError(
            f"{file}: {n_lat * n_lon:,} nodes {spacing:g} m apart in the window; allowed {MAX_NODES:,}, choose"
            " a smaller one"
        )
    turn = whole_turns(0.5 * (west + east))
    return np.linspace(south, north, n_lat), np.linspace(west - turn, east - turn, n_lon)


def _reach(axis: Array, wanted: Array) -> slice:
    """Entries of a monotone axis that are needed for values between, one to spare on either side."""
    finite = wanted[np.isfinite(wanted)]
    if not finite.size:
        return slice(0, 0)
    rising = axis if axis[-1] > axis[0] else axis[::-1]
    if finite.max() < rising[0] or finite.min() > rising[-1]:
        return slice(0, 0)
    first = max(int(np.searchsorted(rising, finite.min(), side="right")) - 2, 0)
    last = min(int(np.searchsorted(rising, finite.max(), side="left")) + 2, axis.size)
    return slice(first, last) if axis[-1] > axis[0] else slice(axis.size - last, axis.size - first)
