"""Data records that folders exchange: frozen, validated, convertible to xarray and NetCDF."""

from pymantaray.records.arrivals import Arrivals, FirstArrivals, RayPaths
from pymantaray.records.base import DatedRecord
from pymantaray.records.estimate import Estimates, PoseCovariances, SharedUnknowns
from pymantaray.records.measurements import Measurements
from pymantaray.records.ranging_truth import RangingTruth
from pymantaray.records.status import RayAxis, RayStatus, SolveStatus, VehicleStatus
from pymantaray.records.trajectory import Trajectories
from pymantaray.records.writing import NETCDF_LOCK, read_netcdf, whole_file, write_netcdf

__all__ = [
    "NETCDF_LOCK",
    "Arrivals",
    "DatedRecord",
    "Estimates",
    "FirstArrivals",
    "Measurements",
    "PoseCovariances",
    "RangingTruth",
    "RayAxis",
    "RayPaths",
    "RayStatus",
    "SharedUnknowns",
    "SolveStatus",
    "Trajectories",
    "VehicleStatus",
    "read_netcdf",
    "whole_file",
    "write_netcdf",
]
