"""
Transmission loss: amplitudes of the image method, circular arcs; reflection at bed and surface by
exact limits.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from refusals import refused
from scipy.integrate import quad

from pymantaray.acoustics import (
    Absorption,
    BoundarySurface,
    FluidBottom,
    GrainSizeBottom,
    IceCover,
    Medium,
    RayPaths,
    SeaSurface,
    find_eigenrays,
    trace_paths,
    transmission_loss,
)
from pymantaray.acoustics.levels.absorption import francois_garrison_db_per_km
from pymantaray.acoustics.levels.loss import find_bounces
from pymantaray.acoustics.reflection import (
    bed_reflection,
    bubble_loss_db,
    coherent_surface_loss_db,
    wave_height_rms,
)
from pymantaray.errors import AcousticsError

C, DEPTH, FREQUENCY = 1500.0, 200.0, 12e3
SOURCE, RECEIVER = np.array([100.0, -50.0, 60.0]), np.array([-500.0, 750.0, 140.0])  # 1000 m apart
RANGE = 1000.0
WAVEGUIDE = Medium.from_profile([0.0, DEPTH], [C, C], bottom_depth=DEPTH)
LINK = (WAVEGUIDE, SOURCE, RECEIVER)
SILT, WIND = FluidBottom.standard("silt"), SeaSurface(7.0)
uniform = Absorption.constant


@pytest.fixture(scope="module")
def arrivals():
    """All with up to two reflections at each boundary."""
    return find_eigenrays(*LINK, 2, 2, tolerance=1e-9)


@pytest.fixture(scope="module")
def paths(arrivals):
    return trace_paths(*LINK, arrivals, tolerance=1e-9)


def image_sources():
    """
    Bounces and length of every image of the source with up to two of each, by the classical series.
    """
    for m in range(-2, 3):
        for sign in (1, -1):
            depth = 2 * m * DEPTH + sign * SOURCE[2]
            surface, bottom = (
                (abs(m), abs(m)) if sign == 1 else ((m - 1, m) if m > 0 else (1 - m, -m))
            )
            if max(surface, bottom) <= 2:
                yield surface, bottom, float(np.hypot(RANGE, depth - RECEIVER[2]))


def test_solver_tracer_and_loss_together_are_the_image_method(arrivals, paths):
    """From the medium alone: delay, amplitude and phase of each, and the parts of the loss."""
    expected = np.array(sorted(image_sources()))
    order = np.lexsort((arrivals.travel_time, arrivals.bottom_bounces, arrivals.surface_bounces))
    s, b, d = expected.T
    np.testing.assert_array_equal(arrivals.surface_bounces[order], s)
    np.testing.assert_array_equal(arrivals.bottom_bounces[order], b)
    np.testing.assert_allclose(arrivals.travel_time[order], d / C, rtol=1e-12, atol=3e-9)
    bare = transmission_loss(*LINK, arrivals, FREQUENCY)
    amplitude = 10.0 ** (-bare.total_db / 20.0) * np.exp(1j * bare.boundary_phase)
    np.testing.assert_allclose(
        amplitude[order], (-1.0) ** s / d, rtol=1e-6
    )  # as the solver's tubes
    for name in ("absorption_db", "surface_db", "bottom_db"):
        assert not np.any(getattr(bare, name))
    angle = np.arccos(RANGE / d)
    r = SILT.coefficient(angle, sound_speed=C)
    for cover in (WIND, IceCover(6.0)):
        loss = transmission_loss(*LINK, arrivals, FREQUENCY, bottom=SILT, surface=cover)
        np.testing.assert_array_equal(loss.geometric_db, bare.geometric_db)
        parts = {
            "surface_db": s * cover.loss_db(angle, FREQUENCY, sound_speed=C),
            "bottom_db": -20.0 * b * np.log10(np.abs(r)),
            "boundary_phase": np.pi * s + b * np.angle(r),
        }
        for name, values in parts.items():
            found = getattr(loss, name)[order]
            np.testing.assert_allclose(found, values, rtol=1e-9, atol=1e-9, err_msg=name)
        total = loss.geometric_db + loss.surface_db + loss.bottom_db
        np.testing.assert_allclose(loss.total_db, total, rtol=1e-14)
    own = Medium.from_profile(
        [0.0, DEPTH],
        [C, C],
        bottom_depth=BoundarySurface(DEPTH, reflection=SILT),
        ice_draft=BoundarySurface(0.0, reflection=IceCover(6.0)),
    )
    same = transmission_loss(own, SOURCE, RECEIVER, arrivals, FREQUENCY)
    np.testing.assert_array_equal(
        same.total_db, loss.total_db
    )  # the medium's reflections are the default
    np.testing.assert_array_equal(same.boundary_phase, loss.boundary_phase)
    bounces = find_bounces(paths)
    counts = np.bincount(bounces.arrival, minlength=arrivals.link.size)
    np.testing.assert_array_equal(counts, arrivals.surface_bounces + arrivals.bottom_bounces)
    np.testing.assert_allclose(bounces.sound_speed, C, rtol=1e-12)


def test_sloping_sea_bed_is_met_at_the_angle_to_its_normal():
    slope, ray = (
        np.radians(10.0),
        np.radians(25.0),
    )  # the bed deepens northward, the ray goes north and down
    normal = np.array([-np.sin(slope), 0.0, np.cos(slope)])
    before = np.array([np.cos(ray), 0.0, np.sin(ray)]) / C
    after = before - 2.0 * (before @ normal) * normal
    paths = RayPaths(
        arrival=[0] * 4,
        position=np.array([[0.0, 0, 0], [1, 0, 1], [1, 0, 1], [2, 0, 1]]),
        slowness=np.array([before, before, after, after]),
        travel_time=[0.0, 1.0, 1.0, 2.0],
        boundary=[0, 2, 2, 0],
    )
    assert find_bounces(paths).grazing_angle[0] == pytest.approx(ray - slope, rel=1e-12)
    refused(
        AcousticsError, "two successive nodes", find_bounces, replace(paths, boundary=[0, 2, 0, 0])
    )


def test_absorption_follows_the_profile_along_every_path(arrivals, paths):
    z, temperature, salinity = profile = [0.0, DEPTH], [12.0, 4.0], [33.0, 34.7]
    water = Absorption.from_profile(*profile)
    loss = transmission_loss(*LINK, arrivals, FREQUENCY, absorption=water, paths=paths)

    def alpha(depth):
        t, s = np.interp(depth, z, temperature), np.interp(depth, z, salinity)
        return (
            float(francois_garrison_db_per_km(FREQUENCY, temperature=t, salinity=s, depth=depth))
            / 1000.0
        )

    for i, angle in enumerate(arrivals.launch_angle):
        turns = ([0.0, DEPTH] if angle < 0.0 else [DEPTH, 0.0]) * 2
        bounces = arrivals.surface_bounces[i] + arrivals.bottom_bounces[i]
        legs = [sorted(pair) for pair in pairwise([SOURCE[2], *turns[:bounces], RECEIVER[2]])]
        expected = sum(quad(alpha, *leg, epsabs=1e-10)[0] for leg in legs) / abs(np.sin(angle))
        assert loss.absorption_db[i] == pytest.approx(expected, rel=1e-6)
    constant = transmission_loss(*LINK, arrivals, FREQUENCY, absorption=uniform(3.0), paths=paths)
    np.testing.assert_allclose(constant.absorption_db, 3e-3 * C * arrivals.travel_time, rtol=1e-12)


def test_all_links_spread_as_spheres_and_absorb_by_their_length():
    source = np.array([[0.0, 0, 50], [0, 0, 10], [20, 30, 100], [0, 0, 50], [0, 0, 50]])
    receiver = np.array([[3000.0, 0, 150], [0, 7000, 190], [20, 30, 120], [0, 0, 50], [0, 0, 500]])

    def loss_of(a, b):
        return transmission_loss(
            WAVEGUIDE, a, b, find_eigenrays(WAVEGUIDE, a, b), FREQUENCY, absorption=uniform(1.2)
        )

    loss = loss_of(source, receiver)  # the last is under the sea bed, that before at one place
    np.testing.assert_array_equal(loss.link, [0, 1, 2, 3])
    distance = np.linalg.norm(receiver - source, axis=1)[:3]
    np.testing.assert_allclose(loss.geometric_db[:3], 20.0 * np.log10(distance), atol=1e-4)
    np.testing.assert_allclose(loss.absorption_db[:3], 1.2e-3 * distance, rtol=1e-6)
    np.testing.assert_allclose(loss.total_db, loss.geometric_db + loss.absorption_db, rtol=1e-12)
    assert loss_of(source[3:4], receiver[3:4]).total_db == loss.total_db[3] == -np.inf
    assert not np.any(loss.boundary_phase)
    assert loss_of(source[4:], receiver[4:]).total_db.size == 0


def test_a_constant_gradient_has_closed_forms_of_loss():
    g, c0 = 0.015, 1450.0
    medium = Medium.from_profile([0.0, 3000.0], [c0, c0 + 3000.0 * g], bottom_depth=3000.0)
    source, receiver = np.array([0.0, 0.0, 800.0]), np.array([6000.0, 5000.0, 500.0])
    water = Absorption.from_profile([0.0, 3000.0], [4.0, -1.0], [32.0, 35.0])
    arrivals = find_eigenrays(medium, source, receiver)
    loss = transmission_loss(medium, source, receiver, arrivals, 25e3, absorption=water)
    assert loss.link.size == 1
    # the metric ds/c is that of hyperbolic space of curvature -g^2: dA/dOmega = c_r^2 sinh^2(g t) /
    # g^2
    c_s, c_r = c0 + g * source[2], c0 + g * receiver[2]
    spreading = 20.0 * np.log10(np.sqrt(c_s * c_r) * np.sinh(g * arrivals.travel_time) / g)
    np.testing.assert_allclose(loss.geometric_db, spreading, atol=1e-4)
    # the circle through both, its centre where c = 0
    r, level = np.linalg.norm((receiver - source)[:2]), -c0 / g
    z0, z1 = source[2] - level, receiver[2] - level
    x = (r**2 + z1**2 - z0**2) / (2.0 * r)
    radius, ends = np.hypot(x, z0), sorted([np.arctan2(z0, -x), np.arctan2(z1, r - x)])

    def alpha(angle):
        z = level + radius * np.sin(angle)
        water = {
            "temperature": 4.0 - 5.0 * z / 3000.0,
            "salinity": 32.0 + 3.0 * z / 3000.0,
            "depth": z,
        }
        return float(francois_garrison_db_per_km(25e3, **water))

    expected = quad(alpha, *ends, epsabs=0.0, epsrel=1e-10)[0] * radius / 1000.0
    assert loss.absorption_db[0] == pytest.approx(expected, rel=1e-5)


def test_loss_is_reciprocal():
    rng = np.random.default_rng(3)
    z = np.array([0.0, 30.0, 80.0, 200.0, 1000.0])
    medium = Medium.from_profile(z, [1480.0, 1478.0, 1462.0, 1466.0, 1478.0], bottom_depth=1000.0)
    water = Absorption.from_profile(z, [8.0, 7.5, 2.0, 3.0, 2.0], [33.0, 33.0, 34.0, 34.8, 34.9])
    a = rng.uniform([0, 0, 5], [10.0, 10.0, 900.0], (12, 3))
    b = rng.uniform([2e3, 2e3, 5], [5e3, 5e3, 900.0], (12, 3))
    ways = [(a, b), (b, a)]
    rays = [find_eigenrays(medium, *ends, canonical=False) for ends in ways]
    there, back = (
        transmission_loss(medium, *ends, arrivals, 15e3, absorption=water)
        for ends, arrivals in zip(ways, rays, strict=True)
    )
    time = np.abs(rays[0].travel_time[:, None] - rays[1].travel_time)
    i, j = np.nonzero((rays[0].link[:, None] == rays[1].link) & (time < 1e-6))
    assert i.size > 8
    np.testing.assert_allclose(there.absorption_db[i], back.absorption_db[j], rtol=1e-4)
    np.testing.assert_allclose(there.total_db[i], back.total_db[j], atol=0.02)


def test_what_does_not_belong_together_is_refused(arrivals, paths):
    def loss(frequency=1e3, ends=LINK[1:], **changes):
        return transmission_loss(
            WAVEGUIDE, *ends, arrivals, frequency, surface=WIND, paths=replace(paths, **changes)
        )

    for options, message in (
        ({"frequency": 0.0}, "frequency_hz is 0 Hz; it must be finite and positive"),
        (
            {"ends": (np.zeros((2, 3)), np.ones((2, 3)))},
            r"for arrivals of 1 links, both must have shape \(1, 3\)",
        ),
        ({"boundary": 0 * paths.boundary}, "disagree on the bounces of 7 arrivals, first 1"),
        (
            {"arrival": paths.arrival + 1},
            "paths: arrival 9; there are only 9 arrivals; trace their paths",
        ),
    ):
        refused(AcousticsError, message, loss, **options)


# Reflection of plane waves at the sea bed

WATER, RHO = 1480.0, 1025.0
ANGLES = np.radians(np.linspace(0.01, 90.0, 181))
lossless = st.builds(FluidBottom, st.floats(1200.0, 4000.0), st.floats(1100.0, 2800.0))


def reflected(angle, bottom, *, speed=WATER):
    return bottom.coefficient(angle, sound_speed=speed)


@settings(max_examples=50)
@given(lossless)
def test_energy_is_conserved_without_attenuation_and_limits_are_exact(bottom):
    r = reflected(ANGLES, bottom)
    # pressure is continuous: 1 + R goes on; its vertical flux, from Snell's law by real
    # trigonometry alone
    cos_below = bottom.sound_speed / WATER * np.cos(ANGLES)
    sin_below = np.sqrt(np.maximum(1.0 - cos_below**2, 0.0))
    z, z_b = RHO * WATER, bottom.density * bottom.sound_speed
    flux = np.abs(1.0 + r) ** 2 * sin_below / z_b
    np.testing.assert_allclose(np.abs(r) ** 2 + flux * z / np.sin(ANGLES), 1.0, atol=1e-6)
    assert complex(reflected(np.pi / 2, bottom)) == pytest.approx((z_b - z) / (z_b + z), abs=1e-12)
    if abs(bottom.sound_speed - WATER) > 1.0:
        assert complex(reflected(1e-9, bottom)) == pytest.approx(-1.0, abs=1e-6)


def test_reflection_is_total_below_the_critical_angle():
    sand = FluidBottom(1650.0, 1900.0)
    critical = float(np.arccos(WATER / 1650.0))
    below = critical * np.array([0.01, 0.3, 0.9, 0.999])
    r = reflected(below, sand)
    np.testing.assert_allclose(np.abs(r), 1.0, atol=1e-12)
    b = np.sqrt(np.cos(below) ** 2 - (WATER / 1650.0) ** 2)
    np.testing.assert_allclose(
        np.angle(r), -2.0 * np.arctan2(b, 1900.0 / RHO * np.sin(below)), atol=1e-12
    )
    assert np.abs(reflected(critical * 1.05, sand)) < 0.9
    m, n = 1500.0 / RHO, WATER / 1450.0
    intromission = np.arctan(np.sqrt((n**2 - 1.0) / (m**2 - n**2)))
    assert abs(reflected(intromission, FluidBottom(1450.0, 1500.0))) < 1e-12


def test_attenuation_takes_energy_as_perturbation_theory_says():
    for name in ("clay", "silt", "sand", "gravel", "moraine"):
        assert np.all(np.abs(reflected(ANGLES, FluidBottom.standard(name))) <= 1.0)
    # below critical, first order in delta: |R| = 1 - 2 m sin(gamma) n0^2 delta / (b (m^2 sin^2
    # gamma + b^2))
    alpha, gamma = 0.01, 0.2
    delta = alpha / (20.0 / np.log(10.0)) / (2.0 * np.pi)  # nepers per radian
    n0, m_sin = WATER / 1700.0, 1800.0 / RHO * np.sin(gamma)
    b = np.sqrt(np.cos(gamma) ** 2 - n0**2)
    lost = 2.0 * m_sin * n0**2 * delta / (b * (m_sin**2 + b**2))
    assert 1.0 - abs(
        complex(reflected(gamma, FluidBottom(1700.0, 1800.0, alpha)))
    ) == pytest.approx(lost, rel=2e-3)


@pytest.mark.parametrize(("gamma", "m", "ratio", "tangent", "expected", "tolerance"), [
    (np.pi / 2, 2.5, 2.5, 0.01374, -2.8, 0.1),
    (np.pi / 2, 2.492, 1.3370, 0.01705, -5.0, 0.5),
    (np.pi / 2, 1.195, 1.0179, 0.02158, -20.0, 0.5),
    (np.pi / 2 - 1.22, 1.149, 0.9873, 0.00386, -32.0, 0.5),
])  # fmt: skip
def test_reflection_coefficient_has_published_values(gamma, m, ratio, tangent, expected, tolerance):
    bottom = FluidBottom(1500.0 * ratio, RHO * m, tangent * 40.0 * np.pi / np.log(10.0))
    r = reflected(gamma, bottom, speed=1500.0)
    assert 20.0 * np.log10(abs(complex(r))) == pytest.approx(expected, abs=tolerance)


# Table 2 of the handbook of APL-UW: grain size, ratios of density and sound speed, loss parameter
TABLE = [
    ("sandy-gravel", -1.0, 2.492, 1.3370, 0.01705),
    ("coarse-sand", 0.5, 2.231, 1.2503, 0.01638),
    ("medium-sand", 1.5, 1.845, 1.1782, 0.01624),
    ("fine-sand", 2.5, 1.451, 1.1073, 0.01602),
    ("very-fine-sand", 3.5, 1.268, 1.0568, 0.01875),
    ("clayey-sand", 4.0, 1.224, 1.0364, 0.02019),
    ("coarse-silt", 4.5, 1.195, 1.0179, 0.02158),
    ("sandy-silt", 5.0, 1.169, 0.9999, 0.01261),
    ("medium-silt", 6.0, 1.149, 0.9873, 0.00386),
    ("fine-silt", 6.5, 1.148, 0.9861, 0.00306),
    ("sandy-clay", 7.0, 1.147, 0.9849, 0.00242),
    ("silty-clay", 8.0, 1.146, 0.9824, 0.00163),
]


@pytest.mark.parametrize(("name", "phi", "density", "speed", "loss"), TABLE)
def test_a_grain_size_has_the_properties_of_the_handbooks_table(name, phi, density, speed, loss):
    bed = bed_reflection(name)
    assert bed == GrainSizeBottom(phi)
    assert bed.density_ratio == pytest.approx(density, abs=6e-4)
    assert bed.sound_speed_ratio == pytest.approx(speed, abs=6e-5)
    assert bed.loss_tangent == pytest.approx(loss, abs=6e-6)
    own = FluidBottom(speed * WATER, density * RHO, loss * 40.0 * np.pi / np.log(10.0))
    np.testing.assert_allclose(reflected(ANGLES, bed), reflected(ANGLES, own), atol=3e-3)
    lost, phase = bed.loss_and_phase(ANGLES, 25e3, sound_speed=np.full(ANGLES.shape, WATER))
    np.testing.assert_allclose(10.0 ** (-lost / 20.0) * np.exp(1j * phase), reflected(ANGLES, bed))
    assert (lost > 0.0).all()


# The surface under wind


def test_wave_height_is_the_integral_of_the_wave_spectrum():
    omega, u = np.geomspace(0.1, 100.0, 20001), 1.026 * 10.0  # at 19.5 m
    spectrum = 0.0081 * 9.81**2 / omega**5 * np.exp(-0.74 * (9.81 / (u * omega)) ** 4)
    sigma = wave_height_rms(10.0)
    assert sigma == pytest.approx(np.sqrt(np.trapezoid(spectrum, omega)), rel=1e-4)
    assert 4.0 * sigma == pytest.approx(2.2, abs=0.1)  # significant height: 0.21 U^2 / g


def test_coherent_loss_is_that_of_gaussian_phases():
    # mean of exp(2 i k zeta sin gamma) over Gaussian elevations, by quadrature
    gamma, f, wind = 0.3, 2e3, 6.0
    x, w = np.polynomial.hermite_e.hermegauss(60)
    zeta = float(wave_height_rms(wind)) * x
    mean = np.sum(w * np.exp(2j * 2.0 * np.pi * f / WATER * zeta * np.sin(gamma))) / np.sum(w)
    loss = coherent_surface_loss_db(gamma, f, wind_speed=wind, sound_speed=WATER)
    assert loss == pytest.approx(-20.0 * np.log10(abs(mean)), rel=1e-9)
    assert SeaSurface(wind, "coherent").loss_db(gamma, f, sound_speed=WATER) == loss


def test_bubble_loss_has_published_values_and_a_limit():
    # test suite of UnderwaterAcoustics.jl: 20 kHz, 10 degrees grazing (80 from the normal), winds
    # of 15, 10, 5
    loss = bubble_loss_db(np.radians(10.0), 20e3, wind_speed=[15.0, 10.0, 5.0])
    np.testing.assert_allclose(loss, [6.5, 3.4, 0.5], atol=0.06)
    sides = bubble_loss_db(0.2, 25e3, wind_speed=[6.0 - 1e-9, 6.0])
    assert sides[0] == pytest.approx(sides[1], rel=1e-7)
    np.testing.assert_array_equal(bubble_loss_db([0.0, 1e-6], 25e3, wind_speed=10.0), 15.0)
    assert np.all(np.diff(bubble_loss_db(0.2, 25e3, wind_speed=np.linspace(0.0, 12.0, 30))) > 0.0)
