"""Summaries of an ocean: the paper's table of regions and spread of sound-speed profiles."""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.geometry.boundary import BoundarySurface
from pymantaray.geometry.frames import ellipsoid
from pymantaray.ocean.convert import time_text
from pymantaray.ocean.names import Equation
from pymantaray.ocean.schema import DIMS, SEA_FLOOR, VARIABLES, validate_ocean
from pymantaray.ocean.sea_floor import sea_floor_depth
from pymantaray.ocean.seawater import ocean_sound_speed


def region_table(
    ocean: xr.Dataset,
    *,
    equation: Equation = "teos-10",
    sea_floor: xr.DataArray | None = None,
    profile: xr.Dataset | None = None,
) -> pd.DataFrame:
    """
    Table of place, size, grid and values of a region, as in the paper's Table I.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    equation : str
        Equation of sound speed.
    sea_floor : xarray.DataArray, optional
        Sea floor from `pymantaray.ocean.open_sea_floor`. Default: half-way below the last level
        with water. [m]
    profile : xarray.Dataset, optional
        Result of `sound_speed_profile_spread` for this ocean and equation. By default it is
        computed.

    Returns
    -------
    pandas.DataFrame
        One row per property, with its unit in the name. The column has the title of the ocean, so
        tables of several oceans can be joined. Widths are along parallels of the WGS 84 ellipsoid;
        the height is along the meridian.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import region_table
    >>> column = region_table(ocean).squeeze()
    >>> column["levels"], round(column["height [km]"], 1)
    (40, 17.9)
    """
    validate_ocean(ocean)
    lat, lon = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon"))
    middle = 0.5 * (lat[0] + lat[-1])
    profile = sound_speed_profile_spread(ocean, equation=equation) if profile is None else profile
    current = np.hypot(ocean["water_u"].values, ocean["water_v"].values)
    floor = (sea_floor_depth(ocean) if sea_floor is None else sea_floor).values
    rows: dict[str, object] = {
        "centre latitude [deg N]": float(middle),
        "centre longitude [deg E]": float(0.5 * (lon[0] + lon[-1])),
        "width at the south edge [km]": _width(lat[0], lon),
        "width at the centre [km]": _width(middle, lon),
        "width at the north edge [km]": _width(lat[-1], lon),
        "height [km]": _height(lat),
        "grid points, longitude": lon.size,
        "grid points, latitude": lat.size,
        "levels": int(ocean.sizes["depth"]),
        "time [UTC]": time_text(ocean),
        "shallowest sea floor [m]": float(floor.min()),
        "deepest sea floor [m]": float(floor.max()),
        "lowest sound speed [m/s]": float(profile["min"].min()),
        "highest sound speed [m/s]": float(profile["max"].max()),
        "median current speed [m/s]": float(np.nanmedian(current)),
        "highest current speed [m/s]": float(np.nanmax(current)),
        "synthetic": "yes" if ocean.attrs["synthetic"] else "no",
        "source": str(ocean.attrs["source"]),
    }
    return _property_table(ocean, rows)


def _property_table(ocean: xr.Dataset, rows: dict[str, object]) -> pd.DataFrame:
    table = pd.DataFrame({str(ocean.attrs["title"]): pd.Series(rows, dtype=object)})
    return table.rename_axis("property")


def sound_speed_profile_spread(ocean: xr.Dataset, *, equation: Equation = "teos-10") -> xr.Dataset:
    """
    Spread of sound speed over the columns of an ocean, level by level.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean or a part of it.
    equation : str
        Equation of sound speed.

    Returns
    -------
    xarray.Dataset
        ``mean``, ``min`` and ``max`` [m/s] and ``count`` of wet points along ``depth``. Grid points
        have equal weights. NaN at levels without wet points.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import sound_speed_profile_spread
    >>> level = sound_speed_profile_spread(ocean).sel(depth=100.0)
    >>> [round(float(level[name]), 1) for name in ("min", "mean", "max")]
    [1449.0, 1449.6, 1450.4]
    """
    attrs = {"standard_name": "speed_of_sound_in_sea_water", "units": "m s-1"}
    speed = xr.DataArray(
        ocean_sound_speed(ocean, equation=equation), {"depth": ocean["depth"]}, DIMS
    )
    return _spread(speed, ("lat", "lon"), ocean, attrs)


def _spread(
    speed: xr.DataArray, over: tuple[str, str], ocean: xr.Dataset, attrs: dict[str, Any]
) -> xr.Dataset:
    """Mean, minimum and maximum over horizontal dimensions, and the number of wet points."""
    count = speed.count(over).assign_attrs(long_name="wet grid points", units="1")
    # not speed.mean, min and max: they warn of levels without water, and ignore this by filters
    # that all threads share
    spread = {
        "mean": speed.sum(over) / count.where(count > 0),
        "min": speed.reduce(np.fmin.reduce, over),
        "max": speed.reduce(np.fmax.reduce, over),
    }
    named = {
        name: values.drop_attrs(deep=False).assign_attrs(attrs) for name, values in spread.items()
    }
    origin = {name: ocean.attrs[name] for name in ("title", "source", "synthetic")}
    return xr.Dataset(named | {"count": count}, attrs=origin)


def profile_spread(local: xr.Dataset) -> xr.Dataset:
    """
    Sound speed of the levels, as in `sound_speed_profile_spread`, with equal mean, minimum and
    maximum.
    """
    speed = local["sound_speed"][0, 0]
    count = xr.ones_like(speed, dtype=int).assign_attrs(
        long_name="wet grid points", units="1", standard_name=""
    )
    spread = dict.fromkeys(("mean", "min", "max"), speed.drop_vars(("north", "east"))) | {
        "count": count.drop_vars(("north", "east"))
    }
    return xr.Dataset(
        spread, attrs={name: local.attrs[name] for name in ("title", "source", "synthetic")}
    )


def columns_spread(local: xr.Dataset) -> xr.Dataset:
    """
    Sound speed of the levels above the sea floor of a local ocean, as in
    `sound_speed_profile_spread`.
    """
    speed = local["sound_speed"]
    over = ("north", "east")
    bed = BoundarySurface.from_dataset(local, "sea_floor_depth", OceanError)
    places = np.stack(np.meshgrid(*(local[name].values for name in over), indexing="ij"), axis=-1)
    wet = local["depth"].values <= bed.depth_at(places.reshape(-1, 2)).reshape(*places.shape[:2], 1)
    return _spread(speed.where(xr.DataArray(wet, dims=speed.dims)), over, local, speed.attrs)


def profile_region(local: xr.Dataset) -> pd.DataFrame:
    """Properties of the water, one per row, as in `region_table` for a gridded ocean."""
    speed = local["sound_speed"].values
    floor = local["sea_floor_depth"].values
    rows: dict[str, object] = {
        "levels": int(local.sizes["depth"]),
        "time [UTC]": local.attrs.get("time", "unknown"),
        "shallowest sea floor [m]": float(floor.min()),
        "deepest sea floor [m]": float(floor.max()),
        "lowest sound speed [m/s]": float(speed.min()),
        "highest sound speed [m/s]": float(speed.max()),
        "synthetic": "no",
        "source": str(local.attrs["source"]),
    }
    if np.ptp(speed, axis=(0, 1)).any():
        extents = {f"{name} [km]": 1e-3 * local[name].values for name in ("north", "east")}
        rows = {name: f"{km[0]:g} to {km[-1]:g}" for name, km in extents.items()} | rows
    return _property_table(local, rows)


def ocean_facts(ocean: xr.Dataset, sea_floor: xr.DataArray | None = None) -> dict[str, str]:
    """
    Extent, levels, time and origin of an ocean as text; without a sea floor [m], the levels of the
    ocean give it.
    """
    validate_ocean(ocean)
    lat, lon, depth = (
        np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon", "depth")
    )
    wet = np.isfinite(ocean["water_temp"].values)
    floor = (sea_floor_depth(ocean) if sea_floor is None else sea_floor).values
    origin = "of the model" if SEA_FLOOR in ocean else "where the levels end"
    if sea_floor is not None:
        origin = str(sea_floor.attrs.get("source", "from a file"))
    middle = 0.5 * (lat[0] + lat[-1])
    deepest = depth[wet.any(axis=(1, 2))][-1]
    return {
        "title": str(ocean.attrs["title"]),
        "source": str(ocean.attrs["source"]),
        "made up": "yes" if ocean.attrs["synthetic"] else "no",
        "time": time_text(ocean).replace("T", " ")
        + ("" if np.isnat(ocean["time"].values) else " UTC"),
        "latitude": f"{lat[0]:.6g} to {lat[-1]:.6g} degrees north, {lat.size} points,"
        f" {_spacing(lat)} apart",
        "longitude": f"{lon[0]:.6g} to {lon[-1]:.6g} degrees east, {lon.size} points,"
        f" {_spacing(lon)} apart",
        "size": f"{_width(middle, lon):.0f} km west to east at the centre, {_height(lat):.0f} km"
        " south to north",
        "levels": f"{depth.size}, 0 to {depth[-1]:g} m, water down to {deepest:g} m",
        "sea floor": f"{floor.min():g} to {floor.max():g} m, {origin}",
        "wet points": f"{wet.sum():,} of {wet.size:,}, {100.0 * wet[0].mean():.0f} % of the"
        " surface",
    }


def variable_table(ocean: xr.Dataset, equation: Equation = "teos-10") -> pd.DataFrame:
    """Minimum, mean and maximum of each variable, of current speed and of sound speed."""
    validate_ocean(ocean)
    fields = {v.name: (v.units.replace("m s-1", "m/s"), ocean[v.name].values) for v in VARIABLES}
    fields["current speed"] = ("m/s", np.hypot(ocean["water_u"].values, ocean["water_v"].values))
    fields["sound speed"] = ("m/s", ocean_sound_speed(ocean, equation=equation))
    rows = [
        (name, units, float(np.nanmin(values)), float(np.nanmean(values)), float(np.nanmax(values)))
        for name, (units, values) in fields.items()
    ]
    return pd.DataFrame(rows, columns=["variable", "units", "least", "mean", "greatest"]).set_index(
        "variable"
    )


def _spacing(axis: Array) -> str:
    steps = np.diff(axis)
    if np.ptp(steps) < 0.01 * steps.mean():
        return f"{steps.mean():.4g} degrees"
    return f"{steps.min():.4g} to {steps.max():.4g} degrees"


def _width(latitude: float, lon: Array) -> float:
    """Length of the parallel between the outer longitudes. [km]"""
    along = np.linspace(lon[0], lon[-1], 1001)
    return float(ellipsoid().line_length(along, np.full_like(along, latitude)) / 1e3)


def _height(lat: Array) -> float:
    """Length of the meridian between the outer latitudes. [km]"""
    return float(ellipsoid().inv(0.0, lat[0], 0.0, lat[-1])[2] / 1e3)
