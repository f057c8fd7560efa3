"""Paths of rays."""

from dataclasses import dataclass
from typing import Any, ClassVar

from pymantaray.records.base import Column, Record, column


@dataclass(frozen=True, eq=False)
class RayPaths(Record):
    """
    Nodes along rays; the nodes of a ray are consecutive and in order.

    A reflection has two nodes with equal position and time, the slowness before and after, and a
    flag on both. Between nodes, a path is the cubic Hermite polynomial in travel time with velocity
    ``slowness / |slowness|**2``.
    """

    kind: ClassVar[str] = "ray_paths"

    arrival: Column = column(
        "node", "1", "row of the arrivals, or number of the ray of a fan", "i8"
    )
    travel_time: Column = column("node", "s", "travel time since emission")
    position: Column = column("node axis", "m", "north, east, down")
    slowness: Column = column(
        "node axis", "s m-1", "slowness vector along the ray; NaN if the ends coincide"
    )
    boundary: Column = column(
        "node", "1", "0 in the water, 1 reflected at the surface, 2 at the sea bed", "i1"
    )

    def plot(self, ax: Any = None) -> Any:
        """
        Plot the depth of the rays over the horizontal distance from their first node.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default new ones.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from pymantaray.acoustics.plots import plot_rays

        return plot_rays(self, ax)
