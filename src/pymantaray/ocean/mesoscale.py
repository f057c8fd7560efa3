"""Eddies that drift: how far they push isopycnals, and how much foreign water they carry."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Grid:
    """Points of a region: levels, and the horizontal grid in degrees and in local metres."""

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

    Isopycnals spread from the core depth where ``heave`` is positive (an anticyclonic lens of weakly
    stratified water) and gather there where it is negative (a cyclone).
    """

    north: float
    """Position of the centre at the epoch. [m]"""
    east: float
    """[m]"""
    drift_north: float
    """[m/s]"""
    drift_east: float
    """[m/s]"""
    radius: float
    """Of the fastest currents: the standard deviation of the Gaussian. [m]"""
    core_depth: float
    """[m]"""
    half_thickness: float
    """Distance of the largest heave from the core. [m]"""
    heave: float
    """Largest displacement; downward beneath the core. [m]"""
    foreign_fraction: float
    """Share of the eddy's own water in its core, 0 to 1. [-]"""
    from_surface: bool
    """Whether that share reaches from the core up to the surface, or fades above the core as below it."""

    def centre(self, elapsed: float, half_box: tuple[float, float]) -> tuple[float, float]:
        """
        Position after a time.

        Parameters
        ----------
        elapsed : float
            Since the epoch. [s]
        half_box : tuple of float
            Half extents (north, east) of the box; what leaves on one side returns on the other. [m]

        Returns
        -------
        north, east : float
            [m]
        """
        moved = (self.north + self.drift_north * elapsed, self.east + self.drift_east * elapsed)
        north, east = ((x + h) % (2.0 * h) - h for x, h in zip(moved, half_box, strict=True))
        return north, east


def eddy_fields(
    eddies: Sequence[Eddy], elapsed: float, grid: Grid, half_box: tuple[float, float]
) -> tuple[Array, Array]:
    """
    Displacement of the water and share of foreign water that all eddies cause together.

    Parameters
    ----------
    eddies : sequence of Eddy
    elapsed : float
        Since the epoch. [s]
    grid : Grid
    half_box : tuple of float
        See `Eddy.centre`. [m]

    Returns
    -------
    heave : ndarray, shape (depth, lat, lon)
        How far below its undisturbed depth the water lies. [m]
    fraction : ndarray, shape (depth, lat, lon)
        Share of the eddies' own water, 0 to 1. [-]
    """
    horizontal, displacement, core = [], [], []
    for eddy in eddies:
        north, east = eddy.centre(elapsed, half_box)
        squared = (grid.north - north) ** 2 + (grid.east - east) ** 2
        horizontal.append(np.exp(-0.5 * squared / eddy.radius**2))
        s = (grid.depth - eddy.core_depth) / eddy.half_thickness
        bell = np.exp(-0.5 * s**2)
        surface = 1.0 - np.exp(-((grid.depth / (0.7 * eddy.core_depth)) ** 4))  # the cap stays at rest
        displacement.append(eddy.heave * s * math.exp(0.5) * bell * surface)
        lid = eddy.from_surface & (s < 0.0)
        core.append(eddy.foreign_fraction * np.where(lid, 1.0, bell))
    heave = np.einsum("ek,eij->kij", displacement, horizontal)
    native = np.ones_like(heave)
    for profile, shape in zip(core, horizontal, strict=True):
        native *= 1.0 - profile[:, None, None] * shape
    return heave, 1.0 - native


def scattered(count: int, dimensions: int) -> Array:
    """
    Evenly scattered points of the unit cube by Roberts' additive recurrence: nobody chose them.

    Parameters
    ----------
    count, dimensions : int

    Returns
    -------
    ndarray, shape (count, dimensions)
        Between 0 and 1. [-]

    Notes
    -----
    The steps are the negative powers of the real root of ``x**(d + 1) = x + 1``.
    """
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1.0)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)
