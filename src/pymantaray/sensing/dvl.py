"""
Doppler velocity log (DVL): mean velocity over ground between samples, in the body frame.

There is no such sensor without a noise level.

Four beams point down at 30 degrees from the vertical. Each can be lost between two samples; three
determine a velocity.
"""

from dataclasses import dataclass

import numpy as np

from pymantaray.arrays import Array
from pymantaray.errors import SensingError
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import Measurements
from pymantaray.sensing.sensor import Columns, Normal, Scene, level

_BEAMS = 4
_TILT = np.radians(30.0)  # rad; angle of a beam from the vertical


@dataclass(frozen=True)
class DvlNoise:
    """
    Errors of a velocity over ground, in the body frame.

    Without a standard deviation there is no such sensor.

    Each axis has an independent error at each sample, and a bias that is constant for each vehicle
    and realization and that estimators do not know. With three beams the noise of each axis is
    larger by their geometry; its correlation between axes is neglected.
    """

    dvl_sigma: float = level(
        0.0,
        "Standard deviation of each axis of a velocity over ground; 0 for no such sensor. [m/s]",
        may_be_zero=True,
    )
    dvl_bias_sigma: float = level(
        0.0,
        "Standard deviation of the constant bias of each axis of a vehicle, which estimators do"
        " not know. [m/s]",
        may_be_zero=True,
    )
    dvl_beam_loss: float = level(
        0.0,
        "Probability that one of the four beams is lost between two samples. [-]",
        may_be_zero=True,
    )
    dvl_reach: float = level(200.0, "Largest altitude at which beams reach the sea floor. [m]")

    def __post_init__(self) -> None:
        """Raise an error for an incomplete sensor and impossible probabilities."""
        if self.dvl_beam_loss > 1.0:
            raise SensingError(
                f"dvl_beam_loss is {self.dvl_beam_loss:g}; it is a probability: allowed are 0 to 1"
            )
        bias = self.dvl_bias_sigma
        loss = self.dvl_beam_loss
        if not self.dvl_sigma and (bias or loss):
            raise SensingError(
                f"DVL: bias sigma is {bias:g} m/s and beam loss {loss:g} without a sensor; set"
                " dvl_sigma above zero"
            )


def measure(scene: Scene, noise: DvlNoise) -> Columns:
    """True velocities between two samples within reach of the sea floor."""
    truth = scene.truth
    sigma = noise.dvl_sigma
    in_reach = np.broadcast_to(np.asarray(scene.altitude) <= noise.dvl_reach, truth.status.shape)
    vehicle, sample = np.nonzero(in_reach[:, :-1] & in_reach[:, 1:] & (sigma > 0.0))
    step = truth.position[vehicle, sample + 1] - truth.position[vehicle, sample]
    velocity = step / (truth.time[sample + 1] - truth.time[sample])[:, None]
    rotation = matrix_from_quaternion(truth.quaternion[vehicle, sample])
    return {
        "dvl_vehicle": vehicle,
        "dvl_sample": sample,
        "dvl_velocity": np.einsum("nij,ni->nj", rotation, velocity),
        "dvl_sigma": np.full((vehicle.size, 3), sigma),
        "dvl_bias_sigma": np.full(vehicle.size, noise.dvl_bias_sigma),
        "dvl_beam_loss": np.full(vehicle.size, noise.dvl_beam_loss),
    }


def perturb(measurements: Measurements, normal: Normal) -> Columns:
    """Add noise and bias; remove velocities of fewer than three beams."""
    if not measurements.dvl_vehicle.size:
        return {}
    from scipy.special import ndtr

    vehicle = measurements.dvl_vehicle
    sample = measurements.dvl_sample
    edges = measurements.time.size - 1
    names = measurements.name
    noise = np.stack([normal((edges, 3), name, "dvl") for name in names])[vehicle, sample]
    bias = np.stack([normal((3,), name, "dvl bias") for name in names])[vehicle]
    beams = np.stack([normal((edges, _BEAMS), name, "dvl beams") for name in names])
    chances = ndtr(beams[vehicle, sample])
    n_beams = np.count_nonzero(chances >= measurements.dvl_beam_loss[:, None], axis=1)
    has_all_beams = (n_beams == _BEAMS)[:, None]
    sigma = np.where(has_all_beams, 1.0, three_beam_factor()) * measurements.dvl_sigma
    error = noise * sigma + bias * measurements.dvl_bias_sigma[:, None]
    is_valid = n_beams >= _BEAMS - 1  # three beams determine a velocity
    columns = {
        "dvl_velocity": measurements.dvl_velocity + error,
        "dvl_sigma": sigma,
        "dvl_vehicle": vehicle,
        "dvl_sample": sample,
        "dvl_bias_sigma": measurements.dvl_bias_sigma,
        "dvl_beam_loss": measurements.dvl_beam_loss,
    }
    return {name: values[is_valid] for name, values in columns.items()}


def three_beam_factor() -> Array:
    """Ratio of the standard deviations of each axis with three and with four beams; shape (3,)."""
    azimuth = np.radians([45.0, 135.0, 225.0, 315.0])
    across = np.sin(_TILT)
    down = np.full(_BEAMS, np.cos(_TILT))
    beams = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), down], axis=1)
    three, four = (
        np.sqrt(np.diag(np.linalg.inv(directions.T @ directions)))
        for directions in (beams[1:], beams)
    )
    return np.asarray(three / four)
