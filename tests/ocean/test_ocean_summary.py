"""Tables of a region against geodesics and brute force."""

import warnings

import numpy as np
import pyproj
import pytest

from pymantaray.ocean import region_table, sound_speed_profile_spread, to_local
from pymantaray.ocean.seawater import sound_speed
from pymantaray.ocean.summary import columns_spread


@pytest.mark.parametrize(
    ("region", "paper_km", "centre_km", "grid"),
    [("beaufort_sea", 650.0, 595.0, [251, 76]), ("fram_strait", 490.0, 437.0, [237, 75])],
)
def test_the_paper_s_width_is_that_of_the_south_edge(region, paper_km, centre_km, grid, request):
    column = region_table(request.getfixturevalue(region)).iloc[:, 0]
    assert column["width at the south edge [km]"] == pytest.approx(paper_km, rel=0.01)
    assert column["width at the centre [km]"] == pytest.approx(centre_km, rel=0.01)
    assert column["width at the north edge [km]"] < column["width at the centre [km]"]
    assert column["height [km]"] == pytest.approx(330.0, rel=0.02)
    assert column[["grid points, longitude", "grid points, latitude"]].tolist() == grid
    assert column["synthetic"] == "yes"
    assert not column.isna().any()
    assert column.name.endswith("(synthetic)")


def test_widths_follow_the_parallel_of_the_ellipsoid(fram_strait):
    ellipsoid = pyproj.Geod(ellps="WGS84")
    sin = np.sin(np.radians(78.0))
    radius = ellipsoid.a * np.cos(np.radians(78.0)) / np.sqrt(1.0 - ellipsoid.es * sin**2)
    expected = radius * np.radians(236 * 0.08) / 1e3
    assert region_table(fram_strait).iloc[:, 0]["width at the centre [km]"] == pytest.approx(
        expected, rel=1e-6
    )


def test_the_spread_of_profiles_is_over_wet_points_only(fram_strait, as_stored):
    spread = sound_speed_profile_spread(fram_strait)
    lat, lon = fram_strait["lat"].values, fram_strait["lon"].values
    for k in (0, 20, 32, 36, 38):
        level = fram_strait.isel(depth=k)
        speed = sound_speed(
            level["water_temp"], level["salinity"], float(level["depth"]), lat[:, None], lon
        )
        wet = speed[np.isfinite(speed)]
        one = spread.isel(depth=k)
        assert int(one["count"]) == wet.size
        if wet.size:
            found = [float(one[name]) for name in ("mean", "min", "max")]
            np.testing.assert_allclose(found, [wet.mean(), wet.min(), wet.max()], rtol=1e-12)
        else:
            assert np.isnan(one["mean"])
            assert np.isnan(one["min"])
    as_stored(one)


def test_spreads_keep_the_attributes_of_their_levels(fram_strait):
    local = to_local(fram_strait, half_extent=(10e3, 10e3))
    for spread, levels in (
        (sound_speed_profile_spread(fram_strait), fram_strait["depth"]),
        (columns_spread(local), local["depth"]),
    ):
        assert spread["depth"].attrs == levels.attrs != {}
        assert spread["mean"].attrs == spread["max"].attrs
        assert spread["mean"].attrs["units"] == "m s-1"
        wet = spread["count"].values > 0
        low, mean, high = (spread[name].values[wet] for name in ("min", "mean", "max"))
        assert ((low <= mean + 1e-9) & (mean <= high + 1e-9)).all()


def test_the_spread_of_profiles_warns_of_no_dry_level(fram_strait, monkeypatch):
    """
    Also of no warning that xarray ignores: the filters are those of all threads, and another thread
    can restore them.
    """
    warned = []
    monkeypatch.setattr(warnings, "warn", lambda message, *_, **__: warned.append(message))
    spread = sound_speed_profile_spread(fram_strait)
    assert (spread["count"] == 0).any()
    assert warned == []
