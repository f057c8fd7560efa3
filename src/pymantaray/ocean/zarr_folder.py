"""Zarr folders: metadata checked before the library sees them, so that nothing in them runs or unpickles."""

import base64
import binascii
import json
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.files import Stored, StoredFile

_CODECS = {
    *("bytes", "endian", "zlib", "gzip", "bz2", "lzma", "blosc", "zstd", "lz4", "crc32c", "crc32", "shuffle"),
    *("transpose", "delta", "fixedscaleoffset", "bitround", "quantize", "adler32", "fletcher32"),
}
"""Codecs between numbers and bytes; what is not here (pickle, objects, plug-ins) is refused."""
_METADATA = ("zarr.json", ".zarray", ".zgroup", ".zattrs")
_LONGEST = 4 << 20  # bytes of a metadata file
_MOST_FILES = 1_000_000


def open_zarr(path: Path) -> StoredFile:
    """
    Read the header of a zarr folder, format 2 or 3; only the arrays of its root group.

    Parameters
    ----------
    path : pathlib.Path

    Returns
    -------
    StoredFile

    Raises
    ------
    OceanError
        If it is no zarr folder, uses a codec beyond numbers and bytes, or the extra is not installed.
    """
    if not any((path / name).is_file() for name in ("zarr.json", ".zgroup")):
        raise OceanError(f"{path.name}: a folder, but no zarr group; name NetCDF files or a zarr folder")
    folders = sorted(child for child in path.iterdir() if child.is_dir())
    arrays = [folder.name for folder in folders if _checked_array(folder, path.name)]
    _checked_json(path, path.name)
    try:
        import zarr
    except ImportError:
        raise OceanError(
            f'{path.name}: reading zarr needs the extra; pip install "pymantaray[zarr]"'
        ) from None
    try:
        group: Any = zarr.open_group(str(path), mode="r", use_consolidated=False)
        variables = {name: _stored(name, group[name], path.name) for name in arrays}
        attrs = dict(group.attrs)
    except OceanError:
        raise
    except Exception as error:  # noqa: BLE001  the library raises whatever it stumbles over
        raise _unreadable(path.name, error) from None
    return StoredFile(path, _size(path), attrs, variables)


def _stored(name: str, array: Any, file: str) -> Stored:
    attrs = dict(array.attrs)
    dims = getattr(array.metadata, "dimension_names", None) or attrs.get("_ARRAY_DIMENSIONS") or ()
    shape = tuple(int(n) for n in array.shape)
    if len(dims) != len(shape):
        raise OceanError(f"{file}: {name} does not name its {len(shape)} dimensions; write it with xarray")
    dtype = np.dtype(array.dtype)
    numeric = dtype.kind in "iuf"
    if "_FillValue" in attrs:
        attrs["_FillValue"] = _fill_value(attrs["_FillValue"])
    elif array.metadata.zarr_format == 2 and numeric and array.fill_value is not None:
        attrs["_FillValue"] = float(array.fill_value)
    chunk_bytes = math.prod(int(n) for n in array.chunks) * dtype.itemsize if numeric else 0

    def read(key: tuple[slice, ...]) -> NDArray[np.generic]:
        try:
            return np.asarray(array[key or ...])
        except Exception as error:  # noqa: BLE001
            raise _unreadable(file, error) from None

    return Stored(
        name, tuple(str(d) for d in dims), shape, dtype if numeric else None, attrs, chunk_bytes, read
    )


def _checked_array(folder: Path, file: str) -> bool:
    """Whether a folder is an array; its metadata are looked through whatever it is."""
    metadata = _checked_json(folder, file)
    return ".zarray" in metadata or metadata.get("zarr.json", {}).get("node_type") == "array"


def _checked_json(folder: Path, file: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in _METADATA:
        path = folder / name
        if not path.is_file():
            continue
        if path.stat().st_size > _LONGEST:
            raise OceanError(
                f"{file}: {folder.name}/{name} is larger than {_LONGEST >> 20} MiB; is it damaged?"
            )
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            names = set(_codecs(content))
        except (ValueError, RecursionError) as error:
            raise _unreadable(file, error) from None
        if not isinstance(content, dict):
            raise _unreadable(file, ValueError(f"{folder.name}/{name} is no object"))
        strange = sorted(names - _CODECS)
        if strange:
            raise OceanError(
                f"{file}: {folder.name} is coded by {', '.join(strange)}; allowed are {', '.join(sorted(_CODECS))}"
            )
        found[name] = content
    return found


def _codecs(content: Any) -> Iterator[str]:
    """Names of all codecs, filters and compressors anywhere in the metadata."""
    pending = [content]
    while pending:
        item = pending.pop()
        if isinstance(item, list):
            pending.extend(item)
        if not isinstance(item, dict):
            continue
        for key in ("compressor", "filters", "codecs", "compressors", "index_codecs", "serializer"):
            codecs = item.get(key) or []
            for codec in codecs if isinstance(codecs, list) else [codecs]:
                yield str(codec.get("id", codec.get("name"))) if isinstance(codec, dict) else str(codec)
        if item.get("dtype") == "|O" or item.get("data_type") == "object":
            yield "objects"
        if item.get("storage_transformers"):
            yield "a storage transformer"
        pending.extend(value for key, value in item.items() if key != "attributes")


def _fill_value(value: Any) -> Any:
    """Fill value as xarray writes it into zarr 3: the eight bytes of a float in base 64."""
    if not isinstance(value, str):
        return value
    try:
        return float(struct.unpack("<d", base64.standard_b64decode(value))[0])
    except (binascii.Error, struct.error, ValueError):
        return np.nan


def _size(path: Path) -> int:
    total = 0
    for i, child in enumerate(path.rglob("*")):
        if i > _MOST_FILES:
            break
        total += child.stat().st_size if child.is_file() else 0
    return total


def _unreadable(file: str, error: Exception) -> OceanError:
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    return OceanError(f"{file}: cannot be read as zarr ({reason})")
