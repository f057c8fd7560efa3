"""The window that is asked for, and where it lies on a server's axes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.geometry.longitude import whole_turns, wrapped

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
LARGEST_VALUES = 20_000_000
"""Of one variable of a window."""
_SAME_DEGREES = 1e-4  # HYCOM's coordinates are off the exact grid by 3e-5
_WIDEST = 180.0  # degrees; more is a west and an east exchanged


@dataclass(frozen=True)
class Region:
    """Latitudes and longitudes, from ``west``, which lies in -180 to 180, eastwards over ``width`` degrees."""

    south: float
    north: float
    west: float
    width: float

    @classmethod
    def of(cls, lat: Sequence[float], lon: Sequence[float]) -> Self:
        """Region of two latitudes in either order, and of west and east in any convention. [degrees]"""
        for name, pair, reach in (("lat", lat, 90.0), ("lon", lon, 360.0)):
            where = f"fetch: {name} is {','.join(f'{x:g}' for x in pair)};"
            if len(pair) != 2 or not all(abs(x) <= reach for x in pair):
                raise OceanError(f"{where} needs two numbers from {-reach:g} to {reach:g}")
            if pair[0] == pair[1]:
                raise OceanError(f"{where} the window is empty")
        width = (lon[1] - lon[0]) % 360.0
        if not 0.0 < width <= _WIDEST:
            raise OceanError(
                f"{where} it goes {width or 360.0:g} degrees eastwards; allowed are {_WIDEST:g}; write west,east"
            )
        return cls(min(lat), max(lat), wrapped(lon[0]), width)

    @property
    def text(self) -> str:
        """South to north and west to east, for messages."""
        east = wrapped(self.west + self.width)
        return f"lat {self.south:g} to {self.north:g}, lon {self.west:g} to {east:g}"

    def latitudes(self, axis: Array) -> Indices:
        """Where the region lies on a rising axis: what is inside, and one point beyond each side."""
        if axis.size < 2 or not np.all(np.diff(axis) > 0.0):
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
        Where the region lies on an axis of any convention and order, from west to east across any seam.

        What is inside, and one point beyond each side; then these longitudes, rising, their middle in -180 to 180.
        """
        # degrees east of the western side; a hair beyond it counts as on it
        east = (axis - self.west + _SAME_DEGREES) % 360.0 - _SAME_DEGREES
        order = np.argsort(east, kind="stable")
        east = east[order]
        if axis.size < 2 or not np.all(np.diff(east) > 0.0):
            raise OceanError("longitudes of the server repeat or are not numbers")
        n = int(np.searchsorted(east, self.width - _SAME_DEGREES, side="left")) + 1
        indices, reached = order[:n], east[:n]
        if reached[0] > _SAME_DEGREES:  # the point before the western side, the long way round
            indices = np.concatenate([order[-1:], indices])
            reached = np.concatenate([east[-1:] - 360.0, reached])
        covered = reached[0] <= _SAME_DEGREES and reached[-1] >= self.width - _SAME_DEGREES
        holes = np.any(np.diff(reached) > 1.5 * np.median(np.diff(east)))
        if not covered or holes or len(set(indices.tolist())) != len(indices):
            raise OceanError(
                f"data cover longitude {axis.min():g} to {axis.max():g}; {self.west:g} to"
                f" {self.west + self.width:g} were asked for"
            )
        lon = axis[indices]
        lon = lon + 360.0 * np.round((self.west + reached - lon) / 360.0)
        return indices, lon - whole_turns(0.5 * (lon[0] + lon[-1]))


def runs(indices: Indices) -> list[tuple[int, int]]:
    """Indices as first and last, both inclusive, of runs that rise by one."""
    cuts = np.flatnonzero(np.diff(indices) != 1) + 1
    return [(int(part[0]), int(part[-1])) for part in np.split(indices, cuts)]
