"""The window on a server's axes: enclosing, contiguous, in any convention."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pymantaray.errors import OceanError
from pymantaray.ocean.fetch.region import Region

STEP = 0.08
LAT = np.arange(-90.0, 91.0)
AXES = {first: first + STEP * np.arange(4500) for first in (-180.0, 0.0, 74.16)}


@given(
    first=st.sampled_from(sorted(AXES)),
    west=st.floats(-180.0, 360.0),
    width=st.floats(0.01, 179.9),
    turns=st.integers(-1, 0),
)
def test_any_window_of_a_circle_is_enclosed_by_at_most_one_point(first, west, width, turns):
    east = west + width
    east -= 360.0 if east > 360.0 else 0.0
    axis = (AXES[first] + 180.0) % 360.0 - 180.0 if turns else AXES[first]
    grid = Region.of((0.0, 1.0), (west, east)).of_grid(LAT, axis, "server")
    lon, indices = grid.lon, np.concatenate([np.r_[block] for block in grid.blocks])[grid.order]
    np.testing.assert_allclose(np.diff(lon), STEP, atol=1e-9)
    np.testing.assert_allclose((lon - axis[indices] + 180.0) % 360.0 - 180.0, 0.0, atol=1e-9)
    middle = 0.5 * (lon[0] + lon[-1])
    assert -180.0 - 1e-9 <= middle < 180.0 + 1e-9
    left = (west - lon[0] + 180.0) % 360.0 - 180.0  # how far the window's side lies inside
    right = lon[-1] - lon[0] - left - width
    assert -1.1e-4 <= left < STEP
    assert -1.1e-4 <= right < STEP
    assert len(grid.blocks) <= 2


@given(south=st.floats(-79.9, 89.0), height=st.floats(0.01, 1.0))
def test_latitudes_are_enclosed_by_at_most_one_point(south, height):
    axis = -80.0 + 0.04 * np.arange(4251)
    for lat in (axis, axis[::-1]):
        grid = Region.of((south, south + height), (0.0, 1.0)).of_grid(lat, AXES[0.0], "server")
        np.testing.assert_array_equal(np.sort(lat[grid.rows]), grid.lat)
        assert -1.1e-4 <= south - grid.lat[0] < 0.04 + 1e-9
        assert -1.1e-4 <= grid.lat[-1] - south - height < 0.04 + 1e-9


def test_a_regional_axis_covers_only_itself():
    axis = -75.68 + STEP * np.arange(18)
    grid = Region.of((0.0, 1.0), (284.4, 285.2)).of_grid(LAT, axis, "server")
    np.testing.assert_allclose(grid.lon, axis[grid.blocks[0]])
    for lon in ((-76.0, -75.0), (-75.0, -74.0), (10.0, 11.0), (-80.0, -70.0)):
        with pytest.raises(
            OceanError, match=r"the data(, which)? cover .*longitude -75\.68 to -74\.32;"
        ):
            Region.of((0.0, 1.0), lon).of_grid(LAT, axis, "server")


@pytest.mark.parametrize("axis", [[0.0], [0.0, 1.0, 1.0, 2.0]])
def test_axes_that_are_none_are_refused(axis):
    with pytest.raises(OceanError):
        Region.of((0.5, 1.5), (0.5, 1.5)).of_grid(np.array(axis), AXES[0.0], "server")
