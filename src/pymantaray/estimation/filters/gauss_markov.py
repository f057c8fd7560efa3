"""
First-order Gauss-Markov processes, observed through one of several alternatives at a time: Kalman
filter with probabilistic data association.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import Array, Indices

_MAX_TERM = 700.0  # of an exponent
_CHANGE = 1e-3  # probability per measurement that errors begin or end
CLUTTER = 0.02
"""Share of measured travel times that no prediction explains."""
CLUTTER_WIDTH = 0.1
"""Width of the distribution of their times. [s]"""


class Processes(NamedTuple):
    """Independent processes with mean zero."""

    sigma: Array
    """Stationary standard deviation of each, above 0."""
    time_scale: Array
    """Correlation time of each, infinite for a constant. [s]"""


class Alternatives(NamedTuple):
    """Alternative explanations of one measurement by the same linear combination of processes."""

    residual: Array
    """Measured minus predicted without the processes, of each alternative."""
    variance: Array
    """Variance of the noise of each."""
    probability: Array
    """Probability of each before the measurement; their sum is the probability of any of them."""
    density: float
    """Density of a measurement that no alternative explains, times its probability."""


class Association(NamedTuple):
    """Outcome of an update: posterior probability of each alternative, and the log likelihood."""

    probability: Array
    log_likelihood: float


@dataclass
class GaussMarkovFilter:
    """
    Mean and covariance of processes at a time, which may run backwards.

    Parameters
    ----------
    processes : Processes
    time : float
        [s]
    """

    processes: Processes
    time: float

    def __post_init__(self) -> None:
        """Begin with the stationary distribution."""
        self._stationary = self.processes.sigma**2
        self.mean: Array = np.zeros(self._stationary.size)
        self.covariance: Array = np.diag(self._stationary)
        self._relaxes = np.isfinite(self.processes.time_scale).any()

    def advance(self, time: float) -> None:
        """Move to a later time, or for a filter that runs backwards to an earlier one."""
        elapsed = abs(time - self.time)
        self.time = time
        if elapsed == 0.0 or not self._relaxes:
            return
        keep = np.exp(-elapsed / self.processes.time_scale)
        self.mean *= keep
        relax(self.covariance, keep, self._stationary)

    @property
    def estimate(self) -> Estimate:
        """Copy of mean and covariance."""
        return Estimate(self.mean.copy(), self.covariance.copy())

    def update(self, columns: Indices, values: Array, alternatives: Alternatives) -> Association:
        r"""
        Update by a measurement that one alternative, or none, explains.

        Parameters
        ----------
        columns : ndarray of int, shape (m,)
            Processes that contribute.
        values : ndarray, shape (m,)
            Their factors.
        alternatives : Alternatives

        Returns
        -------
        Association

        Notes
        -----
        The posterior is a mixture of Gaussians with one component per alternative. It is replaced
        by the Gaussian with its mean and covariance [1]_. All components differ along one
        direction, the covariance of state and measurement, so the update has rank one. A
        measurement that no alternative explains changes nothing.

        References
        ----------
        .. [1] Bar-Shalom, Y., Daum, F. and Huang, J. (2009), The probabilistic data association
           filter, IEEE Control Systems Magazine 29(6), 82-100.
        """
        along = self.covariance[:, columns] @ values
        mean = float(values @ self.mean[columns])
        variance = alternatives.variance + max(float(values @ along[columns]), 0.0)
        off = alternatives.residual - mean
        exponent = np.minimum(0.5 * off**2 / variance, _MAX_TERM)
        density = alternatives.probability * np.exp(-exponent) / np.sqrt(2.0 * np.pi * variance)
        total = float(density.sum()) + alternatives.density
        weight = density / total
        gain = weight / variance
        shift = float(gain @ off)
        reduction = float(gain.sum()) - float(gain @ (off**2 / variance)) + shift**2
        self.mean += shift * along
        self.covariance -= max(reduction, 0.0) * np.outer(along, along)
        return Association(weight, float(np.log(total)))


def relax(covariance: Array, keep: Array, stationary: Array) -> None:
    """
    Let the covariance of processes relax towards their stationary variances, in place.

    Parameters
    ----------
    covariance : ndarray, shape (n, n)
        Contiguous.
    keep : ndarray, shape (n,)
        Share of each process that remains.
    stationary : ndarray, shape (n,)
    """
    covariance *= keep
    covariance *= keep[:, None]
    covariance.reshape(-1)[:: keep.size + 1] += (1.0 - keep**2) * stationary


class Estimate(NamedTuple):
    """Mean and covariance of processes."""

    mean: Array
    covariance: Array


def fuse(forward: Estimate, backward: Estimate, processes: Processes) -> Estimate:
    """
    Estimate at a time from the measurements before it and those after it.

    Both estimates contain the stationary distribution, which counts once.
    """
    unit = processes.sigma
    information = []
    weighted = np.zeros(unit.size)
    for estimate in (forward, backward):
        inverse = np.linalg.inv(estimate.covariance / np.outer(unit, unit))
        information.append(inverse)
        weighted += inverse @ (estimate.mean / unit)
    values, vectors = np.linalg.eigh(information[0] + information[1] - np.eye(unit.size))
    covariance = (vectors / np.maximum(values, 1.0)) @ vectors.T
    return Estimate(unit * (covariance @ weighted), covariance * np.outer(unit, unit))


def average_models(with_errors: float, without: float, no_error: float) -> tuple[float, float]:
    """
    Log likelihood of a measurement by two models, and the probability of the second after it.

    Each event replaces a small share of the probabilities by equal ones, because errors may begin.
    """
    ratio = np.exp(np.clip(without - with_errors, -50.0, 50.0))
    total = 1.0 - no_error + no_error * ratio
    after = (1.0 - _CHANGE) * no_error * ratio / total + 0.5 * _CHANGE
    return with_errors + np.log(total), float(after)
