"""Vertical modes and covariances of sound speed, and random fields of a stated correlation."""

import numpy as np
import pytest
from refusals import refused

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import Cast, read_casts
from pymantaray.ocean.modes import SoundSpeedCovariance, layer_weights, vertical_modes
from pymantaray.ocean.perturb import random_fields
from pymantaray.ocean.seawater import ocean_sound_speed, sound_speed


def columns(ocean, used):
    c = ocean_sound_speed(ocean)[:used]
    return c[:, np.isfinite(c[-1])].T


def test_modes_are_orthonormal_and_carry_the_oceans_variance(beaufort_sea, as_stored):
    found = vertical_modes(beaufort_sea)
    weights = layer_weights(found.depth)
    np.testing.assert_allclose(
        (found.modes * weights) @ found.modes.T, np.eye(len(found.modes)), rtol=0, atol=1e-9
    )
    speed = columns(beaufort_sea, found.depth.size)
    np.testing.assert_allclose(found.mean, speed.mean(axis=0), rtol=0, atol=1e-9)
    amplitudes = ((speed - found.mean) * weights) @ found.modes.T
    np.testing.assert_allclose(
        np.cov(amplitudes.T, bias=True), np.diag(found.variance), rtol=0, atol=1e-9
    )
    pooled = np.mean(((speed - found.mean) ** 2) @ weights)
    assert found.total_variance == pytest.approx(pooled, rel=1e-9)
    assert found.variance.sum() > 0.9999 * found.total_variance
    assert np.all(np.diff(found.variance) < 0.0)
    rebuilt = found.mean + amplitudes @ found.modes
    assert np.mean(((speed - rebuilt) ** 2) @ weights) < 1e-4 * pooled
    as_stored(found)


def test_a_known_mode_is_found(closed_form_ocean, as_stored):
    """Temperature that varies in one shape only gives one mode, of that shape."""
    ocean = closed_form_ocean(
        45.0,
        0.0,
        temperature=lambda z, lat, _: (
            10.0 + 0.1 * (lat - 45.0) * np.exp(-0.5 * ((z - 100.0) / 50.0) ** 2)
        ),
        n=(11, 9),
        depth=np.arange(0.0, 501.0, 10.0),
    )
    found = vertical_modes(ocean)
    shape = np.exp(-0.5 * ((found.depth - 100.0) / 50.0) ** 2)
    shape /= np.sqrt(np.sum(layer_weights(found.depth) * shape**2))
    assert found.variance[0] > 0.999 * found.total_variance
    np.testing.assert_allclose(found.modes[0], shape, rtol=0, atol=0.03)
    assert vertical_modes(ocean, n_modes=1).modes.shape == (1, found.depth.size)
    as_stored(found)


def test_modes_of_casts(shared_data, as_stored):
    casts = read_casts(sorted((shared_data / "casts").glob("beaufort_*ctd*.csv")))
    found = vertical_modes(casts)
    assert len(found.variance) <= len(casts) - 1
    speed = np.array(
        [sound_speed(*c.cell_means(found.depth), found.depth, c.lat, c.lon) for c in casts]
    )
    pooled = np.sum(((speed - speed.mean(axis=0)) ** 2) @ layer_weights(found.depth)) / (
        len(casts) - 1
    )
    assert found.total_variance == pytest.approx(pooled, rel=1e-9)
    with pytest.raises(OceanError, match="levels must be within the samples of all casts"):
        vertical_modes(casts, levels=[0.0, 5_000.0])
    refused(
        OceanError, r"1 column\(s\) down to .*; at least 2 are required", vertical_modes, casts[:1]
    )
    as_stored(found)


def test_columns_that_do_not_differ_have_no_modes():
    # sound speed would still differ by mm/s with latitude, on which pressure at a depth depends
    same = Cast("a", 0.0, 0.0, np.datetime64("2020-01-01"), [0.0, 100.0], [5.0, 4.0], [35.0, 35.0])
    refused(OceanError, "all columns are equal", vertical_modes, [same, same])


def test_covariance_of_modes_is_their_sum_and_falls_with_distance(beaufort_sea, as_stored):
    found = vertical_modes(beaufort_sea, n_modes=4)
    covariance = found.covariance(30e3)
    z = found.depth
    a = np.stack([0.0 * z, 0.0 * z, z], axis=-1)
    expected = np.einsum("k,ki,kj->ij", found.variance, found.modes, found.modes)
    np.testing.assert_allclose(covariance(a[:, None], a[None]), expected, rtol=0, atol=1e-12)
    b = a + np.array([18e3, 24e3, 0.0])
    np.testing.assert_allclose(
        covariance(a, b), np.exp(-0.5) * np.diag(expected), rtol=0, atol=1e-12
    )
    between = covariance([0.0, 0.0, 0.5 * (z[3] + z[4])], [0.0, 0.0, z[9]])
    assert between == pytest.approx(0.5 * (expected[3, 9] + expected[4, 9]))
    points = np.random.default_rng(1).uniform([-5e4, -5e4, 0.0], [5e4, 5e4, 3e3], (60, 3))
    assert np.linalg.eigvalsh(covariance(points[:, None], points[None])).min() > -1e-9
    as_stored(found)


def test_a_covariance_that_is_none_is_refused():
    z = np.arange(0.0, 101.0, 20.0)
    matrix = np.exp(-0.5 * ((z[:, None] - z) / 50.0) ** 2)
    refused(OceanError, "symmetric", SoundSpeedCovariance, z, np.triu(matrix), 1e4)
    refused(OceanError, "horizontal_scale is 0 m", SoundSpeedCovariance, z, matrix, 0.0)


def test_random_fields_have_the_stated_covariance():
    """
    Over 2000 fields: variance, correlation at one and two scales, independence, kurtosis; within 5
    standard errors.
    """
    lat, lon, scale, n = 75.0 + 0.09 * np.arange(9), -140.0 + 0.3 * np.arange(8), 20e3, 2_000
    fields = random_fields(lat, lon, count=n, scale=scale, rng=np.random.default_rng(7))
    north, east = LocalFrame(0.5 * (lat[0] + lat[-1]), 0.5 * (lon[0] + lon[-1])).to_local(
        lat[:, None], lon
    )
    x = np.stack([north, east], axis=-1).reshape(-1, 2)
    expected = np.exp(-0.5 * np.sum((x[:, None] - x) ** 2, axis=-1) / scale**2)
    flat = fields.reshape(n, -1)
    error = np.sqrt((1.0 + expected**2) / n)
    assert np.abs((flat.T @ flat / n - expected) / error).max() < 5.0
    assert np.abs(flat.mean(axis=0)).max() < 5.0 / np.sqrt(n)
    assert np.mean(flat[:, 0] ** 4) == pytest.approx(3.0, abs=5.0 * np.sqrt(96.0 / n))
    assert abs(np.mean(flat[1:, 0] * flat[:-1, 0])) < 5.0 / np.sqrt(n)


class UnitDraws:
    """In a generator's place: 1 for the k-th number drawn and 0 for the rest."""

    def __init__(self, k):
        self.k = k

    def standard_normal(self, shape):
        return (np.arange(np.prod(shape)) == self.k).astype(float).reshape(shape)


def test_the_spline_between_nodes_loses_no_variance():
    """
    Off the lattice's nodes a field is a sum of independent draws: the squares of their weights add
    up to 1.
    """
    lat, lon, total = np.linspace(-0.5, 0.5, 41), np.linspace(-0.5, 0.5, 37), 0.0
    for k in range(10_000):
        (weight,) = random_fields(lat, lon, count=1, scale=40e3, rng=UnitDraws(k))
        if not weight.any():
            break
        total = total + weight**2
    np.testing.assert_allclose(total, 1.0, rtol=0, atol=2e-3)


def test_an_infinite_scale_is_one_number_and_bad_ones_are_refused():
    lat, lon = np.linspace(70.0, 76.0, 5), np.linspace(0.0, 20.0, 6)
    fields = random_fields(lat, lon, count=3, scale=np.inf, rng=np.random.default_rng(1))
    assert np.ptp(fields, axis=(1, 2)).max() == 0.0
    assert np.ptp(fields) > 0.0
    with pytest.raises(
        OceanError, match="nodes across the window; the limit is 1500; use at least"
    ):
        random_fields(lat, lon, count=1, scale=100.0, rng=np.random.default_rng(1))
