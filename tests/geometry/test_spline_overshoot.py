"""How far a spline along one axis leaves the range of two neighbouring values."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from pymantaray.geometry.splines import spline_overshoot


@pytest.mark.parametrize("worst", [0, 2, 3])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_overshoot_is_that_of_a_finely_sampled_spline(worst, axis):
    """Of the level with most of it, which may be the first, one between, or the last."""
    rng = np.random.default_rng(worst)
    points = np.cumsum(rng.uniform(1.0, 2.0, 7))
    values = rng.normal(0.0, 0.01, (7, 7, 5))
    values[..., worst] *= 100.0
    span = np.ptp(values, axis=(0, 1))
    fine = np.linspace(0.0, 1.0, 2001)
    lines = np.moveaxis(values, axis, 0).reshape(7, -1)
    spline = make_interp_spline(points, lines, k=3)
    most = 0.0
    for k in range(6):
        between = spline(points[k] + fine * (points[k + 1] - points[k]))
        low, high = np.sort(lines[k : k + 2], axis=0)
        most = max(most, (between - high).max(), (low - between).max())
    found = spline_overshoot(points, values, span, axis=axis, ignore=0.02)
    assert found == pytest.approx(most, rel=1e-5)
