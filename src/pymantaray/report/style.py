"""One look for all figures: colours, words and pieces that they share, under ``mantaray.mplstyle``; and their files."""

import functools
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import as_file, files
from io import BytesIO
from itertools import cycle, islice
from pathlib import Path
from string import ascii_lowercase
from typing import Any, ParamSpec, TypeVar

import matplotlib as mpl
import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, LinearSegmentedColormap, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import FuncFormatter, LogFormatterMathtext, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from pymantaray.errors import WriteError
from pymantaray.jobs.progress import Progress
from pymantaray.records import whole_file

with warnings.catch_warnings():
    # cmocean 4.0 makes its maps in a way that matplotlib 3.11 has deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    import cmocean

Array = NDArray[np.float64]
COLUMN, DOUBLE = 84.0 / 25.4, 174.0 / 25.4
"""Widths of one column and of both in journals: 84 and 174 mm. [in]"""
HEADER_LINE = 4
"""Entries of a legend that fit beside the header over both columns."""

BLUE, ORANGE, GREEN, SKY, PINK = "#0072B2", "#D55E00", "#009E73", "#56B4E9", "#CC79A7"  # Okabe and Ito
INK, GREY, PALE, BAND = "#1a1a1a", "#6b6b6b", "#c8c8c8", "#dcdcdc"
BED, SHORE, ICE = "#8d7f70", "#4a4038", "#ffffff"

CONDITION_COLOURS = {
    "odometry": GREY,
    "straight": BLUE,
    "refracted": ORANGE,
    "straight-all": SKY,
    "no-ranges": GREEN,
}
_CONDITION_LINES = {
    "refracted": (0, (4.0, 1.2)),
    "straight-all": (0, (1.2, 0.9)),
    "no-ranges": (0, (6.0, 1.2, 1.2, 1.2)),
}
CONDITION_LABELS = {
    "odometry": "Odometry only",
    "straight": "Straight ranges",
    "refracted": "Refracted ranges",
    "straight-all": "Straight, no dropouts",
    "no-ranges": "Graph without ranges",
}
_MORE_COLOURS = (PINK, "#882255", "#332288", "#999933", "#44AA99", "#AA4499")  # after Okabe and Ito, Tol
DISTINCT = len(_MORE_COLOURS)
"""Conditions besides the study's own that have a colour each."""
_MOST_DECADES = 9  # ticks at powers of ten
_PER_LINE = 5  # entries of a legend below the panels
_MARKERS = "osD^v<>phd"
_SIGNS = dict(zip(("o", ".", *_MARKERS[1:], "x", "+"), "●●■◆▲▼◀▶⬟⬢♦×+", strict=True))  # of markers in text
_FITS = 28  # characters of a name on a figure
_FITS_ABOVE = 16  # beside a legend of `HEADER_LINE` entries

with as_file(files("pymantaray.report") / "mantaray.mplstyle") as _file:
    _STYLE: Any = ["default", mpl.rc_params_from_file(_file, use_default_template=False)]
_P = ParamSpec("_P")
_R = TypeVar("_R")


def _stretch(colormap: Colormap, low: float, high: float) -> Colormap:
    """Part of a colour map on which lines can be read."""
    return LinearSegmentedColormap.from_list(colormap.name, colormap(np.linspace(low, high, 256)))


SOUND_SPEED = _stretch(cmocean.cm.ice, 0.99, 0.55)
"""Light blues: black, grey and orange lines stand out on all of them."""
WATER = _stretch(cmocean.cm.thermal, 0.12, 0.98)
"""Sound speed where its structure is the subject: slow dark, fast light."""
FLOOR = _stretch(cmocean.cm.deep, 0.04, 0.85)
"""Depth of the sea floor in plan: shallow light, deep dark."""


def styled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Make or save a figure under the common style, whatever the user's own settings are."""

    @functools.wraps(function)
    def wrapper(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with mpl.style.context(_STYLE):
            return function(*args, **kwargs)

    return wrapper


def new_figure(width: float, height: float, header: str, *, layout: str | None = "constrained") -> Figure:
    """
    Empty figure, in inches, with a small line on top that says which water it shows; unknown to pyplot.

    Without a layout engine axes are placed by hand, as three-dimensional ones must be.
    """
    figure = Figure(figsize=(width, height), layout=layout)  # type: ignore[arg-type]
    FigureCanvasAgg(figure)
    if header:
        kwargs: dict[str, Any] = {} if layout else {"y": 1.0 - 0.04 / height, "va": "top"}
        figure.suptitle(plain(header), x=0.06 / width, ha="left", fontsize=6.5, color=GREY, **kwargs)
    return figure


def ocean_header(attrs: Mapping[Any, Any]) -> str:
    """One line on the water that a figure shows; a synthetic ocean is always called that."""
    parts = [short(ocean_name(attrs), _FITS_ABOVE)]
    if is_synthetic(attrs):
        parts.append("synthetic ocean")
    if attrs.get("time"):
        parts.append(f"{str(attrs['time'])[:16].replace('T', ' ')} UTC")
    return ", ".join(parts)


def ocean_name(attrs: Mapping[Any, Any]) -> str:
    """Name of an ocean without the note that it is synthetic."""
    return str(attrs.get("title", "unnamed ocean")).replace("(synthetic)", "").strip() or "unnamed ocean"


def is_synthetic(attrs: Mapping[Any, Any]) -> bool:
    """True if the attributes of a data set say that its ocean is synthetic."""
    return bool(int(attrs.get("synthetic", 0)))


def short(name: str, fits: int = _FITS) -> str:
    """Name cut to what fits on a figure, with an ellipsis if something was cut."""
    return name if len(name) <= fits else name[: fits - 1].rstrip() + "…"


def shortened(names: Sequence[str]) -> list[str]:
    """Names cut to what fits on a figure and still unlike: at their ends, else before their last letters, else numbered."""
    half = _FITS // 2
    middle = [name if len(name) <= _FITS else f"{name[: half - 1]}…{name[-half:]}" for name in names]
    numbered = [f"{i}: {short(name, _FITS - 5)}" for i, name in enumerate(names, 1)]
    cuts = ([short(name) for name in names], middle, numbered)
    return next(cut for cut in cuts if len(set(cut)) == len(names))


def clock(hours: float) -> str:
    """Time since the start in hours and minutes, and in seconds if there are some."""
    seconds = round(3600.0 * hours)
    text = f"{seconds // 3600} h {seconds // 60 % 60:02d} min"
    return f"{text} {seconds % 60:02d} s" if seconds % 60 else text


def plain(text: str) -> str:
    """Text as matplotlib shows it literally: dollar signs start no mathematics."""
    return text.replace("$", r"\$")


def condition_label(name: str) -> str:
    """Words for a ranging condition; the name itself for an estimator's."""
    return CONDITION_LABELS.get(name, name)


def condition_line(name: str) -> Any:
    """Line style of a ranging condition: what lies under another shows through its gaps."""
    return _CONDITION_LINES.get(name, "-")


def condition_looks(conditions: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Colour and marker of each of a run's conditions, the same on all its figures; colours come again after `DISTINCT` estimators."""
    more, markers = cycle(_MORE_COLOURS), cycle(_MARKERS)
    return {
        name: (CONDITION_COLOURS[name] if name in CONDITION_COLOURS else next(more), next(markers))
        for name in conditions
    }


def vehicle_colours(count: int) -> list[str]:
    """A colour each for vehicles, which come again after the eleventh."""
    return list(islice(cycle((BLUE, ORANGE, GREEN, PINK, SKY, *_MORE_COLOURS[1:], GREY)), count))


def letter(panel: int) -> str:
    """Letter of a panel by its number: a to z, and again."""
    return ascii_lowercase[panel % len(ascii_lowercase)]


def panel_title(axes: Axes, letter: str, text: str) -> None:
    """Title of one panel of several."""
    axes.set_title(f"({letter}) {text}", loc="left")


class LogTicks(LogLocator):
    """Ticks of a logarithmic axis: powers of ten, else 1, 2 and 5 of each decade, else even steps; always at least two."""

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Ticks from one value to another."""
        low, high = sorted((vmin, vmax))
        if not low > 0.0:
            return super().tick_values(vmin, vmax)
        decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
        for subs in ((1.0,), (1.0, 2.0, 5.0)):
            ticks = np.outer(decades, subs).ravel()
            inside = ticks[(ticks >= low * (1.0 - 1e-9)) & (ticks <= high * (1.0 + 1e-9))]
            if inside.size > 1:
                return inside[:: -(-inside.size // _MOST_DECADES)] if len(subs) == 1 else inside
        return MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(low, high)


def short_numbers(axis: Axis) -> None:
    """Write major ticks of a logarithmic axis, and only these: as 0.1, 1, 10, on an axis up to 100,000 and more as powers of ten."""
    powers = LogFormatterMathtext()
    powers.set_axis(axis)

    def text(value: float, position: int | None) -> str:
        return powers(value, position) if axis.get_view_interval()[1] >= 1e5 else f"{value:g}"

    axis.set_major_locator(LogTicks())
    axis.set_major_formatter(FuncFormatter(text))
    axis.set_minor_formatter(NullFormatter())


def entry(label: str, **look: Any) -> Line2D:
    """Line or marker that stands in a legend only."""
    return Line2D([], [], label=label, **look)


def legend_lines(entries: int) -> int:
    """Lines of `common_legend` below the panels; 0 where it stands beside the header."""
    return 0 if entries <= HEADER_LINE else -(-entries // _PER_LINE)


def common_legend(figure: Figure, handles: Sequence[Artist], **options: Any) -> None:
    """Legend for all panels: on the line of the header where it fits there, else below the panels."""
    if legend_lines(len(handles)):
        below = "lower center" if figure.get_layout_engine() is None else "outside lower center"
        place: dict[str, Any] = {"loc": below, "ncols": min(len(handles), _PER_LINE)}
    else:
        place = {"loc": "upper right", "ncols": len(handles)}
    figure.legend(handles=handles, borderaxespad=0.1, **(place | options))


def legend_entries(figure: Figure) -> list[tuple[str, str, str]]:
    """Entries of a figure's common legend as text: a sign, its colour, and the words; for pages too narrow for the figure."""
    entries = []
    for legend in figure.legends:
        for handle, words in zip(legend.legend_handles, legend.get_texts(), strict=True):
            if isinstance(handle, Line2D):
                line = "━" if handle.get_linestyle() == "-" else "╍"
                sign = _SIGNS.get(str(handle.get_marker()), line)
                sign = "○" if handle.get_markerfacecolor() == "white" else sign
                colour = handle.get_color()
            else:
                sign, colour = "■", handle.get_facecolor()  # type: ignore[union-attr]
            entries.append((sign, to_hex(colour), words.get_text().replace(r"\$", "$")))
    return entries


def note(axes: Axes, text: str) -> None:
    """Say in the middle of a panel why it is empty."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=GREY)


def halo() -> list[AbstractPathEffect]:
    """White outline that keeps text readable on lines."""
    return [withStroke(linewidth=1.6, foreground="white")]


def freeze_layout(figure: Figure) -> None:
    """Lay a figure out once and for all, so that drawing it again does not."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")


@styled
def rendered(figure: Figure, kinds: Sequence[str], *, dpi: float | None = None) -> dict[str, bytes]:
    """Figure as files of these kinds, ``png``, ``pdf`` and ``svg``, the same bytes each time; dots per inch by default those of the style."""
    metadata: dict[str, dict[str, Any]] = {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
        "svg": {"Date": None, "Creator": None},
    }
    freeze_layout(figure)
    content = {}
    for kind in kinds:
        with BytesIO() as file:
            figure.savefig(file, format=kind, metadata=metadata[kind], dpi=dpi or mpl.rcParams["savefig.dpi"])
            content[kind] = file.getvalue()
    return content


def write_figures(
    draw: Mapping[str, Callable[[], Figure]],
    folder: str | Path,
    progress: Progress | None = None,
) -> list[Path]:
    """Draw figures, each by its name, and write them as PNG and PDF into a folder, which is made if it is not there."""
    target, written = Path(folder), list[Path]()
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(f"{folder}: cannot be made: {error.strerror or error}") from None
    for i, (name, figure) in enumerate(draw.items()):
        for kind, content in rendered(figure(), ("png", "pdf")).items():
            written.append(target / f"{name}.{kind}")
            with whole_file(written[-1]) as temporary:
                temporary.write_bytes(content)
        if progress is not None:
            progress("figures", i + 1, len(draw))
    return written
