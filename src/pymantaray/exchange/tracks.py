"""
Imported trajectories: poses of each vehicle at its own times, and their interpolation to common
times in a local frame.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, Slerp

from pymantaray.arrays import AnyArray, Array, Codes, Indices
from pymantaray.errors import ExchangeError
from pymantaray.geometry import LocalFrame
from pymantaray.records import Trajectories, VehicleStatus
from pymantaray.records.dates import seconds_since
from pymantaray.records.digits import counted
from pymantaray.records.position_rows import PositionRows, order_of_times
from pymantaray.records.text_table import check_speed

SAME_TIME = 1e-6
"""Times that differ by less count as one. [s]"""
_M_PER_DEGREE = 111_100.0
_DEEPEST = 12_000.0  # m
_ABOVE_SURFACE = 5.0  # m; up to this an error of a depth sensor, beyond it an axis that points up
_SAME_VEHICLE = 10.0  # m
_MAX_COMPARED = 50  # vehicles
_COMPARED_TIMES = 200
_MIN_STEP = 1e-3  # m; shorter steps do not define a course
_MAX_NAME_LENGTH = 64


class Poses(NamedTuple):
    """
    Poses of one vehicle in a file: times as dates or in seconds, lat, lon [deg] or north, east [m],
    depth [m].
    """

    name: str
    time: AnyArray
    place: Array
    """Shape (n, 3)."""
    quaternion: Array | None
    """
    Rotation from body (forward, right, down) to true north, east, down, (w, x, y, z); None if the
    file has none.
    """
    geodetic: bool
    file: str
    centre: tuple[float, float] | None = None
    """
    Latitude and longitude of the local frame's centre; None if the file does not contain it.
    [degrees]
    """
    line: Indices | None = None
    """Line of each pose in the file; None for a file without lines."""
    stated_degrees: bool = False
    """True if the file states that latitudes and longitudes are in degrees."""

    def rows(self, rows: Any) -> Poses:
        """
        Poses of some rows.

        Parameters
        ----------
        rows : index, mask or slice
            Selection of the rows, in any order.

        Returns
        -------
        Poses
        """
        return self._replace(
            time=self.time[rows],
            place=self.place[rows],
            quaternion=None if self.quaternion is None else self.quaternion[rows],
            line=None if self.line is None else self.line[rows],
        )


@dataclass(frozen=True, eq=False)
class Tracks:
    """
    Imported trajectories before the selection of a frame and common times; `read_trajectories`
    reads them.

    Parameters
    ----------
    poses : sequence of Poses
        Poses of each vehicle at increasing times, in seconds since the earliest pose.
    start : numpy.datetime64 or None
        Instant (UTC) of the earliest pose; None if the file has no dates.
    notes : sequence of str
        Changes and omissions by the reader.

    Examples
    --------
    >>> import pandas as pd
    >>> from pymantaray import read_trajectories
    >>> rows = {"time": [0, 60], "vehicle": "A", "north": [0, 30], "east": 0, "depth": 20}
    >>> tracks = read_trajectories(pd.DataFrame(rows))
    >>> tracks.names, tracks.duration, tracks.geodetic
    (['A'], 60.0, False)
    """

    poses: tuple[Poses, ...]
    start: np.datetime64 | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, poses: Sequence[Poses], notes: Sequence[str] = ()) -> Self:
        """
        Sort and check poses, and convert them to one clock.

        Parameters
        ----------
        poses : sequence of Poses
            At least one vehicle, in the form of a reader.
        notes : sequence of str
            Notes of the reader.

        Returns
        -------
        Tracks
        """
        for kind, unlike in (
            ("dates", [np.issubdtype(p.time.dtype, np.datetime64) for p in poses]),
            ("latitude and longitude", [p.geodetic for p in poses]),
        ):
            if len(set(unlike)) > 1:
                one = poses[unlike.index(True)]
                other = poses[unlike.index(False)]
                raise ExchangeError(
                    f"{one.file}: {one.name} has {kind}, but {other.name} of {other.file} does"
                    " not; either all or none must"
                )
        notes = list(notes)
        clean = [_clean(p, notes) for p in poses]
        names = [p.name for p in clean]
        double = next((p for p in clean if names.count(p.name) > 1), None)
        if double is not None:
            raise ExchangeError(
                f"{double.file}: two vehicles have the name {double.name}; rename one"
            )
        start = min(p.time[0] for p in clean)
        dated = clean[0].time.dtype.kind == "M"
        since = seconds_since if dated else np.subtract
        poses = tuple(p._replace(time=since(p.time, start)) for p in clean)
        return cls(poses, start if dated else None, tuple(notes))

    @classmethod
    def of_record(cls, truth: Trajectories) -> Self:
        """
        Convert a record in the local frame to tracks, without the times when a vehicle is not
        active.

        Parameters
        ----------
        truth : Trajectories
            Record.

        Returns
        -------
        Tracks
        """
        return cls.of(poses_of_record(truth, "trajectories"))

    def selected(self, names: Sequence[str]) -> Self:
        """
        Select vehicles.

        Parameters
        ----------
        names : sequence of str
            Names of vehicles; empty for all.

        Returns
        -------
        Tracks
        """
        unknown = [name for name in names if name not in self.names]
        if unknown:
            raise ExchangeError(
                f"no trajectory of {unknown[0]}; available: {', '.join(self.names[:12])}"
            )
        if not names:
            return self
        poses = [p for p in self.poses if p.name in names]
        begin = min(p.time[0] for p in poses)
        start = None if self.start is None else self.start + np.round(1e9 * begin).astype("m8[ns]")
        return replace(
            self, poses=tuple(p._replace(time=p.time - begin) for p in poses), start=start
        )

    @property
    def names(self) -> list[str]:
        """Names of the vehicles."""
        return [p.name for p in self.poses]

    @property
    def duration(self) -> float:
        """Time from the earliest to the latest pose. [s]"""
        return float(max(p.time[-1] for p in self.poses))

    @property
    def geodetic(self) -> bool:
        """True if positions are latitudes and longitudes."""
        return self.poses[0].geodetic

    @property
    def centre(self) -> tuple[float, float] | None:
        """
        Centre of the local frame in a file, else the middle of latitudes and longitudes, else None.
        [degrees]
        """
        named = next((p.centre for p in self.poses if p.centre is not None), None)
        if named is not None or not self.geodetic:
            return named
        lat, lon = (np.concatenate([p.place[:, k] for p in self.poses]) for k in (0, 1))
        lon = lon[0] + (lon - lon[0] + 180.0) % 360.0 - 180.0
        middle = [0.5 * float(values.min() + values.max()) for values in (lat, lon)]
        return middle[0], (middle[1] + 180.0) % 360.0 - 180.0

    def at(self, time: ArrayLike, frame: LocalFrame) -> Trajectories:
        """
        Interpolate poses to common times in a local frame.

        Parameters
        ----------
        time : array_like, shape (n_times,)
            Increasing times since the earliest pose. [s]
        frame : LocalFrame
            Frame of the result. Local positions without a known centre count as positions in this
            frame.

        Returns
        -------
        Trajectories
            Role ``track``. At its own times (within a microsecond), a vehicle has the pose of the
            file. Between two poses, positions are linear in time and attitudes rotate at a constant
            rate (slerp). Before its first and after its last pose, a vehicle is ABSENT at that
            pose. Without attitudes, it is level and heads along its course.
        """
        times = np.asarray(time, dtype=float)
        sampled = zip(*(_at(p, times) for p in self.in_frame(frame)), strict=True)
        position, quaternion, status = map(np.stack, sampled)
        return Trajectories(
            name=np.array(self.names),
            role=np.full(len(self.poses), "track"),
            time=times,
            position=position,
            quaternion=quaternion,
            status=status,
            start=np.datetime64("NaT", "us") if self.start is None else self.start,
            centre=(frame.latitude_deg, frame.longitude_deg),
        )

    def in_frame(self, frame: LocalFrame) -> list[Poses]:
        """
        Convert the poses of each vehicle to north, east, down of a frame.

        Parameters
        ----------
        frame : LocalFrame
            Frame of the result.

        Returns
        -------
        list of Poses
        """
        return [_local(p, frame) for p in self.poses]


def same_vehicle_notes(tracks: Tracks) -> list[str]:
    """
    Note for each pair of trajectories that are always so close together that they may be of one
    vehicle.
    """
    frame = LocalFrame(*(tracks.centre or (0.0, 0.0)))
    local = tracks.in_frame(frame)[:_MAX_COMPARED]
    notes = []
    for k, one in enumerate(local):
        for other in local[:k]:
            first = max(one.time[0], other.time[0])
            last = min(one.time[-1], other.time[-1])
            if last <= first:
                continue
            times = np.linspace(first, last, _COMPARED_TIMES)
            places = [
                np.column_stack([np.interp(times, p.time, axis) for axis in p.place.T])
                for p in (other, one)
            ]
            with np.errstate(over="ignore"):
                distance = float(np.linalg.norm(places[1] - places[0], axis=1).max())
            if distance < _SAME_VEHICLE:
                notes.append(
                    f"{one.file}: {other.name} and {one.name} are always within {distance:.2g} m;"
                    " if they are two estimates of one vehicle, select one of them by its name"
                )
    return notes


def poses_of_record(truth: Trajectories, file: str) -> list[Poses]:
    """Poses of each vehicle of a record while it is active, with dates if the record has a date."""
    time = truth.time
    if not np.isnat(truth.start):
        time = truth.start.astype("M8[ns]") + np.round(time * 1e9).astype("m8[ns]")
    rows = [np.flatnonzero(status == VehicleStatus.ACTIVE) for status in truth.status]
    return [
        Poses(
            str(name),
            time[r],
            truth.position[i, r],
            truth.quaternion[i, r],
            False,
            file,
            truth.centre,
        )
        for i, (name, r) in enumerate(zip(truth.name, rows, strict=True))
    ]


def with_times(truth: Trajectories, time: Array) -> Trajectories:
    """
    Add times to a record, interpolated as in `Tracks.at`; the status is that of the preceding
    sample.
    """
    times = union_of_times(truth.time, time)
    if times.size == truth.time.size:
        return truth
    before = np.searchsorted(truth.time, times + SAME_TIME) - 1
    rows = (
        _at(Poses("", truth.time, place, quaternion, False, ""), times)
        for place, quaternion in zip(truth.position, truth.quaternion, strict=True)
    )
    position, quaternion, _ = map(np.stack, zip(*rows, strict=True))
    status = truth.status[:, before]
    return replace(truth, time=times, position=position, quaternion=quaternion, status=status)


def union_of_times(first: Array, more: Array) -> Array:
    """
    Sorted union of times; the first array has priority for times that differ by less than a
    microsecond.
    """
    place = np.clip(np.searchsorted(first, more), 1, max(first.size - 1, 1))
    near = np.minimum(
        np.abs(first[place - 1] - more), np.abs(first[np.minimum(place, first.size - 1)] - more)
    )
    own = np.sort(more[near > SAME_TIME])
    own = own[np.diff(own, prepend=-np.inf) > SAME_TIME]
    return np.sort(np.concatenate([first, own]))


def level(heading: ArrayLike, pitch: ArrayLike = 0.0, roll: ArrayLike = 0.0) -> Array:
    """
    Quaternions (w, x, y, z), body to north, east, down, from headings, pitches (nose up) and rolls
    (right side down). [rad]
    """
    angles = np.stack(np.broadcast_arrays(heading, pitch, roll), axis=-1)
    return np.asarray(Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True))


def _possible(p: Poses, notes: list[str]) -> Poses:
    """Poses with possible positions in order of time; the rule is that of `PositionRows`."""
    dated = np.issubdtype(p.time.dtype, np.datetime64)
    seconds = seconds_since(p.time, p.time[0]) if dated else p.time
    line = np.arange(len(p.time)) if p.line is None else p.line
    noun = "pose" if p.line is None else "line"
    order, note = order_of_times(
        np.asarray(seconds, dtype=float),
        lambda row: f"{p.file}, {noun} {line[row]}: {p.name}",
        ExchangeError,
        dated=dated,
    )
    notes += [note] if note else []
    rows = PositionRows(p.file, ExchangeError, noun=noun)
    keep = rows.possible(
        seconds,
        np.asarray(p.place, dtype=float),
        line,
        geographic=p.geodetic,
        who=p.name,
        stated_degrees=p.stated_degrees,
    )
    rows.refuse_most(int(keep.sum()))
    notes += rows.notes
    if keep.all() and order is None:
        return p
    chosen = np.arange(keep.size) if order is None else order
    return p._replace(line=line).rows(chosen[keep[chosen]])


def _clean(p: Poses, notes: list[str]) -> Poses:
    """Check poses, sort them by time and drop repeated times; changes are appended to the notes."""
    who = f"{p.file}: {p.name}"
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", p.name).strip("_")[:_MAX_NAME_LENGTH] or "vehicle"
    if name != p.name:
        notes.append(f"{who}: renamed to {name}")
    # poses in order of time, without repeated times
    if p.time.size:
        p = _possible(p, notes)
    p = p.rows(np.argsort(p.time, kind="stable"))
    least = np.timedelta64(1, "us") if p.time.dtype.kind == "M" else SAME_TIME
    first = np.ones(p.time.size, dtype=bool)
    first[1:] = np.diff(p.time) > least
    if not first.all():
        dropped = counted(int(np.count_nonzero(~first)), "pose")
        notes.append(f"{who}: {dropped} at repeated times dropped")
    p = p.rows(first)
    if p.time.size < 2:
        raise ExchangeError(
            f"{who}: {counted(p.time.size, 'pose')}; a trajectory needs at least two"
        )
    # depths below the surface, a possible speed, and quaternions of length 1
    place = _in_water(p.place, who, notes)
    if p.time.dtype.kind != "M":
        metres = place
        if p.geodetic:  # to a percent
            east = _M_PER_DEGREE * np.unwrap(place[:, 1], period=360.0)
            east *= np.cos(np.radians(place[0, 0]))
            metres = np.column_stack([_M_PER_DEGREE * place[:, 0], east, place[:, 2]])
        check_speed(p.time, metres, f"{who}: time", ExchangeError)
    quaternion = None if p.quaternion is None else _normalized(p.quaternion, who)
    return p._replace(name=name, place=place, quaternion=quaternion)


def _in_water(place: Array, who: str, notes: list[str]) -> Array:
    """Finite positions with depths of a sea; those just above the surface move to it."""
    place = np.array(place, dtype=float)
    if not np.isfinite(place).all():
        raise ExchangeError(
            f"{who}: pose {int(np.argmin(np.isfinite(place).all(axis=1)))} has a position that is"
            " not finite; correct or remove it"
        )
    deepest = int(np.argmax(place[:, 2]))
    if place[deepest, 2] > _DEEPEST:
        raise ExchangeError(
            f"{who}: depth {place[deepest, 2]:g} m of pose {deepest} is below any sea; correct or"
            " remove it"
        )
    top = float(place[:, 2].min())
    if top < -_ABOVE_SURFACE:
        raise ExchangeError(
            f"{who}: depth {top:g} m is above the surface; depth must be positive down; change the"
            " sign"
        )
    if top < 0.0:
        above = place[:, 2] < 0.0
        notes.append(
            f"{who}: {above.sum()} poses up to {-top:.2g} m above the surface moved to the surface"
        )
        place[above, 2] = 0.0
    return place


def _normalized(quaternion: Array, who: str) -> Array:
    """Quaternions of length 1 from those of about this length; rounding alone changes nothing."""
    quaternion = np.array(quaternion, dtype=float)
    with np.errstate(over="ignore"):
        length = np.linalg.norm(quaternion, axis=-1, keepdims=True)
    if not (np.abs(length - 1.0) < 0.1).all():
        row = int(np.argmax(~(np.abs(length[:, 0] - 1.0) < 0.1)))
        raise ExchangeError(
            f"{who}: the quaternion of pose {row} has length {length[row, 0]:g}; it must be 1"
        )
    return np.asarray(quaternion / np.where(np.abs(length - 1.0) < 1e-12, 1.0, length))


def _local(p: Poses, frame: LocalFrame) -> Poses:
    """Convert poses from latitude, longitude and true north, or from another frame, to a frame."""
    if not p.geodetic:
        if p.centre in (None, (frame.latitude_deg, frame.longitude_deg)):
            return p
        p = geodetic(p, LocalFrame(*p.centre))
    north, east = frame.to_local(p.place[:, 0], p.place[:, 1])
    return p._replace(
        place=np.column_stack([north, east, p.place[:, 2]]),
        quaternion=about_down(p.quaternion, frame.convergence(p.place[:, 0], p.place[:, 1])),
        geodetic=False,
    )


def geodetic(p: Poses, frame: LocalFrame) -> Poses:
    """
    Convert local poses of a frame to latitudes, longitudes and attitudes relative to true north.
    """
    lat, lon = frame.to_geodetic(p.place[:, 0], p.place[:, 1])
    turn = -frame.convergence(lat, lon)
    place = np.column_stack([lat, lon, p.place[:, 2]])
    return p._replace(place=place, quaternion=about_down(p.quaternion, turn), geodetic=True)


def about_down(quaternion: Array | None, angle: Array) -> Array | None:
    """Rotate attitudes about down by angles. [rad]"""
    if quaternion is None:
        return None
    own = Rotation.from_quat(quaternion, scalar_first=True)
    return np.asarray((Rotation.from_euler("Z", angle[:, None]) * own).as_quat(scalar_first=True))


def _at(p: Poses, times: Array) -> tuple[Array, Array, Codes]:
    """Positions, attitudes and status of local poses at times."""
    there = (times >= p.time[0] - SAME_TIME) & (times <= p.time[-1] + SAME_TIME)
    inside = np.clip(times, p.time[0], p.time[-1])
    quaternion = _course(p.place) if p.quaternion is None else p.quaternion
    place = np.column_stack([np.interp(inside, p.time, axis) for axis in p.place.T])
    turning = Slerp(p.time, Rotation.from_quat(quaternion, scalar_first=True))
    attitude = turning(inside).as_quat(scalar_first=True)
    right = np.clip(np.searchsorted(p.time, inside), 1, p.time.size - 1)
    nearest = np.where(inside - p.time[right - 1] < p.time[right] - inside, right - 1, right)
    own = np.abs(p.time[nearest] - inside) <= SAME_TIME
    place[own] = p.place[nearest[own]]
    attitude[own] = quaternion[nearest[own]]
    status = np.where(there, VehicleStatus.ACTIVE, VehicleStatus.ABSENT).astype(np.int8)
    return place, attitude, status


def _course(place: Array) -> Array:
    """Level attitudes along the course; at rest, as before."""
    step = np.diff(place[:, :2], axis=0)
    moves = np.hypot(*step.T) > _MIN_STEP
    if not moves.any():
        return level(np.zeros(len(place)))
    last = np.maximum.accumulate(np.where(moves, np.arange(len(step)), -1))
    last = np.append(np.where(last < 0, np.argmax(moves), last), 0)
    last[-1] = last[-2]
    return level(np.arctan2(step[last, 1], step[last, 0]))
