"""Depth of every vehicle at every sample, positive down."""

from dataclasses import dataclass

import numpy as np

from pymantaray.records import Measurements
from pymantaray.sensing.sensor import Columns, Normal, Scene, level


@dataclass(frozen=True)
class DepthNoise:
    """Standard deviation of a depth. [m]"""

    depth_sigma: float = level(0.01, "Standard deviation of a depth. [m]")


def measure(scene: Scene, noise: DepthNoise) -> Columns:
    """True depths."""
    depth = scene.truth.position[..., 2]
    return {"depth": depth, "depth_sigma": np.full(len(depth), noise.depth_sigma)}


def perturb(measurements: Measurements, normal: Normal) -> Columns:
    """Independent noise at every sample."""
    shape = (measurements.time.size,)
    noise = np.stack([normal(shape, name, "depth") for name in measurements.name])
    return {"depth": measurements.depth + noise * measurements.depth_sigma[:, None]}
