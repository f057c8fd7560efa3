"""`mantaray ranges`: what it makes of its options."""

from pathlib import Path

import pytest
from command_fixtures import WATER_WORDS

from pymantaray.apps.ranges.ranging import ranges_config
from pymantaray.config import load_sound

CONFIG = "pymantaray.apps.ranges.ranging.ranges_config"
SCHEDULES = {
    "interval": "--interval 0.2h --sampling 0.1h",
    "slots": "--slots A,B --slot 2min",
    "pings": "--pings pings.csv",
}


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Trajectories, a profile and pings in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("own.csv").write_text(
        "time,vehicle,north,east,depth\n"
        "0,A,0,0,5\n1800,A,900,0,5\n0,B,0,9,5\n1800,B,900,9,5\n900,B,,9,5\n"
    )
    Path("profile.csv").write_text("depth,sound_speed\n0,1434\n400,1460\n")
    Path("pings.csv").write_text("time,transmitter\n60,A\n")
    return tmp_path


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_every_option_reaches_the_configuration_of_ranges(reached, files, schedule):
    how = (*SCHEDULES[schedule].split(), "--enu", "--vehicles", "A, B,")
    Path("a.nc").write_text("")
    given = reached(CONFIG, "ranges", "own.csv", "--ocean", "a.nc", *WATER_WORDS.split(), *how)
    assert [Path(file).name for file in given[0]] == ["own.csv"]
    assert given["time"].isoformat() == "2014-07-24T19:20:00"


def test_names_of_variables_are_no_names_of_vehicles(files):
    options = {"names": ["temp=sea_water_temperature"], "vehicles": ["B"]}
    config = ranges_config(["own.csv"], "a.nc", mission={"ping_interval_h": 1.0}, **options)
    assert config.ocean.names == ("temp=sea_water_temperature",)
    assert config.fleet.names == ("B",)


def test_a_section_of_ranges_adds_its_keys_to_those_of_the_water(files):
    water = load_sound("quick", **{"acoustics.max_bottom_bounces": 2})
    sections = {"mission": {"ping_interval_h": 1.0}, "acoustics": {"max_surface_bounces": 1}}
    found = ranges_config(["own.csv"], water, **sections).acoustics
    assert (found.max_surface_bounces, found.max_bottom_bounces) == (1, 2)


def test_no_option_reaches_the_configuration_of_ranges(reached, files):
    words = ("ranges", "own.csv", "--profile", "profile.csv", "--interval", 60)
    reached(CONFIG, *words)


REFUSED = {
    "exactly one of --interval, --slots with --slot, or --pings": "",
    "give exactly one of": "--interval 60 --pings pings.csv",
    "--slots and --slot must be used together; give both": "--slots A,B",
    "--slots and --slot must be used together": "--interval 60 --slot 9",
    "--sampling is 0 s; it must be finite and positive": "--interval 60 --sampling 0",
    "--slot is -2 s": "--slots A,B --slot -2",
}


@pytest.mark.parametrize("message", REFUSED)
def test_schedules_that_are_none_are_refused(mantaray, files, message):
    words = ("ranges", "own.csv", "--profile", "profile.csv", "--bathymetry", 400)
    done = mantaray(*words, *REFUSED[message].split(), "--out", "out")
    assert done.code == 2
    assert message in done.err
    assert not (files / "out").exists()
    no_ocean = mantaray("ranges", "own.csv", "--interval", 60)
    assert no_ocean.err == "error: no ocean; give --ocean or --profile\n"


@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_every_option_reaches_the_run_of_ranges(reached, files, quiet):
    words = ("ranges", "own.csv", "--profile", "profile.csv", "--bathymetry", 400)
    where = ("--centre", 74, -140, "--half-extent", 2000, 3000, "--out", "out")
    how = ("--interval", 60, "--vehicles", "A,B", "--enu", "--set", "noise.range_sigma=7")
    function = "pymantaray.apps.study.command.run_and_report"
    given = reached(function, *words, *where, *how, "--format", "pdf,tex", *quiet)
    config, folder, printed = (given[k] for k in range(3))
    assert folder == Path("out")
    assert given["workers"] == 1
    assert config.noise.range_sigma == 7.0
    assert (config.fleet.names, config.fleet.enu) == (("A", "B"), True)
    assert printed._quiet == bool(quiet)


def test_every_option_reaches_the_notes_of_ranges(mantaray, files, monkeypatch, as_stored):
    monkeypatch.setattr("pymantaray.apps.study.command.run_and_report", lambda *_, **__: None)
    words = ("ranges", "own.csv", "--profile", "profile.csv", "--bathymetry", 400)
    where = ("--centre", 74, -140, "--half-extent", 2000, 3000)
    done = mantaray(*words, *where, "--interval", 60, "--json")
    assert done.code == 0, done.err
    as_stored([done.out, done.err])
