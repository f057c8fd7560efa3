"""
Absolute test of residuals: an estimate must explain what was measured.

Tests of chi-square compare residuals with a noise level, which may be estimated from the same
residuals. This test has limits that do not depend on them, and that no honest data reach: residuals
of seafloor geodesy are 0.1 ms in 2 s, of air guns 10 ms in 5 s, of small beacons 1 m in 50 m.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

LARGEST_SHARE = 0.05
"""Largest residual as a fraction of the travel time or range."""
LARGEST_RATIO = 50.0
"""Largest residual in standard deviations of the stated noise."""
LEAST_TIME = 5e-3
"""Residuals of travel times up to this are never too large a fraction. [s]"""
LEAST_RANGE = 5.0
"""The same for ranges. [m]"""


def unexplained(
    residual: ArrayLike,
    measured: ArrayLike,
    sigma: ArrayLike = np.nan,
    *,
    least: float = LEAST_TIME,
) -> str | None:
    """
    Return why an estimate does not explain its measurements; None if it does.

    Parameters
    ----------
    residual : array_like, shape (n,)
        Measured minus predicted travel times [s] or ranges [m]; NaN for measurements without a
        prediction, which are not counted.
    measured : array_like, shape (n,) or ()
        Travel times or ranges, in the unit of the residuals.
    sigma : array_like, shape (n,) or ()
        Stated standard deviations, in the unit of the residuals; NaN if unknown.
    least : float
        Residuals up to this are never too large a fraction: `LEAST_TIME` or `LEAST_RANGE`.

    Returns
    -------
    str or None
        Words such as ``residuals are 8200 % of the travel times (median)``.

    Notes
    -----
    Medians of the absolute values are compared, so that less than half of gross errors do not
    matter. The limits are 5 % of the measured values, and 50 stated standard deviations.

    Examples
    --------
    >>> from pymantaray.evaluation import unexplained
    >>> unexplained([0.3, 0.4, 0.5], measured=2.0)
    'the median residual is 20 % of what was measured; at most 5 % explain it'
    """
    size, value, stated = np.broadcast_arrays(
        np.abs(np.asarray(residual, dtype=float)),
        np.abs(np.asarray(measured, dtype=float)),
        np.asarray(sigma, dtype=float),
    )
    known = ~np.isnan(size)
    if not known.any():
        return None
    middle = float(np.median(size[known]))
    whole = float(np.median(value[known]))
    if not middle <= max(LARGEST_SHARE * whole, least):
        share = middle / whole if whole > 0.0 else np.inf
        return (
            f"the median residual is {100.0 * share:.3g} % of what was measured; at most"
            f" {100.0 * LARGEST_SHARE:g} % explain it"
        )
    has_sigma = known & np.isfinite(stated)
    if has_sigma.any():
        ratio = float(np.median(size[has_sigma] / stated[has_sigma]))
        if not ratio <= LARGEST_RATIO:
            return (
                f"the median residual is {ratio:.3g} stated standard deviations; at most"
                f" {LARGEST_RATIO:g} explain it"
            )
    return None
