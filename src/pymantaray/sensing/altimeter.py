"""
Altimeter: the depth of a vehicle from its range to the sea floor and the charted depth below it;
absent without a noise level.
"""

from dataclasses import dataclass

import numpy as np

from pymantaray.errors import SensingError
from pymantaray.records import Measurements
from pymantaray.sensing.sensor import Columns, Normal, Scene, level


@dataclass(frozen=True)
class AltimeterNoise:
    """
    Errors of a depth from an altitude [m]; without a standard deviation there is no such sensor.

    The error of the charted depth is constant for each vehicle and realization, and estimators do
    not know it. That the chart is read at the true horizontal position is assumed.
    """

    altimeter_sigma: float = level(
        0.0, "Standard deviation of an altitude; 0 for no such sensor. [m]", may_be_zero=True
    )
    altimeter_bias_sigma: float = level(
        0.0,
        "Standard deviation of the constant error of the charted depth below a vehicle, which"
        " estimators do not know. [m]",
        may_be_zero=True,
    )
    altimeter_reach: float = level(100.0, "Largest altitude that is measured. [m]")

    def __post_init__(self) -> None:
        """Raise an error for an incomplete sensor."""
        if self.altimeter_bias_sigma and not self.altimeter_sigma:
            raise SensingError(
                f"altimeter: bias sigma is {self.altimeter_bias_sigma:g} m without a sensor; set"
                " altimeter_sigma above zero"
            )


def measure(scene: Scene, noise: AltimeterNoise) -> Columns:
    """True depths of vehicles within reach of the sea floor."""
    truth = scene.truth
    near = np.broadcast_to(np.asarray(scene.altitude) <= noise.altimeter_reach, truth.status.shape)
    vehicle, sample = np.nonzero(near & (noise.altimeter_sigma > 0.0))
    return {
        "altimeter_vehicle": vehicle,
        "altimeter_sample": sample,
        "altimeter_depth": truth.position[vehicle, sample, 2],
        "altimeter_sigma": np.full(vehicle.size, noise.altimeter_sigma),
        "altimeter_bias_sigma": np.full(vehicle.size, noise.altimeter_bias_sigma),
    }


def perturb(measurements: Measurements, normal: Normal) -> Columns:
    """Add noise of each sample and the bias of each vehicle."""
    vehicle = measurements.altimeter_vehicle
    if not vehicle.size:
        return {}
    n_times = measurements.time.size
    noise = np.stack([normal((n_times,), name, "altimeter") for name in measurements.name])
    bias = np.stack([normal((1,), name, "altimeter bias") for name in measurements.name])
    return {
        "altimeter_depth": measurements.altimeter_depth
        + noise[vehicle, measurements.altimeter_sample] * measurements.altimeter_sigma
        + bias[vehicle, 0] * measurements.altimeter_bias_sigma
    }
