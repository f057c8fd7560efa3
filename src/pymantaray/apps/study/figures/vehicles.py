"""Position error of each vehicle."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pymantaray.apps.study.figures.register import RunResults, register
from pymantaray.pages import style

_MAX_NAMED_VEHICLES = 30  # vehicles whose names fit below the axis
_LETTERS = 14  # of names in an inch of the axis
_GROUP = 0.8  # width of the markers of a vehicle, in distances between vehicles


@style.styled
def error_by_vehicle(table: pd.DataFrame, header: str) -> Figure:
    """RMSE and quartiles of the position error of each vehicle under each condition."""
    conditions = list(dict.fromkeys(table["condition"]))
    below = 0.14 * style.legend_lines(len(conditions))
    figure = style.new_figure(style.DOUBLE, 2.3 + below, header)
    axes = figure.subplots()
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
    names = [style.plain(style.short(str(name), 12)) for name in vehicles]
    upright = sum(map(len, names)) + 2 * len(names) > style.DOUBLE * _LETTERS
    axes.set_xticks(range(len(vehicles)), names, rotation=90 if upright else 0)
    axes.set_xlabel("Vehicle")
    axes.set_ylabel("Position error [m]")


def _shown(results: RunResults) -> bool:
    if not results.run.study.solves or len(results.run.truth.name) > _MAX_NAMED_VEHICLES:
        return False
    return bool(results.tables["ate_per_vehicle"].frame["rmse_m"].notna().any())


register(
    "error_by_vehicle",
    place=45,
    caption="Position error of each vehicle over all times and {r.realizations}, by ranging"
    " condition: RMSE (dots) and quartiles (lines).",
    draw=lambda r: error_by_vehicle(r.tables["ate_per_vehicle"].frame, r.header),
    needs=_shown,
)
