"""
Oceans believed instead of the true one: statistics at fixed seeds, proportion, and what stays.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from refusals import refused

from pymantaray.errors import OceanError
from pymantaray.geometry import stream
from pymantaray.ocean import column_ocean, mean_ocean, perturb_ocean, vertical_modes
from pymantaray.ocean.perturb import change_sound_speed
from pymantaray.ocean.schema import VARIABLES, validate_ocean
from pymantaray.ocean.seawater import ocean_sound_speed

Z = np.array([0.0, 20.0, 40.0, 60.0, 100.0, 150.0, 250.0, 400.0])
EDGES = np.concatenate([Z[:1], 0.5 * (Z[1:] + Z[:-1]), Z[-1:]])
EQUATIONS = ["teos-10", "del-grosso", "unesco"]


@pytest.fixture(scope="module")
def ocean(closed_form_ocean):
    return closed_form_ocean(
        60.0,
        5.0,
        temperature=lambda z, lat, lon: (
            8.0
            - 0.01 * z
            + np.sin(6.0 * lat + 2.0 * lon) * np.exp(-z / 60.0)
            + 0.3 * np.cos(9.0 * lon) * np.exp(-z / 150.0)
        ),
        salinity=lambda z, _lat, lon: 34.0 + 0.002 * z + 0.01 * lon,
        floor=lambda lat, _lon: np.where(lat > 60.0, 300.0, 500.0),
        n=(12, 14),
        depth=Z,
    )


def speed(ocean, equation="teos-10"):
    return ocean_sound_speed(ocean, equation=equation)


def test_the_pooled_rms_is_the_asked_one_in_expectation(ocean, as_stored):
    """
    Mean of 120 members' mean squares within 4 of its own standard errors, and those below 8 %.
    """
    equation = "unesco"  # the quickest
    c, modes = speed(ocean, equation), vertical_modes(ocean, equation=equation)
    options = {"rms": 0.7, "horizontal_scale": 15e3, "modes": modes, "equation": equation}
    weight = np.diff(EDGES)[:, None, None] * np.isfinite(
        c
    )  # each point counts by its layer's thickness
    squares = np.empty(120)
    for k in range(squares.size):
        member = perturb_ocean(ocean, rng=stream(5, k, "x"), **options)
        squares[k] = np.nansum(weight * (speed(member, equation) - c) ** 2) / weight.sum()
    error = squares.std(ddof=1) / np.sqrt(squares.size)
    assert error < 0.08 * 0.49
    assert abs(squares.mean() - 0.49) < 4.0 * error
    as_stored(modes)


def test_rms_of_the_upper_water(ocean, as_stored):
    c, modes = speed(ocean), vertical_modes(ocean)
    options = {"rms": 1.0, "horizontal_scale": np.inf, "modes": modes}
    whole, upper = (
        speed(perturb_ocean(ocean, rng=np.random.default_rng(2), down_to=d, **options)) - c
        for d in (None, 60.0)
    )
    ratio = np.nanmean(upper[0]) / np.nanmean(whole[0])
    wet = np.isfinite(c).sum(axis=(1, 2))
    layers = (wet * np.diff(edges) for edges in (EDGES, np.minimum(EDGES, 60.0)))
    of_whole, of_top = (np.average(modes.variance @ modes.at(Z) ** 2, weights=w) for w in layers)
    assert ratio == pytest.approx(np.sqrt(of_whole / of_top), rel=1e-3)
    as_stored(modes)


@settings(max_examples=4)
@given(seed=st.integers(0, 2**31), rms=st.floats(0.01, 0.5), equation=st.sampled_from(EQUATIONS))
def test_members_are_valid_repeatable_and_in_proportion_to_rms(ocean, seed, rms, equation):
    before, c = ocean.copy(deep=True), speed(ocean, equation)
    one, again, twice = (
        perturb_ocean(
            ocean, rms=r, horizontal_scale=15e3, rng=np.random.default_rng(seed), equation=equation
        )
        for r in (rms, rms, 2.0 * rms)
    )
    validate_ocean(one)
    assert one.identical(again)
    errors = speed(one, equation) - c, speed(twice, equation) - c
    np.testing.assert_allclose(errors[1], 2.0 * errors[0], rtol=0, atol=1e-5)
    for v in VARIABLES[1:]:
        np.testing.assert_array_equal(one[v.name], ocean[v.name])
    assert f"expected {rms:g} m/s rms" in one.attrs["history"]
    assert ocean.identical(before)


@pytest.mark.parametrize("equation", EQUATIONS)
def test_a_change_of_sound_speed_is_met(ocean, equation, as_stored):
    change = np.random.default_rng(1).uniform(-20.0, 20.0, ocean["water_temp"].shape)
    wet = np.isfinite(ocean["water_temp"].values)
    changed = change_sound_speed(ocean, change, equation=equation)
    difference = speed(changed, equation) - speed(ocean, equation)
    np.testing.assert_allclose(difference[wet], change[wet], rtol=0, atol=2e-6)
    as_stored(changed)


@pytest.mark.parametrize("equation", EQUATIONS)
def test_salinity_adds_what_temperature_cannot(ocean, equation, as_stored):
    colder = ocean.assign(water_temp=ocean["water_temp"].where(ocean["water_temp"].isnull(), -6.5))
    change = np.zeros(ocean["water_temp"].shape)
    change[:2, 1, 1] = (speed(colder, equation) - speed(ocean, equation))[:2, 1, 1]
    changed = change_sound_speed(ocean, change, equation=equation)
    difference = speed(changed, equation) - speed(ocean, equation)
    wet = np.isfinite(difference)
    np.testing.assert_allclose(difference[wet], change[wet], rtol=0, atol=2e-6)
    beyond = change < 0.0
    assert wet[beyond].all()
    np.testing.assert_array_equal(changed["water_temp"].values[beyond], VARIABLES[0].lowest)
    assert np.all(changed["salinity"].values[beyond] < ocean["salinity"].values[beyond] - 1.0)
    np.testing.assert_array_equal(
        changed["salinity"].values[~beyond], ocean["salinity"].values[~beyond]
    )
    as_stored(changed)


def test_the_mean_is_that_of_each_level(ocean, as_stored):
    before = ocean.copy(deep=True)
    mean = mean_ocean(ocean)
    validate_ocean(mean)
    for v in VARIABLES:
        field, true = mean[v.name].values, ocean[v.name].values
        np.testing.assert_array_equal(np.isfinite(field), np.isfinite(true))
        expected = np.broadcast_to(np.nanmean(true, axis=(1, 2), keepdims=True), true.shape)
        np.testing.assert_allclose(
            field[np.isfinite(true)], expected[np.isfinite(true)], rtol=0, atol=1e-12
        )
    assert mean.attrs["history"].startswith("replaced by the horizontal mean of each level")
    assert ocean.identical(before)
    as_stored(mean)


def test_one_column_everywhere_at_rest(ocean, as_stored):
    before = ocean.copy(deep=True)
    i, j = 9, 4  # over the shallow part: 250 m is its deepest level
    place = (float(ocean["lat"][i]) + 0.01, float(ocean["lon"][j]) + 360.02)
    uniform = column_ocean(ocean, place)
    validate_ocean(uniform)
    for name in ("water_temp", "salinity"):
        column = ocean[name].values[:, i, j]
        column = np.where(np.isfinite(column), column, column[6])
        wet = np.isfinite(ocean[name].values)
        np.testing.assert_array_equal(uniform[name], np.where(wet, column[:, None, None], np.nan))
    assert not np.nansum(np.abs(uniform["water_u"].values))
    assert "at rest, carried down from 250 m where deeper" in uniform.attrs["history"]
    assert ocean.identical(before)
    refused(OceanError, "0 N, 0 E is outside the ocean", column_ocean, ocean, (0.0, 0.0))
    as_stored(uniform)


@pytest.mark.parametrize(("change", "message"), [
    ({"rms": -1.0}, "rms is -1; it must be positive"),
    ({"horizontal_scale": 0.0}, "horizontal_scale is 0; it must be positive"),
    ({"down_to": float("nan")}, "down_to is nan; it must be positive"),
    ({"rms": 60.0}, "reduce the change"),
])  # fmt: skip
def test_wrong_arguments_are_refused_in_one_line(ocean, change, message):
    options = {"rms": 1.0, "horizontal_scale": 1e4, "rng": np.random.default_rng(1)} | change
    refused(OceanError, message, perturb_ocean, ocean, **options)
