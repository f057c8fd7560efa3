"""CF data sets of every flavour say the same ocean; what is on another kind of grid is refused with the remedy."""

import gsw
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pymantaray.ocean import open_ocean
from pymantaray.ocean.seawater import sound_speed

LAT = np.linspace(40.0, 41.0, 5)
LON = np.linspace(-30.0, -28.0, 6)
DEPTH = np.array([0.0, 10.0, 100.0, 500.0, 1500.0])
SA = 35.0 + 0.5 * np.cos(DEPTH / 400.0)[:, None, None] + 0.1 * (LAT - 40.5)[:, None] + 0.05 * (LON + 29.0)
CT = 4.0 + 12.0 * np.exp(-DEPTH / 300.0)[:, None, None] + 0.3 * (LAT - 40.5)[:, None] - 0.2 * (LON + 29.0)
DRY = (DEPTH[:, None, None] > 600.0) & (LON > -28.5) & np.ones((5, 1), dtype=bool)

TEMPERATURES = {
    "sea_water_temperature": lambda p: gsw.t_from_CT(SA, CT, p),
    "sea_water_potential_temperature": lambda p: gsw.pt_from_CT(SA, CT) + 0 * p,
    "sea_water_conservative_temperature": lambda p: CT + 0 * p,
}
SALINITIES = {
    "sea_water_practical_salinity": lambda p: gsw.SP_from_SA(SA, p, LON, LAT[:, None]),
    "sea_water_salinity": lambda p: gsw.SP_from_SA(SA, p, LON, LAT[:, None]),
    "sea_water_absolute_salinity": lambda p: SA + 0 * p,
    "sea_water_preformed_salinity": lambda p: gsw.Sstar_from_SA(SA, p, LON, LAT[:, None]),
}
TEMPERATURE_UNITS = {"degC": 0.0, "degree_Celsius": 0.0, "K": 273.15, "kelvin": 273.15}
MASS_UNITS = {"g kg-1": 1.0, "g/kg": 1.0, "kg kg-1": 1e-3}
PRACTICAL_UNITS = ("1", "1e-3", "psu", "0.001", "g/kg")
SPEED_UNITS = {"m s-1": 1.0, "m/s": 1.0, "cm/s": 100.0, "cm s-1": 100.0}
VERTICALS = {  # units, attribute positive, factor from metres down
    "metres down": ("m", "down", 1.0),
    "metres up": ("m", "up", -1.0),
    "negative, not said": ("m", None, -1.0),
    "kilometres": ("km", "down", 1e-3),
    "centimetres": ("centimeters", "down", 100.0),
}


def pressure(depth=DEPTH):
    return gsw.p_from_z(-depth[:, None, None], LAT[:, None])


def flavour(
    *,
    temperature="sea_water_conservative_temperature",
    salinity="sea_water_absolute_salinity",
    t_unit="degC",
    s_unit=None,
    speed_unit="m s-1",
    vertical="metres down",
    lat_falls=False,
    depth_falls=False,
    names=("thetao", "so", "uo", "vo", "deptht", "latitude", "longitude", "time_counter"),
    order=(0, 1, 2, 3),
):
    """Data set whose absolute salinity and conservative temperature are SA and CT."""
    t, s, u, v, z, y, x, when = names
    p = pressure()
    mass = salinity not in ("sea_water_practical_salinity", "sea_water_salinity")
    s_unit = s_unit or ("g kg-1" if mass else "1e-3")
    z_unit, positive, factor = VERTICALS[vertical]
    scale = SPEED_UNITS[speed_unit]
    dims = (when, z, y, x)
    fields = {
        t: (TEMPERATURES[temperature](p) + TEMPERATURE_UNITS[t_unit], temperature, t_unit),
        s: (SALINITIES[salinity](p) * (MASS_UNITS[s_unit] if mass else 1.0), salinity, s_unit),
        u: ((0.1 + 0.01 * CT) * scale, "eastward_sea_water_velocity", speed_unit),
        v: ((0.2 - 0.01 * CT) * scale, "northward_sea_water_velocity", speed_unit),
    }
    data = xr.Dataset(
        {
            n: (dims, np.where(DRY, np.nan, f)[None], {"standard_name": name, "units": unit})
            for n, (f, name, unit) in fields.items()
        },
        coords={
            z: (
                z,
                DEPTH * factor,
                {"units": z_unit, "axis": "Z", **({"positive": positive} if positive else {})},
            ),
            y: (y, LAT, {"units": "degrees_north"}),
            x: (x, LON, {"units": "degrees_east"}),
            when: (when, np.array(["2020-01-01T06:00"], "datetime64[ns]"), {"standard_name": "time"}),
        },
        attrs={"title": "A model", "institution": "Somewhere"},
    )
    if lat_falls:
        data = data.isel({y: slice(None, None, -1)})
    if depth_falls:
        data = data.isel({z: slice(None, None, -1)})
    return data.transpose(*(dims[i] for i in order))


def write(path, data):
    data.to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
    return path


def speed_error(ocean, depth=DEPTH):
    """Largest difference of the sound speed at grid points from gsw's of SA and CT. [m/s]"""
    found = sound_speed(
        ocean["water_temp"].values,
        ocean["salinity"].values,
        ocean["depth"].values[:, None, None],
        ocean["lat"].values[:, None],
        ocean["lon"].values,
    )
    expected = np.where(DRY, np.nan, gsw.sound_speed(SA, CT, pressure(depth)))
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    return np.nanmax(np.abs(found - expected))


@given(
    temperature=st.sampled_from(sorted(TEMPERATURES)),
    salinity=st.sampled_from(sorted(SALINITIES)),
    t_unit=st.sampled_from(sorted(TEMPERATURE_UNITS)),
    mass_unit=st.sampled_from(sorted(MASS_UNITS)),
    practical_unit=st.sampled_from(PRACTICAL_UNITS),
    speed_unit=st.sampled_from(sorted(SPEED_UNITS)),
    vertical=st.sampled_from(sorted(VERTICALS)),
    lat_falls=st.booleans(),
    depth_falls=st.booleans(),
    order=st.permutations(range(4)),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_flavour_has_the_sound_speed_of_gsw(tmp_path, mass_unit, practical_unit, **how):
    practical = how["salinity"] in ("sea_water_practical_salinity", "sea_water_salinity")
    data = flavour(s_unit=practical_unit if practical else mass_unit, **how)
    ocean = open_ocean(write(tmp_path / "model.nc", data))
    assert speed_error(ocean) < 1e-9
    np.testing.assert_allclose(ocean["depth"], DEPTH, rtol=1e-14)
    np.testing.assert_array_equal(ocean["lat"], LAT)
    np.testing.assert_allclose(
        ocean["water_u"].where(~DRY), np.where(DRY, np.nan, 0.1 + 0.01 * CT), atol=1e-15
    )
    np.testing.assert_allclose(ocean["water_v"], np.where(DRY, np.nan, 0.2 - 0.01 * CT), atol=1e-15)
    assert ocean.attrs["title"] == "A model"
    assert ocean.attrs["source"] == "Somewhere"
    converted = how["temperature"] != "sea_water_temperature" or not practical
    assert ("TEOS-10" in ocean.attrs.get("history", "")) == converted


def test_levels_of_pressure_become_depths(tmp_path):
    data = flavour()
    dbar = gsw.p_from_z(-DEPTH, 40.5)
    z_of = -gsw.z_from_p(dbar[:, None], LAT)[..., None] + 0 * LON
    for unit, factor in (("dbar", 1.0), ("Pa", 1e4), ("bar", 0.1)):
        # linear in depth, so that the move between depths leaves no error of interpolation
        there = data.assign(
            thetao=data["thetao"] * 0 + 8.0 - 1e-3 * z_of, so=data["so"] * 0 + 35.0 + 1e-4 * z_of
        )
        there["thetao"].attrs = {"units": "degC", "standard_name": "sea_water_temperature"}
        there["so"].attrs = {"units": "1", "standard_name": "sea_water_practical_salinity"}
        there = there.assign_coords(
            deptht=(
                "deptht",
                dbar * factor,
                {"units": unit, "standard_name": "sea_water_pressure", "positive": "down"},
            )
        )
        ocean = open_ocean(write(tmp_path / "p.nc", there))
        np.testing.assert_allclose(ocean["depth"], DEPTH, atol=1e-6)
        expected = np.where(DRY, np.nan, 8.0 - 1e-3 * DEPTH[:, None, None] + 0 * SA)
        deepest = np.isfinite(expected) & ~np.isfinite(np.concatenate([expected[1:], expected[:1] * np.nan]))
        error = np.abs(ocean["water_temp"].values - expected)
        assert np.nanmax(error[~deepest]) < 1e-9
        assert np.nanmax(error[deepest]) < 1e-3 * 0.2  # nothing below to interpolate to: moved by 0.1 m
        assert "levels of pressure moved by up to" in ocean.attrs["history"]


def test_a_first_level_below_the_surface_is_carried_up_and_recorded(tmp_path, message_of):
    data = flavour(temperature="sea_water_potential_temperature", salinity="sea_water_salinity")
    glorys = data.assign_coords(deptht=("deptht", DEPTH + 0.494, data["deptht"].attrs))
    ocean = open_ocean(write(tmp_path / "glorys.nc", glorys))
    assert ocean["depth"].values[:2] == pytest.approx([0.0, 0.494])
    np.testing.assert_array_equal(ocean["water_temp"][0], ocean["water_temp"][1])
    assert ocean.attrs["history"].splitlines()[-1] == "level at 0 m added with the values at 0.494 m"
    deep = data.assign_coords(deptht=("deptht", DEPTH + 50.0, data["deptht"].attrs))
    assert "the first level is at 50 m" in message_of(write(tmp_path / "deep.nc", deep))


def test_water_at_rest_is_asked_for_by_name(tmp_path, message_of):
    still = flavour()[["thetao", "so"]]
    path = write(tmp_path / "still.nc", still)
    assert 'or open it with currents="rest"' in message_of(path)
    ocean = open_ocean(path, currents="rest")
    assert not ocean["water_u"].where(~DRY, 0.0).values.any()
    assert speed_error(ocean) < 1e-9
    assert "currents at rest: the data set has none" in ocean.attrs["history"]
    half = write(tmp_path / "half.nc", flavour()[["thetao", "so", "uo"]])
    assert "no water_v" in message_of(half, currents="rest")
    assert "allowed are 'required' and 'rest'" in message_of(path, currents="none")


def _renamed(data, **attrs_of):
    for name, attrs in attrs_of.items():
        data[name].attrs = {**data[name].attrs, **attrs}
    return data


def _curvilinear(data):
    lat, lon = np.meshgrid(LAT, LON, indexing="ij")
    data = data.drop_vars(["latitude", "longitude"]).rename(latitude="y", longitude="x")
    return data.assign_coords(
        nav_lat=(("y", "x"), lat, {"units": "degrees_north"}),
        nav_lon=(("y", "x"), lon, {"units": "degrees_east"}),
    )


def _several(data):
    data["again"] = data["so"]
    return data


def _rotated(data):
    data["pole"] = ((), 0, {"grid_mapping_name": "rotated_latitude_longitude"})
    return data


def _staggered(data):
    return data.assign(uo=data["uo"].rename(longitude="lon_u").assign_coords(
        lon_u=("lon_u", LON + 0.2, {"units": "degrees_east"})))  # fmt: skip


def _monthly(data):
    when = xr.Variable("time_counter", [0.5], {"units": "months since 1955-01-01", "standard_name": "time"})
    return data.assign_coords(time_counter=when)


def _calendar(name):
    def change(data):
        attrs = {"units": "days since 2000-01-01", "calendar": name, "standard_name": "time"}
        return data.assign_coords(time_counter=("time_counter", [40.0], attrs))

    return change


REFUSED = {
    "terrain": (
        lambda d: _renamed(d, deptht={"standard_name": "ocean_s_coordinate_g2", "units": "1"}),
        "follows the sea bed",
    ),
    "sigma": (lambda d: _renamed(d, deptht={"formula_terms": "sigma: s eta: zeta"}), "follows the sea bed"),
    "layers of density": (
        lambda d: _renamed(d, deptht={"standard_name": "sea_water_potential_density", "units": "kg m-3"}),
        "is no depth",
    ),
    "curvilinear": (_curvilinear, "the grid is curvilinear; regrid"),
    "rotated pole": (_rotated, "rotated pole; regrid"),
    "grid longitude": (lambda d: _renamed(d, longitude={"standard_name": "grid_longitude"}), "rotated pole"),
    "projected": (
        lambda d: _renamed(d, longitude={"standard_name": "projection_x_coordinate", "units": "m"}),
        "projected",
    ),
    "grid-relative": (
        lambda d: _renamed(
            d, uo={"standard_name": "sea_water_x_velocity"}, vo={"standard_name": "sea_water_y_velocity"}
        ),
        "velocities along the model's grid, not east and north; turn them",
    ),
    "staggered": (_staggered, "interpolate all to the same points"),
    "two of a kind": (_several, "leave one in the file"),
    "no units": (lambda d: _renamed(d, thetao={"units": ""}), "has no units"),
    "furlongs": (lambda d: _renamed(d, uo={"units": "furlong/fortnight"}), "not of a velocity"),
    "salt in kg/kg called 1": (
        lambda d: _renamed(d, so={"standard_name": "sea_water_salinity", "units": "1"}).assign(
            so=lambda e: e["so"].copy(data=e["so"].values / 1000.0)
        ),
        "looks like kg/kg",
    ),
    "wrong way up": (lambda d: d.assign_coords(deptht=-d["deptht"]), "positive down but is negative"),
    "above the surface": (
        lambda d: d.assign_coords(deptht=("deptht", DEPTH - 5.0, d["deptht"].attrs)),
        "a level 5 above the surface",
    ),
    "months": (_monthly, "climatology"),
    "climatology": (lambda d: _renamed(d, time_counter={"climatology": "bounds"}), "climatology"),
    "360 days": (_calendar("360_day"), "calendar '360_day'"),
    "no leap": (_calendar("noleap"), "convert_calendar"),
    "members": (lambda d: d.expand_dims(member=2), "'member' besides"),
    "latitude jumps": (lambda d: d.isel(latitude=[0, 2, 1, 3, 4]), "neither rises nor falls"),
    "masks": (lambda d: d.assign(so=d["so"].where(d["latitude"] > 40.3)), "disagree on"),
    "latitude missing": (
        lambda d: d.assign_coords(latitude=("latitude", [40, 40.1, np.nan, 40.5, 41], d["latitude"].attrs)),
        "latitude is empty or has values that are missing",
    ),
}  # fmt: skip


def undecoded(data):
    """With time as numbers, so that what a case writes there stays."""
    when = {"units": "hours since 2020-01-01", "standard_name": "time"}
    return data.assign_coords(time_counter=("time_counter", [6.0], when))


@pytest.mark.parametrize("case", REFUSED, ids=str)
def test_what_cannot_be_converted_is_refused_with_reason_and_remedy(tmp_path, case, message_of):
    change, says = REFUSED[case]
    path = tmp_path / "model.nc"
    write(path, change(undecoded(flavour())))
    message = message_of(path)
    assert says in message
    assert message.startswith("model.nc: ")


def test_masks_that_differ_a_little_are_made_one_and_recorded(tmp_path):
    data = flavour()
    data["uo"][0, 1, 2, 3] = np.nan
    data["so"][0, 3, 0, 0] = np.nan  # a hole: the water beneath it goes too
    ocean = open_ocean(write(tmp_path / "holes.nc", data))
    assert float(ocean["water_u"][1, 2, 3]) == 0.0
    assert np.isnan(ocean["water_temp"].values[3:, 0, 0]).all()
    assert ocean.attrs["history"].splitlines()[:2] == [
        "2 values beneath a missing one, or without its partner, left out",
        "currents set to 0 at 1 wet points where they are missing",
    ]


def test_the_bathymetry_file_of_glorys_is_refused_sensibly(shared_data, message_of):
    message = message_of(shared_data / "glorys12_fram_strait_bathymetry.nc")
    assert "none of water_temp" in message
    assert "standard_name" in message


def test_grid_relative_currents_may_be_left_out_for_water_at_rest(tmp_path):
    data = _renamed(
        flavour(), uo={"standard_name": "sea_water_x_velocity"}, vo={"standard_name": "sea_water_y_velocity"}
    )
    ocean = open_ocean(write(tmp_path / "model.nc", data), currents="rest")
    assert speed_error(ocean) < 1e-9
