"""`mantaray ocean` check, show and plot: exit codes, one line for each finding, and files that are whole."""

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from pymantaray.cli.ocean import app, fleet_plan
from pymantaray.errors import MantaRayError
from pymantaray.study import load_study

RUN = CliRunner()


def call(*words):
    return RUN.invoke(app, [str(word) for word in words])


@pytest.fixture
def bad_file(ocean_file, tmp_path):
    with xr.open_dataset(ocean_file, engine="scipy") as data:
        data = data.load()
    data["salinity"].values[0, 2, 3] = 400.0
    path = tmp_path / "bad.nc"
    data.to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
    return path


def test_a_usable_ocean_exits_with_0_and_counts_doubts(ocean_file):
    result = call("check", ocean_file)
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0].startswith("doubtful: made up")
    assert lines[-1] == f"0 wrong, {len(lines) - 1} doubtful"


def test_a_wrong_ocean_exits_with_2_and_says_what(bad_file):
    result = call("check", bad_file)
    assert result.exit_code == 2
    first, *_, last = result.output.splitlines()
    assert first.startswith("wrong: ")
    assert "salinity" in first
    assert "400" in first
    assert last.startswith("1 wrong, ")


def test_a_study_s_domain_and_fleet_must_fit(ocean_file, small_text, tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(small_text, encoding="utf-8")
    assert call("check", "--study", study).exit_code == 0, "its own ocean holds it"
    assert call("check", ocean_file, "--study", study).exit_code == 0
    study.write_text(
        small_text.replace("half_extent_north = 15000.0", "half_extent_north = 90000.0"), encoding="utf-8"
    )
    result = call("check", ocean_file, "--study", study)
    assert result.exit_code == 2
    assert "wrong: coverage (74.5 N -140 E): domain of +-90 km north" in result.output
    study.write_text(
        small_text.replace("half_extent_east = 15000.0", "half_extent_east = 2000.0"), encoding="utf-8"
    )
    result = call("check", ocean_file, "--study", study)
    assert result.exit_code == 2
    assert "coverage (vehicle" in result.output
    result = call("check", ocean_file, "--study", "fram")
    assert result.exit_code == 2
    assert "is not inside the data" in result.output


def test_the_plan_of_a_fleet_holds_starts_targets_and_landmarks():
    config = load_study("beaufort")
    plan = fleet_plan(config)
    assert set(plan) == {v.name for v in config.fleet.vehicles} | {m.name for m in config.landmarks}
    floats = [v for v in config.fleet.vehicles if v.kind == "float"]
    assert floats
    for vehicle in floats:
        np.testing.assert_allclose(
            plan[vehicle.name][-1], [vehicle.north, vehicle.east, vehicle.target_depth]
        )
        assert plan[vehicle.name][0, 2] < 1.0


def test_nothing_to_check_is_an_error_of_one_line():
    result = call("check")
    assert isinstance(result.exception, MantaRayError)
    assert "name one, or a study" in str(result.exception)


def test_show_prints_extent_levels_time_and_ranges(ocean_file):
    result = call("show", ocean_file)
    assert result.exit_code == 0, result.output
    with xr.open_dataset(ocean_file, engine="scipy") as data:
        low, high = float(data["water_temp"].min()), float(data["water_temp"].max())
    for text in (
        "made up     yes",
        "2014-07-15 12:00 UTC",
        "17 points, 0.04 degrees apart",
        f"{low:.2f}",
        f"{high:.2f}",
    ):
        assert text in result.output
    assert "\n0 2 4 6 8 10 12" in result.output
    equations = [call("show", ocean_file, "--equation", name).output for name in ("teos-10", "unesco")]
    assert equations[0] != equations[1]


def test_plot_writes_figures_and_refuses_places_outside(ocean_file, tmp_path):
    folder = tmp_path / "figures"
    result = call("plot", ocean_file, "--out", folder, "--depth", 60, "--at", "74.5,220")
    assert result.exit_code == 0, result.output
    names = sorted(path.name for path in folder.iterdir())
    assert names == sorted(
        f"ocean_{name}.{kind}"
        for name in ("profiles", "sections", "map", "sea_floor")
        for kind in ("png", "pdf")
    )
    assert result.output.split() == [
        str(folder / f"ocean_{name}.{kind}")
        for name in ("profiles", "sections", "map", "sea_floor")
        for kind in ("png", "pdf")
    ]
    for words, says in (
        (("--at", "10,10"), "outside the ocean"),
        (("--at", "north"), "not a place"),
        (("--depth", 9_000), "not in the water"),
    ):
        result = call("plot", ocean_file, "--out", tmp_path / "none", *words)
        assert isinstance(result.exception, MantaRayError)
        assert says in str(result.exception)
    assert not (tmp_path / "none").exists()
