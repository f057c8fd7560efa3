"""Data records that folders exchange: frozen, validated, convertible to xarray and NetCDF."""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports

if TYPE_CHECKING:
    from pymantaray.records.arrivals import Arrivals as Arrivals, FirstArrivals as FirstArrivals
    from pymantaray.records.base import DatedRecord as DatedRecord
    from pymantaray.records.estimate import (
        Estimates as Estimates,
        PoseCovariances as PoseCovariances,
        SharedUnknowns as SharedUnknowns,
    )
    from pymantaray.records.measurements import Measurements as Measurements
    from pymantaray.records.ranging_truth import RangingTruth as RangingTruth
    from pymantaray.records.status import (
        RayAxis as RayAxis,
        RayStatus as RayStatus,
        SolveStatus as SolveStatus,
        VehicleStatus as VehicleStatus,
    )
    from pymantaray.records.trajectory import Trajectories as Trajectories
    from pymantaray.records.writing import (
        NETCDF_LOCK as NETCDF_LOCK,
        read_netcdf as read_netcdf,
        whole_file as whole_file,
        write_netcdf as write_netcdf,
    )

__getattr__, __dir__, __all__ = lazy_exports(__name__)
