"""Travel times of the two-point solver against closed forms; no stored numbers."""

import math
from itertools import pairwise

import numpy as np
import pytest

from pymantaray.acoustics import Medium, direct_travel_time_linear_gradient, find_eigenrays
from pymantaray.errors import AcousticsError
from pymantaray.records import RayStatus

BOTTOM = 3000.0
LEVELS = np.array([0, 2, 4, 10, 25, 50, 100, 200, 400, 700, 1000, 1500, 2000, 2500, 3000, 4000.0])


def pairs(n, seed, bottom=BOTTOM):
    """Random links of 0.3 to 12 km; a third of them nearly level, so that rays turn between the ends."""
    rng = np.random.default_rng(seed)
    source = np.column_stack([np.zeros((n, 2)), rng.uniform(1.0, bottom - 1.0, n)])
    bearing, distance = rng.uniform(0, 2 * np.pi, n), rng.uniform(300.0, 12_000.0, n)
    depth = rng.uniform(1.0, bottom - 1.0, n)
    level = rng.random(n) < 1 / 3
    depth[level] = np.clip(source[level, 2] + rng.uniform(-2.0, 2.0, level.sum()), 1.0, bottom - 1.0)
    receiver = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), depth])
    return source, receiver


def arc_extremes(source, receiver, c0, g):
    """Least and greatest depth of the circular arc between two points of a linear profile."""
    x = np.linalg.norm((receiver - source)[:, :2], axis=1)
    za, zb = c0 / g + source[:, 2], c0 / g + receiver[:, 2]
    centre = (x**2 + zb**2 - za**2) / (2 * x)
    vertex = np.sign(g) * np.hypot(za, centre) - c0 / g
    inside = (centre > 0) & (centre < x)
    low = np.minimum(source[:, 2], receiver[:, 2])
    high = np.maximum(source[:, 2], receiver[:, 2])
    return np.where(inside, np.minimum(low, vertex), low), np.where(inside, np.maximum(high, vertex), high)


@pytest.mark.parametrize("gradient", [-0.05, -0.016, 1e-6, 0.017, 0.1])
def test_direct_eigenray_of_a_constant_gradient_is_a_circular_arc(gradient):
    c0 = 1450.0 if gradient > 0 else 1650.0
    medium = Medium.from_profile(LEVELS, c0 + gradient * LEVELS, bottom_depth=BOTTOM, interpolation="linear")
    source, receiver = pairs(500, seed=7)
    first = find_eigenrays(medium, source, receiver, spreading_cutoff_db=None).first()
    shallowest, deepest = arc_extremes(source, receiver, c0, gradient)
    wet = (shallowest > 1e-3) & (deepest < BOTTOM - 1e-3)
    lost = shallowest < -1e-3  # would have to come by way of the surface
    grounded = ~lost & (deepest > BOTTOM + 1e-3)
    expected = direct_travel_time_linear_gradient(source, receiver, sound_speed_surface=c0, gradient=gradient)
    assert wet.sum() > 200
    assert (first.status[wet] == RayStatus.OK).all()
    assert (first.status[lost] == RayStatus.SHADOW).all()
    assert (first.status[grounded] == RayStatus.BLOCKED).all()
    np.testing.assert_allclose(first.travel_time[wet], expected[wet], rtol=0, atol=1e-9)


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_isovelocity_travel_time_is_distance_over_speed(interpolation):
    medium = Medium.from_profile(
        LEVELS, np.full(LEVELS.size, 1500.0), bottom_depth=BOTTOM, interpolation=interpolation
    )
    source, receiver = pairs(200, seed=3)
    arrivals = find_eigenrays(medium, source, receiver)
    distance = np.linalg.norm(receiver - source, axis=1)
    assert np.array_equal(arrivals.link, np.arange(200))  # one ray a link
    np.testing.assert_allclose(arrivals.travel_time, distance / 1500.0, rtol=0, atol=1e-11)
    np.testing.assert_allclose(arrivals.chord_travel_time, distance / 1500.0, rtol=1e-13)
    np.testing.assert_allclose(arrivals.spreading_db, 0.0, atol=1e-5)  # dB
    np.testing.assert_allclose(
        arrivals.source_slowness, (receiver - source) / distance[:, None] / 1500.0, rtol=0, atol=1e-11
    )


def test_smooth_medium_of_a_linear_profile_equals_the_linear_medium():
    c = 1450.0 + 0.017 * LEVELS
    source, receiver = pairs(200, seed=11)
    times = [
        find_eigenrays(
            Medium.from_profile(LEVELS, c, bottom_depth=BOTTOM, interpolation=kind),
            source,
            receiver,
            tolerance=1e-6,
        )
        .first()
        .travel_time
        for kind in ("linear", "smooth")
    ]
    assert np.isfinite(times[0]).sum() > 100
    np.testing.assert_allclose(times[1], times[0], rtol=0, atol=1e-9)


def test_spreading_of_a_constant_gradient_is_the_hyperbolic_ball():
    """In the metric ds/c of curvature -g^2 the area of a sphere grows as sinh^2(g t) / g^2."""
    c0, g = 1450.0, 0.05
    medium = Medium.from_profile(LEVELS, c0 + g * LEVELS, bottom_depth=BOTTOM, interpolation="linear")
    source, receiver = pairs(100, seed=5)
    arrivals = find_eigenrays(medium, source, receiver, spreading_cutoff_db=None)
    distance = np.linalg.norm(receiver - source, axis=1)[arrivals.link]
    c_s = arrivals.source_sound_speed[arrivals.link]
    c_r = arrivals.receiver_sound_speed[arrivals.link]
    area = c_s * c_r * (np.sinh(g * arrivals.travel_time) / g) ** 2  # tube, made reciprocal
    np.testing.assert_allclose(arrivals.spreading_db, 10 * np.log10(area / distance**2), atol=1e-5)


def test_travel_time_error_falls_with_the_tolerance():
    depth = np.linspace(0.0, 5000.0, 101)
    scaled = 2.0 * (depth - 1300.0) / 1300.0
    c = 1500.0 * (1.0 + 0.00737 * (scaled - 1.0 + np.exp(-scaled)))  # Munk (1974)
    medium = Medium.from_profile(depth, c, bottom_depth=5000.0)
    source, receiver = pairs(60, seed=2, bottom=2500.0)
    exact = find_eigenrays(medium, source, receiver, tolerance=1e-8).first().travel_time
    errors = [
        np.nanmax(np.abs(find_eigenrays(medium, source, receiver, tolerance=t).first().travel_time - exact))
        for t in (1e-1, 1e-2, 1e-3, 1e-4)
    ]
    assert all(b < a / 2 for a, b in pairwise(errors)), errors
    assert errors[2] < 1e-7, errors


def test_closed_form_needs_a_positive_sound_speed():
    with pytest.raises(AcousticsError, match=r"falls to -50 m/s; it must be positive"):
        direct_travel_time_linear_gradient([0, 0, 0], [0, 0, 1000], sound_speed_surface=950.0, gradient=-1.0)


def test_vertical_link_is_the_integral_of_slowness():
    g, c0 = 0.017, 1450.0
    medium = Medium.from_profile(LEVELS, c0 + g * LEVELS, bottom_depth=BOTTOM, interpolation="linear")
    arrivals = find_eigenrays(medium, [0.0, 0.0, 10.0], [0.0, 0.0, 2900.0])
    expected = math.log((c0 + g * 2900.0) / (c0 + g * 10.0)) / g
    np.testing.assert_allclose(arrivals.travel_time, [expected], rtol=0, atol=1e-10)
    np.testing.assert_allclose(arrivals.launch_angle, [np.pi / 2], atol=1e-9)
