"""Outcomes of links: statuses, degenerate positions, ducts, and what may not be asked."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pymantaray.acoustics import Medium, find_eigenrays, ray_picture
from pymantaray.errors import AcousticsError
from pymantaray.records import RayStatus

Z = np.array([0.0, 2, 5, 10, 20, 40, 60, 100, 150, 250, 400, 700, 1200, 2000, 3000, 4000])
DUCT = 1440.0 + 0.016 * Z + 8.0 * np.exp(-(((Z - 60) / 25.0) ** 2))


def uniform(interpolation="smooth", speed=DUCT, bottom=3500.0):
    return Medium.from_profile(Z, speed, bottom_depth=bottom, interpolation=interpolation)


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_equal_positions_have_travel_time_zero(interpolation):
    first = find_eigenrays(uniform(interpolation), [10.0, 20.0, 30.0], [10.0, 20.0, 30.0]).first()
    assert first.status[0] == RayStatus.OK
    assert first.travel_time[0] == 0.0
    assert np.isnan(first.source_slowness).all()


@pytest.mark.parametrize(
    ("source", "receiver"),
    [
        ([0, 0, -1.0], [1e3, 0, 100.0]),  # in the air
        ([0, 0, 100.0], [1e3, 0, 3501.0]),  # in the sea bed
    ],
)
def test_positions_outside_the_water_are_a_status(source, receiver):
    first = find_eigenrays(uniform(), source, receiver).first()
    assert first.status[0] == RayStatus.OUTSIDE
    assert np.isnan(first.travel_time[0])


def test_positions_outside_the_grid_are_a_status():
    n = np.linspace(0, 1e4, 5)
    medium = Medium.from_grid(n, n, Z, np.broadcast_to(DUCT, (5, 5, 16)), bathymetry=np.full((5, 5), 3500.0))
    first = find_eigenrays(medium, [[5e3, 5e3, 10.0]] * 2, [[1.1e4, 5e3, 10.0], [6e3, 6e3, 10.0]]).first()
    assert list(first.status) == [RayStatus.OUTSIDE, RayStatus.OK]


def test_ends_on_surface_and_bottom_are_in_the_water():
    medium = uniform(speed=np.full(Z.size, 1500.0))
    first = find_eigenrays(medium, [0, 0, 0.0], [2e3, 0, 3500.0]).first()
    assert first.status[0] == RayStatus.OK
    np.testing.assert_allclose(first.travel_time, np.hypot(2e3, 3500.0) / 1500.0, rtol=1e-12)


def test_sea_mount_blocks_the_link_and_its_flank_does_not():
    north, east = np.linspace(0, 2e4, 21), np.linspace(0, 1e4, 11)
    bottom = np.full((21, 11), 3500.0)
    bottom[10, 5] = 200.0  # one peak: between the cell edges a ray would tunnel through
    medium = Medium.from_grid(north, east, Z, np.full((21, 11, 16), 1500.0), bathymetry=bottom)
    source = [[5e3, 5e3, 800.0], [5e3, 5e3, 800.0]]
    receiver = [[15e3, 5e3, 800.0], [15e3, 8.5e3, 800.0]]
    first = find_eigenrays(medium, source, receiver).first()
    assert list(first.status) == [RayStatus.BLOCKED, RayStatus.OK]


def test_upward_refraction_makes_a_shadow_below_which_the_margin_is_reported():
    """Where sound speed falls with depth, rays from near the surface bend down, away from a far neighbour."""
    c = 1500.0 - 0.05 * np.minimum(Z, 200.0)
    medium = uniform(speed=c)
    first = find_eigenrays(medium, [0, 0, 5.0], [8e3, 0, 10.0]).first()
    assert first.status[0] == RayStatus.SHADOW
    near = find_eigenrays(medium, [0, 0, 5.0], [300.0, 0, 10.0]).first()
    assert near.status[0] == RayStatus.OK
    assert near.shadow_margin[0] == 0.0
    assert np.isfinite(first.chord_travel_time[0])  # dropouts carry it too


def test_duct_carries_several_arrivals_that_a_dense_fan_confirms():
    """A brute-force fan of 40,001 rays brackets as many changes of sign of the miss as there are eigenrays."""
    from numba import njit

    from pymantaray.acoustics._kernels.layout import MISS, workspace
    from pymantaray.acoustics._kernels.link import prepare
    from pymantaray.acoustics._kernels.search import shoot
    from pymantaray.acoustics._kernels.trace import direct_course

    medium = uniform()
    axis_depth = 115.0
    source, receiver = np.array([0.0, 0.0, axis_depth]), np.array([9e3, 0.0, axis_depth + 20.0])
    arrivals = find_eigenrays(medium, source, receiver, spreading_cutoff_db=None, canonical=False)

    @njit(_nrt=False)
    def trace_all(domain, source, receiver, angles, work, miss):
        section, walls, link = prepare(domain, source, receiver, work)
        for i in range(angles.size):
            shoot(section, walls, direct_course(link, False), angles[i], 1e-3, 0.0, work.node, work)
            miss[i] = work.node[MISS]

    angles = np.linspace(-0.3, 0.3, 40_001)
    miss = np.empty(angles.size)
    trace_all(medium.domain(), source, receiver, angles, workspace(medium.depth.size), miss)
    crossings = angles[:-1][np.diff(np.sign(miss)) != 0]
    wet = [a for a in crossings if np.min(np.abs(arrivals.launch_angle - a)) < 1e-4]
    assert len(arrivals.link) >= 3
    assert len(wet) == len(arrivals.link), (crossings, arrivals.launch_angle)


@pytest.mark.filterwarnings("ignore:1 of 1 links have more eigenrays:RuntimeWarning")
@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
@settings(max_examples=40, derandomize=True, deadline=None)
@given(
    depths=st.tuples(*[st.sampled_from([0.0, 0.5, 2.0, 60.0, 61.0, 100.0, 400.0, 1234.5, 3500.0])] * 2),
    distance=st.sampled_from([0.0, 0.1, 1.0, 37.0, 900.0, 5e3, 12e3, 1e5]),
    bearing=st.floats(0.0, 6.28),
)
def test_any_pair_of_places_has_an_outcome(interpolation, depths, distance, bearing):
    """Level, vertical, on a knot, on the surface, on the bottom, 0.1 m and 100 km apart."""
    source = np.array([3.0, -7.0, depths[0]])
    receiver = np.array([3.0 + distance * np.cos(bearing), -7.0 + distance * np.sin(bearing), depths[1]])
    arrivals = find_eigenrays(uniform(interpolation), source, receiver, spreading_cutoff_db=None)
    first = arrivals.first()
    assert first.status[0] in (RayStatus.OK, RayStatus.SHADOW, RayStatus.BLOCKED)
    assert np.isfinite(first.chord_travel_time[0])
    assert (np.diff(arrivals.travel_time) >= 0).all()
    length = np.linalg.norm(receiver - source)
    assert (arrivals.travel_time * DUCT.max() >= length * (1 - 1e-12)).all()
    ridge = interpolation == "linear" and depths == (60.0, 60.0)  # a kink that sends every ray away
    if not ridge and 0.0 < length < 1e3 and min(depths) > 1.0 and max(depths) < 3490.0:
        assert first.status[0] == RayStatus.OK


def test_what_cannot_be_asked_is_one_line():
    medium = uniform()
    ends = [0.0, 0.0, 10.0], [1e3, 0.0, 10.0]
    with pytest.raises(AcousticsError, match="max_surface_bounces: -1; a whole number from 0 to 15"):
        find_eigenrays(medium, *ends, max_surface_bounces=-1)
    with pytest.raises(AcousticsError, match=r"max_bottom_bounces: 1\.5; a whole number"):
        find_eigenrays(medium, *ends, max_bottom_bounces=1.5)
    with pytest.raises(AcousticsError, match=r"source has shape \(2, 3\), receiver \(1, 3\)"):
        find_eigenrays(medium, [ends[0]] * 2, ends[1])
    with pytest.raises(AcousticsError, match=r"source: shape \(1, 2\); needs \(n_links, 3\)"):
        find_eigenrays(medium, [0.0, 0.0], ends[1])
    with pytest.raises(AcousticsError, match="receiver: 1 coordinates are not finite"):
        find_eigenrays(medium, ends[0], [np.nan, 0.0, 10.0])
    with pytest.raises(AcousticsError, match="tolerance: 0"):
        find_eigenrays(medium, *ends, tolerance=0.0)


def test_picture_holds_the_eigenrays_from_end_to_end():
    medium = uniform()
    source, receiver = np.array([0.0, 0.0, 100.0]), np.array([6e3, 8e3, 900.0])
    picture = ray_picture(medium, source, receiver, fan_angles=np.radians([-20.0, -5.0, 5.0, 20.0]))
    arrives = picture.ray_arrives.values == 1
    assert arrives.sum() >= 1
    assert arrives.size == arrives.sum() + 4
    np.testing.assert_allclose(picture.ray_depth.values[arrives, 0], 100.0)
    np.testing.assert_allclose(picture.ray_depth.values[arrives, -1], 900.0, atol=0.02)
    np.testing.assert_allclose(picture.ray_range.values[arrives, -1], 1e4, atol=0.02)
    np.testing.assert_allclose(picture.sound_speed.sel(depth=0.0).values, DUCT[0], atol=1e-9)
    assert picture.ray_depth.min() >= 0.0
    assert (picture.sea_floor_depth == 3500.0).all()
    with pytest.raises(AcousticsError, match="coincide"):
        ray_picture(medium, source, source)
