"""
Reader of poses from ROS 1 and ROS 2 bags, and writer of recordings as ROS 2 bags or MCAP files,
with the library rosbags.

World and body have the axes of REP 103, which `swap_enu` converts. Frames have the names of REP
105.
"""

import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from pymantaray.arrays import Array
from pymantaray.errors import ExchangeError, optional_package
from pymantaray.exchange.bag_sizes import (
    check_bag1,
    check_count,
    check_mcap,
    check_size,
    unpacked_file,
    unpacked_message,
)
from pymantaray.exchange.fixes import Fixes, centre_from_fixes, origin_of_frame
from pymantaray.exchange.frames import swap_enu, swap_enu_attitude
from pymantaray.exchange.recording import Recording, VehiclePoses
from pymantaray.exchange.tracks import Poses
from pymantaray.records.position_rows import missing_fixes
from pymantaray.records.status import TRUTH

MAP = "map"
_POSE = "geometry_msgs/msg/PoseStamped"
_POSES = {"nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseWithCovarianceStamped", _POSE}
_FIX = "sensor_msgs/msg/NavSatFix"
_ORIGIN = f"/{MAP}/fix"
_TRUE = re.compile(f"/{TRUTH}/[^/]+/pose")
_MIN_DATE = 1e8  # s; later stamps are dates, earlier stamps are from the clock of a simulation


def read_bag(path: Path) -> tuple[list[Poses], list[str]]:
    """
    Read a trajectory from each topic of poses or odometry in a bag, and notes about omitted data.

    The name of a vehicle is the first part that differs between topics, or all parts
    (``/fleet/A/odom`` and ``/fleet/B/odom`` are A and B). Positions are east, north, up from the
    centre of the local frame; bodies are forward, left, up (REP-103). A frame whose name ends in
    ``ned`` is north, east, down, and a child frame whose name ends in ``frd`` is forward, right,
    down. Times are from the headers. From a run of `write_bag`, only the true poses are read.

    Satellite fixes (``NavSatFix``) give the centre of the frame. Fixes in the frame of the poses
    are at its origin; fixes of a vehicle are compared with its poses. A fix belongs to the vehicle
    whose name is a part of its topic.
    """
    if path.is_dir() and not any(any(path.glob(f"*.{kind}")) for kind in ("yaml", "db3", "mcap")):
        raise ExchangeError(
            f"{path}: this folder is not a bag; name files, or a folder with metadata.yaml"
        )
    with optional_package(ExchangeError, path, "rosbags", "ros"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS2_HUMBLE)
    # poses and fixes by topic
    rows: dict[str, list[tuple[Any, ...]]] = {}
    located: dict[str, list[tuple[Any, ...]]] = {}
    try:
        with (
            TemporaryDirectory() as temporary,
            AnyReader(_files(path, temporary), default_typestore=store) as bag,
        ):
            for reader in () if bag.is2 else bag.readers:
                check_bag1(reader)
            topics = [c for c in bag.connections if c.msgtype in _POSES or c.msgtype == _FIX]
            messages = bag.messages(connections=topics) if topics else []
            for count, (connection, _, raw) in enumerate(messages, 1):
                check_count(count)
                check_size(len(raw))
                content = unpacked_message(raw) if bag.is2 else raw
                message = bag.deserialize(content, connection.msgtype)
                if connection.msgtype == _FIX:
                    located.setdefault(connection.topic, []).append(_fix_row(message))
                else:
                    rows.setdefault(connection.topic, []).append(_row(message))
            others = sorted({c.msgtype for c in bag.connections})
    except ExchangeError as error:
        raise ExchangeError(f"{path}: {error}") from None
    except Exception as error:  # noqa: BLE001  the library raises many types
        raise ExchangeError(
            f"{path}: not a readable bag: {' '.join(str(error).split())[:120]}"
        ) from None
    # one trajectory of each topic
    if not rows:
        raise ExchangeError(
            f"{path}: no topic of type {', '.join(sorted(_POSES))}; it contains"
            f" {', '.join(others) or 'no messages'}"
        )
    true = {topic: values for topic, values in rows.items() if _TRUE.fullmatch(topic)}
    if true:  # an exported run: ignore its estimates
        left = len(rows) - len(true)
        notes = [f"{path}: topics of poses other than /{TRUTH} ignored: {left}"] if left else []
        names = [topic.split("/")[2] for topic in true]
        rows = true
    else:
        names = _names(list(rows))
        notes = [
            f"{path}: vehicle {name} from topic {topic} in frame {values[0][3]!r}"
            for name, (topic, values) in zip(names, rows.items(), strict=True)
        ]
    tracks = [_poses(name, values, path) for name, values in zip(names, rows.values(), strict=True)]
    return _with_centres(tracks, list(rows.values()), located, notes)


def _files(path: Path, temporary: str) -> list[Path]:
    """
    Files of a bag, whose chunks have been checked; files that are packed as a whole are unpacked
    into a temporary folder.
    """
    from ruamel.yaml import YAML

    files = [path]
    if path.is_dir() and path.suffix == ".bag":  # the library expects a file of ROS 1
        files = sorted(file for kind in ("*.db3", "*.mcap") for file in path.glob(kind))
    elif path.is_dir():
        metadata = YAML(typ="safe").load((path / "metadata.yaml").read_text())
        bag = metadata["rosbag2_bagfile_information"]
        files = [path / PurePath(name).name for name in bag["relative_file_paths"]]
        if f"{bag.get('compression_mode')}".lower() == "file":
            files = [unpacked_file(file, temporary) for file in files]
    for file in files:
        check_mcap(file)
    return files


def _with_centres(
    tracks: list[Poses],
    rows: list[list[tuple[Any, ...]]],
    located: dict[str, list[tuple[Any, ...]]],
    notes: list[str],
) -> tuple[list[Poses], list[str]]:
    """Add centres of frames from satellite fixes to tracks; return them with notes."""
    fixes = {topic: _fixes(values) for topic, values in located.items()}
    frames = [values[0][3] for values in rows]
    out = list(tracks)
    for frame in dict.fromkeys(frames):
        own = [k for k, name in enumerate(frames) if name == frame]
        centred = origin_of_frame([f for f in fixes.values() if f.frame == frame and f.time.size])
        if centred is None:
            centred = centre_from_fixes([
                (np.array([row[0] for row in rows[k]]), tracks[k].place, f)
                for k in own
                for topic, f in fixes.items()
                if len(tracks) == 1 or tracks[k].name in topic.split("/")
            ])  # fmt: skip
            if centred is None:
                continue
            lat, lon = centred.centre
            note = (
                f"{tracks[own[0]].file}: centre of frame {frame!r}: {lat:.6f}, {lon:.6f} (lat,"
                f" lon), from {centred.fixes} satellite fixes that agree within"
                f" {centred.spread:.3g} m"
            )
            notes = [*notes, note]
        for k in own:
            out[k] = tracks[k]._replace(centre=centred.centre)
    without_centre = {
        frame for frame, track in zip(frames, out, strict=True) if track.centre is None
    }
    if without_centre and len(set(frames)) > 1:
        listed = ", ".join(sorted(set(frames)))
        note = (
            f"{tracks[0].file}: frames {listed} are taken as one; distances between their vehicles"
            " are right only if they have one origin and the same axes"
        )
        notes = [*notes, note]
    return out, notes


def _fix_row(message: Any) -> tuple[Any, ...]:
    is_solved = message.status.status >= 0  # -1: no fix
    latitude = message.latitude if is_solved else np.nan
    return _nanoseconds(message), latitude, message.longitude, message.header.frame_id


def _nanoseconds(message: Any) -> int:
    stamp = message.header.stamp
    return int(stamp.sec * 1_000_000_000 + stamp.nanosec)


def _fixes(rows: list[tuple[Any, ...]]) -> Fixes:
    nanoseconds, latitude, longitude, frames = zip(*rows, strict=True)
    lat = np.array(latitude, dtype=float)
    lon = np.array(longitude, dtype=float)
    known = np.isfinite(lat) & np.isfinite(lon)
    known[list(missing_fixes(np.column_stack([lat, lon])))] = False
    return Fixes(np.array(nanoseconds, dtype=np.int64)[known], lat[known], lon[known], frames[0])


def _names(topics: list[str]) -> list[str]:
    """Parts of topics that differ."""
    parts = [topic.strip("/").split("/") for topic in topics]
    while len(parts) > 1 and min(map(len, parts)) > 1 and len({p[0] for p in parts}) == 1:
        parts = [p[1:] for p in parts]
    firsts = [p[0] for p in parts]
    return firsts if len(set(firsts)) == len(firsts) else ["_".join(p) for p in parts]


def _row(message: Any) -> tuple[Any, ...]:
    pose = getattr(message.pose, "pose", message.pose)
    p = pose.position
    q = pose.orientation
    return (
        _nanoseconds(message),
        (p.x, p.y, p.z),
        (q.w, q.x, q.y, q.z),
        message.header.frame_id,
        getattr(message, "child_frame_id", ""),
    )


def _poses(name: str, rows: list[tuple[Any, ...]], path: Path) -> Poses:
    nanoseconds, place, quaternion, frames, children = zip(*rows, strict=True)
    if len({*frames}) > 1:
        raise ExchangeError(
            f"{path}: {name} has poses in frames {', '.join(sorted({*frames}))}; all must be in"
            " one frame"
        )
    time = np.array(nanoseconds, dtype=np.int64)
    p = np.array(place, dtype=float)
    q = np.array(quaternion, dtype=float)
    if not frames[0].lower().endswith("ned"):
        if children[0].lower().endswith("frd"):
            # rotation by pi about forward, from forward, left, up
            q = q[:, [1, 0, 3, 2]] * [-1.0, 1.0, 1.0, -1.0]
        p = swap_enu(p)
        q = swap_enu_attitude(q)
    return Poses(
        name,
        time.astype("datetime64[ns]") if time[0] > _MIN_DATE * 1e9 else time * 1e-9,
        p,
        q,
        False,
        str(path),
    )


class _Track(NamedTuple):
    """One vehicle under one condition: its names, and poses and geodetic positions by sample."""

    topic: str
    frame: str
    true: bool
    poses: dict[int, tuple[Array, Array]]
    fixes: dict[int, Array]


class _Message(NamedTuple):
    topic: str
    kind: str
    nanoseconds: int
    content: Any


def write_bag(recording: Recording, folder: Path, *, mcap: bool = False) -> None:
    """
    Write a recording as a ROS 2 bag, SQLite or MCAP, into an empty folder.

    ``/<condition>/<vehicle>/pose`` and ``path`` contain true and estimated poses in the frame
    ``map`` (east, north, up; body forward, left, up), ``/truth/<vehicle>/fix`` latitudes and
    longitudes, ``/map/fix`` those of the frame's centre, ``/tf`` true poses of
    ``<vehicle>/base_link``, ``/tf_static`` landmarks, and ``/ranges/<transmitter>/<receiver>``
    measured refracted ranges. Times are dates, or seconds since the start if the mission has no
    date.

    Raises
    ------
    ExchangeError
        If rosbags is not installed, or two names are equal in ROS.
    """
    with optional_package(ExchangeError, "bag and mcap", "rosbags", "ros"):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS2_HUMBLE)
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with TemporaryDirectory(dir=folder) as temporary:  # the writer creates its own folder
        bag = Path(temporary, recording.name)
        connections: dict[str, Any] = {}
        # version 8 of the format, for ROS 2 Humble and later
        with Writer(bag, version=8, storage_plugin=plugin) as writer:
            for topic, kind, nanoseconds, content in _Messages(recording, store.types):
                if topic not in connections:
                    once = topic in ("/tf_static", _ORIGIN) or topic.endswith("/path")
                    qos = [_latched()] if once else []
                    connections[topic] = writer.add_connection(
                        topic, kind, typestore=store, offered_qos_profiles=qos
                    )
                writer.write(connections[topic], nanoseconds, store.serialize_cdr(content, kind))
        for file in bag.iterdir():
            shutil.move(file, folder / file.name)


def _latched() -> Any:
    """Quality of service of a topic whose last message late subscribers receive."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    forever = QosTime(2147483647, 4294967295)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        forever,
        forever,
        QosLiveliness.AUTOMATIC,
        forever,
        False,
    )


class _Messages:
    """All messages of a recording in order of time."""

    def __init__(self, recording: Recording, types: Any) -> None:
        self._recording = recording
        self._types = types
        truth = recording.truth
        start = 0 if np.isnat(truth.start) else int(truth.start.astype("M8[ns]").astype(np.int64))
        self._nanoseconds = [start + round(t * 1e9) for t in truth.time.tolist()]
        self._names = _ros_names([*recording.participants, TRUTH, *recording.estimates])

    def __iter__(self) -> Iterator[_Message]:
        """Yield static messages, then poses and ranges sample by sample."""
        m = self._recording.measurements
        received = self._recording.received
        tracks = [self._track(p) for p in self._recording.poses]
        yield from self._static(tracks)
        first = np.searchsorted(m.range_sample[received], np.arange(len(self._nanoseconds) + 1))
        for k in range(len(self._nanoseconds)):
            there = [track for track in tracks if k in track.poses]
            yield self._tf("/tf", k, [(t.frame, *t.poses[k]) for t in there if t.true])
            for track in there:
                pose = self._pose(*track.poses[k])
                yield self._message(f"{track.topic}/pose", _POSE, k, MAP, pose=pose)
                if k in track.fixes:
                    yield self._fix(f"{track.topic}/fix", track.frame, k, track.fixes[k].tolist())
            for row in received[first[k] : first[k + 1]]:
                yield self._range(int(row), k)

    def _track(self, p: VehiclePoses) -> _Track:
        """Poses of a vehicle in ROS's axes, and fixes of its true poses."""
        names = self._names
        frame = self._recording.truth.frame
        poses = zip(swap_enu(p.position), swap_enu_attitude(p.quaternion), strict=True)
        fixes = np.empty((0, 3))
        if p.condition == TRUTH and frame is not None:
            north, east, down = p.position.T
            fixes = np.stack([*frame.to_geodetic(north, east), -down], axis=-1)
        samples = p.samples.tolist()
        return _Track(
            f"/{names[p.condition]}/{names[p.vehicle]}",
            f"{names[p.vehicle]}/base_link",
            p.condition == TRUTH,
            dict(zip(samples, poses, strict=True)),
            dict(zip(samples, fixes, strict=False)),
        )

    def _static(self, tracks: list[_Track]) -> Iterator[_Message]:
        marks = self._recording.measurements.landmark_name.tolist()
        level = np.array([1.0, 0.0, 0.0, 0.0])
        yield self._tf("/tf_static", 0, [
            (self._names[name], place, level)
            for name, place in zip(marks, swap_enu(self._recording.landmarks), strict=True)
        ])  # fmt: skip
        if (frame := self._recording.truth.frame) is not None:
            yield self._fix(_ORIGIN, MAP, 0, (frame.latitude_deg, frame.longitude_deg, 0.0))
        for track in tracks:
            stamped = [
                self._make(_POSE, header=self._header(k, MAP), pose=self._pose(*pose))
                for k, pose in track.poses.items()
            ]
            yield self._message(f"{track.topic}/path", "nav_msgs/msg/Path", 0, MAP, poses=stamped)

    def _fix(self, topic: str, frame: str, k: int, place: Sequence[float]) -> _Message:
        """Latitude, longitude [degrees] and altitude [m] of a frame's origin."""
        latitude, longitude, altitude = place
        return self._message(
            topic,
            _FIX,
            k,
            frame,
            status=self._make("sensor_msgs/msg/NavSatStatus", status=0, service=1),
            latitude=latitude,
            longitude=longitude,
            altitude=altitude,
            position_covariance=np.zeros(9),
            position_covariance_type=0,
        )

    def _range(self, row: int, k: int) -> _Message:
        r = self._recording
        m = self._recording.measurements
        transmitter = int(m.range_transmitter[row])
        receiver = int(m.range_receiver[row])
        ends = [self._names[r.participants[end]] for end in (transmitter, receiver)]
        return self._message(
            f"/ranges/{ends[0]}/{ends[1]}",
            "sensor_msgs/msg/Range",
            k,
            f"{ends[1]}/base_link" if receiver < r.truth.name.size else ends[1],
            radiation_type=0,  # ultrasound, the only acoustic type of the message
            field_of_view=2.0 * np.pi,
            min_range=0.0,
            max_range=np.inf,
            range=float(m.refracted_range[row]),
        )

    def _tf(self, topic: str, k: int, frames: list[tuple[str, Array, Array]]) -> _Message:
        transforms = []
        for name, place, quaternion in frames:
            x, y, z = place.tolist()
            transform = self._make(
                "geometry_msgs/msg/Transform",
                translation=self._make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
                rotation=self._quaternion(quaternion),
            )
            transforms.append(
                self._make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self._header(k, MAP),
                    child_frame_id=name,
                    transform=transform,
                )
            )
        kind = "tf2_msgs/msg/TFMessage"
        return _Message(topic, kind, self._nanoseconds[k], self._make(kind, transforms=transforms))

    def _message(self, topic: str, kind: str, k: int, frame: str, **fields: Any) -> _Message:
        content = self._make(kind, header=self._header(k, frame), **fields)
        return _Message(topic, kind, self._nanoseconds[k], content)

    def _header(self, k: int, frame: str) -> Any:
        sec, nanosec = divmod(self._nanoseconds[k], 1_000_000_000)
        stamp = self._make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _pose(self, place: Array, quaternion: Array) -> Any:
        x, y, z = place.tolist()
        position = self._make("geometry_msgs/msg/Point", x=x, y=y, z=z)
        return self._make(
            "geometry_msgs/msg/Pose", position=position, orientation=self._quaternion(quaternion)
        )

    def _quaternion(self, quaternion: Array) -> Any:
        w, x, y, z = quaternion.tolist()
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _make(self, kind: str, **fields: Any) -> Any:
        return self._types[kind](**fields)


def _ros_names(names: list[str]) -> dict[str, str]:
    """Names that ROS allows in topics: letters, digits and single _, without a leading digit."""
    ros = {name: re.sub(r"^(?=\d)", "_", re.sub("[^A-Za-z0-9]+", "_", name)) for name in names}
    for name, word in ros.items():
        other = next((o for o, w in ros.items() if w == word and o != name), None)
        if other is not None:
            raise ExchangeError(
                f"{name} and {other} are both {word} in ROS, which allows neither - nor . in"
                " names; rename one"
            )
    return ros
