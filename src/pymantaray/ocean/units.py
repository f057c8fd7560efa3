"""Units of the quantities that an ocean is made of, as data sets spell them, and what turns them to ours."""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pymantaray.errors import OceanError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Unit:
    factor: float
    offset: float = 0.0


def _spelled(factor: float, *spellings: str) -> dict[str, _Unit]:
    return dict.fromkeys(spellings, _Unit(factor))


_CELSIUS = (
    "degc",
    "celsius",
    "degreec",
    "degreesc",
    "degreecelsius",
    "degreescelsius",
    "degcelsius",
    "c",
    "°c",
)
_KELVIN = ("k", "kelvin", "degk", "degreek", "degreeskelvin", "degreekelvin", "degreesk", "kelvins")
_SALINITY = (
    *(
        "1",
        "1e-3",
        "0.001",
        "10^-3",
        "10-3",
        "psu",
        "pss-78",
        "pss78",
        "pss",
        "ppt",
        "g/kg",
        "gkg-1",
        "gkg^-1",
    ),
    *(
        "dimensionless",
        "unitless",
        "none",
        "practicalsalinityunit",
        "practicalsalinityunits",
        "‰",
        "parts/1000",
    ),
)
_METRES = ("m", "meter", "metre", "meters", "metres")
_TABLES: dict[str, dict[str, _Unit]] = {
    "temperature": {
        **_spelled(1.0, *_CELSIUS),
        **dict.fromkeys(_KELVIN, _Unit(1.0, -273.15)),
    },
    "practical salinity": _spelled(1.0, *_SALINITY),
    "mass salinity": {
        **_spelled(1.0, "g/kg", "gkg-1", "gkg^-1", "1e-3", "0.001", "10^-3", "10-3", "ppt", "‰"),
        **_spelled(1000.0, "kg/kg", "kgkg-1", "kgkg^-1"),
    },
    "velocity": {
        **_spelled(1.0, "m/s", "ms-1", "ms^-1", "m.s-1", "m*s-1", "m/sec", "ms**-1"),
        **_spelled(1.0, *(f"{m}/{s}" for m in _METRES for s in ("s", "sec", "second", "seconds"))),
        **_spelled(1.0, *(f"{m}second-1" for m in _METRES)),
        **_spelled(0.01, "cm/s", "cms-1", "cms^-1", "cm.s-1", "centimeter/s", "centimetre/s", "cm/sec"),
        **_spelled(0.001, "mm/s", "mms-1", "mms^-1"),
        **_spelled(1000.0 / 3600.0, "km/h", "kmh-1", "kmhour-1", "km/hour"),
    },
    "length": {
        **_spelled(1.0, *_METRES),
        **_spelled(1000.0, "km", "kilometer", "kilometre", "kilometers", "kilometres"),
        **_spelled(0.01, "cm", "centimeter", "centimetre", "centimeters", "centimetres"),
    },
    "pressure": {
        **_spelled(1.0, "dbar", "decibar", "decibars", "dbars"),
        **_spelled(10.0, "bar", "bars"),
        **_spelled(1e-4, "pa", "pascal", "pascals"),
        **_spelled(1e-2, "hpa", "mbar", "millibar"),
        **_spelled(0.1, "kpa"),
        **_spelled(100.0, "mpa"),
    },
}


def is_unit_of(quantity: str, units: str) -> bool:
    """
    Whether a unit is one of a quantity.

    Parameters
    ----------
    quantity : {"temperature", "practical salinity", "mass salinity", "velocity", "length", "pressure"}
    units : str

    Returns
    -------
    bool
    """
    return _normal(units) in _TABLES[quantity]


def convert(values: Array, quantity: str, units: str, *, where: str) -> Array:
    """
    Values in our unit: degC, practical or g/kg, m/s, m or dbar.

    Parameters
    ----------
    values : ndarray
    quantity : str
        As in `is_unit_of`.
    units : str
        As the data set spells them.
    where : str
        File and variable, for the message.

    Returns
    -------
    ndarray
        The same array where nothing is to be done.

    Raises
    ------
    OceanError
        If the unit is missing or none of the quantity.
    """
    if not units:
        raise OceanError(f"{where} has no units; set its attribute units, as CF has it")
    unit = _TABLES[quantity].get(_normal(units))
    if unit is None:
        known = ", ".join({"temperature": ("degC", "K"), "practical salinity": ("1", "1e-3", "psu", "g/kg"),
                           "mass salinity": ("g kg-1", "kg kg-1"), "velocity": ("m s-1", "cm s-1"),
                           "length": ("m", "km", "cm"), "pressure": ("dbar", "Pa", "bar")}[quantity])  # fmt: skip
        raise OceanError(
            f"{where} has units {units[:40]!r}, not of a {quantity}; known are {known} and the like"
        )
    if unit.factor != 1.0:
        values = values * unit.factor
    return values + unit.offset if unit.offset else values


def _normal(units: str) -> str:
    """Spelling without case, blanks and underscores; ``MPa`` and ``mPa`` are not told apart."""
    return re.sub(r"[\s_]+", "", units.strip().lower())
