r"""
Posterior and marginal likelihood of a linear system with normal priors.

For residuals :math:`y = J\delta + e`, :math:`e \sim N(0, \sigma^2 C)`, :math:`\delta \sim N(m, P)`.
The variance of the noise and of each group of coefficients follow MacKay's fixed-point rule: a sum
of squares over the number of parameters that the data determine. ABIC is -2 log evidence + 2
(number of hyperparameters).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from pymantaray.apps.locate.linear import Products
from pymantaray.apps.locate.unknowns import SurveyUnknowns
from pymantaray.arrays import Array
from pymantaray.geometry.spread import MAD_TO_SIGMA

_MAX_STEPS = 60
_CONVERGED = 3e-3  # change of the logarithm of every hyperparameter
_MIN_HYPER = 1e-8  # hyperparameters: fractions of the sound speed, also per km
_MAX_HYPER = 1e-1
MIN_REDUNDANCY = 3  # pings minus unknowns, for an estimate of the noise level
MIN_SIGMA = 1e-9  # s


def robust_sigma(residual: Array) -> float:
    """Standard deviation of residuals from their median magnitude, always positive. [s]"""
    return max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), MIN_SIGMA)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior of a linear system: changes of all columns, covariance and evidence."""

    change: Array
    covariance: Array  # (size, size), 0 where known
    sigma: float  # s
    hyperparameters: Mapping[str, float]
    log_evidence: float
    squares: float
    """Sum of squared whitened residuals after the change, in units of sigma²."""
    effective: float
    """Effective number of parameters."""

    @property
    def abic(self) -> float:
        """Akaike's Bayesian information criterion; smaller is better."""
        return -2.0 * self.log_evidence + 2.0 * (1 + len(self.hyperparameters))


def posterior(
    products: Products,
    unknowns: SurveyUnknowns,
    values: Array,
    start: Mapping[str, float],
    *,
    sigma: float,
    without: NDArray[np.int64] | None = None,
    steps: int = _MAX_STEPS,
    is_fixed: bool = False,
) -> Posterior:
    """
    Posterior at values, with the noise level [s] and the hyperparameters of maximum evidence.

    The iteration starts from ``sigma`` and ``start``. The noise level stays at ``sigma`` if there
    are too few pings. The columns ``without`` are known. With ``steps=1``, nothing but the columns
    changes; with ``is_fixed``, hyperparameters do not change. Known columns change to their prior
    means.
    """
    prior_sd = unknowns.prior_sd
    if without is not None:
        prior_sd[without] = 0.0
    groups = {
        name: columns[prior_sd[columns] > 0.0]
        for name, columns in unknowns.groups.items()
        if (prior_sd[columns] > 0.0).any()
    }
    active = np.flatnonzero(prior_sd > 0.0)
    hyper = dict.fromkeys(unknowns.groups, 1.0) | {
        name: float(start.get(name, 1e-4)) for name in groups
    }
    offset = unknowns.prior_mean - values
    mean = offset[active]
    known_change = np.where(prior_sd > 0.0, 0.0, offset)
    products = products.shifted(known_change)
    row_of = {column: i for i, column in enumerate(active.tolist())}
    members = {
        name: np.array([row_of[column] for column in columns.tolist()])
        for name, columns in groups.items()
    }
    plain = active.size - sum(rows.size for rows in members.values())
    normal = products.normal[np.ix_(active, active)]
    right = products.right[active]
    for step in range(steps):
        sd = unknowns.scaled_sd(hyper)[active]
        solution = _solve(normal, right, products, mean, sd, sigma)
        if step == steps - 1:
            break
        # MacKay: the variance of a group is its sum of squares over the number of its coefficients
        # that the data determine
        largest_change = 0.0
        for name, rows in {} if is_fixed else members.items():
            free = float(np.sum(1.0 - np.diag(solution.covariance)[rows] / sd[rows] ** 2))
            squares = float(
                np.sum(((solution.change - mean)[rows] / (sd[rows] / hyper[name])) ** 2)
            )
            new = float(np.clip(np.sqrt(squares / max(free, 1e-9)), _MIN_HYPER, _MAX_HYPER))
            largest_change = max(largest_change, abs(np.log(new / hyper[name])))
            hyper[name] = new
        # the same for the noise, unless there are too few pings to estimate it
        if products.n_rows >= plain + MIN_REDUNDANCY:
            degrees = max(products.n_rows - solution.effective, 1.0)
            level = max(sigma * float(np.sqrt(solution.squares / degrees)), MIN_SIGMA)
            largest_change = max(largest_change, abs(np.log(level / sigma)))
            sigma = level
        if largest_change < _CONVERGED:
            sd = unknowns.scaled_sd(hyper)[active]
            solution = _solve(normal, right, products, mean, sd, sigma)
            break
    change = known_change
    covariance = np.zeros((unknowns.size, unknowns.size))
    change[active] = solution.change
    covariance[np.ix_(active, active)] = solution.covariance
    selected = {name: hyper[name] for name in groups}
    return replace(solution, change=change, covariance=covariance, hyperparameters=selected)


def _solve(
    normal: Array, right: Array, products: Products, mean: Array, sd: Array, sigma: float
) -> Posterior:
    """Posterior for fixed variances, scaled by the priors for good conditioning."""
    scaled_normal = normal * (sd[:, None] * sd[None, :] / sigma**2)
    factor = cho_factor(scaled_normal + np.eye(sd.size), lower=True, check_finite=False)
    inverse = cho_solve(factor, np.eye(sd.size), check_finite=False)
    offset = mean / sd
    z = inverse @ (right * sd / sigma**2 + offset)
    change = sd * z
    squares = float(products.squares - 2.0 * change @ right + change @ normal @ change) / sigma**2
    squares = max(squares, 0.0)
    penalty = float(np.sum((z - offset) ** 2))
    log_evidence = -0.5 * (
        products.n_rows * np.log(2.0 * np.pi * sigma**2)
        + products.log_determinant
        + 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
        + squares
        + penalty
    )
    effective = float(sd.size - np.trace(inverse))
    covariance = inverse * sd[:, None] * sd[None, :]
    return Posterior(change, covariance, sigma, {}, float(log_evidence), squares, effective)
