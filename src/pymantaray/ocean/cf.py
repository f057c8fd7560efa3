"""
Identification of temperature, salinity, currents and their axes in a CF data set, by standard
names.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NoReturn

import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.messages import did_you_mean, one_line
from pymantaray.ocean.convert import (
    ABSOLUTE,
    CONSERVATIVE,
    HYCOM_NAMES,
    IN_SITU,
    POTENTIAL,
    PRACTICAL,
    PREFORMED,
    REFERENCE,
)
from pymantaray.ocean.files import file_name, text

# by standard name; the first match counts if a data set has several variables of one role
_ROLES: dict[str, dict[str, str]] = {
    "water_temp": {
        "sea_water_temperature": IN_SITU,
        "sea_water_conservative_temperature": CONSERVATIVE,
        "sea_water_potential_temperature": POTENTIAL,
    },
    "salinity": {
        "sea_water_practical_salinity": PRACTICAL,
        "sea_water_salinity": PRACTICAL,
        "sea_water_absolute_salinity": ABSOLUTE,
        "sea_water_reference_salinity": REFERENCE,
        "sea_water_preformed_salinity": PREFORMED,
    },
    "water_u": {"eastward_sea_water_velocity": ""},
    "water_v": {"northward_sea_water_velocity": ""},
}
_STANDARD_NAMES = [standard_name for kinds in _ROLES.values() for standard_name in kinds]
_GRID_RELATIVE = ("sea_water_x_velocity", "sea_water_y_velocity")
_TERRAIN = ("ocean_s_coordinate", "ocean_sigma", "ocean_double_sigma")
_MAX_NAMES = 12
# objectively analysed mean of the World Ocean Atlas, beside statistics with the same standard name
_ANALYSED = "_an"
_PLAIN_NAMES = {
    "latitude": ("lat", "latitude"),
    "longitude": ("lon", "longitude"),
    "depth": ("depth",),
}
_NAME_AXES = (
    "give its axes standard names (grid_latitude, projection_x_coordinate, ...) and the parameters"
    " of the projection, or add latitudes and longitudes in two dimensions"
)


@dataclass(frozen=True)
class Field:
    """One variable of an ocean in a file."""

    role: str
    """Name in the schema."""
    kind: str
    """Kind of temperature or salinity in TEOS-10."""
    variable: str


@dataclass(frozen=True)
class Layout:
    """Variables and axes of an ocean in a file; the axes are names of variables."""

    fields: tuple[Field, ...]
    depth: str
    lat: str
    lon: str
    time: str
    """Empty if the file has no time."""
    grid_relative: tuple[str, ...]
    """Currents along the model's axes, which are not used."""


def with_standard_names(files: Sequence[xr.Dataset], names: Mapping[str, str]) -> None:
    """Set standard names, and units in brackets behind them, of variables in open files."""
    for name, meaning in names.items():
        match = re.fullmatch(r"\s*(\w+)\s*(?:\[(.*)\])?\s*", meaning)
        if not match:
            raise OceanError(
                f"name of {name}: {meaning!r}; it must be a CF standard name such as"
                " sea_water_potential_temperature, or with a unit sea_water_temperature[degC]"
            )
        hint = did_you_mean(match[1], _STANDARD_NAMES, cutoff=0.9).strip()
        if hint and match[1] not in _STANDARD_NAMES:
            raise OceanError(f"name of {name}: {match[1]!r} is not a standard name; {hint}")
        holders = [data for data in files if name in data.variables]
        if not holders:
            there = ", ".join(
                dict.fromkeys(str(variable) for data in files for variable in data.variables)
            )
            where = ", ".join(map(file_name, files))
            raise OceanError(
                f"{where}: no variable {name!r} for {match[1]}; available: {one_line(there)}"
            )
        for data in holders:
            data[name].attrs |= {"standard_name": match[1]} | (
                {"units": match[2]} if match[2] else {}
            )


def layout_of(data: xr.Dataset) -> Layout:
    """
    Find the variables of an ocean and their common axes: latitude, longitude, and depth or
    pressure.
    """
    import cf_xarray  # noqa: F401  registers the accessor

    _refuse_other_horizontals(data)
    # mark coordinates as such for cf-xarray, without reading values
    coordinates = {
        n for n, v in data.variables.items() if v.ndim < 2 or text(v, "units").startswith("degrees")
    }
    for variable in data.variables.values():
        coordinates |= set(text(variable, "coordinates").split()) & data.variables.keys()
    data = data.set_coords(coordinates)
    named = {str(k): [str(n) for n in v] for k, v in data.cf.standard_names.items()}
    fields = tuple(f for role in _ROLES if (f := _field(data, role, named)) is not None)
    relative = tuple(n for s in _GRID_RELATIVE for n in named.get(s, []))
    if not fields:
        _refuse_terrain(data)
        if relative:
            _refuse(data, grid_relative_refusal(relative))
        _refuse(
            data,
            f"no variable {', '.join(HYCOM_NAMES)}, and none on levels with the standard_name of"
            " sea-water temperature,"
            f" salinity or velocity; it contains {listed_variables(data)}; add the standard_name"
            " to the file, or give `names`, as in"
            " temp=sea_water_temperature",
        )
    axes = _axes(data, fields[0].variable)
    for field in fields[1:]:
        others = _axes(data, field.variable)
        if others != axes:
            _refuse(
                data,
                f"{field.variable} is on {', '.join(others)}, {fields[0].variable} on"
                f" {', '.join(axes)}; interpolate both to the same points first (xgcm)",
            )
    return Layout(fields, *axes, relative)


def grid_relative_refusal(names: Sequence[str]) -> str:
    """Cause and remedy for currents along a model's own axes."""
    return (
        f"{' and '.join(names)} are velocities along the axes of the model's grid, not east and"
        " north; rotate them by the angle of the grid and set standard_name to eastward_ and"
        " northward_sea_water_velocity"
    )


def listed_variables(data: xr.Dataset) -> str:
    """
    Names and dimensions of a file's variables for messages, in descending order of the number of
    dimensions.
    """
    ranked = sorted(data.variables.items(), key=lambda item: -item[1].ndim)
    words = [f"{name} ({', '.join(map(str, v.dims))})" for name, v in ranked[:_MAX_NAMES]]
    more = len(ranked) - len(words)
    return ", ".join(words) + (f" and {more} more" if more > 0 else "") if words else "no variable"


def _refuse_terrain(data: xr.Dataset) -> None:
    """
    Raise an error if the levels of a grid of latitudes and longitudes follow the sea bed; those of
    a model's own grid are read before.
    """
    terrain = [str(n) for n, v in data.variables.items() if _follows_bed(v)]
    if terrain:
        _refuse(
            data,
            f"its levels follow the sea bed ({terrain[0]}), but it is no file of ROMS or CROCO with"
            " latitudes and longitudes in two dimensions; interpolate it to fixed depths first"
            " (xgcm, xroms)",
        )


def _follows_bed(variable: xr.Variable) -> bool:
    return text(variable, "standard_name").startswith(_TERRAIN) or "formula_terms" in variable.attrs


def _refuse(data: xr.Dataset, line: str) -> NoReturn:
    raise OceanError(f"{file_name(data)}: {line}")


def _field(data: xr.Dataset, role: str, named: dict[str, list[str]]) -> Field | None:
    kinds = _ROLES[role]
    if role in data.variables and data.variables[role].ndim >= 3:  # HYCOM's name has priority
        variable = data.variables[role]
        kind = kinds.get(text(variable, "standard_name"), next(iter(kinds.values())))
        if kind == POTENTIAL and "in-situ" in text(variable, "comment"):
            _refuse(
                data,
                f"{role}: its standard_name says potential temperature and its comment says in"
                " situ; correct one of them",
            )
        return Field(role, kind, role)
    for standard_name, kind in kinds.items():
        names = [n for n in named.get(standard_name, []) if data.variables[n].ndim >= 3]
        names = [n for n in names if n.endswith(_ANALYSED)] or names
        if len(names) > 1:
            _refuse(
                data, f"{' and '.join(names)} are all {standard_name}; keep only one in the file"
            )
        if names:
            return Field(role, kind, names[0])
    return None


def _axes(data: xr.Dataset, name: str) -> tuple[str, str, str, str]:
    """Names of a variable's coordinates depth, latitude, longitude and time."""
    variable = data.variables[name]
    about = data[[name]].cf
    of = about.coordinates
    axes = about.axes
    lat = _one(data, name, "latitude", [*of.get("latitude", []), *axes.get("Y", [])])
    lon = _one(data, name, "longitude", [*of.get("longitude", []), *axes.get("X", [])])
    pressures = [
        n
        for n in variable.dims
        if n in data.variables
        and text(data.variables[n], "standard_name").startswith("sea_water_pressure")
    ]
    depth = _one(data, name, "depth", [*of.get("vertical", []), *axes.get("Z", []), *pressures])
    times = [n for n in (*of.get("time", []), *axes.get("T", []), "time") if n in data.variables]
    time = next((str(n) for n in times if set(data.variables[n].dims) <= set(variable.dims)), "")
    if time and data.variables[time].ndim > 1:
        _refuse(data, f"{name}: its time {time} has two dimensions; select one instant")
    used = {d for n in filter(None, (depth, lat, lon, time)) for d in data.variables[n].dims}
    extra = [d for d, n in variable.sizes.items() if d not in used and n != 1]
    if extra:
        _refuse(
            data,
            f"{name} has a dimension {extra[0]!r} besides time, depth, lat, lon; select one"
            " element of it",
        )
    return depth, lat, lon, time


def _one(data: xr.Dataset, name: str, axis: str, candidates: Sequence[object]) -> str:
    """One-dimensional coordinate of a variable along one of its dimensions."""
    dims = data.variables[name].dims
    known = dict.fromkeys([*map(str, candidates), *_PLAIN_NAMES[axis]])
    names = [n for n in known if n in data.variables]
    for n in names:
        if axis == "depth":
            _refuse_other_verticals(data, n)
        if data.variables[n].ndim == 1 and data.variables[n].dims[0] in dims:
            return n
    line = (
        f"{name} with dimensions {', '.join(map(str, dims))} has no {axis} axis; add a coordinate"
        " with standard_name and units according to CF"
    )
    if axis != "depth":
        line += ", or name the file with the model's grid too"
    if axis == "depth" and any(data.variables[n].ndim >= 2 for n in names):
        _refuse_terrain(data)
        line = f"{names[0]} varies horizontally; interpolate to fixed depths first (xgcm)"
    _refuse(data, line)


def _refuse_other_verticals(data: xr.Dataset, name: str) -> None:
    standard_name = text(data.variables[name], "standard_name")
    if _follows_bed(data.variables[name]):
        _refuse_terrain(data)
    if (
        "density" in standard_name
        or "sigma_t" in standard_name
        or standard_name == "model_level_number"
    ):
        _refuse(
            data,
            f"{name} ({standard_name}) is not a depth; interpolate to fixed depths first (xgcm)",
        )


def _refuse_other_horizontals(data: xr.Dataset) -> None:
    for name, variable in data.variables.items():
        mapping = text(variable, "grid_mapping_name")
        standard_name = text(variable, "standard_name")
        if mapping.startswith("rotated") or standard_name in ("grid_latitude", "grid_longitude"):
            _refuse(data, f"the grid has a rotated pole ({name}); {_NAME_AXES}")
        projected = standard_name in ("projection_x_coordinate", "projection_y_coordinate")
        if projected or mapping not in ("", "latitude_longitude"):
            kind = mapping or standard_name
            _refuse(data, f"the grid is projected ({name}: {kind}); {_NAME_AXES}")
