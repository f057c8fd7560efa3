"""Position errors of vehicles under water at the pings: from the truth, from the estimate with straight ranges, and compared with the bound."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pymantaray.evaluation.bound import DegreesOfFreedom, ping_samples, rms_bound, submerged_at_pings
from pymantaray.evaluation.trajectory_error import standard_error, trajectory_errors
from pymantaray.records import Estimates, Measurements, Trajectories

Array = NDArray[np.float64]
_BASELINE = "straight"


def ping_error_table(
    truth: Trajectories,
    estimates: Estimates,
    measurements: Measurements,
    bounds: Mapping[str, Array] | None = None,
    freedom: Mapping[str, DegreesOfFreedom] | None = None,
) -> pd.DataFrame:
    r"""
    Position errors of vehicles under water at the pings, for each condition.

    Ranges act at the pings, whereas the APE over all poses depends mainly on the hours between pings.

    Parameters
    ----------
    truth : Trajectories
        True trajectories.
    estimates : Estimates
        Estimates of all conditions and realizations.
    measurements : Measurements
        Measurements without noise, which give the times of pings and the vehicles with a GNSS fix.
    bounds : mapping of str to ndarray, optional
        For each condition what `error_bound` gives for what it measures.
    freedom : mapping of str to DegreesOfFreedom, optional
        For each condition its `DegreesOfFreedom`.

    Returns
    -------
    pandas.DataFrame
        ``condition``; ``n``, errors of all pings, vehicles and usable realizations; ``rmse_m`` and ``median_m`` of their size;
        ``rmse_standard_error_m``, the standard error of ``rmse_m`` from the effective degrees of freedom, an upper estimate for an
        estimator with a bias, NaN without ``freedom``;
        ``from_straight_rmse_m`` and ``from_straight_median_m``, the distance from the estimate of the same realization with
        ``straight`` ranges, NaN where that was not run; ``bound_rmse_m``, the bound of unbiased estimators with these
        measurements, an expectation over the noise, so that ``rmse_m`` of a few realizations can be below it by chance, and
        ``efficiency``, the ratio of its square to that of ``rmse_m``: 1 at the bound.

    Raises
    ------
    EvaluationError
        If the records do not belong together.
    """
    submerged, samples = submerged_at_pings(truth, measurements), ping_samples(measurements)

    def at_pings(values: Array) -> Array:
        """Values of shape (realizations, pings and vehicles)."""
        return np.asarray(values[..., samples].swapaxes(-1, -2)[..., submerged])

    errors = trajectory_errors(truth, estimates)
    names = estimates.condition.tolist()
    straight = estimates.position[names.index(_BASELINE)] if _BASELINE in names else np.nan
    rows = []
    for c, name in enumerate(names):
        own, apart = (
            e[np.isfinite(e)]
            for e in (
                at_pings(errors[c]),
                at_pings(np.linalg.norm(estimates.position[c] - straight, axis=-1)),
            )
        )
        bound = rms_bound(bounds[name], submerged) if bounds is not None else np.nan
        rmse = _rms(own)
        rows.append(
            {
                "condition": name,
                "n": int(own.size),
                "rmse_m": rmse,
                "rmse_standard_error_m": np.nan
                if freedom is None
                else standard_error(rmse, freedom[name].at_pings, _realizations(at_pings(errors[c]))),
                "median_m": _median(own),
                "from_straight_rmse_m": _rms(apart),
                "from_straight_median_m": _median(apart),
                "bound_rmse_m": bound,
                "efficiency": (bound / rmse) ** 2 if rmse > 0.0 else np.nan,
            }
        )
    return pd.DataFrame(rows)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else np.nan


def _realizations(errors: Array) -> int:
    """Number of usable realizations in errors of shape (realizations, places)."""
    return int(np.isfinite(errors).all(axis=1).sum()) if errors.shape[1] else 0


def _median(values: Array) -> float:
    return float(np.median(values)) if values.size else np.nan
