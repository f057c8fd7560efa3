"""
Comparison of all conditions and estimators: position errors, consistency over time, and estimates
of water and clocks.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from pymantaray.apps.study.figures.register import both_widths, register
from pymantaray.apps.study.tables import RunTables
from pymantaray.arrays import Array
from pymantaray.evaluation.ping_error import BASELINE
from pymantaray.plotting import style

_ROW = 0.17  # height of a line [in]
_HEIGHT = 1.35  # of a panel [in]
_LEVEL = 110  # letters of names that fit on the axis level
_PANELS = (("horizontal", "horizontal positions of the fleet"), ("ranges", "ranges of a ping"))
# share of the time axis between neighbouring conditions; all of them take half a step at most
_DODGE = 0.012
_ZOOM = 2.5  # half height of the lower row in widths of the band
_TICKS = 10  # epochs that are all labelled
_LINEAR_REACH = 4.0  # above this, or below its inverse, ratios need a logarithmic axis


@style.styled
def error_and_consistency(
    errors: pd.DataFrame,
    at_pings: pd.DataFrame,
    consistency: pd.DataFrame | None,
    header: str,
    *,
    width: float = style.DOUBLE,
) -> Figure:
    """
    RMSE of the position at all times and at pings, and NEES of the fleet if it exists, with one
    line per condition.

    A marker of NEES is filled if all epochs are within their 95 % bounds, and empty if none is.
    """
    # one row of panels, one line per condition
    names = list(errors["condition"])
    panels = 2 if consistency is None else 3
    rows = _ROW * len(names)
    figure, grid = style.panel_figure(
        width, header, panels, height=1.0 + rows, stacked=0.75 + rows, sharey=True
    )
    colours = [colour for colour, _ in style.condition_looks(names).values()]
    handles = list[Line2D | Patch]()
    # errors at all times and at pings, with the lower bound
    under_water = at_pings.set_index("condition").reindex(names)
    _draw_errors(grid[0], errors["rmse_m"].to_numpy(), colours)
    _draw_errors(grid[1], under_water["rmse_m"].to_numpy(), colours)
    for least in under_water.loc[under_water.index == BASELINE, "bound_rmse_m"].dropna():
        look: dict[str, Any] = {"color": style.GREY, "linewidth": 0.8, "linestyle": "--"}
        handles.append(grid[1].axvline(least, label="lower bound", **look))
    # names and titles
    axes = grid[0]
    axes.set_yticks(range(len(names)), list(style.condition_labels(names).values()))
    axes.set_ylim(len(names) - 0.4, -0.6)
    style.panel_title(axes, "a", "error at all times")
    style.panel_title(grid[1], "b", "under water at pings")
    # NEES within its bounds, and the legend of its markers
    if consistency is not None:
        _draw_consistency(
            grid[2], consistency[consistency["statistic"] == "horizontal"], names, colours
        )
        style.panel_title(grid[2], "c", "horizontal NEES / d.o.f.")
        grid[2].set_xlabel("[-]")
        point: dict[str, Any] = {
            "color": style.INK,
            "marker": "o",
            "markersize": 3.8,
            "linestyle": "none",
        }
        faces = {"inside at every epoch": style.INK, "at some": style.GREY, "at none": "white"}
        handles.append(Patch(color=style.BAND, label="95 % bounds"))
        handles += [
            style.entry(label, markerfacecolor=face, **point) for label, face in faces.items()
        ]
    if handles:
        style.common_legend(figure, handles)
    # grids and ticks
    for panel in grid:
        panel.grid(visible=False, axis="y")
        style.short_numbers(panel.xaxis)
    for panel in grid[1:] if width > style.COLUMN else ():
        panel.tick_params(axis="y", left=False)
    if panels == 2:
        for panel in grid:
            panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    return figure


def _draw_errors(axes: Axes, rmse: Array, colours: list[str]) -> None:
    axes.scatter(rmse, range(rmse.size), c=colours, s=14.0, zorder=3)
    for line, x in enumerate(rmse):
        if np.isfinite(x):
            text = f"{x:.2f}" if x < 100.0 else f"{x:.1f}"
            axes.annotate(
                text, (x, line), (5, 0), textcoords="offset points", va="center", fontsize=6.0
            )
    axes.set_xscale("log")
    axes.margins(x=0.2)
    axes.set_xlabel("[m]")


def _draw_consistency(
    axes: Axes, table: pd.DataFrame, names: list[str], colours: list[str]
) -> None:
    if len(table):
        axes.axvspan(
            float(table["low"].median()),
            float(table["high"].median()),
            color=style.BAND,
            linewidth=0.0,
        )
    axes.axvline(1.0, color=style.GREY, linewidth=0.8)
    for i, (name, colour) in enumerate(zip(names, colours, strict=True)):
        part = table[table["condition"] == name]
        if part.empty:
            continue
        ratio = part["ratio"].to_numpy()
        inside = part["inside"].to_numpy()
        face = colour if inside.all() else style.GREY if inside.any() else "white"
        axes.plot([ratio.min(), ratio.max()], [i, i], color=colour, linewidth=0.9)
        axes.plot(
            np.median(ratio), i, color=colour, marker="o", markersize=3.8, markerfacecolor=face
        )
    axes.set_xscale("log")


register(
    "estimators",
    place=50,
    caption="Errors and consistency of all estimators over {r.realizations}: (a) root mean square"
    " of the position error over all poses; (b) the same for vehicles under water at the pings;"
    " dashed: lower bound of an unbiased estimator with these measurements, on average over the"
    " noise; (c) normalized squared error of the fleet's horizontal positions with the covariance"
    " of the estimator, divided by its degrees of freedom: median over the epochs, minimum and"
    " maximum, and the 95 % bounds of a consistent estimator (grey).",
    **both_widths(
        lambda r, width: error_and_consistency(
            r.tables["ate_pooled"].frame,
            r.tables["ping_error"].frame,
            r.tables["consistency_per_epoch"].frame
            if "consistency_per_epoch" in r.tables
            else None,
            r.header,
            width=width,
        )
    ),
    needs=lambda r: any(not c.standard for c in r.run.study.conditions),
)


@style.styled
def unknowns_before_and_after(
    table: pd.DataFrame, header: str, *, width: float = style.DOUBLE
) -> Figure:
    """
    Posterior standard deviation and error of every unknown, divided by its prior standard
    deviation.
    """
    conditions = list(dict.fromkeys(table["condition"]))
    names = [table.loc[table["condition"] == name, "unknown"] for name in conditions]
    # names would touch on an axis of the figure's width
    level = _LEVEL * width / style.DOUBLE
    upright = [len(each) * (int(each.str.len().max()) + 2) > level for each in names]
    heights = [_HEIGHT + (0.6 if turned else 0.0) for turned in upright]
    figure = style.new_figure(width, 0.5 + sum(heights), header)
    grid = figure.subplots(len(conditions), 1, sharey=True, squeeze=False)[:, 0]
    after = {
        "color": style.BLUE,
        "markersize": 9.0,
        "markeredgewidth": 1.6,
        "label": "posterior standard deviation",
    }
    error = {"color": style.ORANGE, "markersize": 3.2, "label": "root mean square error"}
    for i, (axes, name) in enumerate(zip(grid, conditions, strict=True)):
        part = table[table["condition"] == name]
        x = np.arange(len(part))
        prior = part["prior_sigma"].to_numpy(dtype=float)
        line = axes.axhline(1.0, color=style.GREY, linewidth=0.8, label="before")
        points = axes.plot(x, part["sigma"] / prior, "_", **after)
        points += axes.plot(x, part["rms_error"] / prior, "o", **error)
        axes.set(yscale="log", xlim=(-0.6, len(part) - 0.4))
        axes.set_xticks(
            x,
            [style.plain(unknown) for unknown in part["unknown"]],
            rotation=90 if upright[i] else 0,
        )
        axes.grid(visible=False, axis="x")
        style.short_numbers(axes.yaxis)
        style.panel_title(axes, style.letter(i), style.plain(name))
    figure.supylabel("In prior standard deviations [-]")
    style.common_legend(figure, [*points, line])
    return figure


def _with_prior(tables: RunTables) -> pd.DataFrame:
    """Unknowns with a prior; a fitted standard deviation has none."""
    return tables["unknowns"].frame.dropna(subset="prior_sigma")


register(
    "unknowns",
    place=65,
    caption="Sound-speed modes and clocks estimated together with the poses, over"
    " {r.realizations}: posterior standard deviation (blue) and root mean square error (orange),"
    " both divided by the prior standard deviation. On the grey line, the ranges contain no"
    " information.",
    **both_widths(
        lambda r, width: unknowns_before_and_after(_with_prior(r.tables), r.header, width=width)
    ),
    needs=lambda r: "unknowns" in r.tables and len(_with_prior(r.tables)) > 0,
)


@style.styled
def consistency_over_time(
    table: pd.DataFrame,
    header: str,
    conditions: Sequence[str] = (),
    *,
    width: float = style.DOUBLE,
) -> Figure:
    """
    NEES of the fleet and innovations of its ranges, divided by their degrees of freedom, at the
    fixed epochs.

    ``conditions`` are all conditions of the run, so that colours do not depend on the rows of the
    table.
    """
    tested = list(dict.fromkeys(table["condition"]))
    every = style.condition_looks(list(dict.fromkeys([*conditions, *tested])))
    looks = {name: every[name] for name in tested}
    tables = [table[table["statistic"] == key] for key, _ in _PANELS]
    # ratios far from 1 have a logarithmic axis, and a second row near the bounds
    ratio = np.concatenate([part["ratio"].to_numpy() for part in tables])
    log = bool(ratio.size) and bool(
        ratio.max() > _LINEAR_REACH or ratio.min() < 1.0 / _LINEAR_REACH
    )
    figure, grid = _consistency_grid(2 if log else 1, len(looks), header, width)
    for c, (part, (_, title)) in enumerate(zip(tables, _PANELS, strict=True)):
        style.panel_title(grid[0, c], "ab"[c], title)
        for axes in grid[:, c]:
            _draw(axes, part, looks)
        if width > style.COLUMN or c == len(_PANELS) - 1:
            grid[-1, c].set_xlabel("Time [h]")
        if log:
            style.panel_title(grid[1, c], "cd"[c], "the same, near the bounds")
            grid[0, c].set_yscale("log")
            style.short_numbers(grid[0, c].yaxis)
            if len(part):
                reach = _ZOOM * float(np.maximum(part["high"] - 1.0, 1.0 - part["low"]).max())
                grid[1, c].set_ylim(max(1.0 - reach, 0.0), 1.0 + reach)
    # few epochs are the ticks
    hours = np.unique(np.concatenate([part["time_h"].to_numpy() for part in tables]))
    if 0 < hours.size <= _TICKS:
        grid[-1, 0].set_xticks(hours)
    for axes in grid[:, 0]:
        axes.set_ylabel("NEES / degrees of freedom")
    for axes in grid[:, 1]:
        axes.set_ylabel("NIS / degrees of freedom")
    # one legend for all panels
    point = {"markersize": 3.6}
    labels = style.condition_labels(list(looks))
    handles = [
        style.entry(
            labels[name],
            color=colour,
            marker=marker,
            linewidth=0.9,
            **point,
        )
        for name, (colour, marker) in looks.items()
    ]
    outside = {
        "color": style.INK,
        "marker": "o",
        "markerfacecolor": "white",
        "linestyle": "none",
        **point,
    }
    band = Patch(color=style.BAND, label="95 % bounds")
    style.common_legend(figure, [*handles, band, style.entry("outside its bounds", **outside)])
    return figure


def _consistency_grid(
    rows: int, conditions: int, header: str, width: float
) -> tuple[Figure, NDArray[Any]]:
    """
    Figure with the axes of `consistency_over_time`, rows by statistics; for one column of a
    journal, all of them are below each other.
    """
    count = len(_PANELS)
    if width == style.COLUMN:
        figure = style.new_figure(width, 0.5 + 1.5 * rows * count, header)
        return figure, figure.subplots(rows * count, 1, sharex=True).reshape(rows, count)
    lines = style.legend_lines(conditions + 2)
    figure = style.new_figure(width, 0.75 + 1.6 * rows + 0.14 * lines, header)
    return figure, figure.subplots(rows, count, sharex=True, squeeze=False)


def _draw(axes: Axes, table: pd.DataFrame, looks: dict[str, tuple[str, str]]) -> None:
    if table.empty:
        style.note(axes, "no usable solve")
        return
    axes.axhline(1.0, color=style.GREY, linewidth=0.8)
    hours = np.unique(table["time_h"].to_numpy())
    step = float(np.diff(hours).min()) if hours.size > 1 else 1.0
    first = float(hours[0]) - 0.5 * step
    last = float(hours[-1]) + 0.5 * step
    bounds = (
        table.sort_values("degrees_of_freedom", kind="stable")
        .groupby("time_h")[["low", "high"]]
        .last()
    )
    edges = np.concatenate([[first], 0.5 * (hours[1:] + hours[:-1]), [last]])
    low, high = (bounds[side].to_numpy() for side in ("low", "high"))
    axes.fill_between(
        edges, [*low, low[-1]], [*high, high[-1]], step="post", color=style.BAND, linewidth=0.0
    )
    shown = [name for name in looks if (table["condition"] == name).any()]
    dodge = min(_DODGE * (last - first), 0.5 * step / len(shown))
    for i, name in enumerate(shown):
        part = table[table["condition"] == name]
        colour, marker = looks[name]
        x = part["time_h"] + (i - 0.5 * (len(shown) - 1)) * dodge
        axes.plot(x, part["ratio"], color=colour, linewidth=0.9)
        for inside in (True, False):
            chosen = part["inside"].to_numpy() == inside
            look: Any = {
                "color": colour,
                "markerfacecolor": colour if inside else "white",
                "markersize": 3.6,
            }
            axes.plot(x[chosen], part["ratio"][chosen], marker, **look)
    axes.set_xlim(first, last)


register(
    "consistency",
    place=60,
    caption="Consistency over {r.realizations} at fixed epochs: (a) normalized squared error of"
    " the fleet's horizontal positions with their joint covariance, (b) normalized squared"
    " innovation of the ranges of a ping, each divided by its degrees of freedom; (c, d), if"
    " present, show the same near the bounds. A consistent estimator has a mean of 1 and lies"
    " within the grey 95 % bounds; empty markers are outside.",
    **both_widths(
        lambda r, width: consistency_over_time(
            r.tables["consistency_per_epoch"].frame, r.header, list(r.errors), width=width
        )
    ),
    needs=lambda r: "consistency_per_epoch" in r.tables,
)
