"""Atlases of any water: a data set in memory, a profile, ice, one depth, currents."""

import numpy as np
import pytest
import xarray as xr
from factories import pool_here
from refusals import refused

from pymantaray.acoustics import Currents, Medium, find_eigenrays
from pymantaray.apps.atlas import Atlas, AtlasLinks, open_atlas, plan, run_atlas
from pymantaray.apps.atlas.blocks import LAND, WATER
from pymantaray.apps.atlas.dataset import VARIABLES
from pymantaray.errors import AtlasError
from pymantaray.ocean import synthetic_ocean, to_local, with_ice

LINKS = AtlasLinks(pairs=((30.0, 60.0),), distances=(1500.0,), bearings=2)
WHERE = {"window": (78.7, 78.8, 0.0, 0.3), "every": 1}


@pytest.fixture(autouse=True)
def _own_cache_and_process(tmp_path, monkeypatch):
    """
    Blocks are computed in this process; `test_workers_and_tiles_change_no_digit` is about others.
    """
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("pymantaray.apps.atlas.runner.open_pool", pool_here)


@pytest.fixture(scope="module")
def fram():
    return synthetic_ocean("fram")


def errors(out, *arguments, **options):
    """Range errors by the sound speed at the transmitter, of the first column."""
    run_atlas(Atlas(*arguments, **options), out)
    with open_atlas(out) as atlas:
        return atlas["range_error"].isel(
            time=0, lat=0, lon=0, convention=0
        ).values.ravel(), atlas.load()


def test_an_ocean_in_memory_has_the_atlas_of_its_name(fram, tmp_path):
    by_name, _ = errors(tmp_path / "name.nc", "synthetic:fram", LINKS, **WHERE)
    in_memory, _ = errors(tmp_path / "memory.nc", fram, LINKS, **WHERE)
    np.testing.assert_array_equal(in_memory, by_name)


def test_columns_on_both_sides_of_the_date_line_have_their_water(fram, tmp_path, monkeypatch):
    """Longitudes of the second block are 179.9 and 180.22; those of its water are about -180."""
    monkeypatch.setattr(plan, "_COLUMNS", 2)
    here = fram.sel(lat=slice(78.5, 79.0), lon=slice(-1.8, 1.5)).copy(deep=True)
    for name in ("water_temp", "salinity", "water_u", "water_v"):
        here[name][:, 5:8, [14, 22, 26]] = np.nan  # islands
    there = here.assign_coords(lon=here["lon"] + 179.9)
    there["lon"].attrs = fram["lon"].attrs
    options = {"every": 4, "equation": "unesco"}  # which is the same at all longitudes
    window = (78.66, 78.81, 179.09, 180.26)
    _, mine = errors(tmp_path / "there.nc", there, LINKS, window=window, **options)
    window = (78.66, 78.81, -0.81, 0.36)
    _, expected = errors(tmp_path / "here.nc", here, LINKS, window=window, **options)
    np.testing.assert_allclose(mine["lon"], [179.26, 179.58, 179.9, 180.22])
    np.testing.assert_allclose(mine["range_error"], expected["range_error"], rtol=1e-4, atol=1e-3)
    assert mine["column_status"].values.ravel().tolist() == [LAND, WATER, LAND, LAND]
    assert mine["range_error"].encoding["chunksizes"][:3] == (1, 1, 2)


def test_ice_floor_and_currents_are_those_of_the_local_ocean(fram, tmp_path, as_stored):
    options = {"ice": 5.0, "bathymetry": 900.0, "currents": "carry"}
    mine, atlas = errors(tmp_path / "atlas.nc", "synthetic:fram", LINKS, **WHERE, **options)
    place, half = (float(atlas["lat"][0]), float(atlas["lon"][0])), LINKS.half_extent
    local = with_ice(to_local(fram, place, (half, half)), 5.0)
    source, receiver = LINKS.ends()
    at_rest = find_eigenrays(Medium.from_dataset(local), source, receiver).first()
    straight = np.linalg.norm(receiver - source, axis=-1)
    still = at_rest.source_sound_speed * at_rest.travel_time - straight
    # u.p over 1.5 km, to first order by the current at the transmitter
    along = (receiver - source) / straight[:, None]
    velocity = Currents.from_dataset(local).at(source)
    carried = -np.einsum("ij,ij->i", velocity, along) * straight / at_rest.source_sound_speed
    np.testing.assert_allclose(mine - still, carried, rtol=0.2, atol=2e-3)
    assert np.abs(carried).max() > 0.01
    as_stored(atlas, without="_key")


def test_a_profile_has_one_column(tmp_path, as_stored):
    (tmp_path / "p.csv").write_text("depth,sound_speed\n0,1440\n50,1436\n200,1450\n900,1460\n")
    mine, atlas = errors(
        tmp_path / "atlas.nc", tmp_path / "p.csv", LINKS, bathymetry=1000.0, centre=(74.0, -140.0)
    )
    medium = Medium.from_profile([0, 50, 200, 900], [1440, 1436, 1450, 1460], bottom_depth=1000.0)
    source, receiver = LINKS.ends()
    first = find_eigenrays(medium, source, receiver).first()
    expected = first.source_sound_speed * first.travel_time - np.linalg.norm(
        receiver - source, axis=-1
    )
    np.testing.assert_allclose(mine, expected, rtol=1e-6)  # single precision
    assert (atlas.sizes["lat"], atlas.sizes["lon"]) == (1, 1)
    assert float(atlas["lat"][0]) == 74.0
    with xr.open_dataset(tmp_path / "atlas.nc", decode_cf=False) as raw:
        for name in VARIABLES:
            v = raw[name]
            absent = v.attrs.get("_FillValue", 0.0)
            assert np.isnan(absent) == (v.dtype == np.float32), name
            assert ("coordinates" in v.attrs) == ("pair" in v.dims), name
    as_stored(atlas, without="_key")


def test_what_has_no_columns_is_refused(fram):
    medium = Medium.from_profile([0, 90], [1440, 1450], bottom_depth=90.0)
    refused(
        AtlasError, "a medium has no latitude and longitude, which an atlas needs", Atlas, medium
    )
    refused(
        AtlasError, "give the ocean before to_local", Atlas, to_local(fram, half_extent=(9e3, 9e3))
    )
