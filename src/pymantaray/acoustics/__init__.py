"""Two-point acoustics in a gridded ocean: eigenrays, travel times and their derivatives."""

from pymantaray.acoustics.eigenrays import find_eigenrays
from pymantaray.acoustics.medium import Medium

__all__ = ["Medium", "find_eigenrays"]
