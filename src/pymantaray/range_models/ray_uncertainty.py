"""Covariance of travel times from that of the sound speed along the rays."""

import math

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.paths import quadrature
from pymantaray.arrays import Array
from pymantaray.estimation import RangeEndpoints
from pymantaray.estimation.ranges.range_models import TravelTimeUncertainty
from pymantaray.ocean import SoundSpeedCovariance
from pymantaray.range_models.eigenray_model import EigenrayModel, pairs_of

_PER_SCALE = 8  # pieces of a ray to each horizontal scale: 0.2 % of a variance
_MAX_SECTIONS = 64


class RayUncertainty(TravelTimeUncertainty):
    r"""
    Uncertainty of the direct arrivals' travel times in an assumed ocean.

    By Fermat's principle the first-order error of a travel time is the integral of minus
    :math:`c'/c^2` along the unperturbed ray, so two links of one epoch have the covariance

    .. math:: \int\!\!\int \frac{C(z, z') \, e^{-d^2 / 2 L^2}}{c^2 c'^2} \, ds \, ds' .

    Each ray is cut into pieces of at most an eighth of :math:`L`. In depth the integral over a
    piece is exact, because :math:`C` is bilinear between levels: the hat functions of the levels
    are integrated along the ray. Horizontally the correlation is that of the pieces' centroids.
    Both factors of the sum are positive semidefinite, so the result is, too. A link without a ray
    has no variance. The first order omits that another family of rays may arrive first in the true
    ocean.
    """

    def __init__(self, model: EigenrayModel, covariance: SoundSpeedCovariance) -> None:
        self._model = model
        self._covariance = covariance

    def covariances(self, links: RangeEndpoints, epoch: NDArray[np.intp]) -> list[Array]:
        """
        Covariances of the links of each epoch (n_links, n_links); both directions use one ray.
        [s²]
        """
        pairs = pairs_of(links, self._model.medium)
        paths, pair = self._model.paths(pairs)
        points = quadrature(paths)
        squared_slowness = np.sum(points.slowness**2, axis=1)
        weight, centre = self._pieces(
            pair[points.arrival],
            points.position,
            points.weight * squared_slowness,
            pairs.source.shape[0],
        )
        out = []
        for e in range(int(epoch.max(initial=-1)) + 1):
            mine, at = np.unique(pairs.pair[epoch == e], return_inverse=True)
            w = weight[mine].reshape(-1, weight.shape[-1])
            x = centre[mine].reshape(-1, 2)
            apart = np.sum((x[:, None] - x) ** 2, axis=-1) / self._covariance.horizontal_scale**2
            full = np.exp(-0.5 * apart) * (w @ self._covariance.matrix @ w.T)
            n = mine.size
            pieces = weight.shape[1]
            of_pairs = full.reshape(n, pieces, n, pieces).sum(axis=(1, 3))
            out.append(of_pairs[np.ix_(at, at)])
        return out

    def _pieces(
        self, pair: NDArray[np.int64], position: Array, weight: Array, n_pairs: int
    ) -> tuple[Array, Array]:
        """Weights of the levels in each piece of each pair's ray, and the pieces' centroids."""
        z = self._covariance.depth
        low = np.full((n_pairs, 2), np.inf)
        high = np.full((n_pairs, 2), -np.inf)
        np.minimum.at(low, pair, position[:, :2])
        np.maximum.at(high, pair, position[:, :2])
        extent = np.where(high >= low, high - low, 0.0)
        longest = float(np.hypot(*extent.T).max(initial=0.0))
        count = int(
            np.clip(
                math.ceil(_PER_SCALE * longest / self._covariance.horizontal_scale),
                1,
                _MAX_SECTIONS,
            )
        )
        axis = np.argmax(extent, axis=1)[pair]  # pieces are cut along the longer of north and east
        row = np.arange(pair.size)
        length = extent[pair, axis]
        along = (position[row, axis] - low[pair, axis]) / np.where(length > 0.0, length, 1.0)
        piece = np.clip((count * along).astype(int), 0, count - 1)

        inside = np.clip(position[:, 2], z[0], z[-1])
        i = np.clip(np.searchsorted(z, inside) - 1, 0, z.size - 2)
        s = (inside - z[i]) / (z[i + 1] - z[i])
        levels = np.zeros((n_pairs, count, z.size))
        np.add.at(levels, (pair, piece, i), (1.0 - s) * weight)
        np.add.at(levels, (pair, piece, i + 1), s * weight)
        total = np.zeros((n_pairs, count))
        moment = np.zeros((n_pairs, count, 2))
        np.add.at(total, (pair, piece), weight)
        np.add.at(moment, (pair, piece), weight[:, None] * position[:, :2])
        return levels, moment / np.where(total > 0.0, total, 1.0)[..., None]
