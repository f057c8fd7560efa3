"""
Equations of the sound speed of sea water: one entry of a table each.

References
----------
.. [1] Del Grosso, V. A. (1974), New equation for the speed of sound in natural waters, J. Acoust.
   Soc. Am. 56, 1084-1091.
.. [2] Chen, C.-T. and Millero, F. J. (1977), Speed of sound in seawater at high pressures, J.
   Acoust. Soc. Am. 62, 1129-1135; UNESCO Technical Papers in Marine Science 44, whose check value
   and table were read in secondary sources.
.. [3] Wong, G. S. K. and Zhu, S. (1995), Speed of sound in seawater as a function of salinity,
   temperature, and pressure, J. Acoust. Soc. Am. 97, 1732-1736. The abstract was read; the
   coefficients are those of the National Physical Laboratory's technical guide, as reprinted in
   several codes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, get_args

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import OceanError
from pymantaray.ocean.names import Equation

_DBAR_PER_KGF_CM2 = 9.80665

# Del Grosso's form from [3] for ITS-90: (power of S, of T, of P) and coefficient; P in kgf/cm2
_DEL_GROSSO = (
    (0, 0, 0, 1402.392),
    (0, 1, 0, 0.5012285e1),
    (0, 2, 0, -0.551184e-1),
    (0, 3, 0, 0.221649e-3),
    (1, 0, 0, 0.1329530e1),
    (2, 0, 0, 0.1288598e-3),
    (0, 0, 1, 0.1560592),
    (0, 0, 2, 0.2449993e-4),
    (0, 0, 3, -0.8833959e-8),
    (1, 1, 0, -0.1275936e-1),
    (0, 1, 1, 0.6353509e-2),
    (0, 2, 2, 0.2656174e-7),
    (0, 1, 2, -0.1593895e-5),
    (0, 1, 3, 0.5222483e-9),
    (0, 3, 1, -0.4383615e-6),
    (2, 0, 2, -0.1616745e-8),
    (1, 2, 0, 0.9688441e-4),
    (2, 1, 1, 0.4857614e-5),
    (1, 1, 1, -0.3406824e-3),
)
# Chen and Millero's form from [3]: [power of P, of T], P in bar, for S^0, S^1, S^3/2 and S^2
_PURE_WATER = np.array(
    [
        [1402.388, 5.03830, -5.81090e-2, 3.3432e-4, -1.47797e-6, 3.1419e-9],
        [0.153563, 6.8999e-4, -8.1829e-6, 1.3632e-7, -6.1260e-10, 0.0],
        [3.1260e-5, -1.7111e-6, 2.5986e-8, -2.5353e-10, 1.0415e-12, 0.0],
        [-9.7729e-9, 3.8513e-10, -2.3654e-12, 0.0, 0.0, 0.0],
    ]
)
_LINEAR = np.array(
    [
        [1.389, -1.262e-2, 7.166e-5, 2.008e-6, -3.21e-8],
        [9.4742e-5, -1.2583e-5, -6.4928e-8, 1.0515e-8, -2.0142e-10],
        [-3.9064e-7, 9.1061e-9, -1.6009e-10, 7.994e-12, 0.0],
        [1.100e-10, 6.651e-12, -3.391e-13, 0.0, 0.0],
    ]
)
_THREE_HALVES = np.array([[-1.922e-2, -4.42e-5], [7.3637e-5, 1.7950e-7]])
_SQUARE = np.array([[1.727e-3], [-7.9836e-6]])


def check_equation(equation: str) -> None:
    """Raise an error for an unknown equation of sound speed."""
    if equation not in get_args(Equation):
        raise OceanError(
            f"equation {equation!r} is unknown; allowed: {', '.join(get_args(Equation))}"
        )


def del_grosso(
    temperature: ArrayLike, salinity: ArrayLike, pressure: ArrayLike, *_: ArrayLike
) -> Array:
    """
    Sound speed [m/s] by Del Grosso (1974) from in-situ temperature [degC], practical salinity and
    sea pressure [dbar].

    The fit is for 0 to 30 degC, salinity 30 to 40 and 0 to 9807 dbar. The function does not enforce
    these bounds, because the polynomial extrapolates smoothly to colder and fresher water, as under
    Arctic ice.
    """
    T, S, p = (np.asarray(x, dtype=float) for x in (temperature, salinity, pressure))
    P = p / _DBAR_PER_KGF_CM2
    total = np.zeros(np.broadcast_shapes(T.shape, S.shape, P.shape))
    for s, t, q, coefficient in _DEL_GROSSO:
        total = total + coefficient * S**s * T**t * P**q
    return total


def unesco(
    temperature: ArrayLike, salinity: ArrayLike, pressure: ArrayLike, *_: ArrayLike
) -> Array:
    """
    Sound speed [m/s] by Chen and Millero (1977) from the arguments of `del_grosso`.

    The fit is for 0 to 40 degC, salinity 0 to 40 and 0 to 10,000 dbar. Other values are
    extrapolated.
    """
    T, S, p = (np.asarray(x, dtype=float) for x in (temperature, salinity, pressure))
    P = 0.1 * p  # bar; on a grid it varies less than temperature, so its polynomials come first
    pure, linear, three_halves, square = (
        np.asarray(polynomial.polyval(T, polynomial.polyval(P, table), tensor=False))
        for table in (_PURE_WATER, _LINEAR, _THREE_HALVES, _SQUARE)
    )
    return np.asarray(pure + S * (linear + np.sqrt(S) * three_halves + S * square))


def teos_10(
    temperature: ArrayLike, salinity: ArrayLike, pressure: ArrayLike, lat: ArrayLike, lon: ArrayLike
) -> Array:
    """
    Sound speed [m/s] by TEOS-10, whose absolute salinity depends on the place, from the arguments
    of `del_grosso`.
    """
    import gsw

    SA = gsw.SA_from_SP(salinity, pressure, lon, lat)
    return np.asarray(
        gsw.sound_speed(SA, gsw.CT_from_t(SA, temperature, pressure), pressure), dtype=float
    )


class SoundSpeedEquation(NamedTuple):
    """
    Sound speed [m/s] from in-situ temperature [degC], practical salinity, sea pressure [dbar],
    latitude and longitude.
    """

    sound_speed: Callable[[ArrayLike, ArrayLike, ArrayLike, ArrayLike, ArrayLike], Array]
    references: tuple[str, ...]
    """Keys of its publications in ``references.toml``."""


EQUATIONS: dict[Equation, SoundSpeedEquation] = {
    "teos-10": SoundSpeedEquation(teos_10, ("mcdougall2011",)),
    "del-grosso": SoundSpeedEquation(del_grosso, ("delgrosso1974", "wong1995")),
    "unesco": SoundSpeedEquation(unesco, ("chen1977", "wong1995")),
}
"""Equations by name, Del Grosso's and the UNESCO equation in Wong and Zhu's forms for ITS-90."""
