"""What a run is exported as, opened by the programs that it is for, against the run."""

import re
import sys
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from factories import names_in
from oracles import cf_errors
from refusals import files_of_at_most, refused

from pymantaray.apps.export.run_files import FORMATS, export_run, record
from pymantaray.errors import ExchangeError, JobError, StudyError, WriteError
from pymantaray.estimation import read_pyfg
from pymantaray.exchange import read_trajectories
from pymantaray.exchange.cf import write_cf
from pymantaray.exchange.rosbag import write_bag
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import RayStatus, VehicleStatus

REALIZATION = 1
UP = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
"""North, east, down to east, north, up."""
LATE = 3  # samples
FLOAT32 = 1e-6  # relative; a little more than its rounding


@pytest.fixture(scope="module")
def poses(run):
    """Position and quaternion, body to north, east, down, by condition and vehicle."""
    e, truth = run.estimates, run.truth
    both = {
        ("truth", a): (truth.position[i], truth.quaternion[i]) for i, a in enumerate(truth.name)
    }
    for (c, condition), (i, vehicle) in product(enumerate(e.condition), enumerate(truth.name)):
        both[condition, vehicle] = e.position[c, REALIZATION, i], e.quaternion[c, REALIZATION, i]
    return both


def assert_enu(position, xyzw, pose, *, rtol=1e-12):
    """
    Places are turned to east, north, up; forward, left and up of the body are forward, -right and
    -down of ours.
    """
    place, quaternion = pose
    np.testing.assert_allclose(position, place @ UP.T, rtol=rtol, atol=rtol)
    ours = UP @ matrix_from_quaternion(
        quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    )
    theirs = matrix_from_quaternion(np.asarray(xyzw, dtype=float)[..., [3, 0, 1, 2]])
    np.testing.assert_allclose(theirs, ours * [1.0, -1.0, -1.0], atol=3e-7)


def test_evo_reads_the_same_errors_from_tum(run, exported, poses):
    interface = pytest.importorskip("evo.tools.file_interface")
    metrics = pytest.importorskip("evo.core.metrics")
    out = exported("tum")
    assert names_in(out) == sorted(f"{condition}-{vehicle}.tum" for condition, vehicle in poses)
    lat, lon = run.truth.centre
    assert (out / "truth-A.tum").read_text().splitlines()[:2] == [
        f"# centre_latitude_deg = {lat}",
        f"# centre_longitude_deg = {lon}",
    ]
    errors = (
        run.errors()
        .set_index(["condition", "realization", "vehicle"])
        .sort_index(kind="stable")["error"]
    )
    truth = {a: interface.read_tum_trajectory_file(out / f"truth-{a}.tum") for a in run.truth.name}
    for condition, vehicle in poses:
        read = interface.read_tum_trajectory_file(out / f"{condition}-{vehicle}.tum")
        assert read.check()[0]
        np.testing.assert_array_equal(read.positions_xyz, poses[condition, vehicle][0])
        np.testing.assert_allclose(
            read.orientations_quat_wxyz, poses[condition, vehicle][1], atol=1e-7
        )
        if condition != "truth":
            ape = metrics.APE(metrics.PoseRelation.translation_part)
            ape.process_data((truth[vehicle], read))
            np.testing.assert_allclose(
                ape.error, errors[condition, REALIZATION, vehicle], atol=1e-9
            )


def test_evo_reads_kitti(run, exported, poses, as_stored):
    interface = pytest.importorskip("evo.tools.file_interface")
    out = exported("kitti")
    assert names_in(out) == sorted(
        [
            "frame.json",
            *(f"{c}-{a}.txt" for c, a in poses),
            *(f"times-{a}.txt" for a in run.truth.name),
        ]
    )
    some = ("frame.json", "refracted-D.txt", "straight-C.txt", "times-B.txt", "truth-C.txt")
    as_stored({name: out / name for name in some})
    for (condition, vehicle), (position, quaternion) in poses.items():
        read = interface.read_kitti_poses_file(out / f"{condition}-{vehicle}.txt")
        matrices = np.array(read.poses_se3)
        np.testing.assert_array_equal(matrices[:, :3, 3], position)
        np.testing.assert_allclose(
            matrices[:, :3, :3], matrix_from_quaternion(quaternion), atol=2e-7
        )
    np.testing.assert_array_equal(np.loadtxt(out / "times-B.txt"), run.truth.time)


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_pandas_reads_tables_whose_columns_say_their_units(run, exported, to, as_stored):
    if to == "parquet":
        pytest.importorskip("pyarrow")
    out = exported(to)
    assert names_in(out) == [f"errors.{to}", "frame.json", f"ranges.{to}", f"trajectories.{to}"]
    read = {
        name: pd.read_csv(out / f"{name}.csv", dtype=str)
        if to == "csv"
        else pd.read_parquet(out / f"{name}.parquet")
        for name in ("errors", "ranges", "trajectories")
    }
    # as numbers, whose last digits depend on the machine
    as_stored({n: pd.read_csv(out / f"{n}.csv") if to == "csv" else t for n, t in read.items()})
    ranges, errors = run.ranges(REALIZATION), run.errors()
    for column in ("time", "distance", "refracted_range", "travel_time"):
        unit = ranges.attrs["units"][column]
        np.testing.assert_array_equal(
            read["ranges"][f"{column}_{unit}"].astype(float), ranges[column]
        )
    assert read["ranges"]["status"].tolist() == ranges["status"].tolist()
    np.testing.assert_array_equal(pd.to_datetime(read["ranges"]["date"]), ranges["date"])
    np.testing.assert_array_equal(
        read["errors"]["error_m"].astype(float),
        errors[errors["realization"] == REALIZATION]["error"],
    )
    here, there = run.trajectories(REALIZATION), read["trajectories"]
    for column, own in (
        ("latitude_deg", "latitude"),
        ("north_m", "north"),
        ("down_m", "down"),
        ("qw", "qw"),
    ):
        np.testing.assert_array_equal(there[column].astype(float), here[own])


def test_gtsam_reads_the_poses_and_odometry_of_g2o(run, exported, poses, as_stored):
    import gtsam

    out = exported("g2o")
    assert names_in(out) == ["frame.json", "refracted.g2o", "straight-all.g2o", "straight.g2o"]
    as_stored(out, without="^/straight-all")
    graph, values = gtsam.readG2o(str(out / "refracted.g2o"), True)
    n_vehicles, n = run.truth.status.shape
    assert (values.size(), graph.size()) == (n_vehicles * n, n_vehicles * (n - 1))
    for i, vehicle in enumerate(run.truth.name):
        position, quaternion = poses["refracted", vehicle]
        pose = values.atPose3(i * n + n - 1)
        np.testing.assert_allclose(pose.translation(), position[-1], rtol=1e-15)
        np.testing.assert_allclose(
            pose.rotation().matrix(), matrix_from_quaternion(quaternion[-1]), atol=3e-7
        )
    step = graph.at(0).measured()
    noisy = run.noisy_measurements(REALIZATION)
    np.testing.assert_allclose(step.translation(), noisy.odometry_translation[0, 0], rtol=1e-15)


def test_pyfg_of_the_first_realization_is_that_of_the_run(run, tmp_path, as_stored):
    out = export_run(run, "pyfg", tmp_path / "out")
    as_stored(out, without="/straight")
    for name in ("straight", "refracted", "straight-all"):
        graph, values = read_pyfg(out / f"{name}.pyfg")
        own, own_values = read_pyfg(run.path / f"pyfg/realization-0-{name}.pyfg.gz")
        np.testing.assert_allclose(own_values.position, values.position, rtol=1e-11)
        assert list(own.tables) == list(graph.tables)
        for kind, table in graph.tables.items():
            for of in ("variables", "measurement", "covariance"):
                numbers = getattr(own[kind], of), getattr(table, of)
                np.testing.assert_allclose(*numbers, rtol=1e-11, atol=1e-11)
    other = export_run(run, "pyfg", tmp_path / "other", realization=1)
    graph, _ = read_pyfg(other / "refracted.pyfg")
    heard = run.measurements.range_status == RayStatus.OK
    noisy = run.noisy_measurements(1).refracted_range[heard]
    np.testing.assert_allclose(graph["range"].column("distance").ravel(), noisy, rtol=1e-15)


def test_rerun_reads_transforms_and_ranges(run, exported, poses):
    chunk = pytest.importorskip("rerun.chunk")
    columns = {}
    for part in chunk.RrdReader(exported("rrd")).stream().to_chunks():
        batch = part.to_record_batch()
        for name in batch.schema.names:
            columns.setdefault(part.entity_path, {})[name] = batch.column(name)
    for (condition, vehicle), pose in poses.items():
        entity = columns[f"/map/{condition}/{vehicle}"]
        position, xyzw = (
            np.array(entity[f"Transform3D:{name}"].to_pylist()).squeeze(1)
            for name in ("translation", "quaternion")
        )
        assert_enu(position, xyzw, pose, rtol=FLOAT32)
        time = entity["mission"].to_numpy(zero_copy_only=False)
        np.testing.assert_array_equal(time, run.truth.start + run.truth.time.astype("m8[s]"))
    ranges = run.ranges(REALIZATION)
    for receiver in ("B", "L0"):
        heard = ranges.query(f"status == 'OK' and transmitter == 'A' and receiver == '{receiver}'")
        error = np.array(
            columns[f"/range_error/A/{receiver}"]["Scalars:scalars"].to_pylist()
        ).ravel()
        np.testing.assert_allclose(error, heard["refracted_range"] - heard["distance"], atol=1e-9)
    strips = columns["/map/ranges"]["LineStrips3D:strips"].to_pylist()
    assert sum(map(len, strips)) == (ranges["status"] == "OK").sum()
    line = columns["/earth/B"]["GeoLineStrings:line_strings"].to_pylist()[0][0]
    np.testing.assert_allclose(
        line,
        run.trajectories().query("condition == 'truth' and vehicle == 'B'")[
            ["latitude", "longitude"]
        ],
    )


def messages_of_bag(folder):
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store, out = get_typestore(Stores.ROS2_HUMBLE), []
    with rosbag2.Reader(folder) as reader:
        for connection, time, raw in reader.messages():
            out.append((connection.topic, time, store.deserialize_cdr(raw, connection.msgtype)))
    return out


def messages_of_mcap(file):
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    with file.open("rb") as stream:
        decoded = reader.make_reader(
            stream, decoder_factories=[decoder.DecoderFactory()]
        ).iter_decoded_messages()
        return [
            (channel.topic, message.log_time, content) for _, channel, message, content in decoded
        ]


def place_of(point):
    return point.x, point.y, point.z


def turn_of(q):
    return q.x, q.y, q.z, q.w


@pytest.mark.parametrize(("to", "messages"), [("bag", messages_of_bag), ("mcap", messages_of_mcap)])
def test_messages_of_ros_are_the_runs_in_the_axes_of_ros(run, exported, poses, to, messages):
    pytest.importorskip("rosbags")
    topics, previous = {}, 0
    for topic, time, content in messages(exported(to)):
        assert time >= previous
        previous = time
        topics.setdefault(topic, []).append((time, content))
    names = {condition: condition.replace("-", "_") for condition, _ in poses}
    instants = (
        (run.truth.start + (run.truth.time * 1e6).astype("m8[us]"))
        .astype("M8[ns]")
        .astype(int)
        .tolist()
    )
    for (condition, vehicle), pose in poses.items():
        stamped = topics[f"/{names[condition]}/{vehicle}/pose"]
        assert [time for time, _ in stamped] == instants
        contents = [content for _, content in stamped]
        assert {c.header.frame_id for c in contents} == {"map"}
        assert (
            contents[1].header.stamp.sec * 10**9 + contents[1].header.stamp.nanosec == instants[1]
        )
        assert_enu(
            [place_of(c.pose.position) for c in contents],
            [turn_of(c.pose.orientation) for c in contents],
            pose,
        )
        ((_, path),) = topics[f"/{names[condition]}/{vehicle}/path"]
        assert place_of(path.poses[-1].pose.position) == place_of(contents[-1].pose.position)
    last = {t.child_frame_id: t.transform for t in topics["/tf"][-1][1].transforms}
    assert set(last) == {f"{vehicle}/base_link" for vehicle in run.truth.name}
    assert_enu(
        place_of(last["B/base_link"].translation),
        turn_of(last["B/base_link"].rotation),
        [p[-1] for p in poses["truth", "B"]],
    )
    marks, static = run.measurements, topics["/tf_static"][0][1].transforms
    assert [t.child_frame_id for t in static] == marks.landmark_name.tolist()
    np.testing.assert_allclose(
        [place_of(t.transform.translation) for t in static], marks.landmark_position @ UP.T
    )
    fixes = [content for _, content in topics["/truth/B/fix"]]
    here = run.trajectories().query("condition == 'truth' and vehicle == 'B'")
    np.testing.assert_array_equal(
        [[f.latitude, f.longitude, -f.altitude] for f in fixes],
        here[["latitude", "longitude", "down"]],
    )
    ((_, origin),) = topics["/map/fix"]
    assert (origin.header.frame_id, origin.latitude, origin.longitude) == ("map", 74.5, -140.0)
    ranges = run.ranges(REALIZATION).query("status == 'OK'")
    for (transmitter, receiver), rows in ranges.groupby(["transmitter", "receiver"]):
        heard = topics.pop(f"/ranges/{transmitter}/{receiver}")
        np.testing.assert_allclose(
            [c.range for _, c in heard], rows["refracted_range"], rtol=FLOAT32
        )
        assert heard[0][1].header.frame_id == (
            receiver if receiver in marks.landmark_name else f"{receiver}/base_link"
        )
    assert not any(topic.startswith("/ranges") for topic in topics)


@pytest.fixture(scope="module")
def late(run):
    """A recording in which B is not there at first."""
    recording = record(run, REALIZATION)
    status = run.truth.status.copy()
    status[1, :LATE] = VehicleStatus.ABSENT
    return replace(recording, truth=replace(run.truth, status=status))


@pytest.mark.parametrize(
    ("write", "file"), [(write_cf, "truth.nc"), pytest.param(write_bag, "", marks=pytest.mark.slow)]
)
def test_our_own_readers_take_back_places_dates_and_who_is_there(
    run, late, tmp_path, write, file, as_stored
):
    if write is write_bag:
        pytest.importorskip("rosbags")
    write(late, tmp_path)
    tracks = read_trajectories(tmp_path / file)
    if file:
        as_stored(tmp_path, without="attrs|/straight")
    assert sorted(tracks.names) == sorted(run.truth.name)  # estimates are no vehicles
    track = next(p for p in tracks.in_frame(run.truth.frame) if p.name == "B")
    np.testing.assert_allclose(track.place, run.truth.position[1, LATE:], atol=1e-6)
    np.testing.assert_allclose(track.time, run.truth.time[LATE:], atol=1e-6)
    assert tracks.start == run.truth.start


@pytest.mark.slow
def test_cf_trajectories_point_where_the_vehicles_do_and_comply(run, late, tmp_path):
    write_cf(late, tmp_path)
    with xr.open_dataset(tmp_path / "truth.nc") as data:
        b = data.isel(trajectory=1)
        assert int(b["time"].count()) == run.truth.time.size - LATE
        north, east, _ = np.moveaxis(
            matrix_from_quaternion(run.truth.quaternion[1, LATE:])[:, :, 0], -1, 0
        )
        bearing = run.truth.frame.convergence(b["latitude"][:-LATE], b["longitude"][:-LATE])
        heading = np.degrees(np.arctan2(east, north) - bearing) % 360.0
        np.testing.assert_allclose(b["heading"][:-LATE], heading, atol=1e-9)
    assert not cf_errors(sorted(tmp_path.glob("*.nc")))
    nowhere = replace(late, truth=replace(late.truth, centre=None))
    refused(
        ExchangeError,
        "the run has no date or no geographic position",
        write_cf,
        nowhere,
        tmp_path,
    )


def test_names_of_estimators_become_such_as_ros_allows(run, tmp_path):
    reader = pytest.importorskip("rosbags.highlevel").AnyReader
    recording = record(run, 0)
    poses = next(iter(recording.estimates.values()))
    write_bag(replace(recording, estimates={"bias-0.5": poses, "2-at--5-km": poses}), tmp_path)
    with reader([tmp_path]) as bag:
        topics = {connection.topic for connection in bag.connections}
    assert {"/bias_0_5/A/pose", "/_2_at_5_km/A/pose"} <= topics
    for token in {token for topic in topics for token in topic.strip("/").split("/")}:
        assert re.fullmatch("_?[A-Za-z0-9]+(?:_[A-Za-z0-9]+)*", token), token


def test_names_that_ros_cannot_tell_apart_are_refused(run, tmp_path):
    pytest.importorskip("rosbags")
    recording = record(run, 0)
    words = np.array(["glider-1", "glider_1", "3", "D"])
    same = replace(
        recording,
        truth=replace(recording.truth, name=words),
        measurements=replace(recording.measurements, name=words),
    )
    refused(
        ExchangeError,
        "glider-1 and glider_1 are both glider_1 in ROS, which allows neither - nor . in names",
        write_bag,
        same,
        tmp_path,
    )
    assert not names_in(tmp_path)


@pytest.mark.parametrize(("to", "module", "message"), [
    ("bag", "rosbags.rosbag2", (r'bag and mcap: rosbags is not installed; pip install'
                               r' "pymantaray\[ros\]"')),
    ("mcap", "rosbags.rosbag2", (r'bag and mcap: rosbags is not installed; pip install'
                                r' "pymantaray\[ros\]"')),
    ("rrd", "rerun", r'rrd: rerun-sdk is not installed; pip install "pymantaray\[rerun\]"'),
    ("parquet", "pyarrow", "parquet: pyarrow is not installed; pip install"),
])  # fmt: skip
def test_a_missing_library_is_named_and_nothing_is_left(
    run, tmp_path, monkeypatch, to, module, message
):
    monkeypatch.setitem(sys.modules, module, None)
    refused(ExchangeError, message, export_run, run, to, tmp_path / "out")
    assert not names_in(tmp_path)


def test_what_cannot_be_exported_is_refused_and_leaves_nothing(run, tmp_path, monkeypatch):
    refused(
        ExchangeError,
        f"unknown format 'ply'; allowed: {', '.join(FORMATS)}",
        export_run,
        run,
        "ply",
        tmp_path / "a",
    )
    refused(StudyError, "not a run folder", export_run, tmp_path, "tum", tmp_path / "a")
    refused(
        StudyError,
        "realization 2: the run has 0 to 1",
        export_run,
        run,
        "tum",
        tmp_path / "a",
        realization=2,
    )
    full, file = tmp_path / "full", tmp_path / "there.rrd"
    full.mkdir()
    (full / "mine").touch()
    file.touch()
    refused(JobError, "full", export_run, run, "tum", full)
    refused(WriteError, r"there\.rrd: already exists", export_run, run, "rrd", file)
    assert names_in(full) == ["mine"]
    study = replace(run.study, conditions=run.study.conditions[:2])
    monkeypatch.setitem(vars(run), "study", study)
    refused(
        ExchangeError,
        "no condition of the study has ranges; a graph needs one of straight",
        export_run,
        run,
        "g2o",
        tmp_path / "a",
    )
    assert names_in(tmp_path) == ["full", "there.rrd"]


def test_a_run_without_estimates_is_refused(run, tmp_path, tiny_run_folder):
    import shutil

    copy = tmp_path / "run"
    shutil.copytree(tiny_run_folder, copy)
    (copy / "estimates.nc").unlink()
    refused(
        StudyError,
        r"estimates\.nc: missing",
        export_run,
        copy,
        "tum",
        tmp_path / "a",
    )
    assert names_in(tmp_path) == ["run"]


@pytest.mark.parametrize("form", ["csv", "tum", "kitti", "vtk", "kml", "geojson", "mat"])
def test_a_full_disk_is_told_in_one_line_and_leaves_nothing(run, tmp_path, form):
    with files_of_at_most(100):
        refused(
            WriteError, "cannot be written: File too large", export_run, run, form, tmp_path / "out"
        )
    assert list(tmp_path.iterdir()) == []
