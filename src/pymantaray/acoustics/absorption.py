"""Absorption of sound by sea water: three published formulas, in dB/km."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import AcousticsError

Array = NDArray[np.float64]


def francois_garrison_db_per_km(
    frequency_hz: ArrayLike,
    *,
    temperature: ArrayLike,
    salinity: ArrayLike,
    depth: ArrayLike,
    pH: ArrayLike = 8.0,
    sound_speed: ArrayLike | None = None,
) -> Array:
    r"""
    Absorption by boric acid, magnesium sulphate and water itself, after Francois and Garrison (1982).

    Parameters
    ----------
    frequency_hz : array_like
        [Hz]
    temperature, salinity, depth : array_like
        In situ [degC], practical [-], positive down [m].
    pH : array_like
        On the NBS scale. [-]
    sound_speed : array_like, optional
        By default the paper's own :math:`1412 + 3.21 T + 1.19 S + 0.0167 z`. [m/s]

    Returns
    -------
    ndarray
        All arguments broadcast; NaN stays NaN. [dB/km]

    Raises
    ------
    AcousticsError
        If a frequency is not positive or a salinity negative.

    Notes
    -----
    With f in kHz,
    :math:`\alpha = A_1 f_1 f^2 / (f_1^2 + f^2) + A_2 P_2 f_2 f^2 / (f_2^2 + f^2) + A_3 P_3 f^2`.
    Meant for 0.2 to 1000 kHz. The data behind it, from 10 to 500 kHz: -2 to 22 degC, salinity 30 to 35, 0 to
    3.5 km.

    References
    ----------
    .. [1] Francois, R. E. and Garrison, G. R. (1982), Sound absorption based on ocean measurements, parts I
       and II, J. Acoust. Soc. Am. 72, 896-907 and 1879-1890; coefficients from the manual page of
       mbabsorption (MB-System) and code that agree, the papers themselves were not at hand.
    """
    f, T, S, z = _checked(frequency_hz, temperature, salinity, depth)
    ph = np.asarray(pH, dtype=float)
    c = 1412.0 + 3.21 * T + 1.19 * S + 0.0167 * z if sound_speed is None else np.asarray(sound_speed, float)
    kelvin = 273.0 + T  # the paper's
    f1 = 2.8 * np.sqrt(S / 35.0) * 10.0 ** (4.0 - 1245.0 / kelvin)
    f2 = 8.17 * 10.0 ** (8.0 - 1990.0 / kelvin) / (1.0 + 0.0018 * (S - 35.0))
    a1 = 8.86 / c * 10.0 ** (0.78 * ph - 5.0)
    a2 = 21.44 * S / c * (1.0 + 0.025 * T)
    cold = 4.937e-4 + T * (-2.59e-5 + T * (9.11e-7 - 1.50e-8 * T))
    warm = 3.964e-4 + T * (-1.146e-5 + T * (1.45e-7 - 6.5e-10 * T))
    a3 = np.where(T <= 20.0, cold, warm)
    p2 = 1.0 + z * (-1.37e-4 + 6.2e-9 * z)
    p3 = 1.0 + z * (-3.83e-5 + 4.9e-10 * z)
    # fresh water has no boric acid: f1 = 0 leaves that term 0, f2 > 0 always
    boric, sulphate = a1 * f1 / (f1**2 + f**2), a2 * p2 * f2 / (f2**2 + f**2)
    return np.asarray((boric + sulphate + a3 * p3) * f**2)


def ainslie_mccolm_db_per_km(
    frequency_hz: ArrayLike,
    *,
    temperature: ArrayLike,
    salinity: ArrayLike,
    depth: ArrayLike,
    pH: ArrayLike = 8.0,
) -> Array:
    r"""
    Absorption by the simplified formula of Ainslie and McColm (1998).

    Parameters
    ----------
    frequency_hz : array_like
        [Hz]
    temperature, salinity, depth : array_like
        In situ [degC], practical [-], positive down [m].
    pH : array_like
        [-]

    Returns
    -------
    ndarray
        All arguments broadcast; NaN stays NaN. [dB/km]

    Raises
    ------
    AcousticsError
        If a frequency is not positive or a salinity negative.

    Notes
    -----
    A fit to Francois and Garrison, within 10 % of it from 0.1 to 1000 kHz for -6 to 35 degC at salinity 35,
    pH 8 and the surface, 7.7 to 8.3, 5 to 50 and 0 to 7 km one at a time.

    References
    ----------
    .. [1] Ainslie, M. A. and McColm, J. G. (1998), A simplified formula for viscous and chemical absorption
       in sea water, J. Acoust. Soc. Am. 103, 1671-1672; coefficients from independent codes that agree.
    """
    f, T, S, z = _checked(frequency_hz, temperature, salinity, depth)
    km = z / 1000.0
    f1 = 0.78 * np.sqrt(S / 35.0) * np.exp(T / 26.0)
    f2 = 42.0 * np.exp(T / 17.0)
    boric = 0.106 * f1 / (f1**2 + f**2) * np.exp((np.asarray(pH, dtype=float) - 8.0) / 0.56)
    sulphate = 0.52 * (1.0 + T / 43.0) * (S / 35.0) * f2 / (f2**2 + f**2) * np.exp(-km / 6.0)
    water = 0.00049 * np.exp(-(T / 27.0 + km / 17.0))
    return np.asarray((boric + sulphate + water) * f**2)


def thorp_db_per_km(frequency_hz: ArrayLike) -> Array:
    r"""
    Absorption by Thorp's formula as Jensen et al. and Bellhop use it.

    Parameters
    ----------
    frequency_hz : array_like, shape (...)
        [Hz]

    Returns
    -------
    ndarray, shape (...)
        [dB/km]

    Raises
    ------
    AcousticsError
        If a frequency is not positive.

    Notes
    -----
    With f in kHz, :math:`0.0033 + 0.11 f^2/(1+f^2) + 44 f^2/(4100+f^2) + 0.0003 f^2`. Quoted for about
    4 degC and 1000 m; against the other two formulas at 4 degC it is within 12 % at the surface from 0.5 to
    30 kHz and up to 25 % too high at 1000 m. Thorp (1967) printed the two relaxations only, 0.1 and 40 dB per
    kiloyard.

    References
    ----------
    .. [1] Thorp, W. H. (1967), J. Acoust. Soc. Am. 42, 270; extended as in Jensen et al., Computational
       Ocean Acoustics, 1994, eq. 1.34; coefficients from the documentation of USML.
    """
    f = _checked(frequency_hz)[0] ** 2
    return np.asarray(0.0033 + f * (0.11 / (1.0 + f) + 44.0 / (4100.0 + f) + 3.0e-4))


def _checked(
    frequency_hz: ArrayLike, temperature: ArrayLike = 0.0, salinity: ArrayLike = 0.0, depth: ArrayLike = 0.0
) -> tuple[Array, Array, Array, Array]:
    f = np.asarray(frequency_hz, dtype=float)
    S = np.asarray(salinity, dtype=float)
    if np.any(f <= 0.0):
        raise AcousticsError(f"frequency_hz: {np.min(f):g}; must be positive")
    if np.any(S < 0.0):
        raise AcousticsError(f"salinity: {np.min(S):g}; must not be negative")
    return f / 1000.0, np.asarray(temperature, dtype=float), S, np.asarray(depth, dtype=float)
