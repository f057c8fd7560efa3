"""Two-point acoustics in a gridded ocean: eigenrays, travel times and their derivatives."""

from pymantaray.acoustics.analytic import direct_travel_time_linear_gradient
from pymantaray.acoustics.eigenrays import find_eigenrays
from pymantaray.acoustics.medium import Medium
from pymantaray.acoustics.rays import ray_picture

__all__ = ["Medium", "direct_travel_time_linear_gradient", "find_eigenrays", "ray_picture"]
