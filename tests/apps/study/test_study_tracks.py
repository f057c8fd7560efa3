"""
Other people's trajectories as a fleet: the same ranges by every road, schedules of all kinds, lines
for what is wrong.
"""

import datetime as dt

import numpy as np
import pandas as pd
import pytest
from factories import TINY
from refusals import refused

from pymantaray import LocalFrame, load_study
from pymantaray.apps.export.run_files import export_run
from pymantaray.apps.ranges import measure
from pymantaray.apps.study import open_run, run_study
from pymantaray.apps.study.figures.register import RunResults
from pymantaray.apps.study.page import warnings_of
from pymantaray.config import parse_study
from pymantaray.config.door.fleet import with_tracks
from pymantaray.config.door.study import build_study
from pymantaray.errors import ExchangeError, MantaRayError, StudyError
from pymantaray.evaluation import dropout_table, range_error_table
from pymantaray.exchange import Tracks
from pymantaray.exchange.centre import centre_beside
from pymantaray.ocean import open_ocean
from pymantaray.records import RayStatus, VehicleStatus, write_netcdf
from pymantaray.sensing import PingList, PingSchedule, SlotSchedule

OCEAN = {
    "source": "synthetic:beaufort",
    "centre_lat": 74.5,
    "centre_lon": -140.0,
    "half_extent_north": 15000.0,
    "half_extent_east": 15000.0,
}


NO_CENTRE = {key: OCEAN[key] for key in ("source", "half_extent_north", "half_extent_east")}


@pytest.fixture(scope="module")
def study_run(tiny_run_folder):
    return open_run(tiny_run_folder)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """
    Two unicycles and a mooring, in plain numpy: columns time, vehicle, north, east, depth, heading.
    """
    path = tmp_path_factory.mktemp("tracks") / "mission.csv"
    time = np.arange(0.0, 3601.0, 30.0)
    parts = []
    for name, speed, turn, depth in (
        ("A", 1.5, 4e-4, 40.0),
        ("B", 1.0, -7e-4, 120.0),
        ("M", 0.0, 0.0, 300.0),
    ):
        heading = 0.5 + turn * time
        step = speed * 30.0 * np.column_stack([np.cos(heading), np.sin(heading)])
        north, east = (np.cumsum(step, axis=0) + 700.0 * len(parts)).T
        columns = {"time": time, "vehicle": name, "north": north, "east": east}
        columns |= {"depth": depth + 20.0 * np.sin(time / 500.0) * (speed > 0), "heading": heading}
        parts.append(pd.DataFrame(columns))
    pd.concat(parts).to_csv(path, index=False)
    return path


def same_ranges(one, other):
    """Two runs have the same attempts, statuses and travel times to the last digit."""
    for name in ("range_transmitter", "range_receiver", "range_status"):
        np.testing.assert_array_equal(
            getattr(one.measurements, name), getattr(other.measurements, name)
        )
    when = [run.measurements.time[run.measurements.range_sample] for run in (one, other)]
    np.testing.assert_array_equal(*when)
    for name in ("travel_time", "chord_travel_time", "distance", "sound_speed"):
        np.testing.assert_array_equal(
            getattr(one.ranging_truth, name), getattr(other.ranging_truth, name)
        )


def test_the_truth_of_a_study_as_a_fleet_gives_the_same_ranges(study_run):
    marks = [mark.model_dump() for mark in study_run.config.landmarks]
    by_file = measure(study_run.path / "truth.nc", OCEAN, 3600.0, landmarks=marks)
    same_ranges(by_file, study_run)
    same_ranges(measure(study_run.truth, OCEAN, 3600.0, landmarks=marks), study_run)
    assert by_file.truth.role.tolist() == ["track"] * 4
    assert by_file.truth.start == study_run.truth.start
    # all but roles is that of the study, so tables of all links agree
    one, other = (
        range_error_table(r.measurements, r.ranging_truth, r.truth).iloc[-1].to_dict()
        for r in (by_file, study_run)
    )
    assert one == other


def test_a_study_of_trajectories_equals_one_of_the_same_vehicles(study_run, tmp_path):
    tree = {**TINY, "fleet": {"trajectories": str(study_run.path / "truth.nc")}}
    tree["mission"] = {"ping_interval_h": 1.0}
    run = run_study(parse_study(tree), tmp_path / "run", workers=1)
    same_ranges(run, study_run)
    m, other = run.measurements, study_run.measurements
    np.testing.assert_allclose(
        m.odometry_translation, other.odometry_translation, rtol=0, atol=1e-12
    )
    # same draws, same truth: the same estimates
    np.testing.assert_allclose(
        run.estimates.position, study_run.estimates.position, rtol=0, atol=1e-6
    )
    assert run.config.mission.duration_h == 4.0
    assert list(run.manifest["ocean"]["sha256"]) == [str(study_run.path / "truth.nc")]
    assert np.datetime64(run.manifest["fleet"]["start"]) == study_run.truth.start


def test_places_in_latitude_and_longitude_make_a_frame_of_their_own(study_run, tmp_path):
    frame, truth = LocalFrame(74.5, -140.0), study_run.truth
    rows = []
    for i, name in enumerate(truth.name):
        lat, lon = frame.to_geodetic(truth.position[i, :, 0], truth.position[i, :, 1])
        rows.append(pd.DataFrame({"time": truth.time, "vehicle": name, "lat": lat, "lon": lon,
                                  "depth": truth.position[i, :, 2]}))  # fmt: skip
    pd.concat(rows).to_csv(tmp_path / "m.csv", index=False)
    same = measure(tmp_path / "m.csv", OCEAN, 3600.0)
    same_ranges(measure(pd.read_csv(tmp_path / "m.csv", comment="#"), OCEAN, 3600.0), same)
    np.testing.assert_allclose(same.truth.position, truth.position, rtol=0, atol=1e-6)
    free = measure(tmp_path / "m.csv", NO_CENTRE, 3600.0)
    lat, lon = frame.to_geodetic(*np.moveaxis(truth.position[..., :2], -1, 0))
    centre = free.config.ocean.centre
    assert centre == pytest.approx(
        (0.5 * (lat.min() + lat.max()), 0.5 * (lon.min() + lon.max())), abs=1e-9
    )
    assert (
        free.ocean.attrs["centre_latitude_deg"],
        free.ocean.attrs["centre_longitude_deg"],
    ) == centre
    # another frame, another grid of the same water: the same travel times within what grids differ
    # by
    both = (free.measurements.range_status == 0) & (same.measurements.range_status == 0)
    assert both.sum() > 10
    np.testing.assert_allclose(
        free.ranging_truth.travel_time[both], same.ranging_truth.travel_time[both], rtol=2e-4
    )


def test_slots_let_one_vehicle_ping_at_a_time(table):
    schedule = SlotSchedule(("B", "A", "A"), slot=100.0, start=50.0)
    run = measure(table, OCEAN, schedule)
    m = run.measurements
    when, who = m.time[m.range_sample], m.name[m.range_transmitter]
    slot = np.round((when - 50.0) / 100.0).astype(int)
    assert when.tolist() == sorted(when.tolist())
    np.testing.assert_allclose(when, 50.0 + 100.0 * slot, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(who, np.array(["B", "A", "A"])[slot % 3])
    assert m.range_status.size == 36 * 2  # two listeners of every ping of 50, 150, ... 3550 s
    assert run.links.sample.size == 36 * 2
    # poses at pings are on the line between those of the file
    k = int(np.flatnonzero(m.time == 50.0)[0])
    own = Tracks.of_record(measure(table, OCEAN, 60.0, mission={"sampling_period_s": 30.0}).truth)
    between = own.at([30.0, 60.0], LocalFrame(74.5, -140.0)).position
    np.testing.assert_allclose(
        run.truth.position[:, k], between[:, 0] / 3 + 2 * between[:, 1] / 3, atol=1e-9
    )


def test_a_list_of_pings_makes_one_link_of_both_ways_at_one_time(table, tmp_path, as_stored):
    pings = PingList(
        (10.0, 10.0, 500.5, 9999.0), ("A", "B", "M", "A"), (("B",), ("A",), ("A", "L"), ())
    )
    mark = {"name": "L", "north": 0.0, "east": 0.0, "depth": 100.0}
    run = measure(table, OCEAN, pings, landmarks=[mark])
    m = run.measurements
    names = np.array([*m.name, "L"])
    rows = list(
        zip(
            m.time[m.range_sample], names[m.range_transmitter], names[m.range_receiver], strict=True
        )
    )
    assert rows == [(10.0, "A", "B"), (10.0, "B", "A"), (500.5, "M", "A"), (500.5, "M", "L")]
    assert run.links.sample.size == 3
    assert run.ranging_truth.travel_time[0] == run.ranging_truth.travel_time[1]
    (tmp_path / "pings.csv").write_text(
        "time,transmitter,receivers\n10,A,B\n10,B,A\n500.5,M,A L\n9999,A,\n"
    )
    tree = {**TINY, "ocean": OCEAN, "fleet": {"trajectories": [str(table)]}, "landmarks": [mark]}
    tree |= {"study": {"name": "pings"}, "conditions": []}
    tree["mission"] = {"schedule": {"kind": "pings", "file": "pings.csv"}}
    written = run_study(parse_study(tree, folder=tmp_path), tmp_path / "run", workers=1)
    same_ranges(run, written)
    assert str(tmp_path / "pings.csv") in written.manifest["ocean"]["sha256"]
    as_stored({"m": run.measurements, "truth": run.ranging_truth, "fleet": run.truth})


@pytest.mark.parametrize("timing", [pytest.param("one-way", marks=pytest.mark.slow), "two-way"])
def test_a_landmark_that_transmits_is_heard_as_it_hears(table, timing):
    mark = {"name": "L", "north": 200.0, "east": -400.0, "depth": 150.0}
    options = {"landmarks": [mark], "ranging": {"timing": timing}}
    both = measure(table, OCEAN, PingList((600.0, 600.0), ("M", "L"), (("L",), ("M",))), **options)
    true = both.ranging_truth
    assert (both.measurements.range_status == RayStatus.OK).all()
    assert true.travel_time[0] == true.travel_time[1]  # both at rest, in water at rest
    assert true.sound_speed[0] != true.sound_speed[1]
    alone = measure(table, OCEAN, SlotSchedule(("L",), slot=600.0), **options)
    m = alone.measurements
    assert (m.range_transmitter == 3).all()
    assert m.range_receiver.tolist() == [0, 1, 2] * 7
    heard_by_m = alone.ranging_truth.travel_time[m.range_receiver == 2]
    np.testing.assert_array_equal(heard_by_m, true.travel_time[1])


def test_estimators_run_on_the_pings_of_landmarks_alone(table, tmp_path):
    marks = [
        {"name": f"L{k}", "north": north, "east": east, "depth": 150.0}
        for k, (north, east) in enumerate([(4e3, 0.0), (-2e3, 3e3), (0.0, -4e3)])
    ]
    tree = {**TINY, "ocean": OCEAN, "fleet": {"trajectories": [str(table)]}, "landmarks": marks}
    tree["study"] = {**TINY["study"], "realizations": 2}
    tree["conditions"] = ["odometry", "straight", "refracted"]
    tree["mission"] = {"schedule": {"kind": "slots", "slots": ["L0", "L1", "L2"], "slot_s": 100.0}}
    run = run_study(parse_study(tree), tmp_path / "run", workers=1)
    assert (run.measurements.range_transmitter >= 3).all()
    error = run.errors().groupby("condition")["error"].mean()
    assert error["straight"] < 0.5 * error["odometry"]
    assert run.ranges(0)["transmitter"].unique().tolist() == ["L0", "L1", "L2"]


@pytest.mark.slow
def test_every_schedule_gives_the_travel_time_of_its_time(table):
    interval = measure(table, OCEAN, 600.0)
    slots = measure(table, OCEAN, SlotSchedule(("A", "B", "M"), slot=600.0, start=600.0))

    def times(run):
        m = run.measurements
        keys = zip(m.time[m.range_sample], m.range_transmitter, m.range_receiver, strict=True)
        times = np.nan_to_num(run.ranging_truth.travel_time, nan=-1.0)
        return dict(zip(keys, times.tolist(), strict=True))

    all_pairs, in_turn = times(interval), times(slots)
    assert len(in_turn) == len(all_pairs) // 3
    assert {key: all_pairs[key] for key in in_turn} == in_turn


def test_simulated_vehicles_may_ping_between_samples(study_run):
    tree = {**TINY, "study": {"name": "slots"}, "conditions": []}
    tree["mission"] = {**TINY["mission"], "duration_h": 1.0,
                       "schedule": {"kind": "slots", "slots": ["A", "B"],
                                    "slot_s": 310.0}}  # fmt: skip
    from pymantaray.apps.study.manifest import Stopwatch
    from pymantaray.apps.study.mission import simulate_mission

    mission = simulate_mission(build_study(parse_study(tree)), Stopwatch(), lambda *_: None)
    pings = 310.0 * np.arange(12)
    assert set(mission.truth.time) == {*np.arange(0.0, 3601.0, 200.0), *pings}
    own = np.isin(mission.truth.time, study_run.truth.time)
    np.testing.assert_array_equal(
        mission.truth.position[:, own], study_run.truth.position[:, : own.sum()]
    )


def test_vehicles_that_are_not_there_are_silent(tmp_path, table):
    frame = pd.read_csv(table)
    frame = frame[(frame["vehicle"] != "B") | frame["time"].between(900.0, 2400.0)]
    frame.to_csv(tmp_path / "late.csv", index=False)
    run = measure(tmp_path / "late.csv", OCEAN, 300.0)
    m = run.measurements
    of_b = (m.range_transmitter == 1) | (m.range_receiver == 1)
    there = (m.time[m.range_sample] >= 900.0) & (m.time[m.range_sample] <= 2400.0)
    assert (m.range_status[of_b & ~there] == RayStatus.STOPPED).all()
    assert (m.range_status[~of_b | there] != RayStatus.STOPPED).all()
    assert run.truth.stops == {"B": (VehicleStatus.ABSENT, pytest.approx(2600.0, abs=200.0))}
    assert dropout_table(m, run.truth)["stopped"].iloc[-1] == (of_b & ~there).sum()


def test_an_interval_below_zero_is_refused_by_the_name_of_its_option(table, tmp_path, capsys):
    from pymantaray.cli.main import main

    words = ["ranges", str(table), "--ocean", "synthetic:beaufort", "--interval", "-3"]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--out", str(tmp_path / "out")])
    assert ended.value.code == 2
    assert "--interval is -3 s; it must be finite and positive" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_folder_of_ranges_alone_has_a_report_and_no_estimates(table, tmp_path):
    from pymantaray.cli.main import main

    out = tmp_path / "out"
    words = [
        "ranges",
        str(table),
        "--ocean",
        "synthetic:beaufort",
        "--interval",
        "600",
        "--out",
        str(out),
    ]
    with pytest.raises(SystemExit) as ended:
        main([*words, "--quiet"])
    assert ended.value.code == 0
    run = open_run(out)
    same_ranges(run, measure(table, "synthetic:beaufort", PingSchedule(600.0)))
    assert not (out / "estimates.nc").exists()
    tables = {path.stem for path in (out / "tables").iterdir()}
    assert tables >= {"dropouts", "range_error", "range_error_split", "region"}
    assert not tables & {"ate_pooled", "solves", "ping_error"}
    figures = {path.stem for path in (out / "figures").iterdir()}
    assert {"fleet_layout", "range_error", "dropouts"} <= figures
    assert not figures & {"ape_pooled", "error_over_time", "factor_graph"}
    page = (out / "index.html").read_text()
    assert "3 vehicles, 1 h" in page
    assert "Position error, " not in page  # among the numbers it opens with
    assert run.noisy_measurements(0).straight_range.size == run.measurements.straight_range.size
    last = run.config.study.realizations - 1  # of the noise, without estimates
    assert run.trajectories(last).equals(run.trajectories(0))
    assert not run.ranges(last).equals(run.ranges(0))


def test_the_mission_is_as_long_as_the_trajectories_unless_it_is_cut(table):
    tree = {**TINY, "fleet": {"trajectories": [str(table)]}, "mission": {"ping_interval_h": 0.25}}
    assert with_tracks(parse_study(tree)).mission.duration_h == 1.0
    cut = with_tracks(parse_study({**tree, "mission": {"duration_h": 0.5}}))
    assert cut.mission.duration_h == 0.5
    long = parse_study({**tree, "mission": {"duration_h": 2.0}})
    refused(
        StudyError,
        "mission.duration_h is 2 h, but the trajectories last 1 h; remove the key",
        lambda: with_tracks(long),
    )


@pytest.mark.slow
def test_water_that_varies_is_that_of_the_dates(table, tmp_path):
    # near an eddy that moves
    varying = {**OCEAN, "time_varying": True, "centre_lat": 74.8, "centre_lon": -136.95}
    frame, runs = pd.read_csv(table, dtype=str), {}  # as it stands
    for hour in (10, 15):
        start = pd.Timestamp(f"2014-07-15T{hour + 2}:00:00+02:00")
        dated = frame.assign(time=start + pd.to_timedelta(frame["time"].astype(float), unit="s"))
        dated.to_csv(tmp_path / "dated.csv", index=False)
        runs[hour] = measure(tmp_path / "dated.csv", varying, 1800.0, acoustics={"currents": True})
        assert runs[hour].truth.start == np.datetime64(f"2014-07-15T{hour}:00:00")
    varying["time"] = dt.datetime(2014, 7, 15, 10)  # noqa: DTZ001
    by_hand = measure(table, varying, 1800.0, acoustics={"currents": True})
    same_ranges(runs[10], by_hand)
    one, other = (run.ranging_truth.travel_time for run in runs.values())
    assert np.nanmax(np.abs(one - other)) > 1e-7


def far_away(table):
    frame = pd.read_csv(table)
    frame.assign(north=frame["north"] + 1e6).to_csv(table.with_name("far.csv"), index=False)
    return table.with_name("far.csv")


IMPOSSIBLE = {
    "far.csv: no pose is in the ocean: poses are 10.* km north, .* the ocean reaches -15.0 to"
    " 15.0": lambda table: measure(far_away(table), OCEAN, 600.0),
    "SlotSchedule: slots of 10 s from 0 s on: no vehicle or landmark is called 'Z'; allowed: A, B,"
    " M": lambda table: measure(table, OCEAN, SlotSchedule(("A", "Z"), 10.0)),
    "PingSchedule: interval is 7200 s, the mission lasts 3600 s; at least one ping": lambda table: (
        measure(table, OCEAN, 7200.0)
    ),
    "PingList: .* no vehicle or landmark is called 'L'": lambda table: measure(
        table, OCEAN, PingList((1.0,), ("L",))
    ),
    "PingList: .*: A listens to itself": lambda table: measure(
        table, OCEAN, PingList((1.0,), ("A",), (("A",),))
    ),
    "names of vehicles and landmarks must differ; found A": lambda table: measure(
        table, OCEAN, 600.0, landmarks=[{"name": "A", "north": 0.0, "east": 0.0, "depth": 1.0}]
    ),
    "ranges: `acoustics.max_bounces`: unknown key": lambda table: measure(
        table, OCEAN, 600.0, acoustics={"max_bounces": 1}
    ),
    "no-such.csv": lambda _: measure("no-such.csv", OCEAN, 600.0),
    "no-such.nc": lambda _: run_study(
        parse_study({**TINY, "fleet": {"trajectories": "no-such.nc"}})
    ),
    "fleet: vehicles or trajectories make a fleet; give ": lambda _: parse_study(
        {**TINY, "fleet": {}}
    ),
    "fleet: vehicles or trajectories make a fleet; both are given": lambda _: parse_study(
        {**TINY, "fleet": {**TINY["fleet"], "trajectories": "m.csv"}}
    ),
    "mission.schedule.kind: found 'often'; allowed: 'slots', 'pings'": lambda _: parse_study(
        {**TINY, "mission": {"schedule": {"kind": "often"}}}
    ),
    "no ranges: B is the only vehicle and there is no landmark; add the trajectory of another"
    " vehicle": lambda table: measure(pd.read_csv(table).query("vehicle == 'B'"), OCEAN, 600.0),
    "SlotSchedule: slot is 0 s": lambda _: SlotSchedule(("A",), 0.0),
    "PingList: 1 transmitter of 2 pings": lambda _: PingList((0.0, 1.0), ("A",)),
}


@pytest.mark.parametrize("message", IMPOSSIBLE)
def test_what_cannot_be_ranged_is_refused_in_one_line(message, table):
    refused(MantaRayError, message, lambda: IMPOSSIBLE[message](table))


def test_presets_are_fleets_of_vehicles_as_before():
    config = load_study("quick")
    assert with_tracks(config) is config


@pytest.mark.parametrize("where", ["slots", "pings", "trajectories"])
def test_a_name_that_nobody_has_is_refused_before_anything_is_done(where, table, tmp_path):
    tree = {**TINY, "ocean": OCEAN, "study": {"name": "names"}, "conditions": []}
    tree["mission"] = {
        **TINY["mission"],
        "schedule": {"kind": "slots", "slots": ["A", "Z"], "slot_s": 60.0},
    }
    if where == "pings":
        (tmp_path / "pings.csv").write_text("time,transmitter,receivers\n60,A,Z\n")
        tree["mission"]["schedule"] = {"kind": "pings", "file": "pings.csv"}
    elif where == "trajectories":
        tree["fleet"] = {"trajectories": [str(table)]}
        del tree["mission"]["duration_h"]
    stages = []
    refused(
        MantaRayError,
        "no vehicle or landmark is called 'Z'; allowed: A, B",
        lambda: run_study(
            parse_study(tree, folder=tmp_path),
            tmp_path / "run",
            progress=lambda *now: stages.append(now),
        ),
    )
    assert not stages
    assert not (tmp_path / "run").exists()


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """A run whose frame's centre is 60 km from the middle of its ocean."""
    tree = {**TINY, "study": {"name": "elsewhere", "realizations": 1}, "conditions": ["straight"]}
    tree["mission"] = {**TINY["mission"], "duration_h": 2.0}
    tree["ocean"] = {**OCEAN, "centre_lat": 74.1, "centre_lon": -141.5}
    return run_study(parse_study(tree), tmp_path_factory.mktemp("elsewhere") / "run", workers=1)


@pytest.mark.parametrize(
    ("to", "files"),
    [
        ("tum", "truth-*.tum"),
        ("cf", "truth.nc"),
        ("csv", "trajectories.csv"),
        pytest.param("parquet", "trajectories.parquet", marks=pytest.mark.slow),
        ("bag", ""),
        pytest.param("mcap", "", marks=pytest.mark.slow),
    ],
)
def test_an_exported_run_comes_back_into_the_same_water(elsewhere, tmp_path, to, files):
    if to in ("bag", "mcap"):
        pytest.importorskip("rosbags")
    made = export_run(elsewhere, to, tmp_path / ("run.mcap" if to == "mcap" else "run"))
    source = f"{made}/{files}" if files else made
    marks = [mark.model_dump() for mark in elsewhere.config.landmarks]
    back = measure(source, NO_CENTRE, 3600.0, landmarks=marks)
    assert back.config.ocean.centre == (74.1, -141.5)
    names = [name.removeprefix("truth-") for name in back.truth.name.tolist()]
    assert names == elsewhere.truth.name.tolist()
    one, other = (
        run.ranges()
        .replace("^truth-", "", regex=True)
        .sort_values(["time", "transmitter", "receiver"])
        for run in (elsewhere, back)
    )
    assert one["status"].tolist() == other["status"].tolist()
    np.testing.assert_allclose(other["refracted_range"], one["refracted_range"], rtol=0, atol=1e-6)
    np.testing.assert_allclose(other["sound_speed"], one["sound_speed"], rtol=1e-12)


@pytest.mark.parametrize("to", ["kitti", "g2o", "pyfg"])
def test_formats_without_room_for_a_centre_have_it_beside_them(elsewhere, tmp_path, to):
    folder = export_run(elsewhere, to, tmp_path / "run")
    assert centre_beside(next(folder.glob("*.*"))) == (74.1, -141.5)


def test_the_centre_that_nobody_named_is_told(table, tmp_path, caplog):
    """
    Local positions of a table without a centre: the middle of the ocean is taken, and a line says
    so.
    """
    run = measure(table, NO_CENTRE, 1800.0)
    centre = (run.ocean.attrs["centre_latitude_deg"], run.ocean.attrs["centre_longitude_deg"])
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith(
        f"{table}: positions are local and no file gives the centre of their frame"
    )
    for part in centre:
        assert f"{abs(round(part, 3)):g} {'N' if part > 0 else 'W'}" in line
    assert "`centre`" in line
    assert "ocean.centre_lat" in line
    assert run.notes == [line], "of the run itself, not of a folder in which it was made"
    refused(StudyError, "a run in memory has no manifest", getattr, run, "manifest")
    caplog.clear()
    measure(table, OCEAN, 1800.0)
    named = tmp_path / "named.csv"
    head = "# centre_latitude_deg = 74.2\n# centre_longitude_deg: -140.5\n"
    named.write_text(head + table.read_text())
    assert measure(named, NO_CENTRE, 1800.0).config.ocean.centre == (74.2, -140.5)
    assert not caplog.records
    named.write_text(head.replace("74.2", "north") + table.read_text())
    refused(
        ExchangeError,
        "named.csv: the centre is centre_latitude_deg 'north', .* degrees",
        measure,
        named,
        NO_CENTRE,
        1800.0,
    )


def test_a_run_of_local_positions_has_its_centre_in_the_manifest(table, tmp_path):
    tree = {"study": {"name": "r"}, "conditions": [], "ocean": NO_CENTRE}
    tree |= {"fleet": {"trajectories": str(table)}, "mission": {"ping_interval_h": 1.0}}
    config = parse_study(tree)
    assert "own vehicles, as long as their trajectories, 25" in repr(config)
    run = run_study(config, tmp_path / "run", workers=1)
    assert run.manifest["fleet"]["start"] is None
    (note,) = [n for n in run.manifest["fleet"]["notes"] if "the middle of the ocean is used" in n]
    assert f"{run.ocean.attrs['centre_latitude_deg']:g} N" in note
    assert warnings_of(RunResults(run)) == run.notes, "it has no solves"


def test_ranges_need_no_currents_unless_they_carry_sound(table, tmp_path):
    ocean = open_ocean("synthetic:beaufort", window=(74.2, 74.8, -141.0, -139.0))
    write_netcdf(ocean[["water_temp", "salinity"]], tmp_path / "still.nc")
    section = {
        **OCEAN,
        "source": str(tmp_path / "still.nc"),
        "half_extent_north": 8e3,
        "half_extent_east": 8e3,
    }
    assert measure(table, section, 1800.0).measurements.range_status.size
    for more, sections in (({}, {"acoustics": {"currents": True}}), ({"currents": "required"}, {})):
        refused(
            MantaRayError,
            "no water_u and no water_v",
            measure,
            table,
            section | more,
            1800.0,
            **sections,
        )
