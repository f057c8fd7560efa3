"""The ocean that files hold at one instant: their fields read, converted and put together."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import gsw
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.messages import one_line
from pymantaray.ocean import cf
from pymantaray.ocean.convert import (
    HYCOM_NAMES,
    IN_SITU,
    PRACTICAL,
    check_salinity_unit,
    to_fixed_depths,
    to_in_situ_and_practical,
    to_our_unit,
    up_to_surface,
)
from pymantaray.ocean.files import file_name, text
from pymantaray.ocean.schema import DIMS, VARIABLES, assemble_ocean

if TYPE_CHECKING:
    from pymantaray.ocean.open import Collection, Part

Array = NDArray[np.float64]
_MOST_DISAGREEING = 0.05  # share of the wet points
_STORAGE = ("coordinates", "calendar")
_TEXT = 300  # characters of a title or a source


def ocean_of(
    fields: Mapping[str, tuple["Part", cf.Field]], instant: np.datetime64, collection: "Collection"
) -> xr.Dataset:
    """Ocean of the variables that a collection has at an instant, not validated; its history says what was done."""
    steps: list[str] = []
    values = {role: _in_our_unit(part, field, instant) for role, (part, field) in fields.items()}
    part, temperature = fields["water_temp"]
    if "water_u" not in values:
        at_rest = np.where(np.isfinite(values["water_temp"]), 0.0, np.nan)
        values |= {"water_u": at_rest, "water_v": at_rest.copy()}
        steps.append("currents at rest: the data set has none")
    own = len(collection.parts) == 1 and _is_own(part)
    if not own:
        steps += _agree_on_wet(values)
    lat, lon, depth = part.grid.lat, part.grid.lon, part.levels
    kinds = temperature.kind, fields["salinity"][1].kind
    if kinds != (IN_SITU, PRACTICAL):
        column = depth[:, None, None]
        pressure = column if part.is_pressure else gsw.p_from_z(-column, lat[:, None])
        water = ((values["water_temp"], kinds[0]), (values["salinity"], kinds[1]))
        values["water_temp"], values["salinity"] = to_in_situ_and_practical(*water, pressure, lat, lon)
        steps.append(
            f"temperature from {kinds[0]} to in situ, salinity from {kinds[1]} to practical (TEOS-10)"
        )
    if part.is_pressure:
        depth, values, moved = to_fixed_depths(values, depth, lat)
        steps.append(f"levels of pressure moved by up to {moved:.2g} m to one depth each")
    first = depth[0]
    depth, values = up_to_surface(depth, values, file_name(part.data))
    if first != 0.0:
        steps.append(f"level at 0 m added with the values at {first:.4g} m")
    data = collection.parts[0].data
    hycom = all(_is_hycom(p) for p in collection.parts)
    model = "HYCOM" if hycom else collection.names
    ocean = assemble_ocean(
        {"depth": depth, "lat": lat, "lon": lon},
        instant,
        values,
        title=one_line(text(data, "title"), _TEXT) or f"{'HYCOM ' if hycom else ''}{collection.names}",
        source=next(filter(None, (one_line(text(data, k), _TEXT) for k in ("source", "institution"))), model),
        synthetic=any(np.array_equal(p.data.attrs.get("synthetic", 0), 1) for p in collection.parts),
        validate=False,
    )
    if own:
        return _with_own_attributes(ocean, part)
    history = str(part.data.attrs.get("history", "")).splitlines()[:50]
    lines = [line for line in (*(one_line(line, _TEXT) for line in history), *steps) if line]
    return ocean.assign_attrs(history="\n".join(lines)) if lines else ocean


def _in_our_unit(part: "Part", field: cf.Field, instant: np.datetime64) -> Array:
    variable = part.data.variables[field.variable]
    where, unit = f"{file_name(part.data)}: {field.variable}", text(variable, "units")
    practical = field.role == "salinity" and field.kind == PRACTICAL
    if practical and not unit and ("units" in variable.attrs or _is_hycom(part)):
        unit = "1"  # the canonical unit is also written as a number, or left out
    quantity = {
        "water_temp": "temperature",
        "salinity": "practical salinity" if practical else "mass salinity",
    }.get(field.role, "velocity")
    values = to_our_unit(part.read(field, instant), quantity, unit, where=where)
    if practical:
        check_salinity_unit(values, where)
    return values


def _agree_on_wet(fields: dict[str, Array]) -> list[str]:
    """
    Make all fields agree on what is water, where models' masks differ by a few points.

    Water needs temperature and salinity from the surface down; a current that is missing there is 0, as
    at the sea bed.
    """
    some = np.isfinite(fields["water_temp"]) | np.isfinite(fields["salinity"])
    both = np.isfinite(fields["water_temp"]) & np.isfinite(fields["salinity"])
    wet = np.logical_and.accumulate(both, axis=0)
    moving = np.isfinite(fields["water_u"]) & np.isfinite(fields["water_v"])
    dropped, still = int(np.count_nonzero(some & ~wet)), int(np.count_nonzero(wet & ~moving))
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
    lines = {
        f"{dropped} values beneath a missing one, or without its partner, left out": dropped,
        f"currents set to 0 at {still} wet points where they are missing": still,
    }
    return [line for line, count in lines.items() if count]


def _is_own(part: "Part") -> bool:
    """Whether a file is of our schema, to be given back unchanged."""
    variables = part.data.variables
    same = all(
        v.name in variables
        and variables[v.name].dims == DIMS
        and text(variables[v.name], "standard_name") == v.standard_name
        and text(variables[v.name], "units") == v.units
        for v in VARIABLES
    )
    attrs = part.data.attrs
    stated = "synthetic" in attrs and all(isinstance(attrs.get(name), str) for name in ("title", "source"))
    return same and stated and not variables[part.layout.time].dims


def _with_own_attributes(ocean: xr.Dataset, part: "Part") -> xr.Dataset:
    def plain(attrs: Mapping[str, object], *storage: str) -> dict[str, object]:
        return {
            k: v.item() if isinstance(v, np.generic) else v
            for k, v in attrs.items()
            if k not in (*_STORAGE, *storage)
        }

    ocean.attrs = plain(part.data.attrs)
    for name in (*(v.name for v in VARIABLES), *DIMS):
        ocean[name].attrs = plain(part.data.variables[name].attrs)
    ocean["time"].attrs = plain(part.data.variables[part.layout.time].attrs, "units")
    return ocean


def _is_hycom(part: "Part") -> bool:
    return all(f.variable in HYCOM_NAMES for f in part.layout.fields)
