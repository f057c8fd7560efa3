"""Numbers as Fortran's list-directed input reads them, and lengths that survive the change to kilometres."""

import math
import re
from collections.abc import Iterable
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]
_TOKEN = re.compile(r"'(?:[^']|'')*'|\"[^\"]*\"|/|[^\s,/'\"]+")
_REPEAT = re.compile(r"(\d+)\*(.+)")
_MOST = 10_000_000  # values of one list; more is a damaged count


class ListReader:
    """
    Lines of a text file, read as a sequence of list-directed READ statements.

    Each READ starts on a new line, goes on over as many lines as it needs, stops at a slash and leaves the
    rest of its last line unread; that rest is where people write comments.

    Parameters
    ----------
    path : pathlib.Path

    Attributes
    ----------
    next_line : int
        Index of the line that the next READ starts on; set it to read again.

    Raises
    ------
    AcousticsError
        If the file cannot be read as text.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError as error:
            raise AcousticsError(f"{path}: cannot be read: {error.strerror}") from None
        self.next_line = 0

    @property
    def remark(self) -> str:
        """What follows the first slash on the line read last."""
        return self._lines[self.next_line - 1].partition("/")[2].strip() if self.next_line else ""

    def fail(self, text: str) -> AcousticsError:
        """Error that names the file and the line read last."""
        return AcousticsError(f"{self.path}, line {self.next_line}: {text}")

    def text_follows(self) -> bool:
        """Whether the next line that is not blank starts with a quote or a letter."""
        for line in self._lines[self.next_line :]:
            first = _TOKEN.search(line)
            if first:
                return first[0][0] in "'\"" or first[0][0].isalpha()
        return False

    def words(self, count: int, what: str) -> list[str]:
        """
        Read one list of at most ``count`` words.

        Parameters
        ----------
        count : int
            Words that the READ asks for.
        what : str
            Their meaning, for messages.

        Returns
        -------
        list of str
            Fewer than ``count`` where a slash ended the list. Quotes are removed.

        Raises
        ------
        AcousticsError
            If the file ends first.
        """
        found: list[str] = []
        while len(found) < count:
            if self.next_line >= len(self._lines):
                raise self.fail(f"the file ends where {what} is expected")
            line = self._lines[self.next_line]
            self.next_line += 1
            for word in _TOKEN.findall(line):
                if word == "/":
                    return found
                if word[0] in "'\"":
                    found.append(word[1:-1])
                elif repeat := _REPEAT.fullmatch(word):
                    found.extend([repeat[2]] * min(int(repeat[1]), count - len(found)))
                else:
                    found.append(word)
                if len(found) == count:
                    break
        return found

    def word(self, what: str) -> str:
        """Read a list of one word; an empty list is an error."""
        words = self.words(1, what)
        if not words:
            raise self.fail(f"{what} is missing")
        return words[0]

    def count(self, what: str, *, least: int = 1) -> int:
        """Read a list of one whole number of at least ``least``."""
        word = self.word(what)
        try:
            value = int(word)
        except ValueError:
            raise self.fail(f"{what}: {word!r} is not a whole number") from None
        if not least <= value <= _MOST:
            raise self.fail(f"{what}: {value}; allowed are {least} to {_MOST}")
        return value

    def numbers(self, count: int, what: str, *, least: int | None = None, kilometres: bool = False) -> Array:
        """
        Read one list of numbers.

        Parameters
        ----------
        count : int
            Numbers that the READ asks for.
        what : str
            Their meaning, for messages.
        least : int, optional
            Fewest that must be there before a slash. Default: all.
        kilometres : bool
            They are kilometres; give them as metres.

        Returns
        -------
        ndarray, shape (n,)

        Raises
        ------
        AcousticsError
            If there are fewer, or a word is no finite number.
        """
        row = None if kilometres else self._plain_row(count)
        if row is not None:
            return row
        words = self.words(count, what)
        needed = count if least is None else least
        if len(words) < needed:
            raise self.fail(f"{what}: {len(words)} of {needed} numbers before the slash")
        return np.array([self._number(word, what, kilometres=kilometres) for word in words])

    def vector(self, what: str, *, kilometres: bool = False) -> Array:
        """
        Read a count and, in a list of its own, that many numbers, or the first and last of an even spacing.

        Parameters
        ----------
        what : str
            Their meaning, for messages.
        kilometres : bool
            They are kilometres; give them as metres.

        Returns
        -------
        ndarray, shape (n,)

        Raises
        ------
        AcousticsError
            As `numbers`.
        """
        return self.spaced(self.count(f"number of {what}"), what, kilometres=kilometres)

    def spaced(self, count: int, what: str, *, kilometres: bool = False) -> Array:
        """Read the numbers of a `vector` whose count has been read."""
        values = self.numbers(count, what, least=min(count, 2), kilometres=kilometres)
        if values.size == count:
            return values
        if values.size > 2:
            raise self.fail(f"{what}: {values.size} of {count} numbers before the slash; give 2 or all")
        return np.linspace(values[0], values[1], count)

    def remaining(self) -> Array:
        """
        Read all numbers up to the end of the file, whatever its lines.

        Returns
        -------
        ndarray, shape (n,)

        Raises
        ------
        AcousticsError
            If something else is among them.
        """
        words = " ".join(self._lines[self.next_line :]).replace("D", "E").split()
        for i in [i for i, word in enumerate(words) if "*" in word][::-1]:
            times, _, value = words[i].partition("*")
            words[i : i + 1] = [value] * (int(times) if times.isdigit() else 1)
        try:
            return np.array(words, dtype=float)
        except ValueError as error:
            raise self.fail(f"further down, {error}") from None

    def _plain_row(self, count: int) -> Array | None:
        """Next line, if it is exactly a whole list of plain numbers: the quick road for large grids."""
        if self.next_line >= len(self._lines):
            return None
        words = self._lines[self.next_line].partition("/")[0].split()
        if len(words) != count:
            return None
        try:
            values = np.array(words, dtype=float)
        except ValueError:
            return None
        if not np.isfinite(values).all():
            return None
        self.next_line += 1
        return values

    def _number(self, word: str, what: str, *, kilometres: bool) -> float:
        plain = word.replace("d", "e").replace("D", "e")
        try:
            value = float(Decimal(plain).scaleb(3)) if kilometres else float(plain)
        except (ValueError, InvalidOperation):
            raise self.fail(f"{what}: {word!r} is not a number") from None
        if not math.isfinite(value):
            raise self.fail(f"{what}: {word!r} is not finite")
        return value


def plain(value: float) -> str:
    """
    Shortest decimal that reads back as the same double.

    Parameters
    ----------
    value : float

    Returns
    -------
    str
    """
    return repr(float(value))


def in_kilometres(value: float) -> str:
    """
    Metres written as kilometres by moving the decimal point, so that no digit is lost.

    Parameters
    ----------
    value : float
        [m]

    Returns
    -------
    str
        [km]

    Examples
    --------
    >>> in_kilometres(77499.483)
    '77.499483'
    """
    return format(Decimal(repr(float(value))).scaleb(-3), "f")


def row(values: Iterable[float], *, kilometres: bool = False) -> str:
    """
    Numbers of one list, ended by a slash.

    Parameters
    ----------
    values : iterable of float
    kilometres : bool
        They are metres; write them as kilometres.

    Returns
    -------
    str
    """
    return " ".join(map(in_kilometres if kilometres else plain, values)) + " /"
