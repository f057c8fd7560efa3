"""Speed of the vehicles: a figure that a package adds to the reports of runs."""

import numpy as np
from matplotlib.figure import Figure

from pymantaray.apps.study.figures.register import register
from pymantaray.plotting import style
from pymantaray.records import Trajectories


@style.styled
def speed_over_time(truth: Trajectories, header: str) -> Figure:
    """Speed of every vehicle over ground."""
    figure = style.new_figure(style.DOUBLE, 2.6, header)
    axes = figure.subplots()
    speed = np.linalg.norm(np.diff(truth.position, axis=1), axis=-1) / np.diff(truth.time)
    for name, values in zip(truth.name, speed, strict=True):
        axes.plot(truth.time[1:] / 3600.0, values, linewidth=0.8, label=style.plain(str(name)))
    axes.set_xlabel("Time [h]")
    axes.set_ylabel("Speed [m/s]")
    style.common_legend(figure, axes.get_lines())
    return figure


register(
    "speed",
    place=25,
    of_mission=True,
    caption="Speed of each of the {r.run.truth.name.size} vehicles over ground.",
    draw=lambda r: speed_over_time(r.run.truth, r.header),
)
