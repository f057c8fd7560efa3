"""Check of zarr metadata before the library opens a folder: allowed codecs and sizes of chunks."""

import json
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pymantaray.errors import OceanError
from pymantaray.user_files import MAX_UNPACKED_BYTES, read_bytes

_METADATA = frozenset({".zarray", ".zgroup", ".zmetadata", "zarr.json"})
_MAX_BYTES = 64 * 2**20
"""
Maximum size of a metadata file; consolidated metadata of a model with a thousand variables need 1
MB.
"""
_COMPRESSORS = "blosc bz2 gzip lz4 lzma pcodec zfpy zlib zstd"
_FILTERS = "astype bitround delta fixedscaleoffset packbits quantize shuffle"
_CHECKSUMS = "adler32 crc32 crc32c fletcher32 jenkins_lookup3"
_DECODING = frozenset(f"{_COMPRESSORS} {_FILTERS} {_CHECKSUMS} vlen-bytes vlen-utf8".split())
_CODECS = _DECODING | {f"numcodecs.{name}" for name in _DECODING}
_CODECS |= {"bytes", "endian", "transpose", "sharding_indexed"}  # format 3 only
_LISTS = frozenset(
    {"codecs", "index_codecs", "filters", "compressor", "compressors", "object_codec"}
)


def check_zarr(folder: Path) -> None:
    """
    Raise an error if a folder is not a zarr group, or an array has a codec that is not allowed or a
    chunk that is too large.

    A codec such as ``pickle`` executes the data that it decodes. This module parses metadata in the
    same way as the library, so both read the same names. Folders behind links are also checked.
    """
    files = list(_metadata_files(folder))
    if not files:
        raise OceanError(
            f"{folder}: this folder is not a zarr group; name NetCDF files or a zarr folder"
        )
    for file in files:
        where = f"{folder.name}: {file.parent.name}" if file.parent != folder else folder.name
        _check(_parsed(file, where), where)


def _metadata_files(folder: Path) -> Iterator[Path]:
    """All metadata files below a folder, also behind links; each folder once."""
    seen: set[tuple[int, int]] = set()
    for own, folders, names in os.walk(folder, followlinks=True):
        status = Path(own).stat()
        if (status.st_dev, status.st_ino) in seen:
            folders.clear()
            continue
        seen.add((status.st_dev, status.st_ino))
        # some file systems do not distinguish ZARR.JSON from zarr.json
        yield from (Path(own, name) for name in sorted(names) if name.lower() in _METADATA)


def _parsed(file: Path, where: str) -> Any:
    try:
        # bytes: json detects the encoding, as in the library
        return json.loads(read_bytes(file, OceanError, what="metadata", limit=_MAX_BYTES))
    except (ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or type(error).__name__
        raise OceanError(
            f"{where}: {file.name} cannot be read; it may be damaged ({reason})"
        ) from None


def _check(tree: Any, where: str) -> None:
    """Check a tree of metadata at any depth: an array, a group, or consolidated metadata."""
    if isinstance(tree, list):
        for part in tree:
            _check(part, where)
    if not isinstance(tree, dict):
        return
    _check_chunk(tree, where)
    for key, value in tree.items():
        if key in ("attributes", "fill_value") or key.endswith(".zattrs"):
            continue  # these decode nothing
        if key in _LISTS:
            for codec in value if isinstance(value, list) else [value]:
                _check_codec(codec, where)
        _check(value, where)


def _check_codec(codec: Any, where: str) -> None:
    name = codec
    if isinstance(codec, dict):
        names = {str(codec[key]) for key in ("id", "name") if key in codec}
        name = (
            next(iter(names)) if len(names) == 1 else f"{' and '.join(sorted(names)) or 'no name'}"
        )
    if name is not None and name not in _CODECS:
        raise OceanError(
            f"{where}: codec {str(name)[:40]!r} is not allowed because it could execute data; write"
            f" the data again with one of {_COMPRESSORS.replace(' ', ', ')}"
        )


def _check_chunk(array: dict[str, Any], where: str) -> None:
    """Raise an error if a chunk is too large for memory: any access unpacks a whole chunk."""
    grid = array.get("chunk_grid")
    shape: Any = array.get("chunks")
    if isinstance(grid, dict) and isinstance(grid.get("configuration"), dict):
        shape = grid["configuration"].get("chunk_shape")
        for codec in array.get("codecs") or []:  # only the requested chunks of a shard are unpacked
            if isinstance(codec, dict) and codec.get("name") == "sharding_indexed":
                shape = (codec.get("configuration") or {}).get("chunk_shape", shape)
    if not isinstance(shape, list) or not all(isinstance(n, int) for n in shape):
        return  # the library raises an error
    try:
        kind = np.dtype(array.get("dtype") or array.get("data_type") or "f8")
    except (TypeError, ValueError):
        kind = np.dtype("f8")
    size = math.prod(shape) * kind.itemsize
    if size > MAX_UNPACKED_BYTES:
        raise OceanError(
            f"{where}: a chunk unpacks to {size / 1e9:,.1f} GB; the limit is"
            f" {MAX_UNPACKED_BYTES / 1e9:g} GB; write the data with smaller chunks"
        )
