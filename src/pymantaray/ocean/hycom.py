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
