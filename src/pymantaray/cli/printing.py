"""What a command tells, for people as it comes or for scripts as one JSON object at the end; and how much is logged."""

import json
import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import isfinite, isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from pymantaray.installation import peak_memory_mib
from pymantaray.messages import without_secrets

if TYPE_CHECKING:
    import pandas as pd

LOG = logging.getLogger("pymantaray.cli")
_PREFIX = {"WARNING": "warning: ", "ERROR": "error: "}
_NAME = 30  # letters of what a row is called that have their room in a table
Columns = Mapping[str, tuple[str, str]]
"""Columns that people see: the name and the format of its numbers, empty for words, by heading."""


class Printer:
    """
    Standard output of a command: lines and tables for people, or all of it as one JSON object.

    People see chosen columns, rounded; scripts get every column with all digits, units in the names as in tables on disk.
    """

    def __init__(self, *, as_json: bool, quiet: bool) -> None:
        self._quiet = quiet or as_json
        self.values: dict[str, Any] | None = {} if as_json else None

    def line(self, text: str = "", **values: Any) -> None:
        """Print a line for people, and tell scripts the values in it."""
        if not self._quiet:
            typer.echo(without_secrets(text))
        self.add(**values)

    def add(self, **values: Any) -> None:
        """Tell scripts values that people see otherwise."""
        if self.values is not None:
            self.values |= values

    def table(self, name: str, table: "pd.DataFrame", columns: Columns, title: str = "") -> None:
        """Print columns of a table for people; scripts get all of it as a list of rows."""
        if not self._quiet:
            _print_table(title, table, columns)
        self.add(**{name: table})

    def warn(self, lines: list[str]) -> None:
        """Log warnings, which scripts find in the object too."""
        for line in lines:
            LOG.warning(line)
        self.add(warnings=lines)

    def paths(self, *paths: Path | str, **named: Path | str) -> None:
        """Print what was written, a line each: all that a quiet command prints."""
        lines = [without_secrets(path) for path in paths]
        by_name = {name: without_secrets(path) for name, path in named.items()}
        if self.values is None:
            for line in (*lines, *by_name.values()):
                typer.echo(line)
        else:
            self.values |= by_name | ({"files": lines} if lines else {})


@contextmanager
def printer(*, as_json: bool = False, quiet: bool = False) -> Iterator[Printer]:
    """What a command prints by; JSON comes out at the end of the block, of one that fails nothing does."""
    printed = Printer(as_json=as_json, quiet=quiet)
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
    """As JSON has it: tables as lists of rows, what is not a number as null."""
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


def _print_table(title: str, table: "pd.DataFrame", columns: Columns) -> None:
    from rich import box
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    records = [[(row[name], form) for name, form in columns.values()] for row in table.to_dict("records")]
    rows = [[escape("-" if form and isnan(x) else format(x, form)) for x, form in row] for row in records]
    shown = Table(title=escape(title) or None, title_justify="left", box=box.SIMPLE, pad_edge=False)
    for k, (heading, (_, form)) in enumerate(columns.items()):
        justify: Literal["left", "right"] = "right" if form else "left"
        named = k == 0 and max((len(row[0]) for row in rows), default=0) <= _NAME  # headings fold first
        shown.add_column(escape(heading), no_wrap=named, overflow="fold", justify=justify)
    for cells in rows:
        shown.add_row(*cells)
    Console().print(shown)


@contextmanager
def log_to_stderr(*, quiet: bool, verbose: int) -> Iterator[None]:
    """
    Log to standard error, a line a record: errors alone if quiet, else warnings too; once verbose stages and times, twice all.

    Twice also has the traceback of an error that is known, and what libraries log.
    """
    level = logging.ERROR if quiet else (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
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
        LOG.debug("what led to it:", exc_info=True)
        raise
    finally:
        for one, old in zip(loggers, before, strict=True):
            one.removeHandler(handler)
            one.setLevel(old)
        logging.captureWarnings(False)


class _Formatter(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        if record.name == "py.warnings":  # a file, its line, a class and the warning's words
            return (
                f"warning: {without_secrets(record.getMessage().partition('Warning: ')[2].splitlines()[0])}"
            )
        return _PREFIX.get(record.levelname, "") + without_secrets(super().format(record))
