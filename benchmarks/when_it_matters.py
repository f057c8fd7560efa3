"""
Draw the map of where refraction begins to matter, from a sweep that was run of
`examples/when_it_matters.toml`.
"""

import argparse

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

from pymantaray.apps.sweep import open_sweep

PANELS = {
    "refracted": "nothing is known of the water",
    "error-2": "a model, off by 2 m/s rms",
    "error-0.5": "a model, off by 0.5 m/s rms",
    "cast": "one cast at the start",
    "exact": "all of it",
    "odometry": "no ranges at all",
}
GOOD = 1.5  # times the bound; up to here a mission needs no better knowledge of the water


def main() -> None:
    """Print the table and write the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sweep", help="folder of the sweep")
    parser.add_argument("out", help="figure to be written")
    given = parser.parse_args()
    table = open_sweep(given.sweep).table()
    table = table[table["status"] == "done"]
    table["over_bound"] = table["ping_rmse_m"] / table.groupby("point")[
        "ping_bound_rmse_m"
    ].transform("min")
    columns = [
        "mission.ping_interval_h",
        "odometry",
        "condition",
        "ping_rmse_m",
        "ping_bound_rmse_m",
        "over_bound",
    ]
    print(table[columns].to_string(index=False, float_format="{:.2f}".format))
    figure, grid = plt.subplots(
        2, 3, figsize=(7.16, 4.6), sharex=True, sharey=True, layout="constrained"
    )
    for axes, (condition, title) in zip(grid.ravel(), PANELS.items(), strict=True):
        part = table[table["condition"] == condition]
        error, ratio = (
            part.pivot(index="odometry", columns="mission.ping_interval_h", values=name).loc[
                list(dict.fromkeys(table["odometry"]))
            ]
            for name in ("ping_rmse_m", "over_bound")
        )
        image = axes.imshow(
            ratio, norm=LogNorm(1.0, 100.0), cmap="YlOrRd", aspect="auto", origin="lower"
        )
        for (row, column), value in np.ndenumerate(error.to_numpy()):
            good = ratio.iloc[row, column] <= GOOD
            axes.text(
                column,
                row,
                f"{value:.2f}" if value < 10.0 else f"{value:#.3g}".rstrip("."),
                ha="center",
                va="center",
                fontsize=7,
                fontweight="bold" if good else "normal",
                color="white" if ratio.iloc[row, column] > 30.0 else "black",
            )
        axes.set_title(title, fontsize=8, loc="left")
        axes.set_xticks(
            range(ratio.shape[1]), [f"{hours:g}" for hours in ratio.columns], fontsize=7
        )
        axes.set_yticks(range(ratio.shape[0]), ratio.index, fontsize=7)
    figure.supxlabel("hours between pings", fontsize=8)
    figure.supylabel("odometry's noise", fontsize=8)
    bar = figure.colorbar(image, ax=grid, extend="both")
    bar.set_label("over the least that is possible", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    figure.suptitle(
        "Vehicles under water at pings: error, root mean square [m]; bold within 1.5 of the bound."
        " Synthetic ocean.",
        fontsize=8,
    )
    figure.savefig(given.out, dpi=200)


if __name__ == "__main__":
    main()
