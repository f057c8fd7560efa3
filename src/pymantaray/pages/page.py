"""
Content of a page, in one record for all kinds of results, its layout by one template, its data for
scripts, and its files in a folder.
"""

import gzip
import json
import re
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib.resources import files
from os.path import relpath
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
import pandas as pd
from jinja2 import Environment, FunctionLoader, StrictUndefined, Template
from plotly.offline import get_plotlyjs

from pymantaray.jobs.folder import staged_folder, write_json
from pymantaray.jobs.progress import Progress
from pymantaray.pages.folder import PAGE, TABLES, write_files
from pymantaray.plotting import style
from pymantaray.plotting.drawing import FigureSpec, Picture, draw
from pymantaray.plotting.formats import FIGURES, checked_formats
from pymantaray.records import whole_file
from pymantaray.records.result_table import ResultTable, heading

_MAX_ROWS = 500  # of a table on a page
# folders of an absolute path, in quotes if they contain spaces; not of an address, which has ://
_ROOT = r"(?:file://)?(?:~|[A-Za-z]:)?[/\\]"
_FOLDERS = re.compile(
    rf"(?<![\w/\\.:~])(?:(?P<quote>['\"]){_ROOT}(?:[^'\"/\\]+[/\\])*(?=[^'\"]*(?P=quote))"
    rf"|{_ROOT}(?:[^\s'\",;/\\]+[/\\])*(?=[^\s'\",;/\\]))"
)
_NOT_FINITE = re.compile("NaN|-?Infinity")
_NUMBER_AND_UNIT = re.compile(r"(?<=\d) (?=(?:m|km|s|ms|h|dB|%)(?![\w]))|(?<=m) (?=± )|(?<=±) ")
_ROWS = 20_000  # rows in the plot, at equal spacing in the table


class Card(NamedTuple):
    """A number at the top of a page: its name, its value with unit, and a remark."""

    name: str
    value: str
    remark: str


class Explorer(NamedTuple):
    """
    An interactive part of a page: its kind, which names its template and its script, after the name
    of another package and ``/`` if that has them in its ``templates``, and its data as JSON.
    """

    kind: str
    data: str


@dataclass(frozen=True)
class Page:
    """Content of a page, from top to bottom; empty parts are left out."""

    title: str
    facts: Sequence[str] = ()  # soft lines below the title
    description: str = ""
    notes: Sequence[str] = ()  # what a reader must know before trusting the numbers
    cards: Sequence[Card] = ()
    words: Sequence[str] = ()  # explained terms
    first_tables: Sequence[ResultTable] = ()  # above everything else
    explorer: Explorer | None = None
    pictures: Sequence[Picture] = ()
    more_pictures: Mapping[str, Sequence[Picture]] | None = None  # folded, by their heading
    question: str = ""  # that the first three cards and the picture `lead` answer
    lead: str = ""
    long: bool = False  # the interactive part replaces figures and tables until they are unfolded
    tables: Sequence[ResultTable] = ()
    excerpts: Sequence[ResultTable] = ()  # parts of tables, which are not files of their own
    other_tables: Sequence[ResultTable] = ()  # files that the page does not show
    links: Mapping[str, str | Path] | None = None  # files by their names; `Path`: of another folder
    made: Sequence[str] = ()  # lines above the tables of `origin`
    origin: Sequence[ResultTable] = ()  # how the results were made
    citation: tuple[str, str] | None = None  # in words and as BibTeX
    cite: str = "Cite this run"
    references: Sequence[str] = ()

    @property
    def contents(self) -> dict[str, str]:
        """Headings of the sections by their names in addresses."""
        parts = {
            "answer": (self.question, "Summary"),
            "look": (self.explorer, "Explore"),
            "figures": ([p for p in self.pictures if p.name != self.lead], "Figures"),
            "tables": ([*self.tables, *self.excerpts], "Tables"),
            "origin": (self.origin, "Provenance"),
            "cite": (self.citation, self.cite),
        }
        return {name: words for name, (content, words) in parts.items() if content}

    def html(self) -> str:
        """
        Page as one HTML file that loads no other files; it links to its tables and figures. All
        text is escaped.
        """
        return page_template().render(page=self) + "\n"

    def linked_from(self, folder: Path) -> "Page":
        """Page whose links to other folders are relative to its own folder."""
        links = {
            words: quote(Path(relpath(file.resolve(), folder.resolve())).as_posix())
            if isinstance(file, Path)
            else file
            for words, file in (self.links or {}).items()
        }
        return replace(self, links=links)

    def files(self, formats: Sequence[str] = ()) -> dict[str, bytes]:
        """Files of a report by name: tables as CSV and optionally LaTeX, figures, and the page."""
        own = [*self.first_tables, *self.tables]
        content = {
            f"{TABLES}/{t.name}.csv": t.to_csv().encode() for t in (*own, *self.other_tables)
        }
        if "tex" in formats:
            content |= {f"{TABLES}/{t.name}.tex": t.to_latex().encode() for t in own}
        more = (picture for group in (self.more_pictures or {}).values() for picture in group)
        for picture in (*self.pictures, *more):
            content |= {
                f"{FIGURES}/{picture.name}.{kind}": file for kind, file in picture.files.items()
            }
        return content | {PAGE: self.html().encode()}

    def write(self, folder: str | Path) -> Path:
        """Write the page atomically into a folder with its tables and figures; return its path."""
        out = Path(folder) / PAGE
        with whole_file(out) as temporary:
            temporary.write_text(self.html(), encoding="utf-8")
        return out


@cache
def page_template() -> Template:
    """Compiled template of all pages."""
    environment = Environment(
        loader=FunctionLoader(_template_source),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["base64"] = lambda content: b64encode(content).decode()
    environment.filters["packed"] = packed
    environment.filters["public"] = without_folders
    # numbers stay in one line with their units and standard errors
    environment.filters["unbroken"] = lambda text: _NUMBER_AND_UNIT.sub("\u00a0", text)
    environment.filters["shown"] = lambda table: table.first(_MAX_ROWS).without_empty_columns()
    environment.globals["plotly"] = get_plotlyjs
    return environment.get_template("page.html")


def _template_source(name: str) -> str | None:
    """
    Text of a template of this package, or of another one, whose name and ``/`` are before it; None
    if there is none.
    """
    package, _, file = name.rpartition("/")
    source = files(package or "pymantaray.pages") / "templates" / file
    return source.read_text(encoding="utf-8") if source.is_file() else None


@lru_cache(maxsize=2)  # of a page, and plotly, which all pages share
def packed(text: str) -> str:
    """Text as the script of a page reads it, compressed."""
    return b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()


def origin_table(record: Any, caption: str, file: str) -> ResultTable:
    """Table of the entries of a JSON file with the origin of the results."""
    rows = pd.DataFrame(entries(record), columns=["entry", "value"])
    return ResultTable("origin", rows, caption, file=file)


def entries(content: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Each entry of nested dictionaries with the path to it."""
    if isinstance(content, dict) and content:
        for name, item in content.items():
            yield from entries(item, f"{path} / {name}" if path else str(name))
    elif isinstance(content, list) and any(isinstance(item, dict) for item in content):
        for number, item in enumerate(content, 1):
            yield from entries(item, f"{path} / {number}" if path else str(number))
    elif isinstance(content, list):
        texts = [_text(item) for item in content]
        yield path, ("\n" if any(", " in text for text in texts) else ", ").join(texts) or "none"
    else:
        yield path, "none" if content in (None, {}) else _text(content)


def _text(value: object) -> str:
    """Text of a value, without the rounding errors of computed floating-point numbers."""
    return str(float(f"{value:.12g}")) if isinstance(value, float) else str(value)


def without_folders(text: str) -> str:
    """
    Text whose local paths are names of files, since the folders are those of another machine.

    Addresses and relative paths do not change.
    """
    return _FOLDERS.sub(lambda match: match["quote"] or "", text)


def as_json(content: Any) -> str:
    """JSON that is safe inside a script of a page; numbers that are not finite become null."""
    return _json(content).replace("<", "\\u003c")


def _json(value: Any) -> str:
    """JSON of nested values and arrays; whole numbers have no decimals."""
    if isinstance(value, dict):
        return f"{{{','.join(f'{_json(key)}:{_json(item)}' for key, item in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{','.join(map(_json, value))}]"
    if not isinstance(value, np.ndarray | np.generic | float):
        return json.dumps(value)
    array = np.asarray(value)
    if array.dtype.kind != "f":
        return json.dumps(array.tolist(), separators=(",", ":"))
    text = json.dumps((array + 0.0).tolist(), separators=(",", ":"))  # without negative zeros
    text = text.replace(".0,", ",").replace(".0]", "]").removesuffix(".0")
    return text if np.isfinite(array).all() else _NOT_FINITE.sub("null", text)


def write_page(
    out: str | Path | None,
    name: str,
    specs: Sequence[FigureSpec],
    page_of: Callable[[Sequence[Picture], dict[str, Any]], Page],
    record: dict[str, Any],
    formats: Sequence[str],
    progress: Progress | None,
    others: Callable[[Path], object] = lambda _: None,
) -> Path:
    """
    Draw figures, and write them with their page and its tables into a new folder; return the page.

    A record of the origin becomes ``NAME.json``; ``others`` writes more files into a folder.
    """
    checked_formats(formats)
    with staged_folder(out, name, latest=False) as (stage, folder):
        pictures = draw(specs, formats=formats, progress=progress)
        write_files(stage, page_of(pictures, record).linked_from(folder).files(formats))
        others(stage)
        if record:
            write_json(record, stage / f"{name}.json")
    return folder / PAGE


def table_explorer(
    table: pd.DataFrame,
    up: Sequence[str],
    across: Sequence[str],
    each: Sequence[str],
    *,
    labels: Callable[[str], str] = heading,
    lines: bool = True,
) -> Explorer | None:
    """
    Interactive plot of a table; None if the table has no numbers for it.

    ``up`` are columns for the vertical axis, ``across`` columns for the horizontal axis, and
    ``each`` columns that can divide the rows into series; the first of ``each`` is the initial
    choice. ``labels`` gives the heading of a column.
    """
    up = [name for name in up if pd.to_numeric(table[name], errors="coerce").notna().any()]
    if not len(table) or not up or not across:
        return None
    if len(table) > _ROWS:
        table = table.iloc[np.unique(np.linspace(0, len(table) - 1, _ROWS).round().astype(int))]
    names = list(dict.fromkeys([*up, *across, *each]))
    conditions = list(table["condition"].unique()) if "condition" in table else []
    looks = style.condition_looks(conditions)  # as on all figures
    content = as_json(
        {
            "columns": {name: _values(table[name], number=name in up) for name in names},
            "labels": {name: labels(name) for name in names},
            "up": up,
            "across": list(across),
            "each": list(each),
            "first": each[0] if each else "",
            "lines": lines,
            "colours": style.vehicle_colours(11),
            "own": {name: colour for name, (colour, _) in looks.items()},
        }
    )
    return Explorer("table", content)


def _values(column: "pd.Series[Any]", *, number: bool) -> list[object]:
    """Numbers with six digits, other values as text."""
    values = pd.to_numeric(column, errors="coerce")
    if number or values.notna().all():
        return [float(f"{value:.6g}") for value in values]
    return ["" if value is None else str(value) for value in column]
