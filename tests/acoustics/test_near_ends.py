"""
Echoes of an instrument at its own position, and ends that differ by less than anything that can be
measured.
"""

import numpy as np
import pytest

from pymantaray.acoustics import Medium, find_eigenrays, trace_paths
from pymantaray.acoustics.levels.loss import geometric_loss_db

SPEED, BED, DEPTH = 1500.0, 200.0, 10.0
TINY = (0.0, 5e-324, 1e-320, 1e-200, 1e-160, 1e-150, 1e-30, 1e-9, 9e-7, 1.1e-6, 1e-5)  # m
ECHOES = np.array(
    [2 * DEPTH, 2 * (BED - DEPTH), 2 * BED, 2 * BED]
)  # m; surface, bed, both in either order


@pytest.fixture(scope="module")
def medium():
    return Medium.from_profile([0.0, 100.0, 200.0], [SPEED] * 3, bottom_depth=BED)


def links(step, direction):
    source = np.array([[0.0, 0.0, DEPTH]])
    return source, source + step * np.array(direction)


@pytest.mark.parametrize(
    "direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, -0.8)]
)
@pytest.mark.parametrize("step", TINY)
def test_an_echo_sounder_hears_its_surface_bed_and_both(medium, step, direction):
    a, b = links(step, direction)
    rays = find_eigenrays(medium, a, b, 1, 1, None)
    assert rays.status.tolist() == [0]
    assert rays.surface_bounces.tolist() == [0, 1, 0, 1, 1]
    assert rays.bottom_bounces.tolist() == [0, 0, 1, 1, 1]
    length = np.linalg.norm((b - a) / (step or 1.0)) * step if (b != a).any() else 0.0
    # the solver moves ends that are closer than a micrometre, and depths of ends differ by the step
    np.testing.assert_allclose(
        rays.travel_time[1:], ECHOES / SPEED, rtol=0, atol=(step + 1e-6) / SPEED
    )
    assert rays.travel_time[0] == pytest.approx(length / SPEED, rel=1e-6, abs=2e-15)
    assert rays.chord_travel_time[0] == pytest.approx(rays.travel_time[0], rel=1e-6, abs=2e-15)
    paths = trace_paths(medium, a, b, rays)
    assert np.unique(paths.arrival).tolist() == [0, 1, 2, 3, 4]
    assert not np.isnan(paths.position).any()
    loss = geometric_loss_db(a, b, rays)
    # spherical spreading over the path, 20 lg of its length
    np.testing.assert_allclose(loss[1:], 20.0 * np.log10(ECHOES), rtol=0, atol=1e-4 + step / DEPTH)
    if not (b != a).any():
        assert loss[0] == -np.inf
        assert np.isnan(rays.source_slowness[0]).all()


@pytest.mark.parametrize(
    ("step", "echoes"), [(0.0, 4), (1e-9, 4), (1e-6, 4), (0.1, 4), (0.9, 4), (1.1, 0), (3.0, 0)]
)
def test_one_instrument_hears_its_echoes_with_the_default_cutoff(medium, step, echoes):
    """Echoes after 20 m and more are 26 dB and more below spherical spreading over 1 m."""
    far = (
        np.array([[0.0, 0.0, DEPTH], [0.0, 0.0, DEPTH]]),
        np.array([[step, 0.0, DEPTH], [900.0, 0.0, DEPTH]]),
    )
    rays = find_eigenrays(medium, *far, 1, 1)
    every = find_eigenrays(medium, *far, 1, 1, None)
    own = rays.link == 0
    assert np.count_nonzero(own) == 1 + echoes
    if echoes:
        np.testing.assert_array_equal(rays.travel_time[own], every.travel_time[every.link == 0])
    assert np.all(np.diff(rays.link) >= 0)
    alone = find_eigenrays(medium, far[0][1:], far[1][1:], 1, 1)
    np.testing.assert_array_equal(rays.travel_time[~own], alone.travel_time)
    assert rays.status.tolist() == [0, 0]


def test_directions_of_the_shortest_rays_are_those_of_their_ends(medium):
    a, b = links(1e-200, (0.6, 0.0, 0.8))
    b[0, :2], b[0, 2] = [6e-201, 0.0], DEPTH
    rays = find_eigenrays(medium, a, b)
    np.testing.assert_allclose(rays.source_slowness[0], [1.0 / SPEED, 0.0, 0.0], rtol=1e-12, atol=0)
    assert rays.travel_time[0] == pytest.approx(6e-201 / SPEED, rel=1e-12)


@pytest.mark.parametrize("depth", [0.0, 1e-7, 100.0, BED])
def test_an_instrument_on_a_boundary_hears_the_other(medium, depth):
    """An inverted echo sounder on the bed hears the surface after 400 m."""
    at = [[1e6, 0.0, depth]]
    rays = find_eigenrays(medium, at, at, 1, 1, None)
    expected = {0.0, 2.0 * depth, 2.0 * (BED - depth), 2.0 * BED}
    found = set(np.round(rays.travel_time * SPEED, 3)) - {0.0}
    assert found == {round(x, 3) for x in expected} - {0.0}


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
@pytest.mark.parametrize("place", [(1000.0, 1000.0), (500.0, 300.0)])
def test_echoes_in_a_varying_ocean_agree_with_the_vertical_integral(interpolation, place):
    axis, levels = np.linspace(0.0, 1000.0, 11), np.array([0.0, 60.0, 120.0, 300.0])
    speed = np.tile([1500.0, 1480.0, 1490.0, 1510.0], (11, 11, 1))
    medium = Medium.from_grid(
        axis, axis, levels, speed, bathymetry=250.0, interpolation=interpolation
    )
    at = np.array([[*place, 40.0]])
    rays = find_eigenrays(medium, at, at, 1, 1, None)
    z = np.linspace(0.0, 250.0, 25_001)
    slowness = 1.0 / medium.sound_speed_at(np.column_stack([np.tile(place, (z.size, 1)), z]))
    down = np.concatenate([[0.0], np.cumsum(0.5 * (slowness[1:] + slowness[:-1]) * np.diff(z))])
    to_surface, to_bed = down[4_000], down[-1] - down[4_000]
    expected = [0.0, 2 * to_surface, 2 * to_bed, 2 * down[-1], 2 * down[-1]]
    np.testing.assert_allclose(np.sort(rays.travel_time), np.sort(expected), rtol=0, atol=1e-9)


def test_links_beside_those_of_coincident_ends_are_as_without_them(medium):
    far = (
        np.array([[0.0, 0.0, 10.0], [50.0, 20.0, 150.0]]),
        np.array([[400.0, 0.0, 30.0], [90.0, 0.0, 60.0]]),
    )
    alone = find_eigenrays(medium, *far, 1, 1, None)
    same = np.array([[5.0, 5.0, 50.0]])
    mixed = find_eigenrays(
        medium, *(np.concatenate([same, end[:1], same, end[1:]]) for end in far), 1, 1, None
    )
    own = np.isin(mixed.link, [1, 3])
    np.testing.assert_array_equal(mixed.travel_time[own], alone.travel_time)
    assert np.all(np.diff(mixed.link) >= 0)
    assert np.bincount(mixed.link)[[0, 2]].tolist() == [5, 5]
    assert mixed.status.tolist() == [0] * 4


def test_a_coincident_link_outside_the_water_has_no_ray(medium):
    rays = find_eigenrays(medium, [[0.0, 0.0, 300.0]], [[0.0, 0.0, 300.0]], 1, 1, None)
    assert rays.travel_time.size == 0
    assert rays.status.tolist() == [3]
