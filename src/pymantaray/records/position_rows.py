"""
Rows of positions and times that no vehicle can have had.

The one rule of all readers of surveys, events, tracks and trajectories. It leaves out rows without
a fix (latitude 0 with longitude 0, values outside the globe such as 999) and rows that no vehicle
can have reached from the rows before and after. It refuses positions in radians, and times that
pass midnight without a date. Longitudes may be in any turn. A plausible track is not changed.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pymantaray.arrays import AnyArray, Array, Indices, Mask
from pymantaray.errors import MantaRayError
from pymantaray.geometry.longitude import wrap_longitude
from pymantaray.records.digits import counted
from pymantaray.records.invalid_lines import InvalidLines

Position = tuple[float, float]
"""Latitude and longitude. [degrees]"""
_IMPOSSIBLE = "impossible position"
_RADIUS = 6371e3  # m
_ROUNDED = 1e-4  # degrees; a receiver without a fix writes 0, 0 with any number of digits
_ELSEWHERE = 10_000.0  # m; distance of all other rows from 0, 0
_SLACK = 100.0  # m; errors of positions, such as those of an acoustic fix
FASTEST_VEHICLE = 10.0
"""Speed of any vessel or vehicle after a long rest, for tracks of one vehicle. [m/s]"""
FASTEST_PLATFORM = 300.0
"""
Speed of any platform, for surveys and events, whose rows are not a continuous track and whose
travel times reveal smaller errors. [m/s]
"""
_FASTER = 5.0  # times the usual speed of a track
_USUAL = 0.25  # quantile of the speeds of a track, of which two per gross row are wrong
_FEWEST = 4  # rows that are judged
_LARGEST_PART = 0.2  # of the rows that may be out of reach
_MOST_PARTS = 20_000  # of a track between jumps
_MOST_COMPARED = 2000  # parts before a part
_JUMP_COST = 1.5  # rows
_FAR_SHARE = 0.1  # of all rows
FAR = 10_000.0
"""A longer jump is never the correction of dead reckoning. [m]"""
_FARTHEST = 100_000.0  # m; between any two pings of a survey
_RADIANS = (0.5 * np.pi, np.pi)
_SLOW = (3e-3, 0.5)  # m/s; speeds of vehicles whose radians are read as degrees
_DAY = 86_400.0  # s
_MOST_SHOWN = 3


class Jump(NamedTuple):
    """Step of a track that no vehicle can have made, without a return."""

    row: int
    distance: float
    """[m]"""
    duration: float
    """[s]"""


def is_position(latitude: float, longitude: float) -> bool:
    """Return True if a latitude is in -90 to 90 degrees and a longitude in -360 to 360 degrees."""
    return abs(latitude) <= 90.0 and abs(longitude) <= 360.0


def is_no_fix(latitude: float, longitude: float) -> bool:
    """Return True for 0, 0 and for values outside the globe, which receivers without a fix have."""
    return (latitude, longitude) == (0.0, 0.0) or not is_position(latitude, longitude)


def middle_longitude(longitude: Array) -> float:
    """Median of longitudes in any turn. [degrees]"""
    if np.ptp(longitude) < 180.0:
        return float(np.median(longitude))
    about = float(longitude[0])
    return float(wrap_longitude(float(np.median(wrap_longitude(longitude, about)))))


def distances(first: Array, second: Array, *, geographic: bool) -> Array:
    """Distance between positions (n, 2+): degrees on a sphere, or metres. [m]"""
    with np.errstate(over="ignore", invalid="ignore"):
        if not geographic:
            return np.asarray(np.linalg.norm(first[..., :2] - second[..., :2], axis=-1))
        lat, lat_2 = np.radians(first[..., 0]), np.radians(second[..., 0])
        half = 0.5 * np.radians(wrap_longitude(second[..., 1] - first[..., 1]))
        haversine = np.sin(0.5 * (lat_2 - lat)) ** 2
        haversine = haversine + np.cos(lat) * np.cos(lat_2) * np.sin(half) ** 2
        return np.asarray(2.0 * _RADIUS * np.arcsin(np.sqrt(np.clip(haversine, 0.0, 1.0))))


def impossible_positions(
    time: Array, position: Array, *, geographic: bool, fastest: float = FASTEST_VEHICLE
) -> tuple[dict[int, str], list[Jump]]:
    """
    Reason for each row of one vehicle whose position is impossible, and jumps without a return.

    ``time`` (n,) is in seconds; ``position`` (n, 2+) has latitude and longitude [degrees], or north
    and east [m]. Rows with NaN are not judged.
    """
    reasons = missing_fixes(position) if geographic else {}
    judged = np.isfinite(position[:, :2]).all(axis=1) & np.isfinite(time)
    judged[list(reasons)] = False
    rows = np.flatnonzero(judged)
    rows = rows[np.argsort(time[rows], kind="stable")]
    out_of_reach, jumps = _out_of_reach(time[rows], position[rows], geographic, fastest)
    for k, words in out_of_reach.items():
        row = int(rows[k])
        where = f"{position[row, 0]:.9g}, {position[row, 1]:.9g}"
        reasons[row] = f"position {where} is {words}"
    return reasons, [jump._replace(row=int(rows[jump.row])) for jump in jumps]


def missing_fixes(position: Array) -> dict[int, str]:
    """
    Reason for each row without a fix: latitude and longitude (n, 2+) are 0, 0 or off the globe.

    0, 0 is a position if another row is within 10 km of it. Rows with NaN are not judged.
    """
    judged = np.isfinite(position[:, :2]).all(axis=1)
    with np.errstate(invalid="ignore"):
        wrong = (np.abs(position[:, 0]) > 90.0) | (np.abs(position[:, 1]) > 360.0)
        zero = judged & (np.abs(position[:, :2]) <= _ROUNDED).all(axis=1)
    wrong &= judged
    reasons = {
        row: f"position is {lat:.9g}, {lon:.9g}; latitude must be -90 to 90 and longitude -360 to"
        f" 360 degrees{'; they may be exchanged' if abs(lat) > 90.0 and abs(lon) <= 90.0 else ''}"
        for row, (lat, lon) in zip(
            np.flatnonzero(wrong).tolist(), position[wrong, :2].tolist(), strict=True
        )
    }
    others = position[judged & ~wrong & ~zero]
    if (
        zero.any()
        and len(others)
        and distances(others, np.zeros_like(others), geographic=True).min() > _ELSEWHERE
    ):
        reasons |= {
            row: f"position {position[row, 0]:g}, {position[row, 1]:g} is no fix"
            for row in np.flatnonzero(zero).tolist()
        }
    return reasons


def _out_of_reach(
    time: Array, position: Array, geographic: bool, fastest: float
) -> tuple[dict[int, str], list[Jump]]:
    """
    Rows in order of time that cannot be reached from the others, and jumps without a return.

    A step may be as long as its duration at five times the usual speed, or at the stated one if
    that is faster, and 100 m longer.
    """
    if time.size < _FEWEST:
        return {}, []
    length = distances(position[:-1], position[1:], geographic=geographic)
    duration = np.diff(time)
    moves = duration > 0.0
    if not moves.any():
        return {}, []
    with np.errstate(over="ignore"):
        speed = length[moves] / duration[moves]
    limit = max(_FASTER * float(np.quantile(speed, _USUAL)), fastest)
    breaks = np.flatnonzero(~(length <= _SLACK + limit * duration))
    if not breaks.size:
        return {}, []
    last = time.size - 1
    parts = _Parts(time, position, geographic, np.append(0, breaks + 1), np.append(breaks, last))
    if breaks.size > _MOST_PARTS:
        widest = int(np.argmax(length[breaks]))
        return {}, [parts.step(widest, widest + 1)]
    chain = parts.chain(limit)
    words: dict[int, str] = {}
    for part in sorted(set(range(parts.starts.size)) - set(chain)):
        before = [k for k in chain if k < part]
        step = parts.step(before[-1], part) if before else parts.step(part, chain[0])
        apart = f"{1e-3 * step.distance:,.3g} km away from that {step.duration:g} s"
        apart = f"{apart} {'before' if before else 'after'}"
        words |= dict.fromkeys(range(int(parts.starts[part]), int(parts.ends[part]) + 1), apart)
    if len(words) > max(1.0, _LARGEST_PART * time.size):
        widest = int(np.argmax(length[breaks]))
        return {}, [parts.step(widest, widest + 1)]
    steps = [parts.step(i, j) for i, j in pairwise(chain)]
    return words, [step for step in steps if step.distance > _SLACK + limit * step.duration]


class _Parts(NamedTuple):
    """Parts of a track between steps that are too long, by their first and last rows."""

    time: Array
    position: Array
    geographic: bool
    starts: Indices
    ends: Indices

    def step(self, first: int, second: int) -> Jump:
        """Step from the end of one part to the start of another."""
        end, start = int(self.ends[first]), int(self.starts[second])
        metres = distances(self.position[end], self.position[start], geographic=self.geographic)
        return Jump(start, float(metres), float(self.time[start] - self.time[end]))

    def chain(self, limit: float) -> list[int]:
        """
        Parts with the most rows, where a jump between two of them costs rows.

        A jump costs 1.5 rows, so that one or two wrong rows are left out and a correction of dead
        reckoning is not. A jump of more than 10 km costs 1 row and a tenth of all rows.
        """
        size = (self.ends - self.starts + 1).astype(float)
        far_cost = 1.0 + _FAR_SHARE * self.time.size
        best = size.copy()
        before = np.full(size.size, -1)
        for j in range(1, size.size):
            start = int(self.starts[j])
            first = max(j - _MOST_COMPARED, 0)
            ends = self.ends[first:j]
            metres = distances(
                self.position[start], self.position[ends], geographic=self.geographic
            )
            reach = _SLACK + limit * (self.time[start] - self.time[ends])
            cost = np.where(metres < FAR, _JUMP_COST, far_cost)
            gain = best[first:j] - np.where(metres <= reach, 0.0, cost)
            i = int(np.argmax(gain))
            if gain[i] > 0.0:
                before[j] = first + i
                best[j] += gain[i]
        chain = [int(np.argmax(best))]
        while before[chain[-1]] >= 0:
            chain.append(int(before[chain[-1]]))
        return chain[::-1]


class PositionRows:
    """
    Rows of positions of a file whose impossible rows are left out, with notes.

    Parameters
    ----------
    source : object
        File, for messages.
    error : type of MantaRayError
        Error of the reader.
    noun : str
        Name of a row in messages.
    fastest : float
        Speed that is always possible: `FASTEST_VEHICLE` or `FASTEST_PLATFORM`. [m/s]
    """

    def __init__(
        self,
        source: str | Path,
        error: type[MantaRayError],
        *,
        noun: str = "line",
        fastest: float = FASTEST_VEHICLE,
    ) -> None:
        self._fastest = fastest
        self._source = Path(source)
        self._error = error
        self._noun = noun
        self._invalid = InvalidLines(_IMPOSSIBLE, noun=noun)
        self._jumps: list[str] = []

    def possible(
        self,
        time: Array,
        position: Array,
        line: Sequence[int] | Indices,
        *,
        geographic: bool,
        who: str = "",
        stated_degrees: bool = False,
    ) -> Mask:
        """
        True for the rows of one vehicle with possible positions; the others are noted.

        Positions in radians raise an error, and so does a jump without a return of more than 10 km
        in a track or 100 km in a survey.
        ``stated_degrees`` is True if the file states the unit.
        """
        named = f"{who}: " if who else ""
        reasons, jumps = impossible_positions(
            time, position, geographic=geographic, fastest=self._fastest
        )
        keep = np.ones(len(position), dtype=bool)
        for row, reason in reasons.items():
            self._invalid.add(self._source, int(line[row]), f"{named}{reason}")
            keep[row] = False
        for jump in jumps:
            at = f"{self._source}, {self._noun} {line[jump.row]}: {named}the position"
            step = f"{1e-3 * jump.distance:,.3g} km in {jump.duration:g} s"
            if jump.distance > (FAR if self._fastest < FASTEST_PLATFORM else _FARTHEST):
                raise self._error(
                    f"{at} changes by {step} and does not return; correct or remove the wrong rows"
                )
            self._jumps.append(f"{at} jumps by {step}")
        if geographic and not stated_degrees and looks_like_radians(time[keep], position[keep]):
            lat, lon = position[keep][0, :2]
            raise self._error(
                f"{self._source}: {named}positions such as {lat:g}, {lon:g} look like radians;"
                " convert them to degrees, or name the columns lat_deg and lon_deg if they are"
                " degrees"
            )
        return keep

    def refuse_most(self, valid: int) -> None:
        """Raise an error for the first row if at least as many rows are left out as are valid."""
        self._invalid.refuse_most(valid, self._error)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about rows that are left out, and about jumps."""
        shown = self._jumps[:_MOST_SHOWN]
        more = len(self._jumps) - len(shown)
        rest = [f"{self._source}: {counted(more, 'further jump')}"] if more else []
        return (*self._invalid.notes, *shown, *rest)


def looks_like_radians(time: Array, position: Array) -> bool:
    """
    True for latitudes and longitudes of a vehicle that would hardly move if they were degrees.

    All are within pi/2 and pi, and the median speed is 0.003 to 0.5 m/s, which is 0.2 to 29 m/s in
    radians.
    """
    lat, lon = np.abs(position[:, 0]), np.abs(position[:, 1])
    if not lat.size or lat.max() > _RADIANS[0] or lon.max() > _RADIANS[1]:
        return False
    order = np.argsort(time, kind="stable")
    duration = np.diff(time[order])
    length = distances(position[order][:-1], position[order][1:], geographic=True)
    moves = duration > 0.0
    if not moves.any():
        return False
    slow, fast = _SLOW
    return bool(slow < float(np.median(length[moves] / duration[moves])) < fast)


def order_of_times(
    time: Array,
    where: Callable[[int], str],
    error: type[MantaRayError],
    *,
    dated: bool,
    blocks: bool = False,
) -> tuple[Indices | None, str | None]:
    """
    Order of rows in time and a note about it; None for both if times do not decrease.

    A fall of more than half a day between times of day (seconds from 0 to 86400 without a date)
    raises an error, because midnight may lie between them. With ``blocks``, only whole files behind
    each other may be out of order: a single row raises an error.
    """
    falls = np.flatnonzero(np.diff(time) < 0.0)
    if not falls.size:
        return None, None
    # a row between two that are in order, or a block of one row
    after = np.minimum(falls + 2, time.size - 1)
    is_one_row = (time[after] >= time[falls]) | (np.diff(falls, append=time.size - 1) == 1)
    is_one_row[0] |= falls[0] == 0
    row = int(falls[0]) + 1
    line = f"{where(row)}: time {time[row]:.10g} s is before that of the row above,"
    line += f" {time[row - 1]:.10g} s"
    deepest = float(np.diff(time).min())
    if not dated and time.min() >= 0.0 and time.max() <= _DAY and deepest < -0.5 * _DAY:
        row = int(np.argmin(np.diff(time))) + 1
        raise error(
            f"{where(row)}: time falls from {time[row - 1]:.10g} to {time[row]:.10g} s, as from one"
            " day to the next; write dates, or add 86400 s after midnight"
        )
    if blocks and is_one_row.any():
        raise error(f"{line}; times must not decrease; correct them, or sort the rows")
    note = f"{line}; rows sorted by time ({counted(falls.size, 'fall')})"
    return np.argsort(time, kind="stable"), note


def repeated_rows(keys: Sequence[AnyArray]) -> Mask:
    """True for rows that have the same values in all columns as an earlier row."""
    numbers = [np.unique(key, return_inverse=True)[1].ravel() for key in keys]
    _, first = np.unique(np.column_stack(numbers), axis=0, return_index=True)
    repeated = np.ones(len(numbers[0]), dtype=bool)
    repeated[first] = False
    return repeated


def repeated_note(source: str | Path, lines: Sequence[int]) -> str:
    """Note about lines that repeat earlier lines."""
    shown = ", ".join(map(str, lines[:_MOST_SHOWN])) + (", ..." if len(lines) > _MOST_SHOWN else "")
    words = f"line {shown} repeats an earlier line"
    if len(lines) > 1:
        words = f"lines {shown} repeat earlier lines"
    return f"{source}: {counted(len(lines), 'ping')} counted once: {words}"
