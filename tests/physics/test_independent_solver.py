"""Smooth 3-D media against a solver of another kind: scipy's DOP853 on the full Hamiltonian, with shooting.

The field is evaluated by scipy's own tensor-product spline through the same grid values, so that neither
the section, the coordinates along the chord, the variational equations nor the Fermat correction are shared. All links
are integrated together, in the distance along each link's own chord, so that every ray ends on its receiver's plane.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import NdBSpline, make_interp_spline

from pymantaray.acoustics import Medium, find_eigenrays


def tensor_spline(medium):
    """The medium's definition: cubic not-a-knot splines horizontally, a natural cubic spline in depth."""
    north = make_interp_spline(medium.north, medium.sound_speed, k=3, axis=0)
    east = make_interp_spline(medium.east, north.c, k=3, axis=1)
    depth = make_interp_spline(medium.depth, np.moveaxis(east.c, 0, 1), k=3, axis=2, bc_type="natural")
    return NdBSpline((north.t, east.t, depth.t), np.moveaxis(depth.c, 0, 2), 3)


BAR, MEDIAN = 0.3e-6, 1e-8  # s
LONGEST_STEP = 15.0  # m; the spline's third derivative jumps at every level


def end_state(spline, source, receiver, azimuth, elevation):
    """Position, slowness and travel time of rays at the planes through their receivers."""
    step = receiver - source
    length = np.linalg.norm(step, axis=1)
    chord = step / length[:, None]
    unit = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    n = len(source)
    start = np.concatenate([source, unit / spline(source)[:, None], np.zeros((n, 1))], axis=1)

    def rates(_, state):
        y = state.reshape(n, 7)
        x, p = y[:, :3], y[:, 3:6]
        c = spline(x)
        gradient = np.stack([spline(x, nu=nu) for nu in ((1, 0, 0), (0, 1, 0), (0, 0, 1))], axis=1)
        velocity = (c * c)[:, None] * p
        along = (length / np.sum(velocity * chord, axis=1))[:, None]  # seconds per chord
        return (np.concatenate([velocity, -gradient / c[:, None], np.ones((n, 1))], axis=1) * along).ravel()

    ray = solve_ivp(
        rates,
        (0.0, 1.0),
        start.ravel(),
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
        max_step=LONGEST_STEP / length.max(),
    )
    end = ray.y[:, -1].reshape(n, 7)
    return end[:, :3], end[:, 3:6], end[:, 6]


def shoot_to(spline, source, receiver, launch):
    """Travel times by Newton on two launch angles about first guesses, corrected for the last miss."""
    chord = (receiver - source) / np.linalg.norm(receiver - source, axis=1)[:, None]
    across = np.array([np.linalg.svd(c[None])[2][1:] for c in chord])
    angles = np.stack([np.arctan2(launch[:, 1], launch[:, 0]), np.arcsin(launch[:, 2])])
    n, delta = len(source), 1e-5
    for _ in range(3):
        turns = delta * np.array([[[0.0], [0.0]], [[1.0], [0.0]], [[0.0], [1.0]]])
        trials = np.concatenate([angles + turn for turn in turns], axis=1)
        ends, slowness, time = end_state(spline, np.tile(source, (3, 1)), np.tile(receiver, (3, 1)), *trials)
        miss = np.einsum("nij,nj->ni", across, ends[:n] - receiver)
        if np.linalg.norm(miss, axis=1).max() < 1e-2:
            break
        slopes = [np.einsum("nij,nj->ni", across, ends[k : k + n] - ends[:n]) / delta for k in (n, 2 * n)]
        angles = angles - np.linalg.solve(np.stack(slopes, axis=2), miss[..., None])[..., 0].T
    assert np.linalg.norm(miss, axis=1).max() < 1.0
    return time[:n] - np.sum(slowness[:n] * (ends[:n] - receiver), axis=1)


def check(medium, source, receiver):
    """Errors of the first arrivals, and of the later ones that are not at the edge of the cut-off.

    Where rays diverge by 15 dB the end moves 30 m by a mrad; Newton's linear steps may leave the neighbourhood there.
    """
    arrivals = find_eigenrays(medium, source, receiver)
    clear = (arrivals.spreading_db < 12.0) | (np.diff(arrivals.link, prepend=-1) > 0)
    link = arrivals.link[clear]
    launch = arrivals.source_slowness[clear] * arrivals.source_sound_speed[link, None]
    errors = []
    order = np.argsort(np.linalg.norm((receiver - source)[link], axis=1))
    for part in np.array_split(order, max(1, order.size // 30)):  # links of like length share their steps
        i = link[part]
        exact = shoot_to(tensor_spline(medium), source[i], receiver[i], launch[part])
        errors.append(arrivals.travel_time[clear][part] - exact)
    return np.abs(np.concatenate(errors))


def make_eddies():
    """Two eddies of opposite sign, a surface front and a rough bed, on axes of unequal steps."""
    north = np.array([0.0, 3, 5, 8, 11, 13, 16, 20, 23, 26, 30, 33, 36, 40]) * 1e3
    east = np.linspace(0.0, 36e3, 13)
    depth = np.array([0.0, 4, 10, 20, 35, 50, 75, 100, 150, 200, 300, 450, 700, 1000, 1500, 2200, 3000])
    n, e, z = np.meshgrid(north, east, depth, indexing="ij")
    c = 1449.0 + 0.0165 * z + 6.0 * np.exp(-(((z - 75.0) / 50.0) ** 2))
    c += 8.0 * np.exp(-((n - 15e3) ** 2 + (e - 13e3) ** 2) / 6e3**2 - ((z - 200.0) / 180.0) ** 2)
    c -= 7.0 * np.exp(-((n - 22e3) ** 2 + (e - 20e3) ** 2) / 5e3**2 - ((z - 400.0) / 250.0) ** 2)
    c += 4.0 * np.tanh((e - n + 2e3) / 6e3) * np.exp(-z / 80.0)
    return Medium.from_grid(north, east, depth, c, bathymetry=2700.0 + 250.0 * np.sin(n[..., 0] / 5e3))


@pytest.fixture(scope="module", params=["front", "eddies"])
def ocean(request, front):
    return front if request.param == "front" else make_eddies()


def ends(links, n, seed):
    source, receiver = links(n, seed)
    source[:, 2] += 20.0  # so that few rays are lost to the surface
    receiver[:, 2] += 20.0
    return source, receiver


def test_travel_times_agree_on_a_few_links(ocean, links):
    errors = check(ocean, *ends(links, 16, 21))
    assert len(errors) >= 12
    assert errors.max() < BAR, errors
    assert np.median(errors) < MEDIAN, errors


@pytest.mark.slow
@pytest.mark.parametrize("seed", [22, 23])
def test_travel_times_agree_on_many_links(ocean, links, seed):
    errors = check(ocean, *ends(links, 100, seed))
    assert len(errors) >= 85
    assert errors.max() < BAR, errors
    assert np.median(errors) < MEDIAN, errors
