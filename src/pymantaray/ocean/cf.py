"""What is what in a CF data set: temperature, salinity, currents and their axes, by standard names."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn

import xarray as xr

from pymantaray.errors import OceanError
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

# by standard name; where a data set has several of one role, the first here is taken
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
_GRID_RELATIVE = ("sea_water_x_velocity", "sea_water_y_velocity")
_TERRAIN = ("ocean_s_coordinate", "ocean_sigma", "ocean_double_sigma")
_NORTH = ("degrees_north", "degree_north", "degrees_n", "degree_n")
_MOST_NAMES = 12
_PLAIN_NAMES = {"latitude": ("lat", "latitude"), "longitude": ("lon", "longitude"), "depth": ("depth",)}
_REGRID = "regrid it to latitude and longitude first (xesmf), and turn the currents to east and north"


@dataclass(frozen=True)
class Field:
    """One variable of an ocean in a file."""

    role: str
    """Its name in the schema."""
    kind: str
    """Of temperature or salinity, as TEOS-10 tells them apart."""
    variable: str


@dataclass(frozen=True)
class Layout:
    """Variables and axes of an ocean in a file; the axes are names of variables."""

    fields: tuple[Field, ...]
    depth: str
    lat: str
    lon: str
    time: str
    grid_relative: tuple[str, ...]
    """Currents along the model's axes, which are of no use here."""


def layout_of(data: xr.Dataset) -> Layout:
    """Variables of an ocean and the axes they share, on a grid of latitude, longitude and depth or pressure."""
    import cf_xarray  # noqa: F401  registers the accessor

    _refuse_other_horizontals(data)
    data = _with_coordinates(data)
    named = {str(k): [str(n) for n in v] for k, v in data.cf.standard_names.items()}
    fields = tuple(f for role in _ROLES if (f := _field(data, role, named)) is not None)
    relative = tuple(n for s in _GRID_RELATIVE for n in named.get(s, []))
    if not fields:
        _refuse_model_grid(data)
        if relative:
            _refuse(data, grid_relative_refusal(relative))
        _refuse(
            data,
            f"none of {', '.join(HYCOM_NAMES)} is in it, and no variable with the standard_name of sea-water"
            f" temperature, salinity or velocity on levels; found {found_variables(data)}: give those that are meant their"
            ' standard_name, in the file or as names={"temp": "sea_water_temperature"} in Python',
        )
    axes = _axes(data, fields[0].variable)
    for field in fields[1:]:
        others = _axes(data, field.variable)
        if others != axes:
            _refuse(
                data,
                f"{field.variable} lies on {', '.join(others)}, {fields[0].variable} on {', '.join(axes)};"
                " interpolate all to the same points first (xgcm)",
            )
    return Layout(fields, *axes, relative)


def grid_relative_refusal(names: Sequence[str]) -> str:
    """Reason and remedy for currents along a model's own axes."""
    return (
        f"{' and '.join(names)} are velocities along the model's grid, not east and north; turn them by the"
        " grid's angle and set standard_name to eastward_ and northward_sea_water_velocity"
    )


def found_variables(data: xr.Dataset) -> str:
    """Names and dimensions of a file's variables, those with most dimensions first, for messages."""
    ranked = sorted(data.variables.items(), key=lambda item: -item[1].ndim)
    words = [f"{name} ({', '.join(map(str, v.dims))})" for name, v in ranked[:_MOST_NAMES]]
    more = len(ranked) - len(words)
    return ", ".join(words) + (f" and {more} more" if more > 0 else "") if words else "no variable"


def _refuse_model_grid(data: xr.Dataset) -> None:
    """Refuse a grid that is curvilinear or has levels along the sea bed, as ROMS has, by all that is in the way."""
    curved = [str(n) for n, v in data.variables.items() if v.ndim == 2 and _is_latitude(v)]
    terrain = [str(n) for n, v in data.variables.items() if _follows_bed(v)]
    straight = any(v.ndim == 1 and _is_latitude(v) for v in data.variables.values())
    reasons, remedies = [], []
    if curved and not straight:
        reasons.append(f"its grid is curvilinear ({curved[0]} has two dimensions)")
        remedies.append("regrid it to latitude and longitude (xesmf), with currents turned to east and north")
    if terrain:
        reasons.append(f"its levels follow the sea bed ({terrain[0]})")
        remedies.append("interpolate it to fixed depths (xgcm, xroms)")
    if reasons:
        neither = "neither is" if len(reasons) == 2 else "this is not"
        _refuse(data, f"{' and '.join(reasons)}: {neither} supported; first {', and '.join(remedies)}")


def _is_latitude(variable: xr.Variable) -> bool:
    unit = text(variable, "units").lower()
    return text(variable, "standard_name") == "latitude" or unit in _NORTH


def _follows_bed(variable: xr.Variable) -> bool:
    return text(variable, "standard_name").startswith(_TERRAIN) or "formula_terms" in variable.attrs


def _refuse(data: xr.Dataset, line: str) -> NoReturn:
    raise OceanError(f"{file_name(data)}: {line}")


def _with_coordinates(data: xr.Dataset) -> xr.Dataset:
    """Data set whose coordinates are called so, for cf-xarray; nothing is read."""
    names = {n for n, v in data.variables.items() if v.ndim < 2 or text(v, "units").startswith("degrees")}
    for variable in data.variables.values():
        names |= set(text(variable, "coordinates").split()) & data.variables.keys()
    return data.set_coords(names)


def _field(data: xr.Dataset, role: str, named: dict[str, list[str]]) -> Field | None:
    kinds = _ROLES[role]
    if role in data.variables and data.variables[role].ndim >= 3:  # HYCOM's name decides
        variable = data.variables[role]
        kind = kinds.get(text(variable, "standard_name"), next(iter(kinds.values())))
        if kind == POTENTIAL and "in-situ" in text(variable, "comment"):
            _refuse(
                data,
                f"{role} is called potential by its standard_name and in situ by its comment; correct the one that"
                " is wrong",
            )
        return Field(role, kind, role)
    for standard_name, kind in kinds.items():
        names = [n for n in named.get(standard_name, []) if data.variables[n].ndim >= 3]
        if len(names) > 1:
            _refuse(data, f"{' and '.join(names)} are all {standard_name}; leave one in the file")
        if names:
            return Field(role, kind, names[0])
    return None


def _axes(data: xr.Dataset, name: str) -> tuple[str, str, str, str]:
    """Names of the coordinates depth, latitude, longitude and time of a variable."""
    variable, about = data.variables[name], data[[name]].cf
    of, axes = about.coordinates, about.axes
    lat = _one(data, name, "latitude", [*of.get("latitude", []), *axes.get("Y", [])])
    lon = _one(data, name, "longitude", [*of.get("longitude", []), *axes.get("X", [])])
    pressures = [
        n
        for n in variable.dims
        if n in data.variables and text(data.variables[n], "standard_name").startswith("sea_water_pressure")
    ]
    depth = _one(data, name, "depth", [*of.get("vertical", []), *axes.get("Z", []), *pressures])
    times = [n for n in (*of.get("time", []), *axes.get("T", []), "time") if n in data.variables]
    time = next((str(n) for n in times if set(data.variables[n].dims) <= set(variable.dims)), "")
    if not time or data.variables[time].ndim > 1:
        _refuse(
            data,
            f"no time coordinate that can be read for {name}; needs a variable time with units 'hours since ...'",
        )
    used = {d for n in (depth, lat, lon, time) for d in data.variables[n].dims}
    extra = [d for d, n in variable.sizes.items() if d not in used and n != 1]
    if extra:
        _refuse(data, f"{name} has a dimension {extra[0]!r} besides time, depth, lat, lon; select one")
    return depth, lat, lon, time


def _one(data: xr.Dataset, name: str, axis: str, candidates: Sequence[object]) -> str:
    """Coordinate with one dimension, which the variable has."""
    dims = data.variables[name].dims
    known = dict.fromkeys([*map(str, candidates), *_PLAIN_NAMES[axis]])
    names = [n for n in known if n in data.variables]
    for n in names:
        if axis == "depth":
            _refuse_other_verticals(data, n)
        if data.variables[n].ndim == 1 and data.variables[n].dims[0] in dims:
            return n
    line = (
        f"no {axis} axis for {name}, which has dimensions {', '.join(map(str, dims))}; give its coordinate a"
        " standard_name and units, as CF has it"
    )
    if any(data.variables[n].ndim >= 2 for n in names):
        _refuse_model_grid(data)
        line = f"{axis} has two dimensions, the grid is curvilinear; {_REGRID}"
        if axis == "depth":
            line = f"{names[0]} changes from place to place; interpolate to fixed depths first (xgcm)"
    _refuse(data, line)


def _refuse_other_verticals(data: xr.Dataset, name: str) -> None:
    standard_name = text(data.variables[name], "standard_name")
    if _follows_bed(data.variables[name]):
        _refuse_model_grid(data)
    if "density" in standard_name or "sigma_t" in standard_name or standard_name == "model_level_number":
        _refuse(data, f"{name} ({standard_name}) is no depth; interpolate to fixed depths first (xgcm)")


def _refuse_other_horizontals(data: xr.Dataset) -> None:
    for name, variable in data.variables.items():
        mapping, standard_name = text(variable, "grid_mapping_name"), text(variable, "standard_name")
        if mapping.startswith("rotated") or standard_name in ("grid_latitude", "grid_longitude"):
            _refuse(data, f"{name} says that the grid has a rotated pole; {_REGRID}")
        projected = standard_name in ("projection_x_coordinate", "projection_y_coordinate")
        if projected or mapping not in ("", "latitude_longitude"):
            _refuse(data, f"{name} says that the grid is projected ({mapping or standard_name}); {_REGRID}")
