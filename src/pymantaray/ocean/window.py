"""The geographic window seen from the local frame: longitudes, spacing, and the rectangle that fits."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.longitude import wrapped

Array = NDArray[np.float64]
_EDGE_POINTS = 101  # of a rectangle's side, where containment is checked


@dataclass(frozen=True)
class Window:
    """Latitudes and longitudes that a data set covers, and a local frame inside."""

    lat: Array
    """Shape (lat,). [degrees]"""
    lon: Array
    """Shape (lon,). [degrees]"""
    frame: LocalFrame

    def geographic(self, north: Array, east: Array) -> tuple[Array, Array]:
        """Latitude and longitude of local points, longitude as the data set counts it."""
        lat, lon = self.frame.to_geodetic(north, east)
        return lat, wrapped(lon, about=0.5 * (self.lon[0] + self.lon[-1]))

    def holds(self, half_north: float, half_east: float) -> bool:
        """Whether a rectangle about the frame's centre lies inside the window."""
        s = np.linspace(-1.0, 1.0, _EDGE_POINTS)
        one = np.ones_like(s)
        north = half_north * np.concatenate([s, s, one, -one])
        east = half_east * np.concatenate([one, -one, s, s])
        lat, lon = self.geographic(north, east)
        tolerance = 1e-9  # degrees; a side may lie on the window's edge
        return bool(
            np.all(lat >= self.lat[0] - tolerance)
            and np.all(lat <= self.lat[-1] + tolerance)
            and np.all(lon >= self.lon[0] - tolerance)
            and np.all(lon <= self.lon[-1] + tolerance)
        )

    def native_spacing(self) -> tuple[float, float]:
        """Grid spacing of the data set at the frame's centre."""
        lat, lon = self.frame.latitude_deg, self.frame.longitude_deg
        d_lat = _step_at(self.lat, lat)
        d_lon = _step_at(self.lon, float(self.geographic(np.zeros(1), np.zeros(1))[1][0]))
        n, _ = self.frame.to_local([lat - 0.5 * d_lat, lat + 0.5 * d_lat], lon)
        _, e = self.frame.to_local(lat, [lon - 0.5 * d_lon, lon + 0.5 * d_lon])
        return float(n[1] - n[0]), float(e[1] - e[0])

    def largest_rectangle(self) -> tuple[float, float]:
        """Half sides of the rectangle of largest area about the frame's centre that the window holds."""
        tallest = _reach(lambda north: self.holds(north, 0.0))
        if tallest <= 0.0:
            raise OceanError(
                f"centre {self.frame.latitude_deg:g} N {self.frame.longitude_deg:g} E is not inside the data:"
                f" latitude {self.lat[0]:g} to {self.lat[-1]:g}, longitude {self.lon[0]:g} to {self.lon[-1]:g}"
            )

        def width(north: float) -> float:
            return _reach(lambda east: self.holds(north, east))

        best = optimize.minimize_scalar(
            lambda north: -north * width(north),
            bounds=(0.0, tallest),
            method="bounded",
            options={"xatol": 1.0},
        )
        return float(best.x), width(float(best.x))


def _reach(holds: Callable[[float], bool]) -> float:
    """Largest length that still fits, by bisection to a millimetre, from the inside. [m]"""
    low, high = 0.0, 2.1e7  # half the Earth's girth: nothing fits
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _step_at(axis: Array, value: float) -> float:
    """Spacing of the axis in the interval that holds a value."""
    i = int(np.clip(np.searchsorted(axis, value) - 1, 0, len(axis) - 2))
    return float(axis[i + 1] - axis[i])
