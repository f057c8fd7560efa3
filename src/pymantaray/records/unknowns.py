"""What estimators found of sound-speed modes and clocks, beside the poses."""

from dataclasses import dataclass
from typing import ClassVar

from pymantaray.records.base import Column, Record, column


@dataclass(frozen=True, eq=False)
class SharedUnknowns(Record):
    """
    Unknowns that all ranges of a solve share, of the conditions that estimate any.

    NaN where a condition does not estimate an unknown or a solve is not usable. Values, standard deviations and covariances are in the units that ``unit`` names.
    """

    kind: ClassVar[str] = "shared_unknowns"

    condition: Column = column("condition", "", "ranging condition", "U")
    realization: Column = column("realization", "1", "index of the realization", "i4")
    name: Column = column("unknown", "", "name of the unknown", "U")
    unit: Column = column("unknown", "", "its unit", "U")
    prior_sigma: Column = column("condition unknown", "1", "standard deviation beforehand, in the unit")
    value: Column = column("condition realization unknown", "1", "estimate, in the unit")
    truth: Column = column("condition realization unknown", "1", "true value, in the unit")
    covariance: Column = column(
        "condition realization unknown unknown_column", "1", "marginal covariance, in the units"
    )
