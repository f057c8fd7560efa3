"""Commands that make oceans, run as a user would: files in, files out, one line each."""

from pathlib import Path

import numpy as np
import pytest
import typer
import xarray as xr
from typer.testing import CliRunner

from pymantaray.cli.ocean_make import register
from pymantaray.errors import MantaRayError
from pymantaray.ocean.cast_ocean import cast_ocean
from pymantaray.ocean.casts import read_cast
from pymantaray.ocean.schema import validate_ocean
from pymantaray.records import write_netcdf

CAST = """# drop 9, 2014-07-24/1920 UTC, lat 74.0, lon -140.0; bottom 450 m
depth_m,temperature_degC,practical_salinity
2,-1.2,27.2
50,0.4,30.7
120,-1.4,32.5
400,0.6,34.8
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a command in a folder with a cast and an ocean of another one."""
    monkeypatch.chdir(tmp_path)
    Path("cast.csv").write_text(CAST)
    Path("warmer.csv").write_text(CAST.replace("0.4,30.7", "1.4,30.7").replace("lat 74.0", "lat 74.05"))
    ocean = cast_ocean(
        read_cast("cast.csv"),
        bottom_depth=400.0,
        half_extent=(20e3, 20e3),
        levels=np.arange(0.0, 401.0, 25.0),
    )
    write_netcdf(ocean, Path("ocean.nc"))
    app = typer.Typer()
    register(app)

    def call(*words):
        return CliRunner().invoke(app, [str(word) for word in words])

    return call


def load(path):
    with xr.open_dataset(path) as data:
        ocean = data.load()
    validate_ocean(ocean)
    return ocean


def refused(done):
    assert isinstance(done.exception, MantaRayError), (done.output, done.exception)
    assert not list(Path().glob("*.part"))
    return str(done.exception)


def test_an_ocean_from_a_cast(run):
    done = run("from-cast", "cast.csv", "new.nc", "--below", "constant", "--half-extent", 20, 30)
    assert done.exit_code == 0, done.exception
    assert done.output.count("\n") == 1
    assert done.output.startswith("new.nc: ")
    assert "450 m; cast cast: 4 samples averaged onto" in done.output
    ocean = load("new.nc")
    assert ocean["depth"].values[-1] == 450.0
    assert "extended from 400 m down to the bottom at 450 m" in ocean.attrs["history"]
    assert not list(Path().glob("*.part"))


def test_what_is_missing_or_in_the_way_is_one_line(run):
    assert "above the bottom at 450 m" in refused(run("from-cast", "cast.csv", "new.nc"))
    assert "exists already; give another name or --force" in refused(run("from-cast", "cast.csv", "ocean.nc"))
    assert "must end in .nc" in refused(run("from-cast", "cast.csv", "new.txt"))
    assert "there is no folder no; make it first" in refused(run("from-cast", "cast.csv", "no/new.nc"))
    assert "cannot be read: No such file" in refused(run("from-cast", "none.csv", "new.nc", "--bottom", 300))
    assert "is the input" in refused(run("perturb", "ocean.nc", "ocean.nc", "--method", "mean", "--force"))
    assert "--below and --below-cast exclude each other" in refused(
        run("from-cast", "cast.csv", "new.nc", "--below", "constant", "--below-cast", "warmer.csv")
    )
    assert not Path("new.nc").exists()


def test_an_existing_file_is_replaced_when_asked(run):
    before = Path("ocean.nc").read_bytes()
    assert run("from-cast", "cast.csv", "ocean.nc", "--bottom", 300, "--force").exit_code == 0
    assert Path("ocean.nc").read_bytes() != before
    assert load("ocean.nc")["depth"].values[-1] == 300.0


def test_an_ocean_is_corrected_by_casts(run):
    done = run("correct", "ocean.nc", "warmer.csv", "cast.csv", "new.nc", "--scale", 3, "--noise-ratio", 0.01)
    assert done.exit_code == 0, done.exception
    assert done.output.count("\n") == 1
    before, after = load("ocean.nc"), load("new.nc")
    change = (after["water_temp"] - before["water_temp"]).sel(depth=50.0)
    assert 0.3 < float(change.interp(lat=74.05, lon=-140.0)) < 1.1
    assert abs(float(change.interp(lat=74.0, lon=-140.0))) < 0.05
    assert "corrected by 2 casts (warmer, cast)" in after.attrs["history"]


def test_members_are_repeatable_by_their_seed(run):
    words = ("perturb", "ocean.nc")
    options = ("--method", "gaussian-process", "--rms", 0.5, "--scale", 10, "--vertical-scale", 50)
    outs = []
    for name, seed in (("a.nc", 1), ("b.nc", 1), ("c.nc", 2)):
        done = run(*words, name, *options, "--seed", seed)
        assert done.exit_code == 0, done.exception
        assert "sound speed perturbed by a Gaussian process" in done.output
        outs.append(load(name))
    assert outs[0].identical(outs[1])
    assert not np.allclose(outs[0]["water_temp"], outs[2]["water_temp"], atol=1e-3)
    assert outs[0].attrs["history"].endswith("seed 1")


def test_modes_of_casts_and_one_column(run):
    options = ("--rms", 0.5, "--scale", "inf", "--mode-cast", "cast.csv", "--mode-cast", "warmer.csv")
    assert run("perturb", "ocean.nc", "a.nc", *options).exit_code == 0
    change = load("a.nc")["water_temp"] - load("ocean.nc")["water_temp"]
    assert float(np.abs(change).max("depth").std()) < 1e-3  # the same everywhere
    assert int(np.abs(change.values[:, 0, 0]).argmax()) == 2  # at 50 m, where the casts differ
    done = run("perturb", "ocean.nc", "b.nc", "--method", "column", "--place", 74, -140)
    assert done.exit_code == 0, done.exception
    assert "perturbation eof: horizontal_scale and rms needed" in refused(run("perturb", "ocean.nc", "c.nc"))


def test_help_tells_the_units():
    """Brackets in a help text are taken for markup and vanish."""
    app = typer.Typer()
    register(app)
    for command, units in (("from-cast", ["in m", "in km"]), ("perturb", ["in m/s", "in km"])):
        shown = " ".join(CliRunner().invoke(app, [command, "--help"]).stdout.replace("│", " ").split())
        assert all(unit in shown for unit in units), shown
