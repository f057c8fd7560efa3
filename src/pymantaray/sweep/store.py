"""Where results are: a folder, or an object store by fsspec, of small files that are there whole or not at all."""

import os
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Protocol

from pymantaray.errors import SweepError, WriteError
from pymantaray.records import whole_file

SWEEP, PLAN = "sweep.toml", "plan.json"
_ATOMIC = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "memory")  # an object is there when all of it is
_STALE = 3600.0  # age at which a file with a temporary name is of a process that was killed [s]


def point_name(key: str, *, failed: bool = False) -> str:
    """Name of a point's file."""
    return f"points/{key[:2]}/{key}{'.failed' if failed else ''}.json"


def stage_name(key: str, *, failed: bool = False) -> str:
    """Name of a shared stage's file."""
    return f"stages/{key}{'.failed.json' if failed else '.nc'}"


class Store(Protocol):
    """Named files."""

    url: str

    @property
    def folder(self) -> Path | None:
        """Where it is, None for an object store."""

    def has(self, name: str) -> bool:
        """Whether there is a file."""

    def read(self, name: str) -> bytes | None:
        """Content of a file; None if there is none."""

    def write(self, name: str, content: bytes) -> None:
        """Write a file, whole or not at all, in place of one of that name; raises `WriteError`."""

    def names(self, folder: str) -> set[str]:
        """Names, without folders, of all files below a folder."""

    def remove(self, name: str) -> None:
        """Remove a file if it is there."""

    def tidy(self) -> None:
        """Remove what processes that were killed have left half written."""


class _Folder:
    """A folder of this machine, or one that machines share."""

    def __init__(self, folder: Path) -> None:
        self._folder, self.url = folder, str(folder)

    @property
    def folder(self) -> Path:
        return self._folder

    def has(self, name: str) -> bool:
        return (self.folder / name).exists()

    def read(self, name: str) -> bytes | None:
        try:
            return (self.folder / name).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise SweepError(f"{self.folder / name}: cannot be read: {error.strerror}") from None

    def write(self, name: str, content: bytes) -> None:
        path = self.folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise WriteError(f"{path.parent}: cannot be written: {error.strerror}") from None
        with whole_file(path) as temporary:
            temporary.write_bytes(content)

    def names(self, folder: str) -> set[str]:
        out: set[str] = set()
        for _, _, files in os.walk(self.folder / folder):
            out.update(files)
        return out

    def remove(self, name: str) -> None:
        with suppress(OSError):
            (self.folder / name).unlink()

    def tidy(self) -> None:
        for folder, _, files in os.walk(self.folder):
            for file in files:
                path = Path(folder, file)
                with suppress(OSError):
                    if path.suffix == ".part" and time.time() - path.stat().st_mtime > _STALE:
                        path.unlink()


class _Objects:
    """Objects of a service that fsspec knows."""

    def __init__(self, url: str) -> None:
        try:
            import fsspec
        except ImportError:
            raise SweepError(f"{url}: needs fsspec: pip install 'pymantaray[dask]'") from None
        protocol = url.partition("://")[0]
        if protocol not in _ATOMIC:
            raise SweepError(
                f"{url}: {protocol} may show half a file; give a folder or one of {', '.join(_ATOMIC)}"
            )
        try:
            self._files, root = fsspec.url_to_fs(url)
        except (ImportError, ValueError) as error:
            raise SweepError(f"{url}: cannot be opened: {str(error).partition(chr(10))[0]}") from None
        self.url, self._root = url, PurePosixPath(root)

    @property
    def folder(self) -> None:
        return None

    def has(self, name: str) -> bool:
        self._files.invalidate_cache()
        there: bool = self._files.exists(str(self._root / name))
        return there

    def read(self, name: str) -> bytes | None:
        try:
            content: bytes = self._files.cat_file(str(self._root / name))
        except FileNotFoundError:
            return None
        except OSError as error:
            raise SweepError(f"{self.url}/{name}: cannot be read: {error}") from None
        return content

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

    def tidy(self) -> None:
        """Leave all as it is: an object that is half written is not there."""


def open_store(place: str | Path) -> Store:
    """Store of a folder's name or of a URL."""
    text = str(place)
    if "://" in text:
        return _Objects(text.rstrip("/"))
    return _Folder(Path(text).resolve())


def finished(store: Store, known: Iterable[str]) -> tuple[set[str], set[str]]:
    """Keys of points that are done and of points that have failed, among those that are known."""
    names = {name.removesuffix(".json") for name in store.names("points") if name.endswith(".json")}
    done = {key for key in known if key in names}
    return done, {key for key in known if f"{key}.failed" in names} - done
