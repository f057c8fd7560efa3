"""
`mantaray replay`: a folder of results whole or not at all, what is printed, and what is refused.
"""

import json
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from factories import names_in

from pymantaray.apps.replay.command import _print_result
from pymantaray.cli.printing import Printer
from pymantaray.errors import MantaRayError

EVENTS = pd.DataFrame(
    {
        "time": [f"2020-03-10T12:{m:02d}:00" for m in range(8)],
        "source": ["A", "B"] * 4,
        "receiver": ["B", "A"] * 4,
        "source_north": [0.0, 3000.0] * 4,
        "source_east": 0.0,
        "source_depth": [30.0, 150.0] * 4,
        "receiver_north": [3000.0, 0.0] * 4,
        "receiver_east": 0.0,
        "receiver_depth": [150.0, 30.0] * 4,
        "travel_time": np.hypot(3000.0, 120.0) / 1450.0 + 1e-3 * np.array([1.0, -1.0] * 4),
    }
)
MADE = r"made|origin|citation|links|references|words|explorer|height|width"  # of a page
DETECTION = """[detection]
source_level_db = 190.0
frequency_hz = 10e3
bandwidth_hz = 5e3
absorption = "thorp"
"""


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Events, two casts in one table, and a sonar, in the current folder."""
    monkeypatch.chdir(tmp_path)
    EVENTS.to_csv("events.csv", index=False)
    rows = [f"{name},{time},{z},1450" for name, time in CASTS for z in (0, 500, 2000)]
    (tmp_path / "casts.csv").write_text("\n".join(["station,time,depth,sound_speed", *rows]) + "\n")
    (tmp_path / "sonar.toml").write_text(DETECTION)
    return tmp_path


CASTS = (("first", "2020-03-10T11:00"), ("second", "2020-03-10T13:00"))
WATER = ("--profile", "casts.csv", "--bathymetry", 2000, "--interpolation", "linear")


def test_results_are_a_folder_of_tables_figures_and_a_page(mantaray, drawn, files, as_stored):
    done = mantaray(
        "replay",
        "events.csv",
        *WATER,
        "--out",
        "out",
        "--reference",
        "A",
        "--detection",
        "sonar.toml",
    )
    assert done.code == 0, done.err
    assert done.out.splitlines()[0] == "8 events: 8 ok"
    assert "clocks [ms]: A +0.000 ± 0.000, B +1.000 ± 0.000" in done.out
    assert "Intervals (95 %) resample pairs" in " ".join(done.out.split())
    assert done.out.splitlines()[-1].endswith("out/index.html")
    assert names_in(files / "out") == ["figures", "index.html", "replay.json", "tables"]
    assert names_in(files / "out" / "figures") == [
        f"{name}.png"
        for name in ("coverage", "residual_histogram", "residual_range", "residual_time")
    ]
    events = pd.read_csv(files / "out" / "tables" / "events.csv")
    np.testing.assert_allclose(events["residual_s"], 1e-3 * np.array([1.0, -1.0] * 4), atol=1e-8)
    np.testing.assert_allclose(190.0 - events["loss_db"], events["level_db"])
    spherical = 20.0 * np.log10(np.hypot(3000.0, 120.0))
    assert events["loss_db"].between(spherical + 2.0, spherical + 5.0).all()  # Thorp: 1.2 dB/km
    record = json.loads((files / "out" / "replay.json").read_text())
    assert (record["rule"], record["water"][1]["cast"]) == ("within:6", "second")
    page = (files / "out" / "index.html").read_text()
    assert "Replay of measured travel times" in page
    for name in ("summary", "clocks", "reciprocity", "switching", "events"):
        assert f"tables/{name}.csv" in page
    as_stored([done.out, drawn], without=MADE)
    as_stored(json.loads(drawn.pages[0].explorer.data), name="explorer")
    as_stored([figure.get_size_inches() for figure in drawn.figures], name="sizes")
    as_stored(files / "out", name="files", without=MADE)


def test_directions_are_compared_within_the_window(mantaray, files, undrawn):
    """Events are a minute apart, which is the window without the option."""
    done = mantaray("replay", "events.csv", *WATER, "--window", "59 s", "--out", "out")
    assert done.code == 0
    (row,) = pd.read_csv(files / "out" / "tables" / "reciprocity.csv").to_dict("records")
    assert (row["forth"], row["back"], row["matched"]) == (4, 4, 0)


def test_an_ocean_is_a_water_too(told, files, ocean_file, undrawn, as_stored):
    words = ("--ocean", ocean_file, "--half-extent", 4000, 4000, "--quiet", "--out", "out")
    result = told("replay", "events.csv", *words)
    assert sum(result["statuses"].values()) == len(EVENTS)
    assert {row["node"] for row in result["clocks"]} == {"A", "B"}
    assert result["summary"][0].keys() > {"by", "group", "events", "median_m"}
    assert result["page"].endswith("out/index.html")
    assert len(pd.read_csv(files / "out" / "tables" / "events.csv")) == 8
    as_stored(files / "out" / "tables" / "events.csv", name="events")


@pytest.mark.parametrize(
    "detection",
    [
        (),
        pytest.param(("--detection", "sonar.toml"), marks=pytest.mark.slow),
        pytest.param(("--detection", "salty.toml"), marks=pytest.mark.slow),
    ],
)
def test_the_ocean_of_a_run_is_a_water_too(told, files, tiny_run_folder, detection, undrawn):
    (files / "sonar.toml").write_text(DETECTION)
    (files / "salty.toml").write_text(DETECTION.replace("thorp", "francois-garrison"))
    table = pd.read_csv(files / "events.csv")
    local = table.rename(
        columns=lambda name: name.replace("_lat", "_north").replace("_lon", "_east")
    )
    local[[name for name in local if name.endswith(("_north", "_east"))]] *= 0.0
    local["receiver_north"] = 700.0
    local["travel_time"] = np.hypot(700.0, 120.0) / 1450.0
    local.to_csv(files / "local.csv", index=False)
    extent = (
        "--ocean",
        "synthetic:beaufort",
        "--centre",
        74.5,
        -140.0,
        "--half-extent",
        "15km",
        "15km",
    )
    one, other = (
        told("replay", "local.csv", *water, *detection, "--quiet", "--out", f"out{k}")
        for k, water in enumerate([("--run", tiny_run_folder), extent])
    )
    assert one["statuses"]["ok"] == len(table)
    assert one["summary"] == other["summary"]
    levels = [pd.read_csv(files / f"out{k}" / "tables" / "events.csv")["level_db"] for k in (0, 1)]
    assert levels[0].notna().all() == bool(detection)
    np.testing.assert_allclose(*levels, rtol=1e-9)


COMPARED = (
    *("--nodes", "nodes.csv", "--detection", "sonar.toml", "--window", "20 s"),
    *("--reference", "B", "--rule", "persist:9", "--smooth-positions", "3.5 m", "--clock-drift"),
)
ERRORS = ("--position-sigma", "2.5 m", "--sound-speed-sigma", 0.3, "--wind", 11)
SEARCH = ("--max-surface-bounces", 2, "--max-bottom-bounces", 3, "--cutoff-db", 21)
OF_WATER = r"lut|knots|nodes|local|currents|frame|attrs|notes"


@pytest.fixture
def node_file(files):
    (files / "nodes.csv").write_text("name,north,east,depth\nB,3001,7,151\n")


def test_every_option_reaches_the_replay(reached, files, node_file):
    predicted = (*ERRORS, "--draws", 7, "--learn", "smooth")
    words = ("replay", "events.csv", *WATER, *COMPARED, *predicted)
    reached("pymantaray.apps.replay.replay_events", *words, without=OF_WATER)
    given = reached("pymantaray.apps.replay.read_events", *words)
    assert given == {0: Path("events.csv"), 1: Path("nodes.csv")}
    given = reached("pymantaray.apps.replay.smooth_positions", *words, without=r"^0\.")
    np.testing.assert_array_equal(given[0].source_position[1], (3001.0, 7.0, 151.0))


def test_a_quiet_replay_shows_no_progress(reached, files):
    words = ("replay", "events.csv", *WATER, "--quiet")
    reached("pymantaray.apps.replay.replay_events", *words, without=r"^(?!progress|window)")
    given = reached("pymantaray.apps.replay.write_replay", *words, without=r"^(?!progress|formats)")
    assert given[1] is None
    assert given["made_by"]["detection"] is None


def test_every_option_reaches_the_files_of_a_replay(reached, files, node_file, monkeypatch):
    words = ("replay", "events.csv", *WATER, *COMPARED, *ERRORS, *SEARCH, "--out", "there")
    given = reached(
        "pymantaray.apps.replay.write_replay",
        *(*words, "--format", "pdf,tex"),
        without=r"^0\.(events|candidates|summary|tables|more)|mantaray",
    )
    assert (given[1], given["formats"]) == (Path("there"), ("pdf", "tex"))
    monkeypatch.setattr("pymantaray.apps.replay.write_replay", lambda *_, **__: Path("page"))
    reached("pymantaray.cli.options.printer", *words, "--json", "--quiet", "--to", "latex")


PLACES = {"--centre": (74.5, -140.25), "--position": (-33.5, 151.25)}


@pytest.mark.parametrize(
    ("words", "learn"),
    [
        (("--learn",), "causal"),
        (("--learn", "--quiet"), "causal"),
        (("--learn", "smooth"), "smooth"),
    ],
)
def test_learning_is_causal_if_no_value_is_given(mantaray, files, monkeypatch, words, learn):
    given = []

    def record(*_, options, **__):
        given.append(options.learn)
        raise MantaRayError("enough")

    monkeypatch.setattr("pymantaray.apps.replay.replay_events", record)
    assert mantaray("replay", "events.csv", *WATER, "--rule", "persist:9", *words).code == 2
    assert given == [learn]


@pytest.mark.parametrize("place", PLACES)
def test_every_option_reaches_the_water_of_a_replay(reached, files, place):
    options = (
        *("--bathymetry", "2.1 km", "--crs", "EPSG:3996", "--currents", "carry"),
        *("--equation", "unesco", "--half-extent", "4 km", 3000, "--time", "2020-03-10T12:00"),
        *("--repair-freezing", "--name", "temp=sea_water_temperature", "--ice", "2.5 m"),
        *("--ice-slope", 12, "--ice-length", "25 m", "--interpolation", "linear"),
        *("--earth", "sphere", "--thin", 0.05, "--smooth", "6 m", place, *PLACES[place]),
        *("--detection", "sonar.toml", "--set", "ranging.slot_s=4", *SEARCH),
    )
    words = ("replay", "events.csv", "--profile", "casts.csv", *options)
    given = reached("pymantaray.config.door.water.open_waters", *words)
    assert given["time"] == datetime(2020, 3, 10, 12)  # noqa: DTZ001


@pytest.mark.parametrize(("earth", "geographic", "sphere"), [
    (None, True, True), ("flat", True, False), ("sphere", True, True), (None, False, False),
])  # fmt: skip
def test_positions_on_earth_are_replayed_on_a_sphere(reached, files, earth, geographic, sphere):
    names = {"source_north": "source_lat", "source_east": "source_lon"}
    names |= {name.replace("source", "receiver"): names[name].replace("source", "receiver")
              for name in names}  # fmt: skip
    north = ["source_north", "receiver_north"]
    events = EVENTS.assign(**{name: 70.0 + EVENTS[name] / 111e3 for name in north})
    (events.rename(columns=names) if geographic else EVENTS).to_csv("events.csv", index=False)
    words = ("replay", "events.csv", *WATER, *(("--earth", earth) if earth else ()))
    replayed = "pymantaray.apps.replay.replay_events"
    given = reached(replayed, *words, without=r"^(?!1\[\].medium.earth)")
    assert [water.medium.earth is not None for water in given[1]] == [sphere, sphere]


REFUSED = {
    "rule 'loudest'; allowed are first": (*WATER, "--rule", "loudest"),
    "rule threshold: it needs a sonar": (*WATER, "--rule", "threshold"),
    "exactly one of --ocean, --profile and --run": (),
    "first: a profile has no sea bed": WATER[:2],
    "casts.csv: not valid TOML": (*WATER, "--detection", "casts.csv"),
    "empty.toml: no section [detection]; add it": (*WATER, "--detection", "empty.toml"),
    "francois-garrison, but first has no temperature or salinity": (
        *WATER,
        "--detection",
        "salty.toml",
    ),
    # before the water is opened, which cannot be
    "reference 'Z': no such node": ("--profile", "empty.toml", "--reference", "Z"),
    "rule first: learning needs the rule persist": (
        *("--profile", "empty.toml", "--rule", "first", "--learn", "causal"),
    ),
    "--window is -5 s; it must be finite and zero or positive": (*WATER, "--window", -5),
    "not a run folder": ("--run", "."),
}


@pytest.mark.parametrize("message", REFUSED)
def test_impossible_replays_are_refused_in_one_line_and_leave_nothing(mantaray, files, message):
    (files / "salty.toml").write_text(DETECTION.replace("thorp", "francois-garrison"))
    (files / "empty.toml").write_text("[ocean]\n")
    done = mantaray("replay", "events.csv", *REFUSED[message], "--out", "out")
    assert done.code == 2
    assert message in done.err
    assert len(done.err.splitlines()) == 1
    assert not (files / "out").exists()


def test_a_folder_with_something_in_it_is_left_alone(mantaray, files):
    (files / "out").mkdir()
    (files / "out" / "mine").touch()
    done = mantaray("replay", "events.csv", *WATER, "--out", "out")
    assert (done.code, len(done.err.splitlines())) == (2, 1)
    assert names_in(files / "out") == ["mine"]


def test_rays_take_one_cast(mantaray, files):
    (files / "links.csv").write_text(
        "source_north,source_east,source_depth,receiver_north,receiver_east,receiver_depth\n0,0,9,99,0,9\n"
    )
    done = mantaray("rays", "times", "links.csv", "out.csv", *WATER)
    assert done.code == 2
    assert "casts.csv: contains 2 casts (first, second)" in done.err
    twice = mantaray("rays", "times", "links.csv", "out.csv", *WATER, "--profile", "casts.csv")
    assert "contains 4 casts (first, second, first, second); only one is allowed" in twice.err


def test_smoothed_positions_drifts_and_gross_errors_are_reported(
    mantaray, files, undrawn, as_stored
):
    wrong = EVENTS.assign(travel_time=EVENTS["travel_time"].where(EVENTS.index != 3, 4.19))
    wrong.to_csv("wrong.csv", index=False)
    options = ("--smooth-positions", "3 m", "--clock-drift", "--reference", "A")
    done = mantaray("replay", "wrong.csv", *WATER, "--out", "out", *options)
    assert done.code == 0, done.err
    text = " ".join(done.out.split())
    assert (
        "1 of 8 measured times are no travel times of sound, such as 4.19 s instead of 2.07 s"
        in text
    )
    tables = files / "out" / "tables"
    assert {"baselines.csv", "nodes.csv", "positions.csv"} <= set(names_in(tables))
    clocks = pd.read_csv(tables / "clocks.csv").set_index("node")
    assert clocks.loc["B", "offset_s"] == pytest.approx(1e-3, abs=1e-6)
    assert clocks.loc["B", "drift"] == pytest.approx(0.0, abs=1e-9)
    refused = mantaray("replay", "wrong.csv", *WATER, "--out", "other", "--smooth-positions", "0")
    assert refused.code == 2
    assert "sigma is 0 m" in refused.err
    assert not (files / "other").exists()
    as_stored([done.out, tables])


def test_draws_learning_and_changes_of_candidates_are_printed(made_replay, capsys, as_stored):
    """Of 20 events of each direction, every second one takes another candidate than the last."""
    n = np.arange(40)
    late = 0.02 * (n // 4 % 2) + np.where(n % 2, -1e-3, 1e-3) + 1e-4 * (n % 5 - 2)
    events = made_replay.events.assign(
        measured_s=2.0 + late, residual_s=late, residual_m=1500.0 * late
    )
    times = {"event": np.repeat(n, 2), "travel_time_s": np.tile([2.0, 2.02], 40), "loss_db": 70.0}
    sizes = pd.DataFrame({"name": ["water"], "value": [4e-4]})
    draws = {"draws": [8], "median_size_m": [2.5], "median_error_m": [0.25]}
    more = {"coverage": sizes, "error_sizes": sizes, "draws": pd.DataFrame(draws)}
    result = replace(
        made_replay, events=events, candidates=pd.DataFrame(times), window=100.0, more=more
    )
    told = Printer(quiet=False, to="json")
    for printer in (told, Printer(quiet=False)):
        _print_result(printer, result, Path("page"))
    text = capsys.readouterr().out
    said = "median without learning: 2.500 ± 0.250 m (standard error due to 8 draws, 10 %)"
    assert said in text
    none = pd.DataFrame(draws).assign(median_size_m=np.inf, median_error_m=np.nan)
    unpredicted = replace(result, more=more | {"draws": none})
    _print_result(Printer(quiet=False), unpredicted, Path("page"))
    assert "median without learning: infinite with some draws, because" in capsys.readouterr().out
    assert "candidates change in 0.474 of 38 steps of 90 s, 0.526 if independent" in text
    clock = result.clocks.set_index("node").loc["B"]
    assert f"B +0.500 ± {1e3 * clock['standard_error_s']:.3f}" in text
    assert text.splitlines()[-1] == "page"
    as_stored([told.values, text])


def test_the_sigma_of_a_prediction_explains_residuals_too(made_replay):
    late = 5e-3 * (-1.0) ** (np.arange(40) // 2)
    events = made_replay.events.assign(
        measured_s=2.0 + late, residual_s=late, residual_m=1500.0 * late, sigma_s=5e-5
    )
    result = replace(made_replay, events=events)
    assert "100 stated standard deviations" in result.unexplained
    assert "The water and the positions do not explain" in result.findings[0]
    uncertain = events.assign(prediction_sigma_s=1.2e-4)  # 38 standard deviations of both
    assert replace(made_replay, events=uncertain).unexplained is None


def test_predictions_that_explain_nothing_exit_with_1(mantaray, files, undrawn, as_stored):
    times = np.random.default_rng(0).uniform(0.5, 8.0, len(EVENTS))
    events = EVENTS.assign(travel_time=times)
    pd.concat([events, events.iloc[:1]]).to_csv("events.csv", index=False)
    done = mantaray("replay", "events.csv", *WATER, "--out", "out", "--json")
    assert done.code == 1
    told = json.loads(done.out)
    assert "of what was measured; at most 5 % explain it" in told["unexplained"]
    assert done.err.splitlines()[-1].startswith("error: events.csv: not explained: the median")
    note = "events.csv: 1 ping counted once: line 10 repeats an earlier line"
    assert note in told["notes"]
    assert note in done.err
    page = (files / "out" / "index.html").read_text()
    assert "1 ping counted once" in page
    assert "do not explain the travel times" in page
    as_stored(told)
