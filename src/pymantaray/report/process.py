"""Processes that make the report of a study while the study is still running."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import ExitStack
from functools import partial
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pymantaray.jobs.folder import staged_parts
from pymantaray.jobs.processes import Workers
from pymantaray.jobs.progress import Progress
from pymantaray.report.folder import PARTS, write_files

if TYPE_CHECKING:
    from pymantaray.report.drawing import Drawing
    from pymantaray.report.write import ReportMaker
    from pymantaray.study.store import Run


class ReportProcesses(ExitStack):
    """
    Two processes that make the report of a study: figures and numbers of the mission while the realizations are solved, the rest afterwards.

    The processes start and end with the block. They write no files; the process of the study does.
    """

    def __init__(self, *, formats: Sequence[str]) -> None:
        super().__init__()
        self._formats = formats

    def __enter__(self) -> Self:
        start = partial(_start, self._formats)
        self._figures, self._tables = (self.enter_context(Workers(start, 1)) for _ in range(2))
        for process in (self._figures, self._tables):
            process.submit(bool)  # it imports what it needs while the mission is simulated
        return self

    def begin(self, stage: Path) -> Sequence[Future[Any]]:
        """Start to draw the figures and to compute the numbers of the mission in a folder; both are done with the futures."""
        self._drawn: Future[Drawing] = self._figures.submit(methodcaller("draw_mission", stage))
        self._computed = self._tables.submit(methodcaller("compute_mission", stage))
        return self._drawn, self._computed

    def write(self, run: "Run", progress: Progress | None = None) -> None:
        """Write the report of the finished run, as `write_report` does; the run gets the tables of its summary."""
        if progress is not None:
            progress("report", 0, 1)
        drawing = self._drawn.result()
        self._computed.result()
        errors = self._figures.submit(methodcaller("draw_errors", run.path))
        rest = self._tables.submit(methodcaller("draw_rest", run.path, drawing.rays))
        drawn = {**drawing.pictures, **errors.result()}
        rest.result()
        files, tables = self._tables.submit(methodcaller("make", run.path, drawn=drawn)).result()
        with staged_parts(run.path, PARTS) as stage:
            write_files(stage, files)
        run.tables.use(tables)
        if progress is not None:
            progress("report", 1, 1)


def _start(formats: Sequence[str]) -> Callable[[Callable[["ReportMaker"], Any]], Any]:
    from pymantaray.report.write import ReportMaker

    maker = ReportMaker(formats=formats)
    return lambda call: call(maker)
