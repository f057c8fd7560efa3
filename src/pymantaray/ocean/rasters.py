"""Grids of numbers in text files: ESRI ASCII, and x, y, z as GMT writes them."""

import re
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.user_files import first_bytes, read_text

RASTER = "raster"
"""Name of the variable of a grid whose file has no names."""
_KEYS = ("ncols", "nrows", "xllcorner", "xllcenter", "yllcorner", "yllcenter", "cellsize")
_DIGITS = 6  # of the coordinates in x, y, z; 0.1 m of latitude
_IRREGULAR = 0.05  # of the median step; steps of a regular axis are rounded
_NORTH_FIRST = re.compile(
    r"[#>\s]*(lat|latitude|y|northing)(?:\s*[\[(][^\])]*[\])])?[,;\s]+"
    r"(lon|longitude|long|x|easting)\b",
    re.IGNORECASE,
)
_NUMBER = re.compile(r"[-+]?\d*\.?\d+(e[-+]?\d+)?,?", re.IGNORECASE)


def is_text_grid(path: Path) -> bool:
    """True if a file begins as an ESRI ASCII grid, or with at least two lines of three numbers."""
    start = first_bytes(path, 400).decode("latin-1")
    if start.lower().startswith("ncols"):
        return True
    lines = [line.replace(",", " ").split() for line in start.splitlines() if line[:1] not in "#>"]
    return len(lines) > 2 and all(
        len(line) == 3 and all(map(_NUMBER.fullmatch, line)) for line in lines[:2]
    )


def read_text_grid(path: Path) -> xr.Dataset:
    """
    Read a grid as a data set with one variable on axes ``lat`` and ``lon``, in the unit of the
    file; NaN where it has no value.

    Raises OceanError if numbers are missing or the points of x, y, z are no grid.
    """
    text = read_text(path, OceanError, what="a grid of numbers")
    lat, lon, values = _esri(text, path) if text.lower().startswith("ncols") else _xyz(text, path)
    data = xr.Dataset({RASTER: (("lat", "lon"), values)}, {"lat": lat, "lon": lon})
    data.encoding = {"source": str(path)}
    return data


def _esri(text: str, path: Path) -> tuple[Array, Array, Array]:
    """Latitudes, longitudes and values of an ESRI ASCII grid, whose first row is the northern."""
    header: dict[str, float] = {}
    rest = text
    while match := re.match(r"\s*([a-z_]+)\s+(\S+)[^\S\n]*\n?", rest, re.IGNORECASE):
        try:
            header[match[1].lower()] = float(match[2])
        except ValueError:
            raise OceanError(f"{path.name}: {match[1]} is {match[2]!r}, no number") from None
        rest = rest[match.end() :]
    missing = [k for k in ("ncols", "nrows", "cellsize") if k not in header]
    if missing or not all({f"{a}llcorner", f"{a}llcenter"} & set(header) for a in "xy"):
        raise OceanError(
            f"{path.name}: the header of an ESRI ASCII grid needs {', '.join(_KEYS)} (corner or"
            f" center); it has {', '.join(header)}"
        )
    shape = int(header["nrows"]), int(header["ncols"])
    try:
        values = np.array(rest.split(), dtype=float)
    except ValueError as error:
        raise OceanError(f"{path.name}: {error}; the grid must contain numbers") from None
    if values.size != shape[0] * shape[1]:
        raise OceanError(
            f"{path.name}: {values.size} numbers, but {shape[0]} rows of {shape[1]} columns are"
            " declared; fetch the file again"
        )
    values = values.reshape(shape)
    values = np.where(values == header.get("nodata_value", np.nan), np.nan, values)
    lon, lat = (
        header.get(f"{a}llcenter", header.get(f"{a}llcorner", 0.0) + 0.5 * header["cellsize"])
        + header["cellsize"] * np.arange(count)
        for a, count in (("x", shape[1]), ("y", shape[0]))
    )
    return np.asarray(lat[::-1]), np.asarray(lon), np.asarray(values)


def _xyz(text: str, path: Path) -> tuple[Array, Array, Array]:
    """
    Latitudes, longitudes and values of lines x, y, z, which cover a grid in any order; of lines y,
    x, z if a comment names them in this order.
    """
    lines = [line for line in text.splitlines() if line.strip() and line[:1] not in "#>"]
    comments = [line for line in text.splitlines() if line[:1] in ("#", ">")]
    try:
        points = np.array([line.replace(",", " ").split() for line in lines], dtype=float)
    except ValueError:
        raise OceanError(f"{path.name}: a line has not three numbers x, y, z; correct it") from None
    east, north = points[:, 0], points[:, 1]
    if any(map(_NORTH_FIRST.match, comments)):
        east, north = north, east
    lon, column = _axis(_in_one_turn(east), path)
    lat, row = _axis(north, path)
    if lat.size * lon.size > 2 * len(points):
        raise OceanError(
            f"{path.name}: {len(points)} points are at {lon.size} different x and {lat.size}"
            " different y, so they are no grid; interpolate them first (gmt surface)"
        )
    values = np.full((lat.size, lon.size), np.nan)
    values[row, column] = points[:, 2]
    twice = (values[row, column] != points[:, 2]) & np.isfinite(points[:, 2])
    if twice.any():
        raise OceanError(
            f"{path.name}: line {lines[int(np.argmax(twice))]!r} has the place of a later line with"
            " another z; keep one of them"
        )
    return lat, lon, values


def _in_one_turn(lon: Array) -> Array:
    """Longitudes without a gap of more than half a turn; coordinates in metres are unchanged."""
    axis = np.unique(lon)
    gaps = np.diff(axis)
    if axis.size < 2 or np.abs(axis).max() > 360.0 or gaps.max() <= 180.0:
        return lon
    return np.where(lon > axis[np.argmax(gaps)], lon - 360.0, lon)


def _axis(values: Array, path: Path) -> tuple[Array, NDArray[np.intp]]:
    """
    Increasing axis of the values, and the index of each.

    A regular axis includes those that no line has, such as a column that is land.
    """
    axis, index = np.unique(np.round(values, _DIGITS), return_inverse=True)
    steps = np.diff(axis)
    if steps.size < 2:
        return axis, index
    step = np.median(steps)
    counts = np.round(steps / step)
    irregular = np.any((counts < 1.0) | (np.abs(steps - counts * step) > _IRREGULAR * step))
    if irregular or counts.max() == 1.0:
        return axis, index
    if counts.sum() > 2.0 * values.size:
        raise OceanError(
            f"{path.name}: {values.size} points are at {axis.size} different coordinates from"
            f" {axis[0]:g} to {axis[-1]:g}, {step:g} apart, so they are no grid; correct them or"
            " interpolate them first (gmt surface)"
        )
    place = np.concatenate([[0.0], np.cumsum(counts)])
    return np.interp(np.arange(place[-1] + 1.0), place, axis), place.astype(np.intp)[index]
