"""Where results are: a folder, or an object store by fsspec, of small files that are there whole or not at all."""

import json
import os
import time
import traceback
from collections.abc import Collection, Iterable
from contextlib import suppress
from pathlib import Path, PurePosixPath

from pymantaray.errors import MantaRayError, SweepError, WriteError
from pymantaray.records import whole_file

SWEEP, PLAN = "sweep.toml", "plan.json"
OURS, _PART = {SWEEP, PLAN, "points", "stages", "studies"}, ".part"
_ATOMIC = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "memory")  # an object is there when all of it is
_STALE = 3600.0  # age at which a file with a temporary name is of a process that was killed [s]


def point_name(key: str, *, failed: bool = False) -> str:
    """Name of a point's file."""
    return f"points/{key[:2]}/{key}{'.failed' if failed else ''}.json"


def stage_name(key: str, *, failed: bool = False) -> str:
    """Name of a shared stage's file."""
    return f"stages/{key}{'.failed.json' if failed else '.nc'}"


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
        self.folder: Path | None = None if "://" in place else Path(place).resolve()

    @property
    def _path(self) -> Path:
        assert self.folder is not None  # for the type checker
        return self.folder

    def has(self, name: str) -> bool:
        """Whether there is a file."""
        return (self._path / name).exists()

    def read(self, name: str) -> bytes | None:
        """Content of a file; None if there is none."""
        try:
            return (self._path / name).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise SweepError(f"{self._path / name}: cannot be read: {error.strerror}") from None

    def write(self, name: str, content: bytes) -> None:
        """Write a file, whole or not at all, in place of one of that name; raises `WriteError`."""
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
        """Remove a file if it is there."""
        with suppress(OSError):
            (self._path / name).unlink()

    def claim(self, kind: str, marker: str, ours: Collection[str]) -> None:
        """Refuse a place that holds something else, and remove what killed processes have left half written."""
        if self._path.exists() and not self._path.is_dir():
            raise SweepError(f"{self.url}: is a file; give a folder")
        others = {path.name for path in self._path.iterdir()} if self._path.exists() else set()
        if not self.has(marker) and not all(name in ours or name.endswith(_PART) for name in others):
            raise SweepError(
                f"{self.url}: holds something, and no {kind}; give a new folder, or one of the same {kind}"
            )
        for folder, _, files in os.walk(self._path):
            for path in (Path(folder, file) for file in files if file.endswith(_PART)):
                with suppress(OSError):
                    if time.time() - path.stat().st_mtime > _STALE:
                        path.unlink()


class _Objects(Store):
    """Objects of a service that fsspec knows; one that is half written is not there."""

    def __init__(self, place: str) -> None:
        super().__init__(place)
        try:
            import fsspec
        except ImportError:
            raise SweepError(f"{place}: needs fsspec: pip install 'pymantaray[dask]'") from None
        protocol = place.partition("://")[0]
        if protocol not in _ATOMIC:
            raise SweepError(
                f"{place}: {protocol} may show half a file; give a folder or one of {', '.join(_ATOMIC)}"
            )
        try:
            self._files, root = fsspec.url_to_fs(place)
        except (ImportError, ValueError) as error:
            raise SweepError(f"{place}: cannot be opened: {str(error).partition(chr(10))[0]}") from None
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
            raise SweepError(f"{self.url}/{name}: cannot be read: {error}") from None

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

    def claim(self, kind: str, marker: str, ours: Collection[str]) -> None:
        pass


def open_store(place: str | Path) -> Store:
    """Store of a folder's name or of a URL."""
    text = str(place)
    return _Objects(text.rstrip("/")) if "://" in text else Store(str(Path(text).resolve()))


def finished(store: Store, known: Iterable[str]) -> tuple[set[str], set[str]]:
    """Keys of points that are done and of points that have failed, among those that are known."""
    names = {name.removesuffix(".json") for name in store.names("points") if name.endswith(".json")}
    done = {key for key in known if key in names}
    return done, {key for key in known if f"{key}.failed" in names} - done
