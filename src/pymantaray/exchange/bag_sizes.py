"""
Sizes of bags before the library rosbags reads them, because it unpacks without limits.

Files and messages that are packed as a whole are unpacked here; the library gets their content.
Chunks, which it unpacks itself, are measured first.
"""

import bz2
import io
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

from pymantaray.errors import ExchangeError

MAX_CHUNK_BYTES = 256 * 2**20
"""Maximum size of one chunk or message; programs write chunks of 1 to 4 MB."""
MAX_POSES = 5_000_000
"""Maximum number over all topics of a bag: 58 h at 24 Hz. They need 4 GB of memory."""
_MAX_DISK_FRACTION = 0.5  # of the free space in the temporary folder
_PIECE = 2**20
_ZSTD = b"\x28\xb5\x2f\xfd"  # first bytes of packed content
_LZ4 = b"\x04\x22\x4d\x18"
_BZ2 = b"BZh"
_MCAP = b"\x89MCAP0\r\n"
_CHUNK = 0x06  # kinds of records of an MCAP file
_CHUNK_INDEX = 0x08


def check_count(count: int) -> None:
    """Raise an error for more poses than fit into memory."""
    if count > MAX_POSES:
        raise ExchangeError(
            f"more than {MAX_POSES:,} poses; remove topics, or reduce the sampling rate"
        )


def check_size(size: int) -> None:
    """Raise an error for a chunk or message beyond the limit."""
    if size > MAX_CHUNK_BYTES:
        raise ExchangeError(
            f"a chunk or message has more than {MAX_CHUNK_BYTES / 2**20:.0f} MiB; write the bag"
            " with smaller chunks, or remove topics without poses"
        )


def unpacked_message(raw: bytes | memoryview) -> bytes | memoryview:
    """Content of a message of a ROS 2 bag, which may be packed."""
    if bytes(raw[: len(_ZSTD)]) != _ZSTD:
        return raw
    with _opened(bytes(raw)) as file:
        content = file.read(MAX_CHUNK_BYTES + 1)
    check_size(len(content))
    return content


def unpacked_file(packed: Path, folder: str) -> Path:
    """Unpack a file into a folder, as far as it fits into half of the free space."""
    path = Path(folder, packed.stem)
    room = int(_MAX_DISK_FRACTION * shutil.disk_usage(folder).free)
    with packed.open("rb") as file, _zstd().open(file, "rb") as content, path.open("wb") as out:
        while piece := content.read(_PIECE):
            if out.tell() + len(piece) > room:
                raise ExchangeError(
                    f"its files unpack to more than {room / 1e9:.3g} GB, half of the free space in"
                    f" {tempfile.gettempdir()}; set TMPDIR to a larger folder, or unpack them first"
                )
            out.write(piece)
    return path


def check_mcap(path: Path) -> None:
    """Raise an error if an MCAP file has a chunk beyond the limit."""
    with path.open("rb") as file:
        if file.read(len(_MCAP)) == _MCAP:
            for chunk in _mcap_chunks(file):
                _check_chunk(chunk)


def check_bag1(reader: Any) -> None:
    """Raise an error if a ROS 1 bag, which the library has opened, has a chunk beyond the limit."""
    with reader.path.open("rb") as file:
        for chunk in reader.chunks.values():
            check_size(chunk.datasize)
            file.seek(chunk.datapos)
            _check_chunk(file.read(chunk.datasize))


def _mcap_chunks(file: IO[bytes]) -> Iterator[bytes]:
    """Packed content of each chunk of an MCAP file; its index must have these chunks only."""
    starts = set[int]()
    while len(head := file.read(9)) == 9:
        start = file.tell() - 9
        kind = head[0]
        size = int.from_bytes(head[1:], "little")
        if kind == _CHUNK:
            check_size(size)
            starts.add(start)
            record = file.read(size)
            yield record[40 + int.from_bytes(record[28:32], "little") :]
        elif kind == _CHUNK_INDEX:
            check_size(size)
            if int.from_bytes(file.read(size)[16:24], "little") not in starts:
                raise ExchangeError("the index of its chunks is wrong; write it again")
        else:
            file.seek(size, io.SEEK_CUR)


def _check_chunk(packed: bytes) -> None:
    """Raise an error for a chunk whose content is beyond the limit."""
    size = len(packed)
    if packed.startswith((_ZSTD, _LZ4, _BZ2)):
        size = 0
        with _opened(packed) as file:
            while size <= MAX_CHUNK_BYTES and (piece := file.read(_PIECE)):
                size += len(piece)
    check_size(size)


def _opened(packed: bytes) -> IO[bytes]:
    """Content of packed bytes as a file."""
    if packed.startswith(_BZ2):
        return bz2.open(io.BytesIO(packed))
    if packed.startswith(_ZSTD):
        return cast("IO[bytes]", _zstd().open(io.BytesIO(packed), "rb"))
    from lz4 import frame

    return cast("IO[bytes]", frame.open(io.BytesIO(packed), "rb"))


def _zstd() -> Any:
    """Module with which the library unpacks, which depends on the version of Python."""
    from rosbags.rosbag2 import reader

    return vars(reader)["zstd"]
