"""What is peculiar to HYCOM's files: variable names, a scaled fill value, longitudes of either convention."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# where a server has scaled the fill value like data: -30000 x 0.001, plus 20 for tracers
_SCALED_FILL = {"water_temp": -10.0, "salinity": -10.0, "water_u": -30.0, "water_v": -30.0}
HYCOM_NAMES = tuple(_SCALED_FILL)
"""Names that mean in-situ temperature, practical salinity, currents east and north."""
SAME_DEGREES = 1e-3
"""HYCOM's coordinates are off the exact grid by 3e-5. [degrees]"""


def without_scaled_fill(name: str, values: Array) -> Array:
    """
    Mask the fill value where a server has scaled it like data.

    Parameters
    ----------
    name : str
        Of HYCOM's variable; others are left alone.
    values : ndarray

    Returns
    -------
    ndarray
    """
    if name not in _SCALED_FILL:
        return values
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(values - _SCALED_FILL[name]) < 1e-3, np.nan, values)


def contiguous(lon: Array) -> tuple[NDArray[np.intp], Array]:
    """
    Order that puts longitudes in a row across any seam, and their values in that order.

    Parameters
    ----------
    lon : ndarray, shape (lon,)
        Counted in any way; one meridian may be there twice. [degrees]

    Returns
    -------
    order : ndarray of int, shape (n,)
        A meridian that was there twice is there once.
    lon : ndarray, shape (n,)
        Rising, with the middle in -180 to 180. [degrees]
    """
    turned = lon % 360.0
    order = np.argsort(turned, kind="stable")
    gaps = np.diff(turned[order], append=turned[order[0]] + 360.0)
    if len(order) > 1 and np.any(gaps < 1e-6):
        order = order[gaps >= 1e-6]
        gaps = np.diff(turned[order], append=turned[order[0]] + 360.0)
    order = np.roll(order, -(int(np.argmax(gaps)) + 1))  # begin after the widest gap
    rising = np.unwrap(turned[order], period=360.0)
    middle = 0.5 * (rising[0] + rising[-1])
    return order, rising - 360.0 * np.floor((middle + 180.0) / 360.0)
