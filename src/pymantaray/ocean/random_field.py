"""Gaussian random fields with a Gaussian correlation on the grid of an ocean, and how large they are over its water."""

import math

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame

Array = NDArray[np.float64]
_PER_SCALE = 4.0  # nodes in one length scale; a cubic spline then misses 0.1 % of the standard deviation
_MARGIN = 3  # nodes beyond the window
_MOST = 1500  # nodes along one axis


def random_fields(lat: Array, lon: Array, *, count: int, scale: float, rng: np.random.Generator) -> Array:
    """
    Independent fields of mean 0 and variance 1 at the points of a geographic grid.

    Parameters
    ----------
    lat, lon : ndarray, shape (n_lat,), (n_lon,)
        [degrees]
    count : int
        Number of fields.
    scale : float
        L of the correlation exp(-d²/2L²); infinite for fields that are one number each. [m]
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (count, n_lat, n_lon)

    Raises
    ------
    OceanError
        If the scale is not positive, or so short beside the window that too many nodes would be needed.

    Notes
    -----
    The correlation factors into one along north and one along east of the local frame about the window's
    middle. On a lattice of L/4 a field is F_n Z F_eᵀ with standard normal Z and F Fᵀ the correlation along an
    axis: exactly Gaussian, of the stated covariance. A cubic spline carries it to the grid's points.
    """
    if not scale > 0.0:
        raise OceanError(f"random field: horizontal_scale is {scale:g} m; it must be positive")
    if math.isinf(scale):
        return np.broadcast_to(rng.standard_normal((count, 1, 1)), (count, lat.size, lon.size)).copy()
    frame = LocalFrame(0.5 * (lat[0] + lat[-1]), 0.5 * (lon[0] + lon[-1]))
    north, east = frame.to_local(lat[:, None], lon[None, :])
    axes = [_lattice(x, scale) for x in (north, east)]
    factors = [_factor(axis, scale) for axis in axes]
    fields = np.empty((count, lat.size, lon.size))
    for field in fields:
        nodes = factors[0] @ rng.standard_normal([f.shape[1] for f in factors]) @ factors[1].T
        field[:] = RectBivariateSpline(axes[0], axes[1], nodes).ev(north, east)
    return fields


def _lattice(x: Array, scale: float) -> Array:
    step = scale / _PER_SCALE
    low, high = float(x.min()) - _MARGIN * step, float(x.max()) + _MARGIN * step
    count = math.ceil((high - low) / step) + 1
    if count > _MOST:
        raise OceanError(
            f"random field: horizontal_scale {scale:g} m needs {count} nodes across the window, {_MOST} are allowed;"
            f" take at least {scale * count / _MOST:.0f} m or a smaller window"
        )
    return np.asarray(low + step * np.arange(count), dtype=float)


def _factor(axis: Array, scale: float) -> Array:
    correlation = np.exp(-0.5 * ((axis[:, None] - axis) / scale) ** 2)
    values, vectors = np.linalg.eigh(correlation)
    kept = values > 1e-12 * values[-1]  # the rest is rounding
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


def pooled_rms(ocean: xr.Dataset, variance: Array, down_to: float | None) -> float:
    """
    Root of the mean over the water of a variance that depends on depth.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    variance : ndarray, shape (depth,)
        [m2/s2]
    down_to : float or None
        Depth down to which it is taken; None for all of the water. [m]

    Returns
    -------
    float
        Levels count by the thickness of their layers and their wet points. [m/s]

    Raises
    ------
    OceanError
        If it is zero.
    """
    z = np.asarray(ocean["depth"].values, dtype=float)
    edges = np.concatenate([z[:1], 0.5 * (z[:-1] + z[1:]), z[-1:]])
    if down_to is not None:
        edges = np.minimum(edges, down_to)
    weight = np.diff(edges) * np.isfinite(ocean["water_temp"].values).sum(axis=(1, 2))
    pooled = float(np.sqrt(np.sum(weight * variance) / np.sum(weight)))
    if not pooled > 0.0:
        raise OceanError(
            "perturbation: nothing varies where rms is pooled; take other modes, spread or down_to"
        )
    return pooled
