"""HYCOM's files as they come: packed or not, apart or together, whole or broken."""

import resource

import gsw
import netCDF4
import numpy as np
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean import open_ocean, to_local
from pymantaray.ocean.seawater import sound_speed

PACKING = {"dtype": "int16", "scale_factor": 0.001, "_FillValue": -30000}
TRACER = {**PACKING, "add_offset": 20.0}


@pytest.fixture
def small(closed_form_ocean):
    """Ocean across the antimeridian with a step of a sea bed, as HYCOM would have it."""
    return closed_form_ocean(
        60.0,
        180.0,
        temperature=lambda z, _lat, lon: 4.0 + 0.1 * (lon - 180.0) - 1e-3 * z,
        floor=lambda lat, _lon: np.where(lat > 60.05, 60.0, 400.0),
        n=(9, 11),
        depth=[0.0, 50.0, 200.0, 500.0],
    )


TS, UV = ["water_temp", "salinity"], ["water_u", "water_v"]


def as_file(path, ocean, names=(*TS, *UV), *, times=("2020-01-01",), packed=True):
    """Write a file as HYCOM does, with the variable tau that stops xarray."""
    data = ocean.drop_vars("time").drop_attrs(deep=False)[list(names)]
    data = xr.concat([data] * len(times), "time").assign_coords(
        time=np.array(times, "datetime64[ns]")
    )
    encoding = {n: TRACER if n in TS else PACKING for n in names} if packed else {}
    data["tau"] = ("time", np.zeros(len(times)), {"units": "hours since analysis"})
    data["time"].encoding = {"units": "hours since 2000-01-01 00:00:00", "dtype": "float64"}
    data.to_netcdf(
        path, engine="netcdf4", format="NETCDF3_64BIT" if packed else None, encoding=encoding
    )
    return path


@pytest.fixture
def apart(tmp_path, small):
    """Tracers and currents in a file each."""
    return [as_file(tmp_path / "ts.nc", small, TS), as_file(tmp_path / "uv.nc", small, UV)]


def test_the_gulf_stream_opens_and_has_the_sound_speed_of_gsw(gulf_stream_files, as_stored):
    ocean = open_ocean(gulf_stream_files)
    assert dict(ocean.sizes) == {"depth": 40, "lat": 33, "lon": 18}
    assert -75.7 < float(ocean["lon"].min()) < float(ocean["lon"].max()) < -74.3
    assert ocean["time"].values == np.datetime64("2019-03-07T15:00")
    assert ocean.attrs["synthetic"] == 0
    temperature, salinity = ocean["water_temp"].values, ocean["salinity"].values
    depth, lat, lon = (ocean[name].values for name in ("depth", "lat", "lon"))
    k, i, j = np.nonzero(np.isfinite(temperature))
    p = gsw.p_from_z(-depth[k], lat[i])
    SA = gsw.SA_from_SP(salinity[k, i, j], p, lon[j], lat[i])
    expected = gsw.sound_speed(SA, gsw.CT_from_t(SA, temperature[k, i, j], p), p)
    found = sound_speed(temperature, salinity, depth[:, None, None], lat[:, None], lon)
    np.testing.assert_allclose(found[k, i, j], expected, rtol=0, atol=1e-9)
    as_stored(ocean)


def test_an_origin_on_a_grid_point_has_the_values_of_that_point(gulf_stream_files, as_stored):
    point = open_ocean(gulf_stream_files).isel(lat=10, lon=12)
    centre = float(point["lat"]), float(point["lon"])
    local = to_local(open_ocean(gulf_stream_files), centre, (24e3, 24e3)).sel(north=0.0, east=0.0)
    expected = {
        "sound_speed": sound_speed(
            point["water_temp"], point["salinity"], point["depth"].values, *centre
        ),
        "current_east": point["water_u"].values,  # the frame's centre has no convergence
        "current_north": point["water_v"].values,
    }
    wet = np.isfinite(expected["sound_speed"])
    for name, values in expected.items():
        np.testing.assert_allclose(local[name].values[wet], values[wet], rtol=0, atol=1e-9)
    as_stored(local)


def test_tracers_and_currents_come_from_two_files_in_any_order(apart):
    xr.testing.assert_equal(open_ocean(apart), open_ocean(apart[::-1]))


@pytest.mark.parametrize("convention", ["0 to 360", "-180 to 180", "-180 to 180, sorted"])
def test_longitudes_of_any_convention_are_put_in_a_row(tmp_path, small, convention, as_stored):
    written = small
    if convention != "0 to 360":
        written = small.assign_coords(lon=(small["lon"].values + 180.0) % 360.0 - 180.0)
    if convention.endswith("sorted"):
        written = written.sortby("lon")
    opened = open_ocean(as_file(tmp_path / "file.nc", written))
    assert np.all(np.diff(opened["lon"]) > 0.0)
    np.testing.assert_allclose(
        np.cos(np.radians(opened["lon"] - small["lon"].values)), 1.0, atol=1e-12
    )
    np.testing.assert_allclose(opened["water_temp"], small["water_temp"], atol=0.0006)
    assert to_local(opened).attrs["centre_longitude_deg"] == pytest.approx(-180.0)
    as_stored(opened)


def test_a_time_is_chosen_among_several(tmp_path, small):
    path = as_file(tmp_path / "two.nc", small, times=("2020-01-01T00:00", "2020-01-01T03:00"))
    assert open_ocean(path, time="2020-01-01T03:00")["time"].values == np.datetime64(
        "2020-01-01T03:00"
    )
    with pytest.raises(
        OceanError,
        match=r"2 times .*select one with `time=2020-01-01T00:00`",
    ):
        open_ocean(path)
    with pytest.raises(OceanError, match=r"no time 2020-02-01; available: 2020-01-01T00:00"):
        open_ocean(path, time="2020-02-01")


def test_a_fill_value_that_a_server_scaled_is_masked(tmp_path, small, as_stored):
    scaled = small.fillna(dict.fromkeys(TS, -10.0) | dict.fromkeys(UV, -30.0))
    opened = open_ocean(as_file(tmp_path / "scaled.nc", scaled, packed=False))
    np.testing.assert_array_equal(np.isnan(opened["water_temp"]), np.isnan(small["water_temp"]))
    as_stored(opened)


def potential_and_in_situ(ocean):
    attrs = {"standard_name": "sea_water_potential_temperature", "comment": "in-situ temperature"}
    return ocean.assign(water_temp=ocean["water_temp"].assign_attrs(attrs))


REFUSED = {
    "no salinity": (lambda o: (o, ["water_temp", *UV]), "no salinity; an ocean needs"),
    "no currents": (lambda o: (o, TS), "no water_u and no water_v; an ocean needs"),
    "no tracers": (lambda o: (o, UV), "no water_temp and no salinity; an ocean needs"),
    "something else": (
        lambda o: (o.rename(water_temp="sst")["sst"].drop_attrs().to_dataset(), ["sst"]),
        "no variable water_temp",
    ),
    "two temperatures": (
        lambda o: (potential_and_in_situ(o), [*TS, *UV]),
        "says potential temperature and its comment says in situ",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_files_that_hold_no_ocean_are_refused(tmp_path, small, case, message_of):
    change, words = REFUSED[case]
    message = message_of(as_file(tmp_path / "file.nc", *change(small), packed=False))
    assert message.startswith("file.nc: ")
    assert words in message


def test_sources_that_are_no_file_are_refused(tmp_path, message_of):
    page = tmp_path / "error.nc"
    page.write_text("<html>503 Service Unavailable</html>")
    assert "neither NetCDF-3 nor NetCDF-4" in message_of(page)
    assert "no such file" in message_of(tmp_path / "nowhere.nc")
    assert "no file; name" in message_of([])
    assert "cannot be combined" in message_of(["synthetic:fram", page])


def test_files_that_do_not_belong_together_are_refused(tmp_path, small, apart, message_of):
    moved = as_file(tmp_path / "moved.nc", small.assign_coords(lat=small["lat"] + 0.04), UV)
    assert "moved.nc: water_u and water_temp have different lat axes" in message_of(
        [apart[0], moved]
    )
    later = as_file(tmp_path / "later.nc", small, UV, times=("2020-01-02",))
    message = message_of([apart[0], later], time="2020-01-01")
    assert message.startswith("ts.nc, later.nc: no water_u and no water_v at 2020-01-01")
    # a variable that no file has is named before any question of time
    assert "no water_u and no water_v; an ocean needs" in message_of(apart[0], time="2020-01-09")


def test_currents_of_several_days_open_with_tracers_of_another_file(
    shared_data, tmp_path, message_of, as_stored
):
    path = shared_data / "hycom" / "hycom_glby_930_202212_uv_ncss_netcdf4.nc"
    assert "no water_temp and no salinity" in message_of(path)
    with xr.open_dataset(path) as data:
        warm = data["water_u"].where(data["water_u"].isnull(), 20.0).drop_attrs(deep=False)
        second = data["water_v"].isel(time=1).load()
    tracers = xr.Dataset(
        {
            "water_temp": warm.assign_attrs(units="degC"),
            "salinity": (warm + 15.0).assign_attrs(units="psu"),
        }
    )
    tracers.to_netcdf(tmp_path / "ts.nc", engine="netcdf4")
    ocean = open_ocean([path, tmp_path / "ts.nc"], time=str(second["time"].values))
    np.testing.assert_array_equal(ocean["water_v"], second)
    assert ocean.attrs["source"] == "HYCOM"
    as_stored(ocean)


def test_a_window_reads_what_cropping_the_whole_gives(gulf_stream_files, message_of):
    whole = open_ocean(gulf_stream_files)
    part = open_ocean(gulf_stream_files, window=(34.7, 35.1, -75.3, -74.6))
    expected = whole.sel(lat=slice(34.699, 35.101), lon=slice(-75.301, -74.599))
    assert expected.sizes["lat"] > 5
    xr.testing.assert_identical(part, expected)
    east = open_ocean(gulf_stream_files, window=(34.7, 35.1, 284.7, 285.4))  # the other convention
    xr.testing.assert_identical(part, east)
    assert "no grid point in the window" in message_of(
        gulf_stream_files, window=(10.0, 12.0, 0.0, 2.0)
    )
    for wrong in ((35.0, 34.0, 0.0, 1.0), (1.0, 2.0, 3.0), "here", (np.nan, 1.0, 2.0, 3.0)):
        assert "window" in message_of(gulf_stream_files, window=wrong)


@pytest.mark.parametrize("stored", ["0 to 360", "-180 to 180"])
def test_a_window_across_the_seam_of_a_global_file(tmp_path, closed_form_ocean, stored, as_stored):
    lon = np.arange(0.0, 360.0, 2.0) if stored == "0 to 360" else np.arange(-180.0, 180.0, 2.0)
    ocean = closed_form_ocean(
        10.0,
        0.0,
        temperature=lambda z, lat, _lon: 10.0 + 0 * z + lat,
        n=(6, lon.size),
        depth=[0.0, 100.0],
    ).assign_coords(lon=("lon", lon, {"units": "degrees_east", "standard_name": "longitude"}))
    ocean["salinity"] = ocean["salinity"] * 0 + 30.0 + ocean["lon"] % 360.0 / 90.0
    ocean["salinity"].attrs = {"units": "psu", "standard_name": "sea_water_salinity"}
    path = as_file(tmp_path / "global.nc", ocean)
    assert open_ocean(path).sizes["lon"] == lon.size
    for west, east in ((170.0, -170.0), (-10.0, 10.0), (350.0, 370.0), (-200.0, -180.0)):
        part = open_ocean(path, window=(9.0, 11.0, west, east))
        assert np.all(np.diff(part["lon"]) > 0.0)
        assert (part["lon"].values[0] - west) % 360.0 == pytest.approx(0.0, abs=1e-9)
        assert part.sizes["lon"] == round((east - west) % 360.0 / 2.0) + 1
        expected = 30.0 + part["lon"].values % 360.0 / 90.0
        np.testing.assert_allclose(part["salinity"].values[0, 0], expected, atol=6e-4)
    as_stored(part)


def test_a_global_file_of_gigabytes_is_read_by_the_window(tmp_path, as_stored):
    """HYCOM's grid in NetCDF-3: 6 GB declared and there, but for the axes a hole in the file."""
    axes = {
        "time": (np.zeros(1), "hours since 2014-07-15 12:00"),
        "depth": (np.arange(40.0), "m"),
        "lat": (np.linspace(-80.0, 90.0, 4251), "degrees_north"),
        "lon": (np.arange(4500) * 0.08, "degrees_east"),
    }
    path = tmp_path / "global.nc"
    with netCDF4.Dataset(path, "w", format="NETCDF3_64BIT_OFFSET") as file:
        file.set_fill_off()
        for name, (values, unit) in axes.items():
            file.createDimension(name, None if name == "time" else values.size)
            file.createVariable(name, "f8", name).units = unit
        for name, unit in zip((*TS, *UV), ("degC", "psu", "m/s", "m/s"), strict=True):
            attrs = {
                "units": unit,
                "scale_factor": 0.001,
                "add_offset": 20.0 if name in TS else 0.0,
            }
            file.createVariable(name, "i2", tuple(axes)).setncatts(attrs)
        for name, (values, _) in axes.items():
            file[name][:] = values
    assert path.stat().st_size > 6e9
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    ocean = open_ocean(path, window=(70.0, 71.0, -150.0, -148.0))
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    assert ocean.sizes["lon"] == 26
    assert (ocean["water_temp"] == 20.0).all()  # zero bytes are the offset
    assert grown < 100e6
    as_stored(ocean)
