"""
What is printed never spoils what was done: encodings, closed pipes, full devices; outputs are
checked beforehand.
"""

import errno
import io
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from time import perf_counter

import pandas as pd
import pytest

from pymantaray.cli import output
from pymantaray.cli.main import main
from pymantaray.cli.output import (
    Watch,
    check_output,
    counted_progress,
    progress_bars,
    standard_streams,
)
from pymantaray.cli.printing import printer
from pymantaray.errors import WriteError
from pymantaray.jobs.processes import Workers
from pymantaray.records.result_table import ResultTable

MAIN = [sys.executable, "-c", "from pymantaray.cli.main import main; main()"]


@pytest.mark.parametrize(
    ("encoding", "shown"),
    [("ascii", b"n??\xff"), ("latin-1", b"n\xf6?\xff"), ("utf-8", "nö−".encode() + b"\xff")],
)
def test_characters_that_the_encoding_lacks_are_replaced(encoding, shown):
    """By typer and by rich, on both streams; a byte of a file's name stays that byte."""
    code = (
        "import sys, typer\nfrom rich.console import Console\nfrom pymantaray.cli.output import"
        " standard_streams\n"
        "with standard_streams():\n"
        "    typer.echo(sys.argv[1])\n    typer.echo(sys.argv[1], err=True)\n   "
        " Console().print(sys.argv[1])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, os.fsdecode("nö−".encode() + b"\xff")],
        check=False,
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": encoding},
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, 2 * (shown + b"\n"), shown + b"\n")


def test_a_pipe_that_nobody_reads_ends_the_command_quietly():
    ours, theirs = os.pipe()
    os.close(ours)
    done = subprocess.run(
        [*MAIN, "study", "list"], stdout=theirs, stderr=subprocess.PIPE, check=False
    )
    os.close(theirs)
    assert (done.returncode, done.stderr) == (128 + signal.SIGPIPE, b"")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_full_standard_output_is_one_line():
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = subprocess.run(
            [*MAIN, "study", "list"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
        assert done.stderr == "error: standard output: cannot be written: No space left on device\n"
        assert done.returncode == 2
        silent = subprocess.run(
            [*MAIN, "study", "run", "nosuch"], stdout=full, stderr=full, check=False
        )
        assert silent.returncode == 2


class FullTerminal(io.StringIO):
    """A terminal on which nothing more fits."""

    def isatty(self):
        return True

    def fileno(self):
        return self.nowhere.fileno()

    def write(self, _text):
        raise OSError(errno.ENOSPC, "No space left on device")

    flush = write


def test_progress_that_cannot_be_shown_does_not_stop_the_work(monkeypatch, tmp_path):
    terminal = FullTerminal()
    terminal.nowhere = (tmp_path / "terminal").open("w")
    monkeypatch.setattr(sys, "stderr", terminal)
    terminal.flush = lambda: terminal.write("")
    done = 0
    with standard_streams(), progress_bars(quiet=False) as report:
        for done in range(1, 4):
            report("report", done, 3)
    assert done == 3
    assert sys.stderr is terminal
    terminal.flush = lambda: None  # which the end of the stream that wraps it calls
    terminal.nowhere.close()


def test_progress_says_what_runs_what_is_left_and_the_memory(monkeypatch):
    """
    Time left: at the mean pace since the stage began, less what has passed since its latest part.
    """
    now = 100.0
    watch = Watch(("rays", "realizations", "report"), lambda: now)
    monkeypatch.setattr(output, "peak_memory_mib", lambda: 512.3)
    monkeypatch.setattr(Workers, "largest_mib", 0.0)
    assert watch.line() == "memory 512 MiB"
    watch.report("rays", 0, 4)
    assert watch.line() == "rays: 0 of 4; memory 512 MiB; then realizations, report"
    watch.report("realizations", 10, 30)  # of which ten are there from a run that was interrupted
    now += 60.0
    watch.report("realizations", 12, 30, 1)
    monkeypatch.setattr(Workers, "largest_mib", 200.0)
    memory = "memory 512 MiB, largest worker 200 MiB; then report"
    assert watch.line() == f"realizations: 12 of 30, 1 failed, 9 min left; {memory}"
    now += 8.0 * 60.0
    assert watch.left("realizations") == "60 s left"
    now += 300.0  # longer than was thought
    assert watch.left("realizations") == "0 s left"
    watch.report("realizations", 30, 30)
    assert watch.left("realizations") == ""
    watch.report("report", 0, 1)
    assert watch.line() == "report: 0 of 1; memory 512 MiB, largest worker 200 MiB"


@pytest.mark.skipif(sys.platform != "linux", reason="other clocks may begin with a process")
def test_a_process_started_before_its_imports():
    command = "from time import *\nwhile process_time() < 0.3: pass\n"
    command += "from pymantaray.cli.output import STARTED as s; "
    command += "print(s, perf_counter() - s - process_time())"
    before = perf_counter()
    done = subprocess.run([sys.executable, "-c", command], capture_output=True, check=True)
    started, waited = map(float, done.stdout.split())
    assert before - 0.1 < started < perf_counter() - 0.3
    assert waited > -0.01  # since the clocks were read


class Screen(io.StringIO):
    """Standard error that keeps what it gets, and says when it has a line of a stage."""

    def __init__(self, *, terminal):
        super().__init__()
        self.terminal, self.told = terminal, threading.Event()

    def isatty(self):
        return self.terminal

    def write(self, text):
        count = super().write(text)
        if "ocean: 0 of 1; memory " in text:
            self.told.set()
        return count


def test_without_a_terminal_lines_come_while_one_part_takes_long(monkeypatch):
    screen = Screen(terminal=False)
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr(output, "_LINE_INTERVAL", 1e-3)
    with progress_bars(quiet=False, stages=("ocean", "rays")) as report:
        report("ocean", 0, 1)
        assert screen.told.wait(60.0)
    assert screen.getvalue().splitlines()[-1].endswith(" MiB; then rays")


def test_bars_of_a_terminal_have_the_same_words(monkeypatch):
    screen = Screen(terminal=True)
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with counted_progress("points", quiet=False) as report:
        report(1, 2, 5)
    shown = screen.getvalue()
    assert "3/5" in shown
    assert "2 failed" in shown
    assert "memory " in shown


@pytest.mark.parametrize("terminal", [True, False])
def test_quiet_shows_no_progress(monkeypatch, terminal):
    screen = Screen(terminal=terminal)
    monkeypatch.setattr(sys, "stderr", screen)
    with progress_bars(quiet=True) as report, counted_progress("points", quiet=True) as counted:
        assert (report, counted) == (None, None)
    assert screen.getvalue() == ""


def test_a_closed_stream_is_no_terminal_and_ends_nothing(monkeypatch):
    """As libraries ask for at the end of the interpreter."""
    stream = io.TextIOWrapper(io.BytesIO())
    monkeypatch.setattr(sys, "stdout", stream)
    with standard_streams():
        stream.close()
        assert not sys.stdout.isatty()


def test_main_runs_in_a_thread_and_leaves_its_signals_alone(capsys):
    before, codes = signal.getsignal(signal.SIGTERM), []

    def run():
        try:
            main(["study", "list"])
        except SystemExit as end:
            codes.append(end.code)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert codes == [0]
    assert "quick" in capsys.readouterr().out
    assert signal.getsignal(signal.SIGTERM) is before


def test_outputs_are_refused_before_any_work(tmp_path):
    (tmp_path / "in.csv").write_text("x")
    (tmp_path / "link.csv").symlink_to("in.csv")
    (tmp_path / "folder.csv").mkdir()
    for name, options, said in (
        ("out.txt", {}, "must end in .csv or .nc"),
        ("no/out.csv", {}, "the folder .*no does not exist; create it"),
        ("in.csv", {}, "in.csv: already exists; give another name or --force"),
        ("folder.csv", {"force": True}, "folder.csv: already exists"),
        ("link.csv", {"force": True, "inputs": [tmp_path / "in.csv"]}, "link.csv: is the input"),
        ("new.csv", {"beside": [tmp_path / "in.csv"]}, "in.csv: already exists"),
    ):
        with pytest.raises(WriteError, match=said):
            check_output(tmp_path / name, [".csv", ".nc"], **{"force": False, **options})
    check_output(tmp_path / "new.csv", [".csv"], force=False)
    check_output(tmp_path / "in.csv", [".csv"], force=True)


@pytest.mark.parametrize("width", [80, 100])
def test_names_of_rows_and_numbers_stay_in_one_line_and_headings_fold(width, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    names = ["straight", "off-by-1-honest", "clock-and-ocean-together"]
    columns = ("rmse_m", "median_m", "from_straight_rmse_m", "bound_rmse_m")
    with printer() as out:
        out.table(
            ResultTable(
                "errors", pd.DataFrame({"condition": names} | dict.fromkeys(columns, 1234.56))
            )
        )
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= width
    assert [line.split() for line in lines if "1,234.56" in line] == [
        [name, *["1,234.56"] * 4] for name in names
    ]


@pytest.mark.parametrize("width", [60, 80])
def test_no_cell_is_cropped_beside_a_long_name(width, capsys, monkeypatch):
    """ "5 to 1000 m" must not become "5 to 10"."""
    monkeypatch.setenv("COLUMNS", str(width))
    row = ["BATS/1 2019-03-01T10:00:00", "2019-03-01 10:00 UTC", "31.7 N, 64.2 W", "4, 5 to 1000 m"]
    heads = ("profile", "time", "position", "levels")
    with printer() as out:
        out.frame("profiles", [dict(zip(heads, row, strict=True))] * 2)
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= width
    for word in " ".join(row).split():
        assert shown.split().count(word) >= 2, word


def test_headings_break_between_words_and_wide_tables_continue_below(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    keys = ["landmarks.T.depth", "fleet.vehicles.A.depth", "noise.range_sigma"]
    values = [f"value_{k}_m" for k in range(9)]
    frame = pd.DataFrame(
        {name: [1.0, 1234.56] for name in (*keys, *values)} | {"front": ["yes", "no"]}
    )
    with printer() as out:
        out.table(ResultTable("designs", frame, "Designs"))
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80
    words = shown.split()
    for part in (
        "landmarks.",
        "T.depth",
        "vehicles.",
        "A.depth",
        "noise.",
        "range_",
        "sigma",
        "front",
    ):
        assert part in words
    assert shown.count("1,234.56") >= len(keys) + len(values)
    assert words.count("Designs") == 1


def test_latex_and_csv_are_the_complete_tables_alone(capsys, tmp_path):
    table = ResultTable("errors", pd.DataFrame({"condition": ["a_b"], "rmse_m": [1.25]}), "Errors")

    def printed(**how):
        with printer(**how) as out:
            out.line("for people")
            out.table(table)
            out.paths(folder=tmp_path)
        return capsys.readouterr().out

    assert printed(to="latex") == printed(to="latex", quiet=True) == f"{table.to_latex()}\n"
    assert printed(to="csv") == f"{table.to_csv()}\n"
    assert printed(quiet=True) == f"{tmp_path}\n"
    assert printed(to="json") == printed(as_json=True)
    assert printed().splitlines()[0] == "for people"


@pytest.mark.parametrize("stop", [KeyboardInterrupt, SystemExit(143)])
def test_a_command_that_is_stopped_says_how_to_resume(capsys, stop):
    with pytest.raises(BaseException) as stopped, output.resumable(lambda: "it resumes"):
        raise stop
    assert stopped.type is (stop if isinstance(stop, type) else type(stop))
    assert capsys.readouterr().err == "interrupted; it resumes\n"


def test_a_command_that_ends_or_fails_says_nothing_about_resuming(capsys):
    with output.resumable(lambda: "it resumes"):
        pass
    with pytest.raises(ValueError, match="wrong"), output.resumable(lambda: "it resumes"):
        raise ValueError("wrong")
    assert capsys.readouterr().err == ""
