"""What an atlas is of: columns of an ocean at some instants, cut into blocks that can be computed each on its own."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.acoustics import Medium
from pymantaray.atlas.column import SPLINE
from pymantaray.atlas.links import AtlasLinks
from pymantaray.config import SoundConfig
from pymantaray.config.sections import OceanSection
from pymantaray.errors import AtlasError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.longitude import wrapped
from pymantaray.installation import code_version
from pymantaray.jobs.keys import digest, sha256
from pymantaray.ocean import stored_ocean
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.open import FileSource, OceanIndex, ocean_index
from pymantaray.ocean.synthetic import EPOCH
from pymantaray.ocean.window import GeographicWindow, rectangle, select
from pymantaray.water import Source
from pymantaray.water.ocean import is_profile
from pymantaray.water.uniform import one_profile
from pymantaray.water.water import configuration_of

Array = NDArray[np.float64]
Times = Sequence[str | np.datetime64] | NDArray[np.datetime64]
_SYNTHETIC = "synthetic:"
_COLUMNS = 16  # of a block, each way; rays of 256 columns take half a minute
_POINTS = 160  # of the grid that a block is spread over, each way, at most
_OF_A_PROFILE = 0.1  # degrees, of the cell that stands for it
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
    water: SoundConfig
    """Sea floor, ice, equation, names and currents of the ocean."""
    place: tuple[int, slice, slice]
    """Where it belongs in the atlas: time, latitudes, longitudes."""
    kind: str = "block"
    version: str = field(default_factory=code_version)


class Atlas:
    """
    Columns of a gridded ocean, and the links that are looked at in each.

    Parameters
    ----------
    source : str, Path, sequence of them, xarray.Dataset or SoundConfig
        Any source of `pymantaray.open_water` except a medium or a local ocean. A profile or cast has one column. A data set in
        memory is written to the user's cache, because other processes read it.
    links : AtlasLinks, optional
        By default those with the bounces, cut-off and interpolation of the source, if it is a configuration.
    window : tuple of float, optional
        South, north, west, east of the columns; water beyond is still read for their links. [degrees]
    every : int
        Every n-th column each way, counted in the source's whole grid.
    times : sequence of str or numpy.datetime64, optional
        Instants (UTC) that the source has; by default its first.
    **options
        Of `pymantaray.open_water` that concern the ocean, such as ``bathymetry``, ``ice``, ``equation``, ``names`` and
        ``currents="carry"``. By default the sea floor is where the ocean's levels end.

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
        source: Source,
        links: AtlasLinks | None = None,
        *,
        window: GeographicWindow | None = None,
        every: int = 1,
        times: Times | None = None,
        **options: Any,
    ) -> None:
        self.water, self.every = _water_config(source, options), every
        self.links = links or _links_of(self.water)
        self._index = _index_of(self.water.ocean)
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
        chosen = [np.flatnonzero(n % every == (every // 2 if n.size > 1 else 0)) for n in (rows, columns)]
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
            step = np.gradient(axis) if axis.size > 1 else np.array([_OF_A_PROFILE])
            half = 0.5 * self.every * step[chosen]
            bounds.append(np.stack([own - half, own + half], axis=-1))
        return np.clip(bounds[0], -90.0, 90.0), bounds[1]

    def _files(self, time: np.datetime64) -> tuple[str, ...]:
        """Names of what is read of an instant."""
        there = np.flatnonzero(self._index.times == time)
        return self._index.files[int(there[0]) if there.size else 0]

    @property
    def _maps(self) -> list[str]:
        """Files of sea floor and ice."""
        return [file for file in (self.water.ocean.bathymetry, self.water.ocean.ice) if isinstance(file, str)]

    @cached_property
    def checksums(self) -> dict[str, str]:
        """SHA-256 of every file that is read."""
        files = dict.fromkeys(file for time in self.times for file in self._files(time))
        names = [*files, *self._maps]
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
            "time": str(time),
            "lat": lat,
            "lon": lon,
            "links": asdict(self.links),
            "ocean": self.water.ocean.model_dump(mode="json", exclude={"source", "time"}),
            "currents": self.water.acoustics.currents,
        }
        read = {file: self.checksums[file] for file in (*files, *self._maps) if file in self.checksums}
        return Block(
            key=digest("block", content, read),
            files=files,
            window=reach,
            time=time,
            lat=tuple(lat),
            lon=tuple(lon),
            links=self.links,
            water=self.water,
            place=(t, rows, columns),
        )

    def _reach(self, lat: Array, lon: Array) -> GeographicWindow:
        """South, north, west and east of the grid points that the links of some columns can need."""
        if self._index.lat.size == 1:  # of a profile, which has no grid
            return float(lat[0]), float(lat[0]), float(lon[0]), float(lon[0])
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


def _water_config(source: Source, options: dict[str, Any]) -> SoundConfig:
    """Configuration of the water of all columns; their places and domains are the atlas' own."""
    if isinstance(source, Medium):
        raise AtlasError(
            "an atlas has columns on latitude and longitude, which a medium has not; give an ocean"
        )
    if isinstance(source, xr.Dataset):
        if "lat" not in source.dims and "north" in source.dims:
            raise AtlasError(
                "an atlas needs an ocean on latitude and longitude; give the one before to_local"
            )
        source = str(stored_ocean(source))
    config = configuration_of(source, options)
    for key in ("time_varying", "internal_tide"):
        if getattr(config.ocean, key):
            raise AtlasError(f"ocean.{key}: an atlas has instants of their own, times; leave it out")
    return config


def _links_of(config: SoundConfig) -> AtlasLinks:
    acoustics = config.acoustics
    return AtlasLinks(
        max_surface_bounces=acoustics.max_surface_bounces,
        max_bottom_bounces=acoustics.max_bottom_bounces,
        spreading_cutoff_db=acoustics.cutoff_db,
        interpolation=acoustics.interpolation,
    )


def _index_of(section: OceanSection) -> OceanIndex:
    """Columns and instants of an ocean; one of each of a profile."""
    if not is_profile(section):
        return ocean_index(section.source, section.standard_names)
    profile = one_profile(section)
    lat, lon = section.centre or profile.position or (0.0, 0.0)
    time = np.datetime64(EPOCH, "ns") if np.isnat(profile.time) else profile.time
    return OceanIndex(np.array([lat]), np.array([lon]), np.array([time]), (section.source,))


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
