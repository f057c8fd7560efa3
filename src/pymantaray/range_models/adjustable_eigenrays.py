"""Eigenrays in an assumed ocean whose sound speed has vertical modes of unknown amplitude."""

from typing import Self

import numpy as np

from pymantaray.acoustics import Medium
from pymantaray.acoustics.paths import travel_time_sensitivity
from pymantaray.arrays import Array
from pymantaray.estimation import Prediction, RangeEndpoints, RangeModel
from pymantaray.geometry.natural_spline import natural_spline
from pymantaray.range_models.eigenray_model import EigenrayModel, pairs_of


class AdjustableEigenrays(RangeModel):
    r"""
    Travel time of the earliest direct eigenray in an assumed ocean plus the error :math:`\sum_k a_k
    \phi_k(z)` of its sound speed.

    Shapes (n_modes, n_levels) are linear between their levels [m] and constant beyond; the prior
    standard deviation of the amplitudes is in m/s. Rays are traced again in the adjusted medium, so
    travel times are exact for all amplitudes; their derivatives are integrals along these rays
    (Fermat). The shapes are interpolated like the levels of the medium, so both agree to the last
    digit.
    """

    def __init__(
        self, model: EigenrayModel, depth: Array, shapes: Array, amplitude_sigma: Array
    ) -> None:
        self.amplitude_sigma = amplitude_sigma
        medium = model.medium
        self._levels = np.stack([np.interp(medium.depth, depth, shape) for shape in shapes])
        self._model = self._initial = model
        self._amplitudes = np.zeros(amplitude_sigma.size)
        self._latest: Self | None = None

    @property
    def medium(self) -> Medium:
        """Assumed ocean, for which all amplitudes are zero."""
        return self._initial.medium

    def predict(self, links: RangeEndpoints) -> Prediction:
        """Travel times of the direct arrivals."""
        return self._model.predict(links)

    def adjusted(self, amplitudes: Array) -> Self:
        """
        Model with other amplitudes [m/s], relative to the initially assumed ocean; the latest model
        is kept.
        """
        if np.array_equal(amplitudes, self._amplitudes):
            return self
        if self._latest is None or not np.array_equal(amplitudes, self._latest._amplitudes):
            other = type(self).__new__(type(self))
            other.__dict__.update(
                self.__dict__, _latest=None, _amplitudes=np.array(amplitudes, dtype=float)
            )
            medium = self._initial.medium
            other._model = self._initial.through(
                Medium.from_grid(
                    medium.north,
                    medium.east,
                    medium.depth,
                    medium.sound_speed + amplitudes @ self._levels,
                    interpolation=medium.interpolation,
                    bathymetry=medium.bed,
                    ice_draft=medium.surface,
                    earth=medium.earth,
                )
            )
            self._latest = other
        return self._latest

    def sensitivity(self, links: RangeEndpoints) -> Array:
        """
        Derivatives of the travel times by the amplitudes (n, n_modes), zero without an arrival.
        [s²/m]
        """
        pairs = pairs_of(links, self._initial.medium)
        paths, pair = self._model.paths(pairs)
        of_pairs = np.zeros((pairs.source.shape[0], self.amplitude_sigma.size))
        of_pairs[pair] = travel_time_sensitivity(paths, self._shapes_at)
        return of_pairs[pairs.pair]

    def fit(self, difference: Array, weights: Array) -> Array:
        """
        Amplitudes nearest to a difference of sound speeds at the levels, by weighted least squares.
        [m/s]
        """
        root = np.sqrt(weights)
        return np.asarray(
            np.linalg.lstsq((root * self._levels).T, root * difference, rcond=None)[0]
        )

    def _shapes_at(self, position: Array) -> Array:
        medium = self._initial.medium
        z = np.clip(position[:, 2], medium.depth[0], medium.depth[-1])
        if medium.interpolation == "smooth":
            return natural_spline(medium.depth, self._levels, z).T
        return np.stack([np.interp(z, medium.depth, level) for level in self._levels], axis=1)
