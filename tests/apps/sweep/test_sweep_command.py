"""`mantaray sweep` as a user meets it."""

import subprocess
import sys

import pandas as pd
import pytest
import xarray as xr
from factories import pool_here
from oracles import cf_errors

from pymantaray.apps.sweep import open_sweep

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
