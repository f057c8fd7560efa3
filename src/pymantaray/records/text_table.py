"""Reader of text tables, CSV and similar formats, which keeps the line of the file of each row."""

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pymantaray.arrays import AnyArray, Array, Indices, Mask
from pymantaray.errors import MantaRayError, RecordError
from pymantaray.messages import one_line
from pymantaray.records.csv_text import unguard_formula
from pymantaray.records.dates import seconds_since
from pymantaray.records.invalid_lines import InvalidLines
from pymantaray.user_files import read_bytes

if TYPE_CHECKING:
    import pandas as pd

_NAMES = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
MONTHS = {name: k + 1 for k, name in enumerate(_NAMES)}
"""Number of a month by the first three letters of its English name."""
_LATEST = 1e11  # s; 1970 plus this is the year 5138
_MAX_COLUMNS = 2000
_YEARS = (1700, 2261)
_FASTEST = 3000.0  # m/s; 1 m/s with hours or days for seconds is more
_SINCE_1970 = {"milliseconds": 1e14, "microseconds": 1e17, "nanoseconds": math.inf}
"""Upper limits of stamps."""
_FINITE = "it must be a finite number"
_OPTIONAL = "it must be a number or an empty cell"
_TIMES = (
    "all cells must be seconds, or all must be dates such as 2014-07-15T12:00:00Z (without a zone:"
    " UTC)"
)
_RAGGED = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")
_NUMBER = re.compile(r"[-+.]*\d|nan$", re.IGNORECASE)
_PLAIN_UNITS = ("", "UTC", "degrees_north", "degrees_east")
"""Cells of a row of units that add nothing to the titles."""
_UNIT = re.compile(
    r"utc|deg(ree)?s?(_(north|east|c|f))?|rad|[kcm]?m|met(er|re)s?|ft|feet|d?bars?|db|decibars?"
    r"|[hkm]?pa|psi|°?[cfk]|deg[cf]|celsius|psu|pss-78|g/kg|[cm]?m/s|ft/s|[mun]?s|sec|seconds?",
    re.IGNORECASE,
)
_UNITS_OF_SALINITY = ("1", "1e-3", "0.001")


@dataclass(frozen=True, eq=False)
class TextTable:
    """
    Cells of a table as text, by the line of the file from 1; an empty cell is "".

    Comments are lines that begin with ``#``.
    """

    path: Path
    frame: "pd.DataFrame"
    comments: list[str]

    def require(self, columns: list[str]) -> None:
        """Raise an error if a column is missing or present twice."""
        header = list(self.frame.columns)
        missing = [name for name in columns if name not in header]
        if missing:
            raise RecordError(
                f"{self.path}: no {', '.join(missing)}; the columns are {', '.join(header)}"
            )
        twice = [name for name in columns if header.count(name) > 1]
        if twice:
            raise RecordError(f"{self.path}: two columns {twice[0]}; remove one")

    @property
    def lines(self) -> Indices:
        """Line of the file of each row."""
        return self.frame.index.to_numpy(dtype="int64")

    def numbers(self, columns: list[str]) -> Array:
        """Columns as finite numbers (n_rows, n_columns); any other cell raises an error."""
        self.require(columns)
        values = np.empty((len(self.frame), len(columns)))
        for k, name in enumerate(columns):
            values[:, k] = numbers_of(self.frame[name])
        for row, k in np.argwhere(~np.isfinite(values)):
            raise RecordError(f"{self.where(row)}: {self._fault(columns[k], row, _FINITE)}")
        return values

    def readable(
        self,
        invalid: InvalidLines,
        *,
        times: Collection[str] = (),
        numbers: Collection[str] = (),
        optional: Collection[str] = (),
        words: Collection[str] = (),
        choices: Mapping[str, Collection[str]] | None = None,
    ) -> "TextTable":
        """
        Table of the rows whose cells have the right content.

        That is a readable time, a finite number, a number or nothing, text, or one of several
        words.

        Other rows are added to the invalid lines. Columns of ``optional`` and ``choices`` may be
        absent.
        """
        self.require([*times, *numbers, *words])
        columns = set(self.frame.columns)
        faults: list[tuple[Mask, str, str]] = []
        for name in words:
            empty = np.array([word == "" for word in self.words(name)], dtype=bool)
            faults.append((empty | self.frame[name].isna().to_numpy(), name, "it must have a name"))
        for name in numbers:
            faults.append((~np.isfinite(numbers_of(self.frame[name])), name, _FINITE))
        for name in set(optional) & columns:
            faults.append((self._not_optional(name), name, _OPTIONAL))
        for name, choice in (choices or {}).items():
            wrong = np.array([word.lower() not in choice for word in self.words(name)], dtype=bool)
            faults.append((wrong, name, f"allowed: {', '.join(filter(None, choice))}"))
        for name in times:
            faults.append((self._not_times(name), name, _TIMES))
        keep = np.ones(len(self.frame), dtype=bool)
        for wrong, name, requirement in faults:
            for row in np.flatnonzero(wrong & keep).tolist():
                line = int(self.frame.index[row])
                invalid.add(self.path, line, self._fault(name, row, requirement))
            keep &= ~wrong
        return self if keep.all() else replace(self, frame=self.frame[keep])

    def _refuse(self, wrong: Mask, column: str, requirement: str) -> None:
        """Raise an error for the first cell that is wrong."""
        for row in np.flatnonzero(wrong).tolist():
            raise RecordError(f"{self.where(row)}: {self._fault(column, row, requirement)}")

    def _fault(self, column: str, row: int, requirement: str) -> str:
        cell = self.frame[column].iloc[row]
        content = repr(cell[:40]) if isinstance(cell, str) else cell
        return f"{column} is {content}; {requirement}"

    def where(self, row: int) -> str:
        """Name of the file and line of a row, for messages."""
        return f"{self.path}, line {self.frame.index[row]}"

    def words(self, column: str) -> list[str]:
        """Cells of a column as text; empty without this column."""
        cells = self.frame[column] if column in self.frame.columns else [""] * len(self.frame)
        return [str(cell).strip() for cell in cells]

    def optional(self, column: str, default: float = math.nan) -> Array:
        """Column as numbers, with a default for empty cells and without this column."""
        if column not in self.frame.columns:
            return np.full(len(self.frame), default)
        self._refuse(self._not_optional(column), column, _OPTIONAL)
        cells = self.frame[column]
        return numbers_of(cells.mask(cells == "", str(default)))

    def _not_optional(self, column: str) -> Mask:
        """True for cells that are neither a number nor empty."""
        cells = self.frame[column]
        return np.asarray(
            np.isnan(numbers_of(cells))
            & (cells != "").to_numpy()
            & (cells.str.lower() != "nan").to_numpy()
        )

    def seconds(self, column: str) -> "tuple[Array, np.datetime64]":
        """Column of times as seconds since the first date and this date, or as seconds and NaT."""
        times = self.times(column)
        if not np.issubdtype(times.dtype, np.datetime64):
            return times, np.datetime64("NaT", "ns")
        return seconds_since(times, times[0]), times[0]

    def times(self, column: str) -> AnyArray:
        """
        Column of seconds or of dates (UTC if they have no zone).

        A cell that is neither, or that differs from most cells, raises an error with its line.
        """
        self._refuse(self._not_times(column), column, _TIMES)
        dates = self.frame[column]
        if dates.dtype.kind != "M":
            seconds = numbers_of(dates)
            if np.isfinite(seconds).all():
                check_seconds(seconds, f"{self.path}: {column}", RecordError)
                return seconds
            dates = _dates(dates)
        if dates.dt.tz is not None:
            dates = dates.dt.tz_convert("UTC").dt.tz_localize(None)
        return dates.to_numpy(dtype="datetime64[ns]")

    def _not_times(self, column: str) -> Mask:
        """True for cells that are neither seconds nor dates, or differ in this from most cells."""
        cells = self.frame[column]
        if cells.dtype.kind == "M":
            return np.asarray(cells.isna())
        is_number = np.isfinite(numbers_of(cells))
        if 2 * np.count_nonzero(is_number) > is_number.size:
            return np.asarray(~is_number)
        return np.asarray(is_number | _dates(cells).isna())


def _dates(cells: "pd.Series[Any]") -> "pd.Series[Any]":
    """Dates in UTC, NaT for other cells and for years that 64-bit nanoseconds do not cover."""
    import pandas as pd

    dates = pd.to_datetime(cells, format="ISO8601", utc=True, errors="coerce")
    return dates.where(dates.dt.year.between(*_YEARS))


def check_seconds(times: Array, where: str, error: type[MantaRayError]) -> None:
    """Raise an error for time stamps that are too large for seconds since any epoch in use."""
    latest = max(map(abs, times.tolist()), default=0.0)
    if latest > _LATEST:
        unit = next(name for name, limit in _SINCE_1970.items() if latest < limit)
        raise error(
            f"{where} is up to {latest:.17g}, which is not in seconds but looks like {unit} since"
            " 1970; divide the times so that they are in seconds, or write dates such as"
            " 2014-07-15T12:00:00Z"
        )


def check_speed(
    time: Array,
    position: Array,
    where: str,
    error: type[MantaRayError],
) -> None:
    """Raise an error if positions (n, k) [m] are so fast that times [s] must be days or hours."""
    step = np.diff(time)
    moves = step > 0.0
    if not moves.any():
        return
    with np.errstate(over="ignore"):
        speed = float(
            np.median(np.linalg.norm(np.diff(position, axis=0)[moves], axis=1) / step[moves])
        )
    if speed > _FASTEST:
        raise error(
            f"{where} gives a median speed of {speed:,.0f} m/s; it must be in seconds; multiply"
            " days by 86400, hours by 3600"
        )


def numbers_of(cells: "pd.Series[Any]") -> Array:
    """
    Convert cells to numbers; NaN for other cells.

    pandas before 3.1 does not keep all digits of text.
    """
    import pandas as pd

    values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=float, copy=True)
    if pd.api.types.is_string_dtype(cells):
        finite = np.isfinite(values)
        values[finite] = cells.to_numpy(dtype=object)[finite].astype(float)
    return values


def read_text_table(
    path: str | Path, text: str | None = None, *, invalid: InvalidLines | None = None
) -> TextTable:
    """
    Read a table with a header and the separator of the header: comma, semicolon, tab or spaces.

    ``text`` is the content of the file, if it is read already. Rows with more cells than the
    header, and rows with fewer cells than most rows, are added to ``invalid``; without it, the
    former raise an error, and the latter have empty cells. A row of units below the header, such
    as ERDDAP's, becomes part of the titles.
    """
    import pandas as pd

    path = Path(path)
    content = read_text(path) if text is None else text
    # rows of cells by their numbers of lines, without comments and trailing separators
    lines = {i: line for i, line in enumerate(content.splitlines(), 1) if line.strip(" \t,;")}
    comments = {i: line for i, line in lines.items() if line.lstrip().startswith("#")}
    rows = {i: line.rstrip(" \t,;") for i, line in lines.items() if i not in comments}
    header = next(iter(rows.values()), "")
    if len(rows) < 2:
        problem = f"has one line, {header[:40]!r}" if rows else "is empty"
        raise RecordError(
            f"{path}: {problem}; a table needs a header with names of columns, and rows"
        )
    separator = next((sign for sign in ",;\t" if sign in header), r"\s+")
    n_titles = _count_cells(header, separator)
    if n_titles > _MAX_COLUMNS:
        raise RecordError(
            f"{path}: {n_titles:,} columns; at most {_MAX_COLUMNS:,} are read; check the separators"
        )
    if invalid is not None:
        rows = _whole_rows(path, lines, rows, separator, invalid)
    # cells as text
    try:
        cells = pd.read_csv(
            io.StringIO("\n".join(rows.values())),
            sep=separator,
            header=None,
            dtype=str,
            keep_default_na=False,
            skipinitialspace=True,
        )
    except ValueError as error:
        if match := _RAGGED.search(str(error)):
            titles, row, n = map(int, match.groups())
            raise RecordError(
                f"{path}, line {list(rows)[row - 1]}: {n} cells, but the header has {titles};"
                " check the separators"
            ) from None
        raise RecordError(
            f"{path}: not a readable table: {' '.join(str(error).split())[:80]}"
        ) from None
    if len(cells) != len(rows):
        raise RecordError(f"{path}: {len(rows)} lines give {len(cells)} rows; close all quotes")
    cells = cells.fillna("").map(str.strip).map(unguard_formula).set_axis(list(rows))
    names = cells.iloc[0].tolist()
    has_units = len(cells) > 2 and _are_units(
        units := [cell.strip(" ()[]") for cell in cells.iloc[1]]
    )
    if has_units:
        names = [
            name if unit in _PLAIN_UNITS else f"{name} [{unit}]"
            for name, unit in zip(names, units, strict=True)
        ]
    frame = cells.iloc[1 + has_units :].set_axis(names, axis=1)
    return TextTable(path, frame, list(comments.values()))


def _are_units(cells: list[str]) -> bool:
    """True if cells are a row of units: none is a number or a date, and one is a usual unit."""
    return any(_UNIT.fullmatch(cell) for cell in cells) and all(
        cell in _UNITS_OF_SALINITY or not _NUMBER.match(cell) for cell in cells
    )


def _whole_rows(
    path: Path, lines: dict[int, str], rows: dict[int, str], separator: str, invalid: InvalidLines
) -> dict[int, str]:
    """Header and rows that have as many cells as most rows, or more up to the number of titles."""
    header, *numbers = rows
    titles = _count_cells(rows[header], separator)
    width = {i: min(_count_cells(lines[i], separator), titles) for i in numbers}
    usual, _ = Counter(width.values()).most_common(1)[0]
    whole = {header: rows[header]}
    for i in numbers:
        count = _count_cells(rows[i], separator)
        if not count:
            invalid.add(path, i, f"{one_line(lines[i], 60)!r} has a quote that is not closed")
        elif count > titles:
            invalid.add(
                path, i, f"{count} cells, but the header has {titles}; check the separators"
            )
        elif width[i] < usual:
            cut = "; it is the last: the file may be cut off" if i == numbers[-1] else ""
            reason = f"{one_line(lines[i], 60)!r} has {width[i]} cells, other rows {usual}{cut}"
            invalid.add(path, i, reason)
        else:
            whole[i] = rows[i]
    return whole


def _count_cells(line: str, separator: str) -> int:
    """Number of cells of a line; 0 if a quote is not closed."""
    if separator == r"\s+":
        return len(line.split())
    if '"' not in line:
        return line.count(separator) + 1
    try:
        return len(
            next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))
        )
    except csv.Error:
        return 0


def read_text(path: Path) -> str:
    """Read a text file; other files raise an error."""
    raw = read_bytes(path, RecordError, what="a text table such as a .csv file")
    if raw.startswith(b"SQLite format 3"):
        raise RecordError(
            f"{path}: a database, not a text table; name a text table such as a .csv file"
        )
    if b"\0" in raw[:4096]:
        raise RecordError(f"{path}: a binary file, not a text table; export it as text")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # older programs write degree signs like this
