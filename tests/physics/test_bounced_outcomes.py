"""Outcomes of links with bounces: limits and the cut-off, the status of a link, and what a dense fan arrives with."""

import numpy as np
import pytest

from pymantaray.acoustics import Medium, find_eigenrays, trace_fan
from pymantaray.records import RayStatus

SURFACE, BED = 1, 2  # boundary flags of a path
C = 1500.0


def flat(arctic, bottom, interpolation="smooth"):
    return Medium.from_profile(*arctic, bottom_depth=bottom, interpolation=interpolation)


def bounced_fan(medium, depth, distance, angles, most):
    """End depth, travel time, end slowness and bounces of the rays of a fan that reach the distance."""
    fan = trace_fan(
        medium,
        [0.0, 0.0, depth],
        0.0,
        angles,
        distance,
        max_surface_bounces=most[0],
        max_bottom_bounces=most[1],
    )
    last = np.flatnonzero(np.diff(fan.arrival, append=-1))
    counts = [
        np.bincount(fan.arrival, weights=fan.boundary == flag, minlength=len(angles)) / 2
        for flag in (SURFACE, BED)
    ]
    there = np.isclose(fan.position[last, 0], distance, rtol=0, atol=1e-6) & (fan.boundary[last] == 0)
    rows = last[there]
    return fan.position[rows, 2], fan.travel_time[rows], fan.slowness[rows, 2], *(n[there] for n in counts)


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_no_ray_of_a_dense_fan_beats_the_earliest_of_its_family(interpolation, arctic):
    """A fan's ray that ends within a metre arrives, but for that metre, no earlier than the solver's first."""
    medium, most = flat(arctic, 400.0, interpolation), (1, 1)
    angles = np.arange(-0.9, 0.9, 1e-3)
    compared = 0
    for depth, target, distance in ((130.0, 60.0, 2500.0), (30.0, 250.0, 1800.0)):
        z, time, slope, surface, bottom = bounced_fan(medium, depth, distance, angles, most)
        found = find_eigenrays(medium, [0.0, 0.0, depth], [distance, 0.0, target], *most, None)
        near = np.abs(z - target) < 1.0
        for family in {*zip(surface[near], bottom[near], strict=True)}:
            mine = (found.surface_bounces == family[0]) & (found.bottom_bounces == family[1])
            rays = near & (surface == family[0]) & (bottom == family[1])
            # the travel time of the wave front at the receiver, but for its curvature
            at_target = time[rays] - slope[rays] * (z - target)[rays]
            assert mine.any(), (depth, family)
            assert found.travel_time[mine].min() < at_target.min() + 2e-7, (depth, family)
            compared += np.count_nonzero(rays)
    assert compared >= 6, compared


def test_bounce_limits_are_kept_and_asking_for_more_only_adds(front, links):
    source, receiver = links(8, 47)
    source[:, 2] += 20.0
    rows = {}
    for most in ((0, 0), (1, 0), (0, 1), (1, 1), (2, 1), (2, 2)):
        found = find_eigenrays(front, source, receiver, *most)
        assert found.surface_bounces.max() <= most[0]
        assert found.bottom_bounces.max() <= most[1]
        names = ("link", "surface_bounces", "bottom_bounces", "travel_time", "launch_angle")
        rows[most] = np.array(sorted(zip(*(getattr(found, name) for name in names), strict=True)))
    for few, less in rows.items():
        for many, more in rows.items():
            if few[0] <= many[0] and few[1] <= many[1]:
                kept = more[(more[:, 1] <= few[0]) & (more[:, 2] <= few[1])]
                # the same rays, polished from other ends of an interval
                gap = np.abs(kept[:, None] - less[None])
                same = np.all(gap < [0.5, 0.5, 0.5, 2e-9, 1e-6], axis=-1)
                assert same.sum() == len(kept) == len(less), (few, many)
    assert len(rows[2, 2]) > len(rows[1, 1]) > len(rows[0, 0])


def test_a_bounced_arrival_makes_a_link_without_direct_ray_ok(arctic):
    """Behind a ridge and in a shadow; the first arrival and the slowness are those of the bounced ray."""
    north = np.linspace(0.0, 10e3, 11)
    bed = np.where(np.arange(11) == 5, 300.0, 1000.0)[:, None] * np.ones(2)
    speed = np.full((11, 2, 2), C)
    ridge = Medium.from_grid(north, [-5e3, 5e3], [0.0, 1200.0], speed, bathymetry=bed)
    ends = [3000.0, 0.0, 600.0], [7000.0, 0.0, 600.0]
    assert find_eigenrays(ridge, *ends).status[0] == RayStatus.BLOCKED
    assert find_eigenrays(ridge, *ends, 0, 1).status[0] == RayStatus.BLOCKED
    over = find_eigenrays(ridge, *ends, 1, 0)
    first = over.first()
    assert first.status[0] == RayStatus.OK
    assert len(over.link) == 1
    assert first.travel_time[0] == pytest.approx(np.hypot(4000.0, 1200.0) / C, abs=1e-9)
    expected = np.array([4000.0, 0.0, -1200.0]) / np.hypot(4000.0, 1200.0) / C
    np.testing.assert_allclose(first.source_slowness[0], expected, rtol=0, atol=1e-9)
    assert first.shadow_margin[0] == 0.0
    # downward refraction: two shallow places far apart are in shadow but for the bed
    depth = np.linspace(0.0, 1000.0, 11)
    lens = Medium.from_profile(depth, 1500.0 - 0.05 * depth, bottom_depth=1000.0)
    ends = [0.0, 0.0, 50.0], [0.0, 8000.0, 50.0]
    assert find_eigenrays(lens, *ends, 0, 0).status[0] == RayStatus.SHADOW
    found = find_eigenrays(lens, *ends, 0, 2)
    assert found.status[0] == RayStatus.OK
    assert (found.bottom_bounces > 0).all()


def test_the_cut_off_applies_to_bounced_rays_too():
    """With images the spreading is known: the rays at 15 dB of a steep link fall on either side of the limit."""
    medium = Medium.from_profile([0.0, 200.0], [C, C], bottom_depth=200.0)
    ends = [0.0, 0.0, 100.0], [30.0, 0.0, 110.0]
    everything = find_eigenrays(medium, *ends, 3, 3, None)
    for cutoff in (12.0, 15.0, 20.0):
        some = find_eigenrays(medium, *ends, 3, 3, cutoff)
        expected = everything.travel_time[everything.spreading_db <= cutoff]
        np.testing.assert_allclose(some.travel_time, expected, rtol=0, atol=1e-12)
        assert 0 < len(some.link) < len(everything.link)
