"""
Reader of GNATSS surveys from their ``config.yaml``: two-way times, positions of the transducer at
each instant, and profile.

Columns follow its documentation, https://gnatss.readthedocs.io: ``pxp_tt`` has a time stamp and
two-way times in microseconds, one column per transponder; ``POS_FREED_TRANS_TWTT`` has seconds
since 2000-01-01 12:00, geocentric positions and their covariance.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from numpy.typing import NDArray

from pymantaray.apps.locate.read_options import ReadOptions, skipped_note
from pymantaray.apps.locate.survey import Node, PlatformError, Survey
from pymantaray.arrays import Array
from pymantaray.errors import LocateError, optional_package
from pymantaray.geometry import LocalFrame
from pymantaray.messages import one_line
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.text_table import MONTHS, check_seconds
from pymantaray.user_files import matching_files, read_text

_J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
_TIME_TOLERANCE = 2e-3  # s; between an instant and its position
_RADIUS = (6.3e6, 6.5e6)  # m; limits of the distance of a platform from the centre of the Earth
_SIGMA = (100.0, 100.0, 100.0)  # m; standard deviations of prior positions


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
    (times, counts, line), of_times = _times(_files(path, files, "travel_times"), len(nodes))
    positions, of_positions = _positions(_files(path, files, "gps_solution"), frame, geoid)
    survey = _survey(path, nodes, (times + delay, counts, line), positions)
    return options.applied(
        survey.changed(
            frame=frame,
            profile=_profile(_files(path, files, "sound_speed")[0]),
            notes=(*survey.notes, *of_times, *of_positions),
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
    north, east = frame.to_local(float(entry["lat"]), float(entry["lon"]))
    depth = geoid - float(entry["height"])
    name = str(entry.get("pxp_id") or f"P{number + 1}")
    turn_around = float(entry.get("internal_delay", 0.0))
    return Node(name, (float(north), float(east), depth), _SIGMA, turn_around=turn_around)


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


def _times(
    paths: list[Path], count: int
) -> tuple[tuple[Array, Array, NDArray[np.int64]], tuple[str, ...]]:
    """
    Time stamps since J2000 [s], two-way times (n, n_nodes) [s], NaN without an answer, and line
    numbers; and notes.
    """
    stamps = []
    times = []
    lines = []
    invalid = InvalidLines()
    allowed = f"a time such as 26-JUN-23 00:00:07.00 and {count} two-way times in microseconds"
    for path, number, text, words in _lines(paths):
        try:
            row = _row_of_times(words, count)
        except (ValueError, KeyError, IndexError):
            invalid.add(path, number, f"{one_line(text, 60)!r} is not {allowed}")
            continue
        stamps.append(row[0])
        times.append(row[1:])
        lines.append(number)
    invalid.refuse_most(len(times), LocateError)
    values = np.array(times, dtype=float).reshape(-1, count) * 1e-6
    values[values <= 0.0] = np.nan
    order = np.argsort(stamps, kind="stable")
    measured = np.array(stamps)[order], values[order], np.array(lines, dtype=np.int64)[order]
    return measured, invalid.notes


def _row_of_times(words: list[str], count: int) -> list[float]:
    """
    Time stamp since J2000 [s] and two-way times [us] of a row; an error for a row that is
    incomplete or has no such date.
    """
    day, month, year = words[0].split("-")
    date = np.datetime64(
        f"20{int(year) % 100:02d}-{MONTHS[month.lower()]:02d}-{int(day):02d}", "ns"
    )
    hour, minute, second = words[1].split(":")
    if (
        int(hour) > 23
        or int(minute) > 59
        or not 0.0 <= float(second) < 61.0
        or len(words) < 2 + count
    ):
        raise ValueError(words[1])
    clock = 3600.0 * int(hour) + 60.0 * int(minute) + float(second)
    since = float((date - _J2000) / np.timedelta64(1, "s"))
    return [since + clock, *(float(word) for word in words[2 : 2 + count])]


def _positions(
    paths: list[Path], frame: LocalFrame, geoid: float
) -> tuple[tuple[Array, Array, Array], tuple[str, ...]]:
    """
    Times since J2000 [s], positions (n, 3) in the frame [m], and variances (n, 3) of X, Y, Z [m²];
    and notes.
    """
    rows: list[list[float]] = []
    invalid = InvalidLines()
    for path, number, text, words in _lines(paths):
        try:
            values = [float(word.replace("D", "E")) for word in words[:13]]
        except ValueError:
            values = []
        if not _is_position(values):
            reason = (
                f"{one_line(text, 60)!r} is not a time, X, Y, Z near the Earth's surface and nine"
                " covariances"
            )
            invalid.add(path, number, reason)
            continue
        values += [0.0] * (13 - len(values))
        rows.append([*values[:4], values[4], values[8], values[12]])
    invalid.refuse_most(len(rows), LocateError)
    table = np.array(rows)
    if not table.size:
        raise LocateError(f"{paths[0]}: no position in this file")
    check_seconds(table[:, 0], f"{paths[0]}: time", LocateError)
    table = table[np.argsort(table[:, 0], kind="stable")]
    geodetic = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    lon, lat, height = geodetic.transform(table[:, 1], table[:, 2], table[:, 3])
    north, east = frame.to_local(lat, lon)
    place = np.column_stack([north, east, geoid - height])
    return (table[:, 0], place, table[:, 4:7]), invalid.notes


def _is_position(values: list[float]) -> bool:
    """True for a time and a geocentric position, with all or none of its covariances."""
    if len(values) not in (4, 13) or not np.isfinite(values).all():
        return False
    low, high = _RADIUS
    return low < float(np.linalg.norm(values[1:4])) < high


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
    measured: tuple[Array, Array, NDArray[np.int64]],
    positions: tuple[Array, Array, Array],
) -> Survey:
    stamps, times, lines = measured
    row, node = np.nonzero(np.isfinite(times))
    two_way = times[row, node]
    near = _nearest(positions[0], stamps[row])
    away = _nearest(positions[0], stamps[row] + two_way)
    there = (near >= 0) & (away >= 0)
    if not there.any():
        raise LocateError(
            f"{path}: no position within {_TIME_TOLERANCE * 1e3:g} ms of a ping and its reply;"
            " check transducer_delay_time"
        )
    row = row[there]
    node = node[there]
    near = near[there]
    away = away[there]
    two_way = two_way[there]
    start = stamps.min()
    sigma = float(np.sqrt(np.median(positions[2].mean(axis=1))))
    notes = skipped_note(path, int(times.size - np.isfinite(times).sum()))
    if (~there).any():
        notes += (
            f"{path}: {int((~there).sum())} times without a position of the platform dropped",
        )
    return Survey(
        nodes=nodes,
        node=node.astype(np.int64),
        time=stamps[row] - start,
        travel_time=two_way,
        transmit_position=positions[1][near],
        receive_position=positions[1][away],
        line=lines[row],
        platform_error=PlatformError(sigma, sigma),
        epoch=_J2000 + np.timedelta64(round(1e9 * float(start)), "ns"),
        source=str(path),
        notes=notes,
    )


def _nearest(time: Array, wanted: Array) -> NDArray[np.int64]:
    """Index of the nearest time to each wanted time; -1 if none is within the tolerance."""
    i = np.clip(np.searchsorted(time, wanted), 1, max(time.size - 1, 1))
    last = time.size - 1
    best = np.where(
        np.abs(time[np.minimum(i, last)] - wanted) < np.abs(time[i - 1] - wanted),
        np.minimum(i, last),
        i - 1,
    )
    return np.where(np.abs(time[best] - wanted) <= _TIME_TOLERANCE, best, -1)


def _profile(path: Path) -> tuple[Array, Array]:
    """Depth and sound speed of two columns, depths negative down."""
    rows = [
        line.replace(",", " ").split()[:2] for line in read_text(path, LocateError).splitlines()
    ]
    try:
        table = np.array(
            [[float(word) for word in row] for row in rows if row and not row[0].startswith("#")]
        ).reshape(-1, 2)
    except ValueError:
        table = np.empty((0, 2))
    if len(table) < 2 or not np.isfinite(table).all():
        raise LocateError(
            f"{path}: not a profile; it must have two columns, depth (negative down) and sound"
            " speed"
        ) from None
    depth = np.abs(table[:, 0])
    order = np.argsort(depth, kind="stable")
    keep = np.diff(depth[order], prepend=-1.0) > 0.0
    return depth[order][keep], table[order, 1][keep]
