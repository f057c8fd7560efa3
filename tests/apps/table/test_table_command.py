"""`mantaray table`."""

import json
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
