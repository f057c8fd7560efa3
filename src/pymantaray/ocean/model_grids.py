"""
Variables of an ocean on a model's own grid: names, coordinates, positions of velocities, levels and
sea bed in the files of ROMS, CROCO, NEMO, MOM6, and of models on projections and rotated poles.
"""

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.ocean.convert import degrees, to_our_unit
from pymantaray.ocean.curvilinear import Box, CurvilinearGrid, on_ellipsoid
from pymantaray.ocean.files import file_name, numbers, text

# names in models without standard names; standard names, the first of which these names mean
_FIELDS = {
    "water_temp": (
        ("temp", "votemper", "toce", "thetao"),
        (
            "sea_water_potential_temperature",
            "sea_water_conservative_temperature",
            "sea_water_temperature",
        ),
    ),
    "salinity": (
        ("salt", "vosaline", "soce", "so"),
        (
            "sea_water_practical_salinity",
            "sea_water_salinity",
            "sea_water_absolute_salinity",
            "sea_water_preformed_salinity",
            "sea_water_reference_salinity",
        ),
    ),
    "water_u": ((), ("eastward_sea_water_velocity",)),
    "water_v": ((), ("northward_sea_water_velocity",)),
    # along the columns' and along the rows' index
    "x": (("u", "vozocrtx", "uoce", "uo"), ("sea_water_x_velocity",)),
    "y": (("v", "vomecrty", "voce", "vo"), ("sea_water_y_velocity",)),
}
_COORDINATES = {
    "latitude": ("lat_rho", "nav_lat", "gphit", "geolat", "latitude", "lat", "tlat"),
    "longitude": ("lon_rho", "nav_lon", "glamt", "geolon", "longitude", "lon", "tlon"),
}
_UNITS = {
    "latitude": ("degrees_north", "degree_north"),
    "longitude": ("degrees_east", "degree_east"),
}
_FIELD_DIMENSIONS = 3  # levels, rows, columns
_SAME_LATITUDE = 1e-3  # degrees; coordinates in single precision differ by less


class ModelField(NamedTuple):
    """A variable of a file."""

    data: xr.Dataset
    name: str

    @property
    def variable(self) -> xr.Variable:
        """Its dimensions and attributes."""
        return self.data.variables[self.name]

    @property
    def where(self) -> str:
        """File and name for messages."""
        return f"{file_name(self.data)}: {self.name}"

    @property
    def time(self) -> str:
        """Dimension of time, or an empty text."""
        return next((str(d) for d in self.variable.dims[:-3] if self.variable.sizes[d] > 1), "")

    def block(self, box: Box, instant: int = 0, kept: int = _FIELD_DIMENSIONS) -> Array:
        """Values of a box at an instant: the last dimensions, of which the last two are a row."""
        dims, shape = self.variable.dims, self.variable.shape
        part = {str(dims[-2]): box.rows, str(dims[-1]): box.columns}
        for dim, size in zip(dims[:-kept], shape, strict=False):
            first = instant if size > 1 else 0
            part[str(dim)] = slice(first, first + 1)
        values = numbers(self.data, self.name, part)
        return values.reshape(values.shape[-kept:])

    def metres(self, box: Box, instant: int = 0, kept: int = _FIELD_DIMENSIONS) -> Array:
        """Depths or thicknesses as `block`, in metres; those without a unit are in metres."""
        unit = text(self.variable, "units") or "m"
        return to_our_unit(self.block(box, instant, kept), "length", unit, where=self.where)


def standard_name(field: ModelField, role: str) -> str:
    """Standard name of a field, of its own or as its name says in models."""
    return text(field.variable, "standard_name") or _FIELDS[role][1][0]


def fields_of(files: Sequence[xr.Dataset], role: str) -> Iterator[ModelField]:
    """Variables of a role, one for each file that has it; standard names have priority."""
    names, standard_names = _FIELDS[role]
    for data in files:
        whole = [
            ModelField(data, str(name))
            for name, variable in data.variables.items()
            if variable.ndim >= _FIELD_DIMENSIONS
        ]
        known = [f for f in whole if text(f.variable, "standard_name") in standard_names]
        plain = [f for f in whole if f.name in names and not text(f.variable, "standard_name")]
        yield from (known or plain)[:1]


def on_points(
    files: Sequence[xr.Dataset], names: Sequence[str], shape: Sequence[int]
) -> ModelField | None:
    """
    First variable with one of the names, whose last dimensions have a shape and whose others are
    not larger than an axis of time.
    """
    for name in names:
        for data in files:
            if name in data.variables:
                there = data.variables[name]
                extra = there.ndim - len(shape)
                if extra in (0, 1) and there.shape[extra:] == tuple(shape):
                    return ModelField(data, name)
    return None


def is_curvilinear(files: Sequence[xr.Dataset], field: ModelField) -> bool:
    """
    True if a field has latitudes in two dimensions, or a map projection, and no equal latitudes in
    one dimension.

    MOM6 and others write nominal latitudes in one dimension beside those of the grid.
    """
    lat = _coordinate(files, field, "latitude")
    straight = next(
        (
            ModelField(field.data, str(name))
            for name, v in field.data.variables.items()
            if v.ndim == 1
            and v.dims[0] in field.variable.dims[-2:]
            and (
                text(v, "standard_name") == "latitude"
                or text(v, "units").lower().startswith(_UNITS["latitude"])
            )
        ),
        None,
    )
    if straight is None:
        return lat is not None or _mapping(field.data) is not None
    nominal = "nominal" in text(straight.variable, "long_name").lower()
    if lat is None:
        if nominal:
            raise OceanError(
                f"{field.where}: {straight.name} is a nominal latitude, not that of the grid; name"
                " the file with the model's grid too (ocean_static.nc)"
            )
        return False
    along = degrees(straight.data, straight.name, "latitude")
    by_row = straight.variable.dims[0] == field.variable.dims[-2]
    grid = degrees(lat.data, lat.name, "latitude").reshape(lat.variable.shape[-2:])
    apart = np.abs(grid - (along[:, None] if by_row else along))
    return nominal or bool(np.any(apart[np.isfinite(apart)] > _SAME_LATITUDE))


def grid_of(files: Sequence[xr.Dataset], field: ModelField) -> CurvilinearGrid | None:
    """
    Points of a field: from latitudes and longitudes in two dimensions, or from a map projection and
    its axes; None without both.
    """
    lat, lon = (_coordinate(files, field, axis) for axis in ("latitude", "longitude"))
    if lat is None or lon is None:
        return _projected(field)
    shape = lat.variable.shape[-2:]
    values = [
        degrees(own.data, own.name, axis).reshape(shape)
        for own, axis in ((lat, "latitude"), (lon, "longitude"))
    ]
    impossible = (np.abs(values[0]) > 90.0) | (np.abs(values[1]) > 720.0)
    return CurvilinearGrid(*(np.where(impossible, np.nan, v) for v in values))


def _coordinate(files: Sequence[xr.Dataset], field: ModelField, axis: str) -> ModelField | None:
    """
    Latitude or longitude of a field in two dimensions: as its attribute ``coordinates`` says, by
    name, by units and standard name in its file, then by name in all files.

    Variables of its file on other dimensions, of which it has one, are at another position of the
    grid, such as ``geolat_u``.
    """
    own, dims, shape = field.data, field.variable.dims[-2:], field.variable.shape[-2:]

    def fits(data: xr.Dataset, name: str, *, same: bool = False) -> bool:
        there = data.variables[name]
        elsewhere = data is own and there.dims[-2:] != dims
        beside = elsewhere and (same or bool(set(there.dims[-2:]) & set(dims)))
        return there.shape[-2:] == shape and there.size == shape[0] * shape[1] and not beside

    def named(data: xr.Dataset) -> list[str]:
        by_lower = {str(name).lower(): str(name) for name in data.variables}
        return [by_lower[name] for name in _COORDINATES[axis] if name in by_lower]

    said = text(field.variable, "coordinates") or str(field.variable.encoding.get("coordinates"))
    listed = [n for n in said.split() if n in own.variables]
    by_name = [name for name in named(own) if fits(own, name, same=True)]
    if by_name and not listed:
        return ModelField(own, by_name[0])
    for name in (*listed, *by_name, *map(str, own.variables)):
        there = own.variables[name]
        right = text(there, "standard_name") == axis or text(there, "units").lower().startswith(
            _UNITS[axis]
        )
        if right and fits(own, name, same=name not in listed):
            return ModelField(own, name)
    for data in (own, *files):
        for name in named(data):
            if fits(data, name):
                return ModelField(data, name)
    return None


def _mapping(data: xr.Dataset) -> str | None:
    """Variable with the parameters of a map projection or rotated pole."""
    for name, variable in data.variables.items():
        kind = text(variable, "grid_mapping_name")
        if kind and kind != "latitude_longitude":
            return str(name)
    return None


def _projected(field: ModelField) -> CurvilinearGrid | None:
    """Points from the axes of a map projection, whose units may be multiples such as 100 km."""
    import pyproj

    mapping = _mapping(field.data)
    axes = [_axis(field, k) for k in (-2, -1)]
    if mapping is None or axes[0] is None or axes[1] is None:
        return None
    y, x = (_metres(axis) for axis in axes if axis is not None)
    attrs = dict(field.data.variables[mapping].attrs)
    try:
        crs = pyproj.CRS.from_cf(attrs)
        degrees_of = crs.source_crs or crs.geodetic_crs  # of a rotated pole, those not rotated
        transform = pyproj.Transformer.from_crs(crs, degrees_of, always_xy=True).transform
        lon, lat = transform(*np.meshgrid(x, y))
    except Exception as error:  # noqa: BLE001  pyproj raises many types for wrong attributes
        raise OceanError(
            f"{file_name(field.data)}: the projection in {mapping} cannot be used ({error}); add"
            " latitudes and longitudes in two dimensions"
        ) from None
    return CurvilinearGrid(np.asarray(lat), np.asarray(lon))


def _axis(field: ModelField, k: int) -> ModelField | None:
    """Variable along one dimension of a field, or None."""
    dim = field.variable.dims[k]
    for name, there in field.data.variables.items():
        if there.dims == (dim,) and there.dtype.kind in "iuf" and there.size > 1:
            return ModelField(field.data, str(name))
    return None


def _metres(axis: ModelField) -> Array:
    """Values of an axis in metres, or in degrees for a rotated pole."""
    values = numbers(axis.data, axis.name)
    match = re.fullmatch(r"\s*([\d.]*)\s*(k?)(m|met(?:er|re)s?)\s*", text(axis.variable, "units"))
    factor = (float(match[1] or 1.0) * (1e3 if match[2] else 1.0)) if match else 1.0
    return np.asarray(values * factor)


def index_signs(field: ModelField) -> tuple[float, float]:
    """
    1 for columns and for rows whose axis of a projection increases with the index, otherwise -1:
    velocities are along the axes.
    """
    signs = []
    for k in (-1, -2):
        axis = _axis(field, k)
        falls = axis is not None and float(np.diff(numbers(axis.data, axis.name)[:2])[0]) < 0.0
        signs.append(-1.0 if falls else 1.0)
    return signs[0], signs[1]


def neighbours(
    field: ModelField, tracer: ModelField, points: CurvilinearGrid, along: int
) -> tuple[tuple[int, int], tuple[int, int]]:
    """
    Neighbours of a point of temperature, along rows and columns, between which it lies in the grid
    of a velocity: (-1, 0), (0, 1), or (0, 0) for the same point.

    By the numbers of points; if all are equal, by the coordinates of the velocity in its own file;
    without these, a dimension of another name along the velocity's own axis (0: rows, 1: columns)
    is half-way after a point.
    """
    own = grid_of([field.data], field)
    found = []
    for axis in (0, 1):
        k = axis - 2
        more = field.variable.shape[k] - tracer.variable.shape[k]
        if abs(more) > 1:
            raise OceanError(
                f"{field.where} has {field.variable.shape[k]} points along"
                f" {field.variable.dims[k]}, temperature {tracer.variable.shape[k]}; they belong to"
                " different grids"
            )
        if more == 0 and own is not None and own.lat.shape == points.lat.shape:
            shift = _shift(own, points, axis)
        else:
            shift = 0.5 * (more == -1) - 0.5 * (more == 1)
            other = field.variable.dims[k] != tracer.variable.dims[k]
            if axis == along and more == 0 and other and field.data is tracer.data:
                shift = 0.5
        found.append((-1, 0) if shift > 0.25 else ((0, 1) if shift < -0.25 else (0, 0)))
    return found[0], found[1]


def _shift(own: CurvilinearGrid, points: CurvilinearGrid, axis: int) -> float:
    """Median distance of the points of two grids along an axis, in steps of the second."""
    there = on_ellipsoid(points.lat, points.lon)
    along = np.gradient(there, axis=axis)
    apart = on_ellipsoid(own.lat, own.lon) - there
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(np.nanmedian(np.sum(apart * along, axis=-1) / np.sum(along**2, axis=-1)))
