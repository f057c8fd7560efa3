"""Pressure gauge whose zero is wrong: a depth with a constant error in each realization."""

from dataclasses import dataclass

import numpy as np

from pymantaray.records import Measurements
from pymantaray.sensing import depth
from pymantaray.sensing.sensor import Columns, Normal, Scene


@dataclass(frozen=True)
class Levels:
    """Noise levels, which a study may change in its table ``[noise.pressure-gauge]``."""

    zero_sigma: float = 0.5
    """Standard deviation of the constant error of a vehicle. [m]"""


def measure(_scene: Scene, _levels: Levels) -> Columns:
    """No columns of its own: it measures the depth, as the depth sensor does."""
    return {}


def perturb(measurements: Measurements, normal: Normal, levels: Levels) -> Columns:
    """Depths with the noise of the depth sensor and a constant error for each vehicle."""
    zero = np.stack([normal((1,), name, "gauge zero") for name in measurements.name])
    return {"depth": depth.perturb(measurements, normal)["depth"] + levels.zero_sigma * zero}
