"""
Points of a curvilinear grid: the part in a window, bilinear interpolation to latitudes and
longitudes, and the directions of its axes.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.geometry.longitude import wrap_longitude
from pymantaray.ocean.window import GeographicWindow, checked_window

_MARGIN = 2  # points around a window that are read
_NEAREST = 4  # points whose cells may contain a place
_OUTSIDE = 1e-9  # of a cell; a place this far outside counts as on its side
_WET = 0.5  # share of the weights of a place that must be in the water
_MIN_POINTS = 4
_ECCENTRICITY_SQUARED = 6.69437999014e-3  # of WGS 84
_MOST_SAMPLES = 200  # latitudes or longitudes that are looked for in the grid
_FINEST = 1e-4  # degrees; least spacing of the latitudes


@dataclass(frozen=True)
class Box:
    """Rows and columns of a grid."""

    rows: slice
    columns: slice

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.rows.stop - self.rows.start, self.columns.stop - self.columns.start


@dataclass(frozen=True, eq=False)
class CurvilinearGrid:
    """
    Points of a grid whose latitudes and longitudes vary along both of its axes.

    Points without finite coordinates are outside the grid.
    """

    lat: Array
    """Shape (rows, columns). [degrees]"""
    lon: Array
    """Shape (rows, columns). [degrees]"""

    def box(self, window: GeographicWindow | None, where: str) -> Box:
        """Rows and columns with the points of a window and those around it."""
        inside = np.isfinite(self.lat) & np.isfinite(self.lon)
        if window is not None:
            south, north, west, east = checked_window(window)
            half = 0.5 * min((east - west) % 360.0 or 360.0, 360.0)
            about = west + half
            inside &= (self.lat >= south) & (self.lat <= north)
            inside &= np.abs(wrap_longitude(self.lon, about) - about) <= half
        if not inside.any():
            raise OceanError(
                f"{where}: no grid point in the window {window}; the data cover latitude"
                f" {np.nanmin(self.lat):g} to {np.nanmax(self.lat):g} and longitude"
                f" {np.nanmin(self.lon):g} to {np.nanmax(self.lon):g}; change the window"
            )
        sides = []
        for axis, size in ((1, self.lat.shape[0]), (0, self.lat.shape[1])):
            used = np.flatnonzero(inside.any(axis=axis))
            sides.append(slice(max(used[0] - _MARGIN, 0), min(used[-1] + _MARGIN + 1, size)))
        return Box(*sides)

    def part(self, box: Box) -> "CurvilinearGrid":
        """Points in a box."""
        return CurvilinearGrid(self.lat[box.rows, box.columns], self.lon[box.rows, box.columns])

    def axes(self, window: GeographicWindow | None, where: str) -> tuple[Array, Array]:
        """
        Increasing latitudes and longitudes with about the spacing of the grid, all of them inside
        the grid and the window. [degrees]
        """
        step = 1.0 / np.ceil(1.0 / max(self._spacing, _FINEST))
        if window is None:
            about = float(np.degrees(np.angle(np.nanmean(np.exp(1j * np.radians(self.lon))))))
            lon = wrap_longitude(self.lon, about)
            south, north = float(np.nanmin(self.lat)), float(np.nanmax(self.lat))
            west, east = float(np.nanmin(lon)), float(np.nanmax(lon))
        else:
            south, north, west, east = checked_window(window)
            east = west + ((east - west) % 360.0 or 360.0)
        lat = _multiples(south, north, step)
        widen = 1.0 / max(np.cos(np.radians(0.5 * (south + north))), 1e-3)
        lon = _multiples(west, east, 1.0 / np.ceil(1.0 / (step * widen)))
        every = [-(-axis.size // _MOST_SAMPLES) for axis in (lat, lon)]
        some = lat[:: every[0]], lon[:: every[1]]
        _, _, inside = self.corners(*np.meshgrid(*some, indexing="ij"))
        rows, columns = (
            slice(step * side.start, step * (side.stop - 1) + 1)
            for step, side in zip(every, _largest_full(inside), strict=True)
        )
        if min(rows.stop - rows.start, columns.stop - columns.start) < _MIN_POINTS:
            raise OceanError(
                f"{where}: the curvilinear grid holds no rectangle of {_MIN_POINTS} latitudes by"
                f" {_MIN_POINTS} longitudes, {step:.3g} degrees apart, in the window; give a window"
                " inside the grid"
            )
        return lat[rows], lon[columns]

    def corners(self, lat: Array, lon: Array) -> tuple[NDArray[np.intp], Array, NDArray[np.bool_]]:
        """
        Find the cells of places: flat indices and bilinear weights of the four corners, both (4,
        n), and True for places inside the grid, with the shape of the places.
        """
        places = lat.ravel(), lon.ravel()
        there = on_ellipsoid(*places)
        index = np.zeros((4, len(there)), dtype=np.intp)
        weights = np.zeros((4, len(there)))
        found = np.zeros(len(there), dtype=bool)
        tree, points = self._tree
        _, nearest = tree.query(there, k=min(_NEAREST, tree.n))
        for candidates in np.atleast_2d(nearest.T):
            for d_row in (-1, 0):
                for d_column in (-1, 0):
                    left = np.flatnonzero(~found)
                    if left.size == 0:
                        break
                    beside = points[candidates[left]], (d_row, d_column)
                    own, share, inside = self._in_cell(*beside, places[0][left], places[1][left])
                    index[:, left[inside]] = own[:, inside]
                    weights[:, left[inside]] = share[:, inside]
                    found[left[inside]] = True
        return index, weights, found.reshape(lat.shape)

    def _in_cell(
        self, points: NDArray[np.intp], offset: tuple[int, int], lat: Array, lon: Array
    ) -> tuple[NDArray[np.intp], Array, NDArray[np.bool_]]:
        """Corners and weights of the cells beside some points, and True if they contain places."""
        rows, columns = self.lat.shape
        row, column = np.divmod(points, columns)
        row, column = row + offset[0], column + offset[1]
        inside = (row >= 0) & (row < rows - 1) & (column >= 0) & (column < columns - 1)
        row, column = np.clip(row, 0, rows - 2), np.clip(column, 0, columns - 2)
        first = row * columns + column
        corners = np.stack([first, first + 1, first + columns, first + columns + 1])
        # in the tangent plane at each place, where straight lines are nearly great circles
        east, north = _tangents(lat, lon)
        apart = self._xyz.reshape(-1, 3)[corners] - on_ellipsoid(lat, lon)
        x, y = np.einsum("kni,ni->kn", apart, east), np.einsum("kni,ni->kn", apart, north)
        u, v = _inverse_bilinear(x, y)
        with np.errstate(invalid="ignore"):
            inside &= (np.abs(u - 0.5) <= 0.5 + _OUTSIDE) & (np.abs(v - 0.5) <= 0.5 + _OUTSIDE)
        u, v = np.clip(u, 0.0, 1.0), np.clip(v, 0.0, 1.0)
        return corners, np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v]), inside

    @cached_property
    def _xyz(self) -> Array:
        """Points of the ellipsoid, (rows, columns, 3)."""
        return on_ellipsoid(self.lat, self.lon)

    @cached_property
    def _tree(self) -> tuple[Any, NDArray[np.intp]]:
        """Tree of the points with coordinates, and their flat indices."""
        from scipy.spatial import cKDTree

        flat = self._xyz.reshape(-1, 3)
        points = np.flatnonzero(np.isfinite(flat).all(axis=1))
        return cKDTree(flat[points]), points

    @cached_property
    def _spacing(self) -> float:
        """Median distance of neighbours along the finer axis. [degrees]"""
        return min(
            float(np.degrees(np.nanmedian(np.linalg.norm(np.diff(self._xyz, axis=k), axis=-1))))
            for k in (0, 1)
        )

    def directions(self) -> tuple[Array, Array]:
        """
        Unit vectors (east, north) along the columns' and along the rows' index, each (2, rows,
        columns).
        """
        tangents = _tangents(self.lat, self.lon)
        found = []
        for axis in (1, 0):
            along = np.gradient(self._xyz, axis=axis)
            both = np.stack([np.sum(along * tangent, axis=-1) for tangent in tangents])
            with np.errstate(invalid="ignore"):
                found.append(both / np.hypot(*both))
        return found[0], found[1]


@dataclass(frozen=True, eq=False)
class Regridding:
    """Bilinear interpolation from the points of a grid to latitudes and longitudes."""

    index: NDArray[np.intp]
    """Flat indices of four corners, (4, n)."""
    weights: Array
    shape: tuple[int, int]
    """Numbers of latitudes and longitudes."""

    @classmethod
    def to(cls, grid: CurvilinearGrid, lat: Array, lon: Array) -> "Regridding":
        """Interpolation to increasing latitudes and longitudes inside a grid. [degrees]"""
        index, weights, _ = grid.corners(*np.meshgrid(lat, lon, indexing="ij"))
        return cls(index, weights, (lat.size, lon.size))

    def __call__(self, values: Array) -> Array:
        """
        Interpolate a layer (rows, columns): a place is dry (NaN) if more than half of the weights
        of its corners are dry; otherwise its wet corners share their weights.
        """
        corners = values.ravel()[self.index]
        wet = np.isfinite(corners)
        share = np.where(wet, self.weights, 0.0)
        total = share.sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.sum(share * np.where(wet, corners, 0.0), axis=0) / total
        return np.where(total >= _WET, mean, np.nan).reshape(self.shape)


def on_ellipsoid(lat: Array, lon: Array) -> Array:
    """Points of the WGS 84 ellipsoid, (..., 3), in its semi-major axis, from degrees."""
    lat, lon = np.radians(lat), np.radians(lon)
    radius = 1.0 / np.sqrt(1.0 - _ECCENTRICITY_SQUARED * np.sin(lat) ** 2)
    side = radius * np.cos(lat)
    height = (1.0 - _ECCENTRICITY_SQUARED) * radius * np.sin(lat)
    return np.stack([side * np.cos(lon), side * np.sin(lon), height], axis=-1)


def _tangents(lat: Array, lon: Array) -> tuple[Array, Array]:
    """Unit vectors (..., 3) to the east and to the north, from degrees."""
    lat, lon = np.radians(lat), np.radians(lon)
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros_like(lon)], axis=-1)
    north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
    return east, np.stack(north, axis=-1)


def _inverse_bilinear(x: Array, y: Array) -> tuple[Array, Array]:
    """
    Coordinates of the origin in quadrilaterals with corners (4, n), by Newton's method from the
    middle.
    """
    u, v = np.full(x.shape[1], 0.5), np.full(x.shape[1], 0.5)
    parts = [(c[0], c[1] - c[0], c[2] - c[0], c[0] - c[1] - c[2] + c[3]) for c in (x, y)]
    with np.errstate(all="ignore"):
        for _ in range(8):
            (f, fu, fv), (g, gu, gv) = (
                (a + b * u + c * v + d * u * v, b + d * v, c + d * u) for a, b, c, d in parts
            )
            determinant = fu * gv - fv * gu
            u, v = u - (f * gv - g * fv) / determinant, v - (g * fu - f * gu) / determinant
    return u, v


def _multiples(low: float, high: float, step: float) -> Array:
    """Multiples of a step between two values."""
    return np.arange(np.ceil(low / step - 1e-6), np.floor(high / step + 1e-6) + 1.0) * step


def _largest_full(inside: NDArray[np.bool_]) -> tuple[slice, slice]:
    """
    Rows and columns of a rectangle without a False value: the side with the largest share of them
    is removed until none is left.
    """
    top, bottom, left, right = 0, inside.shape[0], 0, inside.shape[1]
    while bottom > top and right > left:
        part = inside[top:bottom, left:right]
        if part.all():
            break
        shares = [1.0 - side.mean() for side in (part[0], part[-1], part[:, 0], part[:, -1])]
        worst = int(np.argmax(shares))
        if shares[worst] == 0.0:  # only inner places are outside
            worst = int(np.argmin([part.shape[0]] * 2 + [part.shape[1]] * 2))
        top, bottom = top + (worst == 0), bottom - (worst == 1)
        left, right = left + (worst == 2), right - (worst == 3)
    return slice(top, bottom), slice(left, right)
