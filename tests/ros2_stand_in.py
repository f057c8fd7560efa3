"""
The part of rclpy and of the message packages that the node in `ros2` uses, in one process.

A message is delivered when a node is spun, as with rclpy. Time is that of the test.
"""

import sys
from collections import defaultdict, deque
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
Range = message(
    header=Header, radiation_type=0, field_of_view=0.0, min_range=0.0, max_range=0.0, range=0.0
)
Range.ULTRASOUND = 0
Trigger = SimpleNamespace(Request=message(), Response=message(success=False, message=""))


class Network:
    """Topics and services of all nodes."""

    def __init__(self):
        self.subscribers, self.services = defaultdict(list), {}
        self.queues, self.parameters, self.now = {}, {}, 0
        self.timers, self.log = [], []


NETWORK = Network()


class Node:
    """Node on the network of the process."""

    def __init__(self, name, **_):
        self.name = name
        self._values = {}
        NETWORK.queues[self] = deque()

    def declare_parameter(self, name, default):
        self._values[name] = NETWORK.parameters.get(name, default)

    def get_parameter(self, name):
        return SimpleNamespace(value=self._values[name])

    def create_publisher(self, _kind, topic, _depth):
        def publish(content):
            for node, callback in NETWORK.subscribers[topic.strip("/")]:
                NETWORK.queues[node].append((callback, content))

        return SimpleNamespace(publish=publish)

    def create_subscription(self, _kind, topic, callback, _depth):
        NETWORK.subscribers[topic.strip("/")].append((self, callback))

    def create_service(self, kind, name, callback):
        NETWORK.services[name.strip("/")] = lambda: callback(kind.Request(), kind.Response())

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
        "rclpy.executors": {"ExternalShutdownException": KeyboardInterrupt},
        "rclpy.node": {"Node": Node},
        "rclpy.time": {"Time": Time},
        "nav_msgs": {},
        "nav_msgs.msg": {"Odometry": Odometry},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Range": Range},
        "std_msgs": {},
        "std_msgs.msg": {"Header": Header},
        "std_srvs": {},
        "std_srvs.srv": {"Trigger": Trigger},
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    for name in [name for name in sys.modules if name.startswith("mantaray_ros")]:
        monkeypatch.delitem(sys.modules, name)
    return NETWORK
