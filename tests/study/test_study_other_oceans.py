"""Whole missions in water from casts, and over a sea floor finer than the water's grid."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from pymantaray.ocean import cast_ocean, read_cast
from pymantaray.records import RayStatus, VehicleStatus, write_netcdf
from pymantaray.study import load_study, run_study

CASTS = Path(__file__).resolve().parents[3] / "shared" / "data" / "casts"


def casts(pattern):
    found = sorted(CASTS.glob(pattern))
    if found:
        return found
    return [pytest.param(None, marks=pytest.mark.skip(reason=f"real casts are not at {CASTS}"))]


def dead_reckoned(config, **ocean):
    """Water, fleet and rays are what is tested."""
    study = config.study.model_copy(update={"conditions": ("odometry",), "realizations": 1})
    return config.model_copy(update={"study": study, "ocean": config.ocean.model_copy(update=ocean)})


def run_on(file, folder):
    """The quick preset, one realization, in the water of a file."""
    return run_study(dead_reckoned(load_study("quick", ocean=[file])), folder / "run", workers=1)


def check_mission_from_cast(path, folder):
    cast = read_cast(path)
    file = folder / "ocean.nc"
    write_netcdf(cast_ocean(cast, bottom_depth=3000.0, below="constant"), file)
    run = run_on(file, folder)
    assert run.truth.time[-1] == 24 * 3600.0
    assert (run.truth.status == VehicleStatus.ACTIVE).all()
    heard = run.measurements.range_status == RayStatus.OK
    assert heard.mean() > 0.7
    # at rest and level: a float comes up where it went down
    drift = run.truth.position[:, -1, :2] - run.truth.position[:, 0, :2]
    np.testing.assert_allclose(drift, 0.0, atol=1e-6)


@pytest.mark.parametrize("path", casts("beaufort_axctd*74N*"))
def test_a_mission_runs_in_a_uniform_ocean_from_a_cast(path, tmp_path):
    check_mission_from_cast(path, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("path", casts("*.csv"), ids=lambda path: path and path.stem)
def test_a_mission_runs_in_a_uniform_ocean_from_each_cast(path, tmp_path):
    check_mission_from_cast(path, tmp_path)


def test_a_hill_that_the_waters_grid_does_not_show_grounds_floats_and_blocks_links(tmp_path):
    """A ridge of 1,200 m, 2 km wide, across the fleet in a GEBCO file; the synthetic floor there is flat and deep."""
    lat, lon = np.arange(74.0, 75.0, 1.0 / 240.0), np.arange(-142.0, -138.0, 1.0 / 60.0)
    ridge = np.exp(-(((lon + 140.05) * 30.0) ** 2)) + 0.0 * lat[:, None]
    gebco = xr.Dataset(
        {
            "elevation": (
                ("lat", "lon"),
                np.round(-3600.0 + 2400.0 * ridge).astype("int16"),
                {"standard_name": "height_above_mean_sea_level", "units": "m"},
            )
        },
        coords={
            "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        },
    )
    gebco.to_netcdf(tmp_path / "gebco.nc")
    base = load_study("quick")
    extent = {"bathymetry": str(tmp_path / "gebco.nc"), "half_extent_north": 15e3, "half_extent_east": 15e3}
    flat, ridged = (
        run_study(dead_reckoned(base, **ocean), tmp_path / name, workers=1)
        for name, ocean in (("flat", extent | {"bathymetry": None}), ("ridged", extent))
    )
    assert (flat.truth.status == VehicleStatus.ACTIVE).all()
    assert not (flat.measurements.range_status == RayStatus.BLOCKED).any()
    assert np.count_nonzero(ridged.measurements.range_status == RayStatus.BLOCKED) >= 5
    floor = ridged.ocean["sea_floor_depth"]
    assert floor.dims == ("floor_north", "floor_east")
    assert float(floor.min()) < 1300.0
