"""Closed-form travel times: oracles for the solver, and quick answers where a profile is that simple."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import AcousticsError


def direct_travel_time_linear_gradient(
    source: ArrayLike, receiver: ArrayLike, *, sound_speed_surface: float, gradient: float
) -> NDArray[np.float64]:
    r"""
    One-way travel time of the direct ray in a linear sound speed profile :math:`c(z) = c_0 + g z`.

    Parameters
    ----------
    source, receiver : array_like, shape (..., 3)
        Positions ``(north, east, down)`` in the local frame. [m]
    sound_speed_surface : float
        :math:`c_0`, at ``z = 0``. [m s⁻¹]
    gradient : float
        :math:`g`. Zero gives the isovelocity limit. [s⁻¹]

    Returns
    -------
    ndarray, shape (...)
        Travel time. [s]

    Notes
    -----
    In a medium with :math:`c = c_0 + g z` the metric :math:`ds / c` is that of the hyperbolic half-space,
    whose distance between points with speeds :math:`c_s, c_r` a straight distance :math:`d` apart is
    :math:`t = 2|g|^{-1} \operatorname{arcsinh}(|g| d / 2\sqrt{c_s c_r})`. The arcsinh form keeps its digits
    for small gradients. Boundaries are ignored: the arc may leave the water column.

    Examples
    --------
    >>> t = direct_travel_time_linear_gradient(
    ...     [0, 0, 100], [3000, 0, 400], sound_speed_surface=1500.0, gradient=0.016)
    >>> print(f"{t:.6f}")
    2.004546
    """
    a, b = np.asarray(source, dtype=float), np.asarray(receiver, dtype=float)
    c_a = sound_speed_surface + gradient * a[..., 2]
    c_b = sound_speed_surface + gradient * b[..., 2]
    if not (np.all(c_a > 0.0) and np.all(c_b > 0.0)):
        raise AcousticsError(
            f"sound speed at the ends falls to {min(np.min(c_a), np.min(c_b)):g} m/s; it must be positive"
        )
    x = np.linalg.norm(b - a, axis=-1) / (2.0 * np.sqrt(c_a * c_b))
    if gradient == 0.0:
        return np.asarray(2.0 * x)
    return np.asarray(2.0 / abs(gradient) * np.arcsinh(abs(gradient) * x))
