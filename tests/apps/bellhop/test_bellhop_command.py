"""`mantaray rays compare-bellhop` and `write-bellhop`."""

import json
from pathlib import Path

import bellhop_stand_in as stand_in
import numpy as np
import pandas as pd
import pytest
from bellhop_stand_in import read_boundary, read_env, read_grids
from scipy.interpolate import CubicSpline

from pymantaray.apps.study import open_run

LINKS = """source_north,source_east,source_depth,receiver_north,receiver_east,receiver_depth
0,0,100,3000,4000,400
500.5,-300,70,4000,900,40
"""
PROFILE = ("--profile", "profile.csv", "--bathymetry", 1000)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Links, and a profile of 1500 m/s, in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("links.csv").write_text(LINKS)
    Path("profile.csv").write_text("depth, sound_speed\n0, 1500\n1000, 1500\n")
    return tmp_path


def test_comparison_of_a_profile(mantaray, files, monkeypatch, as_stored):
    program = stand_in.install(files)
    monkeypatch.setenv("PATH", stand_in.path_of(files))
    words = ("rays", "compare-bellhop", "links.csv", *PROFILE)
    shown = mantaray(*words, "--out", "out.csv")
    assert shown.code == 0, shown.err
    table = pd.read_csv("out.csv")
    as_stored(table, without="cpu")
    np.testing.assert_allclose(table["difference_us"], stand_in.LATE_US, rtol=0, atol=2e-3)
    assert "2 links: 2 with a direct arrival of MantaRay, 2 of Bellhop" in shown.out
    assert "median +12.50" in shown.out
    told = json.loads(mantaray(*words, "--out", "out.csv", "--force", "--json").out)
    as_stored(told, without="cpu|_us", name="told")
    assert told["bellhop_minus_ours_us"]["median"] == pytest.approx(12.5, abs=2e-3)
    quiet = mantaray(*words, "--out", "again.csv", "--quiet", "--program", program)
    assert quiet.out == "again.csv\n"
    assert sorted(path.suffix for path in files.iterdir()) == ["", ".csv", ".csv", ".csv", ".csv"]


def test_writing_the_links_of_a_table(mantaray, files, as_stored):
    shown = mantaray(
        "rays", "write-bellhop", "links.csv", "--profile", "profile.csv", "--bathymetry", 1234,
        "--out", "run", "--write", "rays", "--beams", 7, "--sea-bed", "matching", "--step", 0,
        "--ice", 4,
    )  # fmt: skip
    paths = [Path(line) for line in shown.out.split()]
    assert paths == [Path("run/link_0.env"), Path("run/link_1.env")]
    second = read_env(paths[1])
    as_stored({file.name: file.read_text() for file in sorted(Path("run").iterdir())})
    assert second.source == (500.5, -300.0, 70.0)
    assert len(second.levels) == 2  # linear by default, so not sampled
    assert (second.run_type[0], second.bottom, second.step, len(second.bearings)) == (
        "R",
        "A",
        0.0,
        7,
    )
    assert set(np.ravel(read_grids(paths[1])[1][2])) == {1234.0}
    assert set(np.ravel(read_boundary(paths[1].with_suffix(".ati"))[2])) == {4.0}
    again = ("rays", "write-bellhop", "links.csv", *PROFILE, "--out", "run")
    assert mantaray(*again, "--force").code == 0
    assert read_env(paths[1]).run_type[0] == "A"


def test_a_smooth_ocean_is_sampled(mantaray, files):
    depth, speed = np.array([0.0, 100.0, 300.0, 1000.0]), np.array([1500.0, 1490.0, 1480.0, 1495.0])
    pd.DataFrame({"depth": depth, "sound_speed": speed}).to_csv("bent.csv", index=False)
    mantaray(
        "rays", "write-bellhop", "links.csv", "--profile", "bent.csv", "--bathymetry", 900,
        "--interpolation", "smooth", "--refine", 5, "--out", "run",
    )  # fmt: skip
    levels = np.array(read_env("run/link_0.env").levels)
    assert len(levels) == 16
    expected = CubicSpline(depth, speed, bc_type="natural")(levels[:, 0])
    np.testing.assert_allclose(levels[:, 1], expected, rtol=0, atol=1e-9)


def test_links_of_a_run_come_with_the_runs_ocean(mantaray, files, tiny_run_folder):
    run = open_run(tiny_run_folder)
    n = run.truth.position.shape[0]
    rows = [
        0,
        int(np.flatnonzero(run.links.second == n)[0]),
    ]  # between vehicles, and to the landmark
    words = ("rays", "write-bellhop", "--run", tiny_run_folder)
    done = mantaray(*words, "--link", rows[0], "--link", rows[1], "--out", "out")
    assert done.code == 0, done.err
    for i, row in enumerate(rows):
        env = read_env(f"out/link_{i}.env")
        start = run.truth.position[run.links.first[row], run.links.sample[row]]
        assert env.source == tuple(start)
    r, bearing = env.receiver_range, env.receiver_bearing
    there = [start[0] + r * np.cos(bearing), start[1] + r * np.sin(bearing), env.receiver_depth]
    mark = run.config.landmarks[0]
    np.testing.assert_allclose(there, [mark.north, mark.east, mark.depth], rtol=0, atol=1e-9)
    (*_, c), _ = read_grids("out/link_0.env")
    np.testing.assert_array_equal(c, run.ocean["sound_speed"].transpose("north", "east", "depth"))
    refused = mantaray(*words, "--link", 1000000, "--out", "run")
    assert "--link is 1000000; the run has links 0 to" in refused.err
