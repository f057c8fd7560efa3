"""Answers of servers kept on disk, each under its request and with a checksum."""

import hashlib
import json
import os
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from pymantaray.errors import OceanError

FOLDER_VARIABLE = "MANTARAY_CACHE"
LARGEST_BYTES = 4 * 2**30  # of all entries together; the oldest go first
_SUFFIX = ".answer"
_LONGEST_HEADER = 1 << 16  # bytes


def cache_folder(folder: str | Path | None = None) -> Path:
    """
    Folder of the cache.

    Parameters
    ----------
    folder : str or Path, optional
        By default that of the environment variable MANTARAY_CACHE, else the platform's place for caches.

    Returns
    -------
    pathlib.Path
    """
    if folder is not None:
        return Path(folder)
    if given := os.environ.get(FOLDER_VARIABLE):
        return Path(given)
    if sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        given = os.environ.get("XDG_CACHE_HOME", "")
        base = Path(given) if Path(given).is_absolute() else Path.home() / ".cache"
    return base / "mantaray" / "ocean"


class Cache:
    """
    Bytes by request; an entry that is not exactly what was stored counts as none.

    An entry is a line of JSON (request, size, SHA-256) followed by the bytes. It is written under a
    temporary name and renamed, so that a killed process leaves no half entry.

    Parameters
    ----------
    folder : str or Path, optional
        See `cache_folder`.
    largest_bytes : int, optional
        Size of all entries together beyond which the oldest are removed.
    """

    def __init__(self, folder: str | Path | None = None, largest_bytes: int = LARGEST_BYTES) -> None:
        self.folder = cache_folder(folder)
        self.largest_bytes = largest_bytes

    def get(self, request: Mapping[str, object], oldest_s: float | None = None) -> bytes | None:
        """
        Bytes stored for a request.

        Parameters
        ----------
        request : mapping
            What was asked for; JSON can write it.
        oldest_s : float, optional
            Age beyond which an entry counts as none. [s]

        Returns
        -------
        bytes or None
            None if there is no entry; a corrupt one is removed.
        """
        path = self._path(request)
        try:
            if oldest_s is not None and time.time() - path.stat().st_mtime > oldest_s:
                return None
            with path.open("rb") as stream:
                header = stream.readline(_LONGEST_HEADER)
                body = stream.read()
        except OSError:
            return None
        if header == _header(request, body):
            return body
        self.remove(request)
        return None

    def put(self, request: Mapping[str, object], body: bytes) -> None:
        """
        Store bytes for a request.

        Parameters
        ----------
        request : mapping
        body : bytes

        Raises
        ------
        OceanError
            If the folder cannot be written.
        """
        path = self._path(request)
        temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            try:
                with temporary.open("wb") as stream:
                    stream.write(_header(request, body))
                    stream.write(body)
                    stream.flush()
                    os.fsync(stream.fileno())
                temporary.replace(path)
            finally:
                temporary.unlink(missing_ok=True)
        except OSError as error:
            raise OceanError(
                f"{self.folder}: cannot be written ({error.strerror}); name another cache folder"
            ) from None

    def remove(self, request: Mapping[str, object]) -> None:
        """
        Remove the entry of a request, if there is one.

        Parameters
        ----------
        request : mapping
        """
        with suppress(OSError):
            self._path(request).unlink(missing_ok=True)

    def prune(self) -> None:
        """Remove the oldest entries while all together are larger than allowed, and what killed processes left."""
        entries = []
        for path in self.folder.glob(f"*{_SUFFIX}*"):
            with suppress(OSError):
                status = path.stat()
                if path.name.endswith(".part"):
                    if time.time() - status.st_mtime > 86400.0:
                        path.unlink()
                else:
                    entries.append((status.st_mtime, status.st_size, path))
        total = sum(size for _, size, _ in entries)
        for _, size, path in sorted(entries):
            if total <= self.largest_bytes:
                return
            with suppress(OSError):
                path.unlink()
                total -= size

    def _path(self, request: Mapping[str, object]) -> Path:
        return self.folder / f"{hashlib.sha256(_canonical(request)).hexdigest()[:40]}{_SUFFIX}"


def _canonical(request: Mapping[str, object]) -> bytes:
    return json.dumps(request, sort_keys=True, separators=(",", ":")).encode()


def _header(request: Mapping[str, object], body: bytes) -> bytes:
    parts = {"request": request, "bytes": len(body), "sha256": hashlib.sha256(body).hexdigest()}
    return _canonical(parts) + b"\n"
