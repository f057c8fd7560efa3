"""
Two-point acoustics in a gridded ocean: eigenrays, travel times and their derivatives, loss and
detection.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.acoustics.currents import Currents as Currents
    from pymantaray.acoustics.currents import current_delays as current_delays
    from pymantaray.acoustics.eigenrays import find_eigenrays as find_eigenrays
    from pymantaray.acoustics.levels.absorption import Absorption as Absorption
    from pymantaray.acoustics.levels.caustics import Tails as Tails
    from pymantaray.acoustics.levels.caustics import find_tails as find_tails
    from pymantaray.acoustics.levels.interference import Coherent as Coherent
    from pymantaray.acoustics.levels.interference import received_loss_db as received_loss_db
    from pymantaray.acoustics.levels.leakage import Leakage as Leakage
    from pymantaray.acoustics.levels.leakage import Leaks as Leaks
    from pymantaray.acoustics.levels.leakage import find_leaks as find_leaks
    from pymantaray.acoustics.levels.loss import transmission_loss as transmission_loss
    from pymantaray.acoustics.levels.sonar import Sonar as Sonar
    from pymantaray.acoustics.levels.sonar import WenzNoise as WenzNoise
    from pymantaray.acoustics.levels.sonar import link_loss_db as link_loss_db
    from pymantaray.acoustics.levels.sonar import probability_of_excess as probability_of_excess
    from pymantaray.acoustics.medium import Medium as Medium
    from pymantaray.acoustics.paths import path_integrals as path_integrals
    from pymantaray.acoustics.paths import quadrature as quadrature
    from pymantaray.acoustics.paths import ray_picture as ray_picture
    from pymantaray.acoustics.paths import trace_fan as trace_fan
    from pymantaray.acoustics.paths import trace_paths as trace_paths
    from pymantaray.acoustics.paths import travel_time_sensitivity as travel_time_sensitivity
    from pymantaray.acoustics.plots import plot_arrivals as plot_arrivals
    from pymantaray.acoustics.profile_files import write_asvp as write_asvp
    from pymantaray.acoustics.profile_files import write_profiles as write_profiles
    from pymantaray.acoustics.profiles import read_profile as read_profile
    from pymantaray.acoustics.profiles import read_profiles as read_profiles
    from pymantaray.acoustics.profiles import smooth_profile as smooth_profile
    from pymantaray.acoustics.profiles import thin_profile as thin_profile
    from pymantaray.acoustics.ray_paths import RayPaths as RayPaths
    from pymantaray.acoustics.reflection import FluidBottom as FluidBottom
    from pymantaray.acoustics.reflection import GrainSizeBottom as GrainSizeBottom
    from pymantaray.acoustics.reflection import IceCover as IceCover
    from pymantaray.acoustics.reflection import SeaSurface as SeaSurface
    from pymantaray.acoustics.selection import ArrivalRule as ArrivalRule
    from pymantaray.acoustics.selection import choose_arrivals as choose_arrivals
    from pymantaray.acoustics.selection import select as select
    from pymantaray.geometry.boundary import BoundarySurface as BoundarySurface

__getattr__, __dir__, __all__ = lazy_exports(__name__)
