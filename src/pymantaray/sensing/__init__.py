"""
Measurements of the vehicles: one module per sensor, acoustic ranges, and noise.

Noise levels import quickly; the modules of ranges are imported on first use.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.sensing.detection import Detector as Detector
    from pymantaray.sensing.detection import Hearing as Hearing
    from pymantaray.sensing.draws import RangingDraws as RangingDraws
    from pymantaray.sensing.landmarks import Landmark as Landmark
    from pymantaray.sensing.measure import assemble as assemble
    from pymantaray.sensing.measure import perturb as perturb
    from pymantaray.sensing.noise import NoiseModel as NoiseModel
    from pymantaray.sensing.picking import Candidates as Candidates
    from pymantaray.sensing.picking import Picker as Picker
    from pymantaray.sensing.picking import draw_picks as draw_picks
    from pymantaray.sensing.picking import find_candidates as find_candidates
    from pymantaray.sensing.ranging import Links as Links
    from pymantaray.sensing.ranging import Ranging as Ranging
    from pymantaray.sensing.ranging import link_positions as link_positions
    from pymantaray.sensing.ranging import measure_ranges as measure_ranges
    from pymantaray.sensing.receptions import Receptions as Receptions
    from pymantaray.sensing.receptions import SoundPath as SoundPath
    from pymantaray.sensing.schedule import PingList as PingList
    from pymantaray.sensing.schedule import PingSchedule as PingSchedule
    from pymantaray.sensing.schedule import Schedule as Schedule
    from pymantaray.sensing.schedule import SlotSchedule as SlotSchedule
    from pymantaray.sensing.timing import ClockModel as ClockModel
    from pymantaray.sensing.timing import Clocks as Clocks
    from pymantaray.sensing.timing import OneWay as OneWay
    from pymantaray.sensing.timing import Timing as Timing
    from pymantaray.sensing.timing import TwoWay as TwoWay
    from pymantaray.sensing.transmission import ReceptionOptions as ReceptionOptions
    from pymantaray.sensing.transmission import Transmission as Transmission
    from pymantaray.sensing.transmission import find_receptions as find_receptions
    from pymantaray.sensing.water import Water as Water

__getattr__, __dir__, __all__ = lazy_exports(__name__)
