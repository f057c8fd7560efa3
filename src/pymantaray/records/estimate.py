"""Results of estimators: trajectories, covariances, fit of ranges, and shared unknowns."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Self

import numpy as np

from pymantaray.records.base import Column, DatedRecord, Record, column
from pymantaray.records.measurements import Measurements
from pymantaray.records.status import SolveStatus

_STEP = 1e-5  # of quaternions in a file, 2e-5 rad at most
_ROUNDING = 2.0 * _STEP


@dataclass(frozen=True, eq=False)
class Estimates(DatedRecord):
    """
    Estimated poses for every realization and condition, with the health of each solve.

    A solve whose ``solve_status`` is not OK, OVER_CHI_SQUARE, UNDER_CHI_SQUARE or SECOND_MINIMUM
    has NaN poses. Dead reckoning (condition ``odometry``) has status OK, no iterations and NaN
    costs. Each estimator of a study is also a condition.

    Examples
    --------
    >>> from pymantaray import load_study
    >>> from pymantaray.apps.study import run_study
    >>> changes = {"mission.duration_h": 2.0, "mission.ping_interval_h": 1.0}
    >>> run = run_study(load_study("quick", **changes), workers=1)
    >>> print(run.estimates.condition, run.estimates.position.shape[-1])
    ['odometry' 'straight' 'refracted'] 3
    """

    kind: ClassVar[str] = "estimates"

    condition: Column = column("condition", "", "ranging condition", "U", labels=True)
    realization: Column = column("realization", "1", "index of the realization", "i4")
    name: Column = column("vehicle", "", "vehicle name", "U", labels=True)
    time: Column = column("time", "s", "time since the start of the mission")
    landmark_name: Column = column("landmark", "", "landmark name", "U", labels=True)
    position: Column = column(
        "condition realization vehicle time axis",
        "m",
        "north, east, down in the local frame",
        step=(8e-4, 8e-4, 2e-4),  # depths are measured more precisely
    )
    quaternion: Column = column(
        "condition realization vehicle time quat",
        "1",
        "rotation body to world, (w, x, y, z)",
        "f4",
        step=_STEP,
    )
    landmark_position: Column = column(
        "condition realization landmark axis", "m", "estimated landmark position"
    )
    solve_status: Column = column(
        "condition realization", "1", "verdict of the health gate", "i1", flags=SolveStatus
    )
    iterations: Column = column("condition realization", "1", "iterations of the optimizer", "i4")
    initial_cost: Column = column("condition realization", "1", "cost at the starting point")
    final_cost: Column = column("condition realization", "1", "cost at the optimum")
    expected_cost: Column = column("condition realization", "1", "half the degrees of freedom")
    gradient_norm: Column = column(
        "condition realization", "1", "largest gradient component at the optimum"
    )
    gated_links: Column = column(
        "condition realization", "1", "ranges that the estimator's ocean does not allow", "i4"
    )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read as `Record.load`; quaternions, which a file holds in steps, get length one again."""
        found = super().load(path)
        length = np.linalg.norm(found.quaternion.astype(float), axis=-1, keepdims=True)
        rounded = np.abs(length - 1.0) < _ROUNDING
        return replace(found, quaternion=found.quaternion / np.where(rounded, length, 1.0))

    @classmethod
    def without_conditions(cls, measurements: Measurements) -> Self:
        """
        Estimates without conditions, for one realization.

        Parameters
        ----------
        measurements : Measurements
            Measurements with vehicles, times and landmarks.

        Returns
        -------
        Estimates
        """
        columns = {
            "realization": np.zeros(1),
            "name": measurements.name,
            "time": measurements.time,
            "landmark_name": measurements.landmark_name,
        }
        sizes = {
            "condition": 0,
            "realization": 1,
            "vehicle": measurements.name.size,
            "time": measurements.time.size,
            "axis": 3,
            "quat": 4,
        }
        sizes["landmark"] = measurements.landmark_name.size
        empty = {
            item.name: np.zeros([sizes[dim] for dim in item.metadata["dims"]])
            for item in cls._columns()
            if item.name not in columns
        }
        return cls(**empty, **columns, start=measurements.start)


@dataclass(frozen=True, eq=False)
class PoseCovariances(DatedRecord):
    """
    Marginal covariances at the optimum of every condition and realization, at a few fixed epochs.

    Values are NaN for an unusable solve and for a singular system. Positions of all vehicles at one
    epoch have a joint covariance, because ranges correlate them; poses have separate covariances.
    Range innovations are NaN with dimension 0 if the solve has no range at the epoch.
    """

    kind: ClassVar[str] = "pose_covariances"

    condition: Column = column("condition", "", "ranging condition", "U", labels=True)
    realization: Column = column("realization", "1", "index of the realization", "i4")
    name: Column = column("vehicle", "", "vehicle name", "U", labels=True)
    sample: Column = column("epoch", "1", "index of the sample", "i4")
    time: Column = column("epoch", "s", "time since the start of the mission", labels=True)
    position_covariance: Column = column(
        "condition realization epoch vehicle axis vehicle_column axis_column",
        "m2",
        "joint covariance of the positions of all vehicles, north, east, down",
        digits=12,
    )
    pose_covariance: Column = column(
        "condition realization epoch vehicle tangent tangent_column",
        "1",
        "covariance in the tangent of the estimated pose, rotation before translation [rad, m]",
        digits=12,
    )
    range_nis: Column = column(
        "condition realization epoch",
        "1",
        "squared innovation of all ranges of the epoch in its covariance",
    )
    range_dimension: Column = column(
        "condition realization epoch", "1", "dimension of that innovation", "i4"
    )


@dataclass(frozen=True, eq=False)
class SharedUnknowns(Record):
    """
    Unknowns that all ranges of a solve share, for the conditions that estimate any.

    Values are NaN if a condition does not estimate an unknown or a solve is not usable. Values,
    standard deviations and covariances are in the units of ``unit``.
    """

    kind: ClassVar[str] = "shared_unknowns"

    condition: Column = column("condition", "", "ranging condition", "U", labels=True)
    realization: Column = column("realization", "1", "index of the realization", "i4")
    name: Column = column("unknown", "", "name of the unknown", "U", labels=True)
    unit: Column = column("unknown", "", "its unit", "U")
    prior_sigma: Column = column("condition unknown", "1", "prior standard deviation, in the unit")
    value: Column = column("condition realization unknown", "1", "estimate, in the unit")
    truth: Column = column("condition realization unknown", "1", "true value, in the unit")
    covariance: Column = column(
        "condition realization unknown unknown_column", "1", "marginal covariance, in the units"
    )
