"""What all commands do alike: outputs checked before any work, streams that cannot spoil finished work, progress."""

import codecs
import errno
import io
import logging
import os
import signal
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from pymantaray.cli.printing import LOG
from pymantaray.errors import WriteError

EXIT_KNOWN_ERROR = 2
Report = Callable[[str, int, int], None]
"""Told the name of a stage, how many of its parts are done, and how many there are."""
_LINE_EVERY = 60.0  # where no bar can be shown [s]


class _Stream(io.TextIOBase):
    """
    Standard output or error as commands see it: what its encoding lacks is replaced, what fails is told in one line.

    It has no ``buffer``, behind which typer would write by an encoding of its own.
    """

    def __init__(self, stream: TextIO, *, fails: bool) -> None:
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="mantaray")
        self._stream, self._fails = stream, fails

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._stream.encoding or "utf-8"

    @property
    def closed(self) -> bool:
        return self._stream.closed

    def isatty(self) -> bool:
        return not self._stream.closed and self._stream.isatty()

    def fileno(self) -> int:
        return self._stream.fileno()

    def write(self, text: str) -> int:
        try:
            self._stream.write(text)
        except OSError as error:
            self._lose(error)
        return len(text)

    def flush(self) -> None:
        try:
            if not self._stream.closed:
                self._stream.flush()
        except OSError as error:
            self._lose(error)

    def _lose(self, error: OSError) -> None:
        """Send what is still to come nowhere, and end the command where its output is lost."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)
        if not self._fails:
            return
        if error.errno == errno.EPIPE:
            raise SystemExit(128 + signal.SIGPIPE)
        print(f"error: standard output: cannot be written: {error.strerror}", file=sys.stderr)  # noqa: T201
        raise SystemExit(EXIT_KNOWN_ERROR)


def _substitute(error: UnicodeError) -> tuple[bytes, int]:
    """Bytes of a file's name as they are on disk; a question mark for a character that the encoding lacks."""
    assert isinstance(error, UnicodeEncodeError)
    lost = error.object[error.start : error.end]
    return b"".join(os.fsencode(c) if "\udc80" <= c <= "\udcff" else b"?" for c in lost), error.end


@contextmanager
def standard_streams() -> Iterator[None]:
    """
    Let nothing that is printed end in a traceback, whoever prints it.

    A pipe that nobody reads ends the command quietly, with the status that a shell gives it; a full device ends it in
    one line. What cannot be told on standard error is not told, and the work goes on.
    """
    codecs.register_error("mantaray", _substitute)
    before = sys.stdout, sys.stderr
    if isinstance(sys.stdout, _Stream):
        yield
        return
    sys.stdout, sys.stderr = (
        None if stream is None else _Stream(stream, fails=stream is sys.stdout) for stream in before
    )
    try:
        try:
            yield
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    finally:
        sys.stdout, sys.stderr = before


@contextmanager
def progress_bars(*, quiet: bool) -> Iterator[Report | None]:
    """
    What shows progress as bars on standard error, one a stage; None if ``quiet``.

    Where standard error is no terminal stages are logged as they end.
    """
    if quiet or sys.stderr is None:
        yield None
        return
    if not sys.stderr.isatty():
        yield _stages() if LOG.isEnabledFor(logging.INFO) else None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<14}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=total)
            progress.update(tasks[stage], completed=done, total=total)

        yield report


def _stages() -> Report:
    start = time.perf_counter()

    def report(stage: str, done: int, total: int) -> None:
        if done == total:
            LOG.info("%s: %d, after %.2f s", stage, total, time.perf_counter() - start)

    return report


@contextmanager
def step_line(*, quiet: bool) -> Iterator[Callable[[int, float], None] | None]:
    """What shows the last step of a solve and its cost on standard error; None if ``quiet`` or where that is no terminal."""
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status("solving") as status:
        yield lambda step, cost: status.update(f"step {step}, cost {cost:.6g}")


@contextmanager
def counted_progress(noun: str, *, quiet: bool) -> Iterator[Callable[[int, int, int], None] | None]:
    """A bar with points or blocks done, failed and left and the time left; a line a minute where standard error is no terminal."""
    if quiet or sys.stderr is None:
        yield None
        return
    if not sys.stderr.isatty():
        yield _lines(noun)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.progress import TimeRemainingColumn as Left

    columns = (
        TextColumn(noun),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]} failed"),
        TimeElapsedColumn(),
        Left(elapsed_when_finished=False),
        TextColumn("left"),
    )
    with Progress(*columns, console=Console(stderr=True), speed_estimate_period=3600.0) as bars:
        task = bars.add_task(noun, failed=0, total=None)
        yield lambda done, failed, total: bars.update(
            task, completed=done + failed, failed=failed, total=total
        )


def _lines(noun: str) -> Callable[[int, int, int], None]:
    start = latest = time.monotonic()
    first: list[int] = []

    def tell(done: int, failed: int, total: int) -> None:
        nonlocal latest
        now, first[:] = time.monotonic(), first or [done + failed]
        new = done + failed - first[0]
        if new and now - latest >= _LINE_EVERY:
            latest = now
            left = duration((now - start) / new * (total - done - failed))
            print(f"{done} done, {failed} failed of {total} {noun}; {left} left", file=sys.stderr)  # noqa: T201

    return tell


def duration(seconds: float) -> str:
    """A time in words, as ``4.2 min``."""
    for size, unit in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"


def check_output(
    out: Path,
    endings: Collection[str],
    *,
    inputs: Iterable[Path] = (),
    beside: Iterable[Path] = (),
    force: bool,
) -> None:
    """
    Refuse an output that cannot or must not be written, before anything is computed.

    ``beside`` are further files that are written along with it; ``inputs`` are not overwritten even by ``force``.
    """
    if out.suffix not in endings:
        raise WriteError(f"{out}: the output's name must end in {' or '.join(endings)}")
    if not out.parent.is_dir():
        raise WriteError(f"{out}: there is no folder {out.parent}; make it first")
    sources = {path.resolve() for path in inputs}
    for path in (out, *beside):
        if path.resolve() in sources:
            raise WriteError(f"{path}: is the input; give another name")
        if path.is_dir() or (path.exists() and not force):
            raise WriteError(f"{path}: exists already; give another name or --force")
