"""Files of a sweep: their names by point and stage, and reading of points with a result."""

import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from pymantaray.jobs.keys import has_checksum, with_checksum
from pymantaray.jobs.store import Store

_LOG = logging.getLogger("pymantaray.apps.sweep")
SWEEP = "sweep.toml"
PLAN = "plan.json"
SWEEP_ENTRIES = {SWEEP, PLAN, "points", "stages", "studies"}
DONE = "done"
FAILED = "failed"
Value = bool | int | float | str | None


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
