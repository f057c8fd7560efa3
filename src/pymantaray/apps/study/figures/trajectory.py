"""
Effect of refraction on estimated positions: errors at a glance, pooled by condition, by vehicle,
and over time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator
from numpy.typing import NDArray

from pymantaray.apps.study.figures.ranging import draw_range_errors
from pymantaray.apps.study.figures.register import RunResults, both_widths, register
from pymantaray.arrays import Array
from pymantaray.plotting import style

_LOG_BINS = 100
_LINEAR_BINS = 60
_ROOF = 0.78  # share of a row's height for the distribution; text is above it
# limit of a linear axis, as a multiple of the median over conditions of their ends
_AXIS_RATIO = 3.0
_RIDGE, _MIN_RIDGE, _HIGHEST = 0.6, 0.45, 8.0
"""Height of a row of distributions in one column, the least one, and of all rows together. [in]"""
_SMALLEST_ERROR = 1e-4  # m; smaller errors are drawn at this value
_MAX_NAMED_VEHICLES = 30  # vehicles whose names fit below the axis
_LETTERS = 14  # of names in an inch of the axis
_NARROW_NAME = 18  # letters of a title above one of two panels in one column
_GROUP = 0.8  # width of the markers of a vehicle, in distances between vehicles


@dataclass(frozen=True, eq=False)
class ApePanel:
    """One column of `pooled_ape`."""

    title: str
    errors: Mapping[str, Array]
    log: bool


def shown_over_time(results: RunResults) -> Mapping[str, Array]:
    """
    Errors of all conditions, or of the study's conditions if there are too many estimators for one
    panel.
    """
    conditions = {c.name for c in results.run.study.conditions if c.standard}
    if len(results.errors) - len(conditions) <= style.DISTINCT:
        return results.errors
    return {name: errors for name, errors in results.errors.items() if name in conditions}


def _caption_over_time(results: RunResults) -> str:
    shown = shown_over_time(results)
    shaded = ", quartiles shaded" if len(shown) <= style.HEADER_LINE else ""
    others = "; estimators are in the next figure" if len(shown) < len(results.errors) else ""
    fixes = "; GNSS fixes are marked at the bottom" if results.fixes.any() else ""
    return (
        "Position error of each vehicle over time: median of"
        f" {results.realizations}{shaded}{others}{fixes}."
    )


@style.styled
def pooled_ape(panels: Sequence[ApePanel], header: str, *, width: float = style.DOUBLE) -> Figure:
    """Distribution of the translational error, all vehicles, times and realizations pooled."""
    conditions = list(dict.fromkeys(name for panel in panels for name in panel.errors))
    figure, grid = _ape_grid(max(len(conditions), 1), len(panels), header, width)
    pooled = [
        {name: values[np.isfinite(values)] for name, values in panel.errors.items()}
        for panel in panels
    ]
    edges = {
        log: _ape_edges(
            [p for p, panel in zip(pooled, panels, strict=True) if panel.log == log], log=log
        )
        for log in {panel.log for panel in panels}
    }
    looks = style.condition_looks(conditions)
    labels = style.condition_labels(conditions)
    for c, (panel, values) in enumerate(zip(panels, pooled, strict=True)):
        style.panel_title(grid[0, c], style.letter(c), style.plain(style.short(panel.title)))
        grid[-1, c].set_xlabel("Absolute position error [m]")
        for axes, name in zip(grid[:, c], conditions, strict=False):
            _ridge(
                axes,
                values.get(name, np.empty(0)),
                edges[panel.log],
                (labels[name], looks[name][0]),
                log=panel.log,
            )
    figure.supylabel("Share of poses in a bin [%]")
    mean = style.entry("mean", color=style.INK, linewidth=1.2)
    style.common_legend(
        figure, [mean, style.entry("quartiles", color=style.INK, linewidth=0.8, linestyle="--")]
    )
    return figure


def _ape_grid(rows: int, columns: int, header: str, width: float) -> tuple[Figure, NDArray[Any]]:
    """
    Figure with the axes of `pooled_ape`, rows by columns; for one column of a journal, the columns
    are below each other.
    """
    if width > style.COLUMN:
        figure = style.new_figure(width, 0.85 + 0.72 * rows, header)
        return figure, figure.subplots(rows, columns, squeeze=False, sharex="col")
    high = max(_MIN_RIDGE, min(_RIDGE, _HIGHEST / (rows * columns)))
    figure = style.new_figure(width, 0.2 + columns * (0.5 + high * rows), header)
    # an empty row between two blocks, for the label of the upper and the title of the lower one
    gaps = [*[high] * rows, 0.12] * columns
    every = figure.add_gridspec(len(gaps) - 1, 1, height_ratios=gaps[:-1])
    grid = np.empty((rows, columns), dtype=object)
    for c in range(columns):
        for row in range(rows):
            shared = {"sharex": grid[0, c]} if row else {}
            grid[row, c] = figure.add_subplot(every[c * (rows + 1) + row, 0], **shared)
            grid[row, c].tick_params(labelbottom=row == rows - 1)
    return figure, grid


def _panel_grid(panels: int, lines: int, header: str, width: float) -> tuple[Figure, NDArray[Any]]:
    """Figure with the axes of each panel, rows by columns, above this many lines of legend."""
    columns = min(3 if width > style.COLUMN else 2, panels)
    rows = -(-panels // columns)
    legend = 0.06 + 0.14 * lines if lines else 0.0  # room for it below the panels [in]
    height = 0.8 + legend + (1.2 if columns > 1 else 2.2) * rows
    figure = style.new_figure(width, height, header, layout=None)
    top = 0.42 + figure.get_figheight() - height  # below the lines of the header [in]
    height = figure.get_figheight()
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    figure.subplots_adjust(
        left=0.55 / width,
        right=1.0 - 0.18 / width,
        bottom=(0.45 + legend) / height,
        top=1.0 - top / height,
        wspace=0.15,
        hspace=0.38,
    )
    figure.supxlabel("Time [h]", y=(0.06 + legend) / height, va="bottom")
    figure.supylabel("Position error [m]", x=0.06 / width, ha="left")
    return figure, grid


@style.styled
def error_over_time(
    time: Array,
    names: Sequence[str],
    errors: Mapping[str, Array],
    fixes: NDArray[np.bool_],
    header: str,
    *,
    width: float = style.DOUBLE,
) -> Figure:
    """
    Position error of every vehicle over time: median over the realizations, with shaded quartiles
    for few conditions.
    """
    entries = len(errors) + bool(fixes.any())
    per_line = 2 if width == style.COLUMN else 0  # as `style.common_legend` has them
    lines = -(-entries // per_line) if per_line else style.legend_lines(entries)
    figure, grid = _panel_grid(max(len(names), 1), lines, header, width)
    hours = time / 3600.0
    looks = style.condition_looks(list(errors))
    _set_shared_axes(grid[0, 0], hours)
    for axes in grid.flat:
        axes.set_autoscaley_on(False)  # until all lines are there
    for name, values in errors.items():
        whole = values[np.isfinite(values).all(axis=(1, 2))]
        if not len(whole):
            continue
        low, middle, high = np.maximum(np.percentile(whole, [25, 50, 75], axis=0), _SMALLEST_ERROR)
        for i, axes in enumerate(grid.flat[: len(names)]):
            if len(errors) <= style.HEADER_LINE:
                axes.fill_between(
                    hours, low[i], high[i], color=looks[name][0], alpha=0.25, linewidth=0.0
                )
            axes.plot(
                hours,
                middle[i],
                color=looks[name][0],
                linewidth=0.9,
                linestyle=style.condition_line(name),
            )
    titles = style.shortened(names, _NARROW_NAME) if width == style.COLUMN else names
    for i, axes in enumerate(grid.flat):
        if i >= len(names):
            axes.set_visible(False)
            continue
        axes.set_title(style.plain(titles[i]), loc="left", fontweight="bold")
        # GNSS fixes at the bottom, as one line, since each costs as much as all
        at = hours[fixes[i]]
        axes.plot(
            np.repeat(at, 3),
            np.tile([0.0, 0.045, np.nan], at.size),
            color=style.SKY,
            linewidth=0.6,
            transform=axes.get_xaxis_transform(),
            solid_capstyle="butt",
        )
        if i + grid.shape[1] >= len(names):
            axes.tick_params(labelbottom=True)
    for axes in grid.flat:
        axes.set_autoscaley_on(True)
    labels = style.condition_labels(list(errors))
    handles = [
        style.entry(
            labels[name],
            color=looks[name][0],
            linestyle=style.condition_line(name),
        )
        for name in errors
    ]
    if fixes.any():
        handles.append(style.entry("GNSS fix", color=style.SKY, linewidth=2.5))
    below: dict[str, Any] = {"loc": "lower center", "ncols": per_line} if per_line else {}
    style.common_legend(figure, handles, **below)
    return figure


def _error_over_time_of(results: RunResults, width: float) -> Figure:
    truth = results.run.truth
    errors = shown_over_time(results)
    names = truth.name.tolist()
    return error_over_time(truth.time, names, errors, results.fixes, results.header, width=width)


def _set_shared_axes(axes: Axes, hours: Array) -> None:
    """
    Set scales and limits that all panels share, because each change takes the time of all panels.
    """
    axes.set_yscale("log")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xlim(hours[0], hours[-1])
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))


def draw_error_distribution(
    axes: Axes, errors: Mapping[str, Array], condition: str, *, log: bool
) -> None:
    """
    Draw the distribution of the position errors of a condition, with mean and quartiles, on the
    common axis of all conditions.
    """
    finite = {name: values[np.isfinite(values)] for name, values in errors.items()}
    colour = style.condition_looks(list(errors))[condition][0]
    label = style.condition_labels(list(errors))[condition]
    _ridge(axes, finite[condition], _ape_edges([finite], log=log), (label, colour), log=log)
    axes.set(xlabel="Absolute position error [m]", ylabel="Share of poses in a bin [%]")


def _ape_edges(pools: Sequence[Mapping[str, Array]], *, log: bool) -> Array:
    """
    Common edges of bins for all panels of one scale.

    A linear axis shows nearly all poses of the conditions other than odometry, but does not extend
    far beyond most of them.
    """
    drawn = [(name, values) for pool in pools for name, values in pool.items() if values.size]
    if not drawn:
        return np.geomspace(0.1, 10.0, 3) if log else np.linspace(0.0, 1.0, 3)
    if log:
        low = max(min(float(values.min()) for _, values in drawn), _SMALLEST_ERROR)
        high = max(max(float(values.max()) for _, values in drawn), 2.0 * low)
        return np.geomspace(0.999 * low, 1.001 * high, _LOG_BINS + 1)
    solved = [values for name, values in drawn if name != "odometry"] or [
        values for _, values in drawn
    ]
    each = [float(np.percentile(values, 99.9)) for values in solved]
    reach = min(max(each), _AXIS_RATIO * float(np.median(each)))
    return np.linspace(0.0, max(1.05 * reach, _SMALLEST_ERROR), _LINEAR_BINS + 1)


def _ridge(
    axes: Axes, values: Array, edges: Array, condition: tuple[str, str], *, log: bool
) -> None:
    """Draw the distribution of one condition; ``condition`` is its label and colour."""
    label, colour = condition
    axes.grid(visible=False, axis="y")
    figure = axes.get_figure(root=True)
    narrow = figure is not None and style.in_one_column(figure)
    axes.locator_params(axis="y", nbins=2 if narrow else 3)
    if log:
        axes.set_xscale("log")
        style.short_numbers(axes.xaxis)
    axes.set_xlim(edges[0], edges[-1])
    place: dict[str, Any] = {"transform": axes.transAxes, "va": "top", "path_effects": style.halo()}
    axes.text(0.015, 0.98, label, color=colour, fontweight="bold", **place)
    if not values.size:
        style.note(axes, "no usable solve")
        return
    share = 100.0 * np.histogram(np.maximum(values, edges[0]), edges)[0] / values.size
    axes.stairs(share, edges, fill=True, color=colour, alpha=0.35, linewidth=0.0)
    axes.stairs(share, edges, color=colour, linewidth=0.8)
    mean = float(values.mean())
    axes.axvline(mean, ymax=_ROOF, color=style.INK, linewidth=1.2)
    for quartile in np.percentile(values, [25.0, 75.0]):
        axes.axvline(quartile, ymax=_ROOF, color=style.INK, linewidth=0.8, linestyle=(0, (4, 2)))
    beyond = 100.0 * float(np.mean(values > edges[-1]))
    words = "beyond" if narrow else "beyond the axis"
    left_out = f", {beyond:.0f} % {words}" if beyond >= 0.5 else ""
    axes.text(
        0.985,
        0.98,
        f"mean {f'{mean:#.3g}'.rstrip('.')} m{left_out}",
        color=style.GREY,
        ha="right",
        **place,
    )
    axes.set_ylim(0.0, max(float(share.max()), 1e-6) / (_ROOF - 0.04))


register(
    "ape_pooled",
    place=30,
    paper="Figures 7 and 8",
    caption="Absolute position error of all vehicles, times and {r.realizations} of the noise by"
    " ranging condition, without alignment; mean solid, quartiles dashed; (a) logarithmic scale,"
    " (b) linear scale, which shows nearly all errors of the conditions other than odometry.",
    **both_widths(
        lambda r, width: pooled_ape(
            [
                ApePanel("logarithmic scale", r.errors, log=True),
                ApePanel("linear scale", r.errors, log=False),
            ],
            r.header,
            width=width,
        )
    ),
    needs=lambda r: r.run.study.solves,
)
register(
    "error_over_time",
    place=40,
    caption=_caption_over_time,
    **both_widths(_error_over_time_of),
    needs=lambda r: r.run.study.solves,
)


@style.styled
def refraction(
    ranges: Array, errors: Mapping[str, Array], header: str, *, width: float = style.DOUBLE
) -> Figure:
    """Histogram of range errors, and mean and quartiles of the position errors by condition."""
    heights = [2.15, 0.75 + 0.18 * len(errors)][: 2 if errors else 1]
    figure, (counts, *others) = style.panel_figure(
        width, header, len(heights), height=2.35, stacked=heights
    )
    draw_range_errors(counts, ranges)
    style.panel_title(counts, "a", "range error")
    style.legend_below(counts)
    for axes in others:
        looks = style.condition_looks(list(errors))
        for row, (name, values) in enumerate(errors.items()):
            usable = values[np.isfinite(values)]
            if usable.size:
                colour = looks[name][0]
                axes.hlines(row, *np.quantile(usable, [0.25, 0.75]), color=colour, linewidth=2.0)
                axes.plot(usable.mean(), row, "o", color=colour, markersize=5.0)
        axes.set_xscale("log")
        style.short_numbers(axes.xaxis)
        names = [style.plain(style.short(style.condition_label(name), 22)) for name in errors]
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("Position error [m]")
        style.panel_title(axes, "b", "position error: mean, quartiles")
    return figure


def _errors(results: RunResults) -> Mapping[str, Array]:
    return shown_over_time(results) if results.run.study.solves else {}


register(
    "refraction",
    place=0,
    caption=lambda r: (
        "Effect of refraction. (a) Error of each range, refracted minus straight."
        + (
            " (b) Mean (dot) and quartiles (line) of the position errors over all vehicles, times"
            " and realizations."
            if _errors(r)
            else ""
        )
    ),
    **both_widths(lambda r, width: refraction(r.ranges.total, _errors(r), r.header, width=width)),
)


@style.styled
def error_by_vehicle(table: pd.DataFrame, header: str, *, width: float = style.DOUBLE) -> Figure:
    """RMSE and quartiles of the position error of each vehicle under each condition."""
    conditions = list(dict.fromkeys(table["condition"]))
    below = 0.0 if width == style.COLUMN else 0.14 * style.legend_lines(len(conditions))
    figure, (axes,) = style.panel_figure(width, header, 1, height=2.3 + below, stacked=2.2)
    draw_vehicle_errors(axes, table)
    style.common_legend(figure, axes.get_legend_handles_labels()[0])
    return figure


def draw_vehicle_errors(axes: Axes, table: pd.DataFrame) -> None:
    """
    Draw RMSE (dots) and quartiles (lines) of the rows of ``ate_per_vehicle``, with conditions next
    to each other.
    """
    vehicles = list(dict.fromkeys(table["vehicle"]))
    conditions = list(dict.fromkeys(table["condition"]))
    looks = style.condition_looks(conditions)
    labels = style.condition_labels(conditions)
    for k, condition in enumerate(conditions):
        rows = table[table["condition"] == condition].set_index("vehicle").reindex(vehicles)
        x = np.arange(len(vehicles)) + _GROUP * ((k + 0.5) / len(conditions) - 0.5)
        colour = looks[condition][0]
        axes.vlines(x, rows["p25_m"], rows["p75_m"], color=colour, linewidth=1.4, alpha=0.5)
        axes.plot(x, rows["rmse_m"], "o", color=colour, markersize=3.5, label=labels[condition])
    axes.set_yscale("log")
    style.short_numbers(axes.yaxis)
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.6, len(vehicles) - 0.4)
    names = [style.plain(name) for name in style.shortened([*map(str, vehicles)], 12)]
    figure = axes.get_figure(root=True)
    inches = style.DOUBLE if figure is None else figure.get_figwidth()
    upright = sum(map(len, names)) + 2 * len(names) > inches * _LETTERS
    axes.set_xticks(range(len(vehicles)), names, rotation=90 if upright else 0)
    axes.set(xlabel="Vehicle", ylabel="Position error [m]")


def _shown(results: RunResults) -> bool:
    if not results.run.study.solves or len(results.run.truth.name) > _MAX_NAMED_VEHICLES:
        return False
    return bool(results.tables["ate_per_vehicle"].frame["rmse_m"].notna().any())


register(
    "error_by_vehicle",
    place=45,
    caption="Position error of each vehicle over all times and {r.realizations}, by ranging"
    " condition: RMSE (dots) and quartiles (lines).",
    **both_widths(
        lambda r, width: error_by_vehicle(r.tables["ate_per_vehicle"].frame, r.header, width=width)
    ),
    needs=_shown,
)
