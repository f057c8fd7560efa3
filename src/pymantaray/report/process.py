"""Process that makes the report of a study while the study is still running."""

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
    from pymantaray.report.write import ReportMaker
    from pymantaray.study.store import Run

_IMPORTS = ["pymantaray.study.realization"]  # processes that solve realizations start next


class ReportProcess(ExitStack):
    """
    Process that makes the report of a study: figures of the mission while the realizations are solved, the rest afterwards.

    The process starts and ends with the block. It writes no files; the process of the study does.
    """

    def __init__(self, *, formats: Sequence[str]) -> None:
        super().__init__()
        self._formats = formats

    def __enter__(self) -> Self:
        self._process = self.enter_context(Workers(partial(_start, self._formats), 1, imports=_IMPORTS))
        self._process.submit(methodcaller("import_all"))
        return self

    def begin(self, stage: Path) -> Future[None]:
        """Start to draw the figures of the mission in a folder."""
        self._drawn = self._process.submit(methodcaller("draw_mission", stage))
        return self._drawn

    def write(self, run: "Run", progress: Progress | None = None) -> None:
        """Write the report of the finished run, as `write_report` does; the run gets the tables of its summary."""
        if progress is not None:
            progress("report", 0, 1)
        self._drawn.result()
        files = self._process.submit(methodcaller("make", run.path)).result()
        with staged_parts(run.path, PARTS) as stage:
            write_files(stage, files)
        run.tables.use(self._process.submit(methodcaller("summary")).result())
        if progress is not None:
            progress("report", 1, 1)


def _start(formats: Sequence[str]) -> Callable[[Callable[["ReportMaker"], Any]], Any]:
    from pymantaray.report.write import ReportMaker

    maker = ReportMaker(formats=formats)
    return lambda call: call(maker)
