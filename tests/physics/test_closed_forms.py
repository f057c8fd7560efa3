"""
Profiles whose rays are known in closed form or by one quadrature: constant gradients, parabolas,
Munk's channel, layers.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from oracles import direct_travel_time_linear_gradient
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.records import RayStatus

BOTTOM = 5000.0


def pairs(n, seed):
    """
    Random links of 0.3 to 12 km; a third of them nearly level, so that rays turn between the ends.
    """
    rng = np.random.default_rng(seed)
    source = np.column_stack([np.zeros((n, 2)), rng.uniform(1.0, BOTTOM - 1.0, n)])
    bearing, distance = rng.uniform(0, 2 * np.pi, n), rng.uniform(300.0, 12_000.0, n)
    depth = rng.uniform(1.0, BOTTOM - 1.0, n)
    level = rng.random(n) < 1 / 3
    depth[level] = np.clip(
        source[level, 2] + rng.uniform(-2.0, 2.0, level.sum()), 1.0, BOTTOM - 1.0
    )
    receiver = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), depth])
    return source, receiver


class Arcs(NamedTuple):
    """
    Circular arcs between two points of a linear profile: least and greatest depth, and the angle to
    the chord.
    """

    shallowest: np.ndarray
    deepest: np.ndarray
    wing: np.ndarray


def arcs(source, receiver, c0, g):
    x = np.linalg.norm((receiver - source)[:, :2], axis=1)
    za, zb = c0 / g + source[:, 2], c0 / g + receiver[:, 2]
    centre = (x**2 + zb**2 - za**2) / (2 * x)
    vertex = np.sign(g) * np.hypot(za, centre) - c0 / g
    inside = (centre > 0) & (centre < x)
    low = np.minimum(source[:, 2], receiver[:, 2])
    high = np.maximum(source[:, 2], receiver[:, 2])
    wing = np.arctan2(centre, za) - np.arctan2(receiver[:, 2] - source[:, 2], x)
    shallowest = np.where(inside, np.minimum(low, vertex), low)
    return Arcs(shallowest, np.where(inside, np.maximum(high, vertex), high), np.abs(wing))


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
@pytest.mark.parametrize("gradient", [-0.12, -0.016, 1e-6, 0.017, 0.12])
def test_direct_eigenray_of_a_constant_gradient_is_a_circular_arc(gradient, interpolation):
    """
    Arcs leave up to 0.4 rad from their chords; in the metric ds/c a sphere's area grows as sinh^2(g
    t) / g^2.
    """
    c0 = 1450.0 if gradient > 0 else 2200.0
    levels = np.concatenate(
        [[0, 2, 4, 10, 25, 50, 100, 200, 400, 700], np.arange(1000.0, 6001.0, 500.0)]
    )
    medium = Medium.from_profile(
        levels, c0 + gradient * levels, bottom_depth=BOTTOM, interpolation=interpolation
    )
    source, receiver = pairs(150, seed=7)
    arrivals = find_eigenrays(medium, source, receiver, spreading_cutoff_db=None, tolerance=1e-5)
    first = arrivals.first()
    shallowest, deepest, wing = arcs(source, receiver, c0, gradient)
    wet = (shallowest > 1e-3) & (deepest < BOTTOM - 1e-3)
    lost = shallowest < -1e-3  # would have to come by way of the surface
    grounded = ~lost & (deepest > BOTTOM + 1e-3)
    expected = direct_travel_time_linear_gradient(
        source, receiver, sound_speed_surface=c0, gradient=gradient
    )
    assert wet.sum() > 75
    assert np.count_nonzero(wing[wet] > 0.25) > 5 or abs(gradient) < 0.1
    assert (first.status[wet] == RayStatus.OK).all()
    assert (first.status[lost] == RayStatus.SHADOW).all()
    assert (first.status[grounded] == RayStatus.BLOCKED).all()
    np.testing.assert_allclose(first.travel_time[wet], expected[wet], rtol=0, atol=1e-9)
    distance = np.linalg.norm(receiver - source, axis=1)[arrivals.link]
    speeds = (arrivals.source_sound_speed * arrivals.receiver_sound_speed)[arrivals.link]
    area = (
        speeds * (np.sinh(gradient * arrivals.travel_time) / gradient) ** 2
    )  # tube, made reciprocal
    np.testing.assert_allclose(arrivals.spreading_db, 10 * np.log10(area / distance**2), atol=1e-5)


class Parabolas(NamedTuple):
    """
    Travel times of both parabolas between two points, their launch angles, and the depths that they
    reach.
    """

    time: np.ndarray
    launch: np.ndarray
    deepest: np.ndarray


SURFACE_SPEED, CURVATURE = 1450.0, 6.0e-5  # c = SURFACE_SPEED / sqrt(1 - 2 CURVATURE z)


def parabolas(source, receiver):
    r"""
    Rays of :math:`n^2 = 1 - 2 \gamma z`: :math:`x'' = \nabla n^2 / 2` in the parameter
    :math:`d\sigma = ds / n`.

    With displacement D and :math:`m` the mean of :math:`n^2` at the ends, :math:`u = \sigma^2` at
    the receiver solves :math:`\gamma^2 u^2 / 4 - m u + D^2 = 0`, the travel time is
    :math:`\sigma (m - \gamma^2 u / 6) / c_0`. NaN beyond the caustic, where :math:`m < \gamma D`.
    """
    step = receiver - source
    n2 = [1.0 - 2.0 * CURVATURE * p[:, 2] for p in (source, receiver)]
    mean = 0.5 * (n2[0] + n2[1])
    square = np.sum(step**2, axis=1)
    root = np.sqrt(
        np.where(mean**2 > CURVATURE**2 * square, mean**2 - CURVATURE**2 * square, np.nan)
    )
    time, launch, deepest = [], [], []
    for u in (2.0 * square / (mean + root), 2.0 * (mean + root) / CURVATURE**2):
        sigma = np.sqrt(u)
        down = (step[:, 2] + 0.5 * CURVATURE * u) / sigma
        time.append(sigma * (mean - CURVATURE**2 * u / 6.0) / SURFACE_SPEED)
        launch.append(np.arcsin(down / np.sqrt(n2[0])))
        turn = np.clip(down / CURVATURE, 0.0, sigma)
        deepest.append(source[:, 2] + down * turn - 0.5 * CURVATURE * turn**2)
    return Parabolas(np.array(time), np.array(launch), np.array(deepest))


@pytest.fixture(scope="module")
def parabolic():
    ends = np.geomspace(
        0.5, 25.0, 30
    )  # the natural spline's straight ends bend within the first metres
    depth = np.unique(
        np.concatenate([[0.0], ends, np.arange(40.0, BOTTOM - 30.0, 20.0), BOTTOM - ends, [BOTTOM]])
    )
    speed = SURFACE_SPEED / np.sqrt(1.0 - 2.0 * CURVATURE * depth)
    return Medium.from_profile(depth, speed, bottom_depth=BOTTOM)


def test_both_parabolas_of_a_linear_squared_index_are_found(parabolic):
    rng = np.random.default_rng(3)
    n = 30
    z0, z1 = rng.uniform(100.0, 800.0, (2, n))
    furthest = 1.0 / CURVATURE - z0 - z1  # where both rays merge, if the ends are level
    distance, bearing = furthest * rng.uniform(0.97, 1.01, n), rng.uniform(0.0, 2.0 * np.pi, n)
    source = np.column_stack([np.zeros((n, 2)), z0])
    receiver = np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), z1])
    exact = parabolas(source, receiver)
    wet = exact.deepest < BOTTOM - 1.0
    arrivals = find_eigenrays(parabolic, source, receiver, spreading_cutoff_db=None, tolerance=1e-6)
    assert wet.all(axis=0).sum() > 5  # links on which both rays stay in the water
    assert np.isnan(exact.time[0]).sum() > 2  # links beyond the caustic
    for link in range(n):
        mine = arrivals.link == link
        expected = np.sort(exact.launch[wet[:, link], link])
        order = np.argsort(arrivals.launch_angle[mine])
        assert mine.sum() == expected.size, (link, source[link], receiver[link], expected)
        np.testing.assert_allclose(arrivals.launch_angle[mine][order], expected, rtol=0, atol=1e-6)
        np.testing.assert_allclose(
            np.sort(arrivals.travel_time[mine]),
            np.sort(exact.time[wet[:, link], link]),
            rtol=0,
            atol=2e-9,
        )
    assert (arrivals.status[np.isnan(exact.time[0])] != RayStatus.OK).all()


def munk(depth):
    scaled = 2.0 * (depth - 1300.0) / 1300.0
    return 1500.0 * (1.0 + 0.00737 * (scaled - 1.0 + np.exp(-scaled)))


def munk_loop(ray_parameter):
    """
    Horizontal length, travel time and action of one full loop: quadrature between the turning
    depths.

    ``z = z_mid + half sin(phi)`` takes the inverse roots at the turning depths away; the
    trapezoidal rule then converges exponentially.
    """
    turning = []
    for lo, hi in ((0.0, 1300.0), (1300.0, BOTTOM)):
        inside = lo == 1300.0  # the function a c - 1 rises with distance from the axis
        for _ in range(200):
            mid = 0.5 * (lo + hi)
            if (ray_parameter * munk(mid) < 1.0) == inside:
                lo = mid
            else:
                hi = mid
        turning.append(0.5 * (lo + hi))
    phi = (np.arange(20_000) + 0.5) * np.pi / 20_000 - 0.5 * np.pi
    z = 0.5 * (turning[0] + turning[1]) + 0.5 * (turning[1] - turning[0]) * np.sin(phi)
    dz = 0.5 * (turning[1] - turning[0]) * np.cos(phi) * np.pi / phi.size
    slowness = 1.0 / munk(z)
    vertical = np.sqrt(slowness**2 - ray_parameter**2)
    length = 2.0 * np.sum(ray_parameter / vertical * dz)
    time = 2.0 * np.sum(slowness**2 / vertical * dz)
    action = 2.0 * np.sum(vertical * dz)
    return length, time, action, turning


@pytest.mark.parametrize("launch", [0.03, 0.18, -0.1])
@pytest.mark.parametrize("loops", [1, 2])
def test_loops_in_the_munk_channel_equal_the_quadrature(launch, loops):
    """
    A ray that leaves the axis is back on it, at its launch angle, after whole loops; t = a R + J.
    """
    depth = np.unique(
        np.concatenate([np.geomspace(0.5, 12.0, 16), np.arange(0.0, BOTTOM + 1.0, 12.5)])
    )
    medium = Medium.from_profile(depth, munk(depth), bottom_depth=BOTTOM)
    a = np.cos(launch) / 1500.0
    length, time, action, turning = munk_loop(a)
    assert turning[0] > 20.0
    assert time == pytest.approx(a * length + action, abs=1e-9)
    arrivals = find_eigenrays(
        medium,
        [0.0, 0.0, 1300.0],
        [0.0, loops * length, 1300.0],
        spreading_cutoff_db=None,
        tolerance=1e-5,
    )
    here = np.argmin(np.abs(arrivals.launch_angle - launch))
    assert arrivals.launch_angle[here] == pytest.approx(launch, abs=1e-6)
    assert arrivals.arrival_angle[here] == pytest.approx(launch, abs=1e-6)
    assert arrivals.travel_time[here] == pytest.approx(loops * time, abs=1e-7)
    assert arrivals.turning_points[here] == 2 * loops
    slowness = np.linalg.norm(arrivals.source_slowness[here, :2])
    assert slowness == pytest.approx(a, abs=1e-10)  # the Snell constant


@pytest.mark.parametrize("ends", [(0.0, 60.0), (60.0, 0.0), (10.0, 55.0), (50.0, 20.0)])
def test_vertical_links_are_the_integral_of_slowness(ends):
    """
    Short and steep: the first step may not pass over a layer, whose curvature it would not see.
    """
    depth = np.array([0.0, 21.0, 47.5, 75.0])
    speed = np.array([1480.0, 1472.2, 1462.1, 1469.0])
    medium = Medium.from_profile(depth, speed, bottom_depth=60.0)
    profile = CubicSpline(depth, speed, bc_type="natural")
    cuts = np.unique(np.clip([*ends, *depth], min(ends), max(ends)))
    exact = sum(quad(lambda z: 1.0 / profile(z), a, b, epsabs=1e-15)[0] for a, b in pairwise(cuts))
    arrivals = find_eigenrays(medium, [0.0, 0.0, ends[0]], [0.0, 0.0, ends[1]], canonical=False)
    np.testing.assert_allclose(arrivals.travel_time, [exact], rtol=0, atol=1e-7)
    np.testing.assert_allclose(arrivals.chord_travel_time, [exact], rtol=0, atol=1e-12)
