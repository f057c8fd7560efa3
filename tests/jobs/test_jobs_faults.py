"""
Whatever becomes of workers, runners and disks, no finished task is lost or done again, and none is
half written.
"""

import json
import subprocess
import sys
import time

import factories
import numpy as np
import pytest
import stub_tasks
from refusals import refused
from stub_tasks import Square, run_square, run_squares, squares_in

from pymantaray.errors import JobError, WriteError


def begin(count, seconds, out):
    command = [sys.executable, stub_tasks.__file__, str(count), str(seconds), out]
    return subprocess.Popen(command, stderr=subprocess.PIPE)


def test_workers_change_no_result_and_finished_tasks_are_skipped(tmp_path):
    tasks = [Square(n) for n in range(6)]
    assert run_squares(tasks[:2], tmp_path / "out", workers=1) == {0: None, 1: None}
    assert run_squares(tasks, tmp_path / "out", workers=2) == dict.fromkeys(range(2, 6))
    assert run_squares(tasks, tmp_path / "out", workers=1) == {}
    contents = squares_in(tmp_path / "out").values()
    assert sorted(json.loads(text)["square"] for text in contents) == [n**2 for n in range(6)]


def test_a_task_that_fails_is_a_result_and_the_others_go_on(tmp_path):
    lines = run_squares([Square(1), Square(-2), Square(3)], tmp_path / "out")
    assert lines == {1: None, -2: "ValueError: -2 is negative", 3: None}
    assert len(squares_in(tmp_path / "out")) == 3


def test_a_task_whose_worker_ends_has_three_attempts(tmp_path):
    lines = run_squares([Square(1), Square(2, deaths=9), Square(3, deaths=1)], tmp_path / "out")
    assert (lines[1], lines[3]) == (None, None)
    assert "by SIGKILL, maybe out of memory; use fewer workers (3 attempts)" in lines[2]
    assert len(list((tmp_path / "out" / "marks").glob("2-*"))) == 3


def test_a_worker_of_other_code_is_refused_in_one_line(tmp_path):
    line = (
        r"^this worker has pymantaray .*, but the task needs 99; install the same versions of it,"
        r" of Python and of numpy, scipy, .*$"
    )
    refused(JobError, line, run_square, str(tmp_path), Square(1, version="99"))


@pytest.mark.slow
def test_kill_minus_nine_at_any_moment_loses_nothing(tmp_path):
    out, rng, finished = tmp_path / "out", np.random.default_rng(7), {}
    for _ in range(4):
        process = begin(200, 0.02, out)
        while process.poll() is None and len(squares_in(out)) <= len(finished):
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.2))
        process.kill()
        process.communicate()
        there = squares_in(out)
        assert len(there) > len(finished)
        assert all(json.loads(content) for content in there.values())
        assert {name: there[name] for name in finished} == finished  # none lost, none done again
        finished = there
    assert begin(200, 0.0, out).communicate()[1] == b""
    begin(200, 0.0, tmp_path / "undisturbed").communicate()
    assert squares_in(out) == squares_in(tmp_path / "undisturbed")
    assert len(squares_in(out)) == 200


@pytest.mark.slow
def test_two_runners_of_one_store_lose_and_change_nothing(tmp_path):
    processes = [begin(60, 0.05, tmp_path / "out") for _ in range(2)]
    assert [process.communicate()[1] for process in processes] == [b"", b""]
    begin(60, 0.0, tmp_path / "alone").communicate()
    assert squares_in(tmp_path / "out") == squares_in(tmp_path / "alone")
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.slow
def test_a_full_or_read_only_disk_is_one_line_and_loses_nothing(tmp_path):
    disk = tmp_path / "disk"
    tasks = [Square(n, size=100_000) for n in range(8)]
    with factories.small_disk(disk, "512k") as remount:
        with pytest.raises(WriteError, match=r"No space left on device$"):
            run_squares(tasks, disk / "out")
        before = squares_in(disk / "out")
        assert 0 < len(before) < 8
        remount("size=8m")
        run_squares(tasks, disk / "out")
        after = squares_in(disk / "out")
        assert len(after) == 8
        assert {name: after[name] for name in before} == before
        remount("ro")
        with pytest.raises(WriteError, match=r"job.txt: cannot be written: Read-only file system$"):
            run_squares([*tasks, Square(9)], disk / "out")
        assert squares_in(disk / "out") == after
        assert not list(disk.rglob("*.part"))


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "squares").write_text("a file where a folder has to be")
    (out / "job.txt").write_text("")
    refused(WriteError, r"squares: cannot be written: ", run_squares, [Square(1)], out)


def test_workers_end_with_a_runner_that_is_killed(tmp_path):
    process = begin(1000, 0.05, tmp_path / "out")
    factories.wait_for(lambda: squares_in(tmp_path / "out"))
    process.kill()
    process.communicate()  # which waits for everybody who has its standard error
    assert len(squares_in(tmp_path / "out")) < 1000
