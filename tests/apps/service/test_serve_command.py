"""`mantaray serve`: what it makes of its options, what it prints and how it ends."""

import signal
from pathlib import Path
from types import SimpleNamespace

import pytest
from command_fixtures import WATER_WORDS

from pymantaray import open_water
from pymantaray.acoustics import Medium
from pymantaray.apps.service import command

CAST = """# drop 9, 2014-07-24/1920 UTC, lat 74.0, lon -140.0
depth_m,temperature_degC,practical_salinity
2,-1.2,27.2
400,0.6,34.8
"""


@pytest.fixture
def profile(tmp_path, monkeypatch):
    """A profile in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("profile.csv").write_text("depth,sound_speed\n0,1434\n1000,1460\n")
    Path("cast.csv").write_text(CAST)
    return ("profile.csv", "--bathymetry", 1000)


class Service:
    """A service that answers nothing."""

    def __init__(self, ocean, *, water_interval, workers, **options):
        assert (water_interval, workers) == (0.0, 0)
        self.water, self.open = open_water(ocean, **options), True

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.open = False


@pytest.fixture
def server(monkeypatch):
    """A server that is made but does not run, and what it was asked for."""
    made = SimpleNamespace(effective_host="127.0.0.1", effective_port=8000, given=[])
    monkeypatch.setattr("pymantaray.apps.service.RangingService", Service)
    monkeypatch.setattr(
        "pymantaray.apps.service.make_server", lambda *a: made.given.append(a) or made
    )
    monkeypatch.setattr(command, "_run", lambda server: made.given.append(server) or 15)
    return made


def test_every_option_reaches_the_service(reached, profile):
    for name in ("a.nc", "b.nc"):
        Path(name).write_text("")
    options = ("--workers", 3, "--water-interval", "2 min", "--set", "ranging.timing=two-way")
    words = ("serve", "a.nc", "b.nc", *WATER_WORDS.split(), *options)
    given = reached("pymantaray.apps.service.RangingService", *words)
    assert given["workers"] == 3
    assert given["time"].isoformat() == "2014-07-24T19:20:00"


def test_no_option_reaches_the_service(reached, profile):
    given = reached("pymantaray.apps.service.RangingService", "serve", "profile.csv")
    assert given["workers"] == 0


def test_every_option_reaches_the_server(mantaray, profile, server):
    done = mantaray("serve", *profile, "--port", 9001, "--host", "::1")
    assert done.code == 143
    service, host, port = server.given[0]
    assert service.water.record["bottom_depth_m"] == 1000.0
    assert not service.open
    assert (host, port) == ("::1", 9001)
    assert server.given[1:] == [server]
    assert "without a password" not in done.err
    assert done.out == "profile\nlistening on http://127.0.0.1:8000\n"
    mantaray("serve", *profile)
    assert server.given[2][1:] == ("127.0.0.1", 8642)


def test_a_server_for_all_is_warned_of_and_notes_of_water_are_told(mantaray, profile, server):
    server.effective_host, server.effective_port = "0.0.0.0", 8001
    done = mantaray("serve", "cast.csv", "--bathymetry", 500)
    lines = done.err.splitlines()
    assert (
        "warning: listening at 0.0.0.0 without a password: anyone who can access it can use it"
    ) in lines
    assert any(line.startswith("cast.csv: ") for line in lines)
    title, listening = done.out.splitlines()
    assert title.endswith("around 74 N, 140 W")
    assert listening == "listening on http://0.0.0.0:8001"


def test_water_without_a_title_is_a_medium():
    medium = Medium.from_profile([0.0, 500.0], [1450.0, 1460.0], bottom_depth=500.0)
    assert command._title(SimpleNamespace(water=open_water(medium))) == "medium"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_signal_that_stops_the_server_is_its_status(monkeypatch, number):
    handlers, seen = {}, []
    event = SimpleNamespace(set=lambda: seen.append("handled"))
    monkeypatch.setattr(command, "handled", event)
    monkeypatch.setattr("signal.signal", lambda which, handler: handlers.update({which: handler}))

    def run():
        with pytest.raises(KeyboardInterrupt):
            handlers[number](number, None)

    server = SimpleNamespace(run=run, close=lambda: seen.append("closed"))
    assert command._run(server) == number
    assert seen == ["handled", "closed"]
    assert set(handlers) == {signal.SIGINT, signal.SIGTERM}
