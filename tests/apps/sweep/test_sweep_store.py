"""Stores: files that are there whole or not at all, in folders and object stores."""

import json
import os
import shutil
import time
from pathlib import Path

import factories
import pandas as pd
import pytest
from dask_cluster import client_here
from refusals import refused

from pymantaray.apps.sweep import open_sweep, run_sweep, stages
from pymantaray.apps.sweep.keys import STAGES, finished, point_content, point_name, stage_name
from pymantaray.apps.sweep.plan import SweepPlan
from pymantaray.apps.sweep.stages import Stages
from pymantaray.config.door.study import build_study
from pymantaray.errors import JobError, SweepError
from pymantaray.installation import code_version
from pymantaray.jobs.store import failure_content, open_store
from pymantaray.pages.page import Page
from pymantaray.records.writing import netcdf_groups


@pytest.fixture(scope="module")
def finished_sweep(noises, tmp_path_factory):
    """Folder of a sweep of two points with its stages; not to be written to."""
    folder = tmp_path_factory.mktemp("finished") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pymantaray.apps.sweep.runner.open_pool", factories.pool_here)
        run_sweep(noises(2), folder, keep_stages=True)
    return folder


@pytest.fixture
def results(finished_sweep, tmp_path):
    """The same in a folder `out` of a test's own."""
    shutil.copytree(finished_sweep, tmp_path / "out")
    return open_sweep(tmp_path / "out")


@pytest.fixture(params=["folder", "memory"])
def store(request, tmp_path):
    if request.param == "folder":
        return open_store(tmp_path / "store")
    pytest.importorskip("fsspec")
    return open_store(f"memory://{tmp_path}")


def test_what_is_written_is_read_counted_and_removed(store):
    assert store.read("a/b") is None
    assert store.names("points") == set()
    for key in ("aa1", "ab2"):
        content = {"key": key, "version": "1", "notes": []}
        content |= {"conditions": {}, "links": {}, "seconds": {}}
        store.write(point_name(key), point_content(content))
    store.write(point_name("ab3", failed=True), b'{"error": "why"}')
    assert json.loads(store.read("points/aa/aa1.json"))["key"] == "aa1"
    assert finished(store, ["aa1", "ab2", "ab3", "ac4"]) == ({"aa1", "ab2"}, {"ab3"})
    store.write("points/aa/aa1.json", b"again")
    assert store.read("points/aa/aa1.json") == b"again"
    store.remove("points/aa/aa1.json")
    store.remove("points/aa/aa1.json")
    assert not store.has("points/aa/aa1.json")
    assert store.has("points/ab/ab2.json")


def test_the_table_and_the_page_of_a_sweep_are_collected(
    results, mantaray, tmp_path, monkeypatch, as_stored
):
    pages = []
    monkeypatch.setattr(Page, "write", lambda page, to: pages.append(page) or Path(to, "page"))
    out = tmp_path / "out"
    done = mantaray("sweep", "collect", out)
    assert done.out.split() == [str(out / name) for name in ("table.csv", "table.nc", "page")]
    (page,) = pages
    assert page.title == f"Sweep over {results.sweep.name}"
    assert [len(table.frame) for table in page.tables] == [len(results.table())]
    assert page.explorer is not None
    columns = ["point", "noise.range_sigma", "condition", "rmse_m"]
    table = pd.read_csv(out / "table.csv")[columns]
    as_stored({"facts": page.facts, "notes": page.notes, "table": table})
    as_stored(out / "table.nc", without="^(?!rmse_m|attempts|attrs)", name="dataset")


def test_a_sweep_in_an_object_store_has_the_digits_of_one_in_a_folder(
    noises, results, summaries, tmp_path
):
    pytest.importorskip("fsspec")
    place = f"memory://{tmp_path}/sweep"
    with client_here(1) as client:
        there = run_sweep(noises(2), place, client=client)
        assert client.status == "running"  # it is its owner's
    assert there.status() == (2, 2, 0, {})
    assert summaries(open_sweep(place)) == summaries(results)
    with pytest.raises(
        SweepError, match="run folders of studies cannot be written to a URL; give a folder"
    ):
        run_sweep(noises(2), place, studies=True)


@pytest.mark.parametrize(
    ("url", "line"),
    [
        ("http://a/b", "http does not write files atomically"),
        ("s3://a/b", "cannot be opened: Install s3fs|cannot be opened"),
    ],
)
def test_a_place_that_cannot_hold_a_sweep_is_refused(url, line):
    pytest.importorskip("fsspec")
    with pytest.raises(JobError, match=line):
        open_store(url)


def test_a_folder_of_something_else_is_left_alone(noises, tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(JobError, match="this folder is not empty and has no sweep"):
        run_sweep(noises(1), tmp_path)
    with pytest.raises(JobError, match="is a file; give a folder"):
        run_sweep(noises(1), tmp_path / "thesis.tex")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(SweepError, match=r"not a sweep: it has no sweep.toml"):
        open_sweep(tmp_path)


def test_old_partial_files_are_removed_and_user_files_stay(
    tmp_path,
):
    store = open_store(tmp_path)
    ours = (f".{'0' * 50}.{'1' * 16}.part", f".sweep.toml.{'1' * 16}.part")
    theirs = ("thesis.part", ".disk.part", f".notes.{'1' * 16}.part")
    (tmp_path / "points" / "00").mkdir(parents=True)
    (tmp_path / "own").mkdir()
    (tmp_path / "sweep.toml").touch()
    old = [tmp_path / "points" / "00" / ours[0], tmp_path / ours[1]]
    young = tmp_path / "points" / ours[0]
    kept = [
        young,
        *(tmp_path / name for name in theirs),
        *(tmp_path / "points" / name for name in theirs),
    ]
    kept.append(tmp_path / "own" / ours[0])
    for path in (*old, *kept):
        path.touch()
        os.utime(path, (time.time() - (0.0 if path == young else 7200.0),) * 2)
    store.claim("sweep", "sweep.toml", {"sweep.toml", "points"})
    assert not any(path.exists() for path in old)
    assert all(path.exists() for path in kept)


OTHER = (
    '{"key": "other", "version": "1", "notes": [], "conditions": {}, "links": {}, "seconds": {}}'
)


@pytest.mark.parametrize(
    "content",
    [
        *("{", OTHER, "conditions", "number"),
        *(pytest.param(content, marks=pytest.mark.slow) for content in ("[]", "", "null")),
    ],
)
def test_a_damaged_result_is_open_and_computed_again(
    here, noises, results, summaries, tmp_path, caplog, content
):
    key = results.contents[0]["key"]
    path = tmp_path / "out" / point_name(key)
    whole = path.read_text()
    mean = '"mean_m": '
    path.write_text({
        "conditions": json.dumps(json.loads(whole) | {"conditions": []}),
        "number": whole.replace(mean, f"{mean}1", 1),
    }.get(content, content))  # fmt: skip
    assert path.read_text() != whole
    damaged = open_sweep(tmp_path / "out")
    assert damaged.status() == (2, 1, 0, {})
    assert (
        f"{key}.json: damaged or of another point; run the sweep again to replace it" in caplog.text
    )
    assert damaged.table()["status"].tolist()[0] == "open"
    again = run_sweep(noises(2), tmp_path / "out")
    assert f"{key}.json: damaged or of another point; removed and computed again" in caplog.text
    assert summaries(again) == summaries(results)


def test_a_damaged_failure_is_tried_again(here, noises, tmp_path):
    sweep = noises(1)
    key = SweepPlan(sweep).keys[0]["point"]
    name = tmp_path / "out" / point_name(key, failed=True)
    name.parent.mkdir(parents=True)
    name.write_text("[1]")
    assert run_sweep(sweep, tmp_path / "out").status() == (1, 1, 0, {})


@pytest.mark.parametrize("content", [b"{", b"[]", b'{"error": 3}', b"\xff", b"[" * 100_000])
def test_a_damaged_failure_of_a_stage_is_computed_again(noises, tmp_path, content):
    sweep = noises(2)
    keys = SweepPlan(sweep).keys[0]
    store = open_store(tmp_path)
    name = stage_name(keys["fleet"], failed=True)
    shared = Stages(build_study(sweep.point(0)), keys, store, frozenset(STAGES))
    store.write(name, failure_content(SweepError("no water")))
    refused(SweepError, "no water", shared._compute, keys["fleet"], lambda: 1)
    store.write(name, content)
    assert shared._compute(keys["fleet"], lambda: 1) == 1
    assert not store.has(name)


@pytest.mark.parametrize(
    "content", [b"[]", b"null", b"{", b'{"keys": 3}', b'{"sweep": [], "keys": ["a"]}', b"\xff"]
)
def test_a_damaged_plan_is_made_again(results, tmp_path, content):
    (tmp_path / "out" / "plan.json").write_bytes(content)
    assert open_sweep(tmp_path / "out").status() == results.status() == (2, 2, 0, {})


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"= 1", b"base = 3"])
def test_a_damaged_definition_is_told_in_one_line(here, noises, tmp_path, content):
    run_sweep(noises(1), tmp_path / "out")
    (tmp_path / "out" / "sweep.toml").write_bytes(content)
    refused(SweepError, r"sweep\.toml: ", open_sweep, tmp_path / "out")
    assert run_sweep(noises(1), tmp_path / "out").status() == (1, 1, 0, {})


@pytest.mark.parametrize(
    "damage",
    ["bit", *(pytest.param(damage, marks=pytest.mark.slow) for damage in ("empty", "cut"))],
)
def test_a_damaged_stage_is_computed_again_by_the_first_that_needs_it(
    here, noises, results, summaries, tmp_path, caplog, damage
):
    before = summaries(results)
    for path in (tmp_path / "out" / "points").glob("*/*"):
        path.unlink()
    (path,) = (tmp_path / "out" / "stages").glob(f"{SweepPlan(noises(2)).keys[0]['rays']}.nc")
    content = path.read_bytes()
    flipped = content[:5000] + bytes([content[5000] ^ 1]) + content[5001:]
    path.write_bytes({"cut": content[: len(content) // 2], "bit": flipped, "empty": b""}[damage])
    for latest in stages.LATEST.values():
        latest.cache_clear()
    again = run_sweep(noises(2), tmp_path / "out", keep_stages=True)
    assert again.status() == (2, 2, 0, {})
    assert summaries(again) == before
    assert f"{path.name}: damaged: its content does not have its checksum; removed" in caplog.text
    assert "mantaray-" not in caplog.text.replace("mantaray-part", "")  # no temporary file is named
    rewritten, groups = ({*netcdf_groups(whole[:-32])} for whole in (path.read_bytes(), content))
    assert rewritten == groups


def test_points_of_other_code_are_computed_again_and_said_to_be(
    here, noises, tmp_path, caplog, monkeypatch
):
    sweep, out = noises(2), tmp_path / "out"
    for module in ("jobs.keys", "apps.sweep.plan", "apps.sweep.runner"):
        monkeypatch.setattr(f"pymantaray.{module}.code_version", lambda: "0.0.9+old")
    run_sweep(sweep, out)
    assert open_sweep(out).status() == (2, 2, 0, {})
    monkeypatch.undo()
    monkeypatch.setattr("pymantaray.apps.sweep.runner.open_pool", factories.pool_here)
    assert open_sweep(out).status() == (2, 2, 0, {})  # what older code found can be read
    caplog.clear()
    results = run_sweep(sweep, out)
    assert "2 points were computed by pymantaray 0.0.9+old, but this is pymantaray" in caplog.text
    assert "computed again, and the old files stay" in caplog.text
    assert {content["version"] for content in results.contents} == {code_version()}
    assert len(list(out.glob("points/*/*.json"))) == 4
    caplog.clear()
    run_sweep(sweep, out)
    assert caplog.text == ""
