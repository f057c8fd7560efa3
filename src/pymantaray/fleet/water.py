"""From a local ocean data set to the arrays that the compiled integrators read."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from pymantaray.errors import FleetError
from pymantaray.fleet._kernel import Water

Array = NDArray[np.float64]

_DIMS = ("north", "east", "depth")
_FLOOR = ("floor_north", "floor_east")
_EDGE = 1e-6  # of the ocean's side; as far as this a sea floor's axis may end inside it


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


def _floor_axes(ocean: xr.Dataset, north: Array, east: Array) -> tuple[Array, Array]:
    """Axes of the sea floor, its own or the ocean's."""
    if not set(_FLOOR) <= set(ocean["sea_floor_depth"].dims):
        return north, east
    axes = _axis(ocean, _FLOOR[0], uniform=True), _axis(ocean, _FLOOR[1], uniform=True)
    for name, axis, whole in zip(_FLOOR, axes, (north, east), strict=True):
        edge = _EDGE * (whole[-1] - whole[0])
        if axis[0] > whole[0] + edge or axis[-1] < whole[-1] - edge:
            raise FleetError(
                f"ocean: axis {name!r} reaches from {axis[0]:g} to {axis[-1]:g} m, the ocean from {whole[0]:g} to"
                f" {whole[-1]:g} m; the sea floor must lie under all of it"
            )
    return axes


def _times(ocean: xr.Dataset) -> Array:
    """Instants of the currents, one where they do not vary. [s]"""
    if "time" not in ocean["current_north"].dims:
        return np.zeros(1)
    time = ocean["time"].values
    if not np.issubdtype(time.dtype, np.number):
        raise FleetError(
            f"ocean: time is of type {time.dtype}; it must count seconds from the mission's start"
        )
    return _axis(ocean, "time", uniform=False)


def water_from_dataset(ocean: xr.Dataset) -> Water:
    """
    Arrays of a local ocean data set for the integrators.

    Parameters
    ----------
    ocean : xarray.Dataset
        Uniform axes ``north`` and ``east``, levels ``depth`` [m]; ``current_north``, ``current_east``
        (north, east, depth) [m s⁻¹], also over ``time`` [s] since the mission's start; ``sea_floor_depth``
        (north, east), or on uniform axes of its own (floor_north, floor_east) [m].

    Returns
    -------
    Water

    Raises
    ------
    FleetError
        If a variable or axis is missing, has other dimensions, missing values or unequal spacing, or the
        sea floor does not lie under all of the ocean.
    """
    needed = [*_DIMS, "current_north", "current_east", "sea_floor_depth"]
    absent = [name for name in needed if name not in ocean.variables]
    if absent:
        raise FleetError(
            f"ocean: the data set lacks {', '.join(absent)}; a local data set has {', '.join(needed)}"
        )
    north, east = _axis(ocean, "north", uniform=True), _axis(ocean, "east", uniform=True)
    depth, time = _axis(ocean, "depth", uniform=False), _times(ocean)
    floor_north, floor_east = _floor_axes(ocean, north, east)
    own = floor_north is not north
    dims = _DIMS if time.size == 1 else ("time", *_DIMS)
    current_north, current_east = (
        _variable(ocean, name, dims).reshape(time.size, north.size, east.size, depth.size)
        for name in ("current_north", "current_east")
    )
    return Water(
        north=float(north[0]),
        east=float(east[0]),
        per_north=_per_metre(north),
        per_east=_per_metre(east),
        depth=depth,
        time=time,
        current_north=current_north,
        current_east=current_east,
        floor_north=float(floor_north[0]),
        floor_east=float(floor_east[0]),
        floor_per_north=_per_metre(floor_north),
        floor_per_east=_per_metre(floor_east),
        floor=_variable(ocean, "sea_floor_depth", _FLOOR if own else _DIMS[:2]),
    )


def _per_metre(axis: Array) -> float:
    """Cells in a metre of a uniform axis."""
    return float((axis.size - 1) / (axis[-1] - axis[0]))
