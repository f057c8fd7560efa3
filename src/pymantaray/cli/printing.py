"""
Output of a command: text and tables for a terminal, or one JSON object for scripts, and its log
level. Messages name options instead of arguments of the library.
"""

import inspect
import json
import logging
import re
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer
from typer.models import OptionInfo

from pymantaray.installation import peak_memory_mib
from pymantaray.messages import printable, without_secrets

if TYPE_CHECKING:
    from pymantaray.records.result_table import Head, ResultTable

LOG = logging.getLogger("pymantaray.cli")
_PREFIX = {"WARNING": "warning: ", "ERROR": "error: "}
Form = Literal["text", "latex", "csv", "json"]
_NAME = 30  # characters of a row's name, or of a word, that a table shows in one line
_GAP = 3  # characters between columns, and at both ends of a line
_EDGE = 2
_BREAK = re.compile(r"(?<=\s)|(?<=[._])(?=[A-Za-z])")  # in a heading
_ARGUMENT = re.compile(r"`([a-z]\w*)(?:=([^`]*))?`")
_PARAMETERS = {
    "drift_sigma": "clock_drift_sigma",
    "ice_slope_deg": "ice_slope",
    "names": "name",
    "offset_sigma": "clock_offset_sigma",
    "overwrite": "force",
    "place": "position",
    "speed_model": "sound_speed",
    "thin_profile": "thin",
    "tolerance": "error",
    "total_s": "time_limit",
}
"""Parameters of commands for arguments with another name."""
_flags = dict[str, str]()


class Printer:
    """
    Standard output of a command: lines and tables as text, tables only as LaTeX or CSV, or
    everything as one JSON object.

    Text has rounded columns that fit a terminal; the other forms have all columns with all digits
    and units in their names.
    """

    def __init__(self, *, quiet: bool, to: Form = "text") -> None:
        self._to = to
        self._silent = quiet
        self._quiet = quiet or to != "text"
        self._noted: list[str] = []
        self.values: dict[str, Any] | None = {} if to == "json" else None

    def line(self, text: str = "", **values: Any) -> None:
        """Print a line of text; JSON has its values."""
        if not self._quiet:
            typer.echo(printable(without_secrets(text)))
        self.add(**values)

    def add(self, **values: Any) -> None:
        """Add values to JSON only."""
        if self.values is not None:
            self.values |= values

    def table(self, table: "ResultTable") -> None:
        """
        Print a table, shortened in text and complete in other forms; JSON has a list of rows by the
        table's name.
        """
        if self._to == "latex":
            typer.echo(table.to_latex())
        elif self._to == "csv":
            typer.echo(table.to_csv())
        elif not self._quiet:
            print_table(table.short())
        self.add(**{table.name: table.frame})

    def frame(self, name: str, rows: Any, caption: str = "", **options: Any) -> None:
        """Print a data frame, or a list of rows, as `table` does with a table."""
        from pandas import DataFrame

        from pymantaray.records.result_table import ResultTable

        self.table(ResultTable(name, DataFrame(rows), caption, **options))

    def warn(self, lines: list[str]) -> None:
        """Log warnings, and add them to JSON."""
        for line in lines:
            LOG.warning(line)
        self.add(warnings=[in_options(line) for line in lines])

    def notes(self, notes: Iterable[str]) -> None:
        """Print notes of readers to standard error, each once, and add them to JSON."""
        every = dict.fromkeys(printable(without_secrets(in_options(note))) for note in notes)
        lines = [line for line in every if line not in self._noted]
        self._noted += lines
        for line in () if self._silent else lines:
            typer.echo(line, err=True)
        if self.values is not None:
            self.values["notes"] = list(self._noted)

    def paths(self, *paths: Path | str, **named: Path | str) -> None:
        """
        Print the paths of written files, one per line, the only output of a quiet command; LaTeX
        and CSV omit them.
        """
        if self._to in ("latex", "csv"):
            return
        lines = [without_secrets(path) for path in paths]
        by_name = {name: without_secrets(path) for name, path in named.items()}
        if self.values is None:
            for line in (*lines, *by_name.values()):
                typer.echo(line)
        else:
            self.values |= by_name | ({"files": lines} if lines else {})


@contextmanager
def printer(*, as_json: bool = False, quiet: bool = False, to: Form = "text") -> Iterator[Printer]:
    """
    Return the printer of a command. JSON is printed at the end of the block, unless the command
    fails.

    ``as_json`` is short for ``to="json"``.
    """
    printed = Printer(quiet=quiet, to="json" if as_json else to)
    try:
        yield printed
    except typer.Exit:  # a status, not a failure
        _print_json(printed.values)
        raise
    _print_json(printed.values)


def _print_json(values: dict[str, Any] | None) -> None:
    if values is not None:
        typer.echo(json.dumps(_plain(values), indent=1, ensure_ascii=False, allow_nan=False))


def _plain(value: Any) -> Any:
    """Convert a value to JSON: tables become lists of rows, NaN becomes null."""
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if hasattr(value, "to_dict"):
        return _plain(value.to_dict("records"))
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    if hasattr(value, "tolist"):  # numpy's
        return _plain(value.tolist())
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if isfinite(value) else None
    return None if str(value) in ("NaT", "<NA>") else str(value)


@contextmanager
def log_to_stderr(*, quiet: bool, verbose: int) -> Iterator[None]:
    """
    Log to standard error, one line per record: errors only if quiet, otherwise also warnings; if
    verbose, stages and times.

    At level 2 all records are logged, including those of libraries and the traceback of a known
    error.
    """
    level = (
        logging.ERROR if quiet else (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    )
    handler = logging.StreamHandler()
    handler.setFormatter(_Formatter())
    loggers = [logging.getLogger("pymantaray"), logging.getLogger("py.warnings")]
    if verbose > 1:
        loggers = [logging.getLogger(), *loggers[:1]]
    before = [one.level for one in loggers]
    start = time.perf_counter()
    logging.captureWarnings(True)
    for one in loggers:
        one.setLevel(level)
    loggers[0].addHandler(handler)
    if verbose < 2:
        loggers[1].addHandler(handler)
    try:
        yield
        LOG.info("%.2f s, at most %.0f MiB", time.perf_counter() - start, peak_memory_mib())
    except (Exception, KeyboardInterrupt):
        LOG.debug("traceback:", exc_info=True)
        raise
    finally:
        for one, old in zip(loggers, before, strict=True):
            one.removeHandler(handler)
            one.setLevel(old)
        logging.captureWarnings(False)


class _Formatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        if record.name == "py.warnings":  # the text has file, line, class and message
            text = record.getMessage().partition("Warning: ")[2].splitlines()[0]
            return f"warning: {printable(without_secrets(in_options(text)))}"
        text = in_options(super().format(record))
        return _PREFIX.get(record.levelname, "") + printable(without_secrets(text))


def print_table(table: "ResultTable") -> None:
    """Print a table to standard output."""
    from rich.console import Console

    from pymantaray.records.digits import plain_signs

    console = Console()
    room = console.width - _EDGE
    rows = [[plain_signs(text) for text in row] for row in table.rows]
    columns = [[row[k] for row in rows] for k in range(len(table.heads))]
    least = [
        _least(head, cells, name=k == 0)
        for k, (head, cells) in enumerate(zip(table.heads, columns, strict=True))
    ]
    for number, block in enumerate(_blocks(least, room)):
        heads = [table.heads[k] for k in block]
        part = [columns[k] for k in block]
        widths = _widths([head.text for head in heads], [least[k] for k in block], room)
        caption = "" if number else table.caption
        from rich import box
        from rich.markup import escape
        from rich.table import Table

        shown = Table(
            title=escape(caption) or None, title_justify="left", box=box.SIMPLE, pad_edge=False
        )
        for head, width, column in zip(heads, widths, part, strict=True):
            text = escape("\n".join(_folded(head.text, width)))
            # rich crops other columns if it cannot make a whole one narrower
            shown.add_column(
                text,
                overflow="fold",
                justify="right" if head.numbers else "left",
                min_width=width,
                no_wrap=max(map(len, column), default=0) <= width,
            )
        for cells in zip(*part, strict=True):
            shown.add_row(*map(escape, cells))
        console.print(shown)


def _least(head: "Head", cells: Sequence[str], *, name: bool) -> int:
    """Smallest width of a column: numbers and short names of rows stay in one line."""
    whole = max(map(len, cells), default=0)
    if not (head.numbers or (name and whole <= _NAME)):
        whole = min(max((len(word) for cell in cells for word in cell.split()), default=0), _NAME)
    return max(whole, *(len(part.strip()) for part in _BREAK.split(head.text)))


def _blocks(least: Sequence[int], room: int) -> list[list[int]]:
    """Columns of each part of a table that fits the room; the first column is in all parts."""
    blocks: list[list[int]] = [[]]
    used = 0
    for k, width in enumerate(least):
        if blocks[-1] and used + _GAP + width > room and len(blocks[-1]) > min(len(blocks) - 1, 1):
            blocks.append([0] if k > 1 else [])
            used = least[0] if k > 1 else 0
        used += width + (_GAP if blocks[-1] else 0)
        blocks[-1].append(k)
    return blocks


def _folded(text: str, width: int) -> list[str]:
    """Lines of a heading in a width."""
    lines = [""]
    for part in _BREAK.split(text):
        if lines[-1] and len((lines[-1] + part).rstrip()) > width:
            lines.append("")
        lines[-1] += part
    return [line.rstrip() for line in lines]


def _widths(heads: Sequence[str], least: Sequence[int], room: int) -> list[int]:
    """Widths of columns; free room goes to the headings with most lines."""
    widths = list(least)
    for _ in range(room - sum(widths) - _GAP * (len(widths) - 1)):
        lines = [len(_folded(head, width)) for head, width in zip(heads, widths, strict=True)]
        if max(lines) == 1:
            break
        widths[lines.index(max(lines))] += 1
    return widths


def use_options_of(parameters: Iterable[inspect.Parameter]) -> None:
    """Write the options of a command with these parameters into the texts of `in_options`."""
    _flags.clear()
    for p in parameters:
        for mark in getattr(p.annotation, "__metadata__", ()):
            if isinstance(mark, OptionInfo):
                # typer's first argument may be a name
                words = (mark.default, *(mark.param_decls or ()))
                names = [word for word in words if isinstance(word, str) and word.startswith("--")]
                _flags[p.name] = (
                    names[0].partition("/")[0] if names else f"--{p.name.replace('_', '-')}"
                )


def in_options(text: str) -> str:
    """
    Text with options instead of arguments: ``--centre`` for ```centre```, ``--currents rest`` for
    ```currents='rest'```.

    Names that are no arguments of the running command stay as they are.
    """
    return _ARGUMENT.sub(_option, text)


def _option(match: "re.Match[str]") -> str:
    name, value = match.groups()
    flag = _flags.get(name) or _flags.get(_PARAMETERS.get(name, ""))
    if flag is None:
        return match[0]
    return flag if value in (None, "True") else f"{flag} " + value.strip("'\"")
