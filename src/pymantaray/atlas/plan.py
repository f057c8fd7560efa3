"""What an atlas is of: columns of an ocean at some instants, cut into blocks that can be computed each on its own."""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pymantaray.atlas.column import SPLINE
from pymantaray.atlas.links import AtlasLinks
from pymantaray.errors import AtlasError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.longitude import wrapped
from pymantaray.installation import code_version
from pymantaray.jobs.keys import digest, sha256
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.open import FileSource, OceanIndex, ocean_index
from pymantaray.ocean.seawater import Equation
from pymantaray.ocean.window import GeographicWindow, rectangle, select

Array = NDArray[np.float64]
Times = Sequence[str | np.datetime64] | NDArray[np.datetime64]
_SYNTHETIC = "synthetic:"
_COLUMNS = 16  # of a block, each way; rays of 256 columns take half a minute
_POINTS = 160  # of the grid that a block is spread over, each way, at most
_SPARE = SPLINE + 2  # grid points read beyond the links of a block


@dataclass(frozen=True)
class Block:
    """Some columns at one instant, and all that it takes to do them."""

    key: str
    files: tuple[str, ...]
    """What is read of them: the grid points of a window that the links of all columns fit in."""
    window: GeographicWindow
    time: np.datetime64
    lat: tuple[float, ...]
    lon: tuple[float, ...]
    links: AtlasLinks
    equation: Equation
    sea_floor: str | None
    place: tuple[int, slice, slice]
    """Where it belongs in the atlas: time, latitudes, longitudes."""
    kind: str = "block"
    version: str = field(default_factory=code_version)


class Atlas:
    """
    Columns of a gridded ocean, and the links that are looked at in each.

    Parameters
    ----------
    source : str, Path or sequence of them
        As `pymantaray.ocean.open_ocean` takes it.
    links : AtlasLinks
    window : tuple of float, optional
        South, north, west, east of the columns; water beyond is still read for their links. [degrees]
    every : int
        Every n-th column each way, counted in the source's whole grid.
    times : sequence of str or numpy.datetime64, optional
        Instants (UTC) that the source has; by default its first.
    equation : {"teos-10", "del-grosso", "unesco"}
        Equation of sound speed.
    sea_floor : str or pathlib.Path, optional
        File for `pymantaray.ocean.open_sea_floor`. By default the sea floor is where the ocean's levels end.

    Raises
    ------
    OceanError
        If the source cannot be read.
    AtlasError
        If no column is left, or a time is not there.

    Examples
    --------
    >>> Atlas("synthetic:fram", every=8).shape
    (1, 9, 30)
    """

    def __init__(
        self,
        source: FileSource,
        links: AtlasLinks | None = None,
        *,
        window: GeographicWindow | None = None,
        every: int = 1,
        times: Times | None = None,
        equation: Equation = "teos-10",
        sea_floor: str | Path | None = None,
    ) -> None:
        self.links, self.every, self.equation = links or AtlasLinks(), every, equation
        self.sea_floor = None if sea_floor is None else os.path.realpath(sea_floor)
        self._index: OceanIndex = ocean_index(_resolved(source))
        self.times = _instants(self._index, times)
        lat, lon = self._index.lat, self._index.lon
        if every < 1:
            raise AtlasError(f"every: {every}; allowed are 1, every column, and more")
        rows, columns = np.arange(lat.size), np.arange(lon.size)
        if window is not None:
            part = select(lat, lon, window, "atlas")
            rows = np.flatnonzero(np.isin(lat, part.lat))
            columns = part.columns
            lon = part.lon
        chosen = [np.flatnonzero(n % every == every // 2) for n in (rows, columns)]
        self._rows, self._columns = rows[chosen[0]], columns[chosen[1]]
        self.lat, self.lon = self._index.lat[self._rows], lon[chosen[1]]
        """Of the columns. [degrees]"""
        if not (self.lat.size and self.lon.size):
            raise AtlasError(f"no column is left: every {every} of {rows.size} x {columns.size} grid points")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of instants, latitudes and longitudes."""
        return self.times.size, self._rows.size, self._columns.size

    def cells(self) -> tuple[Array, Array]:
        """Bounds (lat, 2) and (lon, 2) of the cells that the columns stand for. [degrees]"""
        bounds = []
        for axis, own, chosen in (
            (self._index.lat, self.lat, self._rows),
            (self._index.lon, self.lon, self._columns),
        ):
            half = 0.5 * self.every * np.gradient(axis)[chosen]
            bounds.append(np.stack([own - half, own + half], axis=-1))
        return np.clip(bounds[0], -90.0, 90.0), bounds[1]

    def _files(self, time: np.datetime64) -> tuple[str, ...]:
        """Names of what is read of an instant."""
        there = np.flatnonzero(self._index.times == time)
        return self._index.files[int(there[0]) if there.size else 0]

    @cached_property
    def checksums(self) -> dict[str, str]:
        """SHA-256 of every file that is read."""
        files = dict.fromkeys(file for time in self.times for file in self._files(time))
        names = [*files, *([] if self.sea_floor is None else [self.sea_floor])]
        try:
            return {name: sha256(Path(name)) for name in names if not name.startswith(_SYNTHETIC)}
        except OSError as error:
            raise AtlasError(f"{error.filename}: cannot be read: {error.strerror}") from None

    @property
    def key(self) -> str:
        """Name of the whole: the hash of what its blocks are called."""
        return digest("atlas", [block.key for block in self.blocks], {})

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks, by time, latitude and longitude."""
        size = max(1, min(_COLUMNS, _POINTS // self.every))
        rows, columns = ([slice(k, k + size) for k in range(0, n, size)] for n in self.shape[1:])
        tiles = [(r, c, self._reach(self.lat[r], self.lon[c])) for r, c in product(rows, columns)]
        return tuple(self._block(t, *tile) for t in range(self.times.size) for tile in tiles)

    def _block(self, t: int, rows: slice, columns: slice, reach: GeographicWindow) -> Block:
        time, lat, lon = self.times[t], self.lat[rows].tolist(), self.lon[columns].tolist()
        files = self._files(time)
        content = {
            "files": files,
            "sea_floor": self.sea_floor,
            "time": str(time),
            "lat": lat,
            "lon": lon,
            "links": asdict(self.links),
            "equation": self.equation,
        }
        read = {file: self.checksums[file] for file in (*files, self.sea_floor) if file in self.checksums}
        return Block(
            key=digest("block", content, read),
            files=files,
            window=reach,
            time=time,
            lat=tuple(lat),
            lon=tuple(lon),
            links=self.links,
            equation=self.equation,
            sea_floor=self.sea_floor,
            place=(t, rows, columns),
        )

    def _reach(self, lat: Array, lon: Array) -> GeographicWindow:
        """South, north, west and east of the grid points that the links of some columns can need."""
        half = self.links.half_extent
        corners = [
            LocalFrame(y, x).to_geodetic(*rectangle(half, half))
            for y, x in product(lat[[0, -1]].tolist(), lon[[0, -1]].tolist())
        ]
        south, north = (float(f([f(y) for y, _ in corners])) for f in (np.min, np.max))
        west = lon[0] + min(float(np.min(wrapped(x - lon[0]))) for _, x in corners[::2])
        east = lon[-1] + max(float(np.max(wrapped(x - lon[-1]))) for _, x in corners[1::2])
        rows, columns = self._index.lat, self._index.lon
        first, last = np.searchsorted(rows, [south, north])
        south, north = rows[max(first - _SPARE, 0)], rows[min(last + _SPARE, rows.size - 1)]
        margin = _SPARE * float(np.diff(columns).max())
        west, east = west - margin, east + margin
        return float(south), float(north), float(west), float(min(east, west + 360.0))


def _resolved(source: FileSource) -> list[str]:
    """Names of files by which every worker knows them."""
    sources = [source] if isinstance(source, str | Path) else list(source)
    return [str(s) if str(s).startswith(_SYNTHETIC) else os.path.realpath(s) for s in sources]


def _instants(index: OceanIndex, times: Times | None) -> NDArray[np.datetime64]:
    if times is None:
        return index.times[:1]
    if not len(times):
        raise AtlasError("times: there are none; give one or more, or leave them out for the ocean's first")
    instants = np.unique(np.array([parse_instant(time) for time in times]))
    if not index.files[0][0].startswith(_SYNTHETIC):
        absent = instants[~np.isin(instants, index.times)]
        if absent.size:
            shown = np.datetime_as_string(absent[0], unit="m")
            first, last = np.datetime_as_string(index.times[[0, -1]], unit="m")
            raise AtlasError(
                f"time {shown}: not in the ocean, which has {index.times.size} from {first} to {last}"
            )
    return instants


def instants_between(
    source: FileSource, start: str, stop: str, step_h: float | None = None
) -> NDArray[np.datetime64]:
    """Instants (UTC) of a source from one to another, both included, at least so many hours apart; of a synthetic one by default a day."""
    index, first, last = ocean_index(source), parse_instant(start), parse_instant(stop)
    if last < first:
        raise AtlasError(f"times from {start} to {stop}: the last is before the first")
    if step_h is not None and not 1.0 / 3600.0 <= step_h < np.inf:
        raise AtlasError(f"times every {step_h:g} h; allowed are steps of a second and more")
    if index.files[0][0].startswith(_SYNTHETIC):
        step = np.timedelta64(round((24.0 if step_h is None else step_h) * 3600.0), "s")
        return np.arange(first, last + np.timedelta64(1, "ns"), step)
    chosen: list[np.datetime64] = []
    for time in index.times[(index.times >= first) & (index.times <= last)]:
        if not chosen or (time - chosen[-1]) / np.timedelta64(1, "h") >= (step_h or 0.0):
            chosen.append(time)
    if not chosen:
        raise AtlasError(f"no time of the ocean lies in {start} to {stop}")
    return np.array(chosen)


def described(atlas: Atlas) -> bytes:
    """What an atlas is of, for people who find its unfinished blocks."""
    content = {
        "atlas": atlas.key,
        "version": code_version(),
        "files": atlas.checksums,
        "columns": atlas.shape,
        "links": asdict(atlas.links),
    }
    return json.dumps(content, indent=1).encode()
