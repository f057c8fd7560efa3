"""GNSS: a fix at each sample at which a vehicle is close enough to the surface."""

from dataclasses import dataclass

import numpy as np

from pymantaray.errors import SensingError
from pymantaray.records import Measurements
from pymantaray.sensing.sensor import Columns, Normal, Scene, level


@dataclass(frozen=True)
class GnssNoise:
    """Standard deviation of each axis of a fix. [m]"""

    gnss_sigma: float = level(0.10, "Standard deviation of each axis of a GNSS fix. [m]")


def measure(scene: Scene, noise: GnssNoise) -> Columns:
    """Positions where the depth is smaller than the scene's ``gnss_depth``."""
    if not np.all(np.asarray(scene.gnss_depth) >= 0.0):
        raise SensingError(
            f"gnss_depth is {np.min(scene.gnss_depth):g} m; it must be zero or positive"
        )
    vehicle, sample = np.nonzero(scene.truth.position[..., 2] < scene.gnss_depth)
    return {
        "gnss_vehicle": vehicle,
        "gnss_sample": sample,
        "gnss_position": scene.truth.position[vehicle, sample],
        "gnss_sigma": np.full(vehicle.size, noise.gnss_sigma),
    }


def perturb(measurements: Measurements, normal: Normal) -> Columns:
    """Add noise, drawn for every sample: an additional fix does not change other fixes."""
    noise = np.stack(
        [normal((measurements.time.size, 3), name, "gnss") for name in measurements.name]
    )
    return {
        "gnss_position": measurements.gnss_position
        + noise[measurements.gnss_vehicle, measurements.gnss_sample]
        * measurements.gnss_sigma[:, None]
    }
