"""
Rays through water that varies with depth only, against the closed form of linear profiles and an
independent integration.
"""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from oracles import DenseFan
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline, make_interp_spline

from pymantaray.acoustics import Medium, find_eigenrays

BOTTOM = 600.0


def fine_structure(n_levels=301, step=2.0):
    """Sound speed of an upper ocean with a duct and steps of a few metres."""
    rng = np.random.default_rng(11)
    depth = step * np.arange(n_levels)
    noise = np.convolve(rng.normal(0.0, 0.4, n_levels + 4), np.ones(5) / 5.0, "valid")
    duct = -4.0 * np.exp(-(((depth - 120.0) / 50.0) ** 2))
    return depth, 1446.0 + 0.02 * depth + duct + noise


def links(n, seed, deepest):
    rng = np.random.default_rng(seed)
    source = np.column_stack([np.zeros((n, 2)), rng.uniform(1.0, deepest, n)])
    distance, depth = 10.0 ** rng.uniform(2.0, 4.2, n), rng.uniform(1.0, deepest, n)
    return source, np.column_stack([distance, np.zeros(n), depth])


def integrated(profile, depth, angle, distance):
    """Depth and travel time of a ray at a range, by an adaptive method of order 8 in range."""

    def rates(_, y):
        c, slope = profile(y[0]), profile(y[0], 1)
        return [np.tan(y[1]), -slope / c, 1.0 / (c * np.cos(y[1]))]

    end = solve_ivp(
        rates,
        (0.0, distance),
        [depth, angle, 0.0],
        method="DOP853",
        rtol=1e-12,
        atol=1e-10,
        max_step=10.0,
    )
    return end.y[0, -1], end.y[2, -1]


def test_rays_through_fine_structure_end_at_the_receiver():
    depth, speed = fine_structure()
    medium = Medium.from_profile(depth, speed, bottom_depth=BOTTOM)
    assert medium.domain().ladder
    profile = CubicSpline(depth, speed, bc_type="natural")
    source, receiver = links(12, 3, 300.0)
    rays = find_eigenrays(medium, source, receiver)
    horizontal = rays.ray_axis == 0
    assert np.count_nonzero(horizontal) > 15
    for k in np.flatnonzero(horizontal):
        i, angle = rays.link[k], rays.launch_angle[k]
        z, t = integrated(profile, source[i, 2], angle, receiver[i, 0])
        beside, _ = integrated(profile, source[i, 2], angle + 1e-9, receiver[i, 0])
        miss = z - receiver[i, 2]
        # as launch angles that differ by 2e-9; the widest ray tube grows by 1e7 m/rad
        assert abs(miss) < 2e-3 + 2.0 * abs(beside - z)
        slowness = rays.receiver_slowness[k, 2]
        assert t - slowness * miss == pytest.approx(rays.travel_time[k], rel=0.0, abs=2e-10)


def test_linear_profiles_have_the_closed_form_of_arcs():
    source, receiver = links(60, 4, 590.0)
    kinds = [
        find_eigenrays(
            Medium.from_profile(
                [0.0, BOTTOM], [1480.0, 1492.0], bottom_depth=BOTTOM, interpolation=kind
            ),
            source,
            receiver,
            1,
            1,
        )
        for kind in ("smooth", "linear")
    ]
    layer_by_layer = [rays.ray_axis != 1 for rays in kinds]
    counts = [rays.link[there] for rays, there in zip(kinds, layer_by_layer, strict=True)]
    np.testing.assert_array_equal(*counts)
    for name, error in (("travel_time", 1e-12), ("launch_angle", 1e-9), ("spreading_db", 1e-4)):
        values = [
            getattr(rays, name)[there] for rays, there in zip(kinds, layer_by_layer, strict=True)
        ]
        np.testing.assert_allclose(*values, rtol=0.0, atol=error)


def below_levels(depth, speed, interpolation):
    """Sound speed, or its derivative by depth, in the levels of a medium and below them."""
    spline = CubicSpline(depth, speed, bc_type="natural")
    slope = spline(depth[-1], 1)
    if interpolation == "linear":
        spline = make_interp_spline(depth, speed, k=1)
        slope = (speed[-1] - speed[-2]) / (depth[-1] - depth[-2])

    def profile(z, order=0):
        x = max(z - depth[-1], 0.0)
        stretch = 1.0 + (x / 200.0) ** 2
        if order == 1:
            return slope * stretch**-1.5 if x > 0.0 else spline(z, 1)
        return spline(min(z, depth[-1])) + slope * x / np.sqrt(stretch)

    return profile


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_rays_from_below_the_deepest_level_end_at_the_receiver(interpolation):
    depth, speed = np.linspace(0.0, 800.0, 9), 1440.0 + 0.016 * np.linspace(0.0, 800.0, 9)
    speed[3] += 1.5
    medium = Medium.from_profile(depth, speed, bottom_depth=3000.0, interpolation=interpolation)
    profile = below_levels(medium.depth, medium.sound_speed[0, 0], interpolation)
    source = np.array([[0.0, 0.0, z] for z in (2500.0, 1500.0, 1000.0, 900.0)])
    receiver = np.array([[9000.0, 0.0, z] for z in (2000.0, 300.0, 900.0, 850.0)])
    rays = find_eigenrays(medium, source, receiver)
    assert np.unique(rays.link).size == 4
    for k, i in enumerate(rays.link):
        z, t = integrated(profile, source[i, 2], rays.launch_angle[k], receiver[i, 0])
        miss = z - receiver[i, 2]
        assert abs(miss) < 5e-3
        slowness = rays.receiver_slowness[k, 2]
        assert t - slowness * miss == pytest.approx(rays.travel_time[k], rel=0.0, abs=1e-9)


def range_rate(z, a, profile):
    """Range per depth of a ray with the parameter a."""
    c = profile(z)
    return a * c / np.sqrt(1.0 - (a * c) ** 2)


def time_rate(z, a, profile):
    """Travel time per depth of a ray with the parameter a."""
    c = profile(z)
    return 1.0 / (c * np.sqrt(1.0 - (a * c) ** 2))


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_steep_reflections_have_the_integrals_of_snells_law(interpolation):
    depth, speed = fine_structure(31, 20.0)
    medium = Medium.from_profile(depth, speed, bottom_depth=BOTTOM, interpolation=interpolation)
    profile = CubicSpline(depth, speed, bc_type="natural")
    if interpolation == "linear":
        profile = partial(np.interp, xp=depth, fp=speed)
    source, receiver = links(6, 8, 590.0)
    receiver[:, 0] = 300.0
    rays = find_eigenrays(medium, source, receiver, 1, 1)
    steep = np.flatnonzero(rays.ray_axis == 2)
    assert steep.size > 15
    for k in steep:
        i, angle = rays.link[k], rays.launch_angle[k]
        z, a = source[i, 2], np.cos(angle) / profile(source[i, 2])
        turns = [BOTTOM, 0.0] if angle > 0.0 else [0.0, BOTTOM]
        stops = [z, *turns[: rays.surface_bounces[k] + rays.bottom_bounces[k]], receiver[i, 2]]
        distance, time = 0.0, 0.0
        for begin, end in pairwise(stops):
            cuts = np.array([begin, *depth[(depth - begin) * (depth - end) < 0.0], end])
            for low, high in pairwise(np.sort(cuts)):
                distance += quad(range_rate, low, high, (a, profile))[0]
                time += quad(time_rate, low, high, (a, profile))[0]
        miss = distance - receiver[i, 0]
        assert abs(miss) < 1e-3
        assert time - a * miss == pytest.approx(rays.travel_time[k], rel=0.0, abs=1e-12)


def test_no_ray_near_the_grazing_angle_is_lost():
    depth = [0.0, 30.0, 60.0, 100.0, 150.0, 220.0, 300.0, 400.0, 600.0]
    speed = [1440.0, 1438.0, 1441.0, 1445.0, 1440.0, 1437.0, 1442.0, 1446.0, 1450.0]
    medium = Medium.from_profile(depth, speed, bottom_depth=BOTTOM)
    rays = find_eigenrays(medium, [0.0, 0.0, 6.99], [29382.4, 0.0, 168.48], 1, 1)
    near = np.abs(rays.launch_angle - 0.10823) < 1e-4
    assert near.any()
    assert rays.spreading_db[near][0] < 3.0


@pytest.mark.slow
def test_no_ray_is_lost_between_steps_of_sound_speed():
    depth = np.array([0.0, 30.0, 35.0, 100.0, 104.0, 180.0, 190.0, 400.0])
    speed = np.array([1500.0, 1500.0, 1492.0, 1492.0, 1487.0, 1487.0, 1484.0, 1486.0])
    medium = Medium.from_profile(depth, speed, bottom_depth=400.0)
    assert medium.domain().ladder
    profile = CubicSpline(medium.depth, medium.sound_speed[0, 0], bc_type="natural")
    receivers = np.array([[1000.0, 60.0], [1500.0, 25.0], [1600.0, 150.0], [3600.0, 110.0]])
    fan = DenseFan(lambda _: profile, 400.0, 2.0).eigenrays(140.0, receivers, 2e-5, 0.2)
    source = np.tile([0.0, 0.0, 140.0], (len(receivers), 1))
    receiver = np.column_stack([receivers[:, 0], np.zeros(len(receivers)), receivers[:, 1]])
    rays = find_eigenrays(medium, source, receiver)
    strong = np.flatnonzero((fan.spreading < 14.0) & ~fan.grazing)
    assert strong.size > 5
    for k in strong:
        near = (rays.link == fan.link[k]) & (np.abs(rays.travel_time - fan.time[k]) < 1e-6)
        assert (np.abs(rays.launch_angle[near] - fan.angle[k]) < 1e-5).any()
