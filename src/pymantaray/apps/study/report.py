"""Report of a run in its folder: tables, figures and page, replaced atomically."""

import logging
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pymantaray.apps.study.store import Run, open_run
from pymantaray.apps.study.tables import OF_MISSION
from pymantaray.jobs.folder import staged_parts
from pymantaray.jobs.progress import Progress
from pymantaray.pages.folder import PAGE, PARTS, write_files
from pymantaray.plotting.formats import checked_formats
from pymantaray.records.result_table import ResultTable

if TYPE_CHECKING:
    from pymantaray.plotting.drawing import Picture

LOG = logging.getLogger(__name__)

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
        Additional formats for a paper: figures as ``png`` with 300 dpi, ``pdf`` and ``svg``, and
        for one column of a journal as ``84mm``; tables as ``tex``.
    progress : callable, optional
        Called with ``"report"``, the number of finished parts and the total.

    Returns
    -------
    pathlib.Path
        The page, ``index.html``. The same folder contains ``tables`` (CSV) and ``figures`` (PNG and
        the additional formats). A figure of another package that fails is missing; the page and the
        log say so.

    Raises
    ------
    MantaRayError
        If the folder is not a run, a file of the run is damaged, or a file cannot be written. The
        folder does not change then.

    Examples
    --------
    Continues the example of `pymantaray.apps.study`:

    >>> from pymantaray.apps.study import write_report
    >>> page = write_report(run.path)
    >>> page.name, (page.parent / "tables" / "ping_error.csv").is_file()
    ('index.html', True)
    """
    page, failures = report_of(run_dir, formats=formats, progress=progress)
    for line in failures:
        LOG.error(line)
    return page


def report_of(
    run_dir: str | Path, *, formats: Sequence[str] = (), progress: Progress | None = None
) -> tuple[Path, list[str]]:
    """Write a report as `write_report`; return the page, and a line for each missing figure."""
    report = StudyReport(formats=formats)
    run = open_run(run_dir)
    failures = report.write(run, progress)
    return run.path / PAGE, failures


class StudyReport:
    """
    Report of a run; `begin` makes its parts that do not depend on the realizations, for example
    while other processes solve these.

    Another process would import as many modules, and read the run again, which takes as long as
    drawing most of the figures. Methods import Matplotlib, for which the simulation would wait.
    """

    def __init__(self, *, formats: Sequence[str]) -> None:
        self._formats = checked_formats(formats)
        self._mission: Run | None = None
        self._tables = dict[str, ResultTable]()
        self._pictures = dict[str, "Picture"]()
        self._rays = ""

    def begin(self, folder: Path) -> Iterator[None]:
        """
        Draw figures and compute tables of a run's working folder, one at each step.

        `write` does what is left if not all steps are taken, and raises the error of a step again.
        """
        with suppress(Exception):
            from pymantaray.apps.study.figures.register import RunResults, run_figure_specs
            from pymantaray.apps.study.page import mission_rays
            from pymantaray.plotting.drawing import draw

            run = self._mission = Run(folder)
            results = RunResults(run)
            for _ in run.expect_errors():
                yield
            for name in OF_MISSION:
                if name in run.tables:
                    self._tables[name] = run.tables[name]
                    yield
            for spec in run_figure_specs(results, of_mission=True):
                # a figure that fails is drawn again and reported by `write`
                for picture in draw([spec], formats=self._formats, failures=[]):
                    self._pictures[picture.name] = picture
                yield
            self._rays = mission_rays(results)

    def write(self, run: Run, progress: Progress | None = None) -> list[str]:
        """
        Write the report of the finished run into its folder; return a line for each figure of
        another package that fails, which the report lacks.
        """
        from pymantaray.apps.study.figures.register import RunResults, run_figure_specs
        from pymantaray.apps.study.page import mission_rays, run_page
        from pymantaray.plotting.drawing import draw

        failures: list[str] = []
        with staged_parts(run.path, PARTS) as stage:
            if self._mission is not None:
                known = vars(self._mission).items()
                vars(run).update((name, x) for name, x in known if name not in _OF_FINISHED_RUN)
            run.tables.use(self._tables)
            results = RunResults(run)
            page = run_page(results, self._rays or mission_rays(results))
            pictures = draw(
                run_figure_specs(results),
                formats=self._formats,
                drawn=self._pictures,
                progress=progress,
                failures=failures,
            )
            notes = [*page.notes, *(f"A figure is missing: {line}." for line in failures)]
            write_files(stage, replace(page, pictures=pictures, notes=notes).files(self._formats))
        return failures
