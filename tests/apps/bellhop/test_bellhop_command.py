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


EVERY = (
    "--bathymetry 3km --crs EPSG:3996 --currents carry --equation unesco --centre 74.1 -140.2"
    " --half-extent 9km 11000 --repair-freezing --ice 2 --ice-slope 3 --ice-length 4"
    " --earth sphere --thin 0.5"
)
SAME = r"lut|knots|nodes|^[012](\.|$)"  # of a medium and of ends
COMMANDS = {
    "compare": "rays compare-bellhop links.csv --out out.csv",
    "write": "rays write-bellhop links.csv --out run",
}


@pytest.mark.parametrize("interpolation", [(), ("--interpolation", "smooth")])
@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_reaches_the_water(reached, files, command, interpolation):
    words = (*COMMANDS[command].split(), "--profile", "profile.csv", *EVERY.split())
    reached("pymantaray.config.door.water.open_waters", *words, *interpolation)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_reaches_the_finer_cells(reached, files, command):
    words = (*COMMANDS[command].split(), *PROFILE, "--interpolation", "smooth", "--refine", 5)
    reached("pymantaray.apps.bellhop.linear_medium", *words, without=SAME)


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_every_option_reaches_the_comparison(reached, files, quiet):
    options = ("--program", "mine", "--timeout", "3 min", "--step", "0.07km")
    words = (*COMMANDS["compare"].split(), *PROFILE, *options, *quiet)
    known = "lut|knots|nodes" if quiet else SAME
    reached("pymantaray.apps.bellhop.compare_with_bellhop", *words, without=known)


def test_every_option_reaches_the_table_that_is_written(mantaray, files, monkeypatch, as_stored):
    times = {
        "travel_time_s": [1.0, 2.0, np.nan, 4.0],
        "bellhop_travel_time_s": [1.1, np.nan, np.nan, 4.2],
        "difference_us": [3.0, np.nan, np.nan, -7.0],
        "cpu_ms": [0.5, 0.6, 0.7, 1.4],
        "bellhop_cpu_ms": [11.0, 12.0, 13.0, 22.0],
    }
    table = pd.DataFrame(times)
    written, compared = [], [table, table, table.assign(difference_us=np.nan)]
    monkeypatch.setattr(
        "pymantaray.apps.bellhop.compare_with_bellhop", lambda *_, **__: compared.pop(0)
    )
    monkeypatch.setattr("pymantaray.apps.rays.tables.write_table", lambda *a: written.append(a))
    words = (*COMMANDS["compare"].split(), *PROFILE[:3], 2000)
    done, quiet, none = (mantaray(*words, *more) for more in ((), ("--quiet",), ()))
    assert quiet.out == "out.csv\n"
    assert quiet.err == ""
    as_stored([done.out.splitlines(), done.err, none.out.splitlines()])
    assert len(written) == 3
    assert written[0] == (table, Path("out.csv"))


def test_every_option_reaches_the_files(reached, mantaray, files, monkeypatch):
    options = ["--write", "eigenrays", "--beams", "7", "--step", "0.07km", "--sea-bed", "vacuum"]
    words = (*COMMANDS["write"].split(), *PROFILE[:3], 2000, *options)
    function = "pymantaray.apps.bellhop.write_bellhop"
    given = reached(function, *words, without="lut|knots|nodes")
    assert given[0] == Path("run")
    monkeypatch.setattr(function, lambda *_: [Path("run/a.env"), Path("run/b.env")])
    done = mantaray(*words)
    assert done.out == "run/a.env\nrun/b.env\n"
    assert "profile.csv: ends at 1000 m, above the sea bed at 2000 m" in done.err


def test_every_option_reaches_the_files_of_a_run(reached, files, tiny_run_folder):
    words = ("rays", "write-bellhop", "--run", tiny_run_folder, "--out", "run")
    function = "pymantaray.apps.bellhop.write_bellhop"
    reached(function, *words, "--link", 3, "--link", 5, without=r"lut|knots|nodes|^1\.")


def test_the_last_link_of_a_run_is_there_and_the_next_is_not(mantaray, files, tiny_run_folder):
    last = open_run(tiny_run_folder).links.sample.size - 1
    words = ("rays", "write-bellhop", "--run", tiny_run_folder)
    assert mantaray(*words, "--out", "a", "--link", last).code == 0
    for row in (last + 1, -1):
        refused = mantaray(*words, "--out", "b", "--link", 0, f"--link={row}")
        assert f"--link is {row}; the run has links 0 to {last}" in refused.err


def test_every_option_reaches_the_check_of_the_output(mantaray, files, checked_outputs):
    for name in ("floor.nc", "ice.nc"):
        Path(name).write_text("")
    water = ("--profile", "profile.csv", "--bathymetry", "floor.nc", "--ice", "ice.nc")
    for force in ((), ("--force",)):
        assert mantaray(*COMMANDS["compare"].split(), *water, *force).code == 2
    inputs = [Path(name) for name in ("links.csv", "profile.csv", "floor.nc", "ice.nc")]
    assert checked_outputs == [
        ((Path("out.csv"), (".csv",)), {"inputs": inputs, "force": force})
        for force in (False, True)
    ]
