"""An ocean whose sound speed is changed by given amounts, through its temperature and, where that would be none, its salinity."""

from collections.abc import Callable

import gsw
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean.schema import VARIABLES, validate_ocean
from pymantaray.ocean.seawater import Equation, absolute_and_conservative, sound_speed

Array = NDArray[np.float64]
_ACCURACY = 1e-6  # m/s, of the change of sound speed
_STEP = 0.01  # degC, or share of the salinity, for the slope of sound speed
_ITERATIONS = 30
_SALTIEST = 2.0  # times what it is


def change_sound_speed(ocean: xr.Dataset, change: ArrayLike, *, equation: Equation = "teos-10") -> xr.Dataset:
    """
    Ocean whose sound speed is changed by given amounts.

    Parameters
    ----------
    ocean : xarray.Dataset
        A valid ocean.
    change : array_like, shape (depth, lat, lon)
        Values below the sea bed are not used. [m/s]
    equation : {"teos-10", "del-grosso", "unesco"}

    Returns
    -------
    xarray.Dataset
        Right within 1e-6 m/s. Temperature alone is changed; where it would leave the span of a valid ocean it stays at
        its end, and salinity makes the rest.

    Raises
    ------
    OceanError
        If no temperature and salinity that water can have give the sound speed.
    """
    depth, lat, lon = (np.asarray(ocean[n].values, dtype=float) for n in ("depth", "lat", "lon"))
    wet = np.isfinite(ocean["water_temp"].values)
    k, y, x = np.nonzero(wet)
    start = np.asarray(ocean["water_temp"].values, dtype=float)[wet]
    salinity = np.asarray(ocean["salinity"].values, dtype=float)[wet]

    if equation == "teos-10":  # absolute salinity is in proportion to the practical one, and slow to compute
        SA, _, p = absolute_and_conservative(start, salinity, depth[k], lat[y], lon[x])

    def speed(t: Array, share: Array) -> Array:
        """Sound speed at a temperature and a share of the salinity."""
        if equation == "teos-10":
            return np.asarray(gsw.sound_speed(SA * share, gsw.CT_from_t(SA * share, t, p), p))
        return sound_speed(t, salinity * share, depth[k], lat[y], lon[x], equation=equation)

    full = np.ones(start.size)
    target = speed(start, full) + np.broadcast_to(np.asarray(change, dtype=float), wet.shape)[wet]
    temperature = _root(lambda t: speed(t, full), start, target)
    possible = np.clip(temperature, VARIABLES[0].lowest, VARIABLES[0].highest)
    fields = {"water_temp": possible}
    beyond = possible != temperature
    if beyond.any():
        fresh, now = 0.0 * full, speed(possible, full)
        share = _root(
            lambda s: speed(possible, s), full, np.where(beyond, target, now), fresh, _SALTIEST * full
        )
        fields["salinity"] = np.where(beyond, salinity * share, salinity)
    made = ocean.copy()
    for name, values in fields.items():
        field = np.full(wet.shape, np.nan)
        field[wet] = values
        made[name] = ocean[name].copy(data=field)
    try:
        validate_ocean(made)
    except OceanError as error:
        raise OceanError(
            f"{error} (after a change of sound speed; ask for a smaller one, or for rms in the upper water, down_to)"
        ) from None
    return made


def _root(
    speed: Callable[[Array], Array],
    start: Array,
    target: Array,
    low: Array | float = -np.inf,
    high: Array | float = np.inf,
) -> Array:
    """Argument that gives the target, by the secant method from start, element by element, within bounds."""
    base = speed(start)
    slope = (speed(start + _STEP) - base) / _STEP
    value, off = start, target - base
    for _ in range(_ITERATIONS):
        if np.abs(off).max(initial=0.0) < _ACCURACY:
            return value
        step = np.clip(value + off / slope, low, high) - value
        value = value + step
        before, off = off, target - speed(value)
        moved = np.abs(step) > 1e-6
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(moved, (before - off) / step, slope)
    raise OceanError(
        f"ocean: no temperature or salinity changes sound speed as far as {np.nanmax(np.abs(target - base)):.3g} m/s; ask for"
        " less"
    )
