"""
Sea floor from the levels of an ocean or from a file of depths or heights, and extension of fields
below it.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyproj
import xarray as xr

from pymantaray.arrays import AnyArray, Array, Indices, Mask
from pymantaray.errors import OceanError
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.geometry.longitude import eastward, whole_turns
from pymantaray.messages import one_line
from pymantaray.ocean.convert import is_our_unit, is_unit_of, to_our_unit
from pymantaray.ocean.files import file_name, numbers, open_file, text
from pymantaray.ocean.rasters import RASTER
from pymantaray.ocean.schema import SEA_FLOOR, SEA_FLOOR_ATTRIBUTES, layer_edges
from pymantaray.ocean.sea_floor_water import SIGN_REMEDY, in_water, sea_floor_notes
from pymantaray.ocean.window import GeographicWindow, Window, checked_window, select

MAX_FLOOR_NODES = 1_000_000
"""
Maximum number of nodes of a finer sea floor in the local frame; a larger spacing replaces that of a
larger file.
"""
MIN_CELLS = 2  # on either side of the centre: five nodes, enough for a cubic spline
MAX_POINTS = 40_000_000
"""Maximum number of grid points to read from a file: 320 MB in double precision."""
# latitudes times longitudes onto which a file in a map projection is interpolated
_MAX_NODES = 16_000_000
_SAME_SPACING = 1.01  # ratio of spacings up to which a file is not coarser than the ocean's grid
_DEEPEST = 11_100.0  # m; beyond these a fill value or a unit is wrong
_HIGHEST = 9_000.0
_GAP_FILL = 9_999.0  # m; a depth or height of exactly this without similar ones is a gap
_SIMILAR = 100.0  # m
_DEGREE = 111_195.0  # m, of latitude on the mean sphere
_DOWN = (
    "sea_floor_depth_below_sea_surface",
    "sea_floor_depth_below_geoid",
    "sea_floor_depth_below_mean_sea_level",
    "sea_floor_depth_below_geopotential_datum",
    "sea_floor_depth",
)
_UP = (
    # GEBCO's name for its heights, which are above mean sea level
    "height_above_reference_ellipsoid",
    "height_above_mean_sea_level",
    "height_above_geopotential_datum",
    "surface_altitude",
    "bedrock_altitude",
    "altitude",
)
_NAMED = {"deptho": "down", "elevation": "up", "z": "up", "topo": "up", "altitude": "up"}
_RASTERS = (RASTER, "band1", "band_data")  # of files without names: mixed signs are heights
_NAMED |= dict.fromkeys(("bathymetry", "bathy", "depth", *_RASTERS), "")
_LAT = ("lat", "latitude", "nav_lat", "y")
_LON = ("lon", "longitude", "nav_lon", "x")
_Y = ("latitude", "projection_y_coordinate")
_X = ("longitude", "projection_x_coordinate")
_CRS_REMEDY = 'name it with crs, "EPSG:3996" for IBCAO, or use the geographic version of the file'


def sea_floor_depth(ocean: xr.Dataset) -> xr.DataArray:
    """
    Sea floor of an ocean: of its model, or from its levels, half-way from the deepest valid level
    of each column to the next.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.

    Returns
    -------
    xarray.DataArray, dimensions (lat, lon)
        Depth; 0 on land, and the depth of the last level if it is valid. [m]

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import sea_floor_depth
    >>> float(sea_floor_depth(ocean).max())
    3500.0
    """
    if SEA_FLOOR in ocean:
        return ocean[SEA_FLOOR]
    depth = np.asarray(ocean["depth"].values, dtype=float)
    return xr.DataArray(
        layer_edges(depth)[np.isfinite(ocean["water_temp"].values).sum(axis=0)],
        coords={"lat": ocean["lat"], "lon": ocean["lon"]},
        dims=("lat", "lon"),
        name=SEA_FLOOR,
        attrs=SEA_FLOOR_ATTRIBUTES,
    )


def fill_below_sea_bed(field: AnyArray, lat: Array) -> Array:
    """
    Replace the NaN of a field below the sea bed and on land, so that interpolation near sea bed and
    coast has no gaps.

    A wet column has its deepest valid value at all deeper levels. A land column is a copy of the
    nearest wet column, with distances at the middle latitude. The new values have no physical
    meaning.

    Parameters
    ----------
    field : ndarray, shape (n_depth, n_lat, n_lon)
        Field with NaN outside the water.
    lat : ndarray, shape (n_lat,)
        Latitudes. [degrees]

    Returns
    -------
    ndarray, shape (n_depth, n_lat, n_lon)
        Field without NaN.

    Raises
    ------
    OceanError
        If the field has no wet column.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import fill_below_sea_bed
    >>> temperature = ocean["water_temp"].values
    >>> filled = fill_below_sea_bed(temperature, ocean["lat"].values)
    >>> bool(np.isnan(temperature).any()), bool(np.isnan(filled).any())
    (True, False)
    """
    filled = extended_down(np.asarray(field, dtype=float))
    wet = np.isfinite(filled[0])
    if wet.all():
        return filled
    rows, columns = nearest_wet_columns(wet, lat)
    return np.ascontiguousarray(filled[:, rows, columns])


def extended_down(field: AnyArray) -> Array:
    """
    Copy of a field (n_depth, ...) with the value above at each NaN; a column without a value at the
    first level keeps its NaN.
    """
    filled = np.array(field, dtype=float)
    missing = ~np.isfinite(filled)
    for k in range(1, len(filled)):
        np.copyto(filled[k], filled[k - 1], where=missing[k])
    return filled


def nearest_wet_columns(wet: Mask, lat: Array) -> tuple[Indices, Indices]:
    """
    Row and column (n_lat, n_lon) of the wet column nearest to each column, as in
    `fill_below_sea_bed`.
    """
    from scipy import ndimage

    if not wet.any():
        raise OceanError("ocean: no wet column in the window; choose a window over water")
    aspect = max(float(np.cos(np.radians(np.mean(lat)))), 1e-3)
    nearest = ndimage.distance_transform_edt(
        ~wet, sampling=(1.0, aspect), return_distances=False, return_indices=True
    )
    return np.asarray(nearest[0], dtype=np.intp), np.asarray(nearest[1], dtype=np.intp)


def local_floor(
    sea_floor: xr.DataArray, window: Window, half_extent: tuple[float, float]
) -> xr.DataArray:
    """
    Interpolate the sea floor of a file bilinearly to a regular grid of the local frame with about
    the spacing of the file, or of the window if that is finer.

    If the spacing requires more than `MAX_FLOOR_NODES` nodes, the grid has a
    larger spacing and the function first averages the file over this spacing. The attribute
    ``source`` records this; ``spacing`` is that of the file, north and east. [m]
    """
    if sea_floor.dims != ("lat", "lon") or min(sea_floor.shape) < 2:
        raise OceanError(
            f"sea_floor has dimensions {sea_floor.dims}, shape {sea_floor.shape}; it must have"
            " (lat, lon) with at least 2 points each, as open_sea_floor returns it"
        )
    # spacing of the file, or of the window if that is finer
    theirs = Window(sea_floor["lat"].values, sea_floor["lon"].values, window.frame)
    spacing = theirs.native_spacing()
    step = spacing
    native = window.native_spacing()
    if np.sqrt(np.prod(spacing)) > _SAME_SPACING * np.sqrt(np.prod(native)):  # a coarser file
        step = (min(spacing[0], native[0]), min(spacing[1], native[1]))
    # the file must cover the domain
    name = str(sea_floor.attrs.get("source", "sea_floor"))
    if not theirs.holds(*half_extent):
        lat = theirs.lat
        lon = theirs.lon
        raise OceanError(
            f"{name}: covers latitude {lat[0]:g} to {lat[-1]:g}, longitude {lon[0]:g} to"
            f" {lon[-1]:g}, not the domain of +-{half_extent[0] / 1e3:g} km by"
            f" +-{half_extent[1] / 1e3:g} km; fetch a larger window or shrink half_extent"
        )
    # a larger spacing if there would be too many nodes
    wider = 1.0
    while True:
        cells = [
            max(MIN_CELLS, round(h / (wider * s))) for h, s in zip(half_extent, step, strict=True)
        ]
        if np.prod([2.0 * n + 1.0 for n in cells]) <= MAX_FLOOR_NODES:
            break
        wider *= 1.1
    north, east = (np.linspace(-h, h, 2 * n + 1) for h, n in zip(half_extent, cells, strict=True))
    # means of the file over a larger spacing
    depth = np.asarray(sea_floor.values, dtype=float)
    source = f"{name}, {spacing[0]:.0f} m by {spacing[1]:.0f} m"
    points = 2 * int(0.5 * wider * min(step[0] / spacing[0], step[1] / spacing[1])) + 1
    if points > 1:
        from scipy import ndimage

        depth = ndimage.uniform_filter(depth, points, mode="nearest")
    if wider > 1.0:
        source += (
            f", on nodes {north[1] - north[0]:.0f} m by {east[1] - east[0]:.0f} m apart because at"
            f" most {MAX_FLOOR_NODES:,} are kept, mean of {points} by {points} points"
        )
    # depths of the nodes
    bilinear = linear_interpolator((theirs.lat, theirs.lon), depth)
    nodes = bilinear(np.stack(theirs.geographic(north[:, None], east[None, :]), axis=-1))
    if nodes.max() <= 0.0:
        raise OceanError(f"{name}: is land in the whole domain; {SIGN_REMEDY}")
    return xr.DataArray(
        np.clip(nodes, depth.min(), depth.max()),
        {"floor_north": north, "floor_east": east},
        ("floor_north", "floor_east"),
        attrs={"source": source, "spacing": list(spacing), "notes": sea_floor_notes(sea_floor)},
    )


def levels_to(depth: Array, deepest: float) -> Array:
    """
    Levels that a sea floor beneath an ocean's deepest one asks for, none if the levels reach it.
    [m]

    Evenly spaced, not wider than the ocean's last two levels, the last one at the deepest point.
    """
    missing = deepest - depth[-1]
    if missing <= 0.0:
        return np.empty(0)
    count = int(np.ceil(missing / (depth[-1] - depth[-2]) - 1e-9))
    return np.asarray(np.linspace(depth[-1], deepest, count + 1)[1:])


def open_sea_floor(
    path: str | Path,
    *,
    window: GeographicWindow | None = None,
    crs: str | None = None,
    ocean: xr.Dataset | None = None,
) -> xr.DataArray:
    """
    Depth of the sea floor from a NetCDF file.

    Supported are GEBCO (``elevation``), ETOPO (``z``, also on axes ``x`` and ``y`` in degrees),
    IBCAO (geographic, or polar stereographic in metres), GLORYS (``deptho`` with ``mask``), and any
    variable on two horizontal axes with the CF standard name of a sea floor depth, a height or an
    altitude. The function reads only the window.

    Parameters
    ----------
    path : str or Path
        NetCDF-3 or NetCDF-4 file.
    window : tuple of float, optional
        South, north, west, east; longitudes in any 360 degree window. Default: the whole file.
        Required for a file in a map projection. [degrees]
    crs : str, optional
        Coordinate reference system of a file on projected axes without this information, such as
        ``"EPSG:3996"`` for IBCAO's grids.
    ocean : xarray.Dataset, optional
        A valid ocean whose water the sea floor must hold. Where the ocean has water and the file
        no depth, the depth is interpolated from the points around a gap, and outside the file it is
        the ocean's own.

    Returns
    -------
    xarray.DataArray, shape (lat, lon)
        Depth, positive down, 0 on land; latitudes and longitudes increase. It includes the points
        around the window if the file has them. The attribute ``source`` contains file and variable,
        ``notes`` missing values and differences from the water of the ocean. [m]

    Raises
    ------
    OceanError
        If the file cannot be read, contains no such variable or several, does not cover the window,
        lacks values in it, is in an unknown projection, or is land in most of the ocean's water.

    Notes
    -----
    The function does not distinguish heights above mean sea level, the geoid and the sea surface:
    they differ by up to 2 m, less than the vertical error of these grids. A height above the
    ellipsoid would differ by up to 100 m. GEBCO's standard name denotes this height, but its long
    name denotes sea level, which is correct. Without an ocean, a missing depth is land, as in
    models. A missing height raises an error.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import open_sea_floor, sea_floor_depth
    >>> sea_floor_depth(ocean).to_netcdf("floor.nc")
    >>> float(open_sea_floor("floor.nc").max())
    3500.0
    """
    with open_file(path) as data:
        field = _field_of(data)
        lat, lon, values = field.on_geographic(window, crs)
        name = f"{file_name(data)}: {field.name}"
        depth = _downward(values, field)
        missing = int(np.count_nonzero(np.isnan(depth)))
        notes = [f"no value at {missing} of {depth.size} points: land"] if missing else []
        if ocean is not None:
            lat, lon, depth = _extended(lat, lon, depth, window, name)
            own = np.asarray(sea_floor_depth(ocean).values, dtype=float)
            depth, notes = in_water(depth, lat, lon, ocean, own, name)
        return xr.DataArray(
            np.nan_to_num(depth),
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
                "source": name,
                "notes": tuple(f"{name}: {note}" for note in notes),
            },
        )


def _extended(
    lat: Array, lon: Array, depth: Array, window: GeographicWindow | None, name: str
) -> tuple[Array, Array, Array]:
    """Grid with points without a value, at its own spacing, where it does not cover a window."""
    if window is None:
        return lat, lon, depth
    south, north, west, east = checked_window(window)
    turn = 360.0 * np.round((0.5 * (lon[0] + lon[-1] - west - eastward(west, east))) / 360.0)
    axes, widths = [], []
    sides = (south, north), (west + turn, eastward(west, east) + turn)
    for axis, (low, high) in zip((lat, lon), sides, strict=True):
        step = float(np.median(np.diff(axis)))
        width = [
            max(int(np.ceil(gap / step - 1e-6)), 0) for gap in (axis[0] - low, high - axis[-1])
        ]
        before, after = (step * np.arange(1, count + 1) for count in width)
        axes.append(np.concatenate([axis[0] - before[::-1], axis, axis[-1] + after]))
        widths.append((width[0], width[1]))
    if axes[0].size * axes[1].size > _MAX_NODES:
        raise OceanError(
            f"{name}: covers only a part of the ocean, which has {axes[0].size * axes[1].size:,}"
            f" points at its spacing; the limit is {_MAX_NODES:,}; choose a smaller ocean"
        )
    return axes[0], axes[1], np.pad(depth, widths, constant_values=np.nan)


class HorizontalField(NamedTuple):
    """Variable on two horizontal axes, and its positive direction."""

    data: xr.Dataset
    name: str
    lat: str
    lon: str
    positive: str
    """``"up"``, ``"down"``, or empty if only the values show the direction."""

    def axis(self, name: str) -> Array:
        """Values of an axis, monotone; in metres if its unit is a length."""
        values = numbers(self.data, name).ravel()
        unit = text(self.data.variables[name], "units")
        steps = np.diff(values)
        if values.size < 2 or not (np.all(steps > 0.0) or np.all(steps < 0.0)):
            raise OceanError(
                f"{file_name(self.data)}: axis {name} is not monotone or has fewer than 2 points;"
                " sort it"
            )
        quantity = "length" if is_unit_of("length", unit) else "latitude"  # degrees or radians
        return (
            to_our_unit(values, quantity, unit, where=name)
            if is_unit_of(quantity, unit)
            else values
        )

    def is_projected(self) -> bool:
        """True if the axes are those of a map projection."""
        for name, limit in ((self.lat, 90.0), (self.lon, 540.0)):
            unit = text(self.data.variables[name], "units").lower()
            beyond = np.max(np.abs(self.axis(name))) > limit + 1e-6
            if is_unit_of("length", unit) or (beyond and not unit.startswith("degree")):
                return True
        return False

    def on_geographic(
        self, window: GeographicWindow | None, crs: str | None
    ) -> tuple[Array, Array, Array]:
        """Increasing latitudes and longitudes that enclose a window, and the values there."""
        return _projected(self, window, crs) if self.is_projected() else _cut(self, window)

    def read(self, rows: slice, columns: slice) -> Array:
        """Values of a rectangle (lat, lon)."""
        dims = self.data.variables[self.name].dims
        block = numbers(self.data, self.name, {self.lat: rows, self.lon: columns})
        block = block.squeeze(
            tuple(k for k, dim in enumerate(dims) if dim not in (self.lat, self.lon))
        )
        return block if dims.index(self.lat) < dims.index(self.lon) else block.T


def _field_of(data: xr.Dataset) -> HorizontalField:
    """Variable of the sea floor on two horizontal axes, by standard name or otherwise by name."""
    # variables of a sea floor on horizontal axes
    where = file_name(data)
    by_standard_name: list[HorizontalField] = []
    by_name: list[HorizontalField] = []
    for name, variable in data.variables.items():
        axes = horizontal_axes(data, variable)
        standard_name = text(variable, "standard_name")
        known = standard_name in _DOWN + _UP
        if axes is None or not (known or str(name).lower() in _NAMED):
            continue
        usual = ("down" if standard_name in _DOWN else "up") if known else _NAMED[str(name).lower()]
        stated = text(variable, "positive").lower()
        field = HorizontalField(
            data, str(name), *axes, stated if stated in ("up", "down") else usual
        )
        (by_standard_name if known else by_name).append(field)
    # there must be one, in metres
    fields = by_standard_name or by_name
    if len(fields) > 1:
        names = ", ".join(field.name for field in fields)
        raise OceanError(f"{where}: several sea floors ({names}); keep one in the file")
    if fields:
        unit = text(data.variables[fields[0].name], "units")
        if unit and not is_our_unit("length", unit):
            raise OceanError(f"{where}: {fields[0].name} is in {unit!r}; it must be in metres")
        return fields[0]
    # without one, say what the file contains
    if (
        "spacing" in data.variables
        and len(data.variables.get("z", data.variables["spacing"]).dims) == 1
    ):
        raise OceanError(
            f"{where}: GEBCO's old one-dimensional layout; convert it with GMT's grdconvert to a"
            " grid"
        )
    listed = (
        ", ".join([str(n) for n, v in data.variables.items() if v.dims != (n,)][:6]) or "nothing"
    )
    raise OceanError(
        f"{where}: no sea floor on latitude and longitude among {listed}; the file must have"
        " elevation, z, deptho or a variable with a CF standard name such as"
        " sea_floor_depth_below_geoid"
    )


def horizontal_axes(data: xr.Dataset, variable: xr.Variable) -> tuple[str, str] | None:
    """
    Names of the dimensions of latitude (or y) and longitude (or x); None if another dimension has
    several entries.
    """
    lat = lon = None
    for dim, size in zip(map(str, variable.dims), variable.shape, strict=True):
        axis = data.variables.get(dim)
        standard_name = "" if axis is None else text(axis, "standard_name")
        named = axis is not None and axis.dims == (dim,)
        if named and (standard_name in _Y or (not standard_name and dim.lower() in _LAT)):
            lat = dim
        elif named and (standard_name in _X or (not standard_name and dim.lower() in _LON)):
            lon = dim
        elif size != 1:
            return None
    return None if lat is None or lon is None else (lat, lon)


def _cut(field: HorizontalField, window: GeographicWindow | None) -> tuple[Array, Array, Array]:
    """Latitudes, longitudes and values of the grid points that enclose a window."""
    lat = field.axis(field.lat)
    lon = field.axis(field.lon)
    part = select(lat, lon, window, file_name(field.data), enclose=True)
    if min(part.lat.size, part.lon.size) < 2:
        raise OceanError(
            f"{file_name(field.data)}: covers latitude {lat.min():g} to {lat.max():g}, longitude"
            f" {lon.min():g} to {lon.max():g}; it does not contain the window {window}; fetch this"
            " part"
        )
    if part.lat.size * part.lon.size > MAX_POINTS:
        raise OceanError(
            f"{file_name(field.data)}: {part.lat.size * part.lon.size:,} points requested; the"
            f" limit is {MAX_POINTS:,}; give a window (south, north, west, east)"
        )
    values = np.concatenate([field.read(part.rows, block) for block in part.blocks], axis=1)
    return part.lat, part.lon, part.in_order(values)


def _projected(
    field: HorizontalField, window: GeographicWindow | None, crs: str | None
) -> tuple[Array, Array, Array]:
    """
    Interpolate a field on projected axes bilinearly to latitudes and longitudes with the file's
    spacing at the window's middle.
    """
    where = file_name(field.data)
    if window is None:
        raise OceanError(
            f"{where}: its axes are in metres; give a window (south, north, west, east)"
        )
    y = field.axis(field.lat)
    x = field.axis(field.lon)
    lat, lon = _nodes(checked_window(window), float(np.median(np.abs(np.diff(x)))), where)
    to_file = pyproj.Transformer.from_crs("EPSG:4326", _crs_of(field, crs), always_xy=True)
    at_x, at_y = to_file.transform(*np.meshgrid(lon, lat))
    rows = _reach(y, at_y)
    columns = _reach(x, at_x)
    size = (rows.stop - rows.start, columns.stop - columns.start)
    if min(size) < 2:
        raise OceanError(
            f"{where}: it does not contain the window {window}; fetch the grid that covers it"
        )
    if size[0] * size[1] > _MAX_NODES:
        raise OceanError(
            f"{where}: the window needs more than {_MAX_NODES:,} of its points; choose a smaller"
            " one"
        )
    from scipy.interpolate import RegularGridInterpolator

    bilinear = RegularGridInterpolator(
        (y[rows], x[columns]), field.read(rows, columns), bounds_error=False, fill_value=np.nan
    )
    return lat, lon, np.asarray(bilinear((at_y, at_x)))


def _crs_of(field: HorizontalField, crs: str | None) -> pyproj.CRS:
    """
    Coordinate reference system of the axes, from the user or from the file.

    In the file, it is the variable with the name in ``grid_mapping`` (CF conventions, section 5.6),
    otherwise the only grid mapping.
    """
    if crs is not None:
        try:
            named = pyproj.CRS.from_user_input(crs)
        except pyproj.exceptions.CRSError:
            raise OceanError(f"crs {crs!r} is unknown to PROJ; write it as EPSG:3996") from None
        if not named.is_projected:
            raise OceanError(
                f"crs {crs!r} is not a map projection, but the file's axes are in metres; use a"
                " projected one"
            )
        return named
    where = file_name(field.data)
    variables = field.data.variables
    mapping = text(variables[field.name], "grid_mapping")
    candidates: list[Any] = [mapping] if mapping in variables else list(variables)
    mappings = [variables[name].attrs for name in candidates]
    mappings = [a for a in mappings if {"grid_mapping_name", "crs_wkt", "spatial_ref"} & set(a)]
    if len(mappings) != 1:
        raise OceanError(
            f"{where}: axes of {field.name} are projected, and the file has {len(mappings)} grid"
            f" mappings; {_CRS_REMEDY}"
        )
    try:
        plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in mappings[0].items()}
        return pyproj.CRS.from_cf(plain)
    except (pyproj.exceptions.CRSError, KeyError, ValueError, TypeError) as error:
        reason = one_line(error, 100)
        raise OceanError(f"{where}: invalid grid mapping ({reason}); {_CRS_REMEDY}") from None


def _nodes(window: GeographicWindow, spacing: float, where: str) -> tuple[Array, Array]:
    south, north, west, east = window
    east = eastward(west, east)
    parallel = max(float(np.cos(np.radians(0.5 * (south + north)))), 1e-3)
    n_lat = 1 + max(1, round((north - south) * _DEGREE / spacing))
    n_lon = 1 + max(1, round((east - west) * _DEGREE * parallel / spacing))
    if n_lat * n_lon > _MAX_NODES:
        raise OceanError(
            f"{where}: {n_lat * n_lon:,} nodes with a spacing of {spacing:g} m in the window; the"
            f" limit is {_MAX_NODES:,}; choose a smaller window"
        )
    turn = whole_turns(0.5 * (west + east))
    return np.linspace(south, north, n_lat), np.linspace(west - turn, east - turn, n_lon)


def _reach(axis: Array, values: Array) -> slice:
    """
    Entries of a monotone axis that enclose some values, with one additional entry on either side.
    """
    finite = values[np.isfinite(values)]
    rising = axis if axis[-1] > axis[0] else axis[::-1]
    if not finite.size or finite.max() < rising[0] or finite.min() > rising[-1]:
        return slice(0, 0)
    first = max(int(np.searchsorted(rising, finite.min(), side="right")) - 2, 0)
    last = min(int(np.searchsorted(rising, finite.max(), side="left")) + 2, axis.size)
    return slice(first, last) if axis[-1] > axis[0] else slice(axis.size - last, axis.size - first)


def _downward(values: Array, field: HorizontalField) -> Array:
    """Depth, positive down, 0 on land, NaN where a depth is missing."""
    # a depth of 9999 without similar ones is an undeclared gap
    size = np.abs(values)
    gap = size == _GAP_FILL
    if gap.any() and not np.any(np.abs(size[~gap] - _GAP_FILL) < _SIMILAR):
        values = np.where(gap, np.nan, values)
    name = f"{file_name(field.data)}: {field.name}"
    positive = field.positive
    finite = values[np.isfinite(values)]
    if not finite.size:
        raise OceanError(f"{name} has no values in the window; choose another window")
    positive = positive or ("down" if finite.min() >= 0.0 else "up" if finite.max() <= 0.0 else "")
    if not positive and field.name in _RASTERS:
        positive = "up"
    if not positive:
        raise OceanError(
            f"{name} has positive and negative values; set its attribute positive to 'up' or 'down'"
        )
    depth = values if positive == "down" else -values
    low = float(np.nanmin(depth))
    high = float(np.nanmax(depth))
    if low < -_HIGHEST or high > _DEEPEST:
        raise OceanError(
            f"{name} is between {-low:g} m above and {high:g} m below the sea surface; allowed are"
            f" {_HIGHEST:g} and {_DEEPEST:g} m; check fill value and units"
        )
    missing = int(np.count_nonzero(np.isnan(depth)))
    if missing and positive == "up":
        raise OceanError(
            f"{name} has no value at {missing} of {depth.size} points of the window; choose a"
            " window without gaps"
        )
    return np.maximum(depth, 0.0)
