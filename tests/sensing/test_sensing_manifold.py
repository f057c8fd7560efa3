"""Odometry noise is right-composed: T Exp(xi), with xi the draw times its sigma; large turns tell left from right."""

from dataclasses import replace

import numpy as np

from pymantaray.geometry import stream
from pymantaray.geometry.se3 import matrix_from_quaternion, se3_exp
from pymantaray.sensing import perturb


def matrices(quaternion, translation):
    out = np.zeros((*translation.shape[:-1], 4, 4))
    out[..., :3, :3] = matrix_from_quaternion(quaternion)
    out[..., :3, 3] = translation
    out[..., 3, 3] = 1.0
    return out


def test_odometry_and_first_poses_are_perturbed_from_the_right(make_measurements):
    clean = make_measurements()
    wide = np.broadcast_to([0.3, 0.4, 0.5, 2.0, 3.0, 4.0], clean.odometry_sigma.shape)
    clean = replace(clean, odometry_sigma=wide, first_sigma=wide[:, 0])
    noisy = perturb(clean, root_seed=5, realization=2)
    for a, name in enumerate(clean.name):
        for use, sigma, before, after in (
            (
                "odometry",
                clean.odometry_sigma[a],
                matrices(clean.odometry_rotation[a], clean.odometry_translation[a]),
                matrices(noisy.odometry_rotation[a], noisy.odometry_translation[a]),
            ),
            (
                "first pose",
                clean.first_sigma[a],
                matrices(clean.first_quaternion[a], clean.first_position[a]),
                matrices(noisy.first_quaternion[a], noisy.first_position[a]),
            ),
        ):
            xi = stream(5, 2, "sensing", str(name), use).standard_normal(sigma.shape) * sigma
            turn, move = se3_exp(xi)
            step = np.zeros((*move.shape[:-1], 4, 4))
            step[..., :3, :3], step[..., :3, 3], step[..., 3, 3] = turn, move, 1.0
            np.testing.assert_allclose(after, before @ step, rtol=0, atol=1e-10)
            assert np.abs(after - step @ before).max() > 0.1  # from the left it would be something else
