"""Geographic windows: selection of grid points, and the part of a local frame inside a window."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Self

import numpy as np
import xarray as xr

from pymantaray.arrays import Array, Indices
from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.longitude import contiguous, whole_turns, wrap_longitude
from pymantaray.ocean.schema import place_text

GeographicWindow = tuple[float, float, float, float]
"""South, north, west, east. [degrees]"""
SAME_DEGREES = 1e-3
"""HYCOM's coordinates deviate from the exact grid by 3e-5. [degrees]"""
# degrees; a grid point this far outside a side of the window counts as on it
_SIDE_TOLERANCE = 1e-4
_ENCLOSING_TOLERANCE = 1e-9  # degrees; the same if the grid points must enclose the window
_TURNS = 720.0  # degrees; longitudes may be in another turn
_LAST_LATITUDE = 89.999  # degrees; of a centre
_SEAM = 1.5  # widest steps; a wider gap between the last and the first column is no seam
_WIDEST_STEP = 20.0  # usual steps; a wider gap has no grid points
_MAX_BLOCKS = 8
_SIDE_POINTS = 101  # points per side of a rectangle for checks of containment


@dataclass(frozen=True)
class Selection:
    """Grid points of a window: blocks to read from the file, and their order."""

    lat: Array
    """Increasing. [degrees]"""
    lon: Array
    """Increasing, with the middle in -180 to 180. [degrees]"""
    rows: slice
    """Rows of the file."""
    falling: bool
    """True if latitudes decrease in the file."""
    blocks: tuple[slice, ...]
    """Columns of the file."""
    order: Indices
    """Order of the concatenated columns of all blocks."""

    @property
    def columns(self) -> Indices:
        """Index in the file of each longitude."""
        return np.concatenate([np.r_[block] for block in self.blocks])[self.order]

    def in_order(self, values: Array) -> Array:
        """Sort values of the rows and blocks, (..., lat, lon), so that both axes increase."""
        return values[..., :: -1 if self.falling else 1, self.order]


def checked_window(window: GeographicWindow) -> GeographicWindow:
    """
    South, north, west and east as numbers; west may be greater than east, across the antimeridian.
    [degrees]
    """
    try:
        south, north, west, east = (float(v) for v in window)
    except (TypeError, ValueError):
        raise OceanError(
            f"window {window!r} is invalid; it must be four numbers: south, north, west, east in"
            " degrees"
        ) from None
    inside = -90.0 <= south < north <= 90.0 and max(abs(west), abs(east)) <= _TURNS
    if not inside:  # NaN is not inside
        raise OceanError(
            f"window {window!r} is invalid; it must be south, north, west, east in degrees, with"
            f" south < north in -90 to 90 and west and east in -{_TURNS:g} to {_TURNS:g}"
        )
    return south, north, west, east


def select(
    lat: Array, lon: Array, window: GeographicWindow | None, where: str, *, enclose: bool = False
) -> Selection:
    """
    Select the grid points of a window, or all if there is none.

    With ``enclose``, the selection also includes the points around the window, if the axes have
    them. Latitudes [degrees] may increase or decrease; longitudes may have any convention.
    ``where`` is the file for messages.
    """
    # check the axes
    for name, axis, bound in (("latitude", lat, 90.0), ("longitude", lon, _TURNS)):
        if axis.size == 0 or not np.all(np.isfinite(axis)):
            raise OceanError(f"{where}: {name} is empty or has missing values; correct the axis")
        if np.max(np.abs(axis)) > bound + SAME_DEGREES:
            raise OceanError(
                f"{where}: {name} has values up to {np.max(np.abs(axis)):g}; it must be in"
                " degrees; convert it"
            )
    steps = np.diff(lat)
    if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
        raise OceanError(f"{where}: latitude is not monotonic; sort it and drop duplicates")
    # rows and columns of the window
    if window is None:
        rows = np.arange(lat.size)
        columns, rising = contiguous(lon)
    else:
        south, north, west, east = checked_window(window)
        rows = _rows(lat, south, north, enclose=enclose)
        whole = east - west >= 360.0
        width = 360.0 if whole else (east - west) % 360.0
        columns, rising = _columns(lon, west, width, enclose=enclose)
        steps_east = np.diff(rising)
        if (
            whole
            and steps_east.size
            and steps_east.max() > _SEAM * (rising[0] + 360.0 - rising[-1])
        ):
            columns, rising = contiguous(lon)  # the side of the window is inside the data
        if rows.size == 0 or columns.size == 0:
            raise OceanError(
                f"{where}: no grid point in the window, latitude {south:g} to {north:g} and"
                f" longitude {west:g} to {east:g}; the data cover latitude {lat.min():g} to"
                f" {lat.max():g} and longitude {lon.min():g} to {lon.max():g}; change the window"
            )
    # blocks to read
    stored = np.sort(columns)
    runs = np.split(stored, np.flatnonzero(np.diff(stored) != 1) + 1)
    if len(runs) > _MAX_BLOCKS:  # unordered longitudes: read all between the outermost
        runs = [np.arange(stored[0], stored[-1] + 1)]
    # the selected points must have no gap
    for name, axis in (("latitude", lat[rows]), ("longitude", rising)):
        gaps = np.abs(np.diff(axis))
        if gaps.size and gaps.max() > _WIDEST_STEP * np.median(gaps):
            i = int(np.argmax(gaps))
            raise OceanError(
                f"{where}: {name} has a gap from {axis[i]:g} to {axis[i + 1]:g}, and steps of"
                f" {np.median(gaps):g} elsewhere; select one side with a window"
            )
    # rows of decreasing latitude are read upside down
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


def _rows(lat: Array, south: float, north: float, *, enclose: bool) -> Indices:
    from_south = lat >= south - _SIDE_TOLERANCE
    to_north = lat <= north + _SIDE_TOLERANCE
    inside = from_south & to_north
    if enclose:
        below = lat[lat <= south + _ENCLOSING_TOLERANCE]
        above = lat[lat >= north - _ENCLOSING_TOLERANCE]
        inside |= (lat >= below.max(initial=-90.0)) & to_north & (below.size > 0)
        inside |= (lat <= above.min(initial=90.0)) & from_south & (above.size > 0)
    return np.flatnonzero(inside)


def _columns(lon: Array, west: float, width: float, *, enclose: bool) -> tuple[Indices, Array]:
    """
    Columns from west to east across any seam, each meridian once, and their increasing longitudes,
    middle in -180 to 180.
    """
    # degrees east of the western side; points slightly west of it count as on it
    east = (lon - west + _SIDE_TOLERANCE) % 360.0 - _SIDE_TOLERANCE
    order = np.argsort(east, kind="stable")
    order = order[np.diff(east[order], prepend=-1.0) > 1e-6]
    east = east[order]
    last = int(np.searchsorted(east, width + _SIDE_TOLERANCE, side="right"))
    columns = order[:last]
    reached = east[:last]
    if enclose and order.size > 1:
        gaps = np.diff(east, append=east[0] + 360.0)
        widest = 1.5 * np.sort(gaps)[-2]  # a wider gap is the edge of the data, not a cell
        if (
            last < order.size
            and gaps[last - 1] <= widest
            and not (last and east[last - 1] >= width - _ENCLOSING_TOLERANCE)
        ):
            columns = order[: last + 1]
            reached = east[: last + 1]
        if reached.size < order.size and gaps[-1] <= widest and east[0] > _ENCLOSING_TOLERANCE:
            columns = np.append(order[-1], columns)
            reached = np.append(east[-1] - 360.0, reached)
    rising = lon[columns] + 360.0 * np.round((west + reached - lon[columns]) / 360.0)
    return columns, rising - (whole_turns(0.5 * (rising[0] + rising[-1])) if rising.size else 0.0)


def crop(
    ocean: xr.Dataset, window: GeographicWindow | None, *, enclose: bool = False
) -> xr.Dataset:
    """
    Crop a valid ocean to a window, or with ``enclose`` to the grid points around it; unchanged
    without a window.
    """
    if window is None:
        return ocean
    part = select(
        ocean["lat"].values, ocean["lon"].values, window, str(ocean.attrs["title"]), enclose=enclose
    )
    return _columns_at(ocean.isel(lat=part.rows), part.columns, part.lon)


def _columns_at(ocean: xr.Dataset, columns: Indices, lon: Array) -> xr.Dataset:
    """Ocean with some of its columns, at equal longitudes in another turn. [degrees]"""
    return ocean.isel(lon=columns).assign_coords(lon=("lon", lon, ocean["lon"].attrs))


def centred(ocean: xr.Dataset, centre: tuple[float, float] | None) -> xr.Dataset:
    """
    Ocean around the whole globe with a centre's longitude in its middle, so that its first column
    is on the other side of the Earth; another ocean is unchanged.
    """
    if centre is None or ocean.sizes.get("lon", 0) < 2:
        return ocean
    lon = np.asarray(ocean["lon"].values, dtype=float)
    if lon[0] + 360.0 - lon[-1] > _SEAM * np.diff(lon).max():
        return ocean
    about = wrap_longitude(lon, wrap_longitude(centre[1]))
    order = np.argsort(about, kind="stable")
    return _columns_at(ocean, order, (lon + 360.0 * np.round((about - lon) / 360.0))[order])


def crop_around(
    ocean: xr.Dataset, centre: tuple[float, float] | None, half_extent: tuple[float, float]
) -> xr.Dataset:
    """
    Crop an ocean to the grid points that enclose a local domain.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    centre : tuple of float or None
        Latitude and longitude of the domain's centre; None for the middle of the ocean. [degrees]
    half_extent : tuple of float
        Half sides (north, east) of the domain. [m]

    Returns
    -------
    xarray.Dataset
        A valid ocean.

    Raises
    ------
    OceanError
        If the centre or the domain is not inside the ocean.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import crop_around
    >>> dict(crop_around(ocean, (78.0, 0.0), (3e3, 3e3)).sizes)
    {'depth': 40, 'lat': 3, 'lon': 5}
    """
    ocean = centred(ocean, centre)
    window = Window.of(ocean, centre)
    lat, lon = window.geographic(*rectangle(*window.checked_sides(half_extent)))
    return crop(ocean, (lat.min(), lat.max(), lon.min(), lon.max()), enclose=True)


def window_of(ocean: xr.Dataset) -> GeographicWindow:
    """
    Geographic window of an ocean, for example to read a sea floor.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.

    Returns
    -------
    tuple of float
        South, north, west, east. [degrees]

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import window_of
    >>> [round(edge, 2) for edge in window_of(ocean)]
    [77.92, 78.08, -0.4, 0.4]
    """
    lat = ocean["lat"].values
    lon = ocean["lon"].values
    return float(lat[0]), float(lat[-1]), float(lon[0]), float(lon[-1])


def domain_window(
    centre: tuple[float, float], half_extent: tuple[float, float]
) -> GeographicWindow:
    """
    Window with a local domain, and a fifth of its size and 0.1 degrees more on each side.

    ``centre`` contains latitude and longitude, ``half_extent`` the half sides (north, east) [m].
    """
    north, east = rectangle(*(1.2 * float(h) for h in half_extent))
    lat, lon = LocalFrame(*centre).to_geodetic(north, east)
    lon = wrap_longitude(lon, centre[1])
    more = 0.1 / max(float(np.cos(np.radians(centre[0]))), 1e-3)
    return (
        max(float(lat.min()) - 0.1, -90.0),
        min(float(lat.max()) + 0.1, 90.0),
        float(lon.min()) - more,
        float(lon.max()) + more,
    )


def counted_place(ocean: xr.Dataset, place: tuple[float, float], name: str) -> tuple[float, float]:
    """
    Latitude and longitude of a place in the longitude convention of an ocean; it must be in its
    window. [degrees]
    """
    south, north, west, east = window_of(ocean)
    lat = place[0]
    lon = wrap_longitude(place[1], about=0.5 * (west + east))
    if not (south <= lat <= north and west <= lon <= east):
        raise OceanError(
            f"{name}: {place_text(*place)} is outside the ocean; allowed: latitude {south:g} to"
            f" {north:g}, longitude {west:g} to {east:g}"
        )
    return lat, lon


def half_sides_within(half: tuple[float, float]) -> str:
    """Half sides [m] as text, rounded down so that the displayed values also fit."""
    north, east = (np.floor(h / 100.0) / 10.0 for h in half)
    return f"+-{north:.1f} km by +-{east:.1f} km"


def rectangle(half_north: float, half_east: float) -> tuple[Array, Array]:
    """North and east of points along the four sides of a rectangle around the origin. [m]"""
    s = np.linspace(-1.0, 1.0, _SIDE_POINTS)
    one = np.ones_like(s)
    return half_north * np.concatenate([s, s, one, -one]), half_east * np.concatenate(
        [one, -one, s, s]
    )


@dataclass(frozen=True)
class Window:
    """Latitudes and longitudes of a data set, and a local frame inside."""

    lat: Array
    """Shape (lat,). [degrees]"""
    lon: Array
    """Shape (lon,). [degrees]"""
    frame: LocalFrame

    @classmethod
    def of(cls, ocean: xr.Dataset, centre: tuple[float, float] | None = None) -> Self:
        """
        Window of an ocean or a sea floor, with the frame at a latitude and longitude [degrees] or
        in the middle.
        """
        lat, lon = (np.asarray(ocean[name].values, dtype=float) for name in ("lat", "lon"))
        return cls.on(lat, lon, centre)

    @classmethod
    def on(cls, lat: Array, lon: Array, centre: tuple[float, float] | None = None) -> Self:
        """Window of axes [degrees], with the frame as in `of`."""
        middle = 0.5 * (lat[0] + lat[-1]), 0.5 * (lon[0] + lon[-1])
        return cls(lat, lon, LocalFrame(*(middle if centre is None else centre)))

    def geographic(self, north: Array, east: Array) -> tuple[Array, Array]:
        """
        Latitude and longitude of local points [m]; longitude within 180 degrees of the data set's
        middle. [degrees]
        """
        lat, lon = self.frame.to_geodetic(north, east)
        return lat, wrap_longitude(lon, about=0.5 * (self.lon[0] + self.lon[-1]))

    @cached_property
    def _poles(self) -> list[tuple[float, float]]:
        """North and east of the poles. [m]"""
        north, east = self.frame.to_local([-90.0, 90.0], [0.0, 0.0])
        return list(zip(north.tolist(), east.tolist(), strict=True))

    def _has_pole(self, half_north: float, half_east: float) -> bool:
        return any(abs(n) < half_north and abs(e) < half_east for n, e in self._poles)

    def holds(self, half_north: float, half_east: float, *, coarsely: bool = False) -> bool:
        """
        Return True if a rectangle with these half sides [m] around the frame's centre is inside the
        data set and has no pole in it.

        ``coarsely`` checks some points of its sides only.
        """
        if self._has_pole(half_north, half_east):
            return False
        north, east = rectangle(half_north, half_east)
        # these points are outside of most rectangles that are outside
        some = slice(None, None, _SIDE_POINTS // 4)
        return all(
            self.contains(self.geographic(north[of], east[of]))
            for of in (some, slice(None))[: 1 if coarsely else 2]
        )

    def checked_sides(self, half_extent: tuple[float, float]) -> tuple[float, float]:
        """
        Return the half sides (north, east) of a domain around the frame's centre; the data set must
        hold it. [m]
        """
        north, east = (float(h) for h in half_extent)
        if not (north > 0.0 and east > 0.0):
            raise OceanError(f"half_extent is {half_extent} m; both half sides must be positive")
        if not self.holds(north, east):
            at_pole = self._has_pole(north, east)
            fault = "contains a pole" if at_pole else "does not fit into the data"
            raise OceanError(
                f"domain of +-{north / 1e3:g} km north, +-{east / 1e3:g} km east around"
                f" {place_text(self.frame.latitude_deg, self.frame.longitude_deg)} {fault}; set"
                f" half_extent to at most {half_sides_within(self.largest_rectangle())}"
            )
        return north, east

    def contains(self, places: tuple[Array, Array]) -> bool:
        """Return True if latitudes and longitudes from `geographic` are all inside the data set."""
        tolerance = 1e-9  # degrees; a side may be on the edge of the window
        return all(
            bool(np.all((x >= axis[0] - tolerance) & (x <= axis[-1] + tolerance)))
            for x, axis in zip(places, (self.lat, self.lon), strict=True)
        )

    def native_spacing(self) -> tuple[float, float]:
        """Grid spacing of the data set at the frame's centre, north and east. [m]"""
        lat = self.frame.latitude_deg
        lon = self.frame.longitude_deg
        d_lat = _step_at(self.lat, lat)
        d_lon = _step_at(self.lon, float(self.geographic(np.zeros(1), np.zeros(1))[1][0]))
        n, _ = self.frame.to_local([lat - 0.5 * d_lat, lat + 0.5 * d_lat], lon)
        _, e = self.frame.to_local(lat, [lon - 0.5 * d_lon, lon + 0.5 * d_lon])
        return float(n[1] - n[0]), float(e[1] - e[0])

    def largest_rectangle(self) -> tuple[float, float]:
        """
        Half sides (north, east) of the rectangle of largest area around the frame's centre inside
        the data set. [m]
        """
        edges = ((float(axis[0]), float(axis[-1])) for axis in (self.lat, self.lon))
        return _largest_rectangle(*edges, (self.frame.latitude_deg, self.frame.longitude_deg))


@lru_cache(maxsize=32)  # many oceans have one grid, and a search takes some hundredths of a second
def _largest_rectangle(
    lat: tuple[float, float], lon: tuple[float, float], centre: tuple[float, float]
) -> tuple[float, float]:
    """
    Half sides as by `Window.largest_rectangle`, of the edges of a data set and the frame's centre.
    """
    if abs(centre[0]) > _LAST_LATITUDE:
        raise OceanError(
            f"centre {place_text(*centre)} is at a pole, where north has no direction; move it to"
            f" a latitude of at most {_LAST_LATITUDE}"
        )
    window = Window(np.array(lat), np.array(lon), LocalFrame(*centre))
    tallest = _reach(lambda north: window.holds(north, 0.0))
    if tallest <= 0.0:
        raise OceanError(
            f"centre {place_text(*centre)} is not inside the data: latitude {lat[0]:g} to"
            f" {lat[1]:g}, longitude {lon[0]:g} to {lon[1]:g}"
        )

    def width(north: float) -> float:
        most = _reach(lambda east: window.holds(north, east, coarsely=True))
        return most if window.holds(north, most) else _reach(lambda east: window.holds(north, east))

    from scipy.optimize import minimize_scalar

    best = minimize_scalar(
        lambda north: -north * width(north), bounds=(0.0, tallest), options={"xatol": 1.0}
    )
    return float(best.x), width(float(best.x))


def _reach(holds: Callable[[float], bool]) -> float:
    """Largest length that fits, rounded down, by bisection to a millimetre. [m]"""
    low = 0.0  # the upper limit is half the Earth's circumference
    high = 2.1e7
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _step_at(axis: Array, value: float) -> float:
    """Spacing of an axis in the interval that contains a value."""
    i = int(np.clip(np.searchsorted(axis, value) - 1, 0, len(axis) - 2))
    return float(axis[i + 1] - axis[i])
