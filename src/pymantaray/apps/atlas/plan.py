"""
Definition of an atlas: columns of an ocean at several instants, divided into independent blocks.
"""

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
from pymantaray.apps.atlas.links import AtlasLinks
from pymantaray.arrays import Array
from pymantaray.config.door.ocean import MissionOcean, build_mission_ocean
from pymantaray.config.door.sound import SoundOptions, build_sound
from pymantaray.config.door.water import Source, configuration_of
from pymantaray.errors import AtlasError
from pymantaray.geometry import LocalFrame
from pymantaray.geometry.longitude import wrap_longitude
from pymantaray.installation import code_version
from pymantaray.jobs.keys import digest, sha256, values_of
from pymantaray.ocean import stored_ocean
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.names import SYNTHETIC
from pymantaray.ocean.open import FileSource, OceanIndex, ocean_index
from pymantaray.ocean.synthetic import EPOCH
from pymantaray.ocean.window import GeographicWindow, rectangle, select
from pymantaray.records.digits import counted

Times = Sequence[str | np.datetime64] | NDArray[np.datetime64]
SPLINE = 8  # grid points beyond the domain for interpolation
_COLUMNS = 16  # per block and axis; 256 columns take ten seconds
_MAX_POINTS = 160  # grid points per block and axis
_PROFILE_CELL = 0.1  # degrees; size of the cell of a profile
_GRID_MARGIN = SPLINE + 2  # grid points read beyond the links of a block


@dataclass(frozen=True)
class Block:
    """Columns at one instant, with all data for their computation."""

    key: str
    files: tuple[str, ...]
    """Grid points to read: a window that contains the links of all columns."""
    window: GeographicWindow
    time: np.datetime64
    lat: tuple[float, ...]
    lon: tuple[float, ...]
    links: AtlasLinks
    ocean: MissionOcean
    """Sea floor, ice, equation, names and currents of the ocean."""
    sound: SoundOptions
    """Shape of the Earth, and whether currents change travel times."""
    place: tuple[int, slice, slice]
    """Position in the atlas: time, latitudes, longitudes."""
    kind: str = "block"
    version: str = field(default_factory=code_version)


class Atlas:
    """
    Columns of a gridded ocean and their links.

    Parameters
    ----------
    source : str, Path, sequence of them, xarray.Dataset or SoundConfig
        Any source of `pymantaray.open_water` except a medium or a local ocean. A profile or cast
        has one column. A data set in memory is written to the user's cache, because other processes
        read it.
    links : AtlasLinks, optional
        Links. Default: `AtlasLinks` with the bounces, cut-off and interpolation of a configuration.
    window : tuple of float, optional
        South, north, west, east of the columns. Links may use water outside. [degrees]
    every : int
        Use every n-th column along each axis, counted in the source's whole grid.
    times : sequence of str or numpy.datetime64, optional
        Instants (UTC) of the source. Default: its first.
    **options
        Ocean options of `pymantaray.open_water`, such as ``bathymetry``, ``ice``, ``equation``,
        ``names`` and ``currents="carry"``. Default sea floor: the deepest wet levels of the ocean.

    Raises
    ------
    OceanError
        If the source cannot be read.
    AtlasError
        If no column remains, or the source does not have a time.

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
        self.ocean, self.sound = _water_of(source, options)
        self.every = every
        search = self.sound.options
        self.links = links or AtlasLinks(
            max_surface_bounces=search.max_surface_bounces,
            max_bottom_bounces=search.max_bottom_bounces,
            spreading_cutoff_db=search.spreading_cutoff_db,
            interpolation=self.sound.interpolation,
        )
        self._index = _index_of(self.ocean)
        self.times = _instants(self._index, times)
        lat = self._index.lat
        lon = self._index.lon
        if every < 1:
            raise AtlasError(f"every is {every}; it must be at least 1 (every column)")
        rows = np.arange(lat.size)
        columns = np.arange(lon.size)
        if window is not None:
            part = select(lat, lon, window, "atlas")
            rows = np.flatnonzero(np.isin(lat, part.lat))
            columns = part.columns
            lon = part.lon
        chosen = [
            np.flatnonzero(n % every == (every // 2 if n.size > 1 else 0)) for n in (rows, columns)
        ]
        self._rows = rows[chosen[0]]
        self._columns = columns[chosen[1]]
        self.lat, self.lon = self._index.lat[self._rows], lon[chosen[1]]
        """Latitudes and longitudes of the columns. [degrees]"""
        if not (self.lat.size and self.lon.size):
            raise AtlasError(
                f"no column remains: every is {every} for {rows.size} x {columns.size} grid"
                " points; reduce it"
            )

    def __repr__(self) -> str:
        """Source and size of the atlas."""
        times, rows, columns = self.shape
        where = ", ".join(self.ocean.source)
        return (
            f"<Atlas of {where}: {rows} x {columns} columns, {counted(times, 'instant')},"
            f" {self.links.count} links each>"
        )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of instants, latitudes and longitudes."""
        return self.times.size, self._rows.size, self._columns.size

    def cells(self) -> tuple[Array, Array]:
        """Bounds (lat, 2) and (lon, 2) of the cells that the columns represent. [degrees]"""
        bounds = []
        for axis, own, chosen in (
            (self._index.lat, self.lat, self._rows),
            (self._index.lon, self.lon, self._columns),
        ):
            step = np.gradient(axis) if axis.size > 1 else np.array([_PROFILE_CELL])
            half = 0.5 * self.every * step[chosen]
            bounds.append(np.stack([own - half, own + half], axis=-1))
        return np.clip(bounds[0], -90.0, 90.0), bounds[1]

    def _files(self, time: np.datetime64) -> tuple[str, ...]:
        """Files of an instant."""
        there = np.flatnonzero(self._index.times == time)
        return self._index.files[int(there[0]) if there.size else 0]

    @cached_property
    def checksums(self) -> dict[str, str]:
        """SHA-256 of every input file."""
        files = dict.fromkeys(file for time in self.times for file in self._files(time))
        names = [*files, *self.ocean.maps]
        try:
            return {name: sha256(Path(name)) for name in names if not name.startswith(SYNTHETIC)}
        except OSError as error:
            raise AtlasError(f"{error.filename}: cannot be read: {error.strerror}") from None

    @property
    def key(self) -> str:
        """Key of the atlas: a hash of the names of its blocks."""
        return digest("atlas", [block.key for block in self.blocks], {})

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """All blocks in order of time, latitude and longitude."""
        size = max(1, min(_COLUMNS, _MAX_POINTS // self.every))
        rows, columns = ([slice(k, k + size) for k in range(0, n, size)] for n in self.shape[1:])
        tiles = [(r, c, self._reach(self.lat[r], self.lon[c])) for r, c in product(rows, columns)]
        return tuple(self._block(t, *tile) for t in range(self.times.size) for tile in tiles)

    def _block(self, t: int, rows: slice, columns: slice, reach: GeographicWindow) -> Block:
        time = self.times[t]
        lat = self.lat[rows].tolist()
        lon = self.lon[columns].tolist()
        files = self._files(time)
        content = {
            "files": files,
            "time": str(time),
            "lat": lat,
            "lon": lon,
            "links": asdict(self.links),
            "ocean": self.ocean.values,
            "sound": values_of(self.sound),
        }
        read = {
            file: self.checksums[file]
            for file in (*files, *self.ocean.maps)
            if file in self.checksums
        }
        return Block(
            key=digest("block", content, read),
            files=files,
            window=reach,
            time=time,
            lat=tuple(lat),
            lon=tuple(lon),
            links=self.links,
            ocean=self.ocean,
            sound=self.sound,
            place=(t, rows, columns),
        )

    def _reach(self, lat: Array, lon: Array) -> GeographicWindow:
        """South, north, west and east of the grid points that the links of columns may need."""
        if self._index.lat.size == 1:  # a profile, which has no grid
            return float(lat[0]), float(lat[0]), float(lon[0]), float(lon[0])
        half = self.links.half_extent
        corners = [
            LocalFrame(y, x).to_geodetic(*rectangle(half, half))
            for y, x in product(lat[[0, -1]].tolist(), lon[[0, -1]].tolist())
        ]
        south, north = (float(f([f(y) for y, _ in corners])) for f in (np.min, np.max))
        west = lon[0] + min(float(np.min(wrap_longitude(x - lon[0]))) for _, x in corners[::2])
        east = lon[-1] + max(float(np.max(wrap_longitude(x - lon[-1]))) for _, x in corners[1::2])
        rows = self._index.lat
        columns = self._index.lon
        first, last = np.searchsorted(rows, [south, north])
        south = rows[max(first - _GRID_MARGIN, 0)]
        north = rows[min(last + _GRID_MARGIN, rows.size - 1)]
        margin = _GRID_MARGIN * float(np.diff(columns).max())
        west = west - margin
        east = east + margin
        return float(south), float(north), float(west), float(min(east, west + 360.0))


def _water_of(source: Source, options: dict[str, Any]) -> tuple[MissionOcean, SoundOptions]:
    """Ocean and sound of all columns, without places and domains."""
    if isinstance(source, Medium):
        raise AtlasError(
            "a medium has no latitude and longitude, which an atlas needs; give an ocean"
        )
    if isinstance(source, xr.Dataset):
        if "lat" not in source.dims and "north" in source.dims:
            raise AtlasError(
                "a local ocean has no latitude and longitude, which an atlas needs; give the ocean"
                " before to_local"
            )
        source = str(stored_ocean(source))
    config = configuration_of(source, options)
    ocean = build_mission_ocean(config)
    if ocean.in_metres:
        raise AtlasError(
            f"{ocean.source[0]}: water in metres has no latitude and longitude, which an"
            " atlas needs; give an ocean"
        )
    for key, is_there in {
        "time_varying": ocean.time_varying,
        "internal_tide": ocean.has_tide,
    }.items():
        if is_there:
            raise AtlasError(
                f"ocean.{key} does not apply to an atlas; remove it, and select instants with times"
            )
    return ocean, build_sound(config)


def _index_of(ocean: MissionOcean) -> OceanIndex:
    """Columns and instants of an ocean; one column and one instant for a profile."""
    if not ocean.is_profile:
        index = ocean_index(ocean.source, ocean.reading["names"])
        return index._replace(
            times=np.where(np.isnat(index.times), np.datetime64(EPOCH, "ns"), index.times)
        )
    profile = ocean.profile()
    lat, lon = ocean.centre or profile.position or (0.0, 0.0)
    time = np.datetime64(EPOCH, "ns") if np.isnat(profile.time) else profile.time
    return OceanIndex(np.array([lat]), np.array([lon]), np.array([time]), (ocean.source,))


def _instants(index: OceanIndex, times: Times | None) -> NDArray[np.datetime64]:
    if times is None:
        return index.times[:1]
    if not len(times):
        raise AtlasError("times is empty; give at least one, or omit it for the ocean's first")
    instants = np.unique(np.array([parse_instant(time) for time in times]))
    if not index.files[0][0].startswith(SYNTHETIC):
        absent = instants[~np.isin(instants, index.times)]
        if absent.size:
            shown = np.datetime_as_string(absent[0], unit="m")
            first, last = np.datetime_as_string(index.times[[0, -1]], unit="m")
            raise AtlasError(
                f"time {shown}: not in the ocean, which has {index.times.size} from {first} to"
                f" {last}; select one of these"
            )
    return instants


def instants_between(
    source: FileSource, start: str, stop: str, step_h: float | None = None
) -> NDArray[np.datetime64]:
    """
    Instants (UTC) of a source between two instants, inclusive, with a minimum step in hours.

    The default step of a synthetic ocean is one day.
    """
    index = ocean_index(source)
    first = parse_instant(start)
    last = parse_instant(stop)
    if last < first:
        raise AtlasError(
            f"times from {start} to {stop}: the last is before the first; exchange them"
        )
    if step_h is not None and not 1.0 / 3600.0 <= step_h < np.inf:
        raise AtlasError(f"the time step is {step_h:g} h; it must be at least one second")
    if index.files[0][0].startswith(SYNTHETIC):
        step = np.timedelta64(round((24.0 if step_h is None else step_h) * 3600.0), "s")
        return np.arange(first, last + np.timedelta64(1, "ns"), step)
    chosen: list[np.datetime64] = []
    for time in index.times[(index.times >= first) & (index.times <= last)]:
        if not chosen or (time - chosen[-1]) / np.timedelta64(1, "h") >= (step_h or 0.0):
            chosen.append(time)
    if not chosen:
        raise AtlasError(f"the ocean has no time from {start} to {stop}; select another span")
    return np.array(chosen)


def described(atlas: Atlas) -> bytes:
    """Description of an atlas, for people who see its unfinished blocks."""
    content = {
        "atlas": atlas.key,
        "version": code_version(),
        "files": atlas.checksums,
        "columns": atlas.shape,
        "links": asdict(atlas.links),
    }
    return json.dumps(content, indent=1).encode()
