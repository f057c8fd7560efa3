"""How noisy each measurement is."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.errors import SensingError
from pymantaray.geometry.se3 import matrix_from_quaternion, so3_log
from pymantaray.records import Measurements

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NoiseModel:
    """
    Standard deviations of all measurements; the defaults are the paper's table, the last three ours.

    Parameters
    ----------
    range_sigma : float
        Range, modem jitter included. [m]
    depth_sigma : float
        Depth. [m]
    gnss_sigma : float
        GNSS, each axis. [m]
    odometry_rotation_fraction : float
        Share of an edge's rotation angle. [-]
    odometry_rotation_drift : float
        Rotation per time of the edge. [rad s⁻¹]
    odometry_xy_fraction, odometry_z_fraction : float
        Share of an edge's length, for the horizontal and the vertical body axes. [-]
    odometry_translation_drift : float
        Translation per time of the edge. [m s⁻¹]
    first_position_sigma : float
        First pose, each axis. [m]
    first_rotation_sigma : float
        First pose, each axis. [rad]
    landmark_sigma : float
        Survey of a landmark, each axis. [m]

    Raises
    ------
    SensingError
        If a value is negative or not finite.
    """

    range_sigma: float = 1.0
    depth_sigma: float = 0.01
    gnss_sigma: float = 0.10
    odometry_rotation_fraction: float = 1e-6
    odometry_rotation_drift: float = 5e-7
    odometry_xy_fraction: float = 0.05
    odometry_z_fraction: float = 0.001
    odometry_translation_drift: float = 0.0125
    first_position_sigma: float = 0.1
    first_rotation_sigma: float = 1e-4
    landmark_sigma: float = 0.1

    def __post_init__(self) -> None:
        """Check every value."""
        for f in fields(self):
            value = getattr(self, f.name)
            if not math.isfinite(value) or value < 0.0:
                raise SensingError(
                    f"NoiseModel: {f.name} is {value:g}; it must be finite and zero or positive"
                )

    def odometry_sigma(self, rotation: ArrayLike, translation: ArrayLike, time: ArrayLike) -> Array:
        r"""
        Composite standard deviation of each odometry edge, in the tangent of its relative pose.

        Parameters
        ----------
        rotation : array_like, shape (..., n_time - 1, 4)
            Noise-free relative rotations, quaternions (w, x, y, z).
        translation : array_like, shape (..., n_time - 1, 3)
            Noise-free relative translations. [m]
        time : array_like, shape (n_time,)
            Sample times. [s]

        Returns
        -------
        ndarray, shape (..., n_time - 1, 6)
            Three rotations [rad], three translations [m].

        Notes
        -----
        The paper's :math:`\sigma_i = \sqrt{(f_i \lVert m \rVert)^2 + (d_i \Delta t)^2}`. It leaves the
        motion's magnitude open: here it is the length of the edge's translation for the translations
        and of its rotation vector for the rotations.
        """
        turned = np.linalg.norm(so3_log(matrix_from_quaternion(rotation)), axis=-1)
        moved = np.linalg.norm(np.asarray(translation, dtype=float), axis=-1)
        elapsed = np.diff(np.asarray(time, dtype=float))
        turn = np.hypot(self.odometry_rotation_fraction * turned, self.odometry_rotation_drift * elapsed)
        drift = self.odometry_translation_drift * elapsed
        across = np.hypot(self.odometry_xy_fraction * moved, drift)
        vertical = np.hypot(self.odometry_z_fraction * moved, drift)
        return np.stack([turn, turn, turn, across, across, vertical], axis=-1)


def ranged_pairs(measurements: Measurements) -> Iterator[tuple[str, str, NDArray[np.int64]]]:
    """
    Range attempts of each ordered pair.

    Parameters
    ----------
    measurements : Measurements

    Yields
    ------
    transmitter, receiver : str
        Names.
    rows : ndarray of int
        Attempts of the pair, in order.
    """
    o = measurements
    names = [str(name) for name in (*o.name, *o.landmark_name)]
    pair = o.range_transmitter.astype(np.int64) * len(names) + o.range_receiver
    order = np.argsort(pair, kind="stable")
    keys, first = np.unique(pair[order], return_index=True)
    for key, rows in zip(keys, np.split(order, first[1:]), strict=False):
        transmitter, receiver = divmod(int(key), len(names))
        yield names[transmitter], names[receiver], rows
