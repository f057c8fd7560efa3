"""Opening data sets that nobody vouches for: sizes are checked before anything is read."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean import netcdf3
from pymantaray.ocean.hdf5 import Hdf5Process

Array = NDArray[np.float64]
Attributes = Mapping[str, Any]

BASE_BYTES = 64 << 20
"""Values of one variable (as float64) that are read from any file, however small. [bytes]"""
BYTES_PER_BYTE = 32
"""Values of one variable (as float64) that are read beyond that, per byte of the file's own size; a field
that compresses more is refused where it is larger than `BASE_BYTES`."""
_MEMORY_SHARE = 1 / 12  # of the machine, for one of four variables; conversion holds up to three of each
_NETCDF_FILL = 9.96e36  # of floats that were never written
_INTEGER_FILL = {"i2": -32767, "i4": -2147483647}


@dataclass(frozen=True)
class Stored:
    """One variable of a data set: what its header says, and how to read a block of it."""

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype[np.generic] | None
    """None where the values are text or otherwise no numbers."""
    attrs: Attributes
    chunk_bytes: int
    """What has to be read at once, decompressed; 0 where any block can be. [bytes]"""
    read: Callable[[tuple[slice, ...]], NDArray[np.generic]]

    def text(self, attribute: str) -> str:
        """Attribute as text; empty where it is missing or a number."""
        value = self.attrs.get(attribute, "")
        return value.strip() if isinstance(value, str) else ""


@dataclass(frozen=True)
class StoredFile:
    """A data set as it is stored: a NetCDF file or a zarr folder."""

    path: Path
    size: int
    """[bytes]"""
    attrs: Attributes
    variables: Mapping[str, Stored]

    @property
    def name(self) -> str:
        """Name for messages."""
        return self.path.name

    def values(self, name: str, selection: Mapping[str, slice] | None = None) -> Array:
        """
        Block of a variable as numbers: fill values masked, scale and offset applied.

        Parameters
        ----------
        name : str
        selection : mapping of str to slice, optional
            Slices by dimension, without steps; by default everything.

        Returns
        -------
        ndarray
            NaN where a value is missing.

        Raises
        ------
        OceanError
            If the variable holds no numbers, is damaged, or needs more memory than a file of this size
            can account for.
        """
        variable = self.variables[name]
        if variable.dtype is None:
            raise OceanError(f"{self.name}: {name} holds text or records, not numbers; write it as numbers")
        key = []
        for dim, n in zip(variable.dims, variable.shape, strict=True):
            wanted = (selection or {}).get(dim, slice(None))
            start, stop, _ = wanted.indices(n)
            key.append(slice(start, max(start, stop)))
        self._check_size(variable, math.prod(s.stop - s.start for s in key))
        return _decoded(variable, variable.read(tuple(key)))

    def _check_size(self, variable: Stored, count: int) -> None:
        allowed = BASE_BYTES + BYTES_PER_BYTE * self.size
        needed = max(8 * count, variable.chunk_bytes)
        if needed > _MEMORY_SHARE * _memory() and needed <= allowed:
            raise OceanError(
                f"{self.name}: {variable.name} alone takes {needed / 2**30:.1f} GiB, the machine has"
                f" {_memory() / 2**30:.0f}; read a window, south, north, west, east"
            )
        if needed > allowed:
            raise OceanError(
                f"{self.name}: {variable.name} declares {needed / 2**20:.0f} MiB, a file of"
                f" {self.size / 2**20:.3g} MiB may hold {allowed / 2**20:.0f}; it is damaged, or read a"
                " smaller window"
            )


def open_stored(path: str | Path, reader: Hdf5Process) -> StoredFile:
    """
    Read the header of a NetCDF file or of a zarr folder.

    Parameters
    ----------
    path : str or pathlib.Path
    reader : Hdf5Process
        Reads the NetCDF-4 files; must be open while values are read.

    Returns
    -------
    StoredFile

    Raises
    ------
    OceanError
        If there is nothing, nothing of a known kind, or something damaged.
    """
    path = Path(path)
    if "://" in str(path) or str(path).startswith(("http:", "https:")):
        raise OceanError(f"{path}: an address, not a file; get it with mantaray ocean fetch, or download it")
    if path.is_dir():
        from pymantaray.ocean.zarr_folder import open_zarr

        return open_zarr(path)
    if not path.is_file():
        raise OceanError(f"{path}: no such file; name an existing NetCDF file")
    with path.open("rb") as stream:
        start = stream.read(4)
    if start in (b"CDF\x01", b"CDF\x02", b"CDF\x05"):
        return _netcdf3(path)
    if start == b"\x89HDF":
        return _netcdf4(path, reader)
    raise OceanError(f"{path.name}: neither NetCDF-3 nor NetCDF-4; was an error page saved instead?")


def _netcdf3(path: Path) -> StoredFile:
    attrs, variables = netcdf3.read_header(path)

    def reader(variable: netcdf3.Variable3) -> Callable[[tuple[slice, ...]], NDArray[np.generic]]:
        return lambda key: netcdf3.read_values(path, variable, key)

    stored = {
        name: Stored(name, v.dims, v.shape, None if v.dtype.kind == "S" else v.dtype, v.attrs, 0, reader(v))
        for name, v in variables.items()
    }
    return StoredFile(path, path.stat().st_size, attrs, stored)


def _netcdf4(path: Path, process: Hdf5Process) -> StoredFile:
    header = process.header(path)

    def reader(name: str, declared: Mapping[str, Any]) -> Callable[[tuple[slice, ...]], NDArray[np.generic]]:
        width = np.dtype(declared["dtype"] or "u1").itemsize

        def read(key: tuple[slice, ...]) -> NDArray[np.generic]:
            wanted = width * math.prod(s.stop - s.start for s in key)
            return process.values(path, name, key, wanted + 2 * int(declared["chunk_bytes"]))

        return read

    stored = {
        name: Stored(
            name,
            tuple(v["dims"]),
            tuple(v["shape"]),
            np.dtype(v["dtype"]) if v["dtype"] else None,
            v["attrs"],
            int(v["chunk_bytes"]),
            reader(name, v),
        )
        for name, v in header["variables"].items()
    }
    return StoredFile(path, path.stat().st_size, header["attrs"], stored)


def _memory() -> int:
    """Of the machine. [bytes]"""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _decoded(variable: Stored, raw: NDArray[np.generic]) -> Array:
    """Numbers from what is stored, as the NetCDF User's Guide has it: mask first, then scale and offset."""
    kind = raw.dtype.kind
    if kind == "i" and variable.text("_Unsigned").lower() == "true":
        raw = raw.view(raw.dtype.str.replace("i", "u"))
    fills = [
        number
        for name in ("_FillValue", "missing_value")
        for number in np.atleast_1d(np.asarray(variable.attrs.get(name, np.nan)))
        if isinstance(number, np.number)
    ]
    with np.errstate(all="ignore"):
        values = np.array(raw, dtype=float)
        missing = ~np.isfinite(values)
        if kind == "f":
            missing |= np.abs(values) >= _NETCDF_FILL
        elif "_FillValue" not in variable.attrs and raw.dtype.str[1:] in _INTEGER_FILL:
            missing |= values == _INTEGER_FILL[raw.dtype.str[1:]]
        for fill in fills:
            missing |= values == float(raw.dtype.type(fill)) if kind == "f" else values == float(fill)
        scale, offset = (_number(variable, name) for name in ("scale_factor", "add_offset"))
        if scale is not None:
            values *= scale
        if offset is not None:
            values += offset
    values[missing] = np.nan
    return values


def _number(variable: Stored, name: str) -> float | None:
    value = variable.attrs.get(name)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
