"""MantaRay: effects of refraction in the ocean on acoustic ranges, and on the positions estimated from them.

The names here are the public interface; each is imported from its folder when it is first used.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.acoustics import Medium as Medium
    from pymantaray.acoustics import find_eigenrays as find_eigenrays
    from pymantaray.apps.study import StudyConfig as StudyConfig
    from pymantaray.apps.study import citation as citation
    from pymantaray.apps.study import load_study as load_study
    from pymantaray.apps.study import measure as measure
    from pymantaray.apps.study import open_run as open_run
    from pymantaray.apps.study import run_study as run_study
    from pymantaray.errors import MantaRayError as MantaRayError
    from pymantaray.estimation import dead_reckon as dead_reckon
    from pymantaray.estimation import read_pyfg as read_pyfg
    from pymantaray.estimation import solve_conditions as solve_conditions
    from pymantaray.estimation import write_pyfg as write_pyfg
    from pymantaray.evaluation import dropout_table as dropout_table
    from pymantaray.evaluation import error_table as error_table
    from pymantaray.evaluation import range_error_table as range_error_table
    from pymantaray.exchange import Tracks as Tracks
    from pymantaray.exchange import read_trajectories as read_trajectories
    from pymantaray.fleet import ConstantTwist as ConstantTwist
    from pymantaray.fleet import Drifting as Drifting
    from pymantaray.fleet import FloatCycle as FloatCycle
    from pymantaray.fleet import StationKeeping as StationKeeping
    from pymantaray.fleet import Vehicle as Vehicle
    from pymantaray.fleet import Waypoints as Waypoints
    from pymantaray.fleet import simulate as simulate
    from pymantaray.geometry import LocalFrame as LocalFrame
    from pymantaray.ocean import open_ocean as open_ocean
    from pymantaray.ocean import to_local as to_local
    from pymantaray.records import Arrivals as Arrivals
    from pymantaray.records import Estimates as Estimates
    from pymantaray.records import Measurements as Measurements
    from pymantaray.records import RangingTruth as RangingTruth
    from pymantaray.records import Trajectories as Trajectories
    from pymantaray.sensing import Landmark as Landmark
    from pymantaray.sensing import NoiseModel as NoiseModel
    from pymantaray.sensing import PingList as PingList
    from pymantaray.sensing import PingSchedule as PingSchedule
    from pymantaray.sensing import SlotSchedule as SlotSchedule
    from pymantaray.sensing import perturb as perturb
    from pymantaray.water import open_water as open_water

__version__ = "0.2.0"
__getattr__, __dir__, __all__ = lazy_exports(__name__)
