"""
Casts: columns, units, places and times of tables, what is left out and counted; a uniform ocean
from one cast.
"""

import re
from dataclasses import replace

import gsw
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st
from refusals import refused

from pymantaray.acoustics import Medium, read_profile
from pymantaray.errors import OceanError
from pymantaray.ocean import Cast, cast_ocean, read_cast, read_casts, to_local
from pymantaray.ocean.casts import cast_levels
from pymantaray.ocean.schema import validate_ocean
from pymantaray.ocean.seawater import ocean_sound_speed, sound_speed

Z = np.array([0.0, 10.0, 55.0, 120.0, 400.0])
T = np.array([-1.2, -1.3, 0.4, -1.4, 0.6])
S = np.array([27.0, 27.5, 30.7, 32.5, 34.8])
HEAD = "# AXCTD drop 9, 2014-07-24/1920 UTC, lat 73.9883, lon -139.9500; bottom 3700 m\n"


def table(**columns):
    return pd.DataFrame(columns).to_csv(index=False, float_format="%.17g")


PLAIN = table(depth_m=Z, temperature_degC=T, practical_salinity=S)


def write(folder, text, name="cast.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_plain_table_is_read_as_it_stands(tmp_path, as_stored):
    cast = read_cast(write(tmp_path, HEAD + PLAIN))
    for name, expected in (("depth", Z), ("temperature", T), ("salinity", S)):
        np.testing.assert_array_equal(getattr(cast, name), expected)
    assert (cast.lat, cast.lon, cast.bottom_depth) == (73.9883, -139.95, 3700.0)
    assert cast.time == np.datetime64("2014-07-24T19:20")
    assert (cast.name, cast.dropped, cast.notes) == ("cast", 0, ())
    assert not cast.depth.flags.writeable
    assert (
        repr(cast) == "Cast('cast', 73.988 N, 139.95 W, 2014-07-24T19:20, 5 levels from 0 to 400 m)"
    )
    as_stored(cast)


@pytest.mark.parametrize("header", [
    "DEPTH,TEMP,SAL", "Depth [m],Temperature (°C),Salinity [psu]", "depth;water_temp;psal",
    "depth_m\ttemperature_degC\tpractical_salinity", "z temperature salinity",
    'vertCoord[unit="m"],water_temp[unit="degC"],salinity[unit="psu"]',
])  # fmt: skip
def test_names_units_and_separators_of_many_programs(tmp_path, header, as_stored):
    separator = next((s for s in ",;\t" if s in header), " ")
    rows = "\n".join(
        separator.join(map(repr, map(float, row))) for row in zip(Z, T, S, strict=True)
    )
    cast = read_cast(
        write(tmp_path, f"{header}\n{rows}\n"), lat=74.0, lon=-140.0, time="2014-07-24"
    )
    np.testing.assert_array_equal(cast.temperature, T)
    np.testing.assert_array_equal(cast.depth, Z)
    as_stored(cast)


def test_temperatures_and_salinities_are_converted_by_teos_10(tmp_path, as_stored):
    p = gsw.p_from_z(-Z, 74.0)
    SA = gsw.SA_from_SP(S, p, -140.0, 74.0)
    place = {
        "lat": np.full(5, 74.0),
        "lon": np.full(5, -140.0),
        "time": ["2014-07-24T12:00:00Z"] * 5,
    }
    variants = {
        "dbar": {"pressure_dbar": p, "temperature": T, "salinity": S},
        "kpa": {"pressure [kPa]": 10.0 * p, "temperature [K]": T + 273.15, "salinity": S},
        "potential": {"depth": Z, "theta": gsw.pt0_from_t(SA, T, p), "salinity": S},
        "conservative": {
            "depth": Z,
            "conservative_temperature": gsw.CT_from_t(SA, T, p),
            "psal": S,
        },
        "absolute": {"pres": p, "temp": T, "absolute_salinity_g/kg": SA},
    }
    for name, columns in variants.items():
        cast = read_cast(write(tmp_path, table(**columns, **place), f"{name}.csv"))
        np.testing.assert_allclose(cast.depth, Z, rtol=0, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(cast.temperature, T, rtol=0, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(cast.salinity, S, rtol=0, atol=1e-9, err_msg=name)
        assert cast.time == np.datetime64("2014-07-24T12:00")
    as_stored(cast)


def test_rows_that_cannot_be_used_are_dropped_and_counted(tmp_path, as_stored):
    rows = [
        (-0.3, -1.0, 27.0),  # above the surface
        (1.0, -1.2, 27.0),
        (2.0, "", 27.1),  # missing
        (3.0, -1.2, -9999.0),  # fill value
        (4.0, 99.0, 27.2),  # impossible
        (5.0, -1.3, 27.3),
        (4.9, -1.3, 27.3),  # the winch stopped
        (5.0, -1.3, 27.3),
        (6.0, -1.3, 27.4),
    ]
    text = "depth,temperature,salinity\n" + "\n".join(",".join(map(str, row)) for row in rows)
    cast = read_cast(write(tmp_path, HEAD + text))
    np.testing.assert_array_equal(cast.depth, [1.0, 5.0, 6.0])
    assert cast.dropped == 6
    assert cast.notes == (
        "2 of 9 rows dropped: with a missing value",
        "1 of 9 rows dropped: above the surface",
        "1 of 9 rows dropped: with an impossible value",
        "2 of 9 rows dropped: not deeper than an earlier row",
    )
    as_stored(cast)


def test_bottles_written_from_the_bottom_up_are_turned_round(tmp_path, as_stored):
    cast = read_cast(
        write(tmp_path, HEAD + table(depth=Z[::-1], temperature=T[::-1], salinity=S[::-1]))
    )
    np.testing.assert_array_equal(cast.temperature, T)
    assert cast.notes == ("rows reversed: the file lists them upward",)
    as_stored(cast)


def test_a_table_of_stations_holds_a_cast_for_each(tmp_path):
    frame = {"station": np.repeat([30, 41], 5), "depth": np.tile(Z, 2), "salinity": np.tile(S, 2)}
    frame |= {
        "temperature": np.concatenate([T, T + 1.0]),
        "lat": np.repeat([77.5, 78.5], 5),
        "lon": 1.0,
    }
    path = write(tmp_path, table(**frame, time="1982-03-09"))
    casts = read_casts([path])
    assert [(c.name, c.lat) for c in casts] == [("30", 77.5), ("41", 78.5)]
    np.testing.assert_array_equal(casts[1].temperature, T + 1.0)
    np.testing.assert_array_equal(read_cast(path, name="41").temperature, T + 1.0)
    refused(OceanError, r"contains 2 casts \(30, 41\); select one by its name", read_cast, path)


@pytest.mark.parametrize(("comment", "time"), [
    ("1997-10-12, lat", "1997-10-12T00:00"), ("2014-07-24/1920 UTC", "2014-07-24T19:20"),
    ("2014-07-24T19:20:30Z", "2014-07-24T19:20:30"), ("2014-07-24 07:05", "2014-07-24T07:05"),
    ("2014-07-24 1000 m",
     "2014-07-24T00:00"), ("March 2020", "2020-03-01T00:00"), ("no date", "NaT"),
])  # fmt: skip
def test_times_in_comments(tmp_path, comment, time, as_stored):
    path = write(tmp_path, f"# {comment} lat 74, lon -140\n" + PLAIN)
    cast = read_cast(path)
    np.testing.assert_equal(cast.time, np.datetime64(time, "us"))
    assert ("time unknown" in cast.notes) == (time == "NaT")
    assert read_cast(path, time="2001-02-03T04:05").time == np.datetime64("2001-02-03T04:05")
    as_stored(cast)


def test_places_in_comments_and_columns(tmp_path, as_stored):
    cast = read_cast(write(tmp_path, "# latitude: 33.5 S, longitude: 18.25W\n" + PLAIN))
    assert (cast.lat, cast.lon) == (-33.5, -18.25)
    rows = table(depth=Z, temperature=T, salinity=S, lat=25.0, lon=-99.0, time="2020-01-01")
    assert read_cast(write(tmp_path, rows)).lon == -99.0  # no fill value
    as_stored(cast)


REFUSED = {
    "depth,temperature\n0,1\n9,1\n": "no salinity; the columns are depth, temperature",
    "temperature,salinity\n1,30\n1,30\n": "no depth or pressure; the columns are temperature,"
                                          " salinity",
    "depth,sound_speed\n0,1500\n9,1500\n": "no temperature; .*sound speed alone it is a profile"
                                           " for rays, not a cast",
    "depth,temperature,salinity\n0,1,30\n9,one,30\n": r"cast.csv, line 4: temperature is 'one'; it"
                                                      r" must be a number",
    "depth,temperature,salinity\n0,1,30\n": "1 usable levels; a cast needs at least 2",
    "depth,temperature,salinity\n-9,1,30\n-1,1,30\n": "depth is -9 to -1 m; it must be positive"
                                                      " down",
    "depth,temperature_degR,salinity\n0,1,30\n": "no temperature; the columns are depth,"
                                                 " temperature_degR",
    "depth,temperature [degR],salinity\n0,1,30\n":
        r"unit of column 'temperature \[degR\]' is unknown; write temperature in degC",
    "depth,temperature,t,salinity\n0,1,1,30\n": "columns 'temperature' and 't' are both"
                                                " temperature; remove one",
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), REFUSED.items(), ids=range(len(REFUSED)))
def test_bad_tables_are_refused_in_one_line(tmp_path, text, message):
    refused(
        OceanError, message, read_cast, write(tmp_path, "# lat 74, lon -140, 2014-07-24\n" + text)
    )


@pytest.mark.parametrize(("content", "message"), [
    (PLAIN.encode(), "no place; give lat and lon, add columns of these names, or a comment"),
    (b"\x80\x04\x95\0pickle", "a binary file, not a text table"),
])  # fmt: skip
def test_a_file_without_a_place_or_a_table_is_refused(tmp_path, content, message):
    (tmp_path / "cast.csv").write_bytes(content)
    refused(OceanError, message, read_cast, tmp_path / "cast.csv")


@pytest.mark.parametrize(("path", "message"), [
    ("/dev/zero", "not a regular file"), ("a\0b.csv", "embedded null"),
])  # fmt: skip
def test_what_is_no_ordinary_file_is_refused_before_it_is_read(path, message):
    refused(OceanError, message, read_cast, path)


def test_a_place_that_is_none_is_refused(tmp_path):
    refused(
        OceanError,
        "latitude must be in -90 to 90",
        read_cast,
        write(tmp_path, PLAIN),
        lat=100.0,
        lon=0.0,
    )


def test_a_cast_colder_than_its_freezing_point_says_so(tmp_path, shared_data):
    """
    Water of 25.9 freezes at -1.40 degC; the shipped cast of March 2020 has -1.53 degC at its first
    levels.
    """
    path = tmp_path / "cold.csv"
    path.write_text(
        "# lat 71.2 lon -142.4\ndepth,temperature,salinity\n2,-1.53,25.9\n4,-1.3,25.9\n60,-1.5,31\n"
    )
    (note,) = read_cast(path).notes[1:]
    assert note.startswith("1 of 3 levels too cold to be liquid, up to 0.1")
    assert "K below freezing at 2 m: salinity or temperature is too low" in note
    march = shared_data / "casts" / "beaufort_xctd_icex20_1.csv"
    cold = read_cast(march).notes[-1]
    assert cold.startswith(
        "25 of 1056 levels too cold to be liquid, up to 0.12 K below freezing at 2.466 m"
    )
    assert read_profile(march).notes == (cold,)


def test_the_subset_services_packed_point_table_is_unpacked(shared_data, as_stored):
    path = shared_data / "hycom" / "hycom_glby_930_20210308T12_beaufort_point_ncss.csv"
    cast = read_cast(path)
    raw = pd.read_csv(path).to_numpy()[:, 3:].astype(float)
    wet = raw[:, 1] != -30_000.0
    np.testing.assert_array_equal(cast.depth, raw[wet, 0])
    np.testing.assert_allclose(cast.salinity, raw[wet, 1] / 1000.0 + 20.0, rtol=0, atol=1e-12)
    assert cast.temperature[0] == pytest.approx(-1.623)
    assert (cast.lat, cast.lon, cast.time) == (
        72.3642,
        -150.4196,
        np.datetime64("2021-03-08T12:00"),
    )
    assert cast.dropped == np.count_nonzero(~wet) == 2
    as_stored(cast)


def test_an_unpacked_point_table_stays_as_it_is(tmp_path):
    text = 'time,latitude[unit="degrees_north"],longitude[unit="degrees_east"],vertCoord[unit="m"],'
    text += 'salinity[unit="psu"],water_temp[unit="degC"]\n'
    for time in ("2021-03-08T12:00:00Z", "2021-03-08T15:00:00Z"):
        text += "".join(
            f"{time},72.36,-150.42,{z},{s},{t}\n" for z, t, s in zip(Z, T, S, strict=True)
        )
    casts = read_casts(write(tmp_path, text))
    assert [c.time for c in casts] == [
        np.datetime64("2021-03-08T12:00"),
        np.datetime64("2021-03-08T15:00"),
    ]
    np.testing.assert_array_equal(casts[1].salinity, S)


@settings(max_examples=30)
@given(
    st.binary(max_size=300)
    | st.text(alphabet='depth,tmpraus\n;0123456789.-#" \t', max_size=300).map(str.encode)
)
def test_any_bytes_give_a_cast_or_one_line(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("fuzz") / "cast.csv"
    path.write_bytes(b"# lat 74, lon -140\ndepth,temperature,salinity\n" + content)
    message = ""
    try:
        cast = read_cast(path)
    except OceanError as error:
        message = str(error)
    assert "\n" not in message
    assert message or np.all(np.diff(cast.depth) > 0.0)


@settings(max_examples=25)
@given(
    st.lists(
        st.floats(0.0, 4000.0).map(lambda z: round(z, 2)), min_size=2, max_size=20, unique=True
    ),
    st.randoms(use_true_random=False),
)
def test_means_over_cells_keep_the_water_column(depths, random):
    """The integral of a profile over depth is that of its cell means times the cells."""
    z = np.sort(np.array(depths))
    t = np.array([random.uniform(-1.0, 5.0) for _ in depths])
    cast = Cast("x", 0.0, 0.0, np.datetime64("2020-01-01"), z, t, np.full(z.size, 35.0))
    levels = np.linspace(z[0], z[-1] + 1.0, 7)
    means, salinity = cast.cell_means(levels)
    edges = np.concatenate([levels[:1], 0.5 * (levels[1:] + levels[:-1]), levels[-1:]])
    fine = np.union1d(np.union1d(edges, z), levels)
    exact = np.trapezoid(np.interp(fine, z, t), fine)
    assert np.sum(means * np.diff(edges)) == pytest.approx(exact, rel=1e-9, abs=1e-6)
    assert t.min() - 1e-9 <= means.min() <= means.max() <= t.max() + 1e-9
    np.testing.assert_allclose(salinity, 35.0, rtol=0, atol=1e-9)


SAMPLES = np.arange(5.0, 301.0, 1.0)
INSTANT = np.datetime64("2014-07-24T19:20")
LINEAR = Cast(
    "linear", 74.0, -140.0, INSTANT, SAMPLES, 2.0 - 0.01 * SAMPLES, 30.0 + 0.01 * SAMPLES, 320.0
)


def history(ocean):
    return ocean.attrs["history"].splitlines()


def speed(ocean):
    return ocean_sound_speed(ocean)[:, 0, 0]


def test_the_ocean_is_the_cast_everywhere_and_at_rest(as_stored):
    ocean = cast_ocean(LINEAR, bathymetry=300.0, half_extent=(20e3, 30e3))
    validate_ocean(ocean)
    z = ocean["depth"].values
    assert z[-1] == 300.0
    inside = (z > 8.0) & (
        z < 299.0
    )  # cells wholly within the samples: a linear profile is kept exactly
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
    as_stored(ocean)


@pytest.mark.parametrize("lat", [0.0, -45.0, 78.0, 85.0])
@pytest.mark.parametrize("lon", [10.0, 179.9])
def test_the_window_holds_the_asked_rectangle_about_the_cast(lat, lon, as_stored):
    ocean = cast_ocean(
        replace(LINEAR, lat=lat, lon=lon), bathymetry=300.0, half_extent=(40e3, 90e3)
    )
    local = to_local(ocean, half_extent=(40e3, 90e3))
    assert local.attrs["centre_latitude_deg"] == pytest.approx(lat, abs=1e-9)
    assert (local.attrs["centre_longitude_deg"] - lon + 180.0) % 360.0 == pytest.approx(
        180.0, abs=1e-9
    )
    # "uniform" to some mm/s: pressure at a depth and the composition of sea water depend on the
    # place
    assert np.ptp(local["sound_speed"].values, axis=(0, 1)).max() < 0.02
    np.testing.assert_array_equal(local["sea_floor_depth"], 300.0)
    as_stored(local)


def test_the_change_by_averaging_is_told_and_right(shared_data, as_stored):
    cast = read_cast(shared_data / "casts" / "beaufort_axctd_20140724_74N140W.csv")
    found = {}
    for step in (2.0, 5.0, 10.0):
        ocean = cast_ocean(cast, bathymetry=1000.0, levels=np.arange(0.0, 1001.0, step))
        line = next(line for line in history(ocean) if "averaged onto" in line)
        rms, most = map(float, re.findall(r"by ([\d.]+) m/s rms, ([\d.]+) m/s maximum", line)[0])
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
    as_stored(cast)


@pytest.mark.parametrize("name", [
    "beaufort_axctd_20140724_74N140W", "beaufort_axctd_20140724_75N140W", "beaufort_xctd_icex20_1",
])  # fmt: skip
def test_the_default_levels_keep_the_warm_layer_and_the_duct_beneath(shared_data, name, as_stored):
    cast = read_cast(shared_data / "casts" / f"{name}.csv")
    ocean = cast_ocean(cast, bathymetry=1000.0)
    z, c = ocean["depth"].values, speed(ocean)
    raw = cast.sound_speed()
    for low, high, pick in ((40.0, 65.0, np.argmax), (95.0, 160.0, np.argmin)):
        here, there = (z >= low) & (z <= high), (cast.depth >= low) & (cast.depth <= high)
        i, j = pick(c[here]), pick(raw[there])
        assert c[here][i] == pytest.approx(raw[there][j], abs=0.3)
        assert z[here][i] == pytest.approx(cast.depth[there][j], abs=8.0)
    assert 1444.0 < c[(z >= 40.0) & (z <= 65.0)].max() < 1448.0
    rms = float(re.findall(r"by ([\d.]+) m/s rms", "\n".join(history(ocean)))[0])
    assert rms < 0.06
    as_stored(cast)


def test_below_the_samples_water_is_held_constant_or_another_casts():
    told = "extended from {} m down to the bottom at 1000 m at constant temperature and salinity"
    held = cast_ocean(LINEAR, bathymetry=1000.0, below="constant")
    assert told.format(300) in history(held)
    deep = held["depth"].values > 320.0
    np.testing.assert_allclose(held["water_temp"].values[deep], -1.0, rtol=0, atol=1e-12)
    assert np.all(np.diff(speed(held)[deep]) > 0.0)  # pressure alone
    other = Cast(
        "deep", 75.0, -144.0, LINEAR.time, [0.0, 400.0, 900.0], [1.0, 0.5, -0.5], [30.0, 34.0, 34.9]
    )
    joined = cast_ocean(LINEAR, bathymetry=1000.0, below=other)
    at_600 = float(joined["water_temp"].interp(depth=600.0)[0, 0])
    assert at_600 == pytest.approx(0.5 - 0.4, abs=1e-6)
    assert any("m from cast deep" in line for line in history(joined))
    assert told.format(900) in history(joined)


def test_the_surface_is_extended_at_constant_water_and_that_is_told(as_stored):
    ocean = cast_ocean(LINEAR, bathymetry=300.0, levels=[0.0, 2.0, 4.0, 100.0, 200.0])
    np.testing.assert_allclose(ocean["water_temp"].values[:2], 1.95, rtol=0, atol=1e-12)
    assert "extended from 5 m up to the surface at constant temperature and salinity" in history(
        ocean
    )
    assert "level added at the bottom, 300 m" in history(ocean)
    as_stored(ocean)


def test_the_casts_own_bottom_and_a_given_time_serve():
    assert cast_ocean(LINEAR, below="constant")["depth"].values[-1] == 320.0
    dated = cast_ocean(replace(LINEAR, **NAMELESS), bathymetry=300.0, time="2001-01-01")
    assert dated["time"].values == np.datetime64("2001-01-01")


NAMELESS = {"bottom_depth": float("nan"), "time": np.datetime64("NaT", "us")}
SHORT = Cast("short", 75.0, -144.0, LINEAR.time, [0.0, 200.0], [1.0, 0.5], [30.0, 34.0])
NO_BED = r"it must be deeper than the first sample \(5 m\)"


@pytest.mark.parametrize(("change", "options", "message"), [
    ({}, {"bathymetry": 1000.0}, ("sample at 300 m is above the bottom at 1000 m; give a bottom"
                                 " depth of 300 m, or the water below")),
    ({}, {"bathymetry": 1000.0, "below": SHORT},
     "ends at 200 m, which is not below the end of linear at 300 m"),
    (NAMELESS, {"bathymetry": None}, NO_BED), (NAMELESS, {"bathymetry": 4.0}, NO_BED),
    (NAMELESS, {"bathymetry": 1e9}, NO_BED), 
    (NAMELESS, {"time": "9999-01-01"}, "allowed: 1678 to 2261"),
    ({"lat": 89.9}, {}, "extends over the pole"),
    ({}, {"levels": [5.0, 10.0]}, "levels must strictly increase from 0 m"),
])  # fmt: skip
def test_what_makes_no_ocean_is_refused_with_the_remedy(change, options, message):
    refused(
        OceanError,
        message,
        cast_ocean,
        replace(LINEAR, **change),
        **{"bathymetry": 300.0} | options,
    )


@pytest.mark.parametrize("bottom", [1.0, 2.5, 3.0, 99.0, 101.0, 512.3, 3761.0, 11_000.0])
def test_levels_rise_from_the_surface_to_the_bottom(bottom):
    z = cast_levels(bottom)
    assert z[0] == 0.0
    assert z[-1] == bottom
    assert np.all(np.diff(z) > 0.0)
    assert np.diff(z).max() <= max(150.0, bottom if bottom < 5.0 else 0.0)


def test_every_real_cast_makes_an_ocean_for_rays(shared_data, as_stored):
    files = sorted((shared_data / "casts").glob("*.csv")) + sorted(
        (shared_data / "hycom").glob("*.csv")
    )
    assert len(files) == 10
    for path in files:
        cast = read_cast(path)
        if path.parent.name == "casts":
            rows = pd.read_csv(path, comment="#")
            np.testing.assert_array_equal(cast.temperature, rows["temperature_degC"])
            if "pressure_dbar" in rows:
                expected = -gsw.z_from_p(rows["pressure_dbar"].to_numpy(), cast.lat)
                np.testing.assert_allclose(cast.depth, expected, rtol=0, atol=1e-9)
            assert 70.0 < cast.lat < 80.0
            assert not np.isnat(cast.time)
        ocean = cast_ocean(cast, bathymetry=float(np.floor(cast.depth[-1])), half_extent=(6e3, 6e3))
        medium = Medium.from_dataset(to_local(ocean))
        np.testing.assert_allclose(medium.sound_speed[0, 0], speed(ocean), rtol=0, atol=0.01)
        assert medium.bed.depth.min() == ocean["depth"].values[-1]
    as_stored(cast)


def test_a_cast_without_time_makes_an_ocean_without_time(as_stored):
    ocean = cast_ocean(replace(LINEAR, time=np.datetime64("NaT", "us")), bathymetry=300.0)
    assert np.isnat(ocean["time"].values)
    as_stored(ocean)


def test_a_date_that_does_not_exist_is_a_note(tmp_path, as_stored):
    dated = table(depth=Z, temperature=T, salinity=S, time="2018-13-45")
    undated = table(depth=Z, temperature=T, salinity=S)
    for text in (f"# lat 74, lon -140\n{dated}", f"# 2018-13-45 lat 74, lon -140\n{undated}"):
        cast = read_cast(write(tmp_path, text))
        assert np.isnat(cast.time)
        assert any(
            "'2018-13-45'" in note and "not read; time unknown" in note for note in cast.notes
        )
        if text == f"# lat 74, lon -140\n{dated}":  # a column, not a comment
            assert any("'2018-13-45' (line 3)" in note for note in cast.notes), cast.notes
    as_stored(cast)


@pytest.mark.parametrize("bad", ["30,0.2", "30,abc,30.1", "30,0.2,30.1,30,0.2", '"30,0.2,30.1'])
def test_unreadable_rows_of_a_cast_are_listed_and_left_out(tmp_path, bad, as_stored):
    lines = (HEAD + PLAIN).splitlines()
    path = write(tmp_path, "\n".join([*lines[:4], bad, *lines[4:]]) + "\n")
    cast = read_cast(path)
    np.testing.assert_array_equal(cast.depth, Z)
    np.testing.assert_array_equal(cast.temperature, T)
    assert cast.notes[0].startswith(f"{path}: 1 line left out, not readable: line 5: ")
    profile = read_profile(path)
    np.testing.assert_array_equal(profile.depth, Z)
    assert "1 line left out" in profile.notes[0]
    as_stored(cast)
