"""Outcomes of links: statuses, degenerate positions, ducts, and media of few columns."""

import numpy as np
import pytest
from factories import DUCT, DUCT_DEPTH as Z

from pymantaray.acoustics import Medium, find_eigenrays, ray_picture
from pymantaray.ocean import open_ocean, to_local
from pymantaray.records import RayStatus


def uniform(interpolation="smooth", speed=DUCT, bottom=3500.0):
    return Medium.from_profile(Z, speed, bottom_depth=bottom, interpolation=interpolation)


@pytest.mark.parametrize(("receiver", "status"), [
    ([6e3, 6e3, -1.0], RayStatus.OUTSIDE),  # in the air
    ([6e3, 6e3, 3501.0], RayStatus.OUTSIDE),  # in the sea bed
    ([1.1e4, 5e3, 10.0], RayStatus.OUTSIDE),  # beyond the grid
    ([6e3, 6e3, 10.0], RayStatus.OK),
])  # fmt: skip
def test_positions_outside_the_water_are_a_status(receiver, status):
    n = np.linspace(0, 1e4, 5)
    medium = Medium.from_grid(
        n, n, Z, np.broadcast_to(DUCT, (5, 5, 16)), bathymetry=np.full((5, 5), 3500.0)
    )
    first = find_eigenrays(medium, [5e3, 5e3, 10.0], receiver).first()
    assert first.status[0] == status
    assert np.isnan(first.travel_time[0]) == (status != RayStatus.OK)


def test_upward_refraction_makes_a_shadow_with_a_margin():
    """
    Where sound speed falls with depth, rays from near the surface bend down, away from a far
    neighbour.
    """
    c = 1500.0 - 0.05 * np.minimum(Z, 200.0)
    medium = uniform(speed=c)
    first = find_eigenrays(medium, [0, 0, 5.0], [8e3, 0, 10.0]).first()
    assert first.status[0] == RayStatus.SHADOW
    near = find_eigenrays(medium, [0, 0, 5.0], [300.0, 0, 10.0]).first()
    assert near.status[0] == RayStatus.OK
    assert near.shadow_margin[0] == 0.0
    assert np.isfinite(first.chord_travel_time[0])  # dropouts carry it too


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


def test_the_picture_agrees_with_the_search_about_each_eigenray():
    medium, ends = uniform(), ([0.0, 0.0, 100.0], [6e3, 0.0, 900.0])
    arrivals = find_eigenrays(medium, *ends, 1, 1)
    picture = ray_picture(
        medium, *ends, max_surface_bounces=1, max_bottom_bounces=1, fan_angles=[0.1]
    )
    rays = picture.isel(ray=picture.ray_arrives.values == 1)
    np.testing.assert_array_equal(rays.ray_travel_time, arrivals.travel_time)
    np.testing.assert_array_equal(rays.ray_surface_bounces, arrivals.surface_bounces)
    np.testing.assert_array_equal(rays.ray_bottom_bounces, arrivals.bottom_bounces)
    np.testing.assert_array_equal(rays.ray_spreading, arrivals.spreading_db)
    assert set(zip(arrivals.surface_bounces, arrivals.bottom_bounces, strict=True)) >= {
        (0, 0),
        (1, 0),
        (0, 1),
    }
    assert np.isnan(picture.ray_spreading[-1])
    assert picture.attrs["status"] == "OK"


def test_picture_of_a_link_without_rays_has_none():
    """In uniform water over a sill no ray is left to draw."""
    north = np.linspace(-1e3, 11e3, 13)
    sill = np.where(np.abs(north - 5e3) < 1.0, 100.0, 3000.0)
    medium = Medium.from_grid(
        north,
        [-1e3, 1e3],
        [0.0, 3000.0],
        np.full((13, 2, 2), 1500.0),
        bathymetry=np.tile(sill[:, None], 2),
    )
    picture = ray_picture(medium, [0.0, 0.0, 900.0], [10e3, 0.0, 900.0])
    assert picture.sizes["ray"] == 0
    assert picture.attrs["status"] == "BLOCKED"
    assert np.isfinite(picture.sound_speed).any()


def test_a_bounced_arrival_makes_a_link_without_direct_ray_ok():
    """
    Behind a ridge and in a shadow; the first arrival and the slowness are those of the bounced ray.
    """
    north = np.linspace(0.0, 10e3, 11)
    bed = np.where(np.arange(11) == 5, 300.0, 1000.0)[:, None] * np.ones(2)
    speed = np.full((11, 2, 2), 1500.0)
    ridge = Medium.from_grid(north, [-5e3, 5e3], [0.0, 1200.0], speed, bathymetry=bed)
    ends = [3000.0, 0.0, 600.0], [7000.0, 0.0, 600.0]
    assert find_eigenrays(ridge, *ends).status[0] == RayStatus.BLOCKED
    assert find_eigenrays(ridge, *ends, 0, 1).status[0] == RayStatus.BLOCKED
    over = find_eigenrays(ridge, *ends, 1, 0)
    first = over.first()
    assert first.status[0] == RayStatus.OK
    assert len(over.link) == 1
    assert first.travel_time[0] == pytest.approx(np.hypot(4000.0, 1200.0) / 1500.0, abs=1e-9)
    expected = np.array([4000.0, 0.0, -1200.0]) / np.hypot(4000.0, 1200.0) / 1500.0
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
    """
    With images the spreading is known: the rays at 15 dB of a steep link fall on either side of the
    limit.
    """
    medium = Medium.from_profile([0.0, 200.0], [1500.0, 1500.0], bottom_depth=200.0)
    ends = [0.0, 0.0, 100.0], [30.0, 0.0, 110.0]
    everything = find_eigenrays(medium, *ends, 3, 3, None)
    for cutoff in (12.0, 15.0, 20.0):
        some = find_eigenrays(medium, *ends, 3, 3, cutoff)
        expected = everything.travel_time[everything.spreading_db <= cutoff]
        np.testing.assert_allclose(some.travel_time, expected, rtol=0, atol=1e-12)
        assert 0 < len(some.link) < len(everything.link)


def test_axes_of_two_and_three_points_fall_back_to_lower_degree():
    n, e = np.array([0.0, 5e3]), np.array([0.0, 4e3, 8e3])
    c = 1500.0 + 1e-3 * n[:, None, None] + 1e-8 * (e**2)[None, :, None] + 0.0 * Z
    medium = Medium.from_grid(n, e, Z, c, bathymetry=np.full((2, 3), 3000.0))
    points = np.array([[1234.0, 3456.0, 100.0], [4000.0, 7000.0, 20.0]])
    expected = 1500.0 + 1e-3 * points[:, 0] + 1e-8 * points[:, 1] ** 2
    speeds = find_eigenrays(medium, points, points[::-1]).source_sound_speed
    np.testing.assert_allclose(speeds, expected, atol=1e-9)


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_sound_speed_at_grid_points_is_the_grids(interpolation):
    n, e, z = (
        np.linspace(0.0, 8e3, 5),
        np.linspace(0.0, 9e3, 4),
        np.array([0.0, 10.0, 200.0, 1e3, 3e3]),
    )
    c = 1500.0 + np.random.default_rng(1).normal(size=(5, 4, 5))
    medium = Medium.from_grid(n, e, z, c, bathymetry=3000.0, interpolation=interpolation)
    nodes = np.stack(np.meshgrid(n, e, z, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(medium.sound_speed_at(nodes), c.ravel(), rtol=0, atol=1e-9)
    assert np.isnan(medium.sound_speed_at([[4e3, 4e3, 3001.0], [-1.0, 4e3, 10.0]])).all()


def test_repr_of_a_medium_is_one_line_without_the_field():
    iced = Medium.from_profile([0.0, 3e3], [1500.0, 1510.0], bottom_depth=1000.0, ice_draft=2.0)
    assert repr(iced) == (
        "<Medium 1 x 1 x 2: north 0 to 0 m, east 0 to 0 m, depth 0 to 3000 m, 1500.0 to 1510.0 m/s,"
        " sea bed 1000 to 1000 m, ice to 2 m, smooth>"
    )


def test_a_pair_about_a_caustic_beyond_the_receiver_is_found():
    """
    Rays on both sides of the pair leave the water just before the receiver, in one manner: those
    between do not.
    """
    medium = Medium.from_dataset(
        to_local(open_ocean("synthetic:beaufort"), half_extent=(60e3, 60e3))
    )
    ends = np.array([[-3389.58995, -1103.41914, 0.5], [-1145.21881, -2735.56894, 0.5]])
    for source, receiver in (ends, ends[::-1]):
        arrivals = find_eigenrays(medium, source, receiver, canonical=False)
        angle, near = np.sort(np.abs(arrivals.launch_angle)), np.ptp(arrivals.travel_time[:2])
        assert angle.size == 3
        assert angle[2] - angle[1] < 1e-3  # rad
        assert near < 1e-5 < arrivals.travel_time[2] - arrivals.travel_time[0]  # s


@pytest.mark.parametrize("tolerance", [1e-3, 0.1])
def test_a_reflected_ray_of_both_fans_is_listed_once(tolerance):
    """
    Rays near 60 degrees belong to the fan along the horizontal and to the one in depth, whose
    integrations differ by the tolerance.
    """
    depth = [0.0, 50.0, 100.0, 200.0, 400.0, 800.0, 1500.0, 3000.0]
    speed = [1437.0, 1438.0, 1445.0, 1455.0, 1461.0, 1464.0, 1471.0, 1494.0]
    medium = Medium.from_profile(depth, speed, bottom_depth=3000.0)
    rng = np.random.default_rng(7)
    n = 60
    source = np.column_stack([np.zeros((n, 2)), rng.uniform(100.0, 900.0, n)])
    receiver = np.column_stack(
        [np.zeros(n), rng.uniform(1500.0, 4500.0, n), rng.uniform(100.0, 2900.0, n)]
    )
    rays = find_eigenrays(medium, source, receiver, 2, 2, tolerance=tolerance)
    order = np.lexsort((rays.launch_angle, rays.bottom_bounces, rays.surface_bounces, rays.link))
    kind = np.stack([rays.link, rays.surface_bounces, rays.bottom_bounces])[:, order]
    same = (np.diff(kind) == 0).all(axis=0)
    steep = np.abs(np.degrees(rays.launch_angle))
    assert np.count_nonzero((steep > 58.5) & (steep < 61.8)) >= 15
    assert np.diff(rays.launch_angle[order])[same].min(initial=1.0) > 1e-4
    # flat boundaries: each sequence of reflections has one ray, upwards and downwards
    found = np.array([rays.bottom_bounces + rays.surface_bounces == k for k in (1, 2)]).sum(axis=1)
    assert found.tolist() == [2 * n, 2 * n]
