"""Ice from one value or a file: the draft at the local nodes, and what is refused."""

import numpy as np
import pytest
import xarray as xr
from refusals import refused

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import to_local, with_ice


@pytest.fixture(scope="module")
def local(beaufort_sea):
    return to_local(beaufort_sea, half_extent=(30e3, 30e3))


def ice_file(path, local, values, standard_name="sea_ice_draft", **attrs):
    """A plane or any field on latitude and longitude about the local ocean."""
    lat0, lon0 = local.attrs["centre_latitude_deg"], local.attrs["centre_longitude_deg"]
    lat, lon = lat0 + np.linspace(-1.0, 1.0, 9), lon0 + np.linspace(-4.0, 4.0, 11)
    field = values(lat[:, None] - lat0, lon[None, :] - lon0)
    attributes = {"standard_name": standard_name, "units": "m", **attrs}
    xr.Dataset(
        {"ice": (("lat", "lon"), field, attributes)},
        coords={
            "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        },
    ).to_netcdf(path)
    return path


@pytest.mark.parametrize(
    ("name", "share"), [("sea_ice_draft", 1.0), ("sea_ice_thickness", 917.0 / 1026.0)]
)
def test_a_plane_of_ice_is_the_plane_at_every_node(tmp_path, local, name, share, as_stored):
    path = ice_file(tmp_path / "ice.nc", local, lambda y, x: 3.0 + y + 0.2 * x, name)
    draft = with_ice(local, path)["sea_ice_draft"]
    lat0, lon0 = local.attrs["centre_latitude_deg"], local.attrs["centre_longitude_deg"]
    lat, lon = LocalFrame(lat0, lon0).to_geodetic(
        local["north"].values[:, None], local["east"].values[None, :]
    )
    expected = share * (3.0 + (lat - lat0) + 0.2 * (lon - lon0))
    np.testing.assert_allclose(draft.transpose("north", "east"), expected, atol=1e-9)
    as_stored(draft)


def test_no_value_is_no_ice(tmp_path, local, as_stored):
    path = ice_file(tmp_path / "ice.nc", local, lambda y, x: np.where(y + 0 * x < 0.0, np.nan, 2.0))
    draft = with_ice(local, path)["sea_ice_draft"].transpose("north", "east").values
    np.testing.assert_allclose(draft[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(draft[-1], 2.0, atol=1e-12)
    as_stored(draft)


def test_one_value_stays_one_and_a_negative_one_is_refused(local):
    assert with_ice(local, 2)["sea_ice_draft"].item() == 2.0
    refused(OceanError, "ice: the draft is -1 m", with_ice, local, -1.0)


@pytest.mark.parametrize(("draft", "attrs", "message"), [
    (-1.0, {}, "check the units"),
    (2.0, {"units": "K"}, "must be in metres"),
    (2.0, {"standard_name": "sea_ice_area_fraction"}, "sea_ice_draft or sea_ice_thickness"),
])  # fmt: skip
def test_what_is_no_ice_is_one_line(tmp_path, local, draft, attrs, message):
    path = ice_file(tmp_path / "ice.nc", local, lambda y, x: draft + 0 * y * x, **attrs)
    refused(OceanError, message, with_ice, local, path)
