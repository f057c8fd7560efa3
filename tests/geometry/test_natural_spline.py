"""Slopes of natural cubic splines, compared with scipy's splines."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from pymantaray.geometry.natural_spline import natural_slopes


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
