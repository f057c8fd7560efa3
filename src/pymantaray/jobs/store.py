"""Where results are: a folder, or an object store by fsspec, of small files that are there whole or not at all."""

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

from pymantaray.errors import JobError, MantaRayError, RecordError, WriteError
from pymantaray.records import whole_file

T = TypeVar("T")
_LOG = logging.getLogger("pymantaray.jobs")
_TEMPORARY = re.compile(
    r"\.(?P<name>[^/]+)\.[0-9a-f]{16}\.part"
)  # of a file that `whole_file` has not finished
_KEY = re.compile(r"[0-9a-f]{50}")  # what it leaves of a hash
_ATOMIC = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "memory")  # an object is there when all of it is
_TOGETHER = 1000  # objects that are read at once
_STALE = 3600.0  # age at which a file with a temporary name is of a process that was killed [s]


def failure_content(error: BaseException) -> bytes:
    """What a file says of a task that failed: one line, and for what nobody foresaw where it was."""
    line = str(error).partition("\n")[0]
    content = {"error": line if isinstance(error, MantaRayError) else f"{type(error).__name__}: {line}"}
    if not isinstance(error, MantaRayError):
        content["traceback"] = "".join(traceback.format_exception(error))
    return json.dumps(content, indent=1).encode()


class Store:
    """Named files in a folder of this machine, or in one that machines share."""

    def __init__(self, place: str) -> None:
        self.url = place
        self.folder: Path | None = None if "://" in place else Path(os.path.realpath(place))

    @property
    def _path(self) -> Path:
        assert self.folder is not None  # for the type checker
        return self.folder

    def has(self, name: str) -> bool:
        """Whether there is a file."""
        return (self._path / name).exists()

    def contents(self, names: Iterable[str]) -> Iterator[tuple[str, bytes]]:
        """Names and contents of the files that are there of these names."""
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
        """Write a file, whole or not at all, in place of one of that name; raises `WriteError`."""
        path = self._path / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise WriteError(f"{path.parent}: cannot be written: {error.strerror}") from None
        if os.path.realpath(path.parent) != str(path.parent):
            raise WriteError(
                f"{path.parent}: leads out of {self.url} by a symbolic link; remove the link or give another folder"
            )
        with whole_file(path) as temporary:
            temporary.write_bytes(content)

    def names(self, folder: str) -> set[str]:
        """Names, without folders, of all files below a folder."""
        return {file for _, _, files in os.walk(self._path / folder) for file in files}

    def remove(self, name: str) -> None:
        """Remove a file if it is there."""
        with suppress(OSError):
            (self._path / name).unlink()

    def claim(self, kind: str, marker: str, ours: set[str]) -> None:
        """Refuse a place that holds something else, and remove what killed processes have left half written."""
        if self._path.is_symlink():  # the place is resolved, so that it leads nowhere
            raise JobError(f"{self.url}: is a circle of symbolic links; give another folder")
        if self._path.exists() and not self._path.is_dir():
            raise JobError(f"{self.url}: is a file; give a folder")
        others = {path.name for path in self._path.iterdir()} if self._path.exists() else set()
        if not self.has(marker) and not all(name in ours or _is_unfinished(name, ours) for name in others):
            raise JobError(
                f"{self.url}: holds something, and no {kind}; give a new folder, or one of the same {kind}"
            )
        for name in sorted(ours & others):
            if (self._path / name).is_symlink():
                raise JobError(f"{self._path / name}: is a symbolic link; remove it or give another folder")
        for path in (*self._path.glob("*"), *(p for name in ours for p in (self._path / name).rglob("*"))):
            if _is_unfinished(path.name, ours):
                with suppress(OSError):
                    if time.time() - path.stat().st_mtime > _STALE:
                        path.unlink()


def _is_unfinished(name: str, ours: set[str]) -> bool:
    """True if a file has the temporary name of a task's file, or of one of a store's own."""
    match = _TEMPORARY.fullmatch(name)
    return match is not None and (match["name"] in ours or _KEY.fullmatch(match["name"]) is not None)


class _Objects(Store):
    """Objects of a service that fsspec knows; one that is half written is not there."""

    def __init__(self, place: str) -> None:
        super().__init__(place)
        try:
            import fsspec
        except ImportError:
            raise JobError(f"{place}: needs fsspec: pip install 'pymantaray[dask]'") from None
        protocol = place.partition("://")[0]
        if protocol not in _ATOMIC:
            raise JobError(
                f"{place}: {protocol} may show half a file; give a folder or one of {', '.join(_ATOMIC)}"
            )
        try:
            self._files, root = fsspec.url_to_fs(place)
        except (ImportError, ValueError) as error:
            raise JobError(f"{place}: cannot be opened: {str(error).partition(chr(10))[0]}") from None
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
        rest = iter(names)
        while some := list(islice(rest, _TOGETHER)):
            paths = {self._files._strip_protocol(str(self._root / name)): name for name in some}
            try:
                found = self._files.cat(list(paths), on_error="omit")
            except OSError as error:
                raise JobError(f"{self.url}: cannot be read: {error}") from None
            yield from ((paths[path], content) for path, content in found.items())

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

    def claim(self, kind: str, marker: str, ours: set[str]) -> None:
        pass


def read_valid(store: Store, name: str, parse: Callable[[bytes], T]) -> T | None:
    """Parsed content of a file; None if there is none, or a damaged one, which is removed with a warning."""
    content = store.read(name)
    if content is None:
        return None
    try:
        return parse(content)
    except (RecordError, ValueError) as error:
        _LOG.warning("%s/%s: %s; it is removed and computed again", store.url, name, error)
        store.remove(name)
        return None


def open_store(place: str | Path) -> Store:
    """Store of a folder's name or of a URL."""
    text = str(place)
    if "://" in text:
        return _Objects(text.rstrip("/"))
    return Store(os.path.realpath(text))  # which takes a circle of symbolic links as it is
