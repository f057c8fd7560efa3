"""
Inputs of a report, and the register of its figures.

A figure is a function in a module of this folder, and a call of `register` in the same module with
its name, its place on the page, and a function that draws it from a run's `RunResults`.
`find_figures` imports all modules of the folder, and all modules that other packages name as entry
points of the group ``pymantaray.figures``.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any, TypedDict

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pymantaray.apps.study import figures
from pymantaray.arrays import Array
from pymantaray.entry_points import FIGURES, Extension, current_extension, extensions
from pymantaray.errors import ExtensionError, ReportError
from pymantaray.evaluation import RangeErrors, range_errors, trajectory_errors
from pymantaray.plotting.drawing import FigureSpec, with_source
from pymantaray.plotting.style import COLUMN, DOUBLE, ocean_header, ocean_name
from pymantaray.records import Measurements, Trajectories
from pymantaray.records.digits import counted

if TYPE_CHECKING:
    from pymantaray.apps.study.store import Run
    from pymantaray.apps.study.tables import RunTables


class RunResults:
    """
    A run with its tables, errors and texts for figures and page, each computed once on first use.
    """

    def __init__(self, run: "Run") -> None:
        self.run = run

    @property
    def tables(self) -> "RunTables":
        """Tables of the run by name, in the order of the page."""
        return self.run.tables

    @cached_property
    def ranges(self) -> RangeErrors:
        """Signed range errors and their split. [m]"""
        return range_errors(self.run.ranging_truth)

    @cached_property
    def errors(self) -> Mapping[str, Array]:
        """
        Position errors by condition, of shape (realizations, vehicles, times); NaN for a solve that
        failed. [m]
        """
        estimates = self.run.estimates
        errors = trajectory_errors(self.run.truth, estimates)
        return dict(zip(estimates.condition.tolist(), errors, strict=True))

    @cached_property
    def fixes(self) -> NDArray[np.bool_]:
        """Mask of the poses with a GNSS fix, shape (vehicles, times)."""
        o = self.run.measurements
        fixes = np.zeros(o.depth.shape, dtype=bool)
        fixes[o.gnss_vehicle, o.gnss_sample] = True
        return fixes

    @property
    def region(self) -> str:
        """Name of the ocean, without the note that it is synthetic."""
        return ocean_name(self.run.ocean.attrs)

    @property
    def synthetic(self) -> bool:
        """True if the ocean is synthetic."""
        return self.run.synthetic

    @property
    def header(self) -> str:
        """Header of every figure."""
        return ocean_header(self.run.ocean.attrs)

    @property
    def realizations(self) -> str:
        """Number of realizations with its noun."""
        return counted(len(self.run.estimates.realization), "realization")

    @property
    def attempts(self) -> int:
        """Number of range attempts."""
        return int(self.run.measurements.range_status.size)

    @property
    def received(self) -> int:
        """Number of received ranges."""
        return int(np.isfinite(self.ranges.total).sum())


@dataclass(frozen=True)
class _Entry:
    name: str
    place: float
    caption: str | Callable[[RunResults], str]
    draw: Callable[[RunResults], Figure]
    needs: Callable[[RunResults], bool]
    of_mission: bool
    paper: str
    column: Callable[[RunResults], Figure] | None
    owner: Extension | None
    """Entry point of the package that registered it; None for this package."""

    def check(self) -> None:
        """Raise an error for a value that a report cannot use."""
        entry: Any = self  # a package may give anything
        if not isinstance(entry.name, str) or not _NAME.fullmatch(entry.name):
            raise ReportError(
                f"register: name is {entry.name!r}; it must be 1 to 64 letters, digits, _ and -,"
                " beginning with a letter"
            )
        there = _REGISTER.get(entry.name)
        if there is not None and (entry.owner is not None or there.owner is not None):
            raise ReportError(f"register: name {entry.name!r} is that of another figure")
        if not (isinstance(entry.place, int | float) and np.isfinite(entry.place)):
            raise ReportError(f"register: place is {entry.place!r}; it must be a finite number")
        functions = entry.draw, entry.needs, *([] if entry.column is None else [entry.column])
        if not all(map(callable, functions)):
            raise ReportError("register: draw, needs and column must be functions")
        if not isinstance(entry.paper, str) or not (
            isinstance(entry.caption, str) or callable(entry.caption)
        ):
            raise ReportError("register: caption and paper must be text, or caption a function")

    def spec(self, results: RunResults, *, of_mission: bool) -> FigureSpec | None:
        """Figure of some results; None if they do not have it."""
        if (of_mission and not self.of_mission) or not self.needs(results):
            return None
        column = self.column and partial(self.column, results)
        draw = partial(self.draw, results)
        return FigureSpec(self.name, _caption(self, results), draw, self.paper, column)


_NAME = re.compile(r"[A-Za-z][\w-]{0,63}", re.ASCII)
_REGISTER: dict[str, _Entry] = {}


def register(
    name: str,
    *,
    place: float,
    caption: str | Callable[[RunResults], str],
    draw: Callable[[RunResults], Figure],
    needs: Callable[[RunResults], bool] = lambda _: True,
    of_mission: bool = False,
    paper: str = "",
    column: Callable[[RunResults], Figure] | None = None,
) -> None:
    """
    Add a figure to all reports whose results satisfy ``needs``; ``place`` is its rank on the page.

    A caption may contain attributes of `RunResults`, such as ``{r.received:,}``. A figure with
    ``of_mission`` does not depend on the realizations, so it may be drawn before they are solved.
    ``paper`` is its counterpart in the paper. ``column`` draws it for one column of a journal.
    """
    owner = current_extension()
    entry = _Entry(name, place, caption, draw, needs, of_mission, paper, column, owner)
    entry.check()
    _REGISTER[name] = entry


class _BothWidths(TypedDict):
    """Arguments of `register` of a figure with two layouts."""

    draw: Callable[[RunResults], Figure]
    column: Callable[[RunResults], Figure]


def both_widths(draw: Callable[[RunResults, float], Figure]) -> _BothWidths:
    """
    Arguments ``draw`` and ``column`` of `register`, from a function that draws a run for a width.
    """
    return {"draw": lambda r: draw(r, DOUBLE), "column": lambda r: draw(r, COLUMN)}


def run_figure_specs(results: RunResults, *, of_mission: bool = False) -> list[FigureSpec]:
    """
    Figures of a run in the order of the page; with ``of_mission``, only those that do not depend on
    the realizations.
    """
    failed = find_figures()
    specs = [
        entry.spec(results, of_mission=of_mission)
        if entry.owner is None
        else _guarded_spec(entry, entry.owner, results, of_mission=of_mission)
        for entry in sorted(_REGISTER.values(), key=lambda entry: entry.place)
    ]
    return [*(spec for spec in specs if spec is not None), *failed]


def find_figures() -> list[FigureSpec]:
    """
    Import all modules with figures, which registers the figures: those of this folder, and those of
    other packages. Return a figure that raises the error for each module that cannot be imported.
    """
    for module in iter_modules(figures.__path__):
        import_module(f"{figures.__name__}.{module.name}")
    own = {name: entry for name, entry in _REGISTER.items() if entry.owner is None}
    failed = []
    for name, several in extensions(FIGURES).items():
        for one in several:
            try:
                one.load()
            except ExtensionError as error:
                failed.append(_failed_spec(name, error))
            _REGISTER.update(own)  # whatever its code did to the register
    return failed


def _guarded_spec(
    entry: _Entry, owner: Extension, results: RunResults, *, of_mission: bool
) -> FigureSpec | None:
    """
    Figure of another package, which gets a copy of the results; its errors are raised when it is
    drawn.
    """
    guard = partial(_guard, owner, f"fails in its figure {entry.name!r}")
    try:
        with guard():
            spec = entry.spec(deepcopy(results), of_mission=of_mission)
            if spec is not None:
                f"{spec.caption}{spec.paper}".encode()
    except ExtensionError as error:
        return _failed_spec(entry.name, error)
    return None if spec is None else replace(spec, guard=guard)


@contextmanager
def _guard(owner: Extension, what: str) -> Iterator[None]:
    """Run code of another package that draws a figure, whose styles last for the block only."""
    with mpl.rc_context(), owner.guarded(what):
        yield


def _failed_spec(name: str, error: ExtensionError) -> FigureSpec:
    """Figure that raises an error when it is drawn."""

    def fail() -> Figure:
        raise ExtensionError(*error.args)

    return FigureSpec(name, "", fail)


def range_ends(truth: Trajectories, measurements: Measurements) -> tuple[Array, Array]:
    """
    True positions of transmitter and receiver of every range attempt, each of shape (ranges, 3).
    [m]
    """
    n_vehicles = len(truth.name)

    def place(who: NDArray[np.int32]) -> Array:
        out = np.empty((who.size, 3))
        vehicle = who < n_vehicles
        out[vehicle] = truth.position[who[vehicle], measurements.range_sample[vehicle]]
        out[~vehicle] = measurements.landmark_position[who[~vehicle] - n_vehicles]
        return out

    return place(measurements.range_transmitter), place(measurements.range_receiver)


def _caption(entry: _Entry, results: RunResults) -> str:
    text = (
        entry.caption.format(r=results)
        if isinstance(entry.caption, str)
        else entry.caption(results)
    )
    if not isinstance(text, str):
        raise ReportError(f"figure {entry.name}: its caption is {type(text).__name__}, not text")
    return with_source(text, synthetic=results.synthetic)
