"""Roughness of a boundary: random Gaussian surfaces with a slope and a correlation length."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import GeometryError
from pymantaray.geometry.streams import stream
from pymantaray.quantities.checks import check_number

_POINTS = 512  # along each side of the periodic tile
_POINTS_PER_LENGTH = 6.0
MAX_DEVIATIONS = 4.0
"""Elevations are limited to this number of standard deviations."""


@dataclass(frozen=True)
class Roughness:
    r"""
    Random elevation of a boundary about its mean depth.

    Parameters
    ----------
    slope : float
        Standard deviation of the slope along any horizontal line. [rad]
    length : float
        Correlation length: the correlation of elevations at a distance r is :math:`e^{-r^2/L^2}`.
        [m]
    seed : int
        Seed of the draws.
    draw : int
        Number of the draw. Draws 0, 1, 2, ... are independent; draw -1 - n is draw n upside down.

    Notes
    -----
    The elevation is Gaussian with a Gaussian spectrum, as in [1]_: white noise from the stream
    ``("surface", "roughness")`` is filtered in the frequency domain by :math:`e^{-k^2L^2/8}`. Its
    standard deviation is :math:`h = L \tan s / \sqrt 2` for the slope s. The surface is a periodic
    tile with sides of 85 correlation lengths.

    References
    ----------
    .. [1] Tsang, L., Kong, J. A., Ding, K. H. and Ao, C. O. (2001), Scattering of Electromagnetic
       Waves: Numerical Simulations, chapter 4; opened: the description of its programs,
       http://www.ee.washington.edu/research/laceo/emwave/surface/r1/rsge.html.
    """

    slope: float
    length: float
    seed: int = 20140715
    draw: int = 0

    def __post_init__(self) -> None:
        """Check slope and length."""
        check_number(GeometryError, "roughness: slope", self.slope, "rad")
        check_number(GeometryError, "roughness: length", self.length, "m", positive=True)
        if not self.slope < 0.5:
            raise GeometryError(f"roughness: slope is {self.slope:g} rad; it must be below 0.5 rad")

    @property
    def height(self) -> float:
        """Standard deviation of the elevation. [m]"""
        return float(self.length * np.tan(self.slope) / np.sqrt(2.0))

    @property
    def reach(self) -> float:
        """Largest elevation. [m]"""
        return MAX_DEVIATIONS * self.height

    @property
    def side(self) -> float:
        """Side of the periodic tile. [m]"""
        return self.length * _POINTS / _POINTS_PER_LENGTH

    def with_draw(self, draw: int) -> Self:
        """Return the same roughness with another draw."""
        return replace(self, draw=draw)

    @cached_property
    def _coefficients(self) -> Array:
        """Coefficients of the cubic B-spline through the tile, of unit variance."""
        from scipy.ndimage import spline_filter

        is_mirrored = self.draw < 0
        number = -1 - self.draw if is_mirrored else self.draw
        rng = stream(self.seed, number, "surface", "roughness")
        # wavenumber, in radians per correlation length
        k = 2.0 * np.pi * np.fft.fftfreq(_POINTS, 1.0 / _POINTS_PER_LENGTH)
        along = np.exp(-(k**2) / 8.0)
        gain = along[:, None] * along[None, : _POINTS // 2 + 1]
        white = np.fft.rfft2(rng.standard_normal((_POINTS, _POINTS)))
        variance = float(np.sum(along**2)) ** 2 / _POINTS**2
        tile = np.fft.irfft2(white * gain, s=(_POINTS, _POINTS)) / np.sqrt(variance)
        coefficients = np.asarray(spline_filter(tile, order=3, mode="grid-wrap"))
        return -coefficients if is_mirrored else coefficients

    def elevation_at(self, north: ArrayLike, east: ArrayLike) -> Array:
        """
        Elevation at positions, to be added to the mean depth.

        Parameters
        ----------
        north, east : array_like
            Positions, of shapes that broadcast. [m]

        Returns
        -------
        ndarray
            Positive down. [m]
        """
        from scipy.ndimage import map_coordinates

        positions = np.stack(
            np.broadcast_arrays(np.asarray(north, dtype=float), np.asarray(east, dtype=float))
        )
        shape = positions.shape[1:]
        index = positions.reshape(2, -1) * (_POINTS_PER_LENGTH / self.length)
        unit = map_coordinates(
            self._coefficients, index, order=3, mode="grid-wrap", prefilter=False
        )
        return np.asarray(self.height * np.clip(unit, -MAX_DEVIATIONS, MAX_DEVIATIONS)).reshape(
            shape
        )
