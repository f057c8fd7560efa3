"""Conversion of longitudes between windows of 360 degrees."""

from typing import TypeVar

import numpy as np

from pymantaray.arrays import Array, Indices

Degrees = TypeVar("Degrees", float, Array)


def wrap_longitude(lon: Degrees, about: float = 0.0) -> Degrees:
    """Longitudes within 180 degrees of a meridian, in [about - 180, about + 180). [degrees]"""
    return about + (lon - about + 180.0) % 360.0 - 180.0


def whole_turns(lon: float, about: float = 0.0) -> float:
    """Multiple of 360 to subtract from longitudes about ``lon`` to centre them. [degrees]"""
    return float(360.0 * np.floor((lon - about + 180.0) / 360.0))


def eastward(west: float, east: float) -> float:
    """East side of a window, plus 360 if it is not greater than the west side. [degrees]"""
    return east if east > west else east + 360.0


def contiguous(lon: Array) -> tuple[Indices, Array]:
    """
    Order that makes longitudes increase across any seam, and the sorted longitudes. [degrees]

    Each meridian is included once. The middle of the sorted longitudes is in -180 to 180.
    """
    positive = lon % 360.0
    order = np.argsort(positive, kind="stable")
    gaps = np.diff(positive[order], append=positive[order[0]] + 360.0)
    if len(order) > 1 and np.any(gaps < 1e-6):
        order = order[gaps >= 1e-6]
        gaps = np.diff(positive[order], append=positive[order[0]] + 360.0)
    order = np.roll(order, -(int(np.argmax(gaps)) + 1))  # start after the widest gap
    rising = np.unwrap(positive[order], period=360.0)
    rising -= whole_turns(0.5 * (rising[0] + rising[-1]))
    original = lon[order]
    # adding whole turns to the input keeps all of its digits
    return order, original + 360.0 * np.round((rising - original) / 360.0)
