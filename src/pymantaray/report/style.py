"""One look for all figures: sizes, colours and fonts that read in a two-column paper; and saving them whole."""

import functools
import os
from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import AbstractPathEffect, withStroke

from pymantaray.errors import ReportError
from pymantaray.report.labels import condition_label, plain

COLUMN, DOUBLE = 3.5, 7.16
"""Width of one and of both columns of the paper. [in]"""
PNG_DPI = 200
HEADER_LINE = 4
"""Entries of a legend that fit beside the header over both columns."""

BLUE, ORANGE, GREEN, SKY, PINK = "#0072B2", "#D55E00", "#009E73", "#56B4E9", "#CC79A7"  # Okabe and Ito
INK, GREY, PALE = "#1a1a1a", "#6b6b6b", "#c8c8c8"

CONDITION_COLOURS = {
    "odometry": GREY,
    "straight": BLUE,
    "refracted": ORANGE,
    "straight-all": SKY,
    "no-ranges": GREEN,
}
_MORE_COLOURS = (PINK, "#882255", "#332288", "#999933", "#44AA99", "#AA4499")  # after Okabe and Ito, Tol
_MARKERS = "osD^v<>phd"
DISTINCT = len(_MORE_COLOURS)
"""Conditions besides the study's own that have a colour each."""
_RC: Any = {  # any: matplotlib's types allow only a dictionary with all settings
    "axes.axisbelow": True,
    "axes.edgecolor": INK,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 7.5,
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 7.5,
    "figure.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 7.0,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.5,
    "legend.columnspacing": 1.5,
    "legend.fontsize": 6.5,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "lines.linewidth": 1.1,
    "pdf.fonttype": 42,
    "savefig.facecolor": "white",
    "xtick.color": INK,
    "xtick.direction": "out",
    "xtick.labelsize": 7.0,
    "xtick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.color": INK,
    "ytick.direction": "out",
    "ytick.labelsize": 7.0,
    "ytick.major.width": 0.6,
    "ytick.minor.width": 0.4,
}

_P = ParamSpec("_P")
_R = TypeVar("_R")


def styled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """
    Run a function under the common style, whatever the user's own settings are.

    Parameters
    ----------
    function : callable
        Makes or saves a figure.

    Returns
    -------
    callable
    """

    @functools.wraps(function)
    def wrapper(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with mpl.rc_context():
            mpl.rcdefaults()
            mpl.rcParams.update(_RC)
            return function(*args, **kwargs)

    return wrapper


def new_figure(width: float, height: float, header: str, *, layout: str | None = "constrained") -> Figure:
    """
    Empty figure with a small line on top that says which water it shows.

    Parameters
    ----------
    width, height : float
        Size. [in]
    header : str
        From `ocean_header`; empty for none.
    layout : str or None
        Layout engine; None where axes are placed by hand, as three-dimensional ones must be.

    Returns
    -------
    matplotlib.figure.Figure
        With an Agg canvas, unknown to pyplot.
    """
    figure = Figure(figsize=(width, height), layout=layout)  # type: ignore[arg-type]
    FigureCanvasAgg(figure)
    if header:
        kwargs: dict[str, Any] = {} if layout else {"y": 1.0 - 0.04 / height, "va": "top"}
        figure.suptitle(plain(header), x=0.06 / width, ha="left", fontsize=6.5, color=GREY, **kwargs)
    return figure


def condition_style(name: str) -> tuple[str, str]:
    """
    Colour and label of a ranging condition.

    Parameters
    ----------
    name : str

    Returns
    -------
    colour, label : str
        Pink and the name itself for a condition that is not one of the study's own.
    """
    return CONDITION_COLOURS.get(name, PINK), plain(condition_label(name))


def condition_looks(conditions: Sequence[str]) -> dict[str, tuple[str, str]]:
    """
    Colour and marker of each condition of one figure, different where `condition_style` has one colour for all others.

    Parameters
    ----------
    conditions : sequence of str

    Returns
    -------
    dict of str to tuple of str
        From each condition to its colour and marker. Colours come again after six estimators.
    """
    more, markers = cycle(_MORE_COLOURS), cycle(_MARKERS)
    return {
        name: (CONDITION_COLOURS[name] if name in CONDITION_COLOURS else next(more), next(markers))
        for name in conditions
    }


def panel_title(axes: Axes, letter: str, text: str) -> None:
    """
    Title of one panel of several.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    letter : str
        The panel's letter.
    text : str
    """
    axes.set_title(f"({letter}) {text}", loc="left", fontsize=7.5)


def common_legend(figure: Figure, handles: Sequence[Artist], **options: Any) -> None:
    """
    Legend for all panels: on the line of the header where it fits there, else below the panels.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    handles : sequence of matplotlib.artist.Artist
        With labels. If there are more than `HEADER_LINE` and the figure lays itself out, room is made.
    **options
        Of `matplotlib.figure.Figure.legend`.
    """
    place = (
        "outside lower center" if len(handles) > HEADER_LINE and figure.get_layout_engine() else "upper right"
    )
    look: dict[str, Any] = {"loc": place, "ncols": len(handles), "borderaxespad": 0.1, **options}
    figure.legend(handles=handles, **look)


def note(axes: Axes, text: str) -> None:
    """
    Say in the middle of a panel why it is empty.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    text : str
    """
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=GREY)


def halo() -> list[AbstractPathEffect]:
    """
    White outline that keeps text readable on lines.

    Returns
    -------
    list of matplotlib.patheffects.AbstractPathEffect
        For a text's ``path_effects``.
    """
    return [withStroke(linewidth=1.6, foreground="white")]


def freeze_layout(figure: Figure) -> None:
    """
    Lay a figure out once and for all, so that drawing it again does not.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    """
    if figure.get_layout_engine() is not None:
        figure.draw_without_rendering()
        figure.set_layout_engine("none")


@styled
def save_figure(figure: Figure, folder: Path, name: str) -> list[Path]:
    """
    Write a figure as PNG and PDF, each whole or not at all, the same bytes each time.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    folder : pathlib.Path
        Made if it is not there.
    name : str
        File name without its ending.

    Returns
    -------
    list of pathlib.Path
        The PNG and the PDF.

    Raises
    ------
    ReportError
        If a file cannot be written.
    """
    metadata: dict[str, dict[str, Any]] = {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    }
    freeze_layout(figure)
    paths = []
    for kind, entries in metadata.items():
        path = folder / f"{name}.{kind}"
        temporary = folder / f".{name}.{os.getpid()}.part"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            figure.savefig(temporary, format=kind, dpi=PNG_DPI, metadata=entries)
            temporary.replace(path)
        except OSError as error:
            raise ReportError(f"{path}: figure cannot be written: {error.strerror or error}") from None
        finally:
            temporary.unlink(missing_ok=True)
        paths.append(path)
    return paths
