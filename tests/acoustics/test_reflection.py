"""Reflection at the sea bed and the surface: exact limits, conservation of energy, published values."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pymantaray.acoustics import FluidBottom, SeaSurface
from pymantaray.acoustics.loss import (
    bubble_loss_db,
    coherent_surface_loss_db,
    reflection_coefficient,
    wave_height_rms,
)
from pymantaray.errors import AcousticsError

C, RHO = 1480.0, 1027.0
ANGLES = np.radians(np.linspace(0.01, 90.0, 181))
lossless = st.builds(FluidBottom, st.floats(1200.0, 4000.0), st.floats(1100.0, 2800.0))


@settings(max_examples=50)
@given(lossless)
def test_energy_is_conserved_without_attenuation(bottom):
    r = reflection_coefficient(ANGLES, bottom, sound_speed=C, density=RHO)
    # pressure is continuous: 1 + R goes on; its vertical flux, from Snell's law by real trigonometry alone
    cos_below = bottom.sound_speed / C * np.cos(ANGLES)
    sin_below = np.sqrt(np.maximum(1.0 - cos_below**2, 0.0))
    flux = np.abs(1.0 + r) ** 2 * sin_below / (bottom.density * bottom.sound_speed)
    np.testing.assert_allclose(np.abs(r) ** 2 + flux * RHO * C / np.sin(ANGLES), 1.0, atol=1e-6)


@settings(max_examples=50)
@given(lossless)
def test_vertical_and_grazing_limits(bottom):
    vertical = reflection_coefficient(np.pi / 2, bottom, sound_speed=C, density=RHO)
    z, z_b = RHO * C, bottom.density * bottom.sound_speed
    assert complex(vertical) == pytest.approx((z_b - z) / (z_b + z), abs=1e-12)
    if abs(bottom.sound_speed - C) > 1.0:
        grazing = reflection_coefficient(1e-9, bottom, sound_speed=C, density=RHO)
        assert complex(grazing) == pytest.approx(-1.0, abs=1e-6)


def test_total_reflection_below_the_critical_angle():
    sand = FluidBottom(1650.0, 1900.0)
    critical = float(np.arccos(C / 1650.0))
    below = critical * np.array([0.01, 0.3, 0.9, 0.999])
    r = reflection_coefficient(below, sand, sound_speed=C, density=RHO)
    np.testing.assert_allclose(np.abs(r), 1.0, atol=1e-12)
    b = np.sqrt(np.cos(below) ** 2 - (C / 1650.0) ** 2)
    np.testing.assert_allclose(np.angle(r), -2.0 * np.arctan2(b, 1900.0 / RHO * np.sin(below)), atol=1e-12)
    assert np.all(np.abs(reflection_coefficient(critical * 1.05, sand, sound_speed=C, density=RHO)) < 0.9)


def test_mud_lets_everything_through_at_the_angle_of_intromission():
    mud = FluidBottom(1450.0, 1500.0)
    m, n = 1500.0 / RHO, C / 1450.0
    intromission = np.arctan(np.sqrt((n**2 - 1.0) / (m**2 - n**2)))
    assert abs(reflection_coefficient(intromission, mud, sound_speed=C, density=RHO)) < 1e-12


@pytest.mark.parametrize("name", ["clay", "silt", "sand", "gravel", "moraine"])
def test_attenuation_takes_energy_and_vanishes_smoothly(name):
    bottom = FluidBottom.standard(name)
    lossy = np.abs(reflection_coefficient(ANGLES, bottom, sound_speed=C))
    assert np.all(lossy <= 1.0)
    nearly = FluidBottom(bottom.sound_speed, bottom.density, 1e-9)
    none = FluidBottom(bottom.sound_speed, bottom.density)
    # square-root sensitivity at the critical angle itself
    np.testing.assert_allclose(
        reflection_coefficient(ANGLES, nearly, sound_speed=C),
        reflection_coefficient(ANGLES, none, sound_speed=C),
        atol=1e-4,
    )


def test_small_attenuation_costs_what_perturbation_says():
    # below critical, first order in delta: |R| = 1 - 2 m sin(gamma) n0^2 delta / (b (m^2 sin^2 gamma + b^2))
    alpha, gamma = 0.01, 0.2
    bottom = FluidBottom(1700.0, 1800.0, alpha)
    delta = alpha / (20.0 / np.log(10.0)) / (2.0 * np.pi)  # nepers per radian
    n0, m_sin = C / 1700.0, 1800.0 / RHO * np.sin(gamma)
    b = np.sqrt(np.cos(gamma) ** 2 - n0**2)
    lost = 2.0 * m_sin * n0**2 * delta / (b * (m_sin**2 + b**2))
    r = reflection_coefficient(gamma, bottom, sound_speed=C, density=RHO)
    assert 1.0 - abs(complex(r)) == pytest.approx(lost, rel=2e-3)


def test_reflection_coefficient_has_published_values():
    # test suite of UnderwaterAcoustics.jl: ratios of density and speed, loss tangent; normal and 20 deg grazing
    def loss(gamma, m, ratio, tangent):
        bottom = FluidBottom(1500.0 * ratio, 1000.0 * m, tangent * 40.0 * np.pi / np.log(10.0))
        r = reflection_coefficient(gamma, bottom, sound_speed=1500.0, density=1000.0)
        return 20.0 * np.log10(abs(complex(r)))

    assert loss(np.pi / 2, 2.5, 2.5, 0.01374) == pytest.approx(-2.8, abs=0.1)
    assert loss(np.pi / 2, 2.492, 1.3370, 0.01705) == pytest.approx(-5.0, abs=0.5)
    assert loss(np.pi / 2, 1.195, 1.0179, 0.02158) == pytest.approx(-20.0, abs=0.5)
    assert loss(np.pi / 2 - 1.22, 1.149, 0.9873, 0.00386) == pytest.approx(-32.0, abs=0.5)


def test_wave_height_is_the_integral_of_the_pierson_moskowitz_spectrum():
    wind, g = 10.0, 9.81
    omega = np.geomspace(0.1, 100.0, 20001)
    u = 1.026 * wind  # at 19.5 m
    spectrum = 0.0081 * g**2 / omega**5 * np.exp(-0.74 * (g / (u * omega)) ** 4)
    sigma = wave_height_rms(wind)
    assert sigma == pytest.approx(np.sqrt(np.trapezoid(spectrum, omega)), rel=1e-4)
    assert 4.0 * sigma == pytest.approx(2.2, abs=0.1)  # significant height: 0.21 U^2 / g


def test_coherent_loss_is_that_of_gaussian_phases():
    # mean of exp(2 i k zeta sin gamma) over Gaussian elevations, by quadrature
    gamma, f, wind = 0.3, 2e3, 6.0
    x, w = np.polynomial.hermite_e.hermegauss(60)
    zeta = float(wave_height_rms(wind)) * x
    mean = np.sum(w * np.exp(2j * 2.0 * np.pi * f / C * zeta * np.sin(gamma))) / np.sum(w)
    loss = coherent_surface_loss_db(gamma, f, wind_speed=wind, sound_speed=C)
    assert loss == pytest.approx(-20.0 * np.log10(abs(mean)), rel=1e-9)


def test_bubble_loss_has_published_values():
    # test suite of UnderwaterAcoustics.jl: 20 kHz, 10 degrees grazing (80 from the normal), winds of 15, 10, 5
    loss = bubble_loss_db(np.radians(10.0), 20e3, wind_speed=[15.0, 10.0, 5.0], ceiling_db=30.0)
    np.testing.assert_allclose(loss, [6.5, 3.4, 0.5], atol=0.06)


def test_bubble_loss_is_continuous_at_breaking_and_capped():
    sides = bubble_loss_db(0.2, 25e3, wind_speed=[6.0 - 1e-9, 6.0])
    assert sides[0] == pytest.approx(sides[1], rel=1e-7)
    np.testing.assert_array_equal(bubble_loss_db([0.0, 1e-6], 25e3, wind_speed=10.0), 15.0)
    assert np.all(np.diff(bubble_loss_db(0.2, 25e3, wind_speed=np.linspace(0.0, 12.0, 30))) > 0.0)


@pytest.mark.parametrize("model", ["bubbles", "coherent"])
def test_sea_surface_grows_with_wind_and_frequency(model):
    def loss(wind, f):
        return float(SeaSurface(wind, model).loss_db(0.15, f, sound_speed=C))

    assert loss(0.0, 10e3) < 1e-2
    assert loss(4.0, 10e3) < loss(8.0, 10e3)
    assert loss(8.0, 5e3) < loss(8.0, 10e3)


def test_bad_values_are_refused():
    with pytest.raises(AcousticsError, match="FluidBottom: density is -1; must be finite and positive"):
        FluidBottom(1600.0, -1.0)
    with pytest.raises(AcousticsError, match="attenuation_db_per_wavelength is nan; must be finite and not"):
        FluidBottom(1600.0, 1800.0, np.nan)
    with pytest.raises(AcousticsError, match="'mud' is unknown; there are clay, silt"):
        FluidBottom.standard("mud")
    with pytest.raises(AcousticsError, match="wind_speed: -3 m/s"):
        SeaSurface(-3.0)
    with pytest.raises(AcousticsError, match="'eckart'; allowed are 'bubbles' and 'coherent'"):
        SeaSurface(3.0, "eckart")
