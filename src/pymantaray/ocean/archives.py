"""
Files of archives with many casts, as tables of casts: spreadsheets of Ocean Data View, the CSV of
the World Ocean Database, bottles in the WHP-exchange format, and text of PANGAEA.

Sources: the generic spreadsheet in the guide of Ocean Data View (https://odv.awi.de), the
description of WODselect's CSV (https://www.ncei.noaa.gov/access/world-ocean-database-select), and
files of PANGAEA (https://www.pangaea.de).
"""

import csv
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from pymantaray.errors import OceanError
from pymantaray.ocean.instrument_table import Lines, number_of
from pymantaray.ocean.whp import bottle_table
from pymantaray.records.digits import counted

_WOD = re.compile(r"CAST\s*,,\s*\d+\s*,WOD Unique Cast Number")
_WOD_COLUMNS = {
    "depth": "Depth",
    "pressure": "Pressure",
    "temperature": "Temperatur",
    "salinity": "Salinity",
}
_WOD_MISSING = ("---*---", "**********")
_ODV_ROLES = {
    "cruise": r"cruise",
    "station": r"station",
    "time": r"yyyy-mm-dd",
    "date": r"mon/day/yr",
    "clock": r"hh:mm",
    "lon": r"lon(gitude)?\b",
    "lat": r"lat(itude)?\b",
    "type": r"type\b",
    "bottom": r"bot\w*\.?\s*depth",
}
# flags of questionable, bad and missing values by scheme
_ODV_BAD = {
    "ODV": "48",
    "WOD": "123456789",
    "WODSTATION": "123456789",
    "BODC": "KLMNO",
    "PANGAEA": "?/",
    "ESEAS": "3489",
}
_OTHER_BAD = "3459"  # in those of SeaDataNet, Argo, GTSPP, IODE, OceanSITES, QARTOD and WOCE
_WITH_OTHER_BAD = r"SEADATANET|ARGO|GTSPP|IODE|OCEANSITES|QARTOD|WOCE.*"
_PANGAEA = {
    "Event": "station",
    "Date/Time": "time",
    "Depth water": "depth",
    "Press": "pressure",
    "Temp": "temperature",
    "Tpot": "potential_temperature",
    "Sal": "salinity",
}
_DATE_ONLY = re.compile(r"\d{4}-\d\d-\d\d")


class ArchiveTable(NamedTuple):
    """Text of a table of casts with the lines of a file."""

    name: str
    text: str
    notes: tuple[str, ...]
    labelled: bool = True
    """True if each row has the time and the place of its cast."""


def archive_table(path: Path, text: str, lines: Lines) -> ArchiveTable | None:
    """Table of casts of an archive's file; None for another file."""
    reader = next((read for known, read in _FORMATS if known(text, lines)), None)
    return None if reader is None else reader(path, lines)


def _bottles(path: Path, lines: Lines) -> ArchiveTable:
    return ArchiveTable("WHP-exchange bottles", *bottle_table(path, lines))


def _is_odv(_: str, lines: Lines) -> bool:
    """True if the first line that is no comment has the labels of a spreadsheet."""
    head = next((line for line in lines if line.strip() and not line.startswith("//")), "")
    labels = _roles(_cells(head, _separator(head)))
    return {"station", "lat", "lon"} <= labels.keys() and bool({"time", "date"} & labels.keys())


def _separator(head: str) -> str:
    """Separator of a spreadsheet, from the line with its labels."""
    return next((mark for mark in "\t;" if mark in head), ",")


def _cells(line: str, separator: str) -> list[str]:
    """Cells of a line; those between commas may be quoted, unless the line is too long for that."""
    quoted = separator == "," and '"' in line and len(line) <= csv.field_size_limit()
    cells = next(csv.reader([line]), []) if quoted else line.split(separator)
    return [cell.strip().strip('"') for cell in cells]


def _roles(titles: list[str]) -> dict[str, int]:
    """Columns of the labels of a spreadsheet."""
    return {
        role: k
        for role, form in _ODV_ROLES.items()
        for k in [next((k for k, t in enumerate(titles) if re.match(form, t, re.IGNORECASE)), None)]
        if k is not None
    }


def _odv(_: Path, lines: Lines) -> ArchiveTable:
    """
    Casts of a spreadsheet, whose labels may be in the first row of a station only.

    A station without latitude or longitude has no place, as a cast of any other table.
    """
    start = next(i for i, line in enumerate(lines) if line.strip() and not line.startswith("//"))
    separator = _separator(lines[start])
    titles = _cells(lines[start], separator)
    roles = _roles(titles)
    flags, notes = _odv_flags(titles)
    data = [k for k in range(len(titles)) if k not in flags and k not in roles.values()]
    table = [""] * len(lines)
    table[start] = "\t".join(["station", "time", "lat", "lon", *(titles[k] for k in data)])
    label: dict[str, str] = {}
    types: dict[str, str] = {}  # of the first station of each name
    times: dict[str, str] = {}
    rejected = 0
    for i, line in enumerate(lines[start + 1 :], start + 1):
        if not line.strip() or line.startswith("//"):
            continue
        cells = _cells(line, separator)
        if len(cells) < len(titles) - len(flags):
            table[i] = "\t".join(cells[:4])  # truncated, for the list of invalid lines
            continue
        cells += [""] * (len(titles) - len(cells))
        own = {role: cells[k] for role, k in roles.items() if cells[k]}
        label = _station(own, label)
        for k, (flagged, bad) in flags.items():
            if cells[k] and cells[k] in bad and cells[flagged]:
                cells[flagged] = ""
                rejected += 1
        name = "/".join(filter(None, (label.get("cruise", ""), label.get("station", ""))))
        own_type = label.get("type", "")
        if own_type and types.setdefault(name, own_type) != own_type:  # such as bottles and a CTD
            name = f"{name}/{own_type}"
        times[name] = _odv_time(label)
        place = label.get("lat", ""), label.get("lon", "")
        table[i] = "\t".join([name, times[name], *place, *(cells[k] for k in data)])
    notes += [f"{counted(rejected, 'value')} rejected by quality flags"] if rejected else []
    return ArchiveTable("ODV spreadsheet", "\n".join(table), (*notes, *_without_clock(times)))


def _odv_flags(titles: list[str]) -> tuple[dict[int, tuple[int, str]], list[str]]:
    """
    Column of the values and bad flags of each column of flags, and notes about unknown schemes.

    Standard deviations may be between values and flags.
    """
    flags: dict[int, tuple[int, str]] = {}
    notes: dict[str, None] = {}
    values = -1
    for k, title in enumerate(titles):
        if not re.match(r"Q[VF]\b", title):
            values = values if title.upper().startswith("STANDARD_DEV") else k
            continue
        scheme = (title.split(":")[1].strip() if ":" in title else "ODV").upper()
        if scheme not in _ODV_BAD and not re.fullmatch(_WITH_OTHER_BAD, scheme):
            notes[f"quality flags of {scheme}: read as those of SeaDataNet"] = None
        if values >= 0:
            flags[k] = values, _ODV_BAD.get(scheme, _OTHER_BAD)
    return flags, list(notes)


def _without_clock(times: dict[str, str]) -> list[str]:
    """Note about the casts, by name, that have a date without a time of day."""
    count = sum(bool(_DATE_ONLY.fullmatch(time)) for time in times.values())
    return [f"time of day of {counted(count, 'cast')} unknown: 0 h assumed"] if count else []


def _station(own: dict[str, str], before: dict[str, str]) -> dict[str, str]:
    """Labels of a row; its empty cells are those of the row before at the same station only."""
    same = all(
        own.get(role, before.get(role)) == before.get(role)
        for role in ("cruise", "station", "type")
    )
    return before | own if same else own


def _odv_time(label: dict[str, str]) -> str:
    """Instant of a station in ISO 8601."""
    if "time" in label:
        return label["time"]
    date = re.match(r"(\d{1,2})/(\d{1,2})/(\d{4})", label.get("date", ""))
    if date is None:
        return ""
    clock = label.get("clock", "")
    day = f"{date[3]}-{int(date[1]):02d}-{int(date[2]):02d}"
    if not re.fullmatch(r"\d{1,2}:\d\d(:\d\d)?", clock):
        return day
    hour, rest = clock.split(":", 1)
    return f"{day}T{hour:0>2}:{rest}"


def _wod(path: Path, lines: Lines) -> ArchiveTable:
    """Casts of the World Ocean Database, without values that its quality control rejects."""
    table = [""] * len(lines)
    table[0] = "station,time,lat,lon,depth_m,pressure_dbar,temperature_degC,salinity"
    head: dict[str, str] = {}
    columns: dict[str, int] = {}
    flags: list[str] = []
    times: dict[str, str] = {}
    inside, rejected = False, 0
    for i, line in enumerate(lines):
        cells = [cell.strip() for cell in line.split(",")]
        key = cells[0]
        if line.startswith("#"):
            head, columns, flags, inside = {}, {}, [], False
        elif key == "VARIABLES":
            columns = {q: cells.index(n) for q, n in _WOD_COLUMNS.items() if n in cells}
        elif key == "Prof-Flag":
            flags, inside = cells, True
        elif key.startswith("END OF VARIABLES"):
            inside = False
        elif inside and i:
            values = {}
            for quantity, k in columns.items():
                value = cells[k] if k < len(cells) else ""
                marks = [row[k + 1] for row in (cells, flags) if k + 1 < len(row)]
                bad = value in _WOD_MISSING or any(number_of(mark) > 0.0 for mark in marks)
                rejected += bad and value not in ("", *_WOD_MISSING)
                values[quantity] = "" if bad else value
            labels = head.get("CAST", ""), _wod_time(head), head.get("Latitude", "")
            times[labels[0]] = labels[1]
            row = (*labels, head.get("Longitude", ""), *(values.get(q, "") for q in _WOD_COLUMNS))
            table[i] = ",".join(row)
        elif len(cells) > 2 and not columns:
            head[key] = cells[2]
    if not any(table[1:]):
        raise OceanError(f"{path}: a file of the World Ocean Database without levels of any cast")
    notes = [f"{counted(rejected, 'value')} rejected by quality flags"] if rejected else []
    return ArchiveTable("World Ocean Database", "\n".join(table), (*notes, *_without_clock(times)))


def _wod_time(head: dict[str, str]) -> str:
    """Instant of a cast in ISO 8601, whose hours may be missing."""
    year, month, day = (number_of(head.get(key, "")) for key in ("Year", "Month", "Day"))
    if not year > 0.0 or not month > 0.0 or not day > 0.0:
        return ""
    date = f"{int(year):04d}-{int(month):02d}-{int(day):02d}"
    hours = number_of(head.get("Time", ""))
    if not 0.0 <= hours < 24.0:
        return date
    minutes = min(round(60.0 * hours), 24 * 60 - 1)
    return f"{date}T{minutes // 60:02d}:{minutes % 60:02d}"


def _pangaea(_: Path, lines: Lines) -> ArchiveTable:
    """
    Table below the description of a data set, with titles of ours; the description has the place
    and the time of a single event.
    """
    end = next((i for i, line in enumerate(lines, 1) if line.startswith("*/")), len(lines))
    head, rows = " ".join(lines[:end]), lines[end:]
    titles = rows[0].split("\t") if rows else []
    names = [title.partition(" [")[0] for title in titles]
    for k, name in enumerate(names):
        if name in _PANGAEA:
            other = names[:k].count(name)  # sensors beside the first are not read
            titles[k] = titles[k].replace(name, f"{name} {other}" if other else _PANGAEA[name], 1)
    table = [*[""] * end, "\t".join(titles), *rows[1:]]
    found = [
        re.findall(rf"\b{key}: *([^ *]+)", head) for key in ("DATE/TIME", "LATITUDE", "LONGITUDE")
    ]
    if "Latitude" not in names and [len(one) for one in found[1:]] == [1, 1]:
        (lat,), (lon,) = found[1:]
        table[0] = f"# {''.join(found[0][:1])}, lat {lat}, lon {lon}"
    return ArchiveTable("PANGAEA", "\n".join(table), (), labelled=False)


_FORMATS: tuple[tuple[Callable[[str, Lines], bool], Callable[[Path, Lines], ArchiveTable]], ...] = (
    (lambda text, _: text.startswith("BOTTLE,"), _bottles),
    (lambda _, lines: any(_WOD.match(line) for line in lines[:5]), _wod),
    (lambda text, _: text.startswith("/* DATA DESCRIPTION:"), _pangaea),
    (_is_odv, _odv),
)
"""Condition and reader of each format."""
