"""Small fleets to estimate."""

import factories
import pytest

from pymantaray.estimation.solvers.normal_equations import NormalEquations


@pytest.fixture
def make_fleet():
    return factories.make_fleet


@pytest.fixture(scope="session")
def fleet():
    """Three turning vehicles with fixes, depth and ranges, some of them dropped."""
    return factories.make_fleet(seed=3, gnss_every=10, dropouts=0.2, range_error=20.0)


@pytest.fixture
def damped(monkeypatch):
    """Calls for damped equations, which the solver falls back on."""
    calls, real = [], NormalEquations.with_damping
    monkeypatch.setattr(NormalEquations, "with_damping", lambda *a: calls.append(a) or real(*a))
    return calls
