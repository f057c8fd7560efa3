"""
Absorption formulas against published values, against each other and in their limits; coefficients
of an ocean.
"""

import pickle

import numpy as np
import pytest

from pymantaray.acoustics import Absorption
from pymantaray.acoustics.levels.absorption import (
    ainslie_mccolm_db_per_km,
    francois_garrison_db_per_km,
    thorp_db_per_km,
)
from pymantaray.geometry import LocalFrame
from pymantaray.ocean import open_ocean

FORMULAS = {
    "francois-garrison": francois_garrison_db_per_km,
    "ainslie-mccolm": ainslie_mccolm_db_per_km,
}
both = pytest.mark.parametrize("formula", FORMULAS.values(), ids=FORMULAS)


@pytest.mark.parametrize(("khz", "t", "s", "z", "pH", "expected", "tolerance"), [
    # calculator of the National Physical Laboratory, as users noted its answers (to the digits they
    # kept)
    (130.0, 8.0, 35.0, 15.0, 8.0, 38.0, 0.5),
    (15.0, 25.0, 35.0, 11.6, 8.0, 1.26, 0.005),
    # R package "sonar" 1.0.2, printed example; it takes 273.15 where the paper takes 273, hence 0.2
    # %
    (50.0, 0.0, 35.0, 0.0, 6.0, 13.96602, 0.028),
    # test suite of UnderwaterAcoustics.jl, values to half a decibel over 1 km
    (50.0, 27.0, 35.0, 10.0, 8.1, 11.0, 0.5),
    (100.0, 27.0, 35.0, 10.0, 8.1, 36.0, 0.5),
    (100.0, 14.0, 38.5, 0.0, 8.1, 40.0, 0.5),
    (100.0, 14.0, 38.5, 2000.0, 8.1, 30.0, 0.5),
    (100.0, 14.0, 38.5, 6000.0, 8.1, 16.0, 0.5),
])  # fmt: skip
def test_francois_garrison_gives_the_values_others_published(khz, t, s, z, pH, expected, tolerance):
    alpha = francois_garrison_db_per_km(khz * 1e3, temperature=t, salinity=s, depth=z, pH=pH)
    assert alpha == pytest.approx(expected, abs=tolerance)


@both
def test_pressure_effect_is_that_of_fisher_and_simmons(formula):
    # Fisher and Simmons (1977), table IV, as the manual of swSoundAbsorption (R) quotes it:
    # 10 kHz, 5 degC, 35, 500 atm: 0.52 dB/km. Their data differ from the later ones by up to 10 %.
    alpha = formula(10e3, temperature=5.0, salinity=35.0, depth=4900.0)
    assert alpha == pytest.approx(0.52, rel=0.10)


@pytest.mark.parametrize(("name", "values"), [
    ("temperature", [-1.8, 0.0, 5.0, 15.0, 20.0, 25.0]),
    ("salinity", [25.0, 30.0, 38.0]),
    ("depth", [0.0, 1000.0, 4000.0]),
    ("pH", [7.7, 8.3]),
])  # fmt: skip
def test_the_two_formulas_agree_within_their_stated_tenth(name, values):
    hz = 1e3 * np.array([0.2, 0.5, 1, 2, 5, 10, 12, 25, 30, 70, 100, 200, 500, 1000])
    water = {
        "temperature": 10.0,
        "salinity": 35.0,
        "depth": 0.0,
        "pH": 8.0,
        name: np.array(values)[:, None],
    }
    a, b = (formula(hz, **water) for formula in FORMULAS.values())
    np.testing.assert_allclose(b, a, rtol=0.115)


def test_thorp_agrees_with_the_others_in_water_of_4_degrees():
    khz = np.array([0.5, 1.0, 3.0, 10.0, 20.0, 30.0])
    thorp = thorp_db_per_km(khz * 1e3)
    for formula in FORMULAS.values():
        for depth, rtol in ((0.0, 0.12), (1000.0, 0.26)):
            other = formula(khz * 1e3, temperature=4.0, salinity=35.0, depth=depth)
            np.testing.assert_allclose(thorp, other, rtol=rtol)
    # Thorp (1967) as Etter prints it: the two relaxations alone, per kiloyard
    f2 = khz**2
    printed = 1.0936 * (0.1 * f2 / (1.0 + f2) + 40.0 * f2 / (4100.0 + f2))
    np.testing.assert_allclose(thorp - 0.0033 - 3e-4 * f2, printed, rtol=0.006)


@both
def test_limits(formula):
    water = {"temperature": 5.0, "depth": 0.0}
    fresh = formula(np.array([100e3, 200e3]), salinity=0.0, **water)
    assert fresh[1] / fresh[0] == pytest.approx(4.0)  # water itself: the square of frequency
    far = formula(np.array([1e9, 2e9]), salinity=35.0, **water)
    assert far[1] / far[0] == pytest.approx(4.0, rel=1e-4)  # far above both relaxations
    assert np.all(
        np.diff(formula(np.geomspace(0.1, 1000.0, 60) * 1e3, salinity=35.0, **water)) > 0.0
    )
    acid, alkaline = (
        formula(np.array([1e3, 100e3]), salinity=35.0, pH=p, **water) for p in (7.7, 8.2)
    )
    assert alkaline[0] / acid[0] > 1.5  # boric acid rules below 5 kHz
    assert alkaline[1] / acid[1] == pytest.approx(1.0, abs=0.01)
    assert np.isnan(formula(1e3, temperature=np.nan, salinity=35.0, depth=0.0))


def test_francois_garrison_is_continuous_at_20_degrees():
    sides = francois_garrison_db_per_km(
        1e6, temperature=[20.0, 20.0 + 1e-9], salinity=35.0, depth=0.0
    )
    assert sides[1] == pytest.approx(sides[0], rel=2e-3)


PLACES = np.array(
    [[0.0, 0.0, 0.0], [300.0, -200.0, 50.0], [-400.0, 900.0, 250.0], [0.0, 0.0, 400.0]]
)


@pytest.mark.parametrize("formula", FORMULAS)
def test_profile_is_looked_up_by_depth(formula):
    profile = [0.0, 100.0, 300.0], [10.0, 4.0, 0.0], [30.0, 34.0, 35.0]
    found = Absorption.from_profile(*profile, pH=8.1, formula=formula).db_per_km(PLACES, 12e3)
    temperature, salinity = [10.0, 7.0, 1.0, 0.0], [30.0, 32.0, 34.75, 35.0]
    expected = FORMULAS[formula](
        12e3, temperature=temperature, salinity=salinity, depth=PLACES[:, 2], pH=8.1
    )
    np.testing.assert_allclose(found, expected, rtol=1e-14)


def test_one_coefficient_is_the_same_everywhere():
    np.testing.assert_array_equal(Absorption.constant(1.5).db_per_km(PLACES, 12e3), [1.5] * 4)
    thorp = float(thorp_db_per_km(12e3))
    np.testing.assert_array_equal(Absorption.thorp().db_per_km(PLACES, 12e3), [thorp] * 4)
    uniform = Absorption.from_profile([0.0], [5.0], [35.0]).db_per_km(PLACES[:1], 12e3)
    assert uniform == francois_garrison_db_per_km(12e3, temperature=5.0, salinity=35.0, depth=0.0)


def test_geographic_ocean_is_looked_up_where_the_local_frame_puts_it(ocean_file):
    ocean = open_ocean(ocean_file)
    lat, lon = (0.5 * float(ocean[v][0] + ocean[v][-1]) for v in ("lat", "lon"))
    i, j, depths = 5, 20, [0.0, 50.0, 400.0]  # a grid point of its own
    north, east = LocalFrame(lat, lon).to_local(float(ocean["lat"][i]), float(ocean["lon"][j]))
    at = np.array([[float(north), float(east), z] for z in depths])
    column = ocean.sel(depth=depths).isel(lat=i, lon=j)
    expected = francois_garrison_db_per_km(
        12e3,
        temperature=column["water_temp"].values,
        salinity=column["salinity"].values,
        depth=depths,
    )
    np.testing.assert_allclose(
        Absorption.from_dataset(ocean).db_per_km(at, 12e3), expected, rtol=1e-6
    )


def test_an_absorption_can_be_handed_to_another_process(ocean_file):
    ocean = open_ocean(ocean_file)
    position = np.array([[0.0, 0.0, 5.0], [3e3, -4e3, 800.0]])
    for one in (
        Absorption.constant(2.0),
        Absorption.thorp(),
        Absorption.from_profile([0.0, 100.0], [4.0, 2.0], [35.0, 34.5]),
        Absorption.from_profile(0.0, 4.0, 35.0, formula="ainslie-mccolm"),
        Absorption.from_dataset(ocean),
    ):
        other = pickle.loads(pickle.dumps(one))
        np.testing.assert_array_equal(
            other.db_per_km(position, 12e3), one.db_per_km(position, 12e3)
        )
