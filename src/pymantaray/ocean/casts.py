"""
Casts from tables, instruments, Argo and CF files, and a horizontally uniform ocean at rest from one
cast.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

import gsw
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import MantaRayError, OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.messages import one_line
from pymantaray.ocean import convert
from pymantaray.ocean.argo import ARGO, read_argo
from pymantaray.ocean.cast import Cast, CastTable, clean_cast, read_cast_table
from pymantaray.ocean.cast_folders import is_cast_folder, read_each
from pymantaray.ocean.cast_rows import LevelsError
from pymantaray.ocean.cf_profiles import DATA_SET, holds_profiles, read_cf_profiles
from pymantaray.ocean.convert import DEEPEST, parse_instant
from pymantaray.ocean.files import is_netcdf, open_file
from pymantaray.ocean.instrument_table import written_instant
from pymantaray.ocean.names import Equation
from pymantaray.ocean.positions import Position, known_position, position_in_comment
from pymantaray.ocean.rsk import read_rsk
from pymantaray.ocean.schema import assemble_ocean, latitude, place_text, with_history
from pymantaray.ocean.seawater import sound_speed
from pymantaray.ocean.window import rectangle
from pymantaray.quantities.checks import distinct_digits
from pymantaray.records.digits import counted
from pymantaray.records.text_table import MONTHS
from pymantaray.user_files import exists, first_bytes

Instant = str | np.datetime64
MadeT = TypeVar("MadeT")
_DATE = re.compile(
    r"\b(\d{4}-\d{2}-\d{2})(?:(?:[T/]| +(?=\d{1,2}:))(\d{1,2}):?(\d{2})(?::(\d{2}))?)?"
)
_NUMBERS_FIRST = re.compile(r"\s*\d{1,2}[-/.]\d{1,2}[-/.]\d")
_MONTH = re.compile(rf"\b({'|'.join(MONTHS)})[a-z]*\s+(\d{{4}})\b", re.IGNORECASE)
_BOTTOM = re.compile(r"\bbottom(?:\s+depth)?\s*[:=]?\s*(\d+(?:\.\d+)?)\s*m\b", re.IGNORECASE)
_PACKED_FILL = -30_000.0  # HYCOM's, for both tracers
_PACKED_SCALE = 0.001
_PACKED_OFFSET = 20.0
_PACKED_ABOVE = 100.0  # upper limit of temperature and salinity
_TEMPERATURES = {
    "temperature": convert.IN_SITU,
    "potential_temperature": convert.POTENTIAL,
    "conservative_temperature": convert.CONSERVATIVE,
}
_SALINITIES = {"salinity": convert.PRACTICAL, "absolute_salinity": convert.ABSOLUTE}
_STEPS = (
    (100.0, 2.5),
    (200.0, 5.0),
    (500.0, 10.0),
    (1000.0, 25.0),
    (2000.0, 50.0),
    (12_000.0, 100.0),
)
_MIN_LAST_STEP = 0.5  # fraction of the last step; a level nearer to the bottom is omitted
_POINTS = 9  # along each horizontal axis
_MARGIN = 1.02  # window divided by half extent


def read_cast(
    path: str | Path,
    *,
    lat: float | None = None,
    lon: float | None = None,
    time: Instant | None = None,
    name: str | None = None,
    default_place: tuple[float, float] | None = None,
    repair_freezing: bool = False,
) -> Cast:
    r"""
    Read one cast from a file.

    Parameters
    ----------
    path : str or pathlib.Path
        One of: CSV with named columns (depth or pressure; in-situ, potential or conservative
        temperature; practical or absolute salinity); a point table of HYCOM from the NetCDF Subset
        Service, also with packed integers; a spreadsheet of Ocean Data View; CSV of the World Ocean
        Database; an Argo NetCDF file; profiles of EN4; a CF data set of profiles; in-situ profiles
        of Copernicus; WHP-exchange of a CTD or bottles; a profile of an ice-tethered profiler; an
        instrument's file (Sea-Bird ``.cnv``, Sippican ``.edf``, RBR text or ``.rsk``, CastAway,
        Valeport, AML, SAIV).
    lat, lon : float, optional
        Place. Default: columns ``lat`` and ``lon``, or a comment such as ``# ... lat 74.0, lon
        -140.0``. [degrees]
    time : str or numpy.datetime64, optional
        Instant (UTC). Default: a column or a comment, else NaT.
    name : str, optional
        Name of the cast if the file contains several: its station, or Argo's float and cycle.
    default_place : tuple of float, optional
        Latitude and longitude if the file contains no place. [degrees]
    repair_freezing : bool
        True to raise the salinity of water below its freezing point to the freezing line; a note
        gives the number of levels.

    Returns
    -------
    Cast
        Without rows that have a missing or impossible value, are above the surface, or are not
        deeper than an earlier row. ``dropped`` is the number of these rows and ``notes`` gives the
        reasons.

    Raises
    ------
    OceanError
        If the file is unreadable, a cell is not a number, a column or the place is missing, fewer
        than two levels remain, or the file contains several casts and ``name`` is missing.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.ocean import read_cast
    >>> rows = ["depth,temperature,salinity", "0,4.0,34.0", "200,2.5,35.0", "1000,-0.5,34.9"]
    >>> _ = Path("cast.csv").write_text("\n".join(rows))
    >>> cast = read_cast("cast.csv", lat=78.0, lon=0.0)
    >>> print(cast.sound_speed().round(1))
    [1465.3 1463.4 1463. ]
    """
    where: dict[str, Any] = {"lat": lat, "lon": lon, "time": time, "default_place": default_place}
    casts = read_casts(path, **where, repair_freezing=repair_freezing)
    named = casts if name is None else [cast for cast in casts if cast.name == name]
    if len(named) == 1:
        return named[0]
    listing = ", ".join(cast.name for cast in casts[:4]) + (", ..." if len(casts) > 4 else "")
    if name is not None and not named:
        raise OceanError(f"{path}: no cast {name!r}; available: {listing}")
    raise OceanError(f"{path}: contains {len(named)} casts ({listing}); select one by its name")


def read_casts(
    paths: str | Path | Sequence[str | Path],
    *,
    lat: float | None = None,
    lon: float | None = None,
    time: Instant | None = None,
    default_place: tuple[float, float] | None = None,
    repair_freezing: bool = False,
) -> list[Cast]:
    r"""
    Read all casts of one or more files, in the order of the files.

    Parameters
    ----------
    paths : str, pathlib.Path or sequence of them
        At least one file, as in `read_cast`, or folder or ZIP archive of files. A table with a
        station column contains one cast per station. A table of the NetCDF Subset Service contains
        one cast per time and place. One invalid cast makes the table invalid. Invalid files of a
        folder or archive, and invalid profiles of a data set, are dropped; a note of each cast
        gives their number and the first reason.
    lat, lon, time, default_place, repair_freezing
        As in `read_cast`, for all casts.

    Returns
    -------
    list of Cast

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.ocean import read_casts
    >>> head = "station,depth,temperature,salinity"
    >>> rows = [head, "A,0,4,34", "A,90,3,35", "B,0,4,34", "B,80,3,35"]
    >>> _ = Path("casts.csv").write_text("\n".join(rows))
    >>> [cast.name for cast in read_casts("casts.csv", lat=78.0, lon=0.0)]
    ['A', 'B']
    """
    files = [Path(p) for p in ([paths] if isinstance(paths, str | Path) else paths)]
    if not files:
        raise OceanError("casts: no file; name at least one")
    casts: list[Cast] = []
    place = None if lat is None or lon is None else (float(lat), float(lon))

    def make(station: str, table: CastTable) -> Cast:
        return cast_of_table(table, station, place or cast_place(table) or default_place, time)

    for path in files:
        notes: tuple[str, ...] = ()
        if is_cast_folder(path):
            read = partial(read_casts, lat=lat, lon=lon, time=time, default_place=default_place)
            own, notes = read_each(path, read, OceanError)
        elif holds_argo(path):
            if (lat, lon, time) != (None, None, None):
                raise OceanError(
                    f"{path}: Argo profiles have their own places and times; remove `lat`, `lon`"
                    " and `time`"
                )
            own = read_argo(path)
        else:
            own, notes = each_usable(path, cast_tables(path), make)
        casts += [replace(cast, notes=(*cast.notes, *notes)) for cast in own]
    return [cast.with_repaired_salinity() for cast in casts] if repair_freezing else casts


def each_usable(
    path: Path, tables: Mapping[str, CastTable], make: Callable[[str, CastTable], MadeT]
) -> tuple[list[MadeT], tuple[str, ...]]:
    """
    Casts or profiles of the tables of a file, and a note about those that cannot be used.

    A data set or an archive's file with many profiles usually has some without usable levels. In
    all other files, one of them is an error, as is any other fault in an archive's file.
    """
    one, many = next(iter(tables.values())), len(tables) > 1
    accepted: tuple[type[MantaRayError], ...] = (MantaRayError,)
    if not (many and one.instrument == DATA_SET):
        accepted = (LevelsError,) if many and one.labelled else ()
    made: list[MadeT] = []
    refused: list[MantaRayError] = []
    for name, table in tables.items():
        try:
            made.append(make(name, table))
        except accepted as error:
            refused.append(error)
    if refused and not made:
        raise refused[0]
    if not refused:
        return made, ()
    first = one_line(str(refused[0]).removeprefix(f"{path}"), 160).lstrip(":, ")
    return made, (f"{len(refused)} of {len(tables)} profiles dropped, the first: {first}",)


def holds_casts(path: str | Path) -> bool:
    r"""
    Return True if a source is a file for `read_casts`, not a gridded or synthetic ocean.

    Parameters
    ----------
    path : str or pathlib.Path
        A file, a zarr folder or the name of a synthetic ocean.

    Returns
    -------
    bool
        True for a table, an instrument's file, Argo profiles, a CF data set of profiles, and a
        folder or archive of such files.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.ocean import holds_casts
    >>> _ = Path("cast.csv").write_text("depth,temperature,salinity\n0,4.0,34.0\n200,2.5,35.0\n")
    >>> holds_casts("cast.csv"), holds_casts("synthetic:fram")
    (True, False)
    """
    if str(path).startswith("synthetic:"):
        return False
    if exists(path) and Path(path).is_dir():
        return is_cast_folder(path)
    if not is_netcdf(Path(path)):
        return True
    with open_file(path) as data:
        return bool(ARGO & data.variables.keys()) or holds_profiles(data)


def cast_tables(path: Path) -> dict[str, CastTable]:
    """Casts of a text file, an ``.rsk`` file or a CF data set of profiles, as tables by name."""
    if first_bytes(path, 15) == b"SQLite format 3":
        return read_rsk(path)
    return read_cf_profiles(path) if is_netcdf(path) else read_cast_table(path).casts()


def holds_argo(path: str | Path) -> bool:
    """
    Return True if a file is NetCDF, but not a CF data set of profiles: a file of Argo or EN4, or a
    file that `read_argo` rejects.
    """
    if not is_netcdf(Path(path)):
        return False
    with open_file(path) as data:
        argo = "N_PROF" in data.sizes and bool(ARGO & data.variables.keys())
        return argo or not holds_profiles(data)


def cast_of_table(
    table: CastTable, station: str, place: tuple[float, float] | None, time: Instant | None
) -> Cast:
    """Convert a table with one cast; a missing place or quantity raises an error."""
    where = str(table.path) + (f", {station}" if station not in ("", table.path.stem) else "")
    if place is None:
        raise OceanError(
            f"{where}: no place{unread_position(table)}; give lat and lon, add columns of"
            " these names, or a comment '# lat 74.0, lon -140.0'"
        )
    lat, lon = place
    table = _with_salinity(table, lat)
    instant, notes = cast_time(table) if time is None else (parse_instant(time), [])
    notes = [*table.notes, *notes]
    # temperature and salinity, which may be packed
    kinds = _kind(table, _TEMPERATURES), _kind(table, _SALINITIES)
    values = [table.values(kind) for kind in kinds]
    numbers = np.concatenate(values)
    numbers = numbers[np.isfinite(numbers)]
    is_whole = bool(np.all(numbers == np.round(numbers)))
    if table.bracketed and is_whole and np.abs(numbers).max(initial=0.0) > _PACKED_ABOVE:
        values = [
            np.where(raw == _PACKED_FILL, np.nan, raw * _PACKED_SCALE + _PACKED_OFFSET)
            for raw in values
        ]
        notes.append("packed integers of the NetCDF Subset Service unpacked: times 0.001 plus 20")
    # in-situ temperature and practical salinity at their depths
    depth, depth_notes = cast_depth(table, lat)
    notes += depth_notes
    with np.errstate(all="ignore"):  # impossible rows are dropped below
        pressure = gsw.p_from_z(-np.maximum(depth, 0.0), lat)
    temperature, salinity = convert.to_in_situ_and_practical(
        (values[0][:, None, None], _TEMPERATURES[kinds[0]]),
        (values[1][:, None, None], _SALINITIES[kinds[1]]),
        pressure[:, None, None],
        np.array([lat]),
        np.array([lon]),
    )
    for kind, plain in zip(kinds, ("in-situ", "practical"), strict=True):
        if kind not in ("temperature", "salinity"):
            notes.append(f"{plain} from {kind.replace('_', ' ')} by TEOS-10")
    bottom = next((m for line in table.comments if (m := _BOTTOM.search(line))), None)
    return clean_cast(
        station or table.path.stem,
        place,
        instant,
        (depth, temperature[:, 0, 0], salinity[:, 0, 0]),
        bottom_depth=float(bottom[1]) if bottom else float("nan"),
        notes=notes,
        titles={"temperature": table.title(kinds[0]), "salinity": table.title(kinds[1])},
        where=where,
    )


def cast_depth(table: CastTable, lat: float | None) -> tuple[Array, list[str]]:
    """
    Depth of each row [m], and notes.

    With a latitude, the pressure of an instrument or a data set has priority over its depth, which
    programs compute from pressure with a latitude and a density of their own. In other tables,
    depth has priority.
    """
    if not (table.has("depth") or table.has("pressure")):
        raise OceanError(f"{table.path}: no depth or pressure; {table.listing}")
    pressure = (
        table.values("pressure")
        if table.has("pressure") and lat is not None
        else np.array([np.nan])
    )
    computed = not table.has("depth") or (table.instrument and np.isfinite(pressure).any())
    if not computed:
        return table.values("depth"), []
    with np.errstate(all="ignore"):
        depth = np.asarray(-gsw.z_from_p(pressure, lat), dtype=float)
        notes = ["depth from pressure by TEOS-10"]
        if table.has("depth"):
            change = np.abs(table.values("depth") - depth)
            if np.isfinite(change).any():
                notes[0] += f"; the file's own depth differs by up to {np.nanmax(change):.3g} m"
    return depth, notes


def _with_salinity(table: CastTable, lat: float) -> CastTable:
    """Add practical salinity from conductivity to a table that has no salinity."""
    if not table.has("measured_conductivity", "temperature") or any(
        table.has(kind) for kind in _SALINITIES
    ):
        return table
    if table.has("pressure"):
        pressure = table.values("pressure")
    elif table.has("depth"):
        pressure = np.asarray(
            gsw.p_from_z(-np.maximum(table.values("depth"), 0.0), lat), dtype=float
        )
    else:
        return table
    with np.errstate(all="ignore"):  # impossible rows are dropped later
        salinity = gsw.SP_from_C(
            table.values("measured_conductivity"), table.values("temperature"), pressure
        )
    place = len(table.header)
    return replace(
        table,
        header=(*table.header, "salinity"),
        rows=table.rows.assign(salinity=np.asarray(salinity, dtype=float)).set_axis(
            range(place + 1), axis=1
        ),
        columns={**table.columns, "salinity": (place, "1")},
        notes=(*table.notes, "salinity from conductivity by PSS-78"),
    )


def has_water(table: CastTable) -> bool:
    """True if a table has a temperature and a salinity, or conductivity instead."""
    salty = (*_SALINITIES, "measured_conductivity")
    return any(map(table.has, _TEMPERATURES)) and any(map(table.has, salty))


def _kind(table: CastTable, kinds: dict[str, str]) -> str:
    kind = next((kind for kind in kinds if table.has(kind)), None)
    if kind is None:
        hint = (
            "; with sound speed alone it is a profile for rays, not a cast"
            if table.has("sound_speed")
            else ""
        )
        raise OceanError(f"{table.path}: no {next(iter(kinds))}; {table.listing}{hint}")
    return kind


def cast_place(table: CastTable) -> Position | None:
    """
    Latitude and longitude of a cast from its columns, else from its comments, else None. [degrees]
    """
    return cast_position(table)[0]


def cast_position(table: CastTable) -> tuple[Position | None, tuple[str, ...]]:
    """
    Position of a cast as in `cast_place`, and a note if the positions of its columns are not used.
    """
    notes: tuple[str, ...] = ()
    if table.place is not None:
        return table.place, notes
    if table.has("lat", "lon"):
        places = np.column_stack([table.values("lat"), table.values("lon")])
        known = [
            known_position(*place) for place in places[np.all(np.isfinite(places), axis=1)].tolist()
        ]
        used = [place for place, _ in known if place is not None]
        if used:
            return used[0], notes
        notes = known[0][1] if known else notes
    return next(filter(None, map(position_in_comment, table.comments)), None), notes


def unread_position(table: CastTable) -> str:
    """
    Reason why a file's own position is not used, in parentheses for an error; empty without a
    reason.
    """
    reasons = [
        note for note in (*table.notes, *cast_position(table)[1]) if note.startswith("position ")
    ]
    return f" ({reasons[0]})" if reasons else ""


def cast_time(table: CastTable) -> tuple[np.datetime64, list[str]]:
    """Time of a cast from its column, else from its comments, else NaT; and notes about it."""
    first = table.time or next((cell for cell in table.text("time") or [] if cell), None)
    if first is not None:
        iso, notes = first, list[str]()
        if not table.time and _NUMBERS_FIRST.match(first):
            iso, notes = written_instant(first)
        where = "" if table.time else f" (line {table.lines[0]})"
        return _instant_or_note(iso, notes, f"{first[:40]!r}{where}")
    for line in table.comments:
        if match := _DATE.search(line):
            clock = f"T{int(match[2]):02d}:{match[3]}:{match[4] or '00'}" if match[2] else ""
            notes = [] if clock else ["time of day unknown: 0 h assumed"]
            return _instant_or_note(match[1] + clock, notes, repr(match[1] + clock))
        if match := _MONTH.search(line):
            month = MONTHS[match[1].lower()[:3]]
            note = f"day unknown: the first of {match[0]} assumed"
            return parse_instant(f"{match[2]}-{month:02d}-01"), [note]
    return np.datetime64("NaT", "ns"), ["time unknown"]


def _instant_or_note(iso: str, notes: list[str], shown: str) -> tuple[np.datetime64, list[str]]:
    """Instant and notes, or NaT and a note about a text that is none."""
    try:
        return parse_instant(iso), notes
    except OceanError:
        return np.datetime64("NaT", "ns"), [f"time {shown} not read; time unknown"]


def cast_levels(bottom_depth: float) -> Array:
    """
    Levels that resolve the ducts of a cast but not its noise, wider with depth; the last level is
    the bottom. [m]
    """
    levels = [0.0]
    for until, step in _STEPS:
        while levels[-1] < until and levels[-1] + (1.0 + _MIN_LAST_STEP) * step <= bottom_depth:
            levels.append(levels[-1] + step)
    return np.array([*levels, float(bottom_depth)])


def cast_ocean(
    cast: Cast,
    *,
    bathymetry: float | None = None,
    half_extent: tuple[float, float] = (60e3, 60e3),
    levels: ArrayLike | None = None,
    below: Literal["refuse", "constant"] | Cast = "refuse",
    time: Instant | None = None,
    equation: Equation = "teos-10",
) -> xr.Dataset:
    """
    Make a horizontally uniform ocean at rest from one cast.

    Parameters
    ----------
    cast : Cast
        Temperature and salinity.
    bathymetry : float, optional
        Depth of the flat sea bed, which is the deepest level. Default: the bottom depth of the
        cast. [m]
    half_extent : tuple of float
        Half sides (north, east) of a rectangle around the cast. The window contains this rectangle.
        [m]
    levels : array_like, shape (n,), optional
        Depths, strictly increasing from 0. One level at the bottom replaces all levels at or below
        the bottom. Default: `cast_levels`. [m]
    below : {"refuse", "constant"} or Cast
        Water between the deepest sample and the bottom. ``"refuse"``: an error. ``"constant"``:
        temperature and salinity of the deepest sample, so sound speed increases with pressure
        alone. A deeper cast: its samples below this cast.
    time : str or numpy.datetime64, optional
        Instant (UTC) of the ocean. Default: the time of the cast, NaT if it is unknown.
    equation : str
        Equation of the sound-speed change that the history reports.

    Returns
    -------
    xarray.Dataset
        A valid ocean. Its history reports the change of sound speed due to averaging (rms and
        maximum over the samples), the extensions up and down, and that the water is at rest.

    Raises
    ------
    OceanError
        If the bottom is unknown, the bottom is deeper than the samples and ``below`` is
        ``"refuse"``, a level is invalid, or the window extends over a pole.

    Notes
    -----
    Temperature and salinity are averaged over the cell of each level (`Cast.cell_means`). They are
    constant above the shallowest sample. They are uniform at a constant depth. Sound speed varies
    by a few mm/s over 100 km, because pressure at a depth and the composition of sea water depend
    on the place.

    Examples
    --------
    Continues the example of `pymantaray.ocean`:

    >>> from pymantaray.ocean import cast_ocean
    >>> uniform = cast_ocean(cast, bathymetry=1000.0, half_extent=(5e3, 5e3))
    >>> dict(uniform.sizes), float(uniform["water_temp"][0, 0, 0])
    ({'depth': 111, 'lat': 9, 'lon': 9}, 3.9875)
    """
    bottom = cast.bottom_depth if bathymetry is None else float(bathymetry)
    if not cast.depth[0] < bottom <= DEEPEST:
        raise OceanError(
            f"cast {cast.name}: the bathymetry is {bottom:g} m; it must be deeper than the first"
            f" sample ({cast.depth[0]:g} m) and at most {DEEPEST:g} m; give the depth of the sea"
            " bed as bathymetry"
        )
    instant = cast.time if time is None else parse_instant(time)
    z, level_notes = _levels(cast, levels, bottom)
    full, extensions = _extended(cast, bottom, below)
    temperature, salinity = full.cell_means(z)
    lat, lon = _axes(cast, half_extent)
    columns = {"water_temp": temperature, "salinity": salinity}
    columns |= dict.fromkeys(("water_u", "water_v"), 0.0 * z)
    shape = (z.size, lat.size, lon.size)
    ocean = assemble_ocean(
        {"depth": z, "lat": lat, "lon": lon},
        instant,
        {name: np.broadcast_to(c[:, None, None], shape).copy() for name, c in columns.items()},
        title=f"Cast {cast.name}",
        source=f"one cast at {place_text(cast.lat, cast.lon)}, horizontally uniform",
        synthetic=False,
    )
    t, s = (np.interp(cast.depth, z, column) for column in (temperature, salinity))
    cell_means = sound_speed(t, s, cast.depth, cast.lat, cast.lon, equation=equation)
    change = cell_means - cast.sound_speed(equation)
    change = change[cast.depth <= bottom]
    averaging = (
        f"cast {cast.name}: {cast.depth.size} samples averaged onto {z.size} levels, sound speed"
        f" changed by {np.sqrt(np.mean(change**2)):.2g} m/s rms, {np.abs(change).max():.2g} m/s"
        " maximum"
    )
    rest = "horizontally uniform, currents at rest"
    for line in (*cast.notes, averaging, *level_notes, *extensions, rest):
        ocean = with_history(ocean, line)
    return ocean


def _levels(cast: Cast, levels: ArrayLike | None, bottom: float) -> tuple[Array, list[str]]:
    if levels is None:
        return cast_levels(bottom), []
    z = np.asarray(levels, dtype=float)
    if z.ndim != 1 or z.size < 2 or z[0] != 0.0 or not np.all(np.diff(z) > 0.0):
        raise OceanError(f"cast {cast.name}: levels must strictly increase from 0 m")
    deeper = int(np.count_nonzero(z > bottom))
    notes = (
        [f"{counted(deeper, 'level')} below the bottom at {bottom:g} m removed"] if deeper else []
    )
    if bottom not in z:
        notes.append(f"level added at the bottom, {bottom:g} m")
    return np.append(z[z < bottom], bottom), notes


def _extended(
    cast: Cast, bottom: float, below: Literal["refuse", "constant"] | Cast
) -> tuple[Cast, list[str]]:
    notes = []
    at_constant = "at constant temperature and salinity"
    if cast.depth[0] > 0.0:
        notes.append(f"extended from {cast.depth[0]:.4g} m up to the surface {at_constant}")
    last = float(cast.depth[-1])
    if bottom <= last:
        return cast, notes
    # water below the cast: that of another cast, or a constant
    if isinstance(below, Cast):
        deeper = below.depth > last
        if not deeper.any():
            end, of_other = distinct_digits(below.depth[-1], last)
            raise OceanError(
                f"cast {below.name}: ends at {end} m, which is not below the end of {cast.name} at"
                f" {of_other} m; name a deeper cast"
            )
        warmer, saltier = (
            float(np.interp(last, below.depth, theirs) - ours[-1])
            for theirs, ours in (
                (below.temperature, cast.temperature),
                (below.salinity, cast.salinity),
            )
        )
        notes.append(
            f"below {last:.6g} m from cast {below.name}, which differs there by {warmer:+.2g} degC"
            f" and {saltier:+.2g} in salinity"
        )
        cast = replace(
            cast,
            depth=np.append(cast.depth, below.depth[deeper]),
            temperature=np.append(cast.temperature, below.temperature[deeper]),
            salinity=np.append(cast.salinity, below.salinity[deeper]),
        )
        last = float(cast.depth[-1])
    elif below == "refuse":
        sample, bed = distinct_digits(last, bottom)
        raise OceanError(
            f"cast {cast.name}: its deepest sample at {sample} m is above the bottom at {bed} m;"
            " give a bottom depth of"
            f" {np.floor(last):g} m, or the water below with `below`: constant, or a"
            " deeper cast"
        )
    elif below != "constant":
        raise OceanError(f"below is {below!r}; allowed: 'refuse', 'constant' or a cast")
    if bottom > last:
        notes.append(
            f"extended from {last:.6g} m down to the bottom at {bottom:.6g} m {at_constant}"
        )
    return cast, notes


def _axes(cast: Cast, half_extent: tuple[float, float]) -> tuple[Array, Array]:
    """Latitudes and longitudes around the cast; their window contains the rectangle."""
    north, east = (float(h) for h in half_extent)
    if not (0.0 < north < 5e6 and 0.0 < east < 5e6):
        raise OceanError(
            f"half_extent is {half_extent} m; both half sides must be positive and below 5000 km"
        )
    frame = LocalFrame(cast.lat, cast.lon)
    lat, lon = frame.to_geodetic(*rectangle(north, east))
    half_lat = _MARGIN * float(np.abs(lat - cast.lat).max())
    half_lon = _MARGIN * float(np.abs(lon - frame.longitude_deg).max())
    if abs(cast.lat) + half_lat > 90.0 or half_lon >= 179.0:
        raise OceanError(
            f"cast {cast.name}: a window of +-{north / 1e3:g} by {east / 1e3:g} km around"
            f" {latitude(cast.lat)} extends over the pole; give a smaller"
            " `half_extent`"
        )
    s = np.linspace(-1.0, 1.0, _POINTS)
    return cast.lat + half_lat * s, frame.longitude_deg + half_lon * s
