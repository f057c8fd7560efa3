"""
Inputs of a report, and the register of its figures.

A figure is a function in a module of this folder, and a call of `register` in the same module with
its name, its place on the page, and a function that draws it from a run's `RunResults`.
`find_figures` imports all modules of the folder, and all modules that other packages name as entry
points of the group ``pymantaray.figures``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pymantaray.apps.study import figures
from pymantaray.arrays import Array
from pymantaray.entry_points import extensions, load_extension
from pymantaray.evaluation import RangeErrors, range_errors, trajectory_errors
from pymantaray.pages.drawing import FigureSpec, with_source
from pymantaray.pages.style import ocean_header, ocean_name
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
        count = len(self.run.estimates.realization)
        return counted(count, "realization")

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
    place: float
    caption: str | Callable[[RunResults], str]
    draw: Callable[[RunResults], Figure]
    needs: Callable[[RunResults], bool]
    of_mission: bool
    paper: str
    column: Callable[[RunResults], Figure] | None


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
    ``paper`` is its counterpart in the paper. ``column`` draws it for one column of a journal, if
    it needs another layout.
    """
    _REGISTER[name] = _Entry(place, caption, draw, needs, of_mission, paper, column)


def run_figure_specs(results: RunResults, *, of_mission: bool = False) -> list[FigureSpec]:
    """
    Figures of a run in the order of the page; with ``of_mission``, only those that do not depend on
    the realizations.
    """
    find_figures()
    entries = sorted(_REGISTER.items(), key=lambda item: item[1].place)
    return [
        FigureSpec(
            name,
            _caption(entry, results),
            partial(entry.draw, results),
            entry.paper,
            entry.column and partial(entry.column, results),
        )
        for name, entry in entries
        if (entry.of_mission or not of_mission) and entry.needs(results)
    ]


def find_figures() -> None:
    """
    Import all modules with figures, which registers the figures: those of this folder, and those of
    other packages.
    """
    for module in iter_modules(figures.__path__):
        import_module(f"{figures.__name__}.{module.name}")
    for name in extensions("figures"):
        load_extension("figures", name)


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
    return with_source(text, synthetic=results.synthetic)
