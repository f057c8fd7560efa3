"""Drawing of the figures of a page, and its files in a folder."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from matplotlib.figure import Figure

from pymantaray.errors import ExtensionError, ReportError
from pymantaray.jobs.folder import staged_folder, write_json
from pymantaray.jobs.progress import Progress
from pymantaray.pages.drawing import FigureSpec, Picture
from pymantaray.pages.folder import FIGURE_KINDS, FORMATS, ONE_COLUMN, PAGE, write_files
from pymantaray.pages.page import Page
from pymantaray.pages.style import legend_entries, rendered

_PIXELS_PER_INCH = 133.0  # of figures on the page
_PRINTED = 300.0  # dots per inch of a paper


def write_page(
    out: str | Path | None,
    name: str,
    specs: Sequence[FigureSpec],
    page_of: Callable[[Sequence[Picture], dict[str, Any]], Page],
    record: dict[str, Any],
    formats: Sequence[str],
    progress: Progress | None,
    others: Callable[[Path], object] = lambda _: None,
) -> Path:
    """
    Draw figures, and write them with their page and its tables into a new folder; return the page.

    A record of the origin becomes ``NAME.json``; ``others`` writes more files into a folder.
    """
    checked_formats(formats)
    with staged_folder(out, name, latest=False) as (stage, folder):
        pictures = draw(specs, formats=formats, progress=progress)
        write_files(stage, page_of(pictures, record).linked_from(folder).files(formats))
        others(stage)
        if record:
            write_json(record, stage / f"{name}.json")
    return folder / PAGE


def checked_formats(formats: Sequence[str]) -> Sequence[str]:
    """Formats of a report; raise an error for an unknown one."""
    for name in formats:
        if name not in FORMATS:
            raise ReportError(f"format {name!r}: unknown; allowed: {', '.join(FORMATS)}")
    return formats


def draw(
    specs: Sequence[FigureSpec],
    *,
    formats: Sequence[str],
    drawn: Mapping[str, Picture] = MappingProxyType({}),
    progress: Progress | None = None,
    failures: list[str] | None = None,
) -> list[Picture]:
    """
    Draw figures one after another; only one is in memory at a time.

    With ``failures``, a figure of another package that fails adds its error line to them and is
    left out.
    """
    pictures = []
    notify = progress or (lambda *_: None)
    notify("report", 0, len(specs) or 1)
    for i, spec in enumerate(specs):
        try:
            with spec.guard():
                pictures.append(drawn.get(spec.name) or _picture(spec, formats))
        except ExtensionError as error:
            if failures is None:
                raise
            failures.append(str(error))
        notify("report", i + 1, len(specs))
    return pictures


def _picture(spec: FigureSpec, formats: Sequence[str]) -> Picture:
    figure = spec.draw()
    if not isinstance(figure, Figure):
        raise ReportError(
            f"figure {spec.name}: its function returns {type(figure).__name__}; it must return a"
            " matplotlib figure"
        )
    width, height = (round(_PIXELS_PER_INCH * inches) for inches in figure.get_size_inches())
    kinds = ("png", *(kind for kind in FIGURE_KINDS if kind in formats and kind != "png"))
    printed = "png" in formats
    files = {}
    if ONE_COLUMN in formats and spec.column is not None:
        files[f"{ONE_COLUMN}.pdf"] = rendered(spec.column(), ("pdf",))["pdf"]
    files |= rendered(figure, kinds, dpi=_PRINTED if printed else None, few_colours=not printed)
    legend = legend_entries(figure)
    "".join(word for entry in legend for word in entry).encode()  # the page writes them
    return Picture(spec.name, spec.caption, width, height, files, legend, spec.paper)
