"""Several times: which exist, which enclose a span, and one grid for all."""

import numpy as np
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean import ocean_times, open_ocean, open_ocean_series

START = np.datetime64("2020-01-01T00:00", "ns")


@pytest.fixture
def steps(closed_form_ocean):
    """Oceans 3 h apart, warmer by a degree each."""
    first = closed_form_ocean(
        45.0, 10.0, temperature=lambda z, _lat, _lon: 5.0 + 0 * z, n=(5, 6), depth=[0.0, 10.0]
    )
    warmer = [first["water_temp"] + i for i in range(4)]
    return [
        first.assign(
            water_temp=(first["water_temp"].dims, t.values, first["water_temp"].attrs)
        ).assign_coords(time=START + np.timedelta64(3 * i, "h"))
        for i, t in enumerate(warmer)
    ]


@pytest.fixture
def file(tmp_path, steps):
    xr.concat(steps, "time").to_netcdf(tmp_path / "steps.nc", engine="scipy")
    return tmp_path / "steps.nc"


def warmth(oceans):
    return [float(o["water_temp"].mean()) - 5.0 for o in oceans]


@pytest.mark.parametrize(
    ("start", "stop", "expected"),
    [
        ("2020-01-01T00:00", "2020-01-01T09:00", [0, 1, 2, 3]),
        ("2020-01-01T03:00", "2020-01-01T03:00", [1]),
        ("2020-01-01T03:01", "2020-01-01T05:59", [1, 2]),
        ("2020-01-01T02:59", "2020-01-01T03:01", [0, 1, 2]),
    ],
)
def test_the_instants_that_enclose_a_span(file, start, stop, expected):
    assert warmth(open_ocean_series(file, start, stop)) == pytest.approx(expected)


def test_one_file_for_each_instant_says_the_same(tmp_path, file, steps):
    paths = [tmp_path / f"{i}.nc" for i in range(4)]
    for path, step in zip(paths, steps, strict=True):
        step.to_netcdf(path, engine="scipy")
    apart = open_ocean_series(paths[::-1], START, START + np.timedelta64(8, "h"))
    together = open_ocean_series(file, START, START + np.timedelta64(8, "h"))
    for a, b in zip(apart, together, strict=True):
        for name in a.variables:
            np.testing.assert_array_equal(a[name], b[name])
    np.testing.assert_array_equal(ocean_times(paths), ocean_times(file))


def test_times_are_those_at_which_everything_is_there(tmp_path, file, steps):
    ts = xr.concat(steps, "time")[["water_temp", "salinity"]]
    uv = xr.concat(steps[1:], "time")[["water_u", "water_v"]]
    ts.to_netcdf(tmp_path / "ts.nc", engine="scipy")
    uv.to_netcdf(tmp_path / "uv.nc", engine="scipy")
    both = [tmp_path / "ts.nc", tmp_path / "uv.nc"]
    np.testing.assert_array_equal(ocean_times(file), START + 3 * np.arange(4).astype("timedelta64[h]"))
    assert ocean_times(both).size == 3
    assert ocean_times(both[0]).size == 4
    with pytest.raises(
        OceanError, match=r"does not cover 2020-01-01T00:00 to 2020-01-01T06:00; there is 2020-01-01T03"
    ):
        open_ocean_series(both, "2020-01-01T00:00", "2020-01-01T06:00")
    still = open_ocean_series(both[0], "2020-01-01T00:00", "2020-01-01T06:00", currents="rest")
    assert warmth(still) == pytest.approx([0, 1, 2])


def test_spans_beyond_the_source_or_backward_are_refused(file):
    for start, stop in (("2019-12-31", "2020-01-01"), ("2020-01-01T08:00", "2020-01-01T10:00")):
        with pytest.raises(OceanError, match=r"steps\.nc: does not cover"):
            open_ocean_series(file, start, stop)
    with pytest.raises(OceanError, match="runs backward"):
        open_ocean_series(file, "2020-01-02", "2020-01-01")


def test_a_grid_that_changes_is_refused(tmp_path, steps):
    steps[0].to_netcdf(tmp_path / "0.nc", engine="scipy")
    steps[1].assign_coords(lat=steps[1]["lat"] + 0.02).to_netcdf(tmp_path / "1.nc", engine="scipy")
    moved = [tmp_path / "0.nc", tmp_path / "1.nc"]
    with pytest.raises(OceanError, match=r"lat at 2020-01-01T03.* differs .* one grid"):
        open_ocean_series(moved, START, START + np.timedelta64(1, "h"))


def test_the_real_file_s_three_days(shared_data):
    path = shared_data / "hycom" / "hycom_glby_930_202212_uv_ncss_netcdf4.nc"
    with pytest.raises(OceanError, match="no water_temp and no salinity"):
        ocean_times(path)


def test_synthetic_oceans_come_every_three_hours():
    window = (77.9, 78.1, -0.5, 0.5)
    oceans = open_ocean_series("synthetic:fram", "2014-07-15T13:00", "2014-07-15T15:30", window=window)
    hours = [str(o["time"].values)[11:16] for o in oceans]
    assert hours == ["12:00", "15:00", "18:00"]
    xr.testing.assert_identical(
        oceans[1], open_ocean("synthetic:fram", time="2014-07-15T15:00", window=window)
    )
    assert oceans[0]["water_temp"].values[0, 0, 0] != oceans[1]["water_temp"].values[0, 0, 0]
    assert ocean_times("synthetic:fram") == np.datetime64("2014-07-15T12:00")
    with pytest.raises(OceanError, match="cannot be combined"):
        open_ocean_series(["synthetic:fram", "a.nc"], START, START)
