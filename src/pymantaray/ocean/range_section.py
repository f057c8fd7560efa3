"""
Sections of sound speed by range and depth: tables, Bellhop's ``.ssp`` with its ``.env``, and data
sets with axes ``range`` and ``depth``.
"""

import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.interpolate import make_interp_spline

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.geometry.splines import spline_degree
from pymantaray.ocean.local import assemble_local
from pymantaray.user_files import first_bytes, read_text

_TABLES = (".csv", ".txt", ".tsv", ".dat")
_HEAD = 2**20  # bytes, of the first two rows
_LEAST_RANGES = 2
# nodes of the grid of a turned section per shortest step of its ranges; straight lines with kinks
# need more than splines
_FINER_SPLINE, _FINER_LINE = 4, 8
_MOST_VALUES = 2**24  # of that grid
_SPEEDS = (1300.0, 1800.0)  # m/s; limits of a sound speed in water


def is_range_section(path: str | Path) -> bool:
    """
    True for a file named ``.ssp`` and for a table whose first row contains increasing ranges after
    its first cell.
    """
    path = Path(path)
    if path.suffix == ".ssp":
        return True
    if path.suffix not in _TABLES:
        return False
    rows = _rows(first_bytes(path, _HEAD).decode("utf-8-sig", "replace"))
    if len(rows) < 2:
        return False
    ranges, first = (_numbers(row[1:]) for _, row in rows[:2])
    return (
        ranges is not None
        and first is not None
        and _LEAST_RANGES <= ranges.size == first.size
        and bool(np.all(np.diff(ranges) > 0.0))
        and bool(np.all((first > _SPEEDS[0]) & (first < _SPEEDS[1])))
    )


def read_range_section(path: str | Path) -> xr.Dataset:
    """
    Read a section of sound speed.

    Parameters
    ----------
    path : str or Path
        A table: ranges [m] in the first row, depths [m] in the first column; ranges are in
        kilometres if the first cell contains ``km``. Or Bellhop's ``.ssp`` (ranges in km), whose
        depths are those of the ``.env`` of the same name
        (https://oalib-acoustics.org/models-and-software/rays/, ``bellhop.htm``).

    Returns
    -------
    xarray.Dataset
        ``sound_speed`` (range, depth) [m/s]; NaN where the table has no number.

    Raises
    ------
    OceanError
        If rows have different lengths, or axes do not increase.
    """
    path = Path(path)
    read = _read_bellhop if path.suffix == ".ssp" else _read_table
    ranges, depth, speed = read(path)
    for name, axis in (("ranges", ranges), ("depths", depth)):
        falls = [pair for pair in pairwise(axis.tolist()) if not pair[0] < pair[1]]
        if falls or axis.size < 2:
            after = f"{falls[0][1]:g} follows {falls[0][0]:g}" if falls else f"{axis.size} of them"
            raise OceanError(f"{path.name}: {name} must increase, at least two: {after}; sort them")
    return xr.Dataset(
        {"sound_speed": (("range", "depth"), speed.T, {"units": "m/s"})},
        {"range": ranges, "depth": depth},
        {"title": path.name, "source": path.name},
    )


def along_axis(data: xr.Dataset, bearing: float) -> xr.Dataset:
    """
    Data set in metres (north, east, depth) of a section along an axis of the frame: range 0 is at
    the origin, and the sound speed is uniform across the section.

    ``bearing`` is the direction of the section, clockwise from north [degrees]; one between the
    axes is along north here, and `turned` turns the local ocean.
    """
    ranges = np.asarray(data["range"].values, dtype=float)
    farthest = float(np.abs(ranges).max())
    quarter = round(bearing / 90.0) if _is_along_axis(bearing) else 0
    along, across = ("north", "east") if quarter % 2 == 0 else ("east", "north")
    sign = 1.0 if quarter % 4 in (0, 1) else -1.0
    moved = data.assign_coords({along: ("range", sign * ranges)}).swap_dims(range=along)
    return moved.drop_vars("range").sortby(along).expand_dims({across: [-farthest, farthest]})


def turned(
    local: xr.Dataset,
    bearing: float,
    *,
    smooth: bool,
    half_extent: tuple[float, float] | None = None,
) -> xr.Dataset:
    """
    Local ocean of a section along a bearing from one along north; unchanged along an axis.

    Its grid has four nodes per shortest step of the ranges, eight for LINEAR media. The sound speed
    there is on the spline of the medium along the ranges, or linear between them, and the sea floor
    is linear. Travel times through a front of 12 m/s in 1 km are within 0.3 us of those along an
    axis, 2 us in LINEAR media (tests). Beyond its ends the section continues by one step with the
    slope at its end, and is uniform farther out.

    Parameters
    ----------
    local : xarray.Dataset
        Local ocean of the section along north.
    bearing : float
        Clockwise from north. [degrees]
    smooth : bool
        True for the interpolation of smooth media.
    half_extent : tuple of float, optional
        Half sides of the grid, north and east; by default the farthest range. [m]

    Raises
    ------
    OceanError
        If the grid would be too large.
    """
    if _is_along_axis(bearing):
        return local
    ranges, depth = local["north"].values, local["depth"].values
    finer = _FINER_SPLINE if smooth else _FINER_LINE
    step = float(np.diff(ranges).min()) / finer
    sides = half_extent or (float(np.abs(ranges).max()),) * 2
    counts = [math.ceil(2.0 * side / step) + 1 for side in sides]
    if math.prod(counts) * depth.size > _MOST_VALUES:
        raise OceanError(
            f"{local.attrs['title']}: along {bearing:g} degrees, a grid with {finer} nodes in the"
            f" shortest step of its ranges, {finer * step:g} m, has {counts[0]:,} x {counts[1]:,} x"
            f" {depth.size} nodes; allowed are {_MOST_VALUES:,} in all: use a bearing of 0, 90, 180"
            " or 270 degrees, a smaller half_extent or fewer ranges"
        )
    north, east = (np.linspace(-side, side, n) for side, n in zip(sides, counts, strict=True))
    turn = np.radians(bearing)
    place = np.add.outer(north * np.cos(turn), east * np.sin(turn))
    speed = local["sound_speed"].transpose("north", "east", "depth").values[:, 0]
    floor = local["sea_floor_depth"].transpose("north", ...).values[:, 0]
    span = np.ptp(speed, axis=0)
    degree = spline_degree(ranges, speed[:, None], span, axis=0)[0] if smooth else 1
    still = np.zeros((*place.shape, depth.size))
    return assemble_local(
        {"north": north, "east": east, "depth": depth},
        _along(ranges, speed, degree, place),
        (still, still.copy()),
        np.interp(place, ranges, floor),
        local.attrs,
    )


def _is_along_axis(bearing: float) -> bool:
    return bearing % 90.0 == 0.0


def _along(ranges: Array, values: Array, degree: int, place: Array) -> Array:
    """Values (n, ...) of a spline along the ranges at places, continued beyond its ends."""
    spline = make_interp_spline(ranges, values, k=degree)
    within = np.clip(place, ranges[0], ranges[-1])
    first, last = ranges[1] - ranges[0], ranges[-1] - ranges[-2]
    beyond = np.clip(place - within, -first, last)
    result: Array = spline(within) + beyond[..., None] * spline.derivative()(within)
    return result


def is_section_data(data: xr.Dataset) -> bool:
    """True if a data set has a sound speed along range and depth."""
    return "sound_speed" in data and set(data["sound_speed"].dims) == {"range", "depth"}


def files_of_section(path: str | Path) -> tuple[str, ...]:
    """A file of a section, and the ``.env`` of an ``.ssp``."""
    own = Path(path)
    return (str(path), str(own.with_suffix(".env"))) if own.suffix == ".ssp" else (str(path),)


def _rows(text: str) -> list[tuple[int, list[str]]]:
    """Numbers of the lines of a table that are not empty, and their cells."""
    return [(k, _cells(line)) for k, line in enumerate(text.splitlines(), 1) if line.strip()]


def _cells(row: str) -> list[str]:
    """Cells of a row: between commas, semicolons or tabs, or else between spaces."""
    row = row.strip("\r\n")
    return [
        cell.strip()
        for cell in (re.split(r"[,;\t]", row) if re.search(r"[,;\t]", row) else row.split())
    ]


def _numbers(cells: list[str]) -> Array | None:
    """Numbers of cells, NaN for empty ones; None if a cell is something else."""
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        return None


def _read_table(path: Path) -> tuple[Array, Array, Array]:
    rows = _rows(read_text(path, OceanError, what="a section of sound speed"))
    head = rows[0][1] if rows else [""]
    ranges = _numbers(head[1:])
    if ranges is None or len(rows) < 2:
        raise OceanError(
            f"{path.name}: needs ranges [m] in its first row, and rows of a depth [m] and sound"
            " speeds [m/s]"
        )
    values = []
    for number, row in rows[1:]:
        own = _numbers(row)
        if own is None or own.size != ranges.size + 1:
            raise OceanError(
                f"{path.name}: line {number} has {len(row)} cells that are not a depth and"
                f" {len(head) - 1} sound speeds; correct the line"
            )
        values.append(own)
    table = np.array(values)
    return ranges * (1e3 if "km" in head[0].lower() else 1.0), table[:, 0], table[:, 1:]


def _read_bellhop(path: Path) -> tuple[Array, Array, Array]:
    """Ranges, depths and sound speeds (depth, range) of an ``.ssp`` and its ``.env``."""
    words = _without_comments(path).split()
    numbers = _numbers(words)
    count = int(numbers[0]) if numbers is not None and numbers.size else 0
    env = path.with_suffix(".env")
    depth = _env_depths(env)
    if numbers is None or numbers.size < 1 + count * (1 + depth.size):
        raise OceanError(
            f"{path.name}: needs the number of ranges, the ranges [km] and {depth.size} rows of"
            f" sound speeds, one for each depth of {env.name}; it has {len(words)} words"
        )
    speed = numbers[1 + count : 1 + count * (1 + depth.size)].reshape(depth.size, count)
    return 1e3 * numbers[1 : 1 + count], depth, speed


def _env_depths(path: Path) -> Array:
    """Depths of the profile in a Bellhop ``.env``, which ends at the depth of the bottom."""
    lines = [line for line in _without_comments(path).splitlines() if line.strip()]
    try:
        start = 4  # after title, frequency, media and options
        bottom = float(lines[start].split()[2])
        depths: list[float] = []
        for line in lines[start + 1 :]:
            depths.append(float(line.split()[0].rstrip(",/")))
            if depths[-1] >= bottom:
                return np.array(depths)
    except (IndexError, ValueError):
        pass
    raise OceanError(
        f"{path.name}: no profile of depths down to the bottom after title, frequency, number of"
        " media and options; write it as Bellhop reads it"
    )


def _without_comments(path: Path) -> str:
    """Text of a file of Bellhop without what follows ``!``."""
    text = read_text(path, OceanError, what="a file of Bellhop")
    return "\n".join(line.partition("!")[0] for line in text.splitlines())
