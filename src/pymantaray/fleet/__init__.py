"""Vehicles, their behaviours and the simulation of their trajectories."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.fleet.behaviours import (
        Behaviour as Behaviour,
        ConstantTwist as ConstantTwist,
        Drifting as Drifting,
        FloatCycle as FloatCycle,
        StationKeeping as StationKeeping,
        Vehicle as Vehicle,
        Waypoints as Waypoints,
    )
    from pymantaray.fleet.simulation import simulate as simulate

__getattr__, __dir__, __all__ = lazy_exports(__name__)
