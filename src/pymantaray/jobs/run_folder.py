"""Folder of a run: names of its files, and its manifest."""

import json
from pathlib import Path
from typing import Any

from pymantaray.errors import StudyError
from pymantaray.jobs.folder import MANIFEST
from pymantaray.messages import one_line
from pymantaray.user_files import read_text

FORMAT = 4
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


def read_manifest(folder: Path) -> dict[str, Any]:
    """
    Read the manifest of a run.

    Raises
    ------
    StudyError
        If it cannot be read.
    """
    try:
        content = json.loads(read_text(folder / MANIFEST, StudyError, what="a manifest"))
    except (ValueError, RecursionError) as error:
        raise StudyError(
            f"{folder / MANIFEST}: not a readable manifest: {one_line(error)}"
        ) from None
    if not isinstance(content, dict):
        raise StudyError(f"{folder / MANIFEST}: not a readable manifest: it is not a table")
    return content


def checked_manifest(folder: str | Path) -> dict[str, Any]:
    """
    Read the manifest of a folder that a user names.

    Raises
    ------
    StudyError
        If the folder is not a run of this version's format.
    """
    path = Path(folder)
    if not (path / MANIFEST).is_file():
        raise StudyError(f"{folder}: not a run folder: it has no {MANIFEST}")
    manifest = read_manifest(path.resolve())
    if (number := manifest.get("format")) != FORMAT:
        raise StudyError(f"{folder}: run format {number!r}; this version reads format {FORMAT}")
    for key in ("versions", "seconds"):
        if not isinstance(manifest.get(key), dict):
            raise StudyError(f"{path / MANIFEST}: damaged: it has no table {key!r}; run it again")
    return manifest
