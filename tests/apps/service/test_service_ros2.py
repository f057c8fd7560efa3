"""
The ROS 2 package: its node publishes the ranges of the service, over ROS where rclpy is installed,
else over a stand-in for the transport.
"""

import importlib
import math
import re
import runpy
import time
from types import ModuleType
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import ros2_stand_in as stand_in
from pages import ROOT
from refusals import refused

import pymantaray
from pymantaray import MantaRayError
from pymantaray.acoustics import Medium
from pymantaray.apps.service import RangingService
from pymantaray.config.door.water import open_water
from pymantaray.records import RayStatus

PACKAGE = ROOT / "ros2" / "mantaray_ros"
MESSAGES = ROOT / "ros2" / "mantaray_ros_msgs"
PROFILE = "depth,sound_speed\n0,1440\n100,1436\n400,1452\n1000,1465\n"
OCEAN = '[ocean]\nsource = "profile.csv"\nbathymetry = 1000.0\n'


@pytest.fixture
def sea(tmp_path):
    (tmp_path / "profile.csv").write_text(PROFILE)
    (tmp_path / "sea.toml").write_text(OCEAN)
    return tmp_path / "sea.toml"


class StandIn:
    """The node, and a probe that publishes poses and pings and collects ranges."""

    def __init__(self, monkeypatch, parameters):
        self.network = stand_in.install(monkeypatch)
        self.network.parameters = parameters
        self.kinds = stand_in
        module = importlib.import_module("mantaray_ros.ranging_node")
        self.node = module.RangingNode()
        self.ranges = []
        self.probe = stand_in.Node("probe")
        self.listen(parameters["vehicles"])

    def listen(self, vehicles):
        for name in vehicles:
            for topic in (f"{name}/range", f"{name}/range_truth"):
                self.probe.create_subscription(
                    self.kinds.AcousticRange,
                    topic,
                    lambda m, t=topic: self.ranges.append((t, m)),
                    self.kinds.QoSProfile(depth=100),
                )

    def publish(self, kind, topic, content):
        quality = self.kinds.QoSProfile(depth=100)
        self.probe.create_publisher(kind, topic, quality).publish(content)
        self.spin(0)

    def spin(self, _count):
        stand_in.spin()

    def call(self, transmitter):
        request = stand_in.GetRanges.Request(transmitter=transmitter)
        return self.network.services["get_ranges"](request)

    def close(self):
        """Nothing runs behind."""

    @property
    def log(self):
        return self.network.log


class Ros:
    """The same over rclpy, in one process and on loopback."""

    def __init__(self, monkeypatch, parameters):
        rclpy = pytest.importorskip("rclpy")
        pytest.importorskip("mantaray_ros_msgs", reason="build ros2/mantaray_ros_msgs with colcon")
        for name in [
            name for name in importlib.sys.modules if name.partition(".")[0] == "mantaray_ros"
        ]:
            monkeypatch.delitem(importlib.sys.modules, name)
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        self.kinds = importlib.import_module("mantaray_ros.ranging_node")
        rclpy.init()
        overrides = [rclpy.parameter.Parameter(name, value=v) for name, v in parameters.items()]
        self.node = self.kinds.RangingNode(parameter_overrides=overrides)
        self.probe = rclpy.create_node("probe")
        self.executor = rclpy.executors.SingleThreadedExecutor()
        for node in (self.node, self.probe):
            self.executor.add_node(node)
        self.ranges, self.publishers, self.log = [], {}, []
        logger = self.node.get_logger()
        for level in ("warning", "error"):
            monkeypatch.setattr(type(logger), level, lambda _, text: self.log.append(text))
        self.vehicles = parameters["vehicles"]
        StandIn.listen(self, self.vehicles)
        for name in self.vehicles:
            self.publisher(self.kinds.Odometry, f"{name}/odom")
        self.publisher(self.kinds.Ping, "ping")
        self.until(lambda: all(p.get_subscription_count() for p in self.publishers.values()))
        topics = [f"{name}/{kind}" for name in self.vehicles for kind in ("range", "range_truth")]
        self.until(lambda: all(self.node.count_subscribers(topic) for topic in topics))

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.probe.destroy_node()
        importlib.import_module("rclpy").shutdown()

    def publisher(self, kind, topic):
        if topic not in self.publishers:
            self.publishers[topic] = self.probe.create_publisher(kind, topic, 100)
        return self.publishers[topic]

    def publish(self, kind, topic, content):
        self.publisher(kind, topic).publish(content)
        self.executor.spin_once(timeout_sec=0.05)

    def until(self, done):
        end = time.monotonic() + 20.0
        while not done() and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.05)

    def spin(self, count):
        self.until(lambda: len(self.ranges) >= count)

    def call(self, transmitter):
        client = self.probe.create_client(self.kinds.GetRanges, "get_ranges")
        client.wait_for_service(timeout_sec=10.0)
        answer = client.call_async(self.kinds.GetRanges.Request(transmitter=transmitter))
        self.until(answer.done)
        return answer.result()


OWN_WARNINGS = pytest.mark.filterwarnings("ignore::DeprecationWarning")


@pytest.fixture(params=[StandIn, pytest.param(Ros, marks=[pytest.mark.network, OWN_WARNINGS])])
def start(request, monkeypatch):
    monkeypatch.syspath_prepend(str(PACKAGE))
    started = []

    def begin(**parameters):
        started.append(request.param(monkeypatch, parameters))
        return started[-1]

    yield begin
    for one in started:
        one.close()


def stamp(kinds, seconds):
    return kinds.Time(nanoseconds=round(seconds * 1e9)).to_msg()


def move(ros, name, seconds, north, east, down, frames=("map", "")):
    pose = ros.kinds.Odometry()
    pose.header.stamp = stamp(ros.kinds, seconds)
    pose.header.frame_id, pose.child_frame_id = frames
    place = pose.pose.pose.position
    place.x, place.y, place.z = float(east), float(north), float(-down)
    ros.publish(ros.kinds.Odometry, f"{name}/odom", pose)


def ping(ros, name, seconds):
    content = ros.kinds.Ping(stamp=stamp(ros.kinds, seconds), transmitter=name)
    ros.publish(ros.kinds.Ping, "ping", content)


def test_the_node_answers_with_the_ranges_of_the_service(start, sea):
    """A moves 2 m/s north: at 12.5 s it is half way between its poses; C is below the sea bed."""
    ros = start(vehicles=["A", "B", "C"], ocean=[str(sea)])
    ping(ros, "A", 1012.5)
    move(ros, "A", 1010.0, 0.0, 0.0, 50.0)
    move(ros, "B", 1013.0, 1500.0, -400.0, 120.0, frames=("map", "B/transducer"))
    move(ros, "C", 1013.0, 900.0, 300.0, 5000.0)
    move(ros, "B", 1012.0, 1500.0, -400.0, 120.0, frames=("map", "B/transducer"))
    move(ros, "C", 1012.0, 900.0, 300.0, 5000.0)
    assert ros.ranges == []  # A may still move
    move(ros, "A", 1015.0, 10.0, 0.0, 50.0)
    ros.spin(4)
    with RangingService(sea) as service:
        expected = service.ping(0.0, (5.0, 0.0, 50.0), [(1500, -400, 120), (900, 300, 5000)])
    found = dict(ros.ranges)
    assert len(ros.ranges) == len(found) == 4
    for topic, message in found.items():
        receiver = topic[0]
        assert (message.transmitter, message.receiver) == ("A", receiver)
        assert message.header.frame_id == {"B": "B/transducer", "C": "C/base_link"}[receiver]
    heard = found["B/range"]
    assert heard.status == heard.OK
    assert heard.range == expected.refracted_range[0]
    assert heard.travel_time == pytest.approx(expected.arrival_time[0], abs=1e-12)
    arrival = heard.header.stamp.sec + 1e-9 * heard.header.stamp.nanosec
    assert arrival == pytest.approx(1012.5 + expected.arrival_time[0], abs=2e-9 + 1e-12 * arrival)
    truth = found["B/range_truth"]
    assert truth.range == pytest.approx(math.dist((5, 0, 50), (1500, -400, 120)), rel=1e-12)
    assert truth.header.stamp.nanosec == heard.header.stamp.nanosec
    lost = found["C/range"]
    assert (lost.range, lost.status) == (math.inf, lost.OUTSIDE)
    assert math.isnan(lost.travel_time)
    assert (lost.header.stamp.sec, lost.header.stamp.nanosec) == (1012, 500_000_000)
    assert found["C/range_truth"].range == pytest.approx(math.dist((5, 0, 50), (900, 300, 5000)))


def test_a_service_pings_at_once_from_any_vehicle(start, sea):
    ros = start(vehicles=["A", "B"], ocean=[str(sea)])
    early = ros.call("A")
    assert not early.success
    assert early.message == "no pose yet of A, B"
    assert ros.call("Z").message == "ping of unknown vehicle 'Z'; known: A, B"
    move(ros, "A", 5.0, 0.0, 0.0, 50.0)
    move(ros, "B", 4.0, 0.0, 0.0, 80.0)
    move(ros, "B", 6.0, 0.0, 800.0, 80.0)
    ros.spin(0)
    late = ros.call("A")
    while not late.success:  # poses may still be on their way
        late = ros.call("A")
    ((heard,), (straight,)) = late.ranges, late.straight
    assert (late.stamp.sec, heard.transmitter, heard.receiver) == (5, "A", "B")
    medium = open_water(sea).medium
    assert isinstance(medium, Medium)
    assert straight.range == pytest.approx(math.hypot(400.0, 30.0))
    speed = medium.sound_speed_at([0.0, 0.0, 50.0])[0]
    assert heard.range == pytest.approx(speed * heard.travel_time, rel=1e-9)
    assert heard.status == heard.OK


def test_what_cannot_be_answered_is_logged_in_one_line(start, sea):
    ros = start(vehicles=["A", "B"], ocean=[str(sea)])
    ping(ros, "Z", 1.0)
    for name in ("A", "B"):
        for seconds in (10.0, 20.0):
            move(ros, name, seconds, 0.0, 900.0, 60.0)
    ping(ros, "A", 5.0)
    ros.spin(1) if isinstance(ros, StandIn) else ros.until(lambda: len(ros.log) == 2)
    assert ros.ranges == []
    assert ros.log == [
        "ping of unknown vehicle 'Z'; known: A, B",
        "ping of A: B has poses for 10 to 20 s, not for 5 s",
    ] or ros.log == [
        "ping of unknown vehicle 'Z'; known: A, B",
        "ping of A: A has poses for 10 to 20 s, not for 5 s",
    ]


def test_the_node_warns_once_of_poses_in_several_frames(start, sea):
    ros = start(vehicles=["A", "B"], ocean=[str(sea)])
    for seconds in (1.0, 2.0):
        move(ros, "A", seconds, 0.0, 0.0, 50.0, frames=("A/odom", "A/base_link"))
    for seconds in (1.0, 2.0):
        move(ros, "B", seconds, 0.0, 900.0, 50.0, frames=("B/odom", "B/base_link"))
    ros.spin(0) if isinstance(ros, StandIn) else ros.until(lambda: len(ros.log) == 1)
    (line,) = ros.log
    assert "'B/odom'" in line
    assert "'A/odom'" in line


def test_poses_may_be_lost_but_ranges_may_not(start, sea):
    """REP 2003: publishers of sensor data are reliable, their readers take what comes."""
    ros = start(vehicles=["A", "B"], ocean=[str(sea)])
    best_effort = ros.kinds.QoSProfile(depth=5, reliability=ros.kinds.ReliabilityPolicy.BEST_EFFORT)
    if isinstance(ros, StandIn):
        qualities = {t: [q for *_, q in e] for t, e in ros.network.subscribers.items()}
        assert qualities["A/odom"][0].reliability == best_effort.reliability
        publisher = ros.probe.create_publisher(ros.kinds.Odometry, "A/odom", best_effort)
        publisher.publish(ros.kinds.Odometry())
        assert ros.network.queues[ros.node]
        return
    reliable = ros.kinds.ReliabilityPolicy.RELIABLE
    (odometry,) = ros.node.get_subscriptions_info_by_topic("/A/odom")
    assert odometry.qos_profile.reliability == best_effort.reliability
    (ranges,) = ros.node.get_publishers_info_by_topic("/A/range")
    assert ranges.qos_profile.reliability == reliable
    name = "qos_overrides./A/odom.subscription.reliability"
    assert ros.node.get_parameter(name).value == "best_effort"


@pytest.fixture
def stand(monkeypatch):
    monkeypatch.syspath_prepend(str(PACKAGE))
    return lambda **parameters: StandIn(monkeypatch, parameters)


def test_vehicles_ping_in_turn_in_slots(stand, sea):
    ros = stand(vehicles=["A", "B"], ocean=[str(sea)], slot=5.0)
    ((interval, callback),) = ros.network.timers
    assert interval == 5.0
    for seconds in (0.0, 100.0):
        move(ros, "A", seconds, 0.0, 0.0, 50.0)
        move(ros, "B", seconds, 700.0, 0.0, 90.0)
    for now in (10, 15, 20):
        ros.network.now = now * 10**9
        callback()
        stand_in.spin()
    heard = [(t, m.transmitter) for t, m in ros.ranges if t.endswith("/range")]
    assert heard == [("B/range", "A"), ("A/range", "B"), ("B/range", "A")]


def test_impossible_parameters_are_refused_in_one_line(stand, sea):
    refused(MantaRayError, "vehicles is", stand, vehicles=["A", "A"], ocean=[str(sea)])
    refused(MantaRayError, "letters, digits", stand, vehicles=["glider-1"], ocean=[str(sea)])
    refused(MantaRayError, "no such file", stand, vehicles=["A"], ocean=["nowhere.nc"])
    for wrong in ({"vehicles": []}, {"time_origin": math.nan}):
        parameters = {"vehicles": ["A"], "ocean": [str(sea)]} | wrong
        refused(MantaRayError, "at least one vehicle and a finite time", stand, **parameters)
    for slot in (-1.0, math.inf, math.nan):
        parameters = {"vehicles": ["A"], "ocean": [str(sea)], "slot": slot}
        refused(stand_in.ParameterException, "slot", stand, **parameters)


def test_every_parameter_is_described_and_read_only(stand, sea):
    ros = stand(vehicles=["A"], ocean=[str(sea)])
    assert set(ros.network.descriptors) == {"vehicles", "ocean", "slot", "time_origin"}
    for descriptor in ros.network.descriptors.values():
        assert descriptor.read_only
        assert descriptor.description.endswith((".", "]"))


@pytest.mark.parametrize(("seconds", "north", "message"), [
    (-5.0, 0.0, "must not be negative"),
    (15.0, math.nan, "pose of A at 15 s is not finite"),
    (15.0, math.inf, "pose of A at 15 s is not finite"),
])  # fmt: skip
def test_a_wrong_pose_is_logged_and_changes_no_range(stand, sea, seconds, north, message):
    """A pose of NaN between two others would be in every range between them."""
    ros = stand(vehicles=["A", "B"], ocean=[str(sea)])
    for when in (10.0, 20.0):
        move(ros, "A", when, 0.0, 0.0, 50.0)
        move(ros, "B", when, 700.0, 0.0, 50.0)
    move(ros, "A", seconds, north, 0.0, 50.0)
    ping(ros, "B", -1.0)
    ping(ros, "A", 14.0)
    assert message in ros.log[0]
    assert ros.log[1] == "ping of B: Seconds value must not be negative"
    found = dict(ros.ranges)
    assert found["B/range_truth"].range == pytest.approx(700.0)


def test_old_pings_are_dropped_when_too_many_wait(stand, sea):
    ros = stand(vehicles=["A", "B"], ocean=[str(sea)])
    limit = importlib.import_module("mantaray_ros.ranging_node").MAX_WAITING
    for k in range(limit + 1):
        ping(ros, "A", 1.0 + k)
    assert len(ros.log) == 1
    assert "wait for poses (A, B)" in ros.log[0]


def test_the_package_is_one_of_ros_with_the_version_of_ours(monkeypatch):
    root = ET.parse(PACKAGE / "package.xml").getroot()
    assert root.get("format") == "3"
    assert root.findtext("version") == pymantaray.__version__
    assert root.findtext("license") == "MIT"
    assert root.findtext("export/build_type") == "ament_python"
    source = (PACKAGE / "mantaray_ros" / "ranging_node.py").read_text()
    imported = set(re.findall(r"^from (\w+)\.(?:msg|srv) import", source, re.MULTILINE))
    needed = {element.text for element in root.findall("exec_depend")}
    assert needed == imported | {"rclpy", "launch", "launch_ros"}
    given = {}
    monkeypatch.setattr("setuptools.setup", lambda **options: given.update(options))
    monkeypatch.chdir(PACKAGE)
    runpy.run_path("setup.py")
    assert (given["name"], given["version"]) == (root.findtext("name"), pymantaray.__version__)
    for _, files in given["data_files"]:
        assert all((PACKAGE / name).is_file() for name in files)
    module, _, function = (
        given["entry_points"]["console_scripts"][0].partition(" = ")[2].partition(":")
    )
    assert f"def {function}(" in source
    assert module == "mantaray_ros.ranging_node"


def test_the_launch_file_has_the_parameters_of_the_node(monkeypatch):
    """Texts of defaults are YAML, which is what ROS reads."""
    yaml = pytest.importorskip("yaml")
    monkeypatch.syspath_prepend(str(PACKAGE))
    actions = {"DeclareLaunchArgument": lambda name, **more: (name, more), "Node": dict}
    for name, content in {
        "launch": {"LaunchDescription": list},
        "launch.actions": actions,
        "launch.substitutions": {"LaunchConfiguration": str},
        "launch_ros": {},
        "launch_ros.actions": actions,
    }.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(importlib.sys.modules, name, module)
    script = runpy.run_path(str(PACKAGE / "launch" / "ranging.launch.py"))
    *declared, node = script["generate_launch_description"]()
    (given,) = node["parameters"]
    assert set(given) == {name for name, _ in declared}
    values = {name: yaml.safe_load(more["default_value"]) for name, more in declared}
    parameters = importlib.import_module("mantaray_ros.parameters").PARAMETERS
    assert values == {name: default for name, (default, _) in parameters.items()} | {
        "use_sim_time": True
    }
    assert node["executable"] == "ranging"


def test_the_messages_are_a_package_that_builds_all_of_them():
    root = ET.parse(MESSAGES / "package.xml").getroot()
    assert root.findtext("version") == pymantaray.__version__
    assert root.findtext("member_of_group") == "rosidl_interface_packages"
    listed = set(re.findall(r'"((?:msg|srv)/\w+\.\w+)"', (MESSAGES / "CMakeLists.txt").read_text()))
    assert listed == {f"{p.parent.name}/{p.name}" for p in MESSAGES.glob("[ms]*/*.[ms]*")}


def test_constants_of_the_status_are_those_of_the_library():
    shown = {s.name: getattr(stand_in.AcousticRange, s.name) for s in RayStatus}
    assert shown == {s.name: s.value for s in RayStatus}


def test_positions_between_poses_are_on_the_line(monkeypatch):
    monkeypatch.syspath_prepend(str(PACKAGE))
    from mantaray_ros.tracks import KEPT, Tracks

    tracks = Tracks(["A"])
    assert tracks.latest() is None
    for k in reversed(range(KEPT + 50)):
        tracks.add("A", k * 10, (k, 2.0 * k, -k))
    np.testing.assert_allclose(tracks.at(604)["A"], (60.4, 120.8, -60.4))
    assert tracks.latest() == 10 * (KEPT + 49)
    for outside in (0, 10 * (KEPT + 50)):
        with pytest.raises(ValueError, match="A has poses for"):
            tracks.at(outside)
