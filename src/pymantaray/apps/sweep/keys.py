"""Keys of tasks: hashes of everything that their results depend on."""

import fnmatch
from collections.abc import Mapping
from typing import Any

from pymantaray.config import StudyConfig
from pymantaray.jobs.keys import digest

OCEAN = "ocean"
FLEET = "fleet"
RAYS = "rays"
POINT = "point"
STAGES = (OCEAN, FLEET, RAYS)
"""Stages in order; points with equal keys of a stage share it."""
_READS = {
    OCEAN: ("ocean",),
    FLEET: (
        "fleet",
        "mission.duration_h",
        "mission.physics_step_s",
        "mission.sampling_period_s",
        "mission.schedule",
    ),
    RAYS: (
        "landmarks",
        "mission.ping_*",
        "acoustics",
        "ranging.timing",
        "ranging.turn_around_s",
        "detection",
    ),
}
_TITLES = ("name", "description")  # of a study; no result depends on them


LatestKeys = dict[str, tuple[list[Any], str]]
"""Sections that a stage reads and its key, for the latest configuration."""


def stage_fields(stage: str, config: StudyConfig) -> tuple[str, ...]:
    """Fields that a stage and the stages before it read."""
    before = STAGES[: STAGES.index(stage) + 1]
    first = ("mission.duration_h",) if config.ocean.time_varying else ()
    if FLEET in before and config.fleet.trajectories:  # trajectories also have samples at pings
        first = (*first, "mission.ping_*")
    names = (*first, *(field for name in before for field in _READS[name]))
    return tuple(key for name in names for key in _matching(name))


def _matching(field: str) -> list[str]:
    """Fields that match a pattern; a name without a star matches itself."""
    section, _, key = field.partition(".")
    if "*" not in key:
        return [field]
    known = StudyConfig.model_fields[section].annotation.model_fields  # type: ignore[union-attr]
    return [f"{section}.{name}" for name in fnmatch.filter(known, key)]


def stage_config(config: StudyConfig, stage: str) -> StudyConfig:
    """
    Configuration with only the fields that a stage reads, so its result cannot depend on others.
    """
    fields = stage_fields(stage, config)
    narrow = config.model_copy()
    for name in type(config).model_fields:
        inner = [field.partition(".")[2] for field in fields if field.partition(".")[0] == name]
        if not inner:
            del vars(narrow)[name]
        elif "" not in inner:
            section = getattr(config, name).model_copy()
            for key in set(type(section).model_fields) - set(inner):
                del vars(section)[key]
            vars(narrow)[name] = section
    return narrow


def task_keys(
    config: StudyConfig, checksums: Mapping[str, str], latest: LatestKeys | None = None
) -> dict[str, str]:
    """
    Keys of a study's stages and of its point, from its configuration and the checksums of its input
    files.

    Keys of stages in ``latest`` that were computed from the same objects are used again; the others
    replace them.
    """
    tree = config.model_dump(mode="json")
    out = dict[str, str]()
    latest = {} if latest is None else latest
    for stage in STAGES:
        fields = stage_fields(stage, config)
        read = [
            getattr(config, name) for name in {field.partition(".")[0]: None for field in fields}
        ]
        if stage not in latest or [*map(id, read)] != [*map(id, latest[stage][0])]:
            latest[stage] = (
                read,
                digest(stage, {field: _pick(tree, field) for field in fields}, checksums),
            )
        out[stage] = latest[stage][1]
    tree["study"] = {key: value for key, value in tree["study"].items() if key not in _TITLES}
    out[POINT] = digest(POINT, tree, checksums)
    return out


def _pick(tree: dict[str, Any], field: str) -> Any:
    section, _, key = field.partition(".")
    return tree[section][key] if key else tree[section]
