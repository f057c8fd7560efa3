"""
Reader of CTD files in the WHP-exchange format of CCHDO (``_ct1.csv``).

The first line is ``CTD,`` and a date stamp; header lines are ``KEY = value``; a line of names, a line of units, then rows until
``END_DATA``. Columns ``NAME_FLAG_W`` have WOCE's quality flags, ``NAME_FLAG_I`` those of IGOSS. Sources: files of CCHDO.
"""

import re

from pymantaray.errors import OceanError
from pymantaray.ocean.instrument_table import InstrumentTable, Lines, number_of, numeric_rows, on_its_90

WHP_HEADER = re.compile(r"(CTD|BOTTLE),\s*\d{8}")
_TITLES = {"CTDPRS": "pressure [dbar]", "CTDTMP": "temperature [degC]", "CTDSAL": "salinity [1]"}
_BAD = {"_FLAG_W": "3459", "_FLAG_I": "349"}
"""Flags of questionable, bad, not reported and not sampled values."""


def read_whp(lines: Lines) -> InstrumentTable:
    """Read the columns of a CTD file, without values whose flags are bad."""
    if lines[0].startswith("BOTTLE"):
        raise OceanError("a WHP-exchange file of bottles; only those of a CTD (_ct1.csv) are read")
    start = next(i for i, line in enumerate(lines) if "CTDPRS" in re.split(r"\s*,\s*", line.strip()))
    end = next((i for i, line in enumerate(lines) if line.strip() == "END_DATA"), len(lines))
    keys = {
        key.strip(): value.strip()
        for key, _, value in (line.partition("=") for line in lines[1:start] if not line.startswith("#"))
    }
    names = [name.strip() for name in lines[start].split(",")]
    units = [unit.strip() for unit in lines[start + 1].split(",")]
    rows = numeric_rows(lines[:end], start + 2, ",")
    rejected = 0
    for k, name in enumerate(names):
        for ending, bad in _BAD.items():
            if name + ending in names:
                flag = names.index(name + ending)
                for cells in rows.values():
                    if len(cells) > max(k, flag) and cells[k] and cells[flag] in bad and cells[flag]:
                        cells[k] = ""
                        rejected += name in _TITLES
    titles = [
        _TITLES.get(name, "") + (" 68" if name == "CTDTMP" and "68" in unit else "")
        for name, unit in zip(names, [*units, *[""] * len(names)], strict=False)
    ]
    notes = [f"{rejected} values rejected by quality flags"] if rejected else []
    notes += on_its_90(titles, rows)
    if end == len(lines):
        notes.append("no END_DATA: the file may be incomplete")
    time, date = keys.get("TIME", ""), keys.get("DATE", "")
    if date and not time:
        notes.append("time of day unknown: 0 h assumed")
    return InstrumentTable(
        "WHP-exchange",
        titles,
        rows,
        (keys.get("LATITUDE", ""), keys.get("LONGITUDE", "")),
        f"{date}T{time:0>4}" if date and time else date,
        tuple(notes),
        names,
        number_of(keys.get("DEPTH", "")),
    )
