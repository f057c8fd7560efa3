"""Casts below the freezing point: salinity of the freezing line."""

import gsw
import numpy as np
import pytest

from pymantaray import open_water
from pymantaray.acoustics import read_profile
from pymantaray.ocean import read_cast

TEMPERATURE = np.array([-1.6, -1.6, -1.55, -1.0, 0.4, 0.3])
SALINITY = np.array([24.0, 27.0, 29.5, 31.0, 34.8, 34.9])
DEPTH = np.array([2.0, 10.0, 30.0, 60.0, 200.0, 400.0])


@pytest.fixture
def cast(tmp_path):
    path = tmp_path / "cast.csv"
    rows = "\n".join(f"{z},{t},{s}" for z, t, s in zip(DEPTH, TEMPERATURE, SALINITY, strict=True))
    path.write_text(f"# lat 72.0, lon -145.0\ndepth,temperature,salinity\n{rows}\n")
    return path


def freezing_temperature(depth, salinity):
    p = gsw.p_from_z(-depth, 72.0)
    return gsw.t_freezing(gsw.SA_from_SP(salinity, p, -145.0, 72.0), p, 0.0)


def test_cold_levels_get_the_salinity_at_which_they_freeze(cast, as_stored):
    repaired = read_cast(cast, repair_freezing=True)
    cold = freezing_temperature(DEPTH, SALINITY) > TEMPERATURE
    assert cold.sum() == 2
    np.testing.assert_allclose(
        freezing_temperature(DEPTH, repaired.salinity)[cold], TEMPERATURE[cold], atol=1e-6
    )
    np.testing.assert_array_equal(repaired.salinity[~cold], SALINITY[~cold])
    np.testing.assert_array_equal(repaired.temperature, TEMPERATURE)
    (note,) = repaired.notes[1:]
    assert note.startswith(
        "2 of 6 levels below the freezing point repaired: salinity raised by up to "
    )
    assert float(note.split()[-1]) == pytest.approx(np.max(repaired.salinity - SALINITY), rel=0.01)
    as_stored(repaired)


def test_profile_of_a_repaired_cast_has_its_sound_speed(cast, as_stored):
    plain, repaired = read_profile(cast), read_profile(cast, repair_freezing=True)
    np.testing.assert_allclose(
        repaired.sound_speed, read_cast(cast, repair_freezing=True).sound_speed(), atol=1e-9
    )
    raised = repaired.sound_speed - plain.sound_speed
    assert (raised[:2] > 1.0).all()
    assert (raised[2:] == 0.0).all()
    assert "`repair_freezing`" in plain.notes[0]
    as_stored(repaired)


def test_water_of_a_cast_is_repaired_on_request(cast, as_stored):
    plain, repaired = (
        open_water(str(cast), bathymetry=500.0, interpolation="linear", repair_freezing=repair)
        for repair in (False, True)
    )
    surface = [[0.0, 0.0, 2.0]]
    raised = repaired.medium.sound_speed_at(surface) - plain.medium.sound_speed_at(surface)
    assert raised[0] > 4.0
    assert any("2 of 6 levels below the freezing point repaired" in note for note in repaired.notes)
    as_stored(repaired)


def test_cast_above_the_freezing_point_is_not_changed(tmp_path):
    path = tmp_path / "warm.csv"
    path.write_text("# lat 72.0, lon -145.0\ndepth,temperature,salinity\n2,1.0,30\n20,2.0,31\n")
    warm = read_cast(path, repair_freezing=True)
    np.testing.assert_array_equal(warm.salinity, [30.0, 31.0])
    assert warm.notes == read_cast(path).notes
