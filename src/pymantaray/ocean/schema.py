"""Schema of a valid ocean: a geographic data set with HYCOM's names, units and signs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
import xarray as xr

from pymantaray.arrays import Array, Indices
from pymantaray.errors import OceanError
from pymantaray.geometry.longitude import wrap_longitude
from pymantaray.ocean.convert import DEEPEST, is_our_unit, our_unit

DIMS = ("depth", "lat", "lon")
_NOTED = (
    "climatology, for ",
    "outside its valid range removed",
    "are exactly 0 there",
    "a salinity of 0 in salty water",
)
SEA_FLOOR = "sea_floor_depth"
"""Optional variable (lat, lon): sea floor of the model; without it, the levels show the floor."""
SEA_FLOOR_ATTRIBUTES = {"standard_name": "sea_floor_depth_below_sea_surface", "units": "m"}
MIN_POINTS = {"depth": 2, "lat": 4, "lon": 4}  # horizontal cubic splines need four points


@dataclass(frozen=True)
class Variable:
    """Name, CF attributes, quantity and physically possible range of a variable."""

    name: str
    standard_name: str
    quantity: str
    lowest: float
    highest: float

    @property
    def units(self) -> str:
        """Unit in CF notation."""
        return our_unit(self.quantity)


VARIABLES = (
    Variable("water_temp", "sea_water_temperature", "temperature", -5.0, 45.0),
    Variable("salinity", "sea_water_practical_salinity", "practical salinity", 0.0, 50.0),
    Variable("water_u", "eastward_sea_water_velocity", "velocity", -10.0, 10.0),
    Variable("water_v", "northward_sea_water_velocity", "velocity", -10.0, 10.0),
)
_AXES = {"depth": "length", "lat": "latitude", "lon": "longitude"}
_COORDINATES = {
    "depth": {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"},
    "lat": {"standard_name": "latitude", "units": "degrees_north", "axis": "Y"},
    "lon": {"standard_name": "longitude", "units": "degrees_east", "axis": "X"},
}


@dataclass(frozen=True)
class Finding:
    """An error (wrong: the ocean is unusable) or a doubt (doubtful: a person should look)."""

    severity: Literal["wrong", "doubtful"]
    what: str
    """The property, in a few words."""
    value: str
    """Value with unit."""
    allowed: str = ""
    """Limit with unit."""
    remedy: str = ""
    where: str = ""
    """Place and depth, variable or axis; empty for the whole ocean."""

    def __str__(self) -> str:
        """Finding as one line."""
        place = f" ({self.where})" if self.where else ""
        limit = f"; allowed {self.allowed}" if self.allowed else ""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{self.severity}: {self.what}{place}: {self.value}{limit}{remedy}"


def assemble_ocean(
    coordinates: dict[str, Array],
    time: np.datetime64,
    fields: dict[str, Array],
    *,
    title: str,
    source: str,
    synthetic: bool,
    validate: bool = True,
) -> xr.Dataset:
    """
    Assemble arrays into a data set that follows the schema, with CF attributes.

    Parameters
    ----------
    coordinates : dict of str to ndarray
        ``depth`` [m], ``lat`` and ``lon`` [degrees].
    time : numpy.datetime64
        Instant of the fields (UTC).
    fields : dict of str to ndarray, shape (depth, lat, lon)
        ``water_temp`` [degC], ``salinity`` [practical], ``water_u`` and ``water_v`` [m/s]; NaN
        below the sea bed.
    title, source : str
        Name and origin of the ocean.
    synthetic : bool
        True if the fields are made up; False if they are from a model or measurements.
    validate : bool
        If True, `validate_ocean` checks the result.

    Returns
    -------
    xarray.Dataset

    Examples
    --------
    >>> import numpy as np
    >>> from pymantaray.ocean import assemble_ocean
    >>> axes = {"depth": [0, 100], "lat": [74, 75, 76, 77], "lon": [-140, -139, -138, -137]}
    >>> still = dict.fromkeys(["water_temp", "water_u", "water_v"], np.zeros((2, 4, 4)))
    >>> ocean = assemble_ocean(
    ...     {name: np.array(axis, dtype=float) for name, axis in axes.items()},
    ...     np.datetime64("2026-03-10", "ns"),
    ...     still | {"salinity": np.full((2, 4, 4), 30.0)},
    ...     title="Test Sea",
    ...     source="made up",
    ...     synthetic=True,
    ... )
    >>> dict(ocean.sizes)
    {'depth': 2, 'lat': 4, 'lon': 4}
    """
    ocean = xr.Dataset(
        {
            v.name: (DIMS, fields[v.name], {"standard_name": v.standard_name, "units": v.units})
            for v in VARIABLES
        },
        coords={
            **{k: ((k,), coordinates[k], attrs) for k, attrs in _COORDINATES.items()},
            "time": ((), time.astype("datetime64[ns]"), {"standard_name": "time", "axis": "T"}),
        },
        attrs={
            "Conventions": "CF-1.8",
            "title": title,
            "source": source,
            "synthetic": int(synthetic),
        },
    )
    if validate:
        validate_ocean(ocean)
    return ocean


def with_history(ocean: xr.Dataset, line: str) -> xr.Dataset:
    """
    Append a line to the attribute ``history`` of a copy of an ocean.

    Parameters
    ----------
    ocean : xarray.Dataset
        Any data set.
    line : str
        Description of a change, one line.

    Returns
    -------
    xarray.Dataset

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import with_history
    >>> with_history(ocean, "checked by hand").attrs["history"].splitlines()[-1]
    'checked by hand'
    """
    if not line.strip() or len(line.splitlines()) != 1:
        raise OceanError(
            f"ocean: history line {line[:40]!r} has several lines or is empty; give one line"
        )
    before = str(ocean.attrs.get("history", "")).rstrip("\n")
    return ocean.assign_attrs(history=f"{before}\n{line.strip()}" if before else line.strip())


def reading_notes(ocean: xr.Dataset) -> tuple[str, ...]:
    """
    Lines of a history about a climatology and about values that a reader removed, which a user
    should see.
    """
    return tuple(
        line
        for line in str(ocean.attrs.get("history", "")).splitlines()
        if any(w in line for w in _NOTED)
    )


def layer_edges(depth: Array) -> Array:
    """Edges (n + 1,) of the layers that n levels represent, half-way to their neighbours. [m]"""
    return np.concatenate([depth[:1], 0.5 * (depth[:-1] + depth[1:]), depth[-1:]])


def validate_ocean(ocean: xr.Dataset) -> None:
    """
    Check that a data set is a valid ocean.

    Dimensions are ``(depth, lat, lon)``. Depth [m] is positive down and strictly increases from 0.
    Latitude and longitude [degrees] strictly increase, longitude in any 360 degree window. ``time``
    is a scalar. The variables are in-situ ``water_temp`` [degC], practical ``salinity``, and
    ``water_u`` and ``water_v`` (true east and north) [m/s]. All are NaN below the sea bed, and no
    wet level is below a dry one.

    Parameters
    ----------
    ocean : xarray.Dataset
        Data set to check.

    Raises
    ------
    OceanError
        If the data set is invalid. The message is the first violation.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import validate_ocean
    >>> validate_ocean(ocean.drop_vars("salinity"))
    Traceback (most recent call last):
        ...
    pymantaray.errors.OceanError: ocean: variable missing (salinity)...
    """
    for finding in violations(ocean):
        if finding.severity == "wrong":
            raise OceanError(f"ocean: {str(finding).removeprefix('wrong: ')}")


def violations(ocean: xr.Dataset) -> Iterator[Finding]:
    """
    Find all violations of the schema, and missing units.

    ``where`` begins with the name of the variable or axis. Land masks are compared only if the
    structure is valid.
    """
    for name in DIMS:
        yield from _axis(ocean, name)
    if "time" not in ocean.coords:
        yield Finding(
            "wrong", "axis missing", "no such coordinate", "one instant", "add it", "time"
        )
    elif ocean["time"].ndim or not np.issubdtype(ocean["time"].dtype, np.datetime64):
        axis = f"{ocean['time'].size} of {ocean['time'].dtype}"
        yield Finding("wrong", "axis", axis, "one datetime64", "select one time step", "time")
    for variable in VARIABLES:
        yield from _variable(ocean, variable)
    yield from _wet(ocean)
    missing = [name for name in ("title", "source", "synthetic") if name not in ocean.attrs]
    if missing:
        yield Finding(
            "wrong",
            "attributes missing",
            ", ".join(missing),
            "title, source, synthetic",
            "set them",
        )
    elif not any(np.array_equal(ocean.attrs["synthetic"], flag) for flag in (0, 1)):
        yield Finding(
            "wrong", "attribute", repr(ocean.attrs["synthetic"]), "0 or 1", "set it", "synthetic"
        )


def _axis(ocean: xr.Dataset, name: str) -> Iterator[Finding]:
    wrong = partial(Finding, "wrong", where=name)
    if name not in ocean.coords:
        yield wrong("axis missing", "no such coordinate", ", ".join(DIMS), "add or rename it")
        return
    # unit, dimensions and type
    axis = ocean[name]
    yield from _unit(axis, _AXES[name], "convert the axis")
    if axis.dims != (name,) or not np.issubdtype(axis.dtype, np.number):
        yield wrong(
            "axis",
            f"dimensions {axis.dims}, {axis.dtype}",
            "one dimension, numbers",
            "rebuild the axis",
        )
        return
    # number of points, their order, and depths
    values = np.asarray(axis.values, dtype=float)
    if values.size < MIN_POINTS[name]:
        yield wrong(
            "axis too short",
            f"{values.size} points",
            f"{MIN_POINTS[name]} or more",
            "use a larger window",
        )
    rising = np.diff(values) > 0.0
    if not rising.all():
        yield wrong(
            "axis not monotone",
            f"{np.count_nonzero(~rising)} of {rising.size} steps do not increase, the first after"
            f" {values[int(np.argmin(rising))]:g}",
            "strictly increasing",
            "sort it and drop duplicates",
        )
    elif name == "depth" and values.size and values[-1] > DEEPEST:
        yield wrong(
            "axis",
            f"a level at {values[-1]:g} m",
            f"0 to {DEEPEST:g} m",
            "check its values and unit",
        )
    elif name == "depth" and values.size and values[0] != 0.0:
        yield wrong(
            "axis", f"starts at {values[0]:g} m", "0 m, positive down", "add a level at 0 m"
        )
    # latitudes and longitudes
    finite = values[np.isfinite(values)]
    if name == "lat" and np.abs(finite).max(initial=0.0) > 90.0:
        yield wrong(
            "axis",
            f"{finite.min():g} to {finite.max():g}",
            "-90 to 90 degrees",
            "check its values and unit",
        )
    if name == "lon" and finite.size and np.ptp(finite) >= 360.0:
        yield wrong(
            "axis",
            f"spans {np.ptp(finite):g} degrees",
            "less than 360",
            "remove duplicate meridians",
        )


def _unit(array: xr.DataArray, quantity: str, remedy: str) -> Iterator[Finding]:
    unit = str(array.attrs.get("units", "")).strip()
    if unit and not is_our_unit(quantity, unit):
        yield Finding("wrong", "units", unit, our_unit(quantity), remedy, str(array.name))


def _variable(ocean: xr.Dataset, v: Variable) -> Iterator[Finding]:
    wrong = partial(Finding, "wrong", where=v.name)
    if v.name not in ocean.data_vars:
        yield wrong("variable missing", "no such variable", v.standard_name, "add it")
        return
    # unit, dimensions and type
    field = ocean[v.name]
    if not str(field.attrs.get("units", "")).strip():
        yield Finding("doubtful", "units", "not stated", v.units, "state them", v.name)
    yield from _unit(field, v.quantity, "convert the values")
    if field.dims != DIMS:
        remedy = (
            "transpose the variable" if set(field.dims) == set(DIMS) else "rebuild the variable"
        )
        yield wrong("dimensions", str(field.dims), str(DIMS), remedy)
        if set(field.dims) != set(DIMS):
            return
    if not np.issubdtype(field.dtype, np.number):
        yield wrong("type", str(field.dtype), "numbers", "rebuild the variable")
        return
    # missing, infinite and impossible values
    values = np.asarray(field.values, dtype=float)
    finite = np.isfinite(values)
    if np.isinf(values).any():
        count = np.count_nonzero(np.isinf(values))
        yield wrong("not finite", f"{count} infinite values", "NaN below the sea bed", "mask them")
    if not finite.any():
        yield wrong(
            "no valid value",
            "all missing",
            "some wet points",
            "check that the window is not on land",
        )
        return
    outside = finite & ((values < v.lowest) | (values > v.highest))
    if outside.any():
        yield wrong(
            "values",
            f"{np.count_nonzero(outside)} of {np.count_nonzero(finite)} outside,"
            f" {values[finite].min():g} to {values[finite].max():g}",
            f"{v.lowest:g} to {v.highest:g} {v.units}",
            "check packing, units and fill value",
        )


def _wet(ocean: xr.Dataset) -> Iterator[Finding]:
    """Find points that are wet in one variable and dry in another, or wet below a dry point."""
    fields = {
        v.name: ocean[v.name] for v in VARIABLES if v.name in ocean and ocean[v.name].dims == DIMS
    }
    numeric = all(np.issubdtype(field.dtype, np.number) for field in fields.values())
    if "water_temp" not in fields or not numeric:
        return
    wet = np.isfinite(fields.pop("water_temp").values)
    for name, field in fields.items():
        differ = np.isfinite(field.values) != wet
        if differ.any():
            yield Finding(
                "wrong",
                "NaN islands",
                f"{np.count_nonzero(differ)} points are missing either in it or in water_temp",
                "the same points",
                "apply one mask to all variables, or fill the gap",
                f"{name} {place_of(ocean, np.argwhere(differ)[0])}",
            )
    beneath = wet[1:] & ~np.logical_and.accumulate(wet, axis=0)[:-1]
    if beneath.any():
        k, i, j = np.argwhere(beneath)[0]
        yield Finding(
            "wrong",
            "NaN islands",
            f"{np.count_nonzero(beneath)} wet points are below a dry one",
            "none",
            "fill the gap above them, or mask them",
            f"water_temp {place_of(ocean, (k + 1, i, j))}",
        )


def place_of(ocean: xr.Dataset, index: Sequence[Any] | Indices) -> str:
    """Place of a grid point as text, such as ``34.64 N, 74.72 W, 50 m``, from its indices."""
    if any(name not in ocean.coords or ocean[name].ndim != 1 for name in DIMS):
        return f"index {', '.join(str(int(n)) for n in index)}"
    depth, lat, lon = (float(ocean[name].values[n]) for name, n in zip(DIMS, index, strict=True))
    return f"{place_text(lat, lon)}, {depth:g} m"


def place_text(lat: float, lon: float) -> str:
    """Latitude and longitude as text, such as ``74.5 N, 140 W``."""
    return f"{latitude(lat)}, {longitude(lon)}"


def latitude(value: float) -> str:
    """Latitude as text, such as ``74.5 N``."""
    return f"{abs(round(value, 3)):g} {'S' if value < 0.0 else 'N'}"


def longitude(value: float) -> str:
    """Longitude in any 360 degree window as text, such as ``140 W``."""
    turned = wrap_longitude(value)
    return f"{abs(round(turned, 3)):g} {'W' if turned < 0.0 else 'E'}"
