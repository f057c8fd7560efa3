"""Drifting eddies and geostrophic currents of a density field."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pymantaray.arrays import Array

GRAVITY = 9.81  # m s-2
_ROTATION = 7.292115e-5  # rad s-1
_EARTH_RADIUS = 6_371_000.0  # m


def coriolis(lat: Array) -> Array:
    """Coriolis parameter at latitudes [degrees]. [s-1]"""
    return np.asarray(2.0 * _ROTATION * np.sin(np.radians(lat)))


def geostrophic_currents(
    density: Array, depth: Array, lat: Array, lon: Array, reference_height: Array
) -> tuple[Array, Array]:
    """
    Eastward and northward currents (depth, lat, lon) [m/s] in balance with a density field of that
    shape [kg/m3].

    ``u = -(dp/dy) / (rho f)`` and ``v = (dp/dx) / (rho f)`` at constant depth, on a regular grid
    away from the equator. The trapezoidal rule integrates hydrostatic pressure upward from the
    deepest level, where the anomaly is ``density * GRAVITY * reference_height`` (lat, lon) [m].
    With zero height, there is no motion at the deepest level. A sloping height adds a current that
    is constant over depth.
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


@dataclass(frozen=True)
class Grid:
    """Grid of a region: levels, and horizontal points in degrees and in local metres."""

    depth: Array
    """Shape (depth,). [m]"""
    lat: Array
    """Shape (lat,). [degrees]"""
    lon: Array
    """Shape (lon,). [degrees]"""
    north: Array
    """Shape (lat, lon), from the region's centre. [m]"""
    east: Array
    """Shape (lat, lon), from the region's centre. [m]"""


@dataclass(frozen=True)
class Eddy:
    """
    A round vortex that drifts at constant velocity in a periodic box around its region.

    Isopycnals diverge from the core depth if ``heave`` is positive (an anticyclonic lens of weakly
    stratified water) and converge if it is negative (a cyclone).
    """

    north: float
    """Position of the centre at the epoch, relative to the centre of the region. [m]"""
    east: float
    drift_north: float
    """[m/s]"""
    drift_east: float
    radius: float
    """Radius of the fastest currents: the standard deviation of the Gaussian. [m]"""
    core_depth: float
    """[m]"""
    half_thickness: float
    """Vertical distance of the largest heave from the core. [m]"""
    heave: float
    """Largest displacement; downward below the core. [m]"""
    foreign_fraction: float
    """Fraction of eddy water in the core, 0 to 1. [-]"""
    from_surface: bool
    """
    True if this fraction is constant from the core to the surface; False if it decreases above the
    core as below.
    """

    def centre(self, elapsed: float, half_box: tuple[float, float]) -> tuple[float, float]:
        """Position [m] after a time [s] in a periodic box with these half extents."""
        moved = (self.north + self.drift_north * elapsed, self.east + self.drift_east * elapsed)
        north, east = ((x + h) % (2.0 * h) - h for x, h in zip(moved, half_box, strict=True))
        return north, east


def eddy_fields(
    eddies: Sequence[Eddy], elapsed: float, grid: Grid, half_box: tuple[float, float]
) -> tuple[Array, Array]:
    """
    Downward displacement of the water [m], and its fraction of eddy water; both (depth, lat, lon).
    """
    horizontal = []
    displacement = []
    core = []
    for eddy in eddies:
        north, east = eddy.centre(elapsed, half_box)
        squared = (grid.north - north) ** 2 + (grid.east - east) ** 2
        horizontal.append(np.exp(-0.5 * squared / eddy.radius**2))
        s = (grid.depth - eddy.core_depth) / eddy.half_thickness
        bell = np.exp(-0.5 * s**2)
        # the cap stays at rest
        surface = 1.0 - np.exp(-((grid.depth / (0.7 * eddy.core_depth)) ** 4))
        displacement.append(eddy.heave * s * math.exp(0.5) * bell * surface)
        lid = eddy.from_surface & (s < 0.0)
        core.append(eddy.foreign_fraction * np.where(lid, 1.0, bell))
    heave = np.einsum("ek,eij->kij", displacement, horizontal)
    native = np.ones_like(heave)
    for profile, shape in zip(core, horizontal, strict=True):
        native *= 1.0 - profile[:, None, None] * shape
    return heave, 1.0 - native


def scattered(count: int, dimensions: int) -> Array:
    """Evenly scattered points of the unit cube from Roberts' additive recurrence."""
    root = 2.0  # of x**(d + 1) = x + 1; its negative powers are the steps
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1.0)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)
