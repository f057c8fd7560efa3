"""`mantaray atlas` as a user meets it."""

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
