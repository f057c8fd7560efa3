"""Vehicles under ice: none rises into it, floats go on with their cycle beneath it."""

import numpy as np
import pytest

from pymantaray.fleet import ConstantTwist, Vehicle
from pymantaray.records import VehicleStatus


@pytest.fixture
def icy(make_ocean):
    """A current northwards under ice of 2 m, or that thickens to the north."""

    def make(slope=0.0):
        ocean = make_ocean(uniform=(0.4, 0.0))
        draft = (
            2.0
            + slope * np.maximum(ocean["north"].values, 0.0)[:, None]
            + 0.0 * ocean["east"].values
        )
        return ocean.assign(sea_ice_draft=(("north", "east"), draft) if slope else ((), 2.0))

    return make


@pytest.mark.parametrize("slope", [0.0, 0.01])
def test_a_float_holds_at_the_underside_and_sinks_again(run, icy, make_float, slope):
    truth = run(make_float(), water=icy(slope), duration=8000.0)
    north, depth = truth.position[0, :, 0], truth.position[0, :, 2]
    draft = 2.0 + slope * np.maximum(north, 0.0)
    assert depth[0] == 2.0  # it was to start at 0.5 m
    assert (depth - draft).min() > -1e-9
    surfaced = depth - draft < 0.5
    assert np.count_nonzero(np.diff(surfaced.astype(int)) == 1) >= 2  # it surfaced more than once
    assert (truth.status == VehicleStatus.ACTIVE).all()


def test_a_vehicle_that_climbs_slides_along_the_underside(run, icy):
    climbing = Vehicle("A", (0.0, 0.0, 50.0), ConstantTwist((0.0, 0.0, 0.0, 0.2, 0.0, -0.1)))
    truth = run(climbing, water=icy(0.01), duration=4000.0)
    north, depth = truth.position[0, :, 0], truth.position[0, :, 2]
    late = truth.time > 1000.0
    np.testing.assert_allclose(depth[late], 2.0 + 0.01 * north[late], atol=1e-9)


def test_where_ice_reaches_the_sea_floor_a_vehicle_is_aground(run, icy):
    deep = icy().assign(sea_floor_depth=(("north", "east"), np.full((11, 9), 1.5)))
    still = Vehicle("A", (0.0, 0.0, 1.0), ConstantTwist((0.0, 0.0, 0.0, 0.1, 0.0, 0.0)))
    assert (run(still, water=deep).status[0, 1:] == VehicleStatus.GROUNDED).all()


def test_ice_of_no_draft_changes_nothing(run, make_ocean, make_float):
    open_water = make_ocean(uniform=(0.4, 0.0), slope=0.1)
    iceless = open_water.assign(sea_ice_draft=((), 0.0))
    one, other = (run(make_float(), water=water) for water in (open_water, iceless))
    np.testing.assert_array_equal(one.position, other.position)
