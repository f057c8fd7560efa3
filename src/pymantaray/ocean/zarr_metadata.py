"""Metadata of zarr folders, read before the library opens them: codecs that may decode, and sizes of chunks."""

import json
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pymantaray.errors import OceanError
from pymantaray.records.unpacking import MOST_UNPACKED_BYTES

_METADATA = frozenset({".zarray", ".zgroup", ".zmetadata", "zarr.json"})
_MOST_BYTES = 64 * 2**20
"""Of one file of metadata; consolidated metadata of a model with a thousand variables take 1 MB."""
_COMPRESSORS = "blosc bz2 gzip lz4 lzma pcodec zfpy zlib zstd"
_FILTERS = "astype bitround delta fixedscaleoffset packbits quantize shuffle"
_CHECKSUMS = "adler32 crc32 crc32c fletcher32 jenkins_lookup3"
_DECODING = frozenset(f"{_COMPRESSORS} {_FILTERS} {_CHECKSUMS} vlen-bytes vlen-utf8".split())
_CODECS = _DECODING | {f"numcodecs.{name}" for name in _DECODING}
_CODECS |= {"bytes", "endian", "transpose", "sharding_indexed"}  # format 3 only
_LISTS = frozenset({"codecs", "index_codecs", "filters", "compressor", "compressors", "object_codec"})


def check_zarr(folder: Path) -> None:
    """
    Refuse a folder that is no zarr group, or one of whose arrays needs a codec that is not on the list or a chunk that is too large.

    A codec such as ``pickle`` runs what it decodes. Metadata are parsed as the library does, so that no spelling of a name
    differs between the two; folders behind links are checked too.
    """
    files = list(_metadata_files(folder))
    if not files:
        raise OceanError(f"{folder}: a folder, but no zarr group; name NetCDF files or a zarr folder")
    for file in files:
        where = f"{folder.name}: {file.parent.name}" if file.parent != folder else folder.name
        _check(_parsed(file, where), where)


def _metadata_files(folder: Path) -> Iterator[Path]:
    """All files of metadata below a folder, whatever links lead to them; each folder once."""
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
        if not file.is_file():
            raise OceanError(f"{where}: {file.name} is not an ordinary file")
        if file.stat().st_size > _MOST_BYTES:
            raise OceanError(f"{where}: {file.name} has more than {_MOST_BYTES:,} bytes; it is no metadata")
        return json.loads(file.read_bytes())  # of bytes: their encoding is guessed as the library guesses it
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or type(error).__name__
        raise OceanError(f"{where}: {file.name} cannot be read, perhaps damaged ({reason})") from None


def _check(tree: Any, where: str) -> None:
    """Check whatever a tree of metadata has at any depth: an array, a group, or all of them consolidated."""
    if isinstance(tree, list):
        for part in tree:
            _check(part, where)
    if not isinstance(tree, dict):
        return
    _check_chunk(tree, where)
    for key, value in tree.items():
        if key in ("attributes", "fill_value") or key.endswith(".zattrs"):
            continue  # they decode nothing
        if key in _LISTS:
            for codec in value if isinstance(value, list) else [value]:
                _check_codec(codec, where)
        _check(value, where)


def _check_codec(codec: Any, where: str) -> None:
    name = codec
    if isinstance(codec, dict):
        names = {str(codec[key]) for key in ("id", "name") if key in codec}
        name = next(iter(names)) if len(names) == 1 else f"{' and '.join(sorted(names)) or 'no name'}"
    if name is not None and name not in _CODECS:
        raise OceanError(
            f"{where}: its codec {str(name)[:40]!r} is not allowed, it could run what it decodes; write the data again with"
            f" one of {_COMPRESSORS.replace(' ', ', ')}"
        )


def _check_chunk(array: dict[str, Any], where: str) -> None:
    """Refuse a chunk that does not fit into memory: it is unpacked whole, however little of it is asked for."""
    grid = array.get("chunk_grid")
    shape: Any = array.get("chunks")
    if isinstance(grid, dict) and isinstance(grid.get("configuration"), dict):
        shape = grid["configuration"].get("chunk_shape")
        for codec in array.get("codecs") or []:  # of a shard only the chunks that are asked for are unpacked
            if isinstance(codec, dict) and codec.get("name") == "sharding_indexed":
                shape = (codec.get("configuration") or {}).get("chunk_shape", shape)
    if not isinstance(shape, list) or not all(isinstance(n, int) for n in shape):
        return  # the library refuses it
    try:
        kind = np.dtype(array.get("dtype") or array.get("data_type") or "f8")
    except (TypeError, ValueError):
        kind = np.dtype("f8")
    size = math.prod(shape) * kind.itemsize
    if size > MOST_UNPACKED_BYTES:
        raise OceanError(
            f"{where}: one of its chunks takes {size / 1e9:,.1f} GB unpacked; at most {MOST_UNPACKED_BYTES / 1e9:g} GB are"
            " allowed: write it with smaller chunks"
        )
