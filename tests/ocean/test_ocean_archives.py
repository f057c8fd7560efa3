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
    assert "1 values rejected by quality flags" in casts[0].notes
    for cast in casts:
        object.__setattr__(cast, "lon", (cast.lon + 180.0) % 360.0 - 180.0)
    check(casts, {(1, 2)})


def test_flags_of_other_schemes_are_their_own(tmp_path):
    casts = read_casts(odv(tmp_path / "a.txt", scheme="QV:SEADATANET", bad="8"))
    assert casts[1].depth.size == 5
    casts = read_casts(odv(tmp_path / "b.txt", scheme="QV:SEADATANET", bad="4"))
    assert casts[1].depth.size == 4


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
    with pytest.raises(Exception, match="954051"):
        read_casts(wod(tmp_path / "profile.csv", profile="2"))


def en4(path, potential="POTM_CORRECTED"):
    """Profiles of EN4: depth, potential temperature and practical salinity with flags 1 and 4."""
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
        ):
            file.createVariable(name, "S1", dims[: values.ndim])[:] = values
    return path


def test_profiles_of_en4_have_in_situ_temperatures(tmp_path):
    casts = read_casts(en4(tmp_path / "EN.4.2.2.f.profiles.g10.201407.nc"))
    for cast, time in zip(casts, TIMES, strict=True):
        assert abs(cast.time - np.datetime64(time)) < np.timedelta64(1, "s")
        object.__setattr__(cast, "time", np.datetime64(time, "ns"))
    check(casts, {(1, 2)}, tolerance=1e-5)


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
