"""Provenance of a run: versions, seeds, checksums, timings, memory, platform."""

import datetime as dt
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Hashable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from pymantaray.apps.study.references import Citations
from pymantaray.config.door.fleet import TrackFiles
from pymantaray.config.door.study import Study
from pymantaray.entry_points import extension_keys
from pymantaray.exchange import Tracks
from pymantaray.installation import peak_memory_mib, versions
from pymantaray.jobs.keys import sha256
from pymantaray.messages import without_secrets
from pymantaray.ocean.schema import latitude, longitude
from pymantaray.version import __version__

if TYPE_CHECKING:
    from pymantaray.apps.study.store import Run


class Stopwatch:
    """
    Wall-clock seconds of named stages in the order of their start, and the time at which the first
    began.
    """

    def __init__(self) -> None:
        self.began = dt.datetime.now(dt.UTC)
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time a block."""
        start = perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - start


def checksums(files: Iterable[str]) -> dict[str, str]:
    """SHA-256 of every input file, by file name."""
    return {file: sha256(Path(file)) for file in files}


def describe_run(
    study: Study,
    inputs: dict[str, str],
    watch: Stopwatch,
    *,
    references: Citations,
    ocean: Mapping[Hashable, Any],
    workers: int,
    worker_memory_mib: float,
) -> dict[str, Any]:
    """
    Content of a manifest: everything that results depend on, and their cost; ``ocean`` has the
    local ocean's attributes.
    """
    existing = study.fleet.existing
    used = extension_keys(study.sensors)
    return {
        "study": study.name,
        "made": {"began": f"{watch.began:%Y-%m-%dT%H:%M:%SZ}", "command": _command()},
        "ocean": {
            "source": [without_secrets(source) for source in study.ocean.source],
            "synthetic": bool(ocean["synthetic"]),
            "time_varying": study.ocean.time_varying,
            "sha256": inputs,
            "notes": ocean_notes(ocean),
        },
        **({} if existing is None else {"fleet": _own_fleet(existing, study, ocean)}),
        "random": {
            "seed": study.seed,
            "realizations": study.realizations,
            "generator": "PCG64, one stream a realization, vehicle and sensor, by name",
        },
        "versions": {
            **{key["package"]: key["version"] for key in used},
            "pymantaray": __version__,
            "git_commit": git_commit(),
            **versions(),
        },
        **({"extensions": used} if used else {}),
        "machine": {
            "platform": platform.platform(),
            "processor": platform.machine(),
            "cores": os.cpu_count(),
            "workers": workers,
        },
        "references": [str(reference) for reference in references],
        "seconds": {name: round(value, 3) for name, value in watch.seconds.items()},
        "peak_memory_mib": {"main": peak_memory_mib(), "largest_worker": worker_memory_mib},
    }


def _command() -> str | None:
    """Command line if this process is `mantaray`; None for a script or a notebook."""
    return (
        shlex.join(["mantaray", *map(without_secrets, sys.argv[1:])])
        if Path(sys.argv[0]).stem == "mantaray"
        else None
    )


def ocean_notes(ocean: Mapping[Hashable, Any]) -> list[str]:
    """Notes of the readers of an ocean, from the attributes of the local ocean."""
    return str(ocean.get("notes", "")).splitlines()


def centre_note(
    centre: tuple[float, float] | None, ocean: Mapping[Hashable, Any], tracks: Tracks
) -> str | None:
    """
    Message with the centre of the frame of local positions; None if a file gives it, or the study
    by ``centre``. [degrees]
    """
    if tracks.geodetic or centre is not None or tracks.centre is not None:
        return None
    if "centre_latitude_deg" not in ocean:
        return None  # the water is the same everywhere
    lat = float(ocean["centre_latitude_deg"])
    lon = float(ocean["centre_longitude_deg"])
    return (
        f"{tracks.poses[0].file}: positions are local and no file gives the centre of their frame;"
        f" the middle of the ocean is used, {latitude(lat)}, {longitude(lon)}; for another centre"
        " give `centre` (in a study: ocean.centre_lat and ocean.centre_lon)"
    )


def fleet_notes(study: Study, ocean: Mapping[Hashable, Any]) -> list[str]:
    """Notes of the readers of existing trajectories."""
    existing = study.fleet.existing
    if existing is None:
        return []
    note = centre_note(study.ocean.centre, ocean, existing.tracks)
    return [*existing.tracks.notes, *([note] if note else [])]


def estimator_notes(run: "Run") -> list[str]:
    """Notes of the readers of files that estimators assume."""
    if not any(condition.files for condition in run.study.conditions):
        return []
    from pymantaray.config.door.beliefs import Beliefs

    return Beliefs(run).notes()


def _own_fleet(existing: TrackFiles, study: Study, ocean: Mapping[Hashable, Any]) -> dict[str, Any]:
    """Source of a fleet's trajectories, their start, and changes or assumptions made on reading."""
    start = existing.tracks.start
    return {
        "trajectories": list(existing.files),
        "start": None if start is None else str(start),
        "notes": fleet_notes(study, ocean),
    }


def git_commit() -> str | None:
    """
    Commit of the package's checkout, ``-dirty`` if files differ from it; None without checkout or
    git.
    """
    root = Path(__file__).resolve().parents[3]
    if not (root / ".git").exists():
        return None
    try:
        done = subprocess.run(
            [
                "git",
                "-C",
                str(root),
                "describe",
                "--always",
                "--dirty",
                "--abbrev=40",
                "--exclude=*",
            ],
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
