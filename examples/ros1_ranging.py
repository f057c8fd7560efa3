"""
A ROS 1 node that answers pings with refracted ranges.

It needs ROS 1 and the standard library. The ranges come from `mantaray serve synthetic:beaufort`,
which may run in another Python. `python3 ros1_ranging.py A B C --port 8642` reads the poses of
vehicles A, B and C from /A/odom and so on (nav_msgs/Odometry: east, north, up) and pings from /ping
(std_msgs/Header: stamp, and the transmitter as frame_id). For each receiver it publishes
sensor_msgs/Range on /RECEIVER/range: the refracted range, with the arrival time as stamp and the
transmitter as frame_id. A lost range is +Inf (REP 117), with the time of the ping as stamp.
"""

import argparse
import bisect
import http.client
import json
import math
import threading

import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Range
from std_msgs.msg import Header

KEPT = 1000  # poses of each vehicle


class Ranging:
    """Poses of the fleet, pings that wait for poses, and a connection to the server."""

    def __init__(self, vehicles, port):
        self.lock = threading.Lock()
        self.server = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
        self.poses = {name: [] for name in vehicles}
        self.waiting = []
        self.answers = {
            name: rospy.Publisher(f"/{name}/range", Range, queue_size=100) for name in vehicles
        }
        for name in vehicles:
            rospy.Subscriber(f"/{name}/odom", Odometry, self.moved, callback_args=name)
        rospy.Subscriber("/ping", Header, self.pinged)

    def moved(self, message, name):
        """Keep a pose."""
        place = message.pose.pose.position
        with self.lock:
            bisect.insort(
                self.poses[name], (message.header.stamp.to_sec(), place.y, place.x, -place.z)
            )
            del self.poses[name][:-KEPT]
            self.answer()

    def pinged(self, ping):
        """
        Answer a ping, or keep it until all poses of its time are there: topics have no common
        order.
        """
        with self.lock:
            if ping.frame_id not in self.poses:
                rospy.logwarn(
                    "ignored a ping of %r: unknown vehicle (known: %s)",
                    ping.frame_id,
                    ", ".join(self.poses),
                )
                return
            self.waiting.append(ping)
            self.answer()

    def answer(self):
        """Answer all pings whose poses are there."""
        ready = min(poses[-1][0] if poses else -math.inf for poses in self.poses.values())
        for ping in [ping for ping in self.waiting if ping.stamp.to_sec() <= ready]:
            self.waiting.remove(ping)
            self.publish(ping.frame_id, ping.stamp.to_sec())

    def publish(self, transmitter, time):
        """Ask the server about one ping and publish the ranges."""
        places = {name: interpolated(poses, time) for name, poses in self.poses.items()}
        request = {
            "time": time,
            "source": places.pop(transmitter),
            "receivers": [{"name": name, **place} for name, place in places.items()],
        }
        self.server.request("POST", "/ping", json.dumps(request))
        answer = json.loads(self.server.getresponse().read())
        if "error" in answer:
            rospy.logerr("ping of %s at %g s: %s", transmitter, time, answer["error"])
            return
        for end in answer["receivers"]:
            message = Range(radiation_type=Range.ULTRASOUND, min_range=0.0, max_range=math.inf)
            heard = end["arrival_time"] is not None
            if not heard:
                rospy.loginfo(
                    "%s at %g s: %s gets no range: %s",
                    transmitter,
                    time,
                    end["name"],
                    end["status"],
                )
            message.header.stamp = rospy.Time.from_sec(end["arrival_time"] if heard else time)
            message.header.frame_id = transmitter
            message.range = end["refracted_range"] if heard else math.inf
            self.answers[end["name"]].publish(message)


def interpolated(poses, time):
    """Position at a time between two poses, as the server takes it."""
    k = max(1, bisect.bisect_left(poses, (time,))) if len(poses) > 1 else 0
    before, after = poses[k - 1 if k else 0], poses[min(k, len(poses) - 1)]
    part = (time - before[0]) / (after[0] - before[0]) if after[0] > before[0] else 0.0
    north, east, depth = (a + part * (b - a) for a, b in zip(before[1:], after[1:]))  # noqa: B905  ROS 1 has Python 3.8
    return {"north": north, "east": east, "depth": depth}


def main():
    """Run the node until ROS ends it."""
    parser = argparse.ArgumentParser(
        description="a ROS 1 node that answers pings with refracted ranges"
    )
    parser.add_argument("vehicles", nargs="+")
    parser.add_argument(
        "--port", type=int, default=8642, help="port of `mantaray serve` on this machine"
    )
    options = parser.parse_args(rospy.myargv()[1:])
    rospy.init_node("mantaray_ranging")
    Ranging(options.vehicles, options.port)
    rospy.loginfo("ranging between %s", ", ".join(options.vehicles))
    rospy.spin()


if __name__ == "__main__":
    main()
