"""Reader of tables of pings, one per row; optional tables of nodes and tracks."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.read_rows import attitudes, check_positions, possible_rows
from pymantaray.apps.locate.survey import Node, Survey, TravelDirection, check_names
from pymantaray.arrays import Array, Mask
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
_GEODETIC = (("lat", "lon"), ("lat_rx", "lon_rx"))
_LOCAL = (("north_m", "east_m"), ("north_rx_m", "east_rx_m"))
_HORIZONTAL = [name for ends in (_GEODETIC, _LOCAL) for end in ends for name in end]
_ANGLES = [[f"{name}{end}_deg" for name in ("heading", "pitch", "roll")] for end in ("", "_rx")]
_MAX_NAMES = 6  # in a message
_FALSE = ("0", "false", "no", "n", "f")
_TRUE = ("1", "true", "yes", "y", "t", "")


def read_table(path: Path, options: ReadOptions) -> Survey:
    """Read a survey from a table; the how-to lists its columns."""
    # rows that can be read, at possible positions
    invalid = InvalidLines()
    table = read_text_table(path, invalid=invalid)
    in_degrees = "lat_deg" in table.frame.columns
    titles = {f"{name}_deg": name for end in _GEODETIC for name in end}
    table = replace(table, frame=table.frame.rename(columns=titles))
    kind = _time_column(table)
    table = _readable(table, kind, options, invalid)
    is_geodetic = {"lat", "lon"} <= set(table.frame.columns)
    positions = PositionRows(path, LocateError, fastest=FASTEST_PLATFORM)
    if not options.track:
        time, _ = table.seconds("time")
        ends = [(time, *axes) for axes in (_GEODETIC if is_geodetic else _LOCAL)]
        table = possible_rows(
            table,
            positions,
            _from_platform(table),
            ends,
            geographic=is_geodetic,
            stated_degrees=in_degrees,
        )
    # frame, platform and nodes
    from_platform = _from_platform(table)
    time, epoch = table.seconds("time")
    travel_time = table.numbers([kind])[:, 0] * _TIMES[kind][1]
    node_table = None if options.nodes is None else read_text_table(options.nodes)
    notes: tuple[str, ...] = ()
    if options.track:
        frame, platform, notes = _on_track(table, options, time, epoch, travel_time, node_table)
    else:
        frame = _frame(table, from_platform) or _frame(node_table)
        platform = _in_table(table, options, frame, time, travel_time)
    names = table.words("node")
    partners = table.words("partner")
    wanted = sorted(set(names) | set(filter(None, partners)))
    if node_table is None:
        nodes = _nodes_at_pings(table, options, platform["transmit_position"], wanted)
    else:
        nodes = _nodes_of_table(node_table, options, frame, table, wanted)
    number = {node.name: k for k, node in enumerate(nodes)}
    direction = np.full(len(names), int(_TIMES[kind][0]))
    if _TIMES[kind][0] != TravelDirection.TWO_WAY:
        words = table.words("direction")
        direction[:] = [_DIRECTIONS.get(w.lower(), TravelDirection.FROM_NODE) for w in words]
    survey = Survey(
        nodes=nodes,
        node=np.array([number[name] for name in names]),
        travel_time=travel_time,
        **platform,
        direction=direction,
        partner=np.array([number.get(name, -1) for name in partners]),
        sigma=table.optional("sigma_s"),
        flagged=np.array([word.lower() in _FALSE for word in table.words("use")]),
        line=table.lines,
        frame=frame,
        epoch=epoch,
        source=str(path),
        notes=(*invalid.notes, *positions.notes, *notes),
    )
    return options.apply(survey)


def _time_column(table: TextTable) -> str:
    """Title of the column of travel times."""
    present = [name for name in _TIMES if name in table.frame.columns]
    if len(present) != 1:
        columns = ", ".join(present) or ", ".join(map(str, table.frame.columns))
        raise LocateError(
            f"{table.path}: the columns are {columns}; exactly one of {', '.join(_TIMES)} is"
            " required"
        )
    return present[0]


def _from_platform(table: TextTable) -> Mask:
    """Rows between the platform and a node, not between two nodes."""
    return np.array([word == "" for word in table.words("partner")], dtype=bool)


def _readable(
    table: TextTable, kind: str, options: ReadOptions, invalid: InvalidLines
) -> TextTable:
    """Rows with a time, a node, a travel time, and a position of the platform or a partner."""
    choices: dict[str, Collection[str]] = {"use": _TRUE + _FALSE}
    if _TIMES[kind][0] != TravelDirection.TWO_WAY:
        choices["direction"] = (*_DIRECTIONS, "")
    optional = ["sigma_s", *_HORIZONTAL, "depth_m", "depth_rx_m", *_ANGLES[0], *_ANGLES[1]]
    table = table.readable(
        invalid, times=["time"], numbers=[kind], words=["node"], optional=optional, choices=choices
    )
    keep = np.ones(len(table.frame), dtype=bool)
    from_platform = _from_platform(table)
    required = [] if options.track else [n for n in _HORIZONTAL if n in table.frame.columns]
    for name in required:
        is_missing = ~np.isfinite(table.optional(name))
        for row in np.flatnonzero(from_platform & keep & is_missing).tolist():
            cell = table.frame[name].iloc[row]
            reason = f"the position of the platform is incomplete: {name} is {cell!r}"
            invalid.add(table.path, int(table.frame.index[row]), reason)
            keep[row] = False
    invalid.refuse_most(int(keep.sum()), LocateError)
    return replace(table, frame=table.frame[keep])


def _frame(table: TextTable | None, rows: Mask | slice = slice(None)) -> LocalFrame | None:
    """Frame at the middle of the latitudes and longitudes of a table; None without them."""
    if table is None or not {"lat", "lon"} <= set(table.frame.columns):
        return None
    lat = table.optional("lat")[rows]
    lon = table.optional("lon")[rows]
    return LocalFrame(float(np.median(lat)), middle_longitude(lon)) if lat.size else None


def _in_table(
    table: TextTable,
    options: ReadOptions,
    frame: LocalFrame | None,
    time: Array,
    travel_time: Array,
) -> dict[str, Any]:
    """Times of transmission, positions and attitudes of the platform from the table."""
    columns = set(table.frame.columns)
    is_geodetic = {"lat", "lon"} <= columns
    titles = _GEODETIC if is_geodetic else _LOCAL
    from_platform = _from_platform(table)
    if from_platform.any() and not set(titles[0]) <= columns:
        raise LocateError(
            f"{table.path}: no positions of the platform; add columns lat and lon, or north_m"
            " and east_m, or give `track`"
        )
    positions = []
    for axes, depth in zip(titles, ("depth_m", "depth_rx_m"), strict=True):
        north, east = (np.where(from_platform, table.optional(axis), 0.0) for axis in axes)
        if is_geodetic and frame is not None:
            north, east = frame.to_local(north, east)
        down = table.optional(depth, options.transducer_depth)
        position = np.column_stack([north, east, down])
        positions.append(np.where(from_platform[:, None], position, np.nan))
    transmit_position, receive_position = positions
    if not set(titles[1]) <= columns:
        receive_position = transmit_position
        if from_platform.any():
            time, *positions = options.both_ends(time, travel_time, transmit_position)
            transmit_position, receive_position = positions
    transmit_attitude, receive_attitude = attitudes(table, _ANGLES)
    return {
        "time": time,
        "transmit_position": transmit_position,
        "receive_position": receive_position,
        "transmit_attitude": transmit_attitude,
        "receive_attitude": receive_attitude,
    }


def _on_track(
    table: TextTable,
    options: ReadOptions,
    time: Array,
    epoch: np.datetime64,
    travel_time: Array,
    node_table: TextTable | None,
) -> tuple[LocalFrame | None, dict[str, Any], tuple[str, ...]]:
    """Frame, positions and attitudes of the platform from its track, and notes of its reader."""
    from pymantaray.exchange import read_trajectories

    # track of the platform
    tracks = read_trajectories([str(path) for path in options.track])
    frame = LocalFrame(*tracks.centre) if tracks.centre is not None else _frame(node_table)
    some = ", ".join(tracks.names[:_MAX_NAMES])
    if options.platform is None and len(tracks.names) > 1:
        raise LocateError(f"track: it contains {some}; name the platform with `platform`")
    name = options.platform or tracks.names[0]
    if name not in tracks.names:
        raise LocateError(f"track: no platform {name}; available: {some}")
    # seconds from the track's start to the survey's
    offset = 0.0
    if tracks.start is not None and not np.isnat(epoch):
        offset = float(seconds_since(epoch, tracks.start))
    elif (tracks.start is None) != np.isnat(epoch):
        raise LocateError(
            "track: only one of track and survey has dates; both must have dates, or both"
            " times in seconds"
        )
    # the track must contain every ping
    plane = frame or LocalFrame(0.0, 0.0)
    track = next(track for track in tracks.in_frame(plane) if track.name == name)
    first = track.time[0]
    last = track.time[-1]
    lines = [note for note in tracks.notes if LEFT_OUT in note]
    left_out = f"; rows of the track are left out: {'; '.join(lines)}" if lines else ""
    instants = {"transmission": time + offset, "reception": time + offset + travel_time}
    for noun, instant in instants.items():
        is_outside = (instant < first - 1e-6) | (instant > last + 1e-6)
        is_outside &= _from_platform(table)
        if is_outside.any():
            raise LocateError(
                f"{table.where(int(np.argmax(is_outside)))}: the {noun} is"
                f" {instant[is_outside][0]:.1f} s after the start of the track, which lasts"
                f" {last - first:.1f} s{left_out}"
            )
    # position and attitude at both ends of each ping
    record = tracks.at(np.unique(np.concatenate(list(instants.values()))), plane)
    k = tracks.names.index(name)
    values: dict[str, Any] = {"time": time}
    for end, instant in zip(("transmit", "receive"), instants.values(), strict=True):
        row = np.searchsorted(record.time, instant)
        values[f"{end}_position"] = record.position[k, row]
        values[f"{end}_attitude"] = np.zeros((row.size, 3))
        if track.quaternion is not None:
            rotation = Rotation.from_quat(record.quaternion[k, row], scalar_first=True)
            values[f"{end}_attitude"] = rotation.as_euler("ZYX")
    return frame, values, tracks.notes


def _nodes_at_pings(
    table: TextTable, options: ReadOptions, position: Array, names: list[str]
) -> tuple[Node, ...]:
    """Nodes with priors at the median positions of the platform at their pings."""
    nodes = []
    has_position = np.isfinite(position).all(axis=1)
    for name in names:
        if options.depth is None:
            raise LocateError(
                f"{table.path}: the depth of node {name} is unknown; give `depth` or `nodes`"
            )
        rows = (table.frame["node"].str.strip() == name).to_numpy() & has_position
        if not rows.any():
            raise LocateError(
                f"{table.path}: node {name} has no ping of the platform; give `nodes`"
            )
        north, east, _ = np.median(position[rows], axis=0)
        nodes.append(Node(name, (float(north), float(east), options.depth), _SIGMA))
    return tuple(nodes)


def _nodes_of_table(
    table: TextTable,
    options: ReadOptions,
    frame: LocalFrame | None,
    pings: TextTable,
    names: list[str],
) -> tuple[Node, ...]:
    """Nodes of these names in the order of their own table."""
    table.require(["name"])
    of_table = table.words("name")
    check_names(of_table, table.path)
    missing = [name for name in names if name not in of_table]
    if missing:
        raise LocateError(
            f"{options.nodes}: no node {missing[0]}, which the survey has; available:"
            f" {', '.join(of_table)}"
        )
    # positions
    if frame is not None and {"lat", "lon"} <= set(table.frame.columns):
        lat, lon = table.numbers(["lat", "lon"]).T
        platform_lat, platform_lon = (pings.optional(name) for name in ("lat", "lon"))
        rows = np.isfinite(platform_lat) & np.isfinite(platform_lon)
        if rows.any():
            platform = platform_lat[rows], platform_lon[rows]
            for name, *node in zip(of_table, lat, lon, strict=True):
                check_positions(table.path, platform, (float(node[0]), float(node[1])), name)
        north, east = frame.to_local(lat, lon)
    else:
        north, east = table.numbers(["north_m", "east_m"]).T
    if "depth_m" in table.frame.columns:
        depth = table.numbers(["depth_m"])[:, 0]
    elif options.depth:
        depth = np.full(north.size, options.depth)
    else:
        raise LocateError(f"{table.path}: no column depth_m; add it, or give `depth`")
    # standard deviations, delays and clocks
    horizontal = table.optional("sigma_horizontal_m", _SIGMA[0])
    sigmas = [
        table.optional(title) if title in table.frame.columns else default
        for title, default in (
            ("sigma_north_m", horizontal),
            ("sigma_east_m", horizontal),
            ("sigma_depth_m", np.full(north.size, _SIGMA[2])),
        )
    ]
    others: dict[str, Any] = {
        "turn_around": table.optional("turn_around_s", 0.0)
        + 1e-3 * table.optional("turn_around_ms", 0.0),
        "turn_around_sigma": table.optional("sigma_turn_around_s", 0.0),
        "offset_sigma": table.optional("sigma_clock_offset_s", 0.0),
        "drift_sigma": table.optional("sigma_clock_drift", 0.0),
    }
    return tuple(
        Node(
            name,
            (float(north[k]), float(east[k]), float(depth[k])),
            (float(sigmas[0][k]), float(sigmas[1][k]), float(sigmas[2][k])),
            **{key: float(values[k]) for key, values in others.items()},
        )
        for k, name in enumerate(of_table)
        if name in names
    )
