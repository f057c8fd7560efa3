"""
Readers of tracks of surface vehicles: GPX (https://www.topografix.com/GPX/1/1/), and sentences of
NMEA 0183 from a GNSS receiver (GGA, RMC, ZDA). Their depth is 0.
"""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from pymantaray.errors import ExchangeError
from pymantaray.exchange.tracks import Poses
from pymantaray.records.digits import counted
from pymantaray.user_files import read_text

NMEA = re.compile(r"(?:\S*\s+)?\$[A-Z]{2}[A-Z]{3},")
"""Start of a line with a sentence, perhaps behind a stamp of the logger."""
_SENTENCE = re.compile(r"\$([A-Z]{2}(GGA|RMC|ZDA),[^*\r\n]*)(?:\*([0-9A-Fa-f]{2}))?")
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


def read_nmea(path: Path) -> tuple[list[Poses], list[str]]:
    """
    Read the fixes of a GNSS receiver as one vehicle, with dates of RMC or ZDA.

    Of sentences with the same time GGA has priority. Sentences with a wrong checksum and fixes that
    the receiver marks as invalid are left out.
    """
    fixes: dict[float, tuple[float, float]] = {}
    second: dict[float, tuple[float, float]] = {}
    waiting: list[tuple[float, tuple[float, float]]] = []
    last: float | None = None  # of a dated sentence, since 1970 [s]
    wrong = invalid = 0
    for line in read_text(path, ExchangeError, errors="replace").splitlines():
        match = _SENTENCE.search(line)
        if match is None:
            continue
        body, kind, checksum = match[1], match[2], match[3]
        if checksum and reduce(xor, body.encode(), 0) != int(checksum, 16):
            wrong += 1
            continue
        cells = body.split(",")
        try:
            if kind == "ZDA":
                last = _dated(f"{cells[2]}{cells[3]}{cells[4][-2:]}", cells[1])
                continue
            place, valid = _fix(cells, kind)
            if kind == "RMC":
                last = _dated(cells[9], cells[1])
            clock = _clock(cells[1])
        except (IndexError, ValueError):
            invalid += 1
            continue
        if not valid:
            invalid += 1
        elif kind == "RMC" and last is not None:
            second[last] = place
        elif last is None:
            waiting.append((clock, place))
        else:
            fixes[_nearest(clock, last)] = place
    if last is None and waiting:
        raise ExchangeError(
            f"{path}: fixes without a date; the receiver must also write RMC or ZDA sentences"
        )
    first = min([*second, *fixes, *([] if last is None else [last])], default=0.0)
    for clock, place in waiting:
        fixes.setdefault(_nearest(clock, first), place)
    merged = second | fixes
    if not merged:
        raise ExchangeError(f"{path}: no valid fix among its GGA and RMC sentences")
    times = sorted(merged)
    instants = [np.datetime64(round(1e9 * time), "ns") for time in times]
    points = [(*merged[time], 0.0) for time in times]
    notes = [
        f"{path}: {counted(count, 'sentence')} {why}"
        for count, why in ((wrong, "with a wrong checksum"), (invalid, "without a valid fix"))
        if count
    ]
    return [_surface(path.stem, instants, points, path)], notes


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


def _nearest(clock: float, last: float) -> float:
    """Instant with a time of day that is nearest to another instant. [s]"""
    return clock + _DAY * round((last - clock) / _DAY)


def _fix(cells: list[str], kind: str) -> tuple[tuple[float, float], bool]:
    """Latitude and longitude of a sentence [degrees], and True if the receiver has a fix."""
    first = 2 if kind == "GGA" else 3
    place = []
    for value, side, width in (
        (cells[first], cells[first + 1], 2),
        (cells[first + 2], cells[first + 3], 3),
    ):
        degrees = int(value[:width]) + float(value[width:]) / 60.0
        place.append(-degrees if side in ("S", "W") else degrees)
    valid = int(cells[6]) > 0 if kind == "GGA" else cells[2] == "A"
    return (place[0], place[1]), valid
