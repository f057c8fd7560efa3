"""
Events in: tables read or refused by their line, the water that each belongs to, and its ends there.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyproj
import pytest
from factories import ridged
from refusals import refused

from pymantaray import Water
from pymantaray.acoustics import Leakage, Medium, Sonar
from pymantaray.apps.replay import (
    DetectionRule,
    Events,
    correct_events,
    read_events,
    replay_events,
)
from pymantaray.apps.replay.water import choose_water, ends_of, instants_in
from pymantaray.errors import ReplayError
from pymantaray.geometry import LocalFrame
from pymantaray.sensing import Detector, ReceptionOptions

HEAD = (
    "time,source,receiver,source_lat,source_lon,source_depth,receiver_lat,receiver_lon,"
    "receiver_depth,travel_time"
)
ROW = "2020-03-10T12:00:00Z,A,B,72,-145,30,72.02,-145.1,150,1.6"
WATER = Medium.from_profile(
    [0.0, 3000.0], [1450.0, 1450.0], bottom_depth=3000.0, interpolation="linear"
)


def write(folder, *rows, head=HEAD):
    path = folder / "events.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def test_a_table_is_read_as_it_stands(tmp_path, as_stored):
    rows = (f"{ROW},0.001,first", f"{ROW.replace('12:00:00Z', '12:00:30.5')},,")
    events = read_events(write(tmp_path, *rows, head=f"{HEAD},sigma,cast"))
    assert events.geographic
    np.testing.assert_array_equal(events.time, [0.0, 30.5])
    assert str(events.epoch) == "2020-03-10T12:00:00.000000000"
    np.testing.assert_array_equal(events.sigma, [0.001, np.nan])
    assert events.cast.tolist() == ["first", ""]
    assert events.pair.tolist() == ["A and B", "A and B"]
    local = write(
        tmp_path,
        "5,A,B,0,0,30,900,0,60,0.6",
        head=HEAD.replace("_lat", "_north").replace("_lon", "_east"),
    )
    events = read_events(local)
    assert not events.geographic
    assert np.isnat(events.epoch)
    np.testing.assert_array_equal(events.receiver_position, [[900.0, 0.0, 60.0]])
    as_stored(events)


BAD = {
    "no travel_time; the columns are time": (
        HEAD.replace(",travel_time", ""),
        ROW.rsplit(",", 1)[0],
    ),
    "no source_north, source_east, receiver_north, receiver_east; the columns are": (
        HEAD.replace("lat", "x").replace("lon", "y"),
        ROW,
    ),
    "line 2: travel_time is 'soon'; it must be a finite number": (HEAD, ROW.replace("1.6", "soon")),
    "line 2: time is 'noon'; all cells must be seconds, or all must be dates": (
        HEAD,
        ROW.replace("2020-03-10T12:00:00Z", "noon"),
    ),
    "line 2: receiver is ''; it must have a name": (HEAD, ROW.replace(",B,", ",,")),
    "travel_time of event 1 is -1.6; allowed: seconds above 0": (HEAD, ROW.replace("1.6", "-1.6")),
    "travel_time of event 1 is 4000.0; allowed: seconds above 0, below 3600": (
        HEAD,
        ROW.replace("1.6", "4000"),
    ),
    "source and receiver of event 1 is A and A; allowed: two nodes": (
        HEAD,
        ROW.replace(",B,", ",A,"),
    ),
    "line 2: A: position is 720, -145; latitude must be -90 to 90": (
        HEAD,
        ROW.replace(",72,", ",720,"),
    ),
    "line 2: sigma is 'small'; it must be a number or an empty cell": (
        f"{HEAD},sigma",
        f"{ROW},small",
    ),
    "sigma of event 1 is 0.0; allowed: seconds above 0": (f"{HEAD},sigma", f"{ROW},0"),
    "has positions in lat, lon and in north, east": (f"{HEAD},source_north", f"{ROW},0"),
    "two columns sigma; remove one": (f"{HEAD},sigma,sigma", f"{ROW},1,1"),
    "two columns cast; remove one": (f"{HEAD},cast,cast", f"{ROW},a,a"),
    "two columns level_db; remove one": (f"{HEAD},level_db,level_db", f"{ROW},1,1"),
}


@pytest.mark.parametrize("message", BAD)
def test_what_is_no_event_is_refused_by_its_line(tmp_path, message):
    head, row = BAD[message]
    refused(ReplayError, message, read_events, write(tmp_path, row, head=head))


@pytest.mark.parametrize(
    "bad",
    [
        ROW[:40],
        ROW.replace("1.6", "soon"),
        ROW.replace(",B,", ",,"),
        ROW.replace("2020-03-10T12:00:00Z", "noon"),
        f"{ROW},{ROW}",
    ],
)
def test_lines_that_are_no_events_are_listed_and_left_out(tmp_path, bad):
    path = write(tmp_path, ROW, bad, ROW.replace("12:00:00Z", "12:01:00Z"))
    events = read_events(path)
    assert events.travel_time.tolist() == [1.6, 1.6]
    assert events.notes[0].startswith(f"{path}: 1 line left out, not readable: line 3: ")


@pytest.mark.parametrize("column", ["sigma", "level_db"])
def test_lines_with_a_word_for_an_optional_number_are_left_out(tmp_path, column):
    rows = (f"{ROW},1", f"{ROW},small", f"{ROW.replace('12:00:00Z', '12:01:00Z')},")
    path = write(tmp_path, *rows, head=f"{HEAD},{column}")
    events = read_events(path)
    np.testing.assert_array_equal(getattr(events, column), [1.0, np.nan])
    assert events.notes[0].startswith(f"{path}: 1 line left out, not readable: line 3: {column}")


def test_a_node_may_be_carried_elsewhere_by_an_aircraft(tmp_path):
    """At 200 m/s, which no vessel reaches."""
    north = np.repeat([0.0, 12e3], 4)
    rows = [f"{60 * k},A,B,{x},0,30,{x + 900.0},0,60,0.6" for k, x in enumerate(north)]
    head = HEAD.replace("_lat", "_north").replace("_lon", "_east")
    events = read_events(write(tmp_path, *rows, head=head))
    np.testing.assert_array_equal(events.source_position[:, 0], north)
    assert not events.notes


def events_at(times, casts=None, epoch="2020-03-10T12:00:00"):
    n = len(times)
    return Events(
        time=np.array(times, dtype=float),
        source=["A"] * n,
        receiver=["B"] * n,
        source_position=np.tile([72.0, -145.0, 30.0], (n, 1)),
        receiver_position=np.tile([72.05, -144.9, 150.0], (n, 1)),
        travel_time=np.full(n, 4.0),
        geographic=True,
        cast=np.array(casts or [""] * n),
        epoch=np.datetime64(epoch, "ns"),
    )


def water(name, time="NaT"):
    return Water(WATER, name=name, time=np.datetime64(time, "ns"))


def test_an_event_takes_the_cast_that_it_names_or_the_nearest_in_time():
    casts = [water("early", "2020-03-10T10:00"), water("late", "2020-03-11T00:00"), water("lost")]
    np.testing.assert_array_equal(
        choose_water(events_at([0.0, 3e4, 0.0], ["", "", "late"]), casts[:2]), [0, 1, 1]
    )
    np.testing.assert_array_equal(choose_water(events_at([0.0], ["lost"]), casts), [2])
    np.testing.assert_array_equal(choose_water(events_at([0.0], epoch="NaT"), casts[2:]), [0])


@pytest.mark.parametrize(
    ("message", "events", "casts"),
    [
        ("cast noon is unknown; allowed are a, b", events_at([0.0], ["noon"]), "ab"),
        ("cast a has no time; add a column cast", events_at([0.0]), "ab"),
        ("two casts are called a", events_at([0.0], ["a"]), "aa"),
        ("replay: there is no water", events_at([0.0]), ""),
    ],
)
def test_a_cast_that_cannot_be_told_is_refused(message, events, casts):
    refused(ReplayError, message, choose_water, events, [water(name) for name in casts])
    timed = [water("a", "2020-01-01"), water("b", "2020-02-01")]
    without = events_at([0.0], epoch="NaT")
    refused(ReplayError, "the events' times are seconds", choose_water, without, timed)


def test_ends_keep_the_distance_on_the_ellipsoid(as_stored):
    events = events_at([0.0])
    true = pyproj.Geod(ellps="WGS84").inv(-145.0, 72.0, -144.9, 72.05)[2]
    for one in (water("cast"), Water(WATER, frame=LocalFrame(72.02, -144.95))):
        source, receiver = ends_of(events, np.array([0]), one)
        assert np.linalg.norm((receiver - source)[0, :2]) == pytest.approx(true, rel=1e-6)
        assert (source[0, 2], receiver[0, 2]) == (30.0, 150.0)
    east = (receiver - source)[0, 1] / true
    assert east == pytest.approx(np.sin(np.radians(31.7)), abs=0.02)
    as_stored([source, receiver])


def test_in_uniform_water_the_residual_is_the_clock_error(as_stored):
    events = events_at([0.0, 60.0])
    distance = np.hypot(pyproj.Geod(ellps="WGS84").inv(-145.0, 72.0, -144.9, 72.05)[2], 120.0)
    replay = replay_events(events, Water(WATER), "first")
    (row, _) = replay.events.to_dict("records")
    assert row["predicted_s"] == pytest.approx(distance / 1450.0, abs=1e-7)
    assert row["residual_s"] == pytest.approx(4.0 - distance / 1450.0, abs=1e-7)
    assert row["residual_m"] == pytest.approx(1450.0 * row["residual_s"])
    assert row["loss_db"] == pytest.approx(20.0 * np.log10(distance), abs=1e-3)
    assert np.isnan(row["level_db"])
    as_stored([replay.events, replay.summary])


def test_leakage_predicts_an_event_in_shadow_on_request(as_stored):
    """Over the crest half-way: 2 x hypot(2000, 100) m."""
    modem = Sonar(source_level_db=190.0, frequency_hz=1e3, bandwidth_hz=500.0, noise=60.0)
    events = Events(
        time=[0.0],
        source=["A"],
        receiver=["B"],
        source_position=[[0.0, 0.0, 250.0]],
        receiver_position=[[4000.0, 0.0, 250.0]],
        travel_time=[2.76],
        geographic=False,
    )
    bare = ReceptionOptions(detector=Detector(modem))
    for reception, status in ((bare, "blocked"), (bare._replace(leakage=Leakage(250.0)), "leaked")):
        replay = replay_events(events, Water(ridged(), reception=reception))
        (row,) = replay.events.to_dict("records")
        assert row["status"] == status
        assert replay.summary.loc[0, status] == 1
    assert row["predicted_s"] == pytest.approx(2.0 * np.hypot(2000.0, 100.0) / 1450.0, abs=2e-4)
    assert row["level_db"] == pytest.approx(190.0 - row["loss_db"])
    assert replay.summary.loc[0, "predicted"] == 1
    assert len(replay.candidates) == 1
    as_stored([replay.events, replay.candidates, replay.summary])


def test_a_correction_removes_known_clocks_and_suspect_offsets(as_stored):
    events = events_at([0.0, 3600.0])
    clocks = {"node": ["A", "B"], "offset_s": [1e-3, np.nan], "drift": [2e-6, 0.0]}
    found = SimpleNamespace(
        clocks=pd.DataFrame(clocks).assign(mean_time_s=1800.0),
        nodes=pd.DataFrame(
            {"node": ["A", "B"], "suspect": [False, True], "north_m": 30.0, "east_m": [9.0, -40.0]}
        ),
    )
    right = correct_events(events, found)
    late = -1e-3 - 2e-6 * np.array([-1800.0, 1800.0])
    np.testing.assert_allclose(right.travel_time, 4.0 - late, atol=1e-12)
    np.testing.assert_array_equal(right.source_position, events.source_position)
    azimuth, _, distance = pyproj.Geod(ellps="WGS84").inv(
        -144.9, 72.05, right.receiver_position[0, 1], right.receiver_position[0, 0]
    )
    assert (distance, azimuth) == pytest.approx((50.0, np.degrees(np.arctan2(-40.0, 30.0))))
    as_stored(right)
    local = correct_events(replace(events, geographic=False), found)
    moved = local.receiver_position - events.receiver_position
    np.testing.assert_allclose(moved, [[30.0, -40.0, 0.0]] * 2, atol=1e-12)


def test_instants_of_water_that_varies_are_rounded_in_its_span():
    span = SimpleNamespace(varies=True, start="2020-03-10T11:00", span=(0.0, 5400.0), require=float)
    rows, events = np.arange(3), events_at([0.0, 700.0, 4000.0])
    found = instants_in(events, rows, span, 600.0)
    np.testing.assert_array_equal(found, [3600.0, 4200.0, 5400.0])
    later = SimpleNamespace(**vars(span) | {"start": "2020-03-10T11:58", "span": (100.0, 5400.0)})
    np.testing.assert_array_equal(instants_in(events, rows[:1], later, 600.0), [100.0])
    refused(
        ReplayError,
        "times are seconds, but the water varies",
        instants_in,
        events_at([0.0], epoch="NaT"),
        rows[:1],
        span,
        600.0,
    )


@pytest.mark.parametrize("word", ["loudest", "within", "within:-3", "within:six", "first:3", ""])
def test_rules_that_are_none_are_refused(word):
    refused(
        ReplayError,
        "allowed are first, strongest, within:DB, threshold, persist:MINUTES",
        DetectionRule.parse,
        word,
    )


def test_rules_and_references_that_do_not_fit_are_refused():
    events = events_at([0.0])
    sonar = ReceptionOptions(
        detector=Detector(Sonar(source_level_db=190.0, frequency_hz=1e3, bandwidth_hz=500.0))
    )
    for waters in (Water(WATER), [Water(WATER, reception=sonar), Water(WATER)]):
        refused(
            ReplayError,
            "rule threshold: it needs a sonar",
            replay_events,
            events,
            waters,
            "threshold",
        )
    refused(
        ReplayError,
        "reference 'Z': no such node; allowed are A, B",
        replay_events,
        events,
        Water(WATER),
        reference="Z",
    )
    assert str(DetectionRule.parse("within:6")) == "within:6"
    assert replay_events(events, Water(WATER, reception=ReceptionOptions())).rule == DetectionRule(
        "within", 6.0
    )


def test_positions_of_located_nodes_take_the_place_of_the_events_own(tmp_path):
    nodes = tmp_path / "nodes.csv"
    nodes.write_text("name,lat,lon,depth,sigma_depth_m\nB,72.03,-145.2,151.5,0.02\n")
    own = read_events(write(tmp_path, ROW))
    empty = ROW.replace("72.02,-145.1,150", ",,")
    for row in (ROW, empty):
        events = read_events(write(tmp_path, row), nodes)
        np.testing.assert_array_equal(events.receiver_position, [[72.03, -145.2, 151.5]])
        np.testing.assert_array_equal(events.source_position, own.source_position)
    refused(ReplayError, "receiver_lat is ''", read_events, write(tmp_path, empty))
    nodes.write_text("name,north,east,depth\nB,1,2,3\n")
    refused(
        ReplayError,
        "nodes.csv: no lat, lon; the columns are",
        read_events,
        write(tmp_path, ROW),
        nodes,
    )


def test_events_that_occur_twice_or_have_no_fix_are_left_out(tmp_path, as_stored):
    rows = [ROW.replace("12:00:00Z", f"12:{m:02d}:00Z") for m in range(12)]
    whole = read_events(write(tmp_path, *rows))
    lost = rows[3].replace("72,-145", "0,0")
    path = write(tmp_path, *rows[:3], lost, *rows[4:], *rows[:2])
    events = read_events(path)
    np.testing.assert_array_equal(events.time, np.delete(whole.time, 3))
    assert events.notes == (
        f"{path}: 2 pings counted once: lines 14, 15 repeat earlier lines",
        f"{path}: 1 line left out, impossible position: line 5: A: position 0, 0 is no fix",
    )
    # the other names of a file do not decide about a node with one event
    only = rows[0].replace(",B,", ",C,").replace("72.02,-145.1", "999,999")
    assert len(read_events(write(tmp_path, *rows[1:], only)).time) == 11
    as_stored(events)


def test_events_may_be_unordered_but_not_pass_midnight(tmp_path):
    rows = [ROW.replace("2020-03-10T12:00:00Z", f"{t}") for t in (86_380, 86_390, 5)]
    words = "line 4: time falls from 86390 to 5 s, as from one day to the next"
    refused(ReplayError, words, read_events, write(tmp_path, *rows))
    later = [ROW.replace("12:00:00Z", f"12:{m:02d}:00Z") for m in (2, 0, 1)]
    events = read_events(write(tmp_path, *later))
    assert events.time.tolist() == [0.0, -120.0, -60.0]
    assert not events.notes


def test_positions_of_events_in_radians_are_refused(tmp_path):
    row = ROW.replace("72,-145", "1.2566,-2.5307").replace("72.02,-145.1", "1.2570,-2.5325")
    words = "travel_time is 1.* times the distance .* look like radians; convert them to degrees"
    refused(ReplayError, words, read_events, write(tmp_path, row.replace("1.6", "2.9")))


def test_events_in_degrees_with_long_times_are_not_in_radians(tmp_path):
    row = ROW.replace(",72", ",-72").replace("1.6", "160")  # south and west: all are negative
    assert read_events(write(tmp_path, row)).travel_time.tolist() == [160.0]


def test_nodes_that_drift_beside_the_equator_are_not_in_radians(tmp_path):
    """At 0.1 m/s, which is a walk if the degrees were radians."""
    rows = [f"{60 * k},A,B,{1.0 + 5.4e-5 * k},1,30,1.01,1,150,0.74" for k in range(4)]
    assert len(read_events(write(tmp_path, *rows)).time) == 4


@pytest.mark.parametrize(
    ("ratio", "unit"), [(400.0, True), (200.0, False), (1.0 / 2000.0, True), (1.0 / 5000.0, False)]
)
def test_travel_times_in_another_unit_are_refused(tmp_path, ratio, unit):
    """Over 1500 m of depth, which take about a second."""
    head = HEAD.replace("_lat", "_north").replace("_lon", "_east")
    path = write(tmp_path, f"0,A,B,0,0,700,0,0,2200,{ratio}", head=head)
    if unit:
        words = rf"travel_time is {ratio:.3g} times the distance .* s\); it must be in seconds"
        refused(ReplayError, words, read_events, path)
    else:
        assert read_events(path).travel_time == ratio


def test_nodes_at_one_place_may_hear_each_other_at_once(tmp_path):
    row = ROW.replace("72.02,-145.1,150,1.6", "72,-145,30,0.001")
    assert read_events(write(tmp_path, row)).travel_time.tolist() == [0.001]


def test_echoes_say_nothing_about_the_unit_of_times(tmp_path):
    """Its ends are as far apart as an echo sounder moves, half a metre."""
    head = HEAD.replace("_lat", "_north").replace("_lon", "_east")
    events = read_events(write(tmp_path, "0,A,A,0,0,700,0,0,700.5,0.6", head=head))
    assert events.is_echo.all()


def test_events_at_both_sides_of_the_date_line_have_right_distances(tmp_path):
    row = ROW.replace("72,-145", "72,179.98").replace("72.02,-145.1", "72,-179.99")
    assert len(read_events(write(tmp_path, row.replace("1.6", "0.7"))).time) == 1
