"""
Reader of RBR's ``.rsk`` files, which are SQLite databases, with RBR's library pyrsktools.

The library has no limits, and a database may contain views and generated columns whose values need
any time and memory. The file is therefore checked before the library opens it: its size, the number
of values, and that it consists of ordinary tables.
"""

import sqlite3
import warnings
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from pymantaray.errors import OceanError, optional_package
from pymantaray.messages import one_line
from pymantaray.ocean.cast import CastTable
from pymantaray.ocean.instrument_table import known_unit
from pymantaray.ocean.instruments import AIR_PRESSURE, AIR_PRESSURE_NOTE
from pymantaray.ocean.positions import known_position
from pymantaray.user_files import MAX_BYTES, check_regular

_MAX_VALUES = 12_000_000  # 7 h at 24 Hz with 20 channels
_CHANNELS = {
    "depth": "depth",
    "sea_pressure": "pressure",
    "pressure": "pressure",
    "temperature": "temperature",
    "conductivity": "measured_conductivity",
    "salinity": "salinity",
    "speed_of_sound": "sound_speed",
}
"""
Quantity of each channel of interest by pyrsktools' name of the channel; for one quantity, the first
channel of the file counts.
"""


class _Cast(NamedTuple):
    """Part of a file with one downcast."""

    rows: Any
    place: tuple[float, float] | None
    name: str


def read_rsk(path: Path) -> dict[str, CastTable]:
    """
    Read the downcasts of a file as tables by name; without downcasts in the file, all rows are one
    cast without a name.
    """
    _check(path)
    with optional_package(OceanError, path, "pyrsktools", "rbr"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own imports
        from pyrsktools import RSK
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of missing start times
            with RSK(str(path)) as rsk:
                rsk.readdata()
                units = {channel.longName: str(channel.units or "") for channel in rsk.channels}
                tables = {cast.name: _table(path, cast, units) for cast in _casts(rsk)}
    except Exception as error:  # noqa: BLE001  (the library has no error class of its own)
        raise OceanError(
            f"{path}: not a readable .rsk file: {one_line(error, 100)}; open and save it with"
            " Ruskin"
        ) from None
    return tables


def _check(path: Path) -> None:
    """
    Raise an error for a database that is too large, contains computed values, or has a name that
    SQLite would misread.
    """
    # name and size of the file
    if set("?#%") & set(str(path)):
        raise OceanError(
            f"{path}: the name contains ?, # or %, which SQLite misreads; rename the file"
        )
    check_regular(path, OceanError, what="an .rsk file", limit=MAX_BYTES)
    try:
        with closing(sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True)) as database:
            # contents that SQLite would compute
            computed = database.execute(
                "SELECT name FROM sqlite_master WHERE type = 'view' OR sql LIKE 'CREATE VIRTUAL%'"
                " LIMIT 1"
            ).fetchone()
            tables = [
                row[0]
                for row in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
            ]
            generated = "SELECT name FROM pragma_table_xinfo(?) WHERE hidden <> 0 LIMIT 1"
            computed = computed or next(
                (
                    row
                    for name in tables
                    if (row := database.execute(generated, (name,)).fetchone())
                ),
                None,
            )
            if computed:
                raise OceanError(
                    f"{path}: {one_line(computed[0], 40)} is a view, a virtual table or a generated"
                    " column, which .rsk files do not have; export the cast as text with Ruskin"
                )
            # tables and number of values
            if not {"channels", "data"} <= set(tables):
                raise OceanError(
                    f"{path}: a database without the tables channels and data of an .rsk file; use"
                    " a file from Ruskin"
                )
            (count,) = database.execute("SELECT count(*) FROM data").fetchone()
            width = len(database.execute("PRAGMA table_info(data)").fetchall())
    except (
        sqlite3.Error,
        ValueError,
        TypeError,
    ) as error:  # names that are not UTF-8, and no answer, too
        raise OceanError(
            f"{path}: a damaged database ({one_line(error, 60)}); download it again"
        ) from None
    if count * width > _MAX_VALUES:
        raise OceanError(
            f"{path}: {count:,} rows of {width} columns; the limit is {_MAX_VALUES:,} values;"
            " export one cast with Ruskin"
        )


def _casts(rsk: Any) -> Iterator[_Cast]:
    """Downcasts that Ruskin or the logger marked in a file, or all rows."""
    rows = rsk.data
    positions = [(np.datetime64(g.tstamp), g.latitude, g.longitude) for g in rsk.geoData or ()]
    down = sorted(
        (
            region
            for region in rsk.regions
            if getattr(region, "regionType", None) == "DOWN" and region.type == "CAST"
        ),
        key=lambda region: region.tstamp1,
    )
    parts = [(rows["timestamp"] >= r.tstamp1) & (rows["timestamp"] <= r.tstamp2) for r in down]
    parts = [part for part in parts if part.any()] or [np.ones(rows.size, dtype=bool)]
    for k, part in enumerate(parts):
        place = None
        if positions and part.any():  # the position that is nearest in time to the start of a cast
            start = rows["timestamp"][part][0]
            apart = [abs(time - start) for time, _, _ in positions]
            _, lat, lon = positions[apart.index(min(apart))]
            place = known_position(float(lat), float(lon))[0]
        yield _Cast(rows[part], place, str(k + 1) if len(parts) > 1 else "")


def _table(path: Path, cast: _Cast, units: dict[str, str]) -> CastTable:
    """Columns of known channels of a cast, with sea pressure instead of absolute pressure."""
    rows = cast.rows
    notes = []
    channels = [name for name in _CHANNELS if name in rows.dtype.names]
    absolute = "pressure" in channels and "sea_pressure" not in channels
    if not absolute and "pressure" in channels:
        channels.remove("pressure")
    values = {name: np.asarray(rows[name], dtype=float) for name in channels}
    if absolute:
        values["pressure"] = values["pressure"] - AIR_PRESSURE
        notes.append(AIR_PRESSURE_NOTE)
    time = rows["timestamp"][0] if rows.size else np.datetime64("NaT", "ms")
    return CastTable(
        path,
        tuple(channels),
        pd.DataFrame(dict(enumerate(values.values())), index=np.arange(1, rows.size + 1)),
        [],
        {_CHANNELS[name]: (k, known_unit(units.get(name, ""))) for k, name in enumerate(channels)},
        {},
        bracketed=False,
        instrument="RBR",
        place=cast.place,
        time="" if np.isnat(time) else str(np.datetime_as_string(time, unit="ms")),
        notes=tuple(notes),
    )
