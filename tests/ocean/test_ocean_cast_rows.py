"""Rows of casts: one rule for tables, instruments and data sets; dates and units of columns."""

import gsw
import numpy as np
import pytest
from refusals import refused

from pymantaray.acoustics import read_profile, write_profiles
from pymantaray.errors import AcousticsError, OceanError
from pymantaray.ocean import read_cast
from pymantaray.ocean.instrument_table import written_instant

PLACE = (44.7, 8.0)
ROWS = [(0, 15, 35), (10, 14.5, 35), (50, 14, 35), (100, 8, 35), (200, 7, 35), (400, 6, 35)]
MISSING = "1 of 7 rows dropped: with a missing value"
IMPOSSIBLE = "1 of 7 rows dropped: with an impossible value"
DECK = "3 of 9 rows dropped: in air or on deck, by salinity or sound speed"
SPIKE = "1 of 7 rows dropped: with a depth far beyond the rows before and after"


def table(rows):
    return "depth,temperature,salinity\n" + "".join(f"{z},{t},{s}\n" for z, t, s in rows)


def midas(rows):
    return "\n".join([
        "Previous File Location :\tx", "Time Stamp :\t24/07/2014 19:20:00",
        "Latitude :\t44.7", "Longitude :\t8",
        "Date / Time\tPRESSURE;M\tTEMPERATURE;C\tCalc. SALINITY;PSU",
        *(f"24/07/2014 19:20:00\t{z}\t{t}\t{s}" for z, t, s in rows), "",
    ])  # fmt: skip


def sea_bird(rows):
    return "\n".join([
        "* Sea-Bird", "# name 0 = depSM: Depth [salt water, m]", "# name 1 = t090C: T",
        "# name 2 = sal00: S", "# start_time = Oct 15 1903 11:38:38", "*END*",
        *(f"{z} {t} {s}" for z, t, s in rows), "",
    ])  # fmt: skip


def netcdf(path, rows):
    """A CF profile with these rows, as `write_profiles` writes it."""
    import xarray as xr

    plain = path.with_suffix(".csv")
    plain.write_text(table(ROWS))
    write_profiles(path, [read_profile(plain, PLACE)])
    with xr.open_dataset(path, decode_cf=False) as data:
        data = data.load().isel(z=[0] * len(rows))
    for k, name in enumerate(("depth", "temperature", "salinity")):
        data[name] = data[name].copy(data=np.array([rows], dtype=float)[:, :, k])
        data[name].attrs.pop("_FillValue", None)
    data.drop_vars("sound_speed").to_netcdf(path)


@pytest.fixture(params=["table", "midas", "sea_bird", "netcdf"])
def write(request, tmp_path):
    """Write a cast in one of the formats."""

    def one(rows):
        path = tmp_path / f"cast.{'nc' if request.param == 'netcdf' else 'txt'}"
        if request.param == "netcdf":
            netcdf(path, rows)
        else:
            path.write_text({"table": table, "midas": midas, "sea_bird": sea_bird}[request.param](
                rows))  # fmt: skip
        return path

    return one


@pytest.mark.parametrize(("added", "at", "note"), [
    ([(20, -9.99, 35)], 2, MISSING), ([(20, 14, -99)], 2, MISSING), ([(20, 14, -999)], 2, MISSING),
    ([(20, 9999, 35)], 2, MISSING), ([(20, 14, 1e10)], 2, MISSING), ([(20, 0, 0)], 2, MISSING),
    ([(-99.99, 14, 35)], 2, MISSING), ([(9999, 14, 35)], 2, MISSING),
    ([(20, 14, 77)], 2, IMPOSSIBLE), ([(20, 60, 35)], 2, IMPOSSIBLE),
    ([(0, 25, 0.02), (0.1, 25, 0.3), (0.2, 24, 0.6)], 0, DECK), ([(5000, 14, 35)], 2, SPIKE),
])  # fmt: skip
def test_one_bad_row_is_left_out_by_every_reader(write, added, at, note, as_stored):
    path = write([*ROWS[:at], *added, *ROWS[at:]])
    profile = read_profile(path, PLACE)
    z, t, s = np.transpose(ROWS).astype(float)
    np.testing.assert_allclose(profile.depth, z, atol=1e-9)
    SA = gsw.SA_from_SP(s, gsw.p_from_z(-z, PLACE[0]), PLACE[1], PLACE[0])
    expected = gsw.sound_speed_t_exact(SA, t, gsw.p_from_z(-z, PLACE[0]))
    np.testing.assert_allclose(profile.sound_speed, expected, atol=0.1)
    assert note in profile.notes
    assert read_cast(path, lat=PLACE[0], lon=PLACE[1]).dropped == len(added)
    as_stored(profile)


@pytest.mark.parametrize("factor", [1.8, 1.0])
def test_temperatures_in_another_unit_are_refused(tmp_path, factor):
    offset = 32.0 if factor > 1.0 else 273.15
    rows = [(z, round(factor * t + offset, 2), s) for z, t, s in ROWS]
    path = tmp_path / "cast.csv"
    path.write_text(table(rows))
    low, high = rows[-1][1], rows[0][1]
    message = (
        rf"cast.csv: temperature is {low:g} to {high:g}; allowed: -5 to 45 degC.*name the unit"
    )
    refused(AcousticsError, message, read_profile, path, PLACE)
    refused(OceanError, message, read_cast, path, lat=PLACE[0], lon=PLACE[1])
    path.write_text(
        path.read_text().replace("temperature", f"temperature_{'degF' if factor > 1 else 'K'}")
    )
    plain = tmp_path / "celsius.csv"
    plain.write_text(table(ROWS))
    np.testing.assert_allclose(
        read_profile(path, PLACE).sound_speed, read_profile(plain, PLACE).sound_speed, atol=0.02
    )


def test_cold_seas_in_fahrenheit_are_refused_by_their_depth(tmp_path):
    path = tmp_path / "cast.csv"
    path.write_text(table([(0, 35, 34), (100, 30, 34), (400, 33, 35), (900, 32, 35)]))
    refused(AcousticsError, "below 300 m to 25; name the unit", read_profile, path, PLACE)


def test_rows_in_air_by_sound_speed_and_its_units(tmp_path, as_stored):
    path = tmp_path / "cast.csv"
    path.write_text("depth_m,sound_speed_m_s\n0,0\n0,341\n1,1500\n60,1490\n300,1480\n")
    profile = read_profile(path)
    np.testing.assert_array_equal(profile.sound_speed, [1500.0, 1490.0, 1480.0])
    assert profile.notes == ("2 of 5 rows dropped: in air or on deck, by salinity or sound speed",)
    path.write_text("depth_ft,sound_speed_ft_s\n0,5000\n100,4900\n")
    np.testing.assert_allclose(read_profile(path).sound_speed, [1524.0, 1493.52])
    path.write_text("depth_dbar,sound_speed_km/s\n0,1.5\n1000,1.48\n")
    profile = read_profile(path, (45.0, 0.0))
    np.testing.assert_allclose(profile.depth[1], -gsw.z_from_p(1000.0, 45.0))
    np.testing.assert_allclose(profile.sound_speed, [1500.0, 1480.0])
    path.write_text("depth,sound_speed\n0,5000\n100,4900\n")
    message = "sound_speed is 4900 to 5000; allowed: 1300 to 1800 m/s; name the unit"
    refused(AcousticsError, message, read_profile, path)
    as_stored(profile)


def test_fresh_water_is_read_and_kg_per_kg_is_doubted(tmp_path, as_stored):
    path = tmp_path / "lake.csv"
    path.write_text(table([(0, 20, 0.05), (10, 15, 0.06), (50, 5, 0.06)]))
    profile = read_profile(path, PLACE)
    assert profile.depth.size == 3
    assert profile.notes == ()
    path.write_text(table([(0, 20, 0.035), (10, 15, 0.036), (50, 5, 0.036)]))
    assert any("kg/kg" in note for note in read_profile(path, PLACE).notes)
    as_stored(profile)


def test_water_beside_a_sound_speed_is_possible_or_not_used(tmp_path, as_stored):
    path = tmp_path / "cast.csv"
    path.write_text("depth,temperature,salinity,sound_speed\n0,59,35,1500\n9,57,35,1499\n")
    profile = read_profile(path)
    assert profile.water is None
    assert "temperature is 57 to 59, which is impossible" in profile.notes[0]
    as_stored(profile)


@pytest.mark.parametrize(("words", "day_first", "instant", "note"), [
    ("Oct 15 1903 11:38:38", False, "2003-10-15T11:38:38", "read as of 2003"),
    ("Aug 05 2003", False, "2003-08-05", ""), ("05-AUG-03 1:02", False, "2003-08-05T01:02:00", ""),
    ("5/10/03", False, "2003-05-10", "month is assumed"),
    ("5/10/03 10:11", True, "2003-10-05T10:11:00", "day is assumed"),
    ("12.10.2003", False, "2003-10-12", "day is assumed"), ("07/24/99", True, "1999-07-24", ""),
])  # fmt: skip
def test_years_of_two_digits_and_the_order_of_numbers(words, day_first, instant, note):
    read, notes = written_instant(words, day_first=day_first)
    assert read == instant
    assert (note in str(notes)) if note else not notes


def test_ambiguous_dates_of_columns_and_headers_are_noted(tmp_path, as_stored):
    path = tmp_path / "cast.csv"
    for date, month, note in (("05/10/03", "05-10", "month is assumed"), ("15/10/03", "10-15", "")):
        path.write_text(f"time,{table(ROWS)}".replace("\n", f"\n{date} 10:11,", len(ROWS)))
        cast = read_cast(path, lat=44.7, lon=8.0)
        assert cast.time == np.datetime64(f"2003-{month}T10:11")
        assert note in str(cast.notes)
    path.write_text(sea_bird(ROWS))
    assert read_profile(path, PLACE).time == np.datetime64("2003-10-15T11:38:38")
    as_stored(cast)


@pytest.mark.parametrize("header", [
    "depth_m,sound_speed_m_s", "depth_m,sound_speed_m_per_s", "depth [m],sound speed [m/s]",
    "depth_m,temperature_degC,practical_salinity", "depth [m],temperature [degC],salinity [1]",
])  # fmt: skip
def test_columns_that_mantaray_writes_are_read(tmp_path, header, as_stored):
    """Those of ray files, `ocean show --json`, `convert-cast` and the casts of the examples."""
    speed = "speed" in header
    rows = [(0, 1500), (100, 1490)] if speed else [(0, 15, 35), (100, 14, 35)]
    path = tmp_path / "own.csv"
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows), ""]))
    profile = read_profile(path, PLACE)
    np.testing.assert_array_equal(profile.depth, [0.0, 100.0])
    if speed:
        np.testing.assert_array_equal(profile.sound_speed, [1500.0, 1490.0])
    else:
        np.testing.assert_array_equal(profile.water[0], [15.0, 14.0])
    as_stored(profile)
