"""
Pose graphs as g2o or TORO text, in three dimensions or two: poses, landmarks, edges between poses
and sightings of landmarks.

Lines in two dimensions are lifted and flattened as in PyFactorGraph text.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pymantaray.arrays import Array, Mask
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.columns import (
    TO_WXYZ,
    columns,
    from_triangle,
    to_graph,
    triangle,
    write_rows,
)
from pymantaray.estimation.graph.graph import (
    EDGE,
    KINDS,
    SMALLEST_EIGENVALUE,
    VARIANCES,
    FactorGraph,
    FactorKind,
    Factors,
    GraphValues,
    check_graph,
    check_values,
)
from pymantaray.estimation.graph.pyfg import POSE, GraphFile
from pymantaray.estimation.graph.text import Indefinite, Table, TextLines, Word, read_tables
from pymantaray.estimation.solvers.starts import ANCHOR_SIGMA, chordal
from pymantaray.geometry.se3 import hat, matrix_from_quaternion, quaternion_from_matrix
from pymantaray.records import whole_file

LANDMARK = "VERTEX_TRACKXYZ"
SIGHTING = "EDGE_SE3_TRACKXYZ"
OFFSET = "PARAMS_SE3OFFSET"
PRIOR = "EDGE_SE3_PRIOR"
FIX = "FIX"


_GRAMMAR = {  # names are ids, the last of a sighting that of a parameter
    POSE: columns("pose"),
    LANDMARK: columns("landmark"),
    EDGE: columns("edge"),
    SIGHTING: columns("sighting", more_names=1),
    OFFSET: Word(False, 1, 7, planar=None),
    "VERTEX_SE2": columns("pose").flat,
    "VERTEX_XY": columns("landmark").flat,
    "EDGE_SE2": columns("edge").flat,
    "EDGE_SE2_XY": columns("sighting").flat,
    "VERTEX2": columns("pose").flat,
    "EDGE2": columns("edge").flat,
    "VERTEX3": Word(False, 1, 6),
    "EDGE3": Word(False, 2, 6, 6),
    PRIOR: columns("prior", more_names=1),
    "EDGE_PRIOR_SE2": columns("prior").flat,
    FIX: Word(False, 1, 0, planar=None),
    "ODOMETRY": columns("edge").flat,
    "LANDMARK": columns("sighting").flat,
}
TORO = {POSE: ("VERTEX3", "VERTEX2"), EDGE: ("EDGE3", "EDGE2")}
"""Words of TORO, which g2o succeeded, in three dimensions and in two."""
ISAM = {EDGE: "ODOMETRY", SIGHTING: "LANDMARK"}
"""
Words of iSAM, in two dimensions; their matrix is the upper triangular root of the information, by
rows.
"""
# entries of a matrix over x y angle, by rows, in TORO's order 11 12 22 33 13 23
_TORO_TRIANGLE = [0, 1, 4, 2, 5, 3]
_FLAT = {
    POSE: "VERTEX_SE2",
    LANDMARK: "VERTEX_XY",
    EDGE: "EDGE_SE2",
    SIGHTING: "EDGE_SE2_XY",
    PRIOR: "EDGE_PRIOR_SE2",
}


def _holds(kind: FactorKind) -> bool:
    """True if a file can hold factors of a kind: lines of its words that measure all their axes."""
    return kind.word in (KINDS["edge"].word, KINDS["sighting"].word) and not kind.axes


LEFT_OUT = ("landmarks", *(kind.plural for kind in KINDS.values() if not _holds(kind)))
"""Contents that a file cannot hold; landmarks are those without a sighting."""

_TREATMENTS = "; or drop or repair these lines with `indefinite`"
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
    Write the poses and edges of a factor graph as g2o text, atomically; return the number of
    omitted factors by kind.

    ``leave_out`` must name the kinds of `LEFT_OUT` that the graph has, because the format [1]_
    cannot hold them. Vertices are numbered by the row of the pose, or with ``symbols`` as GTSAM's
    symbols, which keep vehicle and number (vehicles of one letter only) and are too large for g2o
    itself. With ``half_angles`` the rotation part of the information is that of x, y, z of the
    quaternion, half the angle, as g2o has it [2]_; else that of the rotation vector, as GTSAM reads
    the same numbers (checked with 4.3). GTSAM's own writer rounds to six digits; its reader reads
    ``nan`` as 0 and missing numbers as arbitrary values, and skips other lines without a message.

    References
    ----------
    .. [1] g2o wiki, "File Format" and "File format slam 3d",
       https://github.com/RainerKuemmerle/g2o/wiki
    .. [2] g2o issue 699, https://github.com/RainerKuemmerle/g2o/issues/699
    """
    path = Path(path)
    others = {
        table.kind.plural: len(table) for table in graph.tables.values() if not _holds(table.kind)
    }
    if not set(leave_out) <= {"landmarks", *others}:
        raise EstimationError(
            f"{path}: leave out {sorted(leave_out)}; allowed: landmarks, {', '.join(others)}"
        )
    check_graph(graph)
    check_values(graph, initial)
    sighted = np.unique(graph["sighting"].variables[:, 1])
    sizes = {"landmarks": graph.landmark_name.size - sighted.size}
    sizes |= others
    lost = {what: int(n) for what, n in sizes.items() if n}
    refused = [f"{n} {what}" for what, n in lost.items() if what not in leave_out]
    if refused:
        raise EstimationError(
            f"{path}: g2o files hold poses, edges between them and sightings; the graph also has"
            f" {', '.join(refused)}: leave them out with `leave_out`"
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
    isam: bool = False,
    indefinite: Indefinite = "refuse",
) -> GraphFile:
    """
    Read a pose graph from g2o, TORO or iSAM text in three dimensions or two.

    Lines of the words in ``leave_out`` are skipped and counted, with ``skip_unknown`` those of
    unknown words, too; others are refused. Ids that are GTSAM symbols become vehicle and number;
    others belong to a vehicle A. A pose's number is used as its time [s]. Sensor offsets are
    applied to sightings and priors. Vertices of ``FIX`` get a prior of 1 mm and 1 mrad at their
    values. With ``isam``, or in a file with words of iSAM, lines of ``EDGE2`` have the matrix of
    iSAM. A file without vertices has the poses and landmarks of its edges, with values by chordal
    initialization.
    """
    path = Path(path)
    lines = TextLines(path, _GRAMMAR, leave_out, skip_unknown=skip_unknown, indefinite=indefinite)
    tables, planar = read_tables(lines, _GRAMMAR, one_space=False)
    graph, values, valueless = _Reader(
        lines, tables, planar=planar, half_angles=half_angles, isam=isam
    ).graph()
    try:
        check_graph(graph)
    except EstimationError as error:
        raise EstimationError(f"{path}: {error}") from None
    values = chordal(graph, values).values if valueless else values
    return GraphFile(graph, values, dict(lines.left_out), valueless, dict(lines.repaired))


def _lines(
    graph: FactorGraph,
    values: GraphValues,
    ids: list[int],
    sighted: NDArray[Any],
    *,
    half_angles: bool,
) -> Iterator[str]:
    n = graph.n_poses
    planar = graph.planar
    places = np.concatenate([values.position, values.quaternion], axis=1)
    if sighted.size and not planar:
        yield f"{OFFSET} 0 0 0 0 0 0 0 1\n"
    yield from write_rows(_words(POSE), [f"{k}" for k in ids[:n]], places, planar=planar)
    landmarks = values.landmark_position[sighted - n]
    yield from write_rows(
        _words(LANDMARK), [f"{ids[k]}" for k in sighted], landmarks, planar=planar
    )
    edge = graph["edge"]
    sighting = graph["sighting"]
    heads = _heads(edge, ids)
    information = _information(edge, half_angles=half_angles, planar=planar)
    yield from write_rows(_words(EDGE), heads, edge.measurement, information, planar=planar)
    heads = _heads(sighting, ids) if planar else [f"{head} 0" for head in _heads(sighting, ids)]
    information = _information(sighting, half_angles=False, planar=planar)
    yield from write_rows(_words(SIGHTING), heads, sighting.measurement, information, planar=planar)


def _heads(factors: Factors, ids: list[int]) -> list[str]:
    return [f"{ids[a]} {ids[b]}" for a, b in factors.variables.tolist()]


def _words(word: str) -> tuple[str, str | None]:
    """Words in three dimensions and in two."""
    return word, _FLAT[word]


def _information(factors: Factors, *, half_angles: bool, planar: bool) -> Array:
    """Information matrices of factors, rotation before translation, of half angles on request."""
    information = _inverse(TextLines(Path()), "", factors.covariance, [0] * len(factors))
    return information * _angle_scale(2.0) if half_angles and not planar else information


class _Reader:
    """Converts the tables of a file to a graph."""

    def __init__(
        self,
        lines: TextLines,
        tables: dict[str, Table],
        *,
        planar: bool,
        half_angles: bool,
        isam: bool,
    ) -> None:
        self._lines = lines
        self._planar = planar
        self._half_angles = half_angles
        self._isam = isam or any(tables[word].line for word in ISAM.values())
        words = (*_FLAT, OFFSET, FIX)
        self._of = {word: self._table_of(word, tables) for word in words}
        self._grammar = {
            word: _GRAMMAR[_FLAT.get(word, word) if planar else word] for word in words
        }
        self._keep: dict[str, Mask] = {}  # lines whose matrix can be used, by word
        self._known: dict[str, int] = {}  # ids by their spellings
        self._id = {word: self._checked_ids(word, table) for word, table in self._of.items()}
        self._values = {
            word: _in_g2o(
                table, table.numbers(lines, quaternion=table.grammar.values == 7), isam=self._isam
            )
            for word, table in self._of.items()
            if word != FIX
        }

    def graph(self) -> tuple[FactorGraph, GraphValues, bool]:
        """Convert all lines: graph, values, and whether the file has no values."""
        poses, landmarks, valueless = self._vertices()
        names = [_name(k) for k in poses]
        vehicles = list(dict.fromkeys(letter for letter, _ in names))
        numbers = [number for _, number in names]
        graph = FactorGraph(
            vehicle_name=np.array(vehicles),
            landmark_name=np.array([_landmark_name(k) for k in landmarks], dtype=str),
            pose_vehicle=np.array([vehicles.index(letter) for letter, _ in names]),
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
            pose = self._columns(POSE)[0]
            landmark = self._columns(LANDMARK)[0]
            values = GraphValues(pose[:, :3], pose[:, 3:], landmark)
        factors = {"edge": self._edges(), "sighting": self._sightings(), **self._priors(values)}
        return graph.with_factors(**factors), values, valueless

    def _vertices(self) -> tuple[list[int], list[int], bool]:
        """
        Ids of poses and landmarks, taken from edges if there are no vertices; and whether that is
        so.
        """
        poses, landmarks = (self._ids(word) for word in (POSE, LANDMARK))
        valueless = not (poses or landmarks)
        if valueless:
            edges = self._id[EDGE]
            sightings = self._id[SIGHTING]
            poses = sorted({*edges[0], *edges[1], *sightings[0]})
            landmarks = sorted(set(sightings[1]))
        if not poses:
            words = f"{POSE}, {EDGE}, {_FLAT[POSE]} or {_FLAT[EDGE]}"
            self._lines.refuse(f"no {words} in the file", "at least one pose", 0)
        return poses, landmarks, valueless

    def _ids(self, word: str) -> list[int]:
        """
        Ids of vertices; a landmark may have the id of a pose, as in files that number them
        separately.
        """
        table, (ids,) = self._of[word], self._id[word]
        if len(set(ids)) != len(ids):
            before: set[int] = set()
            row = next(i for i, k in enumerate(ids) if k in before or before.add(k))  # type: ignore[func-returns-value]
            self._lines.refuse(f"second {table.word} {ids[row]}", "one of each id", table.line[row])
        return ids

    def _edges(self) -> Factors:
        measurement, covariance = self._columns(EDGE)
        parts = [measurement[:, :3], measurement[:, 3:]]
        return KINDS["edge"].table(self._ends(EDGE, self._pose), parts, covariance)[
            self._keep[EDGE]
        ]

    def _sightings(self) -> Factors:
        """Sightings in the body frames, with sensor offsets applied."""
        position, covariance = self._columns(SIGHTING)
        position = position.copy()
        covariance = covariance.copy()
        if not self._planar:
            for i, offset in enumerate(self._offsets(SIGHTING, 2)):
                if np.any(offset != _NO_OFFSET):
                    rotation = matrix_from_quaternion(offset[3:][TO_WXYZ])
                    position[i] = offset[:3] + rotation @ position[i]
                    covariance[i] = rotation @ covariance[i] @ rotation.T
                    covariance[i] = 0.5 * (covariance[i] + covariance[i].T)
        sightings = KINDS["sighting"].table(
            self._ends(SIGHTING, self._landmark), [position], covariance
        )
        return sightings[self._keep[SIGHTING]]

    def _priors(self, values: GraphValues) -> dict[str, Factors]:
        """Priors of poses, with sensor offsets applied, and of fixed vertices at their values."""
        table, (measurement, covariance) = self._of[PRIOR], self._columns(PRIOR)
        measurement = measurement.copy()
        covariance = covariance.copy()
        if not self._planar:
            for i, offset in enumerate(self._offsets(PRIOR, 1)):
                if np.any(offset != _NO_OFFSET):  # the pose times the offset is measured
                    rotation = matrix_from_quaternion(offset[3:][TO_WXYZ])
                    body_rotation = matrix_from_quaternion(measurement[i, 3:]) @ rotation.T
                    measurement[i, :3] -= body_rotation @ offset[:3]
                    measurement[i, 3:] = quaternion_from_matrix(body_rotation[None])[0]
                    adjoint = np.zeros((6, 6))
                    adjoint[:3, :3] = adjoint[3:, 3:] = rotation
                    adjoint[3:, :3] = hat(offset[None, :3])[0] @ rotation
                    covariance[i] = adjoint @ covariance[i] @ adjoint.T
                    covariance[i] = 0.5 * (covariance[i] + covariance[i].T)
        poses = self._known_variables(table, self._id[PRIOR][0], self._pose)
        parts = [measurement[:, :3], measurement[:, 3:]]
        prior = KINDS["prior"].table(poses[:, None], parts, covariance)[self._keep[PRIOR]]
        ids = np.array(self._id[FIX][0], dtype=object)
        n = len(self._pose)
        known = {**self._landmark, **self._pose}  # a landmark may have the id of a pose
        fixed = np.unique(self._known_variables(self._of[FIX], ids.tolist(), known))
        poses = fixed[fixed < n]
        landmarks = fixed[fixed >= n]
        unit = np.tile(ANCHOR_SIGMA**2 * np.eye(6), (poses.size, 1, 1))
        at = [values.position[poses], values.quaternion[poses]]
        return {
            "prior": prior.append(KINDS["prior"].table(poses[:, None], at, unit)),
            "survey": KINDS["survey"].table(
                landmarks[:, None],
                [values.landmark_position[landmarks - n]],
                np.tile(ANCHOR_SIGMA**2 * np.eye(3), (landmarks.size, 1, 1)),
            ),
        }

    def _known_variables(
        self, table: Table, ids: list[int], known: dict[int, int]
    ) -> NDArray[np.int32]:
        """Variables with some ids; an unknown one is refused."""
        for row, k in enumerate(ids):
            if k not in known:
                self._lines.refuse(f"id {k}", "ids of the file's vertices", table.line[row])
        return np.array([known[k] for k in ids], dtype=np.int32)

    def _offsets(self, word: str, end: int) -> list[Array]:
        """Sensor offset of each line of a word."""
        offsets = dict(zip(self._id[OFFSET][0], self._values[OFFSET], strict=True))
        for i, parameter in enumerate(self._id[word][end]):
            if parameter not in offsets:
                line = self._of[word].line[i]
                self._lines.refuse(f"parameter {parameter}", f"ids of the file's {OFFSET}", line)
        return [offsets[parameter] for parameter in self._id[word][end]]

    def _table_of(self, word: str, tables: dict[str, Table]) -> Table:
        """Lines of a word in this graph's dimensions, by g2o's name, TORO's or iSAM's."""
        own = tables[_FLAT.get(word, word) if self._planar else word]
        if self._planar and word in ISAM and (isam := tables[ISAM[word]]).line:
            if own.line:
                what = f"{own.word} and {isam.word} in one file"
                self._lines.refuse(what, "words of g2o, or of iSAM", max(own.line[0], isam.line[0]))
            return isam.with_lines(tables["EDGE2"]) if word == EDGE else isam
        if word not in TORO or not (toro := tables[TORO[word][self._planar]]).line:
            return own
        if own.line:
            what = f"{own.word} and {toro.word} in one file"
            self._lines.refuse(what, "words of g2o, or of TORO", max(own.line[0], toro.line[0]))
        return toro

    def _ends(self, word: str, of_second: dict[int, int]) -> NDArray[np.int32]:
        """Variables of both ends, the first a pose."""
        table = self._of[word]
        columns = []
        for ids, known in zip(self._id[word][:2], (self._pose, of_second), strict=True):
            try:
                columns.append([known[k] for k in ids])
            except KeyError:
                row = next(i for i, k in enumerate(ids) if k not in known)
                what = "poses" if known is self._pose else "landmarks"
                self._lines.refuse(f"id {ids[row]}", f"ids of the file's {what}", table.line[row])
        return np.array(columns, dtype=np.int32).T

    def _columns(self, word: str) -> tuple[Array, Array]:
        """Measured columns and covariances of the lines of a word."""
        table = self._of[word]
        grammar = self._grammar[word]
        if not grammar.matrix:
            return to_graph(self._values[word], grammar, planar=self._planar)
        # in the dimensions of the file: what is lifted is out of the plane
        values = self._values[word].copy()
        size = grammar.matrix
        information = from_triangle(values[:, grammar.values :], size)
        if self._half_angles and size == 6:
            information *= _angle_scale(0.5)[::-1, ::-1]
        information, self._keep[word] = self._lines.treat(table.word, information)
        values[:, grammar.values :] = triangle(
            _inverse(self._lines, table.word, information, table.line)
        )
        return to_graph(values, grammar, planar=self._planar)

    def _checked_ids(self, word: str, table: Table) -> list[list[int]]:
        """Ids of the lines of a word, for each end."""
        ends = []
        for end in range(table.grammar.names):
            fields = table.names(end)
            for field in dict.fromkeys(fields):
                if field not in self._known:
                    fine = _INTEGER.fullmatch(field) and (
                        int(field) <= _LARGEST_ID or _is_symbol(int(field))
                    )
                    if not fine:
                        allowed = f"integers up to {_LARGEST_ID}, or GTSAM symbols"
                        self._lines.refuse(
                            f"id {field[:40]!r}", allowed, table.line[fields.index(field)]
                        )
                    self._known[field] = int(field)
            ends.append([self._known[field] for field in fields])
        if word == EDGE:
            table.refuse_first(
                self._lines,
                np.array([a == b for a, b in zip(*ends, strict=True)], dtype=bool),
                lambda row: f"{table.word} from {ends[0][row]} to itself",
                "two different poses",
            )
        return ends


def _in_g2o(table: Table, values: Array, *, isam: bool) -> Array:
    """
    Convert numbers to those of g2o: of TORO roll, pitch, yaw and the planar triangle, of iSAM the
    root of the information.
    """
    if table.word in ISAM.values() or (isam and table.word == "EDGE2"):
        size = table.grammar.matrix
        root = np.triu(from_triangle(values[:, table.grammar.values :], size))
        information = np.swapaxes(root, 1, 2) @ root
        return np.concatenate([values[:, : table.grammar.values], triangle(information)], axis=1)
    if table.word == "EDGE2":
        return np.concatenate([values[:, :3], values[:, 3:][:, _TORO_TRIANGLE]], axis=1)
    if table.word not in {"VERTEX3", "EDGE3"}:
        return values
    # yaw, then pitch, then roll, about the rotated axes
    turn = Rotation.from_euler("ZYX", values[:, 5:2:-1]).as_quat()
    return np.concatenate([values[:, :3], turn, values[:, 6:]], axis=1)


def _inverse(lines: TextLines, word: str, matrices: Array, numbers: Sequence[int]) -> Array:
    """Invert positive definite matrices (n, k, k) of lines of a word, scaled to unit diagonals."""
    diagonal = np.diagonal(matrices, axis1=1, axis2=2)
    low = 1.0 / VARIANCES[1]
    high = 1.0 / VARIANCES[0]
    fine = (diagonal >= low) & (diagonal <= high)
    if not fine.all():
        row = int(np.argmin(fine.all(axis=1)))
        wrong = float(diagonal[row][~fine[row]][0])
        allowed = f"{low:g} to {high:g}" if wrong > 0.0 else "a positive diagonal"
        lines.refuse(f"{word} with information {wrong:g}", allowed + _TREATMENTS, numbers[row])
    scale = 1.0 / np.sqrt(diagonal)
    scales = scale[:, :, None] * scale[:, None, :]
    correlation = matrices * scales
    fine = np.linalg.eigvalsh(correlation)[:, 0] >= SMALLEST_EIGENVALUE
    if not fine.all():
        lines.refuse(
            f"{word} with singular information",
            f"a positive definite matrix{_TREATMENTS}",
            numbers[int(np.argmin(fine))],
        )
    inverse = np.linalg.inv(correlation) * scales
    return np.asarray(0.5 * (inverse + np.swapaxes(inverse, 1, 2)))


def _angle_scale(factor: float) -> Array:
    """Factors on the entries of a matrix (6, 6) if its first three axes are scaled by a factor."""
    axis = np.array([factor] * 3 + [1.0] * 3)
    return np.outer(axis, axis)


def _symbols(graph: FactorGraph, path: Path) -> list[int]:
    vehicles = graph.vehicle_name.tolist()
    if (
        not all(len(a) == 1 and a.isascii() and a.isalpha() for a in vehicles)
        or graph.pose_number.min() < 0
    ):
        raise EstimationError(
            f"{path}: symbols need vehicles named by one letter; found {', '.join(vehicles[:5])}"
        )
    poses = zip(graph.pose_vehicle.tolist(), graph.pose_number.tolist(), strict=True)
    names = [_SYMBOL.fullmatch(name) for name in graph.landmark_name.tolist()]
    landmarks = [
        ("L", i) if name is None else (name[1], int(name[2])) for i, name in enumerate(names)
    ]
    ids = [
        ord(letter) << _SYMBOL_SHIFT | k
        for letter, k in [*((vehicles[a], k) for a, k in poses), *landmarks]
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
