"""The two commands, called as the command line calls them."""

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import typer
from scipy.interpolate import CubicSpline
from typer.testing import CliRunner

from pymantaray.acoustics import Medium
from pymantaray.acoustics.bellhop import read_bellhop, read_environment
from pymantaray.cli.options import OceanCommand
from pymantaray.cli.rays_bellhop import compare_bellhop, write_bellhop
from pymantaray.errors import AcousticsError
from pymantaray.ocean import open_ocean
from pymantaray.study import parse_study, preset_text, run_study

HERE = Path(__file__).parent
spec = importlib.util.spec_from_file_location("bellhop_stand_in", HERE / "bellhop_stand_in.py")
stand_in = importlib.util.module_from_spec(spec)
spec.loader.exec_module(stand_in)

LINKS = """source_north,source_east,source_depth,receiver_north,receiver_east,receiver_depth
0,0,100,3000,4000,400
500.5,-300,70,4000,900,40
"""


@pytest.fixture
def call():
    """Call a command with words; what it refuses comes out as its own exception, as in `main`."""
    app = typer.Typer()
    app.command("compare-bellhop", cls=OceanCommand)(compare_bellhop)
    app.command("write-bellhop", cls=OceanCommand)(write_bellhop)

    def run(*words):
        result = CliRunner().invoke(app, [str(word) for word in words])
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return SimpleNamespace(code=result.exit_code, text=result.output)

    return run


@pytest.fixture
def files(tmp_path):
    """Links, and a profile of 1500 m/s."""
    (tmp_path / "links.csv").write_text(LINKS)
    (tmp_path / "profile.csv").write_text("depth, sound_speed\n0, 1500\n1000, 1500\n")
    return tmp_path


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    """A study of four hours in a small window, with a landmark."""
    import tomllib

    tree = tomllib.loads(preset_text("quick"))
    tree["mission"]["duration_h"] = 4.0
    tree["study"] |= {"realizations": 1, "conditions": ["odometry"]}
    tree["ocean"] |= {"half_extent_north": 15000.0, "half_extent_east": 15000.0}
    tree["landmarks"] = [{"name": "L0", "north": 100.0, "east": -200.0, "depth": 50.0}]
    return run_study(parse_study(tree), tmp_path_factory.mktemp("study") / "run", workers=1).path


def test_comparison_of_a_profile(call, files, monkeypatch):
    program = stand_in.install(files)
    monkeypatch.setenv("PATH", stand_in.path_of(files))
    words = ("compare-bellhop", files / "links.csv", "--profile", files / "profile.csv", "--bottom", 1000)
    shown = call(*words, "--out", files / "out.csv")
    assert shown.code == 0, shown.text
    table = pd.read_csv(files / "out.csv")
    np.testing.assert_allclose(table["difference_us"], stand_in.LATE_US, rtol=0, atol=2e-3)
    assert "2 links: 2 with a direct arrival, 2 of Bellhop's" in shown.text
    assert "median +12.50" in shown.text
    quiet = call(*words, "--out", files / "again.csv", "--quiet", "--program", program)
    assert quiet.text == f"{files / 'again.csv'}\n"
    assert sorted(path.suffix for path in files.iterdir()) == ["", ".csv", ".csv", ".csv", ".csv"]


def test_writing_the_links_of_a_table(call, files):
    shown = call(
        "write-bellhop", files / "links.csv", "--profile", files / "profile.csv", "--bottom", 1234,
        "--out", files / "run", "--write", "rays", "--beams", 7, "--sea-bed", "matching", "--step", 0,
    )  # fmt: skip
    paths = [Path(line) for line in shown.text.split()]
    assert [path.name for path in paths] == ["link_0.env", "link_1.env"]
    second = read_environment(paths[1])
    assert (second.source_x[0], second.source_y[0], second.source_depth[0]) == (500.5, -300.0, 70.0)
    assert (second.run_type[0], second.bottom, second.step, second.declination.size) == ("R", "A", 0.0, 7)
    assert read_bellhop(paths[1]).bathymetry.tolist() == [[1234.0]]


def test_writing_a_named_ocean(call, files):
    call("write-bellhop", files / "links.csv", "--ocean", "synthetic:fram", "--out", files / "run")
    found = read_bellhop(files / "run" / "link_1")
    expected = Medium.from_dataset(open_ocean("synthetic:fram"), interpolation="linear")
    np.testing.assert_array_equal(found.sound_speed, expected.sound_speed)
    np.testing.assert_array_equal(found.bathymetry, expected.bathymetry)


def test_a_smooth_ocean_is_sampled(call, files):
    depth = np.array([0.0, 100.0, 300.0, 1000.0])
    speed = np.array([1500.0, 1490.0, 1480.0, 1495.0])
    pd.DataFrame({"depth": depth, "sound_speed": speed}).to_csv(files / "bent.csv", index=False)
    call(
        "write-bellhop", files / "links.csv", "--profile", files / "bent.csv", "--bottom", 900,
        "--interpolation", "smooth", "--refine", 5, "--out", files / "run",
    )  # fmt: skip
    found = read_bellhop(files / "run" / "link_0")
    assert found.depth.size == 16
    expected = CubicSpline(depth, speed, bc_type="natural")(found.depth)
    np.testing.assert_allclose(found.sound_speed[0, 0], expected, rtol=0, atol=1e-9)


def test_links_of_a_run_come_with_the_runs_ocean(call, files, run_folder):
    from pymantaray.study import open_run

    run = open_run(run_folder)
    n = run.truth.position.shape[0]
    rows = [0, int(np.flatnonzero(run.links.second == n)[0])]  # between vehicles, and to the landmark
    call(
        "write-bellhop", "--run", run_folder, "--link", rows[0], "--link", rows[1], "--out", files / "out"
    )  # fmt: skip
    for i, row in enumerate(rows):
        found = read_environment(files / "out" / f"link_{i}")
        start = run.truth.position[run.links.first[row], run.links.sample[row]]
        assert (found.source_x[0], found.source_y[0], found.source_depth[0]) == tuple(start)
    r, bearing = found.receiver_range[0], found.receiver_bearing[0]
    there = [start[0] + r * np.cos(bearing), start[1] + r * np.sin(bearing), found.receiver_depth[0]]
    np.testing.assert_allclose(there, [100.0, -200.0, 50.0], rtol=0, atol=1e-9)
    medium = read_bellhop(files / "out" / "link_0")
    np.testing.assert_array_equal(
        medium.sound_speed, run.ocean["sound_speed"].transpose("north", "east", "depth")
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "no ocean given; exactly one of --ocean, --profile and --run is needed"),
        (
            ["--profile", "profile.csv", "--ocean", "synthetic:fram"],
            "--ocean and --profile given; exactly one",
        ),
        (["--profile", "profile.csv"], "--profile and --bottom: the one needs the other"),
        (
            ["--profile", "links.csv", "--bottom", "9"],
            r"links\.csv: lacks depth, sound_speed; found source_north",
        ),
        (["--profile", "nothing.csv", "--bottom", "9"], r"nothing\.csv: cannot be read: No such file"),
        (
            ["--profile", "holes.csv", "--bottom", "9"],
            r"holes\.csv, line 3: sound_speed needs a number; it is \'\'",
        ),
        (["--run", "."], "not a run folder"),
        (
            ["--profile", "profile.csv", "--bottom", "9", "--link", "1"],
            "give LINKS.csv, or --run with --link ROW",
        ),
    ],
)
def test_bad_input_is_one_line(call, files, monkeypatch, words, message):
    monkeypatch.chdir(files)
    Path("holes.csv").write_text("depth,sound_speed\n0,1500\n10,\n")
    with pytest.raises(Exception, match=message) as caught:
        call("write-bellhop", "links.csv", "--out", "run", *words)
    assert "\n" not in str(caught.value)
    assert not Path("run").exists()


def test_links_of_no_run_and_rows_it_lacks(call, files, run_folder):
    profile = ("--profile", files / "profile.csv", "--bottom", 1000)
    with pytest.raises(AcousticsError, match="--link: a row of which run"):
        call("write-bellhop", *profile, "--link", 0, "--out", files / "run")
    with pytest.raises(AcousticsError, match="--link 1000000: the run has links 0 to"):
        call("write-bellhop", "--run", run_folder, "--link", 1000000, "--out", files / "run")
