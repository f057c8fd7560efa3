r"""
Noise of pings: white noise, correlated noise, and errors of the platform's positions.

With :math:`\Delta` the time between two pings, their covariance is
:math:`\sigma^2(\delta + r\,e^{-|\Delta|/\mu}(m + (1-m)\,[\text{same node}]))`.
"""

from dataclasses import dataclass

import numpy as np

from pymantaray.apps.locate._kernels.whiten import whiten
from pymantaray.apps.locate.survey import PlatformError, Survey
from pymantaray.arrays import Array


@dataclass(frozen=True)
class Correlation:
    """
    Correlated part of the noise of times.

    Parameters
    ----------
    ratio : float
        Variance of the correlated part divided by that of the white part; 0 for none. [-]
    memory : float
        Time in which the correlation falls to 1/e. [s]
    shared : float
        Fraction of the correlated variance that is common to all nodes, 0 to 1. [-]
    """

    ratio: float = 0.0
    memory: float = 60.0
    shared: float = 0.5

    @property
    def variance(self) -> float:
        """Variance of one ping, in units of the white part."""
        return 1.0 + self.ratio


class Whitener:
    """
    Whitening of a survey's rows in order of time: independent rows with equal variance.

    ``sensitivity`` (n, 3) is the derivative of each time by the platform's position, in standard
    deviations of the white noise per metre.
    """

    def __init__(
        self,
        survey: Survey,
        correlation: Correlation,
        platform: PlatformError,
        sensitivity: Array,
    ) -> None:
        noise = correlation
        # observation of each process by the pings, its memory and its variance
        processes = list[tuple[Array, float, float]]()
        if noise.ratio > 0.0 and noise.shared > 0.0:
            common = np.ones(len(survey))
            processes.append((common, noise.memory, noise.ratio * noise.shared))
        if noise.ratio > 0.0 and noise.shared < 1.0:
            for k in range(len(survey.nodes)):
                of_node = (survey.node == k).astype(float)
                processes.append((of_node, noise.memory, noise.ratio * (1.0 - noise.shared)))
        sigmas = (platform.horizontal, platform.horizontal, platform.vertical)
        for slope, sigma in zip(sensitivity.T, sigmas, strict=True):
            if sigma > 0.0:
                processes.append((slope, platform.correlation, sigma**2))
        parts = np.array([part for part, _, _ in processes]).reshape(-1, len(survey))
        self._parts = np.ascontiguousarray(parts.T)
        self._memory = np.array([memory for _, memory, _ in processes])
        self._variance = np.array([variance for *_, variance in processes])
        self._step = np.maximum(np.diff(survey.time, prepend=survey.time[0]), 0.0)
        self.log_determinant = 0.0
        """Log determinant of the covariance of all rows up to now, in units of the white noise."""

    def __call__(self, rows: Array, start: int) -> Array:
        """Whiten rows (m, q) from row ``start``; chunks must be consecutive from 0."""
        out = np.ascontiguousarray(rows)
        if not self._memory.size:
            return out
        if start == 0:
            self._mean = np.zeros((self._memory.size, out.shape[1]))
            self._covariance = np.diag(self._variance)
            self._gain = np.empty(self._memory.size)
            self.log_determinant = 0.0
        part = slice(start, start + len(out))
        self.log_determinant += whiten(
            out,
            self._step[part],
            self._parts[part],
            self._memory,
            self._variance,
            self._mean,
            self._covariance,
            self._gain,
        )
        return out
