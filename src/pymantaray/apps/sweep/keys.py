"""
Keys of tasks, hashes of everything that their results depend on, and the files of a sweep by these
keys.
"""

import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from pymantaray.config.door.fleet import MissionFleet
from pymantaray.config.door.ocean import MissionOcean
from pymantaray.config.door.study import MissionRanging, Study
from pymantaray.entry_points import extension_keys
from pymantaray.jobs.keys import digest, has_checksum, values_of, with_checksum
from pymantaray.jobs.store import Store

OCEAN = "ocean"
FLEET = "fleet"
RAYS = "rays"
POINT = "point"
STAGES = (OCEAN, FLEET, RAYS)
"""Stages in order; points with equal keys of a stage share it."""
_TITLES = ("name", "description")  # of a study; no result depends on them


_PART: dict[str, Callable[[Study], MissionOcean | MissionFleet | MissionRanging]] = {
    OCEAN: lambda study: study.ocean,
    FLEET: lambda study: study.fleet,
    RAYS: lambda study: study.ranging,
}
"""Part of a study that a stage reads in addition to the results of the stages before it."""
_LOG = logging.getLogger("pymantaray.apps.sweep")
SWEEP = "sweep.toml"
PLAN = "plan.json"
SWEEP_ENTRIES = {SWEEP, PLAN, "points", "stages", "studies"}
DONE = "done"
FAILED = "failed"
Value = bool | int | float | str | None


def task_keys(study: Study, checksums: Mapping[str, str]) -> dict[str, str]:
    """
    Keys of a study's stages, from the parts that they read, and of its point, from all keys of its
    configuration and the entry points in use; each with the checksums of its input files.
    """
    out = dict[str, str]()
    before = ""
    for stage in STAGES:
        part = _PART[stage](study)
        own = [before, values_of(part)]
        if stage == OCEAN and study.ocean.varies_with_interpolation:
            own.append(study.sound.interpolation)
        before = digest(stage, own, {file: checksums[file] for file in part.files})
        out[stage] = before
    untitled = {key: value for key, value in study.tree["study"].items() if key not in _TITLES}
    point = [{**study.tree, "study": untitled}, extension_keys(study.sensors)]
    out[POINT] = digest(POINT, point, {file: checksums[file] for file in study.files})
    return out


def point_name(key: str, *, failed: bool = False) -> str:
    """Name of a point's file."""
    return f"points/{key[:2]}/{key}{'.failed' if failed else ''}.json"


def stage_name(key: str, *, failed: bool = False) -> str:
    """Name of a shared stage's file."""
    return f"stages/{key}{'.failed.json' if failed else '.nc'}"


class Point(BaseModel):
    """Content of a point's file."""

    key: str
    version: str
    notes: list[str]
    synthetic: bool = False
    conditions: dict[str, dict[str, Value]]
    links: dict[str, Value]
    seconds: dict[str, float]


class Failure(BaseModel):
    """Content of the file of a point that failed."""

    error: str
    traceback: str | None = None


parse_failure = Failure.model_validate_json
"""Read the content of the file of a failure; damaged content raises ValueError."""


def point_content(content: Mapping[str, Any]) -> bytes:
    """Content of a point's file, with a checksum."""
    return json.dumps(with_checksum(content), indent=1).encode()


def _parse_point(content: bytes) -> Point:
    tree = json.loads(content)
    point = Point.model_validate(tree)
    if not has_checksum(tree):
        raise ValueError("its content does not have its checksum")
    return point


_PARSE: dict[str, Callable[[bytes], BaseModel]] = {DONE: _parse_point, FAILED: parse_failure}


def read_points(
    store: Store, known: Iterable[str], *, discard: bool = False
) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """
    Key, status (`DONE` or `FAILED`) and content of those points that have a result.

    A damaged file, or one of another point, is not a result: a warning names it, and with
    ``discard`` it is removed.
    """
    there = store.names("points")
    known = list(known)
    done = {point_name(key): key for key in known if f"{key}.json" in there}
    failed = {point_name(key, failed=True): key for key in known if f"{key}.failed.json" in there}
    ended = set[str]()
    for names, status in ((done, DONE), (failed, FAILED)):
        for name, content in store.contents(names):
            key = names[name]
            try:
                tree = _PARSE[status](content).model_dump(exclude_unset=True)
            except (ValueError, RecursionError):
                tree = {"key": None}
            if tree.get("key", key) != key:
                remedy = (
                    "removed and computed again" if discard else "run the sweep again to replace it"
                )
                _LOG.warning("%s/%s: damaged or of another point; %s", store.url, name, remedy)
                if discard:
                    store.remove(name)
            elif key not in ended:
                ended.add(key)
                yield key, status, tree


def finished(
    store: Store, known: Iterable[str], *, discard: bool = False
) -> tuple[set[str], set[str]]:
    """Keys of finished points and of failed points among some known keys, as in `read_points`."""
    keys: dict[str, set[str]] = {DONE: set(), FAILED: set()}
    for key, status, _ in read_points(store, known, discard=discard):
        keys[status].add(key)
    return keys[DONE], keys[FAILED]
