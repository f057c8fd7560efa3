"""Poses in ROS bags, of ROS 1 and 2, by the library rosbags."""

from pathlib import Path
from typing import Any

import numpy as np

from pymantaray.errors import ExchangeError
from pymantaray.exchange.frames import from_enu, from_enu_attitude
from pymantaray.exchange.tracks import Poses

_POSES = {
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
}
_UNIX = 1e8  # s; later stamps are dates, earlier ones a simulation's clock


def read_bag(path: Path) -> tuple[list[Poses], list[str]]:
    """
    Trajectory of each topic of poses or odometry in a bag, and what was left out.

    A vehicle is called as the first part of its topic that tells topics apart, or as all of them (``/fleet/A/odom`` and
    ``/fleet/B/odom`` are A and B). Places are
    east, north, up about the local frame's centre, bodies forward, left, up (REP-103); a frame whose name ends in ``ned`` is
    north, east, down, a child frame's in ``frd`` forward, right, down. Times are those of the headers.
    """
    files = [path]
    if path.is_dir() and path.suffix == ".bag":  # which the library takes for a file of ROS 1
        files = sorted(file for kind in ("*.db3", "*.mcap") for file in path.glob(kind))
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ExchangeError(f'{path}: reading bags needs the extra; pip install "pymantaray[ros]"') from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    rows: dict[str, list[tuple[Any, ...]]] = {}
    try:
        with AnyReader(files, default_typestore=store) as bag:
            topics = [c for c in bag.connections if c.msgtype in _POSES]
            for connection, _, raw in bag.messages(connections=topics) if topics else []:
                rows.setdefault(connection.topic, []).append(_row(bag.deserialize(raw, connection.msgtype)))
            others = sorted({c.msgtype for c in bag.connections})
    except Exception as error:  # noqa: BLE001  the library raises whatever it stumbles over
        raise ExchangeError(f"{path}: not a readable bag: {' '.join(str(error).split())[:120]}") from None
    if not rows:
        raise ExchangeError(
            f"{path}: no topic of {', '.join(sorted(_POSES))}; found {', '.join(others) or 'no messages'}"
        )
    names = _names(list(rows))
    return [_poses(name, values, path) for name, values in zip(names, rows.values(), strict=True)], []


def _names(topics: list[str]) -> list[str]:
    """What tells topics apart."""
    parts = [topic.strip("/").split("/") for topic in topics]
    while len(parts) > 1 and min(map(len, parts)) > 1 and len({p[0] for p in parts}) == 1:
        parts = [p[1:] for p in parts]
    firsts = [p[0] for p in parts]
    return firsts if len(set(firsts)) == len(firsts) else ["_".join(p) for p in parts]


def _row(message: Any) -> tuple[Any, ...]:
    pose = getattr(message.pose, "pose", message.pose)
    p, q, stamp = pose.position, pose.orientation, message.header.stamp
    return (
        stamp.sec * 1_000_000_000 + stamp.nanosec,
        (p.x, p.y, p.z),
        (q.w, q.x, q.y, q.z),
        message.header.frame_id,
        getattr(message, "child_frame_id", ""),
    )


def _poses(name: str, rows: list[tuple[Any, ...]], path: Path) -> Poses:
    nanoseconds, place, quaternion, frames, children = zip(*rows, strict=True)
    if len({*frames}) > 1:
        raise ExchangeError(
            f"{path}: {name} has poses in frames {', '.join(sorted({*frames}))}; one is needed"
        )
    time = np.array(nanoseconds, dtype=np.int64)
    p, q = np.array(place, dtype=float), np.array(quaternion, dtype=float)
    ned, frd = frames[0].lower().endswith("ned"), children[0].lower().endswith("frd")
    if not ned:
        p = from_enu(p)
    return Poses(
        name,
        time.astype("datetime64[ns]") if time[0] > _UNIX * 1e9 else time * 1e-9,
        p,
        from_enu_attitude(q) if not ned and not frd else q,
        False,
        str(path),
    )
