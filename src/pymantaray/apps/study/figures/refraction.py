"""Effect of refraction at a glance: range errors, and position errors by condition."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pymantaray.apps.study.figures.ranging import draw_range_errors
from pymantaray.apps.study.figures.register import RunResults, register
from pymantaray.apps.study.figures.trajectory import shown_over_time
from pymantaray.arrays import Array
from pymantaray.pages import style


@style.styled
def refraction(ranges: Array, errors: Mapping[str, Array], header: str) -> Figure:
    """Histogram of range errors, and mean and quartiles of the position errors by condition."""
    figure = style.new_figure(style.DOUBLE, 2.2, header)
    counts, *others = figure.subplots(1, 2 if errors else 1, squeeze=False)[0]
    draw_range_errors(counts, ranges)
    style.panel_title(counts, "a", "range error")
    style.common_legend(figure, counts.get_legend_handles_labels()[0])
    for axes in others:
        _draw_position_errors(axes, errors)
        style.panel_title(axes, "b", "position error: mean (dot), quartiles (line)")
    return figure


def _draw_position_errors(axes: Axes, errors: Mapping[str, Array]) -> None:
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


def _errors(results: RunResults) -> Mapping[str, Array]:
    return shown_over_time(results) if results.run.study.solves else {}


register(
    "refraction",
    place=0,
    caption=lambda r: (
        "Effect of refraction. (a) Error of each range, refracted minus straight."
        + (" (b) Position errors over all vehicles, times and realizations." if _errors(r) else "")
    ),
    draw=lambda r: refraction(r.ranges.total, _errors(r), r.header),
)
