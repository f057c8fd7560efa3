"""Plots of a medium and of rays on axes."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from pymantaray.plotting import style
from pymantaray.plotting.style import axes_or_new
from pymantaray.plotting.water import RAY_KINDS

if TYPE_CHECKING:
    from pymantaray.acoustics.medium import Medium
    from pymantaray.acoustics.ray_paths import RayPaths

_KM = 1e3  # m


def plot_medium(medium: "Medium", ax: Axes | None = None) -> Axes:
    """
    Plot the sound speed in the columns of a medium against depth: mean, and range from minimum to
    maximum shaded.

    Parameters
    ----------
    medium : Medium
        Medium.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default new ones.

    Returns
    -------
    matplotlib.axes.Axes
    """
    axes = axes_or_new(ax)
    speed = medium.sound_speed.reshape(-1, medium.depth.size)
    axes.fill_betweenx(
        medium.depth,
        speed.min(axis=0),
        speed.max(axis=0),
        color=style.BLUE,
        alpha=0.22,
        linewidth=0.0,
    )
    axes.plot(speed.mean(axis=0), medium.depth, color=style.BLUE)
    bed = float(medium.bed.depth.min()), float(medium.bed.depth.max())
    axes.axhspan(*bed, color=style.BED, alpha=0.5, linewidth=0.0)
    axes.axhline(bed[0], color=style.SHORE, linewidth=0.8)
    axes.set(ylim=(1.03 * bed[1], 0.0), xlabel="Sound speed [m/s]", ylabel="Depth [m]")
    return axes


def plot_rays(paths: "RayPaths", ax: Axes | None = None) -> Axes:
    """
    Plot the depth of rays over the horizontal distance from their first node, with line styles by
    reflection.

    Parameters
    ----------
    paths : RayPaths
        Rays.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default new ones.

    Returns
    -------
    matplotlib.axes.Axes
    """
    axes = axes_or_new(ax)
    used = set[int]()
    starts = np.flatnonzero(np.diff(paths.arrival, prepend=-1))
    for rows in np.split(np.arange(paths.arrival.size), starts[1:]):
        place = paths.position[rows]
        boundary = paths.boundary[rows]
        kind = int((boundary == 1).any()) + 2 * int((boundary == 2).any())
        name, look = RAY_KINDS[kind]
        label = name if kind not in used else "_"
        used.add(kind)
        step = np.linalg.norm(np.diff(place[:, :2], axis=0), axis=1)
        axes.plot(np.append(0.0, np.cumsum(step)) / _KM, place[:, 2], label=label, **look)
    axes.yaxis.set_inverted(True)
    axes.set(xlabel="Horizontal range [km]", ylabel="Depth [m]")
    if used:
        axes.legend()
    return axes
