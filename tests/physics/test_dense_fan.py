"""
Eigenrays of ducts, direct and reflected, against `oracles.DenseFan`, a brute-force fan that shares
no code with the solver.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from factories import ARCTIC_DEPTH, arctic
from oracles import DenseFan, direct_travel_time_linear_gradient
from scipy.interpolate import CubicSpline, PPoly, make_interp_spline

from pymantaray.acoustics import Medium, find_eigenrays

BOTTOM, SHALLOW = 3000.0, 350.0  # m; of direct rays, and of reflected ones
# m, rad, s; the angle at the far end of a ray that diverges is worse than its time
MISS, ANGLE, TIME = (3e-2, 1e-5, 1e-6)


class Section(NamedTuple):
    """
    Sound speed in the vertical plane of all links, as the fan takes it and as a medium of the
    solver.
    """

    fan: DenseFan
    medium: Medium


def uniform(depth, speed, bottom=BOTTOM, step=10.0, most=(0, 0)):
    profile = CubicSpline(depth, speed, bc_type="natural")
    medium = Medium.from_profile(depth, speed, bottom_depth=bottom)
    return Section(DenseFan(lambda _: profile, bottom, step, most), medium)


def sloping(depth, north, speed):
    """A section that varies along north; the medium repeats it eastwards."""
    east = np.linspace(-20e3, 20e3, 4)
    grid = np.repeat(speed[:, None], 4, axis=1)
    medium = Medium.from_grid(north, east, depth, grid, bathymetry=np.full((north.size, 4), BOTTOM))
    along = make_interp_spline(
        north, CubicSpline(depth, speed, axis=1, bc_type="natural").c, axis=2
    )
    return Section(DenseFan(lambda r: PPoly(along(r), depth), BOTTOM, 10.0), medium)


def solved(section, depth, receivers, end="deeper"):
    """
    What the solver finds, solved from the end that it prefers, from the source or from the
    receiver.
    """
    source = np.tile([0.0, 0.0, depth], (len(receivers), 1))
    receiver = np.column_stack([receivers[:, 0], np.zeros(len(receivers)), receivers[:, 1]])
    most = section.fan.most
    if end != "receiver":
        return find_eigenrays(section.medium, source, receiver, *most, canonical=end == "deeper")
    back = find_eigenrays(section.medium, receiver, source, *most, canonical=False)
    return replace(back, launch_angle=-back.arrival_angle, arrival_angle=-back.launch_angle)


def pair_up(fan, arrivals, depth, receivers, steepest):
    """
    Eigenrays within 15 dB that the solver misses or invents, and how many agree.

    Rays of both are one where they have the same reflections, arrive within 1 us and would end
    within 3 cm of each other.
    """
    missed, invented, agreed = [], [], 0
    for j, place in enumerate(receivers):
        left = list(np.flatnonzero(arrivals.link == j))
        for k in np.flatnonzero(fan.link == j):
            gap = np.abs(arrivals.launch_angle[left] - fan.angle[k])
            same = (gap * fan.slope[k] < MISS) | (gap < ANGLE)
            same &= np.abs(arrivals.travel_time[left] - fan.time[k]) < TIME
            same &= arrivals.surface_bounces[left] == fan.surface[k]
            same &= arrivals.bottom_bounces[left] == fan.bottom[k]
            if same.any():
                left.pop(int(np.argmin(np.where(same, gap, np.inf))))
                agreed += 1
            elif not fan.grazing[k] and fan.spreading[k] < 14.9:
                missed.append((depth, *place, *(float(column[k]) for column in fan)))
        grazing = fan.time[(fan.link == j) & fan.grazing]
        invented += [
            (depth, *place, arrivals.launch_angle[k], arrivals.travel_time[k])
            for k in left
            if abs(arrivals.launch_angle[k]) < steepest
            and not (np.abs(grazing - arrivals.travel_time[k]) < TIME).any()
        ]
    return missed, invented, agreed


def check(section, depth, receivers, least, spacing=1e-4, steepest=0.6):
    fan = section.fan.eigenrays(depth, receivers, spacing, steepest)
    margin = 1e-3 if any(section.fan.most) else 0.0
    missed, invented, agreed = pair_up(
        fan, solved(section, depth, receivers), depth, receivers, steepest - margin
    )
    assert agreed >= least, agreed
    assert not missed, missed
    assert not invented, invented


@pytest.fixture(scope="module")
def sections():
    """
    An Arctic duct, two ducts one below the other, a duct that a front and an eddy cross, and one
    over a shallow bed.
    """
    depth, speed = ARCTIC_DEPTH, arctic(ARCTIC_DEPTH)
    double = 1440.0 + 0.016 * depth + 7.0 * np.exp(-(((depth - 50.0) / 20.0) ** 2))
    double += 5.0 * np.exp(-(((depth - 220.0) / 50.0) ** 2))
    north = np.linspace(-5e3, 25e3, 13)
    front = speed + 6.0 * np.tanh((north[:, None] - 8e3) / 4e3) * np.exp(-depth / 400.0)
    front += 5.0 * np.exp(-(((north[:, None] - 5e3) / 6e3) ** 2) - ((depth - 150.0) / 120.0) ** 2)
    return {
        "arctic": uniform(depth, speed),
        "double": uniform(depth, double),
        "front": sloping(depth, north, front),
        "shallow": uniform(depth, speed, SHALLOW, 5.0, (2, 1)),
    }


def places(n, seed, longest=12e3, shallow=False):
    """
    Ranges in whole steps; depths in and about the ducts, some of them on levels, or anywhere in
    shallow water.
    """
    rng = np.random.default_rng(seed)
    distance = np.rint(rng.uniform(800.0, longest, n) / 10.0) * 10.0
    if shallow:
        return np.column_stack([distance, rng.uniform(2.0, SHALLOW - 2.0, n)])
    depth = np.where(
        rng.random(n) < 0.8,
        rng.uniform(2.0, 350.0, n),
        rng.choice([0.5, 30.0, 60.0, 130.0, 200.0], n),
    )
    return np.column_stack([distance, depth])


def test_the_fan_finds_the_arcs_of_a_constant_gradient():
    depth = np.linspace(0.0, BOTTOM, 31)
    ends = places(12, 1, longest=5e3)
    fan = uniform(depth, 1450.0 + 0.05 * depth).fan.eigenrays(130.0, ends, 1e-3, 0.6)
    wet = ~fan.grazing
    exact = direct_travel_time_linear_gradient(
        [0.0, 0.0, 130.0],
        np.column_stack([ends[:, 0], np.zeros(12), ends[:, 1]])[fan.link],
        sound_speed_surface=1450.0,
        gradient=0.05,
    )
    assert wet.sum() >= 6
    np.testing.assert_allclose(fan.time[wet], exact[wet], rtol=0, atol=1e-8)
    np.testing.assert_array_less(np.abs(fan.spreading[wet]), 1.0)


@pytest.mark.slow
def test_the_fan_itself_finds_the_images_of_a_wave_guide():
    ends = places(4, 1, 3e3, shallow=True)
    fan = uniform(np.linspace(0.0, 400.0, 5), np.full(5, 1500.0), SHALLOW, 5.0, (2, 1)).fan
    fan = fan.eigenrays(100.0, ends, 1e-3, 0.9)
    expected = []
    for j, (r, z) in enumerate(ends):
        for climb, surface, bottom in (
            (z - 100.0, 0, 0),
            (z + 100.0, 1, 0),
            (2 * SHALLOW - z - 100.0, 0, 1),
            (2 * SHALLOW + 100.0 - z, 1, 1),
            (2 * SHALLOW - 100.0 + z, 1, 1),
            (2 * SHALLOW + 100.0 + z, 2, 1),
        ):
            if climb / r < np.tan(0.899):
                expected.append((j, surface, bottom, np.hypot(r, climb) / 1500.0))
    mine = sorted(zip(fan.link, fan.surface, fan.bottom, fan.time, strict=True))
    assert len(mine) == len(expected) > 16
    np.testing.assert_allclose(mine, sorted(expected), rtol=0, atol=1e-9)


def many(*depths):
    return [pytest.param(depth, True, marks=pytest.mark.slow) for depth in depths]


@pytest.mark.parametrize(
    ("name", "depth", "long"),
    [
        ("front", 145.0, False),
        *(
            pytest.param(name, depth, True, marks=pytest.mark.slow)
            for name, depth in (
                ("front", 0.5),
                ("front", 130.0),
                ("arctic", 130.0),
                ("double", 0.5),
            )
        ),
    ],
)
def test_fan_finds_no_eigenray_that_the_solver_misses(sections, name, depth, long):
    """200 links where it is long."""
    if long:
        check(sections[name], depth, places(50, int(10 * depth)), 10)
    else:
        check(sections[name], depth, places(14, 3, longest=6e3), 15, 2e-4, 0.4)


@pytest.mark.slow
@pytest.mark.parametrize(("depth", "long"), [(145.0, False), *many(0.5, 130.0)])
def test_fan_finds_no_reflected_eigenray_that_the_solver_misses(sections, depth, long):
    """24 links where it is long."""
    if long:
        check(sections["shallow"], depth, places(12, int(10 * depth), 6e3, True), 44, steepest=0.7)
    else:
        check(sections["shallow"], depth, places(4, 3, 3e3, True), 14, 4e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "depth"), [("arctic", 20.0), ("double", 81.2), ("front", 20.0)])
def test_nothing_is_missed_from_either_end(sections, name, depth):
    """
    150 more links, to 14 km and from crests, solved from either end without regard to which is
    easier.

    Rays that only the solver finds are not looked at: in a window of rays in the water narrower
    than its spacing the fan finds none.
    """
    ends = places(50, int(10 * depth) + 7, longest=14e3)
    fan = sections[name].fan.eigenrays(depth, ends, 1e-4, 0.6)
    for end in ("source", "receiver"):
        missed, _, agreed = pair_up(fan, solved(sections[name], depth, ends, end), depth, ends, 0.6)
        assert agreed >= 10
        assert not missed, (end, missed)
