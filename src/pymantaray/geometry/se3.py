"""Rotations and rigid motions: quaternions (w, x, y, z), SO(3) and SE(3) exponential and logarithm.

Twists are ``[omega, v]`` in the body frame, as in GTSAM. All functions accept any leading axes.
"""

import numpy as np
from numpy.typing import ArrayLike

from pymantaray.arrays import Array
from pymantaray.errors import GeometryError

_SMALL_ANGLE = 1e-4  # rad; below it Taylor series replace the closed forms


def lengths(vectors: Array) -> Array:
    """
    Lengths of vectors (..., k), k >= 2.

    The digits are those of `numpy.linalg.norm`, in half of its time.
    """
    squares = vectors * vectors
    total = squares[..., 0] + squares[..., 1]
    for i in range(2, vectors.shape[-1]):
        total += squares[..., i]
    return np.asarray(np.sqrt(total))


def hat(omega: ArrayLike) -> Array:
    """Skew matrix (..., 3, 3) of a vector: ``hat(a) @ b == cross(a, b)``."""
    w = np.asarray(omega, dtype=float)
    out = np.zeros((*w.shape[:-1], 3, 3))
    out[..., 0, 1] = -w[..., 2]
    out[..., 0, 2] = w[..., 1]
    out[..., 1, 0] = w[..., 2]
    out[..., 1, 2] = -w[..., 0]
    out[..., 2, 0] = -w[..., 1]
    out[..., 2, 1] = w[..., 0]
    return out


def _coefficients(theta: Array) -> tuple[Array, Array, Array]:
    """Return sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3, by series near zero."""
    t2 = theta * theta
    small = theta < _SMALL_ANGLE
    series = 1.0 - t2 / 6.0, 0.5 - t2 / 24.0, 1.0 / 6.0 - t2 / 120.0
    if small.all():  # as in most steps of a filter
        return series
    safe = np.where(small, 1.0, theta)
    sine = np.sin(safe)
    a = sine / safe
    b = 2.0 * np.sin(safe / 2.0) ** 2 / safe**2
    c = (safe - sine) / safe**3
    return (
        np.where(small, series[0], a),
        np.where(small, series[1], b),
        np.where(small, series[2], c),
    )


def so3_exp(omega: ArrayLike) -> Array:
    """Rotation matrix of a rotation vector, axis times angle [rad] (Rodrigues)."""
    w = np.asarray(omega, dtype=float)
    a, b, _ = _coefficients(lengths(w))
    k = hat(w)
    return np.asarray(np.eye(3) + a[..., None, None] * k + b[..., None, None] * (k @ k))


def quaternion_from_matrix(rotation: ArrayLike) -> Array:
    """
    Unit quaternion (w, x, y, z) of a rotation matrix, with w >= 0.

    For each matrix, the function uses the one of four equivalent formulas that has the largest
    divisor.
    """
    m = np.moveaxis(np.asarray(rotation, dtype=float), (-2, -1), (0, 1)).copy()
    ww = 1 + m[0, 0] + m[1, 1] + m[2, 2]  # four times the products of the components
    xx = 1 + m[0, 0] - m[1, 1] - m[2, 2]
    yy = 1 - m[0, 0] + m[1, 1] - m[2, 2]
    zz = 1 - m[0, 0] - m[1, 1] + m[2, 2]
    wx = m[2, 1] - m[1, 2]
    wy = m[0, 2] - m[2, 0]
    wz = m[1, 0] - m[0, 1]
    xy = m[0, 1] + m[1, 0]
    xz = m[0, 2] + m[2, 0]
    yz = m[1, 2] + m[2, 1]
    by_x = xx > ww
    by_z = zz > yy
    yz_largest = np.where(by_z, zz, yy) > np.where(by_x, xx, ww)

    def largest(w: Array, x: Array, y: Array, z: Array) -> Array:
        return np.where(yz_largest, np.where(by_z, z, y), np.where(by_x, x, w))

    q = (
        largest(ww, wx, wy, wz),
        largest(wx, xx, xy, xz),
        largest(wy, xy, yy, yz),
        largest(wz, xz, yz, zz),
    )
    norm = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    norm = np.where(q[0] < 0.0, -norm, norm)
    return np.stack([component / norm for component in q], axis=-1)


def matrix_from_quaternion(quaternion: ArrayLike) -> Array:
    """Rotation matrix of a quaternion (w, x, y, z), which is normalized first."""
    q = np.asarray(quaternion, dtype=float)
    norm = lengths(q)
    if not np.all(norm > 0.0):
        raise GeometryError(
            "quaternion: its length is zero or NaN; it must be a unit quaternion (w, x, y, z)"
        )
    w, x, y, z = (q[..., i] / norm for i in range(4))
    rows = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]
    return np.stack(rows, axis=-1).reshape(*norm.shape, 3, 3)


def so3_log(rotation: ArrayLike) -> Array:
    """Rotation vector, axis times angle [rad], of a rotation matrix; its length is at most pi."""
    q = quaternion_from_matrix(rotation)
    vector = q[..., 1:]
    s = lengths(vector)
    angle = 2.0 * np.arctan2(s, q[..., 0])
    scale = np.where(s < 1e-12, 2.0, angle / np.where(s < 1e-12, 1.0, s))
    return np.asarray(scale[..., None] * vector)


def se3_exp(twist: ArrayLike) -> tuple[Array, Array]:
    """Rotation (..., 3, 3) and translation after unit time under a constant body twist."""
    xi = np.asarray(twist, dtype=float)
    omega = xi[..., :3]
    v = xi[..., 3:]
    a, b, c = _coefficients(lengths(omega))
    k = hat(omega)
    kk = k @ k
    rotation = np.eye(3) + a[..., None, None] * k + b[..., None, None] * kk
    left = np.eye(3) + b[..., None, None] * k + c[..., None, None] * kk
    return rotation, np.einsum("...ij,...j->...i", left, v)


def se3_log(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """Twist that reaches a rotation (..., 3, 3) and translation in unit time."""
    omega = so3_log(rotation)
    theta = lengths(omega)
    a, b, _ = _coefficients(theta)
    safe = np.where(theta < _SMALL_ANGLE, 1.0, theta)
    d = np.where(
        theta < _SMALL_ANGLE, 1.0 / 12.0 + theta**2 / 720.0, (1.0 - a / (2.0 * b)) / safe**2
    )
    k = hat(omega)
    inverse_left = np.eye(3) - 0.5 * k + d[..., None, None] * (k @ k)
    v = np.einsum("...ij,...j->...i", inverse_left, np.asarray(translation, dtype=float))
    return np.concatenate([omega, v], axis=-1)


def retract(quaternion: ArrayLike, translation: ArrayLike, twist: ArrayLike) -> tuple[Array, Array]:
    """Quaternion and translation of a pose followed by a twist in its body frame, ``T Exp(xi)``."""
    rotation = matrix_from_quaternion(quaternion)
    step_rotation, step_translation = se3_exp(twist)
    displacement = np.einsum("...ij,...j->...i", rotation, step_translation)
    return quaternion_from_matrix(rotation @ step_rotation), np.asarray(translation + displacement)
