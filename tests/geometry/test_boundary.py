"""
A boundary of the water: depths, extent, and the same numbers from Python and from the kernels.
"""

from functools import partial

import numpy as np
import pytest
import xarray as xr
from refusals import refused

from pymantaray.acoustics import BoundarySurface
from pymantaray.errors import FleetError, GeometryError
from pymantaray.fleet.kernel import OceanArrays, bed_depth, surface_depth

NORTH, EAST = np.array([-3e3, -1e3, 500.0, 4e3]), np.array([-2e3, 0.0, 5e3])


def plane(north, east):
    return 2000.0 + 0.02 * north - 0.03 * east + 1e-5 * north * east


@pytest.fixture
def slope():
    return BoundarySurface(plane(NORTH[:, None], EAST), NORTH, EAST)


def test_a_bilinear_depth_is_exact_between_the_grid_points(slope):
    place = np.random.default_rng(2).uniform([-3e3, -2e3, 0.0], [4e3, 5e3, 9e3], (50, 3))
    corner = BoundarySurface(plane(NORTH[::3, None], EAST[::2]), NORTH[::3], EAST[::2])
    np.testing.assert_allclose(corner.depth_at(place), plane(place[:, 0], place[:, 1]), rtol=1e-14)
    np.testing.assert_allclose(slope.depth_at(place), plane(place[:, 0], place[:, 1]), rtol=1e-14)


def test_kernels_and_python_give_the_same_depth(slope):
    place = np.random.default_rng(3).uniform([-3e3, -2e3], [4e3, 5e3], (50, 2))
    none = np.zeros((1, 1, 1, 1))
    water = OceanArrays(
        *(np.zeros(1) for _ in range(4)), none, none, slope.grid, BoundarySurface(1.0).grid
    )
    compiled = [bed_depth(water, *one) for one in place]
    np.testing.assert_allclose(compiled, slope.depth_at(place), rtol=1e-13)
    assert bed_depth(water, 9e4, 0.0) == pytest.approx(plane(4e3, 0.0))
    assert surface_depth(water, 9e4, 0.0) == 1.0


def test_a_depth_along_one_axis_does_not_vary_along_the_other():
    ridge = BoundarySurface([[100.0], [300.0]], [0.0, 1e3], [0.0])
    np.testing.assert_allclose(ridge.depth_at([[500.0, -9e9], [500.0, 7.0]]), 200.0)


def test_a_depth_beyond_the_edge_is_that_of_the_edge(slope):
    np.testing.assert_allclose(slope.depth_at([[9e4, 0.0]]), plane(4e3, 0.0))


def test_a_data_set_gives_a_boundary_on_any_axes_or_of_one_depth():
    axes = {"north": NORTH, "east": EAST, "floor_north": NORTH * 2, "floor_east": EAST * 2}
    own = (("floor_east", "floor_north"), plane(NORTH[:, None] * 2, EAST * 2).T)
    ocean = xr.Dataset({"sea_floor_depth": own, "sea_ice_draft": ((), 2.0)}, coords=axes)
    bed = BoundarySurface.from_dataset(ocean, "sea_floor_depth")
    np.testing.assert_array_equal(bed.north, NORTH * 2)
    np.testing.assert_array_equal(bed.depth, plane(NORTH[:, None] * 2, EAST * 2))
    assert BoundarySurface.from_dataset(ocean, "sea_ice_draft").depth.tolist() == [[2.0]]


def test_a_boundary_that_ends_inside_the_water_is_refused(slope):
    check = partial(slope.check_extent, name="bed", exception=FleetError)
    check(NORTH, EAST)
    says = "bed: east -2000 to 5000 m; it must extend over the water, -2000 to 6000 m"
    refused(FleetError, says, check, NORTH, np.array([-2e3, 6e3]))
    refused(
        GeometryError,
        r"boundary: depth: shape is \(2, 2\); it must be \(4, 3\)",
        BoundarySurface,
        np.ones((2, 2)),
        NORTH,
        EAST,
    )
