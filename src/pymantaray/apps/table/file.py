"""Files of travel-time tables: NetCDF for Python, and a packed binary form for the C reader."""

import json
import struct
import zlib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from pymantaray.apps.table.cells import LEAF, CellStatus, Tree
from pymantaray.apps.table.table import TravelTimeTable
from pymantaray.errors import OnlineError, RecordError
from pymantaray.records.writing import read_netcdf, whole_file, write_netcdf
from pymantaray.user_files import check_regular, first_bytes, read_bytes

MAGIC = b"MANTATAB"
FORMAT = 2
# magic, version, sectors, branches, cells, corners, sigmas; limits and tolerance
_HEADER = struct.Struct("<8s6I7d")
_CHECKSUM = struct.Struct("<I")  # CRC-32 of all bytes before it
_COLUMNS = {
    "root": ("sector", "<u4", "1", "first branch of each sector"),
    "branch": ("branch_row", "<u4", "1", "axis and lower half, or content of a cell"),
    "corner": ("cell side", "<u4", "1", "rows of the corners"),
    "value": (
        "corner_row term",
        "<f4",
        "1",
        "relative mean slowness, and its derivatives by the coordinates in 1/m",
    ),
    "sigma": ("corner_sigma", "<f4", "1", "standard deviation of the relative mean slowness"),
    "status": ("cell", "u1", "1", "outcome of a look-up"),
    "surface_bounces": ("cell", "u1", "1", "reflections at the surface"),
    "bottom_bounces": ("cell", "u1", "1", "reflections at the bottom"),
}
"""Arrays in the order of the packed form, with dimensions, type, unit and meaning."""


def save_table(table: TravelTimeTable, path: Path | str, *, replace: bool = False) -> None:
    """
    Write a table.

    Parameters
    ----------
    table : TravelTimeTable
    path : pathlib.Path or str
        NetCDF, or the packed form for the C reader if the name ends in ``.mtt``.
    replace : bool
        Overwrite an existing file.

    Examples
    --------
    Continues the example of `pymantaray.apps.table`:

    >>> from pymantaray.apps.table import open_table, save_table
    >>> save_table(table, "saved.nc")
    >>> open_table("saved.nc").upper
    (100.0, 500.0, 2000.0)
    """
    path = Path(path)
    if path.suffix == ".mtt":
        with whole_file(path, replace=replace) as temporary:
            content = _content(table)
            temporary.write_bytes(content + _CHECKSUM.pack(zlib.crc32(content)))
        return
    import xarray as xr

    variables = {
        name: (dims.split(), getattr(table.tree, name), {"units": units, "long_name": meaning})
        for name, (dims, _, units, meaning) in _COLUMNS.items()
    }
    attrs = {
        "title": "MantaRay travel-time table",
        "kind": "travel_time_table",
        "format": FORMAT,
        "lower": list(table.lower),
        "upper": list(table.upper),
        "limits": "source depth, receiver depth and horizontal range [m]",
        "tolerance_m": table.tolerance,
        "record": json.dumps(table.attrs),
        "crc32": _checksum(table),
    }
    dataset = xr.Dataset(variables, attrs=attrs)
    for variable in dataset.variables.values():
        variable.encoding = {"zlib": True, "complevel": 4}
    write_netcdf(dataset, path, replace=replace)


def open_table(path: Path | str) -> TravelTimeTable:
    """
    Read a table.

    Parameters
    ----------
    path : pathlib.Path or str
        File from `save_table`, of either form.

    Returns
    -------
    TravelTimeTable

    Raises
    ------
    OnlineError
        If the file is missing, is not a table, or is damaged.

    Examples
    --------
    Continues the example of `pymantaray.apps.table`:

    >>> from pymantaray.apps.table import open_table, save_table
    >>> save_table(table, "table.nc")
    >>> print(open_table("table.nc").horizontal_range(50.0, 400.0, 1.0).horizontal_range.round(1))
    [1419.4]
    """
    path = check_regular(path, OnlineError, what="a travel-time table")
    try:
        packed = first_bytes(path, len(MAGIC)) == MAGIC
        table = _unpacked(read_bytes(path, OnlineError)) if packed else _from_netcdf(path)
    except (RecordError, ValueError, KeyError, struct.error) as error:
        raise OnlineError(f"{path}: not a readable travel-time table: {error}") from None
    fault = _fault(table)
    if fault:
        raise OnlineError(f"{path}: damaged travel-time table: {fault}; build it again")
    return table


def c_header() -> str:
    """
    Text of the C99 reader of packed tables.

    Returns
    -------
    str
        Content of ``mantaray_table.h``.
    """
    return resources.files("pymantaray.apps.table").joinpath("mantaray_table.h").read_text()


def _content(table: TravelTimeTable) -> bytes:
    """Header and arrays of a table, little-endian."""
    tree = table.tree
    counts = (tree.root.size, tree.branch.size, len(tree.corner), len(tree.value), tree.sigma.size)
    header = _HEADER.pack(MAGIC, FORMAT, *counts, *table.lower, *table.upper, table.tolerance)
    return header + b"".join(
        np.ascontiguousarray(getattr(tree, name), dtype=dtype).tobytes()
        for name, (_, dtype, _, _) in _COLUMNS.items()
    )


def _unpacked(content: bytes) -> TravelTimeTable:
    """Table of header and arrays; the counts must agree with the size."""
    _, version, sectors, branches, cells, corners, sigmas, *numbers = _HEADER.unpack_from(content)
    if version != FORMAT:
        raise ValueError(f"format {version}; this version reads format {FORMAT}")
    shapes: dict[str, tuple[int, ...]] = {
        "root": (sectors,),
        "branch": (branches,),
        "corner": (cells, 8),
        "value": (corners, 4),
        "sigma": (sigmas,),
    }
    arrays = {}
    start = _HEADER.size
    for name, (_, dtype, _, _) in _COLUMNS.items():
        shape = shapes.get(name, (cells,))
        size = int(np.prod(shape)) * np.dtype(dtype).itemsize
        if start + size > len(content):
            raise ValueError(f"{len(content)} bytes; the header needs more")
        arrays[name] = np.frombuffer(content[start : start + size], dtype=dtype).reshape(shape)
        start += size
    if content[start:] != _CHECKSUM.pack(zlib.crc32(content[:start])):
        raise ValueError("its bytes do not have their checksum; copy or build it again")
    return TravelTimeTable(_triple(numbers[:3]), _triple(numbers[3:6]), numbers[6], Tree(**arrays))


def _from_netcdf(path: Path) -> TravelTimeTable:
    dataset = read_netcdf(path, decode_times=False)
    attrs: dict[str, Any] = dataset.attrs
    if attrs.get("kind") != "travel_time_table":
        raise ValueError("no attribute kind = travel_time_table")
    arrays = {
        name: dataset[name].values.astype(dtype) for name, (_, dtype, _, _) in _COLUMNS.items()
    }
    lower, upper = (_triple(attrs[name]) for name in ("lower", "upper"))
    record = json.loads(attrs.get("record", "{}"))
    table = TravelTimeTable(lower, upper, float(attrs["tolerance_m"]), Tree(**arrays), record)
    if attrs["format"] != FORMAT:
        raise ValueError(f"format {attrs['format']}; this version reads format {FORMAT}")
    if attrs["crc32"] != _checksum(table):
        raise ValueError("its values do not have their checksum; copy or build it again")
    return table


def _checksum(table: TravelTimeTable) -> int:
    """
    CRC-32 of the content and of the record (not of the packed form: a CRC-32 over bytes with their
    own is constant).
    """
    return zlib.crc32(json.dumps(table.attrs).encode(), zlib.crc32(_content(table)))


def _triple(numbers: Sequence[float]) -> tuple[float, float, float]:
    """Limits of the three coordinates."""
    first, second, third = (float(number) for number in numbers)
    return first, second, third


def _fault(table: TravelTimeTable) -> str:
    """
    First fault that would make a look-up read outside an array or never end; empty without one.
    """
    tree = table.tree
    limits = np.array([table.lower, table.upper])
    if limits.shape != (2, 3) or not np.all(np.isfinite(limits)) or np.any(limits[0] >= limits[1]):
        return "limits are not ascending"
    if not tree.root.size or np.any(tree.root >= tree.branch.size):
        return "a sector without branches"
    axis = tree.branch & LEAF
    content = (tree.branch >> 2).astype(np.int64)
    inner = axis != LEAF
    number = np.arange(tree.branch.size)
    if np.any(inner & ((content <= number) | (content + 1 >= tree.branch.size))):
        return "a branch whose halves do not follow it"
    has = ~inner & (content & 1 == 1)
    if np.any(has & (content >> 1 >= len(tree.corner))) or np.any(
        ~inner & ~has & (content >> 1 > max(CellStatus))
    ):
        return "a cell without content"
    if (
        tree.corner.shape[1:] != (8,)
        or tree.value.shape[1:] != (4,)
        or np.any(tree.corner >= len(tree.value))
    ):
        return "a cell without corners"
    if any(
        len(column) != len(tree.corner)
        for column in (tree.status, tree.surface_bounces, tree.bottom_bounces)
    ):
        return "cells without a status"
    if np.any(tree.status > CellStatus.AMBIGUOUS):
        return "a cell with a range and a status without one"
    if tree.sigma.size not in (0, len(tree.value)):
        return "corners without a standard deviation"
    finite = np.all(np.isfinite(tree.value)) and np.all(np.isfinite(tree.sigma))
    return "" if finite else "values that are not finite"
