"""The command line called in process, and input files small enough to run."""

import itertools
import json
from functools import cache
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from pymantaray.cli.main import main, tree
from pymantaray.config import load_study, study_toml
from pymantaray.errors import MantaRayError
from pymantaray.pages.page import Page
from pymantaray.plotting import drawing

WATER_WORDS = (
    "--bathymetry 390 --crs EPSG:3996 --currents carry --equation unesco --centre 74.1 -140.2"
    " --half-extent 9km 11000 --time 2014-07-24T19:20 --repair-freezing"
    " --name temp=sea_water_temperature --ice 2 --ice-slope 3 --ice-length 4"
    " --interpolation linear --earth sphere --thin 0.5 --smooth 6 --max-surface-bounces 1"
    " --max-bottom-bounces 2 --cutoff-db 25"
)
"""Every option of water and of arrivals, each with another value than its default."""


@cache
def registered_commands():
    """Every command that is no group, by its words."""

    def below(group, words=()):
        for name, command in group.commands.items():
            if hasattr(command, "commands"):
                yield from below(command, (*words, name))
            else:
                yield " ".join((*words, name)), command

    return dict(below(tree()))


@pytest.fixture
def mantaray(capsys, monkeypatch):
    """
    Call `mantaray` with words; give its exit code and what it printed, which is the same on a busy
    machine.
    """
    monkeypatch.setattr("pymantaray.cli.output._LINE_INTERVAL", 3600.0)

    def call(*words):
        capsys.readouterr()
        with pytest.raises(SystemExit) as exit_info:
            main([str(word) for word in words])
        printed = capsys.readouterr()
        return SimpleNamespace(code=exit_info.value.code or 0, out=printed.out, err=printed.err)

    return call


@pytest.fixture
def undrawn(monkeypatch):
    """Pages whose figures are not drawn into their files, which takes longest, but small images."""
    with BytesIO() as file:
        Image.new("L", (8, 6)).save(file, "PNG")
        small = file.getvalue()
    # modules that have the function
    for module in ("plotting.drawing", "plotting.style", "apps.rays.figures"):
        monkeypatch.setattr(
            f"pymantaray.{module}.rendered", lambda _, kinds, **__: dict.fromkeys(kinds, small)
        )


@pytest.fixture
def columns():
    """Layouts for one column of the figures that are `drawn`."""
    return []


@pytest.fixture
def drawn(undrawn, columns, monkeypatch):
    """Figures and contents of pages that are made; files have small images."""
    made, small, files = SimpleNamespace(figures=[], pages=[]), drawing.rendered, Page.files

    def rendered(figure, *arguments, **options):
        (made.figures if "dpi" in options else columns).append(figure)
        return small(figure, *arguments, **options)

    monkeypatch.setattr(drawing, "rendered", rendered)
    monkeypatch.setattr(Page, "files", lambda page, *a: made.pages.append(page) or files(page, *a))
    return made


@pytest.fixture
def told(mantaray, as_stored):
    """
    Call `mantaray` with words and ``--json``: what it told, which is one JSON object without NaN
    and nothing else. Its numbers are compared with stored ones; `without` leaves some out.
    """
    calls = itertools.count(1)

    def call(*words, code=0, without="(?!)"):
        done = mantaray(*words, "--json")
        assert done.code == code, done.err
        result = json.loads(done.out, parse_constant=lambda word: pytest.fail(word))
        as_stored(result, without=without, name=f"told {next(calls)}")
        return result

    return call


@pytest.fixture
def reached(mantaray, monkeypatch, as_stored):
    """
    Call `mantaray` with words until it calls a function of the library, which is not done: what it
    is given, which is stored, functions by their presence.
    """

    def call(function, *words, without="(?!)"):
        given = []

        def instead(*arguments, **options):
            given.append({**dict(enumerate(arguments)), **options})
            raise MantaRayError("reached")

        with monkeypatch.context() as patch:
            patch.setattr(function, instead)
            done = mantaray(*words)
        assert (done.code, len(given)) == (2, 1), done.err
        plain = {k: "a function" if callable(v) else v for k, v in given[0].items()}
        as_stored(plain, without=without, name=" ".join(("reached", function.rpartition(".")[2])))
        return given[0]

    return call


@pytest.fixture
def spied(mantaray, monkeypatch):
    """
    Call `mantaray` with a function of the library replaced by its result: what each call was given,
    and what the command printed.
    """

    def call(function, result, *words, code=0):
        given = []

        def instead(*arguments, **options):
            given.append({**dict(enumerate(arguments)), **options})
            return result

        monkeypatch.setattr(function, instead)
        done = mantaray(*words)
        assert done.code == code, done.err
        return given, done

    return call


@pytest.fixture
def checked_outputs(monkeypatch):
    """What commands give the check of an output, where they end: arguments and options."""
    given = []

    def check(*arguments, **options):
        given.append((arguments, options))
        raise MantaRayError("reached")

    monkeypatch.setattr("pymantaray.cli.output.check_output", check)
    return given


@pytest.fixture
def small_text():
    """
    Text of a study that takes seconds: the quick preset for four hours in a small window, dead
    reckoning only.
    """
    return study_toml(
        load_study(
            "quick",
            **{
                "study.description": "small",
                "study.realizations": 1,
                "conditions": ["odometry", "straight"],
                "mission.duration_h": 4.0,
                "ocean.half_extent_north": 15000.0,
                "ocean.half_extent_east": 15000.0,
            },
        )
    )


@pytest.fixture(scope="session")
def ocean_file(tmp_path_factory):
    """A small window of the synthetic Beaufort Sea as a NetCDF-3 file."""
    from pymantaray.ocean import synthetic_ocean

    ocean = synthetic_ocean("beaufort")
    lat, lon = ocean.sizes["lat"] // 2, ocean.sizes["lon"] // 2
    window = ocean.isel(lat=slice(lat - 8, lat + 9), lon=slice(lon - 14, lon + 15))
    assert np.isfinite(window["salinity"].isel(depth=0)).all()
    path = tmp_path_factory.mktemp("ocean") / "window.nc"
    window.to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
    return path
