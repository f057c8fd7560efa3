"""Oceans from data sets in memory, and variables that a user names."""

import numpy as np
import pytest
import xarray as xr
from refusals import refused

from pymantaray.errors import OceanError
from pymantaray.ocean import ocean_times, open_ocean, open_ocean_series, synthetic_ocean


@pytest.fixture(scope="module")
def fram():
    return synthetic_ocean("fram")


def bare(ocean, **names):
    """
    The same fields as a model without metadata has them: other names, order and directions, no
    attributes.
    """
    plain = ocean.rename({"water_temp": "temp", **names})
    plain = plain.transpose("lon", "lat", "depth").isel(
        lat=slice(None, None, -1), depth=slice(None, None, -1)
    )
    for name in plain.data_vars:
        plain[name].attrs = {}
    return plain


def test_a_valid_ocean_in_memory_comes_back_unchanged(fram):
    xr.testing.assert_identical(open_ocean(fram), fram)


def test_a_data_set_in_memory_is_read_as_its_file_is(fram, tmp_path):
    plain = bare(fram)
    names = {"temp": "sea_water_temperature[degC]", "salinity": "sea_water_practical_salinity[1]"}
    names |= {
        "water_u": "eastward_sea_water_velocity[m s-1]",
        "water_v": "northward_sea_water_velocity[m s-1]",
    }
    plain.to_netcdf(tmp_path / "plain.nc")
    from_file, in_memory = (
        open_ocean(source, names=names) for source in (tmp_path / "plain.nc", plain)
    )
    xr.testing.assert_equal(from_file, in_memory)
    for name in ("water_temp", "salinity", "water_u", "water_v"):
        np.testing.assert_array_equal(in_memory[name], fram[name])
    assert in_memory["time"].values == fram["time"].values


def test_instants_in_memory_are_those_of_the_data_set(fram):
    times = np.array(["2014-07-15T00", "2014-07-15T06"], dtype="datetime64[ns]")
    varying = xr.concat(
        [fram.drop_vars("time"), fram.drop_vars("time") + 0.0], "time"
    ).assign_coords(time=times)
    for name in fram.data_vars:
        varying[name].attrs = fram[name].attrs
    np.testing.assert_array_equal(ocean_times(varying), times)
    assert [
        o["time"].values for o in open_ocean_series(varying, "2014-07-15T01", "2014-07-15T05")
    ] == list(times)
    assert open_ocean(varying, time="2014-07-15T06").sizes == fram.sizes


def test_opening_changes_nothing_of_the_users_data_set(fram):
    plain = bare(fram)
    before = plain.copy(deep=True)
    with pytest.raises(OceanError):
        open_ocean(plain, names={"temp": "sea_water_temperature"})
    xr.testing.assert_identical(plain, before)


def test_a_name_without_its_variable_lists_what_there_is(fram):
    plain = bare(fram)
    no_variable = "in memory: no variable 'tmp' for sea_water_temperature; available: temp, "
    refused(OceanError, no_variable, open_ocean, plain, names={"tmp": "sea_water_temperature"})
    refused(
        OceanError,
        "temp: 'sea water'; it must be a CF standard name",
        open_ocean,
        plain,
        names={"temp": "sea water"},
    )


def test_a_misspelt_name_and_a_missing_unit_have_a_remedy(fram):
    plain = bare(fram)
    near = {"temp": "sea_water_temprature"}
    refused(
        OceanError,
        "name of temp: 'sea_water_temprature' is not a standard name; did you mean"
        " sea_water_temperature",
        open_ocean,
        plain,
        names=near,
    )
    names = {"temp": "sea_water_temperature", "salinity": "sea_water_practical_salinity"}
    refused(
        OceanError,
        "temp has no units; set .*names",
        open_ocean,
        plain,
        names=names,
        currents="rest",
    )
