"""`mantaray sweep` as a user meets it."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
import xarray as xr
from factories import pool_here
from oracles import cf_errors

from pymantaray.apps.sweep import load_sweep, open_sweep
from pymantaray.apps.sweep.estimate import Cost
from pymantaray.apps.sweep.plan import SweepPlan
from pymantaray.apps.sweep.results import Status
from pymantaray.records.csv_text import csv_text

SWEEP = """
base = "small.toml"

[cross]
noise.range_sigma = [0.5, 1.0]
mission.ping_interval_h = [1.0, 2.0]
"""


@pytest.fixture
def file(tmp_path, small_text):
    (tmp_path / "small.toml").write_text(small_text)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    return tmp_path / "sweep.toml"


@pytest.mark.slow
def test_a_sweep_from_its_plan_to_its_table(mantaray, told, file, tmp_path):
    shown = mantaray("sweep", "show", file, "--workers", "2")
    assert shown.code == 0
    assert shown.out.startswith(
        "quick: 4 points\n  noise.range_sigma: 0.5, 1.0\n  mission.ping_interval_h: 1.0, 2.0\n"
    )
    assert "to do: ocean 1, fleet 1, rays 2, points 4; shared stages are computed once" in shown.out
    assert "on 2 workers" in shown.out
    assert "estimated from the preset quick, scaled by steps, links and poses" in shown.out

    out = tmp_path / "out"
    ran = mantaray("sweep", "run", file, "--out", out, "--workers", "1")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out == f"{out}: 4 done, 0 failed, 0 open of 4 points\n{out}\n"
    assert mantaray("sweep", "status", out).out == f"{out}: 4 done, 0 failed, 0 open of 4 points\n"
    status = {"done": 4, "failed": 0, "open": 0, "points": 4, "failures": []}
    assert told("sweep", "status", out) == status
    assert told("sweep", "run", file, "--out", out) == status | {"folder": str(out), "notes": []}
    plan = told("sweep", "show", file, "--out", out)
    assert plan["axes"] == [
        {"noise.range_sigma": [0.5, 1.0]},
        {"mission.ping_interval_h": [1.0, 2.0]},
    ]
    assert (plan["done"], plan["to_do"]["points"], plan["time_s"]) == (4, 0, 0.0)
    assert "of these 4 done, 0 failed, 0 open" in mantaray("sweep", "show", file, "--out", out).out

    html = open_sweep(out)._repr_html_()
    assert "done: 4 · failed: 0 · open: 0 · points: 4" in html
    assert html.count("<td>straight</td>") == 4

    collected = mantaray("sweep", "collect", out)
    assert collected.out == f"{out / 'table.csv'}\n{out / 'table.nc'}\n{out / 'index.html'}\n"
    table = pd.read_csv(out / "table.csv")
    assert set(table["condition"]) == {"odometry", "straight"}
    assert not cf_errors([out / "table.nc"])
    with xr.open_dataset(out / "table.nc") as dataset:
        assert dataset["rmse_m"].units == "m"
        assert dataset["mission.ping_interval_h"].units == "h"
        assert dict(dataset.sizes) == {
            "noise.range_sigma": 2,
            "mission.ping_interval_h": 2,
            "condition": 2,
        }
    again = mantaray("sweep", "collect", out, "--out", tmp_path / "sweep.toml")
    assert (again.code, again.err) == (
        2,
        f"error: {file}: the name of the output must end in .csv or .nc\n",
    )


def test_the_plan_of_a_sweep_is_shown(mantaray, told, file, as_stored):
    as_stored(mantaray("sweep", "show", file, "--workers", "2").out)
    assert told("sweep", "show", file)["to_do"]["points"] == 4


def test_the_exit_status_says_that_points_have_failed(mantaray, told, file, monkeypatch, tmp_path):
    monkeypatch.setattr("pymantaray.apps.sweep.runner.open_pool", pool_here)
    file.write_text('base = "small.toml"\ncross.fleet.vehicles.A.north = [1e6]')
    out = tmp_path / "out"
    ran = mantaray("sweep", "run", file, "--out", out)
    assert ran.code == 1
    assert "0 done, 1 failed, 0 open of 1 points" in ran.out
    assert ran.err.startswith("warning: failed: 1 x ")
    assert mantaray("sweep", "status", out, "--quiet").err == ""
    status = told("sweep", "status", out, code=1)
    assert [one["points"] for one in status["failures"]] == [status["failed"]] == [1]


def test_bad_points_are_told_before_anything_runs(mantaray, file, tmp_path):
    file.write_text('base = "small.toml"\ncross.noise.range_sigma = [1.0, -1.0, -2.0]')
    ran = mantaray("sweep", "run", file, "--out", tmp_path / "out")
    assert ran.code == 2
    assert ran.err.splitlines() == [
        f"error: point {n} (noise.range_sigma = {-n}.0): noise.range_sigma: found {-n}.0; allowed:"
        " greater than 0"
        for n in (1, 2)
    ]
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_nothing_of_dask_is_imported_before_it_is_asked_for():
    code = "import sys, pymantaray.cli.main, pymantaray.apps.sweep.runner\n"
    code += "print({'dask', 'distributed', 'fsspec'} & set(sys.modules))"
    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert printed.stdout == "set()\n", printed.stderr


COMMAND = "pymantaray.apps.sweep"
CHANGES = ("--set", "noise.depth_sigma=2", "--set", "mission.duration_h=5")


@pytest.mark.parametrize("words", ["show", "run --out out"])
def test_every_option_reaches_the_sweep(reached, file, words):
    name, *more = words.split()
    assert reached(f"{COMMAND}.load_sweep", "sweep", name, file, *more, *CHANGES)[0] == file


COST = Cost({"ocean": 1.0, "fleet": 20.0, "rays": 300.0, "point": 4000.0}, 5_000_000, "a guess")


@pytest.mark.parametrize("done", [2, 0])
@pytest.mark.parametrize("measured", [(), ("--measure",)], ids=["known", "measured"])
def test_every_option_reaches_what_is_shown(
    told, spied, file, monkeypatch, as_stored, done, measured
):
    monkeypatch.chdir(file.parent)
    text = SWEEP.replace("[0.5, 1.0]", str([0.1 * k for k in range(1, 10)]))
    file.write_text(f"{text}study.description = ['{44 * 'x'}']\n")
    changes = {"noise.depth_sigma": 2, "mission.duration_h": 5}
    points = list(SweepPlan(load_sweep(file, **changes)).points)
    found = set(points[:done]), {points[2]}
    asked = []
    monkeypatch.setattr(
        f"{COMMAND}.keys.finished", lambda store, of: asked.append((store, {*of})) or found
    )
    monkeypatch.setattr(f"{COMMAND}.open_sweep", lambda where: SimpleNamespace(contents=[where]))
    monkeypatch.setattr(
        f"{COMMAND}.estimate.cost_of", lambda contents: COST._replace(origin=f"{contents[0]} it")
    )
    words = ("sweep", "show", file, "--out", "here", "--workers", 3, *measured, *CHANGES)
    function = f"{COMMAND}.estimate.measured_cost"
    given, shown = spied(function, COST, *words)
    assert len(given) == len(measured)
    if measured:
        assert given[0][0].point(0).mission.duration_h == 5
    as_stored(shown.out.splitlines())
    assert asked[0][1] == {*points}
    values = told(*words, without="axes")
    assert (values["workers"], values["done"], values["failed"]) == (3, done, 1)
    assert values["to_do"]["points"] == len(points) - done - 1


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_every_option_reaches_the_run_of_the_sweep(reached, file, quiet):
    where = ("--out", "here", "--workers", 3, "--scheduler", "tcp://a:1")
    words = ("sweep", "run", file, *where, "--studies", "--retry-failed", *quiet, *CHANGES)
    given = reached(f"{COMMAND}.run_sweep", *words)
    assert (len(given[0]), given["workers"], given["client"]) == (4, 3, "tcp://a:1")
    assert given[0].point(0).mission.duration_h == 5


def test_every_option_reaches_the_stages_that_are_kept(reached, file):
    words = ("sweep", "run", file, "--out", "here", "--keep-stages")
    assert reached(f"{COMMAND}.run_sweep", *words)["workers"] is None


@pytest.mark.parametrize("reasons", [0, 5, 6])
def test_every_option_reaches_the_count_of_points(told, spied, mantaray, file, as_stored, reasons):
    failures = {f"reason {k}": 10 - k for k in range(reasons)}
    counts = Status(90, 20, sum(failures.values()), failures)
    results = SimpleNamespace(status=lambda: counts, notes=["a note"])
    code = int(reasons > 0)
    words = ("sweep", "run", file, "--out", "here")
    _, done = spied(f"{COMMAND}.run_sweep", results, *words, code=code)
    as_stored([*done.out.splitlines(), *done.err.splitlines()])
    assert done.out.splitlines()[-1] == "here"
    assert mantaray(*words, "--quiet").out == "here\n"
    assert told(*words, code=code)["folder"] == "here"
    given, status = spied(f"{COMMAND}.open_sweep", results, "sweep", "status", "there", code=code)
    assert given == [{0: "there"}]
    assert status.out == f"there{done.out.splitlines()[0].removeprefix('here')}\n"
    assert status.err == done.err.removeprefix("a note\n")


@pytest.fixture
def collected(monkeypatch, file):
    """A sweep whose table is collected, and what is written as NetCDF and as a page."""
    monkeypatch.chdir(file.parent)
    sweep = load_sweep(file)
    table = pd.DataFrame({"noise.range_sigma": [0.5, 1.0], "rmse_m": [3.25, 4.5]})
    made = SimpleNamespace(opened=[], netcdf=[], pages=[], table=table, data=xr.Dataset())
    results = SimpleNamespace(
        sweep=sweep,
        notes=["a note"],
        table=lambda: table,
        dataset=lambda: made.data,
        synthetic=True,
        origin={"versions": ["1"]},
    )
    monkeypatch.setattr(f"{COMMAND}.open_sweep", lambda where: made.opened.append(where) or results)
    monkeypatch.setattr("pymantaray.records.write_netcdf", lambda *a: made.netcdf.append(a))
    monkeypatch.setattr(
        f"{COMMAND}.write_sweep_page",
        lambda *a, **k: made.pages.append((*a, k)) or Path(a[2], "page.html"),
    )
    return made


def test_every_option_reaches_the_table_of_the_folder(mantaray, collected):
    Path("here").mkdir()
    done = mantaray("sweep", "collect", "here")
    assert (done.code, done.out) == (0, "here/table.csv\nhere/table.nc\nhere/page.html\n")
    assert Path("here/table.csv").read_text() == csv_text(collected.table)
    assert collected.netcdf == [(collected.data, Path("here/table.nc"))]
    fields = ["noise.range_sigma", "mission.ping_interval_h"]
    title = {"title": "quick", "notes": ["a note"]}
    title |= {"synthetic": True, "origin": {"versions": ["1"]}}
    assert collected.pages == [(collected.table, fields, "here", title)]


@pytest.mark.parametrize(
    ("words", "out"),
    [("here --out mine.csv", "mine.csv"), ("here --out mine.nc", "mine.nc"),
     ("memory://here", "sweep.csv"), ("memory://here --out mine.nc", "mine.nc")],
)  # fmt: skip
def test_every_option_reaches_the_one_table(mantaray, collected, words, out):
    Path(out).write_text("old")
    refused = mantaray("sweep", "collect", *words.split())
    assert refused.code == 2
    assert f"{out}: already exists" in refused.err
    done = mantaray("sweep", "collect", *words.split(), "--force")
    assert (done.code, done.out) == (0, f"{out}\n")
    assert set(collected.opened) == {words.split()[0]}
    if out.endswith("nc"):
        assert collected.netcdf == [(collected.data, Path(out))]
        assert Path(out).read_text() == "old"
    else:
        assert Path(out).read_text() == csv_text(collected.table)
        assert collected.netcdf == []
    assert collected.pages == []
