"""Report of a run in its folder: tables, figures and page, replaced atomically."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pymantaray.errors import ReportError
from pymantaray.jobs.folder import staged_parts
from pymantaray.jobs.progress import Progress
from pymantaray.records.result_table import ResultTable
from pymantaray.report.explore import mission_rays
from pymantaray.report.figures import FigureSpec, RunResults, find_figures, run_figure_specs
from pymantaray.report.folder import FIGURE_KINDS, FORMATS, PAGE, PARTS, write_files
from pymantaray.report.page import Picture
from pymantaray.report.run_page import run_page
from pymantaray.report.style import legend_entries, rendered
from pymantaray.study.store import Run, open_run
from pymantaray.study.tables import SUMMARY

_PIXELS_PER_INCH = 133.0  # of figures on the page
_PRINTED = 300.0  # dots per inch of a paper
_OF_FINISHED_RUN = ("path", "tables", "manifest", "estimates", "covariances", "unknowns")


def write_report(
    run_dir: str | Path, *, formats: Sequence[str] = (), progress: Progress | None = None
) -> Path:
    """
    Write tables, figures and page of a run into its folder; an existing report is replaced.

    Parameters
    ----------
    run_dir : str or pathlib.Path
        Folder of a run.
    formats : sequence of str
        Additional formats for a paper: figures as ``png`` with 300 dpi, ``pdf`` and ``svg``, tables as ``tex``.
    progress : callable, optional
        Called with ``"report"``, the number of finished parts and the total.

    Returns
    -------
    pathlib.Path
        The page, ``index.html``. The same folder contains ``tables`` (CSV) and ``figures`` (PNG and the additional formats).

    Raises
    ------
    MantaRayError
        If the folder is not a run, a file of the run is damaged, or a file cannot be written. The folder does not change then.
    """
    maker = ReportMaker(formats=formats)
    run = open_run(run_dir)
    with staged_parts(run.path, PARTS) as stage:
        write_files(stage, maker.make(run.path, progress))
    return run.path / PAGE


def checked_formats(formats: Sequence[str]) -> Sequence[str]:
    """Formats of a report; raise an error for an unknown one."""
    for name in formats:
        if name not in FORMATS:
            raise ReportError(f"format {name!r}: unknown; allowed: {', '.join(FORMATS)}")
    return formats


class ReportMaker:
    """Maker of a run's report in two parts: figures of the mission from the run's working folder, then the rest."""

    def __init__(self, *, formats: Sequence[str]) -> None:
        self._formats, self._drawn = checked_formats(formats), dict[str, Picture]()
        self._rays: str | None = None
        self._mission, self._summary = dict[str, Any](), dict[str, ResultTable]()

    def import_all(self) -> None:
        """Import all modules with figures and their dependencies."""
        find_figures()

    def draw_mission(self, folder: Path) -> None:
        """Draw the figures, and compute the numbers of tables, that do not depend on the realizations."""
        run = Run(folder)
        results = RunResults(run)
        specs = run_figure_specs(results, of_mission=True)
        self._drawn = {picture.name: picture for picture in draw(specs, formats=self._formats)}
        self._rays = mission_rays(results)
        run.expect_errors()
        self._mission = {name: value for name, value in vars(run).items() if name not in _OF_FINISHED_RUN}

    def make(self, folder: Path, progress: Progress | None = None) -> dict[str, bytes]:
        """Files of the report of a finished run, by name."""
        run = open_run(folder)
        vars(run).update(self._mission)  # otherwise it reads and computes them again
        results = RunResults(run)
        pictures = draw(
            run_figure_specs(results), formats=self._formats, drawn=self._drawn, progress=progress
        )
        rays = self._rays or mission_rays(results)
        files = run_page(results, pictures, rays).files(self._formats)
        self._summary = {name: run.tables[name] for name in SUMMARY if name in run.tables}
        return files

    def summary(self) -> dict[str, ResultTable]:
        """Tables of the latest report that a command prints."""
        return self._summary


def draw(
    specs: Sequence[FigureSpec],
    *,
    formats: Sequence[str],
    drawn: Mapping[str, Picture] = MappingProxyType({}),
    progress: Progress | None = None,
) -> list[Picture]:
    """Draw figures one after another; only one is in memory at a time."""
    pictures = []
    notify = progress or (lambda *_: None)
    notify("report", 0, len(specs) or 1)
    for i, spec in enumerate(specs):
        pictures.append(drawn.get(spec.name) or _picture(spec, formats))
        notify("report", i + 1, len(specs))
    return pictures


def _picture(spec: FigureSpec, formats: Sequence[str]) -> Picture:
    figure = spec.draw()
    width, height = (round(_PIXELS_PER_INCH * inches) for inches in figure.get_size_inches())
    kinds = ("png", *(kind for kind in FIGURE_KINDS if kind in formats and kind != "png"))
    files = rendered(figure, kinds, dpi=_PRINTED if "png" in formats else None)
    return Picture(spec.name, spec.caption, width, height, files, legend_entries(figure), spec.paper)
