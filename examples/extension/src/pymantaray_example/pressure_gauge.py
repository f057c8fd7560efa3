"""Pressure gauge whose zero is wrong: a depth with a constant error in each realization."""

import numpy as np

from pymantaray.records import Measurements
from pymantaray.sensing import depth
from pymantaray.sensing.sensor import Columns, Normal, Scene

ZERO_SIGMA = 0.5  # m; standard deviation of the constant error of a vehicle


def measure(_scene: Scene, _noise: object) -> Columns:
    """No columns of its own: it measures the depth, as the depth sensor does."""
    return {}


def perturb(measurements: Measurements, normal: Normal) -> Columns:
    """Depths with the noise of the depth sensor and a constant error for each vehicle."""
    zero = np.stack([normal((1,), name, "gauge zero") for name in measurements.name])
    return {"depth": depth.perturb(measurements, normal)["depth"] + ZERO_SIGMA * zero}
