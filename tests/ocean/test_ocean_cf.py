"""
CF data sets of every flavour say the same ocean; what is on another kind of grid is refused with
the remedy.
"""

import gsw
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings, strategies as st

from pymantaray.ocean import open_ocean
from pymantaray.ocean.seawater import sound_speed

LAT = np.linspace(40.0, 41.0, 5)
LON = np.linspace(-30.0, -28.0, 6)
DEPTH = np.array([0.0, 10.0, 100.0, 500.0, 1500.0])
Z = DEPTH[:, None, None]
P = gsw.p_from_z(-Z, LAT[:, None])
SA = 35.0 + 0.5 * np.cos(Z / 400.0) + 0.1 * (LAT - 40.5)[:, None] + 0.05 * (LON + 29.0)
CT = 4.0 + 12.0 * np.exp(-Z / 300.0) + 0.3 * (LAT - 40.5)[:, None] - 0.2 * (LON + 29.0)
DRY = (Z > 600.0) & (LON > -28.5) & np.ones((5, 1), dtype=bool)
SP = gsw.SP_from_SA(SA, P, LON, LAT[:, None])

TEMPERATURES = {
    "sea_water_temperature": gsw.t_from_CT(SA, CT, P),
    "sea_water_potential_temperature": gsw.pt_from_CT(SA, CT),
    "sea_water_conservative_temperature": CT,
}
PRACTICAL = {"sea_water_practical_salinity": SP, "sea_water_salinity": SP}
SALINITIES = PRACTICAL | {
    "sea_water_absolute_salinity": SA,
    "sea_water_preformed_salinity": gsw.Sstar_from_SA(SA, P, LON, LAT[:, None]),
    "sea_water_reference_salinity": gsw.SR_from_SP(SP),
}
TEMPERATURE_UNITS = {
    "degC": 0.0,
    "degree_Celsius": 0.0,
    "degrees_C": 0.0,
    "K": 273.15,
    "kelvin": 273.15,
}
MASS_UNITS = {"g kg-1": 1.0, "g/kg": 1.0, "kg kg-1": 1e-3}
PRACTICAL_UNITS = dict.fromkeys(("1", "1e-3", "psu", "0.001", "g/kg"), 1.0)
SPEED_UNITS = {"m s-1": 1.0, "m/s": 1.0, "cm/s": 100.0, "cm s-1": 100.0}
VERTICALS = {  # attributes, factor from metres down
    "metres down": ({"units": "m", "positive": "down"}, 1.0),
    "metres up": ({"units": "m", "positive": "up"}, -1.0),
    "negative, not said": ({"units": "m"}, -1.0),
    "kilometres": ({"units": "km", "positive": "down"}, 1e-3),
    "centimetres": ({"units": "centimeters", "positive": "down"}, 100.0),
}
TIME = {"units": "hours since 2020-01-01", "standard_name": "time"}
DIMS = ("time_counter", "deptht", "latitude", "longitude")


def flavour(
    *,
    temperature="sea_water_conservative_temperature",
    salinity="sea_water_absolute_salinity",
    t_unit="degC",
    s_unit=None,
    speed_unit="m s-1",
    vertical="metres down",
    falling=(),
    order=DIMS,
):
    """
    Data set whose absolute salinity and conservative temperature are SA and CT; time as a number.
    """
    units = PRACTICAL_UNITS if salinity in PRACTICAL else MASS_UNITS
    s_unit = s_unit or next(iter(units))
    scale = SPEED_UNITS[speed_unit]
    fields = {
        "thetao": (TEMPERATURES[temperature] + TEMPERATURE_UNITS[t_unit], temperature, t_unit),
        "so": (SALINITIES[salinity] * units[s_unit], salinity, s_unit),
        "uo": ((0.1 + 0.01 * CT) * scale, "eastward_sea_water_velocity", speed_unit),
        "vo": ((0.2 - 0.01 * CT) * scale, "northward_sea_water_velocity", speed_unit),
    }
    attrs, factor = VERTICALS[vertical]
    data = xr.Dataset(
        {
            name: (
                DIMS,
                np.where(DRY, np.nan, values)[None],
                {"standard_name": standard_name, "units": unit},
            )
            for name, (values, standard_name, unit) in fields.items()
        },
        coords={
            "deptht": ("deptht", DEPTH * factor, {"axis": "Z"} | attrs),
            "latitude": ("latitude", LAT, {"units": "degrees_north"}),
            "longitude": ("longitude", LON, {"units": "degrees_east"}),
            "time_counter": ("time_counter", [6.0], TIME),
        },
        attrs={"title": "A model", "institution": "Somewhere"},
    )
    return data.isel({name: slice(None, None, -1) for name in falling}).transpose(*order)


def write(path, data):
    data.to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
    return path


def speed_error(ocean):
    """Largest difference of the sound speed at grid points from gsw's of SA and CT. [m/s]"""
    place = (
        ocean["depth"].values[:, None, None],
        ocean["lat"].values[:, None],
        ocean["lon"].values,
    )
    found = sound_speed(ocean["water_temp"].values, ocean["salinity"].values, *place)
    expected = np.where(DRY, np.nan, gsw.sound_speed(SA, CT, P))
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    return np.nanmax(np.abs(found - expected))


@given(
    temperature=st.sampled_from(sorted(TEMPERATURES)),
    salinity=st.sampled_from(sorted(SALINITIES)),
    t_unit=st.sampled_from(sorted(TEMPERATURE_UNITS)),
    mass_unit=st.sampled_from(sorted(MASS_UNITS)),
    practical_unit=st.sampled_from(sorted(PRACTICAL_UNITS)),
    speed_unit=st.sampled_from(sorted(SPEED_UNITS)),
    vertical=st.sampled_from(sorted(VERTICALS)),
    falling=st.sets(st.sampled_from(["latitude", "deptht"])),
    order=st.permutations(DIMS),
)
@settings(max_examples=20)
def test_every_flavour_has_the_sound_speed_of_gsw(tmp_path, mass_unit, practical_unit, **how):
    practical = how["salinity"] in PRACTICAL
    data = flavour(s_unit=practical_unit if practical else mass_unit, **how)
    ocean = open_ocean(write(tmp_path / "model.nc", data))
    assert speed_error(ocean) < 1e-9
    np.testing.assert_allclose(ocean["depth"], DEPTH, rtol=1e-14)
    np.testing.assert_array_equal(ocean["lat"], LAT)
    np.testing.assert_allclose(ocean["water_u"], np.where(DRY, np.nan, 0.1 + 0.01 * CT), atol=1e-15)
    np.testing.assert_allclose(ocean["water_v"], np.where(DRY, np.nan, 0.2 - 0.01 * CT), atol=1e-15)
    assert ocean.attrs["title"] == "A model"
    assert ocean.attrs["source"] == "Somewhere"
    converted = how["temperature"] != "sea_water_temperature" or not practical
    assert ("TEOS-10" in ocean.attrs.get("history", "")) == converted
    assert "practical to practical" not in ocean.attrs.get("history", "")
    assert "in situ to in situ" not in ocean.attrs.get("history", "")


@pytest.mark.parametrize(("unit", "factor"), [("dbar", 1.0), ("Pa", 1e4), ("bar", 0.1)])
def test_levels_of_pressure_become_depths(tmp_path, unit, factor, as_stored):
    dbar = gsw.p_from_z(-DEPTH, 40.5)
    depths = -gsw.z_from_p(dbar[:, None], LAT)[..., None]
    data = flavour(temperature="sea_water_temperature", salinity="sea_water_salinity")
    # linear in depth, so that the move between depths leaves no error of interpolation
    data["thetao"][:] = np.where(DRY, np.nan, 8.0 - 1e-3 * depths)
    axis = {"units": unit, "standard_name": "sea_water_pressure", "positive": "down"}
    data = data.assign_coords(deptht=("deptht", dbar * factor, axis))
    ocean = open_ocean(write(tmp_path / "p.nc", data))
    np.testing.assert_allclose(ocean["depth"], DEPTH, atol=1e-6)
    expected = np.where(DRY, np.nan, 8.0 - 1e-3 * Z + 0 * SA)
    deepest = np.isfinite(expected) & ~np.isfinite(
        np.concatenate([expected[1:], expected[:1] * np.nan])
    )
    error = np.abs(ocean["water_temp"].values - expected)
    assert np.nanmax(error[~deepest]) < 1e-9
    assert np.nanmax(error[deepest]) < 1e-3 * 0.2  # nothing below to interpolate to: moved by 0.1 m
    assert "pressure levels moved by up to" in ocean.attrs["history"]
    as_stored(ocean)


def test_a_first_level_below_the_surface_is_carried_up_and_recorded(tmp_path, as_stored):
    glorys = axis("deptht", DEPTH + 0.494)(flavour())
    ocean = open_ocean(write(tmp_path / "glorys.nc", glorys))
    assert ocean["depth"].values[:2] == pytest.approx([0.0, 0.494])
    np.testing.assert_array_equal(ocean["water_temp"][0], ocean["water_temp"][1])
    assert (
        ocean.attrs["history"].splitlines()[-1] == "level at 0 m added with the values at 0.494 m"
    )
    as_stored(ocean)


def test_water_at_rest_is_asked_for_by_name(tmp_path, message_of, as_stored):
    for change in (lambda d: d[["thetao", "so"]], GRID_RELATIVE):
        path = write(tmp_path / "still.nc", change(flavour()))
        ocean = open_ocean(path, currents="rest")
        assert not ocean["water_u"].where(~DRY, 0.0).values.any()
        assert speed_error(ocean) < 1e-9
        assert "currents at rest: the data set has none" in ocean.attrs["history"]
    assert "allowed: 'required' or 'rest'" in message_of(path, currents="none")
    half = write(tmp_path / "half.nc", flavour()[["thetao", "so", "uo"]])
    assert "no water_v" in message_of(half, currents="rest")
    as_stored(ocean)


def attrs(**of):
    """A change of the attributes of some variables."""

    def change(data):
        for name, new in of.items():
            data[name].attrs |= new
        return data

    return change


def axis(name, values, **attrs):
    return lambda d: d.assign_coords({name: (name, values, d[name].attrs | attrs)})


def nameless(data):
    for name in ("thetao", "so", "uo", "vo"):
        data[name].attrs.pop("standard_name")
    return data


def staggered(data):
    east = xr.Variable("lon_u", LON + 0.2, {"units": "degrees_east"})
    return data.assign(uo=data["uo"].rename(longitude="lon_u").assign_coords(lon_u=east))


GRID_RELATIVE = attrs(
    uo={"standard_name": "sea_water_x_velocity"}, vo={"standard_name": "sea_water_y_velocity"}
)
REFUSED = {
    "terrain": (attrs(deptht={"standard_name": "ocean_s_coordinate_g2", "units": "1"}),
                "its levels follow the sea bed (deptht), but it is no file of ROMS"),
    "sigma": (attrs(deptht={"formula_terms": "sigma: s eta: zeta"}), "levels follow the sea bed"),
    "layers of density": (attrs(deptht={"standard_name": "sea_water_potential_density",
                                        "units": "kg m-3"}), "is not a depth"),
    "without names": (nameless,
                      "it contains thetao (time_counter, deptht, latitude, longitude), so ("),
    "salinity without a name": (
        attrs(so={"standard_name": "salt"}),
        ("no salinity; an ocean needs water_temp, salinity, water_u and water_v, or their CF"
         " standard names (for HYCOM the ts3z and uv3z files together); it contains thetao ("),
    ),
    "rotated pole": (
        lambda d: d.assign(pole=((), 0, {"grid_mapping_name": "rotated_latitude_longitude"})),
        "rotated pole (pole); give its axes standard names",
    ),
    "grid longitude": (attrs(longitude={"standard_name": "grid_longitude"}), "rotated pole"),
    "projected": (attrs(longitude={"standard_name": "projection_x_coordinate", "units": "m"}),
                  "projected"),
    "grid-relative": (GRID_RELATIVE,
                      ("velocities along the axes of the model's grid, not east and north; rotate"
                       " them")),
    "staggered": (staggered, "interpolate both to the same points"),
    "two of a kind": (lambda d: d.assign(again=d["so"]), "keep only one in the file"),
    "no units": (attrs(thetao={"units": ""}), "has no units"),
    "furlongs": (attrs(uo={"units": "furlong/fortnight"}), "which is not a unit of velocity"),
    "salt in kg/kg called 1": (
        lambda d: attrs(so={"standard_name": "sea_water_salinity", "units": "1"})(
            d.assign(so=d["so"].copy(data=d["so"] / 1000.0))
        ),
        "suggests kg/kg",
    ),
    "wrong way up": (axis("deptht", -DEPTH),
                     "has negative values although its attribute positive is 'down'"),
    "above the surface": (axis("deptht", DEPTH - 5.0), "a level 5 above the surface"),
    "deep": (axis("deptht", DEPTH + 50.0), "the first level is at 50 m"),
    "too many months": (axis("time_counter", [1e9], units="months since 1955-01-01"),
                        "correct the axis"),
    "equal times": (lambda d: d.isel(time_counter=[0, 0]), "the instant 2020-01-01T06:00 2 times"),
    "deep levels": (axis("deptht", [0.0, 10.0, 100.0, 500.0, 1e308], units="m"),
                    "a level at 1e+308; allowed: at most 12000 m"),
    "unit of latitude": (attrs(latitude={"units": "m"}), "is not a unit of latitude"),
    "360 days": (attrs(time_counter={"calendar": "360_day"}), "calendar '360_day'"),
    "no leap": (attrs(time_counter={"calendar": "noleap"}), "convert_calendar"),
    "members": (lambda d: d.expand_dims(member=2), "'member' besides"),
    "latitude jumps": (lambda d: d.isel(latitude=[0, 2, 1, 3, 4]), "is not monotonic"),
    "masks": (lambda d: d.assign(so=d["so"].where(d["latitude"] > 40.3)),
              "land masks of temperature"),
    "latitude missing": (
        axis("latitude", [40, 40.1, np.nan, 40.5, 41]),
        "latitude is empty or has missing values",
    ),
    "no currents": (lambda d: d[["thetao", "so"]],
                    "add them, or set the currents to zero with `currents='rest'`"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_converted_is_refused_with_reason_and_remedy(tmp_path, case, message_of):
    change, words = REFUSED[case]
    message = message_of(write(tmp_path / "model.nc", change(flavour())))
    assert words in message
    assert message.startswith("model.nc: ")


def test_masks_that_differ_a_little_are_made_one_and_recorded(tmp_path, as_stored):
    data = flavour()
    data["uo"][0, 1, 2, 3] = np.nan
    data["so"][0, 3, 0, 0] = np.nan  # a hole: the water beneath it goes too
    ocean = open_ocean(write(tmp_path / "holes.nc", data))
    assert float(ocean["water_u"][1, 2, 3]) == 0.0
    assert np.isnan(ocean["water_temp"].values[3:, 0, 0]).all()
    assert ocean.attrs["history"].splitlines()[:2] == [
        "2 points removed: temperature or salinity is missing there or above",
        "currents set to 0 at 1 wet point without currents",
    ]
    as_stored(ocean)


def test_the_bathymetry_file_of_glorys_is_refused_sensibly(shared_data, message_of):
    message = message_of(shared_data / "glorys12_fram_strait_bathymetry.nc")
    assert "no variable water_temp" in message
    assert "standard_name" in message
