"""A uniform ocean from one cast: its water, its ducts, its extensions, and that rays can be traced in it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from pymantaray.errors import OceanError
from pymantaray.ocean import validate_ocean
from pymantaray.ocean.casts import Cast, cast_levels, cast_ocean, read_cast
from pymantaray.ocean.local import to_local
from pymantaray.ocean.seawater import sound_speed

Z = np.arange(5.0, 301.0, 1.0)
LINEAR = Cast(
    "linear", 74.0, -140.0, np.datetime64("2014-07-24T19:20"), Z, 2.0 - 0.01 * Z, 30.0 + 0.01 * Z, 320.0
)


def history(ocean):
    return ocean.attrs["history"].splitlines()


def test_the_ocean_is_the_cast_everywhere_and_at_rest():
    ocean = cast_ocean(LINEAR, bottom_depth=300.0, half_extent=(20e3, 30e3))
    validate_ocean(ocean)
    z = ocean["depth"].values
    assert z[-1] == 300.0
    inside = (z > 8.0) & (z < 299.0)  # cells wholly within the samples: a linear profile is kept exactly
    for name, expected in (("water_temp", 2.0 - 0.01 * z), ("salinity", 30.0 + 0.01 * z)):
        field = ocean[name].values
        assert np.ptp(field, axis=(1, 2)).max() == 0.0
        # but where the spacing changes and a cell's middle is not its level
        even = inside & np.isclose(np.gradient(z), np.append(np.diff(z), 1.0))
        np.testing.assert_allclose(field[even, 0, 0], expected[even], rtol=0, atol=1e-9)
        np.testing.assert_allclose(field[inside, 0, 0], expected[inside], rtol=0, atol=0.02)
    assert not ocean["water_u"].values.any()
    assert not ocean["water_v"].values.any()
    assert ocean["time"].values == np.datetime64("2014-07-24T19:20")
    assert ocean.attrs["synthetic"] == 0


@pytest.mark.parametrize("lat", [0.0, -45.0, 78.0, 85.0])
@pytest.mark.parametrize("lon", [10.0, 179.9])
def test_the_window_holds_the_asked_rectangle_about_the_cast(lat, lon):
    ocean = cast_ocean(replace(LINEAR, lat=lat, lon=lon), bottom_depth=300.0, half_extent=(40e3, 90e3))
    local = to_local(ocean, half_extent=(40e3, 90e3))
    assert local.attrs["centre_latitude_deg"] == pytest.approx(lat, abs=1e-9)
    assert (local.attrs["centre_longitude_deg"] - lon + 180.0) % 360.0 == pytest.approx(180.0, abs=1e-9)
    # "uniform" to some mm/s: pressure at a depth and the composition of sea water depend on the place
    assert np.ptp(local["sound_speed"].values, axis=(0, 1)).max() < 0.02
    np.testing.assert_array_equal(local["sea_floor_depth"], 300.0)


def test_the_change_by_averaging_is_told_and_right(shared_data):
    cast = read_cast(shared_data / "casts" / "beaufort_axctd_20140724_74N140W.csv")
    found = {}
    for step in (2.0, 5.0, 10.0):
        ocean = cast_ocean(cast, bottom_depth=1000.0, levels=np.arange(0.0, 1001.0, step))
        line = next(line for line in history(ocean) if "averaged onto" in line)
        rms, most = map(float, re.findall(r"by ([\d.]+) m/s rms, ([\d.]+) m/s at most", line)[0])
        c = sound_speed(
            np.interp(cast.depth, ocean["depth"], ocean["water_temp"].values[:, 0, 0]),
            np.interp(cast.depth, ocean["depth"], ocean["salinity"].values[:, 0, 0]),
            *(cast.depth, cast.lat, cast.lon),
        )
        change = (c - cast.sound_speed())[cast.depth <= 1000.0]
        assert rms == pytest.approx(np.sqrt(np.mean(change**2)), rel=0.06)
        assert most == pytest.approx(np.abs(change).max(), rel=0.06)
        found[step] = rms
    assert found[2.0] < found[5.0] < found[10.0]


@pytest.mark.parametrize("name", [
    "beaufort_axctd_20140724_74N140W", "beaufort_axctd_20140724_75N140W", "beaufort_xctd_icex20_1",
])  # fmt: skip
def test_the_default_levels_keep_the_warm_layer_and_the_duct_beneath(shared_data, name):
    cast = read_cast(shared_data / "casts" / f"{name}.csv")
    ocean = cast_ocean(cast, bottom_depth=1000.0)
    z, c = ocean["depth"].values, ocean_speed(ocean)
    raw = cast.sound_speed()
    for low, high, pick in ((40.0, 65.0, np.argmax), (95.0, 160.0, np.argmin)):
        here, there = (z >= low) & (z <= high), (cast.depth >= low) & (cast.depth <= high)
        i, j = pick(c[here]), pick(raw[there])
        assert c[here][i] == pytest.approx(raw[there][j], abs=0.3)
        assert z[here][i] == pytest.approx(cast.depth[there][j], abs=8.0)
    assert 1444.0 < c[(z >= 40.0) & (z <= 65.0)].max() < 1448.0
    rms = float(re.findall(r"by ([\d.]+) m/s rms", "\n".join(history(ocean)))[0])
    assert rms < 0.06


def ocean_speed(ocean):
    return sound_speed(
        ocean["water_temp"].values[:, 0, 0],
        ocean["salinity"].values[:, 0, 0],
        ocean["depth"].values,
        float(ocean["lat"].values[0]),
        float(ocean["lon"].values[0]),
    )


def test_the_deep_is_refused_held_constant_or_another_casts():
    with pytest.raises(
        OceanError, match="deepest sample is at 300 m, above the bottom at 1000 m; give bottom_depth=300"
    ):
        cast_ocean(LINEAR, bottom_depth=1000.0)
    held = cast_ocean(LINEAR, bottom_depth=1000.0, below="constant")
    assert "extended from 300 m down to the bottom at 1000 m at constant temperature and salinity" in history(
        held
    )
    deep = held["depth"].values > 320.0
    np.testing.assert_allclose(held["water_temp"].values[deep], -1.0, rtol=0, atol=1e-12)
    assert np.all(np.diff(ocean_speed(held)[deep]) > 0.0)  # pressure alone
    other = Cast("deep", 75.0, -144.0, LINEAR.time, [0.0, 400.0, 900.0], [1.0, 0.5, -0.5], [30.0, 34.0, 34.9])
    joined = cast_ocean(LINEAR, bottom_depth=1000.0, below=other)
    at_600 = float(joined["water_temp"].interp(depth=600.0)[0, 0])
    assert at_600 == pytest.approx(0.5 - 0.4, abs=1e-6)
    assert any("samples of cast deep" in line for line in history(joined))
    assert "extended from 900 m down to the bottom at 1000 m at constant temperature and salinity" in history(
        joined
    )
    short = Cast("short", 75.0, -144.0, LINEAR.time, [0.0, 200.0], [1.0, 0.5], [30.0, 34.0])
    with pytest.raises(OceanError, match="ends at 200 m, not below the 300 m"):
        cast_ocean(LINEAR, bottom_depth=1000.0, below=short)


def test_the_surface_is_extended_at_constant_water_and_that_is_told():
    ocean = cast_ocean(LINEAR, bottom_depth=300.0, levels=[0.0, 2.0, 4.0, 100.0, 200.0])
    np.testing.assert_allclose(ocean["water_temp"].values[:2], 1.95, rtol=0, atol=1e-12)
    assert "extended from 5 m up to the surface at constant temperature and salinity" in history(ocean)
    assert "level at the bottom, 300 m, added" in history(ocean)


def test_the_casts_own_bottom_serves_and_what_is_unknown_is_asked_for():
    assert cast_ocean(LINEAR, below="constant")["depth"].values[-1] == 320.0
    nameless = replace(LINEAR, bottom_depth=float("nan"), time=np.datetime64("NaT"))
    with pytest.raises(OceanError, match="bottom_depth is nan m; give the sea bed's positive depth"):
        cast_ocean(nameless)
    with pytest.raises(OceanError, match="its time is unknown; give one"):
        cast_ocean(nameless, bottom_depth=300.0)
    assert cast_ocean(nameless, bottom_depth=300.0, time="2001-01-01")["time"].values == np.datetime64(
        "2001-01-01"
    )
    with pytest.raises(OceanError, match="reaches over the pole"):
        cast_ocean(replace(LINEAR, lat=89.9), bottom_depth=300.0)
    with pytest.raises(OceanError, match="levels must rise strictly from 0 m"):
        cast_ocean(LINEAR, bottom_depth=300.0, levels=[5.0, 10.0])


@pytest.mark.parametrize("bottom", [1.0, 2.5, 3.0, 99.0, 101.0, 512.3, 3761.0, 11_000.0])
def test_levels_rise_from_the_surface_to_the_bottom(bottom):
    z = cast_levels(bottom)
    assert z[0] == 0.0
    assert z[-1] == bottom
    assert np.all(np.diff(z) > 0.0)
    assert np.diff(z).max() <= max(150.0, bottom if bottom < 5.0 else 0.0)


def test_every_real_cast_makes_an_ocean_that_rays_can_be_traced_in(shared_data):
    from pymantaray.acoustics import Medium

    files = sorted((shared_data / "casts").glob("*.csv")) + sorted((shared_data / "hycom").glob("*.csv"))
    assert len(files) == 10
    for path in files:
        cast = read_cast(path)
        ocean = cast_ocean(cast, bottom_depth=float(np.floor(cast.depth[-1])), half_extent=(30e3, 30e3))
        medium = Medium.from_dataset(to_local(ocean))
        np.testing.assert_allclose(medium.sound_speed[0, 0], ocean_speed(ocean), rtol=0, atol=0.01)
        assert medium.bathymetry.min() == ocean["depth"].values[-1]
