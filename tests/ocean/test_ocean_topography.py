"""Sea floor files: every product's own layout, one sea floor known in closed form; and what is refused."""

import numpy as np
import pyproj
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean.files import numbers
from pymantaray.ocean.topography import open_sea_floor

WINDOW = (75.0, 76.0, 179.0, -179.0)  # across the antimeridian


def height(lat, lon):
    """Hills and a coast, linear between points 0.05 degrees apart; positive up. [m]"""
    turned = (lon - 180.0) % 360.0  # 0 at the antimeridian; the jump of this at 0 E is outside every window
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


def gebco(path, lat, lon):
    """GEBCO 2020 and later: int16, cell centres, with the standard name it has."""
    attrs = {"standard_name": "height_above_reference_ellipsoid", "units": "m", "long_name": "Elevation"}
    xr.Dataset(
        {
            "elevation": (("lat", "lon"), grid(lat, lon).astype("i2"), attrs),
            "tid": (("lat", "lon"), np.zeros((lat.size, lon.size), "i1")),
            "crs": ((), b"", {"grid_mapping_name": "latitude_longitude"}),
        },
        coords={
            "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        },
    ).to_netcdf(path)


@pytest.mark.parametrize("lon", [LON_180, LON_360], ids=["from -180", "from 0"])
@pytest.mark.parametrize("upside_down", [False, True])
def test_gebco_is_read_across_the_antimeridian(tmp_path, lon, upside_down):
    path = tmp_path / "gebco.nc"
    gebco(path, LAT[::-1] if upside_down else LAT, lon)
    floor = open_sea_floor(path, window=WINDOW)
    check(floor)
    spans(floor, WINDOW, 0.05)
    assert floor.attrs["source"] == "gebco.nc: elevation"
    for other in ((75.0, 76.0, 179.0, 181.0), (75.0, 76.0, -181.0, -179.0)):
        np.testing.assert_array_equal(open_sea_floor(path, window=other).values, floor.values)


def test_only_the_window_is_read(tmp_path, monkeypatch):
    path = tmp_path / "gebco.nc"
    gebco(path, LAT, LON_180)
    sizes = []

    def spy(file, name, selection=None):
        values = numbers(file, name, selection)
        if name == "elevation":
            sizes.append(values.size)
        return values

    monkeypatch.setattr("pymantaray.ocean.topography.numbers", spy)
    floor = open_sea_floor(path, window=WINDOW)
    assert len(sizes) == 2, "one rectangle on each side of the seam"
    assert sum(sizes) == floor.size


def test_etopo_on_lon_lat_and_on_x_y_in_degrees(tmp_path):
    lat, lon = LAT, np.round(np.arange(-180.0, 180.01, 0.05), 6)  # both ends are there, as in ETOPO1
    z = grid(lat, lon)
    with_crs = xr.Dataset(
        {
            "z": (
                ("lat", "lon"),
                z.astype("f4"),
                {"units": "meters", "grid_mapping": "crs", "positive": "up"},
            ),
            "crs": ((), b"", {"grid_mapping_name": "latitude_longitude"}),
        },
        coords={"lat": lat, "lon": lon},
    )
    with_crs.to_netcdf(tmp_path / "etopo2022.nc")
    xr.Dataset({"z": (("y", "x"), z.astype("i4"))}, coords={"y": lat, "x": lon}).to_netcdf(
        tmp_path / "etopo1.grd", engine="scipy"
    )
    for name in ("etopo2022.nc", "etopo1.grd"):
        floor = open_sea_floor(tmp_path / name, window=WINDOW)
        check(floor)
        spans(floor, WINDOW, 0.05)


@pytest.mark.parametrize(
    ("name", "attrs", "sign"),
    [
        ("h", {"standard_name": "sea_floor_depth_below_sea_surface", "units": "m"}, -1.0),
        ("h", {"standard_name": "sea_floor_depth_below_geoid"}, -1.0),
        ("topo", {"standard_name": "surface_altitude", "units": "meters", "positive": "up"}, 1.0),
        ("bathymetry", {"positive": "down", "units": "m"}, -1.0),
        ("Band1", {"positive": "up"}, 1.0),
    ],
)
def test_other_names_and_signs(tmp_path, name, attrs, sign):
    path = tmp_path / "any.nc"
    xr.Dataset(
        {name: (("latitude", "longitude"), sign * grid(LAT, LON_360), attrs)},
        coords={"latitude": LAT, "longitude": LON_360},
    ).to_netcdf(path)
    check(open_sea_floor(path, window=WINDOW))


def test_a_depth_without_a_sign_is_known_by_its_values_or_refused(tmp_path):
    depth = np.abs(grid(LAT, LON_360)) + 1.0
    for values in (depth, -depth):
        xr.Dataset({"bathymetry": (("lat", "lon"), values)}, coords={"lat": LAT, "lon": LON_360}).to_netcdf(
            tmp_path / "b.nc"
        )
        floor = open_sea_floor(tmp_path / "b.nc", window=WINDOW)
        assert float(floor.min()) > 0.0
    xr.Dataset(
        {"bathymetry": (("lat", "lon"), grid(LAT, LON_360) + 2_000.0)}, coords={"lat": LAT, "lon": LON_360}
    ).to_netcdf(tmp_path / "c.nc")
    with pytest.raises(OceanError, match="does not say which is down"):
        open_sea_floor(tmp_path / "c.nc", window=WINDOW)


POLAR = pyproj.CRS("EPSG:3996")  # IBCAO's: true scale at 75 N


def ibcao(path, *, mapping, flip=False):
    """A piece of a polar stereographic grid around 75.5 N 180 E, 400 m apart."""
    to_xy = pyproj.Transformer.from_crs("EPSG:4326", POLAR, always_xy=True)
    x0, y0 = to_xy.transform(180.0, 75.5)
    x = 400.0 * np.round(x0 / 400.0) + np.arange(-60e3, 60e3 + 1.0, 400.0)
    y = 400.0 * np.round(y0 / 400.0) + np.arange(-100e3, 100e3 + 1.0, 400.0)
    y = y[::-1] if flip else y
    lon, lat = to_xy.transform(*np.meshgrid(x, y), direction="INVERSE")
    z = -2_000.0 + 1_500.0 * (lat - 75.5) - 800.0 * ((lon % 360.0) - 180.0)
    data = xr.Dataset(
        {"z": (("y", "x"), z.astype("f4"), {"units": "m"})},
        coords={
            "y": ("y", y, {"units": "m", "standard_name": "projection_y_coordinate"}),
            "x": ("x", x, {"units": "m", "standard_name": "projection_x_coordinate"}),
        },
    )
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


@pytest.mark.parametrize(
    "mapping", [CF_POLAR, {"spatial_ref": POLAR.to_wkt()}, None], ids=["cf", "wkt", "said"]
)
@pytest.mark.parametrize("flip", [False, True])
def test_ibcao_s_polar_grid_is_put_on_latitude_and_longitude(tmp_path, mapping, flip):
    path = tmp_path / "ibcao.nc"
    ibcao(path, mapping=mapping, flip=flip)
    window = (75.3, 75.7, 179.2, -179.2)
    floor = open_sea_floor(path, window=window, crs="EPSG:3996" if mapping is None else None)
    lat, lon = floor["lat"].values, floor["lon"].values % 360.0
    expected = 2_000.0 - 1_500.0 * (lat[:, None] - 75.5) + 800.0 * (lon - 180.0)
    # the field is linear in degrees, not in metres of the projection: its curvature over 400 m is left
    assert np.max(np.abs(floor.values - expected)) < 0.05
    assert np.diff(lat).mean() * 111.6e3 == pytest.approx(400.0, rel=0.02)


def test_a_projection_that_is_not_named_is_refused_with_the_remedy(tmp_path):
    path = tmp_path / "ibcao.nc"
    ibcao(path, mapping=None)
    with pytest.raises(OceanError, match=r"EPSG:3996.*geographic version"):
        open_sea_floor(path, window=(75.3, 75.7, 179.2, -179.2))
    ibcao(path, mapping=CF_POLAR)
    with pytest.raises(OceanError, match="name a window"):
        open_sea_floor(path)
    with pytest.raises(OceanError, match="no value at"):
        open_sea_floor(path, window=(74.0, 77.0, 175.0, -175.0))
    with pytest.raises(OceanError, match="is not in it"):
        open_sea_floor(path, window=(65.0, 66.0, 10.0, 11.0))


def test_glorys_real_file(shared_data):
    path = shared_data / "glorys12_fram_strait_bathymetry.nc"
    floor = open_sea_floor(path)
    assert floor.shape == (41, 81)
    with xr.open_dataset(path) as data:
        land = data["mask"].values[0] == 0
        np.testing.assert_array_equal(floor.values == 0.0, land)
        np.testing.assert_array_equal(floor.values[~land], data["deptho"].values[~land].astype(float))
    part = open_sea_floor(path, window=(76.6, 79.4, 351.0, 9.0))
    assert part["lat"].values[[0, -1]] == pytest.approx([76.5, 79.5])
    assert part["lon"].values[[0, -1]] == pytest.approx([-9.5, 9.5])


def bad_files(folder):
    xr.Dataset({"a": (("lat", "lon"), grid(LAT, LON_360))}, coords={"lat": LAT, "lon": LON_360}).to_netcdf(
        folder / "none.nc"
    )
    z = (("lat", "lon"), grid(LAT, LON_360))
    both = {"standard_name": "surface_altitude"}
    xr.Dataset({"a": (*z, both), "b": (*z, both)}, coords={"lat": LAT, "lon": LON_360}).to_netcdf(
        folder / "two.nc"
    )
    xr.Dataset({"elevation": (*z, {"units": "feet"})}, coords={"lat": LAT, "lon": LON_360}).to_netcdf(
        folder / "feet.nc"
    )
    xr.Dataset({"elevation": (z[0], 100.0 * z[1])}, coords={"lat": LAT, "lon": LON_360}).to_netcdf(
        folder / "centimetres.nc"
    )
    holes = z[1].copy()
    holes[20, 3600] = np.nan
    xr.Dataset({"elevation": (z[0], holes)}, coords={"lat": LAT, "lon": LON_360}).to_netcdf(
        folder / "holes.nc"
    )
    shuffled = LAT.copy()
    shuffled[[3, 4]] = shuffled[[4, 3]]
    xr.Dataset({"elevation": z}, coords={"lat": shuffled, "lon": LON_360}).to_netcdf(folder / "shuffled.nc")
    xr.Dataset({"z": ("xysize", z[1][:4].ravel()), "spacing": ("side", [0.05, 0.05])}).to_netcdf(
        folder / "old.nc"
    )
    xr.Dataset({"elevation": z}, coords={"lat": LAT, "lon": LON_360}).to_netcdf(
        folder / "whole.nc", engine="scipy"
    )
    whole = (folder / "whole.nc").read_bytes()
    (folder / "cut.nc").write_bytes(whole[: len(whole) // 2])
    (folder / "page.nc").write_bytes(b"<html>not found</html>")


def test_what_cannot_be_used_is_refused_in_one_line(tmp_path):
    bad_files(tmp_path)
    cases = {
        "missing.nc": "no such file",
        "none.nc": "no sea floor on latitude and longitude among a;",
        "two.nc": r"several sea floors \(a, b\)",
        "feet.nc": "is in 'feet'; needs metres",
        "centimetres.nc": "check fill value and units",
        "holes.nc": "no value at 1 of",
        "shuffled.nc": "lat is not monotone",
        "old.nc": "grdconvert",
        "cut.nc": "cut short",
        "page.nc": "neither NetCDF-3 nor NetCDF-4",
    }
    for name, says in cases.items():
        with pytest.raises(OceanError, match=says) as caught:
            open_sea_floor(tmp_path / name, window=WINDOW)
        assert "\n" not in str(caught.value)
    with pytest.raises(OceanError, match="is not in it"):
        open_sea_floor(tmp_path / "whole.nc", window=(10.0, 11.0, 0.0, 1.0))
    with pytest.raises(OceanError, match="south below north"):
        open_sea_floor(tmp_path / "whole.nc", window=(76.0, 75.0, 0.0, 1.0))
