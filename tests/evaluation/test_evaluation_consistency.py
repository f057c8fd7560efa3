"""
Consistency: known distributions, correlated fleets, a linear problem with closed-form covariance, a
real study.
"""

from dataclasses import replace

import factories
import numpy as np
import pytest
from refusals import refused
from scipy import stats

from pymantaray.apps.study import run_study
from pymantaray.config import load_study, parse_study
from pymantaray.errors import EvaluationError
from pymantaray.evaluation import coverage_table
from pymantaray.evaluation.consistency import (
    consistency_summary,
    consistency_table,
    epoch_errors,
    mean_chi_square_bounds,
    nees,
)
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, so3_exp
from pymantaray.records import PoseCovariances, SolveStatus

SAMPLES = np.array([4, 9])
N_TIMES, N_VEHICLES = 10, 4


def make_case(seed=0, *, n_realizations=40, believed=(1.0, 1.0), common=3.0, shift=0.0):
    """
    Two conditions of Kalman's scalar kind: a shared error of the fleet and one of each vehicle, all
    Gaussian.

    The first condition errs by what it believes, scaled by `believed[0]`; so does the second,
    shifted north.
    """
    rng = np.random.default_rng(seed)
    position = rng.normal(0, 500.0, (N_VEHICLES, N_TIMES, 3))
    quaternion = quaternion_from_matrix(so3_exp(rng.normal(0, 1.0, (N_VEHICLES, N_TIMES, 3))))
    truth = factories.trajectories(
        position, time=3600.0 * np.arange(N_TIMES), quaternion=quaternion
    )
    shape = (2, n_realizations)
    own = np.array([2.0, 1.0, 0.01])
    # a measurement of standard deviation 1 of something with prior 2: closed form, the same in each
    # axis
    joint = np.einsum("ab,ij->aibj", np.eye(N_VEHICLES), np.diag(own**2))
    joint += common**2 * np.einsum(
        "ab,ij->aibj", np.ones((N_VEHICLES, N_VEHICLES)), np.diag([1.0, 1.0, 0.0])
    )
    flat = joint.reshape(3 * N_VEHICLES, -1)
    root = np.linalg.cholesky(flat)
    error = np.einsum("ij,crtj->crti", root, rng.standard_normal((*shape, N_TIMES, 3 * N_VEHICLES)))
    error = np.swapaxes(error.reshape(*shape, N_TIMES, N_VEHICLES, 3), 2, 3)
    error[1, ..., 0] += shift
    turn = 0.01 * rng.standard_normal((*shape, N_VEHICLES, N_TIMES, 3))
    estimate = matrix_from_quaternion(quaternion) @ so3_exp(turn)
    estimates = factories.estimates(
        truth, position + error, quaternion=quaternion_from_matrix(estimate)
    )
    scale = np.array(believed)[:, None, None, None, None, None, None] ** 2
    size = (*shape, SAMPLES.size)
    believed_joint = scale * np.broadcast_to(joint, (*size, *joint.shape))
    to_body = np.swapaxes(estimate[..., SAMPLES, :, :], 2, 3).swapaxes(-1, -2)
    pose = np.zeros((*size, N_VEHICLES, 6, 6))
    pose[..., :3, :3] = 0.01**2 * np.eye(3)
    block = np.einsum("creaiaj->creaij", believed_joint)
    pose[..., 3:, 3:] = to_body @ block @ np.swapaxes(to_body, -1, -2)
    covariances = PoseCovariances(
        condition=estimates.condition,
        realization=estimates.realization,
        name=truth.name,
        sample=SAMPLES,
        time=truth.time[SAMPLES],
        position_covariance=believed_joint,
        pose_covariance=pose,
        range_nis=rng.chisquare(12, size),
        range_dimension=np.full(size, 12),
    )
    return truth, estimates, covariances


def test_nees_of_a_known_error():
    covariance = np.diag([4.0, 9.0])
    assert nees([2.0, 3.0], covariance) == pytest.approx(2.0)
    turn = so3_exp([0.0, 0.0, 0.7])[:2, :2]
    assert nees(turn @ [2.0, 3.0], turn @ covariance @ turn.T) == pytest.approx(2.0)
    both = nees([[2.0, 3.0], [np.nan, 0.0]], np.stack([covariance, covariance]))
    assert both[0] == pytest.approx(2.0)
    assert np.isnan(both[1])
    # metres beside microradians: the scale of an axis is none of its business
    assert nees([1e-6, 1e3], np.diag([1e-12, 1e6])) == pytest.approx(2.0)


@pytest.mark.parametrize(
    "bad", [np.diag([1.0, 0.0]), np.diag([1.0, -1.0]), [[1.0, 2.0], [2.0, 1.0]]]
)
def test_covariance_that_is_none_is_refused(bad):
    refused(EvaluationError, "not positive definite", nees, [1.0, 1.0], bad)
    refused(EvaluationError, r"\(3, 3\) for errors of \(2,\)", nees, [1.0, 1.0], np.eye(3))


def test_bounds_hold_ninety_five_percent_and_shrink_with_realizations():
    low, high = mean_chi_square_bounds(
        50
    )  # Bar-Shalom's example of 50 runs of a dimension of 2 has 100
    assert (50 * low, 50 * high) == pytest.approx((32.357, 71.420), abs=1e-3)
    draws = np.random.default_rng(0).chisquare(50, 20000) / 50
    assert np.mean((draws >= low) & (draws <= high)) == pytest.approx(0.95, abs=0.005)
    many = mean_chi_square_bounds(5000)
    assert many[1] - many[0] < (high - low) / 9
    assert np.isnan(mean_chi_square_bounds(0)).all()


def test_a_consistent_fleet_is_inside_and_a_shifted_one_outside():
    case = make_case(seed=21, shift=12.0)
    table = consistency_table(*case)
    straight, refracted = (table[table["condition"] == name] for name in ("straight", "refracted"))
    assert straight["inside"].sum() >= 5, "of 6 tests; one in twenty is outside by chance"
    shifted = refracted[refracted["statistic"] != "ranges"]
    assert not shifted["inside"].any()
    summary = consistency_summary(table).set_index(["condition", "statistic"])
    assert summary.loc["straight", "consistent"].all()
    assert not summary.loc[("refracted", "horizontal"), "consistent"]
    freedom = table.groupby("statistic")["degrees_of_freedom"].first()
    assert freedom.to_dict() == {"horizontal": 40 * 8, "position": 40 * 12, "ranges": 40 * 12}


@pytest.mark.parametrize(("believed", "above"), [(0.8, True), (1.25, False)])
def test_over_and_underconfidence_show_on_their_sides(believed, above):
    table = consistency_table(*make_case(seed=2, believed=(believed, 1.0)))
    mine = table[(table["condition"] == "straight") & (table["statistic"] == "horizontal")]
    assert mine["ratio"].mean() == pytest.approx(1.0 / believed**2, rel=0.12)
    assert ((mine["ratio"] > mine["high"]) if above else (mine["ratio"] < mine["low"])).all()


def test_false_alarms_are_five_percent_despite_correlation():
    """The joint statistic keeps its level; pooling vehicles as if independent would not."""
    alarms, naive, n = [], [], 40
    for seed in range(n):
        truth, estimates, covariances = make_case(seed=100 + seed, n_realizations=8, common=10.0)
        table = consistency_table(truth, estimates, covariances)
        alarms.append((~table["inside"]).groupby(table["statistic"]).sum())
        each = consistency_table(truth, estimates, covariances, by_vehicle=True)
        pooled = (
            each[each["statistic"] == "horizontal"].groupby(["condition", "time_h"])["ratio"].mean()
        )
        low, high = mean_chi_square_bounds(8 * 2 * N_VEHICLES)
        naive += ((pooled < low) | (pooled > high)).tolist()
    share = sum(alarms) / (4 * n)  # two conditions, two epochs
    low, high = stats.binom.ppf([0.001, 0.999], 4 * n, 0.05) / (4 * n)
    assert ((low <= share) & (share <= high)).all(), share
    assert np.mean(naive) > 2 * high


def test_vehicles_are_judged_one_by_one_and_poses_in_six_dimensions():
    table = consistency_table(*make_case(seed=3, n_realizations=60), by_vehicle=True)
    assert set(table["vehicle"]) == set("ABCD")
    freedom = table.groupby("statistic")["degrees_of_freedom"].first()
    assert freedom.to_dict() == {"horizontal": 120, "position": 180, "pose": 360}
    summary = consistency_summary(table)
    assert summary["consistent"].all(), summary
    assert (summary["inside"] >= 6).all(), "of 8 tests each; one in twenty is outside by chance"


def test_rotation_and_translation_are_taken_apart():
    """The twist of the whole motion would lean metres across into a depth known to centimetres."""
    truth, estimates, covariances = make_case(seed=4)
    errors = epoch_errors(truth, estimates, covariances)
    quaternion = np.swapaxes(estimates.quaternion[..., SAMPLES, :], 2, 3)
    back = np.einsum("...ij,...j->...i", matrix_from_quaternion(quaternion), errors.pose[..., 3:])
    np.testing.assert_allclose(back, -errors.position, atol=1e-5)  # the quaternion has seven digits
    assert np.linalg.norm(errors.pose[..., :3], axis=-1).max() < 0.06
    np.testing.assert_allclose(errors.pose[..., :3].std(), 0.01, rtol=0.1)


def test_failed_solves_leave_the_sum_and_its_degrees_of_freedom():
    truth, estimates, covariances = make_case(seed=5)
    status, position = np.array(estimates.solve_status), np.array(estimates.position)
    status[0, 3], position[0, 3] = SolveStatus.FAILED, np.nan
    table = consistency_table(
        truth, replace(estimates, solve_status=status, position=position), covariances
    )
    mine = table[(table["statistic"] == "horizontal") & (table["condition"] == "straight")]
    assert (mine["realizations"] == 39).all()
    assert (mine["degrees_of_freedom"] == 39 * 8).all()
    whole = consistency_table(truth, estimates, covariances)
    assert len(whole) == len(table)
    nis = np.array(covariances.range_nis)
    nis[0] = np.nan
    none = consistency_table(truth, estimates, replace(covariances, range_nis=nis))
    assert set(none.loc[none["statistic"] == "ranges", "condition"]) == {"refracted"}


@pytest.mark.parametrize(("field", "values", "said"), [
    ("name", ["A", "B", "C", "X"], "different vehicles"),
    ("condition", ["straight", "other"], "different conditions"),
    ("realization", np.arange(40) + 1, "different realizations"),
    ("sample", [4, 99], "sample 99; the truth has 10"),
])  # fmt: skip
def test_records_that_do_not_belong_together_are_refused(field, values, said):
    truth, estimates, covariances = make_case(seed=6)
    with pytest.raises(EvaluationError, match=said):
        consistency_table(truth, estimates, replace(covariances, **{field: np.array(values)}))


def test_coverage_of_a_consistent_fleet_and_its_effective_number():
    case = make_case(seed=7, n_realizations=200, shift=20.0)
    table = coverage_table(*case)
    straight = table[table["condition"] == "straight"]
    assert straight["inside"].mean() >= 10 / 12, straight
    assert set(straight["axis"]) == {"north", "east", "down"}
    one = straight[straight["sigmas"] == 1.0].groupby("axis")["effective_n"].first()
    assert one["down"] == 800, "vehicles are independent in depth"
    assert one["east"] < one["north"] < 600, "a common error of 3 m beside 1 m east and 2 m north"
    north = table[(table["condition"] == "refracted") & (table["axis"] == "north")]
    assert not north["inside"].any()
    assert (north["share"] < north["low"]).all()


def test_variance_of_the_share_is_that_of_as_many_independent_draws():
    n = 2000
    truth, estimates, covariances = make_case(seed=8, n_realizations=n, common=3.0)
    table = coverage_table(truth, estimates, covariances)
    error = epoch_errors(truth, estimates, covariances).position[0, :, 0, :, 1]
    share = np.mean(np.abs(error) <= np.sqrt(10.0), axis=1)
    row = table[
        (table["condition"] == "straight") & (table["axis"] == "east") & (table["sigmas"] == 1.0)
    ].iloc[0]
    p = row["expected"]
    assert p * (1 - p) / share.var() == pytest.approx(row["effective_n"] / n, rel=0.06)


@pytest.mark.slow
def test_straight_ranges_are_consistent_and_refracted_ranges_are_not(tmp_path):
    """
    Five vehicles of the quick preset for eight hours, 16 realizations, covariances at its pings.
    """
    tree = load_study("quick", realizations=16).model_dump(mode="python")
    tree["fleet"]["vehicles"] = tree["fleet"]["vehicles"][:5]
    tree["mission"] |= {"duration_h": 8.0, "physics_step_s": 1.0}
    tree["ocean"] |= {"half_extent_north": 15000.0, "half_extent_east": 15000.0}
    tree["estimator"]["covariance_interval_h"] = 4.0
    run = run_study(parse_study(tree), tmp_path / "run", workers=1)
    small_study = run.truth, run.estimates, run.covariances
    fleet = consistency_table(*small_study)
    summary = consistency_summary(fleet).set_index(["condition", "statistic"])
    assert fleet.loc[fleet["condition"] != "refracted", "inside"].all(), fleet
    refracted = fleet[fleet["condition"] == "refracted"]
    assert not refracted["inside"].any()
    assert (refracted["ratio"] > 10.0 * refracted["high"]).all(), "not by a little"
    assert summary.loc["straight", "consistent"].all()
    vehicles = consistency_summary(consistency_table(*small_study, by_vehicle=True))
    assert vehicles.loc[vehicles["condition"] != "refracted", "consistent"].all(), vehicles
    coverage = coverage_table(*small_study)
    good = coverage[coverage["condition"] != "refracted"]
    assert good["inside"].mean() > 0.85, good[~good["inside"]]
    level = coverage[(coverage["condition"] == "refracted") & (coverage["axis"] != "down")]
    assert (level["share"] < level["low"]).mean() > 0.8
