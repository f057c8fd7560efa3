"""A server on loopback with the data sets of the catalogue, and a fetch that asks it."""

import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean import validate_ocean

pytest.importorskip("pydap.parsers", reason="the extra 'fetch' is not installed")
pytest.importorskip(
    "waitress", reason="waitress, which serves pydap's application here, is not installed"
)

with warnings.catch_warnings():
    warnings.simplefilter(
        "ignore", DeprecationWarning
    )  # pydap's server imports webob, and that cgi
    import opendap_stand_in as server


def catalogue_models():
    lat, lon = server.glbv_latitudes(), server.longitudes(-180.0)
    glby_lat, glby_lon = (
        (-80.0 + 0.04 * np.arange(4251)).astype("f4").astype(float),
        server.longitudes(0.0),
    )
    glby = server.three_hourly("2018-12-04T12", "2019-06-01")
    # one step is missing from the currents only; the axis steps back once, as GLBv0.08 93.0's does
    back, lacking = (
        np.concatenate([glby[:800], glby[799:]]),
        glby[glby != np.datetime64("2019-03-07T18")],
    )
    espc = server.three_hourly("2025-01-01T12", "2025-02-01")
    return {
        **{f"GLBv0.08/expt_53.X/data/{year}": server.reanalysis(year) for year in (2014, 2015)},
        "GLBv0.08/expt_56.3": server.Model(
            server.three_hourly("2014-07-01T12", "2016-10-01"), lat, lon
        ),
        "GLBv0.08/expt_57.2": server.Model(
            server.three_hourly("2016-05-01T12", "2017-02-01T12"), lat, lon
        ),
        "GLBy0.08/expt_93.0/ts3z": server.Model(
            back, glby_lat, glby_lon, ("water_temp", "salinity")
        ),
        "GLBy0.08/expt_93.0/uv3z": server.Model(
            lacking, glby_lat, glby_lon, ("water_u", "water_v")
        ),
        **{
            f"ESPC-D-V02/{short}/2025": server.Model(espc, glby_lat, glby_lon, (name,))
            for short, name in zip(("t3z", "s3z", "u3z", "v3z"), server.OFFSETS, strict=True)
        },
    }


@pytest.fixture(scope="session")
def _running():
    running = server.Running(server.Thredds(catalogue_models()))
    yield running
    running.stop()


@pytest.fixture
def thredds(_running, monkeypatch):
    """The server, well behaved and with nothing asked yet."""
    monkeypatch.delenv("MANTARAY_OCEAN_SERVERS", raising=False)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    app = _running.app
    app.faults.clear()
    app.asked.clear()
    app.account = None
    app.release.clear()
    yield SimpleNamespace(app=app, root=_running.root)
    app.release.set()


@pytest.fixture
def fetch(thredds, tmp_path):
    """
    Fetch from the server, patiently: a busy machine is no fault of the server; gives what happened
    and the ocean.
    """
    from pymantaray.ocean.fetch import FetchLimits, fetch_hycom

    def call(
        lat=(73.0, 73.6), lon=(-150.0, -149.0), time="2014-07-15T12", out="ocean.nc", **options
    ):
        limits = {
            "attempts": 3,
            "backoff_s": 0.01,
            "idle_s": 30.0,
            "request_s": 60.0,
            "total_s": 120.0,
        }
        limits |= options.pop("limits", {})
        options = {"servers": thredds.root, "limits": FetchLimits(**limits)} | options
        fetched = fetch_hycom(lat, lon, time, tmp_path / out, **options)
        with xr.open_dataset(fetched.path) as written:
            ocean = written.load()
        validate_ocean(ocean)
        return fetched, ocean

    return call


@pytest.fixture
def refusal(fetch, tmp_path):
    """
    The one line with which a fetch fails; nothing must be left under the final name or beside it.
    """

    def call(**options):
        before = set(tmp_path.iterdir())
        with pytest.raises(OceanError) as caught:
            fetch(**options)
        message = str(caught.value)
        assert "\n" not in message
        assert len(message) < 700, message
        assert set(tmp_path.iterdir()) == before
        return message

    return call


@pytest.fixture(scope="session")
def is_true():
    """
    Compare an ocean with the closed form at its own points: within half a packing step, same sea
    bed.
    """

    def check(ocean, time):
        hour = server.hours(np.datetime64(time))
        grid = np.ix_(ocean["depth"].values, ocean["lat"].values, ocean["lon"].values)
        for name in server.OFFSETS:
            expected = server.truth(name, hour, *grid)
            np.testing.assert_array_equal(np.isnan(ocean[name].values), np.isnan(expected))
            np.testing.assert_allclose(ocean[name].values, expected, rtol=0, atol=0.00051)
        assert ocean["time"].values == np.datetime64(time)

    return check
