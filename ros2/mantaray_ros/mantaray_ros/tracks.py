"""Poses of the fleet by their stamps, without ROS."""

from bisect import bisect_left, insort

KEPT = 1000  # poses of each vehicle


class Tracks:
    """Latest poses of each vehicle: stamps [ns], and north, east, down. [m]"""

    def __init__(self, vehicles):
        self._poses = {name: [] for name in vehicles}

    def add(self, name, stamp, position):
        """Keep a pose; topics may deliver poses in any order."""
        poses = self._poses[name]
        insort(poses, (stamp, *position))
        del poses[:-KEPT]

    def missing(self):
        """Vehicles without a pose."""
        return [name for name, poses in self._poses.items() if not poses]

    def latest(self):
        """Latest stamp at which all vehicles have a pose, or None. [ns]"""
        return None if self.missing() else min(poses[-1][0] for poses in self._poses.values())

    def at(self, stamp):
        """
        Positions of all vehicles, interpolated between poses.

        Raises
        ------
        ValueError
            If a vehicle has no pose at or before the stamp, or none at or after it.
        """
        return {name: _interpolated(name, poses, stamp) for name, poses in self._poses.items()}


def _interpolated(name, poses, stamp):
    k = bisect_left(poses, (stamp,))
    if k < len(poses) and poses[k][0] == stamp:
        return poses[k][1:]
    if k in (0, len(poses)):
        span = f"{poses[0][0] * 1e-9:g} to {poses[-1][0] * 1e-9:g} s" if poses else "no time"
        raise ValueError(f"{name} has poses for {span}, not for {stamp * 1e-9:g} s")
    before, after = poses[k - 1], poses[k]
    share = (stamp - before[0]) / (after[0] - before[0])
    return tuple(a + share * (b - a) for a, b in zip(before[1:], after[1:], strict=True))
