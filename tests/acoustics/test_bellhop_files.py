"""A medium and its links written for Bellhop come back; files that others wrote mean what the manual says."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.acoustics.bellhop import (
    HalfSpace,
    linear_medium,
    read_bellhop,
    read_environment,
    write_bellhop,
)
from pymantaray.errors import AcousticsError

DATA = Path(__file__).parent / "data"
DEPTH = np.array([0.0, 10.0, 50.0, 200.0, 1000.0])
ATOL_POSITION = 1e-9  # m; double precision of a range and a bearing


def grid_medium(n_north=4, n_east=3, *, seed=0, interpolation="linear"):
    rng = np.random.default_rng(seed)
    north = np.cumsum(rng.uniform(500.0, 2000.0, n_north)) - 3000.0
    east = np.cumsum(rng.uniform(500.0, 2000.0, n_east)) + 70_000.0
    return Medium.from_grid(
        north,
        east,
        DEPTH,
        rng.uniform(1430.0, 1520.0, (n_north, n_east, DEPTH.size)),
        bathymetry=rng.uniform(300.0, 1000.0, (n_north, n_east)),
        interpolation=interpolation,
    )


def middle(medium, depth, offset=(0.0, 0.0)):
    return np.array([medium.north.mean() + offset[0], medium.east.mean() + offset[1], depth])


def assert_same_medium(found, expected):
    for name in ("north", "east", "depth", "sound_speed", "bathymetry"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


@settings(max_examples=25, deadline=None)
@given(n_north=st.integers(1, 4), n_east=st.integers(1, 4), seed=st.integers(0, 2**32 - 1))
def test_a_medium_comes_back_to_the_last_bit(tmp_path_factory, n_north, n_east, seed):
    medium = grid_medium(n_north, n_east, seed=seed)
    folder = tmp_path_factory.mktemp("round")
    (env,) = write_bellhop(folder, medium, middle(medium, 20.0), middle(medium, 100.0, (1.0, 2.0)))
    found = read_bellhop(env)
    assert_same_medium(found, medium)
    assert found.interpolation == "linear"


def test_one_profile_is_written_as_one_and_comes_back_unbounded(tmp_path):
    medium = Medium.from_profile(DEPTH, 1450.0 + 0.017 * DEPTH, bottom_depth=1234.5, interpolation="linear")
    (env,) = write_bellhop(tmp_path, medium, [0, 0, 10], [80_000.0, -3_000.0, 300.0])
    assert not env.with_suffix(".ssp").exists()
    assert read_environment(env).profile == "C"
    assert_same_medium(read_bellhop(env), medium)
    reach = [float(word) for word in env.with_suffix(".bty").read_text().splitlines()[2].split()[:2]]
    assert reach[0] < -80.0 < 80.0 < reach[1]  # km; the flat bed goes on beyond the link


def test_positions_fan_and_box_of_a_link(tmp_path):
    medium = grid_medium()
    source = np.array([medium.north[1] + 0.123, medium.east[1] + 1 / 3, 12.3])
    receiver = source + np.array([-400.1, 500.7, 101.9])
    (env,) = write_bellhop(
        tmp_path, medium, source, receiver, beams=11, cone=0.2, run="rays", frequency=12_345.0, step=7.0
    )
    found = read_environment(env)
    assert (found.source_x[0], found.source_y[0], found.source_depth[0]) == tuple(source)
    assert (found.run_type, found.frequency, found.step) == ("RG RR3", 12_345.0, 7.0)
    r, bearing = found.receiver_range[0], found.receiver_bearing[0]
    there = [source[0] + r * math.cos(bearing), source[1] + r * math.sin(bearing), found.receiver_depth[0]]
    np.testing.assert_allclose(there, receiver, rtol=0, atol=ATOL_POSITION)
    slope = math.atan2(101.9, math.hypot(400.1, 500.7))  # positive down, as in Bellhop
    np.testing.assert_allclose(found.declination, slope + np.linspace(-0.2, 0.2, 11), atol=1e-12)
    np.testing.assert_allclose(
        found.bearing, math.atan2(500.7, -400.1) + np.linspace(-0.2, 0.2, 11), atol=1e-12
    )
    assert np.all(found.box[:2] > np.abs(receiver - source)[:2])
    assert found.box[2] > medium.bathymetry.max()


@pytest.mark.parametrize(
    ("step", "bearing_deg"),
    [([500, 0, 0], 0.0), ([0, 500, 0], 90.0), ([-500, 0, 0], 180.0), ([0, -500, 0], -90.0)],
)
def test_x_is_north_and_bearings_run_clockwise(tmp_path, step, bearing_deg):
    medium = grid_medium()
    (env,) = write_bellhop(tmp_path, medium, middle(medium, 20.0), middle(medium, 20.0) + step)
    assert np.degrees(read_environment(env).receiver_bearing) == pytest.approx([bearing_deg])


def test_links_share_their_grids_and_the_origin_moves_them(tmp_path):
    medium = grid_medium()
    a, b = middle(medium, 20.0), middle(medium, 100.0, (50.0, 60.0))
    paths = write_bellhop(tmp_path, medium, [a, b], [b, a], name="pair", origin=a[:2])
    assert [path.name for path in paths] == ["pair_0.env", "pair_1.env"]
    for suffix in (".ssp", ".bty"):
        first, second = (path.with_suffix(suffix) for path in paths)
        assert first.samefile(second)
    assert read_environment(paths[0]).source_x == [0.0]
    moved = read_bellhop(paths[1])
    np.testing.assert_allclose(moved.north, medium.north - a[0], rtol=0, atol=ATOL_POSITION)
    np.testing.assert_array_equal(moved.sound_speed, medium.sound_speed)


@pytest.mark.parametrize(
    ("bottom", "letter", "expected"),
    [
        ("rigid", "R", None),
        ("vacuum", "V", None),
        ("matching", "A", HalfSpace(sound_speed=1467.0, density_g_per_cm3=1.0)),
        (HalfSpace(1650.0, 1.9, 0.8, 300.0, 1.5), "A", HalfSpace(1650.0, 1.9, 0.8, 300.0, 1.5)),
    ],
)
def test_bottoms(tmp_path, bottom, letter, expected):
    medium = Medium.from_profile(DEPTH, 1450.0 + 0.017 * DEPTH, bottom_depth=1000.0, interpolation="linear")
    (env,) = write_bellhop(tmp_path, medium, [0, 0, 10], [500.0, 0, 20], bottom=bottom)
    found = read_environment(env)
    assert (found.bottom, found.half_space) == (letter, expected)


@pytest.mark.parametrize(
    ("unit", "value"),  # all 2 dB per wavelength at 500 Hz and 1600 m/s, 3.2 m
    [("W", 2.0), ("M", 0.625), ("F", 1.25), ("N", 0.625 / 8.685889638), ("Q", math.pi * 8.685889638 / 2.0),
     ("L", 2.0 / (2.0 * math.pi * 8.685889638))],
)  # fmt: skip
def test_attenuation_units_are_one_attenuation(tmp_path, unit, value):
    text = (
        (DATA / "bellhop_plane.env").read_text().replace("10000.0", "500.0").replace("'CVW'", f"'CV{unit}'")
    )
    (tmp_path / "a.env").write_text(text.replace("'R' 0.0", f"'A' 0.0\n2000.0 1600.0 0.0 1.8 {value} /"))
    found = read_environment(tmp_path / "a").half_space
    assert found.attenuation_db_per_wavelength == pytest.approx(2.0, rel=1e-9)


def test_hand_typed_files_mean_what_the_manual_says():
    environment = read_environment(DATA / "bellhop_hand")
    assert environment.half_space == HalfSpace(1600.0, 1.8, 0.8 * 1600.0 / 1000.0)
    assert environment.depth.tolist() == [0.0, 100.0, 1000.0]
    assert environment.sound_speed.tolist() == [1500.0, 1500.0, 1500.0]
    assert environment.receiver_depth.tolist() == [100.0, 500.0, 900.0]
    assert environment.source_depth.tolist() == [100.0, 200.0]
    assert np.degrees(environment.declination) == pytest.approx([-20.0, 20.0])
    assert np.degrees(environment.bearing) == pytest.approx([-10.0, 0.0, 10.0])
    assert environment.box == (2000.0, 2000.0, 1100.0)

    medium = read_bellhop(DATA / "bellhop_hand.env", x_axis="east")
    # sound speed on east {0, 4}, north {0, 1, 4}; bathymetry on east {-1, 1, 3}, north {0.5, 5} km: both meet in
    assert medium.east.tolist() == [0.0, 1000.0, 3000.0]
    assert medium.north.tolist() == [500.0, 1000.0, 4000.0]

    def speed(north, east, depth):  # the table's numbers by rule: 100 a level, 10 a row of y, 1 along x
        row = np.interp(north, [0.0, 1000.0, 4000.0], [0.0, 10.0, 20.0])
        column = east / 4000.0 * np.interp(depth, [0.0, 100.0, 1000.0], [1.0, 1.0, 1.0])
        level = np.interp(depth, [0.0, 100.0, 1000.0], [1500.0, 1600.0, 1700.0])
        return level + row + column

    n, e, z = np.meshgrid(medium.north, medium.east, medium.depth, indexing="ij")
    expected = speed(n, e, z)
    at_surface_and_4 = (n == 4000.0) & (z == 0.0)  # typed 2*1520.0: no change along x there
    expected[at_surface_and_4] = 1520.0
    np.testing.assert_allclose(medium.sound_speed, expected, rtol=0, atol=1e-9)
    bed = 800.0 + 100.0 * (n[..., 0] - 500.0) / 4500.0 + 10.0 * (e[..., 0] + 1000.0) / 2000.0
    np.testing.assert_allclose(medium.bathymetry, bed, rtol=0, atol=1e-9)

    flipped = read_bellhop(DATA / "bellhop_hand.env")
    np.testing.assert_array_equal(flipped.sound_speed, medium.sound_speed.swapaxes(0, 1))
    np.testing.assert_array_equal(flipped.bathymetry, medium.bathymetry.T)


def test_merging_two_grids_changes_no_interpolated_value(tmp_path):
    medium, other = grid_medium(seed=1), grid_medium(5, 5, seed=2)
    (env,) = write_bellhop(tmp_path, medium, middle(medium, 20.0), middle(medium, 30.0, (9.0, 0.0)))
    write_bellhop(tmp_path, other, middle(other, 20.0), middle(other, 30.0, (9.0, 0.0)), name="other")
    (tmp_path / "other.bty").replace(env.with_suffix(".bty"))
    merged = read_bellhop(env)
    low, high = (
        [f(axis[i] for axis in axes) for axes in ((medium.north, other.north), (medium.east, other.east))]
        for f, i in ((max, 0), (min, -1))
    )
    assert (merged.north[0], merged.east[0], merged.north[-1], merged.east[-1]) == (*low, *high)
    points = np.random.default_rng(3).uniform([*low, 0.0], [*high, 1000.0], (50, 3))

    def values(m, name):
        axes = (m.north, m.east, m.depth)[: getattr(m, name).ndim]
        return RegularGridInterpolator(axes, getattr(m, name))(points[:, : len(axes)])

    np.testing.assert_allclose(
        values(merged, "sound_speed"), values(medium, "sound_speed"), rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(values(merged, "bathymetry"), values(other, "bathymetry"), rtol=0, atol=1e-9)


def test_two_dimensional_files(tmp_path):
    text = (DATA / "bellhop_plane.env").read_text()
    flat = read_bellhop(DATA / "bellhop_plane.env")
    assert (flat.bathymetry.tolist(), flat.interpolation) == ([[2000.0]], "linear")
    (tmp_path / "slope.env").write_text(text.replace("'CVW'", "'SVW'").replace("'R' 0.0", "'R*' 0.0"))
    (tmp_path / "slope.bty").write_text("'LS'\n3\n0.0 2000.0\n1.0 1500.0\n5.0 1400.0\n")
    slope = read_bellhop(tmp_path / "slope")
    assert slope.interpolation == "smooth"
    assert slope.north.tolist() == [0.0, 1000.0, 5000.0]
    assert slope.bathymetry.tolist() == [[2000.0], [1500.0], [1400.0]]
    environment = read_environment(tmp_path / "slope")
    assert not environment.three_d
    assert environment.box == (2500.0, math.inf, 2100.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "'CVW'",
            "'NVW'",
            r"a\.env, line 4: profile option 'N' \(n-squared linear\); supported are C, S and H",
        ),
        ("'CVW'", "'CVW ~'", "altimetry file; a medium's surface is flat"),
        ("   0.0  1500.0  /", "   1.0  1500.0  /", "the first level, Bellhop's surface, is at 1 m"),
        (
            "2000.0  1500.0  /",
            "1999.0 1500.0 /",
            "line 7: the profile ends above the last level that is announced, 2000 m",
        ),
        ("   0.0  1500.0  /", "0.0 1500.0 /\n0.0 1500.0 /", "level 0 m follows 0 m; depths must increase"),
        ("1\n500.0 /\n", "", "2 lists of positions before the run type; a 2-D file has 3, a 3-D file 6"),
        ("500.0 /", "abc /", "'abc' is not a number"),
        ("400.0 900.0 /", "/", "0 of 2 numbers before the slash"),
        ("50.0 2100.0 2.5\n", "", "the file ends where step and box is expected"),
        ("\n1\n'CVW'", "\n2\n'CVW'", "number of media: 2; Bellhop's is 1"),
        ("'R' 0.0", "'R~' 0.0", r"a\.bty: cannot be read: No such file"),
        ("'CVW'", "'HVW'", r"a\.ssp: cannot be read: No such file"),
        ("1500.0", "NaN", "'NaN' is not finite"),
        ("1500.0", "15.0", "15 to 15 m/s; sea water lies in"),
    ],
)
def test_what_is_no_medium_is_refused_in_one_line(tmp_path, old, new, message):
    text = (DATA / "bellhop_plane.env").read_text()
    assert old in text
    (tmp_path / "a.env").write_text(text.replace(old, new))
    with pytest.raises(AcousticsError, match=message) as caught:
        read_bellhop(tmp_path / "a.env")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("bty", "'R'", "'L'", "type 'L'; a 3-D bathymetry has R or C"),
        ("bty", "0.5 5.0", "5.0 0.5", "y: the coordinates must increase"),
        ("bty", "-1.0 3.0 /", "30.0 40.0 /", "must overlap"),
        ("ssp", "1721.0", "", "ends where sound speeds of depth 3, y 3 is expected"),
        ("ssp", "0.0 100.0 1000.0", "5.0 100.0 1000.0", "first level, Bellhop's surface, is at 5 m"),
        ("ssp", "2\n0.0 4.0", "1\n0.0", "number of points in x: 1; allowed are 2"),
    ],
)
def test_damaged_grids_are_refused_in_one_line(tmp_path, name, old, new, message):
    for suffix in ("env", "ssp", "bty"):
        text = (DATA / f"bellhop_hand.{suffix}").read_text()
        (tmp_path / f"a.{suffix}").write_text(text.replace(old, new, 1) if suffix == name else text)
    with pytest.raises(AcousticsError, match=message) as caught:
        read_bellhop(tmp_path / "a.env")
    assert "\n" not in str(caught.value)


def test_what_bellhop_would_move_or_lose_is_not_written(tmp_path):
    medium = grid_medium()
    inside = middle(medium, 20.0)
    for receiver in (middle(medium, 20.0, (1e5, 0.0)), middle(medium, 1000.5), middle(medium, -1.0)):
        with pytest.raises(AcousticsError, match=r"receiver of link 0: .* is outside the grid or its levels"):
            write_bellhop(tmp_path, medium, inside, receiver)
    deep = Medium.from_profile([-5.0, 100.0], [1500.0, 1500.0], bottom_depth=100.0)
    with pytest.raises(AcousticsError, match="the first level is at -5 m; Bellhop takes it for the surface"):
        write_bellhop(tmp_path, deep, [0, 0, 10], [0, 100, 10])
    for wrong in (
        {"beams": 1},
        {"cone": 4.0},
        {"name": "a/b"},
        {"run": "tl"},
        {"bottom": "mud"},
        {"frequency": 0.0},
    ):
        with pytest.raises(AcousticsError, match=next(iter(wrong))):
            write_bellhop(tmp_path, medium, inside, middle(medium, 20.0, (9.0, 0.0)), **wrong)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(AcousticsError, match="sound_speed is -1"):
        HalfSpace(sound_speed=-1.0, density_g_per_cm3=1.0)


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_a_finer_linear_medium_nears_the_same_ocean(interpolation):
    axis = np.linspace(0.0, 8000.0, 5)
    z = np.linspace(0.0, 1000.0, 11)
    n, e, d = np.meshgrid(axis, axis, z, indexing="ij")
    c = 1480.0 + 5.0 * np.sin(n / 3e3) * np.cos(e / 4e3) + 8.0 * np.cos(d / 300.0)
    medium = Medium.from_grid(
        axis, axis, z, c, bathymetry=1000.0 + n[..., 0] / 100.0, interpolation=interpolation
    )
    points = np.random.default_rng(5).uniform([0, 0, 0], [8000.0, 8000.0, 1000.0], (200, 3))
    exact = find_eigenrays(medium, points, points).source_sound_speed

    def error(parts):
        fine = linear_medium(medium, horizontal=parts, vertical=parts)
        assert fine.bathymetry[parts, 0] == pytest.approx(1020.0)
        return np.abs(find_eigenrays(fine, points, points).source_sound_speed - exact).max()

    errors = [error(parts) for parts in (1, 2, 4, 8)]
    if interpolation == "linear":
        assert max(errors) < 1e-9, errors
    else:  # second order, also between 2 and 8 where the cells are small
        assert errors[0] > 0.1
        assert errors[1] / errors[3] > 8.0, errors
