"""A run's report in its folder: tables, figures and page, all new or all as they were."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import pandas as pd

from pymantaray.records import whole_file
from pymantaray.report.figures import Plate, Results, run_plates
from pymantaray.report.page import Picture, run_page
from pymantaray.report.style import save_figure
from pymantaray.report.tables import write_table
from pymantaray.study.folder import staged_parts
from pymantaray.study.store import FIGURES, TABLES, open_run

Progress = Callable[[str, int, int], None]
"""Told the name of a stage, how many of its parts are done, and how many there are."""

PAGE = "index.html"
_PIXELS_PER_INCH = 133.0  # of figures on the page


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
    if progress is not None:
        progress("report", 0, 1)
    results = Results(run)
    with staged_parts(run.path, (TABLES, FIGURES, PAGE)) as stage:
        write_parts(stage, results.tables, run_plates(results), partial(run_page, results), progress)
    return run.path / PAGE


def write_parts(
    folder: Path,
    tables: Mapping[str, pd.DataFrame],
    plates: Sequence[Plate],
    page: Callable[[Sequence[Picture]], str],
    progress: Progress | None,
) -> None:
    """Write tables, figures and page into an empty folder; figures one by one, so that only one is in memory."""
    (folder / TABLES).mkdir()
    for name, table in tables.items():
        write_table(table, folder / TABLES / f"{name}.csv")
    (folder / FIGURES).mkdir()
    pictures = []
    for i, plate in enumerate(plates):
        figure = plate.draw()
        save_figure(figure, folder / FIGURES, plate.name)
        width, height = (round(_PIXELS_PER_INCH * inches) for inches in figure.get_size_inches())
        pictures.append(Picture(plate.name, plate.caption, width, height))
        if progress is not None:
            progress("report", i + 1, len(plates))
    with whole_file(folder / PAGE) as file:
        file.write_text(page(pictures), encoding="utf-8", newline="")
