"""
Files that others tried, in ../shared/cases, with the right values of their descriptions; skipped
where they are absent.
"""

import runpy
import warnings
from pathlib import Path

import gsw
import numpy as np
import pytest
from refusals import refused

from pymantaray.acoustics import read_profile
from pymantaray.config.door.water import open_water
from pymantaray.errors import AcousticsError
from pymantaray.ocean import open_ocean, open_sea_floor, read_cast

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"


@pytest.fixture
def case():
    if not CASES.is_dir():
        pytest.skip(f"the cases are not at {CASES}")
    return lambda name: CASES / name


def test_hemispheres_in_front_of_the_number(case, as_stored):
    cast = read_cast(case("position-hemisphere-first") / "cast.cnv")
    assert (cast.lat, cast.lon) == pytest.approx((-(12 + 30.60 / 60), -(63 + 38.60 / 60)))
    as_stored(cast)


def test_depth_in_fresh_water_beside_pressure(case, as_stored):
    profile = read_profile(case("fresh-water-depth") / "cast.cnv")
    pressure = np.array([100.0, 500.0, 1000.0, 2000.0])
    np.testing.assert_allclose(profile.depth, -gsw.z_from_p(pressure, 45.0), atol=1e-6)
    salinity, temperature = [35.8, 35.5, 35.2, 34.9], [15.0, 11.0, 8.0, 4.0]
    speed = gsw.sound_speed_t_exact(
        gsw.SA_from_SP(salinity, pressure, -30.0, 45.0), temperature, pressure
    )
    np.testing.assert_allclose(
        profile.sound_speed, speed, atol=0.05
    )  # the 75-term equation of TEOS-10 differs by 0.02 m/s
    as_stored(profile)


def test_a_logger_on_deck_and_no_fix(case, as_stored):
    profile = read_profile(case("deck-time") / "cast.aml")
    assert profile.depth.size == 40
    np.testing.assert_allclose(profile.depth[[0, -1]], [1.0, 98.5], atol=0.06)
    profile = read_profile(case("no-fix-999") / "cast.vp2")
    assert profile.place is None
    as_stored(profile)


@pytest.mark.parametrize(("file", "field", "values"), [
    ("t068.cnv", "temperature", [14.2211, 10.2274, 6.2270]),
    ("psi.cnv", "depth", -gsw.z_from_p([9.99740, 99.97398, 999.73981], 45.0)),
    ("pr50M.cnv", "depth", -gsw.z_from_p([10.0, 100.0, 1000.0], 45.0)),
    ("depSF.cnv", "depth", [3.048, 30.48, 304.8]),
    ("cond.cnv", "salinity",
     gsw.SP_from_C([42.9, 42.0, 36.5], [15.0, 14.0, 8.0], [10.0, 100.0, 1000.0])),
])  # fmt: skip
def test_names_of_sea_bird(case, file, field, values, as_stored):
    cast = read_cast(case("cnv-unknown-names") / file)
    np.testing.assert_allclose(getattr(cast, field), values, atol=1e-4)
    as_stored(cast)


def test_feet_and_a_date_with_the_day_first(case, as_stored):
    profile = read_profile(case("cnv-unknown-names") / "feet.edf")
    np.testing.assert_allclose(profile.depth, [0.0, 30.48, 304.8])
    np.testing.assert_allclose(profile.sound_speed, [1539.24, 1524.0, 1508.76])
    assert read_profile(case("edf-date") / "cast.edf").time == np.datetime64("2020-04-28T21:06:17")
    as_stored(profile)


def test_whp_exchange(case, as_stored):
    cast = read_cast(case("whp-exchange") / "cast_ct1.csv")
    np.testing.assert_allclose(cast.depth, [2.98, 99.4, 991.87], atol=5e-3)
    assert (cast.lat, cast.lon, cast.time) == (-12.51, -63.6433, np.datetime64("2024-08-05"))
    as_stored(cast)


def test_zeros_as_land_and_valid_ranges(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(case("fill-zero-valid-range") / "make.py"))
    for name in ("zero.nc", "valid.nc"):
        assert np.isnan(open_ocean(name)["salinity"].values).sum() == 9


def test_fill_numbers_and_units_of_a_table(case, as_stored):
    profile = read_profile(case("cast-fill-number") / "cast.csv")
    np.testing.assert_array_equal(profile.depth, [0.0, 100.0])
    np.testing.assert_allclose(profile.sound_speed, [1506.66, 1484.33], atol=0.01)
    for name, values in (("fahrenheit", "46.4 to 59"), ("kelvin", "")):
        path = case("cast-unit-unstated") / f"{name}.csv"
        refused(AcousticsError, f"temperature is {values}.*name the unit", read_profile, path)
    as_stored(profile)


def test_a_sea_floor_that_is_coarser_than_the_ocean(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make = case("bathymetry-coarser-ignored") / "make.py"
    with warnings.catch_warnings(action="ignore", category=ResourceWarning):
        runpy.run_path(make)  # leaves a file open
    for name in ("coarse.nc", "fine.nc"):
        bed = open_water("ocean.nc", bathymetry=name).medium.bed
        assert bed.depth_at(np.zeros((1, 2))) == pytest.approx(1500.0, abs=0.01)


@pytest.mark.parametrize("name", ["a.asc", "a.xyz"])
def test_a_raster_is_read(case, name):
    assert np.all(open_sea_floor(case("raster-refusal") / name).values == 1500.0)
