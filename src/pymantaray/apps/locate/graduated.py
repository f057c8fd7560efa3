"""Initial values of a solve by graduated non-convexity, robust to gross errors."""

import numpy as np

from pymantaray.apps.locate.linear import Linearization
from pymantaray.arrays import Array, Mask
from pymantaray.estimation import LOSSES, Loss
from pymantaray.geometry.spread import MAD_TO_SIGMA

_SCALE_STEP = 1.5  # factor between successive scales of the loss
_MAX_STEPS = 60
MIN_SIGMA = 1e-9  # s


def robust_sigma(residual: Array) -> float:
    """Standard deviation of residuals from their median magnitude, always positive. [s]"""
    return max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), MIN_SIGMA)


def graduated_change(linear: Linearization, possible: Mask) -> Array:
    """
    Minimize a Geman-McClure loss of the residuals, with priors; return the change of columns.

    The scale of the loss decreases from the largest residual to 3.8 robust standard deviations. The
    first steps therefore use all pings, and a consistent group of pings does not count as gross
    errors before the model has changed.
    """
    unknowns = linear.unknowns
    sd = unknowns.prior_sd
    active = np.flatnonzero(sd > 0.0)
    offset = ((unknowns.prior_mean - linear.values) / np.where(sd > 0.0, sd, 1.0))[active]
    design = linear.columns(possible, active) * sd[active]
    residual = linear.residual[possible] / linear.weight[possible]
    efficient = LOSSES["geman-mcclure"].scale
    current: Array = np.asarray(residual)
    z: Array = np.zeros(active.size)
    scale = max(float(np.abs(current).max()), MIN_SIGMA)
    for _ in range(_MAX_STEPS):
        sigma = robust_sigma(current)
        weight = Loss("geman-mcclure", scale).weight(current) / sigma**2
        normal = design.T @ (design * weight[:, None]) + np.eye(active.size)
        z = np.asarray(
            np.linalg.solve(normal, design.T @ (weight * residual) + offset), dtype=float
        )
        current = np.asarray(residual - design @ z, dtype=float)
        goal = efficient * robust_sigma(current)
        if scale <= goal:
            break
        scale = max(scale / _SCALE_STEP, goal)
    change = np.zeros(unknowns.size)
    change[active] = sd[active] * z
    return change
