"""
Limits for unpacking bags: the library rosbags itself has no limits.

While a bag is read, functions with a limit replace the unpacking functions of the library. Bags are therefore read one after
another.
"""

import bz2
import io
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace
from typing import IO, Any, Self

from pymantaray.errors import ExchangeError

MAX_CHUNK_BYTES = 256 * 2**20
"""Maximum size of one chunk or message; programs write chunks of 1 to 4 MB."""
MAX_POSES = 5_000_000
"""Maximum number over all topics of a bag: 58 h at 24 Hz. They need 4 GB of memory."""
_MAX_DISK_FRACTION = 0.5  # of the free space in the temporary folder
_PIECE = 2**20
_ONE_AT_A_TIME = threading.Lock()


@contextmanager
def limited_unpacking() -> Iterator[None]:
    """Make rosbags raise an error, within the block, for chunks and messages that are too large and files without enough disk space."""
    from lz4 import frame as lz4
    from rosbags.rosbag1 import reader as reader1
    from rosbags.rosbag2 import reader as reader2
    from rosbags.rosbag2 import storage_mcap

    zstd: Any = reader2.zstd
    chunk2 = {
        "lz4": lambda packed, _size: _unpacked(lz4.open, packed),
        "zstd": lambda packed, _size: _unpacked(zstd.open, packed),
    }
    chunk1 = {
        "lz4": lambda packed: _unpacked(lz4.open, packed),
        "bz2": lambda packed: _unpacked(bz2.open, packed),
    }
    whole = SimpleNamespace(
        decompress=lambda packed: _unpacked(zstd.open, packed),
        open=lambda file, mode: _Limited(zstd.open(file, mode)),
    )
    own = (
        (storage_mcap.DECOMPRESSORS, chunk2),
        (reader1.decompressors, chunk1),
        (vars(reader2), {"zstd": whole}),
    )
    with _ONE_AT_A_TIME, ExitStack() as stack:
        for functions, limited in own:
            stack.callback(functions.update, {name: functions[name] for name in limited})
            functions.update(limited)
        yield


def check_count(count: int) -> None:
    """Raise an error for more poses than fit into memory."""
    if count > MAX_POSES:
        raise ExchangeError(f"more than {MAX_POSES:,} poses; remove topics, or reduce the sampling rate")


def check_size(content: bytes | memoryview) -> None:
    """Raise an error for a chunk or message beyond the limit."""
    if len(content) > MAX_CHUNK_BYTES:
        raise ExchangeError(
            f"a chunk or message has more than {MAX_CHUNK_BYTES / 2**20:.0f} MiB; write the bag with"
            " smaller chunks, or remove topics without poses"
        )


def _unpacked(opened: Callable[..., IO[bytes]], packed: bytes) -> bytes:
    """Unpack a chunk or message up to the limit."""
    with opened(io.BytesIO(packed), "rb") as file:
        content = file.read(MAX_CHUNK_BYTES + 1)
    check_size(content)
    return content


class _Limited:
    """A packed file that is read only as far as it fits into the temporary folder."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._folder = tempfile.gettempdir()
        self._room = self._limit = int(_MAX_DISK_FRACTION * shutil.disk_usage(self._folder).free)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def read(self, size: int = _PIECE) -> bytes:
        """Read the next bytes of the content."""
        content = self._file.read(size)
        self._room -= len(content)
        if self._room < 0:
            raise ExchangeError(
                f"its files unpack to more than {self._limit / 1e9:.3g} GB, half of the free space in {self._folder}; set"
                " TMPDIR to a larger folder, or unpack them first"
            )
        return content
