"""Sonar equation: worked by hand, monotone in everything, 0 and 1 in its limits, true to its own draws."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pymantaray.acoustics import Sonar, WenzNoise, link_loss_db, probability_of_excess
from pymantaray.errors import AcousticsError

MODEM = Sonar(source_level_db=185.0, frequency_hz=25e3, bandwidth_hz=5e3, noise=50.0)
decibels = st.floats(-30.0, 30.0)


def test_sonar_equation_by_hand():
    # 185 - (50 + 10 lg 5000) = 98.01; less a loss of 90 leaves 8.01 dB, 1.99 below the threshold of 10
    assert MODEM.noise_level_db == pytest.approx(86.9897, abs=1e-4)
    assert MODEM.snr_db(90.0) == pytest.approx(8.0103, abs=1e-4)
    assert MODEM.figure_of_merit_db == pytest.approx(88.0103, abs=1e-4)
    assert MODEM.probability_heard(90.0) == pytest.approx(0.37, abs=0.001)  # Phi(-0.3316)
    gained = Sonar(185.0, 25e3, 5e3, 50.0, processing_gain_db=20.0)
    assert gained.snr_db(90.0) == pytest.approx(28.0103, abs=1e-4)


def test_noise_of_the_sea_is_its_level_in_the_band():
    sea = WenzNoise(wind_speed=8.0)
    modem = Sonar(185.0, 25e3, 5e3, sea)
    assert modem.noise_level_db == sea.band_level_db(25e3, 5e3)


@settings(max_examples=60)
@given(loss=st.floats(60.0, 130.0), step=st.floats(0.1, 20.0), spread=st.floats(0.5, 12.0))
def test_probability_is_monotone(loss, step, spread):
    def heard(loss=loss, level=185.0, noise=50.0, threshold=10.0, gain=0.0):
        return float(Sonar(level, 25e3, 5e3, noise, gain, threshold, spread).probability_heard(loss))

    p = heard()
    assert 0.0 <= p <= 1.0
    assert heard(loss=loss + step) <= p <= heard(loss=loss - step)
    assert heard(level=185.0 - step) <= p <= heard(level=185.0 + step)
    assert heard(noise=50.0 + step) <= p <= heard(noise=50.0 - step)
    assert heard(threshold=10.0 + step) <= p <= heard(gain=step)
    if 0.0 < p < 1.0 and 1e-6 < p < 1.0 - 1e-6:
        assert heard(loss=loss + step) < p


def test_more_wind_is_heard_less():
    p = [float(Sonar(185.0, 25e3, 5e3, WenzNoise(w)).probability_heard(95.0)) for w in (0.0, 3.0, 8.0, 15.0)]
    assert np.all(np.diff(p) < 0.0), p


def test_falls_with_range_of_spherical_spreading_and_absorption():
    r = np.geomspace(10.0, 3e4, 200)
    p = MODEM.probability_heard(20.0 * np.log10(r) + 5e-3 * r)
    assert np.all(np.diff(p) <= 0.0)
    assert p[0] == pytest.approx(1.0, abs=1e-12)
    assert p[-1] == pytest.approx(0.0, abs=1e-12)


def test_limits_and_missing():
    p = MODEM.probability_heard([-np.inf, np.inf, np.nan, MODEM.figure_of_merit_db])
    np.testing.assert_array_equal(p, [1.0, 0.0, np.nan, 0.5])
    np.testing.assert_array_equal(
        probability_of_excess([-1e-9, 0.0, 5.0, -np.inf, np.nan], 0.0), [0.0, 1.0, 1.0, 0.0, np.nan]
    )


@given(excess=decibels, spread=st.floats(0.1, 12.0))
@settings(max_examples=30)
def test_excess_and_deficit_are_complements(excess, spread):
    p = probability_of_excess([excess, -excess], spread)
    assert p.sum() == pytest.approx(1.0, abs=1e-12)


def test_probability_is_the_share_of_lognormal_levels_above_the_threshold():
    rng = np.random.default_rng(7)
    n, loss = 200_000, 92.0
    snr = MODEM.snr_db(loss) + MODEM.spread_db * rng.standard_normal(n)
    share = np.mean(snr >= MODEM.threshold_db)
    p = float(MODEM.probability_heard(loss))
    assert share == pytest.approx(p, abs=4.0 * np.sqrt(p * (1.0 - p) / n))


def test_link_takes_its_strongest_arrival_or_their_sum():
    loss, link = [80.0, 70.0, 90.0, 70.0, 70.0], [0, 0, 2, 3, 3]
    np.testing.assert_array_equal(link_loss_db(loss, link, 4), [70.0, np.inf, 90.0, 70.0])
    total = link_loss_db(loss, link, 4, combine="sum")
    expected = [-10.0 * np.log10(1e-8 + 1e-7), np.inf, 90.0, 70.0 - 10.0 * np.log10(2.0)]
    np.testing.assert_allclose(total, expected, rtol=1e-14)
    np.testing.assert_array_equal(MODEM.probability_heard(link_loss_db([], [], 2)), [0.0, 0.0])


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(20.0, 5e3), st.integers(0, 4)), max_size=12))
def test_sum_is_never_weaker_than_the_strongest_and_order_is_nothing(rows):
    loss, link = [r[0] for r in rows], [r[1] for r in rows]
    strongest, total = (link_loss_db(loss, link, 5, combine=c) for c in ("strongest", "sum"))
    assert np.all(total <= strongest)
    assert np.all((total >= strongest - 10.0 * np.log10(12.0) - 1e-9) | np.isinf(strongest))
    np.testing.assert_allclose(link_loss_db(loss[::-1], link[::-1], 5, combine="sum"), total, rtol=1e-12)


def test_links_keep_nan_and_equal_positions():
    for combine in ("strongest", "sum"):
        out = link_loss_db([np.nan, 70.0, -np.inf, np.inf], [0, 0, 1, 2], 3, combine=combine)
        np.testing.assert_array_equal(out, [np.nan, -np.inf, np.inf])


def test_bad_values_are_refused():
    with pytest.raises(AcousticsError, match="source_level_db is inf; must be finite"):
        Sonar(np.inf, 25e3, 5e3)
    with pytest.raises(AcousticsError, match="Sonar: noise is nan"):
        Sonar(185.0, 25e3, 5e3, np.nan)
    with pytest.raises(AcousticsError, match="spread_db is -1; must not be negative"):
        Sonar(185.0, 25e3, 5e3, spread_db=-1.0)
    with pytest.raises(AcousticsError, match="band of 60000 Hz about 25000 Hz"):
        Sonar(185.0, 25e3, 60e3)
    with pytest.raises(AcousticsError, match=r"loss_db has shape \(2,\), link \(1,\)"):
        link_loss_db([1.0, 2.0], [0], 1)
    with pytest.raises(AcousticsError, match="link: 0 to 3; must lie in 0 to 2"):
        link_loss_db([1.0, 2.0], [0, 3], 3)
    with pytest.raises(AcousticsError, match="'rms'; allowed are 'strongest' and 'sum'"):
        link_loss_db([1.0], [0], 1, combine="rms")
