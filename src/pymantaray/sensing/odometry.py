"""Odometry: the motion from each sample to the next, in the body frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pymantaray.geometry.se3 import matrix_from_quaternion, moved_by, quaternion_from_matrix, so3_log
from pymantaray.records import Measurements
from pymantaray.sensing.sensor import Columns, Normal, Scene, level


@dataclass(frozen=True)
class OdometryNoise:
    """Errors as fractions of an edge's rotation angle and length [-], and per time [rad/s, m/s]."""

    odometry_rotation_fraction: float = level(
        1e-6, "Error of an edge's rotation as a fraction of its angle. [-]", may_be_zero=True
    )
    odometry_rotation_drift: float = level(5e-7, "Error of rotation per time. [rad/s]")
    odometry_xy_fraction: float = level(
        0.05, "Error forward and to the right as a fraction of an edge's length. [-]", may_be_zero=True
    )
    odometry_z_fraction: float = level(
        0.001, "Error downward as a fraction of an edge's length. [-]", may_be_zero=True
    )
    odometry_translation_drift: float = level(0.0125, "Error of translation per time. [m/s]")

    def odometry_sigma(
        self, rotation: ArrayLike, translation: ArrayLike, time: ArrayLike
    ) -> NDArray[np.float64]:
        r"""
        Composite standard deviation of odometry edges, in the tangent of their noise-free relative poses.

        The paper's :math:`\sigma_i = \sqrt{(f_i \lVert m \rVert)^2 + (d_i \Delta t)^2}`. The paper does not define the
        magnitude of the motion: here it is the length of the edge's translation for translations
        and of its rotation vector for rotations.

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
        turned = np.linalg.norm(so3_log(matrix_from_quaternion(rotation)), axis=-1)
        moved = np.linalg.norm(np.asarray(translation, dtype=float), axis=-1)
        elapsed = np.diff(np.asarray(time, dtype=float))
        turn = np.hypot(self.odometry_rotation_fraction * turned, self.odometry_rotation_drift * elapsed)
        drift = self.odometry_translation_drift * elapsed
        across = np.hypot(self.odometry_xy_fraction * moved, drift)
        vertical = np.hypot(self.odometry_z_fraction * moved, drift)
        return np.stack([turn, turn, turn, across, across, vertical], axis=-1)


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
    m = measurements
    xi = np.stack([normal(m.odometry_sigma.shape[1:], name, "odometry") for name in m.name])
    rotation, translation = moved_by(m.odometry_rotation, m.odometry_translation, xi * m.odometry_sigma)
    return {"odometry_rotation": rotation, "odometry_translation": translation}
