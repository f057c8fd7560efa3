"""Reader of tables of trajectories with one pose per row: CSV and similar text, and Parquet."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from pymantaray.arrays import AnyArray, Array
from pymantaray.errors import (
    ExchangeError,
    RecordError,
    SensingError,
    errors_as,
    optional_package,
)
from pymantaray.exchange.centre import centre_in_comments
from pymantaray.exchange.tracks import Poses, about_down, level
from pymantaray.records.dates import seconds_since
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.position_rows import distances, missing_fixes
from pymantaray.records.status import TRUTH
from pymantaray.records.text_table import TextTable, read_text_table
from pymantaray.sensing.schedule import PingList
from pymantaray.user_files import MAX_UNPACKED_BYTES

_METRES = {"": 1.0, "m": 1.0, "km": 1000.0}
_DEPTHS = _METRES | {"cm": 0.01, "mm": 0.001, "ft": 0.3048, "feet": 0.3048}
_DECIBARS = {"dbar": 1.0, "bar": 10.0, "kpa": 0.1, "mpa": 100.0, "pa": 1e-4, "psi": 0.6894757293168}
_IN_DEGREES = 180.0 / np.pi
_DEGREES = {
    "": 1.0,
    "deg": 1.0,
    "degrees": 1.0,
    **dict.fromkeys(("rad", "radians"), _IN_DEGREES),
}
_ANGLE = {"": 1.0, "rad": 1.0, "radians": 1.0, "deg": np.pi / 180.0, "degrees": np.pi / 180.0}
_NO_UNIT = {"": 1.0}
# by quantity: names of columns, and units behind them, as in depth_m, "depth [m]" or heading_deg
_COLUMNS: dict[str, tuple[str, dict[str, float]]] = {
    "time": ("time timestamp datetime", {"": 1.0, "s": 1.0}),
    "vehicle": ("vehicle name agent platform", _NO_UNIT),
    "lat": ("lat latitude", _DEGREES),
    "lon": ("lon longitude", _DEGREES),
    "north": ("north", _METRES),
    "east": ("east", _METRES),
    "depth": ("depth down", _DEPTHS),
    "pressure": ("pressure depth", _DECIBARS),
    "qw": ("qw", _NO_UNIT),
    "qx": ("qx", _NO_UNIT),
    "qy": ("qy", _NO_UNIT),
    "qz": ("qz", _NO_UNIT),
    "heading": ("heading yaw", _ANGLE),
    "pitch": ("pitch", _ANGLE),
    "roll": ("roll", _ANGLE),
    "convergence": ("convergence", _ANGLE),
    "transmitter": ("transmitter", _NO_UNIT),
    "receivers": ("receivers receiver", _NO_UNIT),
}
_TITLES = {
    f"{name}_{unit}".rstrip("_"): (column, factor)
    for column, (names, units) in _COLUMNS.items()
    for name in names.split()
    for unit, factor in units.items()
}
_UNITS = {
    name: [
        unit
        for others, units in _COLUMNS.values()
        for unit in units
        if unit and name in others.split()
    ]
    for names, _ in _COLUMNS.values()
    for name in names.split()
}
_LATITUDE_UNIT = re.compile(r"lat(itude)?[\W_]+(deg|rad)", re.IGNORECASE)
_IN_BRACKETS = re.compile(r"(\w+)\s*[\[(](.*)[\])]")
_QUATERNION = ["qw", "qx", "qy", "qz"]
_ANGLES = ["heading", "pitch", "roll"]
_OF_PINGS = "time", "transmitter", "receivers"
_IN_MEMORY = "data frame"
_MAX_RADIANS = 6.5  # slightly more than 2 pi
_SAME_PLACE = 100.0  # m, above the motion of a vehicle within the resolution of its times


@errors_as(ExchangeError, RecordError)
def read_table(path: Path) -> tuple[list[Poses], list[str]]:
    """
    Read the trajectories of a table with a header, and a note about unused columns.

    There is one trajectory per name of a vehicle. Without a column of names, there is one with the
    name of the file.
    """
    invalid = InvalidLines()
    if path.suffix.lower() == ".parquet":
        return _trajectories(_parquet(path), invalid)
    return _trajectories(read_text_table(path, invalid=invalid), invalid)


@errors_as(ExchangeError, RecordError)
def read_frame(frame: pd.DataFrame) -> tuple[list[Poses], list[str]]:
    """As `read_table`, for a data frame with the columns of a table; rows are counted from 1."""
    if frame.empty:
        raise ExchangeError(f"{_IN_MEMORY}: no rows; a trajectory needs at least two")
    return _trajectories(_typed_table(Path(_IN_MEMORY), frame), InvalidLines())


def _trajectories(table: TextTable, invalid: InvalidLines) -> tuple[list[Poses], list[str]]:
    """
    Poses of each vehicle in a table, and notes about unused columns and lines that are left out.
    """
    path = table.path
    in_degrees = any(map(_LATITUDE_UNIT.match, table.frame.columns))
    table, factors = _known_columns(table)
    conditions = table.frame.get("condition")
    there = set(factors)
    unread = [title for title in table.frame.columns if title not in there]
    # an exported run: ignore its estimates
    if conditions is not None and (conditions == TRUTH).any():
        table = replace(table, frame=table.frame[conditions == TRUTH])
        unread = []
    place = ["north", "east"]
    if {"lat", "lon"} <= there or ({"lat", "lon"} & there and not {"north", "east"} & there):
        place = ["lat", "lon"]
    depth = "pressure" if "pressure" in there and "depth" not in there else "depth"
    if depth == "pressure" and place[0] != "lat":
        raise ExchangeError(
            f"{path}: pressures become depths by the latitude, but positions are north"
            " and east; give lat and lon, or depths in metres"
        )
    try:
        table.require(["time", *place, depth, *({"vehicle"} & there)])
    except RecordError as error:
        raise ExchangeError(
            f"{error}; a trajectory needs time, lat and lon or north and east, and depth; optional"
            " are vehicle and either qw, qx, qy, qz or heading_deg, pitch_deg, roll_deg"
        ) from None
    whole = set(_QUATERNION) <= there
    angles = [n for n in factors if n in (_QUATERNION if whole else _ANGLES) or n == "convergence"]
    table = table.readable(
        invalid, times=["time"], numbers=[*place, depth, *angles], words={"vehicle"} & there
    )
    invalid.refuse_most(len(table.frame), ExchangeError)
    place_of = _numbers(table, factors, [*place, depth])
    if depth == "pressure":
        import gsw

        place_of[:, 2] = -gsw.z_from_p(place_of[:, 2], place_of[:, 0])
    time = table.times("time")
    quaternion = _attitude(table, factors)
    if place[0] == "lat" and "convergence" in there:  # attitudes are relative to a frame's north
        quaternion = about_down(quaternion, -_numbers(table, factors, ["convergence"])[:, 0])
    if "vehicle" in there:
        names = table.frame["vehicle"].astype(str).to_numpy()
    else:
        _refuse_two_places_at_once(table, time, place_of, unread, geographic=place[0] == "lat")
        names = np.full(time.size, path.stem)
    geodetic = place[0] == "lat"
    centre = centre_in_comments(table.comments, path)
    whole_file = Poses(
        "", time, place_of, quaternion, geodetic, str(path), centre, table.lines, in_degrees
    )
    poses = [
        whole_file.rows(names == name)._replace(name=name) for name in dict.fromkeys(names.tolist())
    ]
    unused = [f"{path}: unused columns: {', '.join(unread)}"] if unread else []
    return poses, [*unused, *invalid.notes]


def _refuse_two_places_at_once(
    table: TextTable, time: AnyArray, position: Array, unread: list[str], *, geographic: bool
) -> None:
    """
    Refuse a table without names in which one time has two positions far apart: it has several
    vehicles.
    """
    missing = missing_fixes(position) if geographic else {}
    possible = np.setdiff1d(np.arange(len(position)), list(missing))
    _, first, of_time = np.unique(time[possible], return_index=True, return_inverse=True)
    earlier = np.arange(len(position))
    earlier[possible] = possible[first[of_time.ravel()]]
    distance = np.hypot(
        distances(position, position[earlier], geographic=geographic),
        position[:, 2] - position[earlier, 2],
    )
    if (distance > _SAME_PLACE).any():
        row = int(np.argmax(distance > _SAME_PLACE))
        lines = table.frame.index
        columns = f" (unused columns: {', '.join(unread)})" if unread else ""
        raise ExchangeError(
            f"{table.path}, line {lines[row]}: {distance[row]:,.0f} m from the position of line"
            f" {lines[earlier[row]]} at the same time, and no column names the vehicle; rename the"
            f" column with the names to vehicle{columns}"
        )


@errors_as(ExchangeError, RecordError)
def read_pings(path: Path, start: np.datetime64 | None) -> PingList:
    """
    Read pings from a table with columns time, transmitter and optional receivers (names separated
    by spaces; default: all).

    Times are seconds since the start of the mission, or dates, which need the instant of that
    start.
    """
    table, _ = _known_columns(read_text_table(path))
    try:
        table.require(["time", "transmitter", *({"receivers"} & set(table.frame.columns))])
    except RecordError as error:
        raise ExchangeError(
            f"{error}; a list of pings needs time and transmitter; optional is receivers"
        ) from None
    unknown = [title for title in table.frame.columns if title not in _OF_PINGS]
    if unknown:  # with a misspelt column of receivers, all participants would listen
        raise ExchangeError(
            f"{path}: unknown column {unknown[0]!r}; allowed: {', '.join(_OF_PINGS)}; rename or"
            " remove it"
        )
    time = table.times("time")
    if time.dtype.kind == "M":
        if start is None:
            raise ExchangeError(
                f"{path}: times are dates, but the start of the mission has no date; give seconds"
                " since the start"
            )
        time = seconds_since(time, start)
    receivers: list[list[str]] = []
    if "receivers" in table.frame:
        receivers = table.frame["receivers"].str.split().tolist()
    try:
        return PingList(
            tuple(time.tolist()),
            tuple(table.frame["transmitter"]),
            tuple(tuple(names) for names in receivers),
        )
    except SensingError as error:
        raise ExchangeError(f"{path}: {error}") from None


def _parquet(path: Path) -> TextTable:
    """Table with typed cells; the line of a row is its number, from 1."""
    with optional_package(ExchangeError, path, "pyarrow", "parquet"):
        import pyarrow.compute
        import pyarrow.parquet  # noqa: F401
    try:
        frame = _parquet_frame(path)
    except ExchangeError:
        raise
    except Exception as error:  # noqa: BLE001  pyarrow raises many types
        raise ExchangeError(
            f"{path}: not a readable Parquet file: {' '.join(str(error).split())[:100]}"
        ) from None
    if frame.empty:
        raise ExchangeError(f"{path}: no rows; a trajectory needs at least two")
    return _typed_table(path, frame)


def _typed_table(path: Path, frame: pd.DataFrame) -> TextTable:
    """Table of a data frame, whose cells are not copied."""
    frame = frame.reset_index() if frame.index.name else frame.copy(deep=False)
    frame.index, frame.columns = pd.RangeIndex(1, len(frame) + 1), frame.columns.map(str)
    return TextTable(path, frame, [])


def _parquet_frame(path: Path) -> pd.DataFrame:
    """
    Content of a Parquet file without nested columns; its declared sizes must not exceed the limit.
    """
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        about = file.metadata
        schema = file.schema_arrow
        packed = sum(about.row_group(k).total_byte_size for k in range(about.num_row_groups))
        size = max(8 * about.num_rows * about.num_columns, packed)
    _check_size(path, size, f"{about.num_rows:,} rows of {about.num_columns} columns need")
    flat = [field for field in schema if not pa.types.is_nested(field.type)]
    kinds = pa.types.is_string, pa.types.is_large_string, pa.types.is_binary
    text = [field.name for field in flat if any(is_kind(field.type) for is_kind in kinds)]
    with pq.ParquetFile(path, read_dictionary=text) as file:  # repeated text is in memory once
        table = file.read(columns=[field.name for field in flat])
    for name in text:
        pieces = table[name].chunks
        lengths = (pc.take(pc.binary_length(piece.dictionary), piece.indices) for piece in pieces)
        _check_size(
            path,
            sum(pc.sum(pc.cast(one, "int64")).as_py() or 0 for one in lengths),
            f"text of {name} needs",
        )
        table = table.set_column(
            table.schema.get_field_index(name), name, table[name].cast(schema.field(name).type)
        )
    frame: pd.DataFrame = table.to_pandas(split_blocks=True, self_destruct=True)
    return frame


def _check_size(path: Path, size: int, what: str) -> None:
    if size > MAX_UNPACKED_BYTES:
        raise ExchangeError(
            f"{path}: {what} {size / 1e9:.3g} GB unpacked; the limit is"
            f" {MAX_UNPACKED_BYTES / 1e9:g} GB; remove columns, or reduce the sampling rate"
        )


def _known_columns(table: TextTable) -> tuple[TextTable, dict[str, float]]:
    """
    Rename known columns, and return the factor of each column to the unit of this package; an
    unknown unit raises an error.
    """
    titles = []
    factors = {}
    for title in table.frame.columns:
        key = re.sub(r"[\s_.\[\]()]+", "_", title.lower()).strip("_")
        column, factor = _TITLES.get(key, (title, 1.0))
        named = _IN_BRACKETS.fullmatch(title.lower().strip())
        if named and key not in _TITLES and _UNITS.get(named[1]):
            raise ExchangeError(
                f"{table.path}: column {title!r} has unit {named[2]!r}; allowed:"
                f" {', '.join(_UNITS[named[1]])}"
            )
        titles.append(column)
        if key in _TITLES:
            factors[column] = factor
    return replace(table, frame=table.frame.set_axis(titles, axis=1)), factors


def _numbers(table: TextTable, factors: dict[str, float], columns: list[str]) -> Array:
    return table.numbers(columns) * [factors[name] for name in columns]


def _attitude(table: TextTable, factors: dict[str, float]) -> Array | None:
    """
    Quaternions from quaternion columns or from heading, pitch and roll; None if the table has
    neither.
    """
    if set(_QUATERNION) <= set(factors):
        return _numbers(table, factors, _QUATERNION)
    angles = [name for name in factors if name in _ANGLES]
    quaternion = [name for name in _QUATERNION if name in factors]
    if not angles and quaternion:
        raise ExchangeError(
            f"{table.path}: only {', '.join(quaternion)} of a quaternion; give all of qw, qx, qy,"
            " qz"
        )
    if not angles:
        return None
    if "heading" not in angles:
        raise ExchangeError(
            f"{table.path}: {' and '.join(angles)} without heading; add heading, or remove these"
            " columns"
        )
    values = _numbers(table, factors, angles)
    for k, name in enumerate(angles):
        if factors[name] == 1.0 and np.abs(values[:, k]).max() > _MAX_RADIANS:
            raise ExchangeError(
                f"{table.path}: {name} has values up to {np.abs(values[:, k]).max():g}, more than 2"
                f" pi radians; if it is in degrees, rename the column to {name}_deg"
            )
    of = dict(zip(angles, values.T, strict=True))
    return level(of["heading"], of.get("pitch", 0.0), of.get("roll", 0.0))
