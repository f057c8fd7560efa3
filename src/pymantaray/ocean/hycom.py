"""HYCOM's NetCDF files, native or as its servers cut them, opened as a valid ocean."""

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.schema import DIMS, VARIABLES, assemble_ocean, parse_instant

Array = NDArray[np.float64]
# by a file's first bytes; for NetCDF-3 scipy, since netCDF4 reads zeros where a file is cut short
_ENGINES = {b"CDF\x01": "scipy", b"CDF\x02": "scipy", b"CDF\x05": "netcdf4", b"\x89HDF": "netcdf4"}
_SCALED_FILL = {"water_temp": -10.0, "salinity": -10.0, "water_u": -30.0, "water_v": -30.0}
_SAME_DEGREES = 1e-3  # HYCOM's coordinates are off the exact grid by 3e-5


def open_hycom(paths: Sequence[str | Path], time: str | np.datetime64 | None = None) -> xr.Dataset:
    """
    Open HYCOM files as one valid ocean at one time.

    Takes packed NetCDF-3 and unpacked NetCDF-4, temperature and salinity in other files than the
    currents, several times in one file or one in each, and longitudes counted from 0 to 360, from -180 to
    180, or across either seam.

    Parameters
    ----------
    paths : sequence of str or Path
        Files that together hold ``water_temp``, ``salinity``, ``water_u`` and ``water_v``.
    time : str or numpy.datetime64, optional
        Time step to take (UTC); needed if the files hold more than one.

    Returns
    -------
    xarray.Dataset
        Longitudes rise, and their middle lies in -180 to 180.

    Raises
    ------
    OceanError
        If a file is missing, unreadable or cut short, a variable or the time is missing, or the files
        disagree on the grid.
    """
    files = [Path(p) for p in paths]
    if not files:
        raise OceanError("ocean: no file given; name at least one NetCDF file")
    parts = [_read(path) for path in files]
    missing = [v.name for v in VARIABLES if not any(v.name in part for part in parts)]
    if missing:
        raise OceanError(
            f"{_names(files)}: no {' and no '.join(missing)}; an ocean needs water_temp, salinity, water_u and"
            " water_v (HYCOM's ts3z and uv3z files together)"
        )
    instant = _one_time(parts, files, time)
    found: dict[str, xr.DataArray] = {}
    for part, path in zip(parts, files, strict=True):
        if instant not in part["time"].values:
            continue
        for name in _SCALED_FILL:
            if name in part and name not in found:
                found[name] = part[name].sel(time=instant)
                _check_same_grid(found[name], next(iter(found.values())), path)
    absent = [v.name for v in VARIABLES if v.name not in found]
    if absent:
        raise OceanError(f"{_names(files)}: no {' and no '.join(absent)} at {instant}; choose another time")
    first = found["water_temp"]
    order, lon = _contiguous(np.asarray(first["lon"].values, dtype=float))
    try:
        return assemble_ocean(
            {"depth": first["depth"].values, "lat": first["lat"].values, "lon": lon},
            instant,
            {name: _without_scaled_fill(name, field.values)[..., order] for name, field in found.items()},
            title=str(parts[0].attrs.get("title", f"HYCOM {_names(files)}")),
            source=str(parts[0].attrs.get("source", "HYCOM")),
            synthetic=False,
        )
    except OceanError as error:
        raise OceanError(f"{_names(files)}: {error}") from None


def _names(files: Sequence[Path]) -> str:
    return ", ".join(path.name for path in files)


def _read(path: Path) -> xr.Dataset:
    """Read the variables of the schema that a file holds, with a time axis, into memory."""
    if not path.is_file():
        raise OceanError(f"{path}: no such file; name an existing NetCDF file")
    with path.open("rb") as stream:
        start = stream.read(4)
    engine = next((e for magic, e in _ENGINES.items() if start.startswith(magic)), None)
    if engine is None:
        raise OceanError(f"{path.name}: neither NetCDF-3 nor NetCDF-4; was an error page saved instead?")
    try:
        # given a stream scipy maps no memory, which a broken file would leave mapped; tau, hours since
        # analysis, has units that xarray cannot decode
        with (
            path.open("rb") if engine == "scipy" else nullcontext(path) as readable,
            xr.open_dataset(readable, engine=engine, drop_variables=["tau"]) as data,
        ):
            part = data[[name for name in _SCALED_FILL if name in data]].load()
    except Exception as error:  # noqa: BLE001  the readers raise whatever they stumble over
        reason = " ".join(str(error).split())[:120]
        raise OceanError(f"{path.name}: cannot be read as NetCDF, perhaps cut short ({reason})") from None
    return _with_dimensions(part, path)


def _with_dimensions(part: xr.Dataset, path: Path) -> xr.Dataset:
    if not part.data_vars:
        raise OceanError(f"{path.name}: none of {', '.join(_SCALED_FILL)} is in it; is it a HYCOM file?")
    if "time" not in part.coords or not np.issubdtype(part["time"].dtype, np.datetime64):
        raise OceanError(f"{path.name}: no time coordinate that can be read; needs units 'hours since ...'")
    if "time" not in part.dims:
        part = part.expand_dims("time")
    for name, field in part.data_vars.items():
        if set(field.dims) != {"time", *DIMS}:
            raise OceanError(f"{path.name}: {name} has dimensions {field.dims}; needs time, depth, lat, lon")
        if str(field.attrs.get("standard_name", "")).startswith("sea_water_potential"):
            raise OceanError(f"{path.name}: {name} is potential temperature; in-situ temperature is needed")
    return part.transpose("time", *DIMS)


def _one_time(
    parts: Sequence[xr.Dataset], files: Sequence[Path], wanted: str | np.datetime64 | None
) -> np.datetime64:
    times = np.unique(np.concatenate([part["time"].values for part in parts]))
    listing = ", ".join(str(np.datetime_as_string(t, unit="m")) for t in times[:4])
    listing += f", ... {np.datetime_as_string(times[-1], unit='m')}" if len(times) > 4 else ""
    if wanted is None:
        if len(times) > 1:
            raise OceanError(f"{_names(files)}: {len(times)} times ({listing}); choose one")
        return np.datetime64(times[0])
    instant = parse_instant(wanted)
    nearest = times[np.argmin(np.abs(times - instant))]
    if abs(nearest - instant) > np.timedelta64(1, "m"):
        raise OceanError(f"{_names(files)}: time {wanted} is not in it; there is {listing}")
    return np.datetime64(nearest)


def _check_same_grid(field: xr.DataArray, first: xr.DataArray, path: Path) -> None:
    for name in DIMS:
        a, b = field[name].values, first[name].values
        if a.shape != b.shape or np.max(np.abs(a - b)) > _SAME_DEGREES:
            raise OceanError(f"{path.name}: {name} of {field.name} differs from that of {first.name}")


def _without_scaled_fill(name: str, values: NDArray[np.floating]) -> Array:
    """Mask the fill value where a server has scaled it like data (-30000 x 0.001, plus 20 for tracers)."""
    field = np.asarray(values, dtype=float)
    return np.where(np.abs(field - _SCALED_FILL[name]) < 1e-3, np.nan, field)


def _contiguous(lon: Array) -> tuple[NDArray[np.intp], Array]:
    """Order that puts the longitudes in a row across any seam, and their values in that order."""
    turned = lon % 360.0
    order = np.argsort(turned)
    gaps = np.diff(turned[order], append=turned[order[0]] + 360.0)
    order = np.roll(order, -(int(np.argmax(gaps)) + 1))  # begin after the widest gap
    rising = np.unwrap(turned[order], period=360.0)
    middle = 0.5 * (rising[0] + rising[-1])
    return order, rising - 360.0 * np.floor((middle + 180.0) / 360.0)
