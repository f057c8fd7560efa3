"""
Reader of files of CTDs (``_ct1.csv``) and bottles (``_hy1.csv``) in the WHP-exchange format of
CCHDO.

The first line is ``CTD,`` and a date stamp; header lines are ``KEY = value``; a line of names, a
line of units, then rows until ``END_DATA``. Columns ``NAME_FLAG_W`` have WOCE's quality flags,
``NAME_FLAG_I`` those of IGOSS. Files of bottles have no header lines: each row has its station,
cast, date and position, and values of the CTD at the closure. Sources: files of CCHDO, and its
description of the format, https://github.com/cchdo/exchange.
"""

import re
from itertools import product
from pathlib import Path

from pymantaray.errors import OceanError
from pymantaray.ocean.instrument_table import (
    ITS_90_NOTE,
    InstrumentTable,
    Lines,
    Rows,
    number_of,
    numeric_rows,
    on_its_90,
)
from pymantaray.records.digits import counted

WHP_HEADER = re.compile(r"CTD,\s*\d{8}")
_TITLES = {"CTDPRS": "pressure [dbar]", "CTDTMP": "temperature [degC]", "CTDSAL": "salinity [1]"}
_BAD = {"_FLAG_W": "3459", "_FLAG_I": "349"}
"""Flags of questionable, bad, not reported and not sampled values."""
_FILL = -900.0  # degC; -999 is missing


def read_whp(lines: Lines) -> InstrumentTable:
    """Read the columns of a CTD file, without values whose flags are bad."""
    start, end = _extent(lines)
    keys = {
        key.strip(): value.strip()
        for key, _, value in (
            line.partition("=") for line in lines[1:start] if not line.startswith("#")
        )
    }
    names = [name.strip() for name in lines[start].split(",")]
    units = [unit.strip() for unit in lines[start + 1].split(",")]
    rows = numeric_rows(lines[:end], start + 2, ",")
    notes = _without_bad(names, rows, *_TITLES)
    titles = [
        _TITLES.get(name, "") + (" 68" if name == "CTDTMP" and "68" in unit else "")
        for name, unit in zip(names, [*units, *[""] * len(names)], strict=False)
    ]
    notes += [*on_its_90(titles, rows), *_incomplete(lines, end)]
    time = keys.get("TIME", "")
    date = keys.get("DATE", "")
    if date and not time:
        notes.append("time of day unknown: 0 h assumed")
    return InstrumentTable(
        "WHP-exchange",
        titles,
        rows,
        (keys.get("LATITUDE", ""), keys.get("LONGITUDE", "")),
        _instant(date, time),
        tuple(notes),
        names,
        number_of(keys.get("DEPTH", "")),
    )


def bottle_table(path: str | Path, lines: Lines) -> tuple[str, tuple[str, ...]]:
    """
    Return the casts of a file of bottles as a table of casts with the same lines, and notes.

    The salinity is that of the CTD, or of the bottle if the CTD has none that is good.
    """
    try:
        start, end = _extent(lines)
    except OceanError as error:
        raise OceanError(f"{path}: {error}") from None
    names = [name.strip() for name in lines[start].split(",")]
    units = dict(zip(names, (unit.strip() for unit in lines[start + 1].split(",")), strict=False))
    rows = {
        i: [cell.strip() for cell in line.split(",")]
        for i, line in enumerate(lines[start + 2 : end], start + 2)
        if line.strip() and not line.startswith("#")
    }
    notes = _without_bad(names, rows, "CTDPRS", "CTDTMP", "CTDSAL", "SALNTY")
    old_scale = "68" in units.get("CTDTMP", "")
    salinities = [name for name in ("CTDSAL", "SALNTY") if name in names]
    table = [""] * len(lines)
    from_bottles = 0
    table[start] = "station,time,lat,lon,pressure_dbar,temperature,salinity"
    for i, cells in rows.items():
        if len(cells) < len(names):
            table[i] = ",".join(cells[:6])  # truncated, for the list of invalid lines
            continue
        row = dict(zip(names, cells, strict=False))
        salinity = [row[name] for name in salinities if number_of(row[name]) > 0.0]
        from_bottles += bool(salinity) and row.get("CTDSAL") != salinity[0]
        temperature = row.get("CTDTMP", "")
        if old_scale and number_of(temperature) > _FILL:
            temperature = repr(number_of(temperature) / 1.00024)
        station = f"{row.get('STNNBR', '')}/{row.get('CASTNO', '')}".strip("/")
        time = _instant(row.get("DATE", ""), row.get("TIME", ""))
        place = row.get("LATITUDE", ""), row.get("LONGITUDE", "")
        water = row.get("CTDPRS", ""), temperature, salinity[0] if salinity else ""
        table[i] = ",".join([station, time, *place, *water])
    if from_bottles:
        notes.append(f"salinity of {counted(from_bottles, 'bottle')}, where the CTD has none")
    if old_scale:
        notes.append(ITS_90_NOTE)
    return "\n".join(table), (*notes, *_incomplete(lines, end))


def _instant(date: str, time: str) -> str:
    """Instant of a date and a time of day such as 945, which may be missing."""
    return f"{date}T{time:0>4}" if date and time else date


def _incomplete(lines: Lines, end: int) -> list[str]:
    return ["no END_DATA: the file may be incomplete"] if end == len(lines) else []


def _extent(lines: Lines) -> tuple[int, int]:
    """Indices of the line of names, and of the line behind the last row."""
    start = next(
        (i for i, line in enumerate(lines) if "CTDPRS" in re.split(r"\s*,\s*", line.strip())), None
    )
    if start is None or start + 1 == len(lines):
        raise OceanError(
            "a WHP-exchange file without a column CTDPRS, the pressure; use another file of this"
            " cruise"
        )
    return start, next(
        (i for i, line in enumerate(lines) if line.strip() == "END_DATA"), len(lines)
    )


def _without_bad(names: list[str], rows: Rows, *columns: str) -> list[str]:
    """Remove the values of columns whose flags are bad; returns a note with their number."""
    count = 0
    for name, (ending, bad) in product(columns, _BAD.items()):
        if name not in names or name + ending not in names:
            continue
        k, flag = names.index(name), names.index(name + ending)
        for cells in rows.values():
            if len(cells) > max(k, flag) and cells[k] and cells[flag] in bad and cells[flag]:
                cells[k] = ""
                count += 1
    return [f"{counted(count, 'value')} rejected by quality flags"] if count else []
