"""
Noise of the sea by its physics, slopes and sums; the sonar equation by hand and in its limits.
"""

import numpy as np
import pytest
from scipy.integrate import quad

from pymantaray.acoustics import Sonar, WenzNoise, link_loss_db, probability_of_excess

MODEM = Sonar(source_level_db=185.0, frequency_hz=25e3, bandwidth_hz=5e3, noise=50.0)


def test_thermal_noise_is_that_of_water_in_equilibrium():
    # Mellen (1952): spectral density of pressure 4 pi k T rho f^2 / c
    f = np.array([10e3, 100e3])
    density = 4.0 * np.pi * 1.380649e-23 * 283.0 * 1025.0 * f**2 / 1490.0  # Pa^2/Hz
    np.testing.assert_allclose(
        WenzNoise().components_db(f)[3], 10.0 * np.log10(density / 1e-12), atol=0.5
    )


def test_wind_noise_has_knudsens_levels_and_slope():
    # Knudsen's curves as textbooks print them: 61 to 66 dB at 1 kHz in sea state 3 (wind 5.5 to 8
    # m/s), falling by 5 to 6 dB per octave to some tens of kilohertz
    at_1_khz = [WenzNoise(w).components_db(1e3)[2] for w in (5.5, 8.0)]
    assert 60.0 < at_1_khz[0] < at_1_khz[1] < 67.0
    octave = np.diff(WenzNoise(6.0).components_db([10e3, 20e3])[2])[0]
    assert -6.1 < octave < -5.0


def test_each_source_has_its_formula_and_rules_its_own_frequencies():
    # at 1 kHz lg f = 0: the constants stand alone; at 10 kHz it is 1
    found = WenzNoise(wind_speed=4.0, shipping=1.0).components_db([1e3, 1e4]).T
    ships, wind = -60.0 * np.log10([1.03, 10.03]), -40.0 * np.log10([1.4, 10.4])
    np.testing.assert_allclose(found[0], [17.0, 50.0 + ships[0], 65.0 + wind[0], -15.0], rtol=1e-14)
    np.testing.assert_allclose(found[1], [-13.0, 76.0 + ships[1], 85.0 + wind[1], 5.0], rtol=1e-13)
    ruling = np.argmax(
        WenzNoise(wind_speed=5.0, shipping=0.5).components_db([3.0, 60.0, 5e3, 500e3]), axis=0
    )
    np.testing.assert_array_equal(ruling, [0, 1, 2, 3])


@pytest.mark.parametrize(
    ("middle", "width"), [(25e3, 5e3), (10.5e3, 1e3), (5e3, 9e3), (1e3, 1999.0)]
)
def test_band_level_is_the_integral_of_the_summed_powers(middle, width):
    noise, low = WenzNoise(wind_speed=5.0, shipping=0.7), middle - width / 2

    def power(f):
        return np.sum(10.0 ** (noise.components_db(f) / 10.0))

    points = [low + x for x in (1.0, 30.0, 100.0)]
    total, _ = quad(power, low, middle + width / 2, epsrel=1e-10, points=points, limit=200)
    assert noise.band_level_db(middle, width) == pytest.approx(10.0 * np.log10(total), abs=1e-3)
    assert noise.band_level_db(middle, 1.0) == pytest.approx(
        float(noise.level_db(middle)), abs=1e-6
    )


def test_sonar_equation_by_hand():
    # 185 - (50 + 10 lg 5000) = 98.01; less a loss of 90 leaves 8.01 dB, 1.99 below the threshold of
    # 10
    assert MODEM.noise_level_db == pytest.approx(86.9897, abs=1e-4)
    assert MODEM.snr_db(90.0) == pytest.approx(8.0103, abs=1e-4)
    assert MODEM.figure_of_merit_db == pytest.approx(88.0103, abs=1e-4)
    assert MODEM.detection_probability(90.0) == pytest.approx(0.37, abs=0.001)  # Phi(-0.3316)
    gained = Sonar(185.0, 25e3, 5e3, 50.0, processing_gain_db=20.0)
    assert gained.snr_db(90.0) == pytest.approx(28.0103, abs=1e-4)
    sea = WenzNoise(wind_speed=8.0)
    assert Sonar(185.0, 25e3, 5e3, sea).noise_level_db == sea.band_level_db(25e3, 5e3)


def test_limits_and_missing():
    p = MODEM.detection_probability([-np.inf, np.inf, np.nan, MODEM.figure_of_merit_db])
    np.testing.assert_array_equal(p, [1.0, 0.0, np.nan, 0.5])
    np.testing.assert_array_equal(
        probability_of_excess([-1e-9, 0.0, 5.0, -np.inf, np.nan], 0.0), [0.0, 1.0, 1.0, 0.0, np.nan]
    )


def test_link_takes_its_strongest_arrival_or_their_sum():
    loss, link = [80.0, 5e3, 70.0, 90.0, 5e3], [0, 3, 0, 2, 3]  # the power of 5000 dB underflows
    np.testing.assert_array_equal(link_loss_db(loss, link, 4), [70.0, np.inf, 90.0, 5e3])
    total = link_loss_db(loss, link, 4, combine="sum")
    expected = [-10.0 * np.log10(1e-8 + 1e-7), np.inf, 90.0, 5e3 - 10.0 * np.log10(2.0)]
    np.testing.assert_allclose(total, expected, rtol=1e-14)
    np.testing.assert_array_equal(MODEM.detection_probability(link_loss_db([], [], 2)), [0.0, 0.0])
    for combine in ("strongest", "sum"):  # NaN and equal positions stay
        out = link_loss_db([np.nan, 70.0, -np.inf, np.inf], [0, 0, 1, 2], 3, combine=combine)
        np.testing.assert_array_equal(out, [np.nan, -np.inf, np.inf])
