"""Folder of a run: names of its files, and its manifest with their checksums."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pymantaray.errors import StudyError, WriteError
from pymantaray.jobs.folder import MANIFEST, write_json
from pymantaray.jobs.keys import CHECKSUM, has_checksum, sha256, with_checksum
from pymantaray.messages import one_line
from pymantaray.user_files import read_text

FORMAT = 5
"""Format of run folders."""
CONFIG = "config.toml"
OCEAN = "ocean.nc"
PROFILE = "profile.nc"
REGION = "region.csv"
TRUTH = "truth.nc"
LINKS = "links.nc"
ARRIVALS = "arrivals.nc"
MEASUREMENTS = "measurements.nc"
RANGING_TRUTH = "ranging_truth.nc"
HEARING = "hearing.nc"
ESTIMATES = "estimates.nc"
COVARIANCES = "covariances.nc"
UNKNOWNS = "unknowns.nc"
CANDIDATES = "candidates.nc"
RAY_PICTURE = "ray_picture.nc"
RANGING_DRAWS = "ranging_draws.nc"
PYFG = "pyfg"
_REMEDY = "restore it from a copy, or run the study again in a new folder"


def write_manifest(content: Mapping[str, Any], folder: Path) -> None:
    """Write the manifest of a run with the checksums of all files in its folder."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    try:
        files = {path.relative_to(folder).as_posix(): sha256(path) for path in paths}
    except OSError as error:
        raise WriteError(
            f"{error.filename or folder}: cannot be read back: {error.strerror}"
        ) from None
    write_json(with_checksum({"format": FORMAT, **content, "files": files}), folder / MANIFEST)


def without_checksums(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a manifest without checksums of the run's files, for people."""
    return {name: value for name, value in manifest.items() if name not in ("files", CHECKSUM)}


def checked_file(folder: Path, manifest: Mapping[str, Any], name: str) -> Path:
    """
    Return the path of a file of a run.

    Raises
    ------
    StudyError
        If its content does not have its checksum in the manifest.
    """
    path = folder / name
    if not path.is_file():
        raise StudyError(f"{path}: missing or not a regular file; {_REMEDY}")
    try:
        is_whole = sha256(path) == manifest["files"].get(name)
    except OSError as error:
        raise StudyError(f"{path}: cannot be read: {error.strerror}; {_REMEDY}") from None
    if not is_whole:
        raise StudyError(
            f"{path}: damaged: its content does not have its checksum in {MANIFEST}; {_REMEDY}"
        )
    return path


def checked_manifest(folder: str | Path) -> dict[str, Any]:
    """
    Read the manifest of the folder of a finished run.

    Raises
    ------
    StudyError
        If the folder is not a run of this version's format, or the manifest is damaged.
    """
    path = Path(folder)
    if not (path / MANIFEST).is_file():
        raise StudyError(f"{folder}: not a run folder: it has no {MANIFEST}")
    file = path.resolve() / MANIFEST
    try:
        manifest = json.loads(read_text(file, StudyError, what="a manifest"))
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{file}: not a readable manifest: {one_line(error)}; {_REMEDY}") from None
    if not isinstance(manifest, dict):
        raise StudyError(f"{file}: not a readable manifest: it is not a table; {_REMEDY}")
    if (number := manifest.get("format")) != FORMAT:
        raise StudyError(f"{folder}: run format {number!r}; this version reads format {FORMAT}")
    if not has_checksum(manifest):
        raise StudyError(
            f"{path / MANIFEST}: damaged: its content does not have its checksum; {_REMEDY}"
        )
    return manifest
