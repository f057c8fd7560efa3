"""Absolute test of residuals: honest data pass with a wide margin, nonsense does not."""

import numpy as np
import pytest

from pymantaray.evaluation import LEAST_RANGE, unexplained


@pytest.mark.parametrize(
    ("noise", "time"),
    [(1e-4, 2.0), (10e-3, 5.0), (1.0 / 1500.0, 50.0 / 1500.0), (2e-3, 5.0 / 1500.0)],
    ids=["seafloor geodesy", "air guns", "beacons", "a pool"],
)
def test_honest_residuals_explain_their_travel_times(noise, time):
    residual = noise * np.random.default_rng(0).standard_normal(200)
    residual[:90] *= 1e6  # gross errors in less than half of the measurements
    assert unexplained(residual[::-1], np.full(200, time)) is None
    assert unexplained(np.append(residual[90:], np.nan), time, noise / 10.0) is None


def test_residuals_near_the_size_of_the_data_explain_nothing():
    assert "8.17e+03 % of what was measured" in unexplained(np.full(9, 188.0), 2.3)
    assert unexplained([0.049, -0.049], 1.0) is None
    assert "5.1 %" in unexplained([0.051, -0.051], 1.0)
    assert unexplained([np.inf, np.inf, 0.0], 1.0)
    assert unexplained([4.9], 0.0, least=LEAST_RANGE) is None
    assert unexplained([5.1], 0.0, least=LEAST_RANGE)


def test_residuals_of_a_hundred_stated_sigmas_explain_nothing():
    residual = np.full(5, 1e-3)
    assert "100 stated standard deviations" in unexplained(residual, 2.0, 1e-5)
    assert unexplained(residual, 2.0, 2.1e-5) is None
    # measurements without a stated noise are judged by their travel times only
    assert unexplained(residual, 2.0, [np.nan] * 5) is None


def test_nothing_predicted_is_not_judged():
    assert unexplained([np.nan, np.nan], [1.0, 2.0], [1e-3, 1e-3]) is None
