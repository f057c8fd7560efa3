"""
Links of every column: from a transmitter at the column to receivers around it, with search options.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement

import numpy as np

from pymantaray.acoustics.medium import Interpolation
from pymantaray.arrays import Array
from pymantaray.errors import AtlasError
from pymantaray.quantities.checks import check_fields, checked_array

CONVENTIONS = ("transmitter", "receiver", "mean", "chord", "nominal")
"""
Sound speeds that convert a travel time to a range: at the transmitter, at the receiver, the mean of
both, the harmonic mean along the chord, and one nominal value.
"""
_DEPTHS = (20.0, 200.0, 800.0)
# half extent of the domain over the greatest distance, because rays also bend sideways
_MARGIN = 1.02


@dataclass(frozen=True)
class AtlasLinks:
    """
    Geometry of links, options of the ray solver, and error thresholds.

    Parameters
    ----------
    pairs : tuple of tuple of float
        Depths of transmitter and receiver. Default: all pairs of 20, 200 and 800 m with the
        transmitter above. [m]
    distances : tuple of float
        Horizontal distances, strictly increasing. [m]
    bearings : int
        Number of directions, evenly spaced clockwise from north.
    nominal_sound_speed : float
        Sound speed of the convention "nominal". [m/s]
    safe : tuple of float
        Error thresholds in ascending order. [m]
    within_db : float
        Arrivals count if their level is at most this much below the strongest arrival of their
        link. [dB]
    max_surface_bounces, max_bottom_bounces : int
        Maximum numbers of reflections of counted arrivals. Ranges use direct arrivals only.
    spreading_cutoff_db, tolerance, interpolation
        As in `pymantaray.acoustics.find_eigenrays` and `Medium`. [dB], [m]

    Raises
    ------
    AtlasError
        If a depth is negative, a list is empty or does not increase, or a number is not positive.

    Examples
    --------
    >>> from pymantaray.apps.atlas import AtlasLinks
    >>> AtlasLinks(pairs=((20.0, 800.0),), distances=(1000.0, 3000.0), bearings=8).distances
    (1000.0, 3000.0)
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
        """Check values that the ray solver does not check."""
        depths = checked_array(AtlasError, "pairs", self.pairs, (None, 2))
        if depths.min() < 0.0:
            raise AtlasError(
                f"pairs: depth is {depths.min():g} m; it must be 0 m or more, positive down"
            )
        for name in ("distances", "safe"):
            values = checked_array(AtlasError, name, getattr(self, name), (None,), rising=True)
            if values[0] <= 0.0:
                raise AtlasError(
                    f"{name}: {values[0]:g} m is not positive; all values must be positive"
                )
        if self.bearings < 1:
            raise AtlasError(f"bearings is {self.bearings}; it must be at least 1")
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
        """Half side of the local domain that contains all links of a column. [m]"""
        return _MARGIN * self.distances[-1]

    def ends(self) -> tuple[Array, Array]:
        """
        Transmitters and receivers (n_links, 3) around a column; bearings vary fastest, then
        distances, then pairs. [m]
        """
        return _ends(self)

    @property
    def count(self) -> int:
        """Number of links of a column."""
        return math.prod(self.shape)


@lru_cache(maxsize=4)
def _ends(links: AtlasLinks) -> tuple[Array, Array]:
    """Read-only ends, which every column of an atlas shares. [m]"""
    depths, distance, bearing = np.meshgrid(
        np.arange(len(links.pairs)), links.distances, np.radians(links.bearings_deg), indexing="ij"
    )
    pairs = np.array(links.pairs)[depths.ravel()]
    level = np.zeros(distance.size)
    north = (distance * np.cos(bearing)).ravel()
    east = (distance * np.sin(bearing)).ravel()
    ends = (
        np.stack([level, level, pairs[:, 0]], axis=-1),
        np.stack([north, east, pairs[:, 1]], axis=-1),
    )
    for end in ends:
        end.setflags(write=False)
    return ends
