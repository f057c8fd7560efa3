"""Nouns that cross folders: frozen, validated, to and from xarray and NetCDF."""

from pymantaray.records.arrivals import Arrivals, FirstArrivals
from pymantaray.records.estimate import Estimates
from pymantaray.records.observations import Observations
from pymantaray.records.ray_paths import RayPaths
from pymantaray.records.status import RayStatus, SolveStatus, VehicleStatus
from pymantaray.records.trajectory import Trajectories

__all__ = [
    "Arrivals",
    "Estimates",
    "FirstArrivals",
    "Observations",
    "RayPaths",
    "RayStatus",
    "SolveStatus",
    "Trajectories",
    "VehicleStatus",
]
