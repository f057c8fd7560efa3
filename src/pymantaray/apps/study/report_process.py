"""Report of a study by another process while the study is running, or by this one afterwards."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pymantaray.jobs.folder import staged_parts
from pymantaray.jobs.processes import Workers
from pymantaray.jobs.progress import Progress
from pymantaray.pages.folder import PARTS, write_files

if TYPE_CHECKING:
    from pymantaray.apps.study.report import ReportMaker, RunReport
    from pymantaray.apps.study.store import Run

SHOWS_RESULTS = True


class ReportProcess(Workers):
    """
    Process that draws figures and computes numbers of a mission while its realizations are solved,
    and the rest of a report afterwards.

    It starts and ends with the block. It writes no files; the process of the study does.
    """

    def __init__(self, *, formats: Sequence[str]) -> None:
        super().__init__(partial(_start, formats), 1)

    def __enter__(self) -> Self:
        super().__enter__()
        self.submit(bool)  # it imports what it needs while the mission is simulated
        return self

    def begin(self, stage: Path) -> Sequence[Future[Any]]:
        """Start with the mission in a folder; the work is done with the future."""
        self._begun = self.submit(methodcaller("prepare", stage))
        return (self._begun,)

    def write(self, run: "Run", progress: Progress | None = None) -> list[str]:
        """
        Write the report of the finished run, as `write_report` does; the run gets the tables of its
        summary. Return a line for each missing figure.
        """
        if progress is not None:
            progress("report", 0, 1)
        self._begun.result()
        report: RunReport = self.submit(methodcaller("make", run.path)).result()
        with staged_parts(run.path, PARTS) as stage:
            write_files(stage, report.files)
        run.tables.use(report.tables)
        if progress is not None:
            progress("report", 1, 1)
        return report.failures


class LaterReport:
    """
    Report that this process makes after the study, with the methods of `ReportProcess`.

    Another process takes as long to import its modules and to read the run as it takes to draw a
    third of the figures, which pays only if other processes solve the realizations as well.
    """

    def __init__(self, *, formats: Sequence[str]) -> None:
        self._formats = formats

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def begin(self, _stage: Path) -> Sequence[Future[Any]]:
        """Begin nothing before the run is finished."""
        return ()

    def write(self, run: "Run", progress: Progress | None = None) -> list[str]:
        """Write the report of the finished run; return a line for each missing figure."""
        from pymantaray.apps.study.report import ReportMaker

        with staged_parts(run.path, PARTS) as stage:
            report = ReportMaker(formats=self._formats).make_of(run, progress)
            write_files(stage, report.files)
        return report.failures


def _start(formats: Sequence[str]) -> Callable[[Callable[["ReportMaker"], Any]], Any]:
    from pymantaray.apps.study.report import ReportMaker

    maker = ReportMaker(formats=formats)
    return lambda call: call(maker)
