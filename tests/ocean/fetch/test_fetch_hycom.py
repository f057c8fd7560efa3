"""
HYCOM fetched by place and time from a server on loopback: the right water, whatever the server's
habits.
"""

from importlib import resources

import numpy as np
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean import open_ocean

pytestmark = pytest.mark.network


def test_a_window_of_the_reanalysis_is_the_server_s_water(fetch, is_true, thredds, as_stored):
    progress = []
    fetched, ocean = fetch(progress=lambda *words: progress.append(words))
    is_true(ocean, "2014-07-15T12:00")
    for name, south, north in (
        ("lat", 73.0, 73.6),
        ("lon", -150.0, -149.0),
    ):  # and a point beyond at most
        assert south - 0.09 < ocean[name][0] <= south + 1e-4
        assert north - 1e-4 <= ocean[name][-1] < north + 0.09
    assert ocean.sizes["depth"] == 40
    assert ocean.attrs["title"] == "HYCOM GOFS 3.1 reanalysis GLBv0.08 expt_53.X, 2014-07-15T12:00Z"
    assert ocean.attrs["synthetic"] == 0
    xr.testing.assert_identical(open_ocean(fetched.path), ocean)
    assert fetched.remarks == ()
    assert fetched.requests == len(thredds.app.asked)
    assert progress == [("fetch", i, 4) for i in range(5)]
    as_stored(fetched)


def test_only_the_window_is_read_in_blocks_of_levels(fetch, is_true, thredds):
    _, ocean = fetch(lat=(74.0, 76.0), lon=(-150.0, -140.0))
    is_true(ocean, "2014-07-15T12:00")
    blocks = [a for a in thredds.app.asked if "water_" in a or "salinity" in a]
    points = ocean.sizes["lat"] * ocean.sizes["lon"]
    assert len(blocks) == 4 * -(-40 // (200_000 // points))
    assert not any("bottom" in a for a in thredds.app.asked)


@pytest.mark.parametrize(("lon", "time", "seam"), [
    pytest.param((210.0, 211.0), "2014-07-15T12", False, marks=pytest.mark.slow),
    pytest.param((-150.0, 211.0), "2014-07-15T12", False, marks=pytest.mark.slow),
    ((359.5, 0.5), "2014-07-15T12", False),  # axis begins at -180
    ((179.5, -179.5), "2014-07-15T12", True),
    *(
        pytest.param(lon, "2019-03-07T15", False, marks=pytest.mark.slow)
        for lon in ((-150.0, -149.0), (179.5, 180.5))
    ),
    ((-0.5, 0.5), "2019-03-07T15", True),  # axis begins at 0
])  # fmt: skip
def test_any_longitudes_from_any_server_and_across_its_seam(
    fetch, is_true, thredds, lon, time, seam
):
    _, ocean = fetch(lon=lon, time=time, lat=(-30.0, -29.0))
    is_true(ocean, time)
    blocks = [a for a in thredds.app.asked if "water_temp" in a]
    assert len(blocks) == 1 + seam, blocks
    np.testing.assert_allclose(np.diff(ocean["lon"]), 0.08, atol=1e-4)
    middle = 0.5 * float(ocean["lon"][0] + ocean["lon"][-1])
    assert -180.0 <= middle < 180.0
    assert abs((middle - lon[0] - 0.5 + 180.0) % 360.0 - 180.0) < 0.09


@pytest.mark.parametrize(("time", "dataset", "n_sets"), [
    pytest.param("2014-01-01T12", "data/2014.", 1, marks=pytest.mark.slow),
    ("2015-01-01T06", "data/2014.", 1),  # the file of a year runs from 12Z
    ("2015-01-01T12", "data/2015.", 1),
    ("2016-01-15T00", "expt_56.3.", 1),
    pytest.param("2016-06-01T00", "expt_57.2.", 1, marks=pytest.mark.slow),
    ("2018-12-04T12", "GLBy0.08/expt_93.0/uv3z.", 2),
    ("2025-01-15T03", "ESPC-D-V02/v3z/2025.", 4),
])  # fmt: skip
def test_the_data_sets_that_hold_the_time_are_found(fetch, is_true, thredds, time, dataset, n_sets):
    _, ocean = fetch(time=time)
    is_true(ocean, time)
    assert any(dataset in a for a in thredds.app.asked)
    # descriptions, axes and the step again of each data set; four variables
    assert len(thredds.app.asked) == n_sets * (2 + 4 + 1) + 4


@pytest.mark.parametrize(
    ("starts", "time", "asked_first"),
    [
        pytest.param(0, "2015-01-01T00", 2015, marks=pytest.mark.slow),
        (0, "2015-01-01T06", 2015),
        (48, "2015-01-01T18", 2014),
    ],
)
def test_a_year_file_without_the_time_gives_way_to_its_neighbour(
    fetch, is_true, thredds, tmp_path, starts, time, asked_first
):
    shipped = resources.files("pymantaray.ocean.fetch").joinpath("servers.toml").read_text()
    mirror = shipped.replace("year_starts_h = 12", f"year_starts_h = {starts}")
    (tmp_path / "mirror.toml").write_text(
        mirror.replace("https://tds.hycom.org/thredds/dodsC", thredds.root)
    )
    _, ocean = fetch(time=time, servers=tmp_path / "mirror.toml")
    is_true(ocean, time)
    assert f"data/{asked_first}." in thredds.app.asked[0]


def test_between_two_year_files_the_nearest_steps_come_from_both(refusal, fetch, is_true):
    assert "the nearest are 2015-01-01T06:00 and 2015-01-01T12:00" in refusal(time="2015-01-01T09")
    _, ocean = fetch(time="2015-01-01T10", nearest=True)
    is_true(ocean, "2015-01-01T12:00")


def test_a_step_that_the_server_lacks_is_refused_with_its_neighbours(
    refusal, fetch, is_true, as_stored
):
    message = refusal(time="2014-06-28T18")
    assert (
        "has no step 2014-06-28T18:00; the nearest are 2014-06-28T09:00 and 2014-06-29T12:00"
        in message
    )
    assert "2014-07-15T12:00 and 2014-07-15T15:00" in refusal(time="2014-07-15T13:30")
    fetched, ocean = fetch(time="2014-06-28T18", nearest=True)
    is_true(ocean, "2014-06-28T09:00")
    assert fetched.remarks == (
        "2014-06-28T18:00 does not exist: nearest step 2014-06-28T09:00 used",
    )
    assert fetched.remarks[0] in ocean.attrs["history"].splitlines()
    as_stored(fetched)


def test_a_step_that_only_one_of_two_data_sets_has_is_missing(refusal, fetch, is_true):
    assert "the nearest are 2019-03-07T15:00 and 2019-03-07T21:00" in refusal(time="2019-03-07T18")
    # the axis of ts3z repeats a step
    _, ocean = fetch(time="2019-03-14T09")
    is_true(ocean, "2019-03-14T09:00")


def test_an_experiment_without_the_time_gives_way_to_the_next(
    fetch, is_true, thredds, monkeypatch, as_stored
):
    model = thredds.app.models["GLBv0.08/expt_57.2"]
    monkeypatch.setattr(model, "instants", model.instants[800:])
    fetched, ocean = fetch(time="2016-06-01T00")
    is_true(ocean, "2016-06-01T00:00")
    assert "expt_56.3" in fetched.title
    assert "expt_57.2 on the server does not cover 2016-06-01T00:00" in fetched.remarks[0]
    as_stored(fetched)


def test_a_time_axis_that_moves_during_the_fetch_is_noticed(refusal, thredds, monkeypatch):
    """A server that loses steps at the front sends another step under the same index."""
    model = thredds.app.models["GLBv0.08/expt_57.2"]

    def lose_one_step(_stage, done, _total):
        if done == 2:
            monkeypatch.setattr(model, "instants", model.instants[1:])

    message = refusal(time="2016-06-01T00", progress=lose_one_step)
    assert "time axis changed during the download" in message


def test_real_files_from_pydap_equal_those_of_the_reader(
    fetch, thredds, gulf_stream_files, monkeypatch
):
    for kind, path in zip(("ts3z", "uv3z"), gulf_stream_files, strict=True):
        monkeypatch.setitem(thredds.app.models, f"GLBy0.08/expt_93.0/{kind}", path)
    _, fetched = fetch(lat=(34.4, 35.6), lon=(284.5, 285.5), time="2019-03-07T15")
    opened = open_ocean(gulf_stream_files)
    expected = opened.sel(lat=fetched["lat"], lon=fetched["lon"], method="nearest", tolerance=1e-6)
    for name in ("water_temp", "salinity", "water_u", "water_v"):
        np.testing.assert_array_equal(np.isnan(fetched[name]), np.isnan(expected[name]))
        np.testing.assert_allclose(fetched[name], expected[name], rtol=0, atol=1e-12)


@pytest.mark.parametrize(("options", "line"), [
    ({"lat": (73.0, 73.0)}, "lat is 73,73; the window is empty"),
    ({"lat": (73.0, 95.0)}, "lat is 73,95; it must be two numbers from -90 to 90"),
    ({"lat": (float("nan"), 1.0)}, "lat is nan,1; it must be"),
    ({"lon": (-130.0, -150.0)},
     "lon is -130,-150; it spans 340 degrees eastwards; the limit is 180; write west,east"),
    ({"lat": (-85.0, -82.0)}, "the data, which cover latitude -80 to 90 and longitude"),
    ({"lat": (-60.0, 60.0), "lon": (0.0, 150.0)},
     "points; the limit is 20,000,000; use a smaller window"),
    ({"lon": (-150.0, -149.99)}, "axis too short (lon): 2 points; allowed 4 or more"),
    ({"out": "nowhere/ocean.nc"}, "no such folder; create it first"),
    ({"servers": "ftp://example.org"}, "no such file"),
    ({"servers": "http://"}, "is not a valid URL"),
    ({"time": "last summer"}, "is not an instant"),
    ({"time": "1980-01-01"}, ("no experiment covers 1980-01-01T00:00; available: expt_53.X"
                             " 1994-01-01")),
    ({"experiment": "mine"}, "unknown experiment 'mine'"),
    ({"lat": (0.0, 0.4), "lon": (-49.3, -48.9)},
     "lat 0 to 0.4, lon -49.3 to -48.9: ocean: no valid value (water_temp)"),
])  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(refusal, options, line):
    assert line in refusal(**options)


def test_an_existing_file_is_left_alone_unless_it_may_be_overwritten(fetch, tmp_path, thredds):
    (tmp_path / "mine.nc").write_text("mine")
    with pytest.raises(OceanError, match=r"mine.nc: already exists"):
        fetch(out="mine.nc")
    assert (tmp_path / "mine.nc").read_text() == "mine"
    assert thredds.app.asked == []
    fetch(out="mine.nc", overwrite=True)
