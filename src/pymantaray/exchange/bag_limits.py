"""
How much a bag may unpack to: the library rosbags unpacks whatever a file holds.

While a bag is read, the functions by which its modules unpack are replaced by ones that stop at a limit. Bags are
read one after another meanwhile.
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

MOST_CHUNK_BYTES = 256 * 2**20
"""Of one chunk or message; programs write chunks of 1 to 4 MB."""
MOST_POSES = 5_000_000
"""Of all topics of a bag; 58 h at 24 Hz. They take 4 GB."""
_SHARE = 0.5  # of the room in the temporary folder
_PIECE = 2**20
_ONE_AT_A_TIME = threading.Lock()


@contextmanager
def limited_unpacking() -> Iterator[None]:
    """Have rosbags refuse, in the block, a chunk or message that is too large unpacked, and a file for which there is no room."""
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
    """Refuse more poses than fit into memory."""
    if count > MOST_POSES:
        raise ExchangeError(f"has more than {MOST_POSES:,} poses; leave out topics or write fewer a second")


def _unpacked(opened: Callable[..., IO[bytes]], packed: bytes) -> bytes:
    """Content of a chunk or message, unpacked no further than to the limit."""
    with opened(io.BytesIO(packed), "rb") as file:
        content = file.read(MOST_CHUNK_BYTES + 1)
    if len(content) > MOST_CHUNK_BYTES:
        raise ExchangeError(
            f"one of its chunks or messages takes more than {MOST_CHUNK_BYTES / 2**20:.0f} MiB unpacked; write the bag with"
            " smaller chunks, or leave out what holds no poses"
        )
    return content


class _Limited:
    """A packed file that is read no further than there is room for it in the temporary folder."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._place = tempfile.gettempdir()
        self._room = self._most = int(_SHARE * shutil.disk_usage(self._place).free)

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
                f"its files take more than {self._most / 1e9:.3g} GB unpacked, half of what is free in {self._place}; set"
                " TMPDIR to a larger folder, or unpack them first"
            )
        return content
