"""
Tables of unknowns: prior and posterior, errors by their standard deviations, and combinations that
are seen or not.
"""

from dataclasses import replace

import numpy as np
import pytest

from pymantaray.evaluation.unknowns import directions_table, unknowns_table
from pymantaray.records import SharedUnknowns


def record(n_realizations=400):
    """
    Three offsets of which only differences were measured, and a mode, which another condition has
    alone.
    """
    rng = np.random.default_rng(0)
    apart = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]) / 1e-4
    clocks = np.linalg.inv(np.eye(3) / 1e-3**2 + apart.T @ apart)
    covariance = np.full((2, n_realizations, 4, 4), np.nan)
    covariance[0, :, 0, 0] = 0.25
    covariance[1, :, 1:, 1:] = clocks
    truth = np.full((2, n_realizations, 4), np.nan)
    truth[0, :, 0], truth[1, :, 1:] = 1.0, 2e-3
    value = truth.copy()
    value[0, :, 0] += 0.5 * rng.standard_normal(n_realizations)
    value[1, :, 1:] += 2.0 * rng.multivariate_normal(np.zeros(3), clocks, n_realizations)
    value[0, 0] = covariance[0, 0] = np.nan
    nan = np.nan
    return SharedUnknowns(
        condition=np.array(["water", "clocks"]),
        realization=np.arange(n_realizations),
        name=np.array(["mode 1", "offset A", "offset B", "offset C"]),
        unit=np.array(["m/s", "s", "s", "s"]),
        prior_sigma=np.array([[1.0, nan, nan, nan], [nan, 1e-3, 1e-3, 1e-3]]),
        value=value,
        truth=truth,
        covariance=covariance,
    )


def test_each_condition_has_its_own_unknowns():
    table = unknowns_table(record())
    assert list(zip(table["condition"], table["unknown"], strict=True)) == [
        ("water", "mode 1"), ("clocks", "offset A"), ("clocks", "offset B"), ("clocks", "offset C"),
    ]  # fmt: skip
    water = table.iloc[0]
    assert water["realizations"] == 399
    assert water["sigma"] == pytest.approx(0.5)
    assert water["resolution"] == pytest.approx(0.75)
    assert water["rms_error"] == pytest.approx(0.5, rel=0.1)
    assert water["error_ratio"] == pytest.approx(1.0, rel=0.2)
    # errors twice as large as they are said to be
    assert np.allclose(table["error_ratio"][1:], 4.0, rtol=0.3)


def test_directions_tell_differences_from_the_time_that_all_share():
    table = directions_table(record())
    clocks = table[table["condition"] == "clocks"]
    assert clocks["direction"].tolist() == [1, 2, 3]
    assert clocks["resolution"].iloc[-1] == pytest.approx(0.0, abs=1e-6)
    assert clocks["combination"].iloc[-1] == "+0.58 offset A +0.58 offset B +0.58 offset C"
    assert (clocks["resolution"].iloc[:2] > 0.98).all()
    assert clocks["seen_so_far"].iloc[-1] == pytest.approx(2.0, abs=0.03)
    np.testing.assert_allclose(clocks["sigma_ratio"] ** 2 + clocks["resolution"], 1.0)
    assert table[table["condition"] == "water"]["combination"].tolist() == ["+1.00 mode 1"]


def test_condition_without_covariances_has_values_but_no_directions():
    u = record()
    covariance = u.covariance.copy()
    covariance[1] = np.nan
    again = replace(u, covariance=covariance)
    assert set(directions_table(again)["condition"]) == {"water"}
    clocks = unknowns_table(again).iloc[1]
    assert np.isnan(clocks["sigma"])
    assert np.isfinite(clocks["rms_error"])


def test_combinations_of_many_are_counted_not_listed():
    n = 7
    eye = np.eye(n)[None, None] - np.full((1, 1, n, n), 1.0 / n) * 0.999
    names = np.array([f"u{i}" for i in range(n)])
    zero = np.zeros((1, 1, n))
    many = SharedUnknowns(
        condition=np.array(["c"]), realization=np.arange(1), name=names, unit=np.full(n, "1"),
        prior_sigma=np.ones((1, n)), value=zero, truth=zero, covariance=eye,
    )  # fmt: skip
    best = directions_table(many)["combination"].iloc[0]
    assert best == "+0.38 u0 +0.38 u1 +0.38 u2 +0.38 u3 and 3 more"
