"""Ocean at one instant from the fields of files: reading, conversion and assembly."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gsw
import numpy as np
import xarray as xr

from pymantaray.arrays import Array, Mask
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
from pymantaray.ocean.schema import (
    DIMS,
    SEA_FLOOR,
    SEA_FLOOR_ATTRIBUTES,
    VARIABLES,
    assemble_ocean,
)
from pymantaray.records.digits import counted

if TYPE_CHECKING:
    from pymantaray.ocean.open import Collection, Part

_MAX_DISAGREEMENT = 0.05  # fraction of the wet points
_STORAGE = ("coordinates", "calendar")
_SALTY = 5.0  # practical salinity or g/kg
_MAX_TEXT = 300  # characters of a title or a source


def ocean_of(
    fields: Mapping[str, tuple["Part", cf.Field]], instant: np.datetime64, collection: "Collection"
) -> xr.Dataset:
    """
    Assemble the variables of a collection at an instant, without validation; the history lists the
    conversions.
    """
    steps: list[str] = []
    # values in our units, without land
    raw = {role: part.read(field, instant) for role, (part, field) in fields.items()}
    steps += [
        f"{counted(count, 'value')} of {fields[role][1].variable} outside its valid range removed"
        for role, (_, count) in raw.items()
        if count
    ]
    land, about = _zeros(raw["water_temp"][0], raw["salinity"][0])
    steps += about
    values = {
        role: np.where(land, np.nan, _in_our_unit(raw[role][0], part, field))
        for role, (part, field) in fields.items()
    }
    part, temperature = fields["water_temp"]
    if "water_u" not in values:
        at_rest = np.where(np.isfinite(values["water_temp"]), 0.0, np.nan)
        values |= {"water_u": at_rest, "water_v": at_rest.copy()}
        steps.append("currents at rest: the data set has none")
    # water is wet at the same points in all variables
    own = len(collection.parts) == 1 and _is_own(part)
    if not own:
        steps += _agree_on_wet(values)
    lat = part.grid.lat
    lon = part.grid.lon
    depth = part.levels
    # in-situ temperature and practical salinity
    kinds = temperature.kind, fields["salinity"][1].kind
    if kinds != (IN_SITU, PRACTICAL):
        column = depth[:, None, None]
        pressure = column if part.is_pressure else gsw.p_from_z(-column, lat[:, None])
        water = ((values["water_temp"], kinds[0]), (values["salinity"], kinds[1]))
        values["water_temp"], values["salinity"] = to_in_situ_and_practical(
            *water, pressure, lat, lon
        )
        steps.append(_conversion_step(*kinds))
    # depths of the levels, from the surface down
    if part.is_pressure:
        depth, values, moved = to_fixed_depths(values, depth, lat)
        steps.append(f"pressure levels moved by up to {moved:.2g} m to constant depths")
    first = depth[0]
    depth, values = up_to_surface(depth, values, file_name(part.data))
    if first != 0.0:
        steps.append(f"level at 0 m added with the values at {first:.4g} m")
    # an ocean of this package without a conversion keeps its attributes
    ocean = assemble_ocean(
        {"depth": depth, "lat": lat, "lon": lon},
        instant,
        values,
        **_provenance(collection),
        validate=False,
    )
    if (bed := part.sea_floor()) is not None:
        ocean = ocean.assign({SEA_FLOOR: (DIMS[1:], bed, SEA_FLOOR_ATTRIBUTES)})
    if own and not steps:
        return _with_own_attributes(ocean, part)
    history = str(part.data.attrs.get("history", "")).splitlines()[:50]
    lines = [line for line in (*(one_line(line, _MAX_TEXT) for line in history), *steps) if line]
    return ocean.assign_attrs(history="\n".join(lines)) if lines else ocean


def _provenance(collection: "Collection") -> dict[str, Any]:
    """Title, source and True if synthetic, by argument of `assemble_ocean`."""
    data = collection.parts[0].data
    hycom = all(_is_hycom(part) for part in collection.parts)
    model = "HYCOM" if hycom else collection.names
    sources = (one_line(text(data, key), _MAX_TEXT) for key in ("source", "institution"))
    return {
        "title": one_line(text(data, "title"), _MAX_TEXT)
        or f"{'HYCOM ' if hycom else ''}{collection.names}",
        "source": next(filter(None, sources), model),
        "synthetic": any(
            np.array_equal(part.data.attrs.get("synthetic", 0), 1) for part in collection.parts
        ),
    }


def _zeros(temperature: Array, salinity: Array) -> tuple[Mask, list[str]]:
    """
    Points where both are exactly 0 in the unit of the file, which is land unless the water is fresh
    everywhere; and notes.
    """
    salty = salinity > 0.0
    land = (temperature == 0.0) & (salinity == 0.0) & bool(salty.any())
    fresh = (salinity == 0.0) & ~land
    steps = []
    if land.any():
        steps.append(
            f"{counted(int(land.sum()), 'point')} removed: temperature and salinity are exactly 0"
            " there, as on land"
        )
    if fresh.any() and salty.any() and np.median(salinity[salty]) > _SALTY:
        steps.append(
            f"a salinity of 0 in salty water at {counted(int(fresh.sum()), 'point')}: if 0 means"
            " missing, declare it (_FillValue)"
        )
    return land, steps


def _in_our_unit(raw: Array, part: "Part", field: cf.Field) -> Array:
    variable = part.data.variables[field.variable]
    where = f"{file_name(part.data)}: {field.variable}"
    unit = text(variable, "units")
    practical = field.role == "salinity" and field.kind == PRACTICAL
    if practical and not unit and ("units" in variable.attrs or _is_hycom(part)):
        unit = "1"  # files also write the canonical unit as a number, or omit it
    quantity = {
        "water_temp": "temperature",
        "salinity": "practical salinity" if practical else "mass salinity",
    }.get(field.role, "velocity")
    values = to_our_unit(raw, quantity, unit, where=where)
    if practical:
        check_salinity_unit(values, where)
    return values


def _agree_on_wet(fields: dict[str, Array]) -> list[str]:
    """
    Apply one land mask to all fields, because the masks of models differ at a few points.

    A wet point has temperature and salinity, and so have all points above it. A missing current at
    a wet point is set to 0, as at the sea bed.
    """
    some = np.isfinite(fields["water_temp"]) | np.isfinite(fields["salinity"])
    both = np.isfinite(fields["water_temp"]) & np.isfinite(fields["salinity"])
    wet = np.logical_and.accumulate(both, axis=0)
    moving = np.isfinite(fields["water_u"]) & np.isfinite(fields["water_v"])
    dropped = int(np.count_nonzero(some & ~wet))
    still = int(np.count_nonzero(wet & ~moving))
    count = int(np.count_nonzero(wet))
    if not count:
        return []  # the validation reports this
    if dropped + still > _MAX_DISAGREEMENT * count:
        raise OceanError(
            f"the land masks of temperature, salinity and currents differ at {dropped + still} of"
            f" {count} wet points; check that the files belong together and declare their fill"
            " value"
        )
    for name, field in fields.items():
        values = np.where(moving, field, 0.0) if name in ("water_u", "water_v") else field
        fields[name] = np.where(wet, values, np.nan)
    missing = "removed: temperature or salinity is missing there or above"
    lines = {
        f"{counted(dropped, 'point')} {missing}": dropped,
        f"currents set to 0 at {counted(still, 'wet point')} without currents": still,
    }
    return [line for line, count in lines.items() if count]


def _is_own(part: "Part") -> bool:
    """Return True if a file follows the package's own schema, so that it is returned unchanged."""
    variables = part.data.variables
    same = all(
        v.name in variables
        and variables[v.name].dims == DIMS
        and text(variables[v.name], "standard_name") == v.standard_name
        and text(variables[v.name], "units") == v.units
        for v in VARIABLES
    )
    attrs = part.data.attrs
    stated = "synthetic" in attrs and all(
        isinstance(attrs.get(name), str) for name in ("title", "source")
    )
    return same and stated and bool(part.layout.time) and not variables[part.layout.time].dims


def _conversion_step(temperature: str, salinity: str) -> str:
    """Line of the history about the kinds of temperature and salinity that were converted."""
    pairs = ("temperature", temperature, IN_SITU), ("salinity", salinity, PRACTICAL)
    changed = [f"{what} from {own} to {ours}" for what, own, ours in pairs if own != ours]
    return f"converted {', '.join(changed)} (TEOS-10)"


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
