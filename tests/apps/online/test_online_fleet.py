"""
A fleet in one place: ranges between vehicles in both directions, by eigenrays and by a table, with
later arrivals.
"""

import math

import numpy as np
import pytest

from pymantaray.acoustics import Medium, find_eigenrays
from pymantaray.apps.online import Beacon, OnlineEstimator, Outcome, StartPose
from pymantaray.apps.online.range_model import TableModel
from pymantaray.estimation.ranges.range_models import RangeEndpoints

STARTS = {"A": np.array([0.0, 0.0, 60.0]), "B": np.array([300.0, 900.0, 250.0])}
BEACON = np.array([-400.0, 700.0, 90.0])
PACE = {
    "A": np.array([1.2, 0.4, 0.0]),
    "B": np.array([-0.3, 1.0, 0.05]),
}  # m/s, with the body's axes to the north and east
SIGMA = np.array([1e-5] * 3 + [0.05] * 3)  # of a second of odometry
PING, END = 10, 120  # s
TIME_SIGMA = 2e-4  # s


@pytest.fixture(scope="module")
def medium(water) -> Medium:
    """Medium of the table's water."""
    medium, _ = water.at_start
    assert isinstance(medium, Medium)
    return medium


def place(name: str, time: float) -> np.ndarray:
    """True position of a member."""
    return BEACON if name == "beacon" else STARTS[name] + time * PACE[name]


def arrivals(medium: Medium, source: str, vehicle: str, time: float) -> np.ndarray:
    """
    Travel times of the direct arrivals and of those with a reflection at the bottom, in ascending
    order.
    """
    ends = (place(name, time)[None] for name in (source, vehicle))
    return np.sort(find_eigenrays(medium, *ends, max_bottom_bounces=1).travel_time)


def fly(medium: Medium, ranges, *, later: bool = False) -> tuple[OnlineEstimator, list[Outcome]]:
    """
    Run the fleet with ranges from the beacon and between the vehicles; the outcomes of the ranges.
    """
    rng = np.random.default_rng(6)
    sigma = [1e-4] * 3 + [5.0, 5.0, 0.2]
    starts = {
        name: StartPose(at + np.array([3.0, -3.0, 0.1]), sigma=sigma) for name, at in STARTS.items()
    }
    estimator = OnlineEstimator(starts, {"beacon": Beacon(BEACON)}, ranges)
    outcomes = []
    for k in range(1, END + 1):
        for name, pace in PACE.items():
            noise = SIGMA * rng.standard_normal(6)
            estimator.add_odometry(float(k), pace + noise[3:], noise[:3], SIGMA, vehicle=name)
            depth = place(name, k)[2] + 0.1 * rng.standard_normal()
            estimator.add_depth(float(k), depth, 0.1, vehicle=name)
        if k % PING == 0:
            for source, vehicle in (("beacon", "A"), ("beacon", "B"), ("A", "B"), ("B", "A")):
                times = arrivals(medium, source, vehicle, k)
                noise = TIME_SIGMA * rng.standard_normal()
                heard = times[-1] if later and k > END // 2 and source == "A" else times[0]
                outcomes.append(
                    estimator.add_range(
                        float(k), source, heard + noise, TIME_SIGMA, vehicle=vehicle
                    )
                )
    return estimator, outcomes


@pytest.mark.slow
def test_a_fleet_is_located_by_eigenrays_and_by_a_table(medium, table):
    for ranges in (medium, table):
        estimator, outcomes = fly(medium, ranges)
        assert set(outcomes) == {Outcome.USED}
        for name in STARTS:
            sigma = np.sqrt(np.diag(estimator.covariance(vehicle=name)))
            assert sigma.max() < 2.5, "the start has a standard deviation of 5 m"
            assert (np.abs(estimator.position(vehicle=name) - place(name, END)) < 4.0 * sigma).all()


def test_eigenrays_and_a_table_give_the_same_positions(medium, table):
    by_rays, by_table = (fly(medium, ranges)[0] for ranges in (medium, table))
    for name in STARTS:
        np.testing.assert_allclose(
            by_rays.position(vehicle=name),
            by_table.position(vehicle=name),
            rtol=0,
            atol=2.0 * table.tolerance,
        )


def test_reflected_arrivals_are_gated_with_either_range_model(medium, table, as_stored):
    for ranges in (medium, table):
        estimator, outcomes = fly(medium, ranges, later=True)
        as_stored(
            [[estimator.pose(vehicle=name) for name in STARTS], estimator.counts()],
            name="by rays" if ranges is medium else "by a table",
        )
        number = (END - END // 2) // PING
        assert estimator.counts()["gated"] == number == outcomes.count(Outcome.GATED)
        for name in STARTS:
            sigma = np.sqrt(np.diag(estimator.covariance(vehicle=name)))
            assert (np.abs(estimator.position(vehicle=name) - place(name, END)) < 4.0 * sigma).all()


def test_a_table_holds_in_both_directions(table, as_stored):
    model = TableModel(table)
    shallow, deep = np.array([[0.0, 0.0, 60.0]]), np.array([[800.0, 600.0, 250.0]])
    there = model.predict(RangeEndpoints(np.zeros(1), shallow, deep, np.zeros(1)))
    back = model.predict(
        RangeEndpoints(np.zeros(1), deep, shallow, np.zeros(1))
    )  # 250 m is no source depth of the table
    as_stored(there)
    assert there.possible.all()
    assert back.possible.all()
    np.testing.assert_array_equal(there.travel_time, back.travel_time)
    np.testing.assert_allclose(there.transmitter_gradient, back.receiver_gradient, rtol=1e-12)
    np.testing.assert_allclose(there.receiver_gradient, back.transmitter_gradient, rtol=1e-12)


def test_a_range_between_vehicles_waits_for_the_odometry_of_both(as_stored):
    starts = {name: StartPose(at) for name, at in STARTS.items()}
    estimator = OnlineEstimator(starts, {}, 1500.0, gate=math.inf)
    estimator.add_odometry(1.0, PACE["A"], np.zeros(3), SIGMA, vehicle="A")
    distance = float(np.linalg.norm(STARTS["A"] - STARTS["B"]))
    assert estimator.add_range(1.0, "B", distance / 1500.0, 1e-3, vehicle="A") == Outcome.WAITING
    before = estimator.covariance(vehicle="A")
    estimator.add_odometry(1.0, PACE["B"], np.zeros(3), SIGMA, vehicle="B")
    assert estimator.counts()["used"] == 1
    assert np.trace(estimator.covariance(vehicle="A")) < 0.9 * np.trace(before)
    as_stored([estimator.pose(vehicle=name) for name in STARTS])
