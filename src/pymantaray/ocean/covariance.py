"""Covariance of a sound-speed error between places in the water."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import OceanError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SoundSpeedCovariance:
    """
    Covariance C(z, z') exp(-d²/2L²) of a sound-speed error between two places.

    Attributes
    ----------
    depth : ndarray, shape (n_levels,)
        [m]
    matrix : ndarray, shape (n_levels, n_levels)
        C at the levels; bilinear between them and constant beyond. [m²/s²]
    horizontal_scale : float
        L. [m]

    Raises
    ------
    OceanError
        If shapes do not fit, the matrix is not symmetric, or the scale is not positive.
    """

    depth: Array
    matrix: Array
    horizontal_scale: float

    def __post_init__(self) -> None:
        """Check."""
        n = np.size(self.depth)
        if self.matrix.shape != (n, n) or not np.allclose(self.matrix, self.matrix.T, rtol=0, atol=1e-12):
            raise OceanError(
                f"covariance: shape {self.matrix.shape} for {n} levels; a symmetric square matrix is needed"
            )
        if not self.horizontal_scale > 0.0:
            raise OceanError(
                f"covariance: horizontal_scale is {self.horizontal_scale:g} m; it must be positive"
            )

    @classmethod
    def gaussian(
        cls,
        depth: ArrayLike,
        *,
        rms: ArrayLike,
        vertical_scale: float,
        horizontal_scale: float,
    ) -> Self:
        """
        Covariance of a Gaussian process with a Gaussian correlation in depth too.

        Parameters
        ----------
        depth : array_like, shape (n_levels,)
            [m]
        rms : array_like, shape () or (n_levels,)
            Standard deviation of sound speed, the same everywhere or by level. [m/s]
        vertical_scale, horizontal_scale : float
            [m]

        Returns
        -------
        SoundSpeedCovariance
        """
        z = np.asarray(depth, dtype=float)
        sigma = np.broadcast_to(np.asarray(rms, dtype=float), z.shape)
        if not vertical_scale > 0.0 or np.any(sigma < 0.0):
            raise OceanError(
                f"covariance: vertical_scale {vertical_scale:g} m must be positive and rms not negative"
            )
        correlation = np.exp(-0.5 * ((z[:, None] - z) / vertical_scale) ** 2)
        return cls(z, sigma[:, None] * correlation * sigma, float(horizontal_scale))

    def __call__(self, a: ArrayLike, b: ArrayLike) -> Array:
        """
        Covariance between places.

        Parameters
        ----------
        a, b : array_like, shape (..., 3)
            North, east, down in one local frame; they broadcast. [m]

        Returns
        -------
        ndarray, shape (...)
            [m²/s²]
        """
        p, q = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
        apart = np.sum(((p[..., :2] - q[..., :2]) / self.horizontal_scale) ** 2, axis=-1)
        (i, s), (j, t) = (self._bracket(x[..., 2]) for x in (p, q))
        vertical = (1 - s) * ((1 - t) * self.matrix[i, j] + t * self.matrix[i, j + 1]) + s * (
            (1 - t) * self.matrix[i + 1, j] + t * self.matrix[i + 1, j + 1]
        )
        return np.asarray(vertical * np.exp(-0.5 * apart))

    def principal(self, share: float = 1.0 - 1e-6) -> tuple[Array, Array]:
        """
        Modes of the covariance that carry a share of its variance over the water column.

        Parameters
        ----------
        share : float

        Returns
        -------
        modes : ndarray, shape (n_modes, n_levels)
            Orthonormal under `layer_weights`.
        variance : ndarray, shape (n_modes,)
            Falling. [m²/s²]
        """
        values, vectors = weighted_eigen(self.matrix, layer_weights(self.depth))
        kept = 1 + int(np.searchsorted(np.cumsum(values), share * values.sum()))
        return vectors[:kept], values[:kept]

    def _bracket(self, z: Array) -> tuple[NDArray[np.intp], Array]:
        clipped = np.clip(z, self.depth[0], self.depth[-1])
        i = np.clip(np.searchsorted(self.depth, clipped) - 1, 0, self.depth.size - 2)
        return i, (clipped - self.depth[i]) / (self.depth[i + 1] - self.depth[i])


def layer_weights(depth: ArrayLike) -> Array:
    """
    Share of the water column that each level stands for.

    Parameters
    ----------
    depth : array_like, shape (n_levels,)
        Strictly increasing. [m]

    Returns
    -------
    ndarray, shape (n_levels,)
        From half-way to the level above to half-way to the one below, over the whole; their sum is 1.
    """
    z = np.asarray(depth, dtype=float)
    edges = np.concatenate([z[:1], 0.5 * (z[:-1] + z[1:]), z[-1:]])
    return np.asarray(np.diff(edges) / (z[-1] - z[0]))


def weighted_eigen(matrix: Array, weights: Array) -> tuple[Array, Array]:
    """
    Principal axes of a covariance when each level counts by its weight.

    Parameters
    ----------
    matrix : ndarray, shape (n_levels, n_levels)
    weights : ndarray, shape (n_levels,)
        Positive, of sum 1.

    Returns
    -------
    variance : ndarray, shape (n_levels,)
        Falling.
    modes : ndarray, shape (n_levels, n_levels)
        In rows, orthonormal under the weights, positive where largest.
    """
    root = np.sqrt(weights)
    values, vectors = np.linalg.eigh(root[:, None] * matrix * root)
    values, modes = np.maximum(values[::-1], 0.0), (vectors[:, ::-1] / root[:, None]).T
    largest = np.take_along_axis(modes, np.abs(modes).argmax(axis=1)[:, None], axis=1)
    return values, np.ascontiguousarray(modes * np.where(largest < 0.0, -1.0, 1.0))
