"""
Readers of tracks of surface vehicles: GPX (https://www.topografix.com/GPX/1/1/), and sentences of
NMEA 0183 from a GNSS receiver (GGA, RMC, ZDA). Their depth is 0.
"""

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from pymantaray.errors import ExchangeError
from pymantaray.exchange.tracks import Poses
from pymantaray.records.digits import counted
from pymantaray.user_files import read_text

NMEA = re.compile(r"[^$]{0,60}\$[A-Z]{5},[^ ]")
"""Start of a line with a sentence, perhaps behind a name and a stamp of the logger."""
_SENTENCE = re.compile(r"\$([A-Z]{2}(GGA|RMC|ZDA),[^*\r\n]*)(?:\*([0-9A-Fa-f]{2}))?")
_ANGLE = re.compile(r"(\d{0,3})([0-5]\d(?:\.\d*)?)")  # loggers omit leading zeros of degrees
_MEASURED = ("1", "2", "3", "4", "5")  # qualities of GGA; then estimated, manual and simulated
_CLOCK = r"(?P<clock>\d\d:\d\d:\d\d(?:\.\d*)?)"
# times of loggers on ships: 2010-03-15T14:08:45.876, 03/15/2010,14:08:45 or 2010:074:14:08:45
_STAMPS = tuple(
    re.compile(rf"\b{date}{_CLOCK}")
    for date in (
        r"(?P<year>\d{4})[-/](?P<month>\d\d)[-/](?P<day>\d\d)[T ,]\s*",
        r"(?P<month>\d\d)/(?P<day>\d\d)/(?P<year>\d{4})[ ,]\s*",
        r"(?P<year>\d{4}):(?P<day_of_year>\d{3}):",
    )
)
_DAY = 86_400.0  # s


def read_gpx(path: Path) -> tuple[list[Poses], list[str]]:
    """Read each track of a GPX file as a vehicle; points without a time are left out."""
    text = read_text(path, ExchangeError)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ExchangeError(f"{path}: declares a document type, which GPX files do not have")
    try:
        root = ET.fromstring(text)
    except ET.ParseError as error:
        raise ExchangeError(f"{path}: no XML ({error}); export the track again") from None
    tracks = list(root.iterfind(".//{*}trk"))
    poses, left = [], 0
    for number, track in enumerate(tracks):
        points, times = [], []
        for point in track.iterfind(".//{*}trkpt"):
            time = point.find("{*}time")
            try:
                place = float(point.attrib["lat"]), float(point.attrib["lon"])
                instant = _instant(time.text if time is not None and time.text else "")
            except (KeyError, ValueError):
                left += 1
                continue
            points.append((*place, 0.0))
            times.append(instant)
        name = track.findtext("{*}name") or ""
        name = name.strip() or (path.stem if len(tracks) == 1 else f"{path.stem}-{number + 1}")
        if points:
            poses.append(_surface(name, times, points, path))
    if not poses:
        raise ExchangeError(
            f"{path}: no track with points that have a time; waypoints and routes have none"
        )
    return poses, [f"{path}: {counted(left, 'point')} without position or time"] if left else []


class _Sentence(NamedTuple):
    """Content of a sentence of NMEA."""

    kind: str
    clock: float
    """Seconds of the day; NaN without a fix."""
    instant: float | None
    """Seconds since 1970; None without a date."""
    place: tuple[float, float] | None
    """Latitude and longitude of a fix; None without one. [degrees]"""
    logged: float | None = None
    """Seconds since 1970 of the logger's stamp; None without one."""

    @classmethod
    def of(cls, cells: list[str], kind: str) -> "_Sentence":
        """Read the cells of a sentence; raises IndexError or ValueError if they are invalid."""
        if kind == "ZDA":
            date = f"{cells[2]:0>2}{cells[3]:0>2}{cells[4][-2:]}"
            return cls(kind, _clock(cells[1]), _dated(date, cells[1]), None)
        if kind == "GGA" and cells[6] in _MEASURED:
            return cls(kind, _clock(cells[1]), None, _place(cells[2:6]))
        if kind == "RMC" and cells[2] == "A":
            instant = _dated(cells[9], cells[1]) if cells[9] else None
            return cls(kind, _clock(cells[1]), instant, _place(cells[3:7]))
        # a date is then that of a clock without a fix, such as 1980
        return cls.without_fix(kind)

    @classmethod
    def without_fix(cls, kind: str) -> "_Sentence":
        """Sentence without time and place."""
        return cls(kind, math.nan, None, None)


def read_nmea(path: Path) -> tuple[list[Poses], list[str]]:
    """
    Read the fixes of a GNSS receiver as one vehicle, with dates of RMC or ZDA; if it writes none,
    with those of the stamps that a logger writes before each sentence.

    Of sentences with the same time GGA has priority. Sentences with a wrong checksum and those
    without a measured fix (void, estimated, manual or simulated) are left out, with their dates.
    ZDA does not say if the receiver has a fix: its date counts only between measured fixes.
    """
    sentences: list[_Sentence] = []
    wrong = 0
    for line in read_text(path, ExchangeError, errors="replace").splitlines():
        match = _SENTENCE.search(line)
        if match is None:
            continue
        body, kind, checksum = match[1], match[2], match[3]
        if checksum and reduce(xor, body.encode(), 0) != int(checksum, 16):
            wrong += 1
            continue
        try:
            one = _Sentence.of(body.split(","), kind)
        except (IndexError, ValueError):
            one = _Sentence.without_fix(kind)
        sentences.append(one._replace(logged=_logged(line[: match.start()])))
    dated, unused = _with_usable_dates(sentences)
    measured = [one for one in dated if one.place is not None or one.instant is not None]
    measured, logged = _with_logged_dates(measured)
    merged = _by_time(measured, path)
    times = sorted(merged)
    instants = [np.datetime64(round(1e9 * time), "ns") for time in times]
    points = [(*merged[time], 0.0) for time in times]
    notes = [
        f"{path}: {counted(count, 'sentence')} {why}"
        for count, why in (
            (wrong, "with a wrong checksum"),
            (len(dated) - len(measured), "without a valid fix"),
            (unused, "ZDA beside those without a valid fix, with dates that are not used"),
            (logged, "with the date of the logger's stamp (month/day/year if it has slashes)"),
        )
        if count
    ]
    return [_surface(path.stem, instants, points, path)], notes


def _with_usable_dates(sentences: list[_Sentence]) -> tuple[list[_Sentence], int]:
    """Remove dates of ZDA before or after a sentence without a fix, and return their number."""
    beside = [True] * len(sentences)
    for order in (range(len(sentences)), reversed(range(len(sentences)))):
        fixed = True
        for i in order:
            if sentences[i].kind == "ZDA":
                beside[i] &= fixed or sentences[i].instant is None
            else:
                fixed = sentences[i].place is not None
    usable = [one for one, good in zip(sentences, beside, strict=True) if good]
    return usable, len(sentences) - len(usable)


def _with_logged_dates(measured: list[_Sentence]) -> tuple[list[_Sentence], int]:
    """Give fixes the dates of the logger if no sentence has one, and return their number."""
    if any(one.instant is not None for one in measured):
        return measured, 0
    dated = [
        one if one.logged is None else one._replace(instant=_nearest(one.clock, one.logged))
        for one in measured
    ]
    return dated, sum(one.instant is not None for one in dated)


def _by_time(measured: list[_Sentence], path: Path) -> dict[float, tuple[float, float]]:
    """
    Places by seconds since 1970.

    A fix without a date is on the day that is nearest to the sentence before, or to the one behind
    if it is before all dates.
    """
    if not any(one.place for one in measured):
        raise ExchangeError(f"{path}: no valid fix among its GGA and RMC sentences")
    start = next((i for i, one in enumerate(measured) if one.instant is not None), None)
    if start is None:
        raise ExchangeError(
            f"{path}: fixes without a date; the receiver must also write RMC or ZDA sentences with"
            " a valid fix, or the logger stamps such as 2010-03-15T14:08:45"
        )
    places: dict[str, dict[float, tuple[float, float]]] = {"RMC": {}, "GGA": {}}
    first = float(measured[start].instant or 0.0)
    for part in (measured[start:], measured[:start][::-1]):
        last = first
        for one in part:
            last = _nearest(one.clock, last) if one.instant is None else one.instant
            if one.place is not None:
                places[one.kind][last] = one.place
    return places["RMC"] | places["GGA"]


def _surface(
    name: str,
    times: Sequence[np.datetime64],
    points: Sequence[tuple[float, float, float]],
    path: Path,
) -> Poses:
    """Track of a surface vehicle, of latitudes and longitudes in degrees."""
    instants = np.array(times, dtype="datetime64[ns]")
    return Poses(name, instants, np.array(points), None, True, str(path), stated_degrees=True)


def _instant(text: str) -> np.datetime64:
    """Instant of ISO 8601 in UTC."""
    time = datetime.fromisoformat(text.strip())
    time = time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    return np.datetime64(time.replace(tzinfo=None), "ns")


def _clock(text: str) -> float:
    """Seconds of the day of a time such as 192000.25."""
    if not re.fullmatch(r"\d{6}(\.\d*)?", text):
        raise ValueError(text)
    return 3600.0 * int(text[:2]) + 60.0 * int(text[2:4]) + float(text[4:])


def _dated(date: str, clock: str) -> float:
    """Seconds since 1970 of a date such as 240714 and a time of day; years from 1980 to 2079."""
    if not re.fullmatch(r"\d{6}", date):
        raise ValueError(date)
    year = int(date[4:]) + (2000 if int(date[4:]) < 80 else 1900)
    day = datetime(year, int(date[2:4]), int(date[:2]), tzinfo=UTC)
    return day.timestamp() + _clock(clock)


def _logged(text: str) -> float | None:
    """Seconds since 1970 of a stamp in the text before a sentence; None without a valid one."""
    match = next(filter(None, (pattern.search(text) for pattern in _STAMPS)), None)
    if match is None:
        return None
    own = match.groupdict()
    try:
        if "day_of_year" in own:
            day = datetime.strptime(f"{own['year']} {own['day_of_year']} +0000", "%Y %j %z")
        else:
            day = datetime(int(own["year"]), int(own["month"]), int(own["day"]), tzinfo=UTC)
        return day.timestamp() + _clock(own["clock"].replace(":", ""))
    except ValueError:
        return None


def _nearest(clock: float, last: float) -> float:
    """Instant with a time of day that is nearest to another instant. [s]"""
    return clock + _DAY * round((last - clock) / _DAY)


def _place(cells: list[str]) -> tuple[float, float]:
    """Latitude and longitude of four cells: degrees with minutes, and hemisphere. [degrees]"""
    place = []
    for value, side, signs in (
        (cells[0], cells[1], {"N": 1.0, "S": -1.0}),
        (cells[2], cells[3], {"E": 1.0, "W": -1.0}),
    ):
        match = _ANGLE.fullmatch(value)
        if match is None or side not in signs:
            raise ValueError(value)
        place.append(signs[side] * (int(match[1] or 0) + float(match[2]) / 60.0))
    return place[0], place[1]
