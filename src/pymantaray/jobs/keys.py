"""Keys of tasks: hashes of everything that a result depends on."""

import hashlib
import json
import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from pymantaray.errors import JobError
from pymantaray.installation import code_version

_RECENT = 2.0  # s; above the resolution of a file system's times
CHECKSUM = "sha256"
"""Key of the checksum of a JSON object."""


def values_of(thing: Any) -> Any:
    """
    Values of an object as for JSON, by field for data classes, named tuples and sections.

    An object of another type is refused, so that no key lacks a value.
    """
    if isinstance(thing, BaseModel):
        return thing.model_dump(mode="json")
    if is_dataclass(thing) and not isinstance(thing, type):
        own = {field.name: values_of(getattr(thing, field.name)) for field in fields(thing)}
        return {"type": type(thing).__name__, **own}
    if isinstance(thing, tuple) and hasattr(thing, "_asdict"):
        return values_of(thing._asdict())
    if isinstance(thing, Mapping):
        return {name: values_of(value) for name, value in thing.items()}
    if isinstance(thing, tuple | list):
        return [values_of(value) for value in thing]
    if isinstance(thing, np.ndarray | np.generic):
        return str(thing) if isinstance(thing, np.datetime64) else values_of(thing.tolist())
    if thing is None or isinstance(thing, str | bool | int):
        return thing
    if isinstance(thing, float):
        return thing if math.isfinite(thing) else str(thing)
    raise TypeError(f"a key cannot contain an object of type {type(thing).__name__}")


def digest(kind: str, tree: Any, checksums: Mapping[str, str]) -> str:
    """
    Hash of everything that a task's result depends on: its kind, the code, a tree of values, and
    the checksums of the files that it reads, which replace their names in the tree.
    """
    content = {"kind": kind, "version": code_version(), "config": tree}
    content["files"] = [*checksums.values()]  # of those that the tree does not name as well
    text = json.dumps(content, sort_keys=True, allow_nan=False)
    for file, checksum in checksums.items():  # the content of a file counts, not its place
        text = text.replace(json.dumps(file), json.dumps(checksum))
    return hashlib.sha256(text.encode()).hexdigest()


class FileChecksums:
    """Checksums of input files in memory; a file that changes is read again."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[str, str]] = {}

    def of(self, files: Iterable[str]) -> dict[str, str]:
        """Checksum of each file by its name."""
        return {file: self._checksum(file) for file in files}

    def _checksum(self, file: str) -> str:
        try:
            stamp = file_stamp(Path(file))
            if self._known.get(file, ("",))[0] != stamp:
                self._known[file] = stamp, sha256(Path(file))
        except OSError as error:
            raise JobError(f"{file}: cannot be read: {error.strerror}") from None
        return self._known[file][1]


def file_stamp(path: Path) -> str:
    """
    Text that changes with the content of a file, or of any file in a folder.

    The times of a file that changed a moment ago may not tell a later change; its content is read.
    """
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file())
        return "".join(f"{file} {file_stamp(file)}\n" for file in files)
    state = path.stat()
    if time.time() - max(state.st_mtime, state.st_ctime) < _RECENT:
        return sha256(path)
    return f"{state.st_ino} {state.st_size} {state.st_mtime_ns} {state.st_ctime_ns}"


def with_checksum(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Plain values of a tree, NumPy scalars as numbers, and the checksum of their JSON."""
    plain: dict[str, Any] = json.loads(json.dumps(tree, default=lambda scalar: scalar.item()))
    return {**plain, CHECKSUM: _tree_checksum(plain)}


def has_checksum(tree: Mapping[str, Any]) -> bool:
    """True if a tree has its checksum from `with_checksum`."""
    return bool(tree.get(CHECKSUM) == _tree_checksum(tree))


def _tree_checksum(tree: Mapping[str, Any]) -> str:
    content = {name: value for name, value in tree.items() if name != CHECKSUM}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def sha256(path: Path) -> str:
    """
    Checksum of a file or of a folder (a zarr store).

    That of a folder is the checksum of the sorted output of ``sha256sum`` for its files.
    """
    if path.is_dir():
        names = sorted(
            file.relative_to(path).as_posix() for file in path.rglob("*") if file.is_file()
        )
        lines = "".join(f"{sha256(path / name)}  {name}\n" for name in names)
        return hashlib.sha256(lines.encode()).hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
