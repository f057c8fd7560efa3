"""Keys of tasks: hashes of everything that a result depends on."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pymantaray.installation import code_version


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
