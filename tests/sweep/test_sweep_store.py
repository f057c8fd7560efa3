"""Stores: files that are there whole or not at all, in folders and object stores."""

import os
import time

import factories
import pytest
from dask_cluster import client_here

from pymantaray.errors import SweepError, WriteError
from pymantaray.sweep import open_sweep, run_sweep
from pymantaray.sweep.store import finished, open_store, point_name


@pytest.fixture(params=["folder", "memory"])
def store(request, tmp_path):
    if request.param == "folder":
        return open_store(tmp_path / "store")
    pytest.importorskip("fsspec")
    return open_store(f"memory://{tmp_path}")


def test_what_is_written_is_read_counted_and_removed(store):
    assert store.read("a/b") is None
    assert store.names("points") == set()
    for key, failed in (("aa1", False), ("ab2", False), ("ab3", True)):
        store.write(point_name(key, failed=failed), key.encode())
    assert store.read("points/aa/aa1.json") == b"aa1"
    assert finished(store, ["aa1", "ab2", "ab3", "ac4"]) == ({"aa1", "ab2"}, {"ab3"})
    store.write("points/aa/aa1.json", b"again")
    assert store.read("points/aa/aa1.json") == b"again"
    store.remove("points/aa/aa1.json")
    store.remove("points/aa/aa1.json")
    assert not store.has("points/aa/aa1.json")
    assert store.has("points/ab/ab2.json")


def test_a_sweep_in_an_object_store_has_the_digits_of_one_in_a_folder(noises, summaries, tmp_path):
    pytest.importorskip("fsspec")
    place = f"memory://{tmp_path}/sweep"
    with client_here(1) as client:
        there = run_sweep(noises(2), place, client=client)
    assert there.status() == (2, 2, 0, {})
    assert summaries(open_sweep(place)) == summaries(run_sweep(noises(2), tmp_path / "here", workers=1))
    with pytest.raises(SweepError, match="studies need a folder"):
        run_sweep(noises(2), place, studies=True)


@pytest.mark.parametrize(
    ("url", "line"),
    [
        ("http://a/b", "http may show half a file"),
        ("s3://a/b", "cannot be opened: Install s3fs|cannot be opened"),
    ],
)
def test_a_place_that_cannot_hold_a_sweep_is_refused(url, line):
    pytest.importorskip("fsspec")
    with pytest.raises(SweepError, match=line):
        open_store(url)


def test_a_folder_of_something_else_is_left_alone(noises, tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(SweepError, match="holds something, and no sweep"):
        run_sweep(noises(1), tmp_path)
    with pytest.raises(SweepError, match="is a file; give a folder"):
        run_sweep(noises(1), tmp_path / "thesis.tex")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(SweepError, match=r"not a sweep: it has no sweep.toml"):
        open_sweep(tmp_path)


def test_what_a_killed_process_left_half_written_is_removed_when_it_is_old(tmp_path):
    store = open_store(tmp_path)
    for name, age in (("old", 7200.0), ("new", 0.0)):
        path = tmp_path / f".{name}.part"
        path.touch()
        os.utime(path, (time.time() - age,) * 2)
    store.claim("sweep", "sweep.toml", ())
    assert [path.name for path in tmp_path.iterdir()] == [".new.part"]


def test_a_damaged_result_is_told_by_its_name(here, noises, tmp_path):
    results = run_sweep(noises(1), tmp_path / "out")
    key = results.contents[0]["key"]
    (tmp_path / "out" / point_name(key)).write_text("{")
    with pytest.raises(SweepError, match=f"{key}.json: is damaged; remove it and run the sweep again"):
        open_sweep(tmp_path / "out").table()


def test_a_folder_that_cannot_be_written_ends_the_sweep_in_one_line(noises, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "points").write_text("a file where a folder has to be")
    (out / "sweep.toml").write_text("")
    with pytest.raises(WriteError, match=r"points/..: cannot be written: .*$") as caught:
        run_sweep(noises(2), out, workers=1)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_full_disk_or_one_that_is_read_only_ends_the_sweep_in_one_line_and_loses_nothing(noises, tmp_path):
    disk = tmp_path / "disk"
    with factories.small_disk(disk, "20m") as remount:
        filler = disk / "filler"
        filler.write_bytes(bytes(1 << 20))
        with pytest.raises(WriteError, match=r"No space left on device$"):
            run_sweep(noises(3), disk / "out", workers=1)
        filler.unlink()
        remount("size=64m")
        assert run_sweep(noises(3), disk / "out", workers=1).status() == (3, 3, 0, {})
        remount("ro")
        with pytest.raises(WriteError, match=r"sweep.toml: cannot be written: Read-only file system$"):
            run_sweep(noises(4), disk / "out", workers=1)
        assert open_sweep(disk / "out").status() == (3, 3, 0, {})
        assert not list(disk.rglob("*.part"))
