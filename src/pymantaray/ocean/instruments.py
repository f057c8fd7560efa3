"""
Readers of text files from instruments and their programs, as columns with names and units of this package.

The content, not the suffix, identifies the format: Sea-Bird ``.cnv`` (Seasoft manual, converted data format), Sippican ``.edf``
(XBT, XCTD, XSV), Kongsberg ``.asvp``, SonTek CastAway, Valeport (VPD, VP2, MIDAS, MiniSVP), AML (``.aml`` and SeaCast's CSV) and
text of RBR Ruskin. Sources for the headers are the manual of the Simrad ME70 (EDF) and files for HydrOffice's Sound Speed Manager.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import gsw

from pymantaray.errors import OceanError
from pymantaray.ocean.convert import parse_instant
from pymantaray.ocean.positions import position_in_text
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

    @property
    def unread(self) -> tuple[str, ...]:
        """Names of the columns that are not used."""
        return tuple(
            name.strip()
            for name, title in zip(self.names, self.titles, strict=False)
            if not title and name.strip()
        )


_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
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
    "decibar": "dbar", "decibars": "dbar", "db": "dbar", "dbar": "dbar", "bar": "bar", "m": "m", "meter": "m", "meters": "m",
    "metre": "m", "metres": "m", "ft": "ft", "feet": "ft", "c": "degC", "degc": "degC", "deg c": "degC", "celsius": "degC",
    "°f": "degF", "ºf": "degF", "deg f": "degF", "degf": "degF", "ft/sec": "ft/s", "psi": "psi", "°c": "degC", "ºc": "degC", "deg_c": "degC", "f": "degF", "m/s": "m/s", "m/sec": "m/s", "meters per second": "m/s", "ft/s": "ft/s",
    "microsiemens per centimeter": "us/cm", "psu": "1", "0/00": "1", "‰": "1", "pss-78": "1", "practical salinity scale": "1", "ppt": "1",
}  # fmt: skip
_SEA_BIRD = (  # short names of Seasoft's variables
    (r"pr(50|[dDS])?M?\d?", "pressure [dbar]"),
    (r"pr(50|[dDS])?E\d?", "pressure [psi]"),
    (r"depSM?", "depth [m]"),
    (r"depSF", "depth [ft]"),
    (r"depFM?", "fresh_water_depth [m]"),
    (r"depFF", "fresh_water_depth [ft]"),
    (r"t(v|nc?)?\d{0,2}_?90(Cm?)?", "temperature [degC]"),
    (r"t(v|nc?)?\d{0,2}_?90F", "temperature [degF]"),
    (r"t(v|nc?)?\d{0,2}_?68(Cm?)?", "temperature [degC] 68"),
    (r"t(v|nc?)?\d{0,2}_?68F", "temperature [degF] 68"),
    (r"potemp\d?90C", "potential_temperature [degC]"),
    (r"gsw_ctA\d?", "conservative_temperature [degC]"),
    (r"sal(\d\d)?", "salinity [1]"),
    (r"gsw_saA\d?", "absolute_salinity [g/kg]"),
    (r"c(ond)?_?\d?S/m", "measured_conductivity [S/m]"),
    (r"c(ond)?_?\d?mS/cm", "measured_conductivity [mS/cm]"),
    (r"c(ond)?_?\d?uS/cm", "measured_conductivity [uS/cm]"),
    (r"sv[CDW]M\d?", "sound_speed [m/s]"),
    (r"sv[CDW]F\d?", "sound_speed [ft/s]"),
    (r"latitude", "lat [degrees]"),
    (r"longitude", "lon [degrees]"),
)
_FRESH_WATER_DEPTH = 1.019716
"""Seasoft's depth in fresh water over pressure. [m/dbar]"""
_SAME_LATITUDE = 0.05  # degrees; depth changes by less than 2e-6 of itself
_CLOCK = r"(?:\s+(?P<time>\d{1,2}:\d\d:\d\d))?"
_MONTH_NAME_FIRST = r"(?P<month>[A-Za-z]{3})[a-z]*\s+(?P<day>\d{1,2}),?\s+(?P<year>\d{4})" + _CLOCK
_DAY_FIRST = r"(?P<day>\d{1,2})/(?P<month>\d{1,2})/(?P<year>\d{4})" + _CLOCK
_TWO_NUMBERS_FIRST = re.compile(r"\s*(\d{1,2})/(\d{1,2})/(\d{4}|\d\d)(?!\d)")
AIR_PRESSURE = 10.1325
"""Air pressure to subtract from absolute pressures. [dbar]"""
AIR_PRESSURE_NOTE = f"{AIR_PRESSURE} dbar of air pressure subtracted from the absolute pressure"


def instrument_table(path: Path, lines: Lines) -> InstrumentTable | None:
    """Read the columns of an instrument's file; None if the text has no known instrument format."""
    head = [line.strip() for line in lines[:400]]
    reader = next((read for known, read in _FORMATS if known(head)), None)
    if reader is None:
        return None
    try:
        sheet = reader(lines)
    except (IndexError, KeyError, StopIteration, ValueError):
        raise OceanError(
            f"{path}: the header of this instrument's file is damaged; export it again"
        ) from None
    if not any(sheet.titles) or not sheet.rows:
        what = "columns" if not any(sheet.titles) else "rows"
        unread = f"; not read: {', '.join(sheet.unread)}" if sheet.unread else ""
        raise OceanError(f"{path}: a file of {sheet.instrument} without {what} that are known{unread}")
    return _with_valid_time(sheet)


def _with_valid_time(sheet: InstrumentTable) -> InstrumentTable:
    """Replace a time that cannot be read by a note: most uses of a cast need no time."""
    if not sheet.time:
        return sheet
    try:
        parse_instant(sheet.time)
    except OceanError:
        return sheet._replace(time="", notes=(*sheet.notes, f"time {sheet.time[:40]!r} not read"))
    return sheet


def _sea_bird(lines: Lines) -> InstrumentTable:
    end = next(i for i, line in enumerate(lines) if line.startswith("*END*"))
    head = [line.lstrip("*# ").strip() for line in lines[:end]]
    entries = [m.groups() for line in head if (m := re.match(r"name\s+\d+\s*=\s*([^:]+):?(.*)", line))]
    names = [name.strip() for name, _ in entries]
    bad = next((float(m[1]) for line in head if (m := re.match(r"bad_flag\s*=\s*(\S+)", line))), -9.99e-29)
    rows: Rows = {}
    for i, line in enumerate(lines[end + 1 :], end + 2):
        cells = line.split()
        if len(cells) != len(names):  # numbers of eleven characters may touch
            cells = [line[k : k + 11].strip() for k in range(0, len(line.rstrip()), 11)]
        if len(cells) == len(names):
            rows[i] = ["" if _value(cell) == bad else cell for cell in cells]
    titles = _first_of_each(
        next((title for pattern, title in _SEA_BIRD if re.fullmatch(pattern, name)), "") for name in names
    )
    position = _position_in(head)
    notes = [
        *_without_flagged_rows(names, rows),
        *_on_its_90(titles, rows),
        *_measured_depth(titles, [about for _, about in entries], rows, position),
    ]
    for key in (r"NMEA UTC \(Time\)\s*=", r"start_time\s*=", r"System UTC\s*=", r"System UpLoad Time\s*="):
        if time := _iso(_after(head, key), _MONTH_NAME_FIRST):
            break
    return InstrumentTable("Sea-Bird", titles, rows, position, time, tuple(notes), names)


def _without_flagged_rows(names: Sequence[str], rows: Rows) -> Iterator[str]:
    """Drop rows with a bad flag, and yield a note."""
    if "flag" in names:
        flagged = [i for i, cells in rows.items() if not cells[names.index("flag")]]
        for i in flagged:
            del rows[i]
        if flagged:
            yield f"{len(flagged)} rows rejected by a bad flag"


def _on_its_90(titles: list[str], rows: Rows) -> Iterator[str]:
    """Convert temperatures from IPTS-68 to ITS-90, and yield a note."""
    for k, title in enumerate(titles):
        if title.endswith(" 68"):
            titles[k] = title.removesuffix(" 68")
            freezing = 32.0 if "degF" in title else 0.0
            _convert(rows, k, 1.0 / 1.00024, freezing - freezing / 1.00024)
            yield "temperature converted from ITS-68 to ITS-90 (divided by 1.00024)"


def _measured_depth(
    titles: list[str], about: Sequence[str], rows: Rows, position: tuple[str, str]
) -> Iterator[str]:
    """Convert depths that Seasoft computed for fresh water, or for another latitude, back to pressure; yield a note."""
    for k, title in enumerate(titles):
        pressure = any(other.startswith("pressure") for other in titles)
        stated = re.search(rf"lat\s*=\s*({_NUMBER.pattern})", about[k])
        unit = 0.3048 if title.endswith("[ft]") else 1.0
        if title.startswith("fresh_water_depth"):
            titles[k] = "" if pressure else "pressure [dbar]"
            if not pressure:
                _convert(rows, k, unit / _FRESH_WATER_DEPTH)
                yield f"pressure from depth in fresh water, {_FRESH_WATER_DEPTH} m/dbar"
        elif title.startswith("depth") and stated and not pressure:
            latitude, place = float(stated[1]), position_in_text(*position)[0]
            if abs(latitude) <= 90.0 and (place is None or abs(place[0] - latitude) > _SAME_LATITUDE):
                titles[k] = "pressure [dbar]"
                for cells in rows.values():
                    cells[k] = repr(float(gsw.p_from_z(-unit * _value(cells[k]), latitude)))
                yield f"pressure from depth, which the file computed for latitude {latitude:g}"


def _sippican(lines: Lines) -> InstrumentTable:
    first = r"\s*(Depth \((m|ft)\)|// Data\s*$)"
    start = next((i for i, line in enumerate(lines) if re.match(first, line, re.IGNORECASE)), len(lines))
    head = [line.lstrip("/ ").strip() for line in lines[: start + 1]]
    fields = {
        int(m[1]): m[2] for line in head if (m := re.match(r"Field\s*(\d+)\s*:\s*(.*)", line, re.IGNORECASE))
    }
    named = re.findall(r"[A-Za-z][A-Za-z ]*?\s*\([^)]*\)", head[-1]) if head else []
    names = [fields[k] for k in sorted(fields)] or named
    date, notes = _month_first(_after(head, r"Date of Launch\s*:"))
    clock = re.match(r"\d{1,2}:\d{2}(:\d{2})?", _after(head, r"Time of Launch\s*:"))
    salinity = _NUMBER.search(_after(head, r"Sound velocity derived with assumed salinity\s*:?|Salinity\s*:"))
    if salinity:
        notes.append(f"sound speed computed with an assumed salinity of {salinity[0]}")
    return InstrumentTable(
        "Sippican",
        _titles(names),
        _numeric_rows(lines, start + 1, None),
        _position_in(head),
        date + (f"T{clock[0]:0>8}" if date and clock else ""),
        tuple(notes),
        names,
    )


def _kongsberg(lines: Lines) -> InstrumentTable:
    first = next(i for i, line in enumerate(lines) if line.strip())
    words = lines[first].strip("() \t").split()
    time, lat, lon = [*words[3:6], "", "", ""][:3]
    digits = re.fullmatch(r"(\d{4})(\d\d)(\d\d)(\d\d)(\d\d)(\d\d)?", time)
    stamp = "{}-{}-{}T{}:{}:{}".format(*digits.groups(default="00")) if digits else ""
    rows = _numeric_rows(lines, first + 1, None)
    return InstrumentTable("Kongsberg", ["depth [m]", "sound_speed [m/s]"], rows, (lat, lon), stamp)


def _castaway(lines: Lines) -> InstrumentTable:
    head = [line.lstrip("% ").strip() for line in lines if line.startswith("%")]
    start = next(
        (i for i, line in enumerate(lines) if line.strip() and not line.startswith("%")), len(lines) - 1
    )
    lat, lon = (_after(head, rf"Start {axis}\s*,") for axis in ("latitude", "longitude"))
    time = _after(head, r"Cast time \(UTC\)\s*,").replace(" ", "T")
    names = lines[start].split(",")
    rows = _numeric_rows(lines, start + 1, ",")
    return InstrumentTable("CastAway", _titles(names), rows, (lat, lon), time, names=names)


def _sections(lines: Lines) -> InstrumentTable:
    """Read files of Valeport and AML with ``[sections]`` of ``key=value``; the last section contains the data."""
    start = next(i for i, line in enumerate(lines) if line.strip().lower() in ("[data]", "[measurementdata]"))
    pairs = (line.split("=", 1) for line in lines[:start] if "=" in line)
    keys = {key.strip().lower(): value.strip() for key, value in pairs}
    aml = "[measurementdata]" in lines[start].lower() or "sn" in keys or "date" in keys
    following = [i for i in range(start + 1, len(lines)) if lines[i].strip()]
    separator = "\t" if following and "\t" in lines[following[0]] else ","
    titles, units = keys.get("columns", "").split(","), keys.get("units", "").split(",")
    if "columns" not in keys and following:
        titles, units = lines[following[0]].split(separator), []
        if len(following) > 1 and not any(
            _NUMBER.fullmatch(c.strip()) for c in lines[following[1]].split(separator)
        ):
            units = lines[following[1]].split(separator)
    if len(units) == len(titles):
        titles = [f"{t} ({u.strip('()[] ')})" if u.strip() else t for t, u in zip(titles, units, strict=True)]
    lat, lon = (keys.get(f"gps{axis}") or keys.get(axis, "") for axis in ("latitude", "longitude"))
    stamps = (keys.get(k) for k in ("datastarttime", "datestarttime", "time_stamp", "timestamp"))
    time = next((s for s in stamps if s), "")
    notes: list[str] = []
    if not time and "date" in keys:
        date, notes = _month_first(keys["date"])
        time = f"{date or keys['date']} {keys.get('time', '')}".strip()
    time = re.sub(r"^(\d{4})[./](\d\d?)[./](\d\d?)", r"\1-\2-\3", time).replace(" ", "T")
    rows = _numeric_rows(lines, start + 1, separator)
    maker = "AML" if aml else "Valeport"
    return InstrumentTable(maker, _titles(titles), rows, (lat, lon), time, tuple(notes), titles)


def _valeport_midas(lines: Lines) -> InstrumentTable:
    start = next(
        (i for i, line in enumerate(lines) if line.upper().startswith("DATE / TIME")), len(lines) - 1
    )
    head = [line.strip() for line in lines[:start]]
    names = [re.sub(r"^([^;]*);(.*)$", r"\1 (\2)", cell) for cell in lines[start].split("\t")]
    time = _iso(_after(head, r"Time Stamp\s*:"), _DAY_FIRST)
    rows = _numeric_rows(lines, start + 1, "\t")
    return InstrumentTable("Valeport", _titles(names), rows, _position_in(head), time, names=names)


def _valeport_mini(lines: Lines) -> InstrumentTable:
    start = next((i for i, line in enumerate(lines) if line.startswith("Pressure units:")), len(lines) - 1)
    head = [line.strip() for line in lines[: start + 1]]
    metres = _after(head, "Pressure units:").lower().startswith("m")
    down = "depth [m]" if metres else "pressure [dbar]"
    model = next((line.split(":")[0] for line in head if re.match(r"(MiniSVP|MiniCTD|RapidSVT?):", line)), "")
    columns = {
        "RapidSV": [down, "sound_speed [m/s]"],
        "MiniCTD": [down, "temperature [degC]", ""],
    }.get(model, [down, "temperature [degC]", "sound_speed [m/s]"])
    time = _iso(_after(head, r"Now\s*:"), _DAY_FIRST)
    return InstrumentTable(
        "Valeport", columns, _numeric_rows(lines, start + 1, None), _position_in(head), time
    )


def _rbr(lines: Lines) -> InstrumentTable:
    start = next(
        i
        for i, line in enumerate(lines)
        if re.match(r"\s*(time|timestamp|date & time)\b", line, re.IGNORECASE)
    )
    separator = "," if "," in lines[start] else None
    words = (
        [cell.strip() for cell in lines[start].split(",")]
        if separator
        else ["date", "time", *lines[start].split()[3:]]
    )
    sea = any(re.match(r"sea ?pres", word, re.IGNORECASE) for word in words)
    titles = _titles("" if sea and re.match("pres", w, re.IGNORECASE) else w for w in words)
    rows, notes = _numeric_rows(lines, start + 1, separator), []
    if (
        not sea
        and (k := next((k for k, title in enumerate(titles) if title.startswith("pressure")), None))
        is not None
    ):
        notes.append(AIR_PRESSURE_NOTE)
        _convert(rows, k, 1.0, -AIR_PRESSURE)
    head = [line.strip() for line in lines[:start]]
    first = next((line for line in lines[start + 1 :] if line.strip()), "")
    time = re.match(r"\s*(\d{4})[-/](\d\d)[-/](\d\d)[ T](\d\d:\d\d:\d\d)", first)
    stamp = f"{time[1]}-{time[2]}-{time[3]}T{time[4]}" if time else ""
    return InstrumentTable("RBR", titles, rows, _position_in(head), stamp, tuple(notes), words)


def _any(pattern: str) -> Callable[[Lines], bool]:
    """Test for a line in the head of a file that begins with a pattern."""
    return lambda head: any(re.match(pattern, line, re.IGNORECASE) for line in head)


_FORMATS: tuple[tuple[Callable[[Lines], bool], Callable[[Lines], InstrumentTable]], ...] = (
    (_any(r"\*END\*"), _sea_bird),
    (_any(r"\(\s*SoundVelocity\b"), _kongsberg),
    (_any(r"(//\s*)?(Date of Launch|Probe Type)\s*:"), _sippican),
    (_any(r"%\s*(Device|Cast time|File name)"), _castaway),
    (_any(r"\[(data|measurementdata)\]$"), _sections),
    (_any(r"Previous File Location\s*:"), _valeport_midas),
    (_any(r"Pressure units:"), _valeport_mini),
    (lambda head: bool(head) and _any(r"(Model=|RBR )")(head[:3]) and _any("(time|timestamp|date & time)")(head), _rbr),
    (lambda head: bool(head) and re.match(r"time,.*\b(sea pressure|speed of sound)\b", head[0], re.IGNORECASE) is not None, _rbr),
)  # fmt: skip


def _titles(cells: Iterable[str]) -> list[str]:
    """Convert titles of a file, such as ``Pressure (Decibar)``, to titles of this package; empty for unused columns."""
    return _first_of_each(_title(cell) for cell in cells)


def _title(cell: str) -> str:
    match = re.fullmatch(r"\s*(.*?)\s*(?:[(\[]([^)\]]*)[)\]])?\s*", cell)
    name, unit = (match[1], match[2] or "") if match else (cell, "")
    quantity = next((q for pattern, q in _QUANTITIES if re.search(pattern, name.strip().lower())), "")
    if not quantity:
        return ""
    known = known_unit(unit)
    return f"{quantity} [{known}]" if known else quantity


def known_unit(unit: str) -> str:
    """Convert the unit of an instrument's column to its usual spelling; other units stay as they are."""
    return _UNITS.get(unit.strip().lower(), unit.strip())


def _first_of_each(titles: Iterable[str]) -> list[str]:
    """Remove the titles of second columns of a quantity."""
    out: list[str] = []
    for title in titles:
        quantity = title.split(" [")[0]
        out.append("" if any(other.split(" [")[0] == quantity for other in out) else title)
    return out


def _numeric_rows(lines: Lines, start: int, separator: str | None) -> Rows:
    """Rows from a line onward with at least one number; other cells become empty."""
    rows = {}
    for i, line in enumerate(lines[start:], start + 1):
        cells = [cell.strip() for cell in line.split(separator)]
        numbers = [cell if _NUMBER.fullmatch(cell) else "" for cell in cells]
        if any(numbers):
            rows[i] = numbers
    return rows


def _after(head: Iterable[str], pattern: str) -> str:
    """Text behind a key, from the first line of a header with this key."""
    for line in head:
        if match := re.match(rf"(?:{pattern})(.*)", line, re.IGNORECASE):
            return match[1].strip()
    return ""


def _convert(rows: Rows, k: int, factor: float, offset: float = 0.0) -> None:
    """Multiply the numbers of a column by a factor and add an offset."""
    for cells in rows.values():
        cells[k] = repr(factor * _value(cells[k]) + offset) if cells[k] else ""


def _value(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _position_in(head: Lines) -> tuple[str, str]:
    """Texts of latitude and longitude from the lines of a header."""
    lat, lon = (_after(head, rf"(?:NMEA )?{axis}\s*[=:]") for axis in ("Latitude", "Longitude"))
    return lat, lon


def _month_first(words: str) -> tuple[str, list[str]]:
    """Convert a date such as 07/24/2014 to ISO 8601, and note an assumption; the day is first if it cannot be a month."""
    match = _TWO_NUMBERS_FIRST.match(words)
    if match is None:
        return "", [f"date {words[:40]!r} not read"] if words and not words[:4].isdigit() else []
    month, day = int(match[1]), int(match[2])
    year = int(match[3]) + (2000 if len(match[3]) == 2 else 0)
    notes = []
    if month > 12:
        month, day = day, month
    elif day <= 12 and month != day:
        notes = [f"date {match[0].strip()!r}: the month is assumed to be first"]
    return f"{year}-{month:02d}-{day:02d}", notes


def _iso(words: str, layout: str) -> str:
    """Convert a date, with its time if present, to ISO 8601; empty if the text has no date of this layout."""
    match = re.match(layout, words)
    if match is None:
        return ""
    date = match.groupdict(default="")
    month = date["month"] if date["month"].isdigit() else MONTHS.get(date["month"].lower())
    if month is None:
        return ""
    year = int(date["year"]) + (2000 if len(date["year"]) == 2 else 0)
    return f"{year}-{int(month):02d}-{int(date['day']):02d}" + (
        f"T{date['time']:0>8}" if date.get("time") else ""
    )
