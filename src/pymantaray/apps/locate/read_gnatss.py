"""
Reader of GNATSS surveys from their ``config.yaml``.

Columns follow its documentation, https://gnatss.readthedocs.io: ``pxp_tt`` has a time stamp and
two-way times in microseconds, one column per transponder; ``POS_FREED_TRANS_TWTT`` has seconds
since 2000-01-01 12:00, geocentric positions and their covariance.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyproj
from numpy.typing import ArrayLike, NDArray

from pymantaray.apps.locate.read_options import ReadOptions, skipped_note
from pymantaray.apps.locate.survey import Node, PlatformError, Survey
from pymantaray.arrays import Array
from pymantaray.errors import LocateError, optional_package
from pymantaray.geometry import LocalFrame
from pymantaray.messages import one_line
from pymantaray.quantities.checks import parsed_number
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.position_rows import PositionRows
from pymantaray.records.text_table import MONTHS, check_seconds
from pymantaray.user_files import matching_files, read_text

_J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
_TIME_TOLERANCE = 2e-3  # s; between an instant and its position
_RADIUS = (6.3e6, 6.5e6)  # m; limits of the distance of a platform from the centre of the Earth
_MEAN_RADIUS = 6371e3  # m
_SIGMA = (100.0, 100.0, 100.0)  # m; standard deviations of prior positions
_POSITION_COLUMNS = 13  # time, X, Y, Z and the covariance matrix by rows


def read_gnatss(path: Path, options: ReadOptions) -> Survey:
    """Read the survey of an array."""
    config = _config(path)
    solver = config.get("solver") or {}
    try:
        transponders = solver["transponders"]
        files = solver.get("input_files") or config["input_files"]
        centre = (float(solver["array_center"]["lat"]), float(solver["array_center"]["lon"]))
        geoid = float(solver.get("geoid_undulation", 0.0))
        delay = float(solver.get("transducer_delay_time", 0.0))
        frame = LocalFrame(*centre)
        nodes = tuple(_node(k, entry, frame, geoid) for k, entry in enumerate(transponders))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise LocateError(
            f"{path}: not a configuration of GNATSS; correct {error} in solver.transponders,"
            " solver.array_center or input_files"
        ) from None
    answers = _answers(_files(path, files, "travel_times"), len(nodes))
    answers = answers._replace(time=answers.time + delay)
    positions = _positions(_files(path, files, "gps_solution"), frame, geoid)
    survey = _survey(path, nodes, answers, positions)
    return options.apply(
        survey.assign(
            frame=frame,
            profile=_profile(_files(path, files, "sound_speed")[0]),
            notes=(*survey.notes, *answers.notes, *positions.notes),
        )
    )


def _config(path: Path) -> dict[str, Any]:
    with optional_package(LocateError, path, "PyYAML", "gnatss"):
        import yaml
    try:
        config = yaml.safe_load(read_text(path, LocateError, what="a config.yaml"))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise LocateError(f"{path}: not readable: {' '.join(str(error).split())[:100]}") from None
    if not isinstance(config, dict):
        raise LocateError(f"{path}: not a configuration of GNATSS")
    return config


def _node(number: int, entry: dict[str, Any], frame: LocalFrame, geoid: float) -> Node:
    north, east = _to_local(frame, float(entry["lat"]), float(entry["lon"]), geoid)
    depth = geoid - float(entry["height"])
    name = str(entry.get("pxp_id") or f"P{number + 1}")
    turn_around = float(entry.get("internal_delay", 0.0))
    return Node(name, (float(north), float(east), depth), _SIGMA, turn_around=turn_around)


def _to_local(
    frame: LocalFrame, lat: ArrayLike, lon: ArrayLike, geoid: float
) -> tuple[Array, Array]:
    """Local coordinates at the sea surface, whose radius differs by the geoid's height. [m]"""
    north, east = frame.to_local(lat, lon)
    scale = 1.0 + geoid / _MEAN_RADIUS
    return scale * north, scale * east


def _files(path: Path, files: dict[str, Any], key: str) -> list[Path]:
    """Files of a pattern, relative to the configuration or the working folder."""
    entry = files.get(key)
    pattern = entry.get("path") if isinstance(entry, dict) else entry
    if not pattern:
        raise LocateError(f"{path}: input_files has no {key}; add it")
    for folder in (path.parent, Path()):
        if paths := matching_files(str(pattern), folder, LocateError):
            return paths
    raise LocateError(f"{path}: {key}: no file matches {pattern}")


class _Answers(NamedTuple):
    """Pings and their answers."""

    time: Array
    """Time stamps since J2000, (n,). [s]"""
    two_way_time: Array
    """Two-way times (n, n_nodes); NaN without an answer. [s]"""
    line: NDArray[np.int64]
    notes: tuple[str, ...]


class _Positions(NamedTuple):
    """Positions of the transducer."""

    time: Array
    """Times since J2000, (n,). [s]"""
    position: Array
    """Positions in the frame, (n, 3). [m]"""
    variance: Array
    """Variances of X, Y, Z, (n, 3). [m²]"""
    notes: tuple[str, ...]


def _answers(paths: list[Path], count: int) -> _Answers:
    """Pings of files with one column per transponder."""
    stamps = []
    times = []
    lines = []
    invalid = InvalidLines()
    content = f"a time such as 26-JUN-23 00:00:07.00 and {count} two-way times in microseconds"
    for path, number, text, words in _lines(paths):
        try:
            stamp = _stamp(words)
            row = [parsed_number(words[2 + k]) for k in range(count)]
        except (ValueError, KeyError, IndexError):
            invalid.add(path, number, f"{one_line(text, 60)!r} is not {content}")
            continue
        stamps.append(stamp)
        times.append(row)
        lines.append(number)
    invalid.refuse_most(len(times), LocateError)
    values = np.array(times).reshape(-1, count) * 1e-6
    values[values <= 0.0] = np.nan
    order = np.argsort(stamps, kind="stable")
    return _Answers(
        time=np.array(stamps)[order],
        two_way_time=values[order],
        line=np.array(lines)[order],
        notes=invalid.notes,
    )


def _stamp(words: list[str]) -> float:
    """Time stamp of a row since J2000; an error if there is no such date. [s]"""
    day, month, year = words[0].split("-")
    date = np.datetime64(
        f"20{int(year) % 100:02d}-{MONTHS[month.lower()]:02d}-{int(day):02d}", "ns"
    )
    hour, minute, second = words[1].split(":")
    if int(hour) > 23 or int(minute) > 59 or not 0.0 <= float(second) < 61.0:
        raise ValueError(words[1])
    clock = 3600.0 * int(hour) + 60.0 * int(minute) + float(second)
    return float((date - _J2000) / np.timedelta64(1, "s")) + clock


def _positions(paths: list[Path], frame: LocalFrame, geoid: float) -> _Positions:
    """Positions of files with times, geocentric positions and their covariances."""
    rows: list[list[float]] = []
    lines: list[int] = []
    invalid = InvalidLines()
    for path, number, text, words in _lines(paths):
        try:
            values = [parsed_number(word.replace("D", "E")) for word in words[:_POSITION_COLUMNS]]
        except ValueError:
            values = []
        if not _is_position(values):
            reason = (
                f"{one_line(text, 60)!r} is not a time, X, Y, Z near the Earth's surface and nine"
                " covariances"
            )
            invalid.add(path, number, reason)
            continue
        values += [0.0] * (_POSITION_COLUMNS - len(values))
        time, x, y, z, xx, _, _, _, yy, _, _, _, zz = values
        rows.append([time, x, y, z, xx, yy, zz])
        lines.append(number)
    invalid.refuse_most(len(rows), LocateError)
    table = np.array(rows)
    if not table.size:
        raise LocateError(f"{paths[0]}: no position in this file")
    check_seconds(table[:, 0], f"{paths[0]}: time", LocateError)
    order = np.argsort(table[:, 0], kind="stable")
    times, xs, ys, zs, *variances = table[order].T
    geodetic = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    lon, lat, height = geodetic.transform(xs, ys, zs)
    north, east = _to_local(frame, lat, lon, geoid)
    positions = PositionRows(paths[0], LocateError)
    keep = positions.possible(
        times, np.column_stack([lat, lon]), np.array(lines)[order], geographic=True
    )
    positions.refuse_most(int(keep.sum()))
    return _Positions(
        time=times[keep],
        position=np.column_stack([north, east, geoid - height])[keep],
        variance=np.column_stack(variances)[keep],
        notes=(*invalid.notes, *positions.notes),
    )


def _is_position(values: list[float]) -> bool:
    """True for a time and a geocentric position, with all or none of its covariances."""
    if len(values) not in (4, _POSITION_COLUMNS) or not np.isfinite(values).all():
        return False
    _, x, y, z, *_ = values
    low, high = _RADIUS
    return low < float(np.linalg.norm([x, y, z])) < high


def _lines(paths: list[Path]) -> Iterator[tuple[Path, int, str, list[str]]]:
    """File, number, text and words of each line that is neither empty nor a comment."""
    for path in paths:
        for number, text in enumerate(read_text(path, LocateError).splitlines(), 1):
            words = text.replace(",", " ").split()
            if words and not words[0].startswith("#"):
                yield path, number, text, words


def _survey(
    path: Path,
    nodes: tuple[Node, ...],
    answers: _Answers,
    positions: _Positions,
) -> Survey:
    has_answer = np.isfinite(answers.two_way_time)
    row, node = np.nonzero(has_answer)
    two_way = answers.two_way_time[row, node]
    transmit_row = _nearest(positions.time, answers.time[row])
    receive_row = _nearest(positions.time, answers.time[row] + two_way)
    has_position = (transmit_row >= 0) & (receive_row >= 0)
    if not has_position.any():
        raise LocateError(
            f"{path}: no position within {_TIME_TOLERANCE * 1e3:g} ms of a ping and its reply;"
            " check transducer_delay_time"
        )
    row = row[has_position]
    node = node[has_position]
    transmit_row = transmit_row[has_position]
    receive_row = receive_row[has_position]
    two_way = two_way[has_position]
    start = answers.time.min()
    sigma = float(np.sqrt(np.median(positions.variance.mean(axis=1))))
    notes = skipped_note(path, int(np.count_nonzero(~has_answer)))
    if not has_position.all():
        count = np.count_nonzero(~has_position)
        notes += (f"{path}: {count} times without a position of the platform dropped",)
    return Survey(
        nodes=nodes,
        node=node.astype(np.int64),
        time=answers.time[row] - start,
        travel_time=two_way,
        transmit_position=positions.position[transmit_row],
        receive_position=positions.position[receive_row],
        line=answers.line[row],
        platform_error=PlatformError(sigma, sigma),
        epoch=_J2000 + np.timedelta64(round(1e9 * float(start)), "ns"),
        source=str(path),
        notes=notes,
    )


def _nearest(time: Array, instant: Array) -> NDArray[np.int64]:
    """Index of the nearest time to each wanted time; -1 if none is within the tolerance."""
    i = np.clip(np.searchsorted(time, instant), 1, max(time.size - 1, 1))
    last = time.size - 1
    best = np.where(
        np.abs(time[np.minimum(i, last)] - instant) < np.abs(time[i - 1] - instant),
        np.minimum(i, last),
        i - 1,
    )
    return np.where(np.abs(time[best] - instant) <= _TIME_TOLERANCE, best, -1)


def _profile(path: Path) -> tuple[Array, Array]:
    """Depth and sound speed of two columns, depths negative down."""
    rows = [
        line.replace(",", " ").split()[:2] for line in read_text(path, LocateError).splitlines()
    ]
    try:
        table = np.array(
            [
                [parsed_number(word) for word in row]
                for row in rows
                if row and not row[0].startswith("#")
            ]
        ).reshape(-1, 2)
    except ValueError:
        table = np.empty((0, 2))
    if len(table) < 2 or not np.isfinite(table).all():
        raise LocateError(
            f"{path}: not a profile; it must have two columns, depth (negative down) and sound"
            " speed"
        ) from None
    depth, first = np.unique(np.abs(table[:, 0]), return_index=True)
    return depth, table[first, 1]
