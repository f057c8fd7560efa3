"""Whether estimators are as good as they think: NEES and range innovations over time, with their bounds."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, NullFormatter

from pymantaray.report.style import (
    DOUBLE,
    GREY,
    HEADER_LINE,
    INK,
    common_legend,
    condition_looks,
    condition_style,
    new_figure,
    note,
    panel_title,
    styled,
)

_PANELS = (("horizontal", "horizontal positions of the fleet"), ("ranges", "ranges of a ping"))
_BAND = "#dcdcdc"
_DODGE = 0.012  # share of the time axis between neighbouring conditions; all of them take half a step at most
_PER_ROW = 5  # entries of the legend where it has lines of its own
_ZOOM = 2.5  # half height of the lower row in widths of the band
_TICKS = 10  # epochs that are all labelled
_LINEAR_REACH = 4.0  # above this, or below its inverse, ratios need a logarithmic axis


@styled
def consistency_over_time(table: pd.DataFrame, header: str) -> Figure:
    """
    NEES of the fleet and innovations of its ranges, each by its degrees of freedom, at the fixed epochs.

    Parameters
    ----------
    table : pandas.DataFrame
        From `pymantaray.evaluation.consistency_table`, of the fleet.
    header : str
        From `ocean_header`.

    Returns
    -------
    matplotlib.figure.Figure
        A column for horizontal positions and one for ranges. The line at 1 is what a consistent estimator
        has on average, the band its 95 % bounds, drawn for the condition with the most solves. A full marker lies
        inside the bounds of its own condition, an empty one outside. Where some lie far off, they are on a
        logarithmic scale, and the second row shows the surroundings of the band.
    """
    conditions = list(dict.fromkeys(table["condition"]))
    looks = condition_looks(conditions)
    entries = len(conditions) + 2
    lines = 0 if entries <= HEADER_LINE else -(-entries // _PER_ROW)
    tables = [table[table["statistic"] == key] for key, _ in _PANELS]
    ratio = np.concatenate([part["ratio"].to_numpy(dtype=float) for part in tables])
    log = bool(ratio.size) and bool(ratio.max() > _LINEAR_REACH or ratio.min() < 1.0 / _LINEAR_REACH)
    rows = 2 if log else 1
    figure = new_figure(DOUBLE, 0.75 + 1.6 * rows + 0.14 * lines, header)
    grid = figure.subplots(rows, len(_PANELS), sharex=True, squeeze=False)
    for c, (part, (_, title)) in enumerate(zip(tables, _PANELS, strict=True)):
        panel_title(grid[0, c], "ab"[c], title)
        for axes in grid[:, c]:
            _draw(axes, part, looks)
        grid[-1, c].set_xlabel("Time [h]")
        if log:
            panel_title(grid[1, c], "cd"[c], "the same, near the bounds")
            grid[0, c].set_yscale("log")
            grid[0, c].yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            grid[0, c].yaxis.set_minor_formatter(NullFormatter())
            if len(part):
                reach = _ZOOM * float(np.maximum(part["high"] - 1.0, 1.0 - part["low"]).max())
                grid[1, c].set_ylim(max(1.0 - reach, 0.0), 1.0 + reach)
    hours = np.unique(np.concatenate([part["time_h"].to_numpy(dtype=float) for part in tables]))
    if 0 < hours.size <= _TICKS:
        grid[-1, 0].set_xticks(hours)
    for axes in grid[:, 0]:
        axes.set_ylabel("NEES / degrees of freedom")
    for axes in grid[:, 1]:
        axes.set_ylabel("NIS / degrees of freedom")
    handles: list[Line2D | Patch] = [
        Line2D(
            [], [], color=colour, marker=marker, markersize=3.6, linewidth=0.9, label=condition_style(name)[1]
        )
        for name, (colour, marker) in looks.items()
    ]
    handles.append(Patch(color=_BAND, label="95 % bounds"))
    handles.append(
        Line2D(
            [],
            [],
            color=INK,
            marker="o",
            markerfacecolor="white",
            linestyle="none",
            markersize=3.6,
            label="outside its bounds",
        )
    )
    common_legend(figure, handles, **({"ncols": _PER_ROW} if lines else {}))
    return figure


def _draw(axes: Axes, table: pd.DataFrame, looks: dict[str, tuple[str, str]]) -> None:
    if table.empty:
        note(axes, "nothing to judge")
        return
    axes.axhline(1.0, color=GREY, linewidth=0.8)
    hours = np.unique(table["time_h"].to_numpy(dtype=float))
    step = float(np.diff(hours).min()) if hours.size > 1 else 1.0
    first, last = float(hours[0]) - 0.5 * step, float(hours[-1]) + 0.5 * step
    bounds = table.sort_values("degrees_of_freedom", kind="stable").groupby("time_h")[["low", "high"]].last()
    edges = np.concatenate([[first], 0.5 * (hours[1:] + hours[:-1]), [last]])
    low, high = (bounds[side].to_numpy(dtype=float) for side in ("low", "high"))
    axes.fill_between(edges, [*low, low[-1]], [*high, high[-1]], step="post", color=_BAND, linewidth=0.0)
    shown = [name for name in looks if (table["condition"] == name).any()]
    dodge = min(_DODGE * (last - first), 0.5 * step / len(shown))
    for i, name in enumerate(shown):
        part = table[table["condition"] == name]
        colour, marker = looks[name]
        x = part["time_h"] + (i - 0.5 * (len(shown) - 1)) * dodge
        axes.plot(x, part["ratio"], color=colour, linewidth=0.9)
        for inside in (True, False):
            chosen = part["inside"].to_numpy(dtype=bool) == inside
            axes.plot(
                x[chosen],
                part["ratio"][chosen],
                color=colour,
                marker=marker,
                markersize=3.6,
                markerfacecolor=colour if inside else "white",
                linestyle="none",
            )
    axes.set_xlim(first, last)
