"""What is what in a CF data set: temperature, salinity, currents and their axes, by standard names."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean.files import Stored, StoredFile
from pymantaray.ocean.hycom import HYCOM_NAMES

IN_SITU, POTENTIAL, CONSERVATIVE = "in situ", "potential", "conservative"
PRACTICAL, ABSOLUTE, PREFORMED, REFERENCE = "practical", "absolute", "preformed", "reference"
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
_PLAIN_NAMES = {"latitude": ("lat", "latitude"), "longitude": ("lon", "longitude"), "depth": ("depth",)}
_AXIS_REMEDY = "give its coordinate a standard_name and units, as CF has it"


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


def layout_of(file: StoredFile) -> Layout:
    """
    Find the variables of an ocean and the axes they share.

    Parameters
    ----------
    file : StoredFile

    Returns
    -------
    Layout

    Raises
    ------
    OceanError
        If nothing of an ocean is in the file, the choice is ambiguous, or the grid is not one of latitude,
        longitude and depth or pressure.
    """
    _refuse_other_horizontals(file)
    skeleton = _skeleton(file)
    named = {str(k): [str(n) for n in v] for k, v in skeleton.cf.standard_names.items()}
    fields = tuple(f for role in _ROLES if (f := _field(file, role, named)) is not None)
    relative = tuple(n for s in _GRID_RELATIVE for n in named.get(s, []))
    if not fields:
        if relative:
            raise OceanError(f"{file.name}: {grid_relative_refusal(relative)}")
        known = ", ".join(HYCOM_NAMES)
        raise OceanError(
            f"{file.name}: none of {known} is in it, and no variable with the standard_name of sea-water"
            " temperature, salinity or velocity on levels; is it a file of an ocean model?"
        )
    axes = [_axes(file, skeleton, field.variable) for field in fields]
    for field, found in zip(fields, axes, strict=True):
        if found != axes[0]:
            raise OceanError(
                f"{file.name}: {field.variable} lies on {', '.join(found)}, {fields[0].variable} on"
                f" {', '.join(axes[0])}; interpolate all to the same points first (xgcm)"
            )
    depth, lat, lon, time = axes[0]
    return Layout(fields, depth, lat, lon, time, relative)


def grid_relative_refusal(names: Sequence[str]) -> str:
    """
    Reason and remedy for currents along a model's own axes.

    Parameters
    ----------
    names : sequence of str
        The variables.

    Returns
    -------
    str
    """
    return (
        f"{' and '.join(names)} are velocities along the model's grid, not east and north; turn them by the"
        " grid's angle and set standard_name to eastward_ and northward_sea_water_velocity"
    )


def _skeleton(file: StoredFile) -> xr.Dataset:
    """Data set with all names and attributes and one value each, for cf-xarray: nothing is read."""
    import cf_xarray  # noqa: F401  registers the accessor

    variables = {}
    for name, stored in file.variables.items():
        attrs = {k: v for k, v in stored.attrs.items() if isinstance(v, str)}
        variables[name] = xr.Variable(stored.dims, np.zeros((1,) * len(stored.dims)), attrs)
    coordinates = {
        n for n, v in file.variables.items() if len(v.dims) < 2 or v.text("units").startswith("degrees")
    }
    for stored in file.variables.values():
        coordinates |= set(stored.text("coordinates").split()) & file.variables.keys()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = xr.Dataset({n: v for n, v in variables.items() if n not in coordinates})
        return data.assign_coords({n: variables[n] for n in sorted(coordinates)})


def _field(file: StoredFile, role: str, named: dict[str, list[str]]) -> Field | None:
    if role in file.variables and len(file.variables[role].shape) >= 3:  # HYCOM's name decides
        standard_name = file.variables[role].text("standard_name")
        kind = _ROLES[role].get(standard_name, next(iter(_ROLES[role].values())))
        if kind == POTENTIAL and "in-situ" in file.variables[role].text("comment"):
            raise OceanError(
                f"{file.name}: {role} is called potential by its standard_name and in situ by its comment;"
                " correct the one that is wrong"
            )
        return Field(role, kind, role)
    for standard_name, kind in _ROLES[role].items():
        found = [n for n in named.get(standard_name, []) if len(file.variables[n].shape) >= 3]
        if len(found) > 1:
            raise OceanError(
                f"{file.name}: {' and '.join(found)} are all {standard_name}; leave one in the file"
            )
        if found:
            return Field(role, kind, found[0])
    return None


def _axes(file: StoredFile, skeleton: xr.Dataset, name: str) -> tuple[str, str, str, str]:
    """Names of the coordinates depth, latitude, longitude and time of a variable."""
    variable = file.variables[name]
    found = skeleton[[name]].cf.coordinates
    axes = skeleton[[name]].cf.axes
    lat = _one(file, variable, "latitude", [*found.get("latitude", []), *axes.get("Y", [])])
    lon = _one(file, variable, "longitude", [*found.get("longitude", []), *axes.get("X", [])])
    depth = _one(
        file, variable, "depth", [*found.get("vertical", []), *axes.get("Z", []), *_pressures(file, variable)]
    )
    times = [n for n in (*found.get("time", []), *axes.get("T", []), "time") if n in file.variables]
    time = next((n for n in times if set(file.variables[n].dims) <= set(variable.dims)), "")
    if not time or len(file.variables[time].dims) > 1:
        raise OceanError(
            f"{file.name}: no time coordinate that can be read for {name}; needs a variable time with units"
            " 'hours since ...'"
        )
    used = {d for n in (depth, lat, lon, time) for d in file.variables[n].dims}
    extra = [d for d, n in zip(variable.dims, variable.shape, strict=True) if d not in used and n != 1]
    if extra:
        raise OceanError(
            f"{file.name}: {name} has a dimension {extra[0]!r} besides time, depth, lat, lon; select one"
        )
    return depth, lat, lon, time


def _pressures(file: StoredFile, variable: Stored) -> list[str]:
    return [
        n
        for n in variable.dims
        if n in file.variables and file.variables[n].text("standard_name").startswith("sea_water_pressure")
    ]


def _one(file: StoredFile, variable: Stored, axis: str, candidates: Sequence[object]) -> str:
    """Coordinate with one dimension, which the variable has."""
    known = [*map(str, candidates), *_PLAIN_NAMES[axis]]
    names = [name for name in dict.fromkeys(known) if name in file.variables]
    for name in names:
        stored = file.variables[name]
        if axis == "depth":
            _refuse_other_verticals(file, stored)
        if (
            len(stored.dims) == 1
            and stored.dims[0] in variable.dims
            and set(stored.dims) <= set(variable.dims)
        ):
            return name
    if any(len(file.variables[n].dims) >= 2 for n in names) and axis != "depth":
        raise OceanError(
            f"{file.name}: {axis} has two dimensions, the grid is curvilinear; regrid it to latitude and"
            " longitude first (xesmf), and turn the currents to east and north"
        )
    if any(len(file.variables[n].dims) >= 2 for n in names):
        raise OceanError(
            f"{file.name}: {names[0]} changes from place to place, the levels are not at fixed depths;"
            " interpolate to depths first (xgcm)"
        )
    raise OceanError(
        f"{file.name}: no {axis} axis for {variable.name}, which has dimensions {', '.join(variable.dims)};"
        f" {_AXIS_REMEDY}"
    )


def _refuse_other_verticals(file: StoredFile, vertical: Stored) -> None:
    standard_name = vertical.text("standard_name")
    if standard_name.startswith(_TERRAIN) or "formula_terms" in vertical.attrs:
        raise OceanError(
            f"{file.name}: {vertical.name} follows the sea bed ({standard_name or 'formula_terms'});"
            " interpolate to fixed depths first (xgcm, xroms)"
        )
    if "density" in standard_name or "sigma_t" in standard_name or standard_name == "model_level_number":
        raise OceanError(
            f"{file.name}: {vertical.name} ({standard_name}) is no depth; interpolate to fixed depths first (xgcm)"
        )


def _refuse_other_horizontals(file: StoredFile) -> None:
    remedy = "regrid it to latitude and longitude first (xesmf), and turn the currents to east and north"
    for name, stored in file.variables.items():
        mapping, standard_name = stored.text("grid_mapping_name"), stored.text("standard_name")
        if mapping.startswith("rotated") or standard_name in ("grid_latitude", "grid_longitude"):
            raise OceanError(f"{file.name}: {name} says that the grid has a rotated pole; {remedy}")
        projected = standard_name in ("projection_x_coordinate", "projection_y_coordinate")
        if projected or mapping not in ("", "latitude_longitude"):
            raise OceanError(
                f"{file.name}: {name} says that the grid is projected ({mapping or standard_name}); {remedy}"
            )
