"""
Data sets with valid ranges, zeros as land, radians, climatologies (World Ocean Atlas), and without
time.
"""

import numpy as np
import pytest
import xarray as xr
from refusals import refused

from pymantaray.errors import MantaRayError, OceanError
from pymantaray.ocean import check_ocean, ocean_times, open_ocean, open_ocean_series, read_cast
from pymantaray.ocean.files import numbers, open_file
from pymantaray.ocean.summary import ocean_facts

DEPTH = np.array([0.0, 50.0, 200.0, 1000.0])
LAT, LON = np.linspace(10.0, 12.0, 9), np.linspace(5.0, 8.0, 8)
Z = DEPTH[:, None, None] + 0 * LAT[:, None] + 0 * LON
LAND = np.zeros(Z.shape, dtype=bool)
LAND[2:, 3:6, 4:6] = True  # 2 levels of 6 columns


def model(fill=np.nan, *, attrs=None, zero=("t", "s", "u", "v"), **axes):
    """Data set whose values on land are a fill value that is not declared as one."""
    fields = {
        "t": ("sea_water_temperature", "degC", 20.0 - Z / 100.0),
        "s": ("sea_water_practical_salinity", "1", 35.0 + Z / 2000.0),
        "u": ("eastward_sea_water_velocity", "m s-1", 0.1 + 0 * Z),
        "v": ("northward_sea_water_velocity", "m s-1", 0.2 + 0 * Z),
    }
    data = xr.Dataset(coords={"time": ("time", [12.0], {"units": "hours since 2024-01-01"})})
    for name, (standard, unit, values) in fields.items():
        field = np.where(LAND & (name in zero), fill, values)
        more = (attrs or {}) if isinstance(fill, float) else {}
        data[name] = (
            ("time", "depth", "lat", "lon"),
            field[None],
            {"standard_name": standard, "units": unit} | more,
        )
    data["depth"] = "depth", DEPTH, {"units": "m", "positive": "down", "standard_name": "depth"}
    data["lat"] = "lat", LAT, {"units": "degrees_north", "standard_name": "latitude"}
    data["lon"] = "lon", LON, {"units": "degrees_east", "standard_name": "longitude"}
    return data.assign_coords(axes)


def test_zeros_of_all_variables_are_land(as_stored):
    ocean = open_ocean(model(0.0))
    for name in ("water_temp", "salinity", "water_u", "water_v"):
        np.testing.assert_array_equal(np.isnan(ocean[name].values), LAND)
    assert (
        f"{LAND.sum()} points removed: temperature and salinity are exactly 0 there, as on land"
        in ocean.attrs["history"]
    )
    ocean = open_ocean(model(0.0).drop_vars(["u", "v"]), currents="rest")
    np.testing.assert_array_equal(np.isnan(ocean["salinity"].values), LAND)
    as_stored(ocean)


def test_zeros_of_temperature_and_salinity_are_land():
    ocean = open_ocean(model(0.0, zero=("t", "s")))
    np.testing.assert_array_equal(np.isnan(ocean["salinity"].values), LAND)
    fresh = model(0.0)
    fresh["s"][:] = 0.0
    assert "points removed" not in open_ocean(fresh).attrs.get("history", "")


def test_a_salinity_of_zero_in_salty_water_is_noted(as_stored):
    ocean = open_ocean(model(0.0, zero=("s",)))
    assert (ocean["salinity"].values[LAND] == 0.0).all()
    assert f"a salinity of 0 in salty water at {LAND.sum()} points" in ocean.attrs["history"]
    as_stored(ocean)


def test_a_latitude_without_units_that_may_be_in_radians_is_refused():
    axes = {"lat": ("lat", np.radians(LAT)), "lon": ("lon", np.radians(LON))}
    refused(
        OceanError,
        "lat has no units and may be in degrees or radians; set its units",
        open_ocean,
        model(**axes),
    )
    plain = model(lat=("lat", LAT), lon=("lon", LON))
    np.testing.assert_array_equal(open_ocean(plain)["lat"].values, LAT)


def test_zeros_of_one_variable_are_water(as_stored):
    ocean = open_ocean(model(0.0, zero=("u", "v")))
    assert np.isfinite(ocean["water_u"].values).all()
    ocean = open_ocean(model(0.0, zero=("t",)))
    assert (ocean["water_temp"].values[LAND] == 0.0).all()
    as_stored(ocean)


@pytest.mark.parametrize("attrs", [
    {"valid_min": -10.0, "valid_max": 60.0}, {"valid_max": 60}, {"valid_range": [-10.0, 60.0]},
    {"valid_range": np.array([-10, 60])},
    {"valid_max": np.float32(60.0)},
])  # fmt: skip
def test_values_outside_the_valid_range_are_missing(tmp_path, attrs, as_stored):
    data = model(99.0, attrs=attrs)
    data.to_netcdf(tmp_path / "a.nc")
    for source in (data, tmp_path / "a.nc"):
        ocean = open_ocean(source)
        np.testing.assert_array_equal(np.isnan(ocean["salinity"].values), LAND)
        assert f"{LAND.sum()} values of s outside its valid range removed" in ocean.attrs["history"]
    as_stored(ocean)


@pytest.mark.parametrize(("packing", "limits", "missing"), [
    # integers are 0 to 9, values 20 to 65; limits of integers are packed, of real numbers unpacked
    ({"scale_factor": 5.0, "add_offset": 20.0},
     {"valid_min": np.int16(2), "valid_max": np.int16(7)}, [0, 1, 8, 9]),
    ({"scale_factor": 5.0, "add_offset": 20.0}, {"valid_range": np.array([2, 7], dtype="i2")},
     [0, 1, 8, 9]),
    ({"scale_factor": 5.0, "add_offset": 20.0}, {"valid_min": 30.0, "valid_max": 55.0},
     [0, 1, 8, 9]),
    ({"scale_factor": -5.0, "add_offset": 20.0}, {"valid_min": np.int16(2)}, [0, 1]),
    ({"scale_factor": 5.0, "add_offset": 20.0}, {}, []),
])  # fmt: skip
def test_valid_ranges_of_packed_integers_are_packed(tmp_path, packing, limits, missing, as_stored):
    data = xr.Dataset({"x": ("n", np.arange(10, dtype="i2"), packing | limits)})
    data.to_netcdf(tmp_path / "packed.nc")
    with open_file(tmp_path / "packed.nc") as opened:
        values = numbers(opened, "x")
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(values)), missing)
    kept = np.setdiff1d(np.arange(10), missing)
    np.testing.assert_allclose(values[kept], packing["scale_factor"] * kept + packing["add_offset"])
    as_stored(opened)


def test_packed_limits_of_unpacked_values_are_ignored():
    data = model(np.nan, attrs={"valid_min": np.int16(-32000), "valid_max": np.int16(1)})
    assert np.nanmax(open_ocean(data)["salinity"].values) > 35.0


def test_radians_become_degrees(as_stored):
    axes = {
        "lat": ("lat", np.radians(LAT), {"units": "radians", "standard_name": "latitude"}),
        "lon": ("lon", np.radians(LON), {"units": "radian", "standard_name": "longitude"}),
    }
    ocean = open_ocean(model(0.0, **axes))
    np.testing.assert_allclose(ocean["lat"], LAT, rtol=1e-14)
    np.testing.assert_allclose(ocean["lon"], LON, rtol=1e-14)
    as_stored(ocean)


def test_rows_of_a_cast_that_are_zero_are_missing(tmp_path, as_stored):
    text = "# lat 12, lon 6\ndepth,temperature,salinity\n1,20,35\n2,0,0\n3,20,35.1\n9,19,35.2\n"
    (tmp_path / "cast.csv").write_text(text)
    cast = read_cast(tmp_path / "cast.csv")
    np.testing.assert_array_equal(cast.depth, [1.0, 3.0, 9.0])
    assert "1 of 4 rows dropped: with a missing value" in cast.notes
    refused(
        OceanError,
        "a level at 9e.36; allowed: at most 12000 m",
        open_ocean,
        model(0.0, depth=("depth", [0.0, 1.0, 2.0, 9e36], {"units": "m"})),
    )
    as_stored(cast)


def atlas(kind, months=(396.5,)):
    """
    Layout of woa23_decav_t01_01.nc: the analysed mean beside statistics with its standard name.
    """
    standard, unit = {
        "t": ("sea_water_temperature", "degrees_celsius"),
        "s": ("sea_water_practical_salinity", "1"),
    }[kind]
    own = model(np.nan)[kind].isel(time=0, drop=True)
    fields = np.stack([own.values + 0.1 * k for k in range(len(months))]).astype("f4")
    dims = ("time", "depth", "lat", "lon")
    data = xr.Dataset(
        coords={name: own[name] for name in dims[1:]}, attrs={"title": "World Ocean Atlas"}
    )
    for name, methods in (("an", ""), ("mn", "statistical mean"), ("dd", "number")):
        words = f"{standard} number_of_observations" if name == "dd" else standard
        data[f"{kind}_{name}"] = (
            dims,
            fields,
            {"standard_name": words, "units": unit, "long_name": methods},
        )
    data["crs"] = (), 0, {"grid_mapping_name": "latitude_longitude"}
    data["time"] = (
        "time",
        np.array(months),
        {
            "standard_name": "time",
            "units": "months since 1955-01-01 00:00:00",
            "climatology": "climatology_bounds",
            "axis": "T",
        },
    )
    data["climatology_bounds"] = ("time", "nbounds"), np.array([[0.0, 805.0]] * len(months))
    return data.set_coords("time")


def test_the_world_ocean_atlas_is_an_ocean_at_rest(tmp_path):
    files = [tmp_path / f"woa23_decav_{kind}01_01.nc" for kind in "ts"]
    for file, kind in zip(files, "ts", strict=True):
        atlas(kind).to_netcdf(file)
    ocean = open_ocean(files, currents="rest")
    expected = model(np.nan)
    np.testing.assert_allclose(ocean["water_temp"].values, expected["t"].values[0], rtol=1e-6)
    np.testing.assert_allclose(ocean["salinity"].values, expected["s"].values[0], rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(ocean["water_u"].values), LAND)
    assert ocean["time"].values == np.datetime64("1988-01-16T12:00")  # 33 years and half of January
    assert "climatology, for 1988-01-16T12:00" in ocean.attrs["history"]
    dated = open_ocean(files, currents="rest", time="2014-01-20")
    assert dated["time"].values == np.datetime64("2014-01-20")
    assert (
        "time set to 2014-01-20T00:00: climatology, for 1988-01-16T12:00" in dated.attrs["history"]
    )
    refused(OceanError, "currents='rest'", open_ocean, files)
    assert check_ocean(files, currents="rest").ok


@pytest.mark.parametrize(
    ("time", "month"), [("2014-03-10", 2), ("2014-12-28", 11), ("2014-01-02", 0), ("2015-07-15", 6)]
)
def test_a_mean_year_gives_the_nearest_month(time, month, as_stored):
    months = np.arange(12) + 0.5
    data = xr.merge([atlas("t", months), atlas("s", months)], compat="override")
    ocean = open_ocean(data, currents="rest", time=time)
    first = model(np.nan)["t"].values[0]
    np.testing.assert_allclose(ocean["water_temp"].values, first + 0.1 * month, rtol=1e-6)
    refused(OceanError, "12 times", open_ocean, data, currents="rest")
    as_stored(ocean)


def test_months_beyond_every_calendar_are_of_no_year(as_stored):
    data = xr.merge(
        [atlas("t", (4614.0,)), atlas("s", (4614.0,))], compat="override"
    )  # as in woa23, decade 91C0
    ocean = open_ocean(data, currents="rest")
    assert ocean["time"].values == np.datetime64("1955-07-01")  # 4614 = 384 years and 6 months
    as_stored(ocean)


def test_a_data_set_without_time_is_an_ocean(tmp_path, as_stored):
    data = model(np.nan).isel(time=0, drop=True)
    data.to_netcdf(tmp_path / "a.nc")
    for source in (data, tmp_path / "a.nc"):
        ocean = open_ocean(source)
        assert np.isnat(ocean["time"].values)
        assert check_ocean(source).ok
        assert np.isnat(ocean_times(source)).all()
        assert ocean_facts(ocean)["time"] == "unknown"
        assert open_ocean(source, time="2014-01-02")["time"].values == np.datetime64("2014-01-02")
        refused(
            MantaRayError,
            "no time coordinate; an ocean that varies",
            open_ocean_series,
            source,
            "2014-01-01",
            "2014-01-02",
        )
    ocean.to_netcdf(tmp_path / "own.nc")
    xr.testing.assert_equal(open_ocean(tmp_path / "own.nc"), ocean)
    as_stored(ocean)


def test_longitudes_with_a_gap_are_refused():
    """A spline across 90 degrees without grid points is no water; a window selects one side."""
    lon = np.r_[LON[:4], LON[4:] + 90.0]
    refused(OceanError, "longitude has a gap from 6.28571 to 96.7143", open_ocean, model(lon=lon))
    assert open_ocean(model(lon=lon), window=(10.0, 12.0, 5.0, 7.0)).sizes["lon"] == 4


@pytest.mark.parametrize("window", [(10.0, 12.0, -180.0, 180.0), (10.0, 12.0, 6.0, 366.0)])
def test_a_window_around_the_globe_takes_all_longitudes(window, as_stored):
    lon = LON + 173.0
    ocean = open_ocean(model(lon=lon), window=window)
    np.testing.assert_allclose(np.diff(ocean["lon"]), np.diff(lon))
    as_stored(ocean)


def with_time(value, units, **attrs):
    return model().assign_coords(time=("time", [value], {"units": units, **attrs}))


@pytest.mark.parametrize(("value", "units", "message"), [
    (-135_140.0, "days since 1970-01-01", "has the year 1600; allowed: 1678 to 2261"),
    (0.0, "hours since 2263-01-01", "has the year 2263"),
    (0.0, "days since 50-01-01", "has the year 50"),
    (np.inf, "hours since 2000-01-01", "has infinite values"),
    (0.0, "hours since 2000-01-01 00:00:00 EST", "cannot be read with certainty"),
    (0.0, "days since 01/02/2000", "cannot be read with certainty"),
])  # fmt: skip
def test_an_instant_that_may_be_another_is_refused(value, units, message):
    """64-bit nanoseconds wrap around: the year 1600 was read as 2184."""
    refused(OceanError, message, ocean_times, with_time(value, units))


@pytest.mark.parametrize(("value", "units", "instant"), [
    (735_601.0, "days since 0001-01-01", "2015-01-02"),
    (3.0, "months since 2000-01-15", "2000-04-15"),
    (0.0, "hours since 2000-01-01 00:00:00 -3:30", "2000-01-01T03:30"),
    (0.0, "hours since 2000-01-01 00:00:00 UTC", "2000-01-01"),
])  # fmt: skip
def test_an_origin_of_times_is_read_whole(value, units, instant):
    assert ocean_times(with_time(value, units))[0] == np.datetime64(instant)
