"""Factor graphs as PyFactorGraph text in three dimensions: grammar, writer and public reader."""

import re
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation._pyfg_reader import Reader
from pymantaray.estimation._pyfg_words import (
    AGENT_LETTERS,
    EDGE,
    FREE_VARIANCE,
    LANDMARK,
    LANDMARK_PRIOR,
    POSE,
    POSE_PRIOR,
    RANGE,
    SIGHTING,
    TO_FILE,
)
from pymantaray.estimation.graph import FactorGraph, GraphValues, check_graph

Array = NDArray[np.float64]


class GraphFile(NamedTuple):
    """A graph read from a file, the file's values of its variables, and what was left out, counted by kind."""

    graph: FactorGraph
    values: GraphValues
    left_out: dict[str, int]


def write_pyfg(graph: FactorGraph, path: Path | str, *, initial: GraphValues) -> None:
    """
    Write a factor graph as PyFactorGraph text, whole or not at all.

    Parameters
    ----------
    graph : FactorGraph
        Vehicles keep their names if all are single capital letters other than L, and landmarks theirs if
        all are an L and a number; else they get such names in order.
    path : pathlib.Path or str
        File to make or replace; its folder must exist.
    initial : GraphValues
        Values of the vertices: the truth, as PyFactorGraph means it, or any starting point.

    Raises
    ------
    EstimationError
        If there are more than 25 vehicles, no pose, or the values do not fit the graph.

    Notes
    -----
    One space between fields, numbers with 17 significant digits. Covariances are the upper triangle by
    rows in the order x, y, z, rx, ry, rz; a range carries its variance. The grammar has no position prior
    and no depth prior: both are written as pose priors with identity rotation and a variance of 1e12 on
    each free axis, and read back as what they were. PyFactorGraph's own reader [1]_ replaces each
    covariance by a multiple of the identity and so loses the depth priors; it also refuses a range
    between two landmarks, which is written here.

    References
    ----------
    .. [1] PyFactorGraph, ``py_factor_graph/io/pyfg_text.py`` and ``utils/matrix_utils.py``,
       https://github.com/MarineRoboticsGroup/PyFactorGraph
    """
    path = Path(path)
    found = initial.position.shape[0], initial.landmark_position.shape[0]
    needed = graph.n_poses, graph.landmark_name.size
    if found != needed:
        raise EstimationError(
            f"{path}: values for {found[0]} poses and {found[1]} landmarks; the graph has {needed[0]} and {needed[1]}"
        )
    if graph.n_poses == 0:
        raise EstimationError(f"{path}: the graph has no pose; a file has to begin with a vertex")
    names = _file_names(graph, path)
    temporary = path.with_name(path.name + ".part")
    try:
        with temporary.open("w", encoding="ascii", newline="\n") as file:
            file.writelines(_lines(graph, initial, names))
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read_pyfg(path: Path | str) -> tuple[FactorGraph, GraphValues]:
    """
    Read a factor graph from PyFactorGraph text in three dimensions.

    Parameters
    ----------
    path : pathlib.Path or str

    Returns
    -------
    graph : FactorGraph
        Poses in the order of the file. Vehicles in the order of their first pose.
    values : GraphValues
        Values of the vertices.

    Raises
    ------
    EstimationError
        If the file cannot be read or a line is not in the grammar; the message names the line, what was
        found and what is allowed.

    See Also
    --------
    load_pyfg : the same, with a choice of what to leave out.

    Notes
    -----
    A pose prior whose rotation is free (variance 1e12 or more) becomes a position fix, and a depth prior
    if north and east are free too. Full covariances are kept, as PyFactorGraph's own reader does not.
    Time stamps of factors are read and checked, and not kept: each factor is taken to be at the time of its
    poses. Vertices are the ground truth in files that PyFactorGraph wrote.
    """
    graph, values, _ = load_pyfg(path)
    return graph, values


def load_pyfg(path: Path | str, *, leave_out: Collection[str] = ()) -> GraphFile:
    """
    Read a factor graph from PyFactorGraph text, leaving out what is named.

    Parameters
    ----------
    path : pathlib.Path or str
    leave_out : collection of str
        Words whose lines are checked but left out: ``EDGE_SE3_XYZ``, a landmark's place in the body frame
        of a pose, has no factor here and is refused otherwise. PyFactorGraph's own reader [1]_ skips these
        lines without a word.

    Returns
    -------
    GraphFile
        Graph, values of the vertices, and how many lines were left out.

    Raises
    ------
    EstimationError
        As `read_pyfg` does; or if a word of ``leave_out`` is one that the graph holds.

    References
    ----------
    .. [1] PyFactorGraph, ``read_from_pyfg_text`` in ``py_factor_graph/io/pyfg_text.py``,
       https://github.com/MarineRoboticsGroup/PyFactorGraph
    """
    path = Path(path)
    if not set(leave_out) <= {SIGHTING}:
        raise EstimationError(f"{path}: leave out {sorted(leave_out)}; allowed: {SIGHTING}")
    reader = Reader(str(path), leave_out)
    try:
        with path.open(encoding="ascii") as file:
            for number, line in enumerate(file, start=1):
                reader.take(number, line.rstrip("\r\n"))
    except (OSError, UnicodeDecodeError) as error:
        raise EstimationError(f"{path}: not a readable text file: {error}") from None
    graph, values = reader.finish()
    try:
        check_graph(graph)
    except EstimationError as error:
        raise EstimationError(f"{path}: {error}") from None
    return GraphFile(graph, values, dict(reader.left_out))


def _file_names(graph: FactorGraph, path: Path) -> list[str]:
    n_agents = int(graph.agent_name.size)
    if n_agents > len(AGENT_LETTERS):
        raise EstimationError(
            f"{path}: {n_agents} vehicles; the format names them by one letter and keeps L for landmarks:"
            f" {len(AGENT_LETTERS)} at most"
        )
    agents = graph.agent_name.tolist()
    if not set(agents) <= set(AGENT_LETTERS):
        agents = list(AGENT_LETTERS[:n_agents])
    landmarks: list[str] = graph.landmark_name.tolist()
    if not all(re.fullmatch("L(0|[1-9][0-9]{0,8})", name) for name in landmarks):
        landmarks = [f"L{i}" for i in range(len(landmarks))]
    poses = zip(graph.pose_agent.tolist(), graph.pose_number.tolist(), strict=True)
    return [f"{agents[a]}{k}" for a, k in poses] + landmarks


def _lines(graph: FactorGraph, initial: GraphValues, names: list[str]) -> Iterator[str]:
    n = graph.n_poses
    time = [f"{t:.17g}" for t in graph.pose_time.tolist()]
    poses = [f"{t} {name}" for t, name in zip(time, names[:n], strict=True)]

    def at(rows: NDArray[np.int32]) -> list[str]:
        return [poses[i] for i in rows.tolist()]

    yield from _rows(POSE, poses, initial.position, initial.quaternion[:, [1, 2, 3, 0]])
    yield from _rows(LANDMARK, names[n:], initial.landmark_position)
    yield from _rows(
        POSE_PRIOR,
        at(graph.prior_pose),
        graph.prior_position,
        graph.prior_quaternion[:, [1, 2, 3, 0]],
        _triangle(graph.prior_covariance[:, TO_FILE][:, :, TO_FILE]),
    )
    yield from _position_priors(at(graph.fix_pose), graph.fix_position, graph.fix_covariance)
    level = np.zeros((graph.depth.size, 3))
    level[:, 2] = graph.depth
    vertical = np.zeros((graph.depth.size, 3, 3))
    vertical[:, [0, 1], [0, 1]] = FREE_VARIANCE
    vertical[:, 2, 2] = graph.depth_variance
    yield from _position_priors(at(graph.depth_pose), level, vertical)
    yield from _rows(
        LANDMARK_PRIOR,
        [f"0 {names[n + i]}" for i in graph.survey_landmark.tolist()],
        graph.survey_position,
        _triangle(graph.survey_covariance),
    )
    edges = zip(graph.edge_from.tolist(), graph.edge_to.tolist(), strict=True)
    yield from _rows(
        EDGE,
        [f"{time[j]} {names[i]} {names[j]}" for i, j in edges],
        graph.edge_translation,
        graph.edge_quaternion[:, [1, 2, 3, 0]],
        _triangle(graph.edge_covariance[:, TO_FILE][:, :, TO_FILE]),
    )
    ranges = zip(graph.range_first.tolist(), graph.range_second.tolist(), strict=True)
    yield from _rows(
        RANGE,
        [f"{time[i] if i < n else 0} {names[i]} {names[j]}" for i, j in ranges],
        graph.range_distance[:, None],
        graph.range_variance[:, None],
    )


def _position_priors(heads: list[str], position: Array, covariance: Array) -> Iterator[str]:
    full = np.zeros((len(heads), 6, 6))
    full[:, :3, :3] = covariance
    full[:, [3, 4, 5], [3, 4, 5]] = FREE_VARIANCE
    identity = np.tile([0.0, 0.0, 0.0, 1.0], (len(heads), 1))
    yield from _rows(POSE_PRIOR, heads, position, identity, _triangle(full))


def _triangle(covariance: Array) -> Array:
    rows, columns = np.triu_indices(covariance.shape[-1])
    return np.asarray(covariance[:, rows, columns])


def _rows(word: str, heads: Iterable[str], *blocks: Array) -> Iterator[str]:
    table = np.concatenate(blocks, axis=1)
    form = f"{word} %s " + " ".join(["%.17g"] * table.shape[1]) + "\n"
    for head, row in zip(heads, table.tolist(), strict=True):
        yield form % (head, *row)
