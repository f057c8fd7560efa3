"""
Vehicles, their behaviours and the simulation of their trajectories.

Examples
--------
>>> from pymantaray import open_ocean, to_local
>>> from pymantaray.fleet import StationKeeping, Vehicle, simulate
>>> ocean = open_ocean("synthetic:fram", window=(77.9, 78.1, -0.4, 0.4))
>>> sea = to_local(ocean, half_extent=(5e3, 5e3))
>>> steps = {"duration": 1800.0, "physics_step": 10.0, "sampling_period": 600.0}
>>> simulate([Vehicle("A", [0.0, 0.0, 20.0], StationKeeping(depth=20.0))], sea, **steps)
<Trajectories: 1 vehicle, 4 times>
"""

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
