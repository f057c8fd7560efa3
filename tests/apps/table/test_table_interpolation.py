"""Interpolation within one cell."""

import itertools

import numpy as np
from hypothesis import given, strategies as st
from numpy.polynomial.polynomial import polyder, polyval3d

from pymantaray.apps.table.cells import interpolate

_CORNERS = np.array([[corner & 1, corner >> 1 & 1, corner >> 2 & 1] for corner in range(8)])


def _cubic(seed: int) -> np.ndarray:
    """Random coefficients of a polynomial of total degree 3."""
    coefficients = np.random.default_rng(seed).normal(size=(4, 4, 4))
    for powers in itertools.product(range(4), repeat=3):
        if sum(powers) > 3:
            coefficients[powers] = 0.0
    return coefficients


def _gradient(coefficients: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Exact derivatives of a polynomial."""
    return np.stack(
        [polyval3d(*np.moveaxis(at, -1, 0), polyder(coefficients, axis=k)) for k in range(3)],
        axis=-1,
    )


@given(st.integers(0, 2**32 - 1))
def test_cubic_polynomials_and_their_derivatives_are_reproduced(seed: int) -> None:
    rng, coefficients = np.random.default_rng(seed), _cubic(seed)
    low, size, at = rng.normal(size=(6, 3)), rng.uniform(0.5, 2.0, (6, 3)), rng.uniform(size=(6, 3))
    corners = low[:, None] + _CORNERS * size[:, None]
    values = polyval3d(*np.moveaxis(corners, -1, 0), coefficients)
    result = interpolate(at, size, values, _gradient(coefficients, corners))
    place = low + at * size
    scale = np.abs(coefficients).sum() * 4.0**3
    np.testing.assert_allclose(result.value, polyval3d(*place.T, coefficients), atol=1e-13 * scale)
    np.testing.assert_allclose(result.gradient, _gradient(coefficients, place), atol=1e-12 * scale)


def test_error_falls_with_the_fourth_power_of_the_size(as_stored) -> None:
    wave = np.array([1.1, 0.7, 0.9])
    at = np.random.default_rng(0).uniform(size=(200, 3))
    errors = []
    for length in (0.4, 0.2, 0.1):
        corners = length * _CORNERS
        phase = corners @ wave
        values, gradients = np.sin(phase), np.cos(phase)[:, None] * wave
        n = len(at)
        result = interpolate(
            at, np.full((n, 3), length), np.tile(values, (n, 1)), np.tile(gradients, (n, 1, 1))
        )
        errors.append(np.abs(result.value - np.sin(length * at @ wave)).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(orders > 3.5)
    as_stored(result)
