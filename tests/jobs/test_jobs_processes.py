"""
Tasks in processes: in order, stopped where one of them fails, and never longer than who asked for
them.
"""

import gc
import importlib
import logging
import os
import pickle
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pymantaray.errors import JobError
from pymantaray.jobs.processes import Workers


def square(number):
    time.sleep(0.1 * (number % 2))
    print("among the results?")
    return number**2, os.environ["OMP_NUM_THREADS"]


def fail_first_then_take_long(folder, number, *, fail=True):
    (folder / f"{os.getpid()}-{number}").touch()
    if number == 0 and fail:
        raise ValueError("the first one")
    time.sleep(60.0)


def die(number):
    os.kill(os.getpid(), signal.SIGKILL)


class UnsendableError(Exception):
    def __reduce__(self):
        raise TypeError("stays here")


def raise_unsendable(number):
    raise UnsendableError


def return_unsendable(number):
    return lambda: number


def task(function):
    return function


def in_processes(function, count, processes=2):
    with Workers(partial(task, function), processes) as workers:
        return [future.result() for future in [workers.submit(number) for number in range(count)]]


def gone(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def wait_for(condition, seconds=600.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_results_are_in_the_order_of_the_tasks_whoever_was_first():
    assert in_processes(square, 7) == [(n**2, "1") for n in range(7)]


def multiply(factor, offset):
    return partial(multiplied, factor, offset)


def multiplied(factor, offset, number):
    if number == 2:
        return die(number)
    return factor * number + offset


def test_every_process_gets_the_arguments_once():
    """Also one that replaces another."""
    with Workers(multiply, 1) as workers:
        workers.give(3.0, 1)
        futures = [workers.submit(number) for number in range(5)]
        with pytest.raises(JobError, match="ended early"):
            futures[2].result(timeout=60.0)
        results = [f.result(timeout=60.0) for f in (*futures[:2], *futures[3:])]
    assert results == [1.0, 4.0, 10.0, 13.0]


def test_a_task_that_fails_stops_the_others(tmp_path):
    with pytest.raises(ValueError, match="the first one") as caught:
        in_processes(partial(fail_first_then_take_long, tmp_path), 9)
    assert "in fail_first_then_take_long" in caught.value.__notes__[0]
    pids = [int(path.name.split("-")[0]) for path in tmp_path.iterdir()]
    assert len(pids) <= 3  # one each, and one that was taken meanwhile
    assert all(gone(pid) for pid in pids)


def test_a_process_that_is_killed_is_told_in_one_line():
    with pytest.raises(
        JobError, match="ended early, by SIGKILL, maybe out of memory; use fewer workers"
    ):
        in_processes(die, 3, 1)


def warn(number):
    logging.getLogger("pymantaray").warning("kernels cannot be kept")
    return number


def test_what_every_process_would_warn_of_is_left_to_who_started_them(capfd):
    assert in_processes(warn, 2, 1) == [0, 1]
    assert "kernels" not in capfd.readouterr().err


@pytest.mark.parametrize(("function", "error", "match"), [
    # the latter from Python 3.14 on
    (return_unsendable, (AttributeError, pickle.PicklingError), "local object"),
    (raise_unsendable, JobError, "ended early, with code 1"),
])  # fmt: skip
def test_what_cannot_be_sent_back_ends_the_work_and_not_the_patience(function, error, match):
    with pytest.raises(error, match=match):
        in_processes(function, 3, 1)


class Unimportable:
    """Something that a worker cannot import."""

    def __reduce__(self):
        return importlib.import_module, ("no_such_module",)


def test_an_import_error_of_a_worker_is_raised_by_the_caller(capfd):
    with (
        pytest.raises(ModuleNotFoundError, match="no_such_module"),
        Workers(Unimportable(), 1) as workers,
    ):
        workers.submit(1).result()
    assert capfd.readouterr().err == ""


SCRIPT = """
import sys; sys.path.insert(0, {here!r})
from functools import partial
from pathlib import Path
from test_jobs_processes import fail_first_then_take_long, in_processes, square
if {square}:
    print([n for n, _ in in_processes(square, 4, 1)])
else:
    in_processes(partial(fail_first_then_take_long, Path(sys.argv[1]), fail=False), 9)
"""
DAEMON = """
import multiprocessing, sys
def run(_):
    exec(open(sys.argv[1]).read())
if __name__ == "__main__":
    with multiprocessing.get_context("fork").Pool(1) as pool:
        pool.map(run, [0])
"""


@pytest.mark.parametrize(
    "how", [pytest.param("script", marks=pytest.mark.slow), "standard input", "daemonic process"]
)
def test_processes_work_whoever_starts_them_without_a_guard(tmp_path, how):
    script, daemon = tmp_path / "script.py", tmp_path / "daemon.py"
    script.write_text(SCRIPT.format(here=str(Path(__file__).parent), square=True))
    daemon.write_text(DAEMON)
    command = {"script": [script], "standard input": ["-"], "daemonic process": [daemon, script]}[
        how
    ]
    done = subprocess.run(
        [sys.executable, *command],
        input=script.read_text(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "[0, 1, 4, 9]\n", done.stderr


def test_processes_end_with_who_started_them_however_that_ends(tmp_path):
    script, out = tmp_path / "script.py", tmp_path / "out"
    out.mkdir()
    script.write_text(SCRIPT.format(here=str(Path(__file__).parent), square=False))
    process = subprocess.Popen([sys.executable, script, out])
    wait_for(lambda: len(list(out.iterdir())) >= 1)
    process.kill()
    process.wait()
    wait_for(lambda: all(gone(int(path.name.split("-")[0])) for path in out.iterdir()))


def hold(mebibytes):
    return np.ones(mebibytes * 2**17).size


def test_memory_is_that_of_the_largest_worker():
    """
    One mebibyte is 2**17 numbers of 8 bytes; a fresh interpreter without work has some tens of
    them.
    """
    here = np.ones(160 * 2**17)
    with Workers(partial(task, hold), 2) as workers:
        workers.submit(1).result()
        before = workers.peak_memory_mib
        workers.submit(60).result()
        assert 0.0 < before < 150.0
        assert 50.0 < workers.peak_memory_mib - before < 110.0
    assert here.nbytes == 160 * 2**20


def threshold(_number):
    return gc.get_threshold()[0]


def test_only_processes_of_ours_collect_garbage_rarely():
    """
    Processes of commands and workers, which collect none at their end; the process of a user keeps
    its own threshold.
    """
    code = """
import atexit, gc, sys
atexit.register(lambda: print(gc.get_freeze_count() > 10_000))
before = gc.get_threshold()[0]
import pymantaray.jobs.processes, pymantaray.acoustics.eigenrays
assert gc.get_threshold()[0] == before
sys.argv = ["mantaray", "--version"]
from pymantaray.__main__ import main
try:
    main()
except SystemExit:
    print(gc.get_threshold()[0])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.split()[-2:] == ["100000", "True"], done.stderr
    with Workers(partial(task, threshold), 1) as workers:
        assert workers.submit(0).result() == 100_000


def imported_from(_number):
    return [__import__(name).__file__ for name in ("struct", "pickle")] + [sys.path]


def test_processes_import_nothing_from_the_working_folder(tmp_path, monkeypatch):
    """
    Python puts the working folder first in the path of ``-c``: a pickle.py there would run before
    anything else.
    """
    for name in ("pickle", "struct", "pymantaray", "numpy"):
        (tmp_path / f"{name}.py").write_text(
            f"open({str(tmp_path / 'sprung')!r}, 'w'); raise SystemExit(3)\n"
        )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    (struct, pickled, path), *_ = in_processes(imported_from, 1, 1)
    assert not (tmp_path / "sprung").exists()
    assert str(tmp_path) not in (str(Path(struct).parent), str(Path(pickled).parent))
    assert path == sys.path


def test_processes_import_from_pythonpath(tmp_path):
    """
    A task in a module of a folder that PYTHONPATH names is found in processes, whose own path has
    it too.
    """
    (tmp_path / "task_of_mine.py").write_text(
        "def start():\n    return double\ndef double(n):\n    return 2 * n\n"
    )
    script = (
        "from task_of_mine import start; from pymantaray.jobs.processes import Workers\n"
        "with Workers(start, 1) as workers:\n    print(workers.submit(21).result())\n"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", script],
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == "42\n", done.stderr
