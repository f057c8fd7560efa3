"""
Information of ranges about water and clocks: prior and posterior of each unknown, and of their
independent combinations.
"""

from typing import Any

import numpy as np
import pandas as pd

from pymantaray.arrays import Array
from pymantaray.records import SharedUnknowns

# of the largest coefficient of a combination; smaller coefficients are not listed
_NAMED_SHARE = 0.3
_NAMED_COUNT = 4  # maximum number of listed coefficients


def unknowns_table(unknowns: SharedUnknowns) -> pd.DataFrame:
    r"""
    Prior and posterior standard deviations and errors of every unknown of every condition.

    Parameters
    ----------
    unknowns : SharedUnknowns
        Unknowns of all conditions and realizations.

    Returns
    -------
    pandas.DataFrame
        ``condition``, ``unknown``, ``unit``; ``prior_sigma`` and ``sigma``, the prior standard
        deviation and the root mean square of the posterior ones over realizations, in the unit;
        ``resolution``, the fraction of the prior variance that the measurements remove: 0 without
        information, 1 for an exactly determined unknown; ``mean_value`` and ``rms_error`` of the
        estimates, in the unit; ``error_ratio``, the mean square of error divided by standard
        deviation, 1 for a consistent estimator; ``realizations``, the number of usable solves.

    Notes
    -----
    A posterior standard deviation well below the prior does not imply that the unknown alone is
    observable: see `directions_table`.

    Examples
    --------
    >>> from pymantaray.evaluation import unknowns_table
    >>> from pymantaray.records import SharedUnknowns
    >>> unknowns = SharedUnknowns(
    ...     condition=["straight-scale"],
    ...     realization=[0],
    ...     name=["scale"],
    ...     unit=["1"],
    ...     prior_sigma=[[1e-3]],
    ...     value=[[[2e-4]]],
    ...     truth=[[[1e-4]]],
    ...     covariance=[[[[1e-8]]]],
    ... )
    >>> unknowns_table(unknowns)[["unknown", "sigma", "resolution"]]
      unknown   sigma  resolution
    0   scale  0.0001        0.99
    """
    rows: list[dict[str, Any]] = []
    for c, i in np.argwhere(
        np.isfinite(unknowns.prior_sigma) | np.isfinite(unknowns.value).any(axis=1)
    ):
        prior = float(unknowns.prior_sigma[c, i])
        variance = unknowns.covariance[c, :, i, i]
        error = unknowns.value[c, :, i] - unknowns.truth[c, :, i]
        rows.append(
            {
                "condition": str(unknowns.condition[c]),
                "unknown": str(unknowns.name[i]),
                "unit": str(unknowns.unit[i]),
                "realizations": int(np.isfinite(unknowns.value[c, :, i]).sum()),
                "prior_sigma": prior,
                "sigma": np.sqrt(_mean(variance)),
                "resolution": 1.0 - _mean(variance) / prior**2,
                "mean_value": _mean(unknowns.value[c, :, i]),
                "rms_error": np.sqrt(_mean(error**2)),
                "error_ratio": _mean(error**2 / variance),
            }
        )
    return pd.DataFrame(rows)


def directions_table(unknowns: SharedUnknowns) -> pd.DataFrame:
    r"""
    Independent combinations of the unknowns of each condition, from the best to the least
    observable.

    Parameters
    ----------
    unknowns : SharedUnknowns
        Unknowns of all conditions and realizations.

    Returns
    -------
    pandas.DataFrame
        ``condition``; ``direction``, from 1; ``sigma_ratio``, posterior divided by prior standard
        deviation; ``resolution``, 1 minus its square; ``seen_so_far``, the cumulative sum of
        resolutions, whose last value is the number of quantities that the measurements determine;
        ``combination``, its largest coefficients in units of the priors. A condition without
        covariances has no rows.

    Notes
    -----
    The combinations are the eigenvectors of the mean over realizations of :math:`D^{-1} P D^{-1}`,
    with P the covariance of the unknowns and D their prior standard deviations. The measurements
    contain no information about a combination with eigenvalue 1; its posterior is the prior. The
    trace of the resolution matrix :math:`I - D^{-1} P D^{-1}` is the number of quantities that the
    measurements determine.

    Examples
    --------
    >>> from pymantaray.evaluation import directions_table
    >>> from pymantaray.records import SharedUnknowns
    >>> unknowns = SharedUnknowns(
    ...     condition=["straight-scale"],
    ...     realization=[0],
    ...     name=["scale"],
    ...     unit=["1"],
    ...     prior_sigma=[[1e-3]],
    ...     value=[[[2e-4]]],
    ...     truth=[[[1e-4]]],
    ...     covariance=[[[[1e-8]]]],
    ... )
    >>> directions_table(unknowns)[["direction", "sigma_ratio", "resolution"]]
       direction  sigma_ratio  resolution
    0          1          0.1        0.99
    """
    rows: list[dict[str, Any]] = []
    for c, name in enumerate(unknowns.condition):
        mine = np.flatnonzero(np.isfinite(unknowns.prior_sigma[c]))
        all_of_them = unknowns.covariance[c][:, mine][:, :, mine]
        good = np.isfinite(all_of_them).all(axis=(1, 2))
        if not good.any():
            continue
        prior = unknowns.prior_sigma[c, mine]
        whitened = all_of_them[good].mean(axis=0) / prior[:, None] / prior
        values, vectors = np.linalg.eigh(0.5 * (whitened + whitened.T))
        resolution = 1.0 - values
        for k, (value, seen) in enumerate(zip(values, np.cumsum(resolution), strict=True)):
            rows.append(
                {
                    "condition": str(name),
                    "direction": k + 1,
                    "sigma_ratio": float(np.sqrt(max(value, 0.0))),
                    "resolution": float(resolution[k]),
                    "seen_so_far": float(seen),
                    "combination": _words(vectors[:, k], [str(n) for n in unknowns.name[mine]]),
                }
            )
    columns = ["condition", "direction", "sigma_ratio", "resolution", "seen_so_far", "combination"]
    return pd.DataFrame(rows, columns=columns)


def _mean(values: Array) -> float:
    """Mean of the finite values; NaN without any."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else np.nan


def _words(vector: Array, names: list[str]) -> str:
    """
    Largest coefficients of a combination with the names of their unknowns; the first is positive.
    """
    order = np.argsort(-np.round(np.abs(vector), 2), kind="stable")
    large = [i for i in order if abs(vector[i]) >= _NAMED_SHARE * abs(vector[order[0]])]
    sign = 1.0 if vector[order[0]] > 0.0 else -1.0
    shown = [f"{sign * vector[i]:+.2f} {names[i]}" for i in large[:_NAMED_COUNT]]
    more = len(large) - len(shown)
    return " ".join(shown) + (f" and {more} more" if more else "")
