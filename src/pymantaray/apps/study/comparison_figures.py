"""Quantiles of the errors of many runs, one line per run."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from pymantaray.arrays import Array
from pymantaray.plotting import style

_COLUMNS = 3
_ROW = 0.19  # height of a line [in]


@style.styled
def quantiles_by_run(
    values: Mapping[str, Mapping[str, Array]],
    header: str,
    label: str,
    *,
    log: bool,
    width: float = style.DOUBLE,
) -> Figure:
    """Quantiles of several kinds of values, one panel per kind and one line per run."""
    runs = list(next(iter(values.values())))
    columns = min(len(values), _COLUMNS if width > style.COLUMN else 1)
    rows = -(-len(values) // columns)
    figure = style.new_figure(width, 0.45 + rows * (0.4 + _ROW * len(runs)), header)
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    colours = style.vehicle_colours(len(runs))
    for i, (axes, (title, by_run)) in enumerate(zip(grid.flat, values.items(), strict=False)):
        style.panel_title(axes, style.letter(i), style.plain(style.short(title)))
        if log:
            axes.set_xscale("log")
            style.short_numbers(axes.xaxis)
        else:
            axes.axvline(0.0, color=style.INK, linewidth=0.7, linestyle="--")
        axes.grid(visible=False, axis="y")
        axes.set_xlabel(label)
        for line, (of_run, colour) in enumerate(zip(by_run.values(), colours, strict=True)):
            finite = of_run[np.isfinite(of_run)]
            if not finite.size:
                continue
            low, first, middle, third, high = np.percentile(finite, [5, 25, 50, 75, 95])
            axes.plot([low, high], [line, line], color=colour, linewidth=0.9)
            axes.plot(
                [first, third], [line, line], color=colour, linewidth=4.5, solid_capstyle="butt"
            )
            axes.plot([middle], [line], "|", color="white", markersize=4.5, markeredgewidth=1.2)
            axes.plot(
                [finite.mean()],
                [line],
                "o",
                color="white",
                markeredgecolor=style.INK,
                markersize=3.0,
            )
        axes.set_yticks(range(len(runs)), [style.plain(name) for name in runs])
        axes.set_ylim(len(runs) - 0.4, -0.6)
    for axes in grid.flat[len(values) :]:
        axes.set_visible(False)
    return figure
