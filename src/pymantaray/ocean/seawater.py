"""Sea water by TEOS-10 (gsw): sound speed and density of what ocean models deliver."""

import gsw
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.ocean.equations import Equation, check_equation, del_grosso, unesco

Array = NDArray[np.float64]


def absolute_and_conservative(
    temperature: ArrayLike, salinity: ArrayLike, depth: ArrayLike, lat: ArrayLike, lon: ArrayLike
) -> tuple[Array, Array, Array]:
    """
    Absolute salinity, conservative temperature and sea pressure of in-situ measurements.

    Parameters
    ----------
    temperature : array_like, shape (...)
        In-situ temperature, ITS-90. [degC]
    salinity : array_like, shape (...)
        Practical salinity. [-]
    depth : array_like, shape (...)
        Positive down. [m]
    lat, lon : array_like, shape (...)
        All arguments broadcast together. [degrees]

    Returns
    -------
    SA : ndarray, shape (...)
        Absolute salinity. [g/kg]
    CT : ndarray, shape (...)
        Conservative temperature. [degC]
    p : ndarray, shape (...)
        Sea pressure. [dbar]

    References
    ----------
    .. [1] McDougall, T. J. and Barker, P. M. (2011), Getting started with TEOS-10 and the Gibbs Seawater
       (GSW) Oceanographic Toolbox, SCOR/IAPSO WG127.
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
    temperature, salinity, depth, lat, lon : array_like, shape (...)
        As in `absolute_and_conservative`; NaN stays NaN.
    equation : {"teos-10", "del-grosso", "unesco"}
        See `pymantaray.ocean.equations` for the latter two. Pressure comes from depth by TEOS-10 in all.

    Returns
    -------
    ndarray, shape (...)
        [m/s]

    Raises
    ------
    OceanError
        If the equation is unknown.

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


def density(
    temperature: ArrayLike, salinity: ArrayLike, depth: ArrayLike, lat: ArrayLike, lon: ArrayLike
) -> Array:
    """
    In-situ density from in-situ temperature, practical salinity, depth and place.

    Parameters
    ----------
    temperature, salinity, depth, lat, lon : array_like, shape (...)
        As in `absolute_and_conservative`; NaN stays NaN.

    Returns
    -------
    ndarray, shape (...)
        [kg/m3]
    """
    SA, CT, p = absolute_and_conservative(temperature, salinity, depth, lat, lon)
    return np.asarray(gsw.rho(SA, CT, p), dtype=float)


def in_situ_temperature(
    potential_temperature: ArrayLike, salinity: ArrayLike, depth: ArrayLike, lat: ArrayLike, lon: ArrayLike
) -> Array:
    """
    In-situ temperature of water whose potential temperature is referred to the surface.

    Parameters
    ----------
    potential_temperature : array_like, shape (...)
        Referred to 0 dbar. [degC]
    salinity, depth, lat, lon : array_like, shape (...)
        As in `absolute_and_conservative`.

    Returns
    -------
    ndarray, shape (...)
        [degC]
    """
    p = gsw.p_from_z(-np.asarray(depth, dtype=float), lat)
    SA = gsw.SA_from_SP(salinity, p, lon, lat)
    # adiabatic move from 0 dbar to p: the same routine with the pressures exchanged
    return np.asarray(gsw.pt_from_t(SA, potential_temperature, 0.0, p), dtype=float)
