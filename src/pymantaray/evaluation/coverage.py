"""How often errors lie within one and three of the sigmas that the estimator claims."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from pymantaray.evaluation.consistency import AXES, epoch_errors
from pymantaray.records import Estimates, Trajectories
from pymantaray.records.covariances import PoseCovariances

Array = NDArray[np.float64]
_SIGMAS = (1.0, 3.0)


def coverage_table(
    truth: Trajectories, estimates: Estimates, covariances: PoseCovariances, *, confidence: float = 0.95
) -> pd.DataFrame:
    r"""
    Share of position errors within 1 and 3 sigma, for each condition, epoch and axis, with binomial bounds.

    Parameters
    ----------
    truth : Trajectories
    estimates : Estimates
    covariances : PoseCovariances
    confidence : float
        Of the bounds. [-]

    Returns
    -------
    pandas.DataFrame
        Columns ``condition``, ``time_h``, ``axis``, ``sigmas``, ``n`` (vehicles times realizations), ``effective_n``,
        ``share``, ``expected``, ``low``, ``high`` and ``inside``.

    Raises
    ------
    EvaluationError
        As `epoch_errors`.

    Notes
    -----
    Errors of the vehicles at one epoch are correlated, by :math:`\rho_{ij}` of their joint covariance, hence so are their
    hits. If the covariance is right the share of one realization has the variance
    :math:`n^{-2} \sum_{ij} [P(|x_i| < k, |x_j| < k) - p^2]`. The bounds are those of a binomial of as many draws as
    have this variance, ``effective_n``, rounded down.
    """
    errors = epoch_errors(truth, estimates, covariances)
    c = covariances
    joint = np.einsum("creaibi->creiab", c.position_covariance)
    rows = []
    for i, e, axis in np.ndindex(c.condition.size, c.sample.size, 3):
        block, error = joint[i, :, e, axis], errors.position[i, :, e, :, axis]
        good = np.isfinite(block).all(axis=(1, 2)) & np.isfinite(error).all(axis=1)
        if not good.any():
            continue
        sigma = np.sqrt(np.diagonal(block[good], axis1=1, axis2=2))
        z = np.abs(error[good]) / sigma
        rho = np.mean(block[good] / (sigma[:, :, None] * sigma[:, None, :]), axis=0)
        for k in _SIGMAS:
            p = float(stats.chi2.cdf(k * k, 1))
            effect = float(np.sum(_hit_covariance(rho, k)) / (p * (1.0 - p) * len(rho)))
            n = max(int(z.size / effect + 1e-9), 1)
            low, high = (
                stats.binom.ppf(q, n, p) / n for q in (0.5 - confidence / 2.0, 0.5 + confidence / 2.0)
            )
            share = float(np.mean(z <= k))
            rows.append(
                {
                    "condition": str(c.condition[i]),
                    "time_h": float(c.time[e] / 3600.0),
                    "axis": AXES[axis],
                    "sigmas": k,
                    "n": z.size,
                    "effective_n": n,
                    "share": share,
                    "expected": p,
                    "low": float(low),
                    "high": float(high),
                    "inside": bool(low <= share <= high),
                }
            )
    columns = [
        "condition",
        "time_h",
        "axis",
        "sigmas",
        "n",
        "effective_n",
        "share",
        "expected",
        "low",
        "high",
        "inside",
    ]
    return pd.DataFrame(rows, columns=columns)


def _hit_covariance(rho: Array, k: float) -> Array:
    """Covariance of two normal variables' being within k sigma, by their correlation."""
    x, weight = np.polynomial.legendre.leggauss(200)
    x, weight = k * x, k * weight
    p = stats.chi2.cdf(k * k, 1)
    r = np.minimum(np.abs(rho), 1.0)[..., None]
    s = np.sqrt(np.maximum(1.0 - r * r, 1e-12))
    within = stats.norm.cdf((k - r * x) / s) - stats.norm.cdf((-k - r * x) / s)
    both = np.sum(weight * stats.norm.pdf(x) * within, axis=-1)
    return np.asarray(np.where(r[..., 0] > 1.0 - 1e-12, p, both) - p * p)
