"""
Sea floors as ESRI ASCII, x, y, z and GeoTIFF are those of the same grid in NetCDF; a survey that
covers a part of an ocean is joined to the ocean's own sea floor.
"""

import re

import numpy as np
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean import open_ocean, open_sea_floor, sea_floor_depth, to_local

LAT, LON = 43.0 + 0.1 * np.arange(9), 7.0 + 0.1 * np.arange(12)
HEIGHT = -1000.0 + 900.0 * (LAT[:, None] - 43.0) + 400.0 * np.sin(9.0 * (LON - 7.0))
HEIGHT[-1, -1] = 120.0  # land


def ascii_grid(path, corner="corner", fill=None):
    half = 0.05 if corner == "corner" else 0.0
    head = {
        "ncols": LON.size,
        "nrows": LAT.size,
        f"xll{corner}": LON[0] - half,
        f"yll{corner}": LAT[0] - half,
        "cellsize": 0.1,
        "NODATA_value": -32767,
    }
    values = HEIGHT if fill is None else np.where(fill, -32767, HEIGHT)
    rows = [" ".join(f"{v:.6f}" for v in row) for row in values[::-1]]
    path.write_text("\n".join([*(f"{k} {v:.10g}" for k, v in head.items()), *rows]) + "\n")
    return path


def xyz(path, separator=" ", header=""):
    points = [
        separator.join(f"{v:.7f}" for v in (x, y, HEIGHT[i, j]))
        for i, y in enumerate(LAT)
        for j, x in enumerate(LON)
    ]
    path.write_text(header + "\n".join(points[::-1]) + "\n")
    return path


def geotiff(path, crs="EPSG:4326", transform=None, values=HEIGHT):
    rasterio = pytest.importorskip("rasterio", reason="rioxarray is not installed")
    transform = transform or rasterio.Affine(0.1, 0.0, LON[0] - 0.05, 0.0, -0.1, LAT[-1] + 0.05)
    form = {"driver": "GTiff", "count": 1, "dtype": "float64", "crs": crs, "nodata": -32767.0}
    shape = {"height": values.shape[0], "width": values.shape[1], "transform": transform}
    with rasterio.open(path, "w", **form, **shape) as file:
        file.write(values[::-1], 1)
    return path


@pytest.mark.parametrize(
    "write",
    [
        lambda folder: ascii_grid(folder / "floor.asc"),
        lambda folder: ascii_grid(folder / "floor.asc", "center"),
        lambda folder: xyz(folder / "floor.xyz"),
        lambda folder: xyz(folder / "floor.csv", ",", "# lon, lat, z\n"),
        lambda folder: xyz(folder / "floor.txt", "\t"),
        lambda folder: geotiff(folder / "floor.tif"),
    ],
    ids=["corner", "center", "spaces", "commas", "tabs", "geotiff"],
)
def test_all_forms_of_a_grid_are_one_sea_floor(tmp_path, write):
    floor = open_sea_floor(write(tmp_path))
    np.testing.assert_allclose(floor["lat"], LAT, atol=1e-6)
    np.testing.assert_allclose(floor["lon"], LON, atol=1e-6)
    np.testing.assert_allclose(floor.values, np.maximum(-HEIGHT, 0.0), atol=1e-5)
    part = open_sea_floor(write(tmp_path), window=(43.25, 43.45, 7.3, 7.5))
    assert part["lat"].values == pytest.approx([43.2, 43.3, 43.4, 43.5], abs=1e-6)


@pytest.mark.parametrize(
    "comment", ["# lat lon z", "#Latitude, Longitude, Depth", "# y\tx\tz", "# lat [deg], lon [deg]"]
)
def test_a_comment_may_say_that_latitudes_are_first(tmp_path, comment):
    points = [line.split() for line in xyz(tmp_path / "floor.xyz").read_text().splitlines()]
    rows = [f"{y} {x} {z}" for x, y, z in points]
    (tmp_path / "floor.xyz").write_text("\n".join(["# survey", comment, *rows]) + "\n")
    floor = open_sea_floor(tmp_path / "floor.xyz")
    np.testing.assert_allclose(floor["lat"], LAT, atol=1e-6)
    np.testing.assert_allclose(floor.values, np.maximum(-HEIGHT, 0.0), atol=1e-5)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_columns_of_land_without_lines_are_land(tmp_path, sign):
    """A spit of land from south to north, whose points are not in the file."""
    lines = [line.split() for line in xyz(tmp_path / "floor.xyz").read_text().splitlines()]
    rows = [f"{x} {y} {sign * 900.0}" for x, y, _ in lines if not 7.35 < float(x) < 7.55]
    (tmp_path / "floor.xyz").write_text("\n".join(rows) + "\n")
    if sign < 0.0:
        with pytest.raises(OceanError, match="no value at 18 of 108 points"):
            open_sea_floor(tmp_path / "floor.xyz")
        return
    floor = open_sea_floor(tmp_path / "floor.xyz")
    np.testing.assert_allclose(floor["lon"], LON, atol=1e-6)
    land = (LON > 7.35) & (LON < 7.55)
    np.testing.assert_array_equal(floor.values == 0.0, np.broadcast_to(land, floor.shape))


def test_a_place_far_from_a_grid_is_refused(tmp_path):
    path = xyz(tmp_path / "floor.xyz")
    path.write_text(f"{path.read_text()}7.0 43000000.0 -900.0\n")
    with pytest.raises(OceanError, match=r"109 points are at 10 different coordinates from 43 to"):
        open_sea_floor(path)


@pytest.mark.parametrize("turn", [0.0, 360.0])
def test_longitudes_of_a_grid_may_pass_greenwich(tmp_path, turn):
    """Longitudes of 359.8 to 0.4 degrees, or -0.2 to 0.4 degrees."""
    lon = -0.2 + 0.1 * np.arange(7)
    rows = [
        f"{x % turn if turn else x:.4f} {y:.4f} {-500.0 - 100.0 * x:.4f}" for y in LAT for x in lon
    ]
    (tmp_path / "floor.xyz").write_text("\n".join(rows) + "\n")
    floor = open_sea_floor(tmp_path / "floor.xyz", window=(43.1, 43.5, -0.15, 0.25))
    expected = np.broadcast_to(500.0 + 100.0 * floor["lon"].values, floor.shape)
    np.testing.assert_allclose(floor["lon"][[0, -1]], [-0.2, 0.3], atol=1e-6)
    np.testing.assert_allclose(floor.values, expected, atol=1e-3)


def test_two_heights_at_one_place_are_refused(tmp_path):
    text = xyz(tmp_path / "floor.xyz").read_text()
    again = text.splitlines()[20]
    (tmp_path / "floor.xyz").write_text(f"{text}{again}\n")
    open_sea_floor(tmp_path / "floor.xyz")
    (tmp_path / "floor.xyz").write_text(f"{text}{again.rsplit(' ', 1)[0]} -5.0\n")
    with pytest.raises(OceanError, match=f"{again}.* has the place of a later line"):
        open_sea_floor(tmp_path / "floor.xyz")


def test_a_geotiff_in_a_projection_is_interpolated(tmp_path):
    import pyproj

    rasterio = pytest.importorskip("rasterio", reason="rioxarray is not installed")
    east, north = 400e3 + 500.0 * np.arange(80), 4760e3 + 500.0 * np.arange(70)
    values = -1500.0 + 0.01 * (north[:, None] - 4760e3) - 0.02 * (east - 400e3)
    transform = rasterio.Affine(500.0, 0.0, east[0] - 250.0, 0.0, -500.0, north[-1] + 250.0)
    path = geotiff(tmp_path / "utm.tif", "EPSG:32632", transform, values)
    floor = open_sea_floor(path, window=(43.1, 43.2, 8.0, 8.1))
    to_utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True).transform
    x, y = to_utm(*np.meshgrid(floor["lon"], floor["lat"]))
    np.testing.assert_allclose(
        floor.values, 1500.0 - 0.01 * (y - 4760e3) + 0.02 * (x - 400e3), atol=1e-3
    )


def test_declared_gaps_have_no_value(tmp_path):
    fill = np.zeros(HEIGHT.shape, dtype=bool)
    fill[3, 4] = True
    path = ascii_grid(tmp_path / "floor.asc", fill=fill)
    with pytest.raises(OceanError, match=r"no value at 1 of 108 points"):
        open_sea_floor(path)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda text: text.replace("ncols 12", "ncols 13"), "108 numbers, but 9 rows of 13"),
        (lambda text: text.replace("cellsize", "cell_size"), "the header of an ESRI ASCII grid"),
        (lambda text: text.replace("cellsize 0.1", "cellsize x"), "cellsize is 'x', no number"),
    ],
)
def test_an_incomplete_ascii_grid_is_refused(tmp_path, change, cause):
    path = ascii_grid(tmp_path / "floor.asc")
    path.write_text(change(path.read_text()))
    with pytest.raises(OceanError) as error:
        open_sea_floor(path)
    assert cause in str(error.value)


def test_soundings_along_tracks_are_no_grid(tmp_path):
    rng = np.random.default_rng(3)
    points = np.column_stack([rng.uniform(7, 8, 50), rng.uniform(43, 44, 50), np.full(50, -900.0)])
    np.savetxt(tmp_path / "tracks.xyz", points, fmt="%.6f")
    with pytest.raises(OceanError, match="they are no grid; interpolate them first"):
        open_sea_floor(tmp_path / "tracks.xyz")


def survey(folder):
    """Survey of 1100 m in a part of an ocean, as ESRI ASCII in steps of 0.01 degrees."""
    head = "ncols 41\nnrows 31\nxllcenter -0.2\nyllcenter 77.9\ncellsize 0.01\n"
    path = folder / "survey.asc"
    path.write_text(head + "\n".join([" ".join(["-1100"] * 41)] * 31) + "\n")
    return path


def test_a_survey_is_joined_to_the_floor_of_the_ocean(tmp_path):
    ocean = open_ocean("synthetic:fram", window=(77.5, 78.5, -2.0, 2.0))
    window = (77.5, 78.5, -2.0, 2.0)
    floor = open_sea_floor(survey(tmp_path), window=window, ocean=ocean)
    assert (float(floor["lat"][0]), float(floor["lon"][-1])) == pytest.approx((77.5, 2.0), abs=0.02)
    inside = floor.sel(lat=slice(77.905, 78.195), lon=slice(-0.195, 0.195))
    assert np.all(inside.values == 1100.0)
    own = sea_floor_depth(ocean)
    far = floor.sel(lat=77.6, lon=-1.5, method="nearest")
    expected = own.interp(lat=float(far["lat"]), lon=float(far["lon"]))
    assert float(far) == pytest.approx(float(expected), abs=0.5)
    (note,) = floor.attrs["notes"]
    assert "elsewhere the sea floor is that of the ocean, with steps of up to" in note
    share, *limits = [
        float(number)
        for number in re.search(
            r"covers (.*) % of the ocean, from (.*) N, (.*) W to (.*) N, (.*) E;", note
        ).groups()
    ]
    assert share == pytest.approx(100.0 * 0.3 * 0.4 / (1.0 * 4.0), rel=0.1)
    assert limits == pytest.approx([77.9, 0.2, 78.2, 0.2], abs=0.011)
    local = to_local(ocean, half_extent=(20e3, 20e3), sea_floor=floor)
    assert isinstance(local, xr.Dataset)
    assert float(local["sea_floor_depth"].min()) <= 1100.0
