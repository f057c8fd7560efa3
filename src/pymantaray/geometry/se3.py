"""Rotations and rigid motions: quaternions (w, x, y, z), SO(3) and SE(3) exponential and logarithm.

Twists are ``[omega, v]`` in the body frame, as in GTSAM. All functions accept any leading axes.
"""

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import GeometryError

_SMALL_ANGLE = 1e-4  # rad; below it Taylor series replace the closed forms


def hat(omega: ArrayLike) -> Array:
    """Skew matrix (..., 3, 3) of a vector: ``hat(a) @ b == cross(a, b)``."""
    w = np.asarray(omega, dtype=float)
    out = np.zeros((*w.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -w[..., 2], w[..., 1]
    out[..., 1, 0], out[..., 1, 2] = w[..., 2], -w[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -w[..., 1], w[..., 0]
    return out


def _coefficients(theta: Array) -> tuple[Array, Array, Array]:
    """Return sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3, by series near zero."""
    t2, small = theta * theta, theta < _SMALL_ANGLE
    near = 1.0 - t2 / 6.0, 0.5 - t2 / 24.0, 1.0 / 6.0 - t2 / 120.0
    if small.all():  # as in most steps of a filter
        return near
    safe = np.where(small, 1.0, theta)
    sine = np.sin(safe)
    a, b, c = sine / safe, 2.0 * np.sin(safe / 2.0) ** 2 / safe**2, (safe - sine) / safe**3
    return np.where(small, near[0], a), np.where(small, near[1], b), np.where(small, near[2], c)


def so3_exp(omega: ArrayLike) -> Array:
    """Rotation matrix of a rotation vector, axis times angle [rad] (Rodrigues)."""
    w = np.asarray(omega, dtype=float)
    a, b, _ = _coefficients(np.linalg.norm(w, axis=-1))
    k = hat(w)
    return np.asarray(np.eye(3) + a[..., None, None] * k + b[..., None, None] * (k @ k))


def quaternion_from_matrix(rotation: ArrayLike) -> Array:
    """
    Unit quaternion (w, x, y, z) of a rotation matrix, with w >= 0.

    For each matrix, the function uses the one of four equivalent formulas that has the largest divisor.
    """
    r = np.asarray(rotation, dtype=float)
    m = [[r[..., i, j] for j in range(3)] for i in range(3)]
    squares = np.stack(
        [
            1 + m[0][0] + m[1][1] + m[2][2],
            1 + m[0][0] - m[1][1] - m[2][2],
            1 - m[0][0] + m[1][1] - m[2][2],
            1 - m[0][0] - m[1][1] + m[2][2],
        ],
        axis=-1,
    )
    rows = np.stack(
        [
            np.stack([squares[..., 0], m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]], axis=-1),
            np.stack([m[2][1] - m[1][2], squares[..., 1], m[0][1] + m[1][0], m[0][2] + m[2][0]], axis=-1),
            np.stack([m[0][2] - m[2][0], m[0][1] + m[1][0], squares[..., 2], m[1][2] + m[2][1]], axis=-1),
            np.stack([m[1][0] - m[0][1], m[0][2] + m[2][0], m[1][2] + m[2][1], squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(squares, axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., :1] < 0.0, -q, q))


def matrix_from_quaternion(quaternion: ArrayLike) -> Array:
    """Rotation matrix of a quaternion (w, x, y, z), which is normalized first."""
    q = np.asarray(quaternion, dtype=float)
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    if not np.all(norm > 0.0):
        raise GeometryError(
            "quaternion: its length is zero or NaN; it must be a unit quaternion (w, x, y, z)"
        )
    w, x, y, z = np.moveaxis(q / norm, -1, 0)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )


def so3_log(rotation: ArrayLike) -> Array:
    """Rotation vector, axis times angle [rad], of a rotation matrix; its length is at most pi."""
    q = quaternion_from_matrix(rotation)
    vector = q[..., 1:]
    s = np.linalg.norm(vector, axis=-1)
    angle = 2.0 * np.arctan2(s, q[..., 0])
    scale = np.where(s < 1e-12, 2.0, angle / np.where(s < 1e-12, 1.0, s))
    return np.asarray(scale[..., None] * vector)


def se3_exp(twist: ArrayLike) -> tuple[Array, Array]:
    """Rotation (..., 3, 3) and translation after unit time under a constant body twist."""
    xi = np.asarray(twist, dtype=float)
    omega, v = xi[..., :3], xi[..., 3:]
    a, b, c = _coefficients(np.linalg.norm(omega, axis=-1))
    k = hat(omega)
    kk = k @ k
    rotation = np.eye(3) + a[..., None, None] * k + b[..., None, None] * kk
    left = np.eye(3) + b[..., None, None] * k + c[..., None, None] * kk
    return rotation, np.einsum("...ij,...j->...i", left, v)


def se3_log(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """Twist that reaches a rotation (..., 3, 3) and translation in unit time; inverse of `se3_exp`."""
    omega = so3_log(rotation)
    theta = np.linalg.norm(omega, axis=-1)
    a, b, _ = _coefficients(theta)
    safe = np.where(theta < _SMALL_ANGLE, 1.0, theta)
    d = np.where(theta < _SMALL_ANGLE, 1.0 / 12.0 + theta**2 / 720.0, (1.0 - a / (2.0 * b)) / safe**2)
    k = hat(omega)
    inverse_left = np.eye(3) - 0.5 * k + d[..., None, None] * (k @ k)
    v = np.einsum("...ij,...j->...i", inverse_left, np.asarray(translation, dtype=float))
    return np.concatenate([omega, v], axis=-1)


def moved_by(quaternion: ArrayLike, translation: ArrayLike, twist: ArrayLike) -> tuple[Array, Array]:
    """Quaternion and translation of a pose followed by a twist in its body frame, ``T Exp(xi)``."""
    rotation = matrix_from_quaternion(quaternion)
    turn, move = se3_exp(twist)
    shift = np.einsum("...ij,...j->...i", rotation, move)
    return quaternion_from_matrix(rotation @ turn), np.asarray(translation + shift)
