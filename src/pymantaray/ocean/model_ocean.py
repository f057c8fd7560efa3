"""
Oceans on a model's own grid as data sets on latitudes, longitudes and fixed depths.

Values are read and interpolated when they are needed, at one instant and in the window only; all
other functions see an ordinary data set with standard names.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.ocean.convert import is_unit_of, levels
from pymantaray.ocean.curvilinear import Box, CurvilinearGrid, Regridding
from pymantaray.ocean.files import file_name, numbers, text
from pymantaray.ocean.model_grids import (
    ModelField,
    fields_of,
    grid_of,
    index_signs,
    is_curvilinear,
    neighbours,
    on_points,
    standard_name,
)
from pymantaray.ocean.model_levels import cell_depth, fixed_depths, s_level_depth, to_depths
from pymantaray.ocean.schema import SEA_FLOOR, SEA_FLOOR_ATTRIBUTES, layer_edges
from pymantaray.ocean.window import GeographicWindow

_THICKNESS = ("e3t", "e3t_0", "thkcello", "h")
_BEDS = ("h", "deptho", "depth_ocean", SEA_FLOOR)
_MASKS = ("mask_rho", "tmask", "wet", "mask")
_TRANSFORMS = {"ocean_s_coordinate_g1": 1, "ocean_s_coordinate_g2": 2}


def on_geographic_axes(
    files: Sequence[xr.Dataset], window: GeographicWindow | None
) -> Sequence[xr.Dataset]:
    """
    Replace files on a model's own grid by data sets on latitudes, longitudes and fixed depths;
    other files are returned unchanged.

    Some files may have only coordinates, sea bed, masks or thicknesses of cells. The data sets use
    the files until they are closed.
    """
    temperature, salinity = (
        next(fields_of(files, role), None) for role in ("water_temp", "salinity")
    )
    known = temperature or salinity
    if known is None or not is_curvilinear(files, known):
        return files
    if temperature is None or salinity is None:
        missing = "salinity" if salinity is None else "temperature"
        raise OceanError(
            f"{known.where} is on a model's own grid, but no file has its {missing}; name the file"
            f" that has it, or set the standard_name of the variable with `names`"
        )
    return _Model.of(files, temperature, salinity, window).data_sets()


@dataclass(frozen=True, eq=False)
class _Levels:
    """Levels of a model: their fixed depths, or what their depths are computed from."""

    fixed: Array | None
    """Depths in the order of the file, if they are the same everywhere. [m]"""
    upward: bool
    """True if the first level of the file is the deepest."""
    thickness: ModelField | None
    s: tuple[Array, Array, float, int] | None
    """s-coordinate, stretching curve, critical depth [m] and transform, in the file's order."""
    name: str
    """For the history."""


@dataclass(frozen=True, eq=False)
class _Model:
    """Grid of a model, restricted to a window, and its files."""

    files: Sequence[xr.Dataset]
    temperature: ModelField
    salinity: ModelField
    box: Box
    grid: CurvilinearGrid
    """Points in the box."""
    whole: CurvilinearGrid
    lat: Array
    lon: Array
    levels: _Levels

    @classmethod
    def of(
        cls,
        files: Sequence[xr.Dataset],
        temperature: ModelField,
        salinity: ModelField,
        window: GeographicWindow | None,
    ) -> "_Model":
        """Find grid and levels; raises OceanError if they are incomplete."""
        where = file_name(temperature.data)
        whole = grid_of(files, temperature)
        if whole is None:
            raise OceanError(
                f"{where}: {temperature.name} has no latitudes and longitudes in two dimensions;"
                " name the file with the model's grid too"
            )
        box = whole.box(window, where)
        grid = whole.part(box)
        lat, lon = grid.axes(window, where)
        found = _levels_of(files, temperature)
        return cls(files, temperature, salinity, box, grid, whole, lat, lon, found)

    @cached_property
    def _regridding(self) -> Regridding:
        return Regridding.to(self.grid, self.lat, self.lon)

    def _depth(self, field: ModelField, instant: int, *, still: bool = False) -> Array:
        """Depths of the levels at points of temperature, increasing. [m]"""
        own = self.levels
        rows = self._in_order
        if own.s is not None:
            s, stretching, critical, transform = own.s
            level = on_points([field.data], ("zeta", "ssh"), self.temperature.variable.shape[-2:])
            zeta = np.zeros(self.box.shape)
            if level is not None and not still:
                zeta = np.nan_to_num(level.block(self.box, instant, kept=2))
            bed = np.maximum(np.nan_to_num(self._bed, nan=1.0), 1e-3)
            return np.asarray(rows(s_level_depth(s, stretching, critical, bed, zeta, transform)))
        if own.thickness is not None:
            # thicknesses that vary in time are those of the field's own file and instant
            shape = self.temperature.variable.shape[-3:]
            varying = on_points([field.data], _THICKNESS, shape) or own.thickness
            thickness = varying.metres(self.box, instant if varying.data is field.data else 0)
            full = None if varying.time or own.fixed is None else rows(own.fixed)
            return cell_depth(np.where(self.wet, rows(thickness), 0.0), full)
        assert own.fixed is not None  # one of the three
        shape = own.fixed.size, *self.box.shape
        return np.broadcast_to(rows(own.fixed)[:, None, None], shape)

    def _in_order(self, values: Array) -> Array:
        """Values by level from the surface down."""
        return values[::-1] if self.levels.upward else values

    @cached_property
    def wet(self) -> NDArray[np.bool_]:
        """
        Points (levels, rows, columns) with water: with temperature and salinity at the first
        instant, which are not both exactly 0, and not masked.
        """
        t, s = (f.block(self.box) for f in (self.temperature, self.salinity))
        wet = np.isfinite(t) & np.isfinite(s) & ~((t == 0.0) & (s == 0.0))
        shape = self.temperature.variable.shape
        for kept in (2, 3):
            mask = on_points(self.files, _MASKS, shape[-kept:])
            if mask is not None:
                wet &= np.nan_to_num(mask.block(self.box, kept=kept)) > 0.5
        return np.asarray(np.logical_and.accumulate(self._in_order(wet), axis=0))

    @cached_property
    def _bed(self) -> Array:
        """Sea bed at points of temperature: of the file, or the lower side of the last cell. [m]"""
        bed = on_points(self.files, _BEDS, self.temperature.variable.shape[-2:])
        own = self.levels
        if own.thickness is not None and (bed is None or not own.thickness.time):
            thickness = self._in_order(own.thickness.metres(self.box))
            total: Array = np.where(self.wet, np.nan_to_num(thickness), 0.0).sum(axis=0)
            return total
        if bed is not None:
            depth = bed.metres(self.box, kept=2)
            wet = depth[self.wet[0] & np.isfinite(depth)]
            if wet.size and np.all(wet <= 0.0):
                raise OceanError(
                    f"{bed.where} is {wet.min():g} to {wet.max():g} m in the water of the window;"
                    " it must be the depth of the bed, positive down; change its sign"
                )
            return depth
        if own.fixed is None:
            raise OceanError(
                f"{self.temperature.where}: the levels follow the sea bed, but no file has the"
                " depth of the bed (h); name the file with the model's grid too"
            )
        edges: Array = layer_edges(self._in_order(own.fixed))[self.wet.sum(axis=0)]
        return edges

    @cached_property
    def depth(self) -> Array:
        """Increasing depths of the data sets. [m]"""
        if self.levels.fixed is not None:
            return self._in_order(self.levels.fixed)
        still = self._depth(self.temperature, 0, still=True)
        return fixed_depths(still, np.where(self.wet[0], self._bed, np.nan))

    def _regridded(self, values: Array, field: ModelField, instant: int) -> Array:
        """Values (levels, rows, columns) on depth, latitude and longitude."""
        # the depths of these levels vary horizontally
        if self.levels.s is not None or self.levels.thickness is not None:
            bed = np.where(self.wet[0], self._bed, 0.0)
            values = to_depths(values, self._depth(field, instant), bed, self.depth)
        return np.stack([self._regridding(layer) for layer in values])

    def _tracer(self, field: ModelField, instant: int) -> Array:
        values = self._in_order(field.block(self.box, instant))
        return self._regridded(np.where(self.wet, values, np.nan), field, instant)

    def data_sets(self) -> list[xr.Dataset]:
        """One data set for each file with fields; the first has the sea floor."""
        variables: dict[int, list[_OnAxes]] = {}
        for role in ("water_temp", "salinity"):
            for field in fields_of(self.files, role):
                if field.variable.shape[-3:] != self.temperature.variable.shape[-3:]:
                    raise OceanError(
                        f"{field.where} has {field.variable.shape[-3:]} levels, rows and columns,"
                        f" {self.temperature.where} {self.temperature.variable.shape[-3:]}; all"
                        " files must have one grid"
                    )
                read = partial(self._tracer, field)
                own = variables.setdefault(id(field.data), [])
                own.append(_OnAxes(field, standard_name(field, role), read))
        for turn, pair in ((False, ("water_u", "water_v")), (True, ("x", "y"))):
            pairs = _pairs(*(list(fields_of(self.files, role)) for role in pair))
            for u, v in pairs:
                variables.setdefault(id(u.data), []).extend(self._velocity(u, v, turn=turn))
            if pairs:
                break
        return [
            self._data_set(own, floor=number == 0) for number, own in enumerate(variables.values())
        ]

    def _velocity(self, u: ModelField, v: ModelField, *, turn: bool) -> list["_OnAxes"]:
        """
        Velocities to east and north, from such velocities or with ``turn`` from those along the
        axes of the grid.
        """
        beside = [
            neighbours(field, self.temperature, self.whole, along)
            for field, along in ((u, 1), (v, 0))
        ]

        def component(k: int, instant: int) -> Array:
            both = list(zip((u, v), beside, strict=True))
            if not turn:
                return self._regridded(self._centred(*both[k], instant), both[k][0], instant)
            parts = [self._centred(*one, instant) for one in both]
            along, across = self._directions
            return self._regridded(along[k] * parts[0] + across[k] * parts[1], u, instant)

        names = ("eastward_sea_water_velocity", "northward_sea_water_velocity")
        return [
            _OnAxes(field, name, partial(component, k))
            for k, (field, name) in enumerate(zip((u, v), names, strict=True))
        ]

    @cached_property
    def _directions(self) -> tuple[Array, Array]:
        """
        Directions (east, north) of velocities along columns and rows: by the angle in the file, or
        by the points.
        """
        angle = on_points(self.files, ("angle",), self.temperature.variable.shape[-2:])
        if angle is not None:
            turn = angle.block(self.box, kept=2)
            unit = text(angle.variable, "units").lower()
            if not unit.startswith("deg") and np.nanmax(np.abs(turn), initial=0.0) > 2.0 * np.pi:
                raise OceanError(
                    f"{angle.where} is up to {np.nanmax(np.abs(turn)):.4g}, which is no angle in"
                    " radians; set its units to degrees"
                )
            turn = np.radians(turn) if unit.startswith("deg") else turn
            return np.stack([np.cos(turn), np.sin(turn)]), np.stack([-np.sin(turn), np.cos(turn)])
        signs = index_signs(self.temperature)
        along, across = self.grid.directions()
        return signs[0] * along, signs[1] * across

    def _centred(
        self, field: ModelField, beside: tuple[tuple[int, int], tuple[int, int]], instant: int
    ) -> Array:
        """
        Velocity at the points of temperature: mean of the two neighbours, of which a masked one
        counts as 0, because no water passes a coast.
        """
        sides, takes = [], []
        for k, own, (low, high) in zip(
            (-2, -1), (self.box.rows, self.box.columns), beside, strict=True
        ):
            size = field.variable.shape[k]
            index = np.arange(own.start, own.stop)
            both = [np.clip(index + offset, 0, size - 1) for offset in (low, high)]
            first = int(min(both[0].min(), both[1].min()))
            sides.append(slice(first, int(max(both[0].max(), both[1].max())) + 1))
            takes.append([i - first for i in both])
        values = self._in_order(field.block(Box(*sides), instant))
        for axis, (low, high) in zip((1, 2), takes, strict=True):
            a, b = np.take(values, low, axis=axis), np.take(values, high, axis=axis)
            some = np.isfinite(a) | np.isfinite(b)
            values = np.where(some, 0.5 * (np.nan_to_num(a) + np.nan_to_num(b)), np.nan)
        return values

    def _data_set(self, fields: Sequence["_OnAxes"], *, floor: bool) -> xr.Dataset:
        """Data set of variables with one axis of time."""
        first = fields[0].field
        time = _time_of(first)
        dated = () if time is None else first.data.variables[time].dims
        for dim in first.variable.dims[:-3]:
            if first.variable.sizes[dim] > 1 and dim not in dated:
                raise OceanError(
                    f"{first.where} has a dimension {str(dim)!r} besides time and the model's grid;"
                    " select one element of it"
                )
        dims: tuple[str, ...] = ("depth", "lat", "lon")
        shape: tuple[int, ...] = (self.depth.size, self.lat.size, self.lon.size)
        if first.time:
            dims, shape = ("time", *dims), (first.variable.sizes[first.time], *shape)
        variables: dict[str, Any] = {}
        for field, name, read in fields:
            units = text(field.variable, "units")
            if not units and "salinity" in name:
                units = "1"  # ROMS writes none
            later = indexing.LazilyIndexedArray(_Later(read, shape))
            variables[field.name] = xr.Variable(
                dims, later, {"standard_name": name, "units": units}
            )
        if floor:
            later = indexing.LazilyIndexedArray(_Later(lambda _: self._sea_floor(), shape[-2:]))
            variables[SEA_FLOOR] = xr.Variable(dims[-2:], later, SEA_FLOOR_ATTRIBUTES)
        coordinates: dict[str, Any] = {
            "depth": ("depth", self.depth, {"units": "m", "positive": "down", "axis": "Z"}),
            "lat": ("lat", self.lat, {"units": "degrees_north", "standard_name": "latitude"}),
            "lon": ("lon", self.lon, {"units": "degrees_east", "standard_name": "longitude"}),
        }
        if time is not None:
            own = first.data.variables[time]
            coordinates["time"] = xr.Variable(dims[:-3], own.values.reshape(shape[:-3]), own.attrs)
        data = xr.Dataset(variables, coordinates, self._attributes(first.data))
        data.encoding = dict(first.data.encoding)
        return data

    def _sea_floor(self) -> Array:
        """
        Sea floor (lat, lon), 0 on land: that of the model, between the last level with water and
        the next. [m]
        """
        count = np.isfinite(self._tracer(self.temperature, 0)).sum(axis=0)
        bed = np.nan_to_num(self._regridding(np.where(self.wet[0], self._bed, np.nan)))
        deepest = np.concatenate([[0.0], self.depth])[count]
        following = np.concatenate([[0.0], self.depth[1:], [np.inf]])[count]
        return np.where(count > 0, np.clip(bed, deepest, following), 0.0)

    def _attributes(self, data: xr.Dataset) -> dict[str, Any]:
        """Attributes of a file, with the interpolation in the history."""
        rows, columns = self.box.shape
        line = (
            f"interpolated from a curvilinear grid ({rows} by {columns} points, {self.levels.name})"
            f" to steps of {self.lat[1] - self.lat[0]:.3g} degrees of latitude and"
            f" {self.lon[1] - self.lon[0]:.3g} of longitude at {self.depth.size} depths"
        )
        before = text(data, "history")
        return data.attrs | {"history": f"{before}\n{line}" if before else line}


class _OnAxes(NamedTuple):
    """Variable of a data set: field of the model, standard name, and values at an instant."""

    field: ModelField
    standard_name: str
    read: Callable[[int], Array]


class _Later(BackendArray):
    """Array whose values are computed by a function of the instant when they are needed."""

    def __init__(self, read: Callable[[int], Array], shape: tuple[int, ...]) -> None:
        self._read = read
        self.shape = shape
        self.dtype = np.dtype(float)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._values
        )

    def _values(self, key: tuple[Any, ...]) -> Array:
        if len(self.shape) < 4:  # no axis of time
            return np.asarray(self._read(0)[key])
        instants = np.arange(self.shape[0])[key[0]]
        if np.ndim(instants) == 0:
            return np.asarray(self._read(int(instants))[key[1:]])
        return np.stack([self._read(int(i)) for i in instants])[(slice(None), *key[1:])]


def _pairs(u: Sequence[ModelField], v: Sequence[ModelField]) -> list[tuple[ModelField, ModelField]]:
    """Velocities along both axes in one file, or in two files with the same times."""
    found = []
    for one in u:
        same = [other for other in v if other.data is one.data]
        dated = [other for other in v if _equal_times(one, other)]
        found += [(one, other) for other in (same or dated)[:1]]
    return found


def _equal_times(a: ModelField, b: ModelField) -> bool:
    names = _time_of(a), _time_of(b)
    if names[0] is None or names[1] is None:
        return names == (None, None)
    values = [numbers(f.data, str(n)) for f, n in zip((a, b), names, strict=True)]
    return values[0].shape == values[1].shape and bool(np.all(values[0] == values[1]))


def _time_of(field: ModelField) -> str | None:
    """Coordinate of time of a field: along its dimension of time, or scalar; None without one."""
    dims = field.variable.dims[:-3]
    known = [
        str(name)
        for name, v in field.data.variables.items()
        if " since " in text(v, "units") and set(v.dims) <= set(dims) and v.size >= 1
    ]
    own = [n for n in known if n in dims]
    along = [n for n in known if field.data.variables[n].dims == (field.time,)]
    found = own or along or known
    if not found and field.time:
        raise OceanError(
            f"{field.where}: no coordinate of time with units such as 'seconds since ...' along"
            f" {field.time}; set the units of the time"
        )
    return found[0] if found else None


def _levels_of(files: Sequence[xr.Dataset], field: ModelField) -> _Levels:
    """Levels of a field, from the variables that describe them in any of the files."""
    count = field.variable.shape[-3]
    stretching = on_points(files, ("Cs_r",), (count,))
    s = on_points(files, ("s_rho", "sc_r"), (count,))
    critical = on_points(files, ("hc",), ())
    if stretching is not None and s is not None:
        hc = critical.data.variables[critical.name].values if critical else _attribute(files, "hc")
        if hc is None:
            raise OceanError(f"{field.where}: no critical depth hc; name the model's grid file too")
        transform = _transform(files, s)
        values = [numbers(own.data, own.name) for own in (s, stretching)]
        upward = bool(values[0][0] < values[0][-1])
        own = values[0], values[1], float(np.ravel(hc)[0]), transform
        return _Levels(None, upward, None, own, f"s-levels of equation {transform}")
    thickness = on_points(files, _THICKNESS, field.variable.shape[-3:])
    axis = _depth_axis(field)
    fixed = None if axis is None else levels(field.data, axis)[0]
    if fixed is None and thickness is None:
        raise OceanError(
            f"{field.where}: dimension {field.variable.dims[-3]} has no depths in metres, no"
            " s-coordinate (s_rho, Cs_r, hc) and no thickness of cells (e3t, h); name the file with"
            " the model's grid too, or interpolate to fixed depths first (xgcm)"
        )
    upward = fixed is not None and bool(fixed[0] > fixed[-1])
    name = "cells cut by the sea bed" if thickness is not None else "fixed levels"
    return _Levels(fixed, upward, thickness, None, name)


def _depth_axis(field: ModelField) -> str | None:
    """
    Coordinate with the depths of a field's levels in metres: of the name of the dimension, or with
    a direction, before others such as the thickness of cells.
    """
    dim = field.variable.dims[-3]
    known = [
        (name != dim, not text(there, "positive"), str(name))
        for name, there in field.data.variables.items()
        if there.dims == (dim,) and is_unit_of("length", text(there, "units"))
    ]
    return min(known, key=lambda one: one[:2])[2] if known else None


def _attribute(files: Sequence[xr.Dataset], name: str) -> Any:
    """Global attribute of one of the files, as CROCO writes parameters; None without it."""
    return next((data.attrs[name] for data in files if name in data.attrs), None)


def _transform(files: Sequence[xr.Dataset], s: ModelField) -> int:
    """Number of the equation of s-levels: of the file, by standard name, or CROCO's attribute."""
    own = on_points(files, ("Vtransform",), ())
    known = _TRANSFORMS.get(text(s.variable, "standard_name"))
    kind = _attribute(files, "VertCoordType")
    if own is not None:
        known = int(np.ravel(own.variable.values)[0])
    elif known is None and kind is not None:
        known = 2 if str(kind).strip().upper() == "NEW" else 1
    if known not in (1, 2):
        raise OceanError(
            f"{s.where}: the equation of the levels is unknown; set Vtransform to 1 or 2, or the"
            " standard_name to ocean_s_coordinate_g1 or _g2"
        )
    return known
