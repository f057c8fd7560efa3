"""What a valid ocean is: a geographic data set with HYCOM's names, units and signs."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError

Array = NDArray[np.float64]
DIMS = ("depth", "lat", "lon")
MIN_POINTS = {"depth": 2, "lat": 4, "lon": 4}  # horizontal cubic splines need four points


@dataclass(frozen=True)
class Variable:
    """Name, CF attributes and physically possible span of one variable."""

    name: str
    standard_name: str
    units: str
    lowest: float
    highest: float


VARIABLES = (
    Variable("water_temp", "sea_water_temperature", "degC", -5.0, 45.0),
    Variable("salinity", "sea_water_practical_salinity", "1", 0.0, 50.0),
    Variable("water_u", "eastward_sea_water_velocity", "m s-1", -10.0, 10.0),
    Variable("water_v", "northward_sea_water_velocity", "m s-1", -10.0, 10.0),
)
_COORDINATES = {
    "depth": {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"},
    "lat": {"standard_name": "latitude", "units": "degrees_north", "axis": "Y"},
    "lon": {"standard_name": "longitude", "units": "degrees_east", "axis": "X"},
}


def assemble_ocean(
    coordinates: dict[str, Array],
    time: np.datetime64,
    fields: dict[str, Array],
    *,
    title: str,
    source: str,
    synthetic: bool,
) -> xr.Dataset:
    """
    Put arrays into a data set of the schema, with CF attributes, and validate it.

    Parameters
    ----------
    coordinates : dict of str to ndarray
        ``depth`` [m], ``lat`` and ``lon`` [degrees].
    time : numpy.datetime64
        Instant of the fields (UTC).
    fields : dict of str to ndarray, shape (depth, lat, lon)
        ``water_temp`` [degC], ``salinity`` [practical], ``water_u`` and ``water_v`` [m/s]; NaN below
        the sea bed.
    title, source : str
        What the ocean is called, and where it comes from.
    synthetic : bool
        Whether the fields are made up rather than a model's or a measurement's.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    OceanError
        If the result does not satisfy `validate_ocean`.
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
        attrs={"Conventions": "CF-1.8", "title": title, "source": source, "synthetic": int(synthetic)},
    )
    validate_ocean(ocean)
    return ocean


def with_history(ocean: xr.Dataset, line: str) -> xr.Dataset:
    """
    Record in the attribute ``history`` what was done to an ocean; the newest line is the last.

    Parameters
    ----------
    ocean : xarray.Dataset
    line : str
        One line of text.

    Returns
    -------
    xarray.Dataset
        Another data set with the same values.

    Raises
    ------
    OceanError
        If the text is empty or more than a line.
    """
    if not line.strip() or len(line.splitlines()) != 1:
        raise OceanError(f"ocean: history takes one line of text, not {line[:40]!r}")
    before = str(ocean.attrs.get("history", "")).rstrip("\n")
    return ocean.assign_attrs(history=f"{before}\n{line.strip()}" if before else line.strip())


def parse_instant(time: str | np.datetime64) -> np.datetime64:
    """
    Instant in UTC from text or numpy's type.

    Parameters
    ----------
    time : str or numpy.datetime64
        Without a zone it is taken as UTC.

    Returns
    -------
    numpy.datetime64

    Raises
    ------
    OceanError
        If it cannot be read.
    """
    try:
        stamp = pd.Timestamp(time)
    except (TypeError, ValueError):
        stamp = pd.Timestamp("NaT")
    if pd.isna(stamp):
        raise OceanError(f"time {time!r} is not an instant; write it as 2014-07-15T12:00 (UTC)")
    if stamp.tz is not None:
        stamp = stamp.tz_convert("UTC").tz_localize(None)
    return stamp.to_datetime64()


def layer_edges(depth: Array) -> Array:
    """Depths (n + 1,) between which each of n levels stands for the water: half-way to its neighbours. [m]"""
    return np.concatenate([depth[:1], 0.5 * (depth[:-1] + depth[1:]), depth[-1:]])


def validate_ocean(ocean: xr.Dataset) -> None:
    """
    Check that a data set is an ocean that the rest of MantaRay can take.

    Dimensions are ``(depth, lat, lon)``; depth [m] is positive down and rises strictly from 0; latitude
    and longitude [degrees] rise strictly, longitude in any 360 degree window; ``time`` is a scalar. The
    variables are in-situ ``water_temp`` [degC], practical ``salinity``, ``water_u`` and ``water_v``
    (true east and north) [m/s], all NaN below the sea bed, which has no wet level beneath it.

    Parameters
    ----------
    ocean : xarray.Dataset

    Raises
    ------
    OceanError
        With one line that says what is wrong, where, and what is allowed.
    """
    for name in (*DIMS, "time"):
        if name not in ocean.coords:
            raise OceanError(
                f"ocean: coordinate {name!r} is missing; needs depth, lat, lon and a scalar time"
            )
    for name in DIMS:
        _check_axis(name, ocean[name])
    if ocean["time"].ndim or not np.issubdtype(ocean["time"].dtype, np.datetime64):
        raise OceanError("ocean: time must be one instant (a datetime64 scalar); select one time step")
    for v in VARIABLES:
        _check_variable(ocean, v)
    _check_wet(ocean)
    missing = [name for name in ("title", "source", "synthetic") if name not in ocean.attrs]
    if missing:
        raise OceanError(
            f"ocean: attributes {missing} are missing; needs title, source and synthetic (0 or 1)"
        )
    if ocean.attrs["synthetic"] not in (0, 1):
        raise OceanError(f"ocean: attribute synthetic is {ocean.attrs['synthetic']!r}; allowed are 0 and 1")


def _check_axis(name: str, axis: xr.DataArray) -> None:
    if axis.dims != (name,):
        raise OceanError(f"ocean: coordinate {name!r} has dimensions {axis.dims}; needs ({name!r},)")
    values = np.asarray(axis.values, dtype=float)
    if values.size < MIN_POINTS[name]:
        raise OceanError(f"ocean: {values.size} point(s) along {name!r}; needs at least {MIN_POINTS[name]}")
    if not np.all(np.isfinite(values)) or not np.all(np.diff(values) > 0.0):
        raise OceanError(f"ocean: coordinate {name!r} does not rise strictly; sort it and drop duplicates")
    if name == "depth" and values[0] != 0.0:
        raise OceanError(f"ocean: depth starts at {values[0]:g} m; must start at 0 m, positive down")
    if name == "lat" and (values[0] < -90.0 or values[-1] > 90.0):
        raise OceanError(f"ocean: latitude spans {values[0]:g} to {values[-1]:g}; allowed -90 to 90 degrees")
    if name == "lon" and values[-1] - values[0] >= 360.0:
        raise OceanError(f"ocean: longitude spans {values[-1] - values[0]:g} degrees; allowed less than 360")


def _check_variable(ocean: xr.Dataset, v: Variable) -> None:
    if v.name not in ocean:
        needed = ", ".join(w.name for w in VARIABLES)
        raise OceanError(f"ocean: variable {v.name!r} ({v.standard_name}) is missing; needs {needed}")
    field = ocean[v.name]
    if field.dims != DIMS:
        raise OceanError(f"ocean: {v.name} has dimensions {field.dims}; needs {DIMS}")
    values = field.values
    finite = np.isfinite(values)
    if not np.any(finite):
        raise OceanError(f"ocean: {v.name} has no valid value; is the window on land?")
    low, high = float(np.min(values[finite])), float(np.max(values[finite]))
    if low < v.lowest or high > v.highest:
        raise OceanError(
            f"ocean: {v.name} spans {low:g} to {high:g}; allowed {v.lowest:g} to {v.highest:g} {v.units};"
            " check packing, units and fill value"
        )


def _check_wet(ocean: xr.Dataset) -> None:
    wet = np.isfinite(ocean["water_temp"].values)
    for v in VARIABLES[1:]:
        differing = int(np.count_nonzero(np.isfinite(ocean[v.name].values) != wet))
        if differing:
            raise OceanError(
                f"ocean: {v.name} and water_temp disagree on {differing} points about what is below the sea bed"
            )
    holes = int(np.count_nonzero(wet[1:] & ~wet[:-1]))
    if holes:
        raise OceanError(
            f"ocean: {holes} wet points lie beneath a dry one; water must reach up to the surface"
        )
