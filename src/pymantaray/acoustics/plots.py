"""Plots of a medium and of rays on axes."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from pymantaray.plotting import style
from pymantaray.plotting.style import axes_or_new
from pymantaray.plotting.water import RAY_KINDS

if TYPE_CHECKING:
    from pymantaray.acoustics.levels.loss import TransmissionLoss
    from pymantaray.acoustics.medium import Medium
    from pymantaray.acoustics.ray_paths import RayPaths
    from pymantaray.records import Arrivals

_KM = 1e3  # m
_BELOW_WEAKEST = 6.0  # dB; length of the weakest arrival's line


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


def plot_arrivals(
    arrivals: "Arrivals",
    link: int = 0,
    loss: "TransmissionLoss | None" = None,
    ax: Axes | None = None,
    *,
    one_column: bool = False,
) -> Axes:
    """
    Plot the level of the arrivals of a link over the delay from the first, with line styles by
    reflection.

    Parameters
    ----------
    arrivals : Arrivals
        From `find_eigenrays`.
    link : int
        Index of the link.
    loss : TransmissionLoss, optional
        Loss of the arrivals. Default: spreading beyond spherical only.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default new ones.
    one_column : bool
        True for new axes in the style of the reports, in a figure for one column of a journal, 84
        mm wide.

    Returns
    -------
    matplotlib.axes.Axes

    Examples
    --------
    Continues the example of `pymantaray.acoustics`:

    >>> from pymantaray.acoustics import plot_arrivals
    >>> axes = plot_arrivals(arrivals)
    >>> axes.get_xlabel(), axes.get_ylabel()
    ('Delay from the first arrival [ms]', 'Level re spherical spreading [dB]')
    """
    if one_column and ax is None:
        return _arrivals_in_one_column(arrivals, link, loss)
    axes = axes_or_new(ax)
    rows = np.flatnonzero(arrivals.link == link)
    delay = 1e3 * (arrivals.travel_time[rows] - arrivals.travel_time[rows].min(initial=np.inf))
    level = -(arrivals.spreading_db if loss is None else loss.total_db)[rows]
    kinds = (arrivals.surface_bounces[rows] > 0) + 2 * (arrivals.bottom_bounces[rows] > 0)
    floor = level.min(initial=0.0) - _BELOW_WEAKEST
    for kind in np.unique(kinds).tolist():
        name, look = RAY_KINDS[kind]
        own = kinds == kind
        axes.vlines(delay[own], floor, level[own], label=name, **look)
        axes.plot(delay[own], level[own], "o", color=look["color"], markersize=3.0)
    axes.set_ylim(bottom=floor)
    axes.set_xlabel("Delay from the first arrival [ms]")
    axes.set_ylabel("Level re spherical spreading [dB]" if loss is None else "Level re 1 m [dB]")
    if rows.size:
        # above the axes: the lines may be anywhere in them
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return axes


@style.styled
def _arrivals_in_one_column(
    arrivals: "Arrivals", link: int, loss: "TransmissionLoss | None"
) -> Axes:
    """Arrivals on the axes of a new figure for one column of a journal."""
    _, (axes,) = style.panel_figure(style.COLUMN, "", 1, height=2.3, stacked=2.1)
    return plot_arrivals(arrivals, link, loss, axes)


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
