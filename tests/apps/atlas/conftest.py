"""A small ocean with a coast, in one file and through time in several, and few links."""

import numpy as np
import pytest

from pymantaray.apps.atlas import AtlasLinks, open_atlas, plan
from pymantaray.ocean import synthetic_ocean

COAST = (slice(20, 23), slice(26, 32))
"""Rows and columns of `ocean` that are land, one of them in a column of the atlas."""


@pytest.fixture(scope="session")
def ocean():
    """Part of the synthetic Fram Strait, with an island."""
    part = synthetic_ocean("fram").isel(lat=slice(20, 52), lon=slice(100, 152)).copy(deep=True)
    for name in ("water_temp", "salinity", "water_u", "water_v"):
        part[name][:, *COAST] = np.nan
    return part


@pytest.fixture(scope="session")
def file(ocean, tmp_path_factory):
    path = tmp_path_factory.mktemp("atlas") / "ocean.nc"
    ocean.to_netcdf(path, engine="netcdf4")
    return path


@pytest.fixture(scope="session")
def days(ocean, tmp_path_factory):
    """Three days, a file each, colder from day to day."""
    folder = tmp_path_factory.mktemp("days")
    paths = [folder / f"day-{day}.nc" for day in range(3)]
    for day, path in enumerate(paths):
        later = ocean.assign_coords(time=ocean["time"] + np.timedelta64(day, "D"))
        later["water_temp"] = later["water_temp"] - 0.2 * day
        later["time"].attrs = ocean["time"].attrs
        later["water_temp"].attrs = ocean["water_temp"].attrs
        later.to_netcdf(path, engine="netcdf4")
    return paths


@pytest.fixture(scope="session")
def links():
    """Six links, up to 3 km."""
    return AtlasLinks(
        pairs=((20.0, 100.0), (300.0, 300.0)), distances=(1_000.0, 3_000.0), bearings=3
    )


@pytest.fixture
def tiles(monkeypatch):
    """Blocks of three by three columns."""
    monkeypatch.setattr(plan, "_COLUMNS", 3)


@pytest.fixture(scope="session")
def content():
    """Everything in an atlas' file, loaded."""

    def load(path):
        with open_atlas(path) as dataset:
            return dataset.load()

    return load
