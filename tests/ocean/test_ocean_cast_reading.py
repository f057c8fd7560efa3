"""Tables of casts: columns, units, places, times, and what is left out and counted."""

import os

import gsw
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pymantaray.errors import OceanError
from pymantaray.ocean.casts import read_cast, read_casts

Z = np.array([0.0, 10.0, 55.0, 120.0, 400.0])
T = np.array([-1.2, -1.3, 0.4, -1.4, 0.6])
S = np.array([27.0, 27.5, 30.7, 32.5, 34.8])
HEAD = "# AXCTD drop 9, 2014-07-24/1920 UTC, lat 73.9883, lon -139.9500; bottom 3700 m\n"


def table(**columns):
    return pd.DataFrame(columns).to_csv(index=False, float_format="%.17g")


def write(folder, text, name="cast.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_plain_table_is_read_as_it_stands(tmp_path):
    cast = read_cast(write(tmp_path, HEAD + table(depth_m=Z, temperature_degC=T, practical_salinity=S)))
    for found, expected in ((cast.depth, Z), (cast.temperature, T), (cast.salinity, S)):
        np.testing.assert_array_equal(found, expected)
    assert (cast.lat, cast.lon, cast.bottom_depth) == (73.9883, -139.95, 3700.0)
    assert cast.time == np.datetime64("2014-07-24T19:20")
    assert (cast.name, cast.dropped, cast.notes) == ("cast", 0, ())
    assert not cast.depth.flags.writeable


@pytest.mark.parametrize("header", [
    "DEPTH,TEMP,SAL", "Depth [m],Temperature (°C),Salinity [psu]", "depth;water_temp;psal",
    "depth_m\ttemperature_degC\tpractical_salinity", "z temperature salinity",
    'vertCoord[unit="m"],water_temp[unit="degC"],salinity[unit="psu"]',
])  # fmt: skip
def test_names_units_and_separators_of_many_programs(tmp_path, header):
    separator = next((s for s in ",;\t" if s in header), " ")
    rows = "\n".join(separator.join(map(repr, map(float, row))) for row in zip(Z, T, S, strict=True))
    cast = read_cast(write(tmp_path, f"{header}\n{rows}\n"), lat=74.0, lon=-140.0, time="2014-07-24")
    np.testing.assert_array_equal(cast.temperature, T)
    np.testing.assert_array_equal(cast.depth, Z)


def test_pressure_kelvin_potential_and_absolute_are_converted_by_teos_10(tmp_path):
    p = gsw.p_from_z(-Z, 74.0)
    SA = gsw.SA_from_SP(S, p, -140.0, 74.0)
    place = {"lat": np.full(5, 74.0), "lon": np.full(5, -140.0), "time": ["2014-07-24T12:00:00Z"] * 5}
    variants = {
        "dbar": {"pressure_dbar": p, "temperature": T, "salinity": S},
        "kpa": {"pressure [kPa]": 10.0 * p, "temperature [K]": T + 273.15, "salinity": S},
        "potential": {"depth": Z, "theta": gsw.pt0_from_t(SA, T, p), "salinity": S},
        "conservative": {"depth": Z, "conservative_temperature": gsw.CT_from_t(SA, T, p), "psal": S},
        "absolute": {"pres": p, "temp": T, "absolute_salinity_g/kg": SA},
    }
    for name, columns in variants.items():
        cast = read_cast(write(tmp_path, table(**columns, **place), f"{name}.csv"))
        np.testing.assert_allclose(cast.depth, Z, rtol=0, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(cast.temperature, T, rtol=0, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(cast.salinity, S, rtol=0, atol=1e-9, err_msg=name)
        assert cast.time == np.datetime64("2014-07-24T12:00")


def test_rows_that_cannot_be_used_are_dropped_and_counted(tmp_path):
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
        "2 of 9 rows with a missing value dropped",
        "1 of 9 rows with an impossible value dropped",
        "1 of 9 rows above the surface dropped",
        "2 of 9 rows no deeper than one before dropped",
    )


def test_bottles_written_from_the_bottom_up_are_turned_round(tmp_path):
    cast = read_cast(write(tmp_path, HEAD + table(depth=Z[::-1], temperature=T[::-1], salinity=S[::-1])))
    np.testing.assert_array_equal(cast.temperature, T)
    assert cast.notes == ("written from the bottom up: turned round",)


def test_a_table_of_stations_holds_a_cast_for_each(tmp_path):
    frame = {"station": np.repeat([30, 41], 5), "depth": np.tile(Z, 2), "salinity": np.tile(S, 2)}
    frame |= {"temperature": np.concatenate([T, T + 1.0]), "lat": np.repeat([77.5, 78.5], 5), "lon": 1.0}
    path = write(tmp_path, table(**frame, time="1982-03-09"))
    casts = read_casts([path])
    assert [(c.name, c.lat) for c in casts] == [("30", 77.5), ("41", 78.5)]
    np.testing.assert_array_equal(casts[1].temperature, T + 1.0)
    np.testing.assert_array_equal(read_cast(path, name="41").temperature, T + 1.0)
    with pytest.raises(OceanError, match=r"holds 2 casts \(30, 41\); choose one by its name"):
        read_cast(path)


@pytest.mark.parametrize(("comment", "time"), [
    ("1997-10-12, lat", "1997-10-12T00:00"), ("2014-07-24/1920 UTC", "2014-07-24T19:20"),
    ("2014-07-24T19:20:30Z", "2014-07-24T19:20:30"), ("2014-07-24 07:05", "2014-07-24T07:05"),
    ("2014-07-24 1000 m", "2014-07-24T00:00"), ("March 2020", "2020-03-01T00:00"), ("no date", None),
])  # fmt: skip
def test_times_in_comments(tmp_path, comment, time):
    cast = read_cast(
        write(tmp_path, f"# {comment} lat 74, lon -140\n" + table(depth=Z, temperature=T, salinity=S))
    )
    if time is None:
        assert np.isnat(cast.time)
        assert cast.notes == ("time unknown",)
    else:
        assert cast.time == np.datetime64(time)
    given_time = read_cast(tmp_path / "cast.csv", time="2001-02-03T04:05")
    assert given_time.time == np.datetime64("2001-02-03T04:05")


def test_hemispheres_in_comments(tmp_path):
    text = "# latitude: 33.5 S, longitude: 18.25W\n" + table(depth=Z, temperature=T, salinity=S)
    cast = read_cast(write(tmp_path, text))
    assert (cast.lat, cast.lon) == (-33.5, -18.25)


def test_minus_99_is_a_longitude(tmp_path):
    path = write(tmp_path, table(depth=Z, temperature=T, salinity=S, lat=25.0, lon=-99.0, time="2020-01-01"))
    assert read_cast(path).lon == -99.0


REFUSED = {
    "depth,temperature\n0,1\n9,1\n": "lacks salinity; found depth, temperature",
    "temperature,salinity\n1,30\n1,30\n": "lacks depth or pressure; found temperature, salinity",
    "depth,sound_speed\n0,1500\n9,1500\n": "lacks temperature; .*sound speed alone makes a profile for rays, no cast",
    "depth,temperature,salinity\n0,1,30\n9,one,30\n": r"cast.csv, line 4: temperature needs a number; it is 'one'",
    "depth,temperature,salinity\n0,1,30\n9,1,30,7\n": "line 4: 4 cells under a header of 3",
    "depth,temperature,salinity\n0,1,30\n": "1 usable levels; a cast needs at least 2",
    "depth,temperature,salinity\n-9,1,30\n-1,1,30\n": "depth is negative in most rows; it must be positive down",
    "depth_fathom,temperature_degF,salinity\n0,1,30\n": "lacks temperature; found",
    "depth,temperature [degF],salinity\n0,1,30\n": r"unit of column 'temperature \[degF\]' is unknown; write temperature in degC",
    "depth,temperature,t,salinity\n0,1,1,30\n": "columns 'temperature' and 't' are both temperature; keep one",
    "depth,temperature,salinity\n": "needs a header with names of columns, and rows",
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), REFUSED.items(), ids=range(len(REFUSED)))
def test_bad_tables_are_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(OceanError, match=message) as caught:
        read_cast(write(tmp_path, "# lat 74, lon -140, 2014-07-24\n" + text))
    assert "\n" not in str(caught.value)


def test_a_cast_without_a_place_or_a_file_is_refused(tmp_path):
    path = write(tmp_path, table(depth=Z, temperature=T, salinity=S))
    with pytest.raises(OceanError, match="no place; give lat and lon, columns of these names, or a comment"):
        read_cast(path)
    with pytest.raises(OceanError, match="cannot be read: No such file"):
        read_cast(tmp_path / "none.csv")
    (tmp_path / "binary.csv").write_bytes(b"\x80\x04\x95\0pickle")
    with pytest.raises(OceanError, match="not a table of text"):
        read_cast(tmp_path / "binary.csv")
    with pytest.raises(OceanError, match="latitude lies in -90 to 90"):
        read_cast(path, lat=100.0, lon=0.0)


def test_the_subset_services_packed_point_table_is_unpacked(shared_data):
    path = shared_data / "hycom" / "hycom_glby_930_20210308T12_beaufort_point_ncss.csv"
    cast = read_cast(path)
    raw = pd.read_csv(path).to_numpy()[:, 3:].astype(float)
    wet = raw[:, 1] != -30_000.0
    np.testing.assert_array_equal(cast.depth, raw[wet, 0])
    np.testing.assert_allclose(cast.salinity, raw[wet, 1] / 1000.0 + 20.0, rtol=0, atol=1e-12)
    assert cast.temperature[0] == pytest.approx(-1.623)
    assert (cast.lat, cast.lon, cast.time) == (72.3642, -150.4196, np.datetime64("2021-03-08T12:00"))
    assert cast.dropped == np.count_nonzero(~wet) == 2


def test_an_unpacked_point_table_stays_as_it_is(tmp_path):
    text = 'time,latitude[unit="degrees_north"],longitude[unit="degrees_east"],vertCoord[unit="m"],'
    text += 'salinity[unit="psu"],water_temp[unit="degC"]\n'
    for time in ("2021-03-08T12:00:00Z", "2021-03-08T15:00:00Z"):
        text += "".join(f"{time},72.36,-150.42,{z},{s},{t}\n" for z, t, s in zip(Z, T, S, strict=True))
    casts = read_casts(write(tmp_path, text))
    assert [c.time for c in casts] == [np.datetime64("2021-03-08T12:00"), np.datetime64("2021-03-08T15:00")]
    np.testing.assert_array_equal(casts[1].salinity, S)


def test_every_real_cast_is_read_whole(shared_data):
    files = sorted((shared_data / "casts").glob("*.csv"))
    assert len(files) == 9
    for path in files:
        cast = read_cast(path)
        rows = pd.read_csv(path, comment="#")
        assert cast.depth.size == len(rows)
        np.testing.assert_array_equal(cast.temperature, rows["temperature_degC"])
        if "pressure_dbar" in rows:
            expected = -gsw.z_from_p(rows["pressure_dbar"].to_numpy(), cast.lat)
            np.testing.assert_allclose(cast.depth, expected, rtol=0, atol=1e-9)
        assert 70.0 < cast.lat < 80.0
        assert not np.isnat(cast.time)


@settings(max_examples=60, deadline=None)
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


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.floats(0.0, 4000.0).map(lambda z: round(z, 2)), min_size=2, max_size=20, unique=True),
    st.randoms(use_true_random=False),
)
def test_means_over_cells_keep_the_water_column(depths, random):
    """The integral of a profile over depth is that of its cell means times the cells."""
    from pymantaray.ocean.casts import Cast

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


def test_what_is_no_ordinary_file_is_refused_before_it_is_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in ("/dev/zero", tmp_path / "pipe", tmp_path):
        with pytest.raises(OceanError, match="not an ordinary file"):
            read_cast(path)
    with pytest.raises(OceanError, match="embedded null"):
        read_cast("a\0b.csv")
    with pytest.raises(OceanError, match="cannot be read: No such file"):
        read_cast(os.fsdecode(b"caf\xe9.csv"))
    with (tmp_path / "huge.csv").open("wb") as file:
        file.truncate(200_000_001)
    with pytest.raises(OceanError, match="more than 200,000,000 bytes; no table"):
        read_cast(tmp_path / "huge.csv")


def test_a_cast_is_shown_in_a_line(tmp_path):
    cast = read_cast(write(tmp_path, HEAD + table(depth_m=Z, temperature_degC=T, practical_salinity=S)))
    assert repr(cast) == "Cast('cast', 73.9883 N -139.95 E, 2014-07-24T19:20, 5 levels from 0 to 400 m)"
