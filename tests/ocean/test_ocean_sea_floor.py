"""
The sea floor: what levels imply, every product's own layout, which one wins, and what is refused.
"""

import re

import netCDF4
import numpy as np
import pyproj
import pytest
import xarray as xr
from refusals import refused

from pymantaray.config.door.water import open_water
from pymantaray.errors import OceanError
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import (
    fill_below_sea_bed,
    open_sea_floor,
    sea_floor as sea_floor_module,
    sea_floor_depth,
    to_local,
)
from pymantaray.ocean.check import check_ocean
from pymantaray.ocean.seawater import sound_speed

DEPTH = [0.0, 10.0, 40.0, 100.0]


def test_the_floor_is_half_way_to_the_next_level(closed_form_ocean, as_stored):
    floors = np.array(
        [-1.0, 0.0, 10.0, 39.0, 40.0, 99.0, 100.0, 500.0]
    )  # true depth of each column
    ocean = closed_form_ocean(
        0.0,
        0.0,
        temperature=lambda z, _lat, _lon: 10.0 + 0 * z,
        floor=lambda _lat, lon: floors[np.round(lon / 0.08 + 3.5).astype(int)],
        n=(5, 8),
        depth=DEPTH,
    )
    expected = [0.0, 5.0, 25.0, 25.0, 70.0, 70.0, 100.0, 100.0]
    np.testing.assert_array_equal(sea_floor_depth(ocean), np.tile(expected, (5, 1)))
    as_stored(ocean)


def test_valid_values_stay_and_the_deepest_is_carried_down():
    field = np.arange(2.0 * 3 * 4).reshape(2, 3, 4)
    field[1, 2, 3] = np.nan
    filled = fill_below_sea_bed(field, np.array([0.0, 1.0, 2.0]))
    valid = np.isfinite(field)
    np.testing.assert_array_equal(filled[valid], field[valid])
    assert filled[1, 2, 3] == field[0, 2, 3]


def test_land_takes_the_nearest_wet_column_by_distance_not_by_index():
    field = np.full((1, 5, 9), np.nan)
    field[0, 2, 1], field[0, 4, 4] = 1.0, 2.0  # 3 columns west, 2 rows north of the point (2, 4)
    near_pole, equator = np.full(5, 78.0), np.zeros(5)
    assert fill_below_sea_bed(field, equator)[0, 2, 4] == 2.0
    assert fill_below_sea_bed(field, near_pole)[0, 2, 4] == 1.0


def test_a_window_on_land_is_refused():
    refused(
        OceanError, "no wet column", fill_below_sea_bed, np.full((2, 4, 4), np.nan), np.zeros(4)
    )


WINDOW = (75.0, 76.0, 179.0, -179.0)  # across the antimeridian


def height(lat, lon):
    """Hills and a coast, linear between points 0.05 degrees apart; positive up. [m]"""
    turned = (
        lon - 180.0
    ) % 360.0  # 0 at the antimeridian; the jump of this at 0 E is outside every window
    turned = np.where(turned > 180.0, turned - 360.0, turned)
    return np.round(-2_000.3 + 1_500.0 * (lat - 75.5) - 80.0 * turned)


def grid(lat, lon):
    return height(lat[:, None], lon[None, :])


def check(floor):
    """Depths, axes and conventions of what was read."""
    assert floor.dims == ("lat", "lon")
    assert np.all(np.diff(floor["lat"]) > 0.0)
    assert np.all(np.diff(floor["lon"]) > 0.0)
    expected = np.maximum(-grid(floor["lat"].values, floor["lon"].values), 0.0)
    np.testing.assert_allclose(floor.values, expected, atol=1e-6)
    assert floor.attrs["units"] == "m"


def spans(floor, window, step):
    """One point beyond the window on each side, and no more than two."""
    south, north, west, east = window
    east = east if east > west else east + 360.0
    lat, lon = floor["lat"].values, floor["lon"].values
    lon = lon + 360.0 * np.round((0.5 * (west + east) - lon.mean()) / 360.0)
    assert south - 2.1 * step < lat[0] <= south + 1e-9
    assert north - 1e-9 <= lat[-1] < north + 2.1 * step
    assert west - 2.1 * step < lon[0] <= west + 1e-9
    assert east - 1e-9 <= lon[-1] < east + 2.1 * step


LAT = np.round(np.arange(74.025, 77.0, 0.05), 6)
LON_180 = np.round(np.arange(-179.975, 180.0, 0.05), 6)
LON_360 = np.round(np.arange(0.025, 360.0, 0.05), 6)


GEBCO_FURTHER = {
    "tid": (("lat", "lon"), np.zeros((LAT.size, LON_360.size), "i1")),
    "crs": ((), b""),
}


def save(
    path,
    name,
    values,
    attrs=None,
    *,
    lat=LAT,
    lon=LON_360,
    dims=("lat", "lon"),
    extra=None,
    **options,
):
    """A file with one field on two axes."""
    axes = dict(zip(dims, (lat, lon), strict=True))
    xr.Dataset({name: (dims, values, attrs or {})} | (extra or {}), coords=axes).to_netcdf(
        path, **options
    )
    return path


def test_only_the_window_is_read(tmp_path):
    """A grid of GEBCO's size, 30 GB as numbers, of which only some chunks were ever written."""
    lat, lon = (-h + 1.0 / 480.0 + np.arange(2 * h * 240) / 240.0 for h in (90, 180))
    with netCDF4.Dataset(tmp_path / "gebco.nc", "w") as data:
        for name, axis in (("lat", lat), ("lon", lon)):
            data.createDimension(name, axis.size)
            data.createVariable(name, "f8", (name,))[:] = axis
        z = data.createVariable(
            "elevation", "i2", ("lat", "lon"), chunksizes=(60, 60), fill_value=32767
        )
        rows = slice(*np.searchsorted(lat, (75.2, 75.4)))
        for columns in (slice(0, 60), slice(-60, None)):
            z[rows, columns] = grid(lat[rows], lon[columns])
    floor = open_sea_floor(tmp_path / "gebco.nc", window=(75.21, 75.39, 179.9, -179.9))
    check(floor)
    spans(floor, (75.21, 75.39, 179.9, -179.9), 1.0 / 240.0)


GEBCO = {
    "standard_name": "height_above_reference_ellipsoid",
    "units": "m",
    "long_name": "Elevation",
}
LON_BOTH_ENDS = np.round(np.arange(-180.0, 180.01, 0.05), 6)  # as in ETOPO1
NAMED = ("latitude", "longitude")


@pytest.mark.parametrize(("name", "sign", "attrs", "options"), [
    ("elevation", "i2", GEBCO, {"lon": LON_180, "extra": GEBCO_FURTHER}),
    ("elevation", "i2", GEBCO, {"lat": LAT[::-1], "extra": GEBCO_FURTHER}),
    ("z", "f4", {"units": "meters", "grid_mapping": "crs", "positive": "up"},
     {"lon": LON_BOTH_ENDS}),
    ("z", "i4", {}, {"lon": LON_BOTH_ENDS, "dims": ("y", "x"), "engine": "scipy"}),
    ("h", "down", {"standard_name": "sea_floor_depth_below_sea_surface", "units": "m"}, {}),
    ("h", "down", {"standard_name": "sea_floor_depth_below_geoid"}, {"dims": NAMED}),
    ("topo", "f8", {"standard_name": "surface_altitude", "units": "meters", "positive": "up"},
     {"dims": NAMED}),
    ("bathymetry", "down", {"positive": "down", "units": "m"}, {"dims": NAMED}),
    ("Band1", "f8", {"positive": "up"}, {"dims": NAMED}),
])  # fmt: skip
def test_every_layout_is_read_across_the_antimeridian(
    tmp_path, name, sign, attrs, options, as_stored
):
    heights = grid(options.get("lat", LAT), options.get("lon", LON_360))
    values = -heights if sign == "down" else heights.astype(sign)
    floor = open_sea_floor(save(tmp_path / "any.nc", name, values, attrs, **options), window=WINDOW)
    check(floor)
    spans(floor, WINDOW, 0.05)
    assert floor.attrs["source"] == f"any.nc: {name}"
    for other in ((75.0, 76.0, 179.0, 181.0), (75.0, 76.0, -181.0, -179.0)):
        np.testing.assert_array_equal(
            open_sea_floor(tmp_path / "any.nc", window=other).values, floor.values
        )
    as_stored(floor)


def test_a_depth_without_a_sign_is_known_by_its_values(tmp_path, as_stored):
    depth = np.abs(grid(LAT, LON_360)) + 1.0
    for values in (depth, -depth):
        floor = open_sea_floor(save(tmp_path / "b.nc", "bathymetry", values), window=WINDOW)
        assert float(floor.min()) > 0.0
    as_stored(floor)


POLAR = pyproj.CRS("EPSG:3996")  # IBCAO's: true scale at 75 N


def ibcao(path, *, mapping, flip=False):
    """A piece of a polar stereographic grid around 75.5 N 180 E, 400 m apart."""
    to_xy = pyproj.Transformer.from_crs("EPSG:4326", POLAR, always_xy=True)
    x0, y0 = to_xy.transform(180.0, 75.5)
    x = 400.0 * np.round(x0 / 400.0) + np.arange(-30e3, 30e3 + 1.0, 400.0)
    y = 400.0 * np.round(y0 / 400.0) + np.arange(-30e3, 30e3 + 1.0, 400.0)
    y = y[::-1] if flip else y
    lon, lat = to_xy.transform(*np.meshgrid(x, y), direction="INVERSE")
    z = -2_000.0 + 1_500.0 * (lat - 75.5) - 800.0 * ((lon % 360.0) - 180.0)
    axes = {
        n: (n, values, {"units": "m", "standard_name": f"projection_{n}_coordinate"})
        for n, values in (("y", y), ("x", x))
    }
    data = xr.Dataset({"z": (("y", "x"), z.astype("f4"), {"units": "m"})}, coords=axes)
    if mapping is not None:
        data["polar"] = ((), 0, mapping)
        data["z"].attrs["grid_mapping"] = "polar"
    data.to_netcdf(path)


CF_POLAR = {
    "grid_mapping_name": "polar_stereographic",
    "straight_vertical_longitude_from_pole": 0.0,
    "latitude_of_projection_origin": 90.0,
    "standard_parallel": 75.0,
    "false_easting": 0.0,
    "false_northing": 0.0,
    "semi_major_axis": 6378137.0,
    "inverse_flattening": 298.257223563,
}
BY_NAME = {"spatial_ref": POLAR.to_wkt()}  # which PROJ need not look for among all datums


@pytest.mark.parametrize(("mapping", "flip"), [
    (CF_POLAR, False), (BY_NAME, True), (None, True),
])  # fmt: skip
def test_ibcao_s_polar_grid_is_put_on_latitude_and_longitude(tmp_path, mapping, flip, as_stored):
    path = tmp_path / "ibcao.nc"
    ibcao(path, mapping=mapping, flip=flip)
    floor = open_sea_floor(path, window=POLAR_WINDOW, crs="EPSG:3996" if mapping is None else None)
    lat, lon = floor["lat"].values, floor["lon"].values % 360.0
    expected = 2_000.0 - 1_500.0 * (lat[:, None] - 75.5) + 800.0 * (lon - 180.0)
    # the field is linear in degrees, not in metres of the projection: its curvature over 400 m is
    # left
    assert np.max(np.abs(floor.values - expected)) < 0.05
    assert np.diff(lat).mean() * 111.6e3 == pytest.approx(400.0, rel=0.02)
    as_stored(floor)


POLAR_WINDOW = (75.3, 75.7, 179.2, -179.2)


@pytest.mark.parametrize(("mapping", "options", "says"), [
    (None, {}, "EPSG:3996.*geographic version"),
    (None, {"crs": "EPSG:0"}, "unknown to PROJ; write it as EPSG:3996"),
    (None, {"crs": "EPSG:4326"}, "not a map projection"),
    (BY_NAME, {"window": None}, "give a window"),
    (BY_NAME, {"window": (74.0, 77.0, 175.0, -175.0)}, "no value at"),
    (BY_NAME, {"window": (65.0, 66.0, 10.0, 11.0)}, "does not contain the window"),
])  # fmt: skip
def test_a_projection_that_is_not_named_is_refused_with_the_remedy(
    tmp_path, mapping, options, says
):
    ibcao(tmp_path / "ibcao.nc", mapping=mapping)
    refused(
        OceanError,
        says,
        open_sea_floor,
        tmp_path / "ibcao.nc",
        **{"window": POLAR_WINDOW} | options,
    )


def test_glorys_real_file(shared_data):
    path = shared_data / "glorys12_fram_strait_bathymetry.nc"
    floor = open_sea_floor(path)
    assert floor.shape == (41, 81)
    with xr.open_dataset(path) as data:
        land = data["mask"].values[0] == 0
        np.testing.assert_array_equal(floor.values == 0.0, land)
        np.testing.assert_array_equal(
            floor.values[~land], data["deptho"].values[~land].astype(float)
        )
    part = open_sea_floor(path, window=(76.6, 79.4, 351.0, 9.0))
    assert part["lat"].values[[0, -1]] == pytest.approx([76.5, 79.5])
    assert part["lon"].values[[0, -1]] == pytest.approx([-9.0, 9.0])


SHUFFLED = LAT.copy()
SHUFFLED[[3, 4]] = SHUFFLED[[4, 3]]
Z = grid(LAT, LON_360)
HOLED = np.where((LAT[:, None] == LAT[20]) & (LON_360[3600] == LON_360), np.nan, Z)
REFUSED = {
    "no such file": lambda path: path,
    "no sea floor on latitude and longitude among a;": lambda path: save(path, "a", Z),
    r"several sea floors \(a, b\)": lambda path: xr.Dataset(
        {n: (("lat", "lon"), Z, {"standard_name": "surface_altitude"}) for n in "ab"},
        coords={"lat": LAT, "lon": LON_360},
    ).to_netcdf(path),
    "is in 'feet'; it must be in metres": lambda path: save(
        path, "elevation", Z, {"units": "feet"}
    ),
    "check fill value and units": lambda path: save(path, "elevation", 100.0 * Z),
    "no value at 1 of": lambda path: save(path, "elevation", HOLED),
    "set its attribute positive": lambda path: save(path, "bathymetry", Z + 2_000.0),
    "lat is not monotone": lambda path: save(path, "elevation", Z, lat=SHUFFLED),
    "grdconvert": lambda path: xr.Dataset(
        {"z": ("xysize", Z[:4].ravel()), "spacing": ("side", [0.05, 0.05])}
    ).to_netcdf(path),
    "incomplete: it declares": lambda path: path.write_bytes(
        save(path, "elevation", Z, engine="scipy").read_bytes()[: Z.nbytes // 2]
    ),
    "neither NetCDF-3 nor NetCDF-4": lambda path: path.write_bytes(b"<html>not found</html>"),
}


@pytest.mark.parametrize("says", REFUSED)
def test_what_cannot_be_used_is_refused_in_one_line(tmp_path, says):
    REFUSED[says](tmp_path / "bad.nc")
    refused(OceanError, says, open_sea_floor, tmp_path / "bad.nc", window=WINDOW)


@pytest.mark.parametrize(("window", "says"), [
    ((10.0, 11.0, 0.0, 1.0), "does not contain the window .*; fetch this part"),
    ((76.99, 77.5, 0.0, 1.0), "does not contain the window .*; fetch this part"),
    ((76.0, 75.0, 0.0, 1.0), "south < north"),
])  # fmt: skip
def test_a_window_that_the_file_does_not_hold_is_refused(tmp_path, window, says):
    refused(
        OceanError, says, open_sea_floor, save(tmp_path / "whole.nc", "elevation", Z), window=window
    )


def test_what_is_no_ordinary_file_is_refused():
    refused(OceanError, "/dev/zero: not a regular file", open_sea_floor, "/dev/zero")


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
def sloping_ocean(closed_form_ocean):
    return closed_form_ocean(
        78.0,
        0.0,
        temperature=lambda z, lat, _lon: 2.0 - z / 2_000.0 + 0.3 * (lat - 78.0),
        floor=lambda _lat, lon: np.where(lon > 0.5, 400.0, 2_100.0),
        depth=[0.0, 100.0, 500.0, 1_000.0, 1_500.0, 2_000.0],
    )


def test_a_coarser_file_is_used_bilinearly(sloping_ocean):
    """A plane is the same at 0.2 degrees and at 0.01 degrees, to rounding and its curvature."""
    coarse = to_local(sloping_ocean, sea_floor=file_floor(0.2), half_extent=(40e3, 25e3))
    fine = to_local(sloping_ocean, sea_floor=file_floor(0.01), half_extent=(40e3, 25e3))
    at = {"floor_north": 12e3, "floor_east": -7e3}
    assert float(coarse["sea_floor_depth"].interp(**at)) == pytest.approx(
        float(fine["sea_floor_depth"].interp(**at)), abs=1.0
    )
    centre = coarse["sea_floor_depth"].sel(floor_north=0.0, floor_east=0.0)
    assert float(centre) == pytest.approx(plane(78.0, 0.0, 0.0), abs=1e-6)
    assert coarse.attrs["sea_floor_source"].startswith("made.nc: elevation, 22329 m by 4644 m")
    plain = to_local(sloping_ocean)
    assert plain["sea_floor_depth"].dims == ("north", "east")
    assert not {"sea_floor_source", "levels_added", "sound_speed_equation"} & set(plain.attrs)


def floor_file(folder, change, step=0.2):
    """A file of depths of the plane with a change of its values."""
    depth = file_floor(step).astype(float)
    depth.attrs = {"standard_name": "sea_floor_depth_below_sea_surface", "units": "m"}
    depth[:] = change(depth.values.copy())
    path = folder / "floor.nc"
    depth.rename("deptho").to_netcdf(path)
    return path


def with_value(value):
    """Change one point over water, 78.1 N, 0 E, to a value."""

    def change(depth):
        depth[5, 15] = value
        return depth

    return change


@pytest.mark.parametrize("fill", [np.nan, 9999.0, -9999.0])
def test_gaps_in_water_are_filled_and_counted(tmp_path, sloping_ocean, fill):
    path = floor_file(tmp_path, with_value(fill))
    floor = open_sea_floor(path, ocean=sloping_ocean)
    np.testing.assert_allclose(floor.values, file_floor(0.2).values, atol=1e-6)  # a plane
    (note,) = floor.attrs["notes"]
    assert note.startswith("floor.nc: deptho: no value at 1 of ")
    alone = open_sea_floor(path)
    assert alone.values[5, 15] == 0.0
    assert alone.attrs["notes"] == ("floor.nc: deptho: no value at 1 of 310 points: land",)


def test_a_profile_on_land_of_a_file_says_so(tmp_path, as_stored):
    profile = tmp_path / "profile.csv"
    profile.write_text("depth,sound_speed\n0,1500\n1000,1490\n")
    options = {"centre": (78.0, 0.0), "half_extent": (30e3, 20e3)}
    path = floor_file(tmp_path, lambda depth: depth)
    water = open_water(profile, bathymetry=str(path), **options)
    assert water.medium.bed.depth_at(np.zeros((1, 2))) == pytest.approx(2500.0, abs=1.0)
    assert not any("land" in note for note in water.notes)
    path = floor_file(tmp_path, lambda depth: np.where(np.arange(31) < 17, np.nan, depth))
    notes = open_water(profile, bathymetry=str(path), **options).notes
    assert any("no value at" in note for note in notes)
    assert any("land at the centre, where the profile has water down to 1000 m" in note
               for note in notes)  # fmt: skip
    path = floor_file(tmp_path, lambda depth: -depth)
    refused(OceanError, "is land in the whole domain; set the attribute positive",
            open_water, profile, bathymetry=str(path), **options)  # fmt: skip
    as_stored(water)


def test_the_notes_of_a_floor_are_those_of_the_water(tmp_path, sloping_ocean, as_stored):
    sloping_ocean.to_netcdf(tmp_path / "ocean.nc")
    path = floor_file(tmp_path, with_value(np.nan))
    water = open_water(tmp_path / "ocean.nc", bathymetry=str(path), half_extent=(30e3, 20e3))
    assert any("filled from the points around them" in note for note in water.notes)
    as_stored(water)


def test_a_real_depth_of_9999_m_stays(tmp_path):
    path = floor_file(tmp_path, lambda depth: np.linspace(9900.0, 10_020.0, depth.size).round()
                      .reshape(depth.shape))  # fmt: skip
    assert 9999.0 in open_sea_floor(path).values


@pytest.mark.parametrize(("change", "message"), [
    (lambda depth: -depth,
     "is land at .* where the ocean has water down to 2000 m; set the attribute positive"),
    (lambda depth: depth / 1e3,
     "is .* m deep where the ocean has water down to 2000 m; check its unit"),
])  # fmt: skip
def test_a_floor_that_is_not_under_the_water_is_refused(tmp_path, sloping_ocean, change, message):
    path = floor_file(tmp_path, change)
    refused(OceanError, message, open_sea_floor, path, ocean=sloping_ocean)


@pytest.mark.parametrize(("change", "note"), [
    (with_value(0.0), "land at 1 of .* points where the ocean has water down to 2000 m"),
    (lambda depth: depth / 6.0, r"in the median, 0\.\d+ times as deep as the ocean's water"),
])  # fmt: skip
def test_a_floor_above_some_water_is_noted(tmp_path, sloping_ocean, change, note, as_stored):
    floor = open_sea_floor(floor_file(tmp_path, change, 0.04), ocean=sloping_ocean)
    assert any(re.search(note, line) for line in floor.attrs["notes"]), floor.attrs["notes"]
    found = check_ocean(sloping_ocean, sea_floor=floor).named("sea floor")
    assert found.severity == "doubtful"
    as_stored(found)


def test_the_water_is_compared_across_the_antimeridian(tmp_path, sloping_ocean, as_stored):
    turned = sloping_ocean.assign_coords(lon=sloping_ocean["lon"] + 360.0)
    path = floor_file(tmp_path, with_value(np.nan))
    floor = open_sea_floor(path, ocean=turned)
    np.testing.assert_allclose(floor.values, file_floor(0.2).values, atol=1e-6)
    in_kilometres = floor_file(tmp_path, lambda depth: depth / 1e3)
    refused(OceanError, "check its unit", open_sea_floor, in_kilometres, ocean=turned)
    as_stored(turned)


@pytest.mark.parametrize("turn", [0.0, 360.0, -360.0])
def test_a_finer_file_lies_where_it_should_on_its_own_axes(sloping_ocean, turn):
    half = (60e3, 30e3)
    local = to_local(sloping_ocean, half_extent=half, sea_floor=file_floor(0.01, turn=turn))
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
    plain = to_local(sloping_ocean, half_extent=half)
    xr.testing.assert_identical(local["sound_speed"].isel(depth=slice(0, 6)), plain["sound_speed"])
    deepest = float(floor.max())
    assert deepest > 2_000.0
    assert float(local["depth"][-1]) == deepest
    np.testing.assert_allclose(local.attrs["levels_added"], local["depth"].values[6:])
    assert np.diff(local["depth"].values[5:]).max() <= 500.0 * (1.0 + 1e-12)


def test_sound_speed_covers_the_water_down_to_the_file_s_floor(sloping_ocean, as_stored):
    """Temperature and salinity of the deepest wet level go on downward; pressure rises."""
    local = to_local(sloping_ocean, half_extent=(40e3, 20e3), sea_floor=file_floor(0.01))
    assert not any(np.isnan(local[name]).any() for name in local.data_vars)
    column = local.sel(north=0.0, east=0.0)
    depth = local["depth"].values
    expected = sound_speed(2.0 - np.minimum(depth, 2_000.0) / 2_000.0, 34.0, depth, 78.0, 0.0)
    np.testing.assert_allclose(column["sound_speed"], expected, atol=1e-3)
    # east of 0.5 E the ocean's own floor is at 450 m, the file's at 2,600: the level at 100 m goes
    # on
    shallow = local.sel(north=0.0, east=19e3, method="nearest")
    lat, lon = LocalFrame(78.0, 0.0).to_geodetic(float(shallow["north"]), float(shallow["east"]))
    assert lon > 0.6
    expected = sound_speed(2.0 - 100.0 / 2_000.0 + 0.3 * (lat - 78.0), 34.0, depth[3:], lat, lon)
    np.testing.assert_allclose(shallow["sound_speed"].values[3:], expected, atol=0.2)
    as_stored(local)


def test_levels_that_reach_the_floor_are_left_alone(sloping_ocean, as_stored):
    shallow = file_floor(0.01, form=lambda lat, lon, _lon_0: 1_200.0 + 0.0 * lat * lon)
    local = to_local(sloping_ocean, sea_floor=shallow, half_extent=(40e3, 20e3))
    assert "levels_added" not in local.attrs
    np.testing.assert_array_equal(local["depth"], sloping_ocean["depth"])
    np.testing.assert_allclose(local["sea_floor_depth"], 1_200.0)
    as_stored(local)


def test_a_file_with_the_ocean_s_own_grid_is_taken(sloping_ocean, as_stored):
    floor = sea_floor_depth(sloping_ocean) * 0.0 + 1_234.0
    local = to_local(sloping_ocean, half_extent=(40e3, 20e3), sea_floor=floor)
    np.testing.assert_allclose(local["sea_floor_depth"], 1_234.0)
    as_stored(local)


def test_the_number_of_nodes_is_capped_stated_and_the_mean_kept(
    sloping_ocean, monkeypatch, as_stored
):
    monkeypatch.setattr(sea_floor_module, "MAX_FLOOR_NODES", 2_000)

    def ripples(lat, lon, lon_0):
        return 1_500.0 + 200.0 * (-1.0) ** np.round((lat - 78.0) / 0.005) + 0.0 * lon

    local = to_local(
        sloping_ocean, half_extent=(40e3, 20e3), sea_floor=file_floor(0.005, form=ripples)
    )
    floor = local["sea_floor_depth"]
    assert 1_000 < floor.size <= 2_000
    assert "at most" in local.attrs["sea_floor_source"]
    assert "points" in local.attrs["sea_floor_source"]
    # ripples of two points a wave would alias to anything; the mean over an odd number of them is
    # damped
    assert float(np.abs(floor - 1_500.0).max()) < 0.3 * 200.0
    as_stored(local)


def test_a_floor_that_does_not_cover_the_domain_is_refused(sloping_ocean):
    with pytest.raises(
        OceanError, match=r"not the domain of \+-60 km by \+-30 km; fetch a larger window"
    ):
        to_local(
            sloping_ocean, half_extent=(60e3, 30e3), sea_floor=file_floor(0.01, half=(0.3, 3.0))
        )
    with pytest.raises(OceanError, match=r"must have \(lat, lon\)"):
        to_local(sloping_ocean, sea_floor=file_floor(0.01).rename(lat="y"))


def test_the_equation_is_passed_on_and_named(sloping_ocean, as_stored):
    half = (40e3, 20e3)
    teos, unesco = (
        to_local(sloping_ocean, half_extent=half, equation=e) for e in ("teos-10", "unesco")
    )
    assert unesco.attrs["sound_speed_equation"] == "unesco"
    assert 0.01 < float(np.abs(unesco["sound_speed"] - teos["sound_speed"]).max()) < 1.0
    as_stored(unesco)
