"""
Sound speed and density of sea water by TEOS-10 (gsw), and two older equations of sound speed.

References
----------
.. [1] McDougall, T. J. and Barker, P. M. (2011), Getting started with TEOS-10 and the Gibbs Seawater (GSW) Oceanographic
   Toolbox, SCOR/IAPSO WG127.
.. [2] Del Grosso, V. A. (1974), New equation for the speed of sound in natural waters, J. Acoust. Soc. Am. 56, 1084-1091.
.. [3] Chen, C.-T. and Millero, F. J. (1977), Speed of sound in seawater at high pressures, J. Acoust. Soc. Am. 62,
   1129-1135; UNESCO Technical Papers in Marine Science 44, whose check value and table were read in secondary sources.
.. [4] Wong, G. S. K. and Zhu, S. (1995), Speed of sound in seawater as a function of salinity, temperature, and pressure,
   J. Acoust. Soc. Am. 97, 1732-1736. The abstract was read; the coefficients are those of the National Physical Laboratory's
   technical guide, as reprinted in several codes.
"""

from __future__ import annotations

from typing import Literal, get_args

import gsw
import numpy as np
import xarray as xr
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import OceanError

Equation = Literal["teos-10", "del-grosso", "unesco"]
_DBAR_PER_KGF_CM2 = 9.80665
SUPERCOOLED = 0.05
"""Water further below its freezing point has a wrong temperature or salinity. [K]"""
UNFROZEN = "salinity or temperature is too low; calibrate it, or use another source"
"""Remedy for such water."""
TOO_COLD = "too cold to be liquid"
"""Words of the note about such water."""

# Del Grosso's form from [4] for ITS-90: (power of S, of T, of P) and coefficient; P in kgf/cm2
_DEL_GROSSO = (
    (0, 0, 0, 1402.392),
    (0, 1, 0, 0.5012285e1),
    (0, 2, 0, -0.551184e-1),
    (0, 3, 0, 0.221649e-3),
    (1, 0, 0, 0.1329530e1),
    (2, 0, 0, 0.1288598e-3),
    (0, 0, 1, 0.1560592),
    (0, 0, 2, 0.2449993e-4),
    (0, 0, 3, -0.8833959e-8),
    (1, 1, 0, -0.1275936e-1),
    (0, 1, 1, 0.6353509e-2),
    (0, 2, 2, 0.2656174e-7),
    (0, 1, 2, -0.1593895e-5),
    (0, 1, 3, 0.5222483e-9),
    (0, 3, 1, -0.4383615e-6),
    (2, 0, 2, -0.1616745e-8),
    (1, 2, 0, 0.9688441e-4),
    (2, 1, 1, 0.4857614e-5),
    (1, 1, 1, -0.3406824e-3),
)
# Chen and Millero's form from [4]: [power of P, of T], P in bar, for S^0, S^1, S^3/2 and S^2
_PURE_WATER = np.array(
    [
        [1402.388, 5.03830, -5.81090e-2, 3.3432e-4, -1.47797e-6, 3.1419e-9],
        [0.153563, 6.8999e-4, -8.1829e-6, 1.3632e-7, -6.1260e-10, 0.0],
        [3.1260e-5, -1.7111e-6, 2.5986e-8, -2.5353e-10, 1.0415e-12, 0.0],
        [-9.7729e-9, 3.8513e-10, -2.3654e-12, 0.0, 0.0, 0.0],
    ]
)
_LINEAR = np.array(
    [
        [1.389, -1.262e-2, 7.166e-5, 2.008e-6, -3.21e-8],
        [9.4742e-5, -1.2583e-5, -6.4928e-8, 1.0515e-8, -2.0142e-10],
        [-3.9064e-7, 9.1061e-9, -1.6009e-10, 7.994e-12, 0.0],
        [1.100e-10, 6.651e-12, -3.391e-13, 0.0, 0.0],
    ]
)
_THREE_HALVES = np.array([[-1.922e-2, -4.42e-5], [7.3637e-5, 1.7950e-7]])
_SQUARE = np.array([[1.727e-3], [-7.9836e-6]])


def absolute_and_conservative(
    temperature: ArrayLike, salinity: ArrayLike, depth: ArrayLike, lat: ArrayLike, lon: ArrayLike
) -> tuple[Array, Array, Array]:
    """Absolute salinity [g/kg], conservative temperature [degC] and sea pressure [dbar] from the arguments of `sound_speed`."""
    p = gsw.p_from_z(-np.asarray(depth, dtype=float), lat)
    SA = gsw.SA_from_SP(salinity, p, lon, lat)
    return SA, gsw.CT_from_t(SA, temperature, p), np.broadcast_to(p, np.shape(SA))


def check_equation(equation: str) -> None:
    """Raise an error for an unknown equation of sound speed."""
    if equation not in get_args(Equation):
        raise OceanError(f"equation {equation!r} is unknown; allowed: {', '.join(get_args(Equation))}")


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
    equation : {"teos-10", "del-grosso", "unesco"}
        The latter two in Wong and Zhu's forms for ITS-90. All use pressure from depth by TEOS-10.

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
    if equation != "teos-10":
        p = gsw.p_from_z(-np.asarray(depth, dtype=float), lat)
        return (del_grosso if equation == "del-grosso" else unesco)(temperature, salinity, p)
    SA, CT, p = absolute_and_conservative(temperature, salinity, depth, lat, lon)
    return np.asarray(gsw.sound_speed(SA, CT, p), dtype=float)


def gridded_water(ocean: xr.Dataset) -> tuple[Array, ...]:
    """Temperature, salinity, depth, latitude and longitude of an ocean, which broadcast to its grid."""
    names = ("water_temp", "salinity", "depth", "lat", "lon")
    temperature, salinity, depth, lat, lon = (ocean[name].values for name in names)
    return temperature, salinity, depth[:, None, None], lat[:, None], lon


def ocean_sound_speed(ocean: xr.Dataset, *, equation: Equation = "teos-10") -> Array:
    """Sound speed (depth, lat, lon) of a valid ocean at its grid points; NaN below the sea bed. [m/s]"""
    return sound_speed(*gridded_water(ocean), equation=equation)


def density_fall(ocean: xr.Dataset) -> Array:
    """
    Density of the upper minus the lower water of each pair of levels (depth - 1, lat, lon) of a valid ocean. [kg/m3]

    Both densities are at the pressure between the levels. Positive values mean unstable pairs. NaN below the sea bed.
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
    In-situ freezing point of air-free water minus its temperature, from the arguments of `sound_speed`. [K]

    The function uses TEOS-10 (``gsw.t_freezing``). Water saturated with air freezes at a temperature 0.002 K lower.
    """
    p = gsw.p_from_z(-np.asarray(depth, dtype=float), lat)
    SA = gsw.SA_from_SP(salinity, p, lon, lat)
    return np.asarray(gsw.t_freezing(SA, p, 0.0) - np.asarray(temperature, dtype=float), dtype=float)


def freezing_notes(
    temperature: Array, salinity: Array, depth: Array, lat: float, lon: float
) -> tuple[str, ...]:
    """Note about water of a profile that is too cold to be liquid, from the arguments of `sound_speed`; empty if there is none."""
    cold = supercooling(temperature, salinity, depth, lat, lon)
    count = int(np.count_nonzero(cold > SUPERCOOLED))
    if not count:
        return ()
    worst = int(np.nanargmax(cold))
    where = f"{cold[worst]:.2g} K below freezing at {depth[worst]:.4g} m"
    note = (
        f"{count} of {cold.size} levels {TOO_COLD}, up to {where}: {UNFROZEN}, or repair the salinity with --repair-freezing"
        " (in Python: repair_freezing)"
    )
    return (note,)


def repair_salinity(
    temperature: Array, salinity: Array, depth: Array, lat: float, lon: float
) -> tuple[Array, tuple[str, ...]]:
    """
    Raise the salinity of water below its freezing point to that of the freezing line.

    Water under ice is at most at its freezing point, and a conductivity cell with ice or bubbles reads too low. The temperature is
    kept; the salinity becomes that of water that freezes at it (``gsw.SA_freezing_from_t``, without air).

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
    note = f"{cold.size} of {repaired.size} levels below the freezing point repaired: salinity raised by up to {change:.2g}"
    return repaired, (note,)


def in_situ_temperature(
    potential_temperature: ArrayLike, salinity: ArrayLike, depth: ArrayLike, lat: ArrayLike, lon: ArrayLike
) -> Array:
    """In-situ temperature [degC] from potential temperature [degC] referred to the surface, 0 dbar."""
    p = gsw.p_from_z(-np.asarray(depth, dtype=float), lat)
    SA = gsw.SA_from_SP(salinity, p, lon, lat)
    # adiabatic change from 0 dbar to p: the same routine with exchanged pressures
    return np.asarray(gsw.pt_from_t(SA, potential_temperature, 0.0, p), dtype=float)


def del_grosso(temperature: ArrayLike, salinity: ArrayLike, pressure: ArrayLike) -> Array:
    """
    Sound speed [m/s] by Del Grosso (1974) from in-situ temperature [degC], practical salinity and sea pressure [dbar].

    The fit is for 0 to 30 degC, salinity 30 to 40 and 0 to 9807 dbar. The function does not enforce these bounds, because the
    polynomial extrapolates smoothly to colder and fresher water, as under Arctic ice.
    """
    T, S, p = (np.asarray(x, dtype=float) for x in (temperature, salinity, pressure))
    P = p / _DBAR_PER_KGF_CM2
    total = np.zeros(np.broadcast_shapes(T.shape, S.shape, P.shape))
    for s, t, q, coefficient in _DEL_GROSSO:
        total = total + coefficient * S**s * T**t * P**q
    return total


def unesco(temperature: ArrayLike, salinity: ArrayLike, pressure: ArrayLike) -> Array:
    """
    Sound speed [m/s] by Chen and Millero (1977) from the arguments of `del_grosso`.

    The fit is for 0 to 40 degC, salinity 0 to 40 and 0 to 10,000 dbar. Other values are extrapolated.
    """
    T, S, p = (np.asarray(x, dtype=float) for x in (temperature, salinity, pressure))
    P = 0.1 * p  # bar; on a grid it varies less than temperature, so its polynomials come first
    pure, linear, three_halves, square = (
        np.asarray(polynomial.polyval(T, polynomial.polyval(P, table), tensor=False))
        for table in (_PURE_WATER, _LINEAR, _THREE_HALVES, _SQUARE)
    )
    return np.asarray(pure + S * (linear + np.sqrt(S) * three_halves + S * square))
