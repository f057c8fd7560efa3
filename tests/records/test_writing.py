"""
Files are written whole or not at all, under names that nobody else can hold; NetCDF from several
threads.
"""

import tempfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xarray as xr
from factories import python, small_disk
from refusals import files_of_at_most, refused

from pymantaray.errors import RecordError, WriteError
from pymantaray.records import NETCDF_LOCK, read_netcdf, whole_file, write_netcdf
from pymantaray.records.writing import netcdf_content

LIMIT = 100_000  # bytes; a file beyond it cannot be written
FULL = xr.Dataset({"noise": ("x", np.random.default_rng(0).standard_normal(LIMIT))})


@pytest.fixture
def small_files():
    """No file of more than LIMIT bytes can be written by this process."""
    with files_of_at_most(LIMIT):
        yield


def write_text(path, text="new", **options):
    with whole_file(path, **options) as temporary:
        temporary.write_text(text)


def test_a_file_appears_when_it_is_complete_with_usual_permissions(tmp_path):
    path = tmp_path / "a.txt"
    with whole_file(path) as temporary:
        temporary.write_text("new")
        assert not path.exists()
        assert temporary.parent == tmp_path
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]
    (tmp_path / "b.txt").touch()
    assert path.stat().st_mode == (tmp_path / "b.txt").stat().st_mode


def test_failure_inside_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def interrupted():
        with whole_file(path) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with pytest.raises(Exception, match=r"object|dtype|infer"):
        write_netcdf(xr.Dataset({"bad": ("x", np.array([object(), object()]))}), path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_two_writers_of_one_file_do_not_meet(tmp_path):
    path = tmp_path / "a.txt"
    with whole_file(path) as one, whole_file(path) as two:
        one.write_text("one")
        two.write_text("two")
        assert one.read_text() == "one"
    assert path.read_text() == "one"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["a.txt.part", "a.txt"])
def test_what_links_of_others_point_to_is_not_touched(name, tmp_path):
    """
    A temporary name that can be guessed, and the final one, which is replaced and not followed.
    """
    mine = tmp_path / "mine.txt"
    mine.write_text("mine")
    (tmp_path / name).symlink_to(mine)
    write_text(tmp_path / "a.txt")
    assert mine.read_text() == "mine"
    assert (tmp_path / name).is_symlink() == (name != "a.txt")


@pytest.mark.parametrize(
    "make", [lambda p: p.touch(), lambda p: p.symlink_to("nowhere")], ids=["file", "link"]
)
def test_a_file_that_is_there_is_refused_if_asked(make, tmp_path):
    make(tmp_path / "a.txt")
    refused(
        WriteError,
        r"a\.txt: already exists; give another name$",
        write_text,
        tmp_path / "a.txt",
        replace=False,
    )
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(("name", "message"), [
    ("absent/a.txt", r"a\.txt: cannot be written: No such file or directory$"),
    ("folder", "folder: cannot be written: not a regular file$"),
    ("/dev/null", "/dev/null: cannot be written: not a regular file$"),
    ("a\0b", "cannot be written: .*null"),
    ("n" * 300, "cannot be written: File name too long$"),
    ("n" * 255, None),
])  # fmt: skip
def test_names_that_cannot_be_written(name, message, tmp_path):
    (tmp_path / "folder").mkdir()
    if message is None:
        write_text(tmp_path / name)
        return
    refused(WriteError, message, write_text, tmp_path / name)
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]


@pytest.mark.usefixtures("small_files")
@pytest.mark.parametrize("write", [
    lambda path: write_text(path, "x" * 2 * LIMIT),
    lambda path: write_netcdf(FULL, path),
], ids=["text", "netcdf"])  # fmt: skip
def test_what_does_not_fit_is_one_line_with_name_and_cause(write, tmp_path):
    path = tmp_path / "a.nc"
    path.write_text("old")
    refused(WriteError, r"a\.nc: cannot be written: File too large$", write, path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_for_temporary_files_is_one_line(tmp_path, monkeypatch):
    """The NetCDF library calls it a lack of permission."""
    with small_disk(tmp_path, "64k"):
        (tmp_path / "filler").write_bytes(bytes(64 << 10))
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
        message = f"{tmp_path}/.*: cannot be written: No space left on device; .* set TMPDIR"
        refused(WriteError, message, netcdf_content, {"a": xr.Dataset({"x": ("x", np.zeros(9))})})


def test_netcdf_from_many_threads(tmp_path):
    """HDF5 is not thread-safe: without a lock this ends in HDF errors, or the process."""

    def there_and_back(number):
        path = tmp_path / f"{number}.nc"
        for _ in range(5):
            write_netcdf(xr.Dataset({f"v{i}": ("x", np.full(100, number)) for i in range(5)}), path)
            data = read_netcdf(path)
            assert all((data[f"v{i}"] == number).all() for i in range(5))

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(there_and_back, range(8)))


def test_a_file_is_open_only_while_no_other_thread_is_at_netcdf(tmp_path, monkeypatch):
    """Which threads meet is chance, and what comes of it; that they cannot is not."""

    def taken_by_another_thread():
        with ThreadPoolExecutor(1) as other:
            taken = other.submit(NETCDF_LOCK.acquire, blocking=False).result()
            return taken and other.submit(NETCDF_LOCK.release).result() is None

    seen = []

    def watched(name, function):
        def call(*arguments, **options):
            seen.append((name, taken_by_another_thread()))
            return function(*arguments, **options)

        return call

    write_netcdf(xr.Dataset({"v": ("x", np.arange(3))}), tmp_path / "a.nc")
    assert taken_by_another_thread()
    monkeypatch.setattr(xr, "open_dataset", watched("open", xr.open_dataset))
    for name in ("load", "close", "dump_to_store"):
        monkeypatch.setattr(xr.Dataset, name, watched(name, getattr(xr.Dataset, name)))
    write_netcdf(read_netcdf(tmp_path / "a.nc"), tmp_path / "b.nc")
    steps = "open", "load", "close", "load", "dump_to_store"
    assert seen == [(step, False) for step in steps]


def test_missing_file_is_one_line(tmp_path):
    with pytest.raises(RecordError, match=r"absent\.nc: no such file"):
        read_netcdf(tmp_path / "absent.nc")


STOPPED_WITHIN_A_LOCK = """
import os, signal
import numpy as np, xarray as xr
from xarray.backends.locks import CombinedLock
from pymantaray.cli.stopping import _raise
from pymantaray.records import read_netcdf, write_netcdf

signal.signal(signal.SIGTERM, _raise)
write_netcdf(xr.Dataset({"a": ("x", np.arange(3.0))}), "first.nc")
acquire = CombinedLock.acquire

def acquire_and_stop(lock, *options, **more):
    got = acquire(lock, *options, **more)
    CombinedLock.acquire = acquire  # once
    os.kill(os.getpid(), signal.SIGTERM)
    return got

for work in ("write", "read"):
    CombinedLock.acquire = acquire_and_stop
    try:
        if work == "write":
            write_netcdf(xr.Dataset({"a": ("x", np.arange(3.0))}), "second.nc")
        else:
            read_netcdf("first.nc")
    except SystemExit as stop:
        assert not [name for name in os.listdir() if name.endswith(".part")]
        assert float(read_netcdf("first.nc")["a"][2]) == 2.0  # no lock is left
        print(work, "stopped with", stop.code)
"""
FULL_DISK = """
from pymantaray.errors import WriteError
for name in "ab":
    try:
        noise = np.random.default_rng(0).standard_normal(100_000)
        write_netcdf(xr.Dataset({"noise": ("x", noise)}), f"full/{name}")
    except WriteError as error:
        print(error)
"""


def test_a_stop_request_and_a_full_disk_leave_no_lock_and_no_file(tmp_path):
    """In a process of its own: what HDF5 could not write stays open in it."""
    full = tmp_path / "full"
    with small_disk(full, "200k"):
        done = python(STOPPED_WITHIN_A_LOCK + FULL_DISK, cwd=tmp_path, timeout=120)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.splitlines() == [
            "write stopped with 143",
            "read stopped with 143",
            *(f"full/{name}: cannot be written: No space left on device" for name in "ab"),
        ]
        assert list(full.iterdir()) == []
    assert not (tmp_path / "second.nc").exists()
