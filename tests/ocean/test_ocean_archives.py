"""
Files of archives with many casts (Ocean Data View, World Ocean Database, EN4) and of SAIV's CTD
give the casts that were written, without values that their quality control rejects.
"""

import gsw
import netCDF4
import numpy as np
import pytest
import xarray as xr

from pymantaray import open_water
from pymantaray.acoustics import read_profiles
from pymantaray.errors import MantaRayError
from pymantaray.ocean import read_cast, read_casts

DEPTH = np.array([0.0, 10.0, 50.0, 120.0, 300.0])
PLACES = [(70.5, -150.25), (71.0, 179.5)]
TIMES = ["2014-07-24T19:20:00", "2015-01-02T03:00:00"]


def temperature(k):
    return 4.0 - k - 0.01 * DEPTH


def salinity(k):
    return 31.0 + k + 0.005 * DEPTH


def check(casts, dropped=(), tolerance=1e-6):
    """Compare two casts with what was written, without rows (cast, level)."""
    assert len(casts) == 2
    for k, cast in enumerate(casts):
        rows = [i for i in range(DEPTH.size) if (k, i) not in dropped]
        assert (cast.lat, cast.lon) == pytest.approx(PLACES[k])
        assert cast.time == np.datetime64(TIMES[k])
        np.testing.assert_allclose(cast.depth, DEPTH[rows], atol=1e-4)
        np.testing.assert_allclose(cast.temperature, temperature(k)[rows], atol=tolerance)
        np.testing.assert_allclose(cast.salinity, salinity(k)[rows], atol=tolerance)


def check_east_west(casts, dropped):
    """Compare two casts whose longitudes may be from 0 to 360 degrees."""
    for cast in casts:
        object.__setattr__(cast, "lon", (cast.lon + 180.0) % 360.0 - 180.0)
    check(casts, dropped)


def odv(path, *, iso=True, repeat=False, scheme="QV:ODV:SALINITY", bad="8"):
    """Spreadsheet of two stations; one salinity has a bad flag."""
    when = ["yyyy-mm-ddThh:mm:ss.sss"] if iso else ["mon/day/yr", "hh:mm"]
    head = [
        "Cruise", "Station", "Type", *when, "Longitude [degrees_east]", "Latitude [degrees_north]",
        "Bot. Depth [m]", "Depth [m]", "Temperature [degC]", "QV:ODV:TEMPERATURE", "Salinity [psu]",
        scheme, "Oxygen [ml/l]",
    ]  # fmt: skip
    lines = ["//<Encoding>UTF-8</Encoding>", "//ODV", "\t".join(head)]
    for k, (lat, lon) in enumerate(PLACES):
        date, clock = TIMES[k].split("T")
        year, month, day = date.split("-")
        times = [f"{date}T{clock}"] if iso else [f"{month}/{day}/{year}", clock[:5]]
        label = ["AB12", f"St{k}", "C", *times, f"{lon % 360.0}", f"{lat}", "400"]
        for i, z in enumerate(DEPTH):
            flag = bad if (k, i) == (1, 2) else "0"
            row = [f"{z}", f"{temperature(k)[i]:.6f}", "0", f"{salinity(k)[i]:.6f}", flag, ""]
            lines.append("\t".join([*(label if repeat or i == 0 else [""] * len(label)), *row]))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("iso", [True, False])
@pytest.mark.parametrize("repeat", [True, False])
def test_a_spreadsheet_of_ocean_data_view_has_its_casts(tmp_path, iso, repeat):
    casts = read_casts(odv(tmp_path / "odv.txt", iso=iso, repeat=repeat))
    assert [cast.name for cast in casts] == ["AB12/St0", "AB12/St1"]
    assert "whole file: 1 value rejected by quality flags" in casts[0].notes
    check_east_west(casts, {(1, 2)})


@pytest.mark.parametrize(
    ("temperature_code", "salinity_code"),
    [
        ("TEMPPR01 [Degrees Celsius]", "PSALPR01 [Dimensionless]"),
        ("TEMPST01 [Degrees Celsius]", "PSLTZZ01 [Dimensionless]"),
        ("CTDTMP_T_VALUE_SENSOR [deg C]", "CTDSAL_D_CONC_SENSOR [pss-78]"),
    ],
)
def test_codes_of_vocabularies_name_columns(tmp_path, temperature_code, salinity_code):
    path = odv(tmp_path / "odv.txt")
    text = path.read_text().replace("\tDepth [m]", "\tDEPHPR01 [Metres]")
    text = text.replace("Temperature [degC]", temperature_code)
    path.write_text(text.replace("Salinity [psu]", salinity_code))
    check_east_west(read_casts(path), {(1, 2)})


def test_pressure_of_seadatanet_gives_the_depth(tmp_path):
    path = odv(tmp_path / "odv.txt")
    code = "\tPRESPR01 [decibar=10000 pascals]"
    path.write_text(path.read_text().replace("\tDepth [m]", code))
    first = read_casts(path)[0]  # the second has a level with a bad flag
    np.testing.assert_allclose(first.depth, -gsw.z_from_p(DEPTH, PLACES[0][0]), atol=0.01)


def test_a_spreadsheet_may_have_commas_and_quoted_labels(tmp_path):
    path = odv(tmp_path / "odv.csv")
    label = '"Ship, leg 2"'
    text = path.read_text().replace(",", ";").replace("AB12", label).replace("\t", ",")
    path.write_text(text.replace("Station", "Station:METAVAR:INDEXED_TEXT", 1))
    casts = read_casts(path)
    assert [cast.name for cast in casts] == ["Ship, leg 2/St0", "Ship, leg 2/St1"]
    check_east_west(casts, {(1, 2)})


@pytest.mark.parametrize("line", ["a" * 300_000, '"' + "a," * 150_000])
def test_a_line_that_is_too_long_for_cells_is_refused_in_one_line(tmp_path, line):
    (tmp_path / "a.csv").write_text(line + "\n1,2,3\n")
    with pytest.raises(MantaRayError) as error:
        read_casts(tmp_path / "a.csv")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "label",
    [["AB12", "St2"], ["CD34", "St1"], ["CD34", ""], ["", "St2"]],
    ids=["station", "cruise", "cruise alone", "station alone"],
)
def test_a_new_station_has_no_place_of_the_station_before(tmp_path, label):
    path = odv(tmp_path / "odv.txt")
    rows = ["\t".join([*label, *[""] * 5, f"{z}", "1.5", "0", "33.0", "0", ""]) for z in DEPTH]
    path.write_text(path.read_text() + "\n".join(rows) + "\n")
    with pytest.raises(MantaRayError, match=rf"odv.txt, {'/'.join(filter(None, label))}: no place"):
        read_casts(path)
    casts = read_casts(path, default_place=(70.0, -140.0))
    assert (casts[2].lat, casts[2].lon) == (70.0, -140.0)
    assert np.isnat(casts[2].time)
    assert "time unknown" in casts[2].notes


@pytest.mark.parametrize(
    ("scheme", "good", "bad"),
    [
        ("QV", "01", "48"),
        ("QF:ODV", "01", "48"),
        ("QV:SEADATANET", "01268", "349"),
        ("QV:ARGO:PSAL", "0128", "349"),
        ("QV:WOCECTD", "1267", "349"),
        ("QV:WOD:Salinity", "0", "123456789"),
        ("QV:WODSTATION", "0", "1234"),
        ("QV:BODC", "BET", "KLMN"),
        ("QV:PANGAEA", "*#", "?/"),
        ("QV:ESEAS", "0125", "348"),
    ],
)
def test_flags_of_each_scheme_are_their_own(tmp_path, scheme, good, bad):
    for flag in good + bad:
        casts = read_casts(odv(tmp_path / f"{ord(flag)}.txt", scheme=scheme, bad=flag))
        assert casts[1].depth.size == (4 if flag in bad else 5), flag
        assert not any("read as those of" in note for note in casts[0].notes)


def test_flags_of_an_unknown_scheme_are_reported(tmp_path):
    casts = read_casts(odv(tmp_path / "a.txt", scheme="QV:SMHI", bad="4"))
    assert casts[1].depth.size == 4
    assert "whole file: quality flags of SMHI: read as those of SeaDataNet" in casts[0].notes


def test_flags_behind_standard_deviations_are_of_the_values(tmp_path):
    path = odv(tmp_path / "odv.txt")
    lines = [line.split("\t") for line in path.read_text().splitlines()]
    for k, line in enumerate(lines[2:]):
        line.insert(11, "STANDARD_DEV" if k == 0 else "0.01")
    path.write_text("\n".join(map("\t".join, lines)) + "\n")
    check_east_west(read_casts(path), {(1, 2)})


def test_bottles_and_a_ctd_of_one_station_are_two_casts(tmp_path):
    path = odv(tmp_path / "odv.txt")
    lines = path.read_text().splitlines()
    label = ["AB12", "St1", "B", TIMES[1], "179.5", "71.0", "400"]
    rows = [[*label, "5", "2.5", "0", "32.1", "0", ""], [*[""] * 7, "400", "0", "0", "34", "0", ""]]
    path.write_text("\n".join([*lines, *map("\t".join, rows)]) + "\n")
    casts = read_casts(path)
    assert [cast.name for cast in casts] == ["AB12/St0", "AB12/St1", "AB12/St1/B"]
    np.testing.assert_array_equal(casts[2].depth, [5.0, 400.0])
    check_east_west(casts[:2], {(1, 2)})


@pytest.mark.parametrize("clock", ["9:05", "09:05", "9:05:00", ""])
def test_hours_of_one_digit_are_hours(tmp_path, clock):
    path = odv(tmp_path / "odv.txt", iso=False)
    path.write_text(path.read_text().replace("19:20", clock))
    casts = read_casts(path)
    hours = np.timedelta64(9 * 60 + 5 if clock else 0, "m")
    assert casts[0].time == np.datetime64("2014-07-24T00:00") + hours
    note = "whole file: time of day of 1 cast unknown: 0 h assumed"
    assert (note in casts[0].notes) == (not clock)


@pytest.mark.parametrize("read", [read_casts, read_profiles])
@pytest.mark.parametrize("write", ["odv", "wod"])
def test_a_station_without_two_levels_does_not_refuse_the_others(tmp_path, read, write):
    path = {"odv": odv, "wod": wod}[write](tmp_path / "many.txt")
    whole = [one.depth.size for one in read(path)]
    lines = path.read_text().splitlines()
    if write == "odv":
        last = [i for i, line in enumerate(lines) if line.strip()][-DEPTH.size + 1 :]
    else:
        ends = [i for i, line in enumerate(lines) if line.startswith("END OF VARIABLES")]
        last = range(ends[-1] - DEPTH.size + 1, ends[-1])
    path.write_text("\n".join(line for i, line in enumerate(lines) if i not in last))
    (kept,) = read(path)
    assert kept.depth.size == whole[0]
    assert any("1 of 2 profiles dropped, the first: " in note for note in kept.notes)


def test_one_cast_of_a_spreadsheet_is_water(tmp_path):
    path = odv(tmp_path / "odv.txt")
    cast = read_cast(path, name="AB12/St0")
    assert cast.temperature[0] == pytest.approx(4.0)
    with pytest.raises(Exception, match="AB12/St1"):
        read_cast(path)


def wod(path, flag="0", profile="0"):
    """CSV of the World Ocean Database with two casts."""
    lines = []
    for k, (lat, lon) in enumerate(PLACES):
        date, clock = TIMES[k].split("T")
        year, month, day = (int(part) for part in date.split("-"))
        hours = int(clock[:2]) + int(clock[3:5]) / 60.0
        own = profile if k == 1 else "0"
        lines += [
            "#--------------------------------------------------------------------------------,",
            f"CAST                        ,,        95405{k},WOD Unique Cast Number,WOD code,",
            "NODC Cruise ID              ,,US-11003       ,,,",
            "Originators Station ID      ,,          12,,,alpha,",
            f"Latitude                    ,,         {lat},decimal degrees,,",
            f"Longitude                   ,,           {lon},decimal degrees,,",
            f"Year                        ,,           {year},,,",
            f"Month                       ,,             {month},,,",
            f"Day                         ,,             {day},,,",
            f"Time                        ,,         {hours:.4f},decimal hours (UT),,",
            "METADATA,",
            "Country                     ,,             US,NODC code,UNITED STATES",
            "VARIABLES ,Depth     ,F,O,Temperatur ,F,O,Salinity   ,F,O,Oxygen     ,F,O,",
            "UNITS     ,m         , , ,degrees C  , , ,PSS        , , ,umol/kg    , , ,",
            f"Prof-Flag ,          ,0, ,           ,0, ,           ,{own}, ,           ,0, ,",
        ]
        for i, z in enumerate(DEPTH):
            own = flag if (k, i) == (1, 2) else "0"
            lines.append(
                f"{i + 1:10d},{z:10.1f},0, ,{temperature(k)[i]:11.6f},0, ,"
                f"{salinity(k)[i]:11.6f},{own}, ,**********,0, ,"
            )
        lines += ["END OF VARIABLES SECTION,", ""]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_casts_of_the_world_ocean_database(tmp_path):
    casts = read_casts(wod(tmp_path / "ocldb.csv"))
    assert [cast.name for cast in casts] == ["954050", "954051"]
    check(casts)
    check(read_casts(wod(tmp_path / "flagged.csv", flag="3")), {(1, 2)})
    (kept,) = read_casts(wod(tmp_path / "profile.csv", profile="2"))
    assert kept.name == "954050"
    assert any("1 of 2 profiles dropped, the first: 954051: 0 usable" in n for n in kept.notes)


@pytest.mark.parametrize(
    ("hours", "clock"),
    [("23.9833", "23:59"), ("23.9967", "23:59"), ("0.0083", "00:00"), ("---*---", "00:00")],
)
def test_decimal_hours_of_the_world_ocean_database(tmp_path, hours, clock):
    path = wod(tmp_path / "ocldb.csv")
    path.write_text(path.read_text().replace("19.3333", hours))
    casts = read_casts(path)
    assert casts[0].time == np.datetime64(f"2014-07-24T{clock}")
    note = "whole file: time of day of 1 cast unknown: 0 h assumed"
    assert (note in casts[0].notes) == (hours == "---*---")


def en4(path, potential="POTM_CORRECTED", whole=None):
    """
    Profiles of EN4: depth, potential temperature and practical salinity with flags 1 and 4, and
    flags of whole profiles by name.
    """
    shape = len(PLACES), DEPTH.size
    lat, lon = (np.array(column) for column in zip(*PLACES, strict=True))
    depth = np.broadcast_to(DEPTH, shape)
    practical = np.stack([salinity(k) for k in range(2)])
    pressure = gsw.p_from_z(-depth, lat[:, None])
    absolute = gsw.SA_from_SP(practical, pressure, lon[:, None], lat[:, None])
    warmth = np.stack([temperature(k) for k in range(2)])
    theta = gsw.pt0_from_t(absolute, warmth, pressure)
    flags = np.full(shape, b"1")
    flags[1, 2] = b"4"
    since = np.datetime64("1950-01-01", "ns")
    days = [(np.datetime64(t, "ns") - since) / np.timedelta64(1, "D") for t in TIMES]
    dims = ("N_PROF", "N_LEVELS")
    data = xr.Dataset(
        {
            "DEPH_CORRECTED": (dims, depth),
            potential: (dims, theta),
            "PSAL_CORRECTED": (dims, practical),
            "LATITUDE": ("N_PROF", lat),
            "LONGITUDE": ("N_PROF", lon),
            "JULD": ("N_PROF", days, {"units": "days since 1950-01-01 00:00:00 utc"}),
            "PLATFORM_NUMBER": ("N_PROF", np.array([b"Q1", b"Q2"])),
        }
    )
    data.to_netcdf(path)
    with netCDF4.Dataset(path, "a") as file:  # letters without a dimension of their own
        for name, values in (
            ("DEPH_CORRECTED_QC", np.full(shape, b"1")),
            ("POTM_CORRECTED_QC", np.full(shape, b"1")),
            ("PSAL_CORRECTED_QC", flags),
            ("POSITION_QC", np.full(2, b"1")),
            ("JULD_QC", np.full(2, b"1")),
            *(whole or {}).items(),
        ):
            file.createVariable(name, "S1", dims[: values.ndim])[:] = values
    return path


def test_profiles_of_en4_have_in_situ_temperatures(tmp_path):
    casts = read_casts(en4(tmp_path / "EN.4.2.2.f.profiles.g10.201407.nc"))
    for cast, time in zip(casts, TIMES, strict=True):
        assert abs(cast.time - np.datetime64(time)) < np.timedelta64(1, "s")
        object.__setattr__(cast, "time", np.datetime64(time, "ns"))
    check(casts, {(1, 2)}, tolerance=1e-5)


@pytest.mark.parametrize("name", ["PROFILE_POTM_QC", "PROFILE_PSAL_QC", "PROFILE_DEPH_QC"])
def test_a_rejected_profile_of_en4_is_not_read(tmp_path, name):
    whole = {name: np.array([b"4", b"1"])}
    (cast,) = read_casts(en4(tmp_path / "EN.4.2.2.f.profiles.g10.201407.nc", whole=whole))
    assert cast.lat == pytest.approx(PLACES[1][0])
    assert any("1 of 2 profiles rejected" in note for note in cast.notes)
    good = {name: np.array([b"1", b"1"])}
    assert len(read_casts(en4(tmp_path / "good.nc", whole=good))) == 2


def saiv(path, separator="."):
    """Text of SAIV's CTD: day first, with a second series that is not read."""
    head = "Ser\tMeas\tSal.\tTemp\tF (ug/l)\tDensity\tS. vel.\tPress\tDate\tTime"
    lines = ["From file: D:\\SD204\\data.SD2", "", head]
    for series in (7, 8):
        for i, z in enumerate(DEPTH):
            values = f"{salinity(0)[i]:.6f}\t{temperature(0)[i]:.6f}\t0.1\t25.1\t1465.12\t{z:.2f}"
            values = values.replace(".", separator)
            lines.append(f"{series}\t{i + 1}\t{values}\t24/07/2014\t19:20:0{i}")
    path.write_text("\n".join(lines) + "\n")
    return path


PANGAEA = """/* DATA DESCRIPTION:
Citation:\tSomeone (2014): CTD. PANGAEA, https://doi.org/10.1594/PANGAEA.1
Event(s):\t{events}
*/
"""


@pytest.mark.parametrize("events", [1, 2])
def test_text_of_pangaea_has_its_events(tmp_path, events):
    """The place and the time of a single event are in the description only."""
    described = [
        f"P/{k} * LATITUDE: {PLACES[k][0]} * LONGITUDE: {PLACES[k][1]} * DATE/TIME: {TIMES[k]}"
        for k in range(events)
    ]
    labels = "Event\tDate/Time\tLatitude\tLongitude\t" if events > 1 else ""
    rows = [f"{labels}Depth water [m]\tTemp [°C]\tTpot [°C]\tSal\tTemp [°C]"]
    for k in range(events):
        label = f"P/{k}\t{TIMES[k]}\t{PLACES[k][0]}\t{PLACES[k][1]}\t" if events > 1 else ""
        for z, t, s in zip(DEPTH, temperature(k), salinity(k), strict=True):
            rows.append(f"{label}{z}\t{t}\t{t - 0.1}\t{s}\t99")
    rows.append("\t".join(["?"] * len(rows[1].split("\t"))))
    text = PANGAEA.format(events="\n\t".join(described)) + "\n".join(rows)
    (tmp_path / "P.tab").write_text(text, encoding="utf-8")
    casts = read_casts(tmp_path / "P.tab")
    assert [cast.name for cast in casts] == (["P/0", "P/1"] if events > 1 else ["P"])
    for k, cast in enumerate(casts):
        assert (cast.lat, cast.lon, cast.time) == (*PLACES[k], np.datetime64(TIMES[k]))
        np.testing.assert_allclose(cast.depth, DEPTH)
        np.testing.assert_allclose(cast.temperature, temperature(k))
        np.testing.assert_allclose(cast.salinity, salinity(k))
    last = len(text.splitlines())
    assert any(f"not readable: line {last}: " in note for note in casts[0].notes)


def wod_ragged(path, *, temperature_flags, salinity_profile_flags=(0, 0, 0)):
    """
    Three casts as WODselect's NetCDF: each quantity has rows of its own; the second cast has no
    salinity.
    """
    rows = {"z": [DEPTH] * 3, "Temperature": [temperature(k) for k in (0, 1, 1)]}
    rows["Salinity"] = [salinity(0), np.empty(0), salinity(1)]
    standard = {"z": "depth", "Temperature": "sea_water_temperature"}
    units = {"z": "m", "Temperature": "degree_C", "Salinity": "1"}
    reasons = "accepted range_out inversion gradient anomaly gradient+inversion range+inversion"
    data = xr.Dataset(attrs={"featureType": "Profile"})
    for name, values in rows.items():
        of, dim = standard.get(name, "sea_water_salinity"), f"{name}_obs"
        flags = np.zeros(sum(map(len, values)), dtype="i1")
        if name == "Temperature":
            flags[: len(temperature_flags)] = temperature_flags
        meanings = {"flag_values": np.arange(7, dtype="i1"), "flag_meanings": reasons}
        linked = f"{name}_sigfigs {name}_WODflag {name}_WODprofileflag"
        data[name] = dim, np.concatenate(values), {"standard_name": of, "units": units[name]}
        data[name].attrs["ancillary_variables"] = linked
        data[f"{name}_sigfigs"] = dim, np.full(flags.size, 4, dtype="i1")
        data[f"{name}_WODflag"] = dim, flags, meanings
        data[f"{name}_row_size"] = "casts", [len(v) for v in values], {"sample_dimension": dim}
    whole = np.array(salinity_profile_flags, dtype="i1")
    meanings |= {"flag_meanings": "accepted annual_sd_out density_inversion cruise a b c"}
    data["Salinity_WODprofileflag"] = "casts", whole, meanings
    lat, lon = np.transpose([PLACES[k] for k in (0, 1, 1)])
    data["lat"] = "casts", lat, {"standard_name": "latitude", "units": "degrees_north"}
    data["lon"] = "casts", lon, {"standard_name": "longitude", "units": "degrees_east"}
    epoch = np.datetime64("1770-01-01", "s")
    days = [(np.datetime64(TIMES[k], "s") - epoch) / np.timedelta64(1, "D") for k in (0, 1, 1)]
    data["time"] = "casts", days, {"standard_name": "time", "units": "days since 1770-01-01"}
    data["wod_unique_cast"] = "casts", [11, 12, 13], {"cf_role": "profile_id"}
    data.to_netcdf(path)
    return path


@pytest.mark.parametrize("flag", range(1, 7))
def test_ragged_casts_of_the_world_ocean_database(tmp_path, flag):
    """Each of its flags but 0 is a reason to reject."""
    casts = read_casts(wod_ragged(tmp_path / "wod.nc", temperature_flags=[0, flag]))
    check(casts, dropped={(0, 1)}, tolerance=1e-9)
    assert [cast.name for cast in casts] == ["11", "13"]
    assert "1 value of Temperature rejected by quality flags" in casts[0].notes
    assert any("1 of 3 profiles dropped, the first: 12" in note for note in casts[0].notes)


def test_a_profile_that_the_world_ocean_database_rejects_is_left_out(tmp_path):
    path = wod_ragged(tmp_path / "w.nc", temperature_flags=[], salinity_profile_flags=(0, 0, 3))
    casts = read_casts(path)
    assert [cast.name for cast in casts] == ["11"]
    assert "Salinity of 1 profile rejected by quality flags" in casts[0].notes


@pytest.mark.parametrize(
    ("flags", "meanings", "dropped"),
    [
        ("48 49 50 51 52 57", "none good_value probably_good_value probably_bad_value bad_value"
         + " missing_value", (3, 4, 5)),
        ("1 2 3 4 9 8", "PASS NOT_EVALUATED SUSPECT FAIL MISSING interpolated", (2, 3, 4)),
        ("0 1 2 3 4 9", "unknown good changed estimated interpolated missing", (5,)),
        ("0 1 2 3 4 9", "no_error not_suspect a_failure bad_data none missing", (2, 3, 5)),
        ("0 1 2 3 4 9", "", (3, 4, 5)),
    ],
    ids=["SeaDataNet", "QARTOD", "own", "denials", "without meanings"],
)  # fmt: skip
def test_flags_are_rejected_by_their_meanings(tmp_path, flags, meanings, dropped):
    values = np.array(flags.split(), dtype="i1")
    depth = 10.0 * np.arange(1, 7)
    attrs = {"flag_values": values, "flag_meanings": meanings} if meanings else {}
    kinds = {"depth": "m", "sea_water_temperature": "degC", "sea_water_practical_salinity": "1"}
    columns = (depth, 5.0 - 0.01 * depth, 35.0 + 0.0 * depth)
    data = xr.Dataset(
        {
            name: ("z", column, {"standard_name": name, "units": unit})
            for (name, unit), column in zip(kinds.items(), columns, strict=True)
        },
        attrs={"featureType": "profile"},
    )
    data["sea_water_temperature"].attrs["ancillary_variables"] = "TEMPPR01_SEADATANET_QC"
    data["TEMPPR01_SEADATANET_QC"] = "z", values, attrs
    data.to_netcdf(tmp_path / "sdn.nc")
    cast = read_cast(tmp_path / "sdn.nc", lat=70.0, lon=0.0)
    np.testing.assert_allclose(cast.depth, np.delete(depth, dropped))


def go_ship(path, *, stations=("1", "1"), scale="ITS-90"):
    """CF/netCDF of CCHDO: pressure, flags, a salinity of bottles before that of the CTD."""
    both = "N_PROF", "N_LEVELS"
    lat, lon = np.transpose(PLACES)
    pressure = gsw.p_from_z(-DEPTH, lat[:, None])
    water = [temperature(0), temperature(1)]
    bottles = np.full(pressure.shape, np.nan)
    bottles[0, :2] = 30.0
    flags = np.full(pressure.shape, 2, dtype="i1")
    flags[0, 2], flags[1, 1] = 4, 9
    data = xr.Dataset(
        {
            "expocode": ("N_PROF", np.array(["33RR2007"] * 2, dtype="S8")),
            "station": ("N_PROF", np.array(stations, dtype="S3")),
            "cast": ("N_PROF", np.array([1, 2], dtype="i4")),
            "bottle_salinity": (both, bottles, {"standard_name": "sea_water_practical_salinity"}),
            "ctd_salinity": (both, [salinity(0), salinity(1)], {"units": "1"}),
            "ctd_salinity_qc": (both, flags, {"standard_name": "status_flag"}),
            "ctd_temperature": (both, water, {"units": "degC", "reference_scale": scale}),
        },
        coords={
            "pressure": (both, pressure, {"units": "dbar", "positive": "down", "axis": "Z"}),
            "latitude": ("N_PROF", lat, {"standard_name": "latitude", "units": "degrees_north"}),
            "longitude": ("N_PROF", lon, {"standard_name": "longitude", "units": "degrees_east"}),
            "time": ("N_PROF", np.array(TIMES, dtype="M8[ns]"), {"standard_name": "time"}),
        },
        attrs={"Conventions": "CF-1.8 CCHDO-1.0", "featureType": "profile"},
    )
    data["ctd_salinity"].attrs["ancillary_variables"] = "ctd_salinity_qc"
    for name, standard in (
        ("pressure", "sea_water_pressure"),
        ("ctd_salinity", "sea_water_practical_salinity"),
        ("ctd_temperature", "sea_water_temperature"),
    ):
        data[name].attrs["standard_name"] = standard
    data.to_netcdf(path)
    return path


def test_casts_of_go_ship_have_station_cast_and_good_values(tmp_path):
    casts = read_casts(go_ship(tmp_path / "33RR_ctd.nc"))
    check(casts, dropped={(0, 2), (1, 1)}, tolerance=1e-9)
    assert [cast.name for cast in casts] == ["1/1", "1/2"]
    assert "2 values of ctd_salinity rejected by quality flags" in casts[0].notes


def test_old_temperatures_of_go_ship_are_converted(tmp_path):
    new, old = (
        read_casts(go_ship(tmp_path / f"{k}.nc", scale=scale))[1]
        for k, scale in enumerate(("ITS-90", "IPTS-68"))
    )
    np.testing.assert_allclose(1.00024 * old.temperature, new.temperature, rtol=1e-12)
    assert any("ITS-68 to ITS-90" in note for note in old.notes)
    assert not any("ITS-68" in note for note in new.notes)


def test_profiles_of_one_name_are_all_read(tmp_path):
    path = go_ship(tmp_path / "both.nc")
    with xr.open_dataset(path) as data:
        same = data.load().assign(cast=("N_PROF", np.array([1, 1], dtype="i4")))
    same.to_netcdf(tmp_path / "same.nc")
    casts = read_casts(tmp_path / "same.nc")
    assert [cast.name for cast in casts] == ["1/1", "1/1_1"]
    check(casts, dropped={(0, 2), (1, 1)}, tolerance=1e-9)


@pytest.mark.parametrize("separator", [".", ","])
def test_a_ctd_of_saiv_is_read_with_its_date(tmp_path, separator):
    cast = read_cast(saiv(tmp_path / "saiv.txt", separator), lat=70.5, lon=-150.25)
    assert cast.time == np.datetime64("2014-07-24T19:20:00")
    np.testing.assert_allclose(cast.temperature, temperature(0), atol=1e-6)
    np.testing.assert_allclose(cast.depth, -gsw.z_from_p(DEPTH, 70.5), atol=1e-3)
    assert any("series 7 is read" in note for note in cast.notes)


def test_water_of_archives_needs_no_option(tmp_path):
    single = tmp_path / "single.txt"
    lines = odv(tmp_path / "odv.txt").read_text().splitlines()
    single.write_text("\n".join(lines[: 3 + DEPTH.size]) + "\n")
    water = open_water(single, bathymetry=300.0)
    assert water.uniform
    assert water.name == "AB12/St0"


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"cast": "AB12/St1"}, "AB12/St1"),
        ({"cast": "St1"}, "AB12/St1"),
        ({"cast": "nearest", "centre": (70.4, -150.0)}, "AB12/St0"),
        ({"cast": "nearest", "centre": (71.2, -179.9)}, "AB12/St1"),
    ],
)
def test_one_cast_of_many_is_chosen_by_name_or_place(tmp_path, options, name):
    water = open_water(odv(tmp_path / "odv.txt"), bathymetry=300.0, **options)
    assert water.name == name


@pytest.mark.parametrize("k", [0, 1])
def test_casts_at_nearly_one_place_are_chosen_by_time(tmp_path, monkeypatch, k):
    beside = PLACES[0][0] + 0.005, PLACES[0][1]  # 560 m
    monkeypatch.setattr(f"{__name__}.PLACES", [PLACES[0], beside])
    path = odv(tmp_path / "odv.txt")
    chosen = {"cast": "nearest", "centre": PLACES[0], "time": TIMES[k]}
    assert open_water(path, bathymetry=300.0, **chosen).name == f"AB12/St{k}"


def test_a_cast_that_is_not_there_is_refused(tmp_path):
    path = odv(tmp_path / "odv.txt")
    with pytest.raises(MantaRayError, match=r"no casts are named 'x'; available: AB12/St0"):
        open_water(path, bathymetry=300.0, cast="x")
    with pytest.raises(MantaRayError, match="the nearest cast needs a `centre`"):
        open_water(path, bathymetry=300.0, cast="nearest")
    with pytest.raises(MantaRayError, match="select it by its name or place with `cast`"):
        open_water(path, bathymetry=300.0)
