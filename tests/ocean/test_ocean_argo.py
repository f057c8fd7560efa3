"""Argo's profile files, written here to the layout of the data centres and of argopy."""

import gsw
import netCDF4
import numpy as np
import pytest
import xarray as xr
from refusals import refused

from pymantaray.errors import OceanError
from pymantaray.ocean.casts import read_cast, read_casts

P = np.array([5.0, 50.0, 100.0, 500.0, 1000.0, 1999.0], dtype="f4")
T = np.array([20.0, 18.0, 15.0, 9.0, 5.0, 3.0], dtype="f4")
S = np.array([36.0, 36.1, 36.0, 35.2, 35.0, 34.9], dtype="f4")
FILL = np.float32(99_999.0)


def write_gdac(
    path,
    *,
    modes="D",
    flags="111111",
    adjusted_flags=None,
    offset=0.01,
    position="1",
    fmt="NETCDF3_CLASSIC",
):
    """
    A core profile file; adjusted values are the raw ones plus an offset, fill values in mode R.
    """
    n, m = len(modes), P.size
    with netCDF4.Dataset(path, "w", format=fmt) as data:
        for name, size in {"N_PROF": n, "N_LEVELS": m, "STRING8": 8}.items():
            data.createDimension(name, size)

        def chars(name, rows, dims=("N_PROF",)):
            v = data.createVariable(name, "S1", dims, fill_value=" ")
            v[:] = np.array([list(r) for r in rows] if len(dims) > 1 else list(rows), dtype="S1")

        chars("PLATFORM_NUMBER", ["6901234 "] * n, ("N_PROF", "STRING8"))
        chars("DATA_MODE", modes)
        chars("DIRECTION", "A" * n)
        chars("POSITION_QC", position * n)
        chars("JULD_QC", "1" * n)
        cycle = data.createVariable("CYCLE_NUMBER", "i4", ("N_PROF",), fill_value=99_999)
        cycle[:] = np.arange(1, n + 1)
        juld = data.createVariable("JULD", "f8", ("N_PROF",), fill_value=999_999.0)
        juld.units = "days since 1950-01-01 00:00:00 UTC"
        juld[:] = 25_000.5 + np.arange(n)
        for name, start in (("LATITUDE", 40.0), ("LONGITUDE", -60.0)):
            data.createVariable(name, "f8", ("N_PROF",), fill_value=99_999.0)[:] = (
                start + np.arange(n)
            )
        for name, values in (("PRES", P), ("TEMP", T), ("PSAL", S)):
            raw = data.createVariable(name, "f4", ("N_PROF", "N_LEVELS"), fill_value=FILL)
            raw[:] = np.tile(values, (n, 1))
            chars(f"{name}_QC", [flags] * n, ("N_PROF", "N_LEVELS"))
            better = data.createVariable(
                f"{name}_ADJUSTED", "f4", ("N_PROF", "N_LEVELS"), fill_value=FILL
            )
            for i, mode in enumerate(modes):
                better[i] = FILL if mode == "R" else values + np.float32(offset)
            rows = [" " * m if mode == "R" else adjusted_flags or flags for mode in modes]
            chars(f"{name}_ADJUSTED_QC", rows, ("N_PROF", "N_LEVELS"))
    return path


def test_delayed_mode_gives_adjusted_values_and_real_time_raw_ones(tmp_path):
    delayed, real_time = read_casts(write_gdac(tmp_path / "6901234_prof.nc", modes="DR"))
    assert (delayed.name, real_time.name) == ("6901234_001", "6901234_002")
    assert (delayed.lat, delayed.lon, real_time.lat) == (40.0, -60.0, 41.0)
    assert delayed.time == np.datetime64("2018-06-13T12:00")  # 25,000.5 days after 1950
    np.testing.assert_allclose(delayed.temperature, T + 0.01, rtol=0, atol=1e-5)
    np.testing.assert_allclose(real_time.temperature, T, rtol=0, atol=1e-6)
    np.testing.assert_allclose(delayed.depth, -gsw.z_from_p(P + 0.01, 40.0), rtol=0, atol=1e-3)
    assert "adjusted values of the profiles in mode A or D" in delayed.notes


@pytest.mark.parametrize("kind", ["flags", "adjusted_flags"])
def test_only_good_flags_are_used_and_the_rest_is_counted(tmp_path, kind, as_stored):
    """Of the adjusted values, where there are any: raw ones never stand in."""
    for flag in "0123456789":
        cast = read_cast(write_gdac(tmp_path / f"flag{flag}.nc", **{kind: f"11{flag}111"}))
        good = flag in "1258"
        assert (cast.depth.size, cast.dropped) == ((6, 0) if good else (5, 1)), flag
    assert any(note.startswith("1 of 6 levels rejected: bad quality flags") for note in cast.notes)
    as_stored(cast)


def test_a_position_under_ice_is_a_good_one(tmp_path):
    assert len(read_casts(write_gdac(tmp_path / "ice.nc", modes="DD", position="8"))) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"adjusted_flags": "444444"},
            "none of 1 profiles has a good position and at least two levels",
        ),
        ({"modes": "DD", "position": "9"}, "none of 2 profiles"),
    ],
)
def test_a_file_without_a_usable_profile_is_refused(tmp_path, options, message):
    refused(OceanError, message, read_casts, write_gdac(tmp_path / "bad.nc", **options))


def test_one_profile_of_many_is_taken_by_its_name(tmp_path):
    path = write_gdac(tmp_path / "many.nc", modes="DDD")
    assert read_cast(path, name="6901234_002").lat == 41.0
    refused(OceanError, "contains 3 casts", read_cast, path)
    refused(OceanError, "have their own places and times", read_cast, path, lat=1.0)


def test_what_argopy_writes_is_read(tmp_path):
    n = 2
    grid = ("N_PROF", "N_LEVELS")
    data = xr.Dataset(
        {
            **{k: (grid, np.tile(v, (n, 1))) for k, v in (("PRES", P), ("TEMP", T), ("PSAL", S))},
            **{
                f"{k}_QC": (grid, np.ones((n, P.size), dtype=int)) for k in ("PRES", "TEMP", "PSAL")
            },
            "PLATFORM_NUMBER": ("N_PROF", [6901234, 6901234]),
            "CYCLE_NUMBER": ("N_PROF", [7, 8]),
            "DIRECTION": ("N_PROF", ["A", "D"]),
            "DATA_MODE": ("N_PROF", ["D", "R"]),
            "POSITION_QC": ("N_PROF", [1, 1]),
            "TIME_QC": ("N_PROF", [1, 1]),
        },
        coords={
            "LATITUDE": ("N_PROF", [40.0, 41.0]),
            "LONGITUDE": ("N_PROF", [-60.0, -61.0]),
            "TIME": (
                "N_PROF",
                np.array(["2018-06-13T12:00:00", "2018-06-23T06:30:15"], dtype="M8[ns]"),
            ),
        },
    )
    data["PRES"][1, 4:] = np.nan  # the second is shorter
    data["PSAL_QC"][0, 0] = 4
    data.to_netcdf(tmp_path / "argopy.nc")
    first, second = read_casts(tmp_path / "argopy.nc")
    assert (first.name, second.name) == ("6901234_007", "6901234_008D")
    assert (first.depth.size, second.depth.size) == (5, 4)
    assert second.time == np.datetime64("2018-06-23T06:30:15")
    np.testing.assert_allclose(first.salinity, S[1:], rtol=0, atol=1e-6)


def test_files_that_are_not_argos_are_refused_in_one_line(tmp_path):
    xr.Dataset({"PRES": ("N_POINTS", P)}).to_netcdf(tmp_path / "points.nc")
    refused(OceanError, "point2profile", read_casts, tmp_path / "points.nc")
    xr.Dataset({"a": ("x", P)}).to_netcdf(tmp_path / "other.nc")
    refused(OceanError, "no PRES over N_PROF and N_LEVELS", read_casts, tmp_path / "other.nc")
    with netCDF4.Dataset(tmp_path / "huge.nc", "w") as data:
        data.createDimension("N_PROF", 2_000_000_000)
        data.createDimension("N_LEVELS", 2_000_000)
        for name in ("PRES", "TEMP", "PSAL"):
            data.createVariable(name, "f4", ("N_PROF", "N_LEVELS"), chunksizes=(1000, 1000))
        for name in ("LATITUDE", "LONGITUDE"):
            data.createVariable(name, "f8", ("N_PROF",), chunksizes=(1000,))
    refused(OceanError, "LATITUDE alone needs", read_casts, tmp_path / "huge.nc")
    for fmt in ("NETCDF4", "NETCDF3_CLASSIC"):
        whole = write_gdac(tmp_path / "whole.nc", fmt=fmt).read_bytes()
        (tmp_path / "cut.nc").write_bytes(whole[: len(whole) // 2])
        refused(OceanError, "cut", read_casts, tmp_path / "cut.nc")


@pytest.mark.parametrize("fmt", ["NETCDF4", "NETCDF3_CLASSIC"])
def test_damaged_files_give_casts_or_one_line(tmp_path, fmt):
    whole = bytearray(write_gdac(tmp_path / "whole.nc", modes="DR", fmt=fmt).read_bytes())
    rng = np.random.default_rng(7)
    for _ in range(8):
        broken = bytearray(whole)
        for at in rng.integers(4, len(whole), 20):
            broken[at] = rng.integers(256)
        (tmp_path / "broken.nc").write_bytes(broken)
        try:
            casts = read_casts(tmp_path / "broken.nc")
        except OceanError as error:
            text = str(error)
            assert "\n" not in text
        else:
            assert all(np.isfinite(c.temperature).all() for c in casts)
