"""The places through which rays run, as ragged nodes."""

from dataclasses import dataclass
from typing import ClassVar

from pymantaray.records.base import Column, Record, column

IN_WATER, AT_SURFACE, AT_BOTTOM = 0, 1, 2


@dataclass(frozen=True, eq=False)
class RayPaths(Record):
    """
    Nodes along rays, those of one ray together and in order.

    A reflection has two nodes of equal place and time, with the slowness before and after, and both flagged.
    Between nodes a path is the cubic Hermite polynomial in travel time with velocity
    ``slowness / |slowness|**2``.
    """

    kind: ClassVar[str] = "ray_paths"

    arrival: Column = column("node", "1", "row of the arrivals, or number of the ray of a fan", "i8")
    travel_time: Column = column("node", "s", "travel time since emission")
    position: Column = column("node axis", "m", "north, east, down")
    slowness: Column = column(
        "node axis", "s m-1", "slowness vector, along the ray; NaN where the ends coincide"
    )
    boundary: Column = column(
        "node", "1", "0 in the water, 1 reflected at the surface, 2 at the sea bed", "i1"
    )
