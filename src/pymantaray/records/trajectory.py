"""Where vehicles are: poses of a fleet at common times."""

from dataclasses import dataclass
from typing import ClassVar

from pymantaray.records.base import Column, Record, column


@dataclass(frozen=True, eq=False)
class Trajectories(Record):
    """
    Poses ``T_world_body`` of a fleet at common sample times, in the local NED frame.

    ``status`` holds `VehicleStatus` values; a stopped vehicle stays at its last place.
    """

    kind: ClassVar[str] = "trajectories"

    name: Column = column("agent", "", "vehicle name", "U")
    role: Column = column(
        "agent", "", "behaviour of the vehicle: float, station, drifting, twist or waypoints", "U"
    )
    time: Column = column("time", "s", "time since the start of the mission")
    position: Column = column("agent time axis", "m", "north, east, down in the local frame")
    quaternion: Column = column("agent time quat", "1", "rotation body to world, (w, x, y, z)")
    status: Column = column("agent time", "1", "VehicleStatus", "i1")
