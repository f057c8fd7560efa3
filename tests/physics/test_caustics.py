"""
The number of caustics of an eigenray: crossings of rays launched beside it, and its bounds by the
turning points.
"""

import numpy as np
import pytest
from factories import front_links, make_front

from pymantaray.acoustics import Medium, find_eigenrays, trace_fan

DEPTH = np.unique(np.concatenate([np.arange(0.0, 600.0, 20.0), np.arange(600.0, 4001.0, 100.0)]))
SCALED = 2.0 * (DEPTH - 1300.0) / 1300.0
DUCTS = {  # sound speed [m/s], depth of its axis and ranges of the links [m]
    "shallow": (
        1445.0 + 15.0 * (1.0 - np.exp(-(((DEPTH - 250.0) / 250.0) ** 2))) + 0.012 * DEPTH,
        250.0,
        (5e3, 25e3),
    ),
    "munk": (1500.0 * (1.0 + 0.00737 * (SCALED - 1.0 + np.exp(-SCALED))), 1300.0, (30e3, 90e3)),
}
BESIDE = 1e-6  # rad


def links(duct, n):
    """Ends of links near the axis of a duct."""
    rng = np.random.default_rng(8)
    _, axis, (least, most) = DUCTS[duct]
    ends = np.zeros((2, n, 3))
    ends[..., 2] = axis + rng.uniform(-150.0, 150.0, (2, n))
    ends[1, :, 0] = rng.uniform(least, most, n)
    return ends


def crossings(medium, source, receiver, launch_angle):
    """
    How often two rays, launched a little above and below an angle, cross on the way to the
    receiver's range.
    """
    step = receiver - source
    distance, azimuth = np.hypot(step[0], step[1]), np.arctan2(step[1], step[0])
    angles = [launch_angle - BESIDE, launch_angle + BESIDE]
    fan = trace_fan(medium, source, azimuth, angles, distance, tolerance=1e-7)
    ranges = np.linspace(0.02, 1.0, 4001) * distance
    depth = []
    for ray in (0, 1):
        own = fan.arrival == ray
        along = np.hypot(*(fan.position[own, :2] - source[:2]).T)
        p = fan.slowness[own]
        slope = p[:, 2] / np.hypot(p[:, 0], p[:, 1])
        k = np.clip(np.searchsorted(along, ranges) - 1, 0, along.size - 2)
        h, t = along[k + 1] - along[k], (ranges - along[k]) / (along[k + 1] - along[k])
        z0, z1, d0, d1 = (
            fan.position[own, 2][k],
            fan.position[own, 2][k + 1],
            slope[k] * h,
            slope[k + 1] * h,
        )
        depth.append(
            z0 + t * (d0 + t * (3 * (z1 - z0) - 2 * d0 - d1 + t * (d0 + d1 - 2 * (z1 - z0))))
        )
    apart = depth[1] - depth[0]
    return np.count_nonzero(apart[1:] * apart[:-1] < 0.0)


@pytest.mark.parametrize("duct", DUCTS)
@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_direct_rays_have_one_caustic_per_turning_point_or_one_less(duct, interpolation):
    medium = Medium.from_profile(
        DEPTH, DUCTS[duct][0], bottom_depth=4000.0, interpolation=interpolation
    )
    arrivals = find_eigenrays(medium, *links(duct, 60))
    assert set(arrivals.turning_points - arrivals.caustics) == {0, 1}
    assert set(arrivals.caustics) >= {0, 1, 2, 3}


@pytest.mark.parametrize("duct", DUCTS)
def test_caustics_are_where_rays_launched_beside_each_other_cross(duct):
    medium = Medium.from_profile(DEPTH, DUCTS[duct][0], bottom_depth=4000.0)
    source, receiver = links(duct, 8)
    arrivals = find_eigenrays(medium, source, receiver, canonical=False)
    found = [
        crossings(medium, source[link], receiver[link], angle)
        for link, angle in zip(arrivals.link, arrivals.launch_angle, strict=True)
    ]
    np.testing.assert_array_equal(arrivals.caustics, found)
    assert set(found) >= {0, 1, 2}


def test_straight_rays_have_no_caustic_after_flat_reflections():
    medium = Medium.from_profile(
        [0.0, 200.0], [1500.0, 1500.0], bottom_depth=200.0, interpolation="smooth"
    )
    layered = Medium.from_profile(
        [0.0, 200.0], [1500.0, 1500.0], bottom_depth=200.0, interpolation="linear"
    )
    for water in (medium, layered):
        arrivals = find_eigenrays(water, [0.0, 0.0, 60.0], [300.0, 900.0, 140.0], 4, 4)
        assert arrivals.link.size == 17
        assert not arrivals.caustics.any()


def test_the_number_of_caustics_is_reciprocal():
    medium, (source, receiver) = make_front(), front_links(20, 3)
    there, back = (
        find_eigenrays(medium, *ends, 1, 1, canonical=False)
        for ends in ((source, receiver), (receiver, source))
    )
    np.testing.assert_array_equal(there.link, back.link)
    np.testing.assert_array_equal(there.caustics, back.caustics)
    assert there.caustics.any()
