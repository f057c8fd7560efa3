"""
Levels where rays fail, compared with an independent parabolic equation, itself compared with an
image source.
"""

import numpy as np
import pytest
from levels_where_rays_fail import PLACES, WATERS as COLUMNS, compare
from oracles import ParabolicEquation, image_source

from pymantaray.acoustics import Leakage, Medium, find_leaks

DEPTH = np.arange(0.0, 1001.0, 2.0)


def warm(depth):
    """
    A warm surface layer: the gradient decreases from 0.19 1/s at the surface to zero at 166 m.
    [m/s]
    """
    return 1500.0 - 12.0 * (1.0 - np.exp(-depth / 60.0)) + 0.012 * depth


def falling(depth):
    """One gradient. [m/s]"""
    return 1460.0 - 0.15 * depth


WATERS = {
    "warm": (warm, Medium.from_profile(DEPTH, warm(DEPTH), bottom_depth=1000.0)),
    "falling": (
        falling,
        Medium.from_profile(
            [0.0, 500.0],
            falling(np.array([0.0, 500.0])),
            bottom_depth=500.0,
            interpolation="linear",
        ),
    ),
}
# source depth, range and receiver depth: 30 to 350 m beyond the rays that graze the surface [m]
SHADOWS = {
    "warm": (
        40.0,
        ((1600.0, 30.0), (1400.0, 10.0), (2000.0, 60.0), (2200.0, 60.0), (2000.0, 40.0)),
    ),
    "falling": (
        40.0,
        ((1400.0, 10.0), (1800.0, 30.0), (2000.0, 60.0), (2000.0, 40.0), (2200.0, 60.0)),
    ),
}


@pytest.mark.parametrize(
    ("hz", "within"), [(1000.0, 0.03), pytest.param(12000.0, 0.05, marks=pytest.mark.slow)]
)
def test_the_parabolic_equation_has_the_field_of_source_and_image(hz, within):
    depths = np.array([5.0, 20.0, 60.0, 100.0])
    pressure = ParabolicEquation(
        lambda z: np.full(z.shape, 1480.0), hz, 50.0, 150.0, 500.0
    ).pressure(3, depths)
    exact = image_source(50.0, 500.0 * np.arange(1, 4)[:, None], depths, 2.0 * np.pi * hz / 1480.0)
    assert np.abs(20.0 * np.log10(np.abs(pressure / exact))).max() < within
    assert np.abs(np.angle(pressure / exact)).max() < 0.02


def test_the_parabolic_equation_does_not_depend_on_its_grid():
    """Half the steps in range, 1.5 times the cells in depth: 30 dB into a shadow."""
    coarse, fine = (
        ParabolicEquation(warm, 1000.0, 40.0, 200.0, 800.0, **steps).pressure(2, [30.0, 60.0])
        for steps in ({}, {"cells": 12.0, "wavelengths": 8.0})
    )
    assert np.abs(20.0 * np.log10(np.abs(coarse / fine))).max() < 0.02


def leak_minus_wave_db(water, hz):
    """
    Level of the leakage model minus that of the parabolic equation in the shadow of the surface,
    for each link.
    """
    speed, medium = WATERS[water]
    depth, places = SHADOWS[water]
    ranges, depths = np.array(places).T
    wave = ParabolicEquation(speed, hz, depth, 200.0, 200.0).pressure(
        round(ranges.max() / 200.0), depths
    )
    wave = wave[np.round(ranges / 200.0).astype(int) - 1, np.arange(depths.size)]
    source = np.tile([0.0, 0.0, depth], (depths.size, 1))
    receiver = np.column_stack([ranges, np.zeros(depths.size), depths])
    leaks = find_leaks(medium, source, receiver, Leakage(), hz, bounces=(15, 0))
    assert leaks.link.tolist() == list(range(depths.size))
    chord = np.linalg.norm(receiver - source, axis=-1)
    return -leaks.arrivals.spreading_db - 20.0 * np.log10(np.abs(wave) * chord)


@pytest.mark.parametrize("water", ["warm", pytest.param("falling", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "hz", [1000.0, *(pytest.param(hz, marks=pytest.mark.slow) for hz in (3e3, 8e3))]
)
def test_sound_in_the_shadow_of_the_surface_has_the_level_of_waves(water, hz):
    """
    Levels of -8 to -45 dB re spherical spreading; the first mode alone was 4 to 16 dB too weak in
    the warm layer.
    """
    assert np.abs(leak_minus_wave_db(water, hz)).max() < 1.0


@pytest.mark.parametrize(
    "water", ["duct at 100 m", "duct below the surface", "source near the surface"]
)
@pytest.mark.slow
def test_levels_of_arrivals_that_interfere_are_those_of_waves(water):
    """
    At 12 kHz all 36 links of the benchmark are within 3 dB; the strongest ray alone is so on 14 of
    them.
    """
    rows = compare(water, 12e3)
    error = rows["predicted_minus_wave_db"].abs()
    assert (error < 3.0).all()
    assert error.median() < 0.1
    assert (rows["strongest_minus_wave_db"].abs() < 3.0).sum() < 0.6 * len(rows)


def test_sound_behind_a_cusp_is_that_of_waves(monkeypatch):
    """
    Beside a cusp, rays alone are 3.6 dB too weak at 3 kHz; a fold continued with a linear time has
    the wrong sign.
    """
    monkeypatch.setitem(
        COLUMNS, "cusp", COLUMNS["duct below the surface"]._replace(places=((2000.0, 16.0),))
    )
    row = compare("cusp", 3e3).iloc[0]
    assert row["rays_minus_wave_db"] < -3.0
    assert abs(row["predicted_minus_wave_db"]) < 1.0


@pytest.mark.parametrize("water", ["duct at 100 m", "duct below the surface"])
@pytest.mark.slow
def test_levels_in_ducts_are_those_of_waves(water):
    """All 26 links are within 3 dB; without the sound behind caustics 20 are."""
    error = compare(water, 3e3)["predicted_minus_wave_db"].abs()
    assert (error < 3.0).all()
    assert error.median() < 0.1


@pytest.mark.parametrize("water", list(PLACES["random"]))
@pytest.mark.slow
def test_levels_of_links_drawn_later_are_those_of_waves(water):
    """
    Nine of ten is the goal: the settings were not chosen with these sources, receivers and the duct
    at 60 m.
    """
    error = compare(water, 3e3, "random")["predicted_minus_wave_db"].abs()
    assert len(error) >= 10
    assert (error < 3.0).mean() >= 0.9
    assert error.median() < 0.2
