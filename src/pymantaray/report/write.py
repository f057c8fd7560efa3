"""A run's report in its folder: tables, figures and page, all new or all as they were."""

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pymantaray.errors import ReportError
from pymantaray.report.figures import Plate, run_plates
from pymantaray.report.findings import gather
from pymantaray.report.page import run_page
from pymantaray.report.style import save_figure
from pymantaray.report.tables import write_table, write_text
from pymantaray.study.store import FIGURES, TABLES, open_run

Progress = Callable[[str, int, int], None]
"""Told the name of a stage, how many of its parts are done, and how many there are."""

STAGE, PAGE = "report", "index.html"


def write_report(run_dir: str | Path, *, progress: Progress | None = None) -> Path:
    """
    Write tables, figures and page of a run into its folder; an earlier report there is replaced.

    Parameters
    ----------
    run_dir : str or pathlib.Path
        Folder of a run.
    progress : callable, optional
        Called with ``"report"``, the parts done and the parts there are.

    Returns
    -------
    pathlib.Path
        The page, ``index.html``; beside it ``tables`` (CSV) and ``figures`` (PNG and PDF).

    Raises
    ------
    MantaRayError
        If the folder is no run, a file of it is damaged, or nothing can be written; then the folder is as
        it was.
    """
    run = open_run(run_dir)
    report = progress or silent
    report(STAGE, 0, 1)
    found = gather(run)
    plates = run_plates(found)
    with _staged(run.path) as stage:
        for name, table in found.tables.items():
            write_table(table, stage / TABLES / f"{name}.csv")
        draw_plates(plates, stage, report)
        write_text(run_page(found, plates), stage / PAGE)
    return run.path / PAGE


def draw_plates(plates: Sequence[Plate], folder: Path, progress: Progress) -> None:
    """
    Make and save figures one by one, so that only one is in memory.

    Parameters
    ----------
    plates : sequence of Plate
    folder : pathlib.Path
        Gets a folder ``figures``.
    progress : callable
        Told of each figure.

    Raises
    ------
    ReportError
        If a file cannot be written.
    """
    for i, plate in enumerate(plates):
        save_figure(plate.draw(), folder / FIGURES, plate.name)
        progress(STAGE, i + 1, len(plates))


def silent(_stage: str, _done: int, _total: int) -> None:
    """Report nothing."""


@contextmanager
def _staged(run: Path) -> Iterator[Path]:
    """Folder inside the run; what is in it takes its place there only if the block ends well."""
    stage = run / f".report.{os.getpid()}.part"
    try:
        stage.mkdir()
    except OSError as error:
        raise ReportError(f"{run}: report cannot be written: {error.strerror or error}") from None
    try:
        yield stage
        old = stage / "old"
        old.mkdir()
        for name in (TABLES, FIGURES, PAGE):
            if (run / name).exists():
                (run / name).replace(old / name)
            (stage / name).replace(run / name)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
