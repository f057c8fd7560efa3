"""Run folders: whole or not at all, wherever they are, and whoever else writes beside them."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from factories import names_in
from refusals import refused

from pymantaray.errors import JobError, WriteError
from pymantaray.jobs.folder import staged_folder
from pymantaray.jobs.run_folder import write_manifest

HOLD = """
import sys, time
from pymantaray.jobs.folder import staged_folder
with staged_folder(sys.argv[1] if len(sys.argv) > 1 else None, "quick") as (stage, folder):
    (stage / "manifest.json").write_text("{}")
    print(folder, flush=True)
    sys.stdin.read()
"""


def holding(*arguments):
    """Process that is writing a folder until its standard input ends."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    return process, process.stdout.readline().strip()


def write(out, name="quick", **options):
    with staged_folder(out, name, **options) as (stage, folder):
        (stage / "manifest.json").write_text("{}")
        (stage / "data").write_text("x")
    return folder


def assert_refused(out, match):
    refused(JobError, match, staged_folder(out).__enter__)


def test_folder_takes_its_name_only_at_the_end(tmp_path):
    out = tmp_path / "deep" / "run"
    with staged_folder(out) as (stage, folder):
        (stage / "data").write_text("x")
        assert folder == out
        assert not out.exists()
    assert (out / "data").read_text() == "x"
    assert names_in(out.parent) == ["run"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize("there", [False, True])
def test_nothing_is_left_behind_on_failure(tmp_path, error, there):
    (tmp_path / "run").mkdir() if there else None

    def fail():
        with staged_folder(tmp_path / "run" / ("" if there else "deep")) as (stage, _):
            (stage / "data").write_text("x")
            raise error

    with pytest.raises(error):
        fail()
    assert [path.name for path in tmp_path.rglob("*")] == ["run"] * there


@pytest.mark.parametrize("link", [False, True])
def test_empty_folder_is_filled_where_it_is_and_a_full_one_refused(tmp_path, link):
    """A mount point cannot be replaced either; it keeps its inode."""
    out, there = tmp_path / "run", tmp_path / "there"
    there.mkdir()
    out.symlink_to(there) if link else there.rename(out)
    inode = out.stat().st_ino
    write(out)
    assert names_in(out) == ["data", "manifest.json"]
    assert (out.stat().st_ino, out.is_symlink()) == (inode, link)
    assert_refused(out, "folder is not empty; give a new or empty folder")


def test_link_to_a_place_that_is_not_there_yet_is_followed(tmp_path):
    (tmp_path / "run").symlink_to(tmp_path / "there")
    write(tmp_path / "run")
    assert names_in(tmp_path / "there") == ["data", "manifest.json"]


@pytest.mark.parametrize(("name", "match"), [
    ("file", "file: is a file"),
    ("file/below", "cannot be written: (Not a directory|File exists)"),
    (os.fsdecode(b"\xff"), r"not a name in UTF-8; select another folder with `out`"),
    ("a\0b", "cannot be written: .*null"),
    ("x" * 300, "cannot be written: File name too long"),
], ids=["file", "below a file", "not UTF-8", "null", "long"])  # fmt: skip
def test_what_cannot_be_written_is_refused_before_the_work(tmp_path, name, match):
    (tmp_path / "file").write_text("mine")
    assert_refused(f"{tmp_path}/{name}", match)
    assert names_in(tmp_path) == ["file"]


def test_a_taken_place_or_removed_folder_is_one_line(tmp_path):
    with (
        pytest.raises(JobError, match="run: cannot be written: Directory not empty; select"),
        staged_folder(tmp_path / "run"),
    ):
        (tmp_path / "run" / "mine").mkdir(parents=True)
    assert names_in(tmp_path / "run") == ["mine"]

    def remove():
        with staged_folder(tmp_path / "other") as (stage, _):
            stage.rmdir()
            (stage / "data").write_text("x")

    refused(JobError, r"\.other\.mantaray-part: this folder was removed", remove)


def test_dated_names_differ_and_latest_is_the_newest(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    process, first = holding()
    second = write(None)
    assert (tmp_path / "runs" / "latest").resolve() == second.resolve()
    assert str(second) != first
    write(None, "comparison", latest=False)
    assert (tmp_path / "runs" / "latest").resolve() == second.resolve()
    process.communicate()
    assert (tmp_path / "runs" / "latest").resolve() == (tmp_path / first).resolve()
    assert all(
        re.fullmatch(r"/.*/runs/quick-\d{8}-\d{6}(-\d+)?", str(path)) for path in (first, second)
    )
    assert len(names_in(tmp_path / "runs")) == 4


@pytest.mark.parametrize("there", [False, True])
def test_stages_of_killed_processes_are_removed_and_others_kept(tmp_path, there):
    out = tmp_path / "run"
    out.mkdir() if there else None
    process, _ = holding(out)
    assert_refused(out, "run: another process writes here")
    write(tmp_path / "beside")
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert any(path.name == ".run.mantaray-part" for path in tmp_path.rglob("*"))
    write(out)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["beside", "run"]
    assert names_in(out) == ["data", "manifest.json"]


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="no file that cannot be read")
def test_a_file_that_cannot_be_read_back_gives_no_manifest(tmp_path):
    (tmp_path / "truth.nc").symlink_to("/proc/self/mem")
    refused(WriteError, r"cannot be read back: Input/output error", write_manifest, {}, tmp_path)
    assert names_in(tmp_path) == ["truth.nc"]
