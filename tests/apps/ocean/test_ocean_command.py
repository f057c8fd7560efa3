"""`mantaray ocean` as a user runs it: exit codes, one line each, files that are whole."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from pymantaray.config import load_study, preset_text
from pymantaray.config.door.fleet import planned_points
from pymantaray.config.door.ocean import build_ocean
from pymantaray.errors import OceanError
from pymantaray.geometry import stream
from pymantaray.ocean import (
    cast_ocean,
    column_ocean,
    mean_ocean,
    open_ocean,
    perturb_ocean,
    read_cast,
    read_casts,
    vertical_modes,
)
from pymantaray.ocean.corrections import correct_with_casts
from pymantaray.ocean.schema import validate_ocean
from pymantaray.records import write_netcdf

CAST = """# drop 9, 2014-07-24/1920 UTC, lat 74.0, lon -140.0; bottom 450 m
depth_m,temperature_degC,practical_salinity
2,-1.2,27.2
50,0.4,30.7
120,-1.4,32.5
400,0.6,34.8
"""


def test_a_usable_ocean_exits_with_0_and_counts_doubts(mantaray, ocean_file, as_stored):
    result = mantaray("ocean", "check", ocean_file)
    lines = result.out.splitlines()
    as_stored(lines)
    assert result.code == 0
    assert lines[0].startswith("doubtful: made up")
    assert lines[-1] == f"0 wrong, {len(lines) - 1} doubtful"


def test_a_wrong_ocean_exits_with_2_and_says_what(mantaray, told, ocean_file, tmp_path):
    with xr.open_dataset(ocean_file, engine="scipy") as data:
        data = data.load()
    data["salinity"].values[0, 2, 3] = 400.0
    data.to_netcdf(tmp_path / "bad.nc", engine="scipy", format="NETCDF3_64BIT")
    result = mantaray("ocean", "check", tmp_path / "bad.nc")
    first, *_, last = result.out.splitlines()
    assert result.code == 2
    assert first.startswith("wrong: ")
    assert "salinity" in first
    assert "400" in first
    assert last.startswith("1 wrong, ")
    found = told("ocean", "check", tmp_path / "bad.nc", code=2)
    assert (found["wrong"], found["findings"][0]["severity"]) == (1, "wrong")


@pytest.mark.slow
def test_a_study_s_domain_and_fleet_must_fit(mantaray, ocean_file, small_text, tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(small_text, encoding="utf-8")
    assert mantaray("ocean", "check", "--study", study).code == 0, "its own ocean holds it"
    assert mantaray("ocean", "check", ocean_file, "--study", study).code == 0
    for side, half, says in (
        ("north", 90e3, "wrong: coverage (74.5 N, 140 W): domain of +-90 km north"),
        ("east", 2e3, "coverage (vehicle"),
    ):
        changes = (
            "--set",
            f"ocean.source={ocean_file}",
            "--set",
            f"ocean.half_extent_{side}={half}",
        )
        result = mantaray("ocean", "check", "--study", study, *changes)
        assert (result.code, says in result.out) == (2, True)
    result = mantaray("ocean", "check")
    assert (result.code, "name one, or give a study" in result.err) == (2, True)


def test_what_only_the_run_s_own_check_sees_is_told_by_the_check_too(
    mantaray, small_text, tmp_path
):
    study = tmp_path / "study.toml"
    swimmer = (
        '\n[[fleet.vehicles]]\nname = "W"\nkind = "waypoints"\nnorth = 0.0\neast = 0.0\ndepth ='
        " 9.0\n"
        "points = [[99.0, 0.0, 9.0]]\nspeed = 1.0\n"
    )
    text = small_text.replace("physics_step_s = 0.125", "physics_step_s = 25.0")
    study.write_text(text + swimmer, encoding="utf-8")
    says = "vehicle 'W': physics_step is 25 s; it must be at most 20 s"
    checked, ran = (
        mantaray("ocean", "check", "--study", study),
        mantaray("study", "run", study, "--no-figures"),
    )
    assert (checked.code, ran.code) == (2, 2)
    assert f"wrong: fleet: {says}" in checked.out
    assert ran.err.startswith(f"error: {says}")


def test_files_are_checked_about_the_centre_that_a_run_gives_them(mantaray, ocean_file, tmp_path):
    with xr.open_dataset(ocean_file) as data:
        narrow = data.isel(lat=slice(None, 10))  # 40 km north to south, 74.34 N in the middle
        narrow.to_netcdf(tmp_path / "south.nc")
    files = [str(tmp_path / "south.nc")]
    local = build_ocean(load_study("quick", ocean=files).ocean, 0.0).local
    assert local.attrs["centre_latitude_deg"] == pytest.approx(
        float(narrow["lat"].values[[0, -1]].mean())
    )
    assert mantaray("ocean", "check", *files, "--study", "quick").code == 0
    assert mantaray("ocean", "check", *files, "--study", "fram").code == 0, (
        "whose centre lies elsewhere"
    )
    far = preset_text("quick").replace("north = 2000.0", "north = 40000.0")
    (tmp_path / "far.toml").write_text(far, encoding="utf-8")
    result = mantaray("ocean", "check", *files, "--study", tmp_path / "far.toml")
    assert (result.code, "outside the domain" in result.out) == (2, True)
    assert result.out.splitlines()[-1].startswith("3 wrong, ")


def test_the_check_and_the_plot_tell_the_notes_of_a_reader(mantaray, monkeypatch, tmp_path):
    rows = ["depth,temperature,salinity", "0,2,30", "50,2,-9", "100,2,31", "200,2,32"]
    (tmp_path / "cast.csv").write_text("\n".join(["# lat 75, lon 1", *rows, ""]))
    done = mantaray("ocean", "check", tmp_path / "cast.csv", "--bathymetry", 200)
    assert done.code == 0
    assert "1 of 4 rows dropped: with " in done.err
    words = ("ocean", "plot", tmp_path / "cast.csv", "--bathymetry", 200, "--out", tmp_path / "p")
    monkeypatch.setattr("pymantaray.apps.ocean.write_ocean_plots", lambda *_, **__: [])
    assert "1 of 4 rows dropped: with " in mantaray(*words).err


def test_options_of_ice_and_profiles_are_checked_without_a_study(mantaray, ocean_file):
    assert mantaray("ocean", "check", ocean_file, "--ice", "2").code == 0
    for words, says in (
        (("--ice", "no_drafts.nc"), "no_drafts.nc: no such file"),
        (("--thin", "0.1"), "ocean.thin (--thin) applies to a profile"),
        (("--smooth", "10"), "ocean.smooth (--smooth) applies to a profile"),
    ):
        result = mantaray("ocean", "check", ocean_file, *words)
        assert result.code == 2
        assert result.out.startswith("wrong: water: ")
        assert says in result.out


def test_the_plan_of_a_fleet_holds_starts_targets_and_landmarks():
    config = load_study("beaufort")
    plan = planned_points(config)
    assert set(plan) == {v.name for v in config.fleet.vehicles} | {m.name for m in config.landmarks}
    floats = [v for v in config.fleet.vehicles if v.kind == "float"]
    assert floats
    for v in floats:
        np.testing.assert_allclose(plan[v.name][-1], [v.north, v.east, v.target_depth])
        assert plan[v.name][0, 2] < 1.0


def test_show_prints_extent_levels_time_and_ranges(mantaray, told, ocean_file, as_stored):
    with xr.open_dataset(ocean_file, engine="scipy") as data:
        spans = [
            f"{float(bound):.2f}" for bound in (data["water_temp"].min(), data["water_temp"].max())
        ]
    shown = [
        mantaray("ocean", "show", ocean_file, "--equation", name).out
        for name in ("teos-10", "unesco")
    ]
    for text in (
        "made up     yes",
        "2014-07-15 00:00 UTC",
        "17 points, 0.04 degrees apart",
        *spans,
    ):
        assert text in shown[0]
    assert "\n0 2 4 6 8 10 12" in shown[0]
    assert shown[0] != shown[1]
    as_stored(shown)
    values = told("ocean", "show", ocean_file)
    assert values["levels_m"][:3] == [0.0, 2.0, 4.0]
    assert values["region"]["grid points, latitude"] == 17
    temperature = values["variables"][0]
    assert temperature["units"] == "degC"
    assert [f"{temperature[bound]:.2f}" for bound in ("least", "greatest")] == spans


def test_show_has_the_domain_and_the_sea_floor_of_its_options(told, mantaray, ocean_file, tmp_path):
    whole = told("ocean", "show", ocean_file)["region"]
    part = told("ocean", "show", ocean_file, "--half-extent", 10000, "10km", "--bathymetry", 900)[
        "region"
    ]
    assert part["height [km]"] < 0.5 * whole["height [km]"]
    assert [part[f"{end} sea floor [m]"] for end in ("shallowest", "deepest")] == [900.0, 900.0]
    assert (
        "900 to 900 m, one depth" in mantaray("ocean", "show", ocean_file, "--bathymetry", 900).out
    )


def test_made_oceans_have_the_domain_and_refuse_a_sea_floor(
    mantaray, ocean_file, tmp_path, as_stored
):
    words = ("ocean", "perturb", ocean_file, tmp_path / "mean.nc", "--method", "mean")
    assert mantaray(*words, "--half-extent", 10000, "10km").code == 0
    with xr.open_dataset(ocean_file) as data, xr.open_dataset(tmp_path / "mean.nc") as mean:
        assert mean.sizes["lat"] < data.sizes["lat"]
    as_stored(tmp_path / "mean.nc")
    result = mantaray(*words, "--force", "--bathymetry", 900)
    assert (result.code, "--bathymetry applies to a profile here" in result.err) == (2, True)


def test_an_ocean_of_two_files_is_perturbed(mantaray, ocean_file, tmp_path):
    with xr.open_dataset(ocean_file) as data:
        data[["water_temp", "salinity"]].to_netcdf(tmp_path / "ts.nc")
        data[["water_u", "water_v"]].to_netcdf(tmp_path / "uv.nc")
    files = (tmp_path / "ts.nc", tmp_path / "uv.nc", tmp_path / "mean.nc")
    assert mantaray("ocean", "perturb", *files, "--method", "mean").code == 0


def test_what_is_left_out_of_a_cast_is_told_when_it_is_perturbed(mantaray, tmp_path):
    head = "depth,temperature,salinity,lat,lon"
    rows = [f"{z},{4 - 0.02 * z},34,74,-140" for z in range(0, 101, 20)]
    (tmp_path / "cast.csv").write_text("\n".join([head, *rows, "30,,34,74,-140"]))
    words = (tmp_path / "cast.csv", tmp_path / "mean.nc", "--method", "mean", "--bathymetry", 100)
    told = mantaray("ocean", "perturb", *words)
    assert (told.code, "1 of 7 rows dropped" in told.err) == (0, True), told.err


@pytest.mark.slow
def test_plot_writes_figures_and_refuses_places_outside(mantaray, ocean_file, tmp_path):
    folder = tmp_path / "figures"
    result = mantaray(
        "ocean", "plot", ocean_file, "--out", folder, "--depth", 60, "--at", "74.5,220"
    )
    names = [
        f"ocean_{n}.{k}"
        for n in ("profiles", "sections", "map", "sea_floor")
        for k in ("png", "pdf")
    ]
    assert result.code == 0
    assert sorted(path.name for path in folder.iterdir()) == sorted(names)
    assert result.out.split() == [str(folder / name) for name in names]
    for option, value, says in (
        ("--at", "10,10", "outside the ocean"),
        ("--at", "north", "2 numbers separated by commas"),
        ("--depth", 9_000, "not in the water"),
        ("--half-extent", "500km 500km", "does not fit into the data"),
    ):
        words = str(value).split()
        result = mantaray("ocean", "plot", ocean_file, "--out", tmp_path / "none", option, *words)
        assert (result.code, says in result.err) == (2, True)
    assert not (tmp_path / "none").exists()


@pytest.fixture
def make(mantaray, tmp_path, monkeypatch):
    """
    Run a command of `mantaray ocean` in a folder with a cast and an ocean of it; give its one line.
    """
    monkeypatch.chdir(tmp_path)
    Path("cast.csv").write_text(CAST)
    Path("warmer.csv").write_text(
        CAST.replace("0.4,30.7", "1.4,30.7").replace("lat 74.0", "lat 74.05")
    )
    levels = np.arange(0.0, 401.0, 25.0)
    ocean = cast_ocean(
        read_cast("cast.csv"), bathymetry=400.0, half_extent=(20e3, 20e3), levels=levels
    )
    write_netcdf(ocean, Path("ocean.nc"))

    def call(*words, code=0):
        files = set(Path().iterdir())
        result = mantaray("ocean", *words)
        assert result.code == code, result
        assert (result.err if code else result.out).count("\n") == 1
        assert not code or set(Path().iterdir()) == files
        return result.err if code else result.out

    return call


def load(path):
    with xr.open_dataset(path) as data:
        ocean = data.load()
    validate_ocean(ocean)
    return ocean


def of_cast(**options):
    return cast_ocean(read_cast("cast.csv"), **{"half_extent": (20e3, 30e3)} | options)


def member(seed):
    rng, casts = stream(seed, 0, "ocean", "perturb"), read_casts(["cast.csv", "warmer.csv"])
    options = {"rms": 0.5, "horizontal_scale": np.inf, "modes": vertical_modes(casts)}
    return perturb_ocean(open_ocean("ocean.nc"), rng=rng, **options)


BY_MODES = (
    "perturb ocean.nc new.nc --rms 0.5 --scale inf --mode-cast cast.csv --mode-cast warmer.csv"
)
MADE = {  # what is told, the command and what it calls
    "450 m; cast cast: 4 samples averaged onto": (
        ("from-cast cast.csv new.nc --below constant --half-extent 20km 30km"),
        lambda: of_cast(below="constant"),
    ),
    "300 m; cast cast": (
        ("from-cast cast.csv new.nc --bathymetry 300 --half-extent 20km 30km --force"),
        lambda: of_cast(bathymetry=300.0),
    ),
    "corrected with 2 casts (warmer, cast)": (
        "correct ocean.nc warmer.csv cast.csv new.nc --scale 3 --noise-ratio 0.01",
        lambda: correct_with_casts(
            open_ocean("ocean.nc"),
            read_casts(["warmer.csv", "cast.csv"]),
            horizontal_scale=3e3,
            noise_ratio=0.01,
        ),
    ),
    "sound speed perturbed by 1 vertical modes": (BY_MODES, lambda: member(0)),
    "perturbed by 1 vertical": (f"{BY_MODES} --seed 1", lambda: member(1)),
    "replaced by the horizontal mean": (
        "perturb ocean.nc new.nc --method mean",
        lambda: mean_ocean(open_ocean("ocean.nc")),
    ),
    "replaced by the column at 74 N, 140 W": (
        "perturb ocean.nc new.nc --method column --place 74 -140",
        lambda: column_ocean(open_ocean("ocean.nc"), (74.0, -140.0)),
    ),
}


@pytest.mark.parametrize("says", MADE)
def test_oceans_are_made_by_commands_as_by_functions(make, says, as_stored):
    words, function = MADE[says]
    line = make(*words.split())
    assert line.startswith("new.nc: ")
    assert says in line
    found, expected = load("new.nc"), function()
    as_stored({"line": line, "ocean": found})
    xr.testing.assert_equal(found, expected)
    seed = [f"seed {words.split()[-1] if '--seed' in words else 0}"] if BY_MODES in words else []
    assert found.attrs["history"].splitlines() == expected.attrs["history"].splitlines() + seed


@pytest.mark.parametrize(("words", "says"), [
    ("from-cast cast.csv new.nc", "above the bottom at 450 m"),
    ("from-cast cast.csv ocean.nc", "already exists; give another name or --force"),
    ("from-cast none.csv new.nc --bathymetry 300", "none.csv: no such file"),
    ("from-cast cast.csv new.nc --below constant --below-cast warmer.csv",
     "--below and --below-cast cannot be combined"),
    ("perturb ocean.nc ocean.nc --method mean --force", "is the input"),
    ("perturb ocean.nc new.nc", "--method eof needs --rms and --scale"),
    ("perturb ocean.nc new.nc --method mean --rms 1", "--method mean does not use --rms"),
    ("perturb ocean.nc new.nc --method mean --down-to 9 --mode-cast cast.csv",
     "--method mean does not use --down-to and --mode-cast; remove the option"),
    ("perturb ocean.nc new.nc --rms 0 --scale 10", "rms is 0; it must be positive"),
    ("check ocean.nc --bathymetry none.nc", "none.nc: no such file"),
    ("plot ocean.nc --out figures --bathymetry none.nc", "none.nc: no such file"),
])  # fmt: skip
def test_what_is_missing_or_in_the_way_is_one_line(make, words, says):
    assert says in make(*words.split(), code=2)


def test_help_tells_the_units(mantaray):
    """Brackets in a help text are taken for markup and vanish."""
    for command, units in (
        ("from-cast", ["--bathymetry METRES", "--lat DEGREES"]),
        ("perturb", ["--rms M/S", "--scale KM"]),
    ):
        shown = " ".join(mantaray("ocean", command, "--help").out.replace("│", " ").split())
        assert all(unit in shown for unit in units), shown


ASVP = (
    "( SoundVelocity  1.0 0 201407241920 74.50000000 -140.25000000 -1 0 0 OMS P 0003 )\n0"
    " 1436.1\n100.5 1440.2\n300 1450\n"
)


def test_casts_are_converted_or_refused_in_one_line(mantaray, tmp_path, monkeypatch, as_stored):
    monkeypatch.chdir(tmp_path)
    Path("sound.asvp").write_text(ASVP)
    table = "depth,temperature,salinity,lat,lon\n" + "".join(
        f"{z},1,{30 + 0.01 * z},74,-140\n" for z in range(1500)
    )
    Path("cast.csv").write_text(table)
    done = mantaray("ocean", "convert-cast", "sound.asvp", "again.nc")
    assert (done.code, done.out) == (0, "again.nc\n")
    assert mantaray("ocean", "convert-cast", "again.nc", "again.asvp").code == 0
    assert Path("again.asvp").read_text().splitlines()[1:4] == [
        "0.00 1436.10",
        "100.50 1440.20",
        "300.00 1450.00",
    ]
    as_stored([Path("again.nc"), Path("again.asvp").read_text()])
    time = ("--time", "2014-07-24T19:20")
    thin = mantaray("ocean", "convert-cast", "cast.csv", "thin.asvp", "--thin", 0.1, *time)
    assert (thin.code, len(Path("thin.asvp").read_text().splitlines()) < 50) == (0, True)
    for words, says in (
        (("cast.csv", "new.asvp"), "the time of cast is unknown"),
        (("cast.csv", "new.asvp", *time), "1501 levels; echo sounders accept at most 1000"),
        (("cast.csv", "new.asvp", "--name", "b"), "no cast 'b'; available: cast"),
        (("cast.csv", "new.txt"), "the name of the output must end in .asvp or .nc"),
        (("cast.csv", "new.nc", "--lat", 3), "--lat and --lon must be used together"),
    ):
        refused = mantaray("ocean", "convert-cast", *words)
        assert refused.code == 2
        assert says in refused.err
        assert len(refused.err.splitlines()) == 1
    assert not [*Path().glob("new.*")]


def test_rays_run_in_an_instruments_profile(told, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("sound.asvp").write_text(ASVP)
    Path("links.csv").write_text(
        "source_north,source_east,source_depth,receiver_north,receiver_east,receiver_depth\n0,0,50,500,0,80\n"
    )
    told(
        "rays",
        "times",
        "links.csv",
        "out.csv",
        "--profile",
        "sound.asvp",
        "--bathymetry",
        300,
        "--interpolation",
        "linear",
    )
    (row,) = pd.read_csv("out.csv").to_dict("records")
    assert row["travel_time_s"] == pytest.approx(
        np.hypot(500.0, 30.0) / 1438.7, rel=1e-4
    )  # at 65 m


def test_profiles_are_shown_without_a_sea_bed(mantaray, tmp_path, monkeypatch, as_stored):
    monkeypatch.chdir(tmp_path)
    Path("sound.asvp").write_text(ASVP)
    shown = mantaray("ocean", "show", "sound.asvp")
    assert shown.code == 0
    as_stored(shown.out)
    for words in (
        "profile     sound",
        "2014-07-24 19:20 UTC",
        "74.5 N, 140.25 W",
        "levels      3, 0 to 300 m",
        "1,450",
    ):
        assert words in shown.out, words
    Path("two.csv").write_text(
        "station,depth,sound_speed\nA,0,1500\nA,9,1501\nB,0,1510\nB,99,1511\n"
    )
    told = json.loads(mantaray("ocean", "show", "two.csv", "--json").out)
    assert [(one["profile"], one["sound_speed"]) for one in told["levels"]] == [
        ("A", [1500.0, 1501.0]),
        ("B", [1510.0, 1511.0]),
    ]


def test_check_show_and_plot_open_a_climatology_without_currents(
    mantaray, undrawn, tmp_path, ocean_file, as_stored
):
    """Of two instants, all take the first; the second is colder by 2 degC."""
    with xr.open_dataset(ocean_file) as one:
        first = one.load().drop_vars(["water_u", "water_v"])
    colder = first.assign(water_temp=first["water_temp"] - 2.0)
    both = xr.concat(
        [
            data.assign_coords(time=np.datetime64(f"2014-0{month}-15"))
            for data, month in ((first, 1), (colder, 7))
        ],
        "time",
    )
    both["time"].attrs |= {"standard_name": "time", "climatology": "bounds"}
    path = tmp_path / "two.nc"
    both.to_netcdf(path)
    line = "times       2; this is the first, --time selects another\n2014-01-15T00:00 2014-07-15"
    check = mantaray("ocean", "check", path)
    show = mantaray("ocean", "show", path)
    plot = mantaray("ocean", "plot", path, "--out", tmp_path / "figures")
    assert (check.code, show.code, plot.code) == (0, 0, 0), plot.err
    as_stored({"check": check.out, "show": show.out})
    assert line in check.out
    assert line in show.out
    assert line in plot.err
    assert "currents at rest" in check.out
    assert f"{float(first['water_temp'].max()):.4g}"[:4] in show.out
    assert mantaray("ocean", "correct", path, path, tmp_path / "new.nc").code == 2  # needs currents


def test_a_range_in_another_form_names_its_own(mantaray, tmp_path):
    Path(tmp_path / "p.csv").write_text("depth,sound_speed\n0,1500\n99,1500\n")
    done = mantaray(
        "table",
        tmp_path / "p.csv",
        "--source-depth",
        "0-20",
        "--receiver-depth",
        "0:9",
        "--range",
        "9:99",
    )
    assert "found '0-20'; it must be START:STOP[:STEP] in metres, such as 0:200:5" in done.err


def test_a_section_shows_its_ranges(mantaray, told, tmp_path):
    (tmp_path / "s.csv").write_text(",0,1000,5000\n0,1500,1501,1502\n100,1490,1491,1492\n")
    region = told("ocean", "show", tmp_path / "s.csv")["region"]
    rows = {row["property"]: row["s.csv"] for row in region}
    assert (rows["north [km]"], rows["east [km]"]) == ("0 to 5", "-5 to 5")


def test_water_in_metres_shows_its_region(mantaray, told, tmp_path, as_stored):
    axes = {"north": [-1e3, 1e3], "east": [-2e3, 2e3], "depth": [0.0, 100.0, 400.0]}
    speed = np.broadcast_to([1450.0, 1440.0, 1455.0], (2, 2, 3))
    floor = {"sea_floor_depth": (("north", "east"), np.full((2, 2), 400.0))}
    water = xr.Dataset({"sound_speed": (tuple(axes), speed)} | floor, axes)
    for name in axes:
        water[name].attrs["units"] = "m"
    water.to_netcdf(tmp_path / "metres.nc")
    rows = told("ocean", "show", tmp_path / "metres.nc")["region"]
    shown = mantaray("ocean", "show", tmp_path / "metres.nc").out
    as_stored(shown)
    assert len(rows) > 2
    assert any("1440" in str(value) for row in rows for value in row.values())
    assert all(str(next(iter(row.values()))) in shown for row in rows)


GRID = (
    "--bathymetry 390 --crs EPSG:3996 --currents carry --equation unesco --centre 74.1 -140.2"
    " --half-extent 9km 11000 --time 2014-07-24T19:20 --repair-freezing"
    " --name temp=sea_water_temperature"
)
RAYS = (
    "--ice 2 --ice-slope 3 --ice-length 4 --interpolation linear --earth sphere --thin 0.5"
    " --smooth 6"
)
HERE = "--half-extent 9km 11000 --equation unesco --centre 74.01 -140.02 --currents rest"
KNOWN = r"attrs|^0\.(lat|lon|depth|time|water_[uv])"  # of the ocean
ON_A_GRID = {
    "check": "check ocean.nc",
    "show": "show ocean.nc",
    "plot": "plot ocean.nc --out p",
    "perturb": "perturb ocean.nc new.nc --method mean",
    "correct": "correct ocean.nc cast.csv new.nc",
}


@pytest.mark.parametrize("options", [GRID, "", "--position 73 -139"], ids=["all", "none", "place"])
@pytest.mark.parametrize("command", ON_A_GRID)
def test_every_option_reaches_the_configuration_of_the_ocean(make, reached, command, options):
    words = (*ON_A_GRID[command].split(), *options.split())
    given = reached("pymantaray.config.door.water.configuration_of", "ocean", *words)
    time = given[1].get("time")
    assert (time and time.isoformat()) == ("2014-07-24T19:20:00" if options == GRID else None)


CHECKED = {
    "levels": f"ocean.nc {HERE} --time 2014-07-24T19:20",
    "floor": f"ocean.nc {HERE} --bathymetry 390",
    "profile": "cast.csv --half-extent 9km 11000 --equation unesco --bathymetry 390",
    "study": "ocean.nc --study quick --half-extent 5km 6km --set fleet.vehicles.B.target_depth=99",
}


@pytest.mark.parametrize("how", CHECKED)
def test_every_option_reaches_the_check(make, reached, how):
    given = reached("pymantaray.ocean.check_ocean", "ocean", "check", *CHECKED[how].split())
    assert isinstance(given[0], xr.Dataset) == (how in ("floor", "profile"))


def test_every_option_reaches_the_check_of_water(make, reached):
    rays = RAYS.removesuffix(" --smooth 6").split()
    words = ("ocean", "check", "cast.csv", "--bathymetry", 390, "--half-extent", 9, 11, *rays)
    reached("pymantaray.config.door.water.open_water", *words)


def test_every_option_reaches_the_study_of_the_check(make, reached):
    words = ("--study", "quick", "--set", "noise.range_sigma=7", *GRID.split(), *RAYS.split())
    given = reached("pymantaray.config.load_study", "ocean", "check", "a.nc", "b.nc", *words)
    assert given["ocean.time"].isoformat() == "2014-07-24T19:20:00"
    assert given["ocean"] == ["a.nc", "b.nc"]


@pytest.mark.parametrize("function", ["ocean_facts", "region_table", "variable_table"])
def test_every_option_reaches_the_tables_that_are_shown(make, reached, function):
    words = ("ocean", "show", "ocean.nc", *HERE.split(), "--bathymetry", 390)
    reached(f"pymantaray.ocean.summary.{function}", *words, without=KNOWN)


def test_every_option_reaches_what_is_shown(make, mantaray, told, as_stored):
    words = ("ocean", "show", "ocean.nc", *HERE.split(), "--bathymetry", 390)
    done = mantaray(*words, "--to", "csv")
    as_stored([done.out, done.err], name="csv")
    history = mantaray(*words).out.partition("\nhistory\n")[2].splitlines()
    assert told(*words)["history"] == history != []


def test_every_option_reaches_profiles_that_are_shown(make, mantaray, told, as_stored):
    Path("two.csv").write_text(
        "station,depth,temperature,salinity\nA,0,1,30\nA,9,2,31\nB,0,3,32\nB,99,4,33\nB,120,,34\n"
    )
    words = ("ocean", "show", "two.csv", "--equation", "unesco", "--position", 70, -130)
    done, one = mantaray(*words), mantaray("ocean", "show", "cast.csv", *words[3:])
    as_stored([done.out.splitlines(), done.err, one.out.splitlines(), one.err])
    told(*words)


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_every_option_reaches_the_plots(make, reached, mantaray, monkeypatch, quiet):
    words = ("ocean", "plot", "ocean.nc", *HERE.split(), "--bathymetry", 390, "--out", "p", *quiet)
    function = "pymantaray.apps.ocean.write_ocean_plots"
    where = ("--depth", "0.1km", "--at", "74.02,-140.03", "--format", "svg,84mm")
    given = reached(function, *words, *where, without=KNOWN)
    assert given[1] == Path("p")
    monkeypatch.setattr(function, lambda *_, **__: [Path("p/a.png"), Path("p/a.pdf")])
    done = mantaray(*words)
    assert done.out == "p/a.png\np/a.pdf\n"
    assert (done.err == "") == bool(quiet) or not quiet


CAST_OPTIONS = "--lat 73 --lon -139 --time 2014-07-25T10:00 --name cast --repair-freezing"
UNIFORM = "--bathymetry 0.5km --half-extent 9km 11000 --equation unesco"


def test_every_option_reaches_the_ocean_of_a_cast(make, mantaray, reached, monkeypatch, as_stored):
    words = ("ocean", "from-cast", "cast.csv", "new.nc", *CAST_OPTIONS.split(), *UNIFORM.split())
    assert reached("pymantaray.ocean.read_cast", *words)[0] == Path("cast.csv")
    reached("pymantaray.ocean.cast_ocean", *words, "--below", "constant")
    read = []
    monkeypatch.setattr(
        "pymantaray.ocean.read_cast", lambda *a, **k: read.append([*a, k]) or read_cast(*a, **k)
    )
    Path("deeper.csv").write_text(
        CAST.replace("400,0.6,34.8", "400,0.6,34.8\n500,,34\n600,0.5,34.9")
    )
    done = mantaray(*words, "--below-cast", "deeper.csv")
    assert read[1][0] == Path("deeper.csv")
    as_stored([read[1][1], done.out, done.err, Path("new.nc")])


def test_every_option_reaches_the_profiles_that_are_written(make, reached, spied, as_stored):
    table = ["station,depth,temperature,salinity"]
    table += [f"{s},{10 * z},{1 + 0.1 * z**1.5},{30 + z}" for s in ("A", "B") for z in range(9)]
    Path("two.csv").write_text("\n".join([*table, "B,200,,30"]))
    convert = ("ocean", "convert-cast", "two.csv")
    place = ("--lat", 73, "--lon", -139, "--repair-freezing")
    which = (*place, "--time", "2014-07-25T10:00", "--name", "B")
    few = (*which, "--thin", 0.2)
    reached("pymantaray.acoustics.read_profiles", *convert, "new.nc", *place)
    given = reached("pymantaray.acoustics.thin_profile", *convert, "new.nc", *few)
    assert given["interpolation"] == "linear"
    reached("pymantaray.acoustics.write_asvp", *convert, "new.asvp", *few)
    Path("new.nc").write_text("")
    words = (*convert, "new.nc", *which[:-2], "--force")
    given = spied("pymantaray.acoustics.write_profiles", *words)
    assert given[0] == Path("new.nc")
    as_stored(given[1])


@pytest.fixture
def spied(mantaray, monkeypatch):
    """What a command gives a function of the library, which is not done, and is not stored."""

    def call(function, *words):
        given = []
        with monkeypatch.context() as patch:
            patch.setattr(function, lambda *a, **k: given.append({**dict(enumerate(a)), **k}))
            done = mantaray(*words)
        assert (done.code, len(given)) == (0, 1), done.err
        return given[0] | {"done": done}

    return call


CASTS = [Path("warmer.csv"), Path("cast.csv")]
FIELDS = f"{HERE} --time 2014-07-24T19:20 --repair-freezing".split()


def test_every_option_reaches_the_correction(make, mantaray, reached, as_stored):
    words = ("ocean", "correct", "ocean.nc", *CASTS, "new.nc", *FIELDS)
    given = reached("pymantaray.ocean.read_casts", *words)
    assert given[0] == CASTS
    scales = ("--scale", "7000m", "--noise-ratio", 0.3, "--vertical-scale", "0.2km")
    time = ("--time-scale", "36 h")
    reached("pymantaray.ocean.correct_with_casts", *words, *scales, *time, without=KNOWN)
    Path("bare.csv").write_text(CAST.replace("50,0.4,30.7", "50,,30.7"))
    done = mantaray(*words[:3], "bare.csv", "new.nc", *scales, "--time-scale", 2)
    as_stored([done.out, done.err, Path("new.nc")], name="written")


def test_every_option_reaches_the_perturbation(make, mantaray, reached, as_stored):
    words = ("ocean", "perturb", "ocean.nc", "new.nc", *FIELDS)
    modes = (*words, "--mode-cast", "warmer.csv", "--mode-cast", "cast.csv")
    member = ("--rms", "20 cm/s", "--scale", "8000m", "--down-to", "0.2km", "--seed", 3)
    given = reached("pymantaray.ocean.read_casts", *modes, *member)
    assert given[0] == CASTS
    reached("pymantaray.ocean.vertical_modes", *modes, *member)
    given = reached("pymantaray.ocean.perturb_ocean", *modes, *member, without=KNOWN)
    expected = stream(3, 0, "ocean", "perturb")
    assert given["rng"].bit_generator.state == expected.bit_generator.state


def test_notes_of_casts_for_modes_are_told(make, mantaray, as_stored):
    Path("bare.csv").write_text(CAST.replace("50,0.4,30.7", "50,,30.7"))
    words = ("ocean", "perturb", "ocean.nc", "new.nc", *FIELDS)
    modes = ("--mode-cast", "bare.csv", "--mode-cast", "warmer.csv")
    done = mantaray(*words, *modes, "--rms", "20 cm/s", "--scale", "8000m", "--seed", 3)
    as_stored([done.out, done.err, Path("new.nc")])


@pytest.mark.parametrize("function", ["mean_ocean", "column_ocean"])
def test_every_option_reaches_the_uniform_ocean(make, reached, function):
    words = ("ocean", "perturb", "ocean.nc", "new.nc", *FIELDS)
    method = ("--method", "column", "--place", 74.03, -140.04)
    reached(
        f"pymantaray.ocean.{function}",
        *words,
        *(method if function == "column_ocean" else ("--method", "mean")),
        without=KNOWN,
    )


OUTPUTS = {  # input files of commands that write
    "from-cast cast.csv new.nc": ["cast.csv"],
    "convert-cast cast.csv new.nc": ["cast.csv"],
    "correct ocean.nc warmer.csv cast.csv new.nc": ["ocean.nc", "warmer.csv", "cast.csv"],
    "perturb a.nc b.nc new.nc --rms 1 --scale 2 --mode-cast cast.csv --mode-cast warmer.csv": [
        "a.nc", "b.nc", "cast.csv", "warmer.csv",
    ],
}  # fmt: skip


@pytest.mark.parametrize("words", OUTPUTS)
def test_every_option_reaches_the_check_of_the_output(make, mantaray, monkeypatch, words):
    for name in ("a.nc", "b.nc"):
        Path(name).write_text("")
    given = []

    def check(*arguments, **options):
        given.append((arguments, options))
        raise OceanError("reached")

    monkeypatch.setattr("pymantaray.apps.ocean.command.check_output", check)
    for force in ((), ("--force",)):
        assert mantaray("ocean", *words.split(), *force).code == 2
    endings = [".asvp", ".nc"] if "convert" in words else [".nc"]
    inputs = [Path(name) for name in OUTPUTS[words]]
    assert given == [
        ((Path("new.nc"), endings), {"inputs": inputs, "force": force}) for force in (False, True)
    ]


WINDOW = "--lat 74.1,74.9 --lon 170,-170 --time 2014-07-15T12 --out fetched --servers mine --force"


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_every_option_reaches_the_fetch_of_hycom(reached, quiet):
    words = ["--nearest", "--experiment", "GLBy0.08", "--attempts", "3", "--time-limit", "77"]
    function = "pymantaray.ocean.fetch.fetch_hycom"
    given = reached(function, "ocean", "fetch", "hycom", *WINDOW.split(), *words, *quiet)
    assert given["out"] == Path("fetched")


def test_every_option_reaches_the_fetch_of_copernicus(reached):
    function = "pymantaray.ocean.fetch.fetch_copernicus"
    words = ("ocean", "fetch", "copernicus", *WINDOW.split(), "--product", "GLORYS")
    assert reached(function, *words)["out"] == Path("fetched")


@pytest.mark.parametrize("name", ["hycom", "copernicus"])
def test_what_was_fetched_is_told(mantaray, monkeypatch, name):
    from pymantaray.ocean.fetch import FetchResult

    result = FetchResult(
        Path("f/new.nc"), "A title", np.datetime64("2014-07-15"), 12, ("one", "two")
    )
    monkeypatch.setattr(f"pymantaray.ocean.fetch.fetch_{name}", lambda **_: result)
    done = mantaray("ocean", "fetch", name, *WINDOW.split(), "--verbose")
    assert (done.code, done.out) == (0, "f/new.nc\n")
    lines = done.err.splitlines()
    assert lines[:3] == ["warning: one", "warning: two", "A title: 12 requests"]
