"""NetCDF files and zarr folders, opened lazily by xarray's engines, and what these do not know."""

import math
import os
import re
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.messages import one_line
from pymantaray.ocean.zarr_metadata import check_zarr
from pymantaray.records.unpacking import MOST_UNPACKED_BYTES
from pymantaray.records.writing import NETCDF_LOCK

Array = NDArray[np.float64]
MEMORY_SHARE = 1 / 12
"""Of the machine's memory, for one of four variables; conversion holds up to three of each."""
IN_MEMORY = "data set in memory"
_NEVER_WRITTEN = {  # what the NetCDF library fills in where a variable declares nothing
    "f4": np.float32(9.9692099683868690e36),
    "f8": np.float64(9.9692099683868690e36),
    "i2": np.int16(-32767),
    "i4": np.int32(-2147483647),
}


def open_file(path: str | Path | xr.Dataset) -> xr.Dataset:
    """
    Header of a data set, its values read where they are asked for: see `numbers`. To be closed.

    Fill values become NaN, scale and offset are applied; times stay numbers. A data set in memory takes the form of a file.
    """
    if isinstance(path, xr.Dataset):
        return _from_memory(path)
    address = re.search(r"[a-z][a-z0-9+]+:/.*", str(path))  # also where a folder was put before it
    if address:
        line = "an address, not a file; get it with mantaray ocean fetch, or download it"
        raise OceanError(f"{address[0]}: {line}")
    path = Path(path)
    engine = _engine(path)
    options: dict[str, Any] = {"consolidated": False} if engine == "zarr" else {}
    with NETCDF_LOCK, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            raw = xr.open_dataset(path, engine=engine, decode_cf=False, **options)
            try:
                if engine == "netcdf4":
                    _check_length(raw, path)
                    _check_chunks(raw, path)
                data = decoded(raw)
            except BaseException:
                raw.close()
                raise
        except Exception as error:  # noqa: BLE001  the engines raise whatever they stumble over
            raise unreadable(path, error) from None

    def close() -> None:
        with NETCDF_LOCK, suppress(Exception):
            raw.close()

    data.set_close(close)
    data.encoding = {"source": str(path)}
    return data


def _from_memory(data: xr.Dataset) -> xr.Dataset:
    """Data set whose instants are numbers again, as in a file; values are shared, not copied."""
    data = data.copy(deep=False)
    for name, variable in data.variables.items():
        dates = variable.dtype.kind == "O" and str(name) in data.coords
        if variable.dtype.kind == "M" or dates:
            try:
                encoded = xr.conventions.encode_cf_variable(variable, name=name)
            except Exception as error:  # noqa: BLE001  objects of any kind
                raise OceanError(
                    f"data set in memory: {name} holds no instants ({one_line(error, 80)})"
                ) from None
            data = data.drop_vars([name]).assign_coords({name: encoded})
    data.encoding = {"source": str(data.encoding.get("source") or IN_MEMORY)}
    return data


def with_standard_names(files: Sequence[xr.Dataset], names: Mapping[str, str]) -> None:
    """Give variables of open files the standard names, and the units in brackets behind them, that a user says they have."""
    for name, meaning in names.items():
        match = re.fullmatch(r"\s*(\w+)\s*(?:\[(.*)\])?\s*", meaning)
        if not match:
            raise OceanError(
                f"name of {name}: {meaning!r}; needs a CF standard name such as sea_water_potential_temperature, or with a"
                " unit sea_water_temperature[degC]"
            )
        holders = [data for data in files if name in data.variables]
        if not holders:
            there = ", ".join(dict.fromkeys(str(variable) for data in files for variable in data.variables))
            where = ", ".join(map(file_name, files))
            raise OceanError(f"{where}: no variable {name!r} to name {match[1]}; there are {one_line(there)}")
        for data in holders:
            data[name].attrs |= {"standard_name": match[1]} | ({"units": match[2]} if match[2] else {})


def decoded(raw: xr.Dataset) -> xr.Dataset:
    """Data set whose fill values, scale and offset are applied as CF has it, in double precision; times are not."""
    for title, variable in raw.variables.items():
        for name in ("scale_factor", "add_offset"):
            if name in variable.attrs:
                variable.attrs[name] = _packing(str(title), name, variable.attrs[name])
        kind = variable.dtype.str[1:]
        if "_FillValue" not in variable.attrs and kind in _NEVER_WRITTEN:
            variable.attrs["_FillValue"] = _NEVER_WRITTEN[kind]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of fill values that differ from each other: all are
        return xr.decode_cf(
            raw, decode_times=False, decode_coords=False, decode_timedelta=False, concat_characters=False
        )


def numbers(data: xr.Dataset, name: str, selection: Mapping[str, slice] | None = None) -> Array:
    """Values of a variable, or of the block that slices by dimension select; NaN where one is missing."""
    variable = data.variables[name].isel(selection or {}, missing_dims="ignore")
    if variable.dtype.kind not in "biuf":
        raise OceanError(f"{file_name(data)}: {name} holds text or records, not numbers; write it as numbers")
    needed = 8 * math.prod(variable.shape)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > MEMORY_SHARE * memory:
        raise OceanError(
            f"{file_name(data)}: {name} alone takes {needed / 2**30:.1f} GiB, the machine has"
            f" {memory / 2**30:.0f}; read a window, south, north, west, east"
        )
    try:
        with NETCDF_LOCK:
            return np.array(variable.values, dtype=float)
    except Exception as error:  # noqa: BLE001
        raise unreadable(file_name(data), error) from None


def file_name(data: xr.Dataset) -> str:
    """Name for messages."""
    return Path(data.encoding["source"]).name


def text(variable: xr.Variable | xr.DataArray | xr.Dataset, attribute: str) -> str:
    """Attribute as text; empty where it is missing or a number."""
    value = variable.attrs.get(attribute, "")
    return value.strip() if isinstance(value, str) else ""


def unreadable(path: str | Path, error: Exception) -> OceanError:
    """Damage that a library stumbled over, as one line."""
    if isinstance(error, OceanError):
        known = str(error).startswith((Path(path).name, str(path)))
        return error if known else OceanError(f"{Path(path).name}: {error}")
    reason = one_line(error, 120) or type(error).__name__
    return OceanError(f"{Path(path).name}: cannot be read, perhaps cut short or damaged ({reason})")


def is_netcdf(path: Path) -> bool:
    """Whether a file begins as NetCDF does; not for what is no ordinary file."""
    with suppress(OSError, ValueError):  # a name with a null character is a ValueError
        if path.is_file():
            with path.open("rb") as stream:
                return stream.read(4) in (b"CDF\x01", b"CDF\x02", b"CDF\x05", b"\x89HDF")
    return False


def _engine(path: Path) -> str:
    if path.is_dir():
        return _zarr_engine(path)
    if not path.is_file():
        what = "not an ordinary file" if path.exists() else "no such file"
        raise OceanError(f"{path}: {what}; name an existing NetCDF file")
    if is_netcdf(path):
        return "netcdf4"
    raise OceanError(f"{path.name}: neither NetCDF-3 nor NetCDF-4; was an error page saved instead?")


def _zarr_engine(path: Path) -> str:
    check_zarr(path)
    try:
        import zarr  # noqa: F401
    except ImportError:
        raise OceanError(
            f'{path.name}: reading zarr needs the extra; pip install "pymantaray[zarr]"'
        ) from None
    return "zarr"


def _check_length(raw: xr.Dataset, path: Path) -> None:
    """Refuse a NetCDF-3 file that is cut short: the library gives zeros for what is not there."""
    with path.open("rb") as stream:
        if stream.read(3) != b"CDF":
            return

    def padded(value: object) -> int:
        return -(-(len(value) if isinstance(value, str) else np.asarray(value).nbytes) // 4) * 4

    tables = [raw.attrs, *(variable.attrs for variable in raw.variables.values())]
    least = (  # of the header and of the values, as the format lays them out
        sum(8 + padded(str(dim)) for dim in raw.sizes)
        + sum(12 + padded(str(key)) + padded(value) for table in tables for key, value in table.items())
        + sum(28 + padded(str(name)) + 4 * v.ndim + v.nbytes for name, v in raw.variables.items())
    )
    if least > path.stat().st_size:
        raise OceanError(
            f"{path.name}: cannot be read, it declares {least} bytes and has {path.stat().st_size}; it is cut"
            " short, fetch it again"
        )


def _check_chunks(raw: xr.Dataset, path: Path) -> None:
    """Refuse a chunk that does not fit into memory: it is unpacked whole, however little of it is asked for."""
    for name, variable in raw.variables.items():
        size = math.prod(variable.encoding.get("chunksizes") or ()) * variable.dtype.itemsize
        if size > MOST_UNPACKED_BYTES:
            raise OceanError(
                f"{path.name}: {name}: one of its chunks takes {size / 1e9:,.1f} GB unpacked; at most"
                f" {MOST_UNPACKED_BYTES / 1e9:g} GB are allowed: write it with smaller chunks"
            )


def _packing(title: str, name: str, value: Any) -> float:
    """Scale factor or offset of a variable; one that makes no numbers of what is stored is refused."""
    number = np.asarray(value)
    if number.size != 1 or number.dtype.kind not in "iuf" or not np.isfinite(number).all():
        raise OceanError(
            f"{title} has {name} {one_line(value, 40)!r}; needs one finite number: correct the attribute"
        )
    if name == "scale_factor" and number.item() == 0.0:
        raise OceanError(
            f"{title} has scale_factor 0, which makes all its values equal; correct the attribute"
        )
    return _decimal(float(number.item()))


def _decimal(number: float) -> float:
    """Shortest decimal number of a float32: HYCOM packs in steps of 0.001, not of 0.0010000000474974513."""
    single = np.float32(number)
    return float(str(single)) if float(single) == number else number
