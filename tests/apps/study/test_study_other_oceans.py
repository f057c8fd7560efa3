"""Whole missions in water from casts, and over a sea floor finer than the water's grid."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pymantaray.acoustics import Medium
from pymantaray.acoustics.ocean_fields import OceanFields
from pymantaray.apps.study import run_study
from pymantaray.apps.study.mission import with_notes
from pymantaray.config import load_study
from pymantaray.config.door.ocean import build_ocean
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import (
    cast_ocean,
    crop_around,
    open_ocean,
    read_cast,
    sound_speed_profile_spread,
)
from pymantaray.records import RayStatus, VehicleStatus, write_netcdf

CASTS = Path(__file__).resolve().parents[4] / "shared" / "data" / "casts"


def casts():
    """A real cast of each sea."""
    if not CASTS.is_dir():
        return [pytest.param(None, marks=pytest.mark.skip(reason=f"real casts are not at {CASTS}"))]
    quick, *slow = (
        CASTS / f"{name}.csv" for name in ("beaufort_axctd_20140724_74N140W", "fram_bottle_1982_30")
    )
    return [quick, *(pytest.param(path, marks=pytest.mark.slow) for path in slow)]


def write_gebco(file, lat, lon, elevation):
    xr.Dataset(
        {
            "elevation": (
                ("lat", "lon"),
                elevation,
                {"standard_name": "height_above_mean_sea_level", "units": "m"},
            )
        },
        coords={
            "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        },
    ).to_netcdf(file)


@pytest.mark.parametrize("path", casts())
def test_a_mission_runs_in_a_uniform_ocean_from_a_cast(path, tmp_path):
    """
    The quick preset in water from a cast, dead reckoned: water, fleet and rays are what is tested.
    """
    write_netcdf(
        cast_ocean(read_cast(path), bathymetry=3000.0, below="constant"), tmp_path / "ocean.nc"
    )
    config = load_study("quick", ocean=[tmp_path / "ocean.nc"])
    config = config.with_(
        conditions=["odometry"], **{"study.realizations": 1, "mission.physics_step_s": 1.0}
    )
    run = run_study(config, tmp_path / "run", workers=1)
    assert run.truth.time[-1] == 24 * 3600.0
    assert (run.truth.status == VehicleStatus.ACTIVE).all()
    assert (run.measurements.range_status == RayStatus.OK).mean() > 0.7
    # at rest and level: a float comes up where it went down
    drift = run.truth.position[:, -1, :2] - run.truth.position[:, 0, :2]
    np.testing.assert_allclose(drift, 0.0, atol=1e-6)


def test_a_ridge_that_the_waters_grid_does_not_show_blocks_links(
    run_tiny, tiny_run, tmp_path, as_stored
):
    """
    Up to 200 m, 2 km wide, across the fleet in a GEBCO file; the synthetic floor there is flat and
    deep.
    """
    lat, lon = np.arange(74.0, 75.0, 1.0 / 240.0), np.arange(-142.0, -138.0, 1.0 / 240.0)
    ridge = np.exp(-(((lon + 140.0083) * 30.0) ** 2)) + 0.0 * lat[:, None]
    file = tmp_path / "gebco.nc"
    write_gebco(file, lat, lon, np.round(-3600.0 + 3400.0 * ridge))
    ridged = run_tiny(
        study={"realizations": 1}, conditions=["odometry"], ocean={"bathymetry": str(file)}
    )
    assert not (tiny_run.measurements.range_status == RayStatus.BLOCKED).any()
    assert np.count_nonzero(ridged.measurements.range_status == RayStatus.BLOCKED) >= 5
    floor = ridged.ocean["sea_floor_depth"]
    assert floor.dims == ("floor_north", "floor_east")
    assert float(floor.min()) < 250.0
    as_stored({"floor": floor, "dropouts": ridged.tables["dropouts"].frame})


def test_a_finer_sea_floor_and_another_equation_reach_the_local_ocean(
    tiny, tiny_run, tmp_path, as_stored
):
    lat, lon = np.linspace(74.0, 75.0, 121), np.linspace(-142.0, -138.0, 161)
    depth = 2900.0 + 50.0 * np.sin(40.0 * lat)[:, None] * np.cos(30.0 * lon)
    write_gebco(tmp_path / "floor.nc", lat, lon, -depth)
    section = {
        "bathymetry": str(tmp_path / "floor.nc"),
        "equation": "del-grosso",
        "time_varying": True,
    }
    ocean = build_ocean(tiny(ocean=section).ocean, 3600.0)
    for part in (ocean.local, ocean.drift, ocean.local_at(600.0)):
        assert part["sea_floor_depth"].dims == ("floor_north", "floor_east")
        here = float(part["sea_floor_depth"].interp(floor_north=0.0, floor_east=0.0))
        assert here == pytest.approx(depth[60, 80], rel=0, abs=0.5)
    assert ocean.local.attrs["sound_speed_equation"] == "del-grosso"
    difference = np.abs(ocean.local["sound_speed"].values - tiny_run.ocean["sound_speed"].values)
    assert 0.01 < difference.max() < 1.0  # m/s, between the equations
    as_stored(ocean.local)


def test_profiles_are_of_the_domain_that_was_asked_for_and_no_further(tiny, tiny_run):
    """No grid point beyond those that enclose 15 km about the centre."""
    section = tiny().ocean
    whole = open_ocean("synthetic:beaufort", time="2014-07-15T00:00")
    part = crop_around(whole, section.centre, section.half_extent)
    frame = LocalFrame(*section.centre)
    north, east = frame.to_local(part["lat"].values[:, None], part["lon"].values)
    for inner, reach in (
        (north[1:-1], section.half_extent[0]),
        (east[:, 1:-1], section.half_extent[1]),
    ):
        assert np.abs(inner).max() < 1.1 * reach
    assert north[0].max() <= -section.half_extent[0] < section.half_extent[0] <= north[-1].min()
    assert east[:, 0].max() <= -section.half_extent[1] < section.half_extent[1] <= east[:, -1].min()
    expected = sound_speed_profile_spread(part)
    assert tiny_run.profile.equals(expected)
    assert tiny_run.profile["count"][0] < 0.1 * whole.sizes["lat"] * whole.sizes["lon"]


def test_notes_of_an_ocean_and_its_medium_are_attributes_of_the_ocean():
    local = xr.Dataset(attrs={"title": "sea"})
    ocean = OceanFields(None, local, notes=("one", "two"))
    still, stepped = (
        Medium.from_profile([0.0, 100.0, 100.01, 500.0], speed, bottom_depth=500.0)
        for speed in ([1440.0] * 4, [1440.0, 1445.0, 1475.0, 1500.0])
    )
    assert stepped.notes
    for medium in (stepped, lambda _: stepped):
        attributes = with_notes(ocean, medium).local.attrs
        assert attributes == {"title": "sea", "notes": "\n".join(["one", "two", *stepped.notes])}
    silent = OceanFields(None, local)
    assert with_notes(silent, still) is silent
