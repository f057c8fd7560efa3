"""
`mantaray locate`: surveys of every grammar end to end, what is printed and written, plans, and what
is refused.
"""

import json
import re
import tomllib
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from campaigns import (
    direct_time,
    make_campaign,
    profile_csv,
    sailed,
    water,
    write_garpos,
    write_gnatss,
    write_obsrange,
    write_table,
)
from oracles import cf_errors
from refusals import refused

from pymantaray.acoustics import Medium
from pymantaray.apps.locate import LocateOptions, Node, Pattern, PlanOptions, Survey, locate
from pymantaray.apps.locate.displacement import campaign_of
from pymantaray.apps.locate.fit_tests import HALVES, FitTest
from pymantaray.apps.locate.mirror import Mirror
from pymantaray.apps.locate.options import CRITERIA
from pymantaray.apps.locate.page import plan_figure
from pymantaray.apps.locate.plan import expected_covariance, plan_survey
from pymantaray.apps.locate.read_options import ReadOptions
from pymantaray.apps.locate.write import summary, write_location
from pymantaray.errors import LocateError

MADE = r"made|origin|citation|links|references|words|explorer|height|width"  # of a page
NOISE = 1e-4  # s; of the campaign
KEYS = {
    "name",
    "lat",
    "lon",
    "north",
    "east",
    "depth",
    "sigma_north_m",
    "sigma_east_m",
    "sigma_depth_m",
}


@pytest.fixture(scope="module")
def campaign():
    return make_campaign(2, pings=60)


def within(nodes, truth, times=4.0):
    for node, place in zip(nodes, truth, strict=True):
        error = np.array([node["north"], node["east"], node["depth"]]) - place
        sigma = np.array([node["sigma_north_m"], node["sigma_east_m"], node["sigma_depth_m"]])
        assert (np.abs(error) < times * sigma).all(), (node["name"], error, sigma)


def test_a_survey_of_garpos_is_located_by_its_ini_file_alone(told, campaign, tmp_path):
    done = told("locate", write_garpos(campaign, tmp_path))
    assert all(set(node) >= KEYS for node in done["nodes"])
    assert [node["name"] for node in done["nodes"]] == campaign.names
    within(done["nodes"], campaign.truth)
    assert done["n_all"] == campaign.time.size
    assert done["n_used"] == campaign.time.size - campaign.gross.sum()
    assert done["rms_s"] == pytest.approx(1e-4, rel=0.15)
    assert done["hyperparameters"]["sound_speed"] == "time"
    assert done["centre"]["lat"] == pytest.approx(34.96, abs=1e-4)
    assert done["tests_passed"]
    lines = {row["line"] for row in done["rejected"]}
    assert len(lines) == campaign.gross.sum()
    assert all("ms" in row["reason"] for row in done["rejected"])


@pytest.mark.parametrize("turn_around", ["13 ms", "0.013"])
def test_survey_text_of_obsrange_is_located_with_a_turn_around_time(told, tmp_path, turn_around):
    path, truth = write_obsrange(tmp_path)
    done = told(
        "locate",
        path,
        "--profile",
        profile_csv(tmp_path),
        "--turn-around",
        turn_around,
        "--sound-speed",
        "scale",
    )
    (node,) = done["nodes"]
    assert node["name"] == "S01"
    within([node], [truth])
    assert np.hypot(node["north"] - truth[0], node["east"] - truth[1]) < 0.5
    assert done["n_all"] == 60
    assert done["n_used"] == 58
    assert sorted(round(1e3 * row["residual_s"], -1) for row in done["rejected"]) == [-300.0, 480.0]
    assert node["lat"] == pytest.approx(-5.2 + truth[0] / 110580.0, abs=1e-6)


def test_a_survey_of_gnatss_is_located_by_its_configuration(told, campaign, tmp_path):
    pytest.importorskip("yaml")
    done = told("locate", write_gnatss(campaign, tmp_path), "--correlation", "none")
    within(done["nodes"], campaign.truth)
    assert done["n_used"] == campaign.time.size - campaign.gross.sum()


def test_our_own_table_is_located_in_seconds_and_in_milliseconds(mantaray, campaign, tmp_path):
    places = []
    for unit in ("s", "ms"):
        pings, nodes = write_table(campaign, tmp_path, unit=unit)
        lever = campaign.lever[0]
        words = ("--nodes", nodes, "--profile", profile_csv(tmp_path), "--lever", *lever)
        options = ("--sound-speed", "time", "--correlation", "none", "--json")
        done = json.loads(mantaray("locate", pings, *words, *options).out)
        within(done["nodes"], campaign.truth)
        assert done["nodes"][0]["lat"] is None
        places.append([node["north"] for node in done["nodes"]])
    np.testing.assert_allclose(*places, atol=1e-3)


def test_names_that_no_file_can_hold_are_refused_before_the_solve(
    mantaray, campaign, tmp_path, monkeypatch
):
    pings, nodes = write_table(campaign, tmp_path)
    for file in (pings, nodes):
        file.write_text(file.read_text().replace(campaign.names[0], "buoy 7/b"))
    monkeypatch.setattr("pymantaray.apps.locate.locate", lambda *_, **__: pytest.fail("solved"))
    water = ("--profile", profile_csv(tmp_path))
    done = mantaray("locate", pings, "--nodes", nodes, *water, "--out", tmp_path / "out")
    assert (done.code, (tmp_path / "out").exists()) == (2, False)
    assert done.err == (
        f"error: {pings}: node 'buoy 7/b': files of results need names of 1 to 64 letters, digits,"
        " _ and -;"
        " rename it in the survey\n"
    )


def test_a_node_may_have_the_name_of_the_platform(mantaray, undrawn, campaign, tmp_path):
    pings, nodes = write_table(campaign, tmp_path)
    for file in (pings, nodes):
        file.write_text(file.read_text().replace(campaign.names[0], "A"))
    lever = campaign.lever[0]
    options = ("--profile", profile_csv(tmp_path), "--lever", *lever, "--sound-speed", "known")
    done = mantaray("locate", pings, "--nodes", nodes, *options, "--out", tmp_path / "out")
    assert done.code == 0, done.err
    assert "A,platform" in (tmp_path / "out" / "survey.names.csv").read_text()


def test_an_unconverged_survey_prints_its_status_and_exits_with_1(
    mantaray, campaign, tmp_path, monkeypatch
):
    pings, nodes = write_table(campaign, tmp_path)
    monkeypatch.setattr("pymantaray.apps.locate.solve._MAX_STEPS", 1)
    monkeypatch.setattr("pymantaray.apps.locate.solve._MAX_DAMPED", 0)
    options = ("--profile", profile_csv(tmp_path), "--lever", *campaign.lever[0])
    done = mantaray("locate", pings, "--nodes", nodes, *options, "--json")
    assert done.code == 1
    assert {node["status"] for node in json.loads(done.out)["nodes"]} == {"not converged"}
    assert done.err.splitlines()[-1].startswith(f"error: {pings}: not converged; ")


@pytest.mark.usefixtures("located_once", "undrawn")
def test_an_answer_that_explains_nothing_exits_with_1(mantaray, campaign, tmp_path, as_stored):
    pings, nodes = write_table(campaign, tmp_path)
    table = pd.read_csv(pings, comment="#")
    times = np.random.default_rng(0).uniform(1.0, 4.0, len(table))
    wrong = table["node"].iloc[0]  # of several nodes
    table["two_way_time_s"] = table["two_way_time_s"].where(table["node"] != wrong, times)
    table.to_csv(pings, index=False)
    options = ("--profile", profile_csv(tmp_path), "--sound-speed", "known")
    options += ("--bathymetry", 9000, "--lever", *campaign.lever[0])
    out = tmp_path / "out"
    done = mantaray("locate", pings, "--nodes", nodes, *options, "--json", "--out", out)
    assert done.code == 1
    told = json.loads(done.out)
    assert {n["name"] for n in told["nodes"] if n["status"] == "unexplained"} == {wrong}
    assert not told["usable"]
    assert "% of what was measured; at most 5 % explain it" in done.err
    assert "unexplained, the median residual is" in (out / "index.html").read_text()
    assert not json.loads((out / "location.json").read_text())["usable"]
    as_stored(told, without="candidates|budget")
    lines = mantaray("locate", pings, "--nodes", nodes, *options).out.splitlines()
    listed = [line for line in lines if line.startswith("  not used: line ")]
    assert f"  and {len(told['rejected']) - len(listed)} more" in lines


@pytest.mark.parametrize(("factor", "status"), [(0.2, "ok"), (0.005, "unexplained")])
def test_stated_noise_is_a_limit_of_residuals(mantaray, campaign, tmp_path, factor, status):
    pings, nodes = write_table(campaign, tmp_path)
    options = ("--profile", profile_csv(tmp_path), "--lever", *campaign.lever[0])
    options += ("--nodes", nodes, "--sigma", f"{1e3 * factor * NOISE} ms")
    done = mantaray("locate", pings, *options, "--json")
    assert done.code == int(status != "ok")
    assert {node["status"] for node in json.loads(done.out)["nodes"]} == {status}


def test_notes_of_a_reader_are_told_everywhere(mantaray, undrawn, campaign, tmp_path):
    pings, nodes = write_table(campaign, tmp_path)
    rows = pings.read_text().splitlines()
    pings.write_text("\n".join([*rows, rows[-1]]) + "\n")
    options = ("--profile", profile_csv(tmp_path), "--lever", *campaign.lever[0])
    out = tmp_path / "out"
    done = mantaray("locate", pings, "--nodes", nodes, *options, "--json", "--out", out)
    note = f"{pings}: 1 ping counted once: line {len(rows) + 1} repeats an earlier line"
    assert note in json.loads(done.out)["notes"]
    assert note in done.err
    page = (out / "index.html").read_text()
    assert note.partition(": ")[2] in page
    # in the words of the command line, in notes and in the provenance
    assert page.count("state --earth flat or --earth sphere if it is known") == 2
    assert "`earth" not in page


def test_a_track_gives_positions_at_both_instants(told, campaign, tmp_path):
    """Positions every 0.5 s in a file of their own, as a logger writes them."""
    time = np.arange(-5.0, campaign.time[-1] + 10.0, 0.5)
    place = sailed(time, 900.0)
    place[:, 2] = 4.0 + 0.5 * np.sin(2.0 * np.pi * time / 8.0)
    rows = [
        "time,vehicle,north,east,depth",
        *(
            f"{t:.1f},ship,{p[0]:.5f},{p[1]:.5f},{p[2]:.5f}"
            for t, p in zip(time, place, strict=True)
        ),
    ]
    (tmp_path / "track.csv").write_text("\n".join(rows) + "\n")

    def at(t):
        return np.column_stack([np.interp(t, time, place[:, k]) for k in range(3)])

    two_way = 2.0 * direct_time(at(campaign.time), campaign.truth[campaign.node])
    for _ in range(4):
        two_way = direct_time(at(campaign.time), campaign.truth[campaign.node]) + direct_time(
            at(campaign.time + two_way), campaign.truth[campaign.node]
        )
    start = np.float64(5.0)  # the track's clock starts at its first pose
    pings = ["time,node,two_way_time_s"]
    pings += [
        f"{t + start:.6f},{campaign.names[k]},{d:.7f}"
        for t, k, d in zip(campaign.time, campaign.node, two_way, strict=True)
    ]
    (tmp_path / "pings.csv").write_text("\n".join(pings) + "\n")
    beside = tmp_path / "nodes"
    beside.mkdir()
    _, nodes = write_table(campaign, beside)
    nodes.write_text(nodes.read_text().replace(",13\n", ",0\n"))
    done = told(
        *("locate", tmp_path / "pings.csv", "--nodes", nodes, "--track", tmp_path / "track.csv"),
        *("--profile", profile_csv(tmp_path), "--sound-speed", "scale", "--correlation", "none"),
        *("--earth", "flat"),
    )
    for node, truth in zip(done["nodes"], campaign.truth, strict=True):
        np.testing.assert_allclose([node["north"], node["east"], node["depth"]], truth, atol=0.02)


def test_results_are_a_folder_with_page_tables_and_files(
    mantaray, drawn, told, campaign, tmp_path, as_stored
):
    ini = write_garpos(campaign, tmp_path)
    done = mantaray(
        "locate",
        ini,
        "--sound-speed",
        "time",
        "--correlation",
        "none",
        "--out",
        tmp_path / "out",
    )
    assert done.code == 0, done.err
    assert "Positions, standard deviations" in done.out
    page = (tmp_path / "out" / "index.html").read_text()
    assert "survey_map" in page
    assert 'name="viewport"' in page
    tables = {path.stem for path in (tmp_path / "out" / "tables").iterdir()}
    assert {"nodes", "pings", "budget", "tests", "candidates", "sound_speed"} <= tables
    landmarks = tomllib.loads((tmp_path / "out" / "landmarks.toml").read_text())["landmarks"]
    assert [landmark["name"] for landmark in landmarks] == campaign.names
    features = json.loads((tmp_path / "out" / "nodes.geojson").read_text())["features"]
    assert [feature["geometry"]["type"] for feature in features] == ["Point", "Polygon"] * 3
    assert not cf_errors([tmp_path / "out" / "location.nc"])
    with xr.open_dataset(tmp_path / "out" / "location.nc") as data:
        assert data["lat"].units == "degrees_north"
        assert data["sigma_depth_m"].units == "m"
        assert data["position_covariance"].shape == (3, 3, 3, 3)
    solved = told("graph", "solve", tmp_path / "out" / "survey.pyfg")
    assert solved["status"] == "OK" or "status" in solved
    again = mantaray("locate", ini, "--out", tmp_path / "out")
    assert again.code == 2
    assert "out" in again.err
    as_stored([done.out, drawn, features, landmarks], without=MADE)
    as_stored(tmp_path / "out", name="files", without=MADE + "|/tables")


def test_a_plan_gives_the_best_radius_of_each_pattern(told, tmp_path):
    done = told(
        *(
            "locate",
            "plan",
            "--depth",
            2000,
            "--profile",
            profile_csv(tmp_path),
            "--pings",
            40,
            "--out",
            tmp_path / "plan.png",
        ),
        *("--radii", 300, 3000, 3),
    )
    assert {row["pattern"] for row in done["best"]} == {"circle", "cross", "line", "rose", "lines"}
    assert len(done["plan"]) == 15
    assert (tmp_path / "plan.png").stat().st_size > 1000
    assert len((tmp_path / "plan.csv").read_text().splitlines()) == 16
    circle = [row for row in done["plan"] if row["pattern"] == "circle"]
    north = [row["sigma_north_m"] for row in circle]
    assert north == sorted(north, reverse=True)


def test_a_plan_says_what_it_assumes(mantaray, tmp_path, as_stored):
    words = ("--profile", profile_csv(tmp_path), "--pattern", "circle", "--radii", 900, 901, 2)
    done = mantaray("locate", "plan", "--depth", 2000, *words, "--pings", 12, "--sigma", "2 ms")
    said = " ".join(done.out.split())
    assert "position in 3-D), 12 pings of 2 ms, node at 2000 m, ship at 2 m/s" in said
    assert "circle: the best radius is the smallest of the search; a better one may be" in said
    as_stored(done.out)


def test_a_plan_searches_until_the_best_radius_is_not_at_an_edge(as_stored):
    plan = plan_survey(
        water(), PlanOptions(300.0, 2e-4, criterion="depth"), shapes=("cross",), pings=20
    )
    (best,) = plan.best.to_dict("records")
    assert best["at_edge"] == ""
    assert plan.table["radius_m"].is_monotonic_increasing
    assert best["radius_m"] > 3.0 * 300.0  # beyond the first search
    given = plan_survey(
        water(), PlanOptions(300.0, 2e-4), np.array([60.0, 90.0]), shapes=("cross",), pings=20
    )
    assert given.best["at_edge"].tolist() == ["greatest"]
    as_stored([plan.table, plan.best, given.table, given.best])


def test_a_plan_has_hours_and_best_radii_by_its_criterion(as_stored):
    options = PlanOptions(1800.0, 2e-4, ship_speed=3.0, turn_time=600.0, criterion="hours")
    plan = plan_survey(water(), options, np.linspace(200.0, 4000.0, 12), pings=30)
    rows = {row["pattern"]: row for row in plan.best.to_dict("records")}
    circle, cross = rows["circle"], rows["cross"]
    track = 2.0 * 30 * circle["radius_m"] * np.sin(np.pi / 30) * 29 / 30  # 29 chords of 30
    assert circle["hours"] == pytest.approx(track / 3.0 / 3600.0)
    assert cross["hours"] == pytest.approx((cross["length_m"] / 3.0 + 600.0) / 3600.0)
    for criterion, (column, _) in CRITERIA.items():
        best = plan.best_by(criterion).set_index("pattern")[column]
        least = plan.table.groupby("pattern")[column].min()
        np.testing.assert_array_equal(best.sort_index(), least.sort_index())
    as_stored([plan.table, plan.best, plan_figure(plan)])


@pytest.mark.parametrize(("wrong", "message"), [
    ({"sigma": 0.0}, "plan: sigma is 0 s, .* must be positive"),
    ({"ship_speed": -1.0}, "ship_speed -1 m/s, .* must be positive"),
    ({"turn_time": -1.0}, "turn_time -1 s; .* not negative"),
    ({"sigma": 1e300}, "plan: sigma is 1e.300 s"),
    ({"ship_speed": 1e300}, "plan: ship_speed is 1e.300 m/s"),
])  # fmt: skip
def test_a_plan_without_noise_speed_or_time_is_refused(wrong, message):
    refused(LocateError, message, PlanOptions, 1800.0, **wrong)


def test_a_plan_is_equal_in_a_grid_and_in_its_profile(as_stored):
    """Rays of equal ranges are traced once in a profile; a grid traces each."""
    z = np.arange(0.0, 3001.0, 100.0)
    speed = 1490.0 + 0.017 * z - 20.0 * np.exp(-((z - 300.0) ** 2) / 2e5)
    axis = np.array([-6000.0, 6000.0])
    field = np.broadcast_to(speed, (2, 2, z.size)).copy()
    field[1, 1] += 1e-9  # no longer uniform
    media = (
        Medium.from_profile(z, speed, bottom_depth=3000.0, interpolation="linear"),
        Medium.from_grid(axis, axis, z, field, bathymetry=3000.0, interpolation="linear"),
    )
    options = PlanOptions(2000.0)
    for shape in ("circle", "rose", "lines"):
        pattern = Pattern(shape, 1500.0, 30)
        (one, lost), (other, also_lost) = (
            expected_covariance(pattern, medium, options) for medium in media
        )
        assert (lost, also_lost) == (0, 0)
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-8)
    as_stored(one)


def test_a_plan_is_kept_by_a_survey_of_its_pattern(told, tmp_path, as_stored):
    """
    The standard deviations of a plan are those of a solve of noise-free times with the same priors.
    """
    medium = water()
    pattern, truth = Pattern("cross", 1500.0, 60), np.array([0.0, 0.0, 1800.0])
    covariance, lost = expected_covariance(pattern, medium, PlanOptions(1800.0, 2e-4))
    expected = np.sqrt(np.diag(covariance))
    place = np.column_stack([pattern.points(), np.full(60, 5.0)])
    times = 2.0 * direct_time(place, truth) + np.random.default_rng(1).normal(0.0, 2e-4, 60)
    node = Node("A", tuple(truth), (500.0, 500.0, 100.0))
    survey = Survey((node,), np.zeros(60, int), 15.0 * np.arange(60), times, place, place)
    found = locate(
        survey, medium, LocateOptions(earth="flat", speed_model="scale", correlation="none")
    ).nodes.iloc[0]
    assert lost == 0
    sigma = found[["sigma_north_m", "sigma_east_m", "sigma_depth_m"]].to_numpy(dtype=float)
    np.testing.assert_allclose(sigma, expected, rtol=0.35)  # 60 pings give their own noise to 10 %
    as_stored([covariance, found.to_dict()])


@pytest.fixture
def short(tmp_path, monkeypatch):
    """Four pings to each of two nodes with their profile, in the current folder."""
    monkeypatch.chdir(tmp_path)
    write_table(make_campaign(2, pings=4, nodes=2), tmp_path)
    profile_csv(tmp_path)
    profile_csv(tmp_path, "other.csv", step=750.0)
    (tmp_path / "earlier.json").write_text('{"nodes": 2}')
    (tmp_path / "track.csv").write_text("time,vehicle,north,east,depth\n0,ship,1,2,3\n")
    return tmp_path


SURVEY = ("locate", "pings.csv", "--nodes", "nodes.csv", "--profile", "cast.csv")
READ = (
    *("--depth", "1.25 km", "--depth-sigma", "26 m", "--horizontal-sigma", 17),
    *("--turn-around", "14 ms", "--turn-around-sigma", "0.3 ms", "--sigma", "0.2 ms"),
    *("--lever", 6, -2.5, 19, "--lever-sigma", 0.1, 0.2, 0.4, "--transducer-depth", "4 m"),
    *("--clock-offset-sigma", "2 ms", "--clock-drift-sigma", 3e-7),
    *("--platform-sigma", 0.7, 1.4, "--platform-correlation", "5 min"),
)
SOLVED = (
    *("--correlation", "none", "--gross", 6.5, "--sound-speed", "modes", "--rigid"),
    *("--sound-speed-sigma", 0.004, "--gradient-sigma", 0.0002, "--knots", "12 min"),
    *("--earth", "flat", "--repair-freezing", "--modes", "cast.csv", "--modes", "other.csv"),
)


def test_every_option_reaches_the_reader_of_a_survey(reached, short):
    tracks = ("--track", "track.csv", "--track", "other.csv", "--platform", "ship")
    words = (*SURVEY, *READ, *tracks, "--position-at", "reception")
    given = reached("pymantaray.apps.locate.read_survey", *words)
    assert (given[0], given[1].nodes) == (Path("pings.csv"), Path("nodes.csv"))
    assert given[1].track == (Path("track.csv"), Path("other.csv"))


def test_every_option_reaches_the_solver_of_a_survey(reached, short, monkeypatch):
    words = (*SURVEY, *READ, *SOLVED)
    given = reached("pymantaray.ocean.casts.read_casts", *words)
    assert given == {0: Path("cast.csv"), "repair_freezing": True}
    monkeypatch.setattr(
        "pymantaray.ocean.casts.read_casts", lambda path, **options: [f"{path} {options}"]
    )
    reached("pymantaray.ocean.modes.vertical_modes", *words)
    monkeypatch.setattr("pymantaray.ocean.modes.vertical_modes", len)
    reached("pymantaray.apps.locate.locate", *words, without=r"^1\.")


@pytest.mark.parametrize("words", [(), ("--free",)])
def test_free_nodes_reach_the_solver(reached, short, words):
    without = r"^0\.(?!rigid)|^1\.(?!interpolation|bed.depth)"
    reached("pymantaray.apps.locate.locate", *SURVEY, *words, without=without)


PLACES = {"--centre": (74.5, -140.25), "--position": (-33.5, 151.25)}


def of_water(place):
    """Options of water, with a position that is its centre or that of its profile."""
    return (
        *("--bathymetry", "2.1 km", "--crs", "EPSG:3996", "--currents", "carry"),
        *("--equation", "unesco", "--half-extent", "4 km", 3000, "--time", "2020-03-10T12:00"),
        *("--repair-freezing", "--name", "temp=sea_water_temperature", "--ice", "2.5 m"),
        *("--ice-slope", 12, "--ice-length", "25 m", "--interpolation", "smooth"),
        *("--earth", "sphere", "--thin", 0.05, "--smooth", "6 m", place, *PLACES[place]),
    )


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("command", ["survey", "plan"])
def test_every_option_reaches_the_water_of_locate(reached, short, command, place):
    words = {"survey": SURVEY, "plan": ("locate", "plan", "--depth", 900, "--profile", "cast.csv")}
    given = reached(OPENED, *words[command], *of_water(place))
    assert given["time"] == datetime(2020, 3, 10, 12)  # noqa: DTZ001
    assert ("earth" in given) == (command == "plan")  # locate itself has the Earth's shape


OPENED = "pymantaray.config.door.water.open_waters"


@pytest.mark.parametrize("depth", [900, 2600])
def test_water_is_deeper_than_its_profile_and_the_node(reached, short, depth):
    given = reached(OPENED, "locate", "plan", "--depth", depth, "--profile", "cast.csv")
    assert given["bathymetry"] == max(3000.0, 1.2 * depth)


@pytest.mark.parametrize("sigma", [50, 450, 4500])
def test_water_is_deeper_than_nodes_may_be(reached, short, sigma):
    text = (short / "nodes.csv").read_text()
    (short / "nodes.csv").write_text(text.replace(",5,5,", f",5,{sigma},"))
    (short / "cast.csv").write_text("depth_m,sound_speed\n0,1480\n1500,1505.5\n")
    given = reached(OPENED, *SURVEY)
    assert given["bathymetry"] == pytest.approx(1.2 * (1312.0 + 3.0 * min(sigma, 100.0)))


@pytest.mark.parametrize("place", PLACES)
def test_a_profile_is_read_at_its_position(reached, short, place):
    words = ("locate", "plan", "--depth", 900, "--profile", "cast.csv", place, *PLACES[place])
    reached("pymantaray.acoustics.read_profiles", *words)


def test_the_bed_is_below_the_profile_of_a_survey_and_its_nodes(reached, tmp_path):
    ini = write_garpos(make_campaign(2, pings=4, nodes=2), tmp_path)
    (tmp_path / "obsdata" / "SITE-svp.csv").write_text("depth,speed\n0,1480\n1500,1505.5\n")
    without = r"^0|^1\.(?!bed.depth)|^2"
    given = reached("pymantaray.apps.locate.locate", "locate", ini, without=without)
    deepest = max(node.position[2] + 3.0 * node.sigma[2] for node in given[0].nodes)
    assert given[1].bed.depth == pytest.approx(1.2 * deepest)


def test_an_ocean_is_centred_at_the_survey(reached, tmp_path):
    ini = write_garpos(make_campaign(2, pings=4, nodes=2), tmp_path)
    reached(OPENED, "locate", ini, "--ocean", "synthetic:fram")


@pytest.mark.parametrize("words", [
    (),
    ("--thin", 3.5, "--smooth", "400 m", "--interpolation", "smooth"),
    ("--bathymetry", 3100, "--ice", "2.5 m", "--thin", 3.5),
], ids=["alone", "reduced", "between"])  # fmt: skip
def test_every_option_reaches_the_profile_of_a_survey(reached, tmp_path, words):
    ini = write_garpos(make_campaign(2, pings=4, nodes=2), tmp_path)
    without = r"^0\.|^1\.(?!(depth|sound_speed|bed.depth|surface.depth|interpolation)$)|^2"
    reached("pymantaray.apps.locate.locate", "locate", ini, *words, without=without)


@pytest.fixture
def located(short, monkeypatch):
    """A survey that is located already."""
    from pymantaray.apps.locate import read_survey

    options = ReadOptions(nodes=short / "nodes.csv", lever=(6.0, -2.5, 20.0))
    survey = read_survey(short / "pings.csv", options)
    found = locate(
        survey, water(), LocateOptions(earth="flat", speed_model="known", correlation="none")
    )
    monkeypatch.setattr("pymantaray.apps.locate.locate", lambda *_, **__: found)
    return found


def test_every_option_reaches_the_files_of_a_survey(reached, located, monkeypatch):
    words = (*SURVEY, "--with", "earlier.json", "--out", "there", "--format", "pdf,tex")
    given = reached("pymantaray.apps.locate.read_campaign", *words)
    assert given == {0: Path("earlier.json")}
    monkeypatch.setattr("pymantaray.apps.locate.read_campaign", str)
    given = reached("pymantaray.apps.locate.location.Location.since", *words, without="^0")
    assert given[0] is located
    assert given[1] == "earlier.json"
    monkeypatch.setattr("pymantaray.apps.locate.location.Location.since", lambda found, _: found)
    written = "pymantaray.apps.locate.write_location_page"
    given = reached(written, *words, without="^0|mantaray")
    assert given[0] is located
    assert (given[1], given["formats"]) == (Path("there"), ("pdf", "tex"))
    reached("pymantaray.cli.options.printer", *SURVEY, "--json", "--quiet", "--to", "latex")


def test_a_survey_without_pings_of_the_platform_has_no_graph(located, tmp_path):
    between = located.survey.assign(partner=1 - located.survey.node)
    folder = tmp_path / "files"
    folder.mkdir()
    files = write_location(replace(located, survey=between), folder)
    assert sorted(files) == sorted(folder.iterdir())
    assert {file.suffix for file in files} == {".toml", ".geojson", ".nc", ".json"}


def test_failed_tests_mirrors_and_displacements_are_told(mantaray, located, monkeypatch, as_stored):
    whole = replace(
        located,
        tests=[FitTest(HALVES, 6.75, 3.0, 1e-5, 2.25, passed=False)],
        mirrors=[
            Mirror("N1", 510.0, -400.0, 1300.0, 8.2, 3.2, undecided=True),
            Mirror("N2", -505.0, 410.0, 1312.0, 36.0, 31.0, undecided=False),
        ],
    )
    earlier = campaign_of(located)
    positions = earlier.positions + np.array([[0.3, -0.2, 0.1], [0.4, -0.2, 0.1]])
    covariance = np.diag(np.tile([4e-4, 1e-4, 9e-4], 2))
    earlier = replace(earlier, positions=positions, covariance=covariance, source="earlier")
    whole = whole.since(earlier)
    assert whole.widening == 1.5  # the root of 6.75 / 3
    monkeypatch.setattr("pymantaray.apps.locate.locate", lambda *_, **__: whole)
    done = mantaray(*SURVEY)
    assert done.code == 0, done.err
    for line in (
        "\nN1: two solutions; 4 of 4 pings used.\n",
        "All standard deviations are multiplied by 1.5 because of failed tests.\n",
        "1300.0 m with a chi-square larger by 3.2: the pings do not exclude it.\n",
        "1312.0 m with a chi-square larger by 31.0: the pings exclude it.\n",
        "Displacement of the nodes since the earlier campaign",
    ):
        assert line in done.out
    as_stored([done.out, whole.warnings])
    assert summary(whole)["displacement"] == whole.displacement.as_dict()


def test_the_water_of_a_survey_reaches_its_files(reached, located, tmp_path):
    ini = write_garpos(make_campaign(2, pings=4, nodes=2), tmp_path)
    words = ("locate", ini, "--thin", 3.5, "--smooth", "400 m", "--out", "there")
    given = reached("pymantaray.apps.locate.write_location_page", *words, without="^0|mantaray|~")
    assert given["made_by"]["survey"] == str(ini)


PLANNED = (
    *("locate", "plan", "--profile", "cast.csv", "--depth", "1.7 km", "--sigma", "2 ms"),
    *("--pattern", "rose", "--pattern", "cross", "--pings", 40, "--radii", 300, 900, 4),
    *("--transducer-depth", "6 m", "--ship-speed", 3, "--turn-time", "4 min"),
    *("--criterion", "depth", "--sound-speed", "gradient", "--sound-speed-sigma", 0.004),
    *("--lever-sigma", 0.1, 0.2, 0.4, "--depth-sigma", "80 m", "--platform-sigma", 0.7, 1.4),
)


def test_every_option_reaches_the_plan_of_a_survey(reached, short, monkeypatch):
    without = r"^0\.(?!bed.depth|interpolation)"
    planned = "pymantaray.apps.locate.plan.plan_survey"
    reached(planned, *PLANNED, without=without)
    plan = plan_survey(water(), PlanOptions(300.0), [90.0], shapes=("cross",), pings=20)
    monkeypatch.setattr(planned, lambda *_, **__: plan)
    drawn = "pymantaray.apps.locate.write_plan_figure"
    given = reached(drawn, *PLANNED, "--out", "plan.png", without="^0.survey")
    assert given == {0: plan, 1: Path("plan.png")}
    reached("pymantaray.cli.options.printer", *PLANNED, "--json", "--quiet", "--to", "latex")


def test_a_quiet_plan_of_all_patterns_shows_no_progress(reached, short):
    words = ("locate", "plan", "--profile", "cast.csv", "--depth", 900, "--quiet")
    reached("pymantaray.apps.locate.plan.plan_survey", *words, without=r"^0\.")


def test_a_plan_replaces_its_files_by_force(mantaray, undrawn, short):
    words = ("locate", "plan", "--profile", "cast.csv", "--depth", 900, "--pattern", "circle")
    words += ("--radii", 300, 900, 2, "--pings", 8, "--out", "plan.pdf")
    for name in ("plan.csv", "plan.pdf"):
        (short / name).write_text("mine")
        done = mantaray(*words)
        assert done.err == f"error: {name}: already exists; give another name or --force\n"
        assert mantaray(*words, "--force").out.splitlines()[-2:] == ["plan.pdf", "plan.csv"]
        (short / name).rename(short / f"first-{name}")
        (short / {"plan.csv": "plan.pdf", "plan.pdf": "plan.csv"}[name]).unlink()
    same = mantaray(*words, "--ice", "plan.pdf", "--force")
    assert same.err == "error: plan.pdf: is the input; give another name\n"


@pytest.mark.slow
def test_one_way_times_and_pings_between_nodes_give_clocks_and_graph(mantaray, told, tmp_path):
    rng = np.random.default_rng(1)
    truth = np.array([[400.0, 10.0, 1300.0], [-300.0, 350.0, 1310.0], [-200.0, -400.0, 1290.0]])
    offset = np.array([2e-3, -1e-3, 4e-3])
    rows = ["time,node,partner,direction,one_way_time_s,north_m,east_m,depth_m,sigma_s"]
    for i in range(180):
        time, k = 20.0 * i, i % 3
        noise = rng.normal(0.0, 5e-5)
        if i % 8 == 5:
            j = (k + 1) % 3
            measured = direct_time(truth[k], truth[j]) + offset[j] - offset[k] + noise
            rows.append(f"{time},N{k + 1},N{j + 1},from node,{measured:.7f},,,,0.00005")
            continue
        place = np.array([900.0 * np.cos(time / 300.0), 700.0 * np.sin(time / 230.0), 5.0])
        away = i % 2 == 1
        measured = direct_time(truth[k], place) + (-offset[k] if away else offset[k]) + noise
        where = ",".join(f"{x:.4f}" for x in place)
        rows.append(
            f"{time},N{k + 1},,{'from' if away else 'to'} node,{measured:.7f},{where},0.00005"
        )
    (tmp_path / "pings.csv").write_text("\n".join(rows) + "\n")
    head = (
        "name,north_m,east_m,depth_m,sigma_horizontal_m,sigma_depth_m,sigma_clock_offset_s,"
        "sigma_clock_drift"
    )
    lines = [
        f"N{k + 1},{p[0] + 8:g},{p[1] - 9:g},{p[2] + 5:g},20,20,0.01,1e-7"
        for k, p in enumerate(truth)
    ]
    (tmp_path / "nodes.csv").write_text("\n".join([head, *lines]) + "\n")
    words = (
        "locate",
        tmp_path / "pings.csv",
        "--nodes",
        tmp_path / "nodes.csv",
        "--profile",
        profile_csv(tmp_path),
    )
    done = told(*words, "--sound-speed", "known", "--out", tmp_path / "out")
    within(done["nodes"], truth)
    clocks = [row for row in done["unknowns"] if "offset" in row["unknown"]]
    for row, expected in zip(clocks, offset, strict=True):
        assert abs(row["value"] - expected) < 4.0 * row["sigma"]
    assert done["tests_passed"]
    solved = mantaray("graph", "solve", tmp_path / "out" / "survey.pyfg")
    assert solved.code == 0
    assert "OK" in solved.out


BAD = {
    "milliseconds": (
        lambda text: text.replace(" msec. Lat", "msec. Lat") and scaled(text),
        "divide milliseconds by 1000",
    ),
    "no answer": (
        lambda text: "\n".join(x for x in text.splitlines() if "msec" not in x),
        "none of 7 events has an answer",
    ),
    "times": (lambda text: text.replace(":06:30:30", ":05:30:30"), "times must not decrease"),
    "lines": (lambda text: text.replace("Lon: 132", "Lon: east"), "line 11: .* is not a ping"),
    "drop point": (
        lambda text: text.replace("(Longitude): -132.5", "(Longitude): somewhere"),
        "is 'somewhere'; it must be degrees",
    ),
    "sign": (
        lambda text: text.replace("(Longitude): -132.5", "(Longitude): 132.5"),
        "wrong sign .east or west.",
    ),
    "hemisphere": (
        lambda text: text.replace("(Latitude):  -5.2", "(Latitude):  5.2"),
        "wrong sign .north or south.",
    ),
    "exchanged": (
        lambda text: text.replace("(Latitude):  -5.2", "(Latitude):  -32.5").replace(
            "-132.5", "-5.2"
        ),
        "km apart",
    ),
    "depth": (lambda text: text.replace("2540", "deep"), "depth is 'deep'"),
}


def scaled(text):
    return re.sub(r"(\d+) msec", lambda m: f"{1000 * int(m[1])} msec", text)


@pytest.mark.parametrize("case", BAD)
def test_wrong_survey_text_is_refused_in_one_line(mantaray, tmp_path, case):
    path, _ = write_obsrange(tmp_path)
    change, message = BAD[case]
    path.write_text(change(path.read_bytes().decode().replace("\r\n", "\n")))
    done = mantaray("locate", path, "--profile", profile_csv(tmp_path), "--turn-around", "13 ms")
    assert done.code == 2
    lines = [line for line in done.err.splitlines() if line.startswith("error")]
    assert len(lines) == 1
    assert re.search(message, lines[0]), lines[0]


def test_water_is_needed_and_must_reach_the_node(mantaray, tmp_path):
    path, _ = write_obsrange(tmp_path)
    assert "no water; give --profile" in mantaray("locate", path).err
    short = tmp_path / "short.csv"
    short.write_text("depth_m,sound_speed\n0,1480\n1000,1497\n")
    done = mantaray("locate", path, "--profile", short)
    assert done.code == 2
    assert "ends at 1000 m, above node S01" in done.err


def test_help_lists_both_commands_and_a_missing_file_is_one_line(mantaray):
    done = mantaray("locate", "--help")
    assert "plan" in done.out
    assert "survey" in done.out
    done = mantaray("locate", "nowhere.txt", "--profile", __file__)
    assert done.code == 2
    assert "nowhere.txt: no such file" in done.err


@pytest.mark.parametrize("row", [0, -1])
def test_pings_beyond_a_track_without_a_fix_name_the_row(mantaray, tmp_path, row):
    """A receiver without a fix writes 0, 0 in the first or last row, where the survey has pings."""
    time = np.arange(0.0, 40.0, 2.0)
    track = [f"{t:g},ship,{45.0 + 1e-5 * t:.6f},-30,4" for t in time]
    line = 2 if row == 0 else len(track) + 1
    track[row] = f"{time[row]:g},ship,0,0,4"
    (tmp_path / "track.csv").write_text("\n".join(["time,vehicle,lat,lon,depth", *track]) + "\n")
    pings = [f"{t:g},N,0.3" for t in np.linspace(0.5, 37.5, 20)]
    (tmp_path / "pings.csv").write_text("\n".join(["time,node,two_way_time_s", *pings]) + "\n")
    done = mantaray(
        "locate",
        tmp_path / "pings.csv",
        *("--track", tmp_path / "track.csv", "--depth", 150),
        *("--profile", profile_csv(tmp_path)),
    )
    assert (done.code, done.err.count("\n")) == (2, 1), done.err
    assert "after the start of the track" in done.err
    assert f"rows of the track are left out: {tmp_path / 'track.csv'}: 1 line left out" in done.err
    assert f"line {line}: " in done.err
