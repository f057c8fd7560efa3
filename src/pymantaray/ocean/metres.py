"""
Local oceans from data sets in metres: axes north, east and depth, sound speed, and optional
currents and sea floor.
"""

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.messages import one_line
from pymantaray.ocean.convert import is_our_unit, our_unit
from pymantaray.ocean.environment import is_environment, read_environment
from pymantaray.ocean.files import IN_MEMORY, is_netcdf, open_file
from pymantaray.ocean.local import assemble_local
from pymantaray.ocean.range_section import is_range_section, is_section_data, read_range_section
from pymantaray.ocean.schema import layer_edges
from pymantaray.ocean.sea_floor import extended_down, nearest_wet_columns
from pymantaray.quantities.checks import checked_array

_AXES = ("north", "east", "depth")
_FLOOR_AXES = ("floor_north", "floor_east")
_CURRENTS = ("current_north", "current_east")
_QUANTITIES = {
    **dict.fromkeys((*_AXES, *_FLOOR_AXES, "sea_floor_depth"), "length"),
    **dict.fromkeys(("sound_speed", *_CURRENTS), "velocity"),
}


def is_in_metres(data: xr.Dataset) -> bool:
    """True if a data set has a sound speed along axes north and east, or along range and depth."""
    return is_section_data(data) or ("sound_speed" in data and {"north", "east"} <= set(data.dims))


def file_in_metres(path: str) -> bool:
    """True if a file has water in metres."""
    if not is_netcdf(Path(path)):
        return is_environment(path) or is_range_section(path) or _is_bellhop_input(path)
    with open_file(path) as data:
        return is_in_metres(data)


def _is_bellhop_input(path: str) -> bool:
    """True for the input file of Bellhop."""
    return Path(path).suffix == ".env"


def read_file_in_metres(path: str) -> xr.Dataset:
    """Read a file with water in metres."""
    if is_environment(path):
        return read_environment(path)
    if _is_bellhop_input(path):
        raise OceanError(
            f"{Path(path).name}: an input file of Bellhop, not a profile; give the .ssp of the same"
            " name for a section, or write its levels as a table with depth and sound_speed"
        )
    if is_range_section(path):
        return read_range_section(path)
    with open_file(path) as data:
        return data.load()


def ocean_in_metres(data: xr.Dataset, name: str = IN_MEMORY, *, at_rest: bool = True) -> xr.Dataset:
    """
    Check a data set in metres, and complete it to a local ocean.

    Parameters
    ----------
    data : xarray.Dataset
        Increasing axes ``north``, ``east`` and ``depth`` [m] and ``sound_speed`` on them [m/s], NaN
        below the sea floor. Optional: ``current_north`` and ``current_east`` on the same axes
        [m/s], NaN for no current; ``sea_floor_depth``, one value, on (north, east) or on
        (floor_north, floor_east) [m], 0 or less or NaN on land. Other variables, such as
        ``sea_ice_draft``, and attributes are unchanged.
    name : str
        Name for messages, and the title of a data set without one.
    at_rest : bool
        If True, water without currents is at rest; otherwise missing currents are an error.

    Returns
    -------
    xarray.Dataset
        Local ocean as from `to_local`, without NaN. Without ``sea_floor_depth``, the sea floor is
        where the levels end.

    Raises
    ------
    OceanError
        If an axis, a variable or a unit is missing or wrong; the message is one line.
    """
    for key, quantity in _QUANTITIES.items():
        unit = str(data[key].attrs.get("units", "")).strip() if key in data.variables else ""
        if unit and not is_our_unit(quantity, unit):
            raise OceanError(
                f"{name}: {key} is in {one_line(unit, 40)!r}; it must be in {our_unit(quantity)}"
            )
    axes = {key: _axis(data, key, name) for key in _AXES}
    speed = _field(data, "sound_speed", _AXES, name)
    wet = np.isfinite(speed)
    if not wet.any():
        raise OceanError(f"{name}: sound_speed has no value; give at least one column of water")
    beneath = wet[..., 1:] & ~np.logical_and.accumulate(wet, axis=2)[..., :-1]
    if beneath.any():
        i, j, k = np.argwhere(beneath)[0]
        raise OceanError(
            f"{name}: sound_speed is missing above a value at north {axes['north'][i]:g}, east"
            f" {axes['east'][j]:g}, depth {axes['depth'][k + 1]:g} m; fill the gap"
        )
    attrs = {"title": name, "source": name, "synthetic": 0, **data.attrs}
    floor = _sea_floor(data, axes["depth"], wet.sum(axis=2), name)
    if not wet.all():  # below the sea bed, as by `fill_below_sea_bed`
        filled = extended_down(np.moveaxis(speed, 2, 0))
        rows, columns = nearest_wet_columns(np.isfinite(filled[0]), np.zeros(1))
        speed = np.ascontiguousarray(np.moveaxis(filled[:, rows, columns], 0, 2))
    local = assemble_local(axes, speed, _currents(data, name, at_rest=at_rest), floor, attrs)
    return local.assign({key: data[key] for key in data.data_vars if key not in _QUANTITIES})


def with_flat_floor(local: xr.Dataset, depth: float) -> xr.Dataset:
    """Local ocean with a flat sea floor. [m]"""
    attrs = local["sea_floor_depth"].attrs
    flat = np.full((local.sizes["north"], local.sizes["east"]), depth)
    without = local.drop_vars(["sea_floor_depth", *_FLOOR_AXES], errors="ignore")
    return without.assign(sea_floor_depth=(("north", "east"), flat, attrs))


def cropped(local: xr.Dataset, half_extent: tuple[float, float]) -> xr.Dataset:
    """
    Grid points of a local ocean within half sides north and east [m], and the next ones around
    them.
    """
    columns = {}
    for name, half in zip(("north", "east"), half_extent, strict=True):
        axis = local[name].values
        if axis[0] > -half or axis[-1] < half:
            raise OceanError(
                f"half_extent is {half:g} m, but {name} of {local.attrs['title']} is {axis[0]:g} to"
                f" {axis[-1]:g} m; use a smaller one"
            )
        first = int(np.searchsorted(axis, -half, side="right")) - 1
        columns[name] = slice(first, int(np.searchsorted(axis, half)) + 1)
    return local.isel(columns)


def _axis(data: xr.Dataset, key: str, name: str) -> Array:
    if key not in data.variables or data[key].dims != (key,):
        found = ", ".join(map(str, data.dims)) or "no axis"
        raise OceanError(
            f"{name}: no coordinate {key}; found {found}; needed: {', '.join(_AXES)} in metres"
        )
    axis = checked_array(
        OceanError, f"{name}: {key}", _numbers(data, key, name), (None,), rising=True
    )
    if axis.size < 2:
        raise OceanError(f"{name}: {key} has 1 value; at least 2 are needed")
    if key == "depth" and axis[0] < 0.0:
        raise OceanError(
            f"{name}: depth begins at {axis[0]:g} m; depth is positive down, 0 at the surface"
        )
    return axis


def _numbers(data: xr.Dataset, key: str, name: str) -> Array:
    if data[key].dtype.kind not in "iuf":
        raise OceanError(f"{name}: {key} is of type {data[key].dtype}; it must contain numbers")
    return np.asarray(data[key].values, dtype=float)


def _field(data: xr.Dataset, key: str, dims: tuple[str, ...], name: str) -> Array:
    """Values of a variable on some axes, in their order."""
    found = data[key].dims
    if set(found) != set(dims):
        more = sorted(set(map(str, found)) - set(dims))
        remedy = (
            f"select one of {more[0]}: isel({more[0]}=0)" if more else "rebuild it on these axes"
        )
        raise OceanError(
            f"{name}: {key} is on ({', '.join(map(str, found))}); it must be on"
            f" ({', '.join(dims)}); {remedy}"
        )
    values = _numbers(data[[key]].transpose(*dims), key, name)
    if np.isinf(values).any():
        raise OceanError(f"{name}: {key} has infinite values; replace them")
    return np.ascontiguousarray(values)


def _currents(data: xr.Dataset, name: str, *, at_rest: bool) -> tuple[Array, Array]:
    """Components of the current, north and east; 0 where there is no value. [m/s]"""
    absent = [key for key in _CURRENTS if key not in data]
    if len(absent) == 1 or (absent and not at_rest):
        remedy = (
            "add it" if len(absent) == 1 else "add them, or allow water at rest with ocean.currents"
        )
        raise OceanError(f"{name}: no {' and '.join(absent)}; {remedy}")
    if absent:
        still = np.zeros([data.sizes[key] for key in _AXES])
        return still, still.copy()
    north, east = (np.nan_to_num(_field(data, key, _AXES, name)) for key in _CURRENTS)
    return north, east


def _sea_floor(data: xr.Dataset, depth: Array, levels: Any, name: str) -> Array | xr.DataArray:
    """Depth of the sea floor, from the data set or from the number of levels of each column. [m]"""
    if "sea_floor_depth" not in data:
        return np.asarray(layer_edges(depth)[levels])
    field = data["sea_floor_depth"]
    if field.ndim == 0:
        return np.full(levels.shape, float(field))
    dims = _FLOOR_AXES if set(field.dims) == set(_FLOOR_AXES) else _AXES[:2]
    values = np.maximum(np.nan_to_num(_field(data, "sea_floor_depth", dims, name)), 0.0)
    if dims == _AXES[:2]:
        return values
    axes = {key: _axis(data, key, name) for key in dims}
    sides = {key: data[key.removeprefix("floor_")].values for key in dims}
    for number, (key, axis) in enumerate(axes.items()):  # constant beyond its edges
        low = int(axis[0] > sides[key][0])
        high = int(axis[-1] < sides[key][-1])
        width = [(low, high) if k == number else (0, 0) for k in range(2)]
        values = np.pad(values, width, mode="edge")
        axes[key] = np.concatenate([sides[key][:1][:low], axis, sides[key][-1:][:high]])
    return xr.DataArray(values, axes, dims)
