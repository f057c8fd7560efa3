"""
Picks of the ranges of one ping from the predicted positions of its ends, by a graduated mixture.
"""

from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array, Mask
from pymantaray.estimation.ranges.expansion import Expansion
from pymantaray.estimation.ranges.picks import fits
from pymantaray.estimation.ranges.range_models import Rows
from pymantaray.geometry import stream

_CONTROL_RATIO = 1.5  # ratio of the standard deviations of successive surrogates
_STEPS = 3  # re-weighted steps on each surrogate
_DRAWN_STARTS = 24  # descents from positions drawn from the prediction


class EpochMixture(NamedTuple):
    """
    Candidates of the ranges of one ping and the distribution of its ends and the unknowns before
    these ranges.
    """

    expansion: Expansion  # of the candidates
    transmitter: Rows  # end of each candidate
    receiver: Rows
    position: Array  # of the ends, (n_ends, 3) [m]
    unknowns: Array  # that all ranges share, in their prior standard deviations
    covariance: (
        Array  # of positions [m²] and unknowns, (3 n_ends + n_unknowns, 3 n_ends + n_unknowns)
    )
    row: Rows  # range of each candidate
    variance: Array  # of each candidate's residual [m²]
    smallest: Array  # variance of each candidate's range in an exact ocean [m²]
    weight: Array  # probability of each candidate before the range is measured
    null: Array  # probability density of each range if it belongs to none, relative to `fits`


def graduated_fits(mixture: EpochMixture, gate: float) -> Array:
    """
    Fit of each candidate at the most probable positions of the ends; infinite for gated candidates.

    Each step weights the candidates of a range by their probabilities at the current positions and
    combines them with the prediction (expectation and maximization). The standard deviations of the
    ranges begin at the largest one of an innovation and decrease to their own, so that the first
    steps see one mode. Further descents begin at positions drawn from the prediction, with smaller
    standard deviations; the one of lowest cost is taken. Candidates whose innovation exceeds
    ``gate`` standard deviations are discarded.
    """
    root = np.linalg.cholesky(
        mixture.covariance + 1e-12 * np.trace(mixture.covariance) * np.eye(len(mixture.covariance))
    )
    residual, by_offset = _at(mixture, root, np.zeros(len(root)))
    innovation = np.sum(by_offset**2, axis=1) + mixture.variance
    allowed = residual**2 <= gate**2 * innovation
    if not allowed.any():
        return np.full(residual.size, np.inf)
    control = max(1.0, float(np.sqrt((innovation / mixture.variance)[allowed].max())))
    rng = stream(0, 0, "estimation", "picks of a ping")
    ends = [_descend(mixture, root, np.zeros(len(root)), control, allowed)]
    ends += [
        _descend(mixture, root, rng.standard_normal(len(root)), np.sqrt(control), allowed)
        for _ in range(_DRAWN_STARTS)
    ]
    residual = min(ends, key=lambda end: end[0])[1]
    return np.where(allowed, fits(residual, mixture.variance, mixture.smallest), np.inf)


def _descend(
    mixture: EpochMixture, root: Array, offset: Array, control: float, allowed: Mask
) -> tuple[float, Array]:
    """
    Cost and residuals of the candidates at the end of a graduated descent from an offset of the
    ends.
    """
    residual, by_offset = _at(mixture, root, offset)
    while True:
        for _ in range(_STEPS):
            share = _shares(mixture, residual, control**2, allowed)
            information = share / (control**2 * mixture.variance)
            target = by_offset @ offset - residual
            matrix = np.eye(len(root)) + by_offset.T @ (information[:, None] * by_offset)
            offset = np.asarray(np.linalg.solve(matrix, by_offset.T @ (information * target)))
            residual, by_offset = _at(mixture, root, offset)
        if control == 1.0:
            break
        control = max(1.0, control / _CONTROL_RATIO)
    fit = fits(residual, mixture.variance, mixture.smallest)
    density = np.where(allowed, mixture.weight * np.exp(-fit), 0.0)
    best = np.array(mixture.null)
    np.maximum.at(best, mixture.row, density)
    with np.errstate(divide="ignore"):
        return float(0.5 * offset @ offset - np.log(best).sum()), residual


def _at(mixture: EpochMixture, root: Array, offset: Array) -> tuple[Array, Array]:
    """
    Residuals of the candidates and their derivatives by the offset of the ends, in units of their
    covariance's root.
    """
    displacement = root @ offset
    m = 3 * len(mixture.position)
    position = mixture.position + displacement[:m].reshape(-1, 3)
    residual, by_transmitter, by_receiver = mixture.expansion(
        position[mixture.transmitter],
        position[mixture.receiver],
        mixture.unknowns + displacement[m:],
    )
    rows = root[:m].reshape(-1, 3, root.shape[1])
    by_offset = np.einsum("ni,nij->nj", by_transmitter, rows[mixture.transmitter])
    by_offset += np.einsum("ni,nij->nj", by_receiver, rows[mixture.receiver])
    return residual, by_offset + mixture.expansion.by_unknowns @ root[m:]


def _shares(mixture: EpochMixture, residual: Array, control: float, allowed: Mask) -> Array:
    """Probability of each candidate with all variances multiplied by a factor."""
    fit = fits(residual, control * mixture.variance, mixture.smallest)
    density = np.where(allowed, mixture.weight * np.exp(-fit), 0.0)
    total = np.bincount(mixture.row, density, mixture.null.size) + mixture.null
    return np.asarray(density / np.maximum(total, np.finfo(float).tiny)[mixture.row])
