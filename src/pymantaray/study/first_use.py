"""First use of kernels and array libraries, in advance: a server that forks processes does it once for all of them."""

import numpy as np
import xarray as xr
from netCDF4 import Dataset

from pymantaray.estimation import GraphSolver
from pymantaray.estimation.graph import KINDS, FactorGraph, Factors, GraphValues
from pymantaray.estimation.marginals import PoseCovariance


def use_all() -> None:
    """Let xarray import the array libraries that are installed and its reader, and load or compile the kernels of solves and standard errors."""
    xr.Variable("sample", [0.0])
    in_memory = Dataset("records.nc", "w", diskless=True)
    xr.open_dataset(xr.backends.NetCDF4DataStore(in_memory)).close()  # type: ignore[no-untyped-call]
    pose = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    rows = {
        "prior": ([[0], [2]], pose),
        "fix": ([[1]], pose[:3]),
        "depth": ([[1], [3]], [0.0]),
        "edge": ([[0, 1], [2, 3]], pose),
        "range": ([[1, 3]], [1.0]),
    }
    factors = {}
    for name, (variables, measured) in rows.items():
        kind, count = KINDS[name], len(variables)
        covariance = np.tile(np.eye(kind.rows), (count, 1, 1))
        factors[name] = Factors(kind, np.array(variables), np.tile(measured, (count, 1)), covariance)
    graph = FactorGraph(
        vehicle_name=np.array(["A", "B"]),
        landmark_name=np.empty(0, dtype=str),
        pose_vehicle=np.array([0, 0, 1, 1]),
        pose_number=np.array([0, 1, 0, 1]),
        pose_time=np.array([0.0, 1.0, 0.0, 1.0]),
        factors=factors,
    )
    position = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    values = GraphValues(position, np.tile(pose[3:], (4, 1)), np.empty((0, 3)))
    GraphSolver().solve(graph, values, covariance_poses=np.array([[1, 3]]))
    PoseCovariance(graph, values).positions(np.ones((2, 4, 3)))
