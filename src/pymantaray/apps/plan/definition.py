"""
Definition of a plan: a base study, its free keys with their values or limits, oceans, costs and
objectives.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveInt

from pymantaray.apps.sweep import Sweep
from pymantaray.config import StudyConfig, load_study
from pymantaray.config.common import Hours, Section
from pymantaray.config.estimators import PerturbedBelief
from pymantaray.config.load import PLAN, plan_tree
from pymantaray.config.parse import parse
from pymantaray.entry_points import extension_keys
from pymantaray.errors import MantaRayError, PlanError
from pymantaray.jobs.keys import FileChecksums, digest
from pymantaray.ocean.environment import files_of
from pymantaray.records.digits import counted
from pymantaray.user_files import exists

Objective = Literal["error", "lost", "heard_by_two", "cost"]
Design = Mapping[str, Any]
"""Value of each free key."""
_RANGE = ("from", "to", "count")
_MAX_DESIGNS = 100_000


class FreeRange(NamedTuple):
    """Limits of a free number that the search varies continuously."""

    low: float
    high: float

    def at(self, key: str, value: float) -> dict[str, float]:
        """Values of a design by key."""
        return {key: value}


class FreeLine(NamedTuple):
    """
    Line between two tables of numbers, such as positions; the search varies the share of its
    length.
    """

    start: Mapping[str, float]
    stop: Mapping[str, float]

    @property
    def low(self) -> float:
        """Share at the start."""
        return 0.0

    @property
    def high(self) -> float:
        """Share at the end."""
        return 1.0

    def at(self, key: str, share: float) -> dict[str, float]:
        """Values of a design by key, rounded to a millionth of the line."""
        return {
            f"{key}.{name}": round(end, 6)
            for name in self.start
            for end in [self.start[name] + share * (self.stop[name] - self.start[name])]
        }


class LinePoints(list[dict[str, float]]):
    """Points of a line at equal steps, each with its values by key."""


class CostSection(Section):
    """Costs, in any unit, which are added up."""

    station: NonNegativeFloat = 0.0
    """Cost of each vehicle that keeps its station. [-]"""
    landmark: NonNegativeFloat = 0.0
    """Cost of each landmark. [-]"""
    ping: NonNegativeFloat = 0.0
    """Cost of each transmission of a ping. [-]"""
    cast: NonNegativeFloat = 0.0
    """Cost of the cast that a condition with ``belief = { kind = "cast" }`` needs. [-]"""


class PerturbedWaters(PerturbedBelief):
    """
    Ensemble of true waters: each ocean with random errors in its vertical modes, as for a perturbed
    belief.

    Assumed waters start from the perturbed water. ``{ kind = "file" }`` with the source of the
    ocean assumes the unperturbed one.
    """

    kind: Literal["perturbed"] = "perturbed"
    """The ocean with random errors."""
    members: PositiveInt = 10
    """Number of waters for each ocean."""


class PlanSection(Section):
    """Section ``[plan]`` of a study file: what is free, and what a good design is."""

    free: dict[str, Any] = Field(min_length=1)
    """
    Free keys of the study: a list of values, or ``{ from = 20, to = 500 }`` with an optional
    ``count`` of equal steps.
    """
    objectives: tuple[Objective, ...] = Field(default=("error", "lost"), strict=False, min_length=1)
    """Objectives; the first one decides which design is the best."""
    condition: str | None = None
    """Condition of the study whose errors are computed. Default: the last one."""
    error_of: str | None = None
    """Vehicle whose position error counts. Default: all vehicles."""
    error_at_h: tuple[Hours[NonNegativeFloat], ...] | None = Field(
        default=None, strict=False, min_length=1
    )
    """Times at which the position error counts, rounded to samples. Default: all pings. [h]"""
    lost_of: str | None = None
    """Vehicle or landmark whose links count as lost or not. Default: all links."""
    oceans: tuple[dict[str, Any], ...] = Field(default=({},), strict=False, min_length=1)
    """Possible oceans: a table of keys of ``[ocean]`` for each, over those of the study."""
    perturbed: PerturbedWaters | None = None
    """Random errors of each ocean. Default: the oceans as they are."""
    ranked_by: Literal["mean", "worst-tenth"] = "mean"
    """
    Value over the ensemble that decides which design is the best: the mean, or the mean of the
    worst tenth.
    """
    costs: CostSection = CostSection()
    """Costs of a design."""
    evaluations: PositiveInt = 40
    """
    Largest number of designs that the search of continuous ranges evaluates, for each objective and
    each combination of listed values: at least 10, and at least two for each range.
    """


class PlanFile(Section):
    """Part of a plan file that is not the study."""

    plan: PlanSection
    """Free keys and objectives."""


@dataclass(frozen=True, eq=False)
class DeploymentPlan:
    """
    A base study, its free keys, and what a good design is.

    Parameters
    ----------
    base : StudyConfig
        Study that all designs change.
    section : PlanSection
        Section ``[plan]``.
    source : str
        Preset or file of the base.
    folder : pathlib.Path
        Folder to which files among the values are relative.

    Raises
    ------
    PlanError
        If a free key, a range, a name or an ocean does not fit the study.

    Examples
    --------
    Continues the example of `pymantaray.apps.plan`:

    >>> from pymantaray.apps.plan import DeploymentPlan, PlanSection
    >>> section = PlanSection(free={"landmarks.T.depth": {"from": 5, "to": 25, "count": 3}})
    >>> plan = DeploymentPlan(load_study("quick", landmarks=[receiver]), section)
    >>> plan.size, plan.lists_at(1)
    (3, {'landmarks.T.depth': 15.0})
    """

    base: StudyConfig
    section: PlanSection
    source: str = "study"
    folder: Path = Path()

    def __post_init__(self) -> None:
        """Check names, ranges and the first and last design in every ocean."""
        section = self.section
        vehicles = [v.name for v in self.base.fleet.vehicles]
        names = {
            "condition": [c.name for c in self.base.conditions],
            "error_of": vehicles,
            "lost_of": [*vehicles, *(mark.name for mark in self.base.landmarks)],
        }
        for key, allowed in names.items():
            value = getattr(section, key)
            if value is not None and value not in allowed and allowed:
                raise PlanError(
                    f"{self.source}: plan.{key}: found {value!r}; allowed:"
                    f" {', '.join(map(str, allowed))}"
                )
        if not self.base.conditions:
            raise PlanError(
                f"{self.source}: conditions: the study has none; a plan needs at least one"
            )
        if self.size > _MAX_DESIGNS:
            raise PlanError(
                f"{self.source}: plan.free: {self.size:,} combinations; at most {_MAX_DESIGNS:,}"
                " are allowed, give shorter lists or ranges without count"
            )
        least = 2 * max(5, len(self.ranges))  # a first population and one generation
        if self.ranges and section.evaluations < least:
            raise PlanError(
                f"{self.source}: plan.evaluations: found {section.evaluations}; the search of"
                f" {counted(len(self.ranges), 'range')} needs at least {least}"
            )
        ends = [{**self.lists_at(k), **self.ends(high=k != 0)} for k in (0, self.size - 1)]
        for design, ocean in product(ends, range(len(section.oceans))):
            study = self.study(design, ocean)
            self._check(study.mission.duration_h, varies=study.ocean.time_varying)

    def _check(self, hours: float, *, varies: bool) -> None:
        """Refuse times after the mission, and perturbations of an ocean that varies."""
        for time in self.section.error_at_h or ():
            if time > hours:
                raise PlanError(
                    f"{self.source}: plan.error_at_h: found {time:g}; allowed: 0 to {hours:g}, the"
                    " duration of the mission"
                )
        if self.section.perturbed is not None and varies:
            raise PlanError(
                f"{self.source}: plan.perturbed: the ocean varies in time; set ocean.time_varying"
                " to false, or remove it"
            )

    @property
    def waters(self) -> list[tuple[int, int | None]]:
        """Waters of the ensemble: the number of the ocean, and that of the perturbation or None."""
        perturbed = self.section.perturbed
        members = [None] if perturbed is None else range(perturbed.members)
        return list(product(range(len(self.section.oceans)), members))

    @property
    def fingerprint(self) -> str:
        """Hash of everything that scores of designs depend on now, with the content of files."""
        content = {
            "study": self.base.model_dump(mode="json"),
            "plan": self.section.model_dump(mode="json"),
            "extensions": extension_keys(self.base.mission.sensors),
            "folder": str(self.folder.absolute()),
        }
        return digest("plan", content, FileChecksums().of(self.files))

    @property
    def files(self) -> tuple[str, ...]:
        """Existing files of the study, of possible oceans, and among the values of free keys."""
        oceans = range(len(self.section.oceans))
        named = [file for ocean in oceans for file in self.study({}, ocean).files]
        for text in _texts(self.section.free):
            named += files_of(self.folder.absolute() / text) if exists(self.folder / text) else []
        return tuple(dict.fromkeys(file for file in (*self.base.files, *named) if exists(file)))

    @cached_property
    def _free(self) -> dict[str, Any]:
        return _flat(self.section.free, self.source)

    @cached_property
    def ranges(self) -> dict[str, FreeRange | FreeLine]:
        """Limits of the free keys that the search varies continuously."""
        return {
            key: value
            for key, value in self._free.items()
            if isinstance(value, FreeRange | FreeLine)
        }

    @cached_property
    def lists(self) -> dict[str, list[Any]]:
        """
        Values of the free keys that have a list or a count; those of a line are positions of the
        design by key.
        """
        return {key: value for key, value in self._free.items() if key not in self.ranges}

    @property
    def keys(self) -> list[str]:
        """Keys of a design in the order of the file."""
        return [
            inner
            for key, value in self._free.items()
            for inner in (
                value.at(key, 0.0)
                if isinstance(value, FreeRange | FreeLine)
                else value[0]
                if isinstance(value, LinePoints)
                else [key]
            )
        ]

    @property
    def size(self) -> int:
        """Number of combinations of listed values."""
        return int(np.prod([len(values) for values in self.lists.values()], dtype=float))

    @property
    def condition(self) -> str:
        """Name of the condition whose errors are computed."""
        return str(self.section.condition or self.base.conditions[-1].name)

    def lists_at(self, number: int) -> dict[str, Any]:
        """
        Values of the listed keys in one of their combinations.

        Parameters
        ----------
        number : int
            Number of the combination, from 0; the last key varies fastest.

        Returns
        -------
        dict of str to object
            Value of each listed key.
        """
        sizes = [len(values) for values in self.lists.values()]
        place = np.unravel_index(number, sizes) if sizes else ()
        design: dict[str, Any] = {}
        for (key, values), k in zip(self.lists.items(), place, strict=True):
            design |= values[k] if isinstance(values, LinePoints) else {key: values[k]}
        return design

    def ends(self, *, high: bool) -> dict[str, float]:
        """
        Values of all ranges at one of their limits.

        Parameters
        ----------
        high : bool
            True for the upper limits, False for the lower ones.

        Returns
        -------
        dict of str to float
            Limit of each key.
        """
        ends: dict[str, float] = {}
        for key, limits in self.ranges.items():
            ends |= limits.at(key, limits.high if high else limits.low)
        return ends

    def study(self, design: Design, ocean: int | None = None) -> StudyConfig:
        """
        Study of a design.

        Parameters
        ----------
        design : mapping
            Values by dotted key; an empty one is the base.
        ocean : int, optional
            Number of an ocean of the ensemble. Default: the ocean of the base.

        Returns
        -------
        StudyConfig

        Raises
        ------
        PlanError
            If it is no study, with the key and the allowed values.
        """
        over = {} if ocean is None else self.section.oceans[ocean]
        values = {**{f"ocean.{key}": value for key, value in over.items()}, **design}
        try:
            return Sweep(
                self.base, cross={k: [v] for k, v in values.items()}, folder=self.folder
            ).point(0)
        except MantaRayError as error:
            line = str(error).partition("\n")[0].removeprefix("sweep: ")
            raise PlanError(f"{self.source}: plan: {line}") from None


def load_plan(file: str | Path, **changes: Any) -> DeploymentPlan:
    r"""
    Read a study file with a section ``[plan]``.

    Parameters
    ----------
    file : str or pathlib.Path
        TOML file of a study; see `PlanSection` for the keys of ``[plan]``.
    **changes
        Values of the study by dotted key, as for `pymantaray.load_study`.

    Returns
    -------
    DeploymentPlan

    Raises
    ------
    PlanError
        If the file has no section ``[plan]``, or the section does not fit the study.
    StudyError
        If the file is not a study, or a key of ``[plan]`` is unknown.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.apps.plan import load_plan
    >>> lines = ['base = "quick"', "[plan.free]", '"mission.ping_interval_h" = [0.5, 1.0, 2.0]']
    >>> _ = Path("mission.toml").write_text("\n".join(lines))
    >>> load_plan("mission.toml").size
    3
    """
    path = Path(file)
    tree = plan_tree(path)
    if tree is None:
        raise PlanError(
            f"{file}: has no section [{PLAN}]; add one with [plan.free], such as"
            ' "fleet.vehicles.A.depth" = { from = 1, to = 500 }'
        )
    section = parse(PlanFile, {PLAN: tree}, str(file), path.parent).plan
    return DeploymentPlan(load_study(path, **changes), section, str(file), path.parent)


def _texts(value: Any) -> Iterator[str]:
    """All texts among nested values."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for inner in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(inner)


def _flat(table: Mapping[str, Any], source: str, before: str = "") -> dict[str, Any]:
    """Lists and ranges by dotted key, with or without quotes around the dots in the file."""
    out: dict[str, Any] = {}
    for name, value in table.items():
        key = before + name
        if isinstance(value, Mapping) and not {"from", "to"} & value.keys():
            out |= _flat(value, source, f"{key}.")
        else:
            out[key] = _values(value, key, f"{source}: plan.free: {key}")
    return out


def _values(value: Any, key: str, label: str) -> list[Any] | FreeRange | FreeLine:
    """List of values, or the limits of a range or line without a count."""
    if not isinstance(value, Mapping):
        if isinstance(value, list | tuple) and value:
            return list(value)
        raise PlanError(
            f"{label}: found {json.dumps(value, default=str)}; give a list, or from and to"
        )
    ends: Any = [value.get(key) for key in _RANGE]
    low, high, count = ends
    if unknown := sorted(value.keys() - set(_RANGE)):
        raise PlanError(f"{label}.{unknown[0]}: unknown key; allowed: {', '.join(_RANGE)}")
    if count is not None and (not isinstance(count, int) or isinstance(count, bool) or count < 2):
        raise PlanError(f"{label}.count: found {count}; allowed: a whole number, 2 or more")
    if isinstance(low, Mapping) or isinstance(high, Mapping):
        line = _line(low, high, label)
        return (
            line
            if count is None
            else LinePoints(line.at(key, x) for x in np.linspace(0.0, 1.0, count).tolist())
        )
    if not all(_is_number(end) for end in (low, high)) or not low < high:
        raise PlanError(
            f"{label}: from is {low}, to is {high}; both must be numbers with from below to"
        )
    return (
        FreeRange(float(low), float(high))
        if count is None
        else np.linspace(low, high, count).tolist()
    )


def _line(start: Any, stop: Any, label: str) -> FreeLine:
    """Line between two tables with the same keys and different numbers."""
    tables = [end for end in (start, stop) if isinstance(end, Mapping) and end]
    alike = len(tables) == 2 and start.keys() == stop.keys() and dict(start) != dict(stop)
    if not alike or not all(_is_number(x) for end in tables for x in end.values()):
        raise PlanError(
            f"{label}: from is {start}, to is {stop}; a line needs two different tables of numbers"
            " with the same keys, such as { north = 0, east = 0 } and { north = 0, east = 5000 }"
        )
    return FreeLine(dict(start), dict(stop))


def _is_number(value: Any) -> bool:
    return (
        isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
    )
