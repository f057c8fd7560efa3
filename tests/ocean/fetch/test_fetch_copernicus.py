"""
GLORYS12 through the service's package: its own signature and its own selection, on a local data set
of its schema.
"""

import inspect
import sys
from types import SimpleNamespace

import gsw
import numpy as np
import pytest
import xarray as xr

from pymantaray.errors import OceanError
from pymantaray.ocean import validate_ocean
from pymantaray.ocean.fetch import fetch_copernicus

# first and last levels of the 50 of GLORYS12 [m]
LEVELS = np.array(
    [
        0.494025,
        1.541375,
        2.645669,
        5.078224,
        9.572997,
        18.49556,
        47.37369,
        92.32607,
        186.1256,
        380.213,
    ]
)


def potential(depth, lon):
    return 3.0 * np.exp(-depth / 200.0) - 1.0 + 0.2 * np.cos(np.radians(3 * lon))


@pytest.fixture(scope="module")
def glorys():
    """Three days about the globe between 72 and 75 N, as the service's data set reads."""
    data = xr.Dataset(
        coords={
            "time": (
                "time",
                np.arange("2014-07-14", "2014-07-17", dtype="M8[D]").astype("M8[ns]"),
                {"standard_name": "time", "axis": "T"},
            ),
            "depth": (
                "depth",
                LEVELS,
                {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"},
            ),
            "latitude": (
                "latitude",
                np.arange(72.0, 75.01, 1 / 12),
                {"units": "degrees_north", "axis": "Y"},
            ),
            "longitude": (
                "longitude",
                -180.0 + np.arange(4320) / 12,
                {"units": "degrees_east", "axis": "X"},
            ),
        },
        attrs={"Conventions": "CF-1.6", "source": "MERCATOR GLORYS12V1", "title": "daily mean"},
    )
    day = xr.DataArray([0.0, 0.01, 0.02], dims="time")
    wet = (data["depth"] < LEVELS[-1]) | (data["latitude"] > 73.5)
    for name, standard_name, units, values in (
        (
            "thetao",
            "sea_water_potential_temperature",
            "degrees_C",
            potential(data["depth"], data["longitude"]),
        ),
        ("so", "sea_water_salinity", "1e-3", 30.0 + data["depth"] / 200.0),
        ("uo", "eastward_sea_water_velocity", "m s-1", 0.1),
        ("vo", "northward_sea_water_velocity", "m s-1", -0.05),
    ):
        field = (values + day + 0.0 * data["longitude"]).where(wet).astype("f4")
        data[name] = field.transpose(*data.sizes).assign_attrs(
            standard_name=standard_name, units=units
        )
    data["time"].encoding = {
        "units": "hours since 1950-01-01",
        "calendar": "gregorian",
        "dtype": "int64",
    }
    return data


@pytest.fixture
def service(glorys, monkeypatch):
    """
    The package with its network call replaced: arguments bound by the real signature, cut by the
    real selection.
    """
    package = pytest.importorskip(
        "copernicusmarine", reason="the extra 'copernicus' is not installed"
    )
    from copernicusmarine.download_functions import subset_parameters as parameters, subset_xarray

    signature = inspect.signature(package.subset)
    asked = []

    def subset(**arguments):
        bound = signature.bind(**arguments)
        bound.apply_defaults()
        a = SimpleNamespace(**bound.arguments)
        asked.append(a)
        cut = subset_xarray.subset(
            glorys,
            a.variables,
            parameters.GeographicalParameters(
                parameters.YParameters(a.minimum_latitude, a.maximum_latitude),
                parameters.XParameters(a.minimum_longitude, a.maximum_longitude),
            ),
            parameters.TemporalParameters(a.start_datetime, a.end_datetime),
            parameters.DepthParameters(a.minimum_depth, a.maximum_depth),
            a.coordinates_selection_method,
        )
        cut.to_netcdf(a.output_directory / a.output_filename, engine="netcdf4")

    monkeypatch.setattr(package, "subset", subset)
    monkeypatch.delenv("MANTARAY_OCEAN_SERVERS", raising=False)
    return asked


@pytest.mark.parametrize(
    ("lon", "first"),
    [
        ((-150.0, -149.0), -150.0),
        ((210.0, 211.0), -150.0),
        ((179.5, -179.5), -180.5),
        ((0.5, 1.2), 0.5),
    ],
)
def test_a_window_of_a_day_becomes_a_valid_ocean(service, tmp_path, lon, first, as_stored):
    fetched = fetch_copernicus((73.0, 74.0), lon, "2014-07-15T18", tmp_path / "glorys.nc")
    with xr.open_dataset(fetched.path) as written:
        ocean = written.load()
    validate_ocean(ocean)
    (asked,) = service
    assert asked.dataset_id == "cmems_mod_glo_phy_my_0.083deg_P1D-m"
    assert asked.start_datetime == asked.end_datetime
    assert ocean["time"].values == np.datetime64("2014-07-15")
    for name, low, width in (("lat", 73.0, 1.0), ("lon", first, (lon[1] - lon[0]) % 360.0)):
        assert low - 0.09 < ocean[name].values[0] <= low + 1e-6
        assert ocean[name].values[-1] >= low + width - 1e-6
    assert ocean.attrs["title"] == "GLORYS12V1 global ocean reanalysis, daily mean, 2014-07-15"
    assert "cmems_mod_glo_phy_my_0.083deg_P1D-m" in ocean.attrs["history"].splitlines()[-1]
    # potential temperature of the second day became in-situ temperature
    point = ocean.sel(depth=LEVELS[8], method="nearest", tolerance=0.01).isel(lat=3, lon=3)
    z, lat, east = (float(point[name]) for name in ("depth", "lat", "lon"))
    SP, p = 30.0 + z / 200.0 + 0.01, gsw.p_from_z(-z, lat)
    SA = gsw.SA_from_SP(SP, p, east, lat)
    expected = gsw.t_from_CT(SA, gsw.CT_from_pt(SA, potential(z, east) + 0.01), p)
    assert float(point["water_temp"]) == pytest.approx(float(expected), abs=1e-4)
    assert list(tmp_path.iterdir()) == [fetched.path]
    as_stored(fetched)


def test_several_data_sets_of_a_product_are_one_ocean(service, tmp_path, as_stored):
    servers = tmp_path / "servers.toml"
    servers.write_text(
        """[[copernicus]]
name = "apart"
title = "apart"
first = 2010-01-01T00:00:00
datasets = [
    { id = "t", variables = ["thetao"] },
    { id = "s", variables = ["so"] },
    { id = "c", variables = ["uo", "vo"] },
]
"""
    )
    fetched = fetch_copernicus(
        (73.0, 74.0), (-150.0, -149.0), "2014-07-15", tmp_path / "glorys.nc", servers=servers
    )
    assert fetched.requests == 3
    assert [a.dataset_id for a in service] == ["t", "s", "c"]
    with xr.open_dataset(fetched.path) as ocean:
        validate_ocean(ocean)
    as_stored(fetched)


@pytest.fixture
def refusal(tmp_path):
    """The one line with which a fetch fails; nothing must be left under the final name."""

    def call(*, lat=(73.0, 74.0), lon=(-150.0, -149.0), time="2014-07-15", **options):
        with pytest.raises(OceanError) as caught:
            fetch_copernicus(lat, lon, time, tmp_path / "glorys.nc", **options)
        assert "\n" not in str(caught.value)
        assert not (tmp_path / "glorys.nc").exists()
        return str(caught.value)

    return call


def test_what_cannot_be_is_refused_before_the_service_is_asked(service, refusal):
    line = "no product covers 1980-01-01T00:00; available: glorys12 1993-01-01 to today"
    assert line in refusal(time="1980-01-01")
    assert "unknown product 'mine'; available: glorys12, analysis" in refusal(product="mine")
    assert "use a smaller window" in refusal(lat=(0.0, 80.0), lon=(-170.0, 0.0))
    assert service == []


def failing(name):
    def subset(**_):
        raise getattr(sys.modules["copernicusmarine"], name)("first line\nsecond line")

    return subset


LOGIN = "log in once with: copernicusmarine login"
FAILURES = {
    "password": (failing("InvalidUsernameOrPassword"), LOGIN),
    "account": (failing("CredentialsCannotBeNone"), LOGIN),
    "data set": (failing("DatasetNotFound"), "0.083deg_P1D-m: first line second line "),
    "no file": (lambda **_: None, f"the service returned no file; {LOGIN}"),
    "no ocean": (
        lambda **a: (a["output_directory"] / a["output_filename"]).write_text("<html>"),
        "the service did not return a valid ocean",
    ),
}


@pytest.mark.parametrize("case", FAILURES)
def test_failures_of_the_service_become_one_line(service, refusal, monkeypatch, case):
    subset, line = FAILURES[case]
    monkeypatch.setattr("copernicusmarine.subset", subset)
    message = refusal()
    assert message.startswith("copernicus: ")
    assert line in message


def test_without_the_package_the_extra_is_named(refusal, monkeypatch):
    monkeypatch.setitem(sys.modules, "copernicusmarine", None)
    assert 'pip install "pymantaray[copernicus]"' in refusal()
