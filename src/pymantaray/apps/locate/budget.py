"""Error budget of each position in metres: an exact decomposition of the posterior covariance."""

import numpy as np
import pandas as pd

from pymantaray.apps.locate.evidence import posterior
from pymantaray.apps.locate.solve import SurveySolution
from pymantaray.apps.locate.survey import PlatformError
from pymantaray.arrays import Array

_PRIORS = {
    "sound speed": ("speed",),
    "lever arm": ("lever",),
    "turn-around time": ("turn_around",),
    "clocks": ("offset", "drift"),
    "prior of the positions": ("position", "array"),
}


def error_budget(solution: SurveySolution, of_models: Array, widening: float) -> pd.DataFrame:
    r"""
    Contributions to the standard deviations of each node's position.

    With the posterior covariance :math:`\Sigma`, priors :math:`P` and information of the data
    :math:`G`,
    :math:`\Sigma = \Sigma G \Sigma + \Sigma P^{-1} \Sigma`. The first part is due to the noise of
    the pings. It consists of ``noise``, the value if only positions were unknown; ``platform
    positions``, the contribution of their errors; and ``geometry``, the remainder, due to the
    correlation of positions with other unknowns in this pattern. The second part is a sum over
    unknowns. ``choice of the model`` is the covariance ``of_models`` [m²], and ``failed tests`` the
    effect of multiplying all by the factor ``widening``. The squares of all contributions add up to
    the square of ``total``.
    """
    unknowns = solution.unknowns
    fit = solution.posterior
    columns = solution.unknowns.slices
    # covariance of positions and all unknowns, and inverse priors
    by_position = unknowns.position_map(solution.values).reshape(-1, unknowns.size)
    spread = by_position @ fit.covariance
    sd = unknowns.scaled_sd(fit.hyperparameters)
    is_known = np.diag(fit.covariance) <= 0.0
    inverse = np.where(is_known | (sd <= 0.0), 0.0, 1.0 / np.maximum(sd, 1e-300))
    # contributions of the priors
    parts = {
        name: sum(
            np.sum((spread[:, columns[kind]] * inverse[columns[kind]]) ** 2, axis=1)
            for kind in kinds
        )
        for name, kinds in _PRIORS.items()
    }
    # the remainder is due to the noise of the pings, in three parts
    total = np.sum(spread * by_position, axis=1)
    noise = np.maximum(total - sum(parts.values()), 0.0)
    from_noise = np.minimum(_noise_alone(solution, by_position, inverse), noise)
    platform = np.minimum(_platform(solution, by_position, total), noise - from_noise)
    variances = {
        "noise": from_noise,
        "geometry": noise - from_noise - platform,
        "platform positions": platform,
    }
    variances |= parts
    # doubts about the model and about its noise
    variances["choice of the model"] = np.diag(of_models)
    total = total + np.diag(of_models)
    variances["failed tests"] = (widening**2 - 1.0) * total
    variances["total"] = widening**2 * total
    # one row for each node and source
    names = unknowns.survey.names
    sigma = np.sqrt(np.maximum(np.array(list(variances.values())), 0.0))
    north, east, depth = sigma.reshape(len(variances), -1, 3).T
    return pd.DataFrame(
        {
            "node": np.repeat(names, len(variances)),
            "source": list(variances) * len(names),
            "north_m": north.ravel(),
            "east_m": east.ravel(),
            "depth_m": depth.ravel(),
        }
    )


def _noise_alone(solution: SurveySolution, by_position: Array, inverse: Array) -> Array:
    """Variances if only positions were unknown."""
    slices = solution.unknowns.slices
    columns = np.concatenate(
        [np.arange(slices[kind].start, slices[kind].stop) for kind in ("position", "array")]
    )
    columns = columns[inverse[columns] > 0.0]
    if not columns.size:
        return np.zeros(len(by_position))
    information = solution.products.normal[np.ix_(columns, columns)] / solution.posterior.sigma**2
    scale = 1.0 / inverse[columns]
    scaled_information = information * np.outer(scale, scale) + np.eye(columns.size)
    covariance = np.linalg.inv(scaled_information) * np.outer(scale, scale)
    spread = by_position[:, columns] @ covariance
    return np.asarray(np.einsum("ij,jk,ik->i", spread, information, spread))


def _platform(solution: SurveySolution, by_position: Array, total: Array) -> Array:
    """Contribution of errors of the platform's positions to the variances."""
    survey = solution.unknowns.survey
    fit = solution.posterior
    if survey.platform_error.horizontal == survey.platform_error.vertical == 0.0:
        return np.zeros_like(total)
    products = solution.linear.products(
        solution.used, solution.correlation, PlatformError(), fit.sigma
    )
    without = posterior(
        products, solution.unknowns, solution.values, fit.hyperparameters, sigma=fit.sigma, steps=1
    )
    less = np.sum((by_position @ without.covariance) * by_position, axis=1)
    return np.asarray(np.maximum(total - less, 0.0))
