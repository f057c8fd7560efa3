"""
Columns of an instrument's file, and functions that its readers share: titles, units, numbers,
positions and dates.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from pymantaray.ocean.convert import vertical_of
from pymantaray.quantities.checks import parsed_number
from pymantaray.records.text_table import MONTHS

Lines = Sequence[str]
Rows = dict[int, list[str]]
"""Cells by line of the file, starting at 1."""


class InstrumentTable(NamedTuple):
    """Columns of an instrument's file."""

    instrument: str
    titles: list[str]
    """Names of quantities with units, as in tables of casts; empty for unused columns."""
    rows: Rows
    position: tuple[str, str]
    """Texts of latitude and longitude, as in the file; empty if it has none."""
    time: str
    """UTC in ISO 8601; empty if the file has no time."""
    notes: tuple[str, ...] = ()
    names: Sequence[str] = ()
    """Names of all columns in the file, in the order of ``titles``."""
    bottom_depth: float = math.nan
    """Depth of the sea bed. [m]"""

    @property
    def unread(self) -> tuple[str, ...]:
        """Names of the columns that are not used."""
        return tuple(
            name.strip()
            for name, title in zip(self.names, self.titles, strict=False)
            if not title and name.strip()
        )


NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_QUANTITIES = (  # the first match in a column's title counts
    (r"potential temp|^potemp", "potential_temperature"),
    (r"specific|conductance|density|anomaly", ""),
    (r"^cond", "measured_conductivity"),
    (r"^(cal\w*\.? ?)?(sv|svel|sos)$|sound (vel|speed)|speed of sound|^calcsv", "sound_speed"),
    (r"^sal|salinity", "salinity"),
    (r"^t(emp)?(ct|sv)?$|^temp|temperature", "temperature"),
    (r"^(sea ?)?pres", "pressure"),
    (r"^depth|^dep\b", "depth"),
)
_UNITS = {
    "decibar": "dbar", "decibars": "dbar", "db": "dbar", "dbar": "dbar", "bar": "bar", "m": "m",
    "meter": "m", "meters": "m", "metre": "m", "metres": "m", "ft": "ft", "feet": "ft",
    "c": "degC", "degc": "degC", "deg c": "degC", "celsius": "degC", "°f": "degF", "ºf": "degF",
    "deg f": "degF", "degf": "degF", "ft/sec": "ft/s", "psi": "psi", "°c": "degC", "ºc": "degC",
    "deg_c": "degC", "f": "degF", "m/s": "m/s", "m/sec": "m/s", "meters per second": "m/s",
    "ft/s": "ft/s", "microsiemens per centimeter": "us/cm", "psu": "1", "0/00": "1", "‰": "1",
    "pss-78": "1", "practical salinity scale": "1", "ppt": "1",
}  # fmt: skip
_YEAR = r"(?P<year>\d{4}|\d\d)(?!\d)"
_DATES = [
    re.compile(r"\s*" + layout)
    for layout in (
        r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})(?!\d)",
        r"(?P<first>\d{1,2})(?P<sign>[-/.])(?P<second>\d{1,2})(?P=sign)" + _YEAR,
        r"(?P<name>[A-Za-z]{3})[a-z]*\.?[-\s]+(?P<day>\d{1,2}),?[-\s]+" + _YEAR,
        r"(?P<day>\d{1,2})[-\s]+(?P<name>[A-Za-z]{3})[a-z]*\.?,?[-\s]+" + _YEAR,
    )
]
_CLOCK = re.compile(r"[T/\s]+(\d{1,2}):(\d\d)(?::(\d\d(?:\.\d+)?))?")
ITS_90_NOTE = "temperature converted from ITS-68 to ITS-90 (divided by 1.00024)"
_CENTURY = 69  # two digits from here on are of 19.., as in POSIX
_BEFORE_INSTRUMENTS = 1950  # programs with years of two digits wrote 1903 for 2003


def known_titles(cells: Iterable[str]) -> list[str]:
    """
    Convert titles of a file, such as ``Pressure (Decibar)``, to titles of this package; empty for
    unused columns.
    """
    return first_of_each(_title(cell) for cell in cells)


def _title(cell: str) -> str:
    match = re.fullmatch(r"\s*(.*?)\s*(?:[(\[]([^)\]]*)[)\]])?\s*", cell)
    name, unit = (match[1], match[2] or "") if match else (cell, "")
    quantity = next(
        (q for pattern, q in _QUANTITIES if re.search(pattern, name.strip().lower())), ""
    )
    if not quantity:
        return ""
    known = known_unit(unit)
    if quantity in ("depth", "pressure"):
        quantity = vertical_of(known, quantity)
    return f"{quantity} [{known}]" if known else quantity


def known_unit(unit: str) -> str:
    """
    Convert the unit of an instrument's column to its usual spelling; other units stay as they are.
    """
    return _UNITS.get(unit.strip().lower(), unit.strip())


def first_of_each(titles: Iterable[str]) -> list[str]:
    """Remove the titles of second columns of a quantity."""
    out: list[str] = []
    for title in titles:
        quantity = title.split(" [")[0]
        out.append("" if any(other.split(" [")[0] == quantity for other in out) else title)
    return out


def numeric_rows(lines: Lines, start: int, separator: str | None) -> Rows:
    """Rows from a line onward with at least one number; other cells become empty."""
    rows = {}
    for i, line in enumerate(lines[start:], start + 1):
        cells = [cell.strip() for cell in line.split(separator)]
        numbers = [cell if NUMBER.fullmatch(cell) else "" for cell in cells]
        if any(numbers):
            rows[i] = numbers
    return rows


def text_after(head: Iterable[str], pattern: str) -> str:
    """Text behind a key, from the first line of a header with this key."""
    for line in head:
        if match := re.match(rf"(?:{pattern})(.*)", line, re.IGNORECASE):
            return match[1].strip()
    return ""


def scale_column(rows: Rows, k: int, factor: float, offset: float = 0.0) -> None:
    """Multiply the numbers of a column by a factor and add an offset."""
    for cells in rows.values():
        cells[k] = repr(factor * number_of(cells[k]) + offset) if cells[k] else ""


def number_of(cell: str) -> float:
    """Number in a cell; NaN for other text."""
    try:
        return parsed_number(cell)
    except ValueError:
        return float("nan")


def position_texts(head: Lines) -> tuple[str, str]:
    """Texts of latitude and longitude from the lines of a header."""
    lat, lon = (text_after(head, rf"(?:NMEA )?{axis}\s*[=:]") for axis in ("Latitude", "Longitude"))
    return lat, lon


def written_date(words: str, *, day_first: bool = False) -> tuple[str, list[str]]:
    """
    Convert a date at the beginning of a text to ISO 8601, and note assumptions.

    Of two numbers, the first is the month, or on request the day, unless only the other order is a
    date. Years of two digits, and those of 19.. before there were such instruments, become years of
    1969 to 2068.
    """
    match = next(filter(None, (layout.match(words) for layout in _DATES)), None)
    date = {} if match is None else match.groupdict()
    if match is None or date.get("name", "jan").lower() not in MONTHS:
        return "", [f"date {words[:40]!r} not read"] if words.strip() else []
    text = match[0].strip()
    notes = []
    if "name" in date:
        month = MONTHS[date["name"].lower()]
        day = int(date["day"])
    elif "first" in date:
        day, month = (int(date[key]) for key in ("first", "second"))
        day_first |= date["sign"] == "."
        if month > 12 or (day <= 12 and not day_first):
            day, month = month, day
        if max(day, month) <= 12 and day != month:
            notes = [f"date {text!r}: the {'day' if day_first else 'month'} is assumed to be first"]
    else:
        day, month = int(date["day"]), int(date["month"])
    year = int(date["year"])
    if year < 100:
        year += 1900 if year >= _CENTURY else 2000
    elif 1900 <= year < _BEFORE_INSTRUMENTS:
        year += 100
        notes.append(f"date {text!r}: read as of {year}, from a year of two digits")
    return f"{year}-{month:02d}-{day:02d}", notes


def written_instant(words: str, *, day_first: bool = False) -> tuple[str, list[str]]:
    """Convert a date, with its time of day if present, as `written_date`."""
    date, notes = written_date(words, day_first=day_first)
    if not date:
        return "", notes
    layout = next(filter(None, (layout.match(words) for layout in _DATES)))
    clock = _CLOCK.match(words[layout.end() :])
    if clock is None:
        return date, notes
    return f"{date}T{int(clock[1]):02d}:{clock[2]}:{clock[3] or '00'}", notes


def on_its_90(titles: list[str], rows: Rows) -> Iterator[str]:
    """Convert temperatures from IPTS-68 to ITS-90, and yield a note."""
    for k, title in enumerate(titles):
        if title.endswith(" 68"):
            titles[k] = title.removesuffix(" 68")
            freezing = 32.0 if "degF" in title else 0.0
            scale_column(rows, k, 1.0 / 1.00024, freezing - freezing / 1.00024)
            yield ITS_90_NOTE
