"""Oceans believed instead of the true one: statistics at fixed seeds, proportion, and what stays."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pymantaray.errors import OceanError
from pymantaray.geometry.streams import stream
from pymantaray.ocean.modes import vertical_modes
from pymantaray.ocean.perturb import perturb_ocean
from pymantaray.ocean.schema import VARIABLES, validate_ocean
from pymantaray.ocean.seawater import sound_speed
from pymantaray.ocean.sound_speed_change import change_sound_speed

Z = np.array([0.0, 20.0, 40.0, 60.0, 100.0, 150.0, 250.0, 400.0])
EDGES = np.concatenate([Z[:1], 0.5 * (Z[1:] + Z[:-1]), Z[-1:]])


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
    z, lat, lon = (ocean[n].values for n in ("depth", "lat", "lon"))
    return sound_speed(
        ocean["water_temp"].values,
        ocean["salinity"].values,
        z[:, None, None],
        lat[:, None],
        lon,
        equation=equation,
    )


def mean_square(change, weights=None):
    """Over the water, each point weighted by its layer's thickness."""
    w = np.diff(EDGES)[:, None, None] * np.isfinite(change)
    return np.nansum(w * change**2) / w.sum()


OPTIONS = {
    "eof": {"horizontal_scale": 15e3},
    "gaussian-process": {"horizontal_scale": 15e3, "vertical_scale": 50.0},
}


@pytest.mark.parametrize("method", OPTIONS)
def test_the_pooled_rms_is_the_asked_one_in_expectation(ocean, method):
    """Mean of 120 members' mean squares within 4 of its own standard errors, and those below 8 %."""
    c = speed(ocean)
    modes = {"modes": vertical_modes(ocean)} if method == "eof" else {}
    squares = np.array([
        mean_square(speed(perturb_ocean(ocean, method, rms=0.7, rng=stream(5, k, "x"), **OPTIONS[method], **modes)) - c)
        for k in range(120)
    ])  # fmt: skip
    error = squares.std(ddof=1) / np.sqrt(squares.size)
    assert error < 0.08 * 0.49
    assert abs(squares.mean() - 0.49) < 4.0 * error


def test_depth_dependent_spread_and_correlations_are_the_asked_ones(ocean):
    """Over 250 members: standard deviation by level, correlation along depth and along the horizontal."""
    c, members = speed(ocean), 250
    spread = ([0.0, 100.0, 400.0], [1.0, 1.0, 0.25])
    rng = np.random.default_rng(11)
    draws = np.array([
        (speed(perturb_ocean(ocean, "gaussian-process", rms=0.5, rng=rng, spread=spread, **OPTIONS["gaussian-process"])) - c)
        for _ in range(members)
    ])  # fmt: skip
    i, j = 2, 3  # over the deep part
    sigma = np.interp(Z, *spread)
    wet = np.isfinite(c)
    weight = np.diff(EDGES)[:, None, None] * wet
    factor = 0.5 / np.sqrt(np.sum(weight * sigma[:, None, None] ** 2) / weight.sum())
    found = draws[:, :, i, j].std(axis=0)
    np.testing.assert_allclose(found, factor * sigma, rtol=4.0 / np.sqrt(2.0 * members))
    deep = np.corrcoef(draws[:, :, i, j].T)
    expected = np.exp(-0.5 * ((Z[:, None] - Z) / 50.0) ** 2)
    assert np.abs(deep - expected).max() < 5.0 / np.sqrt(members)
    from pymantaray.geometry import LocalFrame

    frame = LocalFrame(float(ocean["lat"][i]), float(ocean["lon"][j]))
    for m, n in ((5, 3), (2, 7), (0, 0)):
        apart = np.hypot(*frame.to_local(float(ocean["lat"][m]), float(ocean["lon"][n])))
        rho = np.corrcoef(draws[:, 0, i, j], draws[:, 0, m, n])[0, 1]
        assert abs(rho - np.exp(-0.5 * (apart / 15e3) ** 2)) < 5.0 / np.sqrt(members)


def test_rms_of_the_upper_water(ocean):
    c = speed(ocean)
    options = {"rms": 1.0, "horizontal_scale": np.inf, "modes": vertical_modes(ocean)}
    whole, upper = (
        speed(perturb_ocean(ocean, "eof", rng=np.random.default_rng(2), down_to=d, **options)) - c
        for d in (None, 60.0)
    )
    ratio = np.nanmean(upper[0]) / np.nanmean(whole[0])
    found = options["modes"]
    variance = found.variance @ found.at(Z) ** 2
    layers = np.diff(np.minimum(EDGES, 60.0))
    wet = np.isfinite(c).sum(axis=(1, 2))
    all_of = np.sum(np.diff(EDGES) * wet * variance) / np.sum(np.diff(EDGES) * wet)
    top = np.sum(layers * wet * variance) / np.sum(layers * wet)
    assert ratio == pytest.approx(np.sqrt(all_of / top), rel=1e-3)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    rms=st.floats(0.01, 0.5),
    method=st.sampled_from(sorted(OPTIONS)),
    equation=st.sampled_from(["teos-10", "del-grosso", "unesco"]),
)
def test_members_are_valid_repeatable_and_in_proportion_to_rms(ocean, seed, rms, method, equation):
    c = speed(ocean, equation)
    one, again, twice = (
        perturb_ocean(
            ocean, method, rms=r, rng=np.random.default_rng(seed), equation=equation, **OPTIONS[method]
        )
        for r in (rms, rms, 2.0 * rms)
    )
    validate_ocean(one)
    assert one.identical(again)
    np.testing.assert_allclose(
        speed(twice, equation) - c, 2.0 * (speed(one, equation) - c), rtol=0, atol=1e-5
    )
    for v in VARIABLES[1:]:
        np.testing.assert_array_equal(one[v.name], ocean[v.name])
    assert "history" not in ocean.attrs
    assert f"expected {rms:g} m/s rms" in one.attrs["history"]


def test_other_seeds_are_other_members(ocean):
    a, b = (
        perturb_ocean(ocean, "eof", rms=0.5, horizontal_scale=15e3, rng=stream(1, k, "belief"))
        for k in range(2)
    )
    assert np.nanmax(np.abs(a["water_temp"].values - b["water_temp"].values)) > 0.01


def test_a_change_of_sound_speed_is_met(ocean):
    change = np.random.default_rng(1).uniform(-20.0, 20.0, ocean["water_temp"].shape)
    for equation in ("teos-10", "del-grosso", "unesco"):
        made = change_sound_speed(ocean, change, equation=equation)
        wet = np.isfinite(ocean["water_temp"].values)
        found = speed(made, equation) - speed(ocean, equation)
        np.testing.assert_allclose(found[wet], change[wet], rtol=0, atol=2e-6)
    with pytest.raises(OceanError, match="ask for"):
        change_sound_speed(ocean, np.full(change.shape, -200.0))


@pytest.mark.parametrize("equation", ["teos-10", "del-grosso", "unesco"])
def test_where_no_temperature_can_slow_sound_so_far_salinity_makes_the_rest(ocean, equation):
    wet = np.isfinite(ocean["water_temp"].values)
    colder = ocean.assign(water_temp=ocean["water_temp"].copy(data=np.where(wet, -6.5, np.nan)))
    change = np.zeros(wet.shape)
    change[:2, 1, 1] = (speed(colder, equation) - speed(ocean, equation))[:2, 1, 1]
    made = change_sound_speed(ocean, change, equation=equation)
    found = speed(made, equation) - speed(ocean, equation)
    np.testing.assert_allclose(found[wet], change[wet], rtol=0, atol=2e-6)
    beyond = change < 0.0
    assert wet[beyond].all()
    np.testing.assert_array_equal(made["water_temp"].values[beyond], VARIABLES[0].lowest)
    assert np.all(made["salinity"].values[beyond] < ocean["salinity"].values[beyond] - 1.0)
    np.testing.assert_array_equal(made["salinity"].values[~beyond], ocean["salinity"].values[~beyond])


def test_the_mean_is_that_of_each_level(ocean):
    made = perturb_ocean(ocean, "mean")
    validate_ocean(made)
    for v in VARIABLES:
        field, true = made[v.name].values, ocean[v.name].values
        np.testing.assert_array_equal(np.isfinite(field), np.isfinite(true))
        for level, original in zip(field, true, strict=True):
            np.testing.assert_allclose(level[np.isfinite(level)], np.nanmean(original), rtol=0, atol=1e-12)
    assert made.attrs["history"].startswith("replaced by the horizontal mean of each level")


def test_one_column_everywhere_at_rest(ocean):
    i, j = 9, 4  # over the shallow part: 250 m is its deepest level
    place = (float(ocean["lat"][i]) + 0.01, float(ocean["lon"][j]) + 360.02)
    made = perturb_ocean(ocean, "column", place=place)
    validate_ocean(made)
    for name in ("water_temp", "salinity"):
        column = ocean[name].values[:, i, j]
        column = np.where(np.isfinite(column), column, column[6])
        wet = np.isfinite(ocean[name].values)
        expected = np.where(wet, column[:, None, None], np.nan)
        np.testing.assert_array_equal(made[name], expected)
    assert not np.nansum(np.abs(made["water_u"].values))
    assert "at rest, carried down from 250 m where deeper" in made.attrs["history"]


@pytest.mark.parametrize(("method", "options", "message"), [
    ("noise", {}, "'noise' is unknown; allowed are eof, gaussian-process, mean, column"),
    ("eof", {"rms": 1.0, "horizontal_scale": 1e4}, "perturbation eof: rng needed"),
    ("gaussian-process", {"rng": np.random.default_rng(1)}, "horizontal_scale and rms and vertical_scale needed"),
    ("eof", {"rms": -1.0, "horizontal_scale": 1e4, "rng": np.random.default_rng(1)}, "rms is -1; it must be positive"),
    ("mean", {"rms": 1.0}, "perturbation mean: takes no rms"),
    ("eof", {"rms": 1.0, "horizontal_scale": 1e4, "rng": np.random.default_rng(1), "vertical_scale": 5.0}, "takes no vert"),
    ("column", {"place": (0.0, 0.0)}, "0 N 0 E is outside the ocean's window"),
    ("eof", {"rms": 60.0, "horizontal_scale": 1e4, "rng": np.random.default_rng(1)}, "ask for"),
])  # fmt: skip
def test_wrong_arguments_are_refused_in_one_line(ocean, method, options, message):
    with pytest.raises(OceanError, match=message) as caught:
        perturb_ocean(ocean, method, **options)
    assert "\n" not in str(caught.value)


def test_the_given_ocean_stays_as_it_is(ocean):
    before = ocean.copy(deep=True)
    perturb_ocean(ocean, "mean")
    perturb_ocean(ocean, "column", place=(60.1, 5.0))
    perturb_ocean(ocean, "eof", rms=0.5, horizontal_scale=1e4, rng=np.random.default_rng(1))
    assert ocean.identical(before)


def test_a_synthetic_region_can_be_perturbed(fram_strait):
    made = perturb_ocean(
        fram_strait,
        "eof",
        rms=0.5,
        horizontal_scale=50e3,
        down_to=500.0,
        n_modes=3,
        rng=np.random.default_rng(3),
    )
    change = speed(made) - speed(fram_strait)
    upper = fram_strait["depth"].values <= 500.0
    assert 0.3 < np.sqrt(np.nanmean(change[upper] ** 2)) < 1.2
