"""A finer sea floor in the local frame: which one wins, where it lies, and that sound speed covers it."""

import numpy as np
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import sea_floor as sea_floor_module
from pymantaray.ocean import to_local
from pymantaray.ocean.seawater import sound_speed


def plane(lat, lon, lon_0):
    """Sea floor that slopes in both directions. [m]"""
    return 2_500.0 + 900.0 * (lat - 78.0) + 300.0 * (lon - lon_0)


def file_floor(step, lon_0=0.0, *, half=(0.9, 3.0), turn=0.0, form=plane):
    lat = 78.0 + np.arange(-half[0], half[0] + 1e-9, step)
    lon = lon_0 + np.arange(-half[1], half[1] + 1e-9, step)
    return xr.DataArray(
        form(lat[:, None], lon, lon_0),
        coords={"lat": lat, "lon": lon + turn},
        dims=("lat", "lon"),
        name="sea_floor_depth",
        attrs={"source": "made.nc: elevation"},
    )


@pytest.fixture
def ocean(closed_form_ocean):
    return closed_form_ocean(
        78.0,
        0.0,
        temperature=lambda z, lat, _lon: 2.0 - z / 2_000.0 + 0.3 * (lat - 78.0),
        floor=lambda _lat, lon: np.where(lon > 0.5, 400.0, 2_100.0),
        depth=[0.0, 100.0, 500.0, 1_000.0, 1_500.0, 2_000.0],
    )


def test_without_a_file_nothing_changes(ocean):
    local = to_local(ocean)
    assert local["sea_floor_depth"].dims == ("north", "east")
    assert not {"sea_floor_source", "levels_added", "sound_speed_equation"} & set(local.attrs)


def test_a_coarser_file_is_not_taken_and_that_is_said(ocean):
    local, plain = to_local(ocean, sea_floor=file_floor(0.2)), to_local(ocean)
    assert "made.nc: elevation is coarser" in local.attrs["sea_floor_source"]
    local.attrs.pop("sea_floor_source")
    assert local.identical(plain)


@pytest.mark.parametrize("turn", [0.0, 360.0, -360.0])
def test_a_finer_file_lies_where_it_should_on_its_own_axes(ocean, turn):
    half = (60e3, 30e3)
    local = to_local(ocean, half_extent=half, sea_floor=file_floor(0.01, turn=turn))
    floor = local["sea_floor_depth"]
    assert floor.dims == ("floor_north", "floor_east")
    north, east = floor["floor_north"].values, floor["floor_east"].values
    assert north[[0, -1]] == pytest.approx([-half[0], half[0]])
    assert east[[0, -1]] == pytest.approx([-half[1], half[1]])
    assert np.diff(north).mean() == pytest.approx(1_116.0, rel=0.02)  # a hundredth of a degree
    assert np.diff(east).mean() == pytest.approx(1_116.0 * np.cos(np.radians(78.0)), rel=0.05)
    lat, lon = LocalFrame(78.0, 0.0).to_geodetic(north[:, None], east[None, :])
    np.testing.assert_allclose(floor.values, plane(lat, lon, 0.0), atol=0.01)
    assert local.attrs["sea_floor_source"].startswith("made.nc: elevation, 1116 m by 232 m")
    # the ocean's own fields are those of before, and the levels go on to the deepest point
    plain = to_local(ocean, half_extent=half)
    xr.testing.assert_identical(local["sound_speed"].isel(depth=slice(0, 6)), plain["sound_speed"])
    deepest = float(floor.max())
    assert deepest > 2_000.0
    assert float(local["depth"][-1]) == deepest
    np.testing.assert_allclose(local.attrs["levels_added"], local["depth"].values[6:])
    assert np.diff(local["depth"].values[5:]).max() <= 500.0 * (1.0 + 1e-12)


def test_sound_speed_covers_the_water_down_to_the_file_s_floor(ocean):
    """Temperature and salinity of the deepest wet level go on downward; pressure rises."""
    local = to_local(ocean, half_extent=(40e3, 20e3), sea_floor=file_floor(0.01))
    assert not any(np.isnan(local[name]).any() for name in local.data_vars)
    column = local.sel(north=0.0, east=0.0)
    depth = local["depth"].values
    expected = sound_speed(2.0 - np.minimum(depth, 2_000.0) / 2_000.0, 34.0, depth, 78.0, 0.0)
    np.testing.assert_allclose(column["sound_speed"], expected, atol=1e-3)
    # east of 0.5 E the ocean's own floor is at 450 m, the file's at 2,600: the level at 100 m goes on
    shallow = local.sel(north=0.0, east=19e3, method="nearest")
    lat, lon = LocalFrame(78.0, 0.0).to_geodetic(float(shallow["north"]), float(shallow["east"]))
    assert lon > 0.6
    expected = sound_speed(2.0 - 100.0 / 2_000.0 + 0.3 * (lat - 78.0), 34.0, depth[3:], lat, lon)
    np.testing.assert_allclose(shallow["sound_speed"].values[3:], expected, atol=0.2)


def test_levels_that_reach_the_floor_are_left_alone(ocean):
    shallow = file_floor(0.01, form=lambda lat, lon, _lon_0: 1_200.0 + 0.0 * lat * lon)
    local = to_local(ocean, sea_floor=shallow, half_extent=(40e3, 20e3))
    assert "levels_added" not in local.attrs
    np.testing.assert_array_equal(local["depth"], ocean["depth"])
    np.testing.assert_allclose(local["sea_floor_depth"], 1_200.0)


def test_a_file_with_the_ocean_s_own_grid_is_taken(ocean):
    floor = xr.DataArray(
        np.full((ocean.sizes["lat"], ocean.sizes["lon"]), 1_234.0),
        coords={"lat": ocean["lat"], "lon": ocean["lon"]},
        dims=("lat", "lon"),
    )
    np.testing.assert_allclose(to_local(ocean, sea_floor=floor)["sea_floor_depth"], 1_234.0)


def test_the_number_of_nodes_is_capped_stated_and_the_mean_kept(ocean, monkeypatch):
    monkeypatch.setattr(sea_floor_module, "MAX_FLOOR_NODES", 2_000)

    def ripples(lat, lon, lon_0):
        return 1_500.0 + 200.0 * (-1.0) ** np.round((lat - 78.0) / 0.005) + 0.0 * lon

    local = to_local(ocean, half_extent=(40e3, 20e3), sea_floor=file_floor(0.005, form=ripples))
    floor = local["sea_floor_depth"]
    assert 1_000 < floor.size <= 2_000
    assert "at most" in local.attrs["sea_floor_source"]
    assert "points" in local.attrs["sea_floor_source"]
    # ripples of two points a wave would alias to anything; the mean over an odd number of them is damped
    assert float(np.abs(floor - 1_500.0).max()) < 0.3 * 200.0


def test_a_floor_that_does_not_cover_the_domain_is_refused(ocean):
    with pytest.raises(OceanError, match=r"not the domain of \+-60 km by \+-30 km; fetch a larger window"):
        to_local(ocean, half_extent=(60e3, 30e3), sea_floor=file_floor(0.01, half=(0.3, 3.0)))
    with pytest.raises(OceanError, match=r"needs \(lat, lon\)"):
        to_local(ocean, sea_floor=file_floor(0.01).rename(lat="y"))


def test_the_equation_is_passed_on_and_named(ocean):
    teos, unesco = to_local(ocean), to_local(ocean, equation="unesco")
    assert unesco.attrs["sound_speed_equation"] == "unesco"
    difference = np.abs(unesco["sound_speed"] - teos["sound_speed"])
    assert 0.01 < float(difference.max()) < 1.0
    with pytest.raises(OceanError):
        to_local(ocean, equation="guess")
