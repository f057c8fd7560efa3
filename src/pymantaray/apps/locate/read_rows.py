"""Functions that all readers of surveys share: rows, positions, attitudes, clocks and notes."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pymantaray.arrays import Array, Mask
from pymantaray.errors import LocateError
from pymantaray.messages import one_line
from pymantaray.quantities.checks import parsed_number
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.position_rows import PositionRows, distances, middle_longitude
from pymantaray.records.text_table import TextTable
from pymantaray.user_files import read_text

_MAX_DISTANCE = 100_000.0  # m; no node answers from a greater distance


def number_rows(
    paths: Sequence[Path],
    invalid: InvalidLines,
    read: Callable[[list[str]], list[float]],
    what: str,
) -> tuple[Array, NDArray[np.int64]]:
    """
    Numbers (n, k) of the lines of files, and the lines from 1.

    ``read`` converts the words of a line, or raises an error; the note then says that the line is
    not ``what``. Empty lines and comments do not count.
    """
    rows = []
    lines = []
    for path in paths:
        for number, text in enumerate(read_text(path, LocateError).splitlines(), 1):
            words = text.replace(",", " ").split()
            if not words or words[0].startswith("#"):
                continue
            try:
                rows.append(read(words))
                lines.append(number)
            except (ValueError, KeyError, IndexError):
                invalid.add(path, number, f"{one_line(text, 60)!r} is not {what}")
    invalid.refuse_most(len(rows), LocateError)
    return np.array(rows), np.array(lines, dtype=np.int64)


def numbers_of(words: Iterable[str]) -> list[float]:
    """Finite numbers of words, also with the exponents of Fortran; others raise a ValueError."""
    values = [parsed_number(word.replace("D", "E")) for word in words]
    if not np.isfinite(values).all():
        raise ValueError(values)
    return values


def seconds_of_day(clock: str) -> float:
    """Seconds of a text such as ``06:04:30.5``; a ValueError for a time that does not exist."""
    hour, minute, second = clock.split(":")
    if int(hour) > 23 or int(minute) > 59 or not 0.0 <= float(second) < 61.0:
        raise ValueError(clock)
    return 3600.0 * int(hour) + 60.0 * int(minute) + float(second)


def possible_rows(
    table: TextTable,
    positions: PositionRows,
    judged: Mask,
    ends: Iterable[tuple[Array, str, str]],
    *,
    geographic: bool,
    stated_degrees: bool = False,
) -> TextTable:
    """
    Table without the judged rows whose position of the platform is impossible.

    ``ends`` are the times and the two columns of the positions at transmission and at reception.
    """
    keep = judged.copy()
    for time, *axes in ends:
        if set(axes) <= set(table.frame.columns):
            rows = np.flatnonzero(keep)
            position = np.column_stack([table.optional(axis) for axis in axes])
            keep[rows] = positions.possible(
                time[rows],
                position[rows],
                table.lines[rows],
                geographic=geographic,
                stated_degrees=stated_degrees,
            )
    positions.refuse_most(int(keep.sum()))
    return replace(table, frame=table.frame[keep | ~judged])


def attitudes(table: TextTable, ends: Iterable[Sequence[str]]) -> list[Array]:
    """
    Heading, pitch and roll (n, 3) at each end from its three columns in degrees. [rad]

    They are 0 without a column, and those of the first end without all three.
    """
    out = list[Array]()
    for columns in ends:
        if out and not set(columns) & set(table.frame.columns):
            out.append(out[0])
            continue
        angles = [table.optional(column, 0.0) for column in columns]
        out.append(np.radians(np.column_stack(angles)))
    return out


def check_positions(
    where: object, platform: tuple[Array, Array], node: tuple[float, float], name: str
) -> None:
    """Raise an error if a distance implies a wrong sign or order of coordinates. [degrees]"""
    lat = float(np.median(platform[0]))
    lon = middle_longitude(platform[1])

    def distance(*position: float) -> float:
        return float(distances(np.array(position), np.array(node), geographic=True))

    if distance(lat, lon) < _MAX_DISTANCE:
        return
    advice = "check both"
    for lat_2, lon_2, what in (
        (lat, -lon, "one of the longitudes has the wrong sign (east or west)"),
        (-lat, lon, "one of the latitudes has the wrong sign (north or south)"),
        (-lat, -lon, "latitude and longitude of one have the wrong sign"),
        (lon, lat, "latitude and longitude of one are exchanged"),
    ):
        if distance(lat_2, lon_2) < _MAX_DISTANCE:
            advice = what
    raise LocateError(
        f"{where}: the platform is at {lat:.4f}, {lon:.4f} and node {name} at {node[0]:.4f},"
        f" {node[1]:.4f}, {distance(lat, lon) / 1000.0:,.0f} km apart; {advice}"
    )


def skipped_note(path: Path, count: int) -> tuple[str, ...]:
    """Note with the number of events without an answer."""
    return (f"{path}: {count} event{'' if count == 1 else 's'} without an answer",) if count else ()
