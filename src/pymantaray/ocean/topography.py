"""Sea floor from a file of depths or heights: GEBCO, ETOPO, IBCAO, GLORYS and whatever names its variable by CF."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.geometry.longitude import eastward, whole_turns, wrapped
from pymantaray.ocean.files import file_name, numbers, open_file, text
from pymantaray.ocean.grid import GeographicWindow, checked_window
from pymantaray.ocean.topography_projected import axis_metres, geographic_grid, mapping_of

Array = NDArray[np.float64]

MAX_POINTS = 40_000_000
"""Grid points that are read at most: 320 MB as numbers of double precision."""
_DEEPEST, _HIGHEST = 11_100.0, 9_000.0  # m; beyond these a fill value or a unit is wrong
_DOWN = {
    "sea_floor_depth_below_sea_surface",
    "sea_floor_depth_below_geoid",
    "sea_floor_depth_below_mean_sea_level",
    "sea_floor_depth_below_geopotential_datum",
    "sea_floor_depth",
}
_UP = {
    "height_above_reference_ellipsoid",  # what GEBCO calls its heights, which are above mean sea level
    "height_above_mean_sea_level",
    "height_above_geopotential_datum",
    "surface_altitude",
    "bedrock_altitude",
    "altitude",
}
_NAMED = {
    "deptho": "down",
    "elevation": "up",
    "z": "up",
    "topo": "up",
    "altitude": "up",
    "bathymetry": "",
    "bathy": "",
    "depth": "",
    "band1": "",
}
_LAT, _LON = {"lat", "latitude", "nav_lat", "y"}, {"lon", "longitude", "nav_lon", "x"}
_Y, _X = ("latitude", "projection_y_coordinate"), ("longitude", "projection_x_coordinate")
_METRES = {"", "m", "meter", "meters", "metre", "metres"}


class _Field(NamedTuple):
    """Variable that holds the sea floor, its two axes, and which way it counts."""

    file: xr.Dataset
    variable: str
    lat: str
    lon: str
    positive: str
    """``"up"``, ``"down"``, or empty where only the values can tell."""

    def axis(self, name: str) -> Array:
        """Values of an axis, monotone."""
        values = numbers(self.file, name).ravel()
        steps = np.diff(values)
        if values.size < 2 or not (np.all(steps > 0.0) or np.all(steps < 0.0)):
            raise OceanError(
                f"{file_name(self.file)}: axis {name} is not monotone or has fewer than 2 points; sort it"
            )
        return values

    def read(self, rows: slice, columns: slice) -> Array:
        """One rectangle, latitude first."""
        dims = self.file.variables[self.variable].dims
        block = numbers(self.file, self.variable, {self.lat: rows, self.lon: columns})
        single = tuple(k for k, dim in enumerate(dims) if dim not in (self.lat, self.lon))
        block = block.squeeze(single)
        first = next(dim for dim in dims if dim in (self.lat, self.lon))
        return block if first == self.lat else block.T


def open_sea_floor(
    path: str | Path, *, window: GeographicWindow | None = None, crs: str | None = None
) -> xr.DataArray:
    """
    Depth of the sea floor from a NetCDF file.

    Known are GEBCO (``elevation``), ETOPO (``z``, also on axes ``x`` and ``y`` in degrees), IBCAO
    (geographic, or polar stereographic in metres), GLORYS (``deptho`` with ``mask``), and any variable on
    two horizontal axes whose CF standard name is a sea floor depth, a height or an altitude. Only the
    window is read.

    Parameters
    ----------
    path : str or Path
        NetCDF-3 or NetCDF-4.
    window : tuple of float, optional
        South, north, west, east; longitudes in any 360 degree window. By default the whole file; needed
        for a file in a map projection. [degrees]
    crs : str, optional
        Coordinate reference system of a file on projected axes that names none, such as ``"EPSG:3996"``
        for IBCAO's grids.

    Returns
    -------
    xarray.DataArray, shape (lat, lon)
        Positive down, 0 on land; latitudes and longitudes rise. One point beyond the window on each side
        is kept where the file has it. Attribute ``source`` names file and variable. [m]

    Raises
    ------
    OceanError
        If the file cannot be read, holds no such variable or several, does not reach the window, lacks
        values in it, or is projected without saying how.

    Notes
    -----
    Heights above mean sea level, the geoid and the sea surface are taken for one another: they differ by
    up to 2 m, less than the vertical error of any of these grids. A height above the ellipsoid would
    differ by up to 100 m; GEBCO's standard name says that, but its long name says sea level. Where a depth
    is missing there is land, as models have it; where a height is missing the file is refused.
    """
    with open_file(path) as file:
        field = _find(file)
        if _is_projected(field):
            if window is None:
                raise OceanError(
                    f"{file_name(field.file)}: its axes are in metres; name a window (south, north, west, east)"
                )
            unit = axis_metres(field.file, field.lon)
            lat, lon, values = geographic_grid(
                (field.axis(field.lat), field.axis(field.lon), 1.0 if unit is None else unit),
                field.read,
                mapping_of(field.file, field.variable, crs),
                checked_window(window),
                file_name(field.file),
            )
        else:
            lat, lon, values = _cut(field, window)
    return xr.DataArray(
        _downward(values, field),
        coords={
            "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        },
        dims=("lat", "lon"),
        name="sea_floor_depth",
        attrs={
            "standard_name": "sea_floor_depth_below_sea_surface",
            "units": "m",
            "positive": "down",
            "source": f"{file_name(field.file)}: {field.variable}",
        },
    )


def _find(file: xr.Dataset) -> _Field:
    """Variable on two horizontal axes whose standard name, or else name, is a sea floor's."""
    ranked: dict[bool, list[_Field]] = {True: [], False: []}
    for name, variable in file.variables.items():
        name = str(name)
        axes = _horizontal(file, variable)
        standard, stated = text(variable, "standard_name"), text(variable, "positive").lower()
        by_standard = "down" if standard in _DOWN else "up" if standard in _UP else None
        by_name = _NAMED.get(name.lower())
        if axes is None or (by_standard is None and by_name is None):
            continue
        positive = stated if stated in ("up", "down") else by_standard or by_name or ""
        ranked[by_standard is not None].append(_Field(file, name, *axes, positive))
    found = ranked[True] or ranked[False]
    if len(found) == 1:
        units = text(file.variables[found[0].variable], "units").lower()
        if units not in _METRES:
            raise OceanError(f"{file_name(file)}: {found[0].variable} is in {units!r}; needs metres")
        return found[0]
    if found:
        names = ", ".join(f.variable for f in found)
        raise OceanError(f"{file_name(file)}: several sea floors ({names}); keep one in the file")
    if "spacing" in file.variables and len(file.variables.get("z", file.variables["spacing"]).dims) == 1:
        raise OceanError(
            f"{file_name(file)}: GEBCO's old one-dimensional layout; convert it with GMT's grdconvert to a grid"
        )
    listed = ", ".join([str(n) for n, v in file.variables.items() if v.dims != (n,)][:6]) or "nothing"
    raise OceanError(
        f"{file_name(file)}: no sea floor on latitude and longitude among {listed}; needs elevation, z, deptho or a"
        " variable with a CF standard name such as sea_floor_depth_below_geoid"
    )


def _horizontal(file: xr.Dataset, variable: xr.Variable) -> tuple[str, str] | None:
    """Names of the latitude-like and the longitude-like dimension; every other one has one entry."""
    lat = lon = None
    for dim, size in zip(map(str, variable.dims), variable.shape, strict=True):
        axis = file.variables.get(dim)
        standard = "" if axis is None else text(axis, "standard_name")
        named = axis is not None and axis.dims == (dim,)
        if named and (standard in _Y or (not standard and dim.lower() in _LAT)):
            lat = dim
        elif named and (standard in _X or (not standard and dim.lower() in _LON)):
            lon = dim
        elif size != 1:
            return None
    return None if lat is None or lon is None else (lat, lon)


def _is_projected(field: _Field) -> bool:
    for name, limit in ((field.lat, 90.0), (field.lon, 540.0)):
        if axis_metres(field.file, name) is not None:
            return True
        degrees = text(field.file.variables[name], "units").lower().startswith("degree")
        if not degrees and np.max(np.abs(field.axis(name))) > limit + 1e-6:
            return True
    return False


def _cut(field: _Field, window: GeographicWindow | None) -> tuple[Array, Array, Array]:
    """Latitudes, longitudes and values of a window, as few rectangles of the file as that takes."""
    lat, lon = field.axis(field.lat), field.axis(field.lon)
    name = file_name(field.file)
    if np.abs(lat).max() > 90.0 + 1e-6:
        raise OceanError(f"{name}: latitudes {lat.min():g} to {lat.max():g}; allowed -90 to 90 degrees")
    rows, columns, turned = _inside(lat, lon, None if window is None else checked_window(window))
    if rows.size < 2 or columns.size < 2:
        raise OceanError(
            f"{name}: covers latitude {lat.min():g} to {lat.max():g}, longitude {lon.min():g} to {lon.max():g};"
            f" the window {window} is not in it, fetch that part"
        )
    if rows.size * columns.size > MAX_POINTS:
        raise OceanError(
            f"{name}: {rows.size * columns.size:,} points asked for; at most {MAX_POINTS:,} are read, name a"
            " window (south, north, west, east)"
        )
    runs = np.split(columns, np.flatnonzero(np.abs(np.diff(columns)) != 1) + 1)
    top = int(rows.min())
    pieces = []
    for run in runs:
        left = int(run.min())
        block = field.read(slice(top, int(rows.max()) + 1), slice(left, int(run.max()) + 1))
        pieces.append(block[np.ix_(rows - top, run - left)])
    return lat[rows], turned, np.concatenate(pieces, axis=1)


def _inside(
    lat: Array, lon: Array, window: GeographicWindow | None
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Indices that make latitude and longitude rise through a window, and those longitudes."""
    order = np.argsort(lat)
    if window is None:
        turned = lon % 360.0
        ahead = np.argsort(turned)
        gaps = np.diff(turned[ahead], append=turned[ahead[0]] + 360.0)
        west = turned[ahead[(int(np.argmax(gaps)) + 1) % len(ahead)]]  # begin after the widest gap
        south, north, east = -90.0, 90.0, west + 360.0
    else:
        south, north, west, east = window
        east = eastward(west, east)
    margin_lat, margin_lon = (1.000001 * np.max(np.abs(np.diff(axis))) for axis in (lat, lon))
    rows = order[(lat[order] >= south - margin_lat) & (lat[order] <= north + margin_lat)]
    middle = 0.5 * (west + east)
    turned = wrapped(lon, about=middle)
    columns = np.argsort(turned)
    turned = turned[columns]
    kept = (turned >= west - margin_lon) & (turned <= east + margin_lon)
    kept[1:] &= np.diff(turned) > 1e-9  # a grid may hold both 180 W and 180 E
    turned, columns = turned[kept], columns[kept]
    if turned.size:
        turned = turned - whole_turns(0.5 * (turned[0] + turned[-1]))
    return rows, columns, turned


def _downward(values: Array, field: _Field) -> Array:
    """Depth, positive down, 0 on land and where a depth is missing."""
    name, positive = f"{file_name(field.file)}: {field.variable}", field.positive
    finite = values[np.isfinite(values)]
    if not finite.size:
        raise OceanError(f"{name} has no value in the window; choose another window")
    if not positive:
        positive = "down" if finite.min() >= 0.0 else "up" if finite.max() <= 0.0 else ""
    if not positive:
        raise OceanError(f"{name} has both signs and does not say which is down; set its attribute positive")
    depth = values if positive == "down" else -values
    low, high = float(np.nanmin(depth)), float(np.nanmax(depth))
    if low < -_HIGHEST or high > _DEEPEST:
        raise OceanError(
            f"{name} reaches from {-low:g} m above the sea to {high:g} m below; allowed are"
            f" {_HIGHEST:g} and {_DEEPEST:g}, check fill value and units"
        )
    missing = int(np.count_nonzero(np.isnan(depth)))
    if missing and positive == "up":
        raise OceanError(
            f"{name} has no value at {missing} of {depth.size} points of the window; choose a"
            " window that the file fills"
        )
    return np.where(np.isnan(depth), 0.0, np.maximum(depth, 0.0))
