"""Two-point acoustics in a gridded ocean: eigenrays, travel times and their derivatives, loss and detection."""

from pymantaray.acoustics.absorption import Absorption
from pymantaray.acoustics.caustics import Tails, find_tails
from pymantaray.acoustics.currents import Currents, current_delays
from pymantaray.acoustics.eigenrays import find_eigenrays
from pymantaray.acoustics.interference import Coherent, received_loss_db
from pymantaray.acoustics.leakage import Leakage, Leaks, find_leaks
from pymantaray.acoustics.loss import transmission_loss
from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.paths import (
    path_integrals,
    quadrature,
    ray_picture,
    trace_fan,
    trace_paths,
    travel_time_sensitivity,
)
from pymantaray.acoustics.profile_files import write_asvp, write_profiles
from pymantaray.acoustics.profiles import read_profile, read_profiles, smooth_profile, thin_profile
from pymantaray.acoustics.reflection import FluidBottom, GrainSizeBottom, IceCover, SeaSurface
from pymantaray.acoustics.selection import ArrivalRule, choose_arrivals, select
from pymantaray.acoustics.sonar import Sonar, WenzNoise, link_loss_db, probability_of_excess
from pymantaray.geometry.boundary import BoundarySurface

__all__ = [
    "Absorption",
    "ArrivalRule",
    "BoundarySurface",
    "Coherent",
    "Currents",
    "FluidBottom",
    "GrainSizeBottom",
    "IceCover",
    "Leakage",
    "Leaks",
    "Medium",
    "SeaSurface",
    "Sonar",
    "Tails",
    "WenzNoise",
    "choose_arrivals",
    "current_delays",
    "find_eigenrays",
    "find_leaks",
    "find_tails",
    "link_loss_db",
    "path_integrals",
    "probability_of_excess",
    "quadrature",
    "ray_picture",
    "read_profile",
    "read_profiles",
    "received_loss_db",
    "select",
    "smooth_profile",
    "thin_profile",
    "trace_fan",
    "trace_paths",
    "transmission_loss",
    "travel_time_sensitivity",
    "write_asvp",
    "write_profiles",
]
