"""Media: what is refused and why, and that the field is what its definition says."""

import numpy as np
import pytest
import xarray as xr

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.errors import AcousticsError

Z = np.array([0.0, 10.0, 50.0, 200.0, 1000.0, 3000.0])


def test_axis_must_increase():
    with pytest.raises(AcousticsError, match="depth: axis must be finite and strictly increasing"):
        Medium.from_profile([0.0, 10.0, 10.0], [1500.0] * 3, bottom_depth=10.0)


@pytest.mark.parametrize(
    ("speed", "message"),
    [
        ([1.5] * 6, r"1\.5 to 1\.5 m/s; sea water lies in 1000 to 2500, check the units"),
        ([1500.0] * 5 + [np.nan], "1 values are not finite; fill them before tracing"),
        ([1500.0] * 5, r"shape \(1, 1, 5\); the axes ask for \(1, 1, 6\)"),
        ([[1500.0] * 6], "a profile has one dimension"),
    ],
)
def test_sound_speed_is_checked(speed, message):
    with pytest.raises(AcousticsError, match=message):
        Medium.from_profile(Z, speed, bottom_depth=1000.0)


def test_other_bad_input_is_one_line():
    with pytest.raises(AcousticsError, match="depth: 1 level; a medium needs at least 2"):
        Medium.from_profile([0.0], [1500.0], bottom_depth=1000.0)
    with pytest.raises(AcousticsError, match="'cubic'; allowed are 'smooth' and 'linear'"):
        Medium.from_profile(Z, [1500.0] * 6, bottom_depth=1000.0, interpolation="cubic")
    with pytest.raises(AcousticsError, match="lacks sound_speed, sea_floor_depth"):
        Medium.from_dataset(xr.Dataset(coords={"north": [0.0], "east": [0.0], "depth": Z}))


def test_axes_of_two_and_three_points_fall_back_to_lower_degree():
    n, e = np.array([0.0, 5e3]), np.array([0.0, 4e3, 8e3])
    c = 1500.0 + 1e-3 * n[:, None, None] + 1e-8 * (e**2)[None, :, None] + 0.0 * Z
    medium = Medium.from_grid(n, e, Z, c, bathymetry=np.full((2, 3), 3000.0))
    points = np.array([[1234.0, 3456.0, 100.0], [4000.0, 7000.0, 20.0]])
    expected = 1500.0 + 1e-3 * points[:, 0] + 1e-8 * points[:, 1] ** 2
    speeds = find_eigenrays(medium, points, points[::-1]).source_sound_speed
    np.testing.assert_allclose(speeds, expected, atol=1e-9)
