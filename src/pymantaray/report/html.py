"""Pieces of a page that stands alone: numbers, tables and figures as HTML, everything escaped."""

from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np
import pandas as pd

_UNITS = {"_m": " [m]", "_s": " [s]", "_h": " [h]", "_deg": " [deg]"}
_LONG = 40  # characters of a cell that may be broken
_WORDS = {
    "n": "N",
    "sd_m": "sd [m]",
    "rmse_m": "RMSE [m]",
    "p1_m": "1 % [m]",
    "p5_m": "5 % [m]",
    "p25_m": "25 % [m]",
    "p75_m": "75 % [m]",
    "p95_m": "95 % [m]",
    "p99_m": "99 % [m]",
    "percent": "dropouts [%]",
    "percent_beyond_3_sigma": "beyond 3 sigma [%]",
}


def document(title: str, body: Sequence[str]) -> str:
    """
    Whole page with its style inside; it loads nothing but its own figures.

    Parameters
    ----------
    title : str
        Plain text.
    body : sequence of str
        HTML.

    Returns
    -------
    str
    """
    style = files("pymantaray.report").joinpath("page.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def figure_html(name: str, caption: str) -> str:
    """
    Figure with its caption and a link to the PDF.

    Parameters
    ----------
    name : str
        File name in ``figures/`` without its ending.
    caption : str
        Plain text.

    Returns
    -------
    str
    """
    file, text = escape(f"figures/{name}"), escape(caption)
    return (
        f'<figure id="{escape(name)}">\n<a href="{file}.pdf"><img src="{file}.png" srcset="{file}.png 1.5x" alt="{text}" loading="lazy"></a>\n'
        f'<figcaption>{text} <a href="{file}.pdf">PDF</a></figcaption>\n</figure>'
    )


def table_html(table: pd.DataFrame, caption: str, file: str = "", *, folded: bool = False) -> str:
    """
    Table with its caption and a link to the CSV file.

    Parameters
    ----------
    table : pandas.DataFrame
        Shown without its index.
    caption : str
        Plain text.
    file : str
        Address of the CSV file; none if empty.
    folded : bool
        Show only the caption until it is clicked.

    Returns
    -------
    str
    """
    numeric = [pd.api.types.is_numeric_dtype(table[column]) for column in table.columns]
    marks = [' class="number"' if n else "" for n in numeric]
    head = "".join(
        f"<th{mark}>{escape(heading(str(c)))}</th>" for mark, c in zip(marks, table.columns, strict=True)
    )
    rows = "\n".join(
        "<tr>" + "".join(_cell(show(v), m) for m, v in zip(marks, row, strict=True)) + "</tr>"
        for row in table.astype(object).itertuples(index=False, name=None)
    )
    link = f' <a href="{escape(file)}">CSV</a>' if file else ""
    title = f"{escape(caption)}{link}"
    body = f"<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table></div>"
    if folded:
        return f'<details><summary>{title}</summary>\n<div class="wide"><table>\n{body}\n</details>'
    return f'<div class="wide"><table>\n<caption>{title}</caption>\n{body}'


def cards_html(cards: Sequence[tuple[str, str, str]]) -> str:
    """
    Row of headline numbers.

    Parameters
    ----------
    cards : sequence of tuple of str
        What it is, its value, and a remark, each plain text.

    Returns
    -------
    str
    """
    shown = "\n".join(
        f'<div class="card"><span>{escape(what)}</span><b>{escape(value)}</b><span>{escape(remark)}</span></div>'
        for what, value, remark in cards
    )
    return f'<div class="cards">\n{shown}\n</div>'


def heading(column: str) -> str:
    """
    Head of a column for people, its unit in brackets.

    Parameters
    ----------
    column : str
        Name in the CSV file.

    Returns
    -------
    str

    Examples
    --------
    >>> heading("pooled_difference_m")
    'pooled difference [m]'
    """
    if column in _WORDS:
        return _WORDS[column]
    for ending, unit in _UNITS.items():
        if column.endswith(ending):
            return column.removesuffix(ending).replace("_", " ") + unit
    return column.replace("_", " ")


def show(value: Any) -> str:
    """
    Value of a cell: four digits for a measured number, all of them for a count.

    Parameters
    ----------
    value : object

    Returns
    -------
    str
        A dash for a missing value.

    Examples
    --------
    >>> show(4620), show(-4.9213), show(float("nan")), show("A")
    ('4,620', '−4.921', '–', 'A')
    """
    if value is None:
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return f"{int(value):,}".replace("-", "−")
    if isinstance(value, float | np.floating):
        return _number(float(value))
    return str(value)


def readable(table: pd.DataFrame) -> pd.DataFrame:
    """
    Turn text that is a number into that number, so that it is shown as one.

    Parameters
    ----------
    table : pandas.DataFrame
        Such as a table of regions, whose columns mix numbers and text.

    Returns
    -------
    pandas.DataFrame
    """

    def number(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        for kind in (int, float):
            try:
                return kind(value)
            except ValueError:
                continue
        return value

    return table.astype(object).map(number)


def signed(value: float, unit: str, digits: int = 2) -> str:
    """
    Number with its sign and unit.

    Parameters
    ----------
    value : float
    unit : str
    digits : int
        After the point.

    Returns
    -------
    str
        A dash for a missing value.
    """
    if not np.isfinite(value):
        return "–"
    return f"{value:+.{digits}f} {unit}".replace("-", "−")


def _cell(text: str, mark: str) -> str:
    long = ' class="long"' if not mark and len(text) > _LONG else mark
    return f"<td{long}>{escape(text)}</td>"


def _number(value: float) -> str:
    if np.isnan(value):
        return "–"
    size = abs(value)
    if value == 0.0 or 1e-3 <= size < 1e4:
        text = f"{value:.4g}"
    elif 1e4 <= size < 1e7:
        text = f"{value:,.0f}"
    else:
        text = f"{value:.3e}"
    return text.replace("-", "−")
