"""Media and links that the physics tests share."""

import numpy as np
import pytest

from pymantaray.acoustics import Medium

DEPTH = np.array(
    [0, 5, 10, 20, 30, 45, 60, 80, 100, 130, 160, 200, 300, 400, 600, 800, 1000, 1500, 2500, 4000.0]
)


def profile(depth):
    """Arctic-like: a cold cap, a warm layer at 60 m over a duct at 130 m, then pressure."""
    return (
        1438.0
        + 0.016 * depth
        + 9.0 * np.exp(-(((depth - 60.0) / 25.0) ** 2))
        + 20.0 / (1.0 + np.exp(-(depth - 280.0) / 60.0))
    )


def make_front(interpolation="smooth"):
    """A front in the north and an eddy over a sloping sea bed."""
    north, east = np.linspace(0.0, 40_000.0, 17), np.linspace(0.0, 30_000.0, 13)
    n, e, z = np.meshgrid(north, east, DEPTH, indexing="ij")
    c = profile(z) + 6.0 * np.tanh((n - 20_000.0) / 8000.0) * np.exp(-z / 400.0)
    c += 5.0 * np.exp(-((n - 15e3) ** 2 + (e - 18e3) ** 2) / 9e3**2 - ((z - 150.0) / 120.0) ** 2)
    bottom = 3000.0 - 0.01 * n[..., 0]
    return Medium.from_grid(north, east, DEPTH, c, bathymetry=bottom, interpolation=interpolation)


def make_links(n, seed):
    rng = np.random.default_rng(seed)
    ends = []
    for _ in range(2):
        depth = rng.choice([0.5, 60.0, 130.0, 250.0, 500.0, 1250.0, 2000.0], n)
        ends.append(np.column_stack([rng.uniform(14e3, 24e3, n), rng.uniform(10e3, 20e3, n), depth]))
    return ends


@pytest.fixture(scope="session")
def arctic():
    """Depths and sound speeds of the profile."""
    return DEPTH, profile(DEPTH)


@pytest.fixture(scope="session")
def front_medium():
    return make_front


@pytest.fixture(scope="session")
def front():
    return make_front()


@pytest.fixture(scope="session")
def links():
    return make_links
