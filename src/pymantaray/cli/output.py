"""Common parts of commands: checks of outputs before any work, standard streams, progress."""

import codecs
import errno
import io
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol, TextIO

import typer

from pymantaray.cli.printing import LOG
from pymantaray.errors import WriteError
from pymantaray.installation import peak_memory_mib
from pymantaray.jobs.progress import TaskProgress

STARTED = time.perf_counter() - time.process_time()
"""Start of this process on the clock of `time.perf_counter`; so far it has not waited. [s]"""
EXIT_KNOWN_ERROR = 2
EXIT_UNUSABLE = 1  # of a command that finished with a result that cannot be used


class Report(Protocol):
    """Functions that show progress."""

    def __call__(self, stage: str, done: int, total: int, failed: int = 0, /) -> None:
        """
        Show the name of a stage, the number of its finished parts, the total, and the number of
        failed parts.
        """


_LINE_INTERVAL = 60.0  # between lines if bars are not possible [s]


class _Stream(io.TextIOBase):
    """
    Standard output or error of commands, which replaces characters that the encoding lacks and
    reports failures in one line.

    It has no ``buffer``, so typer cannot bypass the encoding.
    """

    def __init__(self, stream: TextIO, *, fails: bool) -> None:
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="mantaray")
        self._stream = stream
        self._fails = fails

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
        """Discard all further text, and end the command if its output is lost."""
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
    """Bytes of a file name as on disk; a question mark for a character that the encoding lacks."""
    assert isinstance(error, UnicodeEncodeError)
    lost = error.object[error.start : error.end]
    return b"".join(os.fsencode(c) if "\udc80" <= c <= "\udcff" else b"?" for c in lost), error.end


@contextmanager
def standard_streams() -> Iterator[None]:
    """
    Replace the standard streams by streams whose failures do not end in a traceback.

    A closed pipe ends the command without a message, with the status that a shell uses; a full
    device ends it with one line. Text that cannot be written to standard error is lost, and the
    command continues.
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


class Watch:
    """
    State of a command: finished parts and remaining time of each stage, the next stages, and the
    peak memory.
    """

    def __init__(
        self, stages: Sequence[str] = (), clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.stages = stages
        self._clock = clock
        self._present = ""
        self._begun: dict[
            str, tuple[float, int]
        ] = {}  # time of the first report, and finished parts
        self._latest: dict[
            str, tuple[float, int, int, int]
        ] = {}  # time of the latest report; finished, failed and all parts

    def report(self, stage: str, done: int, total: int, failed: int = 0) -> None:
        """Record the number of finished parts of a stage, including failed ones."""
        now = self._clock()
        self._begun.setdefault(stage, (now, done))
        self._latest[stage] = now, done, failed, total
        self._present = stage

    def left(self, stage: str) -> str:
        """
        Text with the remaining time of a stage at its mean speed so far; empty before the first
        part is finished.
        """
        (begin, before), (latest, done, _, total) = self._begun[stage], self._latest[stage]
        if not before < done < total:
            return ""
        end = latest + (latest - begin) / (done - before) * (total - done)
        return f"{duration(max(end - self._clock(), 0.0))} left"

    def failed(self, stage: str) -> str:
        """Text with the number of failed parts of a stage; empty if none failed."""
        failed = self._latest[stage][2]
        return f"{failed} failed" if failed else ""

    def rest(self) -> str:
        """
        Text with the peak memory of this process and of its largest worker, and the next stages.
        """
        from pymantaray.jobs.processes import Workers

        words = f"memory {peak_memory_mib():.0f} MiB"
        if Workers.largest_mib:
            words += f", largest worker {Workers.largest_mib:.0f} MiB"
        after = (
            self.stages[self.stages.index(self._present) + 1 :]
            if self._present in self.stages
            else ()
        )
        return f"{words}; then {', '.join(after)}" if after else words

    def line(self) -> str:
        """Progress, memory and next stages in one line."""
        if not self._present:
            return self.rest()
        _, done, _, total = self._latest[self._present]
        words = f"{done} of {total}", self.failed(self._present), self.left(self._present)
        return f"{self._present}: {', '.join(filter(None, words))}; {self.rest()}"


@contextmanager
def progress_bars(*, quiet: bool, stages: Sequence[str] = ()) -> Iterator[Report | None]:
    """
    Show progress on standard error: a bar per stage in a terminal, otherwise a line per minute;
    None if ``quiet``.

    ``stages`` are the known stages in order.
    """
    if quiet or sys.stderr is None:
        yield None
        return
    watch = Watch(stages)
    with _bars(watch) if sys.stderr.isatty() else _lines(watch, sys.stderr) as report:
        yield report


@contextmanager
def _bars(watch: Watch) -> Iterator[Report]:
    from rich.console import Console, RenderableType
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        ProgressColumn,
        Task,
        TaskID,
        TextColumn,
        TimeElapsedColumn as Elapsed,
    )
    from rich.text import Text

    # a column of failures and remaining time, and a line below all bars
    class Left(ProgressColumn):
        def render(self, task: Task) -> Text:
            words = watch.failed(task.description), watch.left(task.description)
            return Text(", ".join(filter(None, words)))

    class Bars(Progress):
        def get_renderables(self) -> Iterable[RenderableType]:
            yield self.make_tasks_table(self.tasks)
            yield Text(watch.rest())

    # a bar for each stage, from its first report on
    columns = (
        TextColumn("{task.description:<14}"),
        BarColumn(),
        MofNCompleteColumn(),
        Elapsed(),
        Left(),
    )
    with Bars(*columns, console=Console(stderr=True)) as bars:
        tasks: dict[str, TaskID] = {}

        def report(stage: str, done: int, total: int, failed: int = 0) -> None:
            watch.report(stage, done, total, failed)
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=total)
            bars.update(tasks[stage], completed=done, total=total)

        yield report


@contextmanager
def _lines(watch: Watch, stream: TextIO) -> Iterator[Report]:
    """Print lines at regular intervals, and log the end of each stage."""
    over = threading.Event()
    start = time.perf_counter()

    def print_line() -> None:
        while not over.wait(_LINE_INTERVAL):
            print(watch.line(), file=stream, flush=True)

    def report(stage: str, done: int, total: int, failed: int = 0) -> None:
        watch.report(stage, done, total, failed)
        if done == total:
            LOG.info("%s: %d, after %.2f s", stage, total, time.perf_counter() - start)

    threading.Thread(target=print_line, daemon=True).start()
    try:
        yield report
    finally:
        over.set()


@contextmanager
def step_line(*, quiet: bool) -> Iterator[Callable[[int, float], None] | None]:
    """
    Show the last step and cost of a solve on standard error; None if ``quiet`` or without a
    terminal.
    """
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console

    with Console(stderr=True).status("solving") as status:
        yield lambda step, cost: status.update(f"step {step}, cost {cost:.6g}")


@contextmanager
def counted_progress(noun: str, *, quiet: bool) -> Iterator[TaskProgress | None]:
    """Show finished, failed and remaining points or blocks, as `progress_bars` does for stages."""
    with progress_bars(quiet=quiet) as report:
        if report is None:
            yield None
        else:
            yield lambda done, failed, total: report(noun, done + failed, total, failed)


@contextmanager
def resumable(resumes: Callable[[], str]) -> Iterator[None]:
    """Print how to resume on standard error if Ctrl-C or a stop request ends the block."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit):
        typer.echo(f"interrupted; {resumes()}", err=True)
        raise


def duration(seconds: float) -> str:
    """Duration as text, such as ``4.2 min``."""
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
    Raise an error, before any computation, if an output cannot or must not be written.

    ``beside`` are additional files of the output; even ``force`` does not overwrite ``inputs``.
    """
    if out.suffix not in endings:
        raise WriteError(f"{out}: the name of the output must end in {' or '.join(endings)}")
    if not out.parent.is_dir():
        raise WriteError(f"{out}: the folder {out.parent} does not exist; create it")
    sources = {os.path.realpath(path) for path in inputs}
    for path in (out, *beside):
        if os.path.realpath(path) in sources:
            raise WriteError(f"{path}: is the input; give another name")
        if Path(os.path.realpath(path)).is_symlink():
            raise WriteError(f"{path}: symbolic links form a circle; give another name")
        if path.is_dir() or (path.exists() and not force):
            raise WriteError(f"{path}: already exists; give another name or --force")


def write_new(file: Path, text: str) -> None:
    """Write a text to a new file."""
    try:
        with file.open("x", encoding="utf-8") as copy:
            copy.write(text)
    except FileExistsError:
        raise WriteError(f"{file}: already exists; give another name") from None
    except OSError as error:
        raise WriteError(f"{file}: cannot be written: {error.strerror}") from None
