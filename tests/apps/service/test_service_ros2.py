"""
The ROS 2 package: its node publishes the ranges of the service, over ROS where rclpy is installed,
else over a stand-in for the transport.
"""

import importlib
import json
import math
import re
import runpy
import time
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

PACKAGE = ROOT / "ros2" / "mantaray_ros"
PROFILE = "depth,sound_speed\n0,1440\n100,1436\n400,1452\n1000,1465\n"
OCEAN = '[ocean]\nsource = "profile.csv"\nbathymetry = 1000.0\n'
FLOAT32 = 1e-7  # relative


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
                    self.kinds.Range, topic, lambda m, t=topic: self.ranges.append((t, m)), 100
                )

    def publish(self, kind, topic, content):
        self.probe.create_publisher(kind, topic, 100).publish(content)
        self.spin(0)

    def spin(self, _count):
        stand_in.spin()

    def call(self, name):
        return self.network.services[name]()

    def close(self):
        """Nothing runs behind."""

    @property
    def log(self):
        return self.network.log


class Ros:
    """The same over rclpy, in one process and on loopback."""

    def __init__(self, monkeypatch, parameters):
        rclpy = pytest.importorskip("rclpy")
        for name in [name for name in importlib.sys.modules if name.startswith("mantaray_ros")]:
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
        self.publisher(self.kinds.Header, "ping")
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

    def call(self, name):
        client = self.probe.create_client(self.kinds.Trigger, name)
        client.wait_for_service(timeout_sec=10.0)
        answer = client.call_async(self.kinds.Trigger.Request())
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


def move(ros, name, seconds, north, east, down):
    pose = ros.kinds.Odometry()
    pose.header.stamp = stamp(ros.kinds, seconds)
    place = pose.pose.pose.position
    place.x, place.y, place.z = float(east), float(north), float(-down)
    ros.publish(ros.kinds.Odometry, f"{name}/odom", pose)


def ping(ros, name, seconds):
    header = ros.kinds.Header()
    header.stamp, header.frame_id = stamp(ros.kinds, seconds), name
    ros.publish(ros.kinds.Header, "ping", header)


def test_the_node_answers_with_the_ranges_of_the_service(start, sea):
    """A moves 2 m/s north: at 12.5 s it is half way between its poses; C is below the sea bed."""
    ros = start(vehicles=["A", "B", "C"], ocean=[str(sea)])
    ping(ros, "A", 1012.5)
    move(ros, "A", 1010.0, 0.0, 0.0, 50.0)
    move(ros, "B", 1013.0, 1500.0, -400.0, 120.0)
    move(ros, "C", 1013.0, 900.0, 300.0, 5000.0)
    move(ros, "B", 1012.0, 1500.0, -400.0, 120.0)
    move(ros, "C", 1012.0, 900.0, 300.0, 5000.0)
    assert ros.ranges == []  # A may still move
    move(ros, "A", 1015.0, 10.0, 0.0, 50.0)
    ros.spin(4)
    with RangingService(sea) as service:
        expected = service.ping(0.0, (5.0, 0.0, 50.0), [(1500, -400, 120), (900, 300, 5000)])
    found = dict(ros.ranges)
    assert len(ros.ranges) == len(found) == 4
    for message in found.values():
        assert message.header.frame_id == "A"
        assert (message.radiation_type, message.min_range) == (0, 0.0)
        assert message.max_range == math.inf
    heard = found["B/range"]
    assert heard.range == pytest.approx(expected.refracted_range[0], rel=FLOAT32)
    arrival = heard.header.stamp.sec + 1e-9 * heard.header.stamp.nanosec
    assert arrival == pytest.approx(1012.5 + expected.arrival_time[0], abs=2e-9 + 1e-12 * arrival)
    truth = found["B/range_truth"]
    assert truth.range == pytest.approx(math.dist((5, 0, 50), (1500, -400, 120)), rel=FLOAT32)
    assert truth.header.stamp.nanosec == heard.header.stamp.nanosec
    lost = found["C/range"]
    assert lost.range == math.inf
    assert (lost.header.stamp.sec, lost.header.stamp.nanosec) == (1012, 500_000_000)
    assert found["C/range_truth"].range == pytest.approx(math.dist((5, 0, 50), (900, 300, 5000)))


def test_a_service_of_each_vehicle_pings_at_once(start, sea):
    ros = start(vehicles=["A", "B"], ocean=[str(sea)])
    early = ros.call("A/ping")
    assert not early.success
    assert early.message == "no pose yet of A, B"
    move(ros, "A", 5.0, 0.0, 0.0, 50.0)
    move(ros, "B", 4.0, 0.0, 0.0, 80.0)
    move(ros, "B", 6.0, 0.0, 800.0, 80.0)
    ros.spin(0)
    late = ros.call("A/ping")
    while not late.success:  # poses may still be on their way
        late = ros.call("A/ping")
    answer = json.loads(late.message)
    (row,) = answer["receivers"]
    assert (answer["time"], answer["source"], row["name"]) == (5.0, "A", "B")
    medium = open_water(sea).medium
    assert isinstance(medium, Medium)
    assert row["straight_range"] == pytest.approx(math.hypot(400.0, 30.0))
    speed = medium.sound_speed_at([0.0, 0.0, 50.0])[0]
    flight = row["arrival_time"] - 5.0
    assert row["refracted_range"] == pytest.approx(speed * flight, rel=1e-6)
    assert row["status"] == "ok"


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
    heard = [(t, m.header.frame_id) for t, m in ros.ranges if t.endswith("/range")]
    assert heard == [("B/range", "A"), ("A/range", "B"), ("B/range", "A")]


def test_impossible_parameters_are_refused_in_one_line(stand, sea):
    refused(MantaRayError, "vehicles is", stand, vehicles=["A", "A"], ocean=[str(sea)])
    refused(MantaRayError, "letters, digits", stand, vehicles=["glider-1"], ocean=[str(sea)])
    refused(MantaRayError, "no such file", stand, vehicles=["A"], ocean=["nowhere.nc"])
    for wrong in ({"vehicles": []}, {"time_origin": math.nan}, {"slot": math.inf}):
        parameters = {"vehicles": ["A"], "ocean": [str(sea)]} | wrong
        refused(MantaRayError, "at least one vehicle and finite times", stand, **parameters)


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
    arguments = runpy_arguments(monkeypatch)
    assert arguments >= set(re.findall(r'declare_parameter\("(\w+)"', source))


def runpy_arguments(monkeypatch):
    """Arguments of the launch file, whose modules are not imported."""
    text = (PACKAGE / "launch" / "ranging.launch.py").read_text()
    return set(re.findall(r'^    "(\w+)": \(', text, re.MULTILINE))


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
