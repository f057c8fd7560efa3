"""
Pose graphs as g2o text, in three dimensions or two: poses, landmarks, edges between poses and sightings of landmarks.

Lines in two dimensions are lifted and flattened as those of PyFactorGraph text are.
"""

import re
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import EstimationError
from pymantaray.estimation.graph import (
    EDGE,
    KINDS,
    SMALLEST_EIGENVALUE,
    FactorGraph,
    Factors,
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
    flat_matrix,
    flattened,
    from_triangle,
    lifted,
    lifted_matrix,
    triangle,
)
from pymantaray.estimation.starts import chordal
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import whole_file

Array = NDArray[np.float64]

LANDMARK, SIGHTING, OFFSET = "VERTEX_TRACKXYZ", "EDGE_SE3_TRACKXYZ", "PARAMS_SE3OFFSET"


class _Word(NamedTuple):
    """Fields behind a word: ids, the id of a parameter or none, what is measured, and the upper triangle of a matrix."""

    ids: int
    parameter: bool
    measured: int
    matrix: int = 0
    flat: bool = False

    @property
    def numbers(self) -> int:
        return self.measured + self.matrix * (self.matrix + 1) // 2


_GRAMMAR = {
    POSE: _Word(1, False, 7),
    LANDMARK: _Word(1, False, 3),
    EDGE: _Word(2, False, 7, 6),
    SIGHTING: _Word(2, True, 3, 3),
    OFFSET: _Word(1, False, 7),
    "VERTEX_SE2": _Word(1, False, 3, flat=True),
    "VERTEX_XY": _Word(1, False, 2, flat=True),
    "EDGE_SE2": _Word(2, False, 3, 3, flat=True),
    "EDGE_SE2_XY": _Word(2, False, 2, 2, flat=True),
}
_FLAT = {POSE: "VERTEX_SE2", LANDMARK: "VERTEX_XY", EDGE: "EDGE_SE2", SIGHTING: "EDGE_SE2_XY"}

_KIND_OF = {kind.plural: name for name, kind in KINDS.items() if name not in {"edge", "sighting"}}
LEFT_OUT = ("landmarks", *_KIND_OF)
"""What a file cannot hold; landmarks are those without a sighting."""

_SYMBOL_SHIFT = 56  # GTSAM's symbols: a letter in the uppermost byte, a number below
_LARGEST_ID = 2**31 - 1  # g2o's ids are C ints
_INTEGER = re.compile("[0-9]{1,20}")
_SYMBOL = re.compile("([A-Za-z])(0|[1-9][0-9]{0,8})")  # of a landmark
_NO_OFFSET = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


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
    sighted = np.unique(graph["sighting"].variables[:, 1])
    sizes = {"landmarks": graph.landmark_name.size - sighted.size}
    sizes |= {what: len(graph[kind]) for what, kind in _KIND_OF.items()}
    lost = {what: int(n) for what, n in sizes.items() if n}
    refused = [f"{n} {what}" for what, n in lost.items() if what not in leave_out]
    if refused:
        raise EstimationError(
            f"{path}: g2o files hold poses, edges between them and sightings; the graph has {', '.join(refused)} besides:"
            " agree to leave them out (--leave-out all)"
        )
    ids = _symbols(graph, path) if symbols else list(range(graph.n_variables))
    with whole_file(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(_lines(graph, initial, ids, sighted, half_angles=half_angles))
    return lost


def load_g2o(
    path: Path | str,
    *,
    leave_out: Collection[str] = (),
    skip_unknown: bool = False,
    half_angles: bool = False,
) -> GraphFile:
    """
    Read a pose graph from g2o text in three dimensions or two.

    Lines of the words in ``leave_out`` are skipped and counted, with ``skip_unknown`` those of unknown words, too; others
    are refused. Ids that are GTSAM symbols become vehicle and number; others belong to a vehicle A. A pose's
    number stands for its time. [s] Where sensors that sight landmarks have offsets, these are taken into what is sighted. A
    file without vertices has the poses and landmarks of its edges, at values by chordal initialization.
    """
    path = Path(path)
    lines = TextLines(path, _GRAMMAR, leave_out, skip_unknown=skip_unknown)
    rows: dict[str, list[_Row]] = {word: [] for word in _GRAMMAR}
    planar: bool | None = None  # not known yet
    for line in lines:
        word, *fields = line.split()
        flat = _GRAMMAR[word].flat
        planar = flat if planar is None and word != OFFSET else planar
        if flat != bool(planar):
            lines.refuse(
                f"{word} in a graph in {'two' if planar else 'three'} dimensions", "one kind of graph"
            )
        rows[word].append(_take(lines, word, fields))
    graph, values, valueless = _Reader(lines, rows, planar=bool(planar), half_angles=half_angles).graph()
    try:
        check_graph(graph)
    except EstimationError as error:
        raise EstimationError(f"{path}: {error}") from None
    return GraphFile(graph, chordal(graph, values).values if valueless else values, lines.left_out, valueless)


def _lines(
    graph: FactorGraph, values: GraphValues, ids: list[int], sighted: NDArray[Any], *, half_angles: bool
) -> Iterator[str]:
    n, planar = graph.n_poses, graph.planar
    places = np.concatenate([values.position, values.quaternion[:, TO_XYZW]], axis=1)
    if sighted.size and not planar:
        yield f"{OFFSET} 0 0 0 0 0 0 0 1\n"
    yield from _rows(POSE, [f"{k}" for k in ids[:n]], places, planar=planar)
    yield from _rows(
        LANDMARK, [f"{ids[k]}" for k in sighted], values.landmark_position[sighted - n], planar=planar
    )
    edge, sighting = graph["edge"], graph["sighting"]
    matrix = edge.covariance[:, TO_FILE][:, :, TO_FILE]
    step = np.concatenate([edge.column("position"), edge.column("quaternion")[:, TO_XYZW]], axis=1)
    yield from _rows(EDGE, _heads(edge, ids), step, matrix, planar=planar, half_angles=half_angles)
    heads = _heads(sighting, ids) if planar else [f"{head} 0" for head in _heads(sighting, ids)]
    yield from _rows(SIGHTING, heads, sighting.column("position"), sighting.covariance, planar=planar)


def _heads(factors: Factors, ids: list[int]) -> list[str]:
    return [f"{ids[a]} {ids[b]}" for a, b in factors.variables.tolist()]


def _rows(
    word: str,
    heads: list[str],
    measured: Array,
    covariance: Array | None = None,
    *,
    planar: bool,
    half_angles: bool = False,
) -> Iterator[str]:
    """Lines of a word, with the information, in two dimensions those of its flat one."""
    if planar:
        word, measured = _FLAT[word], flattened(measured)
        covariance = covariance if covariance is None else flat_matrix(covariance)
    if covariance is not None:
        information = _inverse(TextLines(Path()), word, covariance, [0] * len(covariance))
        if half_angles and not planar:
            information = information * _angle_scale(2.0)
        measured = np.concatenate([measured, triangle(information)], axis=1)
    for head, row in zip(heads, measured.tolist(), strict=True):
        yield f"{word} {head} {' '.join(f'{v:.17g}' for v in row)}\n"


class _Row(NamedTuple):
    """Number of a line, its ids, and its numbers."""

    line: int
    ids: list[int]
    values: list[float]


class _Reader:
    """Makes a graph of the lines of a file."""

    def __init__(
        self, lines: TextLines, rows: dict[str, list[_Row]], *, planar: bool, half_angles: bool
    ) -> None:
        self._lines, self._planar, self._half_angles = lines, planar, half_angles
        self._words = {word: _FLAT.get(word, word) if planar else word for word in (*_FLAT, OFFSET)}
        self._of = {word: rows[own] for word, own in self._words.items()}

    def graph(self) -> tuple[FactorGraph, GraphValues, bool]:
        """Graph, values of its variables, and whether these are no more than places to begin at."""
        poses, landmarks, valueless = self._vertices()
        names = [_name(k) for k in poses]
        agents = list(dict.fromkeys(letter for letter, _ in names))
        numbers = [number for _, number in names]
        graph = FactorGraph(
            agent_name=np.array(agents),
            landmark_name=np.array([_landmark_name(k) for k in landmarks], dtype=str),
            pose_agent=np.array([agents.index(letter) for letter, _ in names]),
            pose_number=np.array(numbers),
            pose_time=np.array(numbers, dtype=float),
            planar=self._planar,
        )
        self._pose = {k: i for i, k in enumerate(poses)}
        self._landmark = {k: i for i, k in enumerate(landmarks, start=len(poses))}
        if valueless:
            level = np.tile([1.0, 0.0, 0.0, 0.0], (len(poses), 1))
            values = GraphValues(np.zeros((len(poses), 3)), level, np.zeros((len(landmarks), 3)))
        else:
            pose, landmark = self._measured(POSE), self._measured(LANDMARK)
            values = GraphValues(pose[:, :3], pose[:, 3:][:, TO_WXYZ], landmark)
        return graph.with_factors(edge=self._edges(), sighting=self._sightings()), values, valueless

    def _vertices(self) -> tuple[list[int], list[int], bool]:
        """Ids of poses and landmarks, those of the edges where there are no vertices, and whether that is so."""
        poses, landmarks = (self._ids(word) for word in (POSE, LANDMARK))
        valueless = not (poses or landmarks)
        if valueless:
            edges, sightings = self._of[EDGE], self._of[SIGHTING]
            poses = sorted({k for row in edges for k in row.ids} | {row.ids[0] for row in sightings})
            landmarks = sorted({row.ids[1] for row in sightings})
        if not poses:
            words = f"{POSE}, {EDGE}, {_FLAT[POSE]} or {_FLAT[EDGE]}"
            self._lines.refuse(f"no {words} in the file", "one pose at least", 0)
        return poses, landmarks, valueless

    def _ids(self, word: str) -> list[int]:
        """Ids of vertices; a landmark may have that of a pose, as in files where they are counted apart."""
        ids: dict[int, None] = {}
        for row in self._of[word]:
            if row.ids[0] in ids:
                self._lines.refuse(f"second {self._words[word]} {row.ids[0]}", "one for each id", row.line)
            ids[row.ids[0]] = None
        return list(ids)

    def _edges(self) -> Factors:
        rows, measured = self._of[EDGE], self._measured(EDGE)
        covariance = self._covariance(EDGE)
        return KINDS["edge"].table(
            self._ends(rows, self._pose),
            [measured[:, :3], measured[:, 3:][:, TO_WXYZ]],
            covariance[:, TO_FILE][:, :, TO_FILE],
        )

    def _sightings(self) -> Factors:
        """Sightings in the body frames, whatever the offsets of the sensors."""
        rows, place = self._of[SIGHTING], self._measured(SIGHTING)
        covariance = self._covariance(SIGHTING)
        if not self._planar:
            offsets = {row.ids[0]: np.array(row.values) for row in self._of[OFFSET]}
            for i, row in enumerate(rows):
                if row.ids[2] not in offsets:
                    self._lines.refuse(f"parameter {row.ids[2]}", f"ids of the file's {OFFSET}", row.line)
                offset = offsets[row.ids[2]]
                if np.any(offset != _NO_OFFSET):
                    turn = matrix_from_quaternion(offset[3:][TO_WXYZ])
                    place[i], covariance[i] = offset[:3] + turn @ place[i], turn @ covariance[i] @ turn.T
                    covariance[i] = 0.5 * (covariance[i] + covariance[i].T)
        return KINDS["sighting"].table(self._ends(rows, self._landmark), [place], covariance)

    def _ends(self, rows: list[_Row], of_second: dict[int, int]) -> list[list[int]]:
        """Variables of both ends, the first a pose."""
        out = []
        for row in rows:
            ends = list(zip(row.ids[:2], (self._pose, of_second), strict=True))
            for end, known in ends:
                if end not in known:
                    what = "poses" if known is self._pose else "landmarks"
                    self._lines.refuse(f"id {end}", f"ids of the file's {what}", row.line)
            out.append([known[end] for end, known in ends])
        return out

    def _measured(self, word: str) -> Array:
        """What is measured in the lines of a word, lifted."""
        grammar = _GRAMMAR[self._words[word]]
        values = [row.values[: grammar.measured] for row in self._of[word]]
        table = np.array(values, dtype=float).reshape(-1, grammar.measured)
        return lifted(table) if self._planar else table

    def _covariance(self, word: str) -> Array:
        """Covariances of the lines of a word, lifted."""
        own, rows = self._words[word], self._of[word]
        grammar = _GRAMMAR[own]
        values = np.array([row.values[grammar.measured :] for row in rows], dtype=float)
        width = grammar.numbers - grammar.measured
        information = from_triangle(values.reshape(-1, width), grammar.matrix)
        if self._half_angles and grammar.matrix == 6:
            information *= _angle_scale(0.5)
        covariance = _inverse(self._lines, own, information, [row.line for row in rows])
        return lifted_matrix(covariance) if self._planar else covariance


def _take(lines: TextLines, word: str, fields: list[str]) -> _Row:
    grammar = _GRAMMAR[word]
    n_ids = grammar.ids + grammar.parameter
    if len(fields) != n_ids + grammar.numbers:
        lines.refuse(f"{word} with {1 + len(fields)} fields", f"{1 + n_ids + grammar.numbers}")
    for field in fields[:n_ids]:
        if not _INTEGER.fullmatch(field) or (int(field) > _LARGEST_ID and not _is_symbol(int(field))):
            lines.refuse(f"id {field[:40]!r}", f"integers up to {_LARGEST_ID}, or GTSAM symbols")
    ids = [int(field) for field in fields[:n_ids]]
    if word in {EDGE, _FLAT[EDGE]} and ids[0] == ids[1]:
        lines.refuse(f"{word} from {ids[0]} to itself", "two different poses")
    return _Row(lines.number, ids, lines.numbers(word, fields[n_ids:], quaternion=grammar.measured == 7))


def _inverse(lines: TextLines, word: str, matrices: Array, numbers: list[int]) -> Array:
    """Inverses of positive definite matrices (n, k, k) of some lines of a word, by way of their unit-diagonal forms."""
    diagonal = np.diagonal(matrices, axis1=1, axis2=2)
    fine = (diagonal > 0.0).all(axis=1)
    if not fine.all():
        row = int(np.argmin(fine))
        lines.refuse(f"{word} with information {diagonal[row].min():g}", "a positive diagonal", numbers[row])
    scale = 1.0 / np.sqrt(diagonal)
    scales = scale[:, :, None] * scale[:, None, :]
    correlation = matrices * scales
    fine = np.linalg.eigvalsh(correlation)[:, 0] >= SMALLEST_EIGENVALUE
    if not fine.all():
        lines.refuse(
            f"{word} with singular information", "a positive definite matrix", numbers[int(np.argmin(fine))]
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
    names = [_SYMBOL.fullmatch(name) for name in graph.landmark_name.tolist()]
    landmarks = [("L", i) if name is None else (name[1], int(name[2])) for i, name in enumerate(names)]
    ids = [
        ord(letter) << _SYMBOL_SHIFT | k for letter, k in [*((agents[a], k) for a, k in poses), *landmarks]
    ]
    if len(set(ids)) != len(ids):
        raise EstimationError(
            f"{path}: symbols of two variables are the same; rename a landmark or vehicle L"
        )
    return ids


def _is_symbol(number: int) -> bool:
    letter = chr(number >> _SYMBOL_SHIFT) if number >> _SYMBOL_SHIFT < 128 else ""
    return letter.isalpha() and number & (2**_SYMBOL_SHIFT - 1) <= _LARGEST_ID


def _name(number: int) -> tuple[str, int]:
    if number <= _LARGEST_ID:
        return "A", number
    return chr(number >> _SYMBOL_SHIFT), number & (2**_SYMBOL_SHIFT - 1)


def _landmark_name(number: int) -> str:
    letter, k = ("L", number) if number <= _LARGEST_ID else _name(number)
    return f"{letter}{k}"
