"""
Two-point acoustics in a gridded ocean: eigenrays, travel times and their derivatives, loss and
detection.

Examples
--------
>>> import numpy as np
>>> from pymantaray.acoustics import Medium, find_eigenrays, trace_paths
>>> medium = Medium.from_profile([0, 100, 1000], [1450.0, 1460.0, 1475.0], bottom_depth=1000.0)
>>> source, receiver = [0.0, 0.0, 50.0], [3000.0, 0.0, 400.0]
>>> arrivals = find_eigenrays(medium, source, receiver, max_surface_bounces=1)
>>> paths = trace_paths(medium, source, receiver, arrivals)
>>> print(arrivals.travel_time.round(4), arrivals.surface_bounces)
[2.0659 2.0774] [0 1]
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.acoustics.currents import Currents as Currents, current_delays as current_delays
    from pymantaray.acoustics.eigenrays import find_eigenrays as find_eigenrays
    from pymantaray.acoustics.levels.absorption import Absorption as Absorption
    from pymantaray.acoustics.levels.caustics import Tails as Tails, find_tails as find_tails
    from pymantaray.acoustics.levels.interference import (
        Coherent as Coherent,
        received_loss_db as received_loss_db,
    )
    from pymantaray.acoustics.levels.leakage import (
        Leakage as Leakage,
        Leaks as Leaks,
        find_leaks as find_leaks,
    )
    from pymantaray.acoustics.levels.loss import transmission_loss as transmission_loss
    from pymantaray.acoustics.levels.sonar import (
        Sonar as Sonar,
        WenzNoise as WenzNoise,
        link_loss_db as link_loss_db,
        probability_of_excess as probability_of_excess,
    )
    from pymantaray.acoustics.medium import Medium as Medium
    from pymantaray.acoustics.paths import (
        path_integrals as path_integrals,
        quadrature as quadrature,
        ray_picture as ray_picture,
        trace_fan as trace_fan,
        trace_paths as trace_paths,
        travel_time_sensitivity as travel_time_sensitivity,
    )
    from pymantaray.acoustics.plots import plot_arrivals as plot_arrivals
    from pymantaray.acoustics.profile_files import (
        write_asvp as write_asvp,
        write_profiles as write_profiles,
    )
    from pymantaray.acoustics.profiles import (
        read_profile as read_profile,
        read_profiles as read_profiles,
        smooth_profile as smooth_profile,
        thin_profile as thin_profile,
    )
    from pymantaray.acoustics.ray_paths import RayPaths as RayPaths
    from pymantaray.acoustics.reflection import (
        FluidBottom as FluidBottom,
        GrainSizeBottom as GrainSizeBottom,
        IceCover as IceCover,
        SeaSurface as SeaSurface,
    )
    from pymantaray.acoustics.selection import (
        ArrivalRule as ArrivalRule,
        choose_arrivals as choose_arrivals,
        select as select,
    )
    from pymantaray.geometry.boundary import BoundarySurface as BoundarySurface

__getattr__, __dir__, __all__ = lazy_exports(__name__)
