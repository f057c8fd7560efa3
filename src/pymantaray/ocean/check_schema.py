"""Every violation of the schema of an ocean, found independently of each other."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr

from pymantaray.geometry.longitude import wrapped
from pymantaray.ocean.findings import Finding, doubtful, wrong
from pymantaray.ocean.schema import DIMS, MIN_POINTS, VARIABLES, Variable

_UNITS = {
    "degC": {"degc", "deg_c", "celsius", "degree_celsius", "degrees_celsius", "degree_c", "degrees_c", "°c"},
    "1": {"1", "psu", "pss-78", "pss78", "1e-3", "0.001", "dimensionless"},
    "m s-1": {"m s-1", "m/s", "m.s-1", "meter second-1", "metre second-1", "meters per second", "m s^-1"},
}
_AXIS_UNITS = {
    "depth": {"m", "meter", "meters", "metre", "metres"},
    "lat": {"degrees_north", "degree_north", "degrees_n", "degree_n", "degrees"},
    "lon": {"degrees_east", "degree_east", "degrees_e", "degree_e", "degrees"},
}

_AXIS_UNIT = {"depth": "m", "lat": "degrees_north", "lon": "degrees_east"}


def check_schema(ocean: xr.Dataset) -> list[Finding]:
    """
    List all violations of the schema.

    Parameters
    ----------
    ocean : xarray.Dataset
        Anything.

    Returns
    -------
    list of Finding
        ``where`` begins with the variable's or axis' name. Values that need a healthy structure (which
        points are wet) are only compared where there is one.
    """
    found = [*_axes(ocean), *_time(ocean)]
    usable = []
    for variable in VARIABLES:
        problems = _variable(ocean, variable)
        found.extend(problems)
        if variable.name in ocean and ocean[variable.name].dims == DIMS:
            usable.append(variable.name)
    found.extend(_wet(ocean, usable))
    missing = [name for name in ("title", "source", "synthetic") if name not in ocean.attrs]
    if missing:
        found.append(wrong("attributes missing", ", ".join(missing), "title, source, synthetic", "set them"))
    elif ocean.attrs["synthetic"] not in (0, 1):
        found.append(
            wrong("attribute", repr(ocean.attrs["synthetic"]), "0 or 1", "set it", where="synthetic")
        )
    return found


def _axes(ocean: xr.Dataset) -> list[Finding]:
    found = []
    for name in DIMS:
        if name not in ocean.coords:
            found.append(
                wrong("axis missing", "no such coordinate", "depth, lat, lon", "name it so", where=name)
            )
            continue
        axis = ocean[name]
        units = str(axis.attrs.get("units", "")).strip().lower()
        if units and units not in _AXIS_UNITS[name]:
            found.append(wrong("units", units, _AXIS_UNIT[name], "convert the axis", where=name))
        if axis.dims != (name,) or not np.issubdtype(axis.dtype, np.number):
            found.append(
                wrong(
                    "axis",
                    f"dimensions {axis.dims}, {axis.dtype}",
                    "one of numbers",
                    "rebuild it",
                    where=name,
                )
            )
            continue
        values = np.asarray(axis.values, dtype=float)
        if values.size < MIN_POINTS[name]:
            found.append(
                wrong(
                    "axis too short",
                    f"{values.size} points",
                    f"{MIN_POINTS[name]} or more",
                    "widen it",
                    where=name,
                )
            )
        steps = np.diff(values)
        bad = int(np.count_nonzero(~(steps > 0.0)))
        if bad:
            at = values[int(np.argmax(~(steps > 0.0)))]
            found.append(
                wrong(
                    "axis not monotone",
                    f"{bad} of {steps.size} steps do not rise, the first after {at:g}",
                    "strictly rising",
                    "sort it and drop duplicates",
                    where=name,
                )
            )
        elif name == "depth" and values[0] != 0.0:
            found.append(
                wrong(
                    "axis",
                    f"starts at {values[0]:g} m",
                    "0 m, positive down",
                    "add a level at 0 m",
                    where=name,
                )
            )
        finite = values[np.isfinite(values)]
        if name == "lat" and finite.size and np.abs(finite).max() > 90.0:
            found.append(
                wrong(
                    "axis",
                    f"reaches {finite.min():g} to {finite.max():g}",
                    "-90 to 90",
                    "check it",
                    where=name,
                )
            )
        if name == "lon" and finite.size and np.ptp(finite) >= 360.0:
            found.append(
                wrong("axis", f"spans {np.ptp(finite):g} degrees", "less than 360", "cut it", where=name)
            )
    return found


def _time(ocean: xr.Dataset) -> list[Finding]:
    if "time" not in ocean.coords:
        return [wrong("axis missing", "no such coordinate", "one instant", "add the time", where="time")]
    time = ocean["time"]
    if time.ndim or not np.issubdtype(time.dtype, np.datetime64):
        return [
            wrong(
                "axis", f"{time.size} of {time.dtype}", "one datetime64", "select one time step", where="time"
            )
        ]
    return []


def _variable(ocean: xr.Dataset, variable: Variable) -> list[Finding]:
    name = variable.name
    if name not in ocean.data_vars:
        return [wrong("variable missing", "none", variable.standard_name, "add it", where=name)]
    field = ocean[name]
    found = []
    units = str(field.attrs.get("units", "")).strip().lower()
    if not units:
        found.append(doubtful("units", "not stated", variable.units, "state them", where=name))
    elif units not in _UNITS[variable.units]:
        found.append(wrong("units", units, variable.units, "convert the values", where=name))
    if set(field.dims) != set(DIMS):
        found.append(wrong("dimensions", str(field.dims), str(DIMS), "rebuild the variable", where=name))
        return found
    if field.dims != DIMS:
        found.append(wrong("dimensions", str(field.dims), str(DIMS), "transpose the variable", where=name))
    if not np.issubdtype(field.dtype, np.number):
        found.append(wrong("type", str(field.dtype), "numbers", "rebuild the variable", where=name))
        return found
    values = np.asarray(field.values, dtype=float)
    infinite = int(np.count_nonzero(np.isinf(values)))
    if infinite:
        found.append(
            wrong(
                "not finite", f"{infinite} infinite values", "NaN below the sea bed", "mask them", where=name
            )
        )
    finite = np.isfinite(values)
    if not finite.any():
        found.append(
            wrong("no value", "all missing", "water somewhere", "choose a window over water", where=name)
        )
        return found
    outside = finite & ((values < variable.lowest) | (values > variable.highest))
    if outside.any():
        found.append(
            wrong(
                "values",
                f"{int(outside.sum())} of {int(finite.sum())} outside, {values[finite].min():g} to"
                f" {values[finite].max():g}",
                f"{variable.lowest:g} to {variable.highest:g} {variable.units}",
                "check packing, units and fill value",
                where=name,
            )
        )
    return found


def _wet(ocean: xr.Dataset, names: list[str]) -> list[Finding]:
    """Islands of NaN: what is wet in one variable and dry in another, or wet beneath a dry point."""
    found: list[Finding] = []
    if "water_temp" not in names or any(ocean[n].shape != ocean["water_temp"].shape for n in names):
        return found
    wet = {name: np.isfinite(np.asarray(ocean[name].values, dtype=float)) for name in names}
    reference = wet["water_temp"]
    for name in names[1:]:
        differ = wet[name] != reference
        if differ.any():
            found.append(
                wrong(
                    "NaN islands",
                    f"{int(differ.sum())} points are missing in it or in water_temp, not in both",
                    "the same points",
                    "mask all variables alike, or fill the gap",
                    where=f"{name} {place_of(ocean, np.argwhere(differ)[0])}",
                )
            )
    beneath = reference[1:] & ~np.logical_and.accumulate(reference, axis=0)[:-1]
    if beneath.any():
        k, i, j = np.argwhere(beneath)[0]
        found.append(
            wrong(
                "NaN islands",
                f"{int(beneath.sum())} wet points lie beneath a dry one",
                "none",
                "fill the gap above them, or mask them",
                where=f"water_temp {place_of(ocean, (k + 1, i, j))}",
            )
        )
    return found


def place_of(ocean: xr.Dataset, index: Iterable[Any]) -> str:
    """
    Place of a grid point in words.

    Parameters
    ----------
    ocean : xarray.Dataset
    index : sequence of int
        Along depth, lat and lon.

    Returns
    -------
    str
        As ``34.64 N, 74.72 W, 50 m``; indices where an axis is missing.
    """
    k, i, j = (int(n) for n in index)
    if any(name not in ocean.coords or ocean[name].ndim != 1 for name in DIMS):
        return f"index {k}, {i}, {j}"
    depth, lat, lon = (float(ocean[name].values[n]) for name, n in zip(DIMS, (k, i, j), strict=True))
    return f"{latitude(lat)}, {longitude(lon)}, {depth:g} m"


def latitude(value: float) -> str:
    """
    Latitude in words.

    Parameters
    ----------
    value : float
        [degrees]

    Returns
    -------
    str
        As ``74.5 N``.
    """
    return f"{abs(round(value, 3)):g} {'S' if value < 0.0 else 'N'}"


def longitude(value: float) -> str:
    """
    Longitude in words.

    Parameters
    ----------
    value : float
        In any 360 degree window. [degrees]

    Returns
    -------
    str
        As ``140 W``.
    """
    turned = wrapped(value)
    return f"{abs(round(turned, 3)):g} {'W' if turned < 0.0 else 'E'}"
