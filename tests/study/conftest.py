"""The study `factories.TINY` and its run: four vehicles of all kinds, two landmarks, four hours."""

import copy

import pytest
from factories import TINY

from pymantaray.study import open_run, parse_study


@pytest.fixture
def tiny_tree():
    return copy.deepcopy(TINY)


@pytest.fixture(scope="session")
def make_tiny_tree():
    return lambda: copy.deepcopy(TINY)


@pytest.fixture(scope="session")
def tiny_config():
    return parse_study(copy.deepcopy(TINY), "tiny")


@pytest.fixture(scope="session")
def tiny_run(tiny_run_folder):
    return open_run(tiny_run_folder)
