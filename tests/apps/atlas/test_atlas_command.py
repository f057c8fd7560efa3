"""`mantaray atlas` as a user meets it."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from factories import pool_here

WORDS = (
    "--pair",
    "20,100",
    "--distances",
    "1000,2000",
    "--bearings",
    "2",
    "--every",
    "6",
    "--workers",
    "1",
)


def test_an_atlas_from_an_ocean_to_its_figures(
    mantaray, told, undrawn, ocean_file, monkeypatch, tmp_path, as_stored
):
    monkeypatch.setattr("pymantaray.apps.atlas.runner.open_pool", pool_here)
    out = tmp_path / "atlas.nc"
    ran = mantaray("atlas", "run", ocean_file, "--out", out, *WORDS)
    assert (ran.code, ran.err) == (0, "")
    lines = ran.out.splitlines()
    assert lines[0] == "3 x 5 columns, 1 instant, 4 links each; 1 block"
    assert lines[-1] == str(out)
    assert sum(line.startswith(" transmitter ") for line in lines) == 2
    assert not list(tmp_path.glob("*.blocks"))
    shown = mantaray("atlas", "show", out)
    assert shown.out.startswith("Bias of straight-line ranging: Beaufort Sea (synthetic)\n")
    assert "nominal" in shown.out
    as_stored({"ran": lines[:-1], "shown": shown.out})
    atlas = told("atlas", "show", out)
    assert atlas["title"] == shown.out.splitlines()[0]
    assert atlas["safety"][0].keys() > {
        "convention",
        "distance_m",
        "median_m",
        "safe_to_1m_percent",
    }
    again = told("atlas", "run", ocean_file, "--out", out, *WORDS, "--force")
    assert again == {
        "columns_lat": 3,
        "columns_lon": 5,
        "instants": 1,
        "links": 4,
        "notes": [],
        "file": str(out),
    } | {"safety": atlas["safety"]}
    with xr.open_dataset(out) as atlas:
        assert dict(atlas.sizes)["distance"] == 2
        assert np.isfinite(atlas["range_error"]).any()
    plotted = mantaray("atlas", "plot", out, "--out", tmp_path / "plots", "--convention", "mean")
    assert plotted.code == 0
    names = sorted(path.name for path in (tmp_path / "plots").iterdir())
    figures = [
        f"atlas_{name}.{kind}"
        for name in ("conventions", "error", "safe")
        for kind in ("pdf", "png")
    ]
    assert names == sorted([*figures, "index.html"])


LINKED = (
    *("--distances", "1 km,3000", "--bearings", 3, "--safe", "0.5,4", "--within-db", 7),
    *("--nominal", 1480, "--tolerance", "2 mm", "--cutoff-db", 21),
    *("--max-surface-bounces", 2, "--max-bottom-bounces", 3),
)
PROCESSES = ("--workers", 3, "--scheduler", "tcp://there:8786", "--force")


@pytest.mark.parametrize(
    "pairs",
    [("--depths", "30,150 m"), ("--pair", "20,100", "--pair", "50 m,7")],
    ids=["depths", "pairs"],
)
def test_every_option_reaches_the_atlas(reached, ocean_file, tmp_path, pairs):
    out = tmp_path / "a.nc"
    words = ("atlas", "run", ocean_file, "--out", out, *LINKED, *pairs, "--every", 4)
    window = ("--window", "73.5,74.9,-141,-139.2")
    span = ("--start", "2014-07-14", "--stop", "2014-07-16", "--step-h", "2 d")
    made = "pymantaray.apps.atlas.Atlas"
    given = reached(made, *words, *window, *span, "--interpolation", "linear")
    assert given[0].ocean.source == (str(ocean_file),)
    started = "pymantaray.apps.atlas.run_atlas"
    xr.Dataset().to_netcdf(out)
    given = reached(started, *words, *window, *span, *PROCESSES, without="^[01]")
    assert given[0].shape == (1, 4, 6)
    assert (given[1], given["workers"], given["client"]) == (out, 3, "tcp://there:8786")


def test_every_option_reaches_the_instants_of_an_atlas(reached, ocean_file, tmp_path):
    words = ("atlas", "run", ocean_file, "--out", tmp_path / "a.nc", "-q")
    span = ("--start", "2014-07-14", "--stop", "2014-07-16", "--step-h", "2 d")
    found = "pymantaray.apps.atlas.plan.instants_between"
    reached(found, *words, *span)
    made = "pymantaray.apps.atlas.Atlas"
    times = ("--time", "2014-07-15", "--time", "2014-07-16T06:00")
    reached(made, *words, *times)
    xr.Dataset().to_netcdf(tmp_path / "a.nc")
    given = reached("pymantaray.apps.atlas.run_atlas", *words, without="^[01]")
    assert (given["workers"], given["progress"]) == (None, None)


PLACES = {"--centre": (74.5, -140.25), "--position": (-33.5, 151.25)}


@pytest.mark.parametrize("place", PLACES)
def test_every_option_reaches_the_water_of_an_atlas(reached, ocean_file, tmp_path, place):
    words = (
        *("--bathymetry", "2.1 km", "--crs", "EPSG:3996", "--currents", "carry"),
        *("--equation", "unesco", "--half-extent", "4 km", 3000, "--time", "2014-07-15"),
        *("--repair-freezing", "--name", "temp=sea_water_temperature", "--ice", "2.5 m"),
        *("--ice-slope", 12, "--ice-length", "25 m", "--interpolation", "linear"),
        *("--earth", "sphere", "--thin", 0.05, "--smooth", "6 m", place, *PLACES[place]),
    )
    used = "pymantaray.config.door.water.configuration_of"
    atlas = ("atlas", "run", ocean_file, "more.nc", "--out", tmp_path / "atlas.nc")
    (tmp_path / "more.nc").touch()
    given = reached(used, *atlas[:3], tmp_path / "more.nc", *atlas[4:], *LINKED, *words)
    assert given[0] == [str(ocean_file), str(tmp_path / "more.nc")]
    assert "time" not in given[1]  # the atlas itself has several


@pytest.fixture
def opened(monkeypatch, tmp_path):
    """An atlas that is opened as it is."""
    atlas = xr.Dataset(attrs={"title": "made up"})
    file = tmp_path / "atlas.nc"
    file.touch()
    monkeypatch.setattr("pymantaray.apps.atlas.open_atlas", {file: atlas}.__getitem__)
    return atlas


def test_every_option_reaches_the_figures_of_an_atlas(
    reached, mantaray, opened, tmp_path, monkeypatch
):
    words = ("atlas", "plot", tmp_path / "atlas.nc", "--out", tmp_path / "plots")
    more = ("--convention", "chord", "--distance", "2 km", "--pair", "20 m,100")
    drawn = "pymantaray.apps.atlas.write_atlas_plots"
    more += ("--at", "74.5,-140.25", "--format", "png,84mm")
    given = reached(drawn, *words, *more)
    assert given[0] is opened
    assert (given[1], given["distance"]) == (tmp_path / "plots", 2000.0)
    monkeypatch.setattr(drawn, lambda *_, **given: [Path("a.png"), Path(str(given["progress"]))])
    pages = []
    monkeypatch.setattr(
        "pymantaray.apps.atlas.write_atlas_page", lambda *given: pages.append(given) or given[2]
    )
    done = mantaray(*words, "--quiet")
    assert done.out.splitlines() == ["a.png", "None", str(tmp_path / "plots")]
    assert pages == [(opened, [Path("a.png"), Path("None")], tmp_path / "plots")]


def test_figures_of_an_atlas_have_defaults(reached, opened, tmp_path):
    words = ("atlas", "plot", tmp_path / "atlas.nc", "--out", tmp_path / "plots")
    given = reached("pymantaray.apps.atlas.write_atlas_plots", *words, without="^0")
    assert given["distance"] is None


def test_every_option_reaches_the_table_of_an_atlas(reached, opened, tmp_path):
    words = ("atlas", "show", tmp_path / "atlas.nc")
    given = reached("pymantaray.apps.atlas.safety_table", *words)
    assert given[0] is opened
    reached("pymantaray.apps.atlas.command.printer", *words, "--json", "--to", "csv")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            ("--distances", "far"),
            (
                "mantaray atlas run: Invalid value for '--distances': 'far'; it must be numbers"
                " separated by commas"
            ),
        ),
        (
            ("--pair", "20"),
            (
                "mantaray atlas run: Invalid value for '--pair': '20'; it must be 2 numbers"
                " separated by commas"
            ),
        ),
        (
            ("--window", "1,2,3"),
            (
                "mantaray atlas run: Invalid value for '--window': '1,2,3'; it must be 4 numbers"
                " separated by commas"
            ),
        ),
        (("--start", "2014-07-15"), "--start and --stop must be used together and without --time"),
        (("--step-h", "6"), "--step-h needs --start and --stop; give both"),
        (
            ("--time", "2015-01-01"),
            "time 2015-01-01T00:00: not in the ocean, which has 1 from 2014-07-15T00:00 to",
        ),
        (
            ("--cutoff-db", "-3"),
            "--cutoff-db is -3; it must be a positive number of decibels, or none",
        ),
    ],
)
def test_what_cannot_be_is_one_line(mantaray, ocean_file, tmp_path, words, line):
    ran = mantaray("atlas", "run", ocean_file, "--out", tmp_path / "atlas.nc", *words)
    assert ran.code == 2
    assert ran.err.startswith(f"error: {line}")
    assert ran.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("group", ["atlas", "study", "sweep"])
def test_who_leaves_out_run_is_told_of_it(mantaray, group):
    ran = mantaray(group, "ocean.nc", "--out", "atlas.nc")
    assert ran.code == 2
    assert "No such command 'ocean.nc'; allowed: " in ran.err
    assert f"mantaray {group} run ocean.nc" in ran.err


def test_an_ocean_is_not_overwritten_by_its_atlas(mantaray, ocean_file, tmp_path):
    ran = mantaray("atlas", "run", ocean_file, "--out", ocean_file, "--force")
    assert (ran.code, ran.err) == (2, f"error: {ocean_file}: is the input; give another name\n")
    assert mantaray("atlas", "show", ocean_file).err.startswith(
        f"error: {ocean_file}: not an atlas of this version"
    )
