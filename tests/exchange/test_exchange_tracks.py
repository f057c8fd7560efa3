"""Trajectories brought to common times and a local frame: no pose is changed, none is made up."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from refusals import refused
from scipy.spatial.transform import Rotation

from pymantaray.errors import ExchangeError
from pymantaray.exchange import Poses, Tracks, read_trajectories
from pymantaray.exchange.frames import swap_enu, swap_enu_attitude
from pymantaray.exchange.tracks import level, union_of_times, with_times
from pymantaray.geometry import LocalFrame
from pymantaray.records import VehicleStatus

FRAME = LocalFrame(74.5, -140.0)
TIME = np.array([0.0, 7.0, 30.0, 31.5, 60.0])
PLACE = np.array([[0, 0, 5], [10, 3, 6], [40, -9, 8], [42, -8, 8], [42, 20, 3.0]])


def poses(name="A", time=TIME, place=PLACE, quaternion=None, *, geodetic=False):
    return Poses(
        name, np.asarray(time), np.asarray(place, dtype=float), quaternion, geodetic, "mission.csv"
    )


def random_attitudes(n, seed=1):
    return Rotation.random(n, rng=np.random.default_rng(seed)).as_quat(scalar_first=True)


def angle_between(one, other):
    """Of two unit quaternions, whose signs do not matter."""
    apart = np.minimum(np.linalg.norm(one - other, axis=-1), np.linalg.norm(one + other, axis=-1))
    return 4.0 * np.arcsin(apart / 2.0)


def test_a_vehicle_has_the_exact_poses_of_the_file_at_its_times(as_stored):
    q = random_attitudes(TIME.size)
    times = np.sort(np.concatenate([TIME, np.linspace(0.0, 60.0, 23)]))
    truth = Tracks.of([poses(quaternion=q)]).at(times, FRAME)
    own = np.searchsorted(times, TIME)
    np.testing.assert_array_equal(truth.position[0, own], PLACE)
    np.testing.assert_allclose(truth.quaternion[0, own], q, rtol=0, atol=1e-15)
    assert truth.role.tolist() == ["track"]
    as_stored(truth)


def test_between_times_positions_are_linear_and_rotations_uniform(as_stored):
    q = random_attitudes(TIME.size)
    share = np.array([0.1, 0.25, 0.7])
    for k in range(TIME.size - 1):
        times = TIME[k] + share * (TIME[k + 1] - TIME[k])
        truth = Tracks.of([poses(quaternion=q)]).at(times, FRAME)
        np.testing.assert_allclose(
            truth.position[0],
            PLACE[k] + share[:, None] * (PLACE[k + 1] - PLACE[k]),
            rtol=0,
            atol=1e-12,
        )
        whole = angle_between(q[k], q[k + 1])
        np.testing.assert_allclose(
            angle_between(q[k], truth.quaternion[0]), share * whole, rtol=0, atol=1e-12
        )
    as_stored(truth)


def test_outside_its_span_a_vehicle_is_not_there(as_stored):
    late = poses("B", TIME + 100.0, PLACE + 500.0)
    truth = Tracks.of([poses(), late]).at([0.0, 60.0, 60.1, 99.9, 100.0, 160.0, 161.0], FRAME)
    A, X = VehicleStatus.ACTIVE, VehicleStatus.ABSENT
    np.testing.assert_array_equal(truth.status, [[A, A, X, X, X, X, X], [X, X, X, X, A, A, X]])
    np.testing.assert_array_equal(truth.position[0, 2:], np.tile(PLACE[-1], (5, 1)))
    np.testing.assert_array_equal(truth.position[1, :4], np.tile(PLACE[0] + 500.0, (4, 1)))
    assert truth.stops == {"A": (X, 60.1), "B": (X, 161.0)}
    as_stored(truth)


def test_a_record_in_which_a_vehicle_is_never_there_is_refused(as_stored):
    late = poses("B", TIME + 100.0)
    truth = Tracks.of([poses(), late]).at([0.0, 30.0, 60.0], FRAME)
    refused(ExchangeError, "B: 0 poses; a trajectory needs at least two", Tracks.of_record, truth)
    as_stored(truth)


def test_without_attitudes_a_vehicle_is_level_and_heads_where_it_goes(as_stored):
    place = [[0, 0, 5], [0, 0, 9], [10, 0, 9], [10, 0, 2], [10, 5, 2.0]]
    truth = Tracks.of([poses(place=place)]).at(TIME, FRAME)
    heading = (
        np.pi / 2 * np.array([0.0, 0.0, 0.0, 1.0, 1.0])
    )  # at rest: as before, at first as then
    heading[2] = 0.0
    np.testing.assert_allclose(angle_between(truth.quaternion[0], level(heading)), 0.0, atol=1e-12)
    as_stored(truth)


@pytest.mark.parametrize("centre", [(74.5, -140.0), (-60.0, 179.9), (10.0, 20.0)])
def test_headings_by_true_north_are_those_of_the_motion_in_the_frame(centre):
    frame, bearing = LocalFrame(*centre), 0.7
    lat = centre[0] + 2.0 + 1e-6 * np.cos(bearing) * TIME
    lon = centre[1] + 4.0 + 1e-6 * np.sin(bearing) * TIME / np.cos(np.radians(lat))
    q = np.tile(level(bearing), (TIME.size, 1))
    geographic = poses(place=np.column_stack([lat, lon, 0 * lat]), quaternion=q, geodetic=True)
    by_file = Tracks.of([geographic]).at(TIME, frame).quaternion
    by_motion = Tracks.of([geographic._replace(quaternion=None)]).at(TIME, frame).quaternion
    assert (
        angle_between(by_file, level(bearing)).min() > 0.01
    )  # the frame's north is not true north there
    # metres of a degree of latitude and of longitude differ by 1 in 150 on the ellipsoid
    np.testing.assert_allclose(angle_between(by_file, by_motion), 0.0, atol=5e-3)


def test_a_track_over_the_antimeridian_has_no_jump(as_stored):
    lon = np.array([179.98, 179.99, -180.0, -179.99, -179.98])
    tracks = Tracks.of(
        [poses(place=np.column_stack([np.full(5, 60.0), lon, np.zeros(5)]), geodetic=True)]
    )
    assert tracks.centre == pytest.approx((60.0, -180.0))
    east = tracks.at(TIME, LocalFrame(*tracks.centre)).position[0, :, 1]
    np.testing.assert_allclose(np.diff(east), 0.01 * 111_413 * np.cos(np.radians(60.0)), rtol=2e-3)
    as_stored(tracks)


def test_dates_and_seconds_give_the_same_clock():
    start = np.datetime64("2014-07-15T12:00:00.123456789", "ns")
    dates = start + np.round(TIME * 1e9).astype("timedelta64[ns]")
    tracks = Tracks.of([poses("B", dates + np.timedelta64(5, "s")), poses("A", dates)])
    assert tracks.start == start
    np.testing.assert_array_equal(tracks.poses[0].time, TIME + 5.0)
    np.testing.assert_array_equal(tracks.poses[1].time, TIME)
    assert (tracks.names, tracks.duration) == (["B", "A"], 65.0)
    seconds = Tracks.of([poses("B", TIME + 1005.0), poses("A", TIME + 1000.0)])
    assert seconds.start is None
    np.testing.assert_array_equal(seconds.poses[0].time, TIME + 5.0)


def test_rows_are_sorted_and_a_time_that_comes_twice_counts_once(as_stored):
    order = [3, 0, 4, 1, 2, 2]
    tracks = Tracks.of([poses(time=TIME[order], place=PLACE[order])])
    np.testing.assert_array_equal(tracks.poses[0].place, PLACE)
    assert tracks.notes[0].startswith("mission.csv, pose 1: A: time ")
    assert tracks.notes[0].endswith("rows sorted by time (2 falls)")
    assert tracks.notes[1:] == ("mission.csv: A: 1 pose at repeated times dropped",)
    as_stored(tracks)


def test_a_depth_sensor_may_be_a_little_above_the_surface(as_stored):
    for above, count in ((0.4, 1), (4.9, 3)):
        tracks = Tracks.of([poses(place=PLACE - [0, 0, 3.0 + above])])
        assert tracks.poses[0].place[:, 2].min() == 0.0
        assert tracks.notes == (
            f"mission.csv: A: {count} poses up to {above} m above the surface moved to the surface",
        )
    as_stored(tracks)


def test_a_name_that_a_study_cannot_have_becomes_one_that_it_can(as_stored):
    tracks = Tracks.of([poses("Seaglider 12/α")])
    assert tracks.names == ["Seaglider_12"]
    assert "Seaglider 12/α: renamed to Seaglider_12" in tracks.notes[0]
    as_stored(tracks)


def test_a_record_comes_back_and_vehicles_that_stopped_are_not_there(as_stored):
    from factories import trajectories

    truth = trajectories(np.cumsum(np.ones((2, 9, 3)), axis=1), names=["A", "B"])
    again = Tracks.of_record(truth).at(truth.time, FRAME)
    np.testing.assert_array_equal(again.position, truth.position)
    np.testing.assert_array_equal(again.quaternion, truth.quaternion)
    as_stored(again)


def test_places_about_another_centre_are_brought_to_the_frame(as_stored):
    q, near = random_attitudes(TIME.size), LocalFrame(74.6, -139.0)
    (here,) = Tracks.of([poses(quaternion=q)._replace(centre=(74.5, -140.0))]).in_frame(near)
    assert np.linalg.norm(here.place[0, :2]) > 20e3
    (back,) = Tracks.of([here._replace(centre=(74.6, -139.0))]).in_frame(FRAME)
    np.testing.assert_allclose(back.place, PLACE, rtol=0, atol=1e-6)
    np.testing.assert_allclose(angle_between(back.quaternion, q), 0.0, atol=1e-8)
    north = [FRAME.to_geodetic([0.0, 1000.0], [0.0, 0.0])]
    step = np.squeeze([np.diff(axis) for axis in near.to_local(*north[0])])
    turn = angle_between(here.quaternion[0], q[0])
    assert turn == pytest.approx(abs(np.arctan2(step[1], step[0])), abs=1e-4)
    as_stored(back)


def test_with_times_keeps_every_sample_and_adds_the_ones_between():
    from factories import trajectories

    truth = trajectories(np.cumsum(np.ones((2, 9, 3)), axis=1), names=["A", "B"])
    step = truth.time[1]
    more = with_times(truth, np.array([0.5 * step, 2.0 * step + 1e-7, 7.25 * step]))
    assert more.time.size == truth.time.size + 2
    own = np.isin(more.time, truth.time)
    np.testing.assert_array_equal(more.position[:, own], truth.position)
    np.testing.assert_allclose(
        more.position[:, ~own], np.array([1.5, 8.25])[None, :, None] * np.ones((2, 1, 3))
    )
    assert with_times(truth, truth.time[[2, 5]]) is truth


def test_union_of_times_holds_both_and_no_time_twice():
    times = union_of_times(
        np.array([0.0, 10.0, 20.0]), np.array([30.0, 10.0 + 5e-7, 5.0, 5.0 + 5e-7, 20.0])
    )
    np.testing.assert_array_equal(times, [0.0, 5.0, 10.0, 20.0, 30.0])


def test_quaternions_of_unit_length_keep_all_their_digits():
    q = random_attitudes(TIME.size)  # lengths are one to the last digit or two
    (own,) = Tracks.of([poses(quaternion=q)]).poses
    np.testing.assert_array_equal(own.quaternion, q)
    (rounded,) = Tracks.of([poses(quaternion=q.round(3))]).poses
    np.testing.assert_allclose(np.linalg.norm(rounded.quaternion, axis=-1), 1.0, atol=1e-15)


def test_east_north_up_and_back_is_where_one_was():
    rng = np.random.default_rng(3)
    p, q = rng.normal(size=(7, 3)), random_attitudes(7)
    np.testing.assert_allclose(swap_enu(swap_enu(p)), p, atol=1e-15)
    np.testing.assert_allclose(swap_enu_attitude(swap_enu_attitude(q)), q, atol=1e-15)
    # by matrices: a vector of the body, written in its axes of either kind, points to the same
    # place
    flu = rng.normal(size=(7, 3))
    frd = flu * [1, -1, -1]
    enu = Rotation.from_quat(q, scalar_first=True).apply(flu)
    ned = Rotation.from_quat(swap_enu_attitude(q), scalar_first=True).apply(frd)
    np.testing.assert_allclose(ned, enu[:, [1, 0, 2]] * [1, 1, -1], atol=1e-14)


IMPOSSIBLE = {
    "A: 1 pose; a trajectory needs at least two": lambda: [poses(time=TIME[:1], place=PLACE[:1])],
    "two vehicles have the name A; rename one": lambda: [poses(), poses()],
    "pose 2 has a position that is not finite": (
        lambda: [poses(place=np.where(PLACE == 40, np.nan, PLACE))]
    ),
    "position is 95, 95; latitude must be -90 to 90": lambda: [
        poses(place=PLACE + 95.0, geodetic=True)
    ],
    "depth -5.1 m is above the surface; .*change the sign": (
        lambda: [poses(place=PLACE - [0, 0, 8.1])]
    ),
    "the quaternion of pose 0 has length 0; it must be 1": (
        lambda: [poses(quaternion=np.zeros((5, 4)))]
    ),
    "A has latitude and longitude, but B of mission.csv does not": lambda: [
        poses(geodetic=True), poses("B")],
    "A has dates, but B of mission.csv does not": lambda: [
        poses(time=TIME.astype("datetime64[ns]")), poses("B")],
}  # fmt: skip


@pytest.mark.parametrize("message", IMPOSSIBLE)
def test_impossible_trajectories_are_refused_in_one_line(message):
    refused(ExchangeError, message, lambda: Tracks.of(IMPOSSIBLE[message]()))


ZERO_FIX = 7  # row without a fix


def lost_fix(tmp_path, kind):
    """A track of 20 rows in a file of a kind, with one row that is 0, 0, and the right rows."""
    k = np.arange(20)
    time = 10.0 * k
    place = np.column_stack([44.5 + 1e-4 * k, -125.1 + 2e-4 * k, 10.0 + k])
    local = np.column_stack([5e4 + 11.0 * k, 15.0 * k, 10.0 + k])
    right = local if kind in ("tum", "euroc") else place
    wrong = right.copy()
    wrong[ZERO_FIX, :2] = 0.0
    path = tmp_path / f"auv.{ {'euroc': 'csv'}.get(kind, kind) }"
    unit = np.tile([0.0, 0.0, 0.0, 1.0], (20, 1))
    if kind in ("csv", "parquet"):
        frame = pd.DataFrame(wrong, columns=["lat", "lon", "depth"]).assign(time=time)
        frame.to_csv(path, index=False) if kind == "csv" else frame.to_parquet(path)
    elif kind == "tum":
        np.savetxt(path, np.column_stack([time, wrong, unit]))
    elif kind == "euroc":
        head = "#timestamp,p_RS_R_x,p_RS_R_y,p_RS_R_z,q_RS_w,q_RS_x,q_RS_y,q_RS_z"
        rows = np.column_stack([1e9 * time, wrong, unit[:, ::-1]])
        np.savetxt(path, rows, "%d" + 7 * ",%.9g", header=head[1:], comments="#")
    else:
        attrs = {"units": "seconds since 2021-03-04", "standard_name": "time"}
        data = {"time": ("obs", time, attrs)}
        for name, values in zip(("latitude", "longitude", "depth"), wrong.T, strict=True):
            data[name] = "obs", values, {"standard_name": name}
        xr.Dataset(data).to_netcdf(path)
    return path, time, right


@pytest.mark.parametrize("kind", ["csv", "parquet", "tum", "euroc", "nc"])
def test_a_row_without_a_fix_is_left_out_of_every_format(tmp_path, kind, as_stored):
    path, time, right = lost_fix(tmp_path, kind)
    tracks = read_trajectories(path)
    poses = tracks.poses[0]
    for axis in (0, 1):
        value = np.interp(time, poses.time, poses.place[:, axis])
        np.testing.assert_allclose(value, right[:, axis], rtol=0, atol=1e-8)
    (note,) = [note for note in tracks.notes if "impossible position" in note]
    line = {"csv": 9, "parquet": 8, "tum": 8, "euroc": 9, "nc": 7}[kind]
    assert f" {line}: auv: position 0, 0 is " in note
    if kind in ("csv", "parquet", "nc"):
        np.testing.assert_allclose(tracks.centre, right[:, :2].mean(axis=0), rtol=0, atol=1e-12)
    as_stored(tracks)


def test_titles_state_degrees_or_radians(tmp_path):
    frame = pd.DataFrame({"time": [0.0, 10.0], "depth": 5.0})
    angles = np.radians([[44.5, -125.1], [44.5001, -125.1]])
    plain = frame.assign(lat=angles[:, 0], lon=angles[:, 1])
    refused(ExchangeError, "look like radians; convert them", read_trajectories, plain)
    stated = frame.assign(lat_rad=angles[:, 0], lon_rad=angles[:, 1])
    place = read_trajectories(stated).poses[0].place
    np.testing.assert_allclose(place[:, :2], np.degrees(angles), rtol=0, atol=1e-12)
    degrees = frame.assign(lat_deg=angles[:, 0], lon_deg=angles[:, 1])
    np.testing.assert_array_equal(read_trajectories(degrees).poses[0].place[:, :2], angles)


def test_times_of_day_of_a_track_must_not_pass_midnight(tmp_path):
    frame = pd.DataFrame({"time": [86_390.0, 86_400.0, 5.0], "depth": 5.0, "lat": 1.0, "lon": 7.0})
    frame.to_csv(tmp_path / "a.csv", index=False)
    refused(
        ExchangeError,
        "a.csv, line 4: a: time falls from 86400 to 5 s, as from one day to the next",
        read_trajectories,
        tmp_path / "a.csv",
    )


@pytest.mark.parametrize("gross", [(0.0, 0.0), (74.5, -40.0), (-74.5, -140.0), (88.0, -140.0)])
@pytest.mark.parametrize("row", [0, 3, 9])
def test_one_gross_row_does_not_move_the_default_centre(gross, row, as_stored):
    """The centre is the middle of the extremes of the other rows."""
    place = np.column_stack(
        [74.5 + 1e-5 * np.arange(10), -140.0 + 2e-5 * np.arange(10), np.full(10, 5.0)]
    )
    place[row, :2] = gross
    others = np.delete(place, row, axis=0)[:, :2]
    tracks = Tracks.of([poses(time=10.0 * np.arange(10), place=place, geodetic=True)])
    middle = 0.5 * (others.min(axis=0) + others.max(axis=0))
    assert tracks.centre == pytest.approx(tuple(middle), abs=1e-12)
    assert sum("1 " in note and "left out" in note for note in tracks.notes) == 1
    as_stored(tracks)
