"""What the estimator says: trajectories of all realizations under all conditions, and each solve's health."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from pymantaray.records.base import Column, Record, column

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class Estimates(Record):
    """
    Estimated poses for every realization and condition, with the health of each solve.

    A solve whose ``solve_status`` is not OK or OVER_CHI_SQUARE has NaN poses. Dead reckoning
    (condition ``odometry``) has status OK, no iterations and NaN costs. Estimators of a study are conditions
    too. ``gated_links`` is written only where a link was gated, and read as zero where it is missing.
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
    gated_links: Column = field(
        default_factory=lambda: _NONE_GATED,
        metadata=column(
            "condition realization", "1", "ranges that the believed ocean does not allow", "i4"
        ).metadata,
    )

    def __post_init__(self) -> None:
        """Fill in the count that may be left out; convert, check and freeze every field."""
        if self.gated_links is _NONE_GATED:
            object.__setattr__(self, "gated_links", np.zeros(np.shape(self.solve_status), dtype=int))
        super().__post_init__()

    def to_dataset(self) -> "xr.Dataset":
        """
        Give the record as an xarray data set with units and long names.

        Returns
        -------
        xarray.Dataset
            Without ``gated_links`` if no link was gated.
        """
        dataset = super().to_dataset()
        return dataset if np.any(self.gated_links) else dataset.drop_vars("gated_links")

    @classmethod
    def from_dataset(cls, dataset: "xr.Dataset") -> Self:
        """
        Build the record from a data set that `to_dataset` made.

        Parameters
        ----------
        dataset : xarray.Dataset

        Returns
        -------
        Estimates

        Raises
        ------
        RecordError
            If the data set holds another kind of record or lacks a field.
        """
        if "gated_links" not in dataset and "solve_status" in dataset:
            dataset = dataset.assign(gated_links=dataset["solve_status"].astype("i4") * 0)
        return super().from_dataset(dataset)


_NONE_GATED: Any = np.zeros((0, 0), dtype=int)
