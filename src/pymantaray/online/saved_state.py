"""File of an estimator's state: one JSON document with a version and a checksum, written atomically."""

import hashlib
import json
from pathlib import Path
from typing import Any

from pymantaray.errors import OnlineError
from pymantaray.records.writing import whole_file
from pymantaray.user_files import read_text

KIND, FORMAT = "pymantaray online state", 1


def write_state(content: dict[str, Any], path: Path | str) -> None:
    """Write a state; numbers keep all digits."""
    text = json.dumps(content)
    head = {"kind": KIND, "format": FORMAT, "sha256": _checksum(text)}
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(head) + "\n" + text + "\n", encoding="utf-8")


def read_state(path: Path | str) -> dict[str, Any]:
    """Read a state."""
    lines = read_text(path, OnlineError, what="a saved estimator").splitlines()
    try:
        head = json.loads(lines[0])
        kind, version = head["kind"], head["format"]
    except (ValueError, IndexError, KeyError, TypeError):
        kind, version = None, None
    if kind != KIND:
        raise OnlineError(f"{path}: not a saved estimator; save one with OnlineEstimator.save")
    if version != FORMAT:
        raise OnlineError(f"{path}: format {version}; this version of pymantaray reads format {FORMAT}")
    if len(lines) != 2 or head.get("sha256") != _checksum(lines[1]):
        raise OnlineError(f"{path}: damaged: its content does not have its checksum; use an earlier file")
    content: dict[str, Any] = json.loads(lines[1])
    return content


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
