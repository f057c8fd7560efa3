"""How sure the estimator is: covariances of the fleet's poses at fixed epochs, and how its ranges fit there."""

from dataclasses import dataclass
from typing import ClassVar

from pymantaray.records.base import Column, Record, column


@dataclass(frozen=True, eq=False)
class PoseCovariances(Record):
    """
    Marginal covariances at the optimum of every condition and realization, at a few fixed epochs.

    NaN for a solve that is not usable, and for a system that could not be inverted. Positions of all vehicles at one
    epoch are joint, since ranges tie them together; poses are one by one. Range innovations are NaN, of
    dimension 0, where the solve has no range at the epoch.
    """

    kind: ClassVar[str] = "pose_covariances"

    condition: Column = column("condition", "", "ranging condition", "U")
    realization: Column = column("realization", "1", "index of the realization", "i4")
    name: Column = column("agent", "", "vehicle name", "U")
    sample: Column = column("epoch", "1", "index of the sample", "i4")
    time: Column = column("epoch", "s", "time since the start of the mission")
    position_covariance: Column = column(
        "condition realization epoch agent axis agent_column axis_column",
        "m2",
        "joint covariance of the positions of all vehicles, north, east, down",
    )
    pose_covariance: Column = column(
        "condition realization epoch agent tangent tangent_column",
        "1",
        "covariance in the tangent of the estimated pose, rotation before translation [rad, m]",
    )
    range_nis: Column = column(
        "condition realization epoch", "1", "squared innovation of all ranges of the epoch in its covariance"
    )
    range_dimension: Column = column("condition realization epoch", "1", "dimension of that innovation", "i4")
