"""The valid ocean that a collection of files holds at one instant."""

from collections.abc import Mapping
from typing import Any

import gsw
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean import cf, units
from pymantaray.ocean.collection import Collection, Currents, Part
from pymantaray.ocean.conversion import (
    check_salinity_unit,
    to_fixed_depths,
    to_in_situ_and_practical,
    up_to_surface,
)
from pymantaray.ocean.files import Stored
from pymantaray.ocean.hycom import HYCOM_NAMES
from pymantaray.ocean.schema import DIMS, VARIABLES, assemble_ocean, with_history

Array = NDArray[np.float64]
_MOST_DISAGREEING = 0.05  # share of the wet points
_STORAGE = {
    *("_FillValue", "missing_value", "scale_factor", "add_offset", "coordinates", "calendar", "_Unsigned"),
    *("DIMENSION_LABELS", "_ARRAY_DIMENSIONS", "_Netcdf4Dimid", "_NCProperties", "_Netcdf4Coordinates"),
}
_TEXT = 300  # characters of a title or a source


def ocean_at(collection: Collection, instant: np.datetime64, currents: Currents) -> xr.Dataset:
    """
    Read, convert and validate the ocean at an instant.

    Parameters
    ----------
    collection : Collection
    instant : numpy.datetime64
        One of `Collection.times`.
    currents : {"required", "rest"}

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    OceanError
        If something is missing then, or the result is not a valid ocean.
    """
    found = collection.at(instant, collection.needed(currents))
    try:
        ocean = _ocean(collection, found, instant)
    except OceanError as error:
        message = str(error)
        known = any(message.startswith(part.file.name) for part in collection.parts)
        raise OceanError(message if known else f"{collection.names}: {message}") from None
    except Exception as error:  # noqa: BLE001  what no check foresaw in a damaged file
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise OceanError(f"{collection.names}: cannot be read, perhaps damaged ({reason})") from None
    return ocean


def _ocean(
    collection: Collection, found: Mapping[str, tuple[Part, cf.Field]], instant: np.datetime64
) -> xr.Dataset:
    done: list[str] = []
    fields = {role: _in_our_unit(part, field, instant) for role, (part, field) in found.items()}
    part, temperature = found["water_temp"]
    if "water_u" not in fields:
        at_rest = np.where(np.isfinite(fields["water_temp"]), 0.0, np.nan)
        fields |= {"water_u": at_rest, "water_v": at_rest.copy()}
        done.append("currents at rest: the data set has none")
    own = len(collection.parts) == 1 and _is_own(part)
    if not own:
        done += _agree_on_wet(fields)
    lat, lon, depth = part.grid.lat, part.grid.lon, part.levels
    salinity = found["salinity"][1]
    if (temperature.kind, salinity.kind) != (cf.IN_SITU, cf.PRACTICAL):
        pressure = (
            depth[:, None, None] if part.is_pressure else gsw.p_from_z(-depth[:, None, None], lat[:, None])
        )
        fields["water_temp"], fields["salinity"] = to_in_situ_and_practical(
            fields["water_temp"], temperature.kind, fields["salinity"], salinity.kind, pressure, lat, lon
        )
        done.append(
            f"temperature from {temperature.kind} to in situ, salinity from {salinity.kind} to practical (TEOS-10)"
        )
    if part.is_pressure:
        depth, fields, moved = to_fixed_depths(fields, depth, lat)
        done.append(f"levels of pressure moved by up to {moved:.2g} m to one depth each")
    first = depth[0]
    depth, fields = up_to_surface(depth, fields, part.file.name)
    if first != 0.0:
        done.append(f"level at 0 m added with the values at {first:.4g} m")
    ocean = assemble_ocean(
        {"depth": depth, "lat": lat, "lon": lon},
        instant,
        fields,
        title=_title(collection),
        source=_source(collection),
        synthetic=any(p.file.attrs.get("synthetic") == 1 for p in collection.parts),
    )
    if own:
        return _with_own_attributes(ocean, part)
    history = _lines(part.file.attrs.get("history"))
    if history:
        ocean.attrs["history"] = history
    for line in done:
        ocean = with_history(ocean, line)
    return ocean


def _in_our_unit(part: Part, field: cf.Field, instant: np.datetime64) -> Array:
    stored = part.file.variables[field.variable]
    where = f"{part.file.name}: {field.variable}"
    unit = stored.text("units")
    if field.role == "salinity" and not unit:
        # the canonical unit 1 of practical salinity is also written as a number, or left out
        unit = "1" if field.kind == cf.PRACTICAL and ("units" in stored.attrs or _is_hycom(part)) else ""
    quantity = {
        "water_temp": "temperature",
        "salinity": "practical salinity" if field.kind == cf.PRACTICAL else "mass salinity",
    }.get(field.role, "velocity")
    values = units.convert(part.read(field, instant), quantity, unit, where=where)
    if field.role == "salinity" and field.kind == cf.PRACTICAL:
        check_salinity_unit(values, where)
    return values


def _agree_on_wet(fields: dict[str, Array]) -> list[str]:
    """
    Make all fields agree on what is water, where models' masks differ by a few points.

    Water needs temperature and salinity from the surface down; a current that is missing there is 0, as
    at the sea bed.
    """
    valid = np.isfinite(fields["water_temp"]) & np.isfinite(fields["salinity"])
    wet = np.logical_and.accumulate(valid, axis=0)
    dropped = int(
        np.count_nonzero((np.isfinite(fields["water_temp"]) | np.isfinite(fields["salinity"])) & ~wet)
    )
    moving = np.isfinite(fields["water_u"]) & np.isfinite(fields["water_v"])
    still = int(np.count_nonzero(wet & ~moving))
    count = int(np.count_nonzero(wet))
    if not count:
        return []  # what is wrong then is said by the validation
    if dropped + still > _MOST_DISAGREEING * count:
        raise OceanError(
            f"temperature, salinity and currents disagree on {dropped + still} of {count} points about what is"
            " water; do they belong together, and is the fill value declared?"
        )
    for name, field in fields.items():
        values = np.where(moving, field, 0.0) if name in ("water_u", "water_v") else field
        fields[name] = np.where(wet, values, np.nan)
    lines = []
    if dropped:
        lines.append(f"{dropped} values beneath a missing one, or without its partner, left out")
    if still:
        lines.append(f"currents set to 0 at {still} wet points where they are missing")
    return lines


def _is_own(part: Part) -> bool:
    """Whether a file is of our schema, to be given back unchanged."""
    variables, attrs = part.file.variables, part.file.attrs
    same = all(
        v.name in variables
        and variables[v.name].dims == DIMS
        and variables[v.name].text("standard_name") == v.standard_name
        and variables[v.name].text("units") == v.units
        for v in VARIABLES
    )
    return same and {"title", "source", "synthetic"} <= attrs.keys() and not variables[part.layout.time].dims


def _with_own_attributes(ocean: xr.Dataset, part: Part) -> xr.Dataset:
    ocean.attrs = {str(k): v for k, v in part.file.attrs.items() if k not in _STORAGE}
    for name in (*(v.name for v in VARIABLES), *DIMS):
        ocean[name].attrs = _descriptive(part.file.variables[name])
    time = _descriptive(part.file.variables[part.layout.time])
    ocean["time"].attrs = {k: v for k, v in time.items() if k != "units"}
    return ocean


def _descriptive(stored: Stored) -> dict[str, Any]:
    return {str(k): v for k, v in stored.attrs.items() if k not in _STORAGE}


def _is_hycom(part: Part) -> bool:
    return all(f.variable in HYCOM_NAMES for f in part.layout.fields)


def _title(collection: Collection) -> str:
    default = f"{'HYCOM ' if all(_is_hycom(p) for p in collection.parts) else ''}{collection.names}"
    return _line(collection.parts[0].file.attrs.get("title")) or default


def _source(collection: Collection) -> str:
    attrs = collection.parts[0].file.attrs
    default = "HYCOM" if all(_is_hycom(p) for p in collection.parts) else collection.names
    return _line(attrs.get("source")) or _line(attrs.get("institution")) or default


def _line(value: object) -> str:
    """Attribute as one line of printable text."""
    text = " ".join(value.split()) if isinstance(value, str) else ""
    return "".join(c for c in text if c.isprintable())[:_TEXT]


def _lines(value: object) -> str:
    lines = value.splitlines() if isinstance(value, str) else []
    return "\n".join(line for line in map(_line, lines[:50]) if line)
