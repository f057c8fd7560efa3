"""
The part of rclpy and of the message packages that the node in `ros2` uses, in one process.

A message is delivered when a node is spun, as with rclpy. Time is that of the test.
"""

import sys
from collections import defaultdict, deque
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import ModuleType, SimpleNamespace


class Time:
    """Time in nanoseconds."""

    def __init__(self, *, nanoseconds=0):
        self.nanoseconds = nanoseconds

    @classmethod
    def from_msg(cls, stamp):
        if stamp.sec < 0:  # as in rclpy
            raise ValueError("Seconds value must not be negative")
        return cls(nanoseconds=stamp.sec * 10**9 + stamp.nanosec)

    def to_msg(self):
        return Stamp(sec=self.nanoseconds // 10**9, nanosec=self.nanoseconds % 10**9)


def message(**defaults):
    """Class of messages whose fields may only be set if they exist, as in rclpy."""

    class Message:
        __slots__ = tuple(defaults)

        def __init__(self, **values):
            for name, default in (defaults | values).items():
                setattr(self, name, default() if callable(default) else default)

    return Message


Stamp = message(sec=0, nanosec=0)
Header = message(stamp=Stamp, frame_id="")
Point = message(x=0.0, y=0.0, z=0.0)
Pose = message(position=Point)
PoseWithCovariance = message(pose=Pose)
Odometry = message(header=Header, child_frame_id="", pose=PoseWithCovariance)
FloatingPointRange = message(from_value=0.0, to_value=0.0, step=0.0)
ParameterDescriptor = message(description="", read_only=False, floating_point_range=list)


def own_message(text):
    """Class of a message from its definition in `ros2`; constants are attributes."""
    kinds = {"string": "", "uint8": 0, "bool": False, "float64": 0.0}
    kinds |= {"std_msgs/Header": Header, "builtin_interfaces/Time": Stamp, "AcousticRange[]": list}
    constants, defaults = {}, {}
    for line in text.splitlines():
        kind, _, rest = line.partition("#")[0].strip().partition(" ")
        name, _, value = rest.partition("=")
        if value:
            constants[name] = int(value)
        elif kind:
            defaults[name.strip()] = kinds[kind]
    made = message(**defaults)
    for name, value in constants.items():
        setattr(made, name, value)
    return made


MESSAGES = Path(__file__).parents[1] / "ros2" / "mantaray_ros_msgs"
AcousticRange = own_message((MESSAGES / "msg" / "AcousticRange.msg").read_text())
Ping = own_message((MESSAGES / "msg" / "Ping.msg").read_text())
REQUEST, RESPONSE = (MESSAGES / "srv" / "GetRanges.srv").read_text().split("---\n")
GetRanges = SimpleNamespace(Request=own_message(REQUEST), Response=own_message(RESPONSE))


class ParameterException(Exception):  # noqa: N818
    """The name that rclpy gives it."""


class ReliabilityPolicy(Enum):
    """Those that the node names."""

    RELIABLE = 1
    BEST_EFFORT = 2


@dataclass(frozen=True)
class QoSProfile:
    """The part that decides whether a subscription gets what a publisher sends."""

    depth: int
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE


class Network:
    """Topics and services of all nodes."""

    def __init__(self):
        self.subscribers, self.services = defaultdict(list), {}
        self.queues, self.parameters, self.now = {}, {}, 0
        self.timers, self.log, self.descriptors = [], [], {}


NETWORK = Network()


class Node:
    """Node on the network of the process."""

    def __init__(self, name, **_):
        self.name = name
        NETWORK.queues[self] = deque()

    def declare_parameter(self, name, default, descriptor):
        value = NETWORK.parameters.get(name, default)
        for limits in descriptor.floating_point_range:
            if not limits.from_value <= value <= limits.to_value:
                raise ParameterException(f"{name} is {value}, which is out of range")
        NETWORK.descriptors[name] = descriptor
        return SimpleNamespace(value=value)

    def create_publisher(self, _kind, topic, quality, **_):
        def publish(content):
            for node, callback, asked in NETWORK.subscribers[topic.strip("/")]:
                if asked.reliability.value >= quality.reliability.value:
                    NETWORK.queues[node].append((callback, content))

        return SimpleNamespace(publish=publish)

    def create_subscription(self, _kind, topic, callback, quality, **_):
        NETWORK.subscribers[topic.strip("/")].append((self, callback, quality))

    def create_service(self, kind, name, callback):
        NETWORK.services[name.strip("/")] = lambda request: callback(request, kind.Response())

    def create_timer(self, interval, callback):
        NETWORK.timers.append((interval, callback))

    def get_clock(self):
        return SimpleNamespace(now=lambda: Time(nanoseconds=NETWORK.now))

    def get_logger(self):
        return SimpleNamespace(warning=NETWORK.log.append, error=NETWORK.log.append)


def spin():
    """Deliver all messages, and those that the answers are."""
    while any(NETWORK.queues.values()):
        for queue in list(NETWORK.queues.values()):
            while queue:
                callback, content = queue.popleft()
                callback(content)


def install(monkeypatch):
    """Make these the modules of ROS for a test, on a new network."""
    NETWORK.__init__()
    modules = {
        "rclpy": {},
        "rclpy.exceptions": {"ParameterException": ParameterException},
        "rclpy.executors": {"ExternalShutdownException": KeyboardInterrupt},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"QoSProfile": QoSProfile, "ReliabilityPolicy": ReliabilityPolicy},
        "rclpy.qos_overriding_options": {
            "QoSOverridingOptions": SimpleNamespace(with_default_policies=lambda: None)
        },
        "rclpy.time": {"Time": Time},
        "rcl_interfaces": {},
        "rcl_interfaces.msg": {
            "FloatingPointRange": FloatingPointRange,
            "ParameterDescriptor": ParameterDescriptor,
        },
        "nav_msgs": {},
        "nav_msgs.msg": {"Odometry": Odometry},
        "mantaray_ros_msgs": {},
        "mantaray_ros_msgs.msg": {"AcousticRange": AcousticRange, "Ping": Ping},
        "mantaray_ros_msgs.srv": {"GetRanges": GetRanges},
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    for name in [name for name in sys.modules if name.partition(".")[0] == "mantaray_ros"]:
        monkeypatch.delitem(sys.modules, name)
    return NETWORK
