"""The coarse sea floor and the values that continue beneath it."""

import numpy as np
import pytest

from pymantaray.errors import OceanError
from pymantaray.ocean.sea_floor import fill_below_sea_bed, sea_floor_depth

DEPTH = [0.0, 10.0, 40.0, 100.0]


def test_the_floor_is_half_way_to_the_next_level(closed_form_ocean):
    floors = np.array([-1.0, 0.0, 10.0, 39.0, 40.0, 99.0, 100.0, 500.0])  # true depth of each column
    ocean = closed_form_ocean(
        0.0,
        0.0,
        temperature=lambda z, _lat, _lon: 10.0 + 0 * z,
        floor=lambda _lat, lon: floors[np.round(lon / 0.08 + 3.5).astype(int)],
        n=(5, 8),
        depth=DEPTH,
    )
    expected = [0.0, 5.0, 25.0, 25.0, 70.0, 70.0, 100.0, 100.0]
    np.testing.assert_array_equal(sea_floor_depth(ocean), np.tile(expected, (5, 1)))


def test_valid_values_stay_and_the_deepest_is_carried_down():
    field = np.arange(2.0 * 3 * 4).reshape(2, 3, 4)
    field[1, 2, 3] = np.nan
    filled = fill_below_sea_bed(field, np.array([0.0, 1.0, 2.0]))
    valid = np.isfinite(field)
    np.testing.assert_array_equal(filled[valid], field[valid])
    assert filled[1, 2, 3] == field[0, 2, 3]


def test_land_takes_the_nearest_wet_column_by_distance_not_by_index():
    field = np.full((1, 5, 9), np.nan)
    field[0, 2, 1], field[0, 4, 4] = 1.0, 2.0  # 3 columns west, 2 rows north of the point (2, 4)
    near_pole, equator = np.full(5, 78.0), np.zeros(5)
    assert fill_below_sea_bed(field, equator)[0, 2, 4] == 2.0
    assert fill_below_sea_bed(field, near_pole)[0, 2, 4] == 1.0


def test_a_window_on_land_is_refused():
    with pytest.raises(OceanError, match="no wet column"):
        fill_below_sea_bed(np.full((2, 4, 4), np.nan), np.zeros(4))
