"""What the ranges say of water and clocks, beside what was known of them beforehand."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from pymantaray.report.style import (
    BLUE,
    DOUBLE,
    GREY,
    ORANGE,
    common_legend,
    new_figure,
    panel_title,
    styled,
)

_HEIGHT = 1.35  # of a panel [in]
_LEVEL = 110  # letters of names that fit on the axis level


@styled
def unknowns_before_and_after(table: pd.DataFrame, header: str) -> Figure:
    """
    Standard deviation and error of every unknown, in standard deviations that it had beforehand.

    Parameters
    ----------
    table : pandas.DataFrame
        From `pymantaray.evaluation.unknowns.unknowns_table`, not empty.
    header : str
        From `ocean_header`.

    Returns
    -------
    matplotlib.figure.Figure
        A panel for each condition, on logarithmic scales of one range. At 1 nothing was learnt.
    """
    conditions = list(dict.fromkeys(table["condition"]))
    upright = [_too_wide(table.loc[table["condition"] == name, "unknown"]) for name in conditions]
    heights = [_HEIGHT + (0.6 if turned else 0.0) for turned in upright]
    figure = new_figure(DOUBLE, 0.5 + sum(heights), header)
    grid = figure.subplots(len(conditions), 1, sharey=True, squeeze=False)[:, 0]
    for i, (axes, name) in enumerate(zip(grid, conditions, strict=True)):
        part = table[table["condition"] == name]
        x = np.arange(len(part))
        prior = part["prior_sigma"].to_numpy(dtype=float)
        axes.axhline(1.0, color=GREY, linewidth=0.8)
        axes.plot(
            x,
            part["sigma"] / prior,
            color=BLUE,
            marker="_",
            markersize=9.0,
            markeredgewidth=1.6,
            linestyle="none",
        )
        axes.plot(x, part["rms_error"] / prior, color=ORANGE, marker="o", markersize=3.2, linestyle="none")
        axes.set_yscale("log")
        axes.set_xlim(-0.6, len(part) - 0.4)
        axes.set_xticks(x, part["unknown"], rotation=90 if upright[i] else 0)
        axes.grid(visible=False, axis="x")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        panel_title(axes, "abcdefghijklmnopqrstuvwxyz"[i % 26], name)
    figure.supylabel("In prior standard deviations [-]", fontsize=7.5)
    common_legend(
        figure,
        [
            Line2D(
                [],
                [],
                color=BLUE,
                marker="_",
                markersize=9.0,
                markeredgewidth=1.6,
                linestyle="none",
                label="standard deviation after",
            ),
            Line2D(
                [],
                [],
                color=ORANGE,
                marker="o",
                markersize=3.2,
                linestyle="none",
                label="error, root mean square",
            ),
            Line2D([], [], color=GREY, linewidth=0.8, label="before"),
        ],
    )
    return figure


def _too_wide(names: pd.Series) -> bool:
    """Whether names would touch on an axis of the figure's width."""
    return len(names) * (int(names.str.len().max()) + 2) > _LEVEL
