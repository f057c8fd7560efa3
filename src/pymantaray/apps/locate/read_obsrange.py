"""
Reader of survey text for OBSrange.

The Scripps format has one event per line; the Woods Hole format has a table below ``#`` lines.

The grammar follows the sample files of https://github.com/jbrussell/OBSrange. Both formats have the
drop point and its depth in the header and one position of the ship per ping. Altitudes are the
antenna's height and are not used.
"""

import re
from pathlib import Path

import numpy as np

from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.read_rows import check_positions, seconds_of_day, skipped_note
from pymantaray.apps.locate.survey import Node, Survey
from pymantaray.arrays import Array
from pymantaray.errors import LocateError
from pymantaray.geometry import LocalFrame
from pymantaray.messages import one_line
from pymantaray.quantities.checks import parsed_number
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.position_rows import FASTEST_PLATFORM, PositionRows
from pymantaray.user_files import read_text

_FIRST_DAY = np.datetime64("1970-01-01", "s")
_LAST_DAY = np.datetime64("2200-01-01", "s")
_DAYS = 366
_SIGMA = (2000.0, 2000.0, 200.0)  # m; standard deviations of a drop point and a charted depth
_ANGLE = r"\d+\s+\d+(?:\.\d*)?\s*"  # followed by the letter of a side
_LAT = rf"(?P<lat>{_ANGLE}[NSns])"
_LON = rf"(?P<lon>{_ANGLE}[EWew])"
_SECONDS = r"\d{1,2}(?:\.\d*)?"
_PING = re.compile(
    rf"^\s*(?P<ms>\d+(?:\.\d*)?)\s*msec\.?\s+Lat:\s*{_LAT}\s+Lon:\s*{_LON}"
    r"(?:\s+Alt:\s*\S+)?\s+Time\s*\(UTC\):\s*"
    rf"(?P<year>\d{{4}}):(?P<day>\d{{1,3}}):(?P<clock>\d{{1,2}}:\d{{1,2}}:{_SECONDS})\s*$"
)
_ALLOWED = (
    "a ping; write it as 6306 msec. Lat: 4 52.9270 S  Lon: 132 41.4272 W  Alt: 29 Time(UTC):"
    " 2018:114:06:04:30"
)
_LOOKS_LIKE_PING = re.compile(r"^\s*-?[\d.]+\s*msec", re.IGNORECASE)
_ROW = re.compile(
    r"^\s*(?P<date>\d{4}-\d{2}-\d{2})\s+(?P<clock>\d{1,2}:\d{2}:\d{2}(?:\.\d*)?)"
    rf"\s*,\s*\d*\s*,\s*(?P<ms>[\d.]*)\s*,\s*{_LAT}\s*,\s*{_LON}"
    r"\s*,\s*(?P<gps>\d{1,2}:\d{2}:\d{2}(?:\.\d*)?)"
)
_DATE = re.compile(r"^\s*\d{4}-\d{2}-\d{2}\s")
_HEAD = re.compile(r"^\s*#?\s*(?P<key>[A-Za-z][A-Za-z ()\-/]*?)\s*:\s*(?P<value>.*?)\s*$")


def is_obsrange(path: Path) -> bool:
    """True if the header of a file has a drop point."""
    text = read_text(path, LocateError, errors="replace")
    return re.search(r"drop[ -]*point", text[:4000], re.IGNORECASE) is not None


def read_obsrange(path: Path, options: ReadOptions) -> Survey:
    """Read the survey of one node."""
    head, table, lines, notes = _events(path)
    positions = PositionRows(path, LocateError, fastest=FASTEST_PLATFORM)
    keep = positions.possible(table[:, 0], table[:, 2:], lines, geographic=True)
    positions.refuse_most(int(keep.sum()))
    time, ms, lat, lon = table[keep].T
    # drop point
    drop = _coordinate(path, head, "latitude"), _coordinate(path, head, "longitude")
    keys = ["site", "instrument", "station"]
    if "drop-point latitude" in head:
        keys.insert(0, "instrument")
    name = next((head[key] for key in keys if head.get(key)), path.stem)
    check_positions(path, (lat, lon), drop, name)
    depth = options.depth if options.depth is not None else _depth(path, head)
    delay = re.fullmatch(r"([\d.]+)\s*ms", head.get("tat", "").strip())
    turn_around = float(delay[1]) / 1000.0 if delay else 0.0
    # survey about the drop point
    frame = LocalFrame(*drop)
    north, east = frame.to_local(lat, lon)
    position = np.column_stack([north, east, np.full(time.size, options.transducer_depth)])
    transmit_time, transmit_position, receive_position = options.both_ends(
        time - time[0], ms / 1000.0, position
    )
    survey = Survey(
        nodes=(Node(name, (0.0, 0.0, depth), _SIGMA, turn_around=turn_around),),
        node=np.zeros(time.size, dtype=np.int64),
        time=transmit_time,
        travel_time=ms / 1000.0,
        transmit_position=transmit_position,
        receive_position=receive_position,
        line=np.array(lines)[keep],
        frame=frame,
        epoch=np.datetime64(round(1e9 * float(time[0])), "ns"),
        source=str(path),
        notes=(*notes, *positions.notes),
    )
    return options.apply(survey)


def _events(path: Path) -> tuple[dict[str, str], Array, list[int], tuple[str, ...]]:
    """Header, pings (n, 4) as in `_ping`, their lines, and notes about the other lines."""
    head: dict[str, str] = {}
    pings: list[tuple[float, float, float, float]] = []
    lines: list[int] = []
    n_skipped = 0
    invalid = InvalidLines()
    text = read_text(path, LocateError, errors="replace")
    for number, line in enumerate(text.splitlines(), 1):
        is_comment = line.lstrip().startswith("#")
        row = _ROW.match(line)
        if not is_comment and (ping := _ping(line)):
            pings.append(ping)
            lines.append(number)
        elif row and not row["ms"]:
            n_skipped += 1
        elif row or _LOOKS_LIKE_PING.match(line) or (pings and _DATE.match(line)):
            invalid.add(path, number, f"{one_line(line, 60)!r} is not {_ALLOWED}")
        elif not pings and (entry := _HEAD.match(line)) and "skipped" not in line.lower():
            head.setdefault(entry["key"].lower(), entry["value"])
        elif line.strip() and not set(line.strip()) <= set("=-#") and not is_comment:
            n_skipped += 1
    invalid.refuse_most(len(pings), LocateError)
    if not pings:
        raise LocateError(
            f"{path}: none of {n_skipped} events has an answer; the survey needs answers"
        )
    return head, np.array(pings), lines, (*skipped_note(path, n_skipped), *invalid.notes)


def _ping(line: str) -> tuple[float, float, float, float] | None:
    """
    Time since 1970 [s], two-way time [ms], latitude and longitude of a line; None for other lines.
    """
    try:
        if match := _PING.match(line):
            day = int(match["day"])
            time = _instant(f"{match['year']}-01-01", match["clock"]) + 86400.0 * (day - 1)
            if not 1 <= day <= _DAYS:
                return None
        elif (match := _ROW.match(line)) and match["ms"]:
            line_time = _instant(match["date"], match["clock"])
            time = _instant(match["date"], match["gps"])
            time += 86400.0 * round((line_time - time) / 86400.0)  # use the date of the line
        else:
            return None
        return time, float(match["ms"]), _angle(match["lat"]), _angle(match["lon"])
    except (ValueError, OverflowError):  # no such date, or no number
        return None


def _instant(date: str, clock: str) -> float:
    """Seconds since 1970; a ValueError for a date or a time that does not exist."""
    day = np.datetime64(date, "s")
    if not _FIRST_DAY <= day <= _LAST_DAY:
        raise ValueError(date)
    return float(day.astype(np.int64)) + seconds_of_day(clock)


def _angle(text: str) -> float:
    """Degrees of text such as ``4 52.9270 S``; a ValueError for an angle that does not exist."""
    side = text.strip()[-1]
    degrees, minutes = text.strip().removesuffix(side).split()
    value = int(degrees) + float(minutes) / 60.0
    if not (float(minutes) < 60.0 and value <= (90.0 if side in "NSns" else 360.0)):
        raise ValueError(degrees)
    return value * (-1.0 if side in "SWsw" else 1.0)


def _coordinate(path: Path, head: dict[str, str], which: str) -> float:
    """Latitude or longitude of the drop point, in degrees, or degrees and minutes with a letter."""
    text = next((value for key, value in head.items() if "drop" in key and which in key), "")
    try:
        value = parsed_number(text)
    except ValueError:
        if re.fullmatch(f"{_ANGLE}[NSEWnsew]", text.strip()) is None:
            raise LocateError(
                f"{path}: drop point {which} is {text!r}; it must be degrees, or degrees and"
                " minutes such as 01 35.6114 N"
            ) from None
        try:
            value = _angle(text)
        except ValueError:
            value = np.inf
    limit = 90.0 if which == "latitude" else 360.0
    if not abs(value) <= limit:
        raise LocateError(
            f"{path}: drop point {which} is {value:g}; it must be -{limit:g} to {limit:g} degrees"
        )
    return value


def _depth(path: Path, head: dict[str, str]) -> float:
    text = next((value for key, value in head.items() if "depth" in key), "")
    try:
        value = abs(parsed_number(text))
    except ValueError:
        value = 0.0
    if not value > 0.0:
        raise LocateError(f"{path}: the drop point's depth is {text!r}; give `depth` in metres")
    return value
