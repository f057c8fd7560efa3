"""
Common style of all figures: colours, labels and elements, with ``mantaray.mplstyle``; and their
files.
"""

import functools
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import as_file, files
from io import BytesIO
from itertools import cycle, islice
from pathlib import Path
from string import ascii_lowercase
from textwrap import fill, wrap
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
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import (
    FuncFormatter,
    LogFormatterMathtext,
    LogLocator,
    MaxNLocator,
    NullFormatter,
)
from numpy.typing import NDArray
from PIL import Image

from pymantaray.errors import WriteError
from pymantaray.jobs.progress import Progress
from pymantaray.plotting.formats import FIGURE_FORMATS, ONE_COLUMN, PRINTED, checked_formats
from pymantaray.records import whole_file

with warnings.catch_warnings():
    # cmocean 4.0 makes its maps in a way that matplotlib 3.11 has deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    import cmocean

COLUMN, DOUBLE = 84.0 / 25.4, 174.0 / 25.4
"""Widths of one column and of both in journals: 84 and 174 mm. [in]"""
_HEADER_LINE_HEIGHT = 0.125  # [in]
_HEADER_TOP = 0.04  # inches above a header
HEADER_LINE = 4
"""Maximum number of legend entries on the line of the header, for figures over both columns."""

BLUE = "#0072B2"  # Okabe and Ito
ORANGE = "#D55E00"
GREEN = "#009E73"
SKY = "#56B4E9"
PINK = "#CC79A7"
INK = "#1a1a1a"
GREY = "#6b6b6b"
PALE = "#c8c8c8"
BAND = "#dcdcdc"
BED = "#8d7f70"
SHORE = "#4a4038"
ICE = "#ffffff"

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
# colours after Okabe and Ito, and Tol
_MORE_COLOURS = (PINK, "#882255", "#332288", "#999933", "#44AA99", "#AA4499")
DISTINCT = len(_MORE_COLOURS)
"""Number of estimators with a colour of their own."""
_MAX_DECADES = 9  # ticks at powers of ten
_PER_LINE = 5  # entries of a legend below the panels
_BELOW_LABEL = 4.2  # from an axis to the space below its label, in sizes of a legend's letters
_LEGEND_LINE = 0.14  # height of its lines [in]
_TITLE_LETTERS = 17.5  # of a title in an inch of its panel
_BESIDE_PANEL = 0.45  # inches beside a panel that its title does not cover
_MIN_TITLE = 10  # letters of a line of a title
_MARKERS = "osD^v<>phd"
# signs of markers in text
_SIGNS = dict(zip(("o", ".", *_MARKERS[1:], "x", "+"), "●●■◆▲▼◀▶⬟⬢♦×+", strict=True))
_FITS = 28  # characters of a name on a figure
_LETTERS_PER_INCH = 19.0  # of a header
_SYNTHETIC = "synthetic ocean"
_COMPRESSION = 7  # of a PNG; 9 takes six times as long for 6 % less
_EXACT_COLOURS = 64  # of 256 in a picture of few
_HEADER_GAP = 6.0  # points between a header and a legend on its line

with as_file(files("pymantaray.plotting") / "mantaray.mplstyle") as _file:
    _STYLE: Any = ["default", mpl.rc_params_from_file(_file, use_default_template=False)]
_P = ParamSpec("_P")
_R = TypeVar("_R")


def _stretch(colormap: Colormap, low: float, high: float) -> Colormap:
    """Part of a colour map on which lines are visible."""
    return LinearSegmentedColormap.from_list(colormap.name, colormap(np.linspace(low, high, 256)))


SOUND_SPEED = _stretch(cmocean.cm.ice, 0.99, 0.55)
"""
Sound speed in all figures and pages: light blues, slow light, fast dark. Black, grey and orange
lines stand out on all of them.
"""
LEVELS = _stretch(cmocean.cm.thermal, 0.12, 0.98)
"""Range errors and shares on maps of an atlas."""
FLOOR = _stretch(cmocean.cm.deep, 0.04, 0.85)
"""Depth of the sea floor in plan: shallow light, deep dark."""


def styled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """
    Decorator that makes or saves a figure with the common style, independent of the user's
    settings.
    """

    @functools.wraps(function)
    def wrapper(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with mpl.style.context(_STYLE):
            return function(*args, **kwargs)

    return wrapper


def new_figure(
    width: float, height: float, header: str, *, layout: str | None = "constrained"
) -> Figure:
    """
    Empty figure with a size in inches and a small header that describes the water; pyplot does not
    know it. A header of more than one line makes it higher.

    Without a layout engine, the caller places the axes, which is necessary for three-dimensional
    ones.
    """
    together = plain(header).replace(_SYNTHETIC, _SYNTHETIC.replace(" ", "\u00a0"))
    lines = wrap(together, int(_LETTERS_PER_INCH * width))
    height += _HEADER_LINE_HEIGHT * max(len(lines) - 1, 0)
    figure = Figure(figsize=(width, height), layout=layout)  # type: ignore[arg-type]
    FigureCanvasAgg(figure)
    if header:
        kwargs: dict[str, Any] = {} if layout else {"y": 1.0 - _HEADER_TOP / height, "va": "top"}
        figure.suptitle(
            "\n".join(lines).replace("\u00a0", " "),
            x=0.06 / width,
            ha="left",
            fontsize=6.5,
            color=GREY,
            **kwargs,
        )
    return figure


def in_one_column(figure: Figure) -> bool:
    """True if a figure is laid out for one column of a journal."""
    return bool(figure.get_figwidth() < 0.5 * (COLUMN + DOUBLE))


def panel_figure(
    width: float,
    header: str,
    count: int,
    *,
    height: float,
    stacked: float | Sequence[float],
    **grid: Any,
) -> tuple[Figure, list[Axes]]:
    """
    Figure with panels beside each other for both columns of a journal, below each other for one.

    Parameters
    ----------
    width : float
        `DOUBLE`, or `COLUMN` for one column. [in]
    header : str
        Line on top that describes the water.
    count : int
        Number of panels.
    height : float
        Height of the figure over both columns. [in]
    stacked : float or sequence of float
        Height of a panel in one column with its title and labels, or of each panel. [in]
    **grid
        Options of `matplotlib.figure.Figure.subplots` over both columns. Panels below each other
        share their horizontal axis if it is the same quantity with ``sharex=True``.

    Returns
    -------
    tuple of matplotlib.figure.Figure and list of matplotlib.axes.Axes
        The figure, and its panels from left to right or from top to bottom.
    """
    if width > COLUMN:
        figure = new_figure(width, height, header)
        return figure, list(figure.subplots(1, count, squeeze=False, **grid)[0])
    heights = [stacked] * count if isinstance(stacked, int | float) else list(stacked)
    figure = new_figure(width, 0.2 + sum(heights), header)
    kept = {name: value for name, value in grid.items() if name in ("sharex", "sharey")}
    panels = figure.subplots(count, 1, squeeze=False, height_ratios=heights, **kept)[:, 0]
    for axes in panels:
        axes.tick_params(labelbottom=True)
    return figure, list(panels)


def ocean_header(attrs: Mapping[Any, Any]) -> str:
    """One line about the water of a figure; it always marks a synthetic ocean."""
    parts = [ocean_name(attrs)]
    if is_synthetic(attrs):
        parts.append(_SYNTHETIC)
    if attrs.get("time"):
        parts.append(f"{str(attrs['time'])[:16].replace('T', ' ')} UTC")
    return ", ".join(parts)


def ocean_name(attrs: Mapping[Any, Any]) -> str:
    """Name of an ocean without the note that it is synthetic."""
    return (
        str(attrs.get("title", "unnamed ocean")).replace("(synthetic)", "").strip()
        or "unnamed ocean"
    )


def is_synthetic(attrs: Mapping[Any, Any]) -> bool:
    """True if the attributes of a data set say that its ocean is synthetic."""
    return bool(int(attrs.get("synthetic", 0)))


def short(name: str, fits: int = _FITS) -> str:
    """Name shortened to fit on a figure, with an ellipsis if it was too long."""
    return name if len(name) <= fits else name[: fits - 1].rstrip() + "…"


def shortened(names: Sequence[str], fits: int = _FITS) -> list[str]:
    """
    Distinct names shortened to fit on a figure: at their ends, otherwise in their middle, otherwise
    with numbers.
    """
    half = fits // 2
    middle = [name if len(name) <= fits else f"{name[: half - 1]}…{name[-half:]}" for name in names]
    numbered = [f"{i}: {short(name, fits - 5)}" for i, name in enumerate(names, 1)]
    cuts = ([short(name, fits) for name in names], middle, numbered)
    return next(cut for cut in cuts if len(set(cut)) == len(names))


def clock(hours: float) -> str:
    """Time since the start in hours and minutes, with seconds if they are not zero."""
    seconds = round(3600.0 * hours)
    text = f"{seconds // 3600} h {seconds // 60 % 60:02d} min"
    return f"{text} {seconds % 60:02d} s" if seconds % 60 else text


def plain(text: str) -> str:
    """Text for matplotlib with escaped dollar signs, which would start mathematics."""
    return text.replace("$", r"\$")


def condition_label(name: str) -> str:
    """Label of a ranging condition; for an estimator, its name."""
    return CONDITION_LABELS.get(name, name)


def condition_labels(names: Sequence[str]) -> dict[str, str]:
    """Labels of ranging conditions and estimators that fit on a figure, by name."""
    labels = shortened([condition_label(name) for name in names])
    return {name: plain(label) for name, label in zip(names, labels, strict=True)}


def condition_line(name: str) -> Any:
    """Line style of a ranging condition; lines below it are visible through its gaps."""
    return _CONDITION_LINES.get(name, "-")


def condition_looks(conditions: Sequence[str]) -> dict[str, tuple[str, str]]:
    """
    Colour and marker of each condition of a run, the same on all its figures; colours repeat after
    `DISTINCT` estimators.
    """
    more = cycle(_MORE_COLOURS)
    markers = cycle(_MARKERS)
    return {
        name: (CONDITION_COLOURS[name] if name in CONDITION_COLOURS else next(more), next(markers))
        for name in conditions
    }


def vehicle_colours(count: int) -> list[str]:
    """Colours of vehicles, which repeat after the eleventh."""
    return list(islice(cycle((BLUE, ORANGE, GREEN, PINK, SKY, *_MORE_COLOURS[1:], GREY)), count))


def letter(panel: int) -> str:
    """Letter of a panel by its number; letters repeat after z."""
    return ascii_lowercase[panel % len(ascii_lowercase)]


def panel_title(axes: Axes, letter: str, text: str, *, share: float = 1.0) -> None:
    """Title of one panel of several, in lines that fit above it; ``share`` as in `fitting`."""
    axes.set_title(fitting(axes, f"({letter}) {text}", share=share), loc="left")


def fitting(axes: Axes, title: str, *, share: float = 1.0) -> str:
    """
    Title in lines that fit above a panel of a figure for one column of a journal.

    ``share`` is the width of what is drawn over that of the panel, less than 1 for a high map.
    """
    figure = axes.get_figure(root=True)
    place = axes.get_subplotspec()
    if figure is None or place is None or not in_one_column(figure):
        return title
    panel = figure.get_figwidth() * len(place.colspan) / place.get_gridspec().ncols
    letters = max(int(_TITLE_LETTERS * share * (panel - _BESIDE_PANEL)), _MIN_TITLE)
    # a part between two commas stays on one line if it fits there
    parts = [p if len(p) > letters else p.replace(" ", "\u00a0") for p in title.split(", ")]
    return fill(", ".join(parts), letters).replace("\u00a0", " ")


class LogTicks(LogLocator):
    """
    Ticks of a logarithmic axis, at least two: powers of ten, otherwise 1, 2 and 5 of each decade,
    otherwise equal steps.
    """

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
                return inside[:: -(-inside.size // _MAX_DECADES)] if len(subs) == 1 else inside
        return MaxNLocator(4, steps=[1, 2, 5, 10]).tick_values(low, high)


def short_numbers(axis: Axis) -> None:
    """
    Label only the major ticks of a logarithmic axis: as 0.1, 1, 10, or as powers of ten if it
    extends to 100,000 or more.
    """
    powers = LogFormatterMathtext()
    powers.set_axis(axis)

    def text(value: float, position: int | None) -> str:
        return powers(value, position) if axis.get_view_interval()[1] >= 1e5 else f"{value:g}"

    axis.set_major_locator(LogTicks())
    axis.set_major_formatter(FuncFormatter(text))
    axis.set_minor_formatter(NullFormatter())


def entry(label: str, **look: Any) -> Line2D:
    """Line or marker for a legend only."""
    return Line2D([], [], label=label, **look)


def legend_lines(entries: int) -> int:
    """Number of lines of `common_legend` below the panels; 0 if it is on the line of the header."""
    return 0 if entries <= HEADER_LINE else -(-entries // _PER_LINE)


def common_legend(figure: Figure, handles: Sequence[Artist], **options: Any) -> None:
    """
    Legend for all panels: on the line of the header if it fits, otherwise below the panels.

    In one column of a journal, it is below the panels with as many entries on a line as fit, and
    makes the figure higher.
    """
    if in_one_column(figure):
        _legend_of_column(figure, handles, options)
        return
    if legend_lines(len(handles)):
        below = "lower center" if figure.get_layout_engine() is None else "outside lower center"
        place: dict[str, Any] = {"loc": below, "ncols": min(len(handles), _PER_LINE)}
    else:
        place = {"loc": "upper right", "ncols": len(handles)}
    legend = figure.legend(handles=handles, borderaxespad=0.1, **(place | options))
    if (place | options)["loc"] == "upper right":
        _separate(figure, legend)


def legend_below(axes: Axes) -> None:
    """Legend of one panel of several, on a line below the label of its horizontal axis."""
    figure = axes.get_figure(root=True)
    narrow = figure is not None and in_one_column(figure)
    axes.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, 0.0),
        borderaxespad=_BELOW_LABEL,
        ncols=2 if narrow else _PER_LINE,
    )


def _legend_of_column(figure: Figure, handles: Sequence[Artist], options: dict[str, Any]) -> None:
    """Legend below the panels of a narrow figure, whose lines do not exceed its width."""
    placed = figure.get_layout_engine() is None
    below = "lower center" if placed else "outside lower center"
    kwargs: dict[str, Any] = {"loc": below, "borderaxespad": 0.1} | options
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    for columns in range(int(kwargs.pop("ncols", min(len(handles), _PER_LINE))), 0, -1):
        legend = figure.legend(handles=handles, ncols=columns, **kwargs)
        if columns == 1 or legend.get_window_extent(renderer).width <= figure.bbox.width:
            break
        legend.remove()
    if not placed and "outside" in kwargs["loc"]:
        lines = -(-len(handles) // columns)
        figure.set_figheight(figure.get_figheight() + _LEGEND_LINE * lines)


def _separate(figure: Figure, legend: Legend) -> None:
    """Move a legend below a header that leaves it no room on its line."""
    header = figure._suptitle  # type: ignore[attr-defined]
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    gap = _HEADER_GAP * figure.dpi / 72.0
    box = legend.get_window_extent(renderer)
    if header is None or header.get_window_extent(renderer).x1 <= box.x0 - gap:
        return
    below = _HEADER_TOP + header.get_window_extent(renderer).height / figure.dpi
    room = box.height / figure.dpi  # [in]
    engine = figure.get_layout_engine()
    if engine is None:
        _grow(figure, room)
    else:
        figure.set_figheight(figure.get_figheight() + room)
        rect = (0.0, 0.0, 1.0, 1.0 - room / figure.get_figheight())
        engine.set(rect=rect)  # type: ignore[call-arg]
    legend.set_bbox_to_anchor((1.0, 1.0 - below / figure.get_figheight()))


def _grow(figure: Figure, room: float) -> None:
    """Add room at the top of a figure without a layout engine, below its header. [in]"""
    before = figure.get_figheight()
    share = before / (before + room)
    figure.set_figheight(before + room)
    for axes in figure.axes:
        place = axes.get_position(original=True)
        axes.set_position((place.x0, share * place.y0, place.width, share * place.height))
    for text in figure.texts:
        text.set_y(share * text.get_position()[1])
    figure._suptitle.set_y(1.0 - _HEADER_TOP / (before + room))  # type: ignore[attr-defined]


def legend_entries(figure: Figure) -> list[tuple[str, str, str]]:
    """
    Entries of a figure's legends as sign, colour and text, for pages that are too narrow for the
    figure.
    """
    entries = []
    own = (axes.get_legend() for axes in figure.axes)
    for legend in (*figure.legends, *(legend for legend in own if legend is not None)):
        for handle, words in zip(legend.legend_handles, legend.get_texts(), strict=True):
            if isinstance(handle, Line2D):
                line = "━" if handle.get_linestyle() == "-" else "╍"
                sign = _SIGNS.get(str(handle.get_marker()), line)
                sign = "○" if handle.get_markerfacecolor() == "white" else sign
                colour = handle.get_color()
            else:
                sign = "■"
                colour = handle.get_facecolor()  # type: ignore[union-attr]
            entries.append((sign, to_hex(colour), words.get_text().replace(r"\$", "$")))
    return entries


def note(axes: Axes, text: str) -> None:
    """Write the reason for an empty panel in its middle."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=GREY)


def halo() -> list[AbstractPathEffect]:
    """White outline that keeps text readable on lines."""
    return [withStroke(linewidth=1.6, foreground="white")]


def freeze_layout(figure: Figure) -> None:
    """Lay out a figure once; later drawing keeps this layout."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        # with "none", each file is drawn once more before it is drawn
        figure.set_layout_engine(None)


@styled
def rendered(
    figure: Figure, kinds: Sequence[str], *, dpi: float | None = None, few_colours: bool = False
) -> dict[str, bytes]:
    """
    Figure as files of some of the kinds ``png``, ``pdf`` and ``svg``, always with the same bytes;
    default dots per inch: the style's. A PNG of few colours has 256, and less than half the size.
    """
    metadata: dict[str, dict[str, Any]] = {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
        "svg": {"Date": None, "Creator": None},
    }
    dpi = dpi or mpl.rcParams["savefig.dpi"]
    freeze_layout(figure)
    content = {}
    for kind in kinds:
        with BytesIO() as file:
            if few_colours and kind == "png":
                _save_few_colours(figure, file, dpi)
            else:
                figure.savefig(file, format=kind, metadata=metadata[kind], dpi=dpi)
            content[kind] = file.getvalue()
    return content


def _save_few_colours(figure: Figure, file: BytesIO, dpi: float) -> None:
    """Write a figure as a PNG of 256 colours, which is compressed only once."""
    before = figure.dpi
    figure.dpi = dpi
    canvas: Any = FigureCanvasAgg(figure)  # untyped
    canvas.draw()
    figure.dpi = before
    _few_colours(np.asarray(canvas.buffer_rgba())).save(file, "PNG", compress_level=_COMPRESSION)


def _few_colours(pixels: NDArray[np.uint8]) -> Image.Image:
    """
    Picture of 256 colours of opaque pixels (height, width, 4).

    The most frequent colours stay as they are. A median cut of all others chooses the rest, each
    with the square root of its number of pixels, which takes a third of the time of a median cut of
    all pixels. Pixels are counted by runs of one colour.
    """
    words = np.ascontiguousarray(pixels).view(np.uint32).ravel()
    start = np.flatnonzero(np.diff(words, prepend=~words[:1]))
    length = np.diff(start, append=words.size)
    colours, row = np.unique(words[start], return_inverse=True)
    count = np.bincount(row, length).astype(np.intp)
    order = np.argsort(-count, kind="stable")
    rgb = colours[order].view(np.uint8).reshape(-1, 4)[:, :3]
    place = np.arange(order.size)  # in the palette, of colours by frequency
    palette = rgb[:_EXACT_COLOURS].tobytes()
    if order.size > _EXACT_COLOURS:
        weight = np.ceil(np.sqrt(count[order][_EXACT_COLOURS:])).astype(np.intp)
        line = np.repeat(rgb[_EXACT_COLOURS:], weight, axis=0)[np.newaxis]
        others = Image.fromarray(line).quantize(256 - _EXACT_COLOURS)
        place[_EXACT_COLOURS:] = _EXACT_COLOURS + np.asarray(others)[0, np.cumsum(weight) - 1]
        palette += bytes(others.getpalette() or ())
    index = np.empty(order.size, dtype=np.uint8)
    index[order] = place
    few = Image.fromarray(np.repeat(index[row], length).reshape(pixels.shape[:2]))
    few.putpalette(palette[: 3 * 256])
    return few


def write_figures(
    draw: Mapping[str, Callable[[float], Figure]],
    folder: str | Path,
    *,
    formats: Sequence[str] = (),
    progress: Progress | None = None,
) -> list[Path]:
    """
    Draw figures by name and write them as PNG and PDF into a folder, which is created if necessary.

    Each function draws a figure for a width [in]. ``formats`` adds ``svg``, gives the PNG 300 dots
    per inch (``png``), or adds PNG and PDF of the layout for one column of a journal (``84mm``).
    """
    checked_formats(formats, FIGURE_FORMATS)
    target = Path(folder)
    kinds = ("png", "pdf", *(["svg"] if "svg" in formats else []))
    dpi = PRINTED if "png" in formats else None
    layouts = [(DOUBLE, "", kinds)]
    if ONE_COLUMN in formats:
        layouts.append((COLUMN, f".{ONE_COLUMN}", ("png", "pdf")))
    written = list[Path]()
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(f"{folder}: cannot be created: {error.strerror or error}") from None
    for i, (name, figure) in enumerate(draw.items()):
        for width, suffix, own in layouts:
            for kind, content in rendered(figure(width), own, dpi=dpi).items():
                written.append(target / f"{name}{suffix}.{kind}")
                with whole_file(written[-1]) as temporary:
                    temporary.write_bytes(content)
        if progress is not None:
            progress("figures", i + 1, len(draw))
    return written


def axes_or_new(axes: Axes | None) -> Axes:
    """Axes to draw on, by default those of a new figure."""
    import matplotlib.pyplot as plt

    return plt.subplots(layout="constrained")[1] if axes is None else axes
