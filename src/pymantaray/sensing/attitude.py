"""
Attitude and heading reference (AHRS): the rotation of every vehicle at every sample.

There is no such sensor without noise levels.
"""

from dataclasses import dataclass

import numpy as np

from pymantaray.errors import SensingError
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, so3_exp
from pymantaray.records import Measurements
from pymantaray.sensing.sensor import Columns, Normal, Scene, level


@dataclass(frozen=True)
class AttitudeNoise:
    """
    Standard deviations of an attitude [rad]; without tilt and heading there is no such sensor.

    Gravity gives roll and pitch, with an error about each horizontal axis. Heading has an
    independent error at each sample, and a bias that is constant for each vehicle and realization
    and that estimators do not know.
    """

    attitude_tilt_sigma: float = level(
        0.0, "Standard deviation of roll and pitch; 0 for no such sensor. [rad]", may_be_zero=True
    )
    attitude_heading_sigma: float = level(
        0.0,
        "Standard deviation of heading, drawn at each sample; 0 for no such sensor. [rad]",
        may_be_zero=True,
    )
    attitude_heading_bias_sigma: float = level(
        0.0,
        "Standard deviation of the constant heading bias of a vehicle, which estimators do not"
        " know. [rad]",
        may_be_zero=True,
    )

    def __post_init__(self) -> None:
        """Raise an error for an incomplete sensor."""
        tilt = self.attitude_tilt_sigma
        heading = self.attitude_heading_sigma
        bias = self.attitude_heading_bias_sigma
        if not (tilt and heading) and (tilt or heading or bias):
            raise SensingError(
                f"attitude: tilt sigma is {tilt:g}, heading sigma {heading:g} and heading bias"
                f" sigma {bias:g} rad; a sensor needs tilt and heading above zero"
            )


def measure(scene: Scene, noise: AttitudeNoise) -> Columns:
    """True rotations."""
    tilt = noise.attitude_tilt_sigma
    heading = noise.attitude_heading_sigma
    truth = scene.truth
    vehicle, sample = np.nonzero(np.full(truth.status.shape, tilt > 0.0))
    return {
        "attitude_vehicle": vehicle,
        "attitude_sample": sample,
        "attitude_quaternion": truth.quaternion[vehicle, sample],
        "attitude_sigma": np.tile([tilt, tilt, heading], (vehicle.size, 1)),
        "attitude_bias_sigma": np.full(vehicle.size, noise.attitude_heading_bias_sigma),
    }


def perturb(measurements: Measurements, normal: Normal) -> Columns:
    """Add rotations about the axes of the world, ``Exp(xi) R``."""
    if not measurements.attitude_vehicle.size:
        return {}
    vehicle = measurements.attitude_vehicle
    sample = measurements.attitude_sample
    shape = (measurements.time.size, 3)
    noise = np.stack([normal(shape, name, "attitude") for name in measurements.name])
    bias = np.concatenate([normal((1,), name, "attitude bias") for name in measurements.name])
    error = noise[vehicle, sample] * measurements.attitude_sigma
    error[:, 2] += bias[vehicle] * measurements.attitude_bias_sigma
    rotation = so3_exp(error) @ matrix_from_quaternion(measurements.attitude_quaternion)
    return {"attitude_quaternion": quaternion_from_matrix(rotation)}
