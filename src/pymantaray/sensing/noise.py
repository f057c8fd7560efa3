"""Table of sensors, and noise levels of all measurements."""

from dataclasses import dataclass

from pymantaray.errors import SensingError
from pymantaray.quantities.checks import check_fields
from pymantaray.sensing import (
    altimeter,
    attitude,
    depth,
    dvl,
    first_pose,
    gnss,
    landmarks,
    odometry,
)
from pymantaray.sensing.sensor import Sensor, level

SENSORS: tuple[Sensor, ...] = (
    odometry,
    depth,
    gnss,
    landmarks,
    first_pose,
    attitude,
    dvl,
    altimeter,
)
"""All sensors except ranges, which are in `pymantaray.sensing.ranging`."""


@dataclass(frozen=True)
class RangeNoise:
    """Standard deviation of a range, modem jitter included. [m]"""

    range_sigma: float = level(1.0, "Standard deviation of a range, modem jitter included. [m]")


@dataclass(frozen=True)
class NoiseModel(
    altimeter.AltimeterNoise,
    dvl.DvlNoise,
    attitude.AttitudeNoise,
    landmarks.SurveyNoise,
    first_pose.FirstPoseNoise,
    odometry.OdometryNoise,
    gnss.GnssNoise,
    depth.DepthNoise,
    RangeNoise,
):
    """
    Noise levels of all measurements, described in the modules of the sensors.

    The defaults are the paper's table, except the survey.

    Lengths are in metres, angles in radians, drifts per second; fractions are of the
    component of an edge's motion.

    Examples
    --------
    >>> NoiseModel(range_sigma=0.5).depth_sigma
    0.01
    """

    def __post_init__(self) -> None:
        """Check every value."""
        check_fields(SensingError, self, "", *vars(self))
        for sensor in NoiseModel.__bases__:
            check = getattr(sensor, "__post_init__", None)
            if check is not None:
                check(self)
