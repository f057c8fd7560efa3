"""
A medium and its links written for Bellhop, read by a reader that shares nothing with the writer.
"""

import math

import numpy as np
import pytest
from bellhop_stand_in import read_boundary, read_env, read_grids
from hypothesis import given, settings, strategies as st
from refusals import refused

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.apps.bellhop import BellhopOptions, HalfSpace, linear_medium, write_bellhop
from pymantaray.errors import AcousticsError

DEPTH = np.array([0.0, 10.0, 50.0, 200.0, 1000.0])
PROFILE = Medium.from_profile(
    DEPTH, 1450.0 + 0.017 * DEPTH, bottom_depth=1234.5, interpolation="linear"
)
ATOL_POSITION = 1e-9  # m; double precision of a range and a bearing


def grid_medium(n_north=4, n_east=3, *, seed=0):
    rng = np.random.default_rng(seed)
    north = np.cumsum(rng.uniform(500.0, 2000.0, n_north)) - 3000.0
    east = np.cumsum(rng.uniform(500.0, 2000.0, n_east)) + 70_000.0
    c = rng.uniform(1430.0, 1520.0, (n_north, n_east, DEPTH.size))
    bed = rng.uniform(300.0, 1000.0, (n_north, n_east))
    return Medium.from_grid(north, east, DEPTH, c, bathymetry=bed, interpolation="linear")


def middle(medium, depth, offset=(0.0, 0.0)):
    return np.array([medium.north.mean() + offset[0], medium.east.mean() + offset[1], depth])


@settings(max_examples=25)
@given(n_north=st.integers(1, 4), n_east=st.integers(1, 4), seed=st.integers(0, 2**32 - 1))
def test_a_medium_is_written_to_the_last_bit(tmp_path_factory, n_north, n_east, seed):
    medium = grid_medium(n_north, n_east, seed=seed)
    folder = tmp_path_factory.mktemp("round")
    step = [8e4 if n == 1 else 1.0 for n in (n_north, n_east)]
    (env,) = write_bellhop(folder, medium, middle(medium, 20.0), middle(medium, 100.0, step))
    water, bed = read_grids(env)
    assert (water is None) == (n_north == n_east == 1) == (read_env(env).profile == "C")
    profile = medium.sound_speed.mean(axis=(0, 1))
    np.testing.assert_array_equal(read_env(env).levels, np.stack([DEPTH, profile], axis=1))
    grids = [(bed, medium.bed.depth)] + ([] if water is None else [(water, medium.sound_speed)])
    for (north, east, *_, values), expected in grids:
        found = np.array(values)
        for k, (axis, own) in enumerate(((north, medium.north), (east, medium.east))):
            if (
                own.size == 1
            ):  # two points about it, far beyond the link, and no variation between them
                assert axis[0] < own[0] - 8e4 < own[0] + 8e4 < axis[1]
                np.testing.assert_array_equal(*np.split(found, 2, axis=k))
                found = found.take([0], axis=k)
            else:
                np.testing.assert_array_equal(axis, own)
        np.testing.assert_array_equal(found, expected)
    if water is not None:
        np.testing.assert_array_equal(water[2], DEPTH)


@pytest.mark.parametrize(("north", "east"), [(-400.1, 500.7), (400.1, 0.0), (0.0, -500.7)])
def test_positions_fan_and_box_use_x_north_and_clockwise_bearings(tmp_path, north, east, as_stored):
    medium = grid_medium()
    source = np.array([medium.north[1] + 0.123, medium.east[1] + 1 / 3, 12.3])
    receiver = source + np.array([north, east, 101.9])
    options = BellhopOptions(beams=11, cone=0.2, run="rays", frequency=12_345.0, step=7.0)
    (env,) = write_bellhop(tmp_path, medium, source, receiver, options)
    found = read_env(env)
    as_stored(env.read_text())
    assert found.source == tuple(source)
    assert (found.run_type, found.frequency, found.step) == ("RG RR3", 12_345.0, 7.0)
    r, bearing = found.receiver_range, found.receiver_bearing
    there = [
        source[0] + r * math.cos(bearing),
        source[1] + r * math.sin(bearing),
        found.receiver_depth,
    ]
    np.testing.assert_allclose(there, receiver, rtol=0, atol=ATOL_POSITION)
    slope, fan = (
        math.atan2(101.9, math.hypot(north, east)),
        np.linspace(-0.2, 0.2, 11),
    )  # positive down
    np.testing.assert_allclose(found.declinations, slope + fan, atol=1e-12)
    np.testing.assert_allclose(found.bearings, math.atan2(east, north) + fan, atol=1e-12)
    assert np.all(found.box[:2] > np.abs(receiver - source)[:2])
    assert found.box[2] > medium.bed.depth.max()


def test_links_share_their_grids_and_the_origin_moves_them(tmp_path, as_stored):
    medium = grid_medium()
    a, b = middle(medium, 20.0), middle(medium, 100.0, (50.0, 60.0))
    for _ in range(2):  # the second time over the first
        paths = write_bellhop(tmp_path, medium, [a, b], [b, a], origin=a[:2])
    assert [path.name for path in paths] == ["link_0.env", "link_1.env"]
    for suffix in (".ssp", ".bty"):
        first, second = (path.with_suffix(suffix) for path in paths)
        assert first.samefile(second)
    assert read_env(paths[0]).source == (0.0, 0.0, 20.0)
    (north, *_, c), _ = read_grids(paths[1])
    np.testing.assert_allclose(north, medium.north - a[0], rtol=0, atol=ATOL_POSITION)
    np.testing.assert_array_equal(c, medium.sound_speed)
    as_stored({file.name: file.read_text() for file in sorted(tmp_path.iterdir())})
    assert len(list(tmp_path.iterdir())) == 6


def test_ice_is_bellhops_altimetry(tmp_path, as_stored):
    bare = grid_medium()
    draft = np.random.default_rng(1).uniform(0.0, 9.0, bare.bed.depth.shape)
    axes = (bare.north, bare.east, bare.depth, bare.sound_speed)
    iced = Medium.from_grid(*axes, bathymetry=bare.bed, interpolation="linear", ice_draft=draft)
    for medium in (iced, linear_medium(iced, horizontal=2)):
        (env,) = write_bellhop(tmp_path / "ice", medium, middle(bare, 20.0), middle(bare, 100.0))
        assert read_env(env).altimetry
        north, east, found = read_boundary(env.with_suffix(".ati"))
        np.testing.assert_array_equal((*north, *east), (*bare.north, *bare.east))
        np.testing.assert_array_equal(found, draft)
    ice = sorted((tmp_path / "ice").iterdir())
    as_stored({file.name: file.read_text() for file in ice})
    (env,) = write_bellhop(tmp_path / "open", bare, middle(bare, 20.0), middle(bare, 100.0))
    assert not read_env(env).altimetry
    assert not env.with_suffix(".ati").exists()


@pytest.mark.parametrize(("bottom", "letter", "expected"), [
    ("rigid", "R", None),
    ("vacuum", "V", None),
    ("matching", "A", [1000.0, 1467.0, 0.0, 1.0, 0.0, 0.0]),
    (HalfSpace(1650.0, 1.9, 0.8, 300.0, 1.5), "A", [1000.0, 1650.0, 300.0, 1.9, 0.8, 1.5]),
])  # fmt: skip
def test_bottoms(tmp_path, bottom, letter, expected, as_stored):
    (env,) = write_bellhop(
        tmp_path, PROFILE, [0, 0, 10], [500.0, 0, 20], BellhopOptions(bottom=bottom)
    )
    as_stored(env.read_text())
    assert (read_env(env).bottom, read_env(env).half_space) == (letter, expected)


def test_what_bellhop_would_move_or_lose_is_not_written(tmp_path):
    medium = grid_medium()
    inside = middle(medium, 20.0)
    for receiver in (
        middle(medium, 20.0, (1e5, 0.0)),
        middle(medium, 1000.5),
        middle(medium, -1.0),
    ):
        with pytest.raises(
            AcousticsError, match=r"receiver of link 0: .* is outside the grid or its levels"
        ):
            write_bellhop(tmp_path, medium, inside, receiver)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("parts", [{"horizontal": 0}, {"vertical": 0}])
def test_a_finer_medium_has_one_part_of_each_cell_at_least(parts):
    words = "; both must be at least 1"
    refused(AcousticsError, words, linear_medium, grid_medium(), **parts)


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_a_finer_linear_medium_nears_the_same_ocean(interpolation):
    axis, z = np.linspace(0.0, 8000.0, 5), np.linspace(0.0, 1000.0, 11)
    n, e, d = np.meshgrid(axis, axis, z, indexing="ij")
    c = 1480.0 + 5.0 * np.sin(n / 3e3) * np.cos(e / 4e3) + 8.0 * np.cos(d / 300.0)
    bed = 1000.0 + n[..., 0] / 100.0
    medium = Medium.from_grid(axis, axis, z, c, bathymetry=bed, interpolation=interpolation)
    points = np.random.default_rng(5).uniform([0, 0, 0], [8000.0, 8000.0, 1000.0], (200, 3))
    exact = find_eigenrays(medium, points, points).source_sound_speed

    def error(parts):
        fine = linear_medium(medium, horizontal=parts, vertical=parts)
        assert fine.bed.depth[parts, 0] == pytest.approx(1020.0)
        return np.abs(find_eigenrays(fine, points, points).source_sound_speed - exact).max()

    most = "horizontal 1000, vertical 1000: 160,096,018,001 points; at most 100,000,000"
    refused(AcousticsError, most, error, 1000)  # 4001 x 4001 x 10,001
    errors = [error(parts) for parts in (1, 2, 4, 8)]
    if interpolation == "linear":
        assert max(errors) < 1e-9, errors
    else:  # second order, also between 2 and 8 where the cells are small
        assert errors[0] > 0.1
        assert errors[1] / errors[3] > 8.0, errors


def test_the_medium_of_two_columns_is_linear_between_them():
    column = np.array([1450.0, 1451.0, 1453.0, 1456.0])
    speed = np.add.outer([[0.0, 2.0], [4.0, 6.0]], column)
    axes = [0.0, 1e3], [0.0, 2e3], [0.0, 50.0, 100.0, 200.0]
    medium = Medium.from_grid(*axes, speed, bathymetry=200.0)
    finer = linear_medium(medium, horizontal=2, vertical=1)
    np.testing.assert_allclose(finer.sound_speed[1, 1], column + 3.0, rtol=1e-12)
