"""Conversion of text with a unit, such as ``10 min`` or ``25 kHz``, to a number."""

import math
import re
from fractions import Fraction

_UNITS: dict[str, dict[str, Fraction]] = {
    "10 min": {
        "us": Fraction(1, 1_000_000),
        "µs": Fraction(1, 1_000_000),
        "ms": Fraction(1, 1000),
        "s": Fraction(1),
        "min": Fraction(60),
        "h": Fraction(3600),
        "d": Fraction(86400),
    },
    "2 km": {
        "mm": Fraction(1, 1000),
        "cm": Fraction(1, 100),
        "m": Fraction(1),
        "km": Fraction(1000),
        "nmi": Fraction(1852),
    },
    "3 kn": {
        "cm/s": Fraction(1, 100),
        "m/s": Fraction(1),
        "km/h": Fraction(5, 18),
        "kn": Fraction(1852, 3600),
    },
    "10 deg": {
        "deg": Fraction(1),
        "mrad": Fraction(math.degrees(1.0)) / 1000,
        "rad": Fraction(math.degrees(1.0)),
    },
    "5 deg/s": {
        "deg/h": Fraction(1, 3600),
        "deg/min": Fraction(1, 60),
        "deg/s": Fraction(1),
        "rad/s": Fraction(math.degrees(1.0)),
    },
    "25 kHz": {"Hz": Fraction(1), "kHz": Fraction(1000), "MHz": Fraction(1_000_000)},
}
"""Units of each quantity, by an example; values are factors to a base unit."""
_WORDS = {
    "s": "seconds",
    "h": "hours",
    "d": "days",
    "m": "metres",
    "km": "kilometres",
    "m/s": "metres per second",
    "deg": "degrees",
    "rad": "radians",
    "deg/s": "degrees per second",
    "rad/s": "radians per second",
    "Hz": "hertz",
}
_NUMBER = r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"


def has_units(unit: str) -> bool:
    """Return True if `quantity_of` converts to a unit."""
    return any(unit in units for units in _UNITS.values())


def is_like_quantity(text: str) -> bool:
    """True for a number and a word, such as ``10 m`` and ``3 kg``, which is no file name."""
    return re.fullmatch(r"\s*[+-]?[\d.]+\s*[^\W\d_/.]+(/[^\W\d_/.]+)?\s*", text) is not None


def quantity_of(text: str, unit: str) -> float:
    """
    Convert text with units of a quantity to a number in one unit of that quantity.

    Raises
    ------
    ValueError
        If the text is not such a quantity. The message gives the text and the allowed forms.

    Examples
    --------
    >>> quantity_of("1 h 30 min", "h"), quantity_of("-2 km", "m"), quantity_of("25 kHz", "Hz")
    (1.5, -2000.0, 25000.0)
    """
    example, units = next((example, units) for example, units in _UNITS.items() if unit in units)
    part = rf"({_NUMBER})\s*({'|'.join(units)})"
    match = re.fullmatch(rf"\s*([+-]?)\s*((?:{part}\s*)+)", text)
    if not match or len(text) > 1000:
        raise ValueError(
            f"found {text[:100]!r}; allowed: a number of {_WORDS[unit]}, or text such as"
            f' "{example}" (units {", ".join(units)})'
        )
    total = sum(Fraction(number) * units[name] for number, name in re.findall(part, match[2]))
    try:
        return float(-total / units[unit] if match[1] == "-" else total / units[unit])
    except OverflowError:
        return math.copysign(math.inf, -1.0 if match[1] == "-" else 1.0)
