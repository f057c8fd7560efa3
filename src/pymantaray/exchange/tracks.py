"""Trajectories that another program made: each vehicle at times of its own, brought to common times in the local frame."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from pymantaray.errors import ExchangeError
from pymantaray.geometry import LocalFrame
from pymantaray.records import Trajectories, VehicleStatus

Array = NDArray[np.float64]
SAME_TIME = 1e-6
"""Times less than this apart are one. [s]"""
_ABOVE_SURFACE = 5.0  # m; a depth sensor's error at the surface, and not an axis that points up
_STILL = 1e-3  # m; shorter steps have no course
_LONGEST_NAME = 64


class Poses(NamedTuple):
    """One vehicle as a file has it: times as dates or in seconds, lat, lon [deg] or north, east [m], depth [m]."""

    name: str
    time: NDArray[Any]
    place: Array
    """Shape (n, 3)."""
    quaternion: Array | None
    """Body (forward, right, down) to true north, east, down, (w, x, y, z); None where the file has none."""
    geodetic: bool
    file: str
    centre: tuple[float, float] | None = None
    """Latitude and longitude of the local frame's centre, None if the file does not name it. [degrees]"""


@dataclass(frozen=True, eq=False)
class Tracks:
    """
    Trajectories from a file, before a frame and common times are chosen; `read_trajectories` reads them.

    Parameters
    ----------
    poses : sequence of Poses
        Each vehicle's own, times rising, in seconds since the first pose of all.
    start : numpy.datetime64 or None
        Instant (UTC) of that pose; None where the file tells no dates.
    notes : sequence of str
        What was changed or left out in reading.
    """

    poses: tuple[Poses, ...]
    start: np.datetime64 | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, poses: Sequence[Poses], notes: Sequence[str] = ()) -> Self:
        """Tracks of poses as readers give them, at least one: sorted, on one clock, checked."""
        for kind, unlike in (
            ("dates", [np.issubdtype(p.time.dtype, np.datetime64) for p in poses]),
            ("latitude and longitude", [p.geodetic for p in poses]),
        ):
            if len(set(unlike)) > 1:
                one, other = poses[unlike.index(True)], poses[unlike.index(False)]
                raise ExchangeError(
                    f"{one.file}: {one.name} has {kind}, {other.name} of {other.file} has not; all must, or none"
                )
        told = list(notes)
        clean = [_clean(p, told) for p in poses]
        names = [p.name for p in clean]
        double = next((p for p in clean if names.count(p.name) > 1), None)
        if double is not None:
            raise ExchangeError(f"{double.file}: two vehicles are called {double.name}; names must differ")
        start = min(p.time[0] for p in clean)
        if not np.issubdtype(clean[0].time.dtype, np.datetime64):
            return cls(tuple(p._replace(time=p.time - start) for p in clean), None, tuple(told))
        second = np.timedelta64(1_000_000_000, "ns")
        return cls(tuple(p._replace(time=(p.time - start) / second) for p in clean), start, tuple(told))

    @classmethod
    def of_record(cls, truth: Trajectories) -> Self:
        """Tracks of a record in the local frame; where a vehicle is not active, it is not there."""
        return cls.of(poses_of_record(truth, "trajectories"))

    @property
    def names(self) -> list[str]:
        """Names of the vehicles."""
        return [p.name for p in self.poses]

    @property
    def duration(self) -> float:
        """Time from the first pose of all to the last. [s]"""
        return float(max(p.time[-1] for p in self.poses))

    @property
    def geodetic(self) -> bool:
        """Whether places are latitudes and longitudes."""
        return self.poses[0].geodetic

    @property
    def centre(self) -> tuple[float, float] | None:
        """Centre of the local frame that a file names, else the middle of latitudes and longitudes, else None. [degrees]"""
        named = next((p.centre for p in self.poses if p.centre is not None), None)
        if named is not None or not self.geodetic:
            return named
        lat, lon = (np.concatenate([p.place[:, k] for p in self.poses]) for k in (0, 1))
        lon = lon[0] + (lon - lon[0] + 180.0) % 360.0 - 180.0
        middle = [0.5 * float(values.min() + values.max()) for values in (lat, lon)]
        return middle[0], (middle[1] + 180.0) % 360.0 - 180.0

    def at(self, time: ArrayLike, frame: LocalFrame) -> Trajectories:
        """
        Poses at common times in a local frame.

        Parameters
        ----------
        time : array_like, shape (n_times,)
            Since the first pose of all, rising. [s]
        frame : LocalFrame
            What latitudes and longitudes are brought to, and places about another centre. Local places of no known centre
            are taken to be in it.

        Returns
        -------
        Trajectories
            Role ``track``. At a time of its own (to a microsecond) a vehicle has the pose of the file. Between two, places
            are linear in time and attitudes turn at a constant rate (slerp). Before its first pose and after its last
            a vehicle is ABSENT, at that pose. Without attitudes it heads where it goes, level.
        """
        times, local = np.asarray(time, dtype=float), self.in_frame(frame)
        sampled = [_at(p, times) for p in local]
        return Trajectories(
            name=np.array(self.names),
            role=np.full(len(local), "track"),
            time=times,
            position=np.stack([s[0] for s in sampled]),
            quaternion=np.stack([s[1] for s in sampled]),
            status=np.stack([s[2] for s in sampled]),
            start=np.datetime64("NaT", "us") if self.start is None else self.start,
            centre=(frame.latitude_deg, frame.longitude_deg),
        )

    def in_frame(self, frame: LocalFrame) -> list[Poses]:
        """Each vehicle's own poses as north, east, down of a frame."""
        return [_local(p, frame) for p in self.poses]


def poses_of_record(truth: Trajectories, file: str) -> list[Poses]:
    """Each vehicle of a record while it is active, with dates where the record has one."""
    time = truth.time
    if not np.isnat(truth.start):
        time = truth.start.astype("M8[ns]") + np.round(time * 1e9).astype("m8[ns]")
    rows = [np.flatnonzero(status == VehicleStatus.ACTIVE) for status in truth.status]
    return [
        Poses(str(name), time[r], truth.position[i, r], truth.quaternion[i, r], False, file, truth.centre)
        for i, (name, r) in enumerate(zip(truth.name, rows, strict=True))
    ]


def with_times(truth: Trajectories, time: Array) -> Trajectories:
    """Record with further times among its own, by the rule of `Tracks.at`; a vehicle's status is that of the sample before."""
    times = union_of_times(truth.time, time)
    if times.size == truth.time.size:
        return truth
    before = np.searchsorted(truth.time, times + SAME_TIME) - 1
    rows = [
        _at(Poses(str(name), truth.time, place, quaternion, False, ""), times)
        for name, place, quaternion in zip(truth.name, truth.position, truth.quaternion, strict=True)
    ]
    return replace(
        truth,
        time=times,
        position=np.stack([r[0] for r in rows]),
        quaternion=np.stack([r[1] for r in rows]),
        status=truth.status[:, before],
    )


def union_of_times(first: Array, more: Array) -> Array:
    """Rising times of both, those of the first where they differ by less than a microsecond."""
    place = np.clip(np.searchsorted(first, more), 1, max(first.size - 1, 1))
    near = np.minimum(
        np.abs(first[place - 1] - more), np.abs(first[np.minimum(place, first.size - 1)] - more)
    )
    own = np.sort(more[near > SAME_TIME])
    own = own[np.diff(own, prepend=-np.inf) > SAME_TIME]
    return np.sort(np.concatenate([first, own]))


def level(heading: ArrayLike, pitch: ArrayLike = 0.0, roll: ArrayLike = 0.0) -> Array:
    """Quaternions (w, x, y, z) of headings, pitches (nose up) and rolls (right side down), body to north, east, down. [rad]"""
    angles = np.stack(np.broadcast_arrays(heading, pitch, roll), axis=-1)
    return np.asarray(Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True))


def _clean(p: Poses, told: list[str]) -> Poses:
    """Poses sorted by time, each time once, checked; what was changed is told."""
    who = f"{p.file}: {p.name}"
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", p.name).strip("_")[:_LONGEST_NAME] or "vehicle"
    if name != p.name:
        told.append(f"{who} is called {name} here")
    order = np.argsort(p.time, kind="stable")
    time, place = p.time[order], np.array(p.place[order], dtype=float)
    least = np.timedelta64(1, "us") if np.issubdtype(time.dtype, np.datetime64) else SAME_TIME
    first = np.ones(time.size, dtype=bool)
    first[1:] = np.diff(time) > least
    if not first.all():
        told.append(f"{who}: {np.count_nonzero(~first)} poses at times that it has already were left out")
    order, time, place = order[first], time[first], place[first]
    if time.size < 2:
        raise ExchangeError(
            f"{who} has {time.size} pose{'s' * (time.size != 1)}; a trajectory needs two or more"
        )
    if not np.isfinite(place).all():
        raise ExchangeError(
            f"{who}: pose {int(np.argmin(np.isfinite(place).all(axis=1)))} has a place that is not finite"
        )
    if p.geodetic:
        far = np.abs(place[:, 0]) > 90.0
        if far.any():
            raise ExchangeError(f"{who}: latitude {place[far][0, 0]:g}; latitudes lie in -90 to 90 degrees")
    top = float(place[:, 2].min())
    if top < -_ABOVE_SURFACE:
        raise ExchangeError(
            f"{who}: depth {top:g} m is above the surface; depth is positive down: change the sign if yours is up"
        )
    if top < 0.0:
        above = place[:, 2] < 0.0
        told.append(f"{who}: {above.sum()} poses up to {-top:.2g} m above the surface were put on it")
        place[above, 2] = 0.0
    quaternion = None
    if p.quaternion is not None:
        quaternion = np.array(p.quaternion[order], dtype=float)
        length = np.linalg.norm(quaternion, axis=-1, keepdims=True)
        if not (np.abs(length - 1.0) < 0.1).all():
            row = int(np.argmax(~(np.abs(length[:, 0] - 1.0) < 0.1)))
            raise ExchangeError(
                f"{who}: the quaternion of pose {row} has length {length[row, 0]:g}; it must be 1"
            )
        quaternion /= np.where(np.abs(length - 1.0) < 1e-12, 1.0, length)
    return p._replace(name=name, time=time, place=place, quaternion=quaternion)


def _local(p: Poses, frame: LocalFrame) -> Poses:
    """Poses brought from latitude, longitude and true north, or from another frame, to a frame."""
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
    """Local poses of a frame as latitudes, longitudes and attitudes to true north."""
    lat, lon = frame.to_geodetic(p.place[:, 0], p.place[:, 1])
    turn = -frame.convergence(lat, lon)
    place = np.column_stack([lat, lon, p.place[:, 2]])
    return p._replace(place=place, quaternion=about_down(p.quaternion, turn), geodetic=True)


def about_down(quaternion: Array | None, angle: Array) -> Array | None:
    """Attitudes after turns about down. [rad]"""
    if quaternion is None:
        return None
    own = Rotation.from_quat(quaternion, scalar_first=True)
    return np.asarray((Rotation.from_euler("Z", angle[:, None]) * own).as_quat(scalar_first=True))


def _at(p: Poses, times: Array) -> tuple[Array, Array, NDArray[np.int8]]:
    """Places, attitudes and status of local poses at times."""
    there = (times >= p.time[0] - SAME_TIME) & (times <= p.time[-1] + SAME_TIME)
    inside = np.clip(times, p.time[0], p.time[-1])
    quaternion = _course(p.place) if p.quaternion is None else p.quaternion
    place = np.column_stack([np.interp(inside, p.time, axis) for axis in p.place.T])
    turning = Slerp(p.time, Rotation.from_quat(quaternion, scalar_first=True))
    attitude = turning(inside).as_quat(scalar_first=True)
    right = np.clip(np.searchsorted(p.time, inside), 1, p.time.size - 1)
    nearest = np.where(inside - p.time[right - 1] < p.time[right] - inside, right - 1, right)
    own = np.abs(p.time[nearest] - inside) <= SAME_TIME
    place[own], attitude[own] = p.place[nearest[own]], quaternion[nearest[own]]
    status = np.where(there, VehicleStatus.ACTIVE, VehicleStatus.ABSENT).astype(np.int8)
    return place, attitude, status


def _course(place: Array) -> Array:
    """Attitudes that point where places go on to, level; at rest as before."""
    step = np.diff(place[:, :2], axis=0)
    moves = np.hypot(*step.T) > _STILL
    if not moves.any():
        return level(np.zeros(len(place)))
    last = np.maximum.accumulate(np.where(moves, np.arange(len(step)), -1))
    last = np.append(np.where(last < 0, np.argmax(moves), last), 0)
    last[-1] = last[-2]
    return level(np.arctan2(step[last, 1], step[last, 0]))
