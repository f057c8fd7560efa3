"""Keys of tasks: hashes of everything that a result depends on."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from pymantaray.installation import code_version


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
    """Hash of everything that a task's result depends on, with checksums in place of file names."""
    content = {"kind": kind, "version": code_version(), "config": tree}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    for file, checksum in checksums.items():  # the content of a file counts, not its place
        text = text.replace(json.dumps(file), json.dumps(checksum))
    return hashlib.sha256(text.encode()).hexdigest()


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
