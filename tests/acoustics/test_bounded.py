"""
Interpolation that stays near its levels and grid points: uneven levels, drawn steps, thin steps;
the numbers of the notes.
"""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.optimize import brentq

from pymantaray import open_water
from pymantaray.acoustics import Medium, find_eigenrays, thin_profile
from pymantaray.acoustics.bounded import ACROSS_MARGIN, DEPTH_MARGIN
from pymantaray.errors import AcousticsError
from pymantaray.geometry.sphere import EarthSphere
from tests.refusals import refused

GLIDER_DEPTH = np.append(np.linspace(0.0, 200.0, 101), 3000.0)
GLIDER_SPEED = np.append(1500.0 - 0.125 * GLIDER_DEPTH[:-1], 1520.0)


def times(medium, source, receiver):
    rays = find_eigenrays(medium, source, receiver, spreading_cutoff_db=None)
    assert rays.complete.all()
    return rays.first().travel_time


def snell(thickness, speed, distance):
    """Travel time through layers of constant sound speed, by Snell's law."""
    thickness, speed = np.array(thickness, dtype=float), np.array(speed, dtype=float)

    def sines(p):
        return np.sqrt(1.0 - (p * speed) ** 2)

    def miss(p):
        return (thickness * p * speed / sines(p)).sum() - distance

    p = brentq(miss, 0.0, (1.0 - 1e-13) / speed.max(), xtol=1e-17)
    return (thickness / (speed * sines(p))).sum()


def straight_lines_time(depth, speed, source, receiver, distance):
    """The same through straight lines between levels, each cut into thin layers."""
    faces = np.unique([*np.linspace(source, receiver, 20_001), *depth])
    faces = faces[(faces >= source) & (faces <= receiver)]
    middle = 0.5 * (faces[1:] + faces[:-1])
    return snell(np.diff(faces), np.interp(middle, depth, speed), distance)


@settings(max_examples=15, deadline=None)
@given(
    st.lists(st.floats(2.0, 900.0), min_size=1, max_size=12),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.5, 5.0, 60.0]),
    st.booleans(),
)
def test_no_spline_in_depth_leaves_its_levels_by_the_margin(steps, seed, spread, sphere):
    levels = np.concatenate([[0.0], np.cumsum(steps)])
    rng = np.random.default_rng(seed)
    speed = 1490.0 + rng.uniform(-spread, spread, (3, levels.size))
    earth = EarthSphere.at_latitude(70.0) if sphere else None
    medium = Medium.from_grid(
        [0.0, 1e3, 2e3], [0.0], levels, speed[:, None], bathymetry=levels[-1], earth=earth
    )
    at = np.unique(np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(levels)]))
    k = np.clip(np.searchsorted(levels, at) - 1, 0, levels.size - 2)
    low, high = (f(speed[:, k], speed[:, k + 1]) for f in (np.minimum, np.maximum))
    spline = CubicSpline(medium.depth, medium.sound_speed[:, 0], axis=-1, bc_type="natural")(at)
    assert (spline <= high + DEPTH_MARGIN + 1e-6).all()
    assert (spline >= low - DEPTH_MARGIN - 1e-6).all()
    place = np.column_stack([np.full(at.size, 1e3), np.zeros(at.size), at])
    own = medium.sound_speed_at(place)
    # on a sphere the spline is that of flattened water
    np.testing.assert_allclose(own, spline[1], rtol=0, atol=0.5 if sphere else 1e-8)


@settings(max_examples=15, deadline=None)
@given(
    st.integers(3, 9), st.integers(0, 2**32 - 1), st.sampled_from([1.0, 8.0, 40.0]), st.booleans()
)
def test_no_spline_across_leaves_its_grid_points_by_the_margin(n, seed, spread, turned):
    rng = np.random.default_rng(seed)
    axis = np.cumsum(rng.uniform(0.3, 3.0, n)) * 1e3
    values = 1490.0 + rng.uniform(-spread, spread, n)
    speed = np.repeat(values[:, None, None], 2, axis=2)
    axes = (axis, [0.0])
    if turned:
        axes, speed = axes[::-1], speed.swapaxes(0, 1)
    medium = Medium.from_grid(*axes, [0.0, 100.0], speed, bathymetry=100.0)
    at = np.linspace(axis[0], axis[-1], 400)
    k = np.clip(np.searchsorted(axis, at) - 1, 0, n - 2)
    place = np.zeros((at.size, 3))
    place[:, int(turned)] = at
    own = medium.sound_speed_at(place)
    degree = medium.degrees[int(turned)]
    assert degree == 1 or not medium.notes
    np.testing.assert_allclose(
        own, make_interp_spline(axis, values, k=degree)(at), rtol=0, atol=1e-8
    )
    assert (own <= np.maximum(values[k], values[k + 1]) + ACROSS_MARGIN + 1e-6).all()
    assert (own >= np.minimum(values[k], values[k + 1]) - ACROSS_MARGIN - 1e-6).all()


def test_a_deep_level_below_a_dense_profile_invents_no_water():
    """0.05 m/s of 1500 m/s change 2 s by 70 us; the spline through added levels is far nearer."""
    medium = Medium.from_profile(GLIDER_DEPTH, GLIDER_SPEED, bottom_depth=3000.0)
    assert GLIDER_SPEED.min() - 0.1 < medium.sound_speed.min()
    expected = straight_lines_time(GLIDER_DEPTH, GLIDER_SPEED, 20.0, 900.0, 3000.0)
    np.testing.assert_allclose(
        times(medium, [[0, 0, 20]], [[3000, 0, 900]]), expected, rtol=0, atol=2e-6
    )
    left = CubicSpline(GLIDER_DEPTH, GLIDER_SPEED, bc_type="natural")(np.linspace(200, 3000, 9999))
    beyond = GLIDER_SPEED[-2] - left.min()
    where = "between 200 and 3000 m the sound speed is linear"
    assert medium.notes == (f"{where}: a spline would leave its levels by {beyond:.0f} m/s",)
    for other in (
        medium.with_earth(EarthSphere.at_latitude(60.0)),
        medium.plus(np.zeros((1, medium.depth.size)), np.ones((1, 1, 1))),
    ):
        assert other.notes == medium.notes


@pytest.mark.parametrize(
    ("depth", "speed"),
    [([0.0, 500.0, 501.0, 1000.0], [1480.0, 1480.0, 1510.0, 1510.0]),
     ([0.0, 60.0, 62.0, 1000.0], [1500.0, 1499.0, 1450.0, 1466.0])],
)  # fmt: skip
def test_drawn_steps_have_the_times_of_straight_lines(depth, speed):
    medium = Medium.from_profile(depth, speed, bottom_depth=1000.0)
    expected = straight_lines_time(depth, speed, 20.0, 900.0, 800.0)
    got = times(medium, [[0, 0, 20]], [[800, 0, 900]])
    np.testing.assert_allclose(got, expected, rtol=0, atol=5e-6)


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
@pytest.mark.parametrize("gradient", [1.5e4, 1e6, 1e9])
def test_rays_cross_thin_steps(interpolation, gradient):
    """A step of the medium is 3 cm wide about the middle of the given one."""
    thin = 30.0 / gradient
    depth = [0, 300, 300 + thin, 600, 600 + thin, 1000]
    speed = [1480, 1480, 1510, 1510, 1480, 1480]
    medium = Medium.from_profile(depth, speed, bottom_depth=1000.0, interpolation=interpolation)
    assert "sound speed changes by 30 m/s between 300 and 300.0" in medium.notes[0]
    assert "in the medium over 0.03 m" in medium.notes[0]
    for distance in (0.0, 800.0, 2500.0):
        expected = snell([200, 300, 300], [1480, 1510, 1480], distance)
        got = times(medium, [[0, 0, 100]], [[distance, 0, 900]])
        np.testing.assert_allclose(got, expected, rtol=0, atol=3e-7 + 3e-5 * thin)


@pytest.mark.parametrize("interpolation", ["smooth", "linear"])
def test_thin_steps_at_the_ends_and_thin_sheets_keep_the_axis(interpolation):
    depth = [0.0, 1e-6, 500.0, 500.0 + 1e-6, 500.0 + 2e-6, 1000.0 - 1e-6, 1000.0]
    speed = [1450.0, 1480.0, 1480.0, 1530.0, 1480.0, 1480.0, 1500.0]
    medium = Medium.from_profile(depth, speed, bottom_depth=1000.0, interpolation=interpolation)
    assert medium.depth[[0, -1]].tolist() == [0.0, 1000.0]
    gradient = np.diff(medium.sound_speed.ravel()) / np.diff(medium.depth)
    assert np.abs(gradient).max() <= 1e3 * (1.0 + 1e-5)  # 1/s; steeper ones are inaccurate
    got = times(medium, [[0, 0, 100]], [[800, 0, 900]])
    np.testing.assert_allclose(got, np.hypot(800.0, 800.0) / 1480.0, rtol=0, atol=1e-8)


def test_thin_cells_across_are_wide_enough_for_rays():
    north = [0.0, 1e3, 1e3 + 1e-6, 2e3]
    speed = np.array([1480.0, 1480.0, 1510.0, 1510.0])[:, None, None] + np.zeros((1, 2))
    medium = Medium.from_grid(
        north, [0.0], [0.0, 100.0], speed, bathymetry=100.0, interpolation="linear"
    )
    assert "between 1000 and 1000.000001 m north" in medium.notes[0]
    got = times(medium, [[200, 0, 50]], [[1800, 0, 50]])
    np.testing.assert_allclose(got, 800.0 / 1480.0 + 800.0 / 1510.0, rtol=0, atol=1e-7)


def test_a_sum_that_would_leave_its_levels_is_bounded_too():
    levels = np.array([0.0, 10.0, 20.0, 30.0, 2000.0])
    base = Medium.from_profile(levels, np.full(5, 1490.0), bottom_depth=2000.0)
    step = np.array([[0.0, 0.0, 30.0, 30.0, 30.0]])
    total = base.plus(step, np.ones((1, 1, 1)))
    expected = Medium.from_profile(levels, 1490.0 + step[0], bottom_depth=2000.0)
    np.testing.assert_array_equal(total.depth, expected.depth)
    np.testing.assert_allclose(total.field, expected.field, rtol=0, atol=1e-9)
    assert total.notes == expected.notes != ()


def test_a_sum_with_a_front_is_linear_across():
    north = np.arange(6) * 1e3
    base = Medium.from_grid(north, [0.0], [0.0, 100.0], np.full((6, 1, 2), 1490.0), bathymetry=1e2)
    assert base.degrees == (3, 0)
    front = np.where(north < 2.5e3, 0.0, 60.0)[None, :, None]
    total = base.plus(np.ones((1, 2)), front)
    assert total.degrees == (1, 0)
    assert "along north the sound speed is linear between grid points" in total.notes[0]


def test_thinning_keeps_levels_where_a_medium_is_linear():
    z = np.arange(0.0, 401.0, 10.0)
    c = 1500.0 - 20.0 * np.sin(np.pi * np.minimum(z, 200.0) / 200.0) ** 2
    kept = thin_profile(z, c, tolerance=0.2)
    medium = Medium.from_profile(kept.depth, kept.sound_speed, bottom_depth=400.0)
    place = np.column_stack([np.zeros((z.size, 2)), z])
    assert np.abs(medium.sound_speed_at(place) - c).max() <= 0.25


@pytest.mark.parametrize("air", [0.0, 343.0])
def test_sound_speeds_of_air_are_refused_in_one_line(air):
    refused(
        AcousticsError, "sound_speed: .* to 1500 m/s; it must be 1000 to 2500 m/s",
        Medium.from_profile, [-1.0, 0.0, 50.0], [air, 1500.0, 1490.0], bottom_depth=50.0,
    )  # fmt: skip


def test_notes_of_the_medium_are_notes_of_the_water(tmp_path):
    path = tmp_path / "glider.csv"
    rows = (f"{z:g},{c:.6f}" for z, c in zip(GLIDER_DEPTH, GLIDER_SPEED, strict=True))
    path.write_text("\n".join(["depth,sound_speed", *rows, ""]))
    water = open_water(path, bathymetry=3000.0)
    assert "between 200 and 3000 m the sound speed is linear" in water.notes[-1]
    assert water.record["notes"] == [water.notes[-1]]
    assert "notes" not in open_water(path, bathymetry=3000.0, interpolation="linear").record
