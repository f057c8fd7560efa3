"""Errors of the sound speed that an on-line estimator learns: one for each pair of depth bands."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from pymantaray.errors import OnlineError
from pymantaray.quantities.checks import check_magnitudes, check_number, checked_array, is_number


class SoundSpeedBias(NamedTuple):
    """
    Relative error of the sound speed between two depth bands (from, to) [m], and its sigma.

    Examples
    --------
    >>> from pymantaray.apps.online import SoundSpeedBias
    >>> SoundSpeedBias((0.0, 100.0), (100.0, 1000.0), 0.5, 0.1).value
    0.5
    """

    band: tuple[float, float]
    other: tuple[float, float]
    value: float
    sigma: float


class DriftingWater(NamedTuple):
    """
    Relative errors of the sound speed, which drift.

    Each pair of depth bands of transmitter and receiver has its own error, a first-order
    Gauss-Markov process.

    Attributes
    ----------
    sigma : float
        Standard deviation of the relative error; 1e-3 is 1.5 m/s.
    hours : float
        Correlation time; infinite for an error that is constant. [h]
    depths : tuple of float
        Limits of the depth bands, ascending; by default there is one band. [m]

    Examples
    --------
    >>> from pymantaray.apps.online import DriftingWater
    >>> DriftingWater(2e-3, 6.0, (100.0,)).depths
    (100.0,)
    """

    sigma: float
    hours: float = 6.0
    depths: tuple[float, ...] = ()

    def checked(self) -> DriftingWater:
        """
        Return the same water as plain numbers.

        Raises
        ------
        OnlineError
            If a value is not allowed.
        """
        check_number(OnlineError, "water: sigma", self.sigma, "1", positive=True)
        check_magnitudes(OnlineError, "water: sigma", self.sigma)
        if not (is_number(self.hours) and self.hours > 0.0):
            raise OnlineError(f"water: hours is {self.hours} h; it must be positive")
        depths = checked_array(
            OnlineError, "water: depths", self.depths, (np.size(self.depths),), rising=True
        )
        return DriftingWater(float(self.sigma), float(self.hours), tuple(depths.tolist()))

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Pairs of depth bands, each with the shallower one first."""
        bands = len(self.depths) + 1
        return [(a, b) for a in range(bands) for b in range(a, bands)]

    @property
    def bands(self) -> list[tuple[float, float]]:
        """Depth bands; the first and the last have no limit. [m]"""
        limits = [-np.inf, *self.depths, np.inf]
        return list(pairwise(limits))

    def number_of(self, depth: float, other: float) -> int:
        """
        Number of the pair of bands of two depths.

        Parameters
        ----------
        depth, other : float
            Positive down. [m]

        Returns
        -------
        int
        """
        low, high = sorted(int(band) for band in np.searchsorted(self.depths, (depth, other)))
        return self.pairs.index((low, high))


def saved_water(content: Any) -> DriftingWater | None:
    """Water of a saved estimator; an error if it is not one."""
    if content is None:
        return None
    sigma, hours, depths = content
    return DriftingWater(float(sigma), float(hours), tuple(float(x) for x in depths)).checked()
