"""Requested window and its position on a server's axes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.geometry.longitude import wrap_longitude
from pymantaray.ocean.window import GeographicWindow, Selection, select

MAX_VALUES = 20_000_000
"""Maximum number of values of one variable in a window."""
_SIDE_TOLERANCE = 1.1e-4  # degrees; HYCOM's coordinates deviate from the exact grid by 3e-5
_MAX_WIDTH = 180.0  # degrees; a greater width means exchanged west and east


@dataclass(frozen=True)
class Region:
    """Latitudes, and longitudes from ``west`` in -180 to 180 eastwards over ``width`` degrees."""

    south: float
    north: float
    west: float
    width: float

    @classmethod
    def of(cls, lat: Sequence[float], lon: Sequence[float]) -> Self:
        """Region from two latitudes in any order, and west and east in any convention. [degrees]"""
        for name, pair, reach in (("lat", lat, 90.0), ("lon", lon, 360.0)):
            where = f"fetch: {name} is {','.join(f'{x:g}' for x in pair)};"
            if len(pair) != 2 or not all(abs(x) <= reach for x in pair):
                raise OceanError(f"{where} it must be two numbers from {-reach:g} to {reach:g}")
            if pair[0] == pair[1]:
                raise OceanError(f"{where} the window is empty")
        width = (lon[1] - lon[0]) % 360.0
        if not 0.0 < width <= _MAX_WIDTH:
            raise OceanError(
                f"{where} it spans {width or 360.0:g} degrees eastwards; the limit is"
                f" {_MAX_WIDTH:g}; write west,east"
            )
        return cls(min(lat), max(lat), wrap_longitude(lon[0]), width)

    @property
    def text(self) -> str:
        """South to north and west to east for messages."""
        east = wrap_longitude(self.west + self.width)
        return f"lat {self.south:g} to {self.north:g}, lon {self.west:g} to {east:g}"

    @property
    def window(self) -> GeographicWindow:
        """South, north, west and east, which may be greater than 180. [degrees]"""
        return self.south, self.north, self.west, self.west + self.width

    def of_grid(self, lat: Array, lon: Array, where: str) -> Selection:
        """Select the points of a server's grid that enclose the region."""
        grid = select(lat, lon, self.window, where, enclose=True)
        # distance of the region's side from the grid's side
        west = wrap_longitude(self.west - grid.lon[0])
        sides = (
            self.south - grid.lat[0],
            grid.lat[-1] - self.north,
            west,
            np.ptp(grid.lon) - west - self.width,
        )
        if min(sides) < -_SIDE_TOLERANCE:
            raise OceanError(
                f"{where}: {self.text} is not inside the data, which cover latitude {lat.min():g}"
                f" to {lat.max():g} and longitude {lon.min():g} to {lon.max():g}; change the window"
            )
        return grid
