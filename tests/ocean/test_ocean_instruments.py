"""
Files of the grammar that instruments write, made here from one column of water, and what every
reader of casts makes of them.
"""

import gsw
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings, strategies as st
from refusals import refused

from pymantaray.acoustics import Medium, read_profile, read_profiles, write_asvp, write_profiles
from pymantaray.errors import MantaRayError, OceanError
from pymantaray.ocean import holds_casts, read_cast, read_casts
from pymantaray.ocean.instrument_table import written_date

LAT, LON = 74.5, -140.25
TIME = np.datetime64("2014-07-24T19:20:00")
PRESSURE = np.arange(1.0, 202.0, 5.0)
DEPTH = -gsw.z_from_p(PRESSURE, LAT)
TEMPERATURE = -1.2 + 0.004 * PRESSURE
SALINITY = 29.0 + 0.025 * PRESSURE
_SA = gsw.SA_from_SP(SALINITY, PRESSURE, LON, LAT)
SPEED = gsw.sound_speed(_SA, gsw.CT_from_t(_SA, TEMPERATURE, PRESSURE), PRESSURE)
LEVELS = list(zip(PRESSURE, DEPTH, TEMPERATURE, SALINITY, SPEED, strict=True))


def sea_bird(*, rows=LEVELS, flags=None, extra=(), touching=False):
    names = ["prDM: Pressure, Digiquartz [db]", "t090C: Temperature [ITS-90, deg C]",
             "t190C: Temperature, 2 [ITS-90, deg C]",
             "sal00: Salinity, Practical [PSU]",
             "svCM: Sound Velocity [Chen-Millero, m/s]", "flag:  0.000e+00"]  # fmt: skip
    flags = ["0.0000e+00"] * len(rows) if flags is None else flags
    lines = [f"{p:11.3f}{t:11.4f}{t + 1:11.4f}{s:11.4f}{c:11.2f}{flag:>11}"
             for (p, _, t, s, c), flag in zip(rows, flags, strict=True)]  # fmt: skip
    return "\n".join([
        "* Sea-Bird SBE 9 Data File:",
        "* FileName = C:\\cast.hex", "* System UpLoad Time = Jul 25 2014 00:00:01",
        "* NMEA Latitude = 74 30.00 N",
        "* NMEA Longitude = 140 15.00 W", "* NMEA UTC (Time) = Jul 24 2014  19:20:00",
        "# nquan = 6", f"# nvalues = {len(rows)}",
        *(f"# name {k} = {name}" for k, name in enumerate(names)),
        "# start_time = Jul 24 2014 19:21:07 [Instrument's time stamp]",
        "# bad_flag = -9.990e-29", "# file_type = ascii",
        *extra, "*END*", *lines, "",
    ])  # fmt: skip


def sippican(kind="XBT"):
    columns = {
        "XBT": ("Depth (m)", "Temperature (°C)", "Sound Velocity (m/s)"),
        "XCTD": ("Depth (m)", "Temperature (°C)", "Conductivity (mS/cm)", "Salinity (ppt)",
                 "Sound Velocity (m/s)", "Density (kg/m^3)"),
    }[kind]  # fmt: skip
    rows = {
        "XBT": [(z, t, c) for _, z, t, _, c in LEVELS],
        "XCTD": [(z, t, 25.0, s, c, 1025.0) for _, z, t, s, c in LEVELS],
    }[kind]
    assumed = (
        ["// Sound velocity derived with assumed salinity: 34.00 ppt"] if kind == "XBT" else []
    )
    return "\n".join([
        "// MK21 EXPORT DATA FILE",
        "Date of Launch:  07/24/2014", "Time of Launch:  19:20:00", "Sequence #    :  7",
        "Latitude      :  74 30.00000N", "Longitude     :  140 15.00000W",
        "Serial #      :  00000000", "Probe Type    :  T-5",
        *(f"Field{k}  :  {name}" for k, name in enumerate(columns, 1)), *assumed, "// Data", *(
            "\t".join(f"{v:.4f}" for v in row) for row in rows), "",
    ])  # fmt: skip


def sippican_mk12():
    """As the manual of the Simrad ME70 has it."""
    return "\n".join([
        "// This is a MK12 EXPORT DATA FILE (EDF)", "//", "Date of Launch : 07/24/2014",
        "Time of Launch : 19:20:00", "Sequence # : 1",
        "Latitude : 74 30.000N", "Longitude : 140 15.000W",
        "Serial # : 0", "//", "Probe Type : T-7", "Terminal Depth : 760 m",
        "Depth Coeff. 1 : 6.691",
        "//", "Display Units : Metric", "//", "// Sound velocity derived with assumed",
        "// salinity: 30.00 ppt", "//", "Depth (m) - Temperature (°C) - Sound Velocity (m/s)",
        *(f"{z:.4f} {t:.4f} {c:.4f}" for _, z, t, _, c in LEVELS), "",
    ])  # fmt: skip


def sippican_xctd():
    """As the same manual has it, without sound speed."""
    head, _ = sippican_mk12().split("Depth (m) - ")
    rows = (f"{z:.4f} {t:.4f} {s:.4f}" for _, z, t, s, _ in LEVELS)
    return "\n".join(
        [
            head + "Depth (m)  Temp (°C)  Salinity (0/00)",
            "   (m)        (C)          (PPT)",
            *rows,
            "",
        ]
    )


def kongsberg():
    head = (
        f"( SoundVelocity  1.0 0 201407241920 {LAT:.8f} {LON:.8f} -1 0 0 OMS01_00000 P"
        f" {len(LEVELS):04d} )"
    )
    return "\n".join([head, *(f"{z:.4f} {c:.4f}" for _, z, _, _, c in LEVELS), ""])


def castaway():
    head = ["% Device,CC1234", "% File name,CC1234_1", "% Cast time (UTC),2014-07-24 19:20:00",
            "% Cast time (local),2014-07-24 12:20:00",
            f"% Start latitude,{LAT}", f"% Start longitude,{LON}", "%"]  # fmt: skip
    titles = ("Pressure (Decibar),Depth (Meter),Temperature (Celsius),Conductivity (MicroSiemens"
              " per Centimeter),Specific conductance (MicroSiemens per Centimeter),Salinity"
              " (Practical Salinity Scale),Sound velocity (Meters per Second),Density (Kilograms"
              " per Cubic Meter)")  # fmt: skip
    return "\n".join(
        [*head, titles, *(f"{p},{z},{t},25000,31000,{s},{c},1025" for p, z, t, s, c in LEVELS), ""]
    )


def valeport():
    return "\n".join([
        "[HEADER]", "Instrument=SWiFT CTD",
        "Serial_Number=12345", f"Latitude={LAT}", f"Longitude={LON}",
        "Time_Stamp=2014/07/24 19:20:00.000", "[DATA]",
        "Time\tDepth\tPressure\tSound Velocity\tTemperature\tSalinity", "\tm\tdBar\tm/s\tC\tPSU",
        *(f"2014/07/24 19:20:00\t{z}\t{p}\t{c}\t{t}\t{s}" for p, z, t, s, c in LEVELS), "",
    ])  # fmt: skip


def midas():
    return "\n".join([
        "Previous File Location :\tC:\\x",
        "Model Name :\tMIDAS SVX2", "Time Stamp :\t24/07/2014 19:20:00",
        f"Latitude :\t{LAT}", f"Longitude :\t{LON}",
        ("Date / Time\tSOUND"
        " VELOCITY;M/SEC\tPRESSURE;DBAR\tTEMPERATURE;C\tCONDUCTIVITY;MS/CM\tCalc. SALINITY;PSU"),
        *(f"24/07/2014 19:20:00\t{c}\t{p}\t{t}\t25\t{s}" for p, _, t, s, c in LEVELS), "",
    ])  # fmt: skip


def mini_svp():
    return "\n".join([
        "Now: 24/07/2014 19:20:00", "MiniSVP: S/N 12345",
        "Latitude: 74.5", "Site info: north", "Pressure units: dBar",
        *(f"{p}\t{t}\t{c}" for p, _, t, _, c in LEVELS), "",
    ])  # fmt: skip


def aml():
    return "\n".join([
        "[Header]", "SerialNumber=12345", "Date=2014-07-24", "Time=19:20:00.00",
        f"GPSLatitude={LAT}", f"GPSLongitude={LON}",
        "[MeasurementMetadata]", "Columns=Date,Time,Cond,TempCT,Pressure,Depth,SV,Salinity",
        "Units=,,mS/cm,C,dBar,m,m/s,PSU",
        "[MeasurementData]",
        *(f"2014-07-24,19:20:00.00,25,{t},{p},{z},{c},{s}" for p, z, t, s, c in LEVELS), "",
    ])  # fmt: skip


def aml_csv():
    return "\n".join([
        "[cast header]", "SN=12345", "Date=07/24/14", "Time=19:20:00", f"Latitude={LAT}",
        f"Longitude={LON}", "[data]",
        "Date,Time,Depth (m),Temperature (C),SV (m/s),Salinity (PSU),Calc. SV (m/s)",
        *(f"07/24/14,19:20:00,{z},{t},{c},{s},{c + 9}" for p, z, t, s, c in LEVELS), "",
    ])  # fmt: skip


def rbr(*, sea=True):
    titles = "Time,Conductivity,Temperature,Pressure,Sea pressure,Depth,Salinity,Speed of sound"
    rows = [
        f"2014-07-24 19:20:00.{k:03d},25,{t},{p + 10.1325},{p},{z},{s},{c}"
        for k, (p, z, t, s, c) in enumerate(LEVELS)
    ]
    if not sea:
        titles = "Time,Temperature,Pressure,Salinity,Speed of sound"
        rows = [
            f"2014-07-24 19:20:00.{k:03d},{t},{p + 10.1325},{s},{c}"
            for k, (p, _, t, s, c) in enumerate(LEVELS)
        ]
    return "\n".join([titles, *rows, ""])


# name: content, whether it has a salinity, its position and its time; None where the file has none
FILES = {
    "sea_bird.cnv": (sea_bird(), True, True),
    "xbt.edf": (sippican(), False, True),
    "xctd.edf": (sippican("XCTD"), True, True),
    "mk12.edf": (sippican_mk12(), False, True),
    "mk12x.edf": (sippican_xctd(), True, True),
    "profile.asvp": (kongsberg(), False, True),
    "castaway.csv": (castaway(), True, True),
    "swift.vpd": (valeport(), True, True),
    "midas.000": (midas(), True, True),
    "mini.txt": (mini_svp(), False, False),
    "x.aml": (aml(), True, True),
    "aml.csv": (aml_csv(), True, True),
    "rbr.csv": (rbr(), True, False),
    "rbr.txt": (rbr(sea=False), True, False),
}


@pytest.fixture(params=FILES)
def file(request, tmp_path):
    path = tmp_path / request.param
    path.write_text(FILES[request.param][0], encoding="latin-1")
    return path, *FILES[request.param][1:]


def test_a_profile_has_the_water_position_and_time_of_the_file(file, as_stored):
    path, _, placed = file
    profile = read_profile(path, None if placed else (LAT, LON))
    np.testing.assert_allclose(profile.depth, DEPTH, atol=2e-3)
    np.testing.assert_allclose(profile.sound_speed, SPEED, atol=6e-3)
    assert profile.place == pytest.approx((LAT, LON))
    assert profile.time == TIME
    assert holds_casts(path)
    medium = Medium.from_profile(profile.depth, profile.sound_speed, bottom_depth=300.0)
    assert medium.sound_speed.min() == pytest.approx(SPEED.min(), abs=0.01)
    as_stored(profile)


def test_a_cast_has_the_water_and_sound_speed_alone_is_refused_as_one(file, as_stored):
    path, salty, placed = file
    place = {} if placed else {"lat": LAT, "lon": LON}
    if not salty:
        refused(
            OceanError,
            "no (temperature|salinity); .*sound speed alone it is a profile",
            read_cast,
            path,
            **place,
        )
        return
    cast = read_cast(path, **place)
    np.testing.assert_allclose(cast.depth, DEPTH, atol=2e-3)
    np.testing.assert_allclose(cast.temperature, TEMPERATURE, atol=1e-4)
    np.testing.assert_allclose(cast.salinity, SALINITY, atol=1e-4)
    assert (cast.lat, cast.lon) == pytest.approx((LAT, LON))
    assert cast.time == TIME
    as_stored(cast)


def test_flags_soaks_and_upcasts_are_left_out_and_counted(tmp_path, as_stored):
    rows = [LEVELS[1], LEVELS[0], *LEVELS[2:], *LEVELS[::-1]]  # a soak, and the way up
    flags = ["0.0000e+00"] * len(rows)
    flags[5] = "-9.990e-29"
    text = sea_bird(rows=rows, flags=flags).replace(f"{LEVELS[8][2]:11.4f}", " -9.990e-29", 1)
    (tmp_path / "a.cnv").write_text(text)
    cast = read_cast(tmp_path / "a.cnv")
    kept = [k for k in range(len(LEVELS)) if k not in (0, 5, 8)]
    np.testing.assert_allclose(cast.depth, DEPTH[kept], atol=2e-3)
    for words in (
        "1 row rejected by a bad flag",
        "dropped: with a missing value",
        "dropped: not deeper than an earlier row",
    ):
        assert any(words in note for note in cast.notes), cast.notes
    as_stored(cast)


def test_temperature_of_its_68_becomes_that_of_its_90(tmp_path, as_stored):
    (tmp_path / "a.cnv").write_text(
        sea_bird().replace("t090C", "t068C").replace("ITS-90", "IPTS-68")
    )
    cast = read_cast(tmp_path / "a.cnv")
    np.testing.assert_allclose(cast.temperature, TEMPERATURE / 1.00024, atol=1e-4)
    assert any("ITS-68" in note for note in cast.notes)
    as_stored(cast)


def columns(
    tmp_path,
    *names,
    rows=((10.0, 15.0, 35.0), (100.0, 14.0, 35.0), (1000.0, 8.0, 35.0)),
    position=True,
):
    """Write a Sea-Bird file with columns of these names at 45 N, 30 W."""
    place = ["* NMEA Latitude = 45 00.00 N", "* NMEA Longitude = 030 00.00 W"] if position else []
    head = [
        "* Sea-Bird",
        *place,
        *(f"# name {k} = {name}" for k, name in enumerate(names)),
        "*END*",
    ]
    path = tmp_path / "names.cnv"
    path.write_text("\n".join([*head, *(" ".join(map(str, row)) for row in rows), ""]))
    return path


def depth_of(pressure):
    return -gsw.z_from_p(np.array(pressure), 45.0)


@pytest.mark.parametrize(("name", "depth"), [
    ("pr: pressure [db]", depth_of([10.0, 100.0, 1000.0])),
    ("pr50M: Pressure, SBE 50 [db]", depth_of([10.0, 100.0, 1000.0])),
    ("prdE: Pressure, Strain Gauge [psi]", depth_of(np.array([10.0, 100.0, 1000.0]) * 0.6894757)),
    ("prE: Pressure [psi]", depth_of(np.array([10.0, 100.0, 1000.0]) * 0.6894757)),
    ("depSF: Depth [salt water, ft]", np.array([3.048, 30.48, 304.8])),
    ("depSM: Depth [salt water, m], lat = 45", np.array([10.0, 100.0, 1000.0])),
    ("depSM: Depth [salt water, m], lat = 0.00",
     depth_of(gsw.p_from_z([-10.0, -100.0, -1000.0], 0.0))),
    ("depFM: Depth [fresh water, m], lat = 45",
     depth_of(np.array([10.0, 100.0, 1000.0]) / 1.019716)),
    ("depFF: Depth [fresh water, ft], lat = 45",
     depth_of(np.array([10.0, 100.0, 1000.0]) * 0.3048 / 1.019716)),
])  # fmt: skip
def test_every_vertical_column_of_sea_bird_gives_the_depth(tmp_path, name, depth, as_stored):
    cast = read_cast(columns(tmp_path, name, "t090C: Temperature", "sal00: Salinity"))
    np.testing.assert_allclose(cast.depth, depth, rtol=1e-6)
    as_stored(cast)


@pytest.mark.parametrize(("name", "celsius"), [
    ("t068: temperature, IPTS-68 [deg C]",
     lambda t: t / 1.00024), ("tv290C: Temperature", lambda t: t),
    ("t190F: Temperature, 2",
     lambda t: (t - 32.0) / 1.8), ("t068F: T", lambda t: (t - 32.0) / 1.8 / 1.00024),
    ("tnc90C: T", lambda t: t), ("t3890C: T", lambda t: t),
])  # fmt: skip
def test_every_temperature_of_sea_bird_becomes_celsius_of_its_90(
    tmp_path, name, celsius, as_stored
):
    rows = ((10.0, 40.0, 35.0), (100.0, 38.0, 35.0), (1000.0, 36.0, 35.0))
    cast = read_cast(columns(tmp_path, "prM: p", name, "sal00: s", rows=rows))
    np.testing.assert_allclose(cast.temperature, celsius(np.array([40.0, 38.0, 36.0])), atol=1e-9)
    as_stored(cast)


def test_conductivity_of_an_sbe_37_gives_salinity(tmp_path, as_stored):
    rows = ((10.0, 15.0, 4.29), (100.0, 14.0, 4.2), (1000.0, 8.0, 3.65))
    cast = read_cast(
        columns(tmp_path, "prM: p", "t090C: t", "cond0S/m: Conductivity [S/m]", rows=rows)
    )
    expected = gsw.SP_from_C([42.9, 42.0, 36.5], [15.0, 14.0, 8.0], [10.0, 100.0, 1000.0])
    np.testing.assert_allclose(cast.salinity, expected, rtol=1e-9)
    as_stored(cast)


def test_measured_pressure_has_priority_over_computed_depth(tmp_path, as_stored):
    names = (
        "depFM: Depth [fresh water, m]",
        "prdM: Pressure",
        "t090C: t",
        "sal00: s",
        "svCM: Sound Velocity",
    )
    rows = ((101.972, 100.0, 15.0, 35.8, 1509.3), (1019.716, 1000.0, 8.0, 35.2, 1499.0))
    path = columns(tmp_path, *names, rows=rows)
    for read in (read_cast, read_profile):
        np.testing.assert_allclose(read(path).depth, depth_of([100.0, 1000.0]), rtol=1e-9)
    path = columns(tmp_path, "depSM: Depth, lat = 0.0", *names[1:], rows=rows)
    profile = read_profile(path)
    np.testing.assert_allclose(profile.depth, depth_of([100.0, 1000.0]), rtol=1e-9)
    assert any("own depth differs by up to 30.2 m" in note for note in profile.notes)
    path = columns(tmp_path, *names, rows=rows, position=False)
    refused(MantaRayError, "needs a position", read_profile, path)
    as_stored(profile)


def test_refusals_name_the_columns_that_are_not_read(tmp_path):
    path = columns(tmp_path, "timeS: Time, Elapsed [seconds]", "tmprtr: temperature", "sal00: s")
    refused(
        OceanError,
        r"no temperature; the columns are salinity \[1\]; not read: timeS, tmprtr",
        read_cast,
        path,
    )
    refused(MantaRayError, "not read: timeS, tmprtr", read_profile, path)
    (tmp_path / "a.csv").write_text(castaway().replace("Temperature (Celsius)", "Warmth (Celsius)"))
    refused(
        OceanError,
        r"no temperature; .*not read: Warmth \(Celsius\), Specific conductance",
        read_cast,
        tmp_path / "a.csv",
    )


@pytest.mark.parametrize(
    ("maker", "text", "end"), [("AML", aml(), "[MeasurementData]"), ("Valeport", valeport(), "PSU")]
)
def test_a_file_without_rows_is_refused_with_its_maker(tmp_path, maker, text, end):
    (tmp_path / "a.txt").write_text(text.partition(end)[0] + end + "\n")
    message = f"a file of {maker} without rows that are known"
    refused(MantaRayError, message, read_profile, tmp_path / "a.txt")


def test_english_units_of_sippican_become_metric(tmp_path, as_stored):
    text = (
        sippican_mk12().split("Depth (m)")[0]
        + "Depth (ft) - Temperature (F) - Sound Velocity (ft/s)\n"
    )
    (tmp_path / "feet.edf").write_text(
        text + "0.0 80.0 5050.0\n100.0 70.0 5000.0\n1000.0 60.0 4950.0\n"
    )
    profile = read_profile(tmp_path / "feet.edf")
    np.testing.assert_allclose(profile.depth, np.array([0.0, 100.0, 1000.0]) * 0.3048)
    np.testing.assert_allclose(profile.sound_speed, np.array([5050.0, 5000.0, 4950.0]) * 0.3048)
    as_stored(profile)


@pytest.mark.parametrize(("date", "time", "note"), [
    ("28/04/2020", "2020-04-28T19:20:00", ""), ("04/28/2020", "2020-04-28T19:20:00", ""),
    ("09/04/2020", "2020-09-04T19:20:00", "the month is assumed to be first"),
    ("04/04/2020", "2020-04-04T19:20:00", ""),
    ("31/31/2020", "NaT", "not read"), ("30/02/2020", "NaT", "not read"),
    ("soon", "NaT", "not read"),
])  # fmt: skip
def test_dates_of_sippican_are_read_or_noted(tmp_path, date, time, note, as_stored):
    (tmp_path / "a.edf").write_text(
        sippican("XCTD").replace("07/24/2014", date), encoding="latin-1"
    )
    for one in (read_profile(tmp_path / "a.edf"), read_cast(tmp_path / "a.edf")):
        np.testing.assert_equal(one.time, np.datetime64(time))
        assert any(note in line for line in one.notes) if note else "month" not in str(one.notes)
    as_stored(one)


def depths_of(pressure):
    return -gsw.z_from_p(pressure, LAT)


@pytest.mark.parametrize(("text", "old", "new", "depth"), [
    (midas(), "PRESSURE;DBAR", "PRESSURE;M", PRESSURE),
    (midas(), "PRESSURE;DBAR", "DEPTH;FT", PRESSURE * 0.3048),
    (midas(), "PRESSURE;DBAR", "PRESSURE;BAR", depths_of(10.0 * PRESSURE)),
    (mini_svp(), "units: dBar", "units: Metres", PRESSURE),
    (mini_svp(), "units: dBar", "units: mbar", depths_of(0.01 * PRESSURE)),
    (aml(), "C,dBar,m", "C,psi,", depths_of(0.6894757293168 * PRESSURE)),
    (castaway(), "Pressure (Decibar),Depth (Meter)", "X,Depth (Decibar)", depths_of(DEPTH)),
    (valeport(), "\tm\tdBar", "\t\tm", PRESSURE),
])  # fmt: skip
def test_the_unit_of_a_vertical_column_says_what_it_is(tmp_path, text, old, new, depth, as_stored):
    assert old in text
    (tmp_path / "a.txt").write_text(
        text.replace(old, new).replace("Pressure,Depth,SV", "Pressure,X,SV")
        .replace("Time\tDepth", "Time\tX")
    )  # fmt: skip
    profile = read_profile(tmp_path / "a.txt", (LAT, LON))
    np.testing.assert_allclose(profile.depth, depth, rtol=1e-5, atol=1e-3)
    as_stored(profile)


@pytest.mark.parametrize(("text", "old", "new"), [
    (sea_bird(), "Jul 24 2014  19", "Jul 24 1914  19"),
    (sea_bird(), "Jul 24 2014  19", "Jul 24 14  19"),
    (midas(), "24/07/2014 ", "24/07/14 "), (mini_svp(), "24/07/2014 ", "24/07/1914 "),
    (aml(), "2014-07-24", "1914-07-24"), (sippican(), "07/24/2014", "07/24/14"),
    (valeport(), "2014/07/24 ", "24/07/14 "), (castaway(), "2014-07-24 ", "24/07/2014 "),
])  # fmt: skip
def test_years_of_two_digits_in_every_header(tmp_path, text, old, new):
    assert old in text
    (tmp_path / "a.txt").write_text(text.replace(old, new), encoding="latin-1")
    assert read_profile(tmp_path / "a.txt", (LAT, LON)).time == TIME


def test_rows_on_deck_do_not_hide_a_cast(tmp_path, as_stored):
    deck = [(-0.03, -0.03, 20.0, 0.0, 0.0)] * 60
    down = [row for row in LEVELS if row[1] > 0]
    text = aml().split("[MeasurementData]")[0] + "[MeasurementData]\n" + "".join(
        f"2014-07-24,19:20:00.00,25,{t},{p},{z},{c},{s}\n" for p, z, t, s, c in [*deck,
            *down])  # fmt: skip
    (tmp_path / "cast.aml").write_text(text)
    for one in (read_profile(tmp_path / "cast.aml"), read_cast(tmp_path / "cast.aml")):
        np.testing.assert_allclose(one.depth, [z for _, z, *_ in down], atol=2e-3)
        assert "60 of 101 rows dropped: above the surface" in one.notes
    as_stored(one)


def test_salinity_comes_from_conductivity_where_there_is_none(tmp_path, as_stored):
    conductivity = gsw.C_from_SP(SALINITY, TEMPERATURE, PRESSURE)  # mS/cm
    cnv = sea_bird(
        rows=[
            (p, z, t, c / 10.0, v) for (p, z, t, _, v), c in zip(LEVELS, conductivity, strict=True)
        ]
    )
    rows = zip(LEVELS, conductivity, strict=True)
    text = "Time,Conductivity,Temperature,Pressure,Sea pressure,Depth\n" + "".join(
        f"2014-07-24 19:20:00.000,{c},{t},{p + 10.1325},{p},{z}\n" for (p, z, t, _, _), c in rows
    )
    (tmp_path / "a.cnv").write_text(
        cnv.replace("sal00: Salinity, Practical [PSU]", "c0S/m: Conductivity [S/m]")
    )
    (tmp_path / "b.csv").write_text(text)
    for name in ("a.cnv", "b.csv"):
        cast = read_cast(tmp_path / name, lat=LAT, lon=LON)
        np.testing.assert_allclose(cast.salinity, SALINITY, atol=2e-3)  # of the digits of the file
        assert "salinity from conductivity by PSS-78" in cast.notes
    as_stored(cast)


def test_absolute_pressure_loses_that_of_the_air(tmp_path):
    (tmp_path / "a.txt").write_text(rbr(sea=False))
    assert (
        "10.1325 dbar of air pressure subtracted from the absolute pressure"
        in read_cast(tmp_path / "a.txt", lat=LAT, lon=LON).notes
    )


def test_a_database_of_rbr_is_refused_with_what_to_do(tmp_path):
    (tmp_path / "a.rsk").write_bytes(b"SQLite format 3\0" + bytes(100))
    for read in (read_cast, read_profile):
        refused(
            MantaRayError,
            r"a\.rsk: a damaged database",
            read,
            tmp_path / "a.rsk",
        )


def test_asvp_is_written_and_read_back(tmp_path):
    (tmp_path / "a.cnv").write_text(sea_bird())
    profile = read_profile(tmp_path / "a.cnv")
    write_asvp(tmp_path / "b.asvp", profile)
    lines = (tmp_path / "b.asvp").read_text().splitlines()
    assert lines[0].split() == [
        "(",
        "SoundVelocity",
        "1.0",
        "0",
        "201407241920",
        "74.50000000",
        "-140.25000000",
        "-1",
        "0",
        "0",
        "MantaRay",
        "P",
        "0043",
        ")",
    ]
    assert lines[-1].split()[0] == "12000.00"
    back = read_profile(tmp_path / "b.asvp")
    np.testing.assert_allclose(back.depth[1:-1], profile.depth, atol=5.1e-3)
    np.testing.assert_allclose(back.sound_speed[1:-1], profile.sound_speed, atol=5.1e-3)
    assert (back.place, back.time) == ((LAT, LON), TIME)
    for wrong, words in ((profile._replace(place=None), "position of a is unknown"),
                         (profile._replace(time=np.datetime64("NaT", "ns")),
                          "time of a is unknown")):  # fmt: skip
        refused(MantaRayError, words, write_asvp, tmp_path / "c.asvp", wrong)
    fine = np.arange(0.0, 200.0, 0.1)
    many = profile._replace(depth=fine, sound_speed=1440.0 + 0.1 * fine)
    refused(
        MantaRayError,
        "2001 levels; echo sounders accept at most 1000; .*thin",
        write_asvp,
        tmp_path / "c.asvp",
        many,
    )
    assert not (tmp_path / "c.asvp").exists()


def test_cf_profiles_are_written_and_read_back_as_profiles_and_casts(tmp_path):
    (tmp_path / "a.cnv").write_text(sea_bird())
    (tmp_path / "b.csv").write_text(castaway())
    one, two = (read_profile(tmp_path / name) for name in ("a.cnv", "b.csv"))
    short = two._replace(
        depth=two.depth[:9], sound_speed=two.sound_speed[:9], water=tuple(w[:9] for w in two.water)
    )
    write_profiles(tmp_path / "p.nc", [one, short])
    back = read_profiles(tmp_path / "p.nc")
    assert [p.name for p in back] == ["a", "b"]
    for p, q in zip(back, (one, short), strict=True):
        np.testing.assert_array_equal(p.depth, q.depth)
        np.testing.assert_array_equal(p.sound_speed, q.sound_speed)
        assert (p.place, p.time) == (q.place, q.time)
    casts = read_casts(tmp_path / "p.nc")
    np.testing.assert_array_equal(casts[1].salinity, short.water[1])
    assert holds_casts(tmp_path / "p.nc")
    write_profiles(tmp_path / "c.nc", [one._replace(water=None)])
    assert read_profile(tmp_path / "c.nc").water is None
    refused(OceanError, "no temperature; .*sound speed alone", read_cast, tmp_path / "c.nc")


def ragged(layout):
    """Two casts in the layouts of CF's appendix H.3."""
    n = len(LEVELS)
    columns = {"depth": DEPTH, "temperature": TEMPERATURE, "salinity": SALINITY}
    names = {
        "depth": "depth",
        "temperature": "sea_water_temperature",
        "salinity": "sea_water_practical_salinity",
    }
    units = {"depth": "m", "temperature": "degC", "salinity": "1"}
    data = xr.Dataset(attrs={"featureType": "profile"})
    for name, values in columns.items():
        data[name] = (
            "obs",
            np.concatenate([values, values[: n // 2]]),
            {"standard_name": names[name], "units": units[name]},
        )
    if layout == "contiguous":
        data["row_size"] = "profile", [n, n // 2], {"sample_dimension": "obs"}
    else:
        data["of"] = "obs", np.repeat([0, 1], [n, n // 2]), {"instance_dimension": "profile"}
    data["lat"] = "profile", [LAT, 70.0], {"standard_name": "latitude", "units": "degrees_north"}
    data["lon"] = "profile", [LON, -130.0], {"standard_name": "longitude", "units": "degrees_east"}
    data["t"] = (
        "profile",
        [0.0, 3600.0],
        {"standard_name": "time", "units": "seconds since 2014-07-24 19:20:00"},
    )
    return data


@pytest.mark.parametrize("layout", ["contiguous", "indexed"])
def test_ragged_cf_profiles_have_places_times_and_flags(tmp_path, layout):
    data = ragged(layout)
    flags = np.ones(data.sizes["obs"], dtype="i1")
    flags[3] = 4
    data["temperature"].attrs["ancillary_variables"] = "qc"
    data["qc"] = "obs", flags, {"standard_name": "sea_water_temperature status_flag"}
    data.to_netcdf(tmp_path / "r.nc")
    first, second = read_casts(tmp_path / "r.nc")
    np.testing.assert_allclose(first.temperature, np.delete(TEMPERATURE, 3))
    np.testing.assert_allclose(second.salinity, SALINITY[: len(LEVELS) // 2])
    assert (second.lat, second.lon, second.time) == (70.0, -130.0, TIME + np.timedelta64(1, "h"))
    assert "1 value of temperature rejected by quality flags" in first.notes


@given(st.sampled_from(sorted(FILES)), st.data())
@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_damaged_file_gives_a_profile_or_one_line(tmp_path, name, data):
    text = FILES[name][0]
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, len(text)))
    (tmp_path / name).write_text(
        text[:start]
        + data.draw(st.sampled_from(["", "\n", "x", "-", "(", "[data]\n"]))
        + text[end:],
        encoding="latin-1",
    )
    lines = ["one"]
    try:
        levels = read_profile(tmp_path / name, (LAT, LON)).depth.size
    except MantaRayError as error:
        levels, lines = 2, str(error).splitlines()
    assert (levels >= 2, len(lines)) == (True, 1)


@pytest.mark.parametrize(("words", "date", "notes"), [
    ("12/25/2020", "2020-12-25", 0), ("25/12/2020", "2020-12-25", 0),
    ("12/11/2020", "2020-12-11", 1),
    ("12/12/2020", "2020-12-12", 0), ("13/01/20", "2020-01-13", 0), ("soon", "", 1), ("", "", 0),
    ("2020/4/28", "2020-04-28", 0), ("2020-04-28 21:06", "2020-04-28", 0),
    ("2020.13.01", "2020-13-01", 0), ("20200428", "", 1),
])  # fmt: skip
def test_the_month_is_first_unless_it_cannot_be_one(words, date, notes):
    read, made = written_date(words)
    assert (read, len(made)) == (date, notes)
