"""
Maps and sections of an ocean show the data: artists are read back and compared with what they were
given.
"""

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import QuadMesh
from matplotlib.quiver import Quiver
from refusals import refused

from pymantaray.apps.ocean.figures import (
    sea_floor_map,
    sound_speed_map,
    sound_speed_sections,
    write_ocean_plots,
)
from pymantaray.errors import ReportError, WriteError
from pymantaray.ocean import synthetic_ocean
from pymantaray.ocean.seawater import sound_speed
from pymantaray.plotting import style

HEADER = "Test Sea, synthetic ocean"
LABELS = r"texts\[\]\.\[[12]|\.faces|collections\[1\]\.paths"
"""Labels on contours and the gaps for them, and colours of faces at their ends: by rounding."""


@pytest.fixture(scope="module")
def ocean():
    return synthetic_ocean("fram").isel(lat=slice(0, 75, 3), lon=slice(0, 237, 4))


@pytest.fixture(scope="module")
def floor():
    lat, lon = np.arange(76.0, 80.0, 0.05), np.arange(350.0, 370.5, 0.2)
    depth = 1_500.0 + 400.0 * (lat[:, None] - 78.0) + 100.0 * (lon - 360.0)
    return xr.DataArray(
        np.maximum(depth, 0.0),
        coords={"lat": lat, "lon": lon},
        dims=("lat", "lon"),
        attrs={"source": "made.nc: z"},
    )


def test_the_map_shows_the_level_s_sound_speed_and_currents(look, ocean, as_stored):
    figure = look.draw(sound_speed_map(ocean, 90.0, HEADER))
    as_stored(figure, without=LABELS)
    as_stored(figure.get_size_inches(), name="size")
    axes = figure.axes[0]
    level = ocean.sel(depth=90.0)
    mesh = next(c for c in axes.collections if isinstance(c, QuadMesh))
    lat, lon = (level[name].values for name in ("lat", "lon"))
    expected = sound_speed(
        level["water_temp"].values, level["salinity"].values, 90.0, lat[:, None], lon
    )
    np.testing.assert_allclose(
        np.ma.filled(mesh.get_array(), np.nan).reshape(expected.shape), expected
    )
    arrows = next(c for c in axes.collections if isinstance(c, Quiver))
    for x, y, u, v in list(zip(arrows.X, arrows.Y, arrows.U, arrows.V, strict=True))[::37]:
        here = level.sel(lat=y, lon=x)
        if not np.ma.is_masked(u):
            assert (u, v) == pytest.approx((float(here["water_u"]), float(here["water_v"])))
    assert "at 90 m depth" in axes.get_title(loc="left")
    assert {"5°W", "0°", "5°E"} <= {text.get_text() for text in axes.get_xticklabels()}
    assert {"77°N", "79°N"} <= {text.get_text() for text in axes.get_yticklabels()}
    (x0, y0), (x1, y1) = axes.transData.transform([(0.0, 78.0), (1.0, 79.0)])
    as_long_northward = np.cos(np.radians(0.5 * (lat[0] + lat[-1])))
    assert (x1 - x0) / (y1 - y0) == pytest.approx(as_long_northward, rel=1e-3)


def test_a_sea_floor_file_is_drawn_at_the_longitudes_of_the_ocean(look, ocean, floor, as_stored):
    figure = look.draw(sea_floor_map(ocean, HEADER, floor))
    as_stored(figure, without=LABELS, name="map")
    axes = figure.axes[0]
    mesh = next(c for c in axes.collections if isinstance(c, QuadMesh))
    corners = mesh.get_coordinates()[..., 0]
    assert corners.min() == pytest.approx(-10.1)
    assert "made.nc: z" in axes.get_title(loc="left")
    figure = sound_speed_sections(ocean, (78.0, 0.0), HEADER, floor)
    as_stored(figure, without=LABELS)
    bed = figure.axes[2].lines[0]
    lat = ocean["lat"].values[np.argmin(np.abs(ocean["lat"].values - 78.0))]
    expected = 1_500.0 + 400.0 * (lat - 78.0) + 100.0 * bed.get_xdata()
    np.testing.assert_allclose(bed.get_ydata(), expected, atol=1e-6)


def test_sections_go_through_the_place_and_depth_grows_downward(look, ocean, as_stored):
    figure = look.draw(sound_speed_sections(ocean, (77.5, 4.1), HEADER))
    as_stored(figure, without=LABELS)
    as_stored(figure.get_size_inches(), name="size")
    upper, _, lower, lower_north = figure.axes[:4]
    assert upper.get_ylim() == (500.0, 0.0)
    assert lower.get_ylim()[0] == pytest.approx(3_060.0)
    assert "77.48° N" in upper.get_title(loc="left")
    crossing = [line for line in lower_north.lines if line.get_linestyle() == ":"]
    assert crossing[0].get_xdata()[0] == pytest.approx(77.48)


@pytest.mark.slow
def test_uniform_water_at_rest_and_a_flat_bed_can_be_drawn(look, ocean):
    still = ocean.copy(deep=True)
    for name, value in (
        ("water_temp", 1.0),
        ("salinity", 35.0),
        ("water_u", 0.0),
        ("water_v", 0.0),
    ):
        still[name] = (ocean[name].dims, np.full(ocean[name].shape, value))
    for figure in (
        sound_speed_sections(still, (78.0, 0.0), HEADER),
        sound_speed_map(still, 0.0, HEADER),
        sea_floor_map(still, HEADER),
    ):
        look.draw(figure)
    axes = sound_speed_map(still, 0.0, HEADER).axes[0]
    assert not [c for c in axes.collections if isinstance(c, Quiver)]


def test_all_are_written_or_the_reason_is_given(ocean, tmp_path, monkeypatch):
    monkeypatch.setattr(style, "rendered", lambda _, kinds, **__: dict.fromkeys(kinds, b"drawn"))
    names = ["ocean_profiles", "ocean_sections", "ocean_map", "ocean_sea_floor"]
    written = write_ocean_plots(ocean, tmp_path / "a", place=(78.0, 361.0))
    assert written == [tmp_path / "a" / f"{n}.{kind}" for n in names for kind in ("png", "pdf")]
    assert sorted((tmp_path / "a").iterdir()) == sorted(written)
    for options, said in (
        ({"place": (70.0, 0.0)}, "outside the ocean"),
        ({"depth": 4e3}, "allowed 0 to 3000 m"),
    ):
        refused(ReportError, said, write_ocean_plots, ocean, tmp_path / "b", **options)
    (tmp_path / "file").touch()
    refused(
        WriteError,
        "file: cannot be created: File exists",
        write_ocean_plots,
        ocean,
        tmp_path / "file",
    )
