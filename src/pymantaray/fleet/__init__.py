"""Vehicles, their behaviours and the simulation of their trajectories."""

from pymantaray.fleet.behaviours import (
    Behaviour,
    ConstantTwist,
    Drifting,
    FloatCycle,
    StationKeeping,
    Vehicle,
    Waypoints,
)
from pymantaray.fleet.simulate import simulate

__all__ = [
    "Behaviour",
    "ConstantTwist",
    "Drifting",
    "FloatCycle",
    "StationKeeping",
    "Vehicle",
    "Waypoints",
    "simulate",
]
