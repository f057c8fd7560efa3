"""
Reader and writer of the text format of the TUM RGB-D benchmark, which evo and other programs read.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array, Indices
from pymantaray.errors import ExchangeError, MantaRayError
from pymantaray.estimation import FactorGraph, GraphValues
from pymantaray.exchange.centre import Centre, centre_comments, centre_in_comments
from pymantaray.exchange.tracks import Poses
from pymantaray.messages import one_line
from pymantaray.quantities.checks import parsed_number
from pymantaray.records import whole_file
from pymantaray.records.digits import counted
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.records.text_table import check_seconds
from pymantaray.user_files import read_text


def write_tum(
    path: Path | str,
    time: ArrayLike,
    position: ArrayLike,
    quaternion: ArrayLike,
    *,
    centre: Centre | None = None,
) -> None:
    """
    Write one vehicle's trajectory as TUM text, atomically.

    Each line is ``time x y z qx qy qz qw`` with 17 significant digits. x, y, z are north, east and
    down, and the rotation is from body to that frame. Comment lines at the top contain the frame's
    centre.

    Parameters
    ----------
    path : pathlib.Path or str
        File to create or replace; its folder must exist.
    time : array_like, shape (n_times,)
        Times. [s]
    position : array_like, shape (n_times, 3)
        Positions north, east, down in the local frame. [m]
    quaternion : array_like, shape (n_times, 4)
        Rotation body to world, (w, x, y, z).
    centre : tuple of float, optional
        Latitude and longitude of the local frame's centre. [degrees]

    Examples
    --------
    >>> from pathlib import Path
    >>> from pymantaray.exchange import write_tum
    >>> position = [[0.0, 0.0, 20.0], [30.0, 0.0, 20.0]]
    >>> write_tum("A.tum", [0.0, 60.0], position, [[1.0, 0.0, 0.0, 0.0]] * 2)
    >>> Path("A.tum").read_text().splitlines()[-1]
    '60 30 0 20 0 0 0 1'
    """
    path = Path(path)
    t, p, q = (np.asarray(a, dtype=float) for a in (time, position, quaternion))
    if t.ndim != 1 or p.shape != (t.size, 3) or q.shape != (t.size, 4):
        raise MantaRayError(
            f"{path}: shapes of time, position and quaternion are {t.shape}, {p.shape} and"
            f" {q.shape}; they must be (n,), (n, 3) and (n, 4)"
        )
    table = np.concatenate([t[:, None], p, q[:, [1, 2, 3, 0]]], axis=1)
    if not np.isfinite(table).all():
        row = int(np.argmin(np.isfinite(table).all(axis=1)))
        raise MantaRayError(f"{path}: pose {row} is not finite; a failed solve has no trajectory")
    with whole_file(path) as temporary:
        np.savetxt(temporary, table, fmt="%.17g", header="\n".join(centre_comments(centre)))


def write_graph_tum(path: Path | str, graph: FactorGraph, values: GraphValues) -> list[Path]:
    """
    Write the trajectory of each vehicle of a graph as TUM text.

    Parameters
    ----------
    path : pathlib.Path or str
        File for a graph with one vehicle. With several, the file of each vehicle has its name
        before the suffix: ``run.tum`` becomes ``run-A.tum``, ``run-B.tum`` and so on.
    graph : FactorGraph
        Graph with vehicles, order of poses (by number) and times.
    values : GraphValues
        Poses.

    Returns
    -------
    list of pathlib.Path
        Files written.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.exchange import write_graph_tum
    >>> [path.name for path in write_graph_tum("run.tum", graph, start)]
    ['run-A.tum', 'run-B.tum']
    """
    files = graph_tum_files(path, graph)
    for vehicle, file in enumerate(files):
        rows = np.flatnonzero(graph.pose_vehicle == vehicle)
        rows = rows[np.argsort(graph.pose_number[rows], kind="stable")]
        write_tum(file, graph.pose_time[rows], values.position[rows], values.quaternion[rows])
    return files


def graph_tum_files(path: Path | str, graph: FactorGraph) -> list[Path]:
    """
    Files that `write_graph_tum` writes for a graph.

    Parameters
    ----------
    path : pathlib.Path or str
        As in `write_graph_tum`.
    graph : FactorGraph
        Graph with vehicles.

    Returns
    -------
    list of pathlib.Path

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.exchange import graph_tum_files
    >>> [path.name for path in graph_tum_files("run.tum", graph)]
    ['run-A.tum', 'run-B.tum']
    """
    path = Path(path)
    if graph.vehicle_name.size == 1:
        return [path]
    return [
        path.with_name(f"{path.stem}-{name}{path.suffix}") for name in graph.vehicle_name.tolist()
    ]


def read_tum(path: Path) -> tuple[list[Poses], tuple[str, ...]]:
    """
    Read the trajectory of a TUM file, and a note about invalid lines; the name of the file is the
    name of the vehicle.
    """
    invalid = InvalidLines()
    table, line = text_numbers(path, 8, "a TUM file has 8 per row, time x y z qx qy qz qw", invalid)
    check_seconds(table[:, 0], f"{path}: time", ExchangeError)
    quaternion = table[:, [7, 4, 5, 6]]
    lines = read_text(path, ExchangeError).splitlines()
    centre = centre_in_comments((line for line in lines if line.lstrip().startswith("#")), path)
    track = Poses(path.stem, table[:, 0], table[:, 1:4], quaternion, False, str(path), centre, line)
    return [track], invalid.notes


def text_numbers(
    path: Path, width: int, about: str, invalid: InvalidLines | None = None
) -> tuple[Array, Indices]:
    """
    Finite numbers (n, width) of a text without header, separated by spaces or commas, and their
    lines; ``about`` describes its rows.

    Lines with anything else are added to ``invalid``; without it, the first of them raises an
    error.
    """
    rows: list[list[float]] = []
    lines: list[int] = []
    wrong = InvalidLines() if invalid is None else invalid
    for number, line in enumerate(read_text(path, ExchangeError).splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            row = [parsed_number(word) for word in words]
        except ValueError:
            wrong.add(path, number, f"{one_line(line, 60)!r} has a word that is no number; {about}")
            continue
        if len(row) != width:
            wrong.add(path, number, f"{counted(len(row), 'number')}; {about}")
        elif not np.isfinite(row).all():
            wrong.add(path, number, "a number is not finite; correct or remove it")
        else:
            rows.append(row)
            lines.append(number)
    wrong.refuse_most(0 if invalid is None else len(rows), ExchangeError)
    if not rows:
        raise ExchangeError(f"{path}: 0 rows of numbers; {about}")
    return np.array(rows), np.array(lines, dtype=np.int64)
