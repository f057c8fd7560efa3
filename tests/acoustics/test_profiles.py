"""
Thinned and smoothed casts: as near as they say, as few as can be, and what that does to travel
times.
"""

import itertools
from pathlib import Path

import gsw
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import CubicSpline

from pymantaray.acoustics import Medium, find_eigenrays, read_profile, smooth_profile, thin_profile
from pymantaray.acoustics.profiles import is_raw_cast, reduce_profile
from pymantaray.ocean.seawater import sound_speed

CASTS = Path(__file__).parents[3] / "shared" / "data" / "casts"
RAW = [f"beaufort_axctd_20140724_{lat}N140W.csv" for lat in (74, 75)] + [
    f"beaufort_xctd_icex20_{i}.csv" for i in (1, 4)
]


def cast(name):
    """Depth and sound speed of a real cast of 1 m."""
    if not CASTS.is_dir():
        pytest.skip(f"{CASTS} is absent")
    table = pd.read_csv(CASTS / name, comment="#")
    depth = table["depth_m"].to_numpy()
    return depth, sound_speed(
        table["temperature_degC"],
        table["practical_salinity"],
        depth,
        np.full(depth.size, 74.5),
        -140.0,
    )


@pytest.mark.parametrize("kind", ["speed", "depth", "pressure"])
def test_sound_speed_of_a_cast_is_read_or_computed(tmp_path, kind):
    z = np.array([0.0, 30.0, 100.0, 400.0, 1000.0, 2000.0])
    t, s = (
        np.array([-1.0, 0.5, -1.4, 0.6, 0.0, -0.7]),
        np.array([28.0, 31.0, 33.0, 34.8, 34.9, 34.92]),
    )
    c = sound_speed(t, s, z, 74.5, -140.0)
    head, place, columns = {
        "speed": ("", None, {"depth": z, "sound_speed": c}),
        "depth": (
            "# AXCTD, 2014-07-24, lat 74.5, lon -140.0; 1 m means\n",
            None,
            {"depth_m": z, "temperature_degC": t, "practical_salinity": s},
        ),
        "pressure": (
            "",
            (74.5, -140.0),
            {"Pressure_dbar": gsw.p_from_z(-z, 74.5), "temperature": t, "salinity": s},
        ),
    }[kind]
    path = tmp_path / "cast.csv"
    path.write_text(head + pd.DataFrame(columns).to_csv(index=False, float_format="%.17g"))
    profile = read_profile(path, place)
    np.testing.assert_allclose(profile.depth, z, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(profile.sound_speed, c, rtol=1e-9)
    assert profile.position == (None if kind == "speed" else (74.5, -140.0))


def between(profile, depth):
    if profile.interpolation == "linear":
        return np.interp(depth, profile.depth, profile.sound_speed)
    return CubicSpline(profile.depth, profile.sound_speed, bc_type="natural")(depth)


@st.composite
def rough_casts(draw, most=40):
    n = draw(st.integers(2, most))
    steps = draw(st.lists(st.floats(0.1, 5.0), min_size=n, max_size=n))
    noise = draw(st.lists(st.floats(-1.0, 1.0), min_size=n, max_size=n))
    return np.cumsum(steps) - steps[0], 1450.0 + np.array(noise)


@settings(max_examples=30)
@given(rough_casts(), st.sampled_from([0.05, 0.4]), st.sampled_from(["linear", "smooth"]))
def test_a_thinned_profile_stays_within_its_tolerance(raw, tolerance, interpolation):
    z, c = raw
    thin = thin_profile(z, c, tolerance=tolerance, interpolation=interpolation)
    change = between(thin, z) - c
    assert np.abs(change).max() <= tolerance * (1 + 1e-9)
    assert thin.greatest_change == pytest.approx(np.abs(change).max(), abs=1e-9)
    assert thin.rms_change == pytest.approx(np.sqrt(np.mean(change**2)), abs=1e-9)
    assert np.isin(thin.depth, z).all()
    assert (thin.depth[0], thin.depth[-1], thin.raw_levels) == (z[0], z[-1], z.size)


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
@pytest.mark.parametrize("reduce", [None, thin_profile, smooth_profile])
def test_sound_speed_holds_above_a_first_level_below_the_surface(interpolation, reduce):
    z = np.arange(10.0, 301.0, 5.0)
    # its slope at 10 m would take off 3.3 m/s at the surface
    c = 1480.0 + 0.39 * (z - 10.0) * np.exp(-z / 60.0)
    if reduce is not None:
        profile = reduce(z, c, interpolation=interpolation)
        assert profile.raw_levels == z.size
        z, c = profile.depth, profile.sound_speed
    medium = Medium.from_profile(z, c, bottom_depth=300.0, interpolation=interpolation)
    depth = np.linspace(0.0, 5.0, 6)
    ends = np.stack(
        [np.zeros((2, 6)), [np.zeros(6), np.full(6, 100.0)], [depth, depth + 1.0]], axis=-1
    )
    held = find_eigenrays(medium, *ends).source_sound_speed
    np.testing.assert_allclose(held, c[0] if reduce is None else 1480.0, rtol=0, atol=0.15)


@settings(max_examples=30)
@given(rough_casts(most=9), st.sampled_from([0.1, 0.5]))
def test_no_fewer_levels_would_do(raw, tolerance):
    z, c = raw
    kept = thin_profile(z, c, tolerance=tolerance, interpolation="linear").depth.size
    for inner in itertools.combinations(range(1, z.size - 1), max(kept - 3, 0)):
        rows = [0, *inner, z.size - 1]
        off = np.abs(np.interp(z, z[rows], c[rows]) - c).max()
        assert kept == 2 or off > tolerance * (1 - 1e-9), rows


def test_no_level_of_a_spline_can_be_spared_alone():
    z = np.arange(0.0, 300.0)
    c = 1440.0 + 8.0 * np.tanh((z - 80.0) / 20.0) + 0.02 * np.sin(5.0 * z)
    thin = thin_profile(z, c, tolerance=0.1)
    assert thin.depth.size < 20
    for i in range(1, thin.depth.size - 1):
        levels, speeds = np.delete(thin.depth, i), np.delete(thin.sound_speed, i)
        assert np.abs(CubicSpline(levels, speeds, bc_type="natural")(z) - c).max() > 0.1


def test_smoothing_keeps_a_constant_gradient_and_takes_noise_off():
    rng = np.random.default_rng(5)
    z = np.concatenate([[0.0], np.sort(rng.uniform(0.0, 2000.0, 1999))])
    line = 1450.0 + 0.017 * z
    kept = smooth_profile(z, line, length=60.0)
    np.testing.assert_allclose(kept.sound_speed, 1450.0 + 0.017 * kept.depth, rtol=0, atol=1e-9)
    even = np.arange(0.0, 20000.0)
    noise = rng.normal(0.0, 0.1, even.size)
    smooth = smooth_profile(even, 1450.0 + noise, length=20.0)
    sigma = 20.0 / 2.3548  # m; white noise through Gaussian weights: variance / (2 sqrt(pi) sigma)
    expected = 0.1 / np.sqrt(2.0 * np.sqrt(np.pi) * sigma)
    assert smooth.sound_speed[5:-5].std() == pytest.approx(expected, rel=0.05)
    assert np.diff(smooth.depth).max() <= 10.0


@pytest.mark.parametrize("name", RAW)
def test_a_raw_cast_is_thinned_to_a_microsecond_of_vertical_time(name):
    z, c = cast(name)
    thin = reduce_profile(z, c, interpolation="linear")
    # between levels both profiles are straight: many points integrate the slowness
    at = np.linspace(z[0], z[-1], 200001)
    change = 1.0 / np.interp(at, thin.depth, thin.sound_speed) - 1.0 / np.interp(at, z, c)
    vertical = np.abs(np.cumsum(change) * (at[1] - at[0])).max()
    assert vertical < 1.5e-6
    assert thin.vertical_change == pytest.approx(vertical, rel=0.1)
    assert reduce_profile(z[::10], c[::10]) is None


@pytest.mark.parametrize("name", RAW)
def test_travel_times_of_a_thinned_cast_differ_within_the_tolerance(name):
    z, c = cast(name)
    deepest = 150.0  # m
    z, c = z[z <= deepest], c[z <= deepest]
    assert is_raw_cast(z)
    rng = np.random.default_rng(3)
    depths = rng.uniform(20.0, 0.4 * deepest, (2, 12))
    source = np.stack([np.zeros(12), np.zeros(12), depths[0]], axis=-1)
    receiver = np.stack([rng.uniform(3.0, 6.0, 12) * deepest, np.zeros(12), depths[1]], axis=-1)
    tolerance = 0.1  # m/s

    def times(depth, speed, interpolation):
        medium = Medium.from_profile(
            depth, speed, bottom_depth=deepest, interpolation=interpolation
        )
        found = [
            find_eigenrays(
                medium, source, receiver, spreading_cutoff_db=None, canonical=way, threads=1
            )
            for way in (
                True,
                False,
            )  # a ray 40 dB below spherical spreading may be found from one end only
        ]
        return np.fmin(*(arrivals.first().travel_time for arrivals in found))

    for interpolation, slack in (("linear", 0.0), ("smooth", 0.2)):
        # by Fermat, see thin_profile; between the cast's levels two splines differ by a little more
        # than at them
        raw = times(z, c, interpolation)
        thin = thin_profile(z, c, tolerance=tolerance, interpolation=interpolation)
        assert thin.depth.size < 0.5 * z.size
        change = np.abs(times(thin.depth, thin.sound_speed, interpolation) - raw)
        both = np.isfinite(change)
        assert np.count_nonzero(both) >= 9
        assert np.all(
            change[both] <= (1.0 + slack) * raw[both] * tolerance / (c.min() - tolerance)
        ), change
        assert change[both].max() > 1e-7  # s; it is another medium
