"""
Travel times in smooth 3-D media, direct and reflected, against `oracles.Shooting`, which integrates
another Hamiltonian.
"""

import numpy as np
import pytest
from factories import ARCTIC_DEPTH, arctic, front_links, make_front
from oracles import Shooting

from pymantaray.acoustics import Medium, find_eigenrays, trace_paths
from pymantaray.records import RayAxis

BAR, MEDIAN = 0.3e-6, 1e-8  # s


def make_eddies():
    """Two eddies of opposite sign, a surface front and a rough bed, on axes of unequal steps."""
    north = np.array([0.0, 3, 5, 8, 11, 13, 16, 20, 23, 26, 30, 33, 36, 40]) * 1e3
    east = np.linspace(0.0, 36e3, 13)
    depth = np.array(
        [0.0, 4, 10, 20, 35, 50, 75, 100, 150, 200, 300, 450, 700, 1000, 1500, 2200, 3000]
    )
    n, e, z = np.meshgrid(north, east, depth, indexing="ij")
    c = 1449.0 + 0.0165 * z + 6.0 * np.exp(-(((z - 75.0) / 50.0) ** 2))
    c += 8.0 * np.exp(-((n - 15e3) ** 2 + (e - 13e3) ** 2) / 6e3**2 - ((z - 200.0) / 180.0) ** 2)
    c -= 7.0 * np.exp(-((n - 22e3) ** 2 + (e - 20e3) ** 2) / 5e3**2 - ((z - 400.0) / 250.0) ** 2)
    c += 4.0 * np.tanh((e - n + 2e3) / 6e3) * np.exp(-z / 80.0)
    return Medium.from_grid(
        north, east, depth, c, bathymetry=2700.0 + 250.0 * np.sin(n[..., 0] / 5e3)
    )


def make_slope(*, plane):
    """
    A front and an eddy over a bed that slopes both ways, plane or with ridges from cell to cell.
    """
    depth, speed = ARCTIC_DEPTH, arctic(ARCTIC_DEPTH)
    north, east = np.linspace(0.0, 20e3, 11), np.linspace(0.0, 16e3, 9)
    n, e, z = np.meshgrid(north, east, depth, indexing="ij")
    c = speed + 6.0 * np.tanh((n - 10e3) / 4e3) * np.exp(-z / 400.0)
    c += 5.0 * np.exp(-((n - 7e3) ** 2 + (e - 9e3) ** 2) / 4e3**2 - ((z - 150.0) / 120.0) ** 2)
    bed = 500.0 + 0.02 * n[..., 0] + 0.015 * e[..., 0]
    if not plane:
        bed += 25.0 * np.random.default_rng(51).uniform(-1.0, 1.0, bed.shape)
    return Medium.from_grid(north, east, depth, c, bathymetry=bed)


def shallow_links(n, seed):
    """Pairs 0.4 to 4 km apart well inside the sloping ocean, so that no ray leaves it."""
    rng = np.random.default_rng(seed)
    source = rng.uniform((7e3, 5e3, 20.0), (13e3, 11e3, 450.0), (n, 3))
    bearing, distance = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(400.0, 4e3, n)
    receiver = source + np.column_stack(
        [distance * np.cos(bearing), distance * np.sin(bearing), 0 * bearing]
    )
    receiver[:, 2] = rng.uniform(20.0, 450.0, n)
    return source, receiver


def errors(medium, source, receiver, most=(0, 0)):
    """
    Errors of travel times by the number of reflections, for rays not near the cut-off or an edge of
    the bed.

    Where rays diverge by 15 dB the end moves 30 m by a mrad; Newton's linear steps may leave the
    neighbourhood there.
    """
    arrivals, solver = find_eigenrays(medium, source, receiver, *most), Shooting(medium)
    paths = trace_paths(medium, source, receiver, arrivals)
    number = arrivals.surface_bounces + arrivals.bottom_bounces
    lines = ((medium.north, 0), (medium.east, 1))
    edge = np.min(
        [np.abs(paths.position[:, k, None] - axis).min(axis=1) for axis, k in lines], axis=0
    )
    clear = (arrivals.spreading_db < 12.0) | (
        (np.diff(arrivals.link, prepend=-1) > 0) & (number == 0)
    )
    clear[np.unique(paths.arrival[(paths.boundary == 2) & (edge < 1.0)])] = False
    found = {}
    for count in range(sum(most) + 1):
        rows = np.flatnonzero(clear & (number == count))
        rows = rows[np.argsort(arrivals.travel_time[rows])]
        parts = [np.empty(0)]
        for part in np.array_split(
            rows, max(1, rows.size // 40)
        ):  # rays of like length share their steps
            if part.size == 0:
                continue
            walls, times = (
                np.array(v) for v in zip(*(legs(paths, ray) for ray in part), strict=True)
            )
            i = arrivals.link[part]
            launch = arrivals.source_slowness[part] * arrivals.source_sound_speed[i, None]
            exact = solver.times(source[i], receiver[i], launch, walls, times)
            parts.append(np.abs(arrivals.travel_time[part] - exact))
        found[count] = np.concatenate(parts)
    return found


def legs(paths, ray):
    """Walls that a ray meets and the times of its legs."""
    own = paths.arrival == ray
    at = np.flatnonzero(paths.boundary[own] > 0)[::2]
    walls, clock = paths.boundary[own][at], paths.travel_time[own]
    return walls, np.diff(np.concatenate([[0.0], clock[at], clock[-1:]]))


def assert_small(found, least):
    for count, number in least.items():
        assert len(found[count]) >= number, (count, len(found[count]))
        assert found[count].max() < BAR, (count, np.sort(found[count])[-10:])
        assert np.median(found[count]) < MEDIAN, (count, np.median(found[count]))


@pytest.mark.parametrize(
    ("n", "seed"),
    [(5, 21), pytest.param(50, 22, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("make", [pytest.param(make_front, marks=pytest.mark.slow), make_eddies])
def test_direct_travel_times_agree(make, n, seed):
    # deeper: few are lost to the surface
    ends = (end + np.array([0.0, 0.0, 20.0]) for end in front_links(n, seed))
    assert_small(errors(make(), *ends), {0: 0.7 * n})


@pytest.mark.parametrize(
    ("plane", "n", "seed", "most", "least"),
    [
        pytest.param(False, 3, 52, (1, 1), {1: 4, 2: 4}, marks=pytest.mark.slow),
        *(
            pytest.param(plane, 6, 53, (2, 2), {1: 10, 2: 9, 3: 8, 4: 6}, marks=pytest.mark.slow)
            for plane in (True, False)
        ),
    ],
)
def test_reflected_travel_times_agree(plane, n, seed, most, least):
    assert_small(errors(make_slope(plane=plane), *shallow_links(n, seed), most), least)


def test_steep_links_far_from_the_prediction_keep_their_arrival():
    """
    Speeds of 1,400 to 1,600 m/s within 20 m: the start of Newton's method from the mean speed
    fails, and rays about the chord follow.
    """
    depth, profile = (
        np.array([0.0, 20, 40, 300, 600, 1000]),
        np.array([1400.0, 1400, 1600, 1600, 1420, 1500]),
    )
    axis = np.linspace(-5e3, 5e3, 4)
    speed = np.broadcast_to(profile, (4, 4, 6)).copy()
    medium = Medium.from_grid(axis, axis, depth, speed, bathymetry=np.full((4, 4), 1000.0))
    source, receiver = np.zeros((5, 3)), np.zeros((5, 3))
    source[:, 2], receiver[:, 2] = (
        [165.8, 19.6, 150.4, 108.8, 11.1],
        [48.8, 186.6, 25.0, 16.5, 166.7],
    )
    receiver[:, 0] = [336.6, 374.6, 250.2, 249.3, 457.5]
    arrivals = find_eigenrays(medium, source, receiver)
    np.testing.assert_array_equal(arrivals.link, np.arange(5))
    assert np.all(arrivals.ray_axis == RayAxis.CHORD)
    assert errors(medium, source, receiver)[0].max() < BAR
