"""
Node that answers pings between vehicles with refracted ranges, beside the true distances.

The README of the package lists topics, services and parameters.
"""

import copy
import math
import re
from itertools import cycle

import rclpy
from mantaray_ros_msgs.msg import AcousticRange, Ping
from mantaray_ros_msgs.srv import GetRanges
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.time import Time

from mantaray_ros.parameters import PARAMETERS
from mantaray_ros.tracks import Tracks
from pymantaray import MantaRayError
from pymantaray.apps.service import RangingService

MAX_WAITING = 1000  # pings
# As REP 2003 says: a sensor publishes reliably, and whoever reads sensor data takes what comes.
# 100 poses or pings wait while a ping is computed.
PUBLISHED = QoSProfile(depth=100)
POSES = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
LIMITS = {"slot": FloatingPointRange(from_value=0.0, to_value=1e6)}
_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class RangingNode(Node):
    """Poses of the fleet, pings that wait for poses, and the service that computes ranges."""

    def __init__(self, **options):
        super().__init__("mantaray_ranging", **options)
        vehicles, ocean, slot, origin = map(self._parameter, PARAMETERS)
        if len(set(vehicles)) != len(vehicles) or not all(map(_TOKEN.fullmatch, vehicles)):
            raise MantaRayError(
                f"vehicles is {vehicles}; names must differ and have letters, digits and _ only"
            )
        if not (vehicles and math.isfinite(origin)):
            raise MantaRayError(
                f"vehicles is {vehicles} and time_origin {origin}; at least one vehicle and a"
                " finite time are needed"
            )
        self._origin = round(origin * 1e9)
        self._ranging = RangingService(list(ocean))
        self._tracks = Tracks(vehicles)
        self._waiting = []
        self._bodies = {}
        self._worlds = {}
        self._measured = {}
        self._true = {}
        quality = {"qos_overriding_options": QoSOverridingOptions.with_default_policies()}
        for name in vehicles:
            for publishers, topic in ((self._measured, "range"), (self._true, "range_truth")):
                publishers[name] = self.create_publisher(
                    AcousticRange, f"{name}/{topic}", PUBLISHED, **quality
                )
            self.create_subscription(
                Odometry,
                f"{name}/odom",
                lambda pose, name=name: self._moved(name, pose),
                POSES,
                **quality,
            )
        self.create_subscription(Ping, "ping", self._pinged, PUBLISHED, **quality)
        self.create_service(GetRanges, "get_ranges", self._asked)
        if slot > 0.0:
            turns = cycle(vehicles)
            self.create_timer(slot, lambda: self._wait(self._now(), next(turns)))

    def _parameter(self, name):
        """Declare a parameter, which holds until the node ends; its value."""
        default, description = PARAMETERS[name]
        limits = [LIMITS[name]] if name in LIMITS else []
        descriptor = ParameterDescriptor(
            description=description, read_only=True, floating_point_range=limits
        )
        return self.declare_parameter(name, default, descriptor).value

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
        self._note_frames(name, pose)
        self._tracks.add(name, stamp, (place.y, place.x, -place.z))
        self._answer()

    def _note_frames(self, name, pose):
        """Keep the frame of a vehicle; warn once if its poses are in another frame than others."""
        self._bodies[name] = pose.child_frame_id or f"{name}/base_link"
        if name in self._worlds:
            return
        self._worlds[name] = pose.header.frame_id
        first, world = next(iter(self._worlds.items()))
        if world != pose.header.frame_id:
            self.get_logger().warning(
                f"poses of {name} are in frame {pose.header.frame_id!r}, those of {first} in"
                f" {world!r}; the node takes both as one frame"
            )

    def _stamp(self, message, what):
        """Stamp of a header or ping [ns]; None with a warning for one before 1970."""
        try:
            return Time.from_msg(message.stamp).nanoseconds
        except ValueError as error:
            self.get_logger().warning(f"{what}: {error}")
            return None

    def _unknown(self, transmitter):
        """What is wrong with the name of a transmitter; None if it is a vehicle."""
        if transmitter in self._measured:
            return None
        return f"ping of unknown vehicle {transmitter!r}; known: {', '.join(self._measured)}"

    def _pinged(self, ping):
        if unknown := self._unknown(ping.transmitter):
            self.get_logger().warning(unknown)
            return
        stamp = self._stamp(ping, f"ping of {ping.transmitter}")
        if stamp is not None:
            self._wait(stamp, ping.transmitter)

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

    def _asked(self, request, reply):
        """Ping at the latest time for which all poses are there."""
        latest = self._tracks.latest()
        reply.message = self._unknown(request.transmitter) or ""
        if not reply.message and latest is None:
            reply.message = f"no pose yet of {', '.join(self._tracks.missing())}"
        if reply.message:
            return reply
        try:
            reply.ranges, reply.straight = self._range(latest, request.transmitter)
        except (MantaRayError, ValueError) as error:
            reply.message = str(error)
            return reply
        reply.stamp = Time(nanoseconds=latest).to_msg()
        reply.success = True
        return reply

    def _range(self, stamp, transmitter):
        """Publish the ranges of a ping, and return them, refracted and straight."""
        places = self._tracks.at(stamp)
        source = places.pop(transmitter)
        time = (stamp - self._origin) * 1e-9
        ping = self._ranging.ping(time, source, list(places.values()))
        measured, true = [], []
        for k, receiver in enumerate(places):
            message = AcousticRange(transmitter=transmitter, receiver=receiver)
            message.header.frame_id = self._bodies[receiver]
            message.status = int(ping.status[k])
            message.travel_time = float(ping.arrival_time[k]) - time
            heard = math.isfinite(message.travel_time)
            arrival = stamp + round(message.travel_time * 1e9) if heard else stamp
            message.header.stamp = Time(nanoseconds=arrival).to_msg()
            message.range = float(ping.refracted_range[k]) if heard else math.inf
            straight = copy.deepcopy(message)
            straight.range = float(ping.straight_range[k])
            self._measured[receiver].publish(message)
            self._true[receiver].publish(straight)
            measured.append(message)
            true.append(straight)
        return measured, true


def main(arguments=None):
    """Run the node until ROS ends it; impossible parameters end it in one line."""
    rclpy.init(args=arguments)
    try:
        rclpy.spin(RangingNode())
    except (MantaRayError, ParameterException) as error:
        raise SystemExit(f"error: {error}") from None
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
