"""Pose graphs as g2o text in three dimensions: poses and edges between them, nothing else."""

import re
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.graph import (
    EDGE,
    KINDS,
    SMALLEST_EIGENVALUE,
    FactorGraph,
    GraphValues,
    check_graph,
    check_values,
)
from pymantaray.estimation.pyfg import (
    POSE,
    TO_FILE,
    TO_WXYZ,
    TO_XYZW,
    GraphFile,
    TextLines,
    from_triangle,
    triangle,
)
from pymantaray.records import whole_file

Array = NDArray[np.float64]

_KIND_OF = {kind.plural: name for name, kind in KINDS.items() if name != "edge"}
LEFT_OUT = ("landmarks", *_KIND_OF)

_SYMBOL_SHIFT = 56  # GTSAM's symbols: a letter in the uppermost byte, a number below
_LARGEST_ID = 2**31 - 1  # g2o's ids are C ints
_INTEGER = re.compile("[0-9]{1,20}")


def write_g2o(
    graph: FactorGraph,
    path: Path | str,
    *,
    initial: GraphValues,
    leave_out: Collection[str] = (),
    symbols: bool = False,
    half_angles: bool = False,
) -> dict[str, int]:
    """
    Write the poses and edges of a factor graph as g2o text, whole or not at all, and count what is left out.

    What the format [1]_ cannot hold, of `LEFT_OUT`, has to be named in ``leave_out``. Vertices are numbered by the
    row of the pose, or with ``symbols`` as GTSAM's symbols, which keep vehicle and number (vehicles of one
    letter only) and are too large for g2o itself. With ``half_angles`` the rotation part of the information is that of
    x, y, z of the quaternion, half the angle, as g2o has it [2]_; else that of the rotation vector, as GTSAM
    reads the same numbers (checked with 4.3). GTSAM's own writer rounds to six digits; its reader takes ``nan``
    for 0, numbers that are missing for anything, and skips other lines in silence.

    References
    ----------
    .. [1] g2o wiki, "File Format" and "File format slam 3d", https://github.com/RainerKuemmerle/g2o/wiki
    .. [2] g2o issue 699, https://github.com/RainerKuemmerle/g2o/issues/699
    """
    path = Path(path)
    if not set(leave_out) <= set(LEFT_OUT):
        raise EstimationError(f"{path}: leave out {sorted(leave_out)}; allowed: {', '.join(LEFT_OUT)}")
    check_graph(graph)
    check_values(graph, initial)
    sizes = {
        what: len(graph[_KIND_OF[what]]) if what in _KIND_OF else graph.landmark_name.size
        for what in LEFT_OUT
    }
    lost = {what: int(n) for what, n in sizes.items() if n}
    refused = [f"{n} {what}" for what, n in lost.items() if what not in leave_out]
    if refused:
        raise EstimationError(
            f"{path}: g2o files hold poses and edges between them; the graph has {', '.join(refused)} besides:"
            " agree to leave them out (--leave-out all)"
        )
    ids = _symbols(graph, path) if symbols else list(range(graph.n_poses))
    with whole_file(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(_lines(graph, initial, ids, half_angles=half_angles))
    return lost


def load_g2o(path: Path | str, *, leave_out: Collection[str] = (), half_angles: bool = False) -> GraphFile:
    """
    Read a pose graph from g2o text in three dimensions.

    Lines of the words in ``leave_out``, such as ``VERTEX_TRACKXYZ`` or ``FIX``, are skipped and counted; others
    are refused. Ids that are GTSAM symbols become vehicle and number; others belong to a vehicle A. A pose's
    number stands for its time. [s]
    """
    path = Path(path)
    vertices: dict[int, list[float]] = {}
    edges: list[tuple[int, list[int], list[float]]] = []
    left_out: Counter[str] = Counter()
    lines = TextLines(path)
    for line in lines:
        word, *fields = line.split() or ["#"]
        if word.startswith("#"):
            continue
        if word == POSE:
            (pose,), values = _take(lines, word, fields, 1, 7)
            if pose in vertices:
                lines.refuse(f"second vertex {pose}", "one vertex for each id")
            vertices[pose] = values
        elif word == EDGE:
            edges.append((lines.number, *_take(lines, word, fields, 2, 7 + 21)))
        elif word in leave_out:
            left_out[word] += 1
        else:
            lines.refuse(f"begins with {word[:40]!r}", f"{POSE}, {EDGE}, or what is left out")
    if not vertices:
        lines.refuse(f"no {POSE} in the file", "one pose at least", 0)
    graph, values_of = _graph(lines, vertices, edges, half_angles=half_angles)
    try:
        check_graph(graph)
    except EstimationError as error:
        raise EstimationError(f"{path}: {error}") from None
    return GraphFile(graph, values_of, dict(left_out))


def _lines(graph: FactorGraph, values: GraphValues, ids: list[int], *, half_angles: bool) -> Iterator[str]:
    vertices = np.concatenate([values.position, values.quaternion[:, TO_XYZW]], axis=1)
    for pose, numbers in zip(ids, vertices.tolist(), strict=True):
        yield _line(f"{POSE} {pose}", numbers)
    edge = graph["edge"]
    information = _inverse(TextLines(Path()), edge.covariance[:, TO_FILE][:, :, TO_FILE], [0] * len(edge))
    if half_angles:
        information = information * _angle_scale(2.0)
    quaternion = edge.column("quaternion")[:, TO_XYZW]
    table = np.concatenate([edge.column("position"), quaternion, triangle(information)], axis=1)
    for (a, b), numbers in zip(edge.variables.tolist(), table.tolist(), strict=True):
        yield _line(f"{EDGE} {ids[a]} {ids[b]}", numbers)


def _line(head: str, values: list[float]) -> str:
    return f"{head} {' '.join(f'{v:.17g}' for v in values)}\n"


def _graph(
    lines: TextLines,
    vertices: dict[int, list[float]],
    edges: list[tuple[int, list[int], list[float]]],
    *,
    half_angles: bool,
) -> tuple[FactorGraph, GraphValues]:
    row = {pose: i for i, pose in enumerate(vertices)}
    for number, ends, _ in edges:
        for end in ends:
            if end not in row:
                lines.refuse(f"id {end}", "ids of the file's vertices", number)
    letters, numbers = zip(*map(_name, vertices), strict=True)
    agents = list(dict.fromkeys(letters))
    vertex = np.array(list(vertices.values())).reshape(-1, 7)
    edge = np.array([values for *_, values in edges]).reshape(-1, 28)
    information = from_triangle(edge[:, 7:], 6)
    if half_angles:
        information *= _angle_scale(0.5)
    covariance = _inverse(lines, information, [number for number, *_ in edges])
    table = KINDS["edge"].table(
        [[row[end] for end in ends] for _, ends, _ in edges],
        [edge[:, :3], edge[:, 3:7][:, TO_WXYZ]],
        covariance[:, TO_FILE][:, :, TO_FILE],
    )
    graph = FactorGraph(
        agent_name=np.array(agents),
        landmark_name=np.array([], dtype=str),
        pose_agent=np.array([agents.index(letter) for letter in letters]),
        pose_number=np.array(numbers),
        pose_time=np.array(numbers, dtype=float),
    )
    values = GraphValues(vertex[:, :3], vertex[:, 3:][:, TO_WXYZ], np.empty((0, 3)))
    return graph.with_factors(edge=table), values


def _take(
    lines: TextLines, word: str, fields: list[str], n_ids: int, n_values: int
) -> tuple[list[int], list[float]]:
    if len(fields) != n_ids + n_values:
        lines.refuse(f"{word} with {1 + len(fields)} fields", f"{1 + n_ids + n_values}")
    for field in fields[:n_ids]:
        if not _INTEGER.fullmatch(field) or (int(field) > _LARGEST_ID and not _is_symbol(int(field))):
            lines.refuse(f"id {field[:40]!r}", f"integers up to {_LARGEST_ID}, or GTSAM symbols")
    ids = [int(field) for field in fields[:n_ids]]
    if n_ids == 2 and ids[0] == ids[1]:
        lines.refuse(f"{word} from {ids[0]} to itself", "two different poses")
    return ids, lines.numbers(word, fields[n_ids:], quaternion=True)


def _inverse(lines: TextLines, matrices: Array, numbers: list[int]) -> Array:
    """Inverses of positive definite matrices (n, 6, 6) of some lines, by way of their unit-diagonal forms."""
    diagonal = np.diagonal(matrices, axis1=1, axis2=2)
    fine = (diagonal > 0.0).all(axis=1)
    if not fine.all():
        row = int(np.argmin(fine))
        lines.refuse(f"{EDGE} with information {diagonal[row].min():g}", "a positive diagonal", numbers[row])
    scale = 1.0 / np.sqrt(diagonal)
    scales = scale[:, :, None] * scale[:, None, :]
    correlation = matrices * scales
    fine = np.linalg.eigvalsh(correlation)[:, 0] >= SMALLEST_EIGENVALUE
    if not fine.all():
        lines.refuse(
            f"{EDGE} with singular information", "a positive definite matrix", numbers[int(np.argmin(fine))]
        )
    inverse = np.linalg.inv(correlation) * scales
    return np.asarray(0.5 * (inverse + np.swapaxes(inverse, 1, 2)))


def _angle_scale(factor: float) -> Array:
    """Factors of the entries of a matrix (6, 6) when its last three axes are stretched by a factor."""
    axis = np.array([1.0] * 3 + [factor] * 3)
    return np.outer(axis, axis)


def _symbols(graph: FactorGraph, path: Path) -> list[int]:
    agents = graph.agent_name.tolist()
    if not all(len(a) == 1 and a.isascii() and a.isalpha() for a in agents) or graph.pose_number.min() < 0:
        raise EstimationError(
            f"{path}: symbols need vehicles named by one letter; found {', '.join(agents[:5])}"
        )
    poses = zip(graph.pose_agent.tolist(), graph.pose_number.tolist(), strict=True)
    return [ord(agents[a]) << _SYMBOL_SHIFT | k for a, k in poses]


def _is_symbol(number: int) -> bool:
    letter = chr(number >> _SYMBOL_SHIFT) if number >> _SYMBOL_SHIFT < 128 else ""
    return letter.isalpha() and number & (2**_SYMBOL_SHIFT - 1) <= _LARGEST_ID


def _name(number: int) -> tuple[str, int]:
    if number <= _LARGEST_ID:
        return "A", number
    return chr(number >> _SYMBOL_SHIFT), number & (2**_SYMBOL_SHIFT - 1)
