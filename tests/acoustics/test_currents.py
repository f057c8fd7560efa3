"""
Travel times in moving water: closed form of a constant current, sign, and the interpolated current.
"""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from pymantaray.acoustics import (
    Currents,
    Medium,
    current_delays,
    find_eigenrays,
    quadrature,
    trace_paths,
)
from pymantaray.acoustics.paths import Quadrature

C = 1480.0


def straight(source, receiver, *, n=40):
    """Gauss points along straight rays of constant sound speed, one ray each."""
    source, receiver = np.atleast_2d(source).astype(float), np.atleast_2d(receiver).astype(float)
    x, w = np.polynomial.legendre.leggauss(n)
    step = receiver - source
    length = np.linalg.norm(step, axis=-1)
    position = source[:, None] + 0.5 * (x[:, None] + 1.0) * step[:, None]
    slowness = np.broadcast_to((step / length[:, None] / C)[:, None], position.shape)
    weight = (0.5 * w * length[:, None]).ravel()
    return Quadrature(
        np.repeat(np.arange(len(source)), n),
        position.reshape(-1, 3),
        slowness.reshape(-1, 3),
        weight,
    )


def exact_time(step, current):
    """
    Positive root of ``|step - current t| = C t``: sound runs from a centre that drifts with the
    water.
    """
    step, current = np.asarray(step, dtype=float), np.asarray(current, dtype=float)
    along, slower = step @ current, C**2 - current @ current
    return (np.sqrt(along**2 + slower * (step @ step)) - along) / slower


component = st.floats(-3.0, 3.0)
steps = st.tuples(st.floats(-9e3, 9e3), st.floats(-9e3, 9e3), st.floats(100.0, 900.0))


@given(north=component, east=component, step=steps)
@settings(max_examples=60)
def test_constant_current_agrees_with_the_closed_form_to_second_order(north, east, step):
    current, nodes = np.array([north, east, 0.0]), straight([0, 0, 0], step)
    time = np.linalg.norm(step) / C
    delay = current_delays(nodes, Currents.uniform(north, east), 1)[0]
    error = time + delay - exact_time(step, current)
    assert abs(error) <= 1.01 * (np.linalg.norm(current) / C) ** 2 * time + 1e-12
    if abs(error) > 1e-8:  # a quarter of it for half the current
        half = time + 0.5 * delay - exact_time(step, 0.5 * current)
        assert error / half == pytest.approx(4.0, rel=0.02)


def test_a_constant_current_acts_by_the_horizontal_slowness():
    """
    Snell: horizontal slowness is constant along a ray, bounces and all, so the delay is ``-u . p
    t``.
    """
    depth = np.array([0.0, 300.0, 800.0, 2000.0])
    medium = Medium.from_profile(depth, [1450.0, 1465.0, 1460.0, 1480.0], bottom_depth=1500.0)
    ends = (
        [[0.0, 0.0, 200.0], [0.0, 0.0, 1000.0]],
        [[4000.0, 1500.0, 700.0], [-900.0, 2500.0, 60.0]],
    )
    arrivals = find_eigenrays(medium, *ends, max_surface_bounces=1, max_bottom_bounces=1)
    assert arrivals.bottom_bounces.max() == arrivals.surface_bounces.max() == 1
    points = quadrature(trace_paths(medium, *ends, arrivals))
    delay = current_delays(points, Currents.uniform(0.3, -0.5), arrivals.link.size)
    expected = -(arrivals.source_slowness[:, :2] @ [0.3, -0.5]) * arrivals.travel_time
    np.testing.assert_allclose(delay, expected, rtol=0, atol=1e-9)
    assert np.abs(expected).min() > 1e-5


def velocity(x):
    """
    Current that the trilinear interpolation has exactly: north by depth and east, east by north.
    """
    north, east, depth = x
    return np.stack(
        [0.1 + 1e-4 * depth + 1e-8 * depth * east, 0.05 - 2e-5 * north, 0.0 * depth], axis=-1
    )


def test_interpolation_is_exact_if_linear_and_constant_outside():
    grid = ("north", "east", "depth")
    axes = (
        np.linspace(-6e3, 6e3, 5),
        np.linspace(-6e3, 6e3, 4),
        np.array([0.0, 50.0, 400.0, 1500.0]),
    )
    north, east, _ = np.moveaxis(velocity(np.meshgrid(*axes, indexing="ij")), -1, 0)
    ocean = xr.Dataset(
        {"current_north": (grid, north), "current_east": (grid, east)},
        dict(zip(grid, axes, strict=True)),
    )
    sheared = Currents.from_dataset(ocean)
    x = np.random.default_rng(3).uniform([-6e3, -6e3, 0.0], [6e3, 6e3, 1500.0], (50, 3))
    np.testing.assert_allclose(sheared.at(x), velocity(x.T), rtol=0, atol=1e-14)
    assert repr(sheared) == "<Currents 5 x 4 x 4, up to 0.38 m/s>"
    np.testing.assert_array_equal(
        sheared.at([[9e3, -7e3, 1800.0]]), sheared.at([[6e3, -6e3, 1500.0]])
    )


def time_through_shear(shear, length, start, end):
    """Eigenray of ``c |p| + u . p = 1`` with u = shear times depth along the way, by shooting."""

    def trace(angle):
        size = 1.0 / (C + shear * start * np.cos(angle))
        p_along, p_down = size * np.cos(angle), size * np.sin(angle)

        def rates(_, y):
            norm = np.hypot(p_along, y[1])
            along = C * p_along / norm + shear * y[0]
            return [C * y[1] / norm / along, -p_along * shear / along, 1.0 / along]

        done = solve_ivp(
            rates, (0.0, length), [start, p_down, 0.0], method="DOP853", rtol=1e-12, atol=1e-14
        )
        return done.y[0, -1], done.y[2, -1]

    return trace(brentq(lambda angle: trace(angle)[0] - end, -0.3, 0.3, xtol=1e-14))[1]


@pytest.mark.parametrize("shear", [1e-3, 2e-3])
def test_what_first_order_neglects_is_the_shift_of_the_ray(shear):
    """
    The exact ray in a sheared current is faster by ``kappa^2 L^3 / 24 c``; the rest is of (u/c)^2
    t.
    """
    a, b, zero = np.array([0.0, 0.0, 100.0]), np.array([10e3, 0.0, 200.0]), np.zeros(1)
    current = Currents(
        zero, zero, np.array([0.0, 1000.0]), np.array([[[[0.0, 0.0], [shear * 1000.0, 0.0]]]])
    )
    delay = current_delays(straight(a, b), current, 1)[0]
    time = np.linalg.norm(b - a) / C
    beyond = time_through_shear(shear, 10e3, 100.0, 200.0) - time - delay
    assert beyond == pytest.approx(
        -((shear / C) ** 2) * 1e12 / (24 * C), abs=(shear * 200.0 / C) ** 2 * time
    )
    assert abs(beyond) < 0.05 * abs(delay)


def test_arrivals_without_a_way_have_no_delay():
    """
    Number 0 has no points, number 2 starts where it ends: points of no length and slowness NaN.
    """
    nodes = straight([[0, 0, 0], [5, 5, 5]], [[1e3, 0, 0], [5, 5, 6]])
    lost = nodes.arrival == 1
    nodes = nodes._replace(
        arrival=nodes.arrival + 1,
        slowness=np.where(lost[:, None], np.nan, nodes.slowness),
        weight=np.where(lost, 0.0, nodes.weight),
    )
    delay = current_delays(nodes, Currents.uniform(1.0, 0.0), 4)
    np.testing.assert_allclose(delay, [0.0, -1e3 / C**2, 0.0, 0.0], rtol=1e-12)
