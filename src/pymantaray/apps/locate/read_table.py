"""
Reader of tables of pings, one per row, with units in column names; optional tables of nodes and
tracks.
"""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pymantaray.apps.locate.checks import check_places
from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.survey import LeverArm, Node, Survey, TravelDirection, check_names
from pymantaray.arrays import Array
from pymantaray.errors import LocateError
from pymantaray.geometry import LocalFrame
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.text_table import TextTable, read_text_table

_TIMES = {
    "two_way_time_s": (TravelDirection.TWO_WAY, 1.0),
    "two_way_time_ms": (TravelDirection.TWO_WAY, 1e-3),
    "one_way_time_s": (TravelDirection.FROM_NODE, 1.0),
    "one_way_time_ms": (TravelDirection.FROM_NODE, 1e-3),
}
_DIRECTIONS = {"from node": TravelDirection.FROM_NODE, "to node": TravelDirection.TO_NODE}
_SIGMA = (5000.0, 5000.0, 300.0)  # m; default standard deviations of a node
_HORIZONTAL = [
    *("lat", "lon", "lat_rx", "lon_rx"),
    *("north_m", "east_m", "north_rx_m", "east_rx_m"),
]
_ANGLES = [f"{name}{end}_deg" for end in ("", "_rx") for name in ("heading", "pitch", "roll")]
_LIMITS = {"lat": 90.0, "lon": 360.0}  # degrees
_FALSE = ("0", "false", "no", "n", "f")
_TRUE = ("1", "true", "yes", "y", "t", "")


def read_table(path: Path, options: ReadOptions) -> Survey:
    """Read a survey from a table; the how-to lists its columns."""
    invalid = InvalidLines()
    table = read_text_table(path, invalid=invalid)
    kind = _time_column(table)
    table = _readable(table, kind, options, invalid)
    names = table.words("node")
    time, epoch = table.seconds("time")
    travel_time = table.numbers([kind])[:, 0] * _TIMES[kind][1]
    partners = table.words("partner")
    between = np.array([word != "" for word in partners])
    raw = _Places(table, options, time, epoch, travel_time, between)
    frame = raw.frame or _frame_of_nodes(options)
    raw.to_frame(frame)
    nodes = _nodes(table, options, frame, raw, sorted(set(names) | set(filter(None, partners))))
    number = {node.name: k for k, node in enumerate(nodes)}
    survey = Survey(
        nodes=nodes,
        node=np.array([number[name] for name in names]),
        time=raw.sent,
        travel_time=travel_time,
        transmit_position=raw.near,
        receive_position=raw.away,
        transmit_attitude=raw.attitude[0],
        receive_attitude=raw.attitude[1],
        direction=_directions(table, kind),
        partner=np.array([number.get(name, -1) for name in partners]),
        sigma=table.optional("sigma_s"),
        flagged=_flags(table),
        line=table.frame.index.to_numpy(dtype=np.int64),
        lever=LeverArm(),
        frame=frame,
        epoch=epoch,
        source=str(path),
        notes=invalid.notes,
    )
    return options.applied(survey)


def _readable(
    table: TextTable, kind: str, options: ReadOptions, invalid: InvalidLines
) -> TextTable:
    """
    Rows with a time, a node and a travel time, and positions of the platform or the name of a
    partner.
    """
    choices: dict[str, Collection[str]] = {"use": _TRUE + _FALSE}
    if _TIMES[kind][0] != TravelDirection.TWO_WAY:
        choices["direction"] = (*_DIRECTIONS, "")
    optional = ["sigma_s", *_HORIZONTAL, "depth_m", "depth_rx_m", *_ANGLES]
    table = table.readable(
        invalid, times=["time"], numbers=[kind], words=["node"], optional=optional, choices=choices
    )
    by_track = bool(options.track)
    keep = np.ones(len(table.frame), dtype=bool)
    for name in [] if by_track else [name for name in _HORIZONTAL if name in table.frame.columns]:
        values = table.optional(name)
        limit = _LIMITS.get(name[:3], np.inf)
        alone = np.array([word == "" for word in table.words("partner")], dtype=bool)
        for row in np.flatnonzero(alone & keep & ~(np.abs(values) <= limit)).tolist():
            invalid.add(
                table.path, int(table.frame.index[row]), _position_fault(table, row, name, limit)
            )
            keep[row] = False
    invalid.refuse_most(int(keep.sum()), LocateError)
    return replace(table, frame=table.frame[keep])


def _position_fault(table: TextTable, row: int, name: str, limit: float) -> str:
    cell = table.frame[name].iloc[row]
    if not np.isfinite(limit) or cell.lower() in ("", "nan"):
        return f"the position of the platform is incomplete: {name} is {cell!r}"
    lat, lon = (table.frame[name.replace(name[:3], axis)].iloc[row] for axis in ("lat", "lon"))
    exchanged = (
        "; they may be exchanged"
        if name.startswith("lat") and abs(float(lon or "nan")) <= 90.0
        else ""
    )
    return (
        f"position is {lat}, {lon}; latitude must be -90 to 90 and longitude -360 to 360"
        f" degrees{exchanged}"
    )


def _time_column(table: TextTable) -> str:
    there = [name for name in _TIMES if name in table.frame.columns]
    if len(there) != 1:
        columns = ", ".join(there) or ", ".join(map(str, table.frame.columns))
        raise LocateError(
            f"{table.path}: the columns are {columns}; exactly one of {', '.join(_TIMES)} is"
            " required"
        )
    return there[0]


def _flags(table: TextTable) -> NDArray[np.bool_]:
    return np.array([word.lower() in _FALSE for word in table.words("use")])


def _directions(table: TextTable, kind: str) -> NDArray[np.int64]:
    words = table.words("direction")
    out = np.full(len(words), int(_TIMES[kind][0]))
    if _TIMES[kind][0] == TravelDirection.TWO_WAY:
        return out
    for row, word in enumerate(words):
        out[row] = _DIRECTIONS.get(word.lower(), TravelDirection.FROM_NODE)
    return out


class _Places:
    """Positions and attitudes of the platform at both instants, from the table or from a track."""

    def __init__(
        self,
        table: TextTable,
        options: ReadOptions,
        time: Array,
        epoch: np.datetime64,
        duration: Array,
        between: NDArray[np.bool_],
    ) -> None:
        self._table = table
        self._options = options
        self._duration = duration
        self._between = between
        self.sent, columns = time, set(table.frame.columns)
        self._geodetic = {"lat", "lon"} <= columns
        self._epoch = epoch
        self._track = bool(options.track)
        if not (self._track or self._geodetic or {"north_m", "east_m"} <= columns or between.all()):
            raise LocateError(
                f"{table.path}: no positions of the platform; add columns lat and lon, or north_m"
                " and east_m, or give --track (in Python: track)"
            )
        self.frame: LocalFrame | None = None
        if self._track:
            from pymantaray.exchange import read_trajectories

            self._tracks = read_trajectories([str(p) for p in options.track])
            self.frame = (
                LocalFrame(*self._tracks.centre) if self._tracks.centre is not None else None
            )
        elif self._geodetic and not between.all():
            lat, lon = (table.optional(name)[~between] for name in ("lat", "lon"))
            self.frame = LocalFrame(float(np.median(lat)), float(np.median(lon)))
        self.platform = (
            None if not self._geodetic else tuple(table.optional(n) for n in ("lat", "lon"))
        )
        self.attitude = self._attitudes()

    def to_frame(self, frame: LocalFrame | None) -> None:
        """Convert positions to a frame."""
        if self._track:
            self._from_track(frame)
            return
        near = self._end("", frame)
        columns = set(self._table.frame.columns)
        second = {"lat_rx", "lon_rx"} if self._geodetic else {"north_rx_m", "east_rx_m"}
        if second <= columns:
            self.near, self.away = near, self._end("_rx", frame)
        elif self._between.all():
            self.near = self.away = near
        else:
            self.sent, self.near, self.away = self._options.both_ends(
                self.sent, self._duration, near
            )

    def _end(self, suffix: str, frame: LocalFrame | None) -> Array:
        if self._between.all():
            return np.full((self.sent.size, 3), np.nan)
        if self._geodetic:
            lat, lon = (self._table.optional(f"{name}{suffix}") for name in ("lat", "lon"))
            if frame is None:
                raise LocateError(f"{self._table.path}: latitudes and longitudes without a frame")
            north, east = (
                np.where(self._between, np.nan, x)
                for x in frame.to_local(
                    np.where(self._between, frame.latitude_deg, lat),
                    np.where(self._between, 0.0, lon),
                )
            )
        else:
            north, east = (self._table.optional(f"{name}{suffix}_m") for name in ("north", "east"))
        depth = self._table.optional(f"depth{suffix}_m", self._options.transducer_depth)
        return np.column_stack([north, east, depth])

    def _attitudes(self) -> list[Array]:
        out = list[Array]()
        for suffix in ("", "_rx"):
            columns = [f"{name}{suffix}_deg" for name in ("heading", "pitch", "roll")]
            there = any(c in self._table.frame.columns for c in columns)
            angles = [np.radians(self._table.optional(c, 0.0)) for c in columns]
            out.append(np.column_stack(angles) if there or not out else out[0])
        return out

    def _from_track(self, frame: LocalFrame | None) -> None:
        tracks = self._tracks
        options = self._options
        names = tracks.names
        if options.platform is None and len(names) > 1:
            raise LocateError(
                f"track: it contains {', '.join(names[:6])}; name the platform with --platform (in"
                " Python: platform)"
            )
        name = options.platform or names[0]
        if name not in names:
            raise LocateError(f"track: no platform {name}; available: {', '.join(names[:6])}")
        shift = 0.0
        if tracks.start is not None and not np.isnat(self._epoch):
            shift = float((self._epoch - tracks.start) / np.timedelta64(1, "s"))
        elif (tracks.start is None) != np.isnat(self._epoch):
            raise LocateError(
                "track: only one of track and survey has dates; both must have dates, or both"
                " times in seconds"
            )
        own = next(p for p in tracks.in_frame(frame or LocalFrame(0.0, 0.0)) if p.name == name)
        both = self.sent + shift, self.sent + shift + self._duration
        first = own.time[0]
        last = own.time[-1]
        for k, wanted in enumerate(both):
            outside = ((wanted < first - 1e-6) | (wanted > last + 1e-6)) & ~self._between
            if outside.any():
                raise LocateError(
                    f"{self._table.where(int(np.argmax(outside)))}: the"
                    f" {'reception' if k else 'transmission'} is {wanted[outside][0]:.1f} s after"
                    f" the start of the track, which lasts {last - first:.1f} s"
                )
        record = tracks.at(np.unique(np.concatenate(both)), frame or LocalFrame(0.0, 0.0))
        k = names.index(name)
        rows = [np.searchsorted(record.time, wanted) for wanted in both]
        self.near, self.away = (record.position[k, row] for row in rows)
        has_attitude = own.quaternion is not None
        self.attitude = [
            Rotation.from_quat(record.quaternion[k, row], scalar_first=True).as_euler("ZYX")
            if has_attitude
            else np.zeros((row.size, 3))
            for row in rows
        ]


def _frame_of_nodes(options: ReadOptions) -> LocalFrame | None:
    """Frame around the nodes if the platform has none."""
    if options.nodes is None:
        return None
    table = read_text_table(options.nodes)
    if not {"lat", "lon"} <= set(table.frame.columns):
        return None
    lat, lon = table.numbers(["lat", "lon"]).T
    return LocalFrame(float(lat.mean()), float(lon.mean()))


def _nodes(
    table: TextTable,
    options: ReadOptions,
    frame: LocalFrame | None,
    places: _Places,
    names: list[str],
) -> tuple[Node, ...]:
    """Nodes by name, from the table of nodes or from the positions of the platform."""
    known = {} if options.nodes is None else _node_table(options, frame, places)
    missing = [name for name in names if name not in known]
    if missing and options.nodes is not None:
        raise LocateError(
            f"{options.nodes}: no node {missing[0]}, which the survey has; available:"
            f" {', '.join(known)}"
        )
    for name in missing:
        if options.depth is None:
            raise LocateError(
                f"{table.path}: the depth of node {name} is unknown; give --depth or --nodes (in"
                " Python: depth or nodes)"
            )
        mine = (table.frame["node"].str.strip() == name).to_numpy() & np.isfinite(places.near).all(
            axis=1
        )
        if not mine.any():
            raise LocateError(
                f"{table.path}: node {name} has no ping of the platform; give --nodes (in Python:"
                " nodes)"
            )
        middle = places.near[mine].mean(axis=0)
        known[name] = Node(name, (float(middle[0]), float(middle[1]), options.depth), _SIGMA)
    return tuple(known[name] for name in known if name in names)


def _node_table(options: ReadOptions, frame: LocalFrame | None, places: _Places) -> dict[str, Node]:
    path = Path(str(options.nodes))
    table = read_text_table(path)
    table.require(["name"])
    columns = set(table.frame.columns)
    if {"lat", "lon"} <= columns and frame is not None:
        lat, lon = table.numbers(["lat", "lon"]).T
        if places.platform is not None:
            there = np.isfinite(places.platform[0]) & np.isfinite(places.platform[1])
            platform = places.platform[0][there], places.platform[1][there]
            for k, name in enumerate(table.frame["name"]):
                check_places(str(path), platform, (float(lat[k]), float(lon[k])), str(name))
        north, east = frame.to_local(lat, lon)
    else:
        north, east = table.numbers(["north_m", "east_m"]).T
    depth = (
        table.numbers(["depth_m"])[:, 0]
        if "depth_m" in columns
        else np.full(len(table.frame), options.depth or np.nan)
    )
    if not np.isfinite(depth).all():
        raise LocateError(f"{path}: no column depth_m; add it, or give --depth (in Python: depth)")
    horizontal = table.optional("sigma_horizontal_m", _SIGMA[0])
    sigma = [
        table.optional(f"sigma_{axis}_m") if f"sigma_{axis}_m" in columns else default
        for axis, default in (
            ("north", horizontal),
            ("east", horizontal),
            ("depth", np.full(len(depth), _SIGMA[2])),
        )
    ]
    delay = table.optional("turn_around_s", 0.0) + 1e-3 * table.optional("turn_around_ms", 0.0)
    rest = {
        name: table.optional(column, 0.0)
        for name, column in (
            ("turn_around_sigma", "sigma_turn_around_s"),
            ("offset_sigma", "sigma_clock_offset_s"),
            ("drift_sigma", "sigma_clock_drift"),
        )
    }
    names = table.words("name")
    check_names(names, path)
    return {
        name: Node(
            name,
            (float(north[k]), float(east[k]), float(depth[k])),
            (float(sigma[0][k]), float(sigma[1][k]), float(sigma[2][k])),
            turn_around=float(delay[k]),
            **{key: float(values[k]) for key, values in rest.items()},
        )
        for k, name in enumerate(names)
    }
