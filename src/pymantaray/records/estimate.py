"""What the estimator says: trajectories of all realizations under all conditions, and each solve's health."""

from dataclasses import dataclass
from typing import ClassVar

from pymantaray.records.base import Column, Record, column


@dataclass(frozen=True, eq=False)
class Estimates(Record):
    """
    Estimated poses for every realization and condition, with the health of each solve.

    A solve whose ``solve_status`` is not OK or OVER_CHI_SQUARE has NaN poses. Dead reckoning
    (condition ``odometry``) has status OK, no iterations and NaN costs. Estimators of a study are conditions
    too.
    """

    kind: ClassVar[str] = "estimates"

    condition: Column = column("condition", "", "ranging condition", "U")
    realization: Column = column("realization", "1", "index of the realization", "i4")
    name: Column = column("agent", "", "vehicle name", "U")
    time: Column = column("time", "s", "time since the start of the mission")
    landmark_name: Column = column("landmark", "", "landmark name", "U")
    position: Column = column(
        "condition realization agent time axis", "m", "north, east, down in the local frame"
    )
    quaternion: Column = column(
        "condition realization agent time quat", "1", "rotation body to world, (w, x, y, z)", "f4"
    )
    landmark_position: Column = column(
        "condition realization landmark axis", "m", "estimated landmark position"
    )
    solve_status: Column = column("condition realization", "1", "SolveStatus", "i1")
    iterations: Column = column("condition realization", "1", "iterations of the optimizer", "i4")
    initial_cost: Column = column("condition realization", "1", "cost at the starting point")
    final_cost: Column = column("condition realization", "1", "cost at the optimum")
    expected_cost: Column = column("condition realization", "1", "half the degrees of freedom")
    gradient_norm: Column = column("condition realization", "1", "largest gradient component at the optimum")
    gated_links: Column = column(
        "condition realization", "1", "ranges that the believed ocean does not allow", "i4"
    )
