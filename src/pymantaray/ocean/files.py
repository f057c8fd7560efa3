"""Lazy access to NetCDF files and zarr folders through xarray's engines, with additional checks."""

import math
import os
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.errors import MantaRayError, OceanError, optional_package
from pymantaray.messages import one_line
from pymantaray.ocean.rasters import is_text_grid, read_text_grid
from pymantaray.ocean.zarr_metadata import check_zarr
from pymantaray.records.writing import NETCDF_LOCK
from pymantaray.user_files import MAX_UNPACKED_BYTES, check_regular, exists, first_bytes

MEMORY_SHARE = 1 / 12
"""
Maximum fraction of the machine's memory for one of four variables; conversion needs up to three
copies of each.
"""
IN_MEMORY = "data set in memory"
_SHORTEST = 4  # bytes of an integer that is a limit of real numbers, not of packed ones
_RASTERS = {
    b"grib": "a GRIB file",
    b"dsaa": "a Surfer grid",
    b"dsbb": "a Surfer grid",
}
"""Formats of grids that are not read by their first bytes, in lower case."""
_TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_NEVER_WRITTEN = {  # default fill values of the NetCDF library
    "f4": np.float32(9.9692099683868690e36),
    "f8": np.float64(9.9692099683868690e36),
    "i2": np.int16(-32767),
    "i4": np.int32(-2147483647),
}


def open_file(path: str | Path | xr.Dataset) -> xr.Dataset:
    """
    Open a data set without reading values; `numbers` reads them. The caller closes it.

    Fill values become NaN, scale and offset are applied, and times stay numbers. A data set in
    memory is converted to the form of a file.
    """
    if isinstance(path, xr.Dataset):
        return _from_memory(path)
    address = re.search(r"[a-z][a-z0-9+]+:/.*", str(path))  # also behind the name of a folder
    if address:
        line = (
            "a URL, not a file; download it, or use mantaray ocean fetch (in Python: fetch_hycom)"
        )
        raise OceanError(f"{address[0]}: {line}")
    path = Path(path)
    if exists(path) and path.is_file() and is_text_grid(path):
        return read_text_grid(path)
    engine = _engine(path)
    options: dict[str, Any] = {"decode_cf": False}
    if engine == "zarr":
        options["consolidated"] = False
    if engine == "rasterio":  # it accepts no other value of decode_coords
        options = {"mask_and_scale": False, "decode_times": False, "decode_coords": "all"}
    with NETCDF_LOCK, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            raw = xr.open_dataset(path, engine=engine, **options)
            try:
                if engine == "netcdf4":
                    _check_length(raw, path)
                    _check_chunks(raw, path)
                data = decoded(raw)
            except BaseException:
                raw.close()
                raise
        except Exception as error:  # noqa: BLE001  the engines raise many types
            raise unreadable(path, error) from None

    def close() -> None:
        with NETCDF_LOCK, suppress(Exception):
            raw.close()

    data.set_close(close)
    data.encoding = {"source": str(path)}
    return data


def _from_memory(data: xr.Dataset) -> xr.Dataset:
    """
    Convert the instants of a data set to numbers, as in a file; values are shared, not copied.
    """
    data = data.copy(deep=False)
    for name, variable in data.variables.items():
        dates = variable.dtype.kind == "O" and str(name) in data.coords
        if variable.dtype.kind == "M" or dates:
            try:
                encoded = xr.conventions.encode_cf_variable(variable, name=name)
            except Exception as error:  # noqa: BLE001  objects of any kind
                raise OceanError(
                    f"data set in memory: {name} does not contain instants ({one_line(error, 80)})"
                ) from None
            data = data.drop_vars([name]).assign_coords({name: encoded})
    data.encoding = {"source": str(data.encoding.get("source") or IN_MEMORY)}
    return data


def decoded(raw: xr.Dataset) -> xr.Dataset:
    """
    Apply fill values, scale and offset according to CF, in double precision; times are not decoded.
    """
    for title, variable in raw.variables.items():
        for name in ("scale_factor", "add_offset"):
            if name in variable.attrs:
                variable.attrs[name] = _packing(str(title), name, variable.attrs[name])
        kind = variable.dtype.str[1:]
        if "_FillValue" not in variable.attrs and kind in _NEVER_WRITTEN:
            variable.attrs["_FillValue"] = _NEVER_WRITTEN[kind]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # several fill values: all are applied
        return xr.decode_cf(
            raw,
            decode_times=False,
            decode_coords=False,
            decode_timedelta=False,
            concat_characters=False,
        )


def numbers(data: xr.Dataset, name: str, selection: Mapping[str, slice] | None = None) -> Array:
    """
    Values of a variable, or of a block selected by slices per dimension; NaN if missing or outside
    the valid range.
    """
    return counted_numbers(data, name, selection)[0]


def counted_numbers(
    data: xr.Dataset, name: str, selection: Mapping[str, slice] | None = None
) -> tuple[Array, int]:
    """Values as in `numbers`, and the number of values outside the valid range."""
    variable = data.variables[name].isel(selection or {}, missing_dims="ignore")
    if variable.dtype.kind not in "biuf":
        raise OceanError(
            f"{file_name(data)}: {name} contains text or records; it must contain numbers"
        )
    needed = 8 * math.prod(variable.shape)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > MEMORY_SHARE * memory:
        raise OceanError(
            f"{file_name(data)}: {name} alone needs {needed / 2**30:.1f} GiB of memory, and this"
            f" machine has {memory / 2**30:.0f} GiB; read a window (south, north, west, east)"
        )
    try:
        with NETCDF_LOCK:
            values = np.array(variable.values, dtype=float)
    except Exception as error:  # noqa: BLE001
        raise unreadable(file_name(data), error) from None
    if data.variables[name].dims == (name,):  # a coordinate has no missing values (CF 2.5.1)
        return values, 0
    low, high = _valid_range(variable)
    with np.errstate(invalid="ignore"):
        outside = (values < low) | (values > high)
    values[outside] = np.nan
    return values, int(np.count_nonzero(outside))


def _valid_range(variable: xr.Variable) -> tuple[float, float]:
    """
    Limits of the valid values of a variable in its unit, by CF 2.5.1 and the attributes of the
    NetCDF user guide.

    The limits of packed integers are packed as well, unless they are floating-point numbers.
    """
    both = _finite(variable.attrs.get("valid_range"), 2)
    single = [_finite(variable.attrs.get(f"valid_{end}"), 1) for end in ("min", "max")]
    limits = [None if end is None else end[0] for end in single] if both is None else list(both)
    encoding = variable.encoding
    scale, offset = (
        float(encoding.get(key, one)) for key, one in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    raw = np.dtype(encoding.get("dtype", variable.dtype))
    packed = raw.kind in "iu" and not (scale == 1.0 and offset == 0.0)
    kinds = [(limit.dtype.kind, limit.dtype.itemsize) for limit in limits if limit is not None]
    if raw.kind == "f" and any(kind in "iu" and size < _SHORTEST for kind, size in kinds):
        return -np.inf, np.inf  # packed limits that remained when the values were unpacked
    ends = [
        end if limit is None else float(limit)
        for limit, end in zip(limits, (-np.inf, np.inf), strict=True)
    ]
    if packed and all(kind in "iu" for kind, _ in kinds):
        if str(encoding.get("_Unsigned", "")).lower() == "true":
            ends = [end + 2.0 ** (8 * raw.itemsize) if -np.inf < end < 0.0 else end for end in ends]
        ends = sorted(scale * end + offset for end in ends)
    low, high = ends
    rounding = 0.5 * abs(scale) * packed
    return low - rounding - 1e-6 * abs(low), high + rounding + 1e-6 * abs(high)


def _finite(value: object, size: int) -> Any:
    """Attribute as an array of finite numbers; None if it is missing or something else."""
    array = np.asarray(value).ravel()
    return (
        array
        if array.size == size and array.dtype.kind in "iuf" and np.isfinite(array).all()
        else None
    )


def file_name(data: xr.Dataset) -> str:
    """Name for messages."""
    return Path(data.encoding["source"]).name


def text(variable: xr.Variable | xr.DataArray | xr.Dataset, attribute: str) -> str:
    """Attribute as text; empty if it is missing or a number."""
    value = variable.attrs.get(attribute, "")
    return value.strip() if isinstance(value, str) else ""


@contextmanager
def reading(path: Path) -> Iterator[xr.Dataset]:
    """Open a data set and convert errors of the library to one line."""
    with open_file(path) as data, NETCDF_LOCK:
        try:
            yield data
        except MantaRayError:
            raise
        except Exception as error:  # noqa: BLE001  the library raises many types
            raise unreadable(path, error) from None


def unreadable(path: str | Path, error: Exception) -> OceanError:
    """Convert an error of a library to a one-line error."""
    if isinstance(error, OceanError):
        known = str(error).startswith((Path(path).name, str(path)))
        return error if known else OceanError(f"{Path(path).name}: {error}")
    reason = one_line(error, 120) or type(error).__name__
    return OceanError(
        f"{Path(path).name}: cannot be read; it may be incomplete or damaged ({reason})"
    )


def is_netcdf(path: Path) -> bool:
    """Return True if a path is a regular file that begins like NetCDF."""
    return first_bytes(path, 4) in (b"CDF\x01", b"CDF\x02", b"CDF\x05", b"\x89HDF")


def _engine(path: Path) -> str:
    if exists(path) and path.is_dir():
        check_zarr(path)
        with optional_package(OceanError, path.name, "zarr", "zarr"):
            import zarr  # noqa: F401
        return "zarr"
    check_regular(path, OceanError, what="a NetCDF file")
    if is_netcdf(path):
        return "netcdf4"
    if first_bytes(path, 4) in _TIFF:
        with optional_package(OceanError, path.name, "rioxarray", "raster"):
            import rioxarray  # noqa: F401
        return "rasterio"
    raise OceanError(f"{path.name}: {_other_format(path)}")


def _other_format(path: Path) -> str:
    """Cause and remedy for a file that is not NetCDF, by its first bytes."""
    start = first_bytes(path, 200)
    grid = next((name for first, name in _RASTERS.items() if start.lower().startswith(first)), "")
    if grid:
        return (
            f"{grid}, not NetCDF; convert it with gdal_translate -of netCDF {path.name}"
            f" {path.stem}.nc"
        )
    return "neither NetCDF-3 nor NetCDF-4; check that it is not a saved error page"


def _check_length(raw: xr.Dataset, path: Path) -> None:
    """
    Raise an error if a NetCDF-3 file is truncated: the library returns zeros for missing data.
    """
    with path.open("rb") as stream:
        if stream.read(3) != b"CDF":
            return

    def padded(value: object) -> int:
        return -(-(len(value) if isinstance(value, str) else np.asarray(value).nbytes) // 4) * 4

    least = (  # header and values in the layout of the format
        sum(8 + padded(str(dim)) for dim in raw.sizes)
        + sum(
            12 + padded(str(key)) + padded(value)
            for table in [raw.attrs, *(variable.attrs for variable in raw.variables.values())]
            for key, value in table.items()
        )
        + sum(28 + padded(str(name)) + 4 * v.ndim + v.nbytes for name, v in raw.variables.items())
    )
    if least > path.stat().st_size:
        raise OceanError(
            f"{path.name}: incomplete: it declares {least} bytes and has {path.stat().st_size};"
            " fetch it again"
        )


def _check_chunks(raw: xr.Dataset, path: Path) -> None:
    """Raise an error if a chunk is too large for memory: any access unpacks a whole chunk."""
    for name, variable in raw.variables.items():
        size = math.prod(variable.encoding.get("chunksizes") or ()) * variable.dtype.itemsize
        if size > MAX_UNPACKED_BYTES:
            raise OceanError(
                f"{path.name}: {name}: a chunk unpacks to {size / 1e9:,.1f} GB; the limit is"
                f" {MAX_UNPACKED_BYTES / 1e9:g} GB; write the file with smaller chunks"
            )


def _packing(title: str, name: str, value: Any) -> float:
    """Scale factor or offset of a variable; an invalid one raises an error."""
    number = np.asarray(value)
    if number.size != 1 or number.dtype.kind not in "iuf" or not np.isfinite(number).all():
        raise OceanError(
            f"{title}: {name} is {one_line(value, 40)!r}; it must be one finite number; correct"
            " the attribute"
        )
    if name == "scale_factor" and number.item() == 0.0:
        raise OceanError(
            f"{title}: scale_factor is 0, so all values would be equal; correct the attribute"
        )
    # shortest decimal of a float32: HYCOM packs in steps of 0.001, not 0.0010000000474974513
    single = np.float32(number.item())
    return float(str(single) if float(single) == number else number.item())
