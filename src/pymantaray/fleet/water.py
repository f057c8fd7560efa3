"""From a local ocean data set to the arrays that the compiled integrators read."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import FleetError
from pymantaray.fleet._kernel import Water

Array = NDArray[np.float64]

_DIMS = ("north", "east", "depth")


def _axis(ocean: xr.Dataset, name: str, *, uniform: bool) -> Array:
    axis = np.asarray(ocean[name].values, dtype=float)
    steps = np.diff(axis)
    if axis.size < 2 or not np.isfinite(axis).all() or (steps <= 0.0).any():
        raise FleetError(
            f"ocean: axis {name!r} has {axis.size} values; it needs at least 2, finite and increasing"
        )
    if uniform and np.ptp(steps) > 1e-6 * steps.mean():
        raise FleetError(
            f"ocean: axis {name!r} has steps from {steps.min():g} to {steps.max():g} m; they must be equal:"
            " bring the data set to the local frame with pymantaray.ocean.to_local"
        )
    return axis


def _variable(ocean: xr.Dataset, name: str, dims: tuple[str, ...]) -> Array:
    if set(ocean[name].dims) != set(dims):
        raise FleetError(f"ocean: {name} has dimensions {ocean[name].dims}; it needs {dims}")
    values = np.ascontiguousarray(ocean[name].transpose(*dims).values, dtype=float)
    if not np.isfinite(values).all():
        raise FleetError(
            f"ocean: {name} has {np.count_nonzero(~np.isfinite(values))} missing values; none are allowed:"
            " fill it with pymantaray.ocean.to_local"
        )
    return values


def water_from_dataset(ocean: xr.Dataset) -> Water:
    """
    Arrays of a local ocean data set for the integrators.

    Parameters
    ----------
    ocean : xarray.Dataset
        Uniform axes ``north`` and ``east``, levels ``depth`` [m]; ``current_north``, ``current_east``
        (north, east, depth) [m s⁻¹] and ``sea_floor_depth`` (north, east) [m].

    Returns
    -------
    Water

    Raises
    ------
    FleetError
        If a variable or axis is missing, has other dimensions, missing values or unequal spacing.
    """
    needed = [*_DIMS, "current_north", "current_east", "sea_floor_depth"]
    absent = [name for name in needed if name not in ocean.variables]
    if absent:
        raise FleetError(
            f"ocean: the data set lacks {', '.join(absent)}; a local data set has {', '.join(needed)}"
        )
    north, east = _axis(ocean, "north", uniform=True), _axis(ocean, "east", uniform=True)
    depth = _axis(ocean, "depth", uniform=False)
    return Water(
        north=float(north[0]),
        east=float(east[0]),
        per_north=float((north.size - 1) / (north[-1] - north[0])),
        per_east=float((east.size - 1) / (east[-1] - east[0])),
        depth=depth,
        current_north=_variable(ocean, "current_north", _DIMS),
        current_east=_variable(ocean, "current_east", _DIMS),
        floor=_variable(ocean, "sea_floor_depth", _DIMS[:2]),
    )
