"""A study that takes tenths of a second, and sweeps of it."""

import copy
from functools import cache

import pytest
from factories import TINY, pool_here

from pymantaray.apps.sweep import Sweep, stages
from pymantaray.config import parse_study
from pymantaray.config.door.ocean import build_ocean


@pytest.fixture(scope="session")
def ocean_of():
    """Ocean of a configuration, made once for all tests of this process: it takes longest."""
    return cache(lambda section: build_ocean(section, 0.0))


@pytest.fixture(autouse=True)
def nothing_in_memory(monkeypatch, ocean_of):
    """What one test computed is not there for the next, but for oceans."""
    for latest in stages.LATEST.values():
        latest.cache_clear()
    monkeypatch.setattr(stages, "open_ocean", lambda ocean, _: ocean_of(ocean.section))


@pytest.fixture
def here(monkeypatch):
    """Do a sweep's tasks in this process, one after the other."""
    monkeypatch.setattr("pymantaray.apps.sweep.runner.open_pool", pool_here)


@pytest.fixture(scope="session")
def small():
    """TINY for an hour, with two vehicles, one landmark and one realization."""
    tree = copy.deepcopy(TINY)
    tree["study"] |= {"realizations": 1}
    tree["conditions"] = ["odometry", "straight"]
    tree["mission"] |= {"duration_h": 1.0, "ping_interval_h": 0.5}
    tree["fleet"]["vehicles"], tree["landmarks"] = (
        tree["fleet"]["vehicles"][:2],
        tree["landmarks"][:1],
    )
    return parse_study(tree)


@pytest.fixture(scope="session")
def noises(small):
    """Sweep of n points that share all their stages."""
    return lambda n: Sweep(small, cross={"noise.range_sigma": [1.0 + k for k in range(n)]})


@pytest.fixture
def summaries():
    """What a sweep found, apart from what it took."""
    return lambda results: [
        {k: v for k, v in c.items() if k != "seconds"} for c in results.contents
    ]
