"""
Lines of text that begin with a word, read as columns: the common part of PyFactorGraph and g2o
files.

Fields are collected line by line, and converted and checked column by column; messages name the
first wrong line.
"""

from array import array
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Literal, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array, Mask
from pymantaray.errors import EstimationError
from pymantaray.estimation.graph.graph import (
    LARGEST,
    QUATERNION_TOLERANCE,
    SMALLEST_EIGENVALUE,
    VARIANCES,
)
from pymantaray.quantities.checks import parsed_number
from pymantaray.user_files import open_text

MAX_GRAPH_BYTES = 2_000_000_000
_LIST = "FIX"  # whose line lists ids of vertices
_MAX_WORDS_NAMED = 5  # unknown words listed in a message


_REPAIRED = 1e-6  # smallest eigenvalue of a repaired matrix with unit diagonal


class Word(NamedTuple):
    """
    Fields after a word: optional time, names or ids, measured numbers, and the upper triangle of a
    matrix.
    """

    timed: bool
    names: int
    values: int
    matrix: int = 0
    planar: bool | None = False  # true in graphs of two dimensions; None in both

    @property
    def numbers(self) -> int:
        """Number of measured numbers and entries of the triangle."""
        return self.values + self.matrix * (self.matrix + 1) // 2

    @property
    def width(self) -> int:
        """Number of fields, the word included."""
        return 1 + self.timed + self.names + self.numbers

    @property
    def flat(self) -> "Word":
        """Fields in two dimensions."""
        values = {7: 3, 3: 2, 1: 1}[self.values]
        matrix = {6: 3, 3: 2}.get(self.matrix, self.matrix)
        return self._replace(values=values, matrix=matrix, planar=True)


Indefinite = Literal["refuse", "drop", "repair"]
"""Treatment of lines whose information or covariance matrix is not positive definite."""


def definite_matrices(matrices: Array, treatment: Indefinite) -> tuple[Array, Mask]:
    """
    Positive definite matrices (n, k, k) in place of others, and which were positive definite.

    A repaired matrix has the same eigenvectors, after scaling to a unit diagonal, and eigenvalues
    of at least 1e-6. A diagonal entry that is not positive becomes 1e-6 of the median of its axis.
    With "drop" others become the identity, to be left out.
    """
    diagonal = np.diagonal(matrices, axis1=1, axis2=2)
    positive = diagonal >= VARIANCES[0]
    scale = np.sqrt(np.where(positive, diagonal, 1.0))
    correlation = matrices / scale[:, :, None] / scale[:, None, :]
    fine = positive.all(axis=1) & (np.linalg.eigvalsh(correlation)[:, 0] >= SMALLEST_EIGENVALUE)
    if fine.all() or treatment == "refuse":
        return matrices, fine
    out = matrices.copy()
    eye = np.eye(matrices.shape[1])
    if treatment == "drop":
        out[~fine] = eye
        return out, fine
    typical = [
        float(np.median(variances[usable])) if usable.any() else 1.0
        for variances, usable in zip(diagonal.T, positive.T, strict=True)
    ]
    scale = np.sqrt(np.where(positive, diagonal, _REPAIRED * np.array(typical)))[~fine]
    unit = matrices[~fine] / scale[:, :, None] / scale[:, None, :]
    unit[:, np.arange(len(eye)), np.arange(len(eye))] = 1.0
    values, vectors = np.linalg.eigh(unit)
    unit = (vectors * np.maximum(values, _REPAIRED)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    repaired = unit * scale[:, :, None] * scale[:, None, :]
    out[~fine] = 0.5 * (repaired + np.swapaxes(repaired, 1, 2))
    return out, fine


class TextLines:
    """
    Lines of a text file, and errors that name the line.

    Blank lines, comments and a byte-order mark are ignored; lines of omitted and skipped unknown
    words are counted.
    """

    def __init__(
        self,
        path: Path,
        words: Collection[str] = (),
        leave_out: Collection[str] = (),
        *,
        skip_unknown: bool = False,
        indefinite: Indefinite = "refuse",
    ) -> None:
        self.indefinite = indefinite
        self.repaired: Counter[str] = Counter()
        self._path = path
        self.number = 0
        self._words = tuple(words)
        self._leave_out = frozenset(leave_out)
        self._skip_unknown = skip_unknown
        self.left_out: Counter[str] = Counter()
        self._unknown: dict[str, int] = {}  # the first line of each word

    def __iter__(self) -> Iterator[str]:
        """Each line that begins with a known word; ``number`` is its number, from 1."""
        with open_text(
            self._path, EstimationError, what="a graph file", limit=MAX_GRAPH_BYTES
        ) as file:
            for self.number, raw in enumerate(file, start=1):
                line = raw.rstrip("\r\n")
                word = next(iter(line.split(None, 1)), "#")
                if word.startswith("#"):
                    continue
                if word in self._leave_out or word not in self._words:
                    self.left_out[word] += 1
                    if word not in self._leave_out:
                        self._unknown.setdefault(word, self.number)
                    continue
                if not line.isascii():
                    self.refuse(f"{word} with a character that is not ASCII", "ASCII")
                if word == _LIST:
                    yield from (f"{word} {one}" for one in line.split()[1:])
                    continue
                yield line
        never = [
            word
            for word in self._leave_out
            if word not in self._words and word not in self.left_out
        ]
        if never:
            self.refuse(f"no line begins with {never[0]!r}", "words of the file to leave out", 0)
        if self._unknown and not self._skip_unknown:
            first = list(self._unknown.items())[:_MAX_WORDS_NAMED]
            named = [
                f"{self.left_out[word]} of {word[:40]!r} (line {line})" for word, line in first
            ]
            more = len(self._unknown) - len(named)
            listing = ", ".join(named) + (f" and {more} more words" if more else "")
            raise EstimationError(
                f"{self._path}: unknown lines: {listing}; allowed: {', '.join(self._words)}; or"
                " skip and count them with `skip_unknown=True`"
            )

    def treat(self, word: str, matrices: Array) -> tuple[Array, Mask]:
        """
        Treat matrices of a word that are not positive definite as chosen, and count them; returns
        the rows to keep.
        """
        out, fine = definite_matrices(matrices, self.indefinite)
        count = int(np.count_nonzero(~fine))
        if self.indefinite == "drop" and count:
            self.left_out[f"{word} (indefinite matrix)"] += count
            return out, fine
        if self.indefinite == "repair" and count:
            self.repaired[word] += count
        return out, np.ones(len(fine), dtype=bool)

    def refuse(self, what: str, allowed: str, number: int | None = None) -> NoReturn:
        """Raise an error about the current line, or that of a number; 0 for none."""
        line = self.number if number is None else number
        where = f"{self._path}, line {line}" if line else f"{self._path}"
        raise EstimationError(f"{where}: {what}; allowed: {allowed}")


class Table:
    """All lines of one word: line numbers, and the fields of all lines in sequence."""

    def __init__(self, word: str, grammar: Word) -> None:
        self.word = word
        self.grammar = grammar
        self.line = array("q")
        self.fields: list[str] = []

    def with_lines(self, other: "Table") -> "Table":
        """Lines of two words with the same fields, under the word of this table."""
        out = Table(self.word, self.grammar)
        out.line = self.line + other.line
        out.fields = self.fields + other.fields
        return out

    def names(self, end: int) -> list[str]:
        """Name or id of one end of each line."""
        return self.fields[1 + self.grammar.timed + end :: self.grammar.width]

    def numbers(
        self, lines: TextLines, *, position: bool = True, quaternion: bool = False
    ) -> Array:
        """
        Time (if any), measured numbers and triangle of each line, (n, k), checked for size.

        The first three measured numbers may be a position, the next four a quaternion.
        """
        grammar = self.grammar
        n = len(self.line)
        first = 1 + grammar.timed + grammar.names
        out = np.empty((n, grammar.timed + grammar.numbers))
        for column, at in enumerate(
            [*([1] if grammar.timed else []), *range(first, grammar.width)]
        ):
            out[:, column] = self._column(lines, self.fields[at :: grammar.width])
        values = out[:, grammar.timed :]
        self.refuse_first(
            lines,
            ~np.isfinite(out).all(axis=1),
            lambda _: f"{self.word} with a value that is not finite",
            "finite numbers",
        )
        if position:
            far = np.abs(values[:, :3]).max(axis=1, initial=0.0)
            allowed = f"positions of at most {LARGEST:g} m"
            self.refuse_first(
                lines, far > LARGEST, lambda row: f"{self.word} with {far[row]:g}", allowed
            )
        most = np.abs(out).max(axis=1, initial=0.0)
        self.refuse_first(
            lines,
            most > VARIANCES[1],
            lambda row: f"{self.word} with {most[row]:g}",
            f"at most {VARIANCES[1]:g}",
        )
        if quaternion:
            off = np.abs(np.linalg.norm(values[:, 3:7], axis=1) - 1.0) > QUATERNION_TOLERANCE
            self.refuse_first(
                lines,
                off,
                lambda row: f"{self.word}: quaternion {values[row, 3:7].tolist()}",
                "x y z w of length 1",
            )
        return out

    def refuse_first(
        self, lines: TextLines, wrong: ArrayLike, what: Callable[[int], str], allowed: str
    ) -> None:
        """Refuse the first wrong line, if any."""
        if np.any(wrong):
            row = int(np.argmax(wrong))
            lines.refuse(what(row), allowed, self.line[row])

    def _column(self, lines: TextLines, fields: list[str]) -> Array:
        """Numbers of one field of each line."""
        try:
            values = np.fromiter(map(float, fields), dtype=float, count=len(fields))
        except ValueError:
            for row, field in enumerate(fields):
                try:
                    parsed_number(field)
                except ValueError as error:
                    lines.refuse(f"{self.word}: {str(error)[:80]}", "numbers", self.line[row])
            raise
        text = "".join(fields)
        if "_" in text or text.split(None, 1) != [text]:  # Python accepts both in numbers
            odd = ["_" in field or field != field.strip() for field in fields]
            what = f"{self.word} with an underscore or a tab among its numbers"
            self.refuse_first(lines, np.array(odd, dtype=bool), lambda _: what, "digits and spaces")
        return values


def read_tables(
    lines: TextLines, grammar: Mapping[str, Word], *, one_space: bool
) -> tuple[dict[str, Table], bool]:
    """
    Read the tables of all words of a grammar, and whether the graph is two-dimensional.

    ``one_space`` refuses other white space between fields.
    """
    tables = {word: Table(word, fields) for word, fields in grammar.items()}
    takers = {
        word: (table.grammar.planar, table.grammar.width, table.line.append, table.fields.extend)
        for word, table in tables.items()
    }
    planar: bool | None = None  # not known yet
    also = ", with one space between fields" if one_space else ""
    for line in lines:
        fields = line.strip(" ").split(" ") if one_space else line.split()
        word = fields[0]
        if word not in takers:  # a tab follows it
            lines.refuse(f"begins with {word[:40]!r}", "a word, with one space between fields")
        flat, width, add_line, add_fields = takers[word]
        if flat is not planar and flat is not None:
            if planar is not None:
                what = f"{word} in a graph in {'two' if planar else 'three'} dimensions"
                lines.refuse(what, "one kind of graph")
            planar = flat
        if len(fields) != width:
            lines.refuse(f"{word} with {len(fields)} fields", f"{width}{also}")
        add_line(lines.number)
        add_fields(fields)
    return tables, bool(planar)
