"""Odometry: the motion from each sample to the next, in the body frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.geometry.se3 import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    retract,
    so3_log,
)
from pymantaray.records import Measurements
from pymantaray.sensing.sensor import Columns, Normal, Scene, level


@dataclass(frozen=True)
class OdometryNoise:
    """Errors as fractions of each component of an edge's motion [-], and per time [rad/s, m/s]."""

    odometry_rotation_fraction: float = level(
        1e-6,
        "Error about each body axis as a fraction of the edge's rotation about it. [-]",
        may_be_zero=True,
    )
    odometry_rotation_drift: float = level(5e-7, "Error of rotation per time. [rad/s]")
    odometry_xy_fraction: float = level(
        0.05,
        "Error forward and to the right as a fraction of the edge's motion along that axis. [-]",
        may_be_zero=True,
    )
    odometry_z_fraction: float = level(
        0.001,
        "Error downward as a fraction of the edge's motion downward. [-]",
        may_be_zero=True,
    )
    odometry_translation_drift: float = level(0.0125, "Error of translation per time. [m/s]")

    def odometry_sigma(self, rotation: ArrayLike, translation: ArrayLike, time: ArrayLike) -> Array:
        r"""
        Composite standard deviation of odometry edges, in the tangent of their relative poses.

        The paper's :math:`\sigma_i = \sqrt{(f_i \lvert m_i \rvert)^2 + (d_i \Delta t)^2}`, where
        :math:`m_i` is component i of the edge's rotation vector or translation, in the axes of its
        first pose.

        Parameters
        ----------
        rotation : array_like, shape (..., n_time - 1, 4)
            Relative rotations as unit quaternions. [-]
        translation : array_like, shape (..., n_time - 1, 3)
            Relative translations. [m]
        time : array_like, shape (n_time,)
            Times of the poses. [s]

        Returns
        -------
        ndarray, shape (..., n_time - 1, 6)
            Standard deviations, of rotation before translation. [rad, m]
        """
        motion = np.concatenate(
            [so3_log(matrix_from_quaternion(rotation)), np.asarray(translation, dtype=float)],
            axis=-1,
        )
        fraction = np.repeat(
            [self.odometry_rotation_fraction, self.odometry_xy_fraction, self.odometry_z_fraction],
            [3, 2, 1],
        )
        drift = np.repeat([self.odometry_rotation_drift, self.odometry_translation_drift], 3)
        interval = np.diff(np.asarray(time, dtype=float))[:, None]
        return np.asarray(np.hypot(fraction * motion, drift * interval))


def measure(scene: Scene, noise: OdometryNoise) -> Columns:
    """Relative poses ``T_k^-1 T_{k+1}``, rotations with w >= 0."""
    truth = scene.truth
    to_world = matrix_from_quaternion(truth.quaternion)
    to_body = np.swapaxes(to_world[:, :-1], -1, -2)
    rotation = quaternion_from_matrix(to_body @ to_world[:, 1:])
    translation = np.einsum("...ij,...j->...i", to_body, np.diff(truth.position, axis=1))
    return {
        "odometry_rotation": rotation,
        "odometry_translation": translation,
        "odometry_sigma": noise.odometry_sigma(rotation, translation, truth.time),
    }


def perturb(measurements: Measurements, normal: Normal) -> Columns:
    """Noise ``T Exp(xi)`` on the manifold."""
    xi = np.stack(
        [
            normal(measurements.odometry_sigma.shape[1:], name, "odometry")
            for name in measurements.name
        ]
    )
    rotation, translation = retract(
        measurements.odometry_rotation,
        measurements.odometry_translation,
        xi * measurements.odometry_sigma,
    )
    return {"odometry_rotation": rotation, "odometry_translation": translation}
