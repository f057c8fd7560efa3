"""
A mission for the node of ros1_ranging.py, recorded to a bag: `python3 ros1_mission.py own.bag`.

Three vehicles publish their poses once per second of simulated time, and each pings every minute.
All odometry and all ranges that the node publishes are written to the bag.
"""

import math
import sys
import threading
import time

import rosbag
import rospy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Range
from std_msgs.msg import Header

FLEET = {
    "A": (0.0, 0.0, 30.0, 0.0),
    "B": (2500.0, 400.0, 120.0, 1.5),
    "C": (-1500.0, 3000.0, 300.0, -2.0),
}
"""North, east, depth at the start [m], and heading [rad]."""
SPEED, START, DURATION, INTERVAL = 1.5, 1000, 300, 60  # m/s; s, of the simulated clock
PATIENCE = 60.0  # s without a new answer, after which the mission ends


def pose(name, now):
    """Odometry of a vehicle: east, north, up."""
    north, east, depth, heading = FLEET[name]
    elapsed = now - START
    message = Odometry(child_frame_id=f"{name}/base_link")
    message.header.stamp, message.header.frame_id = rospy.Time.from_sec(now), "map"
    place = message.pose.pose.position
    place.x, place.y = (
        east + SPEED * elapsed * math.sin(heading),
        north + SPEED * elapsed * math.cos(heading),
    )
    place.z = -depth
    message.pose.pose.orientation.z = math.sin((math.pi / 2 - heading) / 2)
    message.pose.pose.orientation.w = math.cos((math.pi / 2 - heading) / 2)
    return message


def main():
    """Fly, ping and record."""
    rospy.init_node("mission")
    bag, lock, ranges = rosbag.Bag(sys.argv[1], "w"), threading.Lock(), []

    def record(message, topic):
        with lock:
            ranges.append(message)
            bag.write(topic, message, message.header.stamp)

    odometry = {name: rospy.Publisher(f"/{name}/odom", Odometry, queue_size=1000) for name in FLEET}
    pings = rospy.Publisher("/ping", Header, queue_size=100)
    for name in FLEET:
        rospy.Subscriber(f"/{name}/range", Range, record, callback_args=f"/{name}/range")
    publishers = (*odometry.values(), pings)
    while not all(publisher.get_num_connections() for publisher in publishers):
        rospy.sleep(0.1)  # until the node of ros1_ranging.py listens
    for now in range(START, START + DURATION + 1):
        for name in FLEET:
            message = pose(name, float(now))
            odometry[name].publish(message)
            with lock:
                bag.write(f"/{name}/odom", message, message.header.stamp)
            if now > START and (now - START) % INTERVAL == 0:
                pings.publish(Header(stamp=rospy.Time.from_sec(float(now)), frame_id=name))
        time.sleep(0.002)
    expected, count, since = (
        DURATION // INTERVAL * len(FLEET) * (len(FLEET) - 1),
        -1,
        time.monotonic(),
    )
    while len(ranges) < expected and time.monotonic() - since < PATIENCE:
        if len(ranges) != count:
            count, since = len(ranges), time.monotonic()
        time.sleep(0.1)
    with lock:
        bag.close()
    rospy.loginfo("%d of %d answers in %s", len(ranges), expected, sys.argv[1])


if __name__ == "__main__":
    main()
