"""Group axioms, round trips and limits of the rotation and rigid-motion formulas."""

import numpy as np
import pytest
from scipy.linalg import expm

from pymantaray.errors import GeometryError
from pymantaray.geometry.se3 import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    se3_exp,
    se3_log,
    so3_exp,
    so3_log,
)

ANGLES = [0.0, 1e-12, 1e-7, 0.99e-4, 1.01e-4, 1e-3, 0.5, 2.0, 3.0, np.pi - 1e-4, np.pi - 1e-7]
BATCHES = [(), (1,), (4,), (2, 3), (0,)]


def axis(seed=0, shape=()):
    vectors = np.random.default_rng(seed).standard_normal((*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rotations(shape, seed=1):
    rng = np.random.default_rng(seed)
    angle = rng.choice(ANGLES, size=shape)
    return so3_exp(axis(seed, shape) * np.asarray(angle)[..., None])


def assert_rotation(rotation):
    identity = np.broadcast_to(np.eye(3), rotation.shape)
    np.testing.assert_allclose(
        rotation @ np.swapaxes(rotation, -1, -2), identity, rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, rtol=0, atol=1e-14)


def homogeneous(rotation, translation):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


@pytest.mark.parametrize("shape", BATCHES)
def test_exponential_and_logarithm_keep_the_leading_axes(shape):
    twist = np.random.default_rng(3).standard_normal((*shape, 6))
    rotation, translation = se3_exp(twist)
    assert rotation.shape == (*shape, 3, 3)
    assert translation.shape == (*shape, 3)
    assert_rotation(rotation)
    assert se3_log(rotation, translation).shape == (*shape, 6)
    assert so3_log(so3_exp(twist[..., :3])).shape == (*shape, 3)
    assert quaternion_from_matrix(rotation).shape == (*shape, 4)


def test_a_batch_equals_its_elements_one_by_one():
    twists = (
        np.random.default_rng(4).standard_normal((6, 6))
        * np.array([1e-7, 1e-4, 1, 1, 2, 3])[:, None]
    )
    rotation, translation = se3_exp(twists)
    for k, twist in enumerate(twists):
        one_rotation, one_translation = se3_exp(twist)
        np.testing.assert_array_equal(rotation[k], one_rotation)
        np.testing.assert_allclose(translation[k], one_translation, rtol=0, atol=1e-15)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("seed", range(3))
def test_exponential_is_the_matrix_exponential(angle, seed):
    omega, v = angle * axis(seed), axis(seed + 10) * 1000.0
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = np.cross(omega, np.eye(3)).T, v
    rotation, translation = se3_exp(np.concatenate([omega, v]))
    assert_rotation(rotation)
    np.testing.assert_allclose(
        homogeneous(rotation, translation), expm(generator), rtol=0, atol=1e-11
    )
    np.testing.assert_allclose(so3_exp(omega), rotation, rtol=0, atol=1e-15)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("seed", range(4))
def test_logarithm_inverts_the_exponential(angle, seed):
    twist = np.concatenate([angle * axis(seed), axis(seed + 20) * 500.0])
    np.testing.assert_allclose(so3_log(so3_exp(twist[:3])), twist[:3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(se3_log(*se3_exp(twist)), twist, rtol=0, atol=1e-6)
    if angle < 3.0:
        np.testing.assert_allclose(so3_log(so3_exp(twist[:3])), twist[:3], rtol=1e-14, atol=4e-16)
        np.testing.assert_allclose(se3_log(*se3_exp(twist)), twist, rtol=0, atol=1e-11)


@pytest.mark.parametrize("along", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (-1, 2, -3)])
def test_half_turn_has_length_pi_and_gives_the_rotation_back(along):
    unit = np.array(along) / np.linalg.norm(along)
    rotation = 2.0 * np.outer(unit, unit) - np.eye(3)
    vector = so3_log(rotation)
    assert np.linalg.norm(vector) == pytest.approx(np.pi, rel=0, abs=1e-15)
    np.testing.assert_allclose(so3_exp(vector), rotation, rtol=0, atol=1e-15)


@pytest.mark.parametrize("shape", BATCHES)
def test_quaternion_round_trip(shape):
    rotation = rotations(shape)
    quaternion = quaternion_from_matrix(rotation)
    assert (quaternion[..., 0] >= 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(quaternion, axis=-1), 1.0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(matrix_from_quaternion(quaternion), rotation, rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        matrix_from_quaternion(-3.0 * quaternion), rotation, rtol=0, atol=1e-14
    )


@pytest.mark.parametrize("angle", ANGLES)
def test_quaternion_has_half_the_angle(angle):
    unit = axis(5)
    quaternion = quaternion_from_matrix(so3_exp(angle * unit))
    expected = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * unit])
    np.testing.assert_allclose(quaternion, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("bad", [[0.0, 0.0, 0.0, 0.0], [np.nan, 0.0, 0.0, 1.0]])
def test_quaternion_without_length_is_refused(bad):
    with pytest.raises(GeometryError, match="quaternion: its length is zero or NaN"):
        matrix_from_quaternion([[1.0, 0.0, 0.0, 0.0], bad])
