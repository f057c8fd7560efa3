"""Landmarks: fixed, surveyed points that receive pings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pymantaray.arrays import Array
from pymantaray.errors import SensingError
from pymantaray.quantities.checks import check_number, checked_array
from pymantaray.records import Measurements
from pymantaray.sensing.sensor import Columns, Normal, Scene, level


@dataclass(frozen=True, eq=False)
class Landmark:
    """
    A fixed point that receives the vehicles' pings.

    Parameters
    ----------
    name : str
        Name, unique among landmarks and vehicles.
    position : array_like, shape (3,)
        True position ``(north, east, down)`` in the local frame. [m]
    sigma : float, optional
        Standard deviation of each axis of the survey, which replaces that of the noise model. A
        large value means that the fleet has to locate the landmark. [m]

    Examples
    --------
    Continues the example of `pymantaray.sensing`:

    >>> from pymantaray.sensing import Landmark, measure_ranges
    >>> ranging = measure_ranges(truth, [Landmark("L", [1000.0, 500.0, 900.0])], medium, schedule)
    >>> ranging.attempts.receiver.tolist(), ranging.truth.distance.round(1).tolist()
    ([1, 2, 0, 2], [2035.8, 1422.8, 2035.8, 1224.7])
    """

    name: str
    position: Array
    sigma: float | None = None

    def __post_init__(self) -> None:
        """Check and freeze the position."""
        if not self.name:
            raise SensingError("Landmark: the name is empty; give every landmark a unique name")
        position = checked_array(
            SensingError, f"landmark {self.name!r}: position", self.position, (3,)
        )
        if position[2] < 0.0:
            raise SensingError(
                f"landmark {self.name!r}: depth is {position[2]:g} m; depth is positive down, 0 at"
                " the surface: place it in the water"
            )
        if self.sigma is not None:
            check_number(
                SensingError, f"landmark {self.name!r}: sigma", self.sigma, "m", positive=True
            )
        object.__setattr__(self, "position", position)


@dataclass(frozen=True)
class SurveyNoise:
    """Standard deviation of each axis of a landmark's survey. [m]"""

    landmark_sigma: float = level(
        0.10,
        "Standard deviation of each axis of a landmark's survey. Not in the paper, record 0001."
        " [m]",
    )


def measure(scene: Scene, noise: SurveyNoise) -> Columns:
    """True positions of the landmarks."""
    return {
        "landmark_name": np.array([landmark.name for landmark in scene.landmarks], dtype=str),
        "landmark_position": landmark_positions(scene.landmarks),
        "landmark_sigma": np.array(
            [noise.landmark_sigma if mark.sigma is None else mark.sigma for mark in scene.landmarks]
        ).reshape(-1),
    }


def perturb(measurements: Measurements, normal: Normal) -> Columns:
    """Noise of one survey before the mission."""
    draws = [normal((3,), name, "survey") for name in measurements.landmark_name]
    error = np.reshape(draws, (-1, 3)) * measurements.landmark_sigma[:, None]
    return {"landmark_position": measurements.landmark_position + error}


def landmark_positions(landmarks: Sequence[Landmark]) -> Array:
    """Positions of landmarks as one array, shape (n_landmarks, 3). [m]"""
    return np.array([landmark.position for landmark in landmarks], dtype=float).reshape(-1, 3)


def check_names(vehicle_names: Sequence[str], landmarks: Sequence[Landmark]) -> None:
    """Raise an error for two participants with one name, which identifies random streams."""
    names = set(vehicle_names)
    for landmark in landmarks:
        if landmark.name in names:
            raise SensingError(
                f"landmark {landmark.name!r}: the name is taken by another landmark or vehicle;"
                " names must be unique: rename one"
            )
        names.add(landmark.name)
