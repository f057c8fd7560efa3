"""
Readers of text files from instruments and their programs, as columns with names and units of this
package.

The content, not the suffix, identifies the format: Sea-Bird ``.cnv`` (Seasoft manual, converted
data format), Sippican ``.edf`` (XBT, XCTD, XSV), Kongsberg ``.asvp``, SonTek CastAway, Valeport
(VPD, VP2, MIDAS, MiniSVP), AML (``.aml`` and SeaCast's CSV), text of RBR Ruskin, WHP-exchange
(`pymantaray.ocean.whp`) and ice-tethered profilers (`pymantaray.ocean.itp`). Sources for the
headers are the manual of the Simrad ME70 (EDF) and files for HydrOffice's Sound Speed Manager.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import gsw

from pymantaray.errors import OceanError
from pymantaray.ocean.convert import parse_instant, vertical_of
from pymantaray.ocean.instrument_table import (
    NUMBER,
    InstrumentTable,
    Lines,
    Rows,
    first_of_each,
    known_titles,
    known_unit,
    number_of,
    numeric_rows,
    on_its_90,
    position_texts,
    scale_column,
    text_after,
    written_date,
    written_instant,
)
from pymantaray.ocean.itp import ITP_HEADER, read_itp
from pymantaray.ocean.positions import position_in_text
from pymantaray.ocean.whp import WHP_HEADER, read_whp
from pymantaray.records.digits import counted

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
    (r"(c|cond)_?\d?S/m", "measured_conductivity [S/m]"),
    (r"(c|cond)_?\d?mS/cm", "measured_conductivity [mS/cm]"),
    (r"(c|cond)_?\d?uS/cm", "measured_conductivity [uS/cm]"),
    (r"sv[CDW]M\d?", "sound_speed [m/s]"),
    (r"sv[CDW]F\d?", "sound_speed [ft/s]"),
    (r"latitude", "lat [degrees]"),
    (r"longitude", "lon [degrees]"),
)
_SAIV = (
    (r"Press", "pressure [dbar]"),
    (r"Temp", "temperature [degC]"),
    (r"Sal", "salinity [1]"),
    (r"S\. ?vel", "sound_speed [m/s]"),
)
_FRESH_WATER_DEPTH = 1.019716
"""Seasoft's depth in fresh water over pressure. [m/dbar]"""
_SAME_LATITUDE = 0.05  # degrees; depth changes by less than 2e-6 of itself
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
    except OceanError as error:
        raise OceanError(f"{path}: {error}") from None
    except (IndexError, KeyError, StopIteration, ValueError):
        raise OceanError(
            f"{path}: the header of this instrument's file is damaged; export it again"
        ) from None
    if not any(sheet.titles) or not sheet.rows:
        what = "columns" if not any(sheet.titles) else "rows"
        unread = f"; not read: {', '.join(sheet.unread)}" if sheet.unread else ""
        raise OceanError(
            f"{path}: a file of {sheet.instrument} without {what} that are known{unread}"
        )
    # a note replaces a time that cannot be read: most uses of a cast need no time
    if sheet.time:
        try:
            parse_instant(sheet.time)
        except OceanError:
            note = f"time {sheet.time[:40]!r} not read"
            return sheet._replace(time="", notes=(*sheet.notes, note))
    return sheet


def _sea_bird(lines: Lines) -> InstrumentTable:
    end = next(i for i, line in enumerate(lines) if line.startswith("*END*"))
    head = [line.lstrip("*# ").strip() for line in lines[:end]]
    entries = [
        m.groups() for line in head if (m := re.match(r"name\s+\d+\s*=\s*([^:]+):?(.*)", line))
    ]
    names = [name.strip() for name, _ in entries]
    bad = next(
        (float(m[1]) for line in head if (m := re.match(r"bad_flag\s*=\s*(\S+)", line))), -9.99e-29
    )
    rows: Rows = {}
    for i, line in enumerate(lines[end + 1 :], end + 2):
        cells = line.split()
        if len(cells) != len(names):  # numbers of eleven characters may touch
            cells = [line[k : k + 11].strip() for k in range(0, len(line.rstrip()), 11)]
        if len(cells) == len(names):
            rows[i] = ["" if number_of(cell) == bad else cell for cell in cells]
    titles = first_of_each(
        next((title for pattern, title in _SEA_BIRD if re.fullmatch(pattern, name)), "")
        for name in names
    )
    position = position_texts(head)
    notes = [
        *_without_flagged_rows(names, rows),
        *on_its_90(titles, rows),
        *_measured_depth(titles, [about for _, about in entries], rows, position),
    ]
    for key in (
        r"NMEA UTC \(Time\)\s*=",
        r"start_time\s*=",
        r"System UTC\s*=",
        r"System UpLoad Time\s*=",
    ):
        time, about_time = written_instant(text_after(head, key))
        if time:
            notes += about_time
            break
    return InstrumentTable("Sea-Bird", titles, rows, position, time, tuple(notes), names)


def _without_flagged_rows(names: Sequence[str], rows: Rows) -> Iterator[str]:
    """Drop rows with a bad flag, and yield a note."""
    if "flag" in names:
        flagged = [i for i, cells in rows.items() if not cells[names.index("flag")]]
        for i in flagged:
            del rows[i]
        if flagged:
            yield f"{counted(len(flagged), 'row')} rejected by a bad flag"


def _measured_depth(
    titles: list[str], about: Sequence[str], rows: Rows, position: tuple[str, str]
) -> Iterator[str]:
    """
    Convert depths that Seasoft computed for fresh water, or for another latitude, back to pressure;
    yield a note.
    """
    for k, title in enumerate(titles):
        pressure = any(other.startswith("pressure") for other in titles)
        stated = re.search(rf"lat\s*=\s*({NUMBER.pattern})", about[k])
        unit = 0.3048 if title.endswith("[ft]") else 1.0
        if title.startswith("fresh_water_depth"):
            titles[k] = "" if pressure else "pressure [dbar]"
            if not pressure:
                scale_column(rows, k, unit / _FRESH_WATER_DEPTH)
                yield f"pressure from depth in fresh water, {_FRESH_WATER_DEPTH} m/dbar"
        elif title.startswith("depth") and stated and not pressure:
            latitude = float(stated[1])
            place = position_in_text(*position)[0]
            if abs(latitude) <= 90.0 and (
                place is None or abs(place[0] - latitude) > _SAME_LATITUDE
            ):
                titles[k] = "pressure [dbar]"
                for cells in rows.values():
                    cells[k] = repr(float(gsw.p_from_z(-unit * number_of(cells[k]), latitude)))
                yield f"pressure from depth, which the file computed for latitude {latitude:g}"


def _sippican(lines: Lines) -> InstrumentTable:
    first = r"\s*(Depth \((m|ft)\)|// Data\s*$)"
    start = next(
        (i for i, line in enumerate(lines) if re.match(first, line, re.IGNORECASE)), len(lines)
    )
    head = [line.lstrip("/ ").strip() for line in lines[: start + 1]]
    fields = {
        int(m[1]): m[2]
        for line in head
        if (m := re.match(r"Field\s*(\d+)\s*:\s*(.*)", line, re.IGNORECASE))
    }
    named = re.findall(r"[A-Za-z][A-Za-z ]*?\s*\([^)]*\)", head[-1]) if head else []
    names = [fields[k] for k in sorted(fields)] or named
    date, notes = written_date(text_after(head, r"Date of Launch\s*:"))
    clock = re.match(r"\d{1,2}:\d{2}(:\d{2})?", text_after(head, r"Time of Launch\s*:"))
    salinity = NUMBER.search(
        text_after(head, r"Sound velocity derived with assumed salinity\s*:?|Salinity\s*:")
    )
    if salinity:
        notes.append(f"sound speed computed with an assumed salinity of {salinity[0]}")
    return InstrumentTable(
        "Sippican",
        known_titles(names),
        numeric_rows(lines, start + 1, None),
        position_texts(head),
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
    return InstrumentTable(
        "Kongsberg",
        ["depth [m]", "sound_speed [m/s]"],
        numeric_rows(lines, first + 1, None),
        (lat, lon),
        stamp,
    )


def _castaway(lines: Lines) -> InstrumentTable:
    head = [line.lstrip("% ").strip() for line in lines if line.startswith("%")]
    start = next(
        (i for i, line in enumerate(lines) if line.strip() and not line.startswith("%")),
        len(lines) - 1,
    )
    lat, lon = (text_after(head, rf"Start {axis}\s*,") for axis in ("latitude", "longitude"))
    time, notes = written_instant(text_after(head, r"Cast time \(UTC\)\s*,"))
    names = lines[start].split(",")
    return InstrumentTable(
        "CastAway",
        known_titles(names),
        numeric_rows(lines, start + 1, ","),
        (lat, lon),
        time,
        tuple(notes),
        names,
    )


def _sections(lines: Lines) -> InstrumentTable:
    """
    Read files of Valeport and AML with ``[sections]`` of ``key=value``; the last section contains
    the data.
    """
    start = next(
        i for i, line in enumerate(lines) if line.strip().lower() in ("[data]", "[measurementdata]")
    )
    pairs = (line.split("=", 1) for line in lines[:start] if "=" in line)
    keys = {key.strip().lower(): value.strip() for key, value in pairs}
    aml = "[measurementdata]" in lines[start].lower() or "sn" in keys or "date" in keys
    following = [i for i in range(start + 1, len(lines)) if lines[i].strip()]
    separator = "\t" if following and "\t" in lines[following[0]] else ","
    titles = keys.get("columns", "").split(",")
    units = keys.get("units", "").split(",")
    if "columns" not in keys and following:
        titles = lines[following[0]].split(separator)
        units = []
        if len(following) > 1 and not any(
            NUMBER.fullmatch(c.strip()) for c in lines[following[1]].split(separator)
        ):
            units = lines[following[1]].split(separator)
    if len(units) == len(titles):
        titles = [
            f"{t} ({u.strip('()[] ')})" if u.strip() else t
            for t, u in zip(titles, units, strict=True)
        ]
    lat, lon = (keys.get(f"gps{axis}") or keys.get(axis, "") for axis in ("latitude", "longitude"))
    stamps = (keys.get(k) for k in ("datastarttime", "datestarttime", "time_stamp", "timestamp"))
    stamp = next((s for s in stamps if s), "")
    # Valeport writes the day first
    time, notes = written_instant(
        stamp or f"{keys.get('date', '')} {keys.get('time', '')}", day_first=bool(stamp)
    )
    return InstrumentTable(
        "AML" if aml else "Valeport",
        known_titles(titles),
        numeric_rows(lines, start + 1, separator),
        (lat, lon),
        time,
        tuple(notes),
        titles,
    )


def _valeport_midas(lines: Lines) -> InstrumentTable:
    start = next(
        (i for i, line in enumerate(lines) if line.upper().startswith("DATE / TIME")),
        len(lines) - 1,
    )
    head = [line.strip() for line in lines[:start]]
    names = [re.sub(r"^([^;]*);(.*)$", r"\1 (\2)", cell) for cell in lines[start].split("\t")]
    time, notes = written_instant(text_after(head, r"Time Stamp\s*:"), day_first=True)
    return InstrumentTable(
        "Valeport",
        known_titles(names),
        numeric_rows(lines, start + 1, "\t"),
        position_texts(head),
        time,
        tuple(notes),
        names,
    )


def _valeport_mini(lines: Lines) -> InstrumentTable:
    start = next(
        (i for i, line in enumerate(lines) if line.startswith("Pressure units:")), len(lines) - 1
    )
    head = [line.strip() for line in lines[: start + 1]]
    unit = known_unit(text_after(head, "Pressure units:")) or "dbar"
    down = f"{vertical_of(unit, 'pressure')} [{unit}]"
    model = next(
        (line.split(":")[0] for line in head if re.match(r"(MiniSVP|MiniCTD|RapidSVT?):", line)), ""
    )
    columns = {
        "RapidSV": [down, "sound_speed [m/s]"],
        "MiniCTD": [down, "temperature [degC]", ""],
    }.get(model, [down, "temperature [degC]", "sound_speed [m/s]"])
    time, notes = written_instant(text_after(head, r"Now\s*:"), day_first=True)
    return InstrumentTable(
        "Valeport",
        columns,
        numeric_rows(lines, start + 1, None),
        position_texts(head),
        time,
        tuple(notes),
    )


def _saiv(lines: Lines) -> InstrumentTable:
    start = next(i for i, line in enumerate(lines) if line.startswith("Ser\tMeas"))
    names = [name.strip() for name in lines[start].split("\t")]
    titles = first_of_each(
        next((title for form, title in _SAIV if re.match(form, name, re.IGNORECASE)), "")
        for name in names
    )
    rows = numeric_rows([line.replace(",", ".") for line in lines], start + 1, "\t")
    series = [cells[0] for cells in rows.values()]
    used = {i: cells for i, cells in rows.items() if cells[0] == series[0]}
    left = len(set(series)) - 1
    notes = [f"series {series[0]} is read, {counted(left, 'other series')} not"] if left else []
    first = dict(zip(names, lines[min(used) - 1].split("\t"), strict=False)) if used else {}
    when = f"{first.get('Date', '')} {first.get('Time', '')}".strip()
    time, about_time = written_instant(when, day_first=True)
    return InstrumentTable("SAIV", titles, used, ("", ""), time, (*notes, *about_time), names)


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
    titles = known_titles("" if sea and re.match("pres", w, re.IGNORECASE) else w for w in words)
    rows = numeric_rows(lines, start + 1, separator)
    notes = []
    if (
        not sea
        and (k := next((k for k, title in enumerate(titles) if title.startswith("pressure")), None))
        is not None
    ):
        notes.append(AIR_PRESSURE_NOTE)
        scale_column(rows, k, 1.0, -AIR_PRESSURE)
    head = [line.strip() for line in lines[:start]]
    first = next((line for line in lines[start + 1 :] if line.strip()), "")
    stamp, about_time = written_instant(first.split(separator or "\n")[0], day_first=True)
    notes += about_time
    return InstrumentTable("RBR", titles, rows, position_texts(head), stamp, tuple(notes), words)


def _any(pattern: str) -> Callable[[Lines], bool]:
    """Test for a line in the head of a file that begins with a pattern."""
    return lambda head: any(re.match(pattern, line, re.IGNORECASE) for line in head)


_FORMATS: tuple[tuple[Callable[[Lines], bool], Callable[[Lines], InstrumentTable]], ...] = (
    (_any(r"\*END\*"), _sea_bird),
    (lambda head: bool(head) and WHP_HEADER.match(head[0]) is not None, read_whp),
    (lambda head: bool(head) and ITP_HEADER.match(head[0]) is not None, read_itp),
    (_any(r"\(\s*SoundVelocity\b"), _kongsberg),
    (_any(r"(//\s*)?(Date of Launch|Probe Type)\s*:"), _sippican),
    (_any(r"%\s*(Device|Cast time|File name)"), _castaway),
    (_any(r"\[(data|measurementdata)\]$"), _sections),
    (_any(r"Previous File Location\s*:"), _valeport_midas),
    (_any(r"Pressure units:"), _valeport_mini),
    (_any(r"Ser\tMeas\t"), _saiv),
    (lambda head: bool(head) and _any(r"(Model=|RBR"
                                      r" )")(head[:3]) and _any("(time|timestamp|date &"
                                                                " time)")(head), _rbr),
    (lambda head: bool(head) and re.match(r"time,.*\b(sea pressure|speed of"
                                          r" sound)\b", head[0], re.IGNORECASE) is not None, _rbr),
)  # fmt: skip
