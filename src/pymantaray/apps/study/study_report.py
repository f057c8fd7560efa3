"""Report of a study by its process, begun while other processes solve the realizations."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from pymantaray.jobs.folder import staged_parts
from pymantaray.jobs.progress import Progress
from pymantaray.pages.folder import PARTS, write_files

if TYPE_CHECKING:
    from pymantaray.apps.study.report import ReportMaker
    from pymantaray.apps.study.store import Run

SHOWS_RESULTS = True


class StudyReport:
    """
    Report of a study.

    Another process would import as many modules, and read the run again, which takes as long as
    drawing most of the figures.
    """

    def __init__(self, *, formats: Sequence[str]) -> None:
        self._formats = formats

    @cached_property
    def _maker(self) -> "ReportMaker":
        # imports Matplotlib, for which the simulation would wait
        from pymantaray.apps.study.report import ReportMaker

        return ReportMaker(formats=self._formats)

    def begin(self, stage: Path) -> Iterator[None]:
        """Make parts that do not depend on the realizations, one at each step."""
        with suppress(Exception):  # `write` raises it again, when the data are complete
            yield from self._maker.prepare(stage)

    def write(self, run: "Run", progress: Progress | None = None) -> list[str]:
        """
        Write the report of the finished run, as `write_report` does; return a line for each missing
        figure.
        """
        with staged_parts(run.path, PARTS) as stage:
            report = self._maker.make_of(run, progress)
            write_files(stage, report.files)
        return report.failures
