"""
Rays through cells with linear sound speed: steps that end at faces agree with circular arcs in
closed form.
"""

import numpy as np
import pytest

from pymantaray.acoustics import Medium, find_eigenrays


@pytest.fixture(scope="module")
def media():
    """
    A layered medium, whose rays are arcs, and one that differs from it by less than rounding of a
    ray, whose rays take steps.
    """
    rng = np.random.default_rng(8)
    depth = np.concatenate([[0.0], np.cumsum(rng.uniform(5.0, 250.0, 14))])
    speed = 1470.0 + np.cumsum(rng.normal(0.0, 4.0, 15)) + 0.012 * depth
    axis = np.linspace(-15e3, 15e3, 13)
    field = np.broadcast_to(speed, (13, 13, 15)) + 1e-10 * rng.normal(size=(13, 13, 1))
    bottom = float(depth[-1])
    arcs = Medium.from_profile(depth, speed, bottom_depth=bottom, interpolation="linear")
    steps = Medium.from_grid(axis, axis, depth, field, bathymetry=bottom, interpolation="linear")
    assert arcs.layered
    assert not steps.layered
    return arcs, steps


def test_steps_that_end_at_faces_are_arcs(media):
    rng = np.random.default_rng(3)
    n, bottom = 80, media[0].depth[-1]
    ends = [
        np.column_stack([rng.uniform(-14e3, 14e3, (n, 2)), rng.uniform(0.5, bottom - 1.0, n)])
        for _ in range(2)
    ]
    arcs, steps = (find_eigenrays(medium, *ends, spreading_cutoff_db=15.0) for medium in media)
    np.testing.assert_array_equal(steps.link, arcs.link)
    assert arcs.link.size > 0.5 * n
    np.testing.assert_allclose(steps.travel_time, arcs.travel_time, rtol=0, atol=1e-9)
    np.testing.assert_allclose(steps.launch_angle, arcs.launch_angle, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(steps.turning_points, arcs.turning_points)


def test_no_ray_is_lost_at_round_distances_from_columns():
    """Steps of 60 m and of their multiples end exactly on columns of this front."""
    north = np.array([0.0, 1000.0, 2200.0, 2700.0, 3100.0, 4500.0, 6000.0])
    depth = np.array([0.0, 50.0, 120.0, 300.0, 700.0, 1200.0])
    front = -6.0 * np.tanh((north - 2700.0) / 600.0)
    speed = 1500.0 + 0.004 * (depth - 300.0) ** 2 / 60.0 + front[:, None]
    field = np.repeat(speed[:, None], 2, axis=1)
    medium = Medium.from_grid(
        north, [-1e3, 1e3], depth, field, bathymetry=1200.0, interpolation="linear"
    )
    place = np.arange(1000.0, 6000.0, 20.0)
    source, times = np.tile([900.0, 0.0, 200.0], (place.size, 1)), []
    for shift in (-0.37, 0.0, 0.37):
        ends = np.zeros((place.size, 3))
        ends[:, 0], ends[:, 2] = place + shift, 210.0
        times.append(find_eigenrays(medium, source, ends).first().travel_time)
    np.testing.assert_allclose(times[1], 0.5 * (times[0] + times[2]), rtol=0.0, atol=1e-8)
