"""
Rays from a source in a duct of `linear` water that varies horizontally: the search leaves out those
that never meet the receiver.
"""

import numpy as np
import pytest

from pymantaray.acoustics import Medium, find_eigenrays

AXIS = 120.0  # m
LEVELS = np.array([0.0, 20.0, 50.0, 80.0, AXIS, 160.0, 220.0, 300.0, 400.0, 600.0, 1000.0, 2000.0])
NORTH = np.linspace(-5e3, 25e3, 11)


def gradient(north):
    """Gradient of the sound speed on both sides of the axis. [1/s]"""
    return 0.05 * (1.0 + 0.3 * np.sin(north / 4e3))


@pytest.fixture(scope="module")
def duct():
    """A duct with its axis at a level; the gradient about it varies to the north."""
    speed = 1480.0 + gradient(NORTH)[:, None] * np.abs(LEVELS - AXIS)
    speed = np.repeat(speed[:, None, :], 2, axis=1)
    return Medium.from_grid(
        NORTH, [-5e3, 5e3], LEVELS, speed, bathymetry=1900.0, interpolation="linear"
    )


def ends_of_rays(angle, distance, step=0.5):
    """Depths below the axis at which rays from the axis end, by RK4 in range. [m]"""
    speed_at_axis = 1480.0

    def rates(r, depth, p):
        g = np.interp(r, NORTH, gradient(NORTH))
        n = speed_at_axis / (speed_at_axis + g * np.abs(depth))
        h = np.sqrt(n * n - p * p)
        return p / h, -(n**3) * g * np.sign(depth) / speed_at_axis / h

    depth, p = np.zeros_like(angle), np.sin(angle)
    for i in range(round(distance / step)):
        r = i * step
        z1, p1 = rates(r, depth, p)
        z2, p2 = rates(r + 0.5 * step, depth + 0.5 * step * z1, p + 0.5 * step * p1)
        z3, p3 = rates(r + 0.5 * step, depth + 0.5 * step * z2, p + 0.5 * step * p2)
        z4, p4 = rates(r + step, depth + step * z3, p + step * p3)
        depth = depth + step / 6.0 * (z1 + 2.0 * z2 + 2.0 * z3 + z4)
        p = p + step / 6.0 * (p1 + 2.0 * p2 + 2.0 * p3 + p4)
    return depth


def test_rays_that_reach_a_receiver_are_not_left_out(duct):
    """Receivers are where rays of another integration end, 0.4 to 30 m from the axis."""
    distance = 4e3
    angle = np.geomspace(8e-3, 0.05, 60) * np.tile([1.0, -1.0], 30)
    depth = ends_of_rays(angle, distance)
    # the farthest are at caustics, where an error of a centimetre decides
    share = np.abs(depth) / (angle**2 * 1480.0 / (2.0 * gradient(0.0)))
    apart = (share > 0.3) & (share < 0.8)
    source = np.tile([0.0, 0.0, AXIS], (angle.size, 1))
    receiver = np.column_stack([np.full(angle.size, distance), 0.0 * angle, AXIS + depth])
    arrivals = find_eigenrays(
        duct, source[apart], receiver[apart], canonical=False, spreading_cutoff_db=None
    )
    assert apart.sum() > 25
    for link, wanted in enumerate(angle[apart]):
        gap = np.abs(arrivals.launch_angle[arrivals.link == link] - wanted)
        assert gap.min(initial=np.inf) < 1e-4, (link, wanted)


@pytest.mark.parametrize("beside", [0.0, 1e-3])
def test_a_source_on_a_minimum_has_the_rays_of_the_other_end(duct, beside):
    """The search from the source traced 1,700 rays with 2,000 steps each, and did not end."""
    rng = np.random.default_rng(4)
    n = 12
    depth = np.concatenate([rng.uniform(170.0, 700.0, n - 4), AXIS + np.array([-30, -4, 4, 30])])
    source = np.tile([0.0, 0.0, AXIS + beside], (n, 1))
    receiver = np.column_stack([rng.uniform(6e3, 20e3, n), rng.uniform(-2e3, 2e3, n), depth])
    there = find_eigenrays(duct, source, receiver, canonical=False)
    back = find_eigenrays(duct, receiver, source, canonical=False)
    assert there.complete.all()
    assert np.array_equal(there.status, back.status)
    assert np.array_equal(there.link, back.link)
    np.testing.assert_allclose(there.travel_time, back.travel_time, rtol=0, atol=1e-7)
    np.testing.assert_allclose(there.launch_angle, -back.arrival_angle, rtol=0, atol=1e-5)
