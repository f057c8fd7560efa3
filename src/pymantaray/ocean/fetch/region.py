"""The window that is asked for, and where it lies on a server's axes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
LARGEST_VALUES = 20_000_000  # of one variable of a window
_SAME_DEGREES = 1e-4  # HYCOM's coordinates are off the exact grid by 3e-5
_WIDEST = 180.0  # degrees; more is a west and an east exchanged


@dataclass(frozen=True)
class Region:
    """
    Latitudes and longitudes, from ``west`` eastwards over ``width`` degrees.

    ``west`` lies in -180 to 180.
    """

    south: float
    north: float
    west: float
    width: float

    @classmethod
    def of(cls, lat: Sequence[float], lon: Sequence[float]) -> Self:
        """
        Make a region of two latitudes and two longitudes.

        Parameters
        ----------
        lat : sequence of float
            South and north, in either order. [degrees]
        lon : sequence of float
            West and east in any convention; ``(170, -170)`` crosses the antimeridian. [degrees]

        Returns
        -------
        Region

        Raises
        ------
        OceanError
            If it is empty, not on the globe or wider than 180 degrees.
        """
        for name, pair, reach in (("lat", lat, 90.0), ("lon", lon, 360.0)):
            if len(pair) != 2 or not all(math.isfinite(x) and abs(x) <= reach for x in pair):
                raise OceanError(
                    f"fetch: {name} is {_pair(pair)}; needs two numbers from {-reach:g} to {reach:g}"
                )
            if pair[0] == pair[1]:
                raise OceanError(f"fetch: {name} is {_pair(pair)}; the window is empty")
        width = (lon[1] - lon[0]) % 360.0
        if not 0.0 < width <= _WIDEST:
            raise OceanError(
                f"fetch: lon {_pair(lon)} goes {width or 360.0:g} degrees eastwards; allowed are {_WIDEST:g};"
                " write west,east"
            )
        return cls(min(lat), max(lat), (lon[0] + 180.0) % 360.0 - 180.0, width)

    @property
    def text(self) -> str:
        """South to north and west to east, for messages."""
        return (
            f"lat {self.south:g} to {self.north:g}, lon {self.west:g} to"
            f" {(self.west + self.width + 180.0) % 360.0 - 180.0:g}"
        )

    def latitudes(self, axis: Array) -> Indices:
        """
        Where the region lies on an axis of latitudes: what is inside, and one point beyond each side.

        Parameters
        ----------
        axis : ndarray, shape (lat,)
            Rising. [degrees]

        Returns
        -------
        ndarray of int
            Rising.

        Raises
        ------
        OceanError
            If the axis does not rise or does not cover the region.
        """
        if axis.size < 2 or not np.all(np.isfinite(axis)) or not np.all(np.diff(axis) > 0.0):
            raise OceanError("latitudes of the server do not rise strictly")
        if self.south < axis[0] - _SAME_DEGREES or self.north > axis[-1] + _SAME_DEGREES:
            raise OceanError(
                f"data cover latitude {axis[0]:g} to {axis[-1]:g}; {self.south:g} to {self.north:g} were asked for"
            )
        first = max(int(np.searchsorted(axis, self.south + _SAME_DEGREES, side="right")) - 1, 0)
        last = min(int(np.searchsorted(axis, self.north - _SAME_DEGREES, side="left")), axis.size - 1)
        return np.arange(first, last + 1)

    def longitudes(self, axis: Array) -> tuple[Indices, Array]:
        """
        Where the region lies on an axis of longitudes, from west to east across any seam.

        Parameters
        ----------
        axis : ndarray, shape (lon,)
            In any convention and order, less than a circle. [degrees]

        Returns
        -------
        indices : ndarray of int
            What is inside, and one point beyond each side.
        lon : ndarray
            Rising; their middle lies in -180 to 180. [degrees]

        Raises
        ------
        OceanError
            If the axis does not cover the region.
        """
        if axis.size < 2 or not np.all(np.isfinite(axis)):
            raise OceanError("longitudes of the server are not numbers")
        # degrees east of the western side; a hair beyond it counts as on it
        east = (axis - self.west + _SAME_DEGREES) % 360.0 - _SAME_DEGREES
        order = np.argsort(east, kind="stable")
        east = east[order]
        step = float(np.median(np.diff(east)))
        if not np.all(np.diff(east) > 0.0):
            raise OceanError("longitudes of the server repeat")
        n = int(np.searchsorted(east, self.width - _SAME_DEGREES, side="left")) + 1
        indices, reached = order[:n], east[:n]
        if reached[0] > _SAME_DEGREES:  # the point before the western side, the long way round
            indices = np.concatenate([order[-1:], indices])
            reached = np.concatenate([east[-1:] - 360.0, reached])
        gaps = np.diff(reached)
        covered = reached[0] <= _SAME_DEGREES and reached[-1] >= self.width - _SAME_DEGREES
        if not covered or np.any(gaps > 1.5 * step) or len(set(indices.tolist())) != len(indices):
            raise OceanError(
                f"data cover longitude {axis.min():g} to {axis.max():g}; {self.west:g} to"
                f" {self.west + self.width:g} were asked for"
            )
        lon = axis[indices]
        lon = lon + 360.0 * np.round((self.west + reached - lon) / 360.0)
        middle = 0.5 * (lon[0] + lon[-1])
        return indices, lon - 360.0 * math.floor((middle + 180.0) / 360.0)

    def boxes(self, seam: float, margin: float) -> list[tuple[float, float]]:
        """
        Widen the region and cut it at a server's seam.

        Parameters
        ----------
        seam : float
            Where the server's longitudes begin; they end 360 degrees further. [degrees]
        margin : float
            Added on either side. [degrees]

        Returns
        -------
        list of (west, east)
            One or two, in the server's convention. [degrees]
        """
        west = seam + (self.west - margin - seam) % 360.0
        east = west + self.width + 2.0 * margin
        if east <= seam + 360.0:
            return [(west, east)]
        return [(west, seam + 360.0), (seam, east - 360.0)]


def runs(indices: Indices) -> list[tuple[int, int]]:
    """
    Cut indices into runs that rise by one.

    Parameters
    ----------
    indices : ndarray of int

    Returns
    -------
    list of (first, last)
        Both inclusive.

    Examples
    --------
    >>> runs(np.array([4498, 4499, 0, 1, 2]))
    [(4498, 4499), (0, 2)]
    """
    cuts = np.flatnonzero(np.diff(indices) != 1) + 1
    return [(int(part[0]), int(part[-1])) for part in np.split(indices, cuts)]


def _pair(pair: Sequence[float]) -> str:
    return ",".join(f"{x:g}" for x in pair)
