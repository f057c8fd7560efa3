"""The links of every place: from a transmitter there to receivers around it, and what is asked of them."""

import math
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from pymantaray.acoustics.medium import Interpolation
from pymantaray.errors import AtlasError
from pymantaray.geometry.checks import check_fields, checked_array

Array = NDArray[np.float64]
CONVENTIONS = ("transmitter", "receiver", "mean", "chord", "nominal")
"""Speeds that a travel time is multiplied with: where it was sent, where it was received, the mean of both, the harmonic mean
along the chord, and one number for all water."""
_DEPTHS = (20.0, 200.0, 800.0)
_ROOM = 1.02  # of the domain beyond the farthest receiver: rays bend sideways


@dataclass(frozen=True)
class AtlasLinks:
    """
    Geometries of links, how their rays are found, and the errors that count as safe.

    Parameters
    ----------
    pairs : tuple of tuple of float
        Depths of transmitter and receiver. By default all pairs of 20, 200 and 800 m, the transmitter above. [m]
    distances : tuple of float
        Horizontal, strictly increasing. [m]
    bearings : int
        How many directions, evenly spaced from north, clockwise.
    nominal_sound_speed : float
        What is multiplied with where nothing is measured. [m/s]
    safe : tuple of float
        Range errors that are put up with, strictly increasing. [m]
    within_db : float
        Arrivals that are weaker than the strongest of their link by no more than this are counted. [dB]
    max_surface_bounces, max_bottom_bounces : int
        Reflections that counted arrivals may have. What is ranged on has none.
    spreading_cutoff_db, tolerance, interpolation
        As `pymantaray.acoustics.find_eigenrays` and `Medium` take them. [dB], [m]

    Raises
    ------
    AtlasError
        If a depth is negative, a list is empty or does not rise, or a number is not positive.
    """

    pairs: tuple[tuple[float, float], ...] = tuple(combinations_with_replacement(_DEPTHS, 2))
    distances: tuple[float, ...] = (2_000.0, 5_000.0, 10_000.0)
    bearings: int = 4
    nominal_sound_speed: float = 1500.0
    safe: tuple[float, ...] = (1.0, 5.0, 20.0)
    within_db: float = 10.0
    max_surface_bounces: int = 0
    max_bottom_bounces: int = 0
    spreading_cutoff_db: float | None = 15.0
    tolerance: float = 1e-3
    interpolation: Interpolation = "smooth"

    def __post_init__(self) -> None:
        """Check what the ray solver does not."""
        depths = checked_array(AtlasError, "pairs", self.pairs, (None, 2))
        if depths.min() < 0.0:
            raise AtlasError(f"pairs: depth {depths.min():g} m; allowed are 0 m and more, positive down")
        for name in ("distances", "safe"):
            values = checked_array(AtlasError, name, getattr(self, name), (None,), rising=True)
            if values[0] <= 0.0:
                raise AtlasError(f"{name}: {values[0]:g} m; all must be positive")
        if self.bearings < 1:
            raise AtlasError(f"bearings: {self.bearings}; at least 1 is needed")
        check_fields(AtlasError, self, "m/s", "nominal_sound_speed", positive=True)
        check_fields(AtlasError, self, "dB", "within_db")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of pairs, distances and bearings."""
        return len(self.pairs), len(self.distances), self.bearings

    @property
    def bearings_deg(self) -> Array:
        """Directions from transmitter to receiver, clockwise from north. [degrees]"""
        return np.arange(self.bearings) * 360.0 / self.bearings

    @property
    def half_extent(self) -> float:
        """Half side of the local domain that holds all links of a place. [m]"""
        return _ROOM * self.distances[-1]

    def ends(self) -> tuple[Array, Array]:
        """Transmitters and receivers (n_links, 3) about a place; bearings change fastest, then distances, then pairs. [m]"""
        depths, distance, bearing = np.meshgrid(
            np.arange(len(self.pairs)), self.distances, np.radians(self.bearings_deg), indexing="ij"
        )
        pairs = np.array(self.pairs)[depths.ravel()]
        level = np.zeros(distance.size)
        north, east = (distance * np.cos(bearing)).ravel(), (distance * np.sin(bearing)).ravel()
        return np.stack([level, level, pairs[:, 0]], axis=-1), np.stack([north, east, pairs[:, 1]], axis=-1)

    @property
    def count(self) -> int:
        """Links of a place."""
        return math.prod(self.shape)
