"""
Reader of GNATSS surveys from their ``config.yaml``.

Columns follow its documentation, https://gnatss.readthedocs.io: ``pxp_tt`` has a time stamp and
two-way times in microseconds, one column per transponder; ``POS_FREED_TRANS_TWTT`` has seconds
since 2000-01-01 12:00, geocentric positions and their covariance.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from numpy.typing import ArrayLike, NDArray

from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.read_rows import (
    number_rows,
    numbers_of,
    seconds_of_day,
    skipped_note,
)
from pymantaray.apps.locate.survey import Node, PlatformError, Survey
from pymantaray.arrays import Array
from pymantaray.errors import LocateError, optional_package
from pymantaray.geometry import LocalFrame
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
    config = _configuration(path)
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
    # pings, and the nearest positions of the transducer at both of their ends
    invalid = InvalidLines()
    answers, lines = _answers(_files(path, files, "travel_times"), len(nodes), invalid)
    position_files = _files(path, files, "gps_solution")
    invalid_positions = InvalidLines()
    instants, position, variance, notes = _positions(
        position_files, frame, geoid, invalid_positions
    )
    stamps = answers[:, 0] + delay
    row, node = np.nonzero(answers[:, 1:] > 0.0)
    two_way = answers[row, 1 + node]
    transmit_row = _nearest(instants, stamps[row])
    receive_row = _nearest(instants, stamps[row] + two_way)
    has_position = (transmit_row >= 0) & (receive_row >= 0)
    if not has_position.any():
        raise LocateError(
            f"{path}: no position within {_TIME_TOLERANCE * 1e3:g} ms of a ping and its reply;"
            " check transducer_delay_time"
        )
    n_without = np.count_nonzero(~has_position)
    without = f"{path}: {n_without} times without a position of the platform dropped"
    sigma = float(np.sqrt(np.median(variance.mean(axis=1))))
    survey = Survey(
        nodes=nodes,
        node=node,
        time=stamps[row] - stamps.min(),
        travel_time=two_way,
        transmit_position=position[transmit_row],
        receive_position=position[receive_row],
        line=lines[row],
        platform_error=PlatformError(sigma, sigma),
        frame=frame,
        profile=_profile(_files(path, files, "sound_speed")[0]),
        epoch=_J2000 + np.timedelta64(round(1e9 * float(stamps.min())), "ns"),
        source=str(path),
        notes=(
            *skipped_note(path, answers[:, 1:].size - row.size),
            *([without] if n_without else []),
            *invalid.notes,
            *invalid_positions.notes,
            *notes,
        ),
    )
    return options.apply(survey.rows(has_position))


def _configuration(path: Path) -> dict[str, Any]:
    """Content of a ``config.yaml``."""
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


def _answers(
    paths: list[Path], count: int, invalid: InvalidLines
) -> tuple[Array, NDArray[np.int64]]:
    """
    Time stamps since J2000 and two-way times (n, 1 + n_nodes), and their lines, in order. [s]

    Two-way times without an answer are 0.
    """

    def read(words: list[str]) -> list[float]:
        day, month, year = words[0].split("-")
        date = np.datetime64(
            f"20{int(year) % 100:02d}-{MONTHS[month.lower()]:02d}-{int(day):02d}", "ns"
        )
        stamp = float((date - _J2000) / np.timedelta64(1, "s")) + seconds_of_day(words[1])
        return [stamp, *(1e-6 * parsed_number(words[2 + k]) for k in range(count))]

    what = f"a time such as 26-JUN-23 00:00:07.00 and {count} two-way times in microseconds"
    table, lines = number_rows(paths, invalid, read, what)
    order = np.argsort(table[:, 0], kind="stable")
    return table[order], lines[order]


def _positions(
    paths: list[Path], frame: LocalFrame, geoid: float, invalid: InvalidLines
) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """
    Times since J2000 [s], positions (n, 3) [m] and variances of X, Y, Z (n, 3) [m²], and notes.
    """

    def read(words: list[str]) -> list[float]:
        values = numbers_of(words[:_POSITION_COLUMNS])
        low, high = _RADIUS
        # all covariances, or none
        has_count = len(values) in (4, _POSITION_COLUMNS)
        if not (has_count and low < float(np.linalg.norm(values[1:4])) < high):
            raise ValueError(values)
        return values + [0.0] * (_POSITION_COLUMNS - len(values))

    what = "a time, X, Y, Z near the Earth's surface and nine covariances"
    table, lines = number_rows(paths, invalid, read, what)
    if not table.size:
        raise LocateError(f"{paths[0]}: no position in this file")
    check_seconds(table[:, 0], f"{paths[0]}: time", LocateError)
    order = np.argsort(table[:, 0], kind="stable")
    table = table[order]
    geodetic = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    lon, lat, height = geodetic.transform(table[:, 1], table[:, 2], table[:, 3])
    north, east = _to_local(frame, lat, lon, geoid)
    positions = PositionRows(paths[0], LocateError)
    keep = positions.possible(
        table[:, 0], np.column_stack([lat, lon]), lines[order], geographic=True
    )
    positions.refuse_most(int(keep.sum()))
    position = np.column_stack([north, east, geoid - height])
    variance = table[:, [4, 8, 12]]
    return table[keep, 0], position[keep], variance[keep], positions.notes


def _nearest(time: Array, instant: Array) -> NDArray[np.int64]:
    """Index of the nearest time to each wanted time; -1 if none is within the tolerance."""
    last = time.size - 1
    after = np.clip(np.searchsorted(time, instant), min(1, last), last)
    before = np.maximum(after - 1, 0)
    is_after = np.abs(time[after] - instant) < np.abs(time[before] - instant)
    best = np.where(is_after, after, before)
    return np.where(np.abs(time[best] - instant) <= _TIME_TOLERANCE, best, -1)


def _profile(path: Path) -> tuple[Array, Array]:
    """Depth and sound speed of two columns, depths negative down."""
    invalid = InvalidLines()
    what = "a depth (negative down) and a sound speed"
    table, _ = number_rows([path], invalid, lambda words: numbers_of([words[0], words[1]]), what)
    invalid.refuse_most(0, LocateError)
    if len(table) < 2:
        raise LocateError(f"{path}: not a profile; it must have at least two lines with {what}")
    depth, first = np.unique(np.abs(table[:, 0]), return_index=True)
    return depth, table[first, 1]
