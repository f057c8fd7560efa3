"""What the vehicles measure: one module a sensor, ranges by sound, and the noise of all."""

from pymantaray.sensing.detection import Detector, Hearing
from pymantaray.sensing.landmarks import Landmark
from pymantaray.sensing.measure import assemble, perturb
from pymantaray.sensing.mistaken import Candidates, Picker, draw_picks, find_candidates
from pymantaray.sensing.noise import NoiseModel
from pymantaray.sensing.ranging import Links, Ranging, measure_ranges
from pymantaray.sensing.schedule import PingSchedule
from pymantaray.sensing.timing import ClockModel, Clocks, OneWay, Timing, TwoWay

__all__ = [
    "Candidates",
    "ClockModel",
    "Clocks",
    "Detector",
    "Hearing",
    "Landmark",
    "Links",
    "NoiseModel",
    "OneWay",
    "Picker",
    "PingSchedule",
    "Ranging",
    "Timing",
    "TwoWay",
    "assemble",
    "draw_picks",
    "find_candidates",
    "measure_ranges",
    "perturb",
]
