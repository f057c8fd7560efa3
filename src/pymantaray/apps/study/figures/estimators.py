"""Comparison of all conditions and estimators: position errors and consistency."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator

from pymantaray.apps.study.figures.register import register
from pymantaray.arrays import Array
from pymantaray.evaluation.ping_error import BASELINE
from pymantaray.pages import style

_ROW = 0.17  # height of a line [in]


@style.styled
def error_and_consistency(
    errors: pd.DataFrame, at_pings: pd.DataFrame, consistency: pd.DataFrame | None, header: str
) -> Figure:
    """
    RMSE of the position at all times and at pings, and NEES of the fleet if it exists, with one
    line per condition.

    A marker of NEES is filled if all epochs are within their 95 % bounds, and empty if none is.
    """
    names = list(errors["condition"])
    panels = 2 if consistency is None else 3
    figure = style.new_figure(style.DOUBLE, 1.0 + _ROW * len(names), header)
    grid = figure.subplots(1, panels, sharey=True, squeeze=False)[0]
    colours = [colour for colour, _ in style.condition_looks(names).values()]
    handles = list[Line2D | Patch]()
    under_water = at_pings.set_index("condition").reindex(names)
    _draw_errors(grid[0], errors["rmse_m"].to_numpy(), colours)
    _draw_errors(grid[1], under_water["rmse_m"].to_numpy(), colours)
    for least in under_water.loc[under_water.index == BASELINE, "bound_rmse_m"].dropna():
        look: dict[str, Any] = {"color": style.GREY, "linewidth": 0.8, "linestyle": "--"}
        handles.append(grid[1].axvline(least, label="lower bound", **look))
    axes = grid[0]
    axes.set_yticks(range(len(names)), list(style.condition_labels(names).values()))
    axes.set_ylim(len(names) - 0.4, -0.6)
    style.panel_title(axes, "a", "error at all times")
    style.panel_title(grid[1], "b", "under water at pings")
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
    for panel in grid:
        panel.grid(visible=False, axis="y")
        style.short_numbers(panel.xaxis)
    for panel in grid[1:]:
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
    draw=lambda r: error_and_consistency(
        r.tables["ate_pooled"].frame,
        r.tables["ping_error"].frame,
        r.tables["consistency_per_epoch"].frame if "consistency_per_epoch" in r.tables else None,
        r.header,
    ),
    needs=lambda r: any(not c.standard for c in r.run.study.conditions),
)
