"""What is found in a run, worked out once for its tables, figures and page."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.evaluation import RangeErrors, range_errors, trajectory_errors
from pymantaray.report.labels import is_synthetic, ocean_header, ocean_name
from pymantaray.report.tables import make_tables
from pymantaray.study.store import RAY_PICTURE, Run

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Findings:
    """
    A run and what is drawn and told of it.

    Parameters
    ----------
    run : Run
    tables : dict of str to pandas.DataFrame
        From `make_tables`.
    ranges : RangeErrors
    errors : mapping of str to ndarray, shape (n_realizations, n_agents, n_time)
        Position errors by condition, NaN for a solve that failed. [m]
    fixes : ndarray of bool, shape (n_agents, n_time)
        Where a vehicle has a GNSS fix.
    """

    run: Run
    tables: dict[str, pd.DataFrame]
    ranges: RangeErrors
    errors: Mapping[str, Array]
    fixes: NDArray[np.bool_]

    @property
    def region(self) -> str:
        """Name of the ocean, without the note that it is synthetic."""
        return ocean_name(self.run.ocean.attrs)

    @property
    def synthetic(self) -> bool:
        """Whether the data or the configuration say that the ocean is made up."""
        return is_synthetic(self.run.ocean.attrs) or self.run.synthetic

    @property
    def header(self) -> str:
        """Line on top of every figure."""
        return ocean_header({**self.run.ocean.attrs, "synthetic": int(self.synthetic)})

    @property
    def has_ray_picture(self) -> bool:
        """Whether the run holds rays to draw."""
        return (self.run.path / RAY_PICTURE).is_file()


def gather(run: Run) -> Findings:
    """
    Work out what a run's report needs.

    Parameters
    ----------
    run : Run

    Returns
    -------
    Findings

    Raises
    ------
    MantaRayError
        If a file of the run is missing or damaged, or its records do not fit together.
    """
    measurements, estimates = run.measurements, run.estimates
    fixes = np.zeros(measurements.depth.shape, dtype=bool)
    fixes[measurements.gnss_agent, measurements.gnss_sample] = True
    errors = trajectory_errors(run.truth, estimates)
    return Findings(
        run=run,
        tables=make_tables(run),
        ranges=range_errors(run.ranging_truth),
        errors=dict(zip(estimates.condition.tolist(), errors, strict=True)),
        fixes=fixes,
    )
