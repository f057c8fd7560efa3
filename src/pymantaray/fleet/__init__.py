"""Vehicles: what they do, and where the ocean and their own motion take them."""

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
