"""All conditions and estimators side by side: how far off they are, and whether they know it."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from pymantaray.report.style import (
    CONDITION_COLOURS,
    DOUBLE,
    GREY,
    INK,
    common_legend,
    condition_style,
    new_figure,
    panel_title,
    styled,
)

_ROW = 0.17  # height of a line [in]
_BAND = "#dcdcdc"
_BASELINE = "straight"


@styled
def error_and_consistency(errors: pd.DataFrame, consistency: pd.DataFrame | None, header: str) -> Figure:
    """
    Root mean square of the position error, and NEES of the fleet, a line for each condition.

    Parameters
    ----------
    errors : pandas.DataFrame
        From `pymantaray.evaluation.error_table`, pooled.
    consistency : pandas.DataFrame or None
        From `pymantaray.evaluation.consistency.consistency_table`, of the fleet; None leaves out the second panel.
    header : str
        From `ocean_header`.

    Returns
    -------
    matplotlib.figure.Figure
        The dashed line is the error with straight ranges. NEES is horizontal, by its degrees of freedom: median over the epochs
        and least to greatest, in full where all epochs lie within their 95 % bounds, empty where none does.
    """
    names = list(errors["condition"])
    y = np.arange(len(names))
    rmse = errors["rmse_m"].to_numpy(dtype=float)
    panels = 1 if consistency is None else 2
    figure = new_figure(DOUBLE, (0.8 if consistency is None else 1.0) + _ROW * len(names), header)
    grid = figure.subplots(1, panels, sharey=True, squeeze=False)[0]
    colours = [CONDITION_COLOURS.get(name, INK) for name in names]
    axes, handles = grid[0], list[Line2D | Patch]()
    panel_title(axes, "a", "position error, root mean square")
    if _BASELINE in names and np.isfinite(rmse[names.index(_BASELINE)]):
        look: dict[str, Any] = {"color": GREY, "linewidth": 0.8, "linestyle": "--"}
        axes.axvline(rmse[names.index(_BASELINE)], **look)
        handles.append(Line2D([], [], label=f"error, {condition_style(_BASELINE)[1].lower()}", **look))
    axes.scatter(rmse, y, c=colours, s=14.0, zorder=3)
    for x, line in zip(rmse, y, strict=True):
        if np.isfinite(x):
            axes.annotate(
                f"{x:.2f}" if x < 100.0 else f"{x:.1f}",
                (x, line),
                (5, 0),
                textcoords="offset points",
                va="center",
                fontsize=6.0,
            )
    axes.set_xscale("log")
    axes.margins(x=0.12)
    axes.set_yticks(y, [condition_style(name)[1] for name in names])
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlabel("[m]")
    if consistency is not None:
        _draw_consistency(grid[1], consistency[consistency["statistic"] == "horizontal"], names, colours)
        panel_title(grid[1], "b", "horizontal NEES of the fleet / degrees of freedom")
        grid[1].set_xlabel("[-]")
        handles += [
            Patch(color=_BAND, label="95 % bounds"),
            _mark(INK, "inside at every epoch"),
            _mark(GREY, "at some"),
            _mark("white", "at none"),
        ]
        grid[1].tick_params(axis="y", left=False)
    if handles:
        common_legend(figure, handles)
    for panel in grid:
        panel.grid(visible=False, axis="y")
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    return figure


def _mark(face: str, label: str) -> Line2D:
    return Line2D(
        [], [], color=INK, marker="o", markersize=3.8, markerfacecolor=face, linestyle="none", label=label
    )


def _draw_consistency(axes: Axes, table: pd.DataFrame, names: list[str], colours: list[str]) -> None:
    if len(table):
        axes.axvspan(float(table["low"].median()), float(table["high"].median()), color=_BAND, linewidth=0.0)
    axes.axvline(1.0, color=GREY, linewidth=0.8)
    for i, (name, colour) in enumerate(zip(names, colours, strict=True)):
        part = table[table["condition"] == name]
        if part.empty:
            continue
        ratio, inside = part["ratio"].to_numpy(dtype=float), part["inside"].to_numpy(dtype=bool)
        face = colour if inside.all() else GREY if inside.any() else "white"
        axes.plot([ratio.min(), ratio.max()], [i, i], color=colour, linewidth=0.9)
        axes.plot(np.median(ratio), i, color=colour, marker="o", markersize=3.8, markerfacecolor=face)
    axes.set_xscale("log")
