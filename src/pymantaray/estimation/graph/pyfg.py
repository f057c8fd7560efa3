"""
Factor graphs as PyFactorGraph text, in three dimensions or two.

Writer and reader use one grammar. Lines in two dimensions contain only the coordinates in the
plane: the reader lifts them to three dimensions, and the writer flattens them.
"""

import csv
import gzip
import io
import itertools
import re
import string
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from io import TextIOWrapper
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.arrays import Array
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.columns import ROTATION_FIRST, columns, to_graph, write_rows
from pymantaray.estimation.graph.graph import (
    EDGE,
    KINDS,
    LANDMARK_PRIOR,
    POSE_PRIOR,
    RANGE,
    SIGHTING,
    FactorGraph,
    FactorKind,
    Factors,
    GraphValues,
    check_graph,
    check_kinds,
    check_values,
)
from pymantaray.estimation.graph.pyfactorgraph import (
    ABOVE,
    ABOVE_VARIANCE,
    depths_from_above,
    with_depths,
)
from pymantaray.estimation.graph.text import Indefinite, Table, TextLines, read_tables
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import whole_file
from pymantaray.user_files import exists, is_gzip, read_text

POSE = "VERTEX_SE3:QUAT"
LANDMARK = "VERTEX_XYZ"
FLAT = {  # words in two dimensions, by those in three
    POSE: "VERTEX_SE2",
    LANDMARK: "VERTEX_XY",
    POSE_PRIOR: "VERTEX_SE2:PRIOR",
    LANDMARK_PRIOR: "VERTEX_XY:PRIOR",
    EDGE: "EDGE_SE2",
    SIGHTING: "EDGE_SE2_XY",
}
_LETTERS = "ABCDEFGHIJKMNOPQRSTUVWXYZ"  # of vehicles; L is for landmarks
_NAME = re.compile(rf"([{_LETTERS}]+|L)([0-9]+)")
_STUDY_NAME = re.compile("[A-Za-z0-9_-]+")
_LARGEST_NUMBER = 2**31 - 1  # of a pose; records store it in 32 bits
_FREE_VARIANCE = 1e12  # an axis with this variance or more is not constrained
_TEXT_COLUMNS = {"position": slice(0, 3), "depth": slice(2, 3), "quaternion": slice(3, 7)}
_COMPRESSION = 5  # of gzip; 9 takes three times as long for 2 % less
_AXES = np.array(["rx", "ry", "rz", "x", "y", "z"])  # of a tangent, rotation before translation


_GRAMMAR = {
    POSE: columns("pose", timed=True),
    LANDMARK: columns("landmark"),
    POSE_PRIOR: columns("prior", timed=True),
    LANDMARK_PRIOR: columns("survey", timed=True),
    EDGE: columns("edge", timed=True),
    RANGE: columns("range", timed=True),
    SIGHTING: columns("sighting", timed=True),
}


_WORDS = {**_GRAMMAR, **{flat: _GRAMMAR[word].flat for word, flat in FLAT.items()}}


class GraphFile(NamedTuple):
    """
    A graph read from a file, the values of its variables, and the number of omitted lines by word.

    ``valueless`` is true if the file has no values; ``values`` are then by chordal initialization.
    ``repaired`` counts the lines whose matrix was made positive definite, ``depths_from_above`` the
    depths that the file has as ranges.
    """

    graph: FactorGraph
    values: GraphValues
    left_out: dict[str, int]
    valueless: bool = False
    repaired: Mapping[str, int] = MappingProxyType({})
    depths_from_above: int = 0


def write_pyfg(
    graph: FactorGraph,
    path: Path | str,
    *,
    initial: GraphValues,
) -> None:
    """
    Write a factor graph as PyFactorGraph text, atomically.

    Parameters
    ----------
    graph : FactorGraph
        Vehicles keep their names if all are single capital letters other than L, and landmarks if
        all are an L and a number. Otherwise they get such symbols in order, and a table beside the
        file, ``name.names.csv`` for ``name.pyfg``, lists their names.
    path : pathlib.Path or str
        File to create or replace, compressed if its name ends in ``.gz``; its folder must exist.
    initial : GraphValues
        Values of the vertices: the ground truth, as PyFactorGraph defines it, or starting values.

    Raises
    ------
    EstimationError
        If the values do not fit the graph, a name occurs twice or has other characters.
    WriteError
        If the file cannot be written.

    Notes
    -----
    Numbers have 17 significant digits. Covariances are the upper triangle by rows in the order x,
    y, z, rx, ry, rz; a range carries its variance. The grammar has no prior of a position, a depth
    or an attitude alone. Depths are written as ranges to a landmark 5e8 m above the surface, and
    read back within 1e-7 m: as pose priors, PyFactorGraph's reader [1]_ would give them a precision
    of 0, and GTSAM's `PriorFactorPose3`, with errors in the tangent of the body, another optimum.
    Positions and attitudes are pose priors with a variance of 1e12 on each free axis; positions
    have the attitude of ``initial``. PyFactorGraph's reader replaces each covariance by a multiple
    of the identity, and refuses a range between two landmarks, which is written here. It knows a
    vehicle by one letter: more than 25 vehicles get names of several letters, AA, AB and so on,
    which `read_pyfg` reads and it does not. A comment or a word that it does not know would stop
    it, hence the table beside.

    References
    ----------
    .. [1] PyFactorGraph, ``py_factor_graph/io/pyfg_text.py`` and ``utils/matrix_utils.py``,
       https://github.com/MarineRoboticsGroup/PyFactorGraph

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pathlib import Path
    >>> from pymantaray.estimation import write_pyfg
    >>> write_pyfg(graph, "graph.pyfg", initial=start)
    >>> Path("graph.pyfg").read_text().count("VERTEX_SE3:QUAT ")
    4
    """
    _write(graph, Path(path), initial, None)


def not_in_text(graph: FactorGraph) -> list[str]:
    """Numbers and plurals of the kinds of factors in a graph that this text cannot hold."""
    tables = (table for table in graph.tables.values() if table.kind.word is None)
    return [f"{len(table)} {table.kind.plural}" for table in tables if len(table)]


def write_pyfgs(
    graphs: Mapping[Path, FactorGraph], *, initial: GraphValues, digits: int = 17
) -> None:
    """
    Write graphs of the same variables by their files, each as `write_pyfg` does; factors that they
    share become text once. Numbers have this many significant digits.
    """
    known = dict[str, tuple[Factors, str]]()
    for path, graph in graphs.items():
        _write(graph, path, initial, known, digits)


_Known = dict[str, tuple[Factors, str]] | None
"""
Tables of factors with their text, by kind, of a graph of the same variables; None if no graph
follows.
"""


def _write(
    graph: FactorGraph, path: Path, initial: GraphValues, known: _Known, digits: int = 17
) -> None:
    """Write a graph; its tables replace others in ``known``."""
    check_kinds()
    check_values(graph, initial)
    if lost := not_in_text(graph):
        raise EstimationError(
            f"{path}: PyFactorGraph text cannot hold {', '.join(lost)}; leave them out, or write"
            " the graph as NetCDF"
        )
    vehicles, landmarks = _symbols(graph)
    full = graph.vehicle_name.tolist() + graph.landmark_name.tolist()
    table = names_file(path)
    if vehicles + landmarks != full:
        odd = next((name for name in full if not _STUDY_NAME.fullmatch(name)), None)
        if odd is not None or len(set(full)) != len(full):
            what = "two equal names" if odd is None else f"the name {odd!r}"
            raise EstimationError(
                f"{path}: {what}; names must differ and consist of letters, digits, _ and -"
            )
    texts = _texts(graph, initial, (vehicles, landmarks), known, digits)
    with whole_file(path) as temporary:
        with _opened(temporary, compressed=is_gzip(path)) as file:
            file.writelines(texts)
        if vehicles + landmarks == full:
            table.unlink(missing_ok=True)  # from a replaced file
        else:
            with (
                whole_file(table) as beside,
                beside.open("w", encoding="utf-8", newline="") as names,
            ):
                csv.writer(names).writerows(
                    [("symbol", "name"), *zip(vehicles + landmarks, full, strict=True)]
                )


@contextmanager
def _opened(path: Path, *, compressed: bool) -> Iterator[IO[str]]:
    """Open a file for the text of a graph, optionally compressed, always with the same bytes."""
    with path.open("wb") as file, ExitStack() as stack:
        content: IO[bytes] = file
        if compressed:
            packed = gzip.GzipFile("", "wb", _COMPRESSION, file, mtime=0)
            content = cast("IO[bytes]", stack.enter_context(packed))
        yield stack.enter_context(TextIOWrapper(content, encoding="ascii", newline="\n"))


def names_file(path: Path) -> Path:
    """Path of the table of vehicle and landmark names beside a PyFactorGraph file."""
    return path.with_name(f"{plain_path(path).stem}.names.csv")


def plain_path(path: Path) -> Path:
    """Path of a graph file without the ending of gzip, whose suffix is the format."""
    return path.with_suffix("") if is_gzip(path) else path


def read_pyfg(path: Path | str) -> tuple[FactorGraph, GraphValues]:
    """
    Read a factor graph from PyFactorGraph text, in three dimensions or two.

    Parameters
    ----------
    path : pathlib.Path or str
        A name that ends in ``.gz`` means a file compressed by gzip. If a table of names of
        `write_pyfg` lies beside it, vehicles and landmarks get the names of
        the table.

    Returns
    -------
    graph : FactorGraph
        Poses are in the order of the file, vehicles in the order of their first pose.
    values : GraphValues
        Values of the vertices.

    Raises
    ------
    EstimationError
        If the file cannot be read or a line is not in the grammar; the message names the line, its
        error and the allowed input.

    Notes
    -----
    A pose prior whose rotation is free (variance 1e12 or more) becomes a position fix, and a depth
    prior if north and east are free too, as do the ranges that `write_pyfg` writes for depths. Time
    stamps of factors are checked and not kept: a factor has the time of its poses. In files of
    PyFactorGraph, vertices are the ground truth.

    Examples
    --------
    Continues the example of `pymantaray.estimation`:

    >>> from pymantaray.estimation import read_pyfg, write_pyfg
    >>> write_pyfg(graph, "graph.pyfg", initial=start)
    >>> read_pyfg("graph.pyfg")[0]
    <FactorGraph: 2 vehicles, 0 landmarks, 4 poses>
    """
    file = load_pyfg(path)
    return file.graph, file.values


def load_pyfg(
    path: Path | str,
    *,
    leave_out: Collection[str] = (),
    skip_unknown: bool = False,
    indefinite: Indefinite = "refuse",
) -> GraphFile:
    """
    Read like `read_pyfg`, but skip the lines of the words in ``leave_out`` and, with
    ``skip_unknown``, of unknown words.
    """
    path = Path(path)
    lines = TextLines(path, _WORDS, leave_out, skip_unknown=skip_unknown, indefinite=indefinite)
    tables, planar = read_tables(lines, _WORDS, one_space=True)
    graph, values = _Reader(lines, tables, planar=planar).graph(_read_names(names_file(path)))
    n_ranges = len(graph["range"])
    graph, values = with_depths(graph, values)
    try:
        check_graph(graph)
    except EstimationError as error:
        raise EstimationError(f"{path}: {error}") from None
    return GraphFile(
        graph,
        values,
        dict(lines.left_out),
        repaired=dict(lines.repaired),
        depths_from_above=n_ranges - len(graph["range"]),
    )


class _Reader:
    """Converts the tables of one file to a graph."""

    def __init__(self, lines: TextLines, tables: dict[str, Table], *, planar: bool) -> None:
        self._lines = lines
        self._planar = planar
        self._tables = {
            word: tables[FLAT.get(word, word) if self._planar else word] for word in _GRAMMAR
        }
        self._known: dict[str, str] = {}  # names by their spellings
        self._names = {
            word: self._checked_names(word, table) for word, table in self._tables.items()
        }
        self._values = {
            word: table.numbers(
                lines,
                position=word != RANGE,
                quaternion=_GRAMMAR[word].values == 7 and not self._planar,
            )
            for word, table in self._tables.items()
        }
        self._variable: dict[str, int] = {}
        distance = self._values[RANGE][:, 1]
        self._tables[RANGE].refuse_first(
            lines,
            distance < 0.0,
            lambda row: f"{RANGE} with distance {distance[row]:g}",
            "0 or more",
        )

    def graph(self, names: dict[str, str]) -> tuple[FactorGraph, GraphValues]:
        """Convert all lines; ``names`` maps symbols of vehicles and landmarks to their names."""
        (poses,) = self._names[POSE]
        (landmarks,) = self._names[LANDMARK]
        if not poses:
            self._lines.refuse(f"no {POSE} or {FLAT[POSE]} in the file", "at least one pose", 0)
        for word, vertices in ((POSE, poses), (LANDMARK, landmarks)):
            for row, name in enumerate(vertices):
                if name in self._variable:
                    line = self._tables[word].line[row]
                    self._lines.refuse(
                        f"second vertex named {name}", "one vertex for each name", line
                    )
                self._variable[name] = len(self._variable)
        of_pose = [name.rstrip(string.digits) for name in poses]
        vehicles = list(dict.fromkeys(of_pose))
        index = {vehicle: i for i, vehicle in enumerate(vehicles)}
        graph = FactorGraph(
            vehicle_name=np.array([names.get(vehicle, vehicle) for vehicle in vehicles]),
            landmark_name=np.array([names.get(name, name) for name in landmarks], dtype=str),
            pose_vehicle=np.array([index[vehicle] for vehicle in of_pose]),
            pose_number=np.array(
                [int(name[len(vehicle) :]) for vehicle, name in zip(of_pose, poses, strict=True)]
            ),
            pose_time=self._values[POSE][:, 0],
            planar=self._planar,
        )
        tables = {
            name: self._table(kind, kind.word)
            for name, kind in KINDS.items()
            if kind.word not in (POSE_PRIOR, None)
        }
        vertex = self._numbers(POSE)[0]
        landmark = self._numbers(LANDMARK)[0]
        values = GraphValues(
            position=vertex[:, :3], quaternion=vertex[:, 3:], landmark_position=landmark
        )
        return graph.with_factors(**self._pose_priors(), **tables), values

    def _numbers(self, word: str) -> tuple[Array, Array]:
        """Measurements in the lines of a word and their covariances, in the order of a graph."""
        flat = self._planar and word in FLAT
        grammar = _GRAMMAR[word].flat if flat else _GRAMMAR[word]
        values = self._values[word][:, grammar.timed :]
        measurement, covariance = to_graph(values, grammar, planar=flat)
        if flat and word == POSE_PRIOR:
            # the axes out of the plane are free if the axes in the plane are
            free = np.diagonal(covariance, axis1=1, axis2=2) >= _FREE_VARIANCE
            covariance[free[:, 3:5].all(axis=1), 5, 5] = _FREE_VARIANCE
            covariance[free[:, 2], 0, 0] = covariance[free[:, 2], 1, 1] = _FREE_VARIANCE
        return measurement, covariance

    def _table(self, kind: FactorKind, word: str) -> Factors:
        """Factors of a kind with a word of its own."""
        measurement, covariance = self._numbers(word)
        variables = self._variables(word)
        if word == EDGE:
            free = np.diagonal(covariance, axis1=1, axis2=2) >= _FREE_VARIANCE
            # odometry has the lines that no other kind has
            partial = {k.axes for k in KINDS.values() if k.word == EDGE and k.axes}
            mine = np.zeros(len(free), dtype=np.bool_)
            for axes in [kind.axes] if kind.axes else partial:
                mine |= (free == ~np.isin(np.arange(6), axes)).all(axis=1)
            mine = mine if kind.axes else ~mine
            variables = variables[mine]
            measurement = measurement[mine]
            covariance = covariance[mine]
            if kind.axes:
                covariance = covariance[:, kind.axes][:, :, kind.axes]
        columns = [measurement[:, span] for span in kind.columns_at.values()]
        covariance, keep = self._lines.treat(self._tables[word].word, covariance)
        return kind.table(variables, columns, covariance)[keep]

    def _pose_priors(self) -> dict[str, Factors]:
        """
        Factors of the kinds that are written as pose priors, distinguished by their free axes.
        """
        measurement, covariance = self._numbers(POSE_PRIOR)
        variables = self._variables(POSE_PRIOR)
        quaternion = measurement[:, 3:]
        free = np.diagonal(covariance, axis1=1, axis2=2) >= _FREE_VARIANCE
        # depth is distinct from horizontal axes only if the prior's axes are the world's, up to a
        # rotation about down
        level = np.abs(quaternion[:, 1:3]).max(axis=1, initial=0.0) < 1e-9
        left = np.ones(len(free), dtype=bool)
        allowed = []
        tables = {}
        for name, kind in KINDS.items():
            if kind.word != POSE_PRIOR:
                continue
            axes = list(kind.axes)
            fixed = np.isin(np.arange(6), axes)
            mine = (free == ~fixed).all(axis=1)
            matrix = covariance[:, axes][:, :, axes]
            allowed.append(_axes(~fixed) or "none")
            columns = [measurement[:, _TEXT_COLUMNS[column]] for column in kind.columns_at]
            if "quaternion" not in kind.columns_at:
                if fixed[3:].all():
                    matrix = _rotated(matrix, matrix_from_quaternion(quaternion))
                else:
                    mine &= level
                    allowed[-1] += " on level axes"
            left &= ~mine
            treated, keep = self._lines.treat(self._tables[POSE_PRIOR].word, matrix[mine])
            tables[name] = kind.table(variables[mine], [c[mine] for c in columns], treated)[keep]
        if left.any():
            row = int(np.argmax(left))
            self._lines.refuse(
                f"pose prior with free axes {_axes(free[row])}",
                f"{', or '.join(allowed)} (free: variance {_FREE_VARIANCE:g} or more)",
                self._tables[POSE_PRIOR].line[row],
            )
        return tables

    def _variables(self, word: str) -> NDArray[np.int32]:
        known = self._variable
        ends = self._names[word]
        try:
            columns = [[known[name] for name in names] for names in ends]
        except KeyError:
            row, name = next(
                (row, name)
                for row, names in enumerate(zip(*ends, strict=True))
                for name in names
                if name not in known
            )
            self._lines.refuse(
                f"name {name}", "names of the file's vertices", self._tables[word].line[row]
            )
        return np.array(columns, dtype=np.int32).T

    def _checked_names(self, word: str, table: Table) -> list[list[str]]:
        """
        Names in the lines of a word, for each end, without leading zeros, so that A01 equals A1.
        """
        ends = []
        for end in range(_GRAMMAR[word].names):
            fields = table.names(end)
            for field in dict.fromkeys(fields):
                if field not in self._known:
                    self._known[field] = self._name(table, field, fields)
            ends.append([self._known[field] for field in fields])
        self._check_names(table, word, ends)
        return ends

    def _name(self, table: Table, field: str, fields: list[str]) -> str:
        match = _NAME.fullmatch(field)
        if match is None:
            self._lines.refuse(
                f"name {field[:40]!r}",
                "a capital letter and a number, as A0, or L0 for a landmark",
                table.line[fields.index(field)],
            )
        digits = match[2].lstrip("0") or "0"
        if len(digits) > 10 or int(digits) > _LARGEST_NUMBER:
            self._lines.refuse(
                f"{table.word}: number of {field[:40]}",
                f"numbers up to {_LARGEST_NUMBER}",
                table.line[fields.index(field)],
            )
        return match[1] + digits

    def _check_names(self, table: Table, lifted: str, ends: list[list[str]]) -> None:
        word = table.word
        lines = self._lines
        landmark = np.array([[name[0] == "L" for name in names] for names in ends], dtype=bool)
        if lifted in {POSE, POSE_PRIOR, EDGE}:
            table.refuse_first(
                lines,
                landmark.any(axis=0),
                lambda row: f"{word} with landmark {ends[int(np.argmax(landmark[:, row]))][row]}",
                "poses",
            )
        if lifted in {LANDMARK, LANDMARK_PRIOR}:
            table.refuse_first(
                lines,
                ~landmark[0],
                lambda row: f"{word} with pose {ends[0][row]}",
                "a landmark, as L0",
            )
        if len(ends) < 2:
            return

        def both(row: int) -> str:
            return f"{word} from {ends[0][row]} to {ends[1][row]}"

        same = np.array([a == b for a, b in zip(*ends, strict=True)], dtype=bool)
        table.refuse_first(
            lines, same, lambda row: f"{word} from {ends[0][row]} to itself", "two different names"
        )
        if lifted == SIGHTING:
            table.refuse_first(lines, landmark[0] | ~landmark[1], both, "a pose, then a landmark")
        table.refuse_first(lines, landmark[0] & ~landmark[1], both, "the pose first")


def _read_names(path: Path) -> dict[str, str]:
    """Names by symbol of vehicles and landmarks; empty without a table."""
    if not exists(path):
        return {}
    text = read_text(path, EstimationError, what="a table of names")
    try:
        head, *rows = csv.reader(io.StringIO(text, newline=""))
    except (ValueError, csv.Error) as error:
        raise EstimationError(f"{path}: not a readable table of names: {error}") from None
    names = {row[0]: row[1] for row in rows if len(row) == 2 and _STUDY_NAME.fullmatch(row[1])}
    if (
        head != ["symbol", "name"]
        or len(names) != len(rows)
        or len(set(names.values())) != len(rows)
    ):
        raise EstimationError(
            f"{path}: not a table of names; it must have a line symbol,name, then in each line a"
            " symbol of the graph file and a name of letters, digits, _ and -,"
            " each once"
        )
    return names


def _symbols(graph: FactorGraph) -> tuple[list[str], list[str]]:
    """Symbols of vehicles and landmarks in the file."""
    vehicles: list[str] = graph.vehicle_name.tolist()
    width = 1
    while len(_LETTERS) ** width < len(vehicles):
        width += 1
    if not all(re.fullmatch(f"[{_LETTERS}]{{{width}}}", name) for name in vehicles):
        letters = itertools.product(_LETTERS, repeat=width)
        vehicles = ["".join(next(letters)) for _ in vehicles]
    landmarks: list[str] = graph.landmark_name.tolist()
    if not all(re.fullmatch("L(0|[1-9][0-9]{0,8})", name) for name in landmarks):
        landmarks = [f"L{i}" for i in range(len(landmarks))]
    return vehicles, landmarks


def _texts(
    graph: FactorGraph,
    initial: GraphValues,
    symbols: tuple[list[str], list[str]],
    known: _Known,
    digits: int,
) -> Iterator[str]:
    """
    Lines of the poses, of the landmarks and of each kind of factors, or the text of a kind from
    ``known``.
    """
    vehicles, landmarks = symbols
    look: dict[str, Any] = {"planar": graph.planar, "digits": digits}
    numbers = zip(graph.pose_vehicle.tolist(), graph.pose_number.tolist(), strict=True)
    names = [f"{vehicles[a]}{k}" for a, k in numbers] + landmarks
    time = [f"{t:.17g}" for t in graph.pose_time.tolist()] + ["0"] * len(landmarks)
    poses = [f"{t} {name}" for t, name in zip(time, names[: graph.n_poses], strict=False)]
    poses_values = np.concatenate([initial.position, initial.quaternion], axis=1)
    yield from write_rows(_words(POSE), poses, poses_values, **look)
    yield from write_rows(_words(LANDMARK), landmarks, initial.landmark_position, **look)
    above = next(f"L{k}" for k in range(len(landmarks) + 1) if f"L{k}" not in landmarks)
    if any(len(factors) and factors.kind.is_depth for factors in graph.tables.values()):
        yield f"{LANDMARK} {above} 0 0 {-ABOVE:g}\n"
        variance = f"{ABOVE_VARIANCE:g}"
        yield f"{LANDMARK_PRIOR} 0 {above} 0 0 {-ABOVE:g} {variance} 0 0 {variance} 0 {variance}\n"
    for table, factors in graph.tables.items():
        kind = factors.kind
        if kind.word is None:
            continue
        if known is not None and table in known and _same(known[table][0], factors):
            yield known[table][1]
            continue
        # a factor has the time of the variable that messages name; landmarks have no time
        heads = [
            f"{time[after]} {' '.join(names[v] for v in ends)}"
            for after, ends in zip(
                factors.subject.tolist(), factors.variables.tolist(), strict=True
            )
        ]
        if kind.is_depth:
            heads = [f"{head} {above}" for head in heads]
            rows = write_rows(
                _words(RANGE), heads, *depths_from_above(factors, initial), planar=False
            )
        else:
            rows = write_rows(
                _words(kind.word), heads, *_pose_prior_columns(graph, factors, initial), **look
            )
        if known is None:
            yield from rows
        else:
            known[table] = factors, "".join(rows)
            yield known[table][1]


def _same(first: Factors, second: Factors) -> bool:
    """True if two tables of factors of a kind have the same numbers."""
    return all(
        np.array_equal(getattr(first, of), getattr(second, of))
        for of in ("variables", "measurement", "covariance")
    )


def _words(word: str) -> tuple[str, str | None]:
    """Words in three dimensions and in two."""
    return word, FLAT.get(word)


def _pose_prior_columns(
    graph: FactorGraph, factors: Factors, initial: GraphValues
) -> tuple[Array, Array]:
    """
    Measured columns and covariance; kinds without a word of their own become pose priors with free
    axes. A position has the attitude of the values and so, for readers that take the error in the
    tangent of the prior, its own optimum.
    """
    kind = factors.kind
    covariance = factors.covariance
    measurement = factors.measurement
    if kind.axes:
        axes = np.array(kind.axes)
        measurement = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (len(factors), 1))
        for column, span in kind.columns_at.items():
            measurement[:, _TEXT_COLUMNS[column]] = factors.measurement[:, span]
        if kind.axes == (3, 4, 5) and kind.ends == ("pose",) and not graph.planar:
            measurement[:, 3:] = initial.quaternion[factors.subject]
            to_body = np.swapaxes(matrix_from_quaternion(measurement[:, 3:]), 1, 2)
            part = _rotated(factors.covariance, to_body)
        else:
            part = factors.covariance
        covariance = np.tile(_FREE_VARIANCE * np.eye(6), (len(factors), 1, 1))
        covariance[:, axes[:, None], axes] = part
    return measurement, covariance


def _axes(which: ArrayLike) -> str:
    """Names of axes of a tangent, translation first."""
    return " ".join(_AXES[ROTATION_FIRST][np.asarray(which)[ROTATION_FIRST]].tolist())


def _rotated(covariance: Array, rotation: Array) -> Array:
    """Covariances (n, 3, 3) in rotated axes; untouched, to the last digit, if axes are equal."""
    equal = (covariance == covariance[:, :1, :1] * np.eye(3)).all(axis=(1, 2))
    rotated = rotation @ covariance @ np.swapaxes(rotation, 1, 2)
    rotated = 0.5 * (rotated + np.swapaxes(rotated, 1, 2))
    return np.where(equal[:, None, None], covariance, rotated)
