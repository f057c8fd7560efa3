"""
A section of sound speed by range and depth, as a table, as Bellhop's files or in memory, is water
whose rays are those of an independent integration through the section.
"""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from pymantaray import open_water
from pymantaray.acoustics import find_eigenrays
from pymantaray.errors import MantaRayError

RANGES = np.array([0.0, 1000.0, 2200.0, 2700.0, 3100.0, 4500.0, 6000.0])
DEPTH = np.array([0.0, 50.0, 120.0, 300.0, 700.0, 1200.0])
FRONT = -6.0 * np.tanh((RANGES - 2700.0) / 600.0)  # m/s
SPEED = 1500.0 + 0.004 * (DEPTH - 300.0)[:, None] ** 2 / 60.0 + FRONT
OPTIONS = {"bathymetry": 1200.0, "interpolation": "linear"}


def table(path, ranges=RANGES, head="depth", separator=","):
    """Table as pandas writes a frame with depths as index and ranges as columns."""
    frame = pd.DataFrame(SPEED, index=pd.Index(DEPTH, name=head), columns=ranges)
    frame.to_csv(path, sep=separator)
    return path


def bellhop(folder):
    """An ``.ssp`` beside the ``.env`` with its depths."""
    rows = [" ".join(f"{c:.17g}" for c in row) for row in SPEED]
    ranges = " ".join(f"{r / 1e3:.17g}" for r in RANGES)
    (folder / "case.ssp").write_text("\n".join([f"{RANGES.size}", ranges, *rows, ""]))
    profile = "\n".join(f"{z:g} {c:.6f} /" for z, c in zip(DEPTH, SPEED[:, 0], strict=True))
    (folder / "case.env").write_text(
        f"'front'  ! title\n1000.0 ! Hz\n1\n'QVWT'\n0 0.0 1200.0\n{profile}\n'A' 0\n"
    )
    return folder / "case.ssp"


def travel_times(water, bearing):
    """Travel times [s] of three links along a bearing [degrees]."""
    turn = np.radians(bearing)
    along = np.array([[np.cos(turn), np.sin(turn), 0.0]])
    near, far = np.array([[500.0], [200.0], [900.0]]), np.array([[5200.0], [5900.0], [3000.0]])
    depth = np.array([[[80.0, 250.0]], [[400.0, 90.0]], [[200.0, 600.0]]])
    down = np.array([[0.0, 0.0, 1.0]])
    ends = [r * along + depth[..., k] * down for k, r in enumerate((near, far))]
    return find_eigenrays(water.at_start[0], *ends).first().travel_time


def traced(ends):
    """Travel time [s] of the direct ray between two points (range, depth) by DOP853."""
    lookup = xr.DataArray(SPEED.T, {"range": RANGES, "depth": DEPTH}, ("range", "depth"))

    def speed(r, z):
        i = int(np.clip(np.searchsorted(RANGES, r) - 1, 0, RANGES.size - 2))
        k = int(np.clip(np.searchsorted(DEPTH, z) - 1, 0, DEPTH.size - 2))
        u = (r - RANGES[i]) / (RANGES[i + 1] - RANGES[i])
        v = (z - DEPTH[k]) / (DEPTH[k + 1] - DEPTH[k])
        c = lookup.values[i : i + 2, k : k + 2]
        value = (1 - u) * ((1 - v) * c[0, 0] + v * c[0, 1]) + u * ((1 - v) * c[1, 0] + v * c[1, 1])
        by_r = ((1 - v) * (c[1, 0] - c[0, 0]) + v * (c[1, 1] - c[0, 1])) / np.diff(RANGES)[i]
        by_z = ((1 - u) * (c[0, 1] - c[0, 0]) + u * (c[1, 1] - c[1, 0])) / np.diff(DEPTH)[k]
        return value, by_r, by_z

    (r0, z0), (r1, z1) = ends

    def end(angle):
        def slope(r, y):
            c, by_r, by_z = speed(r, y[0])
            tangent = np.tan(y[1])
            return [tangent, (by_r * tangent - by_z) / c, 1.0 / (c * np.cos(y[1]))]

        path = solve_ivp(
            slope,
            (r0, r1),
            [z0, angle, 0.0],
            method="DOP853",
            rtol=1e-11,
            atol=1e-10,
            max_step=20.0,
        )
        return path.y[:, -1]

    chord = np.arctan2(z1 - z0, r1 - r0)
    angle = brentq(lambda a: end(a)[0] - z1, chord - 0.05, chord + 0.05, xtol=1e-13)
    return end(angle)[2]


def test_rays_through_a_table_are_those_of_an_integration(tmp_path):
    water = open_water(table(tmp_path / "front.csv"), **OPTIONS)
    expected = [
        traced(ends)
        for ends in (
            ((500.0, 80.0), (5200.0, 250.0)),
            ((200.0, 400.0), (5900.0, 90.0)),
            ((900.0, 200.0), (3000.0, 600.0)),
        )
    ]
    np.testing.assert_allclose(travel_times(water, 0.0), expected, rtol=0.0, atol=2e-8)


def test_all_forms_of_a_section_are_the_same_water(tmp_path):
    data = xr.DataArray(SPEED, {"depth": DEPTH, "range": RANGES}, ("depth", "range"))
    data.to_dataset(name="sound_speed").to_netcdf(tmp_path / "section.nc")
    expected = travel_times(open_water(data, **OPTIONS), 0.0)
    for source in (
        table(tmp_path / "metres.csv"),
        table(tmp_path / "tabs.txt", separator="\t"),
        table(tmp_path / "kilometres.csv", RANGES / 1e3, "depth [m] \\ range [km]"),
        bellhop(tmp_path),
        tmp_path / "section.nc",
    ):
        times = travel_times(open_water(source, **OPTIONS), 0.0)
        np.testing.assert_allclose(times, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
def test_a_section_may_have_any_bearing(tmp_path, interpolation):
    path, options = table(tmp_path / "front.csv"), OPTIONS | {"interpolation": interpolation}
    expected = travel_times(open_water(path, **options), 0.0)
    for bearing in (90.0, 180.0, 270.0, -90.0, 360.0):
        times = travel_times(open_water(path, bearing=bearing, **options), bearing)
        np.testing.assert_allclose(times, expected, rtol=0.0, atol=1e-9)
    error = 3e-7 if interpolation == "smooth" else 2e-6
    for bearing in (10.0, 33.0, 123.0, 250.0, -45.0):
        times = travel_times(open_water(path, bearing=bearing, **options), bearing)
        np.testing.assert_allclose(times, expected, rtol=0.0, atol=error)


def test_a_turned_section_has_its_own_sea_floor_and_ends(tmp_path):
    """Its levels end at 700 m beyond 4 km; behind its ends the water is that of the ends."""
    data = xr.DataArray(SPEED, {"depth": DEPTH, "range": RANGES}, ("depth", "range"))
    data = data.where((data["depth"] < 1000.0) | (data["range"] < 4000.0))
    along, turned = (open_water(data, bearing=b, interpolation="linear") for b in (0.0, 60.0))
    places = np.c_[np.array([500.0, 2500.0, 3500.0, 5000.0]), np.zeros((4, 2))]
    turn = np.radians(60.0)
    matrix = np.array(
        [[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    there = places @ matrix
    floors = [w.at_start[0].bottom_depth(p) for w, p in ((along, places), (turned, there))]
    np.testing.assert_allclose(floors[1], floors[0], atol=1.0)
    behind = np.array([[-5000.0, 0.0, 300.0]]) @ matrix
    first = SPEED[3, 0] - (SPEED[3, 1] - SPEED[3, 0])
    np.testing.assert_allclose(turned.at_start[0].sound_speed_at(behind), first, atol=1e-9)


def test_a_turned_section_has_a_grid_of_limited_size(tmp_path):
    ranges = np.arange(0.0, 60_000.0, 100.0)
    speed = np.full((DEPTH.size, ranges.size), 1500.0)
    data = xr.DataArray(speed, {"depth": DEPTH, "range": ranges}, ("depth", "range"))
    with pytest.raises(MantaRayError, match="use a bearing of 0, 90, 180 or 270 degrees, a small"):
        open_water(data, bearing=30.0, bathymetry=1200.0)
    water = open_water(data, bearing=30.0, bathymetry=1200.0, half_extent=(5e3, 5e3))
    assert water.at_start[0].north[-1] == 5e3


def test_the_direction_of_a_section_is_its_own(tmp_path):
    """The sound speed decreases with range, so towards the bearing."""
    path = table(tmp_path / "front.csv")
    for bearing in (0.0, 90.0, 180.0, 270.0, 33.0):
        medium, _ = open_water(path, bearing=bearing, **OPTIONS).at_start
        turn = np.radians(bearing)
        places = [[r * np.cos(turn), r * np.sin(turn), 300.0] for r in (0.0, 2000.0, 5000.0)]
        np.testing.assert_allclose(
            medium.sound_speed_at(places),
            1500.0 + np.interp([0.0, 2000.0, 5000.0], RANGES, FRONT),
            atol=2e-3,
        )


def test_a_cast_with_three_columns_is_no_section(tmp_path):
    path = tmp_path / "cast.csv"
    path.write_text("depth,temperature,salinity\n0,10,35\n50,9,35\n200,8,35\n")
    assert open_water(path, bathymetry=300.0, centre=(60.0, 0.0)).uniform


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda text: text.replace("\n50.0,", "\n-5.0,"), "depths must increase"),
        (lambda text: text.rstrip().rpartition(",")[0], "line 7 has 7 cells"),
        (lambda text: text.replace("\n300.0,", "\nx,"), "line 5 has 8 cells"),
        (lambda text: text.replace("\n300.0,", "\n\n\nx,"), "line 7 has 8 cells"),
    ],
)
def test_a_wrong_table_is_refused_by_its_line(tmp_path, change, cause):
    path = table(tmp_path / "front.csv")
    path.write_text(change(path.read_text()))
    with pytest.raises(MantaRayError) as error:
        open_water(path, **OPTIONS)
    assert cause in str(error.value)


def test_depths_of_an_ssp_are_needed(tmp_path):
    path = bellhop(tmp_path)
    (tmp_path / "case.env").write_text("'front'\n1000\n1\n'QVWT'\n0 0 1200\n0 1500 /\n")
    with pytest.raises(MantaRayError, match="no profile of depths down to the bottom"):
        open_water(path, **OPTIONS)
    (tmp_path / "case.env").unlink()
    with pytest.raises(MantaRayError, match=r"case\.env"):
        open_water(path, **OPTIONS)


def test_an_env_is_refused_with_what_to_give_instead(tmp_path):
    env = bellhop(tmp_path).with_suffix(".env")
    with pytest.raises(
        MantaRayError, match=r"case\.env: an input file of Bellhop.* give the \.ssp"
    ):
        open_water(env, **OPTIONS)


def test_only_a_section_has_a_bearing():
    axes = {"north": [0.0, 1e3], "east": [0.0, 1e3], "depth": DEPTH}
    box = xr.DataArray(np.full((2, 2, DEPTH.size), 1500.0), axes).to_dataset(name="sound_speed")
    for source in ("synthetic:beaufort", box):
        with pytest.raises(MantaRayError, match="applies to a section of sound speed"):
            open_water(source, bearing=10.0)
