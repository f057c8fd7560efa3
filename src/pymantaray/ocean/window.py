"""Windows on the Earth: what they take of a data set's grid, and what of the local frame lies inside them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import optimize

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.longitude import contiguous, whole_turns, wrapped

Array = NDArray[np.float64]
GeographicWindow = tuple[float, float, float, float]
"""South, north, west, east. [degrees]"""
SAME_DEGREES = 1e-3
"""HYCOM's coordinates are off the exact grid by 3e-5. [degrees]"""
_HAIR = 1e-4  # degrees, by which a grid point may miss the side of a window that it is on
_ON = 1e-9  # the same, where the window has to be enclosed
_MOST_BLOCKS = 8
_SIDE_POINTS = 101  # of a rectangle, where containment is checked


@dataclass(frozen=True)
class Selection:
    """Grid points of a window: what to read from the file, and how to put it in order."""

    lat: Array
    """Rising. [degrees]"""
    lon: Array
    """Rising, with the middle in -180 to 180. [degrees]"""
    rows: slice
    """Of the file."""
    falling: bool
    """Whether latitudes fall in the file."""
    blocks: tuple[slice, ...]
    """Columns of the file."""
    order: NDArray[np.intp]
    """Puts the columns of the blocks, one after the other, in a row."""

    @property
    def columns(self) -> NDArray[np.intp]:
        """Number in the file of each longitude."""
        return np.concatenate([np.r_[block] for block in self.blocks])[self.order]

    def in_order(self, values: Array) -> Array:
        """What the file has in the rows and blocks, (..., lat, lon), with both axes rising."""
        return values[..., :: -1 if self.falling else 1, self.order]


def checked_window(window: GeographicWindow) -> GeographicWindow:
    """South, north, west and east as numbers; west may be the greater, across the antimeridian. [degrees]"""
    try:
        south, north, west, east = (float(v) for v in window)
    except (TypeError, ValueError):
        raise OceanError(
            f"window {window!r} is not four numbers: south, north, west, east in degrees"
        ) from None
    if not np.all(np.isfinite([south, north, west, east])) or not -90.0 <= south < north <= 90.0:
        raise OceanError(
            f"window {window!r}: needs south, north, west, east in degrees, south below north within -90 to 90"
        )
    return south, north, west, east


def select(
    lat: Array, lon: Array, window: GeographicWindow | None, where: str, *, enclose: bool = False
) -> Selection:
    """
    Grid points of a window, by default all of them; on request those too that enclose it, where the axes have them.

    Latitudes [degrees] rise or fall, longitudes are counted in any way; ``where`` names the file in messages.
    """
    for name, axis, bound in (("latitude", lat, 90.0), ("longitude", lon, 720.0)):
        if axis.size == 0 or not np.all(np.isfinite(axis)):
            raise OceanError(f"{where}: {name} is empty or has values that are missing; correct the axis")
        if np.max(np.abs(axis)) > bound + SAME_DEGREES:
            raise OceanError(f"{where}: {name} reaches {np.max(np.abs(axis)):g}; is it in degrees?")
    steps = np.diff(lat)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise OceanError(f"{where}: latitude neither rises nor falls throughout; sort it and drop duplicates")
    if window is None:
        rows = np.arange(lat.size)
        columns, rising = contiguous(lon)
    else:
        south, north, west, east = checked_window(window)
        rows = _rows(lat, south, north, enclose=enclose)
        columns, rising = _columns(
            lon, west, 360.0 if east - west >= 360.0 else (east - west) % 360.0, enclose=enclose
        )
        if rows.size == 0 or columns.size == 0:
            raise OceanError(
                f"{where}: no grid point in the window {south:g} to {north:g} N, {west:g} to {east:g} E; the data"
                f" reach from {lat.min():g} to {lat.max():g} N and {lon.min():g} to {lon.max():g} E"
            )
    stored = np.sort(columns)
    runs = np.split(stored, np.flatnonzero(np.diff(stored) != 1) + 1)
    if len(runs) > _MOST_BLOCKS:  # longitudes in no order: read all between the outermost
        runs = [np.arange(stored[0], stored[-1] + 1)]
    falling = bool(steps.size and steps[0] < 0.0)
    inside = lat[rows[0] : rows[-1] + 1]
    return Selection(
        np.ascontiguousarray(inside[::-1] if falling else inside),
        rising,
        slice(int(rows[0]), int(rows[-1]) + 1),
        falling,
        tuple(slice(int(run[0]), int(run[-1]) + 1) for run in runs),
        np.searchsorted(np.concatenate(runs), columns),
    )


def _rows(lat: Array, south: float, north: float, *, enclose: bool) -> NDArray[np.intp]:
    from_south, to_north = lat >= south - _HAIR, lat <= north + _HAIR
    inside = from_south & to_north
    if enclose:
        below, above = lat[lat <= south + _ON], lat[lat >= north - _ON]
        inside |= (lat >= below.max(initial=-90.0)) & to_north & (below.size > 0)
        inside |= (lat <= above.min(initial=90.0)) & from_south & (above.size > 0)
    return np.flatnonzero(inside)


def _columns(lon: Array, west: float, width: float, *, enclose: bool) -> tuple[NDArray[np.intp], Array]:
    """Columns from west eastwards across any seam, each meridian once; and these, rising, their middle in -180 to 180."""
    # degrees east of the western side; a hair beyond it counts as on it
    east = (lon - west + _HAIR) % 360.0 - _HAIR
    order = np.argsort(east, kind="stable")
    order = order[np.diff(east[order], prepend=-1.0) > 1e-6]
    east = east[order]
    last = int(np.searchsorted(east, width + _HAIR, side="right"))
    columns, reached = order[:last], east[:last]
    if enclose and order.size > 1:
        gaps = np.diff(east, append=east[0] + 360.0)
        widest = 1.5 * np.sort(gaps)[-2]  # wider is no cell, but where the data end
        if last < order.size and gaps[last - 1] <= widest and not (last and east[last - 1] >= width - _ON):
            columns, reached = order[: last + 1], east[: last + 1]
        if reached.size < order.size and gaps[-1] <= widest and east[0] > _ON:
            columns, reached = np.append(order[-1], columns), np.append(east[-1] - 360.0, reached)
    rising = lon[columns] + 360.0 * np.round((west + reached - lon[columns]) / 360.0)
    return columns, rising - (whole_turns(0.5 * (rising[0] + rising[-1])) if rising.size else 0.0)


def crop(ocean: xr.Dataset, window: GeographicWindow | None, *, enclose: bool = False) -> xr.Dataset:
    """Part of a valid ocean that lies in a window, or on request encloses it; all of it without one."""
    if window is None:
        return ocean
    part = select(
        ocean["lat"].values, ocean["lon"].values, window, str(ocean.attrs["title"]), enclose=enclose
    )
    return ocean.isel(lat=part.rows, lon=part.columns)


def crop_around(
    ocean: xr.Dataset, centre: tuple[float, float] | None, half_extent: tuple[float, float]
) -> xr.Dataset:
    """Grid points of a valid ocean that enclose a local domain: its centre [degrees] and half sides north and east [m]."""
    window = Window.of(ocean, centre)
    lat, lon = window.geographic(*rectangle(*half_extent))
    return crop(ocean, (lat.min(), lat.max(), lon.min(), lon.max()), enclose=True)


def window_of(ocean: xr.Dataset) -> GeographicWindow:
    """Window of a valid ocean, to ask a file of the sea floor for. [degrees]"""
    lat, lon = ocean["lat"].values, ocean["lon"].values
    return float(lat[0]), float(lat[-1]), float(lon[0]), float(lon[-1])


def counted_place(ocean: xr.Dataset, place: tuple[float, float], name: str) -> tuple[float, float]:
    """Latitude and longitude of a place as the ocean counts it, which must lie in its window. [degrees]"""
    south, north, west, east = window_of(ocean)
    lat, lon = place[0], wrapped(place[1], about=0.5 * (west + east))
    if not (south <= lat <= north and west <= lon <= east):
        raise OceanError(
            f"{name}: {place[0]:g} N {place[1]:g} E is outside the ocean's window, latitude {south:g} to {north:g},"
            f" longitude {west:g} to {east:g}"
        )
    return lat, lon


def half_sides_within(half: tuple[float, float]) -> str:
    """Half sides [m] in words, rounded down, so that what is shown fits where they do."""
    north, east = (np.floor(h / 100.0) / 10.0 for h in half)
    return f"+-{north:.1f} km by +-{east:.1f} km"


def rectangle(half_north: float, half_east: float) -> tuple[Array, Array]:
    """North and east of points along the four sides of a rectangle about the origin. [m]"""
    s = np.linspace(-1.0, 1.0, _SIDE_POINTS)
    one = np.ones_like(s)
    return half_north * np.concatenate([s, s, one, -one]), half_east * np.concatenate([one, -one, s, s])


@dataclass(frozen=True)
class Window:
    """Latitudes and longitudes that a data set covers, and a local frame inside."""

    lat: Array
    """Shape (lat,). [degrees]"""
    lon: Array
    """Shape (lon,). [degrees]"""
    frame: LocalFrame

    @classmethod
    def of(cls, ocean: xr.Dataset, centre: tuple[float, float] | None = None) -> Self:
        """Window of an ocean or a sea floor, about a latitude and longitude [degrees] or its own middle."""
        lat, lon = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon"))
        middle = 0.5 * (lat[0] + lat[-1]), 0.5 * (lon[0] + lon[-1])
        return cls(lat, lon, LocalFrame(*(middle if centre is None else centre)))

    def geographic(self, north: Array, east: Array) -> tuple[Array, Array]:
        """Latitude and longitude of local points [m], within 180 degrees of the data set's middle. [degrees]"""
        lat, lon = self.frame.to_geodetic(north, east)
        return lat, wrapped(lon, about=0.5 * (self.lon[0] + self.lon[-1]))

    def holds(self, half_north: float, half_east: float) -> bool:
        """Whether a rectangle of these half sides [m] about the frame's centre lies inside the data set."""
        sides = self.geographic(*rectangle(half_north, half_east))
        tolerance = 1e-9  # degrees; a side may lie on the window's edge
        return all(
            bool(np.all((x >= axis[0] - tolerance) & (x <= axis[-1] + tolerance)))
            for x, axis in zip(sides, (self.lat, self.lon), strict=True)
        )

    def native_spacing(self) -> tuple[float, float]:
        """Grid spacing of the data set at the frame's centre, north and east. [m]"""
        lat, lon = self.frame.latitude_deg, self.frame.longitude_deg
        d_lat = _step_at(self.lat, lat)
        d_lon = _step_at(self.lon, float(self.geographic(np.zeros(1), np.zeros(1))[1][0]))
        n, _ = self.frame.to_local([lat - 0.5 * d_lat, lat + 0.5 * d_lat], lon)
        _, e = self.frame.to_local(lat, [lon - 0.5 * d_lon, lon + 0.5 * d_lon])
        return float(n[1] - n[0]), float(e[1] - e[0])

    def largest_rectangle(self) -> tuple[float, float]:
        """Half sides, north and east, of the rectangle of largest area about the frame's centre that the data set holds. [m]"""
        tallest = _reach(lambda north: self.holds(north, 0.0))
        if tallest <= 0.0:
            raise OceanError(
                f"centre {self.frame.latitude_deg:g} N {self.frame.longitude_deg:g} E is not inside the data:"
                f" latitude {self.lat[0]:g} to {self.lat[-1]:g}, longitude {self.lon[0]:g} to {self.lon[-1]:g}"
            )

        def width(north: float) -> float:
            return _reach(lambda east: self.holds(north, east))

        best = optimize.minimize_scalar(
            lambda north: -north * width(north), bounds=(0.0, tallest), options={"xatol": 1.0}
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
