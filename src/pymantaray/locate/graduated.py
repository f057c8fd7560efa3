"""First values of a solve by graduated non-convexity: all pings count at first, and gross errors ever less."""

import numpy as np
from numpy.typing import NDArray

from pymantaray.estimation import LOSSES, Loss
from pymantaray.locate.linear import Linearization, Mask

Array = NDArray[np.float64]
_NARROWER = 1.5  # by which the scale of the loss falls
_STEPS = 60
_MAD = 1.4826  # median absolute deviation of a normal distribution to its standard deviation
_LEAST = 1e-9  # s


def robust_sigma(residual: Array) -> float:
    """Standard deviation of residuals by their median size, never 0. [s]"""
    return max(_MAD * float(np.median(np.abs(residual))), _LEAST)


def graduated_change(linear: Linearization, possible: Mask) -> Array:
    """
    Change of all columns that minimizes a Geman-McClure loss of the linear system's residuals, with the priors.

    The scale of the loss falls from the largest residual to 3.8 robust standard deviations, so that the first steps see every ping
    and a consistent group is not taken for gross errors before the model has moved.
    """
    unknowns = linear.unknowns
    sd = unknowns.prior_sd
    active = np.flatnonzero(sd > 0.0)
    offset = ((unknowns.prior_mean - linear.values) / np.where(sd > 0.0, sd, 1.0))[active]
    design = linear.columns(possible, active) * sd[active]
    residual = linear.residual[possible] / linear.weight[possible]
    efficient = LOSSES["geman-mcclure"].scale
    left: Array = np.asarray(residual)
    z: Array = np.zeros(active.size)
    scale = max(float(np.abs(left).max()), _LEAST)
    for _ in range(_STEPS):
        sigma = robust_sigma(left)
        weight = Loss("geman-mcclure", scale).weight(left) / sigma**2
        normal = design.T @ (design * weight[:, None]) + np.eye(active.size)
        z = np.asarray(np.linalg.solve(normal, design.T @ (weight * residual) + offset), dtype=float)
        left = np.asarray(residual - design @ z, dtype=float)
        goal = efficient * robust_sigma(left)
        if scale <= goal:
            break
        scale = max(scale / _NARROWER, goal)
    change = np.zeros(unknowns.size)
    change[active] = sd[active] * z
    return change
