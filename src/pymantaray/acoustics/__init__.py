"""Two-point acoustics in a gridded ocean: eigenrays, travel times and their derivatives."""

from pymantaray.acoustics.analytic import direct_travel_time_linear_gradient
from pymantaray.acoustics.eigenrays import find_eigenrays
from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.path_integrals import path_integrals, quadrature, travel_time_sensitivity
from pymantaray.acoustics.paths import trace_fan, trace_paths
from pymantaray.acoustics.rays import ray_picture

__all__ = [
    "Medium",
    "direct_travel_time_linear_gradient",
    "find_eigenrays",
    "path_integrals",
    "quadrature",
    "ray_picture",
    "trace_fan",
    "trace_paths",
    "travel_time_sensitivity",
]
