"""Longitudes: counted from any meridian, in any window of 360 degrees. The one place that turns them."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Degrees = TypeVar("Degrees", float, Array)


def wrapped(lon: Degrees, about: float = 0.0) -> Degrees:
    """Longitudes within 180 degrees of a meridian: from ``about - 180``, which counts, to ``about + 180``. [degrees]"""
    return about + (lon - about + 180.0) % 360.0 - 180.0


def whole_turns(lon: float, about: float = 0.0) -> float:
    """Multiple of 360 to subtract from an axis whose middle is ``lon``, so that it lies about a meridian. [degrees]"""
    return float(360.0 * np.floor((lon - about + 180.0) / 360.0))


def eastward(west: float, east: float) -> float:
    """East side of a window counted so that it lies east of the west side, also across the antimeridian. [degrees]"""
    return east if east > west else east + 360.0


def contiguous(lon: Array) -> tuple[NDArray[np.intp], Array]:
    """Order that puts longitudes in a row across any seam, each once, and so rising, their middle in -180 to 180. [degrees]"""
    turned = lon % 360.0
    order = np.argsort(turned, kind="stable")
    gaps = np.diff(turned[order], append=turned[order[0]] + 360.0)
    if len(order) > 1 and np.any(gaps < 1e-6):
        order = order[gaps >= 1e-6]
        gaps = np.diff(turned[order], append=turned[order[0]] + 360.0)
    order = np.roll(order, -(int(np.argmax(gaps)) + 1))  # begin after the widest gap
    rising = np.unwrap(turned[order], period=360.0)
    rising -= whole_turns(0.5 * (rising[0] + rising[-1]))
    own = lon[order]
    return order, own + 360.0 * np.round((rising - own) / 360.0)  # not a digit is lost on the way
