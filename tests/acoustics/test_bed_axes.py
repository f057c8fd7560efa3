"""A sea bed on axes of its own, finer than the water's."""

import numpy as np
import pytest
import xarray as xr

from pymantaray.acoustics import BoundarySurface, Medium, find_eigenrays, trace_paths
from pymantaray.apps.bellhop import linear_medium
from pymantaray.records import RayStatus

AXIS = np.linspace(-10e3, 10e3, 5)
DEPTH = np.linspace(0.0, 4000.0, 21)
SPEED = 1460.0 + 0.016 * DEPTH + 0.0 * AXIS[:, None, None] + 1e-5 * AXIS[:, None]


def slope(north, east):
    return 2000.0 + 0.02 * north[:, None] + 0.01 * east


def medium(bed_axis=None, bed=slope, interpolation="smooth"):
    own = AXIS if bed_axis is None else bed_axis
    return Medium.from_grid(
        AXIS,
        AXIS,
        DEPTH,
        SPEED,
        bathymetry=BoundarySurface(bed(own, own), own, own),
        interpolation=interpolation,
    )


def hill(north, east):
    """A hill of 1,500 m that stands between two grid lines of the water."""
    return (500.0 + ((north[:, None] - 2550.0) ** 2 + (east - 250.0) ** 2) / 1000.0).clip(
        max=2000.0
    )


def ends(n=14):
    rng = np.random.default_rng(11)
    place = rng.uniform([-6e3, -6e3, 10.0], [6e3, 6e3, 900.0], (2, n, 3))
    return place[0], place[1]


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_a_plane_on_finer_axes_is_the_same_plane(interpolation):
    source, receiver = ends()
    coarse, fine = (
        find_eigenrays(medium(axis, interpolation=interpolation), source, receiver, 1, 1)
        for axis in (None, np.linspace(-11e3, 11e3, 57))
    )
    assert fine.link.size >= 28
    np.testing.assert_array_equal(fine.link, coarse.link)
    np.testing.assert_allclose(fine.travel_time, coarse.travel_time, rtol=0, atol=1e-8)


def test_a_hill_between_the_waters_grid_lines_blocks_and_reflects():
    fine = np.concatenate([[-10e3], np.arange(-500.0, 5.6e3, 100.0), [10e3]])
    water = medium(fine, hill)
    np.testing.assert_allclose(
        water.bottom_depth([[2550.0, 250.0]]), 505.0
    )  # the top lies within a cell
    below, above = [50.0, 250.0, 800.0], [5050.0, 250.0, 800.0]
    assert find_eigenrays(water, below, above).status[0] == RayStatus.BLOCKED
    assert find_eigenrays(medium(None, hill), below, above).status[0] == RayStatus.OK
    source, receiver = [50.0, 250.0, 300.0], [5050.0, 250.0, 300.0]
    over = find_eigenrays(water, source, receiver, max_bottom_bounces=1)
    bounced = over.bottom_bounces == 1
    assert bounced.sum() == 1
    paths = trace_paths(water, source, receiver, over)
    touch = paths.position[(paths.boundary == 2) & bounced[paths.arrival]]
    np.testing.assert_allclose(touch[:, 2], water.bottom_depth(touch), atol=1e-4)
    assert touch[0, 2] < 510.0  # on the hill


def test_a_local_data_set_with_its_own_floor_axes():
    fine = np.arange(-10e3, 10.1e3, 250.0)
    ocean = xr.Dataset(
        {
            "sound_speed": (("north", "east", "depth"), SPEED),
            "sea_floor_depth": (("floor_north", "floor_east"), hill(fine, fine)),
        },
        coords={
            "north": AXIS,
            "east": AXIS,
            "depth": DEPTH,
            "floor_north": fine,
            "floor_east": fine,
        },
    )
    water = Medium.from_dataset(ocean)
    np.testing.assert_array_equal(water.bed.depth, hill(fine, fine))
    halved = linear_medium(water, horizontal=2)
    place = np.stack([fine[20:60] + 60.0, np.full(40, 210.0)], axis=-1)
    np.testing.assert_allclose(halved.bottom_depth(place), water.bottom_depth(place))
