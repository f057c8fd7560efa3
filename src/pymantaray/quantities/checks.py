"""
Checks of numbers and arrays from outside: each folder raises its own error, with the same text.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import MantaRayError

Error = type[MantaRayError]


def check_number(
    error: Error, name: str, value: float, unit: str = "", *, positive: bool = False
) -> None:
    """Raise an error if a number is not finite, negative or, on request, zero."""
    if not math.isfinite(value) or value < 0.0 or (positive and value == 0.0):
        allowed = "positive" if positive else "zero or positive"
        raise error(f"{name} is {f'{value:g} {unit}'.rstrip()}; it must be finite and {allowed}")


def distinct_digits(*values: float) -> list[str]:
    """
    Format numbers that a message compares with six digits, or with as many as different numbers
    need to look different.
    """
    different = len(set(values))
    digits = next((n for n in range(6, 17) if len({f"{v:.{n}g}" for v in values}) == different), 17)
    return [f"{v:.{digits}g}" for v in values]


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
    array = np.array(values, dtype=float, order="C")
    fits = len(shape) == array.ndim and all(
        have == want or (want is None and have > 0)
        for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        needed = ", ".join("n" if size is None else str(size) for size in shape)
        raise error(
            f"{name}: shape is {array.shape}; it must be ({needed}{',' * (len(shape) == 1)})"
        )
    if missing := np.count_nonzero(~np.isfinite(array)):
        raise error(f"{name}: {missing} of {array.size} values are not finite; fill or remove them")
    if rising and np.any(np.diff(array) <= 0.0):
        first = array[:-1][np.diff(array) <= 0.0][0]
        raise error(f"{name}: values do not increase after {first:g}; they must strictly increase")
    array.setflags(write=False)
    return array
