"""Keys of tasks: hashes of everything that their results depend on."""

from collections.abc import Mapping
from typing import Any

from pymantaray.config.build.study import Study
from pymantaray.jobs.keys import digest, values_of

OCEAN = "ocean"
FLEET = "fleet"
RAYS = "rays"
POINT = "point"
STAGES = (OCEAN, FLEET, RAYS)
"""Stages in order; points with equal keys of a stage share it."""
_TITLES = ("name", "description")  # of a study; no result depends on them

LatestKeys = dict[str, tuple[tuple[Any, ...], str]]
"""Parts of a study that a stage reads and its key, for the latest study."""


def stage_parts(study: Study, stage: str) -> tuple[Any, ...]:
    """Parts of a study that a stage and the stages before it read."""
    return (study.ocean, study.fleet, study.ranging)[: STAGES.index(stage) + 1]


def task_keys(
    study: Study, checksums: Mapping[str, str], latest: LatestKeys | None = None
) -> dict[str, str]:
    """
    Keys of a study's stages, from the parts that they read, and of its point, from all keys of its
    configuration; each with the checksums of the input files.

    Keys of stages in ``latest`` that were computed from the same objects are used again; the others
    replace them.
    """
    out = dict[str, str]()
    latest = {} if latest is None else latest
    for stage in STAGES:
        parts = stage_parts(study, stage)
        if stage not in latest or any(
            one is not other for one, other in zip(parts, latest[stage][0], strict=True)
        ):
            latest[stage] = parts, digest(stage, values_of(parts), checksums)
        out[stage] = latest[stage][1]
    own = {key: value for key, value in study.tree["study"].items() if key not in _TITLES}
    out[POINT] = digest(POINT, {**study.tree, "study": own}, checksums)
    return out
