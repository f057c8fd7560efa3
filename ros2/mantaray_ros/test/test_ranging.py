"""
The installed node in a process of its own, over ROS on loopback; `colcon test` runs this.

It is started as `ros2 run` does, and by `ros2 launch` where that is installed.
"""

import math
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
import rclpy
from ament_index_python import get_package_prefix
from mantaray_ros_msgs.msg import AcousticRange, Ping
from mantaray_ros_msgs.srv import GetRanges
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data

PROFILE = "depth,sound_speed\n0,1440\n100,1436\n400,1452\n1000,1465\n"
OCEAN = '[ocean]\nsource = "profile.csv"\nbathymetry = 1000.0\n'
COMPILED = 600.0  # s; the first start compiles kernels
EXECUTABLE = Path(get_package_prefix("mantaray_ros")) / "lib" / "mantaray_ros" / "ranging"
LAUNCH = ["ros2", "launch", "mantaray_ros", "ranging.launch.py", "use_sim_time:=false"]


def by_executable(parameters):
    """Command of the executable with parameters."""
    pairs = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    return [str(EXECUTABLE), "--ros-args", *pairs]


def by_launch_file(parameters):
    """Command of the launch file with arguments."""
    if shutil.which("ros2") is None:
        pytest.skip("ros2 launch is not installed")
    return [*LAUNCH, *(f"{name}:={value}" for name, value in parameters.items())]


@pytest.fixture(autouse=True)
def loopback(monkeypatch):
    """Let only this test's processes hear each other."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(os.getpid() % 100))


@pytest.fixture(params=[by_executable, by_launch_file])
def started(request, tmp_path):
    """Process of the node."""
    (tmp_path / "profile.csv").write_text(PROFILE)
    (tmp_path / "sea.toml").write_text(OCEAN)
    command = request.param({"vehicles": "[A, B]", "ocean": f"['{tmp_path / 'sea.toml'}']"})
    process = subprocess.Popen(command)
    yield process
    if process.poll() is None:
        process.kill()
        process.wait()


@pytest.fixture
def probe():
    """Node of the test."""
    rclpy.init()
    node = rclpy.create_node("probe")
    yield node
    node.destroy_node()
    rclpy.shutdown()


def until(node, done, seconds=20.0):
    """Spin a node until a condition holds."""
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end, "nothing came"
        rclpy.spin_once(node, timeout_sec=0.1)


def pose(seconds, north, depth):
    """Pose of a vehicle."""
    message = Odometry()
    message.header.stamp.sec, message.header.frame_id = seconds, "map"
    message.pose.pose.position.y, message.pose.pose.position.z = north, -depth
    return message


def test_ranges_by_topic_and_by_service(started, probe):
    """A ping at 15 s, and one at the latest time of all poses."""
    client = probe.create_client(GetRanges, "get_ranges")
    until(probe, client.service_is_ready, COMPILED)
    got = []
    probe.create_subscription(AcousticRange, "B/range", got.append, qos_profile_sensor_data)
    poses = {name: probe.create_publisher(Odometry, f"{name}/odom", 10) for name in "AB"}
    pings = probe.create_publisher(Ping, "ping", 10)
    publishers = (*poses.values(), pings)
    until(probe, lambda: all(each.get_subscription_count() for each in publishers))
    until(probe, lambda: probe.count_publishers("B/range"))
    for seconds in (10, 20):
        poses["A"].publish(pose(seconds, 0.0, 50.0))
        poses["B"].publish(pose(seconds, 900.0, 80.0))
    ping = Ping(transmitter="A")
    ping.stamp.sec = 15
    pings.publish(ping)
    until(probe, lambda: got)
    straight = math.hypot(900.0, 30.0)
    assert (got[0].transmitter, got[0].header.frame_id) == ("A", "B/base_link")
    assert got[0].range == pytest.approx(straight, rel=1e-3)
    assert got[0].range != straight
    assert got[0].header.stamp.sec == 15
    answer = client.call_async(GetRanges.Request(transmitter="B"))
    until(probe, answer.done)
    assert answer.result().success, answer.result().message
    assert answer.result().straight[0].range == pytest.approx(straight)
    assert answer.result().ranges[0].receiver == "A"
    started.send_signal(signal.SIGINT)
    assert started.wait(20.0) == 0
