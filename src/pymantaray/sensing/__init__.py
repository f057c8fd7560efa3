"""What the vehicles measure: noise-free observations of the truth, and the noise stage."""

from pymantaray.sensing.depth import measure_depth
from pymantaray.sensing.gnss import Fixes, measure_gnss
from pymantaray.sensing.landmarks import Landmark
from pymantaray.sensing.noise import NoiseModel
from pymantaray.sensing.observe import assemble
from pymantaray.sensing.odometry import measure_odometry
from pymantaray.sensing.perturb import perturb
from pymantaray.sensing.ranging import Links, Ranging, measure_ranges
from pymantaray.sensing.schedule import Attempts, PingSchedule, attempts

__all__ = [
    "Attempts",
    "Fixes",
    "Landmark",
    "Links",
    "NoiseModel",
    "PingSchedule",
    "Ranging",
    "assemble",
    "attempts",
    "measure_depth",
    "measure_gnss",
    "measure_odometry",
    "measure_ranges",
    "perturb",
]
