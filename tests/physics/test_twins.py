"""
Rays to a receiver just inside a boundary come in pairs: one reaches it directly, its twin after one
more reflection there.

The twin is a ray to the image of the receiver at twice its distance z from the boundary, so its
travel time is longer by 2 z sin(theta) / c, with the angle theta at the boundary. This holds for
rays so steep there that they bend little over z.
"""

import numpy as np
import pytest
from lost_rays import random_links, several_extrema

from pymantaray import open_water
from pymantaray.acoustics import Medium, find_eigenrays

BOTTOM = 600.0
STRONG = 14.0  # dB; the cut-off is 15 dB
BENDING = 0.03  # 1/m; gradients are at most 0.5 1/s


def links(n, seed, near):
    """Sources near a boundary, receivers in the middle of the water to 10 km, in all directions."""
    rng = np.random.default_rng(seed)
    source = np.column_stack([rng.uniform(-8e3, 8e3, (n, 2)), np.full(n, near)])
    bearing, distance = rng.uniform(0.0, 2.0 * np.pi, n), 10.0 ** rng.uniform(2.5, 4.0, n)
    shift = distance[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    return source, np.column_stack([source[:, :2] + shift, rng.uniform(30.0, 400.0, n)])


def twins(rays, distance, at_bottom):
    """Rays that leave away from the boundary, and whether each has a twin."""
    away = np.sign(rays.launch_angle) == (-1.0 if at_bottom else 1.0)
    bounces = rays.bottom_bounces if at_bottom else rays.surface_bounces
    steep = np.sin(rays.launch_angle) ** 2 > BENDING * distance
    kept = np.flatnonzero(away & steep & (bounces == 0) & (rays.spreading_db < STRONG))
    paired = []
    for k in kept:
        twin = (rays.link == rays.link[k]) & ~away & (bounces == 1)
        twin &= (rays.surface_bounces + rays.bottom_bounces) == 1 + (
            rays.surface_bounces + rays.bottom_bounces
        )[k]
        later = rays.travel_time[twin] - rays.travel_time[k]
        expected = 2.0 * distance * abs(rays.source_slowness[k, 2])
        paired.append((np.abs(later - expected) < 0.02 * expected + 1e-10).any())
    return np.array(paired)


def layered(interpolation):
    z = np.array([0.0, 20.0, 50.0, 90.0, 150.0, 300.0, 600.0])
    c = np.array([1470.0, 1462.0, 1455.0, 1461.0, 1466.0, 1470.0, 1478.0])
    return Medium.from_profile(z, c, bottom_depth=BOTTOM, interpolation=interpolation)


@pytest.mark.parametrize("depth", [0.002, 0.01, 0.05, 0.2, 1.0])
@pytest.mark.parametrize(
    "medium", [layered("smooth"), layered("linear"), several_extrema(1)], ids=["s", "l", "3-D"]
)
def test_rays_to_a_receiver_below_the_surface_have_twins(medium, depth):
    source, receiver = links(100, 5, depth)
    has = twins(find_eigenrays(medium, source, receiver, 1, 1), depth, at_bottom=False)
    assert has.size > 75
    assert has.all()


@pytest.mark.parametrize("height", [0.002, 0.01, 0.05, 0.2])
def test_rays_between_ends_above_the_sea_bed_have_twins(height):
    """Both ends are near it, so that one of them is the receiver of the search."""
    z = np.array([0.0, 200.0, 400.0, 500.0, 600.0])
    c = np.array([1500.0, 1490.0, 1484.0, 1481.0, 1480.0])
    medium = Medium.from_profile(z, c, bottom_depth=BOTTOM)
    source, receiver = links(150, 6, BOTTOM - height)
    receiver[:, 2] = source[:, 2]
    has = twins(find_eigenrays(medium, source, receiver, 1, 1), height, at_bottom=True)
    assert has.size > 75
    assert has.all()


def test_rays_that_reflect_between_direct_ones_are_found():
    """From one end, the rays of the first fan on both sides of two of them do not reflect."""
    medium = several_extrema(3)
    ends = [end[17:18] for end in random_links(medium, 18, [7, 3], farthest=12e3)]
    one, other = (find_eigenrays(medium, *both, 1, canonical=False) for both in (ends, ends[::-1]))
    assert np.count_nonzero(one.surface_bounces) == 5
    np.testing.assert_allclose(other.travel_time, one.travel_time, rtol=0.0, atol=1e-7)


def test_rays_between_those_that_reflect_again_are_found():
    """Pairs about a caustic near the surface, which end between 2.6 and 3 km; two are left out."""
    medium, _ = open_water("synthetic:beaufort").at_start
    north = np.linspace(2600.0, 3000.0, 21)
    ends = [
        np.column_stack([r, 0.0 * r, 0.0 * r + z]) for r, z in ((0.0 * north, 1.0), (north, 5.0))
    ]
    one, other = (
        np.bincount(find_eigenrays(medium, *both, 1, canonical=False).link, minlength=21)
        for both in (ends, ends[::-1])
    )
    assert one.sum() == 119
    assert np.abs(one - other).sum() <= 4
