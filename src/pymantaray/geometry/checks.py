"""Numbers and arrays from outside: each folder refuses them by its own error, all in the same words."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import MantaRayError

Array = NDArray[np.float64]
Error = type[MantaRayError]


def check_number(error: Error, name: str, value: float, unit: str = "", *, positive: bool = False) -> None:
    """Refuse a number that is not finite and positive, or not negative."""
    if not math.isfinite(value) or value < 0.0 or (positive and value == 0.0):
        allowed = "positive" if positive else "zero or positive"
        raise error(f"{name} is {f'{value:g} {unit}'.rstrip()}; it must be finite and {allowed}")


def told_apart(*values: float) -> list[str]:
    """Numbers that a refusal compares: of six digits, or of as many as different ones need to look different."""
    different = len(set(values))
    digits = next((n for n in range(6, 17) if len({f"{v:.{n}g}" for v in values}) == different), 17)
    return [f"{v:.{digits}g}" for v in values]


def check_fields(error: Error, model: object, unit: str, *names: str, positive: bool = False) -> None:
    """Refuse numbers in fields of a model, see `check_number`."""
    for name in names:
        check_number(error, f"{type(model).__name__}: {name}", getattr(model, name), unit, positive=positive)


def checked_array(
    error: Error, name: str, values: ArrayLike, shape: tuple[int | None, ...], *, rising: bool = False
) -> Array:
    """Finite values as a read-only array of a shape, None for any length but 0; a rising one increases strictly."""
    array = np.array(values, dtype=float, order="C")
    fits = len(shape) == array.ndim and all(
        have == want or (want is None and have > 0) for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        needed = ", ".join("n" if size is None else str(size) for size in shape)
        raise error(f"{name}: shape {array.shape}; it needs ({needed}{',' * (len(shape) == 1)})")
    if missing := np.count_nonzero(~np.isfinite(array)):
        raise error(f"{name}: {missing} values are not finite; fill them, or leave them out")
    if rising and np.any(np.diff(array) <= 0.0):
        first = array[:-1][np.diff(array) <= 0.0][0]
        raise error(f"{name}: it must strictly increase; it does not after {first:g}")
    array.setflags(write=False)
    return array
