"""Currents in geostrophic (thermal wind) balance with a density field on a geographic grid."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = 9.81  # m s-2
_ROTATION = 7.292115e-5  # rad s-1
_EARTH_RADIUS = 6_371_000.0  # m


def coriolis(lat: Array) -> Array:
    """
    Coriolis parameter.

    Parameters
    ----------
    lat : ndarray, shape (...)
        [degrees]

    Returns
    -------
    ndarray, shape (...)
        [s-1]
    """
    return np.asarray(2.0 * _ROTATION * np.sin(np.radians(lat)))


def geostrophic_currents(
    density: Array, depth: Array, lat: Array, lon: Array, reference_height: Array
) -> tuple[Array, Array]:
    """
    Currents that balance a density field, with a given pressure at the deepest level.

    Pressure is integrated hydrostatically upward from the deepest level by the trapezoidal rule; there
    its anomaly is ``density * GRAVITY * reference_height``, so that a height of zero makes the deepest
    level one of no motion, and a sloping one adds a current that is the same at all depths.

    Parameters
    ----------
    density : ndarray, shape (depth, lat, lon)
        In-situ density, without gaps. [kg/m3]
    depth : ndarray, shape (depth,)
        Positive down. [m]
    lat, lon : ndarray, shape (lat,), (lon,)
        Evenly spaced, away from the equator. [degrees]
    reference_height : ndarray, shape (lat, lon)
        Pressure at the deepest level, as a height of water. [m]

    Returns
    -------
    u, v : ndarray, shape (depth, lat, lon)
        Eastward and northward current. [m/s]

    Notes
    -----
    ``u = -(dp/dy) / (rho f)`` and ``v = (dp/dx) / (rho f)``, gradients at constant depth by central
    differences, one-sided of second order at the window's edges.
    """
    anomaly = density - density.mean(axis=(1, 2), keepdims=True)  # a level's mean has no gradient
    layers = 0.5 * (anomaly[1:] + anomaly[:-1]) * np.diff(depth)[:, None, None]
    below = np.concatenate([np.cumsum(layers[::-1], axis=0)[::-1], np.zeros_like(anomaly[:1])])
    pressure = GRAVITY * (density[-1] * reference_height - below)
    metres_north = _EARTH_RADIUS * np.radians(lat)
    dp_dy = np.gradient(pressure, metres_north, axis=1, edge_order=2)
    dp_dx = np.gradient(pressure, np.radians(lon), axis=2, edge_order=2) / (
        _EARTH_RADIUS * np.cos(np.radians(lat))[:, None]
    )
    rho_f = density * coriolis(lat)[:, None]
    return -dp_dy / rho_f, dp_dx / rho_f
