"""
Sections of sound speed by range and depth: tables, Bellhop's ``.ssp`` with its ``.env``, and data
sets with axes ``range`` and ``depth``.
"""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import xarray as xr

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.user_files import first_bytes, read_text

_TABLES = (".csv", ".txt", ".tsv", ".dat")
_HEAD = 20_000  # bytes, of the first row
_LEAST_RANGES = 2
_FINER = 4  # steps of the grid of a turned section per step of its ranges
_MOST_NODES = 400  # of that grid, along each side
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
    rows = first_bytes(path, _HEAD).decode("utf-8-sig", "replace").splitlines()
    if len(rows) < 2:
        return False
    ranges, first = (_numbers(_cells(row)[1:]) for row in rows[:2])
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


def along_bearing(data: xr.Dataset, bearing: float) -> xr.Dataset:
    """
    Data set in metres (north, east, depth) of a section: range 0 is at the origin, and the sound
    speed is uniform across the section.

    ``bearing`` is the direction of the section, clockwise from north [degrees]. Along an axis of
    the frame the ranges are nodes of the grid; otherwise its nodes are four times as dense, with
    linear interpolation between the ranges.
    """
    ranges = np.asarray(data["range"].values, dtype=float)
    farthest = float(np.abs(ranges).max())
    quarter = round(bearing / 90.0)
    if bearing == 90.0 * quarter:
        along, across = ("north", "east") if quarter % 2 == 0 else ("east", "north")
        sign = 1.0 if quarter % 4 in (0, 1) else -1.0
        axis = {along: ("range", sign * ranges)}
        turned = data.assign_coords(axis).swap_dims(range=along).drop_vars("range").sortby(along)
        return turned.expand_dims({across: [-farthest, farthest]})
    step = float(np.diff(ranges).min()) / _FINER  # of the nodes
    count = min(int(np.ceil(2.0 * farthest / step)) + 1, _MOST_NODES)
    nodes = np.linspace(-farthest, farthest, count)
    turn = np.radians(bearing)
    north, east = (xr.DataArray(nodes, {name: nodes}, (name,)) for name in ("north", "east"))
    place = north * np.cos(turn) + east * np.sin(turn)
    # one step beyond the ends continues the section, so that splines have no kink at the ends
    place = place.clip(2.0 * ranges[0] - ranges[1], 2.0 * ranges[-1] - ranges[-2])
    return data.interp(range=place, kwargs={"fill_value": "extrapolate"}).drop_vars("range")


def is_section_data(data: xr.Dataset) -> bool:
    """True if a data set has a sound speed along range and depth."""
    return "sound_speed" in data and set(data["sound_speed"].dims) == {"range", "depth"}


def files_of_section(path: str | Path) -> tuple[str, ...]:
    """A file of a section, and the ``.env`` of an ``.ssp``."""
    own = Path(path)
    return (str(path), str(own.with_suffix(".env"))) if own.suffix == ".ssp" else (str(path),)


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
    lines = read_text(path, OceanError, what="a section of sound speed").splitlines()
    rows = [_cells(line) for line in lines if line.strip()]
    ranges = _numbers(rows[0][1:])
    values = []
    for number, row in enumerate(rows[1:], 2):
        own = _numbers(row)
        if ranges is None or own is None or own.size != ranges.size + 1:
            raise OceanError(
                f"{path.name}: line {number} has {len(row)} cells that are not a depth and"
                f" {len(rows[0]) - 1} sound speeds; correct the line"
            )
        values.append(own)
    table = np.array(values)
    assert ranges is not None  # by is_range_section
    return ranges * (1e3 if "km" in rows[0][0].lower() else 1.0), table[:, 0], table[:, 1:]


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
