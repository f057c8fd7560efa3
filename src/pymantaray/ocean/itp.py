"""
Reader of profiles of WHOI's ice-tethered profilers (``itpNgrdMMMM.dat``, level 3).

The first line is ``%ITP N, profile M: year day longitude(E+) latitude(N+) ndepths``, the second has
these numbers, the third the names of the columns, in newer files with the year and the day of each
level; ``%endofdat`` ends the file. Day 1.0 is 1 January, 0 h. Sources: files of WHOI in public
repositories, and the comments of other readers.
"""

import re

import numpy as np

from pymantaray.errors import OceanError
from pymantaray.ocean.instrument_table import (
    InstrumentTable,
    Lines,
    known_titles,
    number_of,
    numeric_rows,
)

ITP_HEADER = re.compile(r"%\s*ITP\s+\d+\s*,\s*profile", re.IGNORECASE)
_ORDER = ("year", "day", "longitude", "latitude", "ndepths")


def read_itp(lines: Lines) -> InstrumentTable:
    """Read the columns of a profile."""
    about = [number_of(word) for word in lines[1].split()]
    if len(about) < len(_ORDER) or not lines[2].lstrip().startswith("%"):
        raise OceanError(
            "a file of an ice-tethered profiler without the year, day, longitude, latitude and"
            " number of levels of a profile"
        )
    year, day, longitude, latitude, levels = about[: len(_ORDER)]
    names = lines[2].strip().lstrip("%").split()
    end = next((i for i, line in enumerate(lines) if line.startswith("%endofdat")), len(lines))
    rows = {
        i: cells
        for i, cells in numeric_rows(lines[:end], 3, None).items()
        if len(cells) == len(names)
    }
    notes = []
    if len(rows) != levels:
        notes.append(
            f"{len(rows)} levels, but the header states {levels:g}: the file may be incomplete"
        )
    return InstrumentTable(
        "ITP",
        known_titles(names),
        rows,
        (f"{latitude}", f"{longitude}"),
        _instant(year, day),
        tuple(notes),
        names,
    )


def _instant(year: float, day: float) -> str:
    """Instant to the second from a year and a day with fraction; empty if they are none."""
    if not (1970 <= year <= 2200 and 1.0 <= day < 367.0):
        return ""
    start = np.datetime64(f"{int(year)}-01-01", "s")
    return str(start + np.timedelta64(round(86_400.0 * (day - 1.0)), "s"))
