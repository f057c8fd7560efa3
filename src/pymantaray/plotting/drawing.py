"""Figures of a report, before and after they are drawn, and the drawing of them."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import NamedTuple, Self

from matplotlib.figure import Figure

from pymantaray.errors import ExtensionError, ReportError
from pymantaray.jobs.progress import Progress
from pymantaray.plotting.formats import FIGURE_KINDS, FIGURES, ONE_COLUMN, PRINTED
from pymantaray.plotting.style import COLUMN, DOUBLE, in_one_column, legend_entries, rendered

_PIXELS_PER_INCH = 133.0  # of figures on the page


class Image(NamedTuple):
    """PNG of a figure, and its size on the page. [px]"""

    png: bytes
    width: int
    height: int


class Picture(NamedTuple):
    """
    A drawn figure: size on the page [px], files by kind, signs, colours and words of its legend,
    counterpart in the paper, folder, and its layout for one column, for a narrow screen.
    """

    name: str
    caption: str
    width: int
    height: int
    files: Mapping[str, bytes]
    legend: Sequence[tuple[str, str, str]] = ()
    paper: str = ""
    folder: str = f"{FIGURES}/"
    narrow: Image | None = None


@dataclass(frozen=True)
class FigureSpec:
    """
    A figure of a report: file name without suffix, caption, function that draws it, counterpart in
    the paper, and function that draws it for one column of a journal.
    """

    name: str
    caption: str
    draw: Callable[[], Figure]
    paper: str = ""
    column: Callable[[], Figure] | None = None
    guard: Callable[[], AbstractContextManager[None]] = nullcontext
    """Context in which it is drawn: that of another package, if it is from one."""

    @classmethod
    def of_both_widths(
        cls, name: str, caption: str, draw: Callable[[float], Figure], paper: str = ""
    ) -> Self:
        """Figure with two layouts, from a function that draws it for a width. [in]"""
        return cls(name, caption, partial(draw, DOUBLE), paper, partial(draw, COLUMN))


def with_source(caption: str, *, synthetic: bool) -> str:
    """Caption with a remark if the ocean is synthetic."""
    return f"{caption} Synthetic ocean." if synthetic else caption


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
    width, height = _size(figure)
    kinds = ("png", *(kind for kind in FIGURE_KINDS if kind in formats and kind != "png"))
    printed = "png" in formats
    files = {}
    narrow = None
    if ONE_COLUMN in formats and spec.column is not None:
        column = spec.column()
        files[f"{ONE_COLUMN}.pdf"] = rendered(column, ("pdf",))["pdf"]
        if not in_one_column(figure):
            narrow = Image(rendered(column, ("png",), few_colours=True)["png"], *_size(column))
    files |= rendered(figure, kinds, dpi=PRINTED if printed else None, few_colours=not printed)
    legend = legend_entries(figure)
    "".join(word for entry in legend for word in entry).encode()  # the page writes them
    return Picture(spec.name, spec.caption, width, height, files, legend, spec.paper, narrow=narrow)


def _size(figure: Figure) -> tuple[int, int]:
    """Width and height on the page. [px]"""
    width, height = (round(_PIXELS_PER_INCH * inches) for inches in figure.get_size_inches())
    return width, height
