"""Small fleets to estimate."""

import factories
import pytest


@pytest.fixture
def make_fleet():
    return factories.make_fleet
