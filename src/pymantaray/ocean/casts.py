"""Casts: measured profiles of temperature and salinity, from tables or Argo's files."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import gsw
import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.argo import is_netcdf, read_argo
from pymantaray.ocean.cast import Cast, clean_cast
from pymantaray.ocean.cast_table import CastTable, read_cast_table
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.seawater import in_situ_temperature

__all__ = ["Cast", "place_in_comments", "read_cast", "read_casts"]

Array = NDArray[np.float64]
_NUMBER = r"(-?\d+(?:\.\d+)?)\s*°?\s*"
_LAT = re.compile(rf"\blat(?:itude)?\b\s*[:=]?\s*{_NUMBER}([NS])?\b", re.IGNORECASE)
_LON = re.compile(rf"\blon(?:gitude)?\b\s*[:=]?\s*{_NUMBER}([EW])?\b", re.IGNORECASE)
_DATE = re.compile(r"\b(\d{4}-\d{2}-\d{2})(?:(?:[T/]| +(?=\d{1,2}:))(\d{1,2}):?(\d{2})(?::(\d{2}))?)?")
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTH = re.compile(rf"\b({'|'.join(_MONTHS)})[a-z]*\s+(\d{{4}})\b", re.IGNORECASE)
_BOTTOM = re.compile(r"\bbottom(?:\s+depth)?\s*[:=]?\s*(\d+(?:\.\d+)?)\s*m\b", re.IGNORECASE)
_PACKED_FILL, _PACKED_SCALE, _PACKED_OFFSET = -30_000.0, 0.001, 20.0  # HYCOM's, of both tracers
_PACKED_ABOVE = 100.0  # no temperature or salinity is beyond this


class _Given(NamedTuple):
    lat: float | None
    lon: float | None
    time: str | np.datetime64 | None


def read_cast(
    path: str | Path,
    *,
    lat: float | None = None,
    lon: float | None = None,
    time: str | np.datetime64 | None = None,
    name: str | None = None,
) -> Cast:
    """
    Read the cast that a file holds.

    Parameters
    ----------
    path : str or pathlib.Path
        CSV with named columns (see `read_cast_table`): depth or pressure; temperature, in situ, potential or
        conservative; practical or absolute salinity. HYCOM's point tables from the NetCDF Subset Service,
        also with the packed integers that it delivers. Argo's NetCDF profiles.
    lat, lon : float, optional
        Place; by default of the columns ``lat`` and ``lon`` or a comment as ``# ... lat 74.0, lon -140.0``.
        [degrees]
    time : str or numpy.datetime64, optional
        Instant (UTC); by default of a column or a comment, NaT where neither has one.
    name : str, optional
        If the file holds several: the one to take (its station, or Argo's float and cycle).

    Returns
    -------
    Cast
        Without rows that have a missing or impossible value, lie above the surface, or go no deeper than one
        before them; ``dropped`` counts them and ``notes`` says why.

    Raises
    ------
    OceanError
        If the file is unreadable, a cell is no number, a column or the place is missing, fewer than two
        levels are left, or it holds several casts and none is named.
    """
    found = read_casts(path, lat=lat, lon=lon, time=time)
    named = found if name is None else [cast for cast in found if cast.name == name]
    if len(named) == 1:
        return named[0]
    listing = ", ".join(cast.name for cast in found[:4]) + (", ..." if len(found) > 4 else "")
    if name is not None and not named:
        raise OceanError(f"{path}: no cast {name!r} in it; there is {listing}")
    raise OceanError(f"{path}: holds {len(named or found)} casts ({listing}); choose one by its name")


def read_casts(
    paths: str | Path | Sequence[str | Path],
    *,
    lat: float | None = None,
    lon: float | None = None,
    time: str | np.datetime64 | None = None,
) -> list[Cast]:
    """
    Read all casts of one or more files.

    Parameters
    ----------
    paths : str, pathlib.Path or sequence of them
        As `read_cast` takes. A table with a station column holds a cast for each station, one of the NetCDF
        Subset Service one for each time and place.
    lat, lon, time
        As in `read_cast`, for all casts.

    Returns
    -------
    list of Cast
        In the files' order; at least one.

    Raises
    ------
    OceanError
        As `read_cast` does; one bad cast of a table refuses the table.
    """
    files = [Path(p) for p in ([paths] if isinstance(paths, str | Path) else paths)]
    if not files:
        raise OceanError("casts: no file given; name at least one")
    given = _Given(lat, lon, time)
    casts: list[Cast] = []
    for path in files:
        if is_netcdf(path):
            if (lat, lon, time) != (None, None, None):
                raise OceanError(f"{path}: Argo's profiles have their own places and times; leave these out")
            casts += read_argo(path)
        else:
            table = read_cast_table(path)
            groups = _groups(table)
            casts += [_cast(table.select(rows), station, given) for station, rows in groups.items()]
    return casts


def place_in_comments(comments: Sequence[str]) -> tuple[float, float] | None:
    """
    Latitude and longitude that comment lines name, as in ``lat 74.0, lon -140.0``.

    Parameters
    ----------
    comments : sequence of str

    Returns
    -------
    tuple of float, or None
        The first pair that one line has. [degrees]
    """
    for line in comments:
        north, east = _LAT.search(line), _LON.search(line)
        if north and east:
            return (
                float(north[1]) * (-1.0 if (north[2] or "").upper() == "S" else 1.0),
                float(east[1]) * (-1.0 if (east[2] or "").upper() == "W" else 1.0),
            )
    return None


def _groups(table: CastTable) -> dict[str, list[int]]:
    """Rows of each cast by its name, in the order of the file."""
    keys = [""] * len(table.rows)
    station = table.text("station")
    if table.bracketed and table.has("lat", "lon"):
        times = table.text("time") or keys
        places = zip(times, table.values("lat"), table.values("lon"), strict=True)
        keys = [f"{t} {north:g} {east:g}".strip() for t, north, east in places]
    elif station is not None:
        keys = station
    groups: dict[str, list[int]] = {}
    for i, key in enumerate(keys):
        groups.setdefault(key, []).append(i)
    return groups if len(groups) > 1 or table.text("station") else {"": list(range(len(table.rows)))}


def _cast(table: CastTable, station: str, given: _Given) -> Cast:
    lat, lon = _place(table, given)
    time, notes = _time(table, given.time)
    temperature_kind = _kind(table, "temperature", ("potential_temperature", "conservative_temperature"))
    salinity_kind = _kind(table, "salinity", ("absolute_salinity",))
    values = {q: table.values(q) for q in (temperature_kind, salinity_kind)}
    if table.bracketed and _packed(list(values.values())):
        for q, raw in values.items():
            values[q] = np.where(raw == _PACKED_FILL, np.nan, raw * _PACKED_SCALE + _PACKED_OFFSET)
        notes.append("packed integers of the NetCDF Subset Service unpacked: times 0.001 plus 20")
    vertical = "depth" if table.has("depth") else "pressure"
    if not table.has(vertical):
        raise OceanError(f"{table.path}: lacks depth or pressure; found {', '.join(table.header)}")
    level = table.values(vertical)
    if vertical == "pressure":
        depth = np.asarray(-gsw.z_from_p(level, lat), dtype=float)
        notes.append("depth from pressure by TEOS-10")
    else:
        depth = level
    with np.errstate(all="ignore"):  # rows that are nonsense are dropped below
        converted, told = _converted(values, np.maximum(depth, 0.0), (lat, lon))
    bottom = next((m for line in table.comments if (m := _BOTTOM.search(line))), None)
    return clean_cast(
        name=station or table.path.stem,
        place=(lat, lon),
        time=time,
        profile=(depth, *converted),
        bottom_depth=float(bottom[1]) if bottom else float("nan"),
        notes=notes + told,
        where=str(table.path) + (f", {station}" if station else ""),
    )


def _converted(
    values: dict[str, Array], depth: Array, place: tuple[float, float]
) -> tuple[tuple[Array, Array], list[str]]:
    """In-situ temperature and practical salinity, and how they came about."""
    (temperature_kind, temperature), (salinity_kind, salinity) = values.items()
    lat, lon = place
    pressure = gsw.p_from_z(-depth, lat)
    notes = []
    if salinity_kind == "absolute_salinity":
        salinity = np.asarray(gsw.SP_from_SA(salinity, pressure, lon, lat), dtype=float)
        notes.append("practical from absolute salinity by TEOS-10")
    if temperature_kind == "potential_temperature":
        temperature = in_situ_temperature(temperature, salinity, depth, lat, lon)
        notes.append("in-situ from potential temperature by TEOS-10")
    elif temperature_kind == "conservative_temperature":
        SA = gsw.SA_from_SP(salinity, pressure, lon, lat)
        temperature = np.asarray(gsw.t_from_CT(SA, temperature, pressure), dtype=float)
        notes.append("in-situ from conservative temperature by TEOS-10")
    return (temperature, salinity), notes


def _kind(table: CastTable, plain: str, others: tuple[str, ...]) -> str:
    kind = next((q for q in (plain, *others) if table.has(q)), None)
    if kind is None:
        hint = "; sound speed alone makes a profile for rays, no cast" if table.has("sound_speed") else ""
        raise OceanError(f"{table.path}: lacks {plain}; found {', '.join(table.header)}{hint}")
    return kind


def _packed(columns: list[Array]) -> bool:
    found = np.concatenate([c[np.isfinite(c)] for c in columns])
    return bool(found.size and np.all(found == np.round(found)) and np.abs(found).max() > _PACKED_ABOVE)


def _place(table: CastTable, given: _Given) -> tuple[float, float]:
    if given.lat is not None and given.lon is not None:
        return float(given.lat), float(given.lon)
    if table.has("lat", "lon"):
        places = np.column_stack([table.values("lat"), table.values("lon")])
        known = places[np.all(np.isfinite(places), axis=1)]
        if len(known):
            return float(known[0, 0]), float(known[0, 1])
    place = place_in_comments(table.comments)
    if place is None:
        raise OceanError(
            f"{table.path}: no place; give lat and lon, columns of these names, or a comment '# lat 74.0, lon -140.0'"
        )
    return place


def _time(table: CastTable, given: str | np.datetime64 | None) -> tuple[np.datetime64, list[str]]:
    if given is not None:
        return parse_instant(given), []
    column = table.text("time")
    first = next((cell for cell in column or [] if cell), None)
    if first is not None:
        try:
            return parse_instant(first), []
        except OceanError as error:
            raise OceanError(f"{table.path}, line {table.lines[0]}: {error}") from None
    for line in table.comments:
        if match := _DATE.search(line):
            clock = f"T{int(match[2]):02d}:{match[3]}:{match[4] or '00'}" if match[2] else ""
            return parse_instant(match[1] + clock), ([] if clock else ["time of day unknown: taken as 0 h"])
        if match := _MONTH.search(line):
            month = _MONTHS.index(match[1].lower()[:3]) + 1
            return parse_instant(f"{match[2]}-{month:02d}-01"), [
                f"day unknown: {match[0]} taken as its first"
            ]
    return np.datetime64("NaT", "ns"), ["time unknown"]
