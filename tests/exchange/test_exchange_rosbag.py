"""
Bags that rosbags writes, of ROS 1 and 2: names of vehicles, axes, clocks, and what is refused.
"""

import numpy as np
import pyproj
import pytest
from refusals import refused
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from pymantaray import LocalFrame, read_trajectories
from pymantaray.errors import ExchangeError

TIME = np.array([0.0, 0.5, 1.25])
UNIX = 1_700_000_000


def stamped(store, ros, time, frame):
    stamp = store.types["builtin_interfaces/msg/Time"](sec=int(time), nanosec=round(time % 1 * 1e9))
    more = {"seq": 0} if ros == 1 else {}
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **more)


def pose_of(store, p, q):
    point = store.types["geometry_msgs/msg/Point"](*map(float, p))
    w, x, y, z = map(float, q)
    return store.types["geometry_msgs/msg/Pose"](
        point, store.types["geometry_msgs/msg/Quaternion"](x, y, z, w)
    )


def write(path, topics, *, ros=2, start=UNIX, frame="map", child="base_link", more=None):
    """
    A bag with three poses on each topic, an odometry or a pose by its name: x = t, y = 2 t, z = -3
    - t.
    """
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    attitude = Rotation.from_euler("ZYX", [0.3, 0.0, 0.0]).as_quat(scalar_first=True)
    with Writer1(path) if ros == 1 else Writer2(path, version=9) as bag:
        for topic in topics:
            kind = (
                "nav_msgs/msg/Odometry"
                if topic.endswith("odom")
                else "geometry_msgs/msg/PoseStamped"
            )
            connection = bag.add_connection(topic, kind, typestore=store)
            for t in TIME:
                header = stamped(store, ros, start + t, frame)
                pose = pose_of(store, [t, 2 * t, -3 - t], attitude)
                message = store.types["geometry_msgs/msg/PoseStamped"](header, pose)
                if topic.endswith("odom"):
                    zero = store.types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
                    twist = store.types["geometry_msgs/msg/Twist"](zero, zero)
                    message = store.types["nav_msgs/msg/Odometry"](
                        header,
                        child,
                        store.types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
                        store.types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
                    )
                raw = (store.serialize_ros1 if ros == 1 else store.serialize_cdr)(message, kind)
                bag.write(
                    connection, int((start + t) * 1e9) + 5_000_000, raw
                )  # received 5 ms later
        if more is not None:
            more(store, bag)
    return path


@pytest.mark.parametrize(("name", "ros"), [("two", 2), ("one.bag", 1)])
def test_topics_are_vehicles_and_enu_becomes_ned(name, ros, tmp_path, as_stored):
    tracks = read_trajectories(write(tmp_path / name, ["/auv1/odom", "/auv2/pose"], ros=ros))
    assert sorted(tracks.names) == ["auv1", "auv2"]
    assert tracks.start == np.datetime64(
        UNIX * 1_000_000_000, "ns"
    )  # of the headers, not of the recorder
    truth = tracks.at(TIME, LocalFrame(0, 0))
    for k in range(2):
        np.testing.assert_allclose(truth.position[k], np.column_stack([2 * TIME, TIME, 3 + TIME]))
        body = Rotation.from_quat(truth.quaternion[k], scalar_first=True)
        heading = (
            np.pi / 2 - 0.3
        )  # from east to the left by 0.3 is from north to the right by the rest
        np.testing.assert_allclose(
            body.apply([1.0, 0, 0]), np.tile([np.cos(heading), np.sin(heading), 0], (3, 1))
        )
        np.testing.assert_allclose(
            body.apply([0, 0, 1.0]), np.tile([0.0, 0, 1], (3, 1)), atol=1e-15
        )
    as_stored(tracks)


def test_a_frame_named_ned_is_ned_and_simulated_time_has_no_date(tmp_path, as_stored):
    bag = write(
        tmp_path / "ned",
        ["/robot/odom", "/robot/pose"],
        start=20,
        frame="world_ned",
        child="base_link_frd",
    )
    tracks = read_trajectories(bag)
    assert sorted(tracks.names) == ["odom", "pose"]
    assert tracks.start is None
    bag = write(tmp_path / "ned3", ["/a/odom"], frame="map_ned", child="base_link_frd")
    (own,) = read_trajectories(bag).poses
    np.testing.assert_allclose(own.time, TIME)
    assert own.quaternion[0] == pytest.approx(
        Rotation.from_euler("Z", [[0.3]]).as_quat(scalar_first=True)[0]
    )
    as_stored(tracks)


def test_an_frd_body_in_an_enu_world_is_rotated_by_the_world_alone(tmp_path, as_stored):
    (own,) = read_trajectories(write(tmp_path / "frd", ["/a/odom"], child="base_link_frd")).poses
    turned = Rotation.from_quat(own.quaternion[0], scalar_first=True)
    in_enu = Rotation.from_euler("ZYX", [0.3, 0.0, 0.0])  # as the file has it
    for axis in np.eye(3):
        east, north, up = in_enu.apply(axis)
        np.testing.assert_allclose(turned.apply(axis), [north, east, -up], atol=1e-15)
    as_stored(own)


def test_true_poses_of_an_exported_run_are_vehicles_not_estimates(tmp_path, as_stored):
    tracks = read_trajectories(write(tmp_path / "run", ["/truth/A/pose", "/refracted/A/pose"]))
    assert tracks.names == ["A"]
    assert tracks.notes == (f"{tmp_path / 'run'}: topics of poses other than /truth ignored: 1",)
    as_stored(tracks)


def test_topics_are_called_by_what_tells_them_apart(tmp_path):
    bag = write(tmp_path / "fleet", ["/fleet/A/odom", "/fleet/A/pose", "/fleet/B/pose"])
    assert sorted(read_trajectories(bag).names) == ["A_odom", "A_pose", "B_pose"]
    assert sorted(
        read_trajectories(write(tmp_path / "two", ["/fleet/A/pose", "/fleet/B/pose"])).names
    ) == [
        "A",
        "B",
    ]


def write_robot(path, *, ros, offset=(3.0, 2.0, 0.0), frames=("odom", "map")):
    """
    One robot with its odometry and a localization with a covariance, shifted by an offset, every 10
    s.
    """
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    kinds = {"/odometry/filtered": "nav_msgs/msg/Odometry"}
    kinds["/localization_pose"] = "geometry_msgs/msg/PoseWithCovarianceStamped"
    zero = store.types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    twist = store.types["geometry_msgs/msg/Twist"](zero, zero)
    with Writer1(path) if ros == 1 else Writer2(path, version=9) as bag:
        topics = [bag.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()]
        for t in range(0, 600, 10):
            for connection, kind, frame, shift in zip(
                topics, kinds.values(), frames, (np.zeros(3), np.array(offset)), strict=True
            ):
                header = stamped(store, ros, UNIX + t, frame)
                pose = store.types["geometry_msgs/msg/PoseWithCovariance"](
                    pose_of(store, np.array([t, 0.0, -20.0]) + shift, (1.0, 0.0, 0.0, 0.0)),
                    np.zeros(36),
                )
                parts = [header, pose]
                if kind.endswith("Odometry"):
                    speed = store.types["geometry_msgs/msg/TwistWithCovariance"](
                        twist, np.zeros(36)
                    )
                    parts = [header, "base_link", pose, speed]
                message = store.types[kind](*parts)
                raw = (store.serialize_ros1 if ros == 1 else store.serialize_cdr)(message, kind)
                bag.write(connection, (UNIX + t) * 1_000_000_000, raw)
    return path


@pytest.mark.parametrize(("name", "ros"), [("bag", 2), ("one.bag", 1)])
def test_two_topics_of_one_robot_are_named_and_one_can_be_selected(name, ros, tmp_path, as_stored):
    bag = write_robot(tmp_path / name, ros=ros)
    tracks = read_trajectories(bag)
    assert tracks.notes[:2] == (
        f"{bag}: vehicle odometry from topic /odometry/filtered in frame 'odom'",
        f"{bag}: vehicle localization_pose from topic /localization_pose in frame 'map'",
    )
    assert "frames map, odom are taken as one" in tracks.notes[2]
    distance = np.hypot(3.0, 2.0)
    assert f"odometry and localization_pose are always within {distance:.2g} m" in tracks.notes[3]
    one = read_trajectories(bag, names=["localization_pose"])
    assert one.names == ["localization_pose"]
    np.testing.assert_allclose(one.poses[0].place[0], [2.0, 3.0, 20.0])  # north, east, down
    assert not [note for note in one.notes if "always within" in note]
    as_stored(one)


@pytest.mark.parametrize(("name", "ros"), [("bag", 2), ("one.bag", 1)])
def test_vehicles_that_are_apart_in_one_frame_are_no_robot(name, ros, tmp_path):
    bag = write_robot(tmp_path / name, ros=ros, offset=(0.0, 30.0, 0.0), frames=("map", "map"))
    notes = read_trajectories(bag).notes
    assert len(notes) == 2
    bag = write_robot(tmp_path / f"far{name}", ros=ros, offset=(0.0, 30.0, 0.0))
    assert "only if they have one origin" in read_trajectories(bag).notes[-1]


def test_bags_without_poses_are_refused_in_one_line(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer2(tmp_path / "text", version=9) as bag:
        connection = bag.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        message = store.types["std_msgs/msg/String"]("hello")
        bag.write(connection, 1, store.serialize_cdr(message, "std_msgs/msg/String"))
    refused(ExchangeError, "no topic of .*Odometry.*; it contains std_msgs/msg/String",
            lambda: read_trajectories(tmp_path / "text"))  # fmt: skip
    (tmp_path / "bad.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    refused(
        ExchangeError,
        "bad.bag: not a readable bag",
        lambda: read_trajectories(tmp_path / "bad.bag"),
    )
    (tmp_path / "bad.mcap").write_bytes(b"nothing of the kind")
    refused(
        ExchangeError,
        "bad.mcap: not a readable bag",
        lambda: read_trajectories(tmp_path / "bad.mcap"),
    )
    (tmp_path / "empty").mkdir()
    refused(
        ExchangeError,
        "empty: this folder is not a bag; name files",
        lambda: read_trajectories(tmp_path / "empty"),
    )


CENTRE = 74.5, -140.0
MIDWAY = np.array([0.25, 0.75, 1.25])
"""Times of satellite fixes; poses are at others."""


def with_fixes(path, topics, fix, *, frame="gps", drift=0.0, origin=None, solved=True):
    """
    The bag of `write` about `CENTRE` with satellite fixes, ``drift`` metres too far north per
    second.
    """
    earth = pyproj.Proj(f"+proj=sterea +lat_0={CENTRE[0]} +lon_0={CENTRE[1]} +ellps=WGS84")
    kind = "sensor_msgs/msg/NavSatFix"

    def fixes(store, bag):
        connection = bag.add_connection(fix, kind, typestore=store)
        for t in MIDWAY:
            lon, lat = earth(t, 2 * t + drift * t, inverse=True) if origin is None else origin[::-1]
            status = store.types["sensor_msgs/msg/NavSatStatus"](
                status=0 if solved else -1, service=1
            )
            header = stamped(store, 2, UNIX + t, frame)
            message = store.types[kind](header, status, lat, lon, 3.0 + t, np.zeros(9), 0)
            bag.write(connection, int((UNIX + t) * 1e9), store.serialize_cdr(message, kind))

    return write(path, topics, more=fixes)


def test_fixes_of_a_vehicle_give_the_centre_of_its_frame(tmp_path, as_stored):
    tracks = read_trajectories(
        with_fixes(tmp_path / "b", ["/auv1/odom", "/auv2/odom"], "/auv2/gps/fix")
    )
    assert tracks.centre == pytest.approx(CENTRE, abs=1e-8)
    assert {p.centre for p in tracks.poses} == {tracks.centre}  # one frame, one centre
    assert any("centre of frame 'map': 74.500000, -140.000000" in note for note in tracks.notes)
    as_stored(tracks)


def test_fixes_of_the_frames_origin_are_its_centre_to_the_last_digit(tmp_path):
    bag = with_fixes(tmp_path / "b", ["/auv1/odom"], "/map/fix", frame="map", origin=(34.65, -74.7))
    assert read_trajectories(bag).centre == (34.65, -74.7)


def test_fixes_that_do_not_agree_give_their_median_and_say_so(tmp_path, as_stored):
    bag = with_fixes(tmp_path / "b", ["/auv1/odom"], "/gps/fix", frame="map", drift=1000.0)
    tracks = read_trajectories(bag)
    north, east = LocalFrame(*CENTRE).to_local(*tracks.centre)
    assert (float(north), float(east)) == pytest.approx(
        (750.0, 0.0), abs=0.1
    )  # of 250, 750, 1250 m
    assert any("3 satellite fixes that agree within 500 m" in note for note in tracks.notes)
    as_stored(tracks)


def test_receivers_without_a_fix_give_no_centre(tmp_path):
    assert (
        read_trajectories(
            with_fixes(tmp_path / "b", ["/auv1/odom"], "/gps/fix", solved=False)
        ).centre
        is None
    )
