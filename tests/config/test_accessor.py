"""The accessor `mantaray` of data sets gives what the functions for files give."""

import re
import subprocess
import sys
from html import unescape
from pathlib import Path

import gsw
import numpy as np
import pytest
import xarray as xr
from refusals import refused

import pymantaray.xarray
from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.config.door.water import open_water
from pymantaray.errors import OceanError, WaterError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean.seawater import sound_speed

HYCOM = Path(__file__).resolve().parents[3] / "shared" / "data" / "hycom"
DEPTH = np.array([0.494, 9.57, 29.44, 77.85, 155.85, 318.1, 643.6, 1062.4], dtype=np.float32)


@pytest.fixture(scope="module")
def glorys():
    """Data set with the names, axes and attributes of GLORYS12, at two times."""
    lat = np.linspace(78.0, 79.0, 13, dtype=np.float32)
    lon = np.linspace(-1.0, 3.0, 25, dtype=np.float32)
    z, north, east = np.meshgrid(DEPTH, lat, lon, indexing="ij")
    theta = 3.0 - z / 400.0 + 0.2 * (east - 1.0) - 0.4 * (north - 78.5)
    salt = 34.5 + z / 3000.0
    dry = (z > 700.0) & (east < 0.0)
    fields = {
        "thetao": (np.where(dry, np.nan, theta), "sea_water_potential_temperature", "degrees_C"),
        "so": (np.where(dry, np.nan, salt), "sea_water_salinity", "1e-3"),
    }
    dims = ("time", "depth", "latitude", "longitude")
    times = np.array(["2020-03-01", "2020-03-02"], dtype="datetime64[ns]")
    return xr.Dataset(
        {
            name: (dims, np.stack([field, field + 0.5]), {"standard_name": meaning, "units": unit})
            for name, (field, meaning, unit) in fields.items()
        },
        coords={
            "time": ("time", times, {"standard_name": "time"}),
            "depth": ("depth", DEPTH, {"standard_name": "depth", "units": "m", "positive": "down"}),
            "latitude": ("latitude", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "longitude": (
                "longitude",
                lon,
                {"standard_name": "longitude", "units": "degrees_east"},
            ),
        },
    )


@pytest.fixture(scope="module")
def gulf_stream():
    files = sorted(HYCOM.glob("*2019030712_t003_ts3z.nc"))
    if not files:
        pytest.skip(f"no HYCOM file in {HYCOM}")
    return xr.load_dataset(files[0], drop_variables="tau"), files[0]


def test_sound_speed_is_that_of_teos_10(glorys, as_stored):
    speed = glorys.mantaray.sound_speed(time="2020-03-02")
    there = glorys.sel(time="2020-03-02").squeeze()
    p = gsw.p_from_z(-there["depth"].astype(float), there["latitude"].astype(float))
    SA = gsw.SA_from_SP(there["so"].astype(float), p, there["longitude"], there["latitude"])
    expected = gsw.sound_speed(SA, gsw.CT_from_pt(SA, there["thetao"].astype(float)), p)
    assert speed.dims == ("depth", "latitude", "longitude")
    attrs = speed.attrs["standard_name"], speed.attrs["units"]
    assert attrs == ("speed_of_sound_in_sea_water", "m s-1")
    ours = speed.sel(depth=there["depth"])
    np.testing.assert_array_equal(ours.isnull(), there["thetao"].isnull())
    np.testing.assert_allclose(ours, expected.transpose(*ours.dims), rtol=0, atol=1e-8)
    as_stored(speed)


def test_sound_speed_has_the_axes_of_its_data_set(glorys):
    with_speed = glorys.isel(time=0).assign(c=glorys.mantaray.sound_speed(time="2020-03-01"))
    np.testing.assert_array_equal(with_speed["c"].isnull(), with_speed["so"].isnull())


AXES = {
    "depth": (DEPTH, {"standard_name": "depth", "units": "m", "positive": "down"}),
    "height": (-DEPTH[::-1], {"standard_name": "height", "units": "m", "positive": "up"}),
    "pressure": (1.01 * DEPTH, {"standard_name": "sea_water_pressure", "units": "dbar"}),
    "from the surface": (DEPTH - DEPTH[0], {"standard_name": "depth", "units": "m"}),
}


@pytest.mark.parametrize("axis", AXES)
def test_differences_of_sound_speed_and_variables_align(glorys, axis):
    """Every point of the data set has its sound speed, whatever its levels count."""
    label, attrs = AXES[axis]
    data = glorys.isel(time=0)
    if axis == "height":
        data = data.isel(depth=slice(None, None, -1))
    data = data.assign_coords(depth=("depth", label, attrs)).rename(depth="level")
    speed = data.mantaray.sound_speed()
    assert speed.dims == ("level", "latitude", "longitude")
    assert speed["level"].attrs == attrs
    difference = speed - data["thetao"]
    assert dict(difference.sizes) == dict(data["thetao"].sizes)
    np.testing.assert_array_equal(*xr.broadcast(difference.isnull(), data["thetao"].isnull()))
    # 4 m/s per kelvin and 0.017 m/s per metre: a value on another level would show
    depth = xr.DataArray(DEPTH, {"level": label[:: -1 if axis == "height" else 1]}, ["level"])
    expected = 1449.0 + 4.6 * data["thetao"] + 1.3 * (data["so"] - 35.0) + 0.016 * depth
    assert float(abs(speed - expected).max()) < 1.0


def test_variables_without_standard_names_are_named(glorys):
    bare = glorys.isel(time=0).copy()
    for name in ("thetao", "so"):
        bare[name].attrs = {"units": bare[name].attrs["units"]}
    names = {"thetao": "sea_water_potential_temperature", "so": "sea_water_salinity"}
    speed = bare.mantaray.sound_speed(names=names)
    xr.testing.assert_identical(speed, glorys.isel(time=0).mantaray.sound_speed())
    assert bare["thetao"].attrs == {"units": "degrees_C"}


@pytest.mark.parametrize("equation", ["teos-10", "unesco"])
def test_a_hycom_data_set_is_read_as_its_file(gulf_stream, equation):
    data, path = gulf_stream
    speed = data.mantaray.sound_speed(equation=equation)
    medium = data.mantaray.medium(equation=equation, half_extent=(20e3, 20e3))
    from_file = open_water(path, equation=equation, half_extent=(20e3, 20e3)).medium
    # xarray unpacks to single precision: 2e-6 K, and 4 m/s per kelvin
    np.testing.assert_allclose(medium.sound_speed, from_file.sound_speed, rtol=0, atol=2e-5)
    np.testing.assert_array_equal(medium.bed.depth, from_file.bed.depth)
    assert np.nanmin(speed) - 1.0 < medium.sound_speed.min()
    assert speed.sizes == {"depth": 40, "lat": 33, "lon": 18}
    there = data.squeeze().sel(depth=[10.0, 400.0, 2000.0])
    ours = speed.sel(depth=there["depth"])
    z, lat, lon = xr.broadcast(there["depth"], there["lat"], there["lon"])
    expected = sound_speed(
        there["water_temp"].values, there["salinity"].values, z, lat, lon, equation=equation
    )
    np.testing.assert_allclose(ours, expected, rtol=0, atol=2e-5)


def test_eigenrays_are_those_of_local_positions(glorys, as_stored):
    source, receiver = np.array([78.5, 1.0, 50.0]), np.array([[78.55, 1.2, 300.0], [0, 0, 9.0]])
    options = {"time": "2020-03-01", "max_surface_bounces": 1}
    arrivals = glorys.mantaray.eigenrays([source, source], receiver, **options)
    frame = LocalFrame(78.5, 1.0)
    ends = [
        np.column_stack([*frame.to_local(*points[:, :2].T), points[:, 2]])
        for points in (np.array([source, source]), receiver)
    ]
    expected = find_eigenrays(glorys.mantaray.medium(time="2020-03-01"), *ends, 1, 0)
    assert arrivals.surface_bounces.tolist() == [0, 1]
    np.testing.assert_allclose(arrivals.travel_time, expected.travel_time, rtol=0, atol=1e-9)
    assert [status.item() for status in arrivals.status] == [0, 3]  # the second is outside
    as_stored(arrivals)


def test_a_section_agrees_with_the_grid_and_the_medium(glorys, as_stored):
    options = {"time": "2020-03-01"}
    section = glorys.mantaray.section((78.5, 1.0), (78.5, 2.0), points=7, **options)
    at_grid = glorys.mantaray.sound_speed(**options).sel(latitude=78.5, longitude=1.0)
    wet = at_grid.dropna("depth")
    np.testing.assert_allclose(section[:, 0].sel(depth=wet["depth"]), wet, rtol=0, atol=0.02)
    along = LocalFrame(78.5, 1.0).to_local(78.5, 2.0)
    np.testing.assert_allclose(section["distance"][-1], np.hypot(*along), rtol=1e-6)
    np.testing.assert_allclose(section["longitude"].values[[0, -1]], [1.0, 2.0], atol=1e-9)
    medium = glorys.mantaray.medium(**options)
    point = [float(section["north"][3]), float(section["east"][3]), float(section["depth"][4])]
    assert section[4, 3] == medium.sound_speed_at(point)[0]
    as_stored({"section": section, "medium": medium})


@pytest.fixture
def metres():
    c = 1450.0 + 0.016 * np.array([0.0, 100.0, 400.0]) + np.zeros((5, 5, 1))
    axis = np.linspace(-8e3, 8e3, 5)
    dims = ("north", "east", "depth")
    coords = {"north": axis, "east": axis, "depth": [0.0, 100.0, 400.0]}
    return xr.Dataset({"sound_speed": (dims, c)}, coords)


def test_water_in_metres_takes_positions_in_metres(metres, as_stored):
    ends = [0.0, 0.0, 50.0], [3000.0, 1000.0, 200.0]
    expected = find_eigenrays(Medium.from_dataset(metres), *ends)
    assert metres.mantaray.eigenrays(*ends).travel_time == expected.travel_time
    section = metres.mantaray.section((0, -3000), (4000, 0), points=6)
    np.testing.assert_allclose(section["distance"], np.linspace(0.0, 5000.0, 6))
    np.testing.assert_allclose(section[1], 1451.6, atol=1e-9)
    np.testing.assert_array_equal(metres.mantaray.sound_speed(), metres["sound_speed"])
    as_stored(section)


def test_what_is_no_ocean_is_refused_in_one_line(glorys, metres):
    refused(OceanError, "no variable", xr.Dataset().mantaray.sound_speed)
    refused(OceanError, "no variable", xr.Dataset({"a": ("x", [1.0])}).mantaray.medium)
    refused(OceanError, "time", glorys.mantaray.medium)
    rays, section = glorys.mantaray.eigenrays, glorys.mantaray.section
    now = {"time": "2020-03-01"}
    refused(WaterError, "source is .*latitude, longitude, depth", rays, (78, 1), (78, 1, 5), **now)
    refused(WaterError, "receiver is", rays, (78, 1, 5), "here", **now)
    refused(WaterError, "latitudes are 8000", rays, (8e3, 1, 5), (0, 0, 9), **now)
    refused(WaterError, "end is", section, (78, 1), (78, np.nan), **now)
    refused(WaterError, "no point", section, (10, 1), (20, 1), **now)
    refused(WaterError, "points is 1", section, (78, 1), (78, 2), points=1, **now)
    refused(WaterError, "unknown option", glorys.mantaray.medium, deepness=3)
    refused(WaterError, "north, east", metres.mantaray.section, (0, 1, 2), (0, 1))


def test_the_import_of_the_package_imports_neither_xarray_nor_numpy():
    code = "import sys, pymantaray; print({'xarray', 'numpy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_notebooks_show_the_facts_of_media_and_water(as_stored):
    options = {"half_extent_north": 20e3, "half_extent_east": 20e3}
    water = open_water("synthetic:fram", **options)
    hostile = water.local.assign_attrs(title="<b>Fram</b>")
    marked = pymantaray.Water(water.medium, local=hostile, notes=("a < b",))
    for shown in (water.medium, water, marked):
        html = shown._repr_html_()
        assert len(html) < 800
        text = unescape(re.sub(r"<[^>]*>", "", html))
        assert "depth: 0 to 5000 m" in text
        for fact in water.medium.facts().values():
            assert fact in repr(shown)
            assert fact in text
    assert "<b>" not in marked._repr_html_()
    assert "&lt;b&gt;Fram" in marked._repr_html_()
    assert "note 1: a < b" in text
    as_stored(marked.medium.facts())
