"""
Node that answers pings between vehicles with refracted ranges, beside the true distances.

The README of the package lists topics, services and parameters.
"""

import json
import math
import re
from itertools import cycle

import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import Range
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from mantaray_ros.tracks import Tracks
from pymantaray import MantaRayError
from pymantaray.apps.service import RangingService
from pymantaray.records import RayStatus

DEPTH = 100  # messages in a queue
MAX_WAITING = 1000  # pings
_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class RangingNode(Node):
    """Poses of the fleet, pings that wait for poses, and the service that computes ranges."""

    def __init__(self, **options):
        super().__init__("mantaray_ranging", **options)
        self.declare_parameter("vehicles", ["A", "B"])
        self.declare_parameter("ocean", ["synthetic:beaufort"])
        self.declare_parameter("slot", 0.0)
        self.declare_parameter("time_origin", 0.0)
        vehicles = list(self.get_parameter("vehicles").value)
        if len(set(vehicles)) != len(vehicles) or not all(map(_TOKEN.fullmatch, vehicles)):
            raise MantaRayError(
                f"vehicles is {vehicles}; names must differ and have letters, digits and _ only"
            )
        origin, slot = (self.get_parameter(name).value for name in ("time_origin", "slot"))
        if not (vehicles and math.isfinite(origin) and math.isfinite(slot)):
            raise MantaRayError(
                f"vehicles is {vehicles}, time_origin {origin} and slot {slot}; at least one"
                " vehicle and finite times are needed"
            )
        self._origin = round(origin * 1e9)
        self._ranging = RangingService(list(self.get_parameter("ocean").value))
        self._tracks = Tracks(vehicles)
        self._waiting = []
        self._measured = {}
        self._true = {}
        for name in vehicles:
            self._measured[name] = self.create_publisher(Range, f"{name}/range", DEPTH)
            self._true[name] = self.create_publisher(Range, f"{name}/range_truth", DEPTH)
            self.create_subscription(
                Odometry, f"{name}/odom", lambda pose, name=name: self._moved(name, pose), DEPTH
            )
            self.create_service(
                Trigger, f"{name}/ping", lambda _, reply, name=name: self._asked(name, reply)
            )
        self.create_subscription(Header, "ping", self._pinged, DEPTH)
        if slot > 0.0:
            turns = cycle(vehicles)
            self.create_timer(slot, lambda: self._wait(self._now(), next(turns)))

    def _now(self):
        return self.get_clock().now().nanoseconds

    def _moved(self, name, pose):
        """Keep a pose, from east, north, up."""
        place = pose.pose.pose.position
        stamp = self._stamp(pose.header, f"pose of {name}")
        if stamp is None:
            return
        if not all(map(math.isfinite, (place.x, place.y, place.z))):
            self.get_logger().warning(f"pose of {name} at {stamp * 1e-9:g} s is not finite")
            return
        self._tracks.add(name, stamp, (place.y, place.x, -place.z))
        self._answer()

    def _stamp(self, header, what):
        """Stamp of a message [ns]; None with a warning for one before 1970."""
        try:
            return Time.from_msg(header.stamp).nanoseconds
        except ValueError as error:
            self.get_logger().warning(f"{what}: {error}")
            return None

    def _pinged(self, ping):
        if ping.frame_id not in self._measured:
            known = ", ".join(self._measured)
            self.get_logger().warning(f"ping of unknown vehicle {ping.frame_id!r}; known: {known}")
            return
        stamp = self._stamp(ping, f"ping of {ping.frame_id}")
        if stamp is not None:
            self._wait(stamp, ping.frame_id)

    def _wait(self, stamp, transmitter):
        """Answer a ping when all poses of its time are there: topics have no common order."""
        if len(self._waiting) == MAX_WAITING:
            missing = ", ".join(self._tracks.missing()) or "newer ones"
            self.get_logger().warning(
                f"{MAX_WAITING} pings wait for poses ({missing}); dropped one"
            )
            self._waiting.pop(0)
        self._waiting.append((stamp, transmitter))
        self._answer()

    def _answer(self):
        latest = self._tracks.latest()
        if latest is None:
            return
        ready = [ping for ping in self._waiting if ping[0] <= latest]
        self._waiting = [ping for ping in self._waiting if ping[0] > latest]
        for stamp, transmitter in ready:
            try:
                self._range(stamp, transmitter)
            except (MantaRayError, ValueError) as error:
                self.get_logger().error(f"ping of {transmitter}: {error}")

    def _asked(self, transmitter, reply):
        """Ping at the latest time for which all poses are there."""
        latest = self._tracks.latest()
        if latest is None:
            reply.message = f"no pose yet of {', '.join(self._tracks.missing())}"
            return reply
        try:
            reply.message = json.dumps(self._range(latest, transmitter), allow_nan=False)
            reply.success = True
        except (MantaRayError, ValueError) as error:
            reply.message = str(error)
        return reply

    def _range(self, stamp, transmitter):
        """Publish the ranges of a ping, and return them as in the answers of `mantaray serve`."""
        places = self._tracks.at(stamp)
        source = places.pop(transmitter)
        time = (stamp - self._origin) * 1e-9
        ping = self._ranging.ping(time, source, list(places.values()))
        rows = []
        for k, receiver in enumerate(places):
            delay = float(ping.arrival_time[k]) - time
            heard = math.isfinite(delay)
            arrival = stamp + round(delay * 1e9) if heard else stamp
            value = float(ping.refracted_range[k]) if heard else math.inf
            straight = float(ping.straight_range[k])
            self._measured[receiver].publish(_message(transmitter, arrival, value))
            self._true[receiver].publish(_message(transmitter, arrival, straight))
            rows.append(
                {
                    "name": receiver,
                    "status": RayStatus(ping.status[k]).name.lower(),
                    "arrival_time": arrival * 1e-9 if heard else None,
                    "refracted_range": value if heard else None,
                    "straight_range": straight,
                }
            )
        return {"time": stamp * 1e-9, "source": transmitter, "receivers": rows}


def _message(transmitter, stamp, value):
    """Range [m] at a stamp [ns]; the transmitter is its frame."""
    message = Range()
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    message.header.frame_id = transmitter
    message.radiation_type = Range.ULTRASOUND
    message.field_of_view = 2.0 * math.pi
    message.min_range = 0.0
    message.max_range = math.inf
    message.range = value
    return message


def main(arguments=None):
    """Run the node until ROS ends it; impossible parameters end it in one line."""
    rclpy.init(args=arguments)
    try:
        rclpy.spin(RangingNode())
    except MantaRayError as error:
        raise SystemExit(f"error: {error}") from None
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
