"""Gauss-Markov processes against conditioning of the joint normal distribution."""

import numpy as np
import pytest

from pymantaray.estimation.filters.gauss_markov import (
    Alternatives,
    GaussMarkovFilter,
    Processes,
    fuse,
)

PROCESSES = Processes(np.array([2.0, 1.0, 0.5]), np.array([np.inf, 50.0, 400.0]))
TIMES = np.array([0.0, 10.0, 35.0, 40.0, 160.0, 161.0, 300.0])
COLUMNS = np.array([0, 1, 2])
FACTORS = np.random.default_rng(4).normal(size=(TIMES.size, 3))
MEASURED = np.random.default_rng(5).normal(0.0, 2.0, TIMES.size)
NOISE = 0.3


def joint(times, factors, others, other_factors):
    """Covariance of linear combinations of the processes at two sets of times."""
    lag = np.abs(times[:, None] - others[None, :])
    return sum(
        PROCESSES.sigma[k] ** 2
        * np.exp(-lag / PROCESSES.time_scale[k])
        * np.outer(factors[:, k], other_factors[:, k])
        for k in range(3)
    )


def conditioned(at, known):
    """Mean and variance of the combination of event `at` given some measured events."""
    inner = joint(TIMES[known], FACTORS[known], TIMES[known], FACTORS[known])
    inner += NOISE**2 * np.eye(len(known))
    cross = joint(TIMES[[at]], FACTORS[[at]], TIMES[known], FACTORS[known])[0]
    own = joint(TIMES[[at]], FACTORS[[at]], TIMES[[at]], FACTORS[[at]])[0, 0]
    weights = np.linalg.solve(inner, cross)
    return weights @ MEASURED[known], own - weights @ cross


def one(residual):
    """A measurement that one candidate explains for certain."""
    return Alternatives(np.array([residual]), np.array([NOISE**2]), np.ones(1), 0.0)


def run(order):
    """Estimate before each event of a pass, by event."""
    state = GaussMarkovFilter(PROCESSES, TIMES[order[0]])
    before = {}
    for k in order:
        state.advance(TIMES[k])
        before[k] = state.estimate
        state.update(COLUMNS, FACTORS[k], one(MEASURED[k]))
    return before


def projected(estimate, k):
    mean = FACTORS[k] @ estimate.mean
    return mean, FACTORS[k] @ estimate.covariance @ FACTORS[k]


def test_predictions_are_conditioned_on_earlier_measurements():
    before = run(range(TIMES.size))
    for k in range(1, TIMES.size):
        expected = conditioned(k, list(range(k)))
        np.testing.assert_allclose(projected(before[k], k), expected, rtol=1e-9, atol=1e-12)


def test_two_passes_are_conditioned_on_all_other_measurements(as_stored):
    forward, backward = run(range(TIMES.size)), run(range(TIMES.size - 1, -1, -1))
    for k in range(TIMES.size):
        both = fuse(forward[k], backward[k], PROCESSES)
        others = [i for i in range(TIMES.size) if i != k]
        expected = conditioned(k, others)
        np.testing.assert_allclose(projected(both, k), expected, rtol=1e-8, atol=1e-10)
    as_stored(both)


def test_likelihood_is_that_of_the_joint_distribution():
    state = GaussMarkovFilter(PROCESSES, 0.0)
    total = 0.0
    for k in range(TIMES.size):
        state.advance(TIMES[k])
        total += state.update(COLUMNS, FACTORS[k], one(MEASURED[k])).log_likelihood
    covariance = joint(TIMES, FACTORS, TIMES, FACTORS) + NOISE**2 * np.eye(TIMES.size)
    quadratic = MEASURED @ np.linalg.solve(covariance, MEASURED)
    expected = -0.5 * (quadratic + np.linalg.slogdet(2.0 * np.pi * covariance)[1])
    assert total == pytest.approx(expected, rel=1e-10)


def test_a_measurement_that_nothing_explains_changes_nothing():
    state = GaussMarkovFilter(PROCESSES, 0.0)
    before = state.estimate
    wrong = Alternatives(np.array([80.0, 90.0]), np.full(2, 0.01), np.full(2, 0.49), 0.2)
    outcome = state.update(COLUMNS, FACTORS[0], wrong)
    assert outcome.probability.sum() < 1e-12
    np.testing.assert_allclose(state.mean, before.mean, atol=1e-9)
    np.testing.assert_allclose(state.covariance, before.covariance, rtol=1e-9)


def test_two_candidates_give_mean_and_covariance_of_their_mixture(as_stored):
    """One process of variance 4, measured at 1 or at -3, each with a variance of 1."""
    single = Processes(np.array([2.0]), np.array([np.inf]))
    state = GaussMarkovFilter(single, 0.0)
    two = Alternatives(np.array([1.0, -3.0]), np.ones(2), np.full(2, 0.5), 0.0)
    outcome = state.update(np.array([0]), np.ones(1), two)
    weight = np.exp(-0.5 * np.array([1.0, 9.0]) / 5.0)
    weight /= weight.sum()
    np.testing.assert_allclose(outcome.probability, weight, rtol=1e-12)
    means = 0.8 * np.array([1.0, -3.0])
    mean = weight @ means
    assert state.mean[0] == pytest.approx(mean)
    assert state.covariance[0, 0] == pytest.approx(0.8 + weight @ (means - mean) ** 2)
    as_stored([outcome, state.estimate])
