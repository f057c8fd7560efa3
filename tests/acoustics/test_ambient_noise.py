"""Wenz curves: physics of the thermal part, slopes, sums, and levels in bands."""

import numpy as np
import pytest
from scipy.integrate import quad

from pymantaray.acoustics import WenzNoise
from pymantaray.acoustics.sonar import check_band
from pymantaray.errors import AcousticsError


def test_thermal_noise_is_that_of_water_in_equilibrium():
    # Mellen (1952): spectral density of pressure 4 pi k T rho f^2 / c
    f = np.array([10e3, 100e3])
    density = 4.0 * np.pi * 1.380649e-23 * 283.0 * 1025.0 * f**2 / 1490.0  # Pa^2/Hz
    np.testing.assert_allclose(WenzNoise().components_db(f)[3], 10.0 * np.log10(density / 1e-12), atol=0.5)


def test_wind_noise_has_knudsens_levels_and_slope():
    # Knudsen's curves as textbooks print them: 61 to 66 dB at 1 kHz in sea state 3 (wind 5.5 to 8 m/s),
    # falling by 5 to 6 dB per octave to some tens of kilohertz
    at_1_khz = [WenzNoise(w).components_db(1e3)[2] for w in (5.5, 8.0)]
    assert 60.0 < at_1_khz[0] < at_1_khz[1] < 67.0
    octave = np.diff(WenzNoise(6.0).components_db([10e3, 20e3])[2])[0]
    assert -6.1 < octave < -5.0


def test_formulas_at_one_kilohertz():
    # lg f = 0 there: the constants stand alone
    components = WenzNoise(wind_speed=4.0, shipping=1.0).components_db(1e3)
    expected = [17.0, 50.0 - 60.0 * np.log10(1.03), 65.0 - 40.0 * np.log10(1.4), -15.0]
    np.testing.assert_allclose(components, expected, rtol=1e-14)


def test_each_source_rules_its_own_frequencies():
    ruling = np.argmax(WenzNoise(wind_speed=5.0, shipping=0.5).components_db([3.0, 60.0, 5e3, 500e3]), axis=0)
    np.testing.assert_array_equal(ruling, [0, 1, 2, 3])


def test_powers_add():
    noise = WenzNoise(wind_speed=7.0, shipping=0.3)
    f = np.geomspace(1.0, 1e6, 50)
    parts = noise.components_db(f)
    assert np.all(noise.level_db(f) > parts.max(axis=0))
    assert np.all(noise.level_db(f) <= parts.max(axis=0) + 10.0 * np.log10(4.0))
    np.testing.assert_allclose(
        10.0 ** (noise.level_db(f) / 10.0), np.sum(10.0 ** (parts / 10.0), axis=0), rtol=1e-12
    )


@pytest.mark.parametrize(("middle", "width"), [(25e3, 5e3), (10.5e3, 1e3), (5e3, 9e3), (1e3, 1999.0)])
def test_band_level_is_the_integral(middle, width):
    noise = WenzNoise(wind_speed=5.0, shipping=0.7)
    power, _ = quad(
        lambda f: 10.0 ** (float(noise.level_db(f)) / 10.0),
        middle - width / 2,
        middle + width / 2,
        epsrel=1e-10,
        points=[middle - width / 2 + x for x in (1.0, 30.0, 100.0)],
        limit=200,
    )
    assert noise.band_level_db(middle, width) == pytest.approx(10.0 * np.log10(power), abs=1e-3)


def test_narrow_band_is_level_plus_width_and_bands_add():
    noise = WenzNoise()
    assert noise.band_level_db(20e3, 1.0) == pytest.approx(float(noise.level_db(20e3)), abs=1e-6)
    halves = [noise.band_level_db(f, 4e3) for f in (20e3, 24e3)]
    whole = 10.0 * np.log10(np.sum(10.0 ** (np.array(halves) / 10.0)))
    assert noise.band_level_db(22e3, 8e3) == pytest.approx(whole, abs=1e-9)


def test_bad_values_are_refused():
    with pytest.raises(AcousticsError, match="wind_speed is -1 m/s"):
        WenzNoise(wind_speed=-1.0)
    with pytest.raises(AcousticsError, match=r"shipping is 1\.5; must lie in 0 to 1"):
        WenzNoise(shipping=1.5)
    with pytest.raises(AcousticsError, match="frequency_hz: 0; must be positive"):
        WenzNoise().level_db([10.0, 0.0])
    with pytest.raises(AcousticsError, match="band of 20 Hz about 10 Hz"):
        check_band(10.0, 20.0)
