"""Estimates of water and clocks from ranges, compared with their priors."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pymantaray.apps.study.figures.register import register
from pymantaray.apps.study.tables import RunTables
from pymantaray.pages import style

_HEIGHT = 1.35  # of a panel [in]
_LEVEL = 110  # letters of names that fit on the axis level


@style.styled
def unknowns_before_and_after(table: pd.DataFrame, header: str) -> Figure:
    """
    Posterior standard deviation and error of every unknown, divided by its prior standard
    deviation.
    """
    conditions = list(dict.fromkeys(table["condition"]))
    upright = [_too_wide(table.loc[table["condition"] == name, "unknown"]) for name in conditions]
    heights = [_HEIGHT + (0.6 if turned else 0.0) for turned in upright]
    figure = style.new_figure(style.DOUBLE, 0.5 + sum(heights), header)
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
        axes.set_yscale("log")
        axes.set_xlim(-0.6, len(part) - 0.4)
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


def _too_wide(names: pd.Series) -> bool:
    """True if names would touch on an axis of the figure's width."""
    return len(names) * (int(names.str.len().max()) + 2) > _LEVEL


register(
    "unknowns",
    place=65,
    caption="Sound-speed modes and clocks estimated together with the poses, over"
    " {r.realizations}: posterior standard deviation (blue) and root mean square error (orange),"
    " both divided by the prior standard deviation. On the grey line, the ranges contain no"
    " information.",
    draw=lambda r: unknowns_before_and_after(_with_prior(r.tables), r.header),
    needs=lambda r: "unknowns" in r.tables and len(_with_prior(r.tables)) > 0,
)
