"""Consistency of estimators: NEES and range innovations over time, with their bounds."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pymantaray.apps.study.figures.register import register
from pymantaray.pages import style

_PANELS = (("horizontal", "horizontal positions of the fleet"), ("ranges", "ranges of a ping"))
# share of the time axis between neighbouring conditions; all of them take half a step at most
_DODGE = 0.012
_ZOOM = 2.5  # half height of the lower row in widths of the band
_TICKS = 10  # epochs that are all labelled
_LINEAR_REACH = 4.0  # above this, or below its inverse, ratios need a logarithmic axis


@style.styled
def consistency_over_time(
    table: pd.DataFrame, header: str, conditions: Sequence[str] = ()
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
    lines = style.legend_lines(len(looks) + 2)
    tables = [table[table["statistic"] == key] for key, _ in _PANELS]
    ratio = np.concatenate([part["ratio"].to_numpy() for part in tables])
    log = bool(ratio.size) and bool(
        ratio.max() > _LINEAR_REACH or ratio.min() < 1.0 / _LINEAR_REACH
    )
    rows = 2 if log else 1
    figure = style.new_figure(style.DOUBLE, 0.75 + 1.6 * rows + 0.14 * lines, header)
    grid = figure.subplots(rows, len(_PANELS), sharex=True, squeeze=False)
    for c, (part, (_, title)) in enumerate(zip(tables, _PANELS, strict=True)):
        style.panel_title(grid[0, c], "ab"[c], title)
        for axes in grid[:, c]:
            _draw(axes, part, looks)
        grid[-1, c].set_xlabel("Time [h]")
        if log:
            style.panel_title(grid[1, c], "cd"[c], "the same, near the bounds")
            grid[0, c].set_yscale("log")
            style.short_numbers(grid[0, c].yaxis)
            if len(part):
                reach = _ZOOM * float(np.maximum(part["high"] - 1.0, 1.0 - part["low"]).max())
                grid[1, c].set_ylim(max(1.0 - reach, 0.0), 1.0 + reach)
    hours = np.unique(np.concatenate([part["time_h"].to_numpy() for part in tables]))
    if 0 < hours.size <= _TICKS:
        grid[-1, 0].set_xticks(hours)
    for axes in grid[:, 0]:
        axes.set_ylabel("NEES / degrees of freedom")
    for axes in grid[:, 1]:
        axes.set_ylabel("NIS / degrees of freedom")
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
    draw=lambda r: consistency_over_time(
        r.tables["consistency_per_epoch"].frame, r.header, list(r.errors)
    ),
    needs=lambda r: "consistency_per_epoch" in r.tables,
)
