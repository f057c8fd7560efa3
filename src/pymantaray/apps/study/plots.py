"""Plots for use from Python: each draws on axes, with the functions that draw the figures of the report."""

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from pymantaray.apps.study.figures.fleet import draw_plan
from pymantaray.apps.study.figures.ocean import RAY_KINDS, draw_profile
from pymantaray.apps.study.figures.ranging import draw_range_errors
from pymantaray.apps.study.figures.register import RunResults
from pymantaray.apps.study.figures.trajectory import draw_error_distribution
from pymantaray.apps.study.figures.vehicles import draw_vehicle_errors
from pymantaray.pages import style

if TYPE_CHECKING:
    from pymantaray.acoustics import Medium
    from pymantaray.apps.study.store import Run
    from pymantaray.records import RayPaths

_KM = 1e3  # m


def _axes(ax: Axes | None) -> Axes:
    return plt.subplots(layout="constrained")[1] if ax is None else ax


class RunPlots:
    """
    Plots of a run; each method draws on axes and returns them.

    Parameters
    ----------
    run : Run
    """

    def __init__(self, run: "Run") -> None:
        self._results = RunResults(run)

    def __repr__(self) -> str:
        """Names of the plots."""
        names = [name for name, value in vars(type(self)).items() if callable(value) and name[0] != "_"]
        return f"<RunPlots: {', '.join(f'{name}()' for name in names)}>"

    def range_error(self, ax: Axes | None = None, *, log: bool = False) -> Axes:
        """
        Plot the histogram of the range error, refracted minus straight.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default new ones.
        log : bool
            True for a logarithmic count.

        Returns
        -------
        matplotlib.axes.Axes
        """
        axes = _axes(ax)
        draw_range_errors(axes, self._results.ranges.total, log=log)
        axes.legend()
        return axes

    def position_error(self, condition: str, ax: Axes | None = None, *, log: bool = False) -> Axes:
        """
        Plot the distribution of the position error of a condition, over vehicles, times and realizations.

        Parameters
        ----------
        condition : str
            Ranging condition or estimator, as in ``run.estimates.condition``.
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default new ones.
        log : bool
            True for a logarithmic scale of errors.

        Returns
        -------
        matplotlib.axes.Axes
        """
        axes = _axes(ax)
        draw_error_distribution(axes, self._results.errors, condition, log=log)
        return axes

    def error_by_vehicle(self, ax: Axes | None = None) -> Axes:
        """
        Plot RMSE and quartiles of the position error of each vehicle.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default new ones.

        Returns
        -------
        matplotlib.axes.Axes
        """
        axes = _axes(ax)
        draw_vehicle_errors(axes, self._results.tables["ate_per_vehicle"].frame)
        axes.legend()
        return axes

    def fleet(self, ax: Axes | None = None) -> Axes:
        """
        Plot the true tracks, landmarks and GNSS fixes on a map.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default new ones.

        Returns
        -------
        matplotlib.axes.Axes
        """
        axes, run = _axes(ax), self._results.run
        draw_plan(axes, run.truth, run.measurements, style.vehicle_colours(len(run.truth.name)))
        return axes

    def sound_speed(self, ax: Axes | None = None) -> Axes:
        """
        Plot the sound speed of the region against depth: mean, and range from minimum to maximum shaded.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default new ones.

        Returns
        -------
        matplotlib.axes.Axes
        """
        axes = _axes(ax)
        deepest = draw_profile(axes, self._results.run.profile, self._results.region, style.BLUE)
        axes.set_ylim(deepest or 1.0, 0.0)
        axes.set_xlabel("Sound speed [m/s]")
        axes.set_ylabel("Depth [m]")
        return axes


def medium(medium: "Medium", ax: Axes | None = None) -> Axes:
    """
    Plot the sound speed in the columns of a medium against depth: mean, and range from minimum to maximum shaded.

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
    axes = _axes(ax)
    speed = medium.sound_speed.reshape(-1, medium.depth.size)
    axes.fill_betweenx(
        medium.depth, speed.min(axis=0), speed.max(axis=0), color=style.BLUE, alpha=0.22, linewidth=0.0
    )
    axes.plot(speed.mean(axis=0), medium.depth, color=style.BLUE)
    bed = float(medium.bed.depth.min()), float(medium.bed.depth.max())
    axes.axhspan(*bed, color=style.BED, alpha=0.5, linewidth=0.0)
    axes.axhline(bed[0], color=style.SHORE, linewidth=0.8)
    axes.set_ylim(1.03 * bed[1], 0.0)
    axes.set_xlabel("Sound speed [m/s]")
    axes.set_ylabel("Depth [m]")
    return axes


def rays(paths: "RayPaths", ax: Axes | None = None) -> Axes:
    """
    Plot the depth of rays over the horizontal distance from their first node, with line styles by reflection.

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
    axes, used = _axes(ax), set[int]()
    starts = np.flatnonzero(np.diff(paths.arrival, prepend=-1))
    for rows in np.split(np.arange(paths.arrival.size), starts[1:]):
        place, boundary = paths.position[rows], paths.boundary[rows]
        kind = int((boundary == 1).any()) + 2 * int((boundary == 2).any())
        name, look = RAY_KINDS[kind]
        label = name if kind not in used else "_"
        used.add(kind)
        step = np.linalg.norm(np.diff(place[:, :2], axis=0), axis=1)
        axes.plot(np.append(0.0, np.cumsum(step)) / _KM, place[:, 2], label=label, **look)
    axes.yaxis.set_inverted(True)
    axes.set_xlabel("Horizontal range [km]")
    axes.set_ylabel("Depth [m]")
    if used:
        axes.legend()
    return axes
