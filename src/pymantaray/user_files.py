"""
Opening of the files that a user names: regular files only, with a limit of size, and one error line
for each cause.
"""

import gzip
import os
import re
import stat
import tomllib
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import IO, Any

from pymantaray.messages import printable

Refusal = Callable[[str], Exception]
"""Class of errors of the caller's folder."""
GZIP = ".gz"
MAX_BYTES = 200_000_000
"""A 24 Hz CTD writes 600,000 rows of at most 300 bytes on a cast to 12 km and back at 1 m/s."""
MAX_UNPACKED_BYTES = 2_000_000_000
"""
Maximum size of data unpacked into memory at a time: a table, or a chunk of an array or of a bag.
"""
_MAX_SEARCHED = 200_000  # files and folders that one pattern may visit
_MAX_PARTS = 100  # of a TOML key; tomllib needs memory in proportion to their square
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![\w-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{_MAX_PARTS},}}+")


@contextmanager
def open_regular(
    path: str | Path, refusal: Refusal, *, what: str = "a file", limit: int = MAX_BYTES
) -> Iterator[IO[bytes]]:
    """
    Open a regular file for reading; each cause of a failure is an error of one line.

    Parameters
    ----------
    path : str or pathlib.Path
    refusal : type of MantaRayError
        Error of the caller's folder.
    what : str
        Kind of file, for messages.
    limit : int
        Maximum size. [bytes]

    Yields
    ------
    file object
        Errors within the block, such as a disk that fails, are errors of one line too.
    """
    try:
        file = _opened(Path(path), refusal, what, limit)
    except (OSError, ValueError) as error:  # a name with a null character is a ValueError
        raise _cannot_be_read(path, refusal, error) from None
    try:
        with file:
            yield file
    except OSError as error:
        if error.errno is None:
            raise
        raise _cannot_be_read(path, refusal, error) from None


def read_bytes(
    path: str | Path, refusal: Refusal, *, what: str = "a file", limit: int = MAX_BYTES
) -> bytes:
    """Return the content of a regular file, as `open_regular`."""
    with open_regular(path, refusal, what=what, limit=limit) as file:
        content = file.read(limit + 1)
    if len(content) > limit:  # it grows, or the system does not know its size
        raise _too_large(path, refusal, limit)
    return content


def read_text(
    path: str | Path,
    refusal: Refusal,
    *,
    what: str = "a text file",
    limit: int = MAX_BYTES,
    errors: str = "strict",
) -> str:
    """
    Return the text of a regular file in UTF-8, with or without a byte order mark, as
    `open_regular`.
    """
    try:
        return read_bytes(path, refusal, what=what, limit=limit).decode("utf-8-sig", errors)
    except UnicodeDecodeError:
        raise refusal(f"{shown(path)}: cannot be read: not UTF-8 text; save it as UTF-8") from None


def is_gzip(path: str | Path) -> bool:
    """True if the name of a file says that it is compressed by gzip."""
    return Path(path).suffix == GZIP


def _decompressed(file: IO[bytes], path: str | Path, refusal: Refusal, limit: int) -> IO[bytes]:
    """Content of a gzip file, whose limit of size is that of its content too."""
    try:
        with gzip.GzipFile(fileobj=file) as whole:
            content = whole.read(limit + 1)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise refusal(
            f"{shown(path)}: cannot be read: not a complete gzip file ({error}); name an intact"
            " file"
        ) from None
    if len(content) > limit:
        raise _too_large(path, refusal, limit)
    return BytesIO(content)


@contextmanager
def open_text(
    path: str | Path, refusal: Refusal, *, what: str = "a text file", limit: int = MAX_BYTES
) -> Iterator[IO[str]]:
    """
    Open a regular file of UTF-8 text for reading line by line, as `open_regular`; a file whose name
    ends in ``.gz`` is decompressed.
    """
    try:
        with open_regular(path, refusal, what=what, limit=limit) as file:
            content = _decompressed(file, path, refusal, limit) if is_gzip(path) else file
            yield TextIOWrapper(content, encoding="utf-8-sig", newline=None)
    except UnicodeDecodeError:
        raise refusal(f"{shown(path)}: cannot be read: not UTF-8 text; save it as UTF-8") from None


def check_regular(
    path: str | Path, refusal: Refusal, *, what: str = "a file", limit: int | None = None
) -> Path:
    """
    Return the path of a regular file that a library opens by its name; raise an error for anything
    else.
    """
    with open_regular(path, refusal, what=what, limit=2**63 if limit is None else limit):
        return Path(path)


def first_bytes(path: str | Path, count: int) -> bytes:
    """First bytes of a regular file, to find out its format; empty for anything else."""
    try:
        with open_regular(path, OSError, limit=2**63) as file:
            return file.read(count)
    except OSError:
        return b""


def read_toml(path: str | Path, refusal: Refusal) -> dict[str, Any]:
    """Return the nested dictionaries of a TOML file, as `open_regular` and `parse_toml`."""
    return parse_toml(read_text(path, refusal, what="a TOML file"), str(path), refusal)


def parse_toml(text: str, label: str, refusal: Refusal) -> dict[str, Any]:
    """
    Return the nested dictionaries of a TOML text; text that needs unlimited memory or stack is
    refused.
    """
    if long := _LONG_KEY.search(text):
        line = text.count("\n", 0, long.start()) + 1
        raise refusal(
            f"{label}: not valid TOML: line {line}: a key of more than {_MAX_PARTS} parts"
        )
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise refusal(f"{label}: not valid TOML: {error}") from None
    except (ValueError, RecursionError):
        raise refusal(
            f"{label}: not valid TOML: a number is too long, or tables are nested too deeply"
        ) from None


def matching_files(pattern: str, folder: Path, refusal: Refusal) -> list[Path]:
    """
    Sorted paths that match a pattern with ``*``, ``?``, ``[]`` and ``**``, relative to a folder.

    Links to folders are not followed below ``**``, and a search of too many files is an error.
    """
    parts = (folder / pattern).parts
    wild = next((k for k, part in enumerate(parts) if re.search(r"[*?[]", part)), len(parts))
    to_search = [(Path(*parts[:wild]), parts[wild:])]
    found: set[Path] = set()
    count = 0
    while to_search:
        place, rest = to_search.pop()
        if not rest:
            found |= {place} if exists(place) else set()
            continue
        anywhere = rest[0] == "**"
        if anywhere:
            to_search.append((place, rest[1:]))
        for name, is_folder in _entries(place, follow=not anywhere):
            count += 1
            if anywhere and is_folder:
                to_search.append((place / name, rest))
            elif not anywhere and fnmatchcase(name, rest[0]) and (is_folder or len(rest) == 1):
                to_search.append((place / name, rest[1:]))
        if count > _MAX_SEARCHED:
            limit = f"more than {_MAX_SEARCHED:,} files to search"
            raise refusal(f"{shown(pattern)}: {limit}; name a folder closer to the files")
    return sorted(found)


def exists(path: str | Path) -> bool:
    """
    True if there is a file or folder of this name; False also for a name that no file can have.
    """
    try:
        os.stat(path)  # noqa: PTH116  Path.exists raises an error for long names
    except (OSError, ValueError):
        return False
    return True


def shown(path: str | Path) -> str:
    """Path for messages: at most 200 characters, control characters escaped."""
    name = printable(str(path)).replace("\n", "\\n")
    return name if len(name) <= 200 else f"{name[:140]}...{name[-57:]}"


def check_there(path: str | Path, refusal: Refusal, what: str = "file") -> None:
    """Raise an error if no file or folder of a name exists."""
    if not exists(path):
        raise _missing(path, refusal, what)


def _entries(folder: Path, *, follow: bool) -> list[tuple[str, bool]]:
    """Names in a folder, and True for folders; empty for a folder that cannot be read."""
    try:
        with os.scandir(folder) as entries:
            return [(entry.name, entry.is_dir(follow_symlinks=follow)) for entry in entries]
    except (OSError, ValueError):
        return []


def _opened(path: Path, refusal: Refusal, what: str, limit: int) -> IO[bytes]:
    """
    Open a path after a check of its kind, without waiting for a writer, and check again what was
    opened.
    """
    _check_state(path, path.stat(), refusal, what, limit)
    number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
    file = os.fdopen(number, "rb")
    try:
        _check_state(path, os.fstat(number), refusal, what, limit)
    except BaseException:
        file.close()
        raise
    return file


def _check_state(
    path: Path, state: os.stat_result, refusal: Refusal, what: str, limit: int
) -> None:
    if stat.S_ISDIR(state.st_mode):
        raise refusal(f"{shown(path)}: is a folder; name {what}")
    if not stat.S_ISREG(state.st_mode):
        raise refusal(f"{shown(path)}: not a regular file; name {what}")
    if state.st_size > limit:
        raise _too_large(path, refusal, limit)


def _cannot_be_read(path: str | Path, refusal: Refusal, error: Exception) -> Exception:
    if isinstance(error, FileNotFoundError):
        return _missing(path, refusal, "file")
    cause = getattr(error, "strerror", None) or error
    return refusal(f"{shown(path)}: cannot be read: {cause}; name an existing file")


def _missing(path: str | Path, refusal: Refusal, what: str) -> Exception:
    return refusal(f"{shown(path)}: no such {what}; name an existing {what}")


def _too_large(path: str | Path, refusal: Refusal, limit: int) -> Exception:
    return refusal(f"{shown(path)}: cannot be read: more than {limit:,} bytes; use a smaller file")
