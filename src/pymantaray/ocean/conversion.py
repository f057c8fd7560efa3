"""In-situ temperature and practical salinity at fixed depths from what a data set delivers instead."""

import gsw
import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError
from pymantaray.ocean import cf, units
from pymantaray.ocean.files import StoredFile

Array = NDArray[np.float64]
_AT_SURFACE = 1e-3  # m; a first level this close to 0 m is the surface
_DEEPEST_FIRST_LEVEL = 30.0  # m, that is carried up to the surface
_LEAST_SALINITY = 0.06  # a whole ocean below is kg/kg under a wrong unit


def levels(file: StoredFile, name: str) -> tuple[Array, bool]:
    """
    Vertical axis, positive down, in the order of the file.

    Parameters
    ----------
    file : StoredFile
    name : str
        Of the coordinate.

    Returns
    -------
    values : ndarray, shape (depth,)
        [m] or [dbar]
    is_pressure : bool

    Raises
    ------
    OceanError
        If units and direction do not say which way is down, or a level is above the surface.
    """
    axis = file.variables[name]
    unit, where = axis.text("units"), f"{file.name}: {name}"
    if units.is_unit_of("pressure", unit) or axis.text("standard_name").startswith("sea_water_pressure"):
        return _from_surface(
            units.convert(file.values(name), "pressure", unit, where=where), where, "dbar"
        ), True
    values = units.convert(file.values(name), "length", unit, where=where)
    positive = (axis.text("positive") or axis.text("_CoordinateZisPositive")).lower()
    if axis.text("standard_name") in ("height", "altitude", "height_above_mean_sea_level"):
        positive = positive or "up"
    negative = bool(values.size) and bool(np.all(values <= 0.0)) and bool(np.any(values < 0.0))
    if positive == "down" and negative:
        raise OceanError(
            f"{where} is called positive down but is negative; correct the sign or the attribute"
        )
    return _from_surface(
        -values if positive == "up" or (negative and not positive) else values, where, "m"
    ), False


def _from_surface(values: Array, where: str, unit: str) -> Array:
    if values.size == 0 or not np.all(np.isfinite(values)):
        raise OceanError(f"{where} is empty or has values that are missing or not finite; correct the axis")
    if values.min() < -_AT_SURFACE:
        raise OceanError(
            f"{where} has a level {-values.min():g} {unit} above the surface; check its attribute positive"
        )
    return np.asarray(np.where(np.abs(values) <= _AT_SURFACE, 0.0, values), dtype=float)


def to_in_situ_and_practical(
    temperature: Array, t_kind: str, salinity: Array, s_kind: str, pressure: Array, lat: Array, lon: Array
) -> tuple[Array, Array]:
    """
    In-situ temperature and practical salinity by TEOS-10.

    Parameters
    ----------
    temperature : ndarray, shape (depth, lat, lon)
        In situ, potential (referred to 0 dbar) or conservative. [degC]
    t_kind : str
    salinity : ndarray, shape (depth, lat, lon)
        Practical [-]; absolute, reference or preformed [g/kg].
    s_kind : str
    pressure : ndarray, broadcastable to (depth, lat, lon)
        Sea pressure. [dbar]
    lat, lon : ndarray, shapes (lat,), (lon,)
        [degrees]

    Returns
    -------
    temperature, salinity : ndarray, shape (depth, lat, lon)
        [degC], [-]; the arrays given where nothing is to be done.

    References
    ----------
    .. [1] McDougall, T. J. and Barker, P. M. (2011), Getting started with TEOS-10 and the Gibbs Seawater
       (GSW) Oceanographic Toolbox, SCOR/IAPSO WG127.
    """
    place = (pressure, lon, lat[:, None])
    with np.errstate(all="ignore"):
        if s_kind == cf.PRACTICAL:
            practical = salinity
        elif s_kind == cf.ABSOLUTE:
            practical = gsw.SP_from_SA(salinity, *place)
        elif s_kind == cf.REFERENCE:
            practical = gsw.SP_from_SR(salinity)
        else:
            practical = gsw.SP_from_Sstar(salinity, *place)
        if t_kind == cf.IN_SITU:
            return temperature, practical
        absolute = salinity if s_kind == cf.ABSOLUTE else gsw.SA_from_SP(practical, *place)
        if t_kind == cf.CONSERVATIVE:
            return np.asarray(gsw.t_from_CT(absolute, temperature, pressure), dtype=float), practical
        return np.asarray(gsw.pt_from_t(absolute, temperature, 0.0, pressure), dtype=float), practical


def check_salinity_unit(salinity: Array, where: str) -> None:
    """
    Refuse salinity in kg/kg whose unit says that it is practical.

    Parameters
    ----------
    salinity : ndarray
    where : str
        File and variable, for the message.

    Raises
    ------
    OceanError
    """
    wet = salinity[np.isfinite(salinity)]
    if wet.size and 0.0 < wet.max() < _LEAST_SALINITY:
        raise OceanError(
            f"{where} is {wet.max():.3g} at most, which looks like kg/kg; set units to 'kg kg-1' and the"
            " standard_name to sea_water_absolute_salinity, or multiply by 1000"
        )


def to_fixed_depths(
    fields: dict[str, Array], pressure: Array, lat: Array
) -> tuple[Array, dict[str, Array], float]:
    """
    Move fields from levels of pressure to the depths these have at the middle latitude.

    Parameters
    ----------
    fields : dict of str to ndarray, shape (depth, lat, lon)
    pressure : ndarray, shape (depth,)
        Rising. [dbar]
    lat : ndarray, shape (lat,)
        [degrees]

    Returns
    -------
    depth : ndarray, shape (depth,)
        [m]
    fields : dict of str to ndarray
        Interpolated linearly; a value whose neighbour is missing is kept.
    moved : float
        Largest move. [m]
    """
    depth = -np.asarray(gsw.z_from_p(pressure, 0.5 * (lat[0] + lat[-1])), dtype=float)
    depth[pressure == 0.0] = 0.0
    actual = -np.asarray(gsw.z_from_p(pressure[:, None], lat), dtype=float)
    shift = (depth[:, None] - actual)[..., None]
    result = {}
    for name, field in fields.items():
        slope = np.diff(field, axis=0) / np.diff(actual, axis=0)[..., None]
        below = np.concatenate([slope, np.zeros_like(field[:1])])
        above = np.concatenate([np.zeros_like(field[:1]), slope])
        step = np.where(shift > 0.0, below, above) * shift
        result[name] = field + np.where(np.isfinite(step), step, 0.0)
    return depth, result, float(np.max(np.abs(shift)))


def up_to_surface(depth: Array, fields: dict[str, Array], where: str) -> tuple[Array, dict[str, Array]]:
    """
    Add a level at 0 m with the values of the first one, where that is deeper.

    Parameters
    ----------
    depth : ndarray, shape (depth,)
        Rising. [m]
    fields : dict of str to ndarray, shape (depth, lat, lon)
    where : str
        For the message.

    Returns
    -------
    depth, fields
        As given where the first level is at 0 m.

    Raises
    ------
    OceanError
        If the first level is too deep to stand for the surface.
    """
    if depth[0] == 0.0:
        return depth, fields
    if depth[0] > _DEEPEST_FIRST_LEVEL:
        raise OceanError(
            f"{where}: the first level is at {depth[0]:g} m; up to {_DEEPEST_FIRST_LEVEL:g} m it is carried up to"
            " the surface, beyond that write the levels above it yourself"
        )
    return np.concatenate([[0.0], depth]), {n: np.concatenate([f[:1], f]) for n, f in fields.items()}
