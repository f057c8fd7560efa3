"""Reader of tables of pings, one per row; optional tables of nodes and tracks."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pymantaray.apps.locate.checks import check_positions
from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.survey import Node, Survey, TravelDirection, check_names
from pymantaray.arrays import Array
from pymantaray.errors import LocateError
from pymantaray.geometry import LocalFrame
from pymantaray.records.dates import seconds_since
from pymantaray.records.invalid_lines import LEFT_OUT, InvalidLines
from pymantaray.records.position_rows import FASTEST_PLATFORM, PositionRows, middle_longitude
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
_MAX_NAMES = 6  # in a message
_FALSE = ("0", "false", "no", "n", "f")
_TRUE = ("1", "true", "yes", "y", "t", "")


def read_table(path: Path, options: ReadOptions) -> Survey:
    """Read a survey from a table; the how-to lists its columns."""
    invalid = InvalidLines()
    table, in_degrees = _known_titles(read_text_table(path, invalid=invalid))
    kind = _time_column(table)
    table = _readable(table, kind, options, invalid)
    positions = PositionRows(path, LocateError, fastest=FASTEST_PLATFORM)
    table = _possible(table, options, positions, in_degrees=in_degrees)
    names = table.words("node")
    time, epoch = table.seconds("time")
    travel_time = table.numbers([kind])[:, 0] * _TIMES[kind][1]
    partners = table.words("partner")
    between = np.array([word != "" for word in partners])
    raw = _PlatformPositions(table, options, time, epoch, travel_time, between)
    frame = raw.frame or _frame_of_nodes(options)
    raw.to_frame(frame)
    nodes = _nodes(table, options, frame, raw, sorted(set(names) | set(filter(None, partners))))
    number = {node.name: k for k, node in enumerate(nodes)}
    survey = Survey(
        nodes=nodes,
        node=np.array([number[name] for name in names]),
        time=raw.transmit_time,
        travel_time=travel_time,
        transmit_position=raw.transmit_position,
        receive_position=raw.receive_position,
        transmit_attitude=raw.attitude[0],
        receive_attitude=raw.attitude[1],
        direction=_directions(table, kind),
        partner=np.array([number.get(name, -1) for name in partners]),
        sigma=table.optional("sigma_s"),
        flagged=np.array([word.lower() in _FALSE for word in table.words("use")]),
        line=table.lines,
        frame=frame,
        epoch=epoch,
        source=str(path),
        notes=(*invalid.notes, *positions.notes, *raw.notes),
    )
    return options.apply(survey)


def _known_titles(table: TextTable) -> tuple[TextTable, bool]:
    """
    Table whose latitudes and longitudes have the titles ``lat`` and ``lon``, and True if the file
    states that they are degrees.
    """
    names = {f"{axis}{end}_deg": f"{axis}{end}" for axis in ("lat", "lon") for end in ("", "_rx")}
    columns = table.frame.columns
    in_degrees = "lat_deg" in columns
    return replace(table, frame=table.frame.rename(columns=names)), in_degrees


def _possible(
    table: TextTable, options: ReadOptions, positions: PositionRows, *, in_degrees: bool
) -> TextTable:
    """Rows whose positions of the platform are possible, at transmission and at reception."""
    if options.track:
        return table
    time, _ = table.seconds("time")
    from_platform = _from_platform(table)
    keep = from_platform.copy()
    for axes in (("lat", "lon"), ("north_m", "east_m")):
        for end in ("", "_rx"):
            first, second = (
                f"{axis.removesuffix('_m')}{end}{axis[len(axis.removesuffix('_m')) :]}"
                for axis in axes
            )
            if not {first, second} <= set(table.frame.columns):
                continue
            rows = np.flatnonzero(keep)
            possible = positions.possible(
                time[rows],
                np.column_stack([table.optional(first)[rows], table.optional(second)[rows]]),
                table.lines[rows],
                geographic=axes[0] == "lat",
                stated_degrees=in_degrees,
            )
            keep[rows[~possible]] = False
    positions.refuse_most(int(keep.sum()))
    keep |= ~from_platform
    return replace(table, frame=table.frame[keep])


def _from_platform(table: TextTable) -> NDArray[np.bool_]:
    """Rows between the platform and a node, not between two nodes."""
    return np.array([word == "" for word in table.words("partner")], dtype=bool)


def _readable(
    table: TextTable, kind: str, options: ReadOptions, invalid: InvalidLines
) -> TextTable:
    """Rows with a time, a node, a travel time, and a position of the platform or a partner."""
    choices: dict[str, Collection[str]] = {"use": _TRUE + _FALSE}
    if _TIMES[kind][0] != TravelDirection.TWO_WAY:
        choices["direction"] = (*_DIRECTIONS, "")
    optional = ["sigma_s", *_HORIZONTAL, "depth_m", "depth_rx_m", *_ANGLES]
    table = table.readable(
        invalid, times=["time"], numbers=[kind], words=["node"], optional=optional, choices=choices
    )
    keep = np.ones(len(table.frame), dtype=bool)
    from_platform = _from_platform(table)
    for name in _HORIZONTAL:
        if options.track or name not in table.frame.columns:
            continue
        is_missing = ~np.isfinite(table.optional(name))
        for row in np.flatnonzero(from_platform & keep & is_missing).tolist():
            cell = table.frame[name].iloc[row]
            reason = f"the position of the platform is incomplete: {name} is {cell!r}"
            invalid.add(table.path, int(table.frame.index[row]), reason)
            keep[row] = False
    invalid.refuse_most(int(keep.sum()), LocateError)
    return replace(table, frame=table.frame[keep])


def _time_column(table: TextTable) -> str:
    present = [name for name in _TIMES if name in table.frame.columns]
    if len(present) != 1:
        columns = ", ".join(present) or ", ".join(map(str, table.frame.columns))
        raise LocateError(
            f"{table.path}: the columns are {columns}; exactly one of {', '.join(_TIMES)} is"
            " required"
        )
    return present[0]


def _directions(table: TextTable, kind: str) -> NDArray[np.int64]:
    words = table.words("direction")
    out = np.full(len(words), int(_TIMES[kind][0]))
    if _TIMES[kind][0] == TravelDirection.TWO_WAY:
        return out
    for row, word in enumerate(words):
        out[row] = _DIRECTIONS.get(word.lower(), TravelDirection.FROM_NODE)
    return out


class _PlatformPositions:
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
        self.transmit_time = time
        columns = set(table.frame.columns)
        self._geodetic = {"lat", "lon"} <= columns
        self._epoch = epoch
        self._track = bool(options.track)
        if not (self._track or self._geodetic or {"north_m", "east_m"} <= columns or between.all()):
            raise LocateError(
                f"{table.path}: no positions of the platform; add columns lat and lon, or north_m"
                " and east_m, or give `track`"
            )
        self.frame: LocalFrame | None = None
        self.notes: tuple[str, ...] = ()
        if self._track:
            from pymantaray.exchange import read_trajectories

            self._tracks = read_trajectories([str(path) for path in options.track])
            self.notes = self._tracks.notes
            self.frame = (
                LocalFrame(*self._tracks.centre) if self._tracks.centre is not None else None
            )
        elif self._geodetic and not between.all():
            lat, lon = (table.optional(name)[~between] for name in ("lat", "lon"))
            self.frame = LocalFrame(float(np.median(lat)), middle_longitude(lon))
        self.lat_lon = (
            None if not self._geodetic else tuple(table.optional(name) for name in ("lat", "lon"))
        )
        self.attitude = self._attitudes()

    def to_frame(self, frame: LocalFrame | None) -> None:
        """Convert positions to a frame."""
        if self._track:
            self._from_track(frame)
            return
        transmit_position = self._end("", frame)
        columns = set(self._table.frame.columns)
        second = {"lat_rx", "lon_rx"} if self._geodetic else {"north_rx_m", "east_rx_m"}
        if second <= columns:
            self.transmit_position = transmit_position
            self.receive_position = self._end("_rx", frame)
        elif self._between.all():
            self.transmit_position = transmit_position
            self.receive_position = transmit_position
        else:
            ends = self._options.both_ends(self.transmit_time, self._duration, transmit_position)
            self.transmit_time, self.transmit_position, self.receive_position = ends

    def _end(self, suffix: str, frame: LocalFrame | None) -> Array:
        if self._between.all():
            return np.full((self.transmit_time.size, 3), np.nan)
        if self._geodetic:
            lat, lon = (self._table.optional(f"{name}{suffix}") for name in ("lat", "lon"))
            if frame is None:
                raise LocateError(f"{self._table.path}: latitudes and longitudes without a frame")
            north, east = (
                np.where(self._between, np.nan, values)
                for values in frame.to_local(
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
            exists = any(column in self._table.frame.columns for column in columns)
            angles = [np.radians(self._table.optional(column, 0.0)) for column in columns]
            out.append(np.column_stack(angles) if exists or not out else out[0])
        return out

    def _rows_left_out(self) -> str:
        """Rows that the reader of the track left out, which may be its first or last."""
        lines = [note for note in self.notes if LEFT_OUT in note]
        return f"; rows of the track are left out: {'; '.join(lines)}" if lines else ""

    def _from_track(self, frame: LocalFrame | None) -> None:
        tracks = self._tracks
        options = self._options
        names = tracks.names
        if options.platform is None and len(names) > 1:
            raise LocateError(
                f"track: it contains {', '.join(names[:_MAX_NAMES])}; name the platform with"
                " `platform`"
            )
        name = options.platform or names[0]
        if name not in names:
            available = ", ".join(names[:_MAX_NAMES])
            raise LocateError(f"track: no platform {name}; available: {available}")
        offset = 0.0
        if tracks.start is not None and not np.isnat(self._epoch):
            offset = float(seconds_since(self._epoch, tracks.start))
        elif (tracks.start is None) != np.isnat(self._epoch):
            raise LocateError(
                "track: only one of track and survey has dates; both must have dates, or both"
                " times in seconds"
            )
        track = next(
            track for track in tracks.in_frame(frame or LocalFrame(0.0, 0.0)) if track.name == name
        )
        instants = {"transmission": self.transmit_time + offset}
        instants["reception"] = instants["transmission"] + self._duration
        first = track.time[0]
        last = track.time[-1]
        for noun, instant in instants.items():
            outside = ((instant < first - 1e-6) | (instant > last + 1e-6)) & ~self._between
            if outside.any():
                raise LocateError(
                    f"{self._table.where(int(np.argmax(outside)))}: the {noun} is"
                    f" {instant[outside][0]:.1f} s after the start of the track, which lasts"
                    f" {last - first:.1f} s{self._rows_left_out()}"
                )
        times = np.unique(np.concatenate(list(instants.values())))
        record = tracks.at(times, frame or LocalFrame(0.0, 0.0))
        k = names.index(name)
        rows = [np.searchsorted(record.time, instant) for instant in instants.values()]
        self.transmit_position, self.receive_position = (record.position[k, row] for row in rows)
        has_attitude = track.quaternion is not None
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
    return LocalFrame(float(np.median(lat)), middle_longitude(lon))


def _nodes(
    table: TextTable,
    options: ReadOptions,
    frame: LocalFrame | None,
    platform: _PlatformPositions,
    names: list[str],
) -> tuple[Node, ...]:
    """Nodes by name, from the table of nodes or from the positions of the platform."""
    nodes = {} if options.nodes is None else _node_table(options, frame, platform)
    missing = [name for name in names if name not in nodes]
    if missing and options.nodes is not None:
        raise LocateError(
            f"{options.nodes}: no node {missing[0]}, which the survey has; available:"
            f" {', '.join(nodes)}"
        )
    for name in missing:
        if options.depth is None:
            raise LocateError(
                f"{table.path}: the depth of node {name} is unknown; give `depth` or `nodes`"
            )
        has_position = np.isfinite(platform.transmit_position).all(axis=1)
        rows = (table.frame["node"].str.strip() == name).to_numpy() & has_position
        if not rows.any():
            raise LocateError(
                f"{table.path}: node {name} has no ping of the platform; give `nodes`"
            )
        middle = np.median(platform.transmit_position[rows], axis=0)
        nodes[name] = Node(name, (float(middle[0]), float(middle[1]), options.depth), _SIGMA)
    return tuple(nodes[name] for name in nodes if name in names)


def _node_table(
    options: ReadOptions, frame: LocalFrame | None, platform: _PlatformPositions
) -> dict[str, Node]:
    path = Path(str(options.nodes))
    table = read_text_table(path)
    table.require(["name"])
    columns = set(table.frame.columns)
    if {"lat", "lon"} <= columns and frame is not None:
        lat, lon = table.numbers(["lat", "lon"]).T
        if platform.lat_lon is not None:
            platform_lat, platform_lon = platform.lat_lon
            is_finite = np.isfinite(platform_lat) & np.isfinite(platform_lon)
            positions = platform_lat[is_finite], platform_lon[is_finite]
            for k, name in enumerate(table.frame["name"]):
                check_positions(str(path), positions, (float(lat[k]), float(lon[k])), str(name))
        north, east = frame.to_local(lat, lon)
    else:
        north, east = table.numbers(["north_m", "east_m"]).T
    depth = (
        table.numbers(["depth_m"])[:, 0]
        if "depth_m" in columns
        else np.full(len(table.frame), options.depth or np.nan)
    )
    if not np.isfinite(depth).all():
        raise LocateError(f"{path}: no column depth_m; add it, or give `depth`")
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
    other_values = {
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
            **{key: float(values[k]) for key, values in other_values.items()},
        )
        for k, name in enumerate(names)
    }
