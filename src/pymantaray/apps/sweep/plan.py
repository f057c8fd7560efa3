"""Plan of a sweep: its points, their shared stages, and the tasks that can start."""

import hashlib
import json
from collections import Counter
from collections.abc import Collection, Iterator
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from pymantaray.apps.sweep.definition import Sweep
from pymantaray.apps.sweep.keys import POINT, STAGES, task_keys
from pymantaray.apps.sweep.tasks import SweepTask
from pymantaray.config.door.study import build_study
from pymantaray.errors import MantaRayError, StudyError, SweepError
from pymantaray.installation import code_version
from pymantaray.jobs.keys import sha256
from pymantaray.jobs.pool import Queue

_MAX_FAULTS = 20  # in one message


class SweepPlan:
    """
    Keys of all tasks of a sweep.

    Raises
    ------
    SweepError
        If points are not valid studies or their input cannot be read, with one line each.
    """

    def __init__(self, sweep: Sweep) -> None:
        self.sweep = sweep
        checksums = dict[str, str]()
        bad: list[str] = []
        self.keys: list[dict[str, str]] = []
        """Keys of each point by the name of the stage."""
        for number in range(len(sweep)):
            try:
                study = build_study(sweep.point(number))
                for file in study.files:
                    if file not in checksums:
                        try:
                            checksums[file] = sha256(Path(file))
                        except OSError as error:
                            raise StudyError(f"{file}: cannot be read: {error.strerror}") from None
                self.keys.append(task_keys(study, checksums))
            except MantaRayError as error:
                bad.append(str(error).partition("\n")[0])
        if bad:
            rest = [f"and {len(bad) - _MAX_FAULTS} more"] if len(bad) > _MAX_FAULTS else []
            raise SweepError("\n".join([*dict.fromkeys(bad[:_MAX_FAULTS]), *rest]))

    @cached_property
    def points(self) -> dict[str, int]:
        """Number of a point by its key; equal points have one key."""
        out: dict[str, int] = {}
        for number, key in enumerate(self.keys):
            out.setdefault(key[POINT], number)
        return out

    @cached_property
    def shared(self) -> frozenset[str]:
        """Keys of stages that several points need."""
        uses = Counter(self.keys[n][stage] for n in self.points.values() for stage in STAGES)
        return frozenset(key for key, count in uses.items() if count > 1)

    def count(self, stage: str, points: Collection[str]) -> int:
        """Number of distinct instances of a stage that some points need."""
        return len({self.keys[self.points[key]][stage] for key in points})


def plan_content(plan: SweepPlan, toml: str) -> bytes:
    """
    Content of the file of a plan's keys, with which progress is counted without making the plan
    again.
    """
    content = {
        "sweep": hashlib.sha256(toml.encode()).hexdigest(),
        "version": code_version(),
        "keys": [key[POINT] for key in plan.keys],
    }
    return json.dumps(content).encode()


class Planned(NamedTuple):
    """Content of the file from `plan_content`."""

    sweep: str
    """Hash of the sweep's text."""
    version: str
    """Version of the code that made the plan."""
    keys: list[str]

    def is_of(self, toml: str) -> bool:
        """True if the keys belong to the sweep with this text."""
        return self.sweep == hashlib.sha256(toml.encode()).hexdigest()


def read_plan(content: bytes | None) -> Planned | None:
    """Read the file of a plan; None if it is missing or damaged."""
    try:
        tree = json.loads(content or b"")
        keys = [key for key in tree["keys"] if isinstance(key, str)]
        return Planned(str(tree["sweep"]), str(tree["version"]), keys)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


class SweepQueue(Queue):
    """
    Tasks of unfinished points, each issued when its stages exist.

    After a stage, the tasks that need it are issued before the next stage.
    """

    def __init__(
        self, plan: SweepPlan, open_points: set[str], *, keep_stages: bool, studies: bool
    ) -> None:
        self._plan = plan
        self._studies = studies
        self.keeps_stages = keep_stages
        self._lasting = frozenset(STAGES) if keep_stages else frozenset()
        self._what: dict[str, tuple[str, int]] = {}
        """Kind of each task, and the number of a point that needs it."""
        self._after: dict[str, list[str]] = {}
        """Tasks that need each stage."""
        self._points_left: Counter[str] = Counter()
        """Number of unfinished points that need each stage."""
        super().__init__(())
        for key, number in plan.points.items():
            if key in open_points:
                self._add(number)
        self._ready.reverse()
        self.left = len(self._what)

    def _add(self, number: int) -> None:
        before: str | None = None
        names = self._plan.keys[number]
        for kind in (*(stage for stage in STAGES if stage in self._shared(number)), POINT):
            key = names[kind]
            if key not in self._what:
                self._what[key] = kind, number
                (self._ready if before is None else self._after.setdefault(before, [])).append(key)
            if kind != POINT:
                self._points_left[key] += 1
            before = key

    def _shared(self, number: int) -> frozenset[str]:
        names = self._plan.keys[number]
        return self._lasting | {stage for stage in STAGES if names[stage] in self._plan.shared}

    def task(self, key: str) -> SweepTask:
        """Task to send to a worker."""
        kind, number = self._what[key]
        config = self._plan.sweep.point(number)
        return SweepTask(kind, self._plan.keys[number], config, self._shared(number), self._studies)

    def kind(self, key: str) -> str:
        """Kind of a task."""
        return self._what[key][0]

    def done(self, key: str) -> Iterator[str]:
        """Record that a task finished or failed; yields the stages that no other task needs."""
        self.left -= 1
        self._ready.extend(reversed(self._after.pop(key, [])))
        kind, number = self._what[key]
        if kind == POINT:
            names = self._plan.keys[number]
            for stage in STAGES:
                if names[stage] in self._points_left:
                    self._points_left[names[stage]] -= 1
                    if not self._points_left[names[stage]]:
                        yield names[stage]
