"""An on-line estimator that learns the errors of its sound speed, against a known truth."""

import numpy as np
import pytest
from refusals import refused

from pymantaray.apps.online import Beacon, DriftingWater, OnlineEstimator, StartPose
from pymantaray.apps.online.slow_errors import SlowErrors
from pymantaray.errors import OnlineError
from pymantaray.estimation.filters.error_state import State

SPEED = 1500.0
SHALLOW, DEEP = 2e-3, -1e-3  # relative errors between the vehicle and each band of beacons
PLACES = {
    "B1": (900.0, 0.0, 40.0),
    "B2": (-300.0, 1100.0, 40.0),
    "B3": (-800.0, -700.0, 40.0),
    "B4": (700.0, -900.0, 150.0),
    "B5": (200.0, 1500.0, 150.0),
}
SIGMA = 2e-5


def estimator(water=None):
    start = StartPose((0.0, 0.0, 50.0), sigma=[0.01, 0.01, 0.02, 1.0, 1.0, 0.1])
    beacons = {name: Beacon(place) for name, place in PLACES.items()}
    return OnlineEstimator(start, beacons, SPEED, water=water)


def mission(one, seed=1, seconds=400, begin=0):
    """A vehicle going north at 1 m/s with ranges of a different water; its last position."""
    rng = np.random.default_rng(seed)
    where = np.array([0.0, 0.0, 50.0])
    names = list(PLACES)
    for k in range(1, seconds + 1):
        where = where + np.array([1.0, 0.0, 0.0])
        step = [1.0, 0.0, 0.0] + 0.02 * rng.standard_normal(3)
        noise = SIGMA * rng.standard_normal()
        if k <= begin:
            continue
        one.add_odometry(float(k), step, (0.0, 0.0, 0.0), [1e-5] * 3 + [0.02] * 3)
        if k % 4:
            continue
        name = names[k // 4 % len(names)]
        error = SHALLOW if PLACES[name][2] < 100.0 else DEEP
        true = np.linalg.norm(where - PLACES[name]) / (SPEED * (1.0 + error))
        one.add_range(float(k), name, true + noise, SIGMA)
    return where


def test_errors_of_the_sound_speed_come_back_within_their_sigmas(as_stored):
    one = estimator(DriftingWater(2e-3, np.inf, (100.0,)))
    where = mission(one)
    near, far, unseen = one.water_errors()
    as_stored({"errors": one.water_errors(), "pose": one.pose(), "counts": one.counts()})
    assert (near.band, near.other) == ((-np.inf, 100.0), (-np.inf, 100.0))
    assert near.value == pytest.approx(SHALLOW / (1.0 + SHALLOW), abs=4.0 * near.sigma)
    assert far.value == pytest.approx(DEEP / (1.0 + DEEP), abs=4.0 * far.sigma)
    assert max(near.sigma, far.sigma) < 2e-4
    assert (unseen.value, unseen.sigma) == pytest.approx((0.0, 2e-3))
    off = one.position() - where
    assert np.sqrt(off @ np.linalg.solve(one.covariance(), off)) < 4.0
    assert one.counts()["gated"] == 0
    plain = estimator()
    mission(plain)
    wrong = np.linalg.norm((plain.position() - where)[:2])
    assert np.linalg.norm(off[:2]) < 0.5 * wrong or plain.counts()["gated"] > 10


def test_errors_that_drift_return_to_their_first_sigma(as_stored):
    one = estimator(DriftingWater(2e-3, 0.01))
    mission(one, seconds=40)
    sigma = one.water_errors(40.0)[0].sigma
    for k in range(41, 400):
        one.add_odometry(float(k), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), [1e-5] * 3 + [0.02] * 3)
    later = one.water_errors()[0]
    assert sigma < 1e-3
    keep = np.exp(-2.0 * 359.0 / 36.0)
    assert later.sigma == pytest.approx(2e-3 * np.sqrt(1.0 - keep), rel=1e-3)
    as_stored([later, one.pose()])


def test_errors_decay_by_the_law_of_a_gauss_markov_process(as_stored):
    """Errors shrink by exp(-h / hours), and covariances return to sigma²."""
    water = SlowErrors(DriftingWater(2e-3, 5.0, (100.0,)), None, 1, 6)
    rng = np.random.default_rng(3)
    members = 1 + water.members
    root = rng.standard_normal((6 * members, 6 * members))
    before = State(
        np.tile(np.eye(3), (members, 1, 1)), rng.standard_normal((members, 3)), root @ root.T
    )
    after = water.relax(before, 2.0 * 3600.0)
    share = np.exp(-2.0 / 5.0)
    np.testing.assert_allclose(after.position[0], before.position[0])
    np.testing.assert_allclose(after.position[1:], share * before.position[1:])
    errors = water.columns_of(members)
    keep = np.ones(6 * members)
    keep[errors] = share
    expected = keep[:, None] * before.covariance * keep
    expected[errors, errors] += 2e-3**2 * (1.0 - share**2)
    np.testing.assert_allclose(after.covariance, expected)
    np.testing.assert_allclose(before.covariance, root @ root.T)
    as_stored(after)


def test_a_restored_estimator_goes_on_with_its_water(tmp_path):
    water = DriftingWater(2e-3, 6.0, (100.0,))
    whole, half = estimator(water), estimator(water)
    mission(whole, seconds=160)
    mission(half, seconds=80)
    half.save(tmp_path / "state.json")
    restored = OnlineEstimator.restore(tmp_path / "state.json", SPEED)
    mission(restored, seconds=160, begin=80)
    np.testing.assert_array_equal(restored.position(), whole.position())
    assert restored.water_errors() == whole.water_errors()


@pytest.mark.parametrize(
    ("water", "message"),
    [
        (DriftingWater(0.0), "water: sigma is 0"),
        (DriftingWater(1e-3, -1.0), "water: hours is -1.0 h; it must be positive"),
        (DriftingWater(1e-3, 1.0, (100.0, 50.0)), "do not increase after 100"),
        (DriftingWater(1e308), "water: sigma is 1e.308; allowed are 0, and 1e-18 to 1e.12"),
        (DriftingWater(1e-3, "x"), "water: hours is x h; it must be positive"),
        (DriftingWater(1e-3, 1.0, (10**400,)), "water: depths: not an array of numbers"),
    ],
)
def test_impossible_water_is_refused(water, message):
    refused(OnlineError, message, estimator, water)
