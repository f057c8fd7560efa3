"""Coarse sea floor from what is valid, and values below it for the interpolants."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy import ndimage

from pymantaray.errors import OceanError

Array = NDArray[np.float64]


def sea_floor_depth(ocean: xr.Dataset) -> xr.DataArray:
    """
    Sea floor that the levels of a model imply: half-way from the deepest valid level to the next.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.

    Returns
    -------
    xarray.DataArray, shape (lat, lon)
        Depth of the sea floor; 0 on land, the deepest level itself where that is valid. [m]
    """
    depth = np.asarray(ocean["depth"].values, dtype=float)
    floor_of = np.concatenate([[0.0], 0.5 * (depth[:-1] + depth[1:]), depth[-1:]])
    levels = np.isfinite(ocean["water_temp"].values).sum(axis=0)
    return xr.DataArray(
        floor_of[levels],
        coords={"lat": ocean["lat"], "lon": ocean["lon"]},
        dims=("lat", "lon"),
        name="sea_floor_depth",
        attrs={"standard_name": "sea_floor_depth_below_sea_surface", "units": "m"},
    )


def fill_below_sea_bed(field: NDArray[np.floating], lat: Array) -> Array:
    """
    Give every point a value, so that interpolants near the sea bed and the coast see no gap.

    In a wet column the deepest valid value is carried downward; a land column takes the filled column
    of the nearest wet one. The values are for interpolation only: nothing is meant to be there.

    Parameters
    ----------
    field : ndarray, shape (depth, lat, lon)
        NaN below the sea bed; valid from the surface downward in wet columns.
    lat : ndarray, shape (lat,)
        Only the shortening of a degree of longitude is taken from it, at the middle. [degrees]

    Returns
    -------
    ndarray, shape (depth, lat, lon)
        Without NaN.

    Raises
    ------
    OceanError
        If no column is wet.
    """
    filled = np.array(field, dtype=float)
    wet = np.isfinite(filled[0])
    if not wet.any():
        raise OceanError("ocean: no wet column in the window; choose a window over water")
    for k in range(1, len(filled)):
        filled[k] = np.where(np.isfinite(filled[k]), filled[k], filled[k - 1])
    if wet.all():
        return filled
    aspect = max(float(np.cos(np.radians(np.mean(lat)))), 1e-3)
    rows, columns = ndimage.distance_transform_edt(
        ~wet, sampling=(1.0, aspect), return_distances=False, return_indices=True
    )
    return np.ascontiguousarray(filled[:, rows, columns])
