"""Slopes of natural cubic splines, compared with scipy's splines."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pymantaray.geometry.natural_spline import (
    hermite_overshoot,
    natural_slopes,
    natural_spline,
)


@pytest.mark.parametrize(
    ("points", "shape"),
    [
        ([0.0, 2.0], (3,)),
        ([0.0, 1.0, 40.0], (2, 4)),
        (np.arange(40.0) ** 2, (7, 3)),
        ([0.0, 50.0, 51.0, 400.0], ()),
    ],
)
def test_slopes_are_those_of_scipys_natural_spline(points, shape):
    points = np.asarray(points)
    values = 1500.0 + np.random.default_rng(4).normal(size=(*shape, points.size))
    before = values.copy()
    expected = CubicSpline(points, values, axis=-1, bc_type="natural")(points, 1)
    np.testing.assert_allclose(natural_slopes(points, values), expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(values, before)


def test_splines_pass_through_points_without_curvature_at_ends():
    points = np.array([0.0, 1.0, 5.0, 40.0])
    values = np.array([[1500.0, 1490.0, 1495.0, 1480.0], [0.0, 1.0, 0.0, 2.0]])
    np.testing.assert_allclose(natural_spline(points, values, points), values, rtol=1e-14)
    h = 1e-3
    for end in (points[0] + h, points[-1] - h):  # second differences about a point beside an end
        below, at, above = natural_spline(points, values, np.array([end - h, end, end + h])).T
        np.testing.assert_allclose((below - 2.0 * at + above) / h**2, 0.0, atol=0.05)


def test_overshoot_of_cubics_is_that_of_dense_samples():
    rng = np.random.default_rng(8)
    for n in (2, 3, 9):
        points = np.cumsum(rng.uniform(1.0, 300.0, n))
        values = rng.normal(0.0, 20.0, (4, 3, n))
        got = hermite_overshoot(points, values, natural_slopes(points, values), ignore=0.0)
        for k in range(n - 1):
            at = np.linspace(points[k], points[k + 1], 2001)
            dense = natural_spline(points, values, at)
            first, last = values[..., k, None], values[..., k + 1, None]
            beyond = np.maximum(dense - np.maximum(first, last), np.minimum(first, last) - dense)
            assert got[k] == pytest.approx(beyond.max(), abs=1e-4)


def test_small_overshoot_may_be_an_upper_bound():
    points = np.array([0.0, 100.0, 200.0, 300.0])
    values = np.array([0.0, 0.0, 10.0, 10.0])
    slopes = natural_slopes(points, values)
    exact = hermite_overshoot(points, values, slopes, ignore=0.0)
    bound = hermite_overshoot(points, values, slopes, ignore=5.0)
    assert (exact <= bound + 1e-12).all()
    assert bound.max() <= 5.0
