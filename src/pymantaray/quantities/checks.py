"""Checks of numbers and arrays from outside, with the same text for the errors of all folders."""

import math

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import MantaRayError
from pymantaray.messages import one_line

Error = type[MantaRayError]
MAGNITUDES = 1e-18, 1e12
"""Standard deviations whose squares leave digits beside others."""


def is_number(value: object) -> bool:
    """True for a number of Python or NumPy."""
    return isinstance(value, int | float | np.number)


def parsed_number(text: str) -> float:
    """Number in a text; ValueError for other text and for Python's ``1_000``."""
    if "_" in text:
        raise ValueError(f"{text[:40]!r} is not a number")
    return float(text)


def check_number(
    error: Error, name: str, value: float, unit: str = "", *, positive: bool = False
) -> None:
    """Raise an error if a number is not finite, negative or, on request, zero."""
    try:
        finite = math.isfinite(value)
    except (TypeError, OverflowError):
        raise error(f"{name} is {one_line(repr(value), 40)}; it must be a number") from None
    if not finite or value < 0.0 or (positive and value == 0.0):
        allowed = "positive" if positive else "zero or positive"
        raise error(f"{name} is {f'{value:g} {unit}'.rstrip()}; it must be finite and {allowed}")


def check_magnitudes(error: Error, name: str, *values: float, unit: str = "") -> None:
    """
    Raise an error for a number that is negative or, if it is not 0, so small or so large that its
    square leaves no digits.
    """
    low, high = MAGNITUDES
    for value in values:
        if not (value == 0.0 or low <= value <= high):  # NaN does not pass
            raise error(
                f"{name} is {f'{value:g} {unit}'.rstrip()}; allowed are 0, and {low:g} to {high:g}"
            )


def distinct_digits(*values: float) -> list[str]:
    """Format numbers with at least six digits, and as many as distinguish different numbers."""
    different = len(set(values))
    digits = 6
    while digits < 17 and len({f"{value:.{digits}g}" for value in values}) < different:
        digits += 1
    return [f"{value:.{digits}g}" for value in values]


def check_fields(
    error: Error, model: object, unit: str, *names: str, positive: bool = False
) -> None:
    """Check numbers in fields of a model with `check_number`."""
    for name in names:
        check_number(
            error, f"{type(model).__name__}: {name}", getattr(model, name), unit, positive=positive
        )


def checked_array(
    error: Error,
    name: str,
    values: ArrayLike,
    shape: tuple[int | None, ...],
    *,
    rising: bool = False,
) -> Array:
    """
    Convert finite values to a read-only array and check its shape.

    None in ``shape`` allows any length except 0. With ``rising``, values must strictly increase.
    """
    try:
        array = np.array(values, dtype=float, order="C")
    except (TypeError, ValueError, OverflowError) as problem:
        raise error(f"{name}: not an array of numbers: {one_line(problem, 80)}") from None
    fits = len(shape) == array.ndim and all(
        length == allowed or (allowed is None and length > 0)
        for allowed, length in zip(shape, array.shape, strict=True)
    )
    if not fits:
        sizes = ", ".join("n" if size is None else str(size) for size in shape)
        raise error(
            f"{name}: shape is {array.shape}; it must be ({sizes}{',' * (len(shape) == 1)})"
        )
    if missing := np.count_nonzero(~np.isfinite(array)):
        raise error(f"{name}: {missing} of {array.size} values are not finite; fill or remove them")
    if rising and np.any(np.diff(array) <= 0.0):
        first = array[:-1][np.diff(array) <= 0.0][0]
        raise error(f"{name}: values do not increase after {first:g}; they must strictly increase")
    array.setflags(write=False)
    return array
