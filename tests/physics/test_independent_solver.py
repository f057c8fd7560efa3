"""Smooth 3-D media against a solver of another kind: scipy's DOP853 on the full Hamiltonian, with shooting.

The field is evaluated by scipy's own tensor-product spline through the same grid values, so that neither
the section, the chord coordinates, the variational equations nor the Fermat correction are shared.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import NdBSpline, make_interp_spline

from pymantaray.acoustics import find_eigenrays
from pymantaray.records import RayStatus


def tensor_spline(medium):
    """The medium's definition: cubic not-a-knot splines horizontally, a natural cubic spline in depth."""
    north = make_interp_spline(medium.north, medium.sound_speed, k=3, axis=0)
    east = make_interp_spline(medium.east, north.c, k=3, axis=1)
    depth = make_interp_spline(medium.depth, np.moveaxis(east.c, 0, 1), k=3, axis=2, bc_type="natural")
    return NdBSpline((north.t, east.t, depth.t), np.moveaxis(depth.c, 0, 2), 3)


def shoot_to(spline, source, receiver, launch, duration):
    """Travel time by Newton on two launch angles about a first guess, corrected for the last miss."""
    chord = (receiver - source) / np.linalg.norm(receiver - source)
    across = np.linalg.svd(chord[None])[2][1:]
    azimuth, elevation = np.arctan2(launch[1], launch[0]), np.arcsin(launch[2])

    def rates(_, state):
        c = float(spline(state[:3]))
        gradient = [float(spline(state[:3], nu=nu)) for nu in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        return np.concatenate([c * c * state[3:], -np.array(gradient) / c])

    def passed(_, state):
        return (state[:3] - receiver) @ chord

    passed.terminal = True
    c0 = float(spline(source))

    def trace(angles):
        a, e = azimuth + angles[0], elevation + angles[1]
        unit = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        ray = solve_ivp(
            rates,
            (0.0, 1.2 * duration),
            np.concatenate([source, unit / c0]),
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
            max_step=0.01,  # the spline's third derivative jumps at every level
            events=passed,
        )
        return ray.t_events[0][0], ray.y_events[0][0]

    angles = np.zeros(2)
    for _ in range(3):
        time, end = trace(angles)
        miss = across @ (end[:3] - receiver)
        if np.linalg.norm(miss) < 1e-3:
            break
        columns = [(across @ (trace(angles + d)[1][:3] - end[:3])) / 1e-5 for d in 1e-5 * np.eye(2)]
        angles = angles - np.linalg.solve(np.column_stack(columns), miss)
    return time - end[3:] @ (end[:3] - receiver)


def check(medium, source, receiver):
    first = find_eigenrays(medium, source, receiver).first()
    spline = tensor_spline(medium)
    ok = np.flatnonzero(first.status == RayStatus.OK)
    errors = []
    for i in ok:
        launch = first.source_slowness[i] * first.source_sound_speed[i]
        exact = shoot_to(spline, source[i], receiver[i], launch, first.travel_time[i])
        errors.append(first.travel_time[i] - exact)
    return np.abs(errors)


def test_travel_times_agree_on_a_few_links(front, links):
    source, receiver = links(4, 21)
    source[:, 2] += 20.0
    errors = check(front, source, receiver)
    assert len(errors) >= 3
    assert errors.max() < 0.3e-6, errors


@pytest.mark.slow
def test_travel_times_agree_on_many_links(front, links):
    source, receiver = links(50, 22)
    source[:, 2] += 20.0
    receiver[:, 2] += 20.0
    errors = check(front, source, receiver)
    assert len(errors) >= 45
    assert errors.max() < 0.3e-6, errors
    assert np.median(errors) < 1e-8, errors
