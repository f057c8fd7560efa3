"""Uncertainty of positions due to the choice of a model of sound speed and noise."""

from collections.abc import Sequence

import numpy as np

from pymantaray.apps.locate.options import Kind
from pymantaray.apps.locate.solve import Candidate, SurveySolution
from pymantaray.arrays import Array


def spread_of_models(
    candidates: Sequence[Candidate], kinds: Sequence[Kind], solution: SurveySolution
) -> Array:
    """
    Covariance that the choice of the model adds to all positions (3 n_nodes, 3 n_nodes). [m²]

    The probability of each candidate of the allowed `kinds`, at each of its amplitudes of the sound
    speed, is proportional to exp(-ABIC / 2). The covariance of their mixture about the chosen
    model's positions is the mean of their covariances and squared differences. The result is its
    excess over the chosen model's covariance, at least 0 in all directions.
    """
    unknowns = solution.unknowns
    n_columns = unknowns.slices["array"].stop
    by_position = unknowns.position_map(solution.values).reshape(-1, unknowns.size)[:, :n_columns]
    allowed = [candidate for candidate in candidates if candidate.model.kind in kinds]
    chosen = next(candidate for candidate in allowed if candidate.model == solution.model)
    fits = [
        (fit, candidate.abic - 2.0 * (fit.log_evidence - candidate.fit.log_evidence))
        for candidate in allowed
        for fit in (candidate.fit, *candidate.others)
    ]
    abic = np.array([value for _, value in fits])
    probability = np.exp(-0.5 * (abic - abic.min()))
    probability /= probability.sum()
    total = np.zeros((len(by_position), len(by_position)))
    for (fit, _), weight in zip(fits, probability, strict=True):
        difference = by_position @ (fit.change[:n_columns] - chosen.fit.change[:n_columns])
        excess = fit.covariance[:n_columns, :n_columns]
        excess = excess - chosen.fit.covariance[:n_columns, :n_columns]
        total += weight * (by_position @ excess @ by_position.T + np.outer(difference, difference))
    values, vectors = np.linalg.eigh(total)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
