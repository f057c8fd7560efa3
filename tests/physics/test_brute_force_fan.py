"""Eigenrays of ducts against a brute-force fan that shares no code with the solver.

The fan integrates Hamilton's equations in range by RK4 with fixed steps, thousands of rays at a time, through
scipy's splines. Intervals of launch angle with a change of sign, an extremum of the miss near zero, or the edge of a
window of rays that stay in the water are divided by 8, three times. Spreading comes from
differences of depth between neighbouring rays.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PPoly, make_interp_spline

from pymantaray.acoustics import Medium, direct_travel_time_linear_gradient, find_eigenrays

Array = NDArray[np.float64]
BOTTOM = 3000.0
STEP = 10.0  # m
GRAZING = 0.02  # m; a ray this near a boundary may count as in the water or not
DIVISION = 8
MISS, ANGLE = 3e-2, 1e-5  # m, rad; the angle at the far end of a ray that diverges is worse than its time


class Section(NamedTuple):
    """Sound speed in the vertical plane of all links, and the same as a medium of the solver."""

    medium: Medium
    depth: Array
    coefficients: object  # range -> (4, layers) coefficients of the natural spline in depth


class Rays(NamedTuple):
    """What the fan found: one row per eigenray; slope is the change of the miss by the launch angle [m/rad]."""

    link: Array
    angle: Array
    time: Array
    spreading: Array
    slope: Array
    grazing: Array


def uniform_section(depth, speed):
    medium = Medium.from_profile(depth, speed, bottom_depth=BOTTOM)
    c = CubicSpline(depth, speed, bc_type="natural").c
    return Section(medium, depth, lambda _: c)


def sloping_section(depth, north, speed):
    """A section that varies along north; the medium repeats it eastwards."""
    east = np.linspace(-20e3, 20e3, 4)
    grid = np.repeat(speed[:, None], 4, axis=1)
    medium = Medium.from_grid(north, east, depth, grid, bathymetry=np.full((north.size, 4), BOTTOM))
    along = make_interp_spline(north, CubicSpline(depth, speed, axis=1, bc_type="natural").c, axis=2)
    return Section(medium, depth, lambda r: along(r))


def trace(section, depth, angles, steps):
    """Yield (depth, tangent state, least and greatest depth) of all rays after each step; lost rays are NaN."""
    c_source = float(PPoly(section.coefficients(0.0), section.depth)(depth))
    y = np.array([np.full(angles.size, depth), np.sin(angles), np.zeros(angles.size), np.zeros(angles.size)])
    least, greatest = np.full((2, angles.size), depth)

    def rates(poly, y):
        """Of depth, its slowness, travel time and the lateral spreading integral; slowness in units of 1/c_source."""
        c, slope = poly(y[0]), poly(y[0], 1)
        n2 = (c_source / c) ** 2
        h = np.sqrt(n2 - y[1] ** 2)
        return np.array([y[1] / h, -n2 * slope / (c * h), n2 / (h * c_source), 1.0 / h])

    polys = PPoly(section.coefficients(0.0), section.depth)
    with np.errstate(invalid="ignore"):
        for i in range(steps):
            middle = PPoly(section.coefficients((i + 0.5) * STEP), section.depth)
            end = PPoly(section.coefficients((i + 1.0) * STEP), section.depth)
            k1 = rates(polys, y)
            k2 = rates(middle, y + 0.5 * STEP * k1)
            k3 = rates(middle, y + 0.5 * STEP * k2)
            k4 = rates(end, y + STEP * k3)
            y = y + STEP / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            least, greatest = np.minimum(least, y[0]), np.maximum(greatest, y[0])
            y[:, (y[0] < 0.0) | (y[0] > BOTTOM)] = np.nan
            polys = end
            yield y, least, greatest


def candidates(miss):
    """Indices i of intervals [i, i + 1] in which a root may hide."""
    alive = np.isfinite(miss)
    with np.errstate(invalid="ignore"):
        change = miss[:-1] * miss[1:] <= 0.0
        edge = alive[:-1] != alive[1:]
        size = np.abs(miss)
        dip = np.zeros(miss.size, dtype=bool)
        dip[1:-1] = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]) & (miss[:-2] * miss[2:] > 0.0)
        bend = np.zeros(miss.size)
        bend[1:-1] = np.abs(miss[:-2] - 2.0 * miss[1:-1] + miss[2:])
        dip &= size < bend  # a parabola's vertex lies at most an eighth of this beyond the middle node
    near = dip[:-1] | dip[1:]
    return np.flatnonzero(change | edge | near)


def brute_force(section, depth, receivers, spacing, steepest):
    """Eigenrays from (0, depth) to receivers (n, 2) at whole steps: link, angle, time, spreading, grazing."""
    ends = np.rint(receivers[:, 0] / STEP).astype(int)
    angles = np.arange(-steepest, steepest, spacing)
    miss = np.empty((len(receivers), angles.size))
    for i, (y, _, _) in enumerate(trace(section, depth, angles, ends.max()), start=1):
        for link in np.flatnonzero(ends == i):
            miss[link] = y[0] - receivers[link, 1]
    link, left = [], []
    for j, row in enumerate(miss):
        found = candidates(row)
        link.append(np.full(found.size, j))
        left.append(angles[found])
    link, left, width = np.concatenate(link), np.concatenate(left), spacing
    for level in range(3):
        width /= DIVISION
        nodes = left[:, None] + width * np.arange(DIVISION + 1)
        state = np.full((6, *nodes.shape), np.nan)
        flat, owner = nodes.ravel(), np.repeat(link, DIVISION + 1)
        out = state.reshape(6, -1)
        for i, (y, least, greatest) in enumerate(trace(section, depth, flat, ends.max()), start=1):
            here = ends[owner] == i
            if here.any():
                out[:4, here], out[4, here], out[5, here] = y[:, here], least[here], greatest[here]
        state[0] -= receivers[link, 1][:, None]
        if level < 2:
            hits = [candidates(row) for row in state[0]]
            left = np.concatenate([nodes[j, hit] for j, hit in enumerate(hits)])
            link = np.repeat(link, [hit.size for hit in hits])
    with np.errstate(invalid="ignore"):
        row, at = np.nonzero(state[0, :, :-1] * state[0, :, 1:] <= 0.0)
    a, b = state[:, row, at], state[:, row, at + 1]
    t = a[0] / (a[0] - b[0])
    _, p, time, side, least, greatest = (1 - t) * a + t * b
    link, angle = link[row], nodes[row, at] + t * width
    speeds = []
    for r, z in receivers:
        speeds.append(PPoly(section.coefficients(r), section.depth)(z))
    c_source = float(PPoly(section.coefficients(0.0), section.depth)(depth))
    n = c_source / np.array(speeds)[link]
    # tube: |dz| cos(arrival) across the plane's ray, side * h of launch out of the plane
    slope = np.abs(b[0] - a[0]) / width
    area = slope * np.sqrt(n**2 - p**2) / n * side
    length2 = receivers[link, 0] ** 2 + (receivers[link, 1] - depth) ** 2
    spreading = 10.0 * np.log10(area * n / length2)
    grazing = (least < GRAZING) | (greatest > BOTTOM - GRAZING)
    order = np.lexsort((angle, link))
    twice = (np.diff(angle[order], prepend=np.inf) < 1e-2 * width) & (np.diff(link[order], prepend=-1) == 0)
    one = order[~twice]  # a root at a node may show on both sides
    return Rays(link[one], angle[one], time[one], spreading[one], slope[one], grazing[one])


def eigenrays(section, depth, receivers, solved_from="deeper"):
    """What the solver finds, solved from the end that it prefers, from the source or from the receiver."""
    source = np.tile([0.0, 0.0, depth], (len(receivers), 1))
    receiver = np.column_stack([receivers[:, 0], np.zeros(len(receivers)), receivers[:, 1]])
    if solved_from != "receiver":
        return find_eigenrays(section.medium, source, receiver, canonical=solved_from == "deeper")
    found = find_eigenrays(section.medium, receiver, source, canonical=False)
    return replace(found, launch_angle=-found.arrival_angle, arrival_angle=-found.launch_angle)


def compare(section, depth, receivers, spacing=1e-4, steepest=0.6):
    """Reproducers of eigenrays within 15 dB that the solver misses or invents, and how many agree."""
    fan = brute_force(section, depth, receivers, spacing, steepest)
    return pair_up(fan, eigenrays(section, depth, receivers), depth, receivers, steepest)


def pair_up(fan, arrivals, depth, receivers, steepest):
    """Pair rays of both one to one where they arrive within 1 us and would end within 3 cm of each other."""
    missed, invented, agreed = [], [], 0
    for j in range(len(receivers)):
        left = [k for k in np.flatnonzero(arrivals.link == j) if abs(arrivals.launch_angle[k]) < steepest]
        for k in np.flatnonzero(fan.link == j):
            gap = np.abs(arrivals.launch_angle[left] - fan.angle[k])
            same = (gap * fan.slope[k] < MISS) | (gap < ANGLE)
            same &= np.abs(arrivals.travel_time[left] - fan.time[k]) < 1e-6
            if same.any():
                left.pop(int(np.argmin(np.where(same, gap, np.inf))))
                agreed += 1
            elif not fan.grazing[k] and fan.spreading[k] < 14.9:
                missed.append([depth, *receivers[j], fan.angle[k], fan.time[k], fan.spreading[k]])
        invented += [
            [
                depth,
                *receivers[j],
                arrivals.launch_angle[k],
                arrivals.travel_time[k],
                arrivals.spreading_db[k],
            ]
            for k in left
        ]
    return missed, invented, agreed


def report(what, rays):
    rows = "\n".join(", ".join(f"{v:.12g}" for v in ray) for ray in rays)
    return f"{what}: source depth, range, receiver depth, launch angle, travel time, spreading\n{rows}"


@pytest.fixture(scope="module")
def sections(arctic):
    """An Arctic duct, two ducts one below the other, and a duct that a front and an eddy cross."""
    depth, speed = arctic
    double = 1440.0 + 0.016 * depth + 7.0 * np.exp(-(((depth - 50.0) / 20.0) ** 2))
    double += 5.0 * np.exp(-(((depth - 220.0) / 50.0) ** 2))
    north = np.linspace(-5e3, 25e3, 13)
    front = speed + 6.0 * np.tanh((north[:, None] - 8e3) / 4e3) * np.exp(-depth / 400.0)
    front += 5.0 * np.exp(-(((north[:, None] - 5e3) / 6e3) ** 2) - ((depth - 150.0) / 120.0) ** 2)
    return {
        "arctic": uniform_section(depth, speed),
        "double": uniform_section(depth, double),
        "front": sloping_section(depth, north, front),
    }


def receivers(n, seed, longest=12e3):
    """Ranges in whole steps; depths in and about the ducts, some of them on levels."""
    rng = np.random.default_rng(seed)
    distance = np.rint(rng.uniform(800.0, longest, n) / STEP) * STEP
    depth = np.where(
        rng.random(n) < 0.8, rng.uniform(2.0, 350.0, n), rng.choice([0.5, 30.0, 60.0, 130.0, 200.0], n)
    )
    return np.column_stack([distance, depth])


def test_the_fan_itself_finds_the_circular_arcs_of_a_constant_gradient():
    depth = np.linspace(0.0, BOTTOM, 31)
    section = uniform_section(depth, 1450.0 + 0.05 * depth)
    places = receivers(12, 1, longest=5e3)
    link, _, time, spreading, _, grazing = brute_force(section, 130.0, places, 1e-3, 0.6)
    wet = ~grazing
    ends = np.column_stack([places[:, 0], np.zeros(12), places[:, 1]])[link]
    exact = direct_travel_time_linear_gradient(
        [0.0, 0.0, 130.0], ends, sound_speed_surface=1450.0, gradient=0.05
    )
    assert wet.sum() >= 6
    np.testing.assert_allclose(time[wet], exact[wet], rtol=0, atol=1e-8)
    np.testing.assert_array_less(np.abs(spreading[wet]), 1.0)


@pytest.mark.parametrize("name", ["arctic", "double", "front"])
def test_fan_finds_no_eigenray_that_the_solver_misses(sections, name):
    missed, invented, agreed = compare(sections[name], 145.0, receivers(14, 3, longest=8e3), 2e-4, 0.4)
    assert agreed >= 15
    assert not missed, report("missed", missed)
    assert not invented, report("invented", invented)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arctic", "double", "front"])
@pytest.mark.parametrize("depth", [0.5, 5.0, 60.0, 100.0, 130.0, 200.0])
def test_fan_finds_no_eigenray_that_the_solver_misses_on_many_links(sections, name, depth):
    """900 links."""
    missed, invented, agreed = compare(sections[name], depth, receivers(50, int(10 * depth)))
    assert agreed >= 10
    assert not missed, report("missed", missed)
    assert not invented, report("invented", invented)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arctic", "double", "front"])
@pytest.mark.parametrize("depth", [0.5, 20.0, 50.0, 81.2, 150.0, 260.0])
def test_nothing_is_missed_from_either_end(sections, name, depth):
    """900 more links, to 14 km and from crests, solved from either end without regard to which is easier.

    Rays that only the solver finds are not looked at: in a window of rays in the water narrower than its spacing
    the fan finds none.
    """
    places = receivers(50, int(10 * depth) + 7, longest=14e3)
    fan = brute_force(sections[name], depth, places, 1e-4, 0.6)
    for end in ("source", "receiver"):
        arrivals = eigenrays(sections[name], depth, places, solved_from=end)
        missed, _, agreed = pair_up(fan, arrivals, depth, places, 0.6)
        assert agreed >= 10
        assert not missed, report(f"missed from the {end}", missed)
