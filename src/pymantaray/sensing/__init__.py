"""What the vehicles measure: noise-free measurements of the truth, and the noise stage."""

from pymantaray.sensing.candidates import find_candidates
from pymantaray.sensing.clocks import ClockModel, Clocks
from pymantaray.sensing.depth import measure_depth
from pymantaray.sensing.detection import Detector, Hearing
from pymantaray.sensing.gnss import Fixes, measure_gnss
from pymantaray.sensing.landmarks import Landmark
from pymantaray.sensing.mistaken import Candidates
from pymantaray.sensing.noise import NoiseModel
from pymantaray.sensing.observe import assemble
from pymantaray.sensing.odometry import measure_odometry
from pymantaray.sensing.perturb import perturb
from pymantaray.sensing.picker import Picker
from pymantaray.sensing.ranging import Links, Ranging, measure_ranges
from pymantaray.sensing.schedule import Attempts, PingSchedule, attempts
from pymantaray.sensing.timing import OneWay, Timing, TwoWay

__all__ = [
    "Attempts",
    "Candidates",
    "ClockModel",
    "Clocks",
    "Detector",
    "Fixes",
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
    "attempts",
    "find_candidates",
    "measure_depth",
    "measure_gnss",
    "measure_odometry",
    "measure_ranges",
    "perturb",
]
