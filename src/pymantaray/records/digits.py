"""Numbers as readers see them: the same digits in the terminal, in notebooks and on pages."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pymantaray.arrays import Array

MISSING = "–"
_MINUS = "−"
_LARGE = 1e5  # numbers from here on have no decimals, and an exponent
_HUGE = 1e7
_MAX_DECIMALS = 5  # to give the smallest number a digit
_MAX_DIGITS = 8  # of a number written without an exponent
_EXPONENT = ".3e"


def show(value: Any) -> str:
    """
    Text of one value.

    A measured number has four digits, a count has all digits, and a missing value is a dash.
    """
    if value is None:
        return MISSING
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return f"{int(value):,}".replace("-", _MINUS)
    if not isinstance(value, float | np.floating):
        return str(value)
    size = abs(float(value))
    if np.isnan(size):
        return MISSING
    if size == 0.0 or 1e-3 <= size < 1e4:
        text = f"{value:.4g}"
    elif 1e4 <= size < _HUGE:
        text = f"{value:,.0f}"
    else:
        text = f"{value:{_EXPONENT}}"
    return text.replace("-", _MINUS)


def show_alike(values: Sequence[Any], form: str | None = None) -> list[str]:
    """
    Text of each value of one quantity.

    Measured numbers have one format, by default that of `number_format`.
    """
    form = number_format(measured_numbers(values)) if form is None else form
    return [
        f"{value:z{form}}".replace("-", _MINUS)
        if form and isinstance(value, float | np.floating) and np.isfinite(value)
        else show(value)
        for value in values
    ]


def show_row(values: Sequence[Any]) -> list[str]:
    """Text of each value of a row with one quantity; a single number has four digits."""
    if measured_numbers(values).size > 1:
        return show_alike(values)
    return [show(value) for value in values]


def measured_numbers(values: Sequence[Any]) -> Array:
    """Finite floating-point numbers among some values."""
    return np.array(
        [
            value
            for value in values
            if isinstance(value, float | np.floating) and np.isfinite(value)
        ],
        dtype=float,
    )


def number_format(numbers: Array) -> str:
    """
    Format for all numbers of one quantity, which then have equal decimals.

    The largest has four digits and at least two decimals, if each number but 0 then shows a digit.
    Otherwise it has as many decimals as the smallest needs, or an exponent if these are too many.
    """
    if (form := compact_format(numbers)) is not None:
        return form
    sizes = np.abs(numbers[numbers != 0.0])
    decimals = max(-int(np.floor(np.log10(sizes.min()))), 0)
    digits = max(int(np.floor(np.log10(sizes.max()))), 0) + 1 + decimals
    return f",.{decimals}f" if decimals <= _MAX_DECIMALS and digits <= _MAX_DIGITS else _EXPONENT


def compact_format(numbers: Array) -> str | None:
    """
    Format in which the largest number has four digits, and at least two decimals.

    None if a number would then show no digit.
    """
    sizes = np.abs(numbers[numbers != 0.0])
    if not sizes.size:
        return ",.0f"
    if sizes.max() >= _HUGE:
        return None
    if sizes.max() >= _LARGE or (numbers == np.round(numbers)).all():
        decimals = 0
    else:
        decimals = max(2, 3 - int(np.floor(np.log10(sizes.max()))))
    return f",.{decimals}f" if (sizes >= 0.5 * 10.0**-decimals).all() else None


def metres(value: float) -> str:
    """Number with its unit and two decimals, a dash for a missing value."""
    return f"{value:,.2f} m".replace("-", _MINUS) if np.isfinite(value) else MISSING


def signed_metres(value: float) -> str:
    """Number with its sign, its unit and two decimals, a dash for a missing value."""
    return f"{value:+,.2f} m".replace("-", _MINUS) if np.isfinite(value) else MISSING


def plain_signs(text: str) -> str:
    """Text with hyphens as minus signs, which all terminals and programs can read."""
    return text.replace(_MINUS, "-").replace(MISSING, "-")


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless the number is 1."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
