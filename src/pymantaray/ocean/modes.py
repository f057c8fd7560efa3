"""
Vertical modes of sound speed in an ocean's columns or in casts, and the covariance of an error in
these modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.geometry.grid import linear_interpolator
from pymantaray.ocean.cast import Cast, notes_of_casts
from pymantaray.ocean.names import Equation
from pymantaray.ocean.schema import layer_edges, validate_ocean
from pymantaray.ocean.seawater import sound_speed

_MIN_COLUMNS = 0.5  # fraction of the wet columns that must reach the deepest level of the modes


@dataclass(frozen=True, eq=False)
class SoundSpeedCovariance:
    """
    Covariance C(z, z') exp(-d²/2L²) of a sound-speed error between two places.

    C is a symmetric ``matrix`` (n_levels, n_levels) [m²/s²] at the levels ``depth`` [m]. It is
    bilinear between levels and constant beyond them. L is the ``horizontal_scale`` [m].

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import vertical_modes
    >>> covariance = vertical_modes(ocean).covariance(horizontal_scale=20e3)
    >>> place = np.array([0.0, 0.0, 100.0])
    >>> print((covariance(place, place + [20e3, 0.0, 0.0]) / covariance(place, place)).round(3))
    [0.607]
    """

    depth: Array
    matrix: Array
    horizontal_scale: float

    def __post_init__(self) -> None:
        """Check."""
        n = np.size(self.depth)
        if self.matrix.shape != (n, n) or not np.allclose(
            self.matrix, self.matrix.T, rtol=0, atol=1e-12
        ):
            raise OceanError(
                f"covariance: shape is {self.matrix.shape} for {n} levels; it must be symmetric,"
                f" ({n}, {n})"
            )
        if not self.horizontal_scale > 0.0:
            raise OceanError(
                f"covariance: horizontal_scale is {self.horizontal_scale:g} m; it must be positive"
            )

    def __call__(self, a: ArrayLike, b: ArrayLike) -> Array:
        """
        Covariance (...) between places (..., 3), north, east, down in one local frame [m]. They
        broadcast. [m²/s²]
        """
        p, q = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
        apart = np.sum(((p[..., :2] - q[..., :2]) / self.horizontal_scale) ** 2, axis=-1)
        down = np.stack([p[..., 2], q[..., 2]], axis=-1)
        vertical = linear_interpolator((self.depth, self.depth), self.matrix)(down)
        return np.asarray(vertical * np.exp(-0.5 * apart))


def layer_weights(depth: ArrayLike) -> Array:
    """
    Fractions of the water column that levels represent.

    Parameters
    ----------
    depth : array_like, shape (n,)
        Strictly increasing levels. Each represents the layer half-way to its neighbours. [m]

    Returns
    -------
    ndarray, shape (n,)
        Their sum is 1. [-]

    Examples
    --------
    >>> from pymantaray.ocean import layer_weights
    >>> print(layer_weights([0.0, 50.0, 200.0]))
    [0.125 0.5   0.375]
    """
    z = np.asarray(depth, dtype=float)
    return np.asarray(np.diff(layer_edges(z)) / (z[-1] - z[0]))


def _weighted_eigen(matrix: Array, weights: Array) -> tuple[Array, Array]:
    """
    Principal axes of a covariance with weighted levels: variances in descending order, and modes.

    Modes are rows. They are orthonormal under the weights (sum 1) and positive at their maximum.
    """
    root = np.sqrt(weights)
    values, vectors = np.linalg.eigh(root[:, None] * matrix * root)
    values = np.maximum(values[::-1], 0.0)
    modes = (vectors[:, ::-1] / root[:, None]).T
    largest = np.take_along_axis(modes, np.abs(modes).argmax(axis=1)[:, None], axis=1)
    return values, np.ascontiguousarray(modes * np.where(largest < 0.0, -1.0, 1.0))


@dataclass(frozen=True, eq=False)
class VerticalModes:
    """
    Vertical modes of sound speed and their variances.

    Attributes
    ----------
    depth : ndarray, shape (n_levels,)
        Levels. [m]
    mean : ndarray, shape (n_levels,)
        Mean sound speed. [m/s]
    modes : ndarray, shape (n_modes, n_levels)
        Modes, orthonormal under `layer_weights`: the mean over the water column of the product of
        two modes is 1 or
        0. [-]
    variance : ndarray, shape (n_modes,)
        Variances of the amplitudes in descending order. [m²/s²]
    total_variance : float
        Mean variance over the water column, including omitted modes. [m²/s²]
    notes : tuple of str
        Notes of the reader of the casts.
    """

    depth: Array
    mean: Array
    modes: Array
    variance: Array
    total_variance: float
    notes: tuple[str, ...] = ()

    def at(self, depth: ArrayLike) -> Array:
        """
        Interpolate the modes linearly to other depths; they are constant beyond the levels.

        Parameters
        ----------
        depth : array_like, shape (...)
            [m]

        Returns
        -------
        ndarray, shape (n_modes, ...)
            [-]
        """
        z = np.asarray(depth, dtype=float)
        return np.stack([np.interp(z, self.depth, mode) for mode in self.modes])

    def covariance(self, horizontal_scale: float) -> SoundSpeedCovariance:
        """
        Covariance of a sound-speed error in these modes.

        Parameters
        ----------
        horizontal_scale : float
            Scale of the Gaussian correlation of the amplitudes; infinite for a horizontally uniform
            error. [m]

        Returns
        -------
        SoundSpeedCovariance
        """
        matrix = np.einsum("k,ki,kj->ij", self.variance, self.modes, self.modes)
        return SoundSpeedCovariance(self.depth, matrix, horizontal_scale)


def vertical_modes(
    columns: xr.Dataset | Sequence[Cast],
    *,
    n_modes: int | None = None,
    levels: ArrayLike | None = None,
    equation: Equation = "teos-10",
) -> VerticalModes:
    """
    Empirical orthogonal functions of sound speed from an ocean's columns or from casts.

    Parameters
    ----------
    columns : xarray.Dataset or sequence of Cast
        A valid ocean, whose wet columns have equal weights, or at least two casts.
    n_modes : int, optional
        Number of modes. Default: enough for 99.99 % of the variance.
    levels : array_like, shape (n_levels,), optional
        For casts only: levels for averaging, within the samples of all casts. Default: every 5 m
        between the deepest first and the shallowest last sample. [m]
    equation : str
        Equation of sound speed.

    Returns
    -------
    VerticalModes
        For an ocean, on its levels down to the deepest level that half of its columns reach;
        shallower columns are excluded. Each mode is positive at its maximum.

    Raises
    ------
    OceanError
        If there are fewer than two columns, all columns are equal, or a level is outside the
        samples of a cast.

    Notes
    -----
    The modes are eigenvectors of the covariance of the columns. Each level is weighted by the layer
    that it represents, so the sum of variances is the mean square anomaly over the water column for
    any spacing of levels.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import vertical_modes
    >>> modes = vertical_modes(ocean, n_modes=2)
    >>> modes.modes.shape, float((modes.variance.sum() / modes.total_variance).round(3))
    ((2, 38), 1.0)
    """
    depth, speed = (
        _ocean_columns(columns, equation)
        if isinstance(columns, xr.Dataset)
        else _cast_columns(columns, levels, equation)
    )
    if len(speed) < 2:
        raise OceanError(
            f"modes: {len(speed)} column(s) down to {depth[-1]:g} m; at least 2 are required"
        )
    mean = speed.mean(axis=0)
    anomaly = speed - mean
    matrix = anomaly.T @ anomaly / (len(speed) - (0 if isinstance(columns, xr.Dataset) else 1))
    variance, modes = _weighted_eigen(matrix, layer_weights(depth))
    total = float(variance.sum())
    if not total > 1e-12:
        raise OceanError("modes: all columns are equal; use an ocean that varies, or several casts")
    share = 1 + int(np.searchsorted(np.cumsum(variance), 0.9999 * total))
    rank = int(np.count_nonzero(variance > 1e-12 * total))
    count = min(share if n_modes is None else n_modes, rank)
    if count < 1:
        raise OceanError(f"modes: n_modes is {n_modes}; it must be at least 1")
    notes = () if isinstance(columns, xr.Dataset) else notes_of_casts(columns)
    return VerticalModes(depth, mean, modes[:count], variance[:count], total, notes)


def _ocean_columns(ocean: xr.Dataset, equation: Equation) -> tuple[Array, Array]:
    validate_ocean(ocean)
    depth, lat, lon = (np.asarray(ocean[n].values, dtype=float) for n in ("depth", "lat", "lon"))
    wet = np.isfinite(ocean["water_temp"].values)
    reach = wet.sum(axis=(1, 2)) >= _MIN_COLUMNS * wet[0].sum()
    used = max(int(np.count_nonzero(reach)), 2)
    rows, cols = np.nonzero(wet[used - 1])
    speed = sound_speed(
        ocean["water_temp"].values[:used, rows, cols],
        ocean["salinity"].values[:used, rows, cols],
        depth[:used, None],
        lat[rows],
        lon[cols],
        equation=equation,
    )
    return depth[:used], speed.T


def _cast_columns(
    casts: Sequence[Cast], levels: ArrayLike | None, equation: Equation
) -> tuple[Array, Array]:
    if not casts:
        raise OceanError("modes: no cast; give at least 2")
    first = max(c.depth[0] for c in casts)
    last = min(c.depth[-1] for c in casts)
    every_5_m = np.arange(5.0 * np.ceil(first / 5.0), last + 1e-9, 5.0)
    z = every_5_m if levels is None else np.asarray(levels, dtype=float)
    if z.size < 2 or z[0] < first or z[-1] > last:
        raise OceanError(
            f"modes: levels must be within the samples of all casts, {first:g} to {last:g} m"
        )
    speed = [sound_speed(*c.cell_means(z), z, c.lat, c.lon, equation=equation) for c in casts]
    return z, np.array(speed)
