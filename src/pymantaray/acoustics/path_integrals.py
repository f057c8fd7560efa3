"""Integrals along rays: of any function of place, and the sensitivity of travel time to sound speed."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import AcousticsError
from pymantaray.records import RayPaths

Array = NDArray[np.float64]
_GAUSS_NODES, _GAUSS_WEIGHTS = (
    0.5 * (v + shift) for v, shift in zip(np.polynomial.legendre.leggauss(4), (1.0, 0.0), strict=True)
)


class Quadrature(NamedTuple):
    """Points along rays with weights that integrate over arc length."""

    arrival: NDArray[np.int64]
    position: Array
    slowness: Array
    weight: Array


def quadrature(paths: RayPaths) -> Quadrature:
    """
    Gauss-Legendre points on every segment of paths.

    Parameters
    ----------
    paths : RayPaths

    Returns
    -------
    Quadrature
        ``arrival`` (n,), ``position`` (n, 3) [m], ``slowness`` (n, 3), along the ray [s m⁻¹], and ``weight`` (n,), the arc
        length that each point stands for [m].

    Notes
    -----
    Between nodes a path is a cubic Hermite polynomial in travel time; four points a segment.
    """
    first = np.flatnonzero((np.diff(paths.arrival) == 0) & (np.diff(paths.travel_time) > 0.0))
    a, b = first, first + 1
    h = (paths.travel_time[b] - paths.travel_time[a])[:, None, None]
    t = _GAUSS_NODES[None, :, None]
    x0, x1 = paths.position[a, None], paths.position[b, None]
    v0, v1 = (
        p / np.sum(p * p, axis=-1, keepdims=True) for p in (paths.slowness[a, None], paths.slowness[b, None])
    )
    position = _hermite(t, h, x0, v0, x1, v1)
    velocity = (
        (6.0 * t**2 - 6.0 * t) * (x0 - x1) / h
        + (1.0 - 4.0 * t + 3.0 * t**2) * v0
        + (3.0 * t**2 - 2.0 * t) * v1
    )
    speed = np.linalg.norm(velocity, axis=-1)
    weight = speed * h[..., 0] * _GAUSS_WEIGHTS
    n = t.shape[1]
    return Quadrature(
        np.repeat(paths.arrival[a], n),
        position.reshape(-1, 3),
        (velocity / speed[..., None] ** 2).reshape(-1, 3),
        weight.reshape(-1),
    )


def resample(paths: RayPaths, n_points: int) -> Array:
    """
    Positions at equal steps of travel time along every ray.

    Parameters
    ----------
    paths : RayPaths
    n_points : int
        At least 2, for each ray.

    Returns
    -------
    ndarray, shape (n_rays, n_points, 3)
        [m]
    """
    starts = np.flatnonzero(np.diff(paths.arrival, prepend=-1))
    out = np.empty((starts.size, n_points, 3))
    for i, nodes in enumerate(np.split(np.arange(paths.arrival.size), starts[1:])):
        nodes = nodes[np.append(np.diff(paths.travel_time[nodes]) > 0.0, True)]  # of a reflection the second
        if nodes.size < 2:
            out[i] = paths.position[nodes[0]]
            continue
        times = np.linspace(paths.travel_time[nodes[0]], paths.travel_time[nodes[-1]], n_points)
        k = np.clip(np.searchsorted(paths.travel_time[nodes], times, side="right") - 1, 0, nodes.size - 2)
        a, b = nodes[k], nodes[k] + 1  # the next node, before a reflection
        h = (paths.travel_time[b] - paths.travel_time[a])[:, None]
        t = (times - paths.travel_time[a])[:, None] / h
        v0, v1 = (p / np.sum(p * p, axis=-1, keepdims=True) for p in (paths.slowness[a], paths.slowness[b]))
        out[i] = _hermite(t, h, paths.position[a], v0, paths.position[b], v1)
    return out


def path_integrals(paths: RayPaths, integrand: Callable[[Array], Array]) -> Array:
    """
    Integral over arc length of functions of place, along every ray.

    Parameters
    ----------
    paths : RayPaths
    integrand : callable
        Takes positions (n, 3) [m], gives values (n,) or (n, k).

    Returns
    -------
    ndarray, shape (n_rays, k)
        [unit of the integrand times m]

    Raises
    ------
    AcousticsError
        If the integrand gives another number of values than it got positions.
    """
    points = quadrature(paths)
    return _gather(paths, points, _values(integrand, points.position) * points.weight[:, None])


def travel_time_sensitivity(paths: RayPaths, basis: Callable[[Array], Array]) -> Array:
    r"""
    Change of travel time by a small change of the sound speed, to first order.

    Parameters
    ----------
    paths : RayPaths
    basis : callable
        Shapes of the change of sound speed: takes positions (n, 3) [m], gives values (n,) or (n, k).

    Returns
    -------
    ndarray, shape (n_rays, k)
        Derivative of the travel time by the amplitude of each shape. [s per unit of amplitude in m s⁻¹]

    Raises
    ------
    AcousticsError
        As `path_integrals`.

    Notes
    -----
    For :math:`c + \epsilon \phi`, :math:`\partial t / \partial \epsilon = -\int \phi / c^2 \, ds` along the
    unperturbed ray: by Fermat's principle the ray's displacement has no first-order effect.
    """
    points = quadrature(paths)
    squared = np.sum(points.slowness**2, axis=-1)
    return -_gather(paths, points, _values(basis, points.position) * (points.weight * squared)[:, None])


def _hermite(t: Array, h: Array, x0: Array, v0: Array, x1: Array, v1: Array) -> Array:
    """Cubic Hermite polynomial at the fraction t of a segment that takes h, from places and velocities at its ends."""
    return np.asarray(
        (1.0 - 3.0 * t**2 + 2.0 * t**3) * x0
        + (t - 2.0 * t**2 + t**3) * h * v0
        + (3.0 * t**2 - 2.0 * t**3) * x1
        + (t**3 - t**2) * h * v1
    )


def _values(function: Callable[[Array], Array], position: Array) -> Array:
    values = np.asarray(function(position), dtype=float)
    if values.shape[:1] != position.shape[:1] or values.ndim > 2:
        raise AcousticsError(
            f"integrand gave shape {values.shape} for positions {position.shape}; needs ({position.shape[0]}, k)"
        )
    return values if values.ndim == 2 else values[:, None]


def _gather(paths: RayPaths, points: Quadrature, values: Array) -> Array:
    n_rays = int(paths.arrival[-1]) + 1 if paths.arrival.size else 0
    total = np.zeros((n_rays, values.shape[1]))
    np.add.at(total, points.arrival, values)
    return total
