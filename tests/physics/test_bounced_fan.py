"""Bounced eigenrays of an Arctic duct over a shallow bed against a brute-force fan that shares no code with the solver.

Hamilton's equations in range by RK4 with fixed steps through scipy's spline; a step that crosses the surface or the bed is cut
there by the secant method and goes on reflected. Intervals of launch angle with a change of sign between rays of the same
reflections, an extremum near zero, or a change of reflections are divided by 8, three times.
"""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pymantaray.acoustics import Medium, find_eigenrays

Array = NDArray[np.float64]
BOTTOM = 350.0
STEP = 5.0  # m
DIVISION = 8
SURFACE_LIMIT, BED_LIMIT = 2, 1
GRAZING = 0.02  # m; a ray that turns this near a boundary may count as reflected or not
MISS, ANGLE, TIME = 3e-2, 1e-5, 1e-6  # m, rad, s


class Rays(NamedTuple):
    """What the fan found: one row per eigenray; slope is the change of the miss by the launch angle [m/rad]."""

    link: Array
    surface: Array
    bottom: Array
    angle: Array
    time: Array
    spreading: Array
    slope: Array
    grazing: Array


def advance(profile, c_source, y, step):
    """One RK4 step of depth, its slowness, travel time and lateral spreading; steps (n,) differ by ray."""

    def rates(y):
        c, slope = profile(y[0]), profile(y[0], 1)
        n2 = (c_source / c) ** 2
        h = np.sqrt(n2 - y[1] ** 2)
        return np.array([y[1] / h, -n2 * slope / (c * h), n2 / (h * c_source), 1.0 / h])

    k1 = rates(y)
    k2 = rates(y + 0.5 * step * k1)
    k3 = rates(y + 0.5 * step * k2)
    k4 = rates(y + step * k3)
    return y + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def reflect(profile, c_source, y, new, bounces, order):
    """Cut the steps of rays that crossed a boundary, reflect them and finish the step; in place."""
    for at, wall, sign in ((0, 0.0, -1.0), (1, BOTTOM, 1.0)):
        out = np.flatnonzero(sign * (new[0] - wall) > 0.0)
        if out.size == 0:
            continue
        start = y[:, out]
        lo, hi = np.zeros(out.size), np.full(out.size, STEP)
        f_lo, f_hi = start[0] - wall, new[0, out] - wall
        for _ in range(8):  # regula falsi of Illinois kind
            at_step = hi - f_hi * (hi - lo) / (f_hi - f_lo)
            here = advance(profile, c_source, start, at_step)
            f = here[0] - wall
            beyond = sign * f > 0.0
            f_lo = np.where(beyond, 0.5 * f_lo, f)
            f_hi = np.where(beyond, f, 0.5 * f_hi)
            lo, hi = np.where(beyond, lo, at_step), np.where(beyond, at_step, hi)
        here[0] = wall
        here[1] *= -1.0
        new[:, out] = advance(profile, c_source, here, STEP - at_step)
        bounces[at, out] += 1
        order[out] = 3 * order[out] + 1 + at
    lost = (bounces[0] > SURFACE_LIMIT) | (bounces[1] > BED_LIMIT) | (new[0] < 0.0) | (new[0] > BOTTOM)
    new[:, lost] = np.nan


def trace(profile, depth, angles, steps):
    """Yield states, bounces, order of bounces and nearness to a boundary of turning points after each step."""
    c_source = float(profile(depth))
    y = np.array([np.full(angles.size, depth), np.sin(angles), np.zeros(angles.size), np.zeros(angles.size)])
    bounces, order = np.zeros((2, angles.size), dtype=int), np.zeros(angles.size, dtype=np.int64)
    nearest = np.full(angles.size, np.inf)
    with np.errstate(invalid="ignore"):
        for _ in range(steps):
            new = advance(profile, c_source, y, STEP)
            reflect(profile, c_source, y, new, bounces, order)
            flat = np.abs(new[1]) < 0.01
            gap = np.minimum(new[0], BOTTOM - new[0])
            nearest = np.where(flat, np.fmin(nearest, gap), nearest)
            y = new
            yield y, bounces, order, nearest


def candidates(miss, order):
    """Indices i of intervals [i, i + 1] in which a root may hide."""
    alive = np.isfinite(miss)
    with np.errstate(invalid="ignore"):
        same = order[:-1] == order[1:]
        change = same & (miss[:-1] * miss[1:] <= 0.0)
        edge = (alive[:-1] != alive[1:]) | (~same & alive[:-1] & alive[1:])
        size = np.abs(miss)
        dip = np.zeros(miss.size, dtype=bool)
        dip[1:-1] = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]) & (miss[:-2] * miss[2:] > 0.0)
        bend = np.zeros(miss.size)
        bend[1:-1] = np.abs(miss[:-2] - 2.0 * miss[1:-1] + miss[2:])
        dip &= size < bend
    return np.flatnonzero(change | edge | dip[:-1] | dip[1:])


def brute_force(profile, depth, receivers, spacing, steepest):
    """Eigenrays from (0, depth) to receivers (n, 2) at whole steps."""
    ends = np.rint(receivers[:, 0] / STEP).astype(int)
    angles = np.arange(-steepest, steepest, spacing)
    link, left = [], []
    for i, (y, _, order, _) in enumerate(trace(profile, depth, angles, ends.max()), start=1):
        for j in np.flatnonzero(ends == i):
            found = candidates(y[0] - receivers[j, 1], order)
            link.append(np.full(found.size, j))
            left.append(angles[found])
    link, left, width = np.concatenate(link), np.concatenate(left), spacing
    for level in range(3):
        width /= DIVISION
        nodes = left[:, None] + width * np.arange(DIVISION + 1)
        state = np.full((8, *nodes.shape), np.nan)
        out, owner = state.reshape(8, -1), np.repeat(link, DIVISION + 1)
        rays = trace(profile, depth, nodes.ravel(), ends.max())
        for i, (y, bounces, order, nearest) in enumerate(rays, start=1):
            here = ends[owner] == i
            if here.any():
                out[:, here] = np.concatenate([y, bounces, order[None], nearest[None]])[:, here]
        state[0] -= receivers[link, 1][:, None]
        if level < 2:
            hits = [candidates(*rows) for rows in zip(state[0], state[6], strict=True)]
            left = np.concatenate([nodes[j, hit] for j, hit in enumerate(hits)])
            link = np.repeat(link, [hit.size for hit in hits])
    with np.errstate(invalid="ignore"):
        same = state[6, :, :-1] == state[6, :, 1:]
        row, at = np.nonzero(same & (state[0, :, :-1] * state[0, :, 1:] <= 0.0))
    a, b = state[:, row, at], state[:, row, at + 1]
    t = a[0] / (a[0] - b[0])
    _, p, time, side = ((1 - t) * a + t * b)[:4]
    link, angle = link[row], nodes[row, at] + t * width
    n = float(profile(depth)) / profile(receivers[link, 1])
    slope = np.abs(b[0] - a[0]) / width
    area = slope * np.sqrt(n**2 - p**2) / n * side
    length2 = receivers[link, 0] ** 2 + (receivers[link, 1] - depth) ** 2
    spreading = 10.0 * np.log10(area * n / length2)
    grazing = np.minimum(a[7], b[7]) < GRAZING
    order = np.lexsort((angle, link))
    twice = (np.diff(angle[order], prepend=np.inf) < 1e-2 * width) & (np.diff(link[order], prepend=-1) == 0)
    one = order[~twice]
    bounces = a[4:6, one].astype(int)
    return Rays(link[one], *bounces, angle[one], time[one], spreading[one], slope[one], grazing[one])


def compare(profile, medium, depth, receivers, spacing, steepest=0.7):
    """Rays within 15 dB that the solver misses or invents, and how many agree, with and without reflections."""
    fan = brute_force(profile, depth, receivers, spacing, steepest)
    source = np.tile([0.0, 0.0, depth], (len(receivers), 1))
    receiver = np.column_stack([receivers[:, 0], np.zeros(len(receivers)), receivers[:, 1]])
    found = find_eigenrays(medium, source, receiver, SURFACE_LIMIT, BED_LIMIT)
    missed, invented, agreed = [], [], 0
    for j in range(len(receivers)):
        left = list(np.flatnonzero(found.link == j))
        for k in np.flatnonzero(fan.link == j):
            gap = np.abs(found.launch_angle[left] - fan.angle[k])
            same = (gap * fan.slope[k] < MISS) | (gap < ANGLE)
            same &= np.abs(found.travel_time[left] - fan.time[k]) < TIME
            same &= (found.surface_bounces[left] == fan.surface[k]) & (
                found.bottom_bounces[left] == fan.bottom[k]
            )
            if same.any():
                left.pop(int(np.argmin(np.where(same, gap, np.inf))))
                agreed += 1
            elif not fan.grazing[k] and fan.spreading[k] < 14.9:
                row = (fan.surface[k], fan.bottom[k], fan.angle[k], fan.time[k], fan.spreading[k])
                missed.append([depth, *receivers[j], *row])
        near = [
            fan.grazing[fan.link == j] & (np.abs(fan.time[fan.link == j] - found.travel_time[k]) < TIME)
            for k in left
        ]
        names = ("surface_bounces", "bottom_bounces", "launch_angle", "travel_time", "spreading_db")
        invented += [
            [depth, *receivers[j], *(getattr(found, name)[k] for name in names)]
            for k, grazes in zip(left, near, strict=True)
            if not grazes.any() and abs(found.launch_angle[k]) < steepest - 1e-3
        ]
    return missed, invented, agreed


def report(what, rays):
    rows = "\n".join(", ".join(f"{v:.12g}" for v in ray) for ray in rays)
    return (
        f"{what}: source depth, range, receiver depth, bounces, launch angle, travel time, spreading\n{rows}"
    )


@pytest.fixture(scope="module")
def duct(arctic):
    depth, speed = arctic
    return CubicSpline(depth, speed, bc_type="natural"), Medium.from_profile(
        depth, speed, bottom_depth=BOTTOM
    )


def receivers(n, seed, longest):
    rng = np.random.default_rng(seed)
    distance = np.rint(rng.uniform(800.0, longest, n) / 10.0) * 10.0
    return np.column_stack([distance, rng.uniform(2.0, BOTTOM - 2.0, n)])


def test_the_fan_itself_finds_the_images_of_a_wave_guide():
    levels = np.linspace(0.0, 400.0, 5)
    profile = CubicSpline(levels, np.full(5, 1500.0), bc_type="natural")
    places = receivers(6, 1, 3e3)
    fan = brute_force(profile, 100.0, places, 1e-3, 0.9)
    expected = []
    for j, (r, z) in enumerate(places):
        for climb, surface, bottom in (
            (z - 100.0, 0, 0),
            (z + 100.0, 1, 0),
            (2 * BOTTOM - z - 100.0, 0, 1),
            (2 * BOTTOM + 100.0 - z, 1, 1),
            (2 * BOTTOM - 100.0 + z, 1, 1),
            (2 * BOTTOM + 100.0 + z, 2, 1),
        ):
            if climb / r < np.tan(0.899):
                expected.append((j, surface, bottom, np.hypot(r, climb) / 1500.0))
    mine = sorted(zip(fan.link, fan.surface, fan.bottom, fan.time, strict=True))
    assert len(mine) == len(expected) > 25
    np.testing.assert_allclose(mine, sorted(expected), rtol=0, atol=1e-9)


def test_fan_finds_no_bounced_eigenray_that_the_solver_misses(duct):
    missed, invented, agreed = compare(*duct, 145.0, receivers(10, 3, 5e3), 4e-4, 0.6)
    assert agreed >= 40, agreed
    assert not missed, report("missed", missed)
    assert not invented, report("invented", invented)


@pytest.mark.slow
@pytest.mark.parametrize(
    "depth",
    [
        0.5,
        60.0,
        75.0,
        130.0,
        300.0,
    ],
)
def test_fan_finds_no_bounced_eigenray_that_the_solver_misses_on_many_links(duct, depth):
    """200 links."""
    missed, invented, agreed = compare(*duct, depth, receivers(40, int(10 * depth), 9e3), 1e-4)
    assert agreed >= 150, agreed
    assert not missed, report("missed", missed)
    assert not invented, report("invented", invented)
