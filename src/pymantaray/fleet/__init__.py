"""Vehicles, their behaviours and the simulation of their trajectories."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.fleet.behaviours import Behaviour as Behaviour
    from pymantaray.fleet.behaviours import ConstantTwist as ConstantTwist
    from pymantaray.fleet.behaviours import Drifting as Drifting
    from pymantaray.fleet.behaviours import FloatCycle as FloatCycle
    from pymantaray.fleet.behaviours import StationKeeping as StationKeeping
    from pymantaray.fleet.behaviours import Vehicle as Vehicle
    from pymantaray.fleet.behaviours import Waypoints as Waypoints
    from pymantaray.fleet.simulation import simulate as simulate

__getattr__, __dir__, __all__ = lazy_exports(__name__)
