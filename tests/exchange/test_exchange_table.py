"""Tables of trajectories and pings: units, attitudes, time zones, and what is refused."""

import gsw
import numpy as np
import pandas as pd
import pytest
from refusals import refused
from scipy.spatial.transform import Rotation

from pymantaray import LocalFrame, read_trajectories
from pymantaray.errors import ExchangeError
from pymantaray.exchange import write_tum
from pymantaray.exchange.table import read_pings

TIME = np.array([0.0, 12.5, 20.0])
TABLE = pd.DataFrame(
    {
        "time": np.tile(TIME, 2),
        "vehicle": np.repeat(["A", "B"], 3),
        "north": [0.0, 1 / 3, 2.0, 10.0, 20.0, 30.0],
        "east": [1.0, 2.0, 1e4 / 7, 0.0, -1.0, -2.0],
        "depth": [5.0, 6.0, 7.0, 50.0, 60.0, 70.0],
    }
)


@pytest.mark.parametrize("name", ["mission.csv", "mission.tsv", "mission.parquet", None])
def test_a_table_comes_back_to_the_last_digit(name, tmp_path, as_stored):
    source = TABLE.copy() if name is None else tmp_path / name
    if name and name.endswith("parquet"):
        TABLE.to_parquet(source)
    elif name:
        TABLE.to_csv(source, index=False, sep="," if name.endswith("csv") else "\t")
    tracks = read_trajectories(source)
    assert (tracks.names, tracks.start, tracks.geodetic, tracks.notes) == (
        ["A", "B"],
        None,
        False,
        (),
    )
    for own, rows in zip(tracks.poses, (slice(0, 3), slice(3, 6)), strict=True):
        np.testing.assert_array_equal(own.time, TIME)
        np.testing.assert_array_equal(own.place, TABLE[["north", "east", "depth"]].to_numpy()[rows])
    as_stored(tracks)


def test_a_data_frame_is_left_as_it_was_and_its_faults_are_one_line():
    frame = TABLE.set_index("time").rename(columns={"depth": "depth [m]", "vehicle": "name"})
    before = frame.copy()
    assert read_trajectories(frame).names == ["A", "B"]
    pd.testing.assert_frame_equal(frame, before)
    dates = TABLE.assign(time=pd.Timestamp("2014-07-15") + pd.to_timedelta(TABLE["time"], unit="s"))
    assert read_trajectories(dates).start == np.datetime64("2014-07-15")
    for faulty, message in (
        (
            TABLE.drop(columns="depth"),
            "data frame: no depth; the columns are time, vehicle, north, east",
        ),
        (
            TABLE.assign(north=np.nan),
            "data frame, line 1: north is nan; it must be a finite number",
        ),
        (TABLE.iloc[:0], "data frame: no rows"),
    ):
        refused(ExchangeError, message, read_trajectories, faulty)


def test_names_of_columns_carry_units(tmp_path):
    other = TABLE.rename(
        columns={"north": "North [m]", "east": "east_km", "depth": "Depth (m)", "time": "time_s"}
    )
    other["east_km"] /= 1000.0
    other.to_csv(tmp_path / "other.csv", index=False)
    TABLE.to_csv(tmp_path / "plain.csv", index=False)
    one, two = (read_trajectories(tmp_path / f"{name}.csv").poses for name in ("other", "plain"))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_allclose(a.place, b.place, rtol=1e-15)


def test_angles_and_quaternions_say_the_same(tmp_path, as_stored):
    angles = np.radians([[30.0, 10.0, -5.0], [200.0, -20.0, 3.0], [359.0, 0.0, 0.0]])
    q = Rotation.from_euler("ZYX", angles).as_quat(scalar_first=True)
    base = TABLE.iloc[:3].drop(columns="vehicle")
    base.assign(
        **dict(
            zip(("heading_deg", "pitch [degrees]", "roll_deg"), np.degrees(angles).T, strict=True)
        )
    ).to_csv(tmp_path / "angles.csv", index=False)
    base.assign(**dict(zip(("yaw", "pitch", "roll"), angles.T, strict=True))).to_csv(
        tmp_path / "radians.csv", index=False
    )
    base.assign(**dict(zip(("qw", "qx", "qy", "qz"), q.T, strict=True))).to_csv(
        tmp_path / "quaternions.csv", index=False
    )
    for name in ("angles", "radians", "quaternions"):
        tracks = read_trajectories(tmp_path / f"{name}.csv")
        assert tracks.names == [name]
        own = Rotation.from_quat(tracks.poses[0].quaternion, scalar_first=True)
        np.testing.assert_allclose(
            (own.inv() * Rotation.from_quat(q, scalar_first=True)).magnitude(), 0, atol=1e-14
        )
    # nose up is a positive pitch: forward then points to smaller depths
    forward = own.apply([1.0, 0.0, 0.0])
    assert forward[0, 2] < 0.0 < forward[1, 2]
    as_stored(tracks)


@pytest.mark.parametrize(
    ("written", "start"),
    [
        (["2023-05-01T12:00:00+02:00", "2023-05-01T12:00:12.5+02:00", "2023-05-01T12:00:20+02:00"],
         "2023-05-01T10"),
        (["2023-05-01 12:00:00Z",
          "2023-05-01 12:00:12.500Z", "2023-05-01 12:00:20Z"], "2023-05-01T12"),
        (["2023-05-01T12:00", "2023-05-01T12:00:12.5", "2023-05-01T12:00:20"], "2023-05-01T12"),
        # clocks go back: 02:30 comes twice, and zones tell which is meant
        (["2023-10-29T02:59:50+02:00", "2023-10-29T02:00:02.5+01:00", "2023-10-29T02:00:10+01:00"],
         "2023-10-29T00:59:50"),
    ],
)  # fmt: skip
def test_dates_are_brought_to_utc(written, start, tmp_path, as_stored):
    TABLE.iloc[:3].assign(time=written).to_csv(tmp_path / "m.csv", index=False)
    tracks = read_trajectories(tmp_path / "m.csv")
    assert tracks.start == np.datetime64(start, "ns")
    np.testing.assert_array_equal(tracks.poses[0].time, TIME)
    as_stored(tracks)


def test_endings_may_be_in_capitals(tmp_path):
    pytest.importorskip("pyarrow")
    TABLE.to_parquet(tmp_path / "M.PARQUET")
    assert (
        read_trajectories(tmp_path / "M.PARQUET").names
        == read_trajectories(text(TABLE.to_csv(index=False), "M.CSV")(tmp_path)).names
    )


def test_dates_of_parquet_keep_their_zone(tmp_path, as_stored):
    when = pd.Timestamp("2023-05-01T12:00", tz="Europe/Oslo") + pd.to_timedelta(TIME, unit="s")
    for name, times in (("zone", when), ("utc", when.tz_convert("UTC").tz_localize(None))):
        TABLE.iloc[:3].assign(time=times).to_parquet(tmp_path / f"{name}.parquet")
        tracks = read_trajectories(tmp_path / f"{name}.parquet")
        assert tracks.start == np.datetime64("2023-05-01T10:00", "ns")
        np.testing.assert_array_equal(tracks.poses[0].time, TIME)
    as_stored(tracks)


def test_a_table_in_latitude_and_longitude_is_where_the_frame_says(tmp_path, as_stored):
    frame = LocalFrame(74.5, -140.0)
    lat, lon = frame.to_geodetic(TABLE["north"], TABLE["east"])
    TABLE.drop(columns=["north", "east"]).assign(lat=lat, longitude=lon).to_csv(
        tmp_path / "m.csv", index=False
    )
    truth = read_trajectories(tmp_path / "m.csv").at(TIME, frame)
    np.testing.assert_allclose(
        truth.position.reshape(-1, 3), TABLE[["north", "east", "depth"]], rtol=0, atol=1e-6
    )  # metres; digits of a degree
    as_stored(truth)


def test_several_files_are_one_fleet_on_one_clock(tmp_path, as_stored):
    q = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    for name, offset in (("A", 100.0), ("B", 107.0)):
        write_tum(tmp_path / f"{name}.tum", TIME + offset, TABLE[["north", "east", "depth"]][:3], q)
    tracks = read_trajectories(tmp_path / "*.tum")
    assert (tracks.names, tracks.duration) == (["A", "B"], 27.0)
    np.testing.assert_array_equal(tracks.poses[1].time, TIME + 7.0)
    np.testing.assert_array_equal(tracks.poses[0].place, TABLE[["north", "east", "depth"]][:3])
    as_stored(tracks)


def test_tum_files_of_ros_have_other_axes(tmp_path, as_stored):
    # goes east, nose east, at 4 m depth: in ROS x is east and the attitude is none
    rows = np.column_stack([TIME, TIME, 0 * TIME, -4 + 0 * TIME, np.tile([0.0, 0, 0, 1], (3, 1))])
    np.savetxt(tmp_path / "a.tum", rows)
    truth = read_trajectories(tmp_path / "a.tum", enu=True).at(TIME, LocalFrame(0, 0))
    np.testing.assert_allclose(truth.position[0], np.column_stack([0 * TIME, TIME, 4 + 0 * TIME]))
    body = Rotation.from_quat(truth.quaternion[0], scalar_first=True)
    np.testing.assert_allclose(body.apply([1.0, 0, 0]), np.tile([0.0, 1, 0], (3, 1)), atol=1e-15)
    np.testing.assert_allclose(body.apply([0, 0, 1.0]), np.tile([0.0, 0, 1], (3, 1)), atol=1e-15)
    as_stored(truth)


@pytest.mark.parametrize(
    ("kind", "file"),
    [("csv", "trajectories.csv"), ("parquet", "trajectories.parquet"), ("cf", "truth.nc")],
)
def test_what_was_exported_of_a_run_is_read_as_its_truth(
    kind, file, tiny_run_folder, tmp_path, as_stored
):
    from pymantaray.apps.export.run_files import export_run
    from pymantaray.apps.study import open_run

    run = open_run(tiny_run_folder)
    export_run(run, kind, tmp_path / "out")
    tracks = read_trajectories(tmp_path / "out" / file)
    assert (tracks.names, tracks.notes) == (run.truth.name.tolist(), ())
    truth = tracks.at(run.truth.time, LocalFrame(*run.truth.centre))
    np.testing.assert_allclose(truth.position, run.truth.position, rtol=0, atol=1e-6)
    turn = Rotation.from_quat(truth.quaternion.reshape(-1, 4), scalar_first=True).inv()
    turn *= Rotation.from_quat(run.truth.quaternion.reshape(-1, 4), scalar_first=True)
    assert turn.magnitude().max() < 1e-8  # rad; about the frame's north, 2e-3 from the true one
    assert np.abs(run.truth.frame.convergence(*run.truth.frame.to_geodetic(0.0, 6000.0))) > 3e-3
    as_stored(tracks)


def test_columns_that_are_not_read_are_said(tmp_path):
    TABLE.assign(heading_gon=0.0, salinity=35.0).to_csv(tmp_path / "m.csv", index=False)
    notes = read_trajectories(tmp_path / "m.csv").notes
    assert notes == (f"{tmp_path / 'm.csv'}: unused columns: heading_gon, salinity",)


def text(content, name="m.csv"):
    def write(folder):
        (folder / name).write_text(content)
        return folder / name

    return write


REFUSED = {
    "m.csv: no north, east; the columns are time, depth; a trajectory needs": (
        text("time,depth\n0,2\n1,2")
    ),
    "m.csv: no lon; the columns are time, lat, depth; a trajectory needs": (
        text("time,lat,depth\n0,1,2\n1,1,2")
    ),
    "m.csv: no east; the columns are time, lat, north, depth; a trajectory needs": text(
        "time,lat,north,depth\n0,1,1,2\n1,1,1,2"),
    "m.csv, line 3: depth is 'x'; it must be a finite number": text(
        "time,north,east,depth\n0,0,0,0\n1,0,0,x"),
    "m.csv, line 3: time is 'noon'; all cells must be seconds, or all must be dates": text(
        "time,north,east,depth\n2020-01-01,0,0,0\nnoon,0,0,0"),
    "m.csv, line 2: time is '5'; all cells must be seconds, or all must be dates": text(
        "time,north,east,depth\n5,0,0,0\n2020-01-01,0,0,0"),
    "m.csv: pitch without heading; add": text("time,north,east,depth,pitch\n0,0,0,0,0\n1,0,0,0,0"),
    "m.csv: heading has values up to 359, .* rename the column to heading_deg": text(
        "time,north,east,depth,heading\n0,0,0,0,0\n1,0,0,0,359"),
    r"m.csv: column 'Heading \[gon\]' has unit 'gon'; allowed: rad, radians, deg, degrees": text(
        "time,north,east,depth,Heading [gon]\n0,0,0,0,0\n1,0,0,0,0"),
    r"m.csv: column 'depth\(fathom\)' has unit 'fathom'; allowed: m, km, cm, mm, ft, feet, dbar": (
        text("time,north,east,depth(fathom)\n0,0,0,0\n1,0,0,0")
    ),
    "m.csv: only qw, qx, qy of a quaternion; give all of qw, qx, qy, qz": text(
        "time,north,east,depth,qw,qx,qy\n0,0,0,0,1,0,0\n1,0,0,0,1,0,0"),
    "m.csv: two columns vehicle; remove one": (
        text("time,vehicle,name,north,east,depth\n0,a,b,0,0,0\n1,a,b,0,0,0")
    ),
    "m.csv, line 3: vehicle is ''; it must have a name": (
        text("time,vehicle,north,east,depth\n0,a,0,0,0\n1,,0,0,0")
    ),
    r"m.csv, line 3: 500 m from the position of line 2 at the same time, .* to vehicle \(unused"
    r" columns: auv\)": text(
        "time,auv,north,east,depth\n0,A,0,0,0\n0,B,300,400,0\n1,A,0,0,0\n1,B,300,400,0"),
    # 0.04 degrees of longitude at 60 N
    r"m.csv, line 4: 2,2\d\d m from the position of line 3 at the same time": text(
        "time,lat,lon,depth\n0,0,0,0\n1,60,0,0\n1,60,0.04,0"),
    "m.csv: A: 1 pose;": text("time,vehicle,north,east,depth\n0,A,0,0,0\n0,B,0,0,0\n1,B,0,0,0"),
    "m.csv: is empty; a table needs a header": text(""),
    "no such file": lambda folder: folder / "none.csv",
    r"none\*.csv: no file matches this pattern": lambda folder: folder / "none*.csv",
    "unknown format of trajectories; allowed: .bag, .csv": text("x", "m.xyz"),
    "no file; name": lambda _: [],
    "m.parquet: not a readable Parquet file": text("PAR1", "m.parquet"),
    "m.tum, line 1: 7 numbers; a TUM file has 8": text("0 1 2 3 4 5 6\n" * 2, "m.tum"),
    "m.tum, line 1: '0 1 2 x 0 0 0 1' has a word that is no number": (
        text("0 1 2 x 0 0 0 1\n", "m.tum")
    ),
    "m.tum: 0 rows": text("# nothing\n", "m.tum"),
    "m.tum, line 2: a number is not finite": text("0 0 0 0 0 0 0 1\nnan 0 0 0 0 0 0 1\n", "m.tum"),
}  # fmt: skip


@pytest.mark.parametrize("message", REFUSED)
def test_bad_files_are_one_line_each(message, tmp_path):
    refused(ExchangeError, message, lambda: read_trajectories(REFUSED[message](tmp_path)))


CUT = {
    "m.csv": ("time,north,east,depth\n0,0,0,0\n1,0,0,5\n{}\n3,0,0,15\n",
              ["2,0", "2,0,0,x", "inf,0,0,10", "2,0,0,1,1"]),
    "m.tum": ("0 0 0 0 0 0 0 1\n1 0 0 5 0 0 0 1\n\n{}\n3 0 0 15 0 0 0 1\n",
              ["2 0 0", "2 0 0 x 0 0 0 1", "2 0 0 nan 0 0 0 1"]),
    "e.csv": (
        ("#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [],"
         " q_RS_z []\n"
        "0,0,0,0,1,0,0,0\n1000000000,0,0,5,1,0,0,0\n{}\n3000000000,0,0,15,1,0,0,0\n"),
        ["2000000000,0,0", "2000000000,0,0,x,1,0,0,0", "99999999999999999999,0,0,0,1,0,0,0"],
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "row"), [(name, row) for name, (_, rows) in CUT.items() for row in rows]
)
def test_unreadable_rows_of_a_track_are_listed_and_left_out(name, row, tmp_path, as_stored):
    (tmp_path / name).write_text(CUT[name][0].format(row))
    tracks = read_trajectories(tmp_path / name)
    assert tracks.poses[0].time.tolist() == [0.0, 1.0, 3.0]
    assert tracks.poses[0].place[:, 2].tolist() == [0.0, 5.0, 15.0]
    assert tracks.notes[0].startswith(f"{tmp_path / name}: 1 line left out, not readable: line 4: ")
    as_stored(tracks)


def test_a_vehicle_may_have_several_rows_per_resolution_of_time(tmp_path, as_stored):
    file = text("time,north,east,depth\n0,0,0,5\n0,0.5,0,5\n1,1,0,5\n1,1.5,0,5\n")(tmp_path)
    tracks = read_trajectories(file)
    assert any("2 poses at repeated times dropped" in note for note in tracks.notes)
    as_stored(tracks)


def test_a_table_of_parquet_without_rows_is_refused(tmp_path):
    TABLE.iloc[:0].assign(heading=[]).to_parquet(tmp_path / "m.parquet")
    refused(ExchangeError, "m.parquet: no rows", read_trajectories, tmp_path / "m.parquet")


def test_pings_are_seconds_or_dates_and_may_name_their_listeners(tmp_path, as_stored):
    path = text("time,transmitter,receivers\n0,A,\n10.5,B,A C\n")(tmp_path)
    pings = read_pings(path, None)
    assert (pings.time, pings.transmitter, pings.receivers) == (
        (0.0, 10.5),
        ("A", "B"),
        ((), ("A", "C")),
    )
    path = text("Time,Transmitter,receiver\n0,A,B\n")(tmp_path)  # a list that is not everybody
    assert read_pings(path, None).receivers == (("B",),)
    path = text("time,transmitter\n2023-05-01T12:00:00+02:00,A\n")(tmp_path)
    assert read_pings(path, np.datetime64("2023-05-01T09:59:00", "ns")).time == (60.0,)
    refused(
        ExchangeError,
        "times are dates, but the start of the mission has no date",
        lambda: read_pings(path, None),
    )
    refused(ExchangeError, "a ping is at -60 s; the mission starts at 0", lambda: read_pings(
        path, np.datetime64("2023-05-01T10:01:00", "ns")))  # fmt: skip
    refused(ExchangeError, "no transmitter; the columns are time, who; a list of pings needs",
            lambda: read_pings(
        text("time,who\n0,A\n")(tmp_path), None))  # fmt: skip
    mistyped = text("time,transmitter,receivrs\n0,A,B\n")(tmp_path)
    refused(
        ExchangeError,
        "m.csv: unknown column 'receivrs'; allowed: time, transmitter, receivers; rename",
        lambda: read_pings(mistyped, None),
    )
    both = text("time,transmitter,receiver,receivers\n0,A,B,B\n")(tmp_path)
    refused(ExchangeError, "two columns receivers; remove one", read_pings, both, None)
    as_stored(pings)


@pytest.mark.parametrize("place", ["north,east", "lat,lon"])
def test_times_in_days_are_refused(place, tmp_path):
    """1 m/s for ten minutes: 60 m north each minute."""
    size = 1.0 if place == "north,east" else 1.0 / 111_100.0
    for days, unit in ((False, 60.0), (True, 60.0 / 86_400.0)):
        rows = [f"{41834 + k * unit:.9f},{60.0 * k * size:.9f},179.99,10" for k in range(10)]
        (tmp_path / "m.csv").write_text("\n".join([f"time,{place},depth", *rows]))
        if days:
            message = (
                "m: time gives a median speed of 86,[34]\\d\\d m/s; it must be in seconds;"
                " multiply days by 86400"
            )
            refused(ExchangeError, message, read_trajectories, tmp_path / "m.csv")
        else:
            assert read_trajectories(tmp_path / "m.csv").poses[0].time.size == 10


def test_a_vehicle_over_the_antimeridian_is_not_fast(tmp_path):
    (tmp_path / "m.csv").write_text("time,lat,lon,depth\n0,0,179.999,10\n100,0,-179.999,10\n")
    assert read_trajectories(tmp_path / "m.csv").names == ["m"]


DEPTHS = {
    "depth_cm": 100.0,
    "depth [ft]": 1.0 / 0.3048,
    "depth (mm)": 1000.0,
    "depth_km": 1e-3,
}


@pytest.mark.parametrize("title", [*DEPTHS, "pressure_dbar", "depth [dbar]", "pressure [kPa]"])
def test_depths_are_metres_whatever_their_unit(tmp_path, title):
    lat, depth = 71.0 + 1e-4 * np.arange(5), np.linspace(10.0, 400.0, 5)
    pressure = gsw.p_from_z(-depth, lat)
    factor = {"pressure [kPa]": 10.0}.get(title, 1.0)
    values = DEPTHS[title] * depth if title in DEPTHS else factor * pressure
    frame = pd.DataFrame({"time": np.arange(5.0), "lat": lat, "lon": 8.0, title: values})
    frame.to_csv(tmp_path / "a.csv", index=False)
    (poses,) = read_trajectories(tmp_path / "a.csv").poses
    np.testing.assert_allclose(poses.place[:, 2], depth, atol=1e-6)


def test_pressures_need_a_latitude(tmp_path):
    frame = pd.DataFrame({"time": np.arange(5.0), "north": 0.0, "east": 0.0, "depth_dbar": 5.0})
    frame.to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(ExchangeError, match="pressures become depths by the latitude"):
        read_trajectories(tmp_path / "a.csv")


def test_radians_of_a_column_are_named(tmp_path):
    lat, lon = np.radians([71.0, 71.001]), np.radians([8.0, 8.001])
    frame = pd.DataFrame({"time": [0.0, 60.0], "lat_rad": lat, "lon_rad": lon, "depth": 5.0})
    frame.to_csv(tmp_path / "a.csv", index=False)
    (poses,) = read_trajectories(tmp_path / "a.csv").poses
    np.testing.assert_allclose(poses.place[:, 0], [71.0, 71.001], atol=1e-9)
