"""
Sound speed and density of sea water by TEOS-10 (gsw), or sound speed by another equation.

References
----------
.. [1] McDougall, T. J. and Barker, P. M. (2011), Getting started with TEOS-10 and the Gibbs
   Seawater (GSW) Oceanographic Toolbox, SCOR/IAPSO WG127.
"""

from __future__ import annotations

import gsw
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.ocean.equations import EQUATIONS, check_equation
from pymantaray.ocean.names import Equation

SUPERCOOLED = 0.05
"""Water further below its freezing point has a wrong temperature or salinity. [K]"""
UNFROZEN = "salinity or temperature is too low; calibrate it, or use another source"
"""Remedy for such water."""
TOO_COLD = "too cold to be liquid"
"""Words of the note about such water."""


def absolute_and_conservative(
    temperature: ArrayLike, salinity: ArrayLike, depth: ArrayLike, lat: ArrayLike, lon: ArrayLike
) -> tuple[Array, Array, Array]:
    """
    Absolute salinity [g/kg], conservative temperature [degC] and sea pressure [dbar] from the
    arguments of `sound_speed`.
    """
    p = gsw.p_from_z(-np.asarray(depth, dtype=float), lat)
    SA = gsw.SA_from_SP(salinity, p, lon, lat)
    return SA, gsw.CT_from_t(SA, temperature, p), np.broadcast_to(p, np.shape(SA))


def sound_speed(
    temperature: ArrayLike,
    salinity: ArrayLike,
    depth: ArrayLike,
    lat: ArrayLike,
    lon: ArrayLike,
    *,
    equation: Equation = "teos-10",
) -> Array:
    """
    Sound speed from in-situ temperature, practical salinity, depth and place.

    Parameters
    ----------
    temperature : array_like, shape (...)
        In-situ temperature, ITS-90. NaN gives NaN. [degC]
    salinity : array_like, shape (...)
        Practical salinity. [-]
    depth : array_like, shape (...)
        Depth, positive down. [m]
    lat, lon : array_like, shape (...)
        Place. All arguments broadcast. [degrees]
    equation : str
        Key of `pymantaray.ocean.equations.EQUATIONS`. All use pressure from depth by TEOS-10.

    Returns
    -------
    ndarray, shape (...)
        Sound speed. [m/s]

    Examples
    --------
    >>> print(f"{float(sound_speed(-1.2, 27.4, 10.0, 74.5, -140.0)):.1f}")
    1433.3
    """
    check_equation(equation)
    p = gsw.p_from_z(-np.asarray(depth, dtype=float), lat)
    return EQUATIONS[equation].sound_speed(temperature, salinity, p, lat, lon)


def gridded_water(ocean: xr.Dataset) -> tuple[Array, ...]:
    """
    Temperature, salinity, depth, latitude and longitude of an ocean, which broadcast to its grid.
    """
    names = ("water_temp", "salinity", "depth", "lat", "lon")
    temperature, salinity, depth, lat, lon = (ocean[name].values for name in names)
    return temperature, salinity, depth[:, None, None], lat[:, None], lon


def ocean_sound_speed(ocean: xr.Dataset, *, equation: Equation = "teos-10") -> Array:
    """
    Sound speed (depth, lat, lon) of a valid ocean at its grid points; NaN below the sea bed. [m/s]
    """
    return sound_speed(*gridded_water(ocean), equation=equation)


def density_fall(ocean: xr.Dataset) -> Array:
    """
    Density of the upper minus the lower water of each pair of levels (depth - 1, lat, lon) of a
    valid ocean. [kg/m3]

    Both densities are at the pressure between the levels. Positive values mean unstable pairs. NaN
    below the sea bed.
    """
    SA, CT, p = absolute_and_conservative(*gridded_water(ocean))
    between = 0.5 * (p[1:] + p[:-1])
    return np.asarray(gsw.rho(SA[:-1], CT[:-1], between) - gsw.rho(SA[1:], CT[1:], between))


def density(
    temperature: ArrayLike, salinity: ArrayLike, depth: ArrayLike, lat: ArrayLike, lon: ArrayLike
) -> Array:
    """In-situ density [kg/m3] from the arguments of `sound_speed`; NaN gives NaN."""
    SA, CT, p = absolute_and_conservative(temperature, salinity, depth, lat, lon)
    return np.asarray(gsw.rho(SA, CT, p), dtype=float)


def supercooling(
    temperature: ArrayLike, salinity: ArrayLike, depth: ArrayLike, lat: ArrayLike, lon: ArrayLike
) -> Array:
    """
    In-situ freezing point of air-free water minus its temperature, from the arguments of
    `sound_speed`. [K]

    The function uses TEOS-10 (``gsw.t_freezing``). Water saturated with air freezes at a
    temperature 0.002 K lower.
    """
    p = gsw.p_from_z(-np.asarray(depth, dtype=float), lat)
    SA = gsw.SA_from_SP(salinity, p, lon, lat)
    return np.asarray(
        gsw.t_freezing(SA, p, 0.0) - np.asarray(temperature, dtype=float), dtype=float
    )


def freezing_notes(
    temperature: Array, salinity: Array, depth: Array, lat: float, lon: float
) -> tuple[str, ...]:
    """
    Note about water of a profile that is too cold to be liquid, from the arguments of
    `sound_speed`; empty if there is none.
    """
    cold = supercooling(temperature, salinity, depth, lat, lon)
    count = int(np.count_nonzero(cold > SUPERCOOLED))
    if not count:
        return ()
    worst = int(np.nanargmax(cold))
    where = f"{cold[worst]:.2g} K below freezing at {depth[worst]:.4g} m"
    note = (
        f"{count} of {cold.size} levels {TOO_COLD}, up to {where}: {UNFROZEN}, or repair the"
        " salinity with `repair_freezing`"
    )
    return (note,)


def repair_salinity(
    temperature: Array, salinity: Array, depth: Array, lat: float, lon: float
) -> tuple[Array, tuple[str, ...]]:
    """
    Raise the salinity of water below its freezing point to that of the freezing line.

    Water under ice is at most at its freezing point, and a conductivity cell with ice or bubbles
    reads too low. The temperature is kept; the salinity becomes that of water that freezes at it
    (``gsw.SA_freezing_from_t``, without air).

    Parameters
    ----------
    temperature, salinity, depth, lat, lon
        As in `sound_speed`, of one profile.

    Returns
    -------
    salinity : ndarray, shape (n_levels,)
        Practical salinity, unchanged at other levels. [-]
    notes : tuple of str
        Number of repaired levels and the largest change; empty without a repair.
    """
    p = gsw.p_from_z(-np.asarray(depth, dtype=float), lat)
    cold = np.flatnonzero(supercooling(temperature, salinity, depth, lat, lon) > 0.0)
    if not cold.size:
        return salinity, ()
    SA = gsw.SA_freezing_from_t(temperature[cold], p[cold], 0.0)
    repaired = np.array(salinity, dtype=float)
    repaired[cold] = gsw.SP_from_SA(SA, p[cold], lon, lat)
    change = float(np.max(repaired - salinity))
    note = (
        f"{cold.size} of {repaired.size} levels below the freezing point repaired: salinity raised"
        f" by up to {change:.2g}"
    )
    return repaired, (note,)


def in_situ_temperature(
    potential_temperature: ArrayLike,
    salinity: ArrayLike,
    depth: ArrayLike,
    lat: ArrayLike,
    lon: ArrayLike,
) -> Array:
    """
    In-situ temperature [degC] from potential temperature [degC] referred to the surface, 0 dbar.
    """
    p = gsw.p_from_z(-np.asarray(depth, dtype=float), lat)
    SA = gsw.SA_from_SP(salinity, p, lon, lat)
    # adiabatic change from 0 dbar to p: the same routine with exchanged pressures
    return np.asarray(gsw.pt_from_t(SA, potential_temperature, 0.0, p), dtype=float)
