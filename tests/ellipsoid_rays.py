"""
Independent travel times on the ellipsoid: Hamiltonian rays in geocentric coordinates.

The sound speed depends on the depth below the WGS 84 ellipsoid. Nothing here uses the package.
"""

import numpy as np
import pyproj

_TO_GEODETIC = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
_TO_ECEF = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
_STEPS = 120  # of a ray; the error of the fourth order is below 1 ns for smooth profiles
_ITERATIONS = 8


def ecef(lat, lon, depth):
    """Geocentric positions (n, 3) of points below the ellipsoid. [m]"""
    return np.stack(_TO_ECEF.transform(lon, lat, -np.asarray(depth)), axis=-1)


def east_north_up(point, lat, lon):
    """East, north and up (n, 3) of geocentric points in the tangent plane of an origin. [m]"""
    phi, lam = np.radians([lat, lon])
    axes = [
        [-np.sin(lam), np.cos(lam), 0.0],
        [-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)],
        [np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)],
    ]
    return (point - ecef(lat, lon, 0.0)) @ np.array(axes).T


def from_east_north_up(enu, lat, lon):
    """Geocentric points (n, 3) of east, north and up. [m]"""
    basis = east_north_up(ecef(lat, lon, 0.0) + np.eye(3), lat, lon)
    return ecef(lat, lon, 0.0) + np.asarray(enu) @ basis.T


def deep_water(depth):
    """Sound speed of a canonical profile, and its derivative. [m/s, 1/s]"""
    eta = 2.0 * (np.asarray(depth) - 1000.0) / 1000.0
    speed = 1490.0 * (1.0 + 0.0074 * (eta + np.exp(-eta) - 1.0))
    return speed, 1490.0 * 0.0074 * 2e-3 * (1.0 - np.exp(-eta))


def _rates(position, slowness, profile):
    """Derivatives of position and slowness by travel time."""
    lon, lat, height = _TO_GEODETIC.transform(*position.T)
    phi, lam = np.radians(lat), np.radians(lon)
    up = np.stack([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)], axis=-1)
    speed, by_depth = profile(-height)
    return (speed**2)[:, None] * slowness, (by_depth / speed)[:, None] * up


def _end(start, slowness, time, profile):
    """Ends of rays after a time, and their final slownesses (Runge-Kutta of fourth order)."""
    position = start.copy()
    slowness = slowness.copy()
    step = (time / _STEPS)[:, None]
    for _ in range(_STEPS):
        a = _rates(position, slowness, profile)
        b = _rates(position + 0.5 * step * a[0], slowness + 0.5 * step * a[1], profile)
        c = _rates(position + 0.5 * step * b[0], slowness + 0.5 * step * b[1], profile)
        d = _rates(position + step * c[0], slowness + step * c[1], profile)
        position = position + step / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
        slowness = slowness + step / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
    return position, slowness


def travel_times(source, receiver, profile=deep_water):
    """Travel times of the direct rays between geocentric points (n, 3). [s]"""
    *_, height = _TO_GEODETIC.transform(*source.T)
    speed = profile(-height)[0]
    chord = receiver - source
    length = np.linalg.norm(chord, axis=1)
    direction = chord / length[:, None]
    time = length / 1500.0
    for _ in range(_ITERATIONS):
        first = np.cross(direction, np.array([0.31, 0.83, 0.46]))
        first /= np.linalg.norm(first, axis=1)[:, None]
        second = np.cross(direction, first)
        end, slowness = _end(source, direction / speed[:, None], time, profile)
        miss = receiver - end
        if np.linalg.norm(miss, axis=1).max() < 1e-7:
            break
        tilt = 1e-5
        columns = [
            (_end(source, (direction + tilt * axis) / speed[:, None], time, profile)[0] - end)
            / tilt
            for axis in (first, second)
        ]
        velocity = slowness / np.sum(slowness**2, axis=1)[:, None]
        change = np.linalg.solve(np.stack([*columns, velocity], axis=-1), miss[:, :, None])[..., 0]
        direction = direction + change[:, :1] * first + change[:, 1:2] * second
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        time = time + change[:, 2]
    assert np.linalg.norm(miss, axis=1).max() < 1e-4
    return time
