"""Storage of results as small, atomically written files in a folder or an object store."""

import hashlib
import json
import logging
import os
import re
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import TypeVar

from pymantaray.errors import JobError, MantaRayError, RecordError, WriteError, optional_package
from pymantaray.records import whole_file

T = TypeVar("T")
_LOG = logging.getLogger("pymantaray.jobs")
# name of an unfinished file of `whole_file`
_TEMPORARY = re.compile(r"\.(?P<name>[^/]+)\.[0-9a-f]{16}\.part")
_KEY = re.compile(r"[0-9a-f]{50}")  # a hash truncated by `whole_file`
# protocols that write objects atomically
_ATOMIC = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "memory")
_BATCH = 1000  # objects per read
_SEAL_BYTES = hashlib.sha256().digest_size
_STALE_AGE = 3600.0  # an older file with a temporary name is from a killed process [s]


def failure_content(error: BaseException) -> bytes:
    """Content of the file of a failed task: one line, and a traceback for unexpected errors."""
    line = str(error).partition("\n")[0]
    content = {
        "error": line if isinstance(error, MantaRayError) else f"{type(error).__name__}: {line}"
    }
    if not isinstance(error, MantaRayError):
        content["traceback"] = "".join(traceback.format_exception(error))
    return json.dumps(content, indent=1).encode()


class Store:
    """Named files in a folder of this machine, or in one that machines share."""

    def __init__(self, location: str) -> None:
        self.url = location
        self.folder: Path | None = None if "://" in location else Path(os.path.realpath(location))

    @property
    def _path(self) -> Path:
        assert self.folder is not None  # for the type checker
        return self.folder

    def has(self, name: str) -> bool:
        """Return True if a file exists."""
        return (self._path / name).exists()

    def contents(self, names: Iterable[str]) -> Iterator[tuple[str, bytes]]:
        """Names and contents of those files that exist."""
        for name in names:
            content = self.read(name)
            if content is not None:
                yield name, content

    def read(self, name: str) -> bytes | None:
        """Content of a file; None if there is none."""
        try:
            return (self._path / name).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise JobError(f"{self._path / name}: cannot be read: {error.strerror}") from None

    def write(self, name: str, content: bytes) -> None:
        """Write or replace a file atomically; raises `WriteError`."""
        path = self._path / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise WriteError(f"{path.parent}: cannot be written: {error.strerror}") from None
        with whole_file(path) as temporary:
            temporary.write_bytes(content)

    def names(self, folder: str) -> set[str]:
        """Names, without folders, of all files below a folder."""
        return {file for _, _, files in os.walk(self._path / folder) for file in files}

    def remove(self, name: str) -> None:
        """Remove a file if it exists."""
        with suppress(OSError):
            (self._path / name).unlink()

    def claim(self, kind: str, marker: str, own_names: set[str]) -> None:
        """
        Raise an error if the store has other content.

        Incomplete files of killed processes are removed.
        """
        if self._path.exists() and not self._path.is_dir():
            raise JobError(f"{self.url}: is a file; give a folder")
        others = {path.name for path in self._path.iterdir()} if self._path.exists() else set()
        if not self.has(marker) and not all(
            name in own_names or _is_unfinished(name, own_names) for name in others
        ):
            raise JobError(
                f"{self.url}: this folder is not empty and has no {kind}; give a new folder, or"
                f" one of the same {kind}"
            )
        paths = list(self._path.glob("*"))
        for name in own_names:
            paths += (self._path / name).rglob("*")
        for path in paths:
            if _is_unfinished(path.name, own_names):
                with suppress(OSError):
                    if time.time() - path.stat().st_mtime > _STALE_AGE:
                        path.unlink()


def _is_unfinished(name: str, own_names: set[str]) -> bool:
    """True for the temporary name of a task's file, or of one of the store's own files."""
    match = _TEMPORARY.fullmatch(name)
    return match is not None and (
        match["name"] in own_names or _KEY.fullmatch(match["name"]) is not None
    )


class _Objects(Store):
    """Store in an object service of fsspec; incomplete objects do not exist there."""

    def __init__(self, location: str) -> None:
        super().__init__(location)
        with optional_package(JobError, location, "fsspec", "dask"):
            import fsspec
        protocol = location.partition("://")[0]
        if protocol not in _ATOMIC:
            raise JobError(
                f"{location}: {protocol} does not write files atomically; give a folder, or one of"
                f" {', '.join(_ATOMIC)}"
            )
        try:
            self._files, root = fsspec.url_to_fs(location)
        except (ImportError, ValueError) as error:
            raise JobError(
                f"{location}: cannot be opened: {str(error).partition(chr(10))[0]}"
            ) from None
        self._root = PurePosixPath(root)

    def has(self, name: str) -> bool:
        self._files.invalidate_cache()
        return bool(self._files.exists(str(self._root / name)))

    def read(self, name: str) -> bytes | None:
        try:
            return bytes(self._files.cat_file(str(self._root / name)))
        except FileNotFoundError:
            return None
        except OSError as error:
            raise JobError(f"{self.url}/{name}: cannot be read: {error}") from None

    def contents(self, names: Iterable[str]) -> Iterator[tuple[str, bytes]]:
        remaining_names = iter(names)
        while batch := list(islice(remaining_names, _BATCH)):
            paths = {self._files._strip_protocol(str(self._root / name)): name for name in batch}
            try:
                contents = self._files.cat(list(paths), on_error="omit")
            except OSError as error:
                raise JobError(f"{self.url}: cannot be read: {error}") from None
            yield from ((paths[path], content) for path, content in contents.items())

    def write(self, name: str, content: bytes) -> None:
        try:
            self._files.pipe_file(str(self._root / name), content)
        except OSError as error:
            raise WriteError(f"{self.url}/{name}: cannot be written: {error}") from None

    def names(self, folder: str) -> set[str]:
        self._files.invalidate_cache()
        return {PurePosixPath(path).name for path in self._files.find(str(self._root / folder))}

    def remove(self, name: str) -> None:
        with suppress(OSError):
            self._files.rm_file(str(self._root / name))

    def claim(self, kind: str, marker: str, own_names: set[str]) -> None:
        pass


def read_valid(store: Store, name: str, parse: Callable[[bytes], T]) -> T | None:
    """
    Parse the content of a file; None if it is missing or damaged.

    A damaged file is removed with a warning.
    """
    content = store.read(name)
    if content is None:
        return None
    try:
        return parse(content)
    except (RecordError, ValueError) as error:
        _LOG.warning("%s/%s: %s; removed and computed again", store.url, name, error)
        store.remove(name)
        return None


def write_sealed(store: Store, name: str, content: bytes) -> None:
    """Write a file that ends in a checksum of its name and content."""
    store.write(name, content + _seal(name, content))


def read_sealed(store: Store, name: str, parse: Callable[[bytes], T]) -> T | None:
    """
    Parse a file from `write_sealed`, as `read_valid`; one with a wrong bit, or under the name of
    another, is damaged.
    """

    def parse_sealed(file: bytes) -> T:
        content = file[:-_SEAL_BYTES]
        if file[-_SEAL_BYTES:] != _seal(name, content):
            raise RecordError("damaged: its content does not have its checksum")
        return parse(content)

    return read_valid(store, name, parse_sealed)


def _seal(name: str, content: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + content).digest()


def open_store(location: str | Path) -> Store:
    """Open the store in a folder or at a URL."""
    text = str(location)
    if "://" in text:
        return _Objects(text.rstrip("/"))
    return Store(os.path.realpath(text))  # `realpath` does not resolve a circle of symbolic links
