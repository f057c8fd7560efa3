"""
Opening of oceans: files that belong together, data sets in memory, or the name of a synthetic
region.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import xarray as xr

from pymantaray.arrays import Array, Instants
from pymantaray.errors import OceanError
from pymantaray.ocean import cf
from pymantaray.ocean.assemble import ocean_of
from pymantaray.ocean.convert import (
    degrees,
    has_time,
    instants,
    levels,
    listing,
    minute,
    parse_instant,
    pick,
    without_scaled_fill,
)
from pymantaray.ocean.files import (
    IN_MEMORY,
    counted_numbers,
    file_name,
    numbers,
    open_file,
    unreadable,
)
from pymantaray.ocean.names import SYNTHETIC, CurrentsPolicy
from pymantaray.ocean.schema import SEA_FLOOR, VARIABLES, validate_ocean, with_history
from pymantaray.ocean.synthetic import EPOCH, synthetic_axes, synthetic_ocean
from pymantaray.ocean.window import SAME_DEGREES, GeographicWindow, Selection, crop, select

FileSource = str | Path | Sequence[str | Path]
Source = FileSource | xr.Dataset | Sequence[str | Path | xr.Dataset]
Names = Mapping[str, str]
"""CF standard names by variable, for variables without one; a unit may follow in brackets."""
_ROLES = tuple(v.name for v in VARIABLES)
_MAX_LISTED_FILES = 2  # in messages
SYNTHETIC_STEP = np.timedelta64(3, "h")  # as in HYCOM


def open_ocean(
    source: Source,
    *,
    time: str | np.datetime64 | None = None,
    window: GeographicWindow | None = None,
    currents: CurrentsPolicy = "required",
    names: Names | None = None,
    around: GeographicWindow | None = None,
) -> xr.Dataset:
    """
    Open and validate an ocean.

    Parameters
    ----------
    source : str, Path, xarray.Dataset or sequence of them
        A NetCDF file, zarr folder or data set in memory with HYCOM's variables, CF standard names,
        or the names of ROMS, CROCO, NEMO or MOM6; several of these that belong together; or
        ``"synthetic:beaufort"`` or ``"synthetic:fram"``. Axes may have any order and direction. A
        valid ocean written as NetCDF is returned unchanged.
    time : str or numpy.datetime64, optional
        Instant (UTC). Default: the only time of files, NaT for a data set without time; 15 July
        2014, 12 h for synthetic oceans. Data sets without time, and climatologies such as the World
        Ocean Atlas, take any instant: a climatology gives the field that is nearest in the year.
    window : tuple of float, optional
        South, north, west, east. Only grid points inside are read. West may be greater than east,
        across the antimeridian. Default: all grid points. [degrees]
    currents : {"required", "rest"}
        If a data set has no currents: ``"required"`` raises an error, ``"rest"`` sets them to zero.
    names : mapping of str to str, optional
        CF standard names of variables without one, such as ``{"temp":
        "sea_water_potential_temperature"}``. A unit may follow, ``{"temp":
        "sea_water_temperature[degC]"}``.
    around : tuple of float, optional
        Window as which curvilinear grids are interpolated to latitudes and longitudes if ``window``
        is None; it does not affect other grids. Default: the whole grid. [degrees]

    Returns
    -------
    xarray.Dataset
        A valid ocean, see `pymantaray.ocean.validate_ocean`. ``attrs["synthetic"]`` is 1 for a
        synthetic ocean. ``attrs["history"]`` lists conversions, one per line.

    Raises
    ------
    OceanError
        If the source cannot be opened or is not a valid ocean.

    Examples
    --------
    >>> ocean = open_ocean("synthetic:fram", window=(77.5, 78.5, -2.0, 2.0))
    >>> dict(ocean.sizes)
    {'depth': 40, 'lat': 25, 'lon': 51}
    """
    ocean = read_ocean(
        source, time=time, window=window, currents=currents, names=names, around=around
    )
    _validate(ocean, source)
    return ocean


def read_ocean(
    source: Source,
    *,
    time: str | np.datetime64 | None,
    window: GeographicWindow | None,
    currents: CurrentsPolicy,
    names: Names | None = None,
    around: GeographicWindow | None = None,
) -> xr.Dataset:
    """Read and convert an ocean without validation; otherwise as `open_ocean`."""
    sources, region = _sources(source)
    if region is not None:
        return crop(synthetic_ocean(region, EPOCH if time is None else time), window)
    with Collection(sources, window, names, around) as collection:
        collection.needed(currents)
        return collection.ocean_at(time, currents)


def open_ocean_series(
    source: Source,
    start: str | np.datetime64,
    stop: str | np.datetime64,
    *,
    window: GeographicWindow | None = None,
    currents: CurrentsPolicy = "required",
    names: Names | None = None,
    around: GeographicWindow | None = None,
) -> tuple[xr.Dataset, ...]:
    """
    Open the oceans of a source at all instants that enclose a time span.

    Parameters
    ----------
    source, window, currents, names, around
        As in `open_ocean`.
    start, stop : str or numpy.datetime64
        Time span (UTC). The source must cover it.

    Returns
    -------
    tuple of xarray.Dataset
        Valid oceans on one grid in order of time: the last at or before ``start``, the first at or
        after ``stop``, and all between. Synthetic oceans have a step of 3 h.

    Examples
    --------
    >>> from pymantaray.ocean import open_ocean_series
    >>> window = (77.9, 78.1, -0.4, 0.4)
    >>> span = "2014-07-15T13:00", "2014-07-15T14:00"
    >>> series = open_ocean_series("synthetic:fram", *span, window=window)
    >>> [str(ocean["time"].values)[:16] for ocean in series]
    ['2014-07-15T12:00', '2014-07-15T15:00']
    """
    first = parse_instant(start)
    last = parse_instant(stop)
    if last < first:
        raise OceanError(f"ocean: start {start} is after stop {stop}; exchange them")
    sources, region = _sources(source)
    if region is not None:
        origin = first.astype("datetime64[D]").astype("datetime64[ns]")
        begin = origin + (first - origin) // SYNTHETIC_STEP * SYNTHETIC_STEP
        times = np.arange(begin, last + SYNTHETIC_STEP, SYNTHETIC_STEP)
        return tuple(
            crop(synthetic_ocean(region, t), window) for t in _enclosing(times, first, last, region)
        )
    with Collection(sources, window, names, around) as collection:
        if np.isnat(collection.times()).all():
            raise OceanError(
                f"{collection.names}: no time coordinate; an ocean that varies needs one"
            )
        times = _enclosing(collection.whole_times(currents), first, last, collection.names)
        oceans = tuple(collection.ocean(np.datetime64(t), currents) for t in times)
    for ocean in oceans:
        _validate(ocean, source)
        for name in ("depth", "lat", "lon"):
            if not np.array_equal(ocean[name], oceans[0][name]):
                raise OceanError(
                    f"{collection.names}: {name} differs between {oceans[0]['time'].values} and"
                    f" {ocean['time'].values}; a series must have one grid"
                )
    return oceans


def ocean_times(source: Source, names: Names | None = None) -> Instants:
    """
    Instants at which a source has an ocean.

    Parameters
    ----------
    source, names
        As in `open_ocean`.

    Returns
    -------
    ndarray of datetime64, shape (time,)
        Increasing instants (UTC) with temperature and salinity, and with currents if the source has
        any. For a synthetic ocean, which exists at all times: its epoch.

    Examples
    --------
    >>> from pymantaray.ocean import ocean_times
    >>> print(ocean_times("synthetic:fram"))
    ['2014-07-15T00:00:00.000000000']
    """
    sources, region = _sources(source)
    if region is not None:
        return np.array([EPOCH], dtype="datetime64[ns]")
    with Collection(sources, names=names) as collection:
        return collection.whole_times("rest")


class OceanIndex(NamedTuple):
    """Coverage of a source of `open_ocean`, without its fields."""

    lat: Array
    """Increasing. [degrees]"""
    lon: Array
    """Increasing, also across a seam; the middle is in -180 to 180. [degrees]"""
    times: Instants
    """As in `ocean_times`."""
    files: tuple[tuple[str, ...], ...]
    """Files of the source for each of the times."""


def ocean_index(source: Source, names: Names | None = None) -> OceanIndex:
    """Grid and times of a source, and its files for each time."""
    sources, region = _sources(source)
    if region is not None:
        lat, lon = synthetic_axes(region)
        return OceanIndex(lat, lon, ocean_times(source), ((str(sources[0]),),))
    with Collection(sources, names=names) as collection:
        times = collection.whole_times("rest")
        roles = collection.needed("rest")
        holds = [{id(part) for part, _ in collection.at(time, roles).values()} for time in times]
        named = [
            (str(path), id(part)) for path, part in zip(sources, collection.parts, strict=True)
        ]
        files = tuple(tuple(path for path, part in named if part in parts) for parts in holds)
        grid = collection.parts[0].grid
        return OceanIndex(grid.lat, grid.lon, times, files)


def _sources(source: Source) -> tuple[list[str | Path | xr.Dataset], str | None]:
    """Sources as a list, and the name of a synthetic region."""
    sources = [source] if isinstance(source, str | Path | xr.Dataset) else list(source)
    regions = [str(s) for s in sources if isinstance(s, str) and s.startswith(SYNTHETIC)]
    if regions and len(sources) > 1:
        raise OceanError(f"ocean: {regions[0]} cannot be combined with other sources; use it alone")
    return sources, regions[0].removeprefix(SYNTHETIC) if regions else None


def _validate(ocean: xr.Dataset, source: Source) -> None:
    try:
        validate_ocean(ocean)
    except OceanError as error:
        shown = [
            IN_MEMORY if isinstance(s, xr.Dataset) else Path(s).name for s in _sources(source)[0]
        ]
        raise OceanError(f"{_names(shown)}: {error}") from None


def _enclosing(times: Instants, start: np.datetime64, stop: np.datetime64, names: str) -> Instants:
    """Select the instants that enclose a span from increasing instants."""
    low = int(np.searchsorted(times, start, side="right")) - 1
    high = int(np.searchsorted(times, stop, side="left"))
    if low < 0 or high >= len(times):
        there = f"available: {listing(times)}" if len(times) else "no time has all variables"
        raise OceanError(
            f"{names}: does not cover {np.datetime_as_string(start, unit='m')} to"
            f" {np.datetime_as_string(stop, unit='m')}; {there}"
        )
    return times[low : high + 1]


def _names(names: Sequence[str]) -> str:
    return ", ".join(names if len(names) < 5 else [*names[:3], f"... {names[-1]}"])


@dataclass(frozen=True)
class Part:
    """One file of a collection: its layout and the grid points inside the window."""

    data: xr.Dataset
    layout: cf.Layout
    times: Instants
    """One NaT for a file without time."""
    climatology: bool
    """True if times are those of a mean year."""
    grid: Selection
    levels: Array
    """Increasing. [m] or [dbar]"""
    upward: bool
    """True if levels decrease in the file."""
    is_pressure: bool

    @classmethod
    def of(cls, data: xr.Dataset, window: GeographicWindow | None) -> Self:
        """Make a part from an open file."""
        layout = cf.layout_of(data)
        axis, is_pressure = levels(data, layout.depth)
        steps = np.diff(axis)
        if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
            raise OceanError(f"{file_name(data)}: {layout.depth} is not monotonic; sort it")
        upward = bool(steps.size and steps[0] < 0.0)
        lat = degrees(data, layout.lat, "latitude")
        lon = degrees(data, layout.lon, "longitude")
        grid = select(lat, lon, window, file_name(data))
        times = np.array(["NaT"], dtype="datetime64[ns]")
        climatology = False
        if has_time(data, layout.time):
            times, climatology = instants(data, layout.time)
        axis = axis[::-1] if upward else axis
        return cls(data, layout, times, climatology, grid, axis, upward, is_pressure)

    @property
    def timeless(self) -> bool:
        """True if the file has no time."""
        return bool(np.isnat(self.times).all())

    def holds(self, instant: np.datetime64) -> bool:
        """Return True if the file has fields for an instant."""
        return self.timeless or bool(np.any(self.times == instant))

    @property
    def axes(self) -> dict[str, Array]:
        """Increasing axes of the window."""
        return {"depth": self.levels, "lat": self.grid.lat, "lon": self.grid.lon}

    def field(self, role: str) -> cf.Field | None:
        """Variable of a role, or None if the file does not have it."""
        return next((f for f in self.layout.fields if f.role == role), None)

    def read(self, field: cf.Field, instant: np.datetime64) -> tuple[Array, int]:
        """
        Values (depth, lat, lon) of a variable at an instant, in the unit of the file, and the
        number of invalid ones.
        """
        layout = self.layout
        variables = self.data.variables
        dims = variables[field.variable].dims
        lat, lon, depth = (variables[n].dims[0] for n in (layout.lat, layout.lon, layout.depth))
        block = {str(lat): self.grid.rows}
        for time in variables[layout.time].dims if layout.time and not self.timeless else ():
            i = int(np.flatnonzero(self.times == instant)[0])
            block[str(time)] = slice(i, i + 1)
        columns = [
            counted_numbers(self.data, field.variable, {**block, str(lon): c})
            for c in self.grid.blocks
        ]
        whole = np.concatenate([values for values, _ in columns], axis=dims.index(lon))
        invalid = sum(count for _, count in columns)
        whole = np.moveaxis(whole, [dims.index(d) for d in (depth, lat, lon)], (-3, -2, -1))
        whole = whole.reshape(whole.shape[-3:])  # all other dimensions have one element
        whole = self.grid.in_order(whole[:: -1 if self.upward else 1])
        return without_scaled_fill(field.variable, np.ascontiguousarray(whole)), invalid

    def sea_floor(self) -> Array | None:
        """Sea floor (lat, lon) of the model, if the file has it on its axes. [m]"""
        variable = self.data.variables.get(SEA_FLOOR)
        names = tuple(self.data.variables[n].dims[0] for n in (self.layout.lat, self.layout.lon))
        if variable is None or variable.dims != names:
            return None
        columns = [
            numbers(self.data, SEA_FLOOR, {str(names[0]): self.grid.rows, str(names[1]): c})
            for c in self.grid.blocks
        ]
        return self.grid.in_order(np.concatenate(columns, axis=1))


def _part(data: xr.Dataset, window: GeographicWindow | None) -> Part:
    try:
        return Part.of(data, window)
    except Exception as error:  # noqa: BLE001  a damaged file can cause errors of any type
        raise unreadable(file_name(data), error) from None


class Collection:
    """Files that together contain an ocean; they are open until the block ends."""

    def __init__(
        self,
        paths: Sequence[str | Path | xr.Dataset],
        window: GeographicWindow | None = None,
        names: Names | None = None,
        around: GeographicWindow | None = None,
    ) -> None:
        if not paths:
            raise OceanError("ocean: no file; name at least one NetCDF file")
        from pymantaray.ocean.model_ocean import on_geographic_axes

        with ExitStack() as stack:
            data = [open_file(path) for path in paths]
            for one in data:
                stack.callback(one.close)
            cf.with_standard_names(data, names or {})
            data = list(on_geographic_axes(data, window or around))
            self.parts = [_part(one, window) for one in data]
            self.names = _names([file_name(part.data) for part in self.parts])
            missing = [r for r in _ROLES[:2] if not any(p.field(r) for p in self.parts)]
            if missing:
                raise self._lacks(missing)
            self._stack = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def times(self) -> Instants:
        """All instants in the files, increasing; NaT if no file has a time."""
        dated = [part.times for part in self.parts if not part.timeless]
        return np.unique(np.concatenate(dated)) if dated else self.parts[0].times

    def ocean_at(self, time: str | np.datetime64 | None, currents: CurrentsPolicy) -> xr.Dataset:
        """Ocean at a requested time as in `open_ocean`, without validation."""
        times = self.times()
        climatology = any(part.climatology for part in self.parts)
        if not (climatology or np.isnat(times).all()):
            return self.ocean(pick(times, time, self.names), currents)
        if time is None:
            own = pick(times, None, self.names)
            ocean = self.ocean(own, currents)
            return with_history(ocean, f"climatology, for {minute(own)}") if climatology else ocean
        wanted = parse_instant(time)
        own = times[0]
        why = "the data set has no time"
        if climatology:
            distance = _phase(times) - _phase(wanted)
            own = times[np.argmin(np.abs(distance - np.round(distance)))]
            why = f"climatology, for {minute(own)}"
        ocean = self.ocean(own, currents)
        ocean["time"] = ((), wanted, ocean["time"].attrs)
        return with_history(ocean, f"time set to {minute(wanted)}: {why}")

    def whole_times(self, currents: CurrentsPolicy) -> Instants:
        """Increasing instants with all required variables."""
        times = self.times()
        for role in self.needed(currents):
            parts = [part for part in self.parts if part.field(role)]
            if not any(part.timeless for part in parts):
                times = np.intersect1d(times, np.concatenate([part.times for part in parts]))
        return times

    def needed(self, currents: CurrentsPolicy) -> tuple[str, ...]:
        """
        Required variables; with ``currents="rest"``, currents are required only if a file has one
        of them.
        """
        if currents not in ("required", "rest"):
            raise OceanError(f"currents is {currents!r}; allowed: 'required' or 'rest'")
        absent = [r for r in _ROLES[2:] if not any(p.field(r) for p in self.parts)]
        if not absent:
            return _ROLES
        if currents == "required" or len(absent) == 1:
            raise self._lacks(absent)
        return _ROLES[:2]

    def at(self, instant: np.datetime64, roles: Sequence[str]) -> dict[str, tuple[Part, cf.Field]]:
        """File and variable of each role at an instant; all must have one grid."""
        fields: dict[str, tuple[Part, cf.Field]] = {}
        for part in self.parts:
            for role in roles if part.holds(instant) else ():
                field = part.field(role)
                if field is not None and role not in fields:
                    fields[role] = (part, field)
                    _check_same_grid(part, role, *next(iter(fields.items())))
        absent = [r for r in roles if r not in fields]
        if absent:
            raise OceanError(
                f"{self.names}: no {' and no '.join(absent)} at {instant}; select another time"
            )
        return fields

    def ocean(self, instant: np.datetime64, currents: CurrentsPolicy) -> xr.Dataset:
        """Read and convert the ocean at one of the instants, without validation."""
        fields = self.at(instant, self.needed(currents))
        try:
            return ocean_of(fields, instant, self)
        except OceanError as error:
            known = any(str(error).startswith(file_name(part.data)) for part in self.parts)
            raise OceanError(f"{error}" if known else f"{self.names}: {error}") from None

    def _lacks(self, roles: Sequence[str]) -> OceanError:
        relative = [n for p in self.parts for n in p.layout.grid_relative]
        rest = "set the currents to zero with `currents='rest'` (in a study: ocean.currents)"
        if relative and set(roles) <= set(_ROLES[2:]):
            return OceanError(f"{self.names}: {cf.grid_relative_refusal(relative)}, or {rest}")
        listed = [cf.listed_variables(part.data) for part in self.parts[:_MAX_LISTED_FILES]]
        line = (
            f"{self.names}: no {' and no '.join(roles)}; an ocean needs water_temp, salinity,"
            " water_u and water_v, or their CF standard names (for HYCOM the ts3z and uv3z files"
            " together); it contains"
            f" {'; '.join(listed)}"
        )
        return OceanError(
            line + (f"; add them, or {rest}" if list(roles) == list(_ROLES[2:]) else "")
        )


def _phase(time: Instants | np.datetime64) -> Array:
    """Fraction of the year."""
    year = np.asarray(time).astype("datetime64[Y]")
    length = (year + 1).astype("datetime64[ns]") - year.astype("datetime64[ns]")
    return np.asarray((time - year.astype("datetime64[ns]")) / length, dtype=float)


def _check_same_grid(part: Part, role: str, first_role: str, first: tuple[Part, cf.Field]) -> None:
    for name, a in part.axes.items():
        b = first[0].axes[name]
        same = a.shape == b.shape and np.max(np.abs(a - b)) <= SAME_DEGREES
        if not same or part.is_pressure != first[0].is_pressure:
            raise OceanError(
                f"{file_name(part.data)}: {role} and {first_role} have different {name} axes;"
                " interpolate both to one grid"
            )
