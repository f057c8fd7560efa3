"""An on-line estimator that learns errors of ways, on missions whose water its model lacks."""

import numpy as np
import pytest
from refusals import refused
from wrong_water import estimator, mission

from pymantaray.apps.online import Beacon, DriftingWater, LearnedWays, OnlineEstimator, StartPose
from pymantaray.apps.online.slow_errors import SlowErrors
from pymantaray.errors import OnlineError
from pymantaray.estimation.filters.error_state import State, average_states
from pymantaray.geometry.se3 import so3_exp

WAYS = LearnedWays(3e-3, 2.0)
INSIDE = 7.815  # 95 % quantile of chi-square with 3 degrees of freedom


@pytest.fixture(scope="module")
def scores():
    """Errors and NEES of missions of each kind, without and with learned ways."""

    def score(kind, seeds=(1, 2, 3, 4)):
        runs = [mission([estimator(), estimator(water=WAYS)], kind, s, hours=0.5) for s in seeds]
        return [np.concatenate(x, axis=1) for x in zip(*runs, strict=True)]

    return {kind: score(kind) for kind in ("right", "profile", "tide")}


@pytest.mark.slow
def test_in_right_water_learned_ways_cost_at_most_3_percent(scores):
    errors, nees = scores["right"]
    for level in (0.5, 0.9):
        without, learned = np.quantile(errors, level, axis=1)
        assert learned < 1.03 * without
    assert 0.6 < nees[1].mean() / 3.0 < 1.3


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "gain"), [("profile", 2.0), ("tide", 1.5)])
def test_in_wrong_water_learned_ways_are_better_and_consistent(scores, kind, gain):
    errors, nees = scores[kind]
    for level, least in ((0.5, 1.0), (0.9, gain)):
        without, learned = np.quantile(errors, level, axis=1)
        assert least * learned < without
    inside = np.mean(nees < INSIDE, axis=1)
    assert inside[0] < 0.7
    assert inside[1] > 0.9
    assert nees[1].mean() / 3.0 < 1.3


def test_errors_of_ways_come_back_within_their_sigmas():
    """A vehicle that knows its position measures the errors of its ways directly."""
    start = StartPose((0.0, 0.0, 50.0), sigma=[1e-6] * 3 + [1e-3] * 3)
    one = OnlineEstimator(
        start,
        {"near": Beacon((300.0, 0.0, 50.0)), "far": Beacon((0.0, 900.0, 50.0))},
        1500.0,
        water=LearnedWays(2e-3, np.inf),
    )
    rng = np.random.default_rng(2)
    for k in range(1, 41):
        one.add_odometry(float(k), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), [1e-7] * 3 + [1e-5] * 3)
        name, distance, error = [("near", 300.0, 1e-3), ("far", 900.0, -2e-3)][k % 2]
        one.add_range(float(k), name, distance / 1500.0 / (1.0 + error) + 1e-5 * rng.normal(), 1e-5)
    near, far = one.way_errors()
    assert (near.source, near.vehicle, far.source) == ("near", "vehicle", "far")
    # predicted times are multiplied by 1 - error
    assert near.value == pytest.approx(1e-3 / 1.001, abs=4.0 * near.sigma)
    assert far.value == pytest.approx(-2e-3 / 0.998, abs=4.0 * far.sigma)
    assert max(near.sigma, far.sigma) < 6e-5
    assert estimator().way_errors() == []


def test_the_second_estimate_never_has_errors_of_ways():
    """After measurements and the drift of the errors, their values and variances are still zero."""
    one = estimator(water=(WAYS, DriftingWater(1e-3)))
    mission([one], "profile", 5, hours=0.05)
    line = one._timeline
    values, sigma = line.ranging.errors.errors(line.state_at(0, 180.0).without)
    assert values[0] != 0.0 < sigma[0]
    np.testing.assert_array_equal([values[1:], sigma[1:]], 0.0)


def test_each_pair_and_direction_has_its_own_error():
    errors = SlowErrors(DriftingWater(1e-3, 6.0, (100.0,)), WAYS, 3, 5)
    ways = [(k, v) for v in range(3) for k in range(5) if k != v]
    numbers = [errors.way(*way) for way in ways]
    assert sorted(numbers) == list(range(3, 3 + len(ways))) == list(range(3, 15))
    assert errors.numbers_of((4, 1), (50.0, 150.0)) == [1, errors.way(4, 1)]
    assert errors.members == 5
    np.testing.assert_array_equal(errors.processes.sigma[[0, 3]], [1e-3, 3e-3])
    np.testing.assert_array_equal(errors.processes.time_scale[[0, 3]], [6.0 * 3600.0, 7200.0])


def test_the_average_has_the_moments_of_the_mixture():
    """Against draws from both normal distributions."""
    rng = np.random.default_rng(5)
    turn = np.array([0.02, -0.01, 0.03])
    place = rng.normal(0.0, 1.0, (2, 3))
    covariance = [root @ root.T * 1e-4 for root in rng.standard_normal((2, 6, 6))]
    first = State(np.eye(3)[None], place[:1], covariance[0])
    second = State(so3_exp(turn)[None], place[1:], covariance[1])
    mean = average_states(first, second, 0.3)
    one, two = (rng.multivariate_normal(np.zeros(6), c, 200_000) for c in covariance)
    two[:, :3] += turn
    one[:, 3:] += place[0]
    two[:, 3:] += place[1]
    drawn = np.where(rng.random(200_000)[:, None] < 0.3, one, two)
    np.testing.assert_allclose(mean.position[0], drawn[:, 3:].mean(axis=0), atol=0.01)
    np.testing.assert_allclose(mean.rotation[0], so3_exp(0.7 * turn), atol=1e-12)
    np.testing.assert_allclose(mean.covariance, np.cov(drawn.T), atol=0.01)


def test_a_restored_estimator_goes_on_with_its_ways(tmp_path):
    """To the last bit, for errors of water and ways together."""
    options = {"water": (WAYS, DriftingWater(1e-3, 6.0, (100.0,))), "lag": 30.0}
    whole, half = estimator(**options), estimator(**options)
    mission([whole, half], "profile", 4, hours=0.1)
    half.save(tmp_path / "state.json")
    model = half._timeline.ranging.model
    restored = OnlineEstimator.restore(tmp_path / "state.json", model)
    still = (0.0, 0.0, 0.0)
    for one in (whole, restored):
        for k in range(1, 20):
            one.add_odometry(360.0 + 5.0 * k, still, still, [1e-5] * 3 + [0.02] * 3)
            one.add_range(360.0 + 5.0 * k - 1.0, "B1", 0.61, 2e-4)
    np.testing.assert_array_equal(restored.position(), whole.position())
    np.testing.assert_array_equal(restored.covariance(), whole.covariance())
    assert restored.way_errors() == whole.way_errors()
    assert restored.water_errors() == whole.water_errors()
    assert restored.counts() == whole.counts()


@pytest.mark.parametrize(
    ("ways", "message"),
    [
        (LearnedWays(0.0), "ways: sigma is 0"),
        (LearnedWays(1e-3, -1.0), "ways: hours is -1.0 h; it must be positive"),
        ((WAYS, WAYS), r"water: .*; allowed are a DriftingWater, a LearnedWays, or both"),
        ((), r"water: \(\); allowed are a DriftingWater, a LearnedWays, or both"),
        (3.0, r"water: 3.0; allowed are a DriftingWater, a LearnedWays, or both"),
        ((WAYS, 3.0), r"water: .*; allowed are a DriftingWater, a LearnedWays, or both"),
        (LearnedWays(1e308), "ways: sigma is 1e.308; allowed are 0, and 1e-18 to 1e.12"),
    ],
)
def test_impossible_ways_are_refused(ways, message):
    refused(OnlineError, message, estimator, water=ways)
