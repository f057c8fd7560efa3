"""
WHP-exchange, ice-tethered profilers, in-situ profiles of Copernicus, and folders and archives of
casts; depths by gsw.
"""

import zipfile

import gsw
import numpy as np
import pytest
import xarray as xr
from refusals import refused

from pymantaray.acoustics import read_profile, read_profiles
from pymantaray.errors import AcousticsError, MantaRayError, OceanError
from pymantaray.ocean import cast_folders, cast_ocean, holds_casts, read_cast, read_casts

PRESSURE = np.array([3.0, 100.0, 500.0, 1000.0])
TEMPERATURE = np.array([2.5, 1.2, 0.6, -0.4])
SALINITY = np.array([31.5, 34.1, 34.8, 34.9])
LAT, LON = 77.884, -145.0856


def depth(pressure, lat=LAT):
    return -gsw.z_from_p(np.asarray(pressure), lat)


def whp(*, unit="ITS-90", flag="2", letter="W", end="END_DATA\n", time="TIME = 0755\n"):
    names = [f"{name},{name}_FLAG_{letter}" for name in ("CTDPRS", "CTDTMP", "CTDSAL", "CTDOXY")]
    lines = [f"{p:9.1f},2,{t:9.4f},{flag if p == 500.0 else '2'},{s:9.4f},2,   -999.0,9"
             for p, t, s in zip(PRESSURE, TEMPERATURE, SALINITY, strict=True)]  # fmt: skip
    return ("CTD,20240805EXAMPLE\n# a comment = 3\nNUMBER_HEADERS = 10\nEXPOCODE = 00XX\nSTNNBR ="
            f" 25\nCASTNO = 1\nDATE = 20240805\n{time}"
            f"LATITUDE =   {LAT}\nLONGITUDE =  {LON}\nDEPTH =  1200\n"
            + ",".join(names) + f",\nDBAR,,{unit},,PSS-78,,UMOL/KG,,\n"
            + "\n".join(lines) + f"\n{end}")  # fmt: skip


def test_a_ctd_file_of_whp_exchange_is_a_cast(tmp_path, as_stored):
    (tmp_path / "a_ct1.csv").write_text(whp())
    cast = read_cast(tmp_path / "a_ct1.csv")
    np.testing.assert_allclose(cast.depth, depth(PRESSURE))
    np.testing.assert_array_equal(cast.temperature, TEMPERATURE)
    np.testing.assert_array_equal(cast.salinity, SALINITY)
    assert (cast.lat, cast.lon, cast.bottom_depth) == (LAT, LON, 1200.0)
    assert cast.time == np.datetime64("2024-08-05T07:55")
    assert cast_ocean(cast, below="constant")["depth"].values[-1] == 1200.0
    (tmp_path / "a_ct1.csv").write_text(whp(time="", end=""))
    cast = read_cast(tmp_path / "a_ct1.csv")
    assert cast.time == np.datetime64("2024-08-05")
    assert {"time of day unknown: 0 h assumed", "no END_DATA: the file may be incomplete"} <= set(
        cast.notes
    )
    as_stored(cast)


@pytest.mark.parametrize(("letter", "flag", "kept"), [
    ("W", "2", 4), ("W", "1", 4), ("W", "3", 3), ("W", "4", 3), ("W", "5", 3), ("W", "6", 4),
    ("W", "9", 3),
    ("I", "1", 4), ("I", "5", 4), ("I", "3", 3), ("I", "4", 3), ("I", "9", 3),
])  # fmt: skip
def test_bad_flags_of_whp_exchange_drop_the_level(tmp_path, letter, flag, kept, as_stored):
    (tmp_path / "a_ct1.csv").write_text(whp(flag=flag, letter=letter))
    cast = read_cast(tmp_path / "a_ct1.csv")
    assert cast.depth.size == kept
    assert ("1 value rejected by quality flags" in cast.notes) == (kept == 3)
    as_stored(cast)


def test_temperatures_of_whp_exchange_become_its_90(tmp_path):
    (tmp_path / "a_ct1.csv").write_text(whp(unit="IPTS-68"))
    np.testing.assert_allclose(read_cast(tmp_path / "a_ct1.csv").temperature, TEMPERATURE / 1.00024)


def bottles(*, unit="ITS-90", end="END_DATA\n", bad=()):
    """
    Two casts, the second from the bottom up; ``bad`` lists rows of the first whose salinity of the
    CTD is flagged.
    """
    head = (
        "EXPOCODE,SECT_ID,STNNBR,CASTNO,SAMPNO,BTLNBR,BTLNBR_FLAG_W,DATE,TIME,LATITUDE,LONGITUDE,DEPTH,CTDPRS,CTDTMP,"
        "CTDSAL,CTDSAL_FLAG_W,SALNTY,SALNTY_FLAG_W"
    )
    rows = []
    for cast, order in ((1, slice(None)), (2, slice(None, None, -1))):
        for k, (p, t, s) in enumerate(
            zip(PRESSURE[order], TEMPERATURE[order], SALINITY[order], strict=True)
        ):
            flag = 4 if cast == 1 and k in bad else 2
            rows.append(
                f"  33RR2007,   I8S,     {cast},  1,     {k},     {k},2,2024080{cast},"
                f" 755,{LAT:9.4f}, {LON + cast:9.4f},  450, {p:8.1f}, {t:8.4f},"
                f"  {s:8.4f},{flag},{s + 0.001:9.4f},{2 if k else 9}"
            )
    lines = [
        "BOTTLE,20071011WHPSIODBK",
        "#code : hyd_to_exchange.pl",
        head,
        f",,,,,,,,,,,,DBAR,{unit},PSS-78,,PSS-78,",
        *rows,
    ]
    return "\n".join(lines) + f"\n{end}"


def test_bottles_of_whp_exchange_are_casts(tmp_path, as_stored):
    path = tmp_path / "a_hy1.csv"
    path.write_text(bottles())
    casts = read_casts(path)
    assert [cast.name for cast in casts] == ["1/1", "2/1"]
    for k, cast in enumerate(casts, 1):
        np.testing.assert_allclose(cast.depth, depth(PRESSURE))
        np.testing.assert_array_equal(cast.temperature, TEMPERATURE)
        np.testing.assert_array_equal(cast.salinity, SALINITY)
        assert (cast.lat, cast.lon) == pytest.approx((LAT, LON + k), abs=1e-4)
        assert cast.time == np.datetime64(f"2024-08-0{k}T07:55")
    assert len(read_profiles(path)) == 2
    as_stored(cast)


def test_flags_of_bottles_choose_the_salinity(tmp_path, as_stored):
    """The CTD's salinity is bad in two rows; the bottle of the first of them has no value."""
    path = tmp_path / "a_hy1.csv"
    path.write_text(bottles(bad=(0, 2), unit="IPTS-68", end=""))
    cast = read_casts(path)[0]
    np.testing.assert_allclose(cast.depth, depth(PRESSURE[1:]))
    np.testing.assert_allclose(cast.temperature, TEMPERATURE[1:] / 1.00024)
    np.testing.assert_allclose(
        cast.salinity, [SALINITY[1], SALINITY[2] + 0.001, SALINITY[3]], rtol=0, atol=1e-9
    )
    notes = " ".join(cast.notes)
    assert "salinity of 1 bottle, where the CTD has none" in notes
    assert "no END_DATA" in notes
    as_stored(cast)


def test_bottles_without_pressure_or_with_truncated_lines(tmp_path, as_stored):
    path = tmp_path / "a_hy1.csv"
    path.write_text(bottles().replace("CTDPRS", "REVPRS"))
    refused(OceanError, "a_hy1.csv: a WHP-exchange file without a column CTDPRS", read_casts, path)
    lines = bottles().splitlines()
    path.write_text("\n".join([*lines[:5], lines[5][:60], *lines[6:]]))
    cast = read_casts(path)[0]
    assert cast.depth.size == PRESSURE.size - 1
    assert "1 line left out, not readable: line 6" in " ".join(cast.notes)
    as_stored(cast)


def itp(profile=0, *, newer=True, levels=None, end="%endofdat\n", rising=False, year=2016):
    rows = [
        f"{p:g}    {t:.4f}   {s:.4f}  280.8654"
        for p, t, s in zip(PRESSURE, TEMPERATURE, SALINITY, strict=True)
    ]
    rows[2] = rows[2].replace("0.6000", "   NaN")
    if newer:
        rows = [f"{year}  275.9{k}843  {row}" for k, row in enumerate(rows)]
    names = (
        "year day " if newer else ""
    ) + "pressure(dbar) temperature(C) salinity oxygen(umol/kg)"
    return (f"%ITP 99, profile {profile}: year day longitude(E+) latitude(N+) ndepths\n"
            f"{year}  275.75000  {LON}  {LAT} "
            f" {levels or len(rows)}{' 0' if newer else ''}\n%{names}\n"
            + "\n".join(rows[::-1] if rising else rows) + f"\n{end}")  # fmt: skip


@pytest.mark.parametrize("newer", [True, False])
@pytest.mark.parametrize("rising", [True, False])
def test_a_profile_of_an_ice_tethered_profiler_is_a_cast(tmp_path, newer, rising, as_stored):
    path = tmp_path / "itp99grd0000.dat"
    path.write_text(itp(newer=newer, rising=rising))
    cast = read_cast(path)
    kept = [0, 1, 3]
    np.testing.assert_allclose(cast.depth, depth(PRESSURE[kept]))
    np.testing.assert_allclose(cast.temperature, TEMPERATURE[kept])
    np.testing.assert_allclose(cast.salinity, SALINITY[kept])
    assert (cast.name, cast.lat, cast.lon) == ("itp99grd0000", LAT, LON)
    assert cast.time == np.datetime64(
        "2016-10-01T18:00"
    )  # day 275 of a leap year, day 1 is 1 January
    assert "1 of 4 rows dropped: with a missing value" in cast.notes
    profile = read_profile(path)
    sa = gsw.SA_from_SP(SALINITY[kept], PRESSURE[kept], LON, LAT)
    speed = gsw.sound_speed(
        sa, gsw.CT_from_t(sa, TEMPERATURE[kept], PRESSURE[kept]), PRESSURE[kept]
    )
    np.testing.assert_allclose(profile.sound_speed, speed, atol=1e-3)
    as_stored(cast)


def test_incomplete_profiles_of_a_profiler_are_noted_or_refused(tmp_path):
    path = tmp_path / "itp99grd0000.dat"
    path.write_text(itp(levels=371, end=""))
    assert (
        "4 levels, but the header states 371: the file may be incomplete" in read_cast(path).notes
    )
    path.write_text(itp(levels=2))
    assert "4 levels, but the header states 2: the file may be incomplete" in read_cast(path).notes
    text = itp(levels=5, end="")
    path.write_text(
        text + text.splitlines()[-1][:33] + "\n"
    )  # a fifth row that is cut after its temperature
    assert "4 levels, but the header states 5: the file may be incomplete" in read_cast(path).notes
    path.write_text(itp(year=0))
    assert np.isnat(read_cast(path).time)
    for text in (itp().splitlines()[0], itp().replace("2016  275.75", "% 2016  275.75")):
        path.write_text(text + "\n")
        refused(MantaRayError, "itp99grd0000.dat: ", read_cast, path)


def test_folders_and_archives_of_profiles_are_many_casts(tmp_path):
    folder = tmp_path / "itp99"
    folder.mkdir()
    for k in range(5):
        (folder / f"itp99grd{k:04d}.dat").write_text(itp(k))
    (folder / "itp99grd0005.dat").write_text(itp(5).splitlines()[0])
    (folder / "readme.txt").write_text("Profiles of ITP 99.\n")
    with zipfile.ZipFile(tmp_path / "itp99.zip", "w") as archive:
        for file in folder.iterdir():
            archive.write(file, f"itp99grddata/{file.name}")
    for source in (folder, tmp_path / "itp99.zip"):
        assert holds_casts(source)
        casts = read_casts(source)
        assert [cast.name for cast in casts] == [f"itp99grd{k:04d}" for k in range(5)]
        assert (
            casts[4]
            .notes[-1]
            .startswith(f"2 of 7 files of {source.name} dropped, the first: itp99grd0005.dat: ")
        )
        assert read_cast(source, name="itp99grd0003").name == "itp99grd0003"
        refused(
            OceanError,
            "contains 5 casts .itp99grd0000, .*; select one by its name",
            read_cast,
            source,
        )
        assert len(read_profiles(source)) == 5
        refused(AcousticsError, "contains 5 casts", read_profile, source)
    with zipfile.ZipFile(tmp_path / "none.zip", "w") as archive:
        archive.writestr("a.txt", "nothing\n")
    refused(
        OceanError,
        "none.zip: none of 1 file has a cast; a.txt: ",
        read_casts,
        tmp_path / "none.zip",
    )
    (tmp_path / "cut.zip").write_bytes((tmp_path / "itp99.zip").read_bytes()[:300])
    refused(OceanError, "cut.zip: not a readable ZIP archive", read_casts, tmp_path / "cut.zip")


def test_an_archive_may_have_equal_names_and_links_lead_nowhere(tmp_path):
    path = tmp_path / "casts.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for k in range(2):
            archive.writestr(f"leg{k}/itp99grd0000.dat", itp(k, year=2016 + k))
        archive.writestr("__MACOSX/leg0/._itp99grd0000.dat", "resource fork")
        link = zipfile.ZipInfo("link.dat")
        link.external_attr = 0o120777 << 16
        archive.writestr(link, "/etc/hostname")
    casts = read_casts(path)
    assert [str(cast.time)[:4] for cast in casts] == ["2016", "2017"]
    assert not any("dropped, the first" in note for cast in casts for note in cast.notes)


@pytest.mark.parametrize(
    ("limit", "value", "message"),
    [
        ("_MAX_FILES", 2, ("3 files|more than 2")),
        ("_MAX_UNPACKED", 1000, "the limits are .* and 1e-06 GB; unpack a part"),
        ("MAX_BYTES", 300, "itp2.dat has more than 300 bytes|itp0.dat has more than 300 bytes"),
    ],
)
def test_folders_and_archives_have_limits(tmp_path, monkeypatch, limit, value, message):
    folder = tmp_path / "casts"
    folder.mkdir()
    with zipfile.ZipFile(tmp_path / "casts.zip", "w") as archive:
        for k in range(3):
            (folder / f"itp{k}.dat").write_text(itp(k))
            archive.write(folder / f"itp{k}.dat", f"itp{k}.dat")
    assert len(read_casts(folder)) == len(read_casts(tmp_path / "casts.zip")) == 3
    monkeypatch.setattr(cast_folders, limit, value)
    refused(OceanError, message, read_casts, tmp_path / "casts.zip")
    if limit == "_MAX_FILES":
        refused(OceanError, "3 files; the limit is 2; name a smaller folder", read_casts, folder)


def copernicus(*, adjusted=False, depths=False):
    """Layout of GL_PR_CT_*.nc and GL_PR_PF_*.nc: three profiles, the second without good levels."""
    vertical = (
        ("DEPH", depth(PRESSURE), "depth", "m")
        if depths
        else ("PRES", PRESSURE, "sea_water_pressure", "dbar")
    )
    data = xr.Dataset(
        attrs={"data_type": "OceanSITES vertical profile", "cdm_data_type": "vertical profile"}
    )
    columns = {
        vertical[0]: vertical[1:],
        "TEMP": (TEMPERATURE, "sea_water_temperature", "degrees_C"),
        "PSAL": (SALINITY, "sea_water_practical_salinity", "0.001"),
    }
    flags = np.ones((3, 4), dtype="i1")
    flags[1] = 4
    flags[2, 1] = 9
    for name, (values, standard, unit) in columns.items():
        attrs = {"standard_name": standard, "units": unit}
        for ending, change in (("", 0.0), ("_ADJUSTED", 0.01)) if adjusted else (("", 0.0),):
            data[name + ending] = (
                ("TIME", "DEPTH"),
                np.tile(values + change * (name != vertical[0]), (3, 1)),
                attrs,
            )
            data[f"{name}{ending}_QC"] = ("TIME", "DEPTH"), flags, {"long_name": "quality flag"}
    if adjusted:
        for name in columns:
            data[f"{name}_ADJUSTED"][2] = np.nan
    data["TIME"] = (
        "TIME",
        [23590.5, 23591.0, 23592.0],
        {"standard_name": "time", "units": "days since 1950-01-01T00:00:00Z"},
    )
    data["LATITUDE"] = (
        "LATITUDE",
        [LAT, LAT, 70.0],
        {"standard_name": "latitude", "units": "degrees_north"},
    )
    data["LONGITUDE"] = (
        "LONGITUDE",
        [LON, LON, -130.0],
        {"standard_name": "longitude", "units": "degrees_east"},
    )
    data["TIME_QC"] = "TIME", np.array([1, 1, 4], dtype="i1")
    data["POSITION_QC"] = "POSITION", np.array([1, 1, 1], dtype="i1")
    return data


@pytest.mark.parametrize("depths", [True, False])
def test_profiles_of_copernicus_are_casts(tmp_path, depths):
    copernicus(depths=depths).to_netcdf(tmp_path / "GL_PR_CT_1.nc")
    assert holds_casts(tmp_path / "GL_PR_CT_1.nc")
    one, three = read_casts(tmp_path / "GL_PR_CT_1.nc")
    np.testing.assert_allclose(one.depth, depth(PRESSURE))
    np.testing.assert_array_equal(one.salinity, SALINITY)
    assert (one.name, one.lat, one.lon) == ("GL_PR_CT_1_0", LAT, LON)
    assert one.time == np.datetime64("2014-08-03T12:00")
    np.testing.assert_allclose(
        three.depth, (depth(PRESSURE) if depths else depth(PRESSURE, 70.0))[[0, 2, 3]]
    )
    assert (three.lat, np.isnat(three.time)) == (70.0, True)
    assert one.notes[-1].startswith(
        "1 of 3 profiles dropped, the first: GL_PR_CT_1_1: 0 usable levels"
    )
    assert [p.name for p in read_profiles(tmp_path / "GL_PR_CT_1.nc")] == [
        "GL_PR_CT_1_0",
        "GL_PR_CT_1_2",
    ]
    data = copernicus()
    data["POSITION_QC"][0] = 4
    data.to_netcdf(tmp_path / "b.nc")
    (only,) = read_casts(tmp_path / "b.nc")
    assert only.lat == 70.0


def test_profiles_of_copernicus_use_adjusted_values(tmp_path, as_stored):
    copernicus(adjusted=True).to_netcdf(tmp_path / "GL_PR_PF_1.nc")
    one, three = read_casts(tmp_path / "GL_PR_PF_1.nc")
    np.testing.assert_allclose(one.temperature, TEMPERATURE + 0.01)
    np.testing.assert_allclose(three.temperature, TEMPERATURE[[0, 2, 3]])
    as_stored(three)
