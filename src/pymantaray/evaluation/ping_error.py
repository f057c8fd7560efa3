"""
Position errors of vehicles under water at the pings, compared with the estimate with straight
ranges and with the bound.
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pymantaray.arrays import Array
from pymantaray.evaluation.bound import (
    DegreesOfFreedom,
    ping_samples,
    rms_bound,
    submerged_at_pings,
)
from pymantaray.evaluation.trajectory_error import (
    spread_standard_error,
    standard_error,
    trajectory_errors,
)
from pymantaray.geometry.se3 import lengths
from pymantaray.geometry.spread import root_mean
from pymantaray.records import Estimates, Measurements, Trajectories

BASELINE = "straight"


def ping_error_table(
    truth: Trajectories,
    estimates: Estimates,
    measurements: Measurements,
    bounds: Mapping[str, Array] | None = None,
    freedom: Mapping[str, DegreesOfFreedom] | None = None,
) -> pd.DataFrame:
    r"""
    Position errors of vehicles under water at the pings, for each condition.

    Ranges act at the pings, whereas the APE over all poses depends mainly on the hours between
    pings.

    Parameters
    ----------
    truth : Trajectories
        True trajectories.
    estimates : Estimates
        Estimates of all conditions and realizations.
    measurements : Measurements
        Measurements without noise, which give the times of pings and the vehicles with a GNSS fix.
    bounds : mapping of str to ndarray, optional
        Result of `error_bound` for each condition.
    freedom : mapping of str to DegreesOfFreedom, optional
        Degrees of freedom of each condition, for standard errors.

    Returns
    -------
    pandas.DataFrame
        One row per condition:

        - ``condition``;
        - ``n``, number of errors over all pings, vehicles and usable realizations;
        - ``rmse_m`` and ``median_m``, root mean square and median of the errors;
        - ``rmse_standard_error_m``, standard error of ``rmse_m`` from the effective degrees of
          freedom. It is an upper estimate
          if the estimator is biased, and NaN without ``freedom``;
        - ``from_straight_rmse_m`` and ``from_straight_median_m``, distance from the estimate of the
          same realization with
          ``straight`` ranges, NaN if the study has no such condition;
        - ``from_straight_rmse_standard_error_m``, standard error of ``from_straight_rmse_m`` from
          the spread of the realizations,
          NaN for fewer than two;
        - ``bound_rmse_m``, bound of unbiased estimators with these measurements. It is an
          expectation over the noise, so
          ``rmse_m`` of a few realizations can be below it by chance;
        - ``efficiency``, the square of ``bound_rmse_m`` divided by that of ``rmse_m``: 1 at the
          bound.

    Raises
    ------
    EvaluationError
        If the records have different vehicles or times.

    Examples
    --------
    Continues the example of `pymantaray.evaluation`:

    >>> from pymantaray.evaluation import ping_error_table
    >>> table = ping_error_table(truth, estimates, measurements)
    >>> table[["condition", "n", "rmse_m", "from_straight_rmse_m"]].round(2)
       condition  n  rmse_m  from_straight_rmse_m
    0   odometry  6   13.87                  9.94
    1   straight  6    9.88                  0.00
    2  refracted  6    9.99                  1.81
    """
    submerged = submerged_at_pings(truth, measurements)
    samples = ping_samples(measurements)

    def at_pings(values: Array) -> Array:
        """Values of shape (realizations, pings and vehicles)."""
        return np.asarray(values[..., samples].swapaxes(-1, -2)[..., submerged])

    errors = trajectory_errors(truth, estimates)
    names = estimates.condition.tolist()
    straight = estimates.position[names.index(BASELINE)] if BASELINE in names else np.nan
    rows = []
    for c, name in enumerate(names):
        from_straight = at_pings(lengths(estimates.position[c] - straight))
        own, apart = (e[np.isfinite(e)] for e in (at_pings(errors[c]), from_straight))
        # mean squares of each realization
        squares = np.mean(from_straight**2, axis=1) if apart.size else np.empty(0)
        bound = rms_bound(bounds[name], submerged) if bounds is not None else np.nan
        rmse = root_mean(own**2)
        rows.append(
            {
                "condition": name,
                "n": int(own.size),
                "rmse_m": rmse,
                "rmse_standard_error_m": np.nan
                if freedom is None
                else standard_error(
                    rmse, freedom[name].at_pings, _realizations(at_pings(errors[c]))
                ),
                "median_m": _median(own),
                "from_straight_rmse_m": root_mean(apart**2),
                "from_straight_rmse_standard_error_m": spread_standard_error(
                    squares[np.isfinite(squares)]
                ),
                "from_straight_median_m": _median(apart),
                "bound_rmse_m": bound,
                "efficiency": (bound / rmse) ** 2 if rmse > 0.0 else np.nan,
            }
        )
    return pd.DataFrame(rows)


def _realizations(errors: Array) -> int:
    """Number of usable realizations in errors of shape (realizations, places)."""
    return int(np.isfinite(errors).all(axis=1).sum()) if errors.shape[1] else 0


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else np.nan
