"""Bounced rays in a smooth 3-D ocean over a sloping bed against scipy's DOP853 on the full Hamiltonian, with shooting.

The field is scipy's own tensor-product spline. Each leg is integrated in travel time for as long as it lasts; its end on the
surface or the bed is found by Newton's method on that time, the slowness is mirrored about the normal there, and two launch
angles are varied until the ray meets its receiver. The solver gives first guesses of the launch and of the legs' times.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import NdBSpline, make_interp_spline

from pymantaray.acoustics import Medium, find_eigenrays, trace_paths

BAR, MEDIAN = 0.3e-6, 1e-8  # s
LONGEST_STEP = 15.0  # m; the spline's third derivative jumps at every level
SURFACE = 1
DEEPEST = 1300.0


def make_ocean(arctic, *, plane):
    """A front and an eddy over a bed that slopes both ways, plane or with ridges from cell to cell."""
    depth, speed = arctic
    north, east = np.linspace(0.0, 20e3, 11), np.linspace(0.0, 16e3, 9)
    n, e, z = np.meshgrid(north, east, depth, indexing="ij")
    c = speed + 6.0 * np.tanh((n - 10e3) / 4e3) * np.exp(-z / 400.0)
    c += 5.0 * np.exp(-((n - 7e3) ** 2 + (e - 9e3) ** 2) / 4e3**2 - ((z - 150.0) / 120.0) ** 2)
    bed = 500.0 + 0.02 * n[..., 0] + 0.015 * e[..., 0]
    if not plane:
        bed += 25.0 * np.random.default_rng(51).uniform(-1.0, 1.0, bed.shape)
    return Medium.from_grid(north, east, depth, c, bathymetry=bed)


def tensor_spline(medium):
    """The medium's definition: cubic not-a-knot splines horizontally, a natural cubic spline in depth."""
    north = make_interp_spline(medium.north, medium.sound_speed, k=3, axis=0)
    east = make_interp_spline(medium.east, north.c, k=3, axis=1)
    depth = make_interp_spline(medium.depth, np.moveaxis(east.c, 0, 1), k=3, axis=2, bc_type="natural")
    return NdBSpline((north.t, east.t, depth.t), np.moveaxis(depth.c, 0, 2), 3)


def bed_at(medium, place):
    """Depth and slopes of the bilinear bed under places (n, 3)."""
    cells = []
    for axis, k in ((medium.north, 0), (medium.east, 1)):
        i = np.clip(np.searchsorted(axis, place[:, k]) - 1, 0, axis.size - 2)
        cells.append((i, (place[:, k] - axis[i]) / (axis[i + 1] - axis[i]), axis[i + 1] - axis[i]))
    (i, u, dn), (j, v, de) = cells
    b00, b10, b01, b11 = (medium.bathymetry[i + p, j + q] for p, q in ((0, 0), (1, 0), (0, 1), (1, 1)))
    depth = (b00 * (1 - u) + b10 * u) * (1 - v) + (b01 * (1 - u) + b11 * u) * v
    return (
        depth,
        ((b10 - b00) * (1 - v) + (b11 - b01) * v) / dn,
        ((b01 - b00) * (1 - u) + (b11 - b10) * u) / de,
    )


def run(spline, state, duration):
    """Integrate rays (n, 6) of position and slowness for their own times, possibly negative. [s]"""
    n = len(state)

    def rates(_, flat):
        y = flat.reshape(n, 6)
        c = spline(y[:, :3])
        gradient = np.stack([spline(y[:, :3], nu=nu) for nu in ((1, 0, 0), (0, 1, 0), (0, 0, 1))], axis=1)
        return (
            np.concatenate([(c * c)[:, None] * y[:, 3:], -gradient / c[:, None]], axis=1) * duration[:, None]
        ).ravel()

    longest = np.abs(duration).max() * 1500.0
    step = min(1.0, LONGEST_STEP / longest) if longest > 0.0 else 1.0
    ray = solve_ivp(rates, (0.0, 1.0), state.ravel(), method="DOP853", rtol=1e-12, atol=1e-12, max_step=step)
    return ray.y[:, -1].reshape(n, 6)


def shoot(medium, spline, source, angles, walls, times):
    """End states and travel times of rays that meet walls (n, k) after about times (n, k + 1) of leg."""
    azimuth, elevation = angles
    unit = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    state = np.concatenate([source, unit / spline(source)[:, None]], axis=1)
    total = np.zeros(len(source))
    for leg in range(walls.shape[1]):
        duration = times[:, leg].copy()
        state = run(spline, state, duration)
        on_surface = walls[:, leg] == SURFACE
        for _ in range(3):
            depth, f_n, f_e = bed_at(medium, state[:, :3])
            normal = np.stack([f_n, f_e, -np.ones_like(f_n)], axis=1)
            normal[on_surface] = [0.0, 0.0, 1.0]
            gap = np.where(on_surface, state[:, 2], depth - state[:, 2])
            rate = np.sum(normal * state[:, 3:], axis=1) * spline(state[:, :3]) ** 2
            assert (rate < 0.0).all()  # towards the boundary
            more = -gap / rate
            state = run(spline, state, more)
            duration += more
        total += duration
        np.testing.assert_allclose(gap, 0.0, atol=1e-6)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        state[:, 3:] -= 2.0 * np.sum(state[:, 3:] * normal, axis=1, keepdims=True) * normal
    last = times[:, -1]
    return run(spline, state, last), total + last


def exact_times(medium, source, receiver, launch, walls, times):
    """Travel times by Newton on two launch angles, corrected for the last miss."""
    spline = tensor_spline(medium)
    angles = np.stack([np.arctan2(launch[:, 1], launch[:, 0]), np.arcsin(launch[:, 2])])
    n, delta = len(source), 1e-5
    turns = delta * np.array([[[0.0], [0.0]], [[1.0], [0.0]], [[0.0], [1.0]]])
    for _ in range(3):
        trials = np.concatenate([angles + turn for turn in turns], axis=1)
        many = [np.tile(v, (3, 1)) for v in (source, walls, times)]
        ends, total = shoot(medium, spline, many[0], trials, *many[1:])
        ray = ends[:n, 3:] / np.linalg.norm(ends[:n, 3:], axis=1, keepdims=True)
        across = np.array([np.linalg.svd(p[None])[2][1:] for p in ray])
        miss = np.einsum("nij,nj->ni", across, ends[:n, :3] - receiver)
        if np.linalg.norm(miss, axis=1).max() < 1e-2:
            break
        slopes = [
            np.einsum("nij,nj->ni", across, ends[k : k + n, :3] - ends[:n, :3]) / delta for k in (n, 2 * n)
        ]
        angles = angles - np.linalg.solve(np.stack(slopes, axis=2), miss[..., None])[..., 0].T
    assert np.linalg.norm(miss, axis=1).max() < 1.0, miss
    return total[:n] - np.sum(ends[:n, 3:] * (ends[:n, :3] - receiver), axis=1)


def legs(paths, ray):
    """Walls that a ray meets and the times of its legs."""
    own = paths.arrival == ray
    at = np.flatnonzero(paths.boundary[own] > 0)[::2]
    walls, clock = paths.boundary[own][at], paths.travel_time[own]
    return walls, np.diff(np.concatenate([[0.0], clock[at], clock[-1:]]))


def draw_links(n, seed):
    """Pairs 0.4 to 4 km apart well inside the ocean, so that no ray leaves it."""
    rng = np.random.default_rng(seed)
    source = rng.uniform((7e3, 5e3, 20.0), (13e3, 11e3, 450.0), (n, 3))
    bearing, distance = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(400.0, 4e3, n)
    receiver = source + np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), 0 * bearing])
    receiver[:, 2] = rng.uniform(20.0, 450.0, n)
    return source, receiver


def errors(medium, source, receiver, most=(1, 1)):
    """Errors of bounced travel times by the number of reflections, for rays not near the cut-off or an edge of the bed."""
    arrivals = find_eigenrays(medium, source, receiver, *most)
    paths = trace_paths(medium, source, receiver, arrivals)
    number = arrivals.surface_bounces + arrivals.bottom_bounces
    place = paths.position[:, :2]
    edge = np.min(
        [np.abs(place[:, k, None] - axis).min(axis=1) for k, axis in ((0, medium.north), (1, medium.east))],
        axis=0,
    )
    near = np.unique(paths.arrival[(paths.boundary == 2) & (edge < 1.0)])
    clear = (arrivals.spreading_db < 12.0) & (number > 0)
    clear[near] = False
    found = {}
    for count in range(1, sum(most) + 1):
        rows = np.flatnonzero(clear & (number == count))
        rows = rows[np.argsort(arrivals.travel_time[rows])]
        part_errors = [np.empty(0)]
        for part in np.array_split(rows, max(1, rows.size // 40)):  # rays of like length share their steps
            if part.size == 0:
                continue
            walls, times = (np.array(v) for v in zip(*(legs(paths, ray) for ray in part), strict=True))
            i = arrivals.link[part]
            launch = arrivals.source_slowness[part] * arrivals.source_sound_speed[i, None]
            exact = exact_times(medium, source[i], receiver[i], launch, walls, times)
            part_errors.append(np.abs(arrivals.travel_time[part] - exact))
        found[count] = np.concatenate(part_errors)
    return found


def test_bounced_travel_times_agree_on_a_few_links(arctic):
    found = errors(make_ocean(arctic, plane=False), *draw_links(5, 52))
    for count in (1, 2):
        assert len(found[count]) >= 6
        assert found[count].max() < BAR, (count, found[count])
        assert np.median(found[count]) < MEDIAN, (count, found[count])


@pytest.mark.slow
@pytest.mark.parametrize("plane", [True, False])
def test_bounced_travel_times_agree_on_many_links(arctic, plane):
    found = errors(make_ocean(arctic, plane=plane), *draw_links(60, 53), most=(2, 2))
    for count, least in ((1, 100), (2, 90), (3, 80), (4, 60)):
        assert len(found[count]) >= least, (count, len(found[count]))
        assert found[count].max() < BAR, (count, np.sort(found[count])[-10:])
        assert np.median(found[count]) < MEDIAN, (count, np.median(found[count]))
