"""Prior of each vehicle's pose at the start of the mission."""

from dataclasses import dataclass

import numpy as np

from pymantaray.geometry.se3 import retract
from pymantaray.records import Measurements
from pymantaray.sensing.sensor import Columns, Normal, Scene, level


@dataclass(frozen=True)
class FirstPoseNoise:
    """Standard deviation of each axis of the first pose, position [m] and rotation [rad]."""

    first_position_sigma: float = level(
        0.10,
        "Standard deviation of each axis of the first position. Not in the paper, record 0001. [m]",
    )
    first_rotation_sigma: float = level(
        1e-4,
        "Standard deviation of each axis of the first rotation. Not in the paper, record 0001."
        " [rad]",
    )


def measure(scene: Scene, noise: FirstPoseNoise) -> Columns:
    """True first poses."""
    sigma = np.repeat([noise.first_rotation_sigma, noise.first_position_sigma], 3)
    return {
        "first_position": scene.truth.position[:, 0],
        "first_quaternion": scene.truth.quaternion[:, 0],
        "first_sigma": np.tile(sigma, (scene.truth.name.size, 1)),
    }


def perturb(measurements: Measurements, normal: Normal) -> Columns:
    """Noise ``T Exp(xi)`` on the manifold."""
    noise = np.stack([normal((6,), name, "first pose") for name in measurements.name])
    xi = noise * measurements.first_sigma
    quaternion, position = retract(measurements.first_quaternion, measurements.first_position, xi)
    return {"first_position": position, "first_quaternion": quaternion}
