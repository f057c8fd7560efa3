"""Several times: which exist, which enclose a span, and one grid for all."""

import numpy as np
import pytest
import xarray as xr
from refusals import refused

from pymantaray.errors import OceanError
from pymantaray.ocean import ocean_times, open_ocean, open_ocean_series

START = np.datetime64("2020-01-01T00:00", "ns")


@pytest.fixture
def steps(closed_form_ocean):
    """Oceans 3 h apart, warmer by a degree each."""
    return [
        closed_form_ocean(
            45.0, 10.0, temperature=lambda *_, i=i: 5.0 + i, n=(5, 6), depth=[0.0, 10.0]
        ).assign_coords(time=START + np.timedelta64(3 * i, "h"))
        for i in range(4)
    ]


@pytest.fixture
def file(tmp_path, steps):
    return write(tmp_path / "steps.nc", steps)


def write(path, steps, names=("water_temp", "salinity", "water_u", "water_v")):
    xr.concat(steps, "time")[list(names)].to_netcdf(path)
    return path


def warmth(oceans):
    return [float(o["water_temp"].mean()) - 5.0 for o in oceans]


@pytest.mark.parametrize(("start", "stop", "expected"), [
    ("2020-01-01T00:00", "2020-01-01T09:00", [0, 1, 2, 3]),
    ("2020-01-01T03:00", "2020-01-01T03:00", [1]),
    ("2020-01-01T03:01", "2020-01-01T05:59", [1, 2]),
    ("2020-01-01T02:59", "2020-01-01T03:01", [0, 1, 2]),
])  # fmt: skip
def test_the_instants_that_enclose_a_span(file, start, stop, expected):
    assert warmth(open_ocean_series(file, start, stop)) == pytest.approx(expected)


def test_one_file_for_each_instant_says_the_same(tmp_path, file, steps):
    paths = [write(tmp_path / f"{i}.nc", [step]) for i, step in enumerate(steps)]
    span = START, START + np.timedelta64(8, "h")
    apart, together = open_ocean_series(paths[::-1], *span), open_ocean_series(file, *span)
    for a, b in zip(apart, together, strict=True):
        xr.testing.assert_equal(a, b)
    np.testing.assert_array_equal(ocean_times(paths), ocean_times(file))


def test_times_are_those_at_which_everything_is_there(tmp_path, file, steps):
    ts = write(tmp_path / "ts.nc", steps, ["water_temp", "salinity"])
    uv = write(tmp_path / "uv.nc", steps[1:], ["water_u", "water_v"])
    np.testing.assert_array_equal(
        ocean_times(file), START + 3 * np.arange(4).astype("timedelta64[h]")
    )
    assert ocean_times([ts, uv]).size == 3
    assert ocean_times(ts).size == 4
    span = "2020-01-01T00:00", "2020-01-01T06:00"
    refused(
        OceanError,
        " to ".join(span) + "; available: 2020-01-01T03",
        open_ocean_series,
        [ts, uv],
        *span,
    )
    assert warmth(open_ocean_series(ts, *span, currents="rest")) == pytest.approx([0, 1, 2])


def test_spans_beyond_the_source_or_backward_are_refused(file):
    for start, stop in (("2019-12-31", "2020-01-01"), ("2020-01-01T08:00", "2020-01-01T10:00")):
        refused(OceanError, r"steps\.nc: does not cover", open_ocean_series, file, start, stop)
    refused(OceanError, "is after stop", open_ocean_series, file, "2020-01-02", "2020-01-01")


def test_a_grid_that_changes_is_refused(tmp_path, steps):
    moved = steps[1].assign_coords(lat=steps[1]["lat"] + 0.02)
    paths = [write(tmp_path / f"{i}.nc", [step]) for i, step in enumerate((steps[0], moved))]
    with pytest.raises(OceanError, match=r"lat differs between .* one grid"):
        open_ocean_series(paths, START, START + np.timedelta64(1, "h"))


def test_synthetic_oceans_come_every_three_hours():
    window = (77.9, 78.1, -0.5, 0.5)
    oceans = open_ocean_series(
        "synthetic:fram", "2014-07-15T13:00", "2014-07-15T14:30", window=window
    )
    assert [str(o["time"].values)[11:16] for o in oceans] == ["12:00", "15:00"]
    xr.testing.assert_identical(
        oceans[1], open_ocean("synthetic:fram", time="2014-07-15T15:00", window=window)
    )
    assert oceans[0]["water_temp"].values[0, 0, 0] != oceans[1]["water_temp"].values[0, 0, 0]
    assert ocean_times("synthetic:fram") == np.datetime64("2014-07-15T00:00")
