"""`mantaray table`."""

import json
from datetime import datetime
from pathlib import Path

import pytest

from pymantaray.apps.table import open_table
from pymantaray.cli.main import main

PROFILE = "depth_m,sound_speed\n0,1480\n50,1478\n100,1475\n300,1472\n"


@pytest.fixture
def profile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "profile.csv"
    path.write_text(PROFILE)
    return path


def _run(*words: str) -> int:
    with pytest.raises(SystemExit) as stop:
        main(["table", "profile.csv", *words])
    return int(stop.value.code or 0)


LIMITS = ("--source-depth", "10:50:10", "--receiver-depth", "10:150:20", "--range", "100 m:1 km")


@pytest.mark.usefixtures("profile")
def test_a_profile_without_a_sea_floor_makes_a_table_and_a_reader(
    capsys: pytest.CaptureFixture[str], as_stored
) -> None:
    assert _run(*LIMITS, "--out", "t.mtt", "--c-reader", "reader.h") == 0
    text = capsys.readouterr().out
    assert "% direct" in text
    table = open_table("t.mtt")
    assert table.lower == (10.0, 10.0, 100.0)
    assert table.upper == (50.0, 150.0, 1000.0)
    assert table.travel_time(20.0, 100.0, 500.0).travel_time[0] == pytest.approx(
        506.36 / 1476.0, rel=2e-3
    )
    assert "mantaray_table_open" in Path("reader.h").read_text()
    as_stored([text, table.tree, table.shares()])


def test_a_table_says_where_its_water_is_linear(
    profile: Path, capsys: pytest.CaptureFixture[str], as_stored
) -> None:
    rows = [f"{z},{1500 - 0.12 * z}" for z in range(0, 101, 20)]
    profile.write_text("\n".join(["depth_m,sound_speed", *rows, "2000,1510", ""]))
    limits = ("--source-depth", "10:20:10", "--receiver-depth", "100:140:40", "--range", "100:200")
    assert _run(*limits, "--out", "t.nc", "--json") == 0
    note = "between 100 and 2000 m the sound speed is linear"
    printed = capsys.readouterr()
    assert note in printed.err
    as_stored(json.loads(printed.out), name="told")
    assert note in open_table("t.nc").attrs["water"]["notes"]
    as_stored(open_table("t.nc").attrs)


BOX = (
    *("--source-depth", "10:50:5", "--receiver-depth", "20:150:25", "--range", "0.1 km:1 km:40"),
    *("--error", "20 cm", "--node", "300,-0.2 km", "--sectors", 3),
)
PLACES = {"--centre": (74.5, -140.25), "--position": (-33.5, 151.25)}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.usefixtures("profile")
def test_every_option_reaches_the_water_of_a_table(reached, place) -> None:
    words = (
        *("--bathymetry", "2.1 km", "--crs", "EPSG:3996", "--currents", "carry"),
        *("--equation", "unesco", "--half-extent", "4 km", 3000, "--time", "2020-03-10T12:00"),
        *("--repair-freezing", "--name", "temp=sea_water_temperature", "--ice", "2.5 m"),
        *("--ice-slope", 12, "--ice-length", "25 m", "--interpolation", "linear"),
        *("--earth", "sphere", "--thin", 0.05, "--smooth", "6 m", place, *PLACES[place]),
        *("--max-surface-bounces", 2, "--max-bottom-bounces", 3, "--cutoff-db", 21),
        *("--arrival", "direct-or-first", "--out", "t.nc"),
    )
    used = "pymantaray.config.door.water.configuration_of"
    given = reached(used, "table", "profile.csv", "synthetic:fram", *words, *BOX)
    assert given[0] == ["profile.csv", "synthetic:fram"]
    assert given[1]["time"] == datetime(2020, 3, 10, 12)  # noqa: DTZ001


@pytest.mark.usefixtures("profile")
def test_every_option_reaches_the_table(reached, monkeypatch) -> None:
    Path("other.csv").write_text("depth_m,sound_speed\n0,1470\n")
    monkeypatch.setattr(
        "pymantaray.config.door.water.open_water",
        lambda source, **keys: {"source": str(source), **keys},
    )
    words = ("table", "profile.csv", *BOX, "--out", "t.mtt", "--arrival", "strongest")
    words += ("--cutoff-db", 21, "--ensemble", "other.csv", "--ensemble", "profile.csv")
    reached("pymantaray.apps.table.build_table", *words)


@pytest.mark.usefixtures("profile")
def test_a_quiet_table_shows_no_progress(reached) -> None:
    words = ("table", "profile.csv", *LIMITS, "--out", "t.mtt", "--quiet")
    reached("pymantaray.apps.table.build_table", *words, without="^0")


@pytest.mark.parametrize(
    ("levels", "deepest", "expected"), [(300, 150, 300.0), (300, 400, 400.0), (60, 150, 150.0)]
)
def test_a_sea_floor_is_below_the_profile_and_the_table(
    reached, profile: Path, levels, deepest, expected
) -> None:
    profile.write_text(f"depth_m,sound_speed\n0,1470\n{levels},1475\n")
    limits = ("--source-depth", f"10:{deepest}", "--receiver-depth", "10:50", *LIMITS[4:])
    opened = "pymantaray.config.door.water.open_water"
    given = reached(opened, "table", "profile.csv", *limits, "--out", "t.nc")
    assert given["bathymetry"] == expected


@pytest.mark.usefixtures("profile")
def test_every_option_reaches_the_files_of_a_table(reached, mantaray, monkeypatch) -> None:
    words = ("table", "profile.csv", *LIMITS, "--error", "0.5 m", "--out", "t.mtt")
    words += ("--c-reader", "r.h")
    made = mantaray(*words).out.splitlines()
    assert ("below 0.5 m" in made[0], made[-2:]) == (True, ["t.mtt", "r.h"])
    table = open_table("t.mtt")
    monkeypatch.setattr("pymantaray.apps.table.build_table", lambda *_, **__: table)
    for name, other in (("t.mtt", "r.h"), ("r.h", "t.mtt")):
        Path(name).write_text("mine")
        Path(other).unlink()
        refused = mantaray(*words)
        assert refused.err == f"error: {name}: already exists; give another name or --force\n"
        given = reached("pymantaray.apps.table.save_table", *words, "--force", without="^[01]")
        assert given == {0: table, 1: Path("t.mtt"), "replace": True}
        assert mantaray(*words, "--force").code == 0
        assert Path(name).stat().st_size > len("mine")

    def meanwhile(*_, **__):
        Path("r.h").write_text("mine")
        return table

    for name in ("t.mtt", "r.h"):
        Path(name).unlink()
    with monkeypatch.context() as patch:
        patch.setattr("pymantaray.apps.table.build_table", meanwhile)
        assert (mantaray(*words).code, Path("r.h").read_text()) == (2, "mine")
    same = mantaray(*words[:-1], "profile.csv", "--force")
    assert same.code == 2
    form = ("--force", "--json", "--quiet")
    reached("pymantaray.cli.options.printer", *words, *form)


@pytest.mark.usefixtures("profile")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((*LIMITS, "--out", "t.txt"), "must end in .nc or .mtt"),
        (("--source-depth", "10", *LIMITS[2:], "--out", "t.nc"), "START:STOP"),
        ((*LIMITS, "--out", "t.nc", "--error", "0"), "--error is 0"),
        ((*LIMITS[:4], "--range", "0:100", "--out", "t.nc"), "--range begins at 0"),
        (("--source-depth", "50:10", *LIMITS[2:], "--out", "t.nc"), "--source-depth is (50"),
        (
            (*LIMITS[:2], "--receiver-depth", "5:9:7", *LIMITS[4:], "--out", "t.nc"),
            "--receiver-depth is (5",
        ),
        ((*LIMITS, "--out", "t.nc", "--c-reader", "profile.csv"), "must end in .h"),
    ],
)
def test_wrong_options_end_in_one_line(
    words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run(*words) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert any(message in line for line in error)
    assert not Path("t.nc").exists()
