"""A table of results: all digits for programs, and one look for all readers."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from itertools import repeat
from textwrap import wrap
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pymantaray.arrays import Array
from pymantaray.records.column_attributes import UNIT_ENDINGS
from pymantaray.records.csv_text import csv_text
from pymantaray.records.digits import (
    compact_format,
    measured_numbers,
    number_format,
    plain_signs,
    show,
    show_alike,
    show_row,
)
from pymantaray.records.glossary import meaning

if TYPE_CHECKING:
    import pandas as pd

_HEADS = {
    "n": "N",
    "sd_m": "sd [m]",
    "rmse_m": "RMSE [m]",
    "p1_m": "1 % [m]",
    "p5_m": "5 % [m]",
    "p25_m": "25 % [m]",
    "p75_m": "75 % [m]",
    "p95_m": "95 % [m]",
    "p99_m": "99 % [m]",
    "from_straight_rmse_m": "RMSE from straight [m]",
    "from_straight_rmse_standard_error_m": "standard error from straight [m]",
    "from_straight_median_m": "median from straight [m]",
    "rmse_standard_error_m": "standard error of RMSE [m]",
    "bound_rmse_m": "lower bound of RMSE [m]",
    "efficiency": "efficiency, (bound / RMSE)²",
    "percent": "share [%]",
    "percent_beyond_3_sigma": "> 3 sigma [%]",
}
_SMALLEST_LENGTH = 1e-6  # m; shorter ones in a column of longer ones are rounding errors
_FORMATS = dict.fromkeys(("lat", "lon", "latitude", "longitude"), ".6f")  # a metre is 1e-5 degrees
_KEY = "key"  # columns of settings
_MEANING = "meaning"
_QUANTITY = "quantity"  # a column with names of columns of other tables
_NOTEBOOK_ROWS = 24  # more than a record has columns
_HEAD_LETTERS = 12  # of a line of a head in LaTeX
_MAX_LINE = 30  # letters; a column with longer texts wraps in LaTeX
_POWER_OF_TEN = re.compile(r"(?<=\d)e(\$-\$|-|\+)0*(\d+)\b")
_LATEX_SIGNS = {
    "−": "$-$",
    "–": "--",
    "²": "$^2$",
    "≤": "$\\leq$",
    "°": "$^\\circ$",
    "σ": "$\\sigma$",
    "µ": "$\\mu$",
}


class Head(NamedTuple):
    """
    Head of a column.

    Text with the unit in brackets, True for a column of numbers, and the meaning, which may be
    empty.
    """

    text: str
    numbers: bool
    meaning: str


@dataclass(frozen=True, eq=False)
class ResultTable:
    """
    A table of results, the same wherever it is shown.

    Parameters
    ----------
    name : str
        Name of its file and of its LaTeX label.
    frame : pandas.DataFrame
        All columns with all digits; names of columns end in their units, ``_m``, ``_s``, ``_h``,
        ``_deg``, ``_percent``.
    caption : str
    columns : sequence of str
        Columns that people see, by default all.
    brief : sequence of str
        Columns where there is less room, in the terminal, in notebooks and in LaTeX, by default
        `columns`.
    words : mapping of str to str
        Heads of columns that mean something else than in other tables.
    by_row : bool
        True if each row is one quantity; otherwise each column is.
    folded : bool
        True if a page shows only the caption until it is clicked.
    paper : str
        Counterpart in the paper.
    file : str
        File to which a page links, by default ``tables/NAME.csv``.

    Examples
    --------
    >>> import pandas as pd
    >>> frame = pd.DataFrame({"vehicle": ["A", "B"], "rmse_m": [0.51234, 12.3]})
    >>> print(ResultTable("errors", frame))
    vehicle RMSE [m]
          A     0.51
          B    12.30
    """

    name: str
    frame: "pd.DataFrame"
    caption: str = ""
    columns: Sequence[str] = ()
    brief: Sequence[str] = ()
    words: Mapping[str, str] = field(default_factory=dict)
    by_row: bool = False
    folded: bool = False
    paper: str = ""
    file: str = ""

    @property
    def visible(self) -> "pd.DataFrame":
        """Columns that people see, with all digits."""
        return self.frame[list(self.columns)] if self.columns else self.frame

    @cached_property
    def heads(self) -> list[Head]:
        """Heads of the columns that people see."""
        return [
            Head(self.words.get(name, heading(name)), dtype.kind in "iuf", meaning(name))
            for name, dtype in zip(map(str, self.visible.columns), self.visible.dtypes, strict=True)
        ]

    @cached_property
    def rows(self) -> list[list[str]]:
        """
        Cells that people see.

        They have equal decimals in each column, or in each row if a row is one quantity.
        """
        frame = self.visible.astype(object)
        if _QUANTITY in frame:
            frame[_QUANTITY] = frame[_QUANTITY].map(heading)
        cells = frame.to_numpy()
        if self.by_row:
            settings = _MEANING in frame  # exact numbers
            return [[*map(show, row)] if settings else show_row(row) for row in cells.tolist()]
        forms = _formats(self.visible)
        columns = [
            show_alike(column, form) for column, form in zip(cells.T.tolist(), forms, strict=True)
        ]
        return [list(row) for row in zip(*columns, strict=True)]

    def short(self) -> "ResultTable":
        """
        Return the table with the columns for the terminal and for notebooks.

        Returns
        -------
        ResultTable
        """
        return replace(self, columns=self.brief or self.columns)

    def first(self, rows: int) -> "ResultTable":
        """
        Return the first rows, with a caption that says so.

        Parameters
        ----------
        rows : int

        Returns
        -------
        ResultTable
            The table itself if it has no more rows.
        """
        if len(self.frame) <= rows:
            return self
        caption = f"{self.caption.removesuffix('.')}: the first {rows} of {len(self.frame):,} rows"
        return replace(self, frame=self.frame.head(rows), caption=caption)

    def without_empty_columns(self) -> "ResultTable":
        """
        Return the table without the columns that are empty in all rows.

        Returns
        -------
        ResultTable
            The table itself if it has no rows.
        """
        frame = self.visible
        values = [str(name) for name in frame if (frame[name].notna() & (frame[name] != "")).any()]
        return replace(self, columns=values) if values else self

    def to_csv(self) -> str:
        """
        Return all columns with all digits as CSV.

        Returns
        -------
        str
        """
        return csv_text(self.frame)

    def to_latex(self) -> str:
        """
        Return the table for LaTeX and its package booktabs, with caption and label.

        Returns
        -------
        str
            The columns of `brief`; settings have their meaning instead of their key. Special
            characters are escaped, long texts wrap, and the label is ``tab:NAME``.
        """
        import pandas as pd

        # room is small: settings have their meaning first and no key
        names = [str(name) for name in self.brief or self.visible.columns]
        if {_KEY, _MEANING} <= set(names):
            names = [_MEANING, *(name for name in names if name not in (_KEY, _MEANING))]
        if names != [str(name) for name in self.visible.columns]:
            return replace(self, columns=names).to_latex()
        texts = pd.DataFrame(self.rows, columns=range(len(self.heads)), dtype=object).map(_latex)
        texts.columns = pd.Index([_latex_head(head) for head in self.heads])
        content = texts.to_latex(
            index=False,
            escape=False,
            column_format="".join(self._latex_columns()),
            caption=_latex(self.caption),
            label=f"tab:{self.name}",
            position="tb",
        )
        return str(content)

    def _latex_columns(self) -> list[str]:
        """
        Types of the columns in LaTeX.

        Numbers are aligned right. Columns of sentences share half of the line and wrap.
        """
        columns = zip(*self.rows, strict=True) if self.rows else repeat((), len(self.heads))
        longest = [max(map(len, column), default=0) for column in columns]
        sentences = [
            not head.numbers and n > _MAX_LINE for head, n in zip(self.heads, longest, strict=True)
        ]
        paragraph = f"p{{{0.5 / max(sum(sentences), 1):.2g}\\linewidth}}"
        return [
            "r" if head.numbers else paragraph if is_sentence else "l"
            for head, is_sentence in zip(self.heads, sentences, strict=True)
        ]

    def __str__(self) -> str:
        """Heads and cells in columns, as a terminal shows them."""
        import pandas as pd

        if not self.rows:
            return f"{'  '.join(head.text for head in self.heads)}\n(no rows)"
        texts = pd.DataFrame(
            [[plain_signs(text) for text in row] for row in self.rows],
            columns=[head.text for head in self.heads],
        )
        return str(texts.to_string(index=False))

    def __repr__(self) -> str:
        """Name and size."""
        rows, columns = self.frame.shape
        return f"<ResultTable {self.name}: {rows} row{'' if rows == 1 else 's'}, {columns} columns>"

    def _repr_html_(self) -> str:
        """HTML for a notebook: caption and cells, of a long table the first rows."""
        table = self.short().first(_NOTEBOOK_ROWS)
        cells = "".join(f"<th>{escape(head.text)}</th>" for head in table.heads)
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>"
            for row in table.rows
        )
        caption = f"<div>{escape(table.caption)}</div>" if table.caption else ""
        return f"{caption}<table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>"


def notebook_html(title: str, facts: Mapping[str, object], tables: Sequence[ResultTable]) -> str:
    """Title, facts by name and tables as HTML; long tables show their first rows."""
    words = " · ".join(f"{escape(name)}: {escape(str(value))}" for name, value in facts.items())
    bodies = "".join(table._repr_html_() for table in tables)
    return f"<div><strong>{escape(title)}</strong><br>{words}{bodies}</div>"


def heading(column: str) -> str:
    """Head of a column, its unit in brackets; a key of a configuration is unchanged."""
    if column in _HEADS:
        return _HEADS[column]
    if "." in column:
        return column
    for ending, (unit, _) in UNIT_ENDINGS.items():
        if column.endswith(ending):
            return f"{column.removesuffix(ending).replace('_', ' ')} [{unit}]"
    return column.replace("_", " ")


def _formats(table: "pd.DataFrame") -> list[str]:
    """
    Format of the measured numbers of each column.

    Columns in one unit have the same, if each number then shows a digit, and standard deviations
    have one of their own. Columns of whole numbers have no decimals.
    """
    columns = [str(column) for column in table.columns]
    units = [
        next((ending for ending in UNIT_ENDINGS if column.endswith(ending)), column)
        for column in columns
    ]
    units = [
        f"sigma {unit}" if column.startswith("sigma_") else unit
        for column, unit in zip(columns, units, strict=True)
    ]
    numbers = [
        _significant(measured_numbers(table.iloc[:, k].tolist()), column)
        for k, column in enumerate(columns)
    ]
    units = [
        column if (values == np.round(values)).all() else unit
        for column, unit, values in zip(columns, units, numbers, strict=True)
    ]
    by_unit: dict[str, list[Array]] = {}
    for unit, values in zip(units, numbers, strict=True):
        by_unit.setdefault(unit, []).append(values)
    formats = {unit: compact_format(np.concatenate(parts)) for unit, parts in by_unit.items()}
    return [
        _FORMATS.get(column) or formats[unit] or number_format(values)
        for column, unit, values in zip(columns, units, numbers, strict=True)
    ]


def _significant(numbers: Array, column: str) -> Array:
    """
    Numbers that determine a format.

    Lengths below a micrometre are left out, unless the column has no others.
    """
    sizes = np.abs(numbers)
    if not column.endswith("_m") or not (sizes >= _SMALLEST_LENGTH).any():
        return numbers
    significant: Array = numbers[(sizes >= _SMALLEST_LENGTH) | (sizes == 0.0)]
    return significant


def _latex_head(head: Head) -> str:
    """
    Head of a column in LaTeX; a long head of numbers has several lines.

    No line begins with the bracket of an option.
    """
    lines = wrap(head.text, _HEAD_LETTERS, break_long_words=False, break_on_hyphens=False)
    if len(lines) < 2 or not head.numbers:
        return _latex(head.text)
    return r"\shortstack[r]{" + r" \\{} ".join(map(_latex, lines)) + "}"


def _latex(text: str) -> str:
    """Text with escaped special characters of LaTeX."""
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    special |= {sign: f"\\{sign}" for sign in "&%$#_{}"}
    special |= {"<": "$<$", ">": "$>$", "\n": " "}
    special |= _LATEX_SIGNS
    latex = "".join(special.get(letter, letter) for letter in text)
    return _POWER_OF_TEN.sub(
        lambda match: rf"$\times 10^{{{'-' if match[1] != '+' else ''}{match[2]}}}$", latex
    )
