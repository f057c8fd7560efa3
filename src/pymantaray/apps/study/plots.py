"""
Plots for use from Python: each draws on axes, with the functions that draw the figures of the
report.
"""

from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from pymantaray.apps.study.figures.fleet import draw_plan
from pymantaray.apps.study.figures.ranging import draw_range_errors
from pymantaray.apps.study.figures.register import RunResults
from pymantaray.apps.study.figures.trajectory import draw_error_distribution, draw_vehicle_errors
from pymantaray.plotting import style
from pymantaray.plotting.style import axes_or_new
from pymantaray.plotting.water import draw_profile

if TYPE_CHECKING:
    from pymantaray.apps.study.store import Run


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
        names = [
            name for name, value in vars(type(self)).items() if callable(value) and name[0] != "_"
        ]
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
        axes = axes_or_new(ax)
        draw_range_errors(axes, self._results.ranges.total, log=log)
        axes.legend()
        return axes

    def position_error(self, condition: str, ax: Axes | None = None, *, log: bool = False) -> Axes:
        """
        Plot the distribution of the position error of a condition, over vehicles, times and
        realizations.

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
        axes = axes_or_new(ax)
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
        axes = axes_or_new(ax)
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
        axes = axes_or_new(ax)
        run = self._results.run
        draw_plan(axes, run.truth, run.measurements, style.vehicle_colours(len(run.truth.name)))
        return axes

    def sound_speed(self, ax: Axes | None = None) -> Axes:
        """
        Plot the sound speed of the region against depth: mean, and range from minimum to maximum
        shaded.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default new ones.

        Returns
        -------
        matplotlib.axes.Axes
        """
        axes = axes_or_new(ax)
        deepest = draw_profile(axes, self._results.run.profile, self._results.region, style.BLUE)
        axes.set(ylim=(deepest or 1.0, 0.0), xlabel="Sound speed [m/s]", ylabel="Depth [m]")
        return axes
