"""
Trajectory errors: definitions by hand, equality with evo, failed solves, coverage of the intervals.
"""

from dataclasses import replace

import factories
import numpy as np
import pytest
from refusals import refused
from scipy import stats

from pymantaray.errors import EvaluationError
from pymantaray.evaluation import comparison_table, error_table, trajectory_errors
from pymantaray.evaluation.trajectory_error import ape, ate_statistics
from pymantaray.geometry.se3 import quaternion_from_matrix, so3_exp
from pymantaray.records import SolveStatus


def make_run(
    seed=0,
    *,
    n_realizations=4,
    n_vehicles=3,
    n_times=40,
    conditions=("straight", "refracted"),
    shift=0.0,
):
    """
    Truth by random walk; the estimates err by noise, by `shift` metres north in the last condition.
    """
    rng = np.random.default_rng(seed)
    position = np.cumsum(rng.normal(0, 50.0, (n_vehicles, n_times, 3)), axis=1)
    quaternion = quaternion_from_matrix(so3_exp(rng.normal(0, 1.0, (n_vehicles, n_times, 3))))
    truth = factories.trajectories(position, quaternion=quaternion)
    common = rng.normal(0, 3.0, (n_realizations, n_vehicles, n_times, 3))
    error = common + rng.normal(0, 1.0, (len(conditions), n_realizations, n_vehicles, n_times, 3))
    error[-1, ..., 0] += shift
    return truth, factories.estimates(truth, position + error, conditions)


def with_failure(estimates, condition, realization):
    status, position = np.array(estimates.solve_status), np.array(estimates.position)
    status[condition, realization] = SolveStatus.FAILED
    position[condition, realization] = np.nan
    return replace(estimates, solve_status=status, position=position)


def test_ape_is_a_distance_and_is_not_aligned():
    truth = np.random.default_rng(0).normal(size=(2, 5, 3))
    np.testing.assert_allclose(ape(truth + np.array([3.0, 4.0, 12.0]), truth), 13.0, rtol=1e-12)
    refused(EvaluationError, r"\(2, 4, 3\) against \(2, 5, 3\)", ape, truth[:, :4], truth)


def test_distances_have_the_digits_of_a_norm():
    """
    They are the same numbers as before in every table; a sum in another order differs in the last
    digit.
    """
    rng = np.random.default_rng(1)
    truth, estimate = 1e4 * rng.normal(size=(2, 50, 3)), 1e4 * rng.normal(size=(3, 2, 50, 3))
    estimate[0, 1, 7] = np.nan
    np.testing.assert_array_equal(ape(estimate, truth), np.linalg.norm(estimate - truth, axis=-1))


def test_statistics_of_a_known_set():
    s = ate_statistics([[0.0, 1.0, 2.0], [3.0, np.nan, 4.0]])
    assert (s["n"], s["mean_m"], s["median_m"], s["max_m"]) == (5, 2.0, 2.0, 4.0)
    assert s["rmse_m"] == pytest.approx(np.sqrt(6.0))
    assert (s["p25_m"], s["p75_m"]) == (1.0, 3.0)
    assert s["p5_m"] == pytest.approx(0.2)
    assert s["p95_m"] == pytest.approx(3.8)
    empty = ate_statistics([np.nan])
    assert empty["n"] == 0
    assert np.isnan(empty["rmse_m"])


def test_equals_evo_on_a_whole_run():
    metrics = pytest.importorskip("evo.core.metrics")
    trajectory = pytest.importorskip("evo.core.trajectory")
    truth, estimates = make_run(seed=4)

    def as_evo(position, quaternion):
        return trajectory.PoseTrajectory3D(position, quaternion.astype(float), np.array(truth.time))

    ours = trajectory_errors(truth, estimates)
    keys = ["condition", "realization", "vehicle"]
    table = error_table(truth, estimates, by=keys[1:]).set_index(keys)
    for c, r, a in np.ndindex(*ours.shape[:3]):
        metric = metrics.APE(metrics.PoseRelation.translation_part)
        ends = [(truth.position[a], truth.quaternion[a])]
        ends.append((estimates.position[c, r, a], estimates.quaternion[c, r, a]))
        metric.process_data(tuple(as_evo(*end) for end in ends))
        np.testing.assert_allclose(ours[c, r, a], metric.error, rtol=1e-12)
        theirs, row = (
            metric.get_all_statistics(),
            table.loc[(estimates.condition[c], r, truth.name[a])],
        )
        for name in ("mean", "median", "rmse", "max"):
            assert row[f"{name}_m"] == pytest.approx(theirs[name], rel=1e-12), name
    pooled = error_table(truth, estimates).set_index("condition")
    for condition, errors in zip(estimates.condition, ours, strict=True):
        assert pooled.loc[condition, "n"] == errors.size
        assert pooled.loc[condition, "rmse_m"] == pytest.approx(
            np.sqrt(np.mean(errors**2)), rel=1e-12
        )
        assert pooled.loc[condition, "p95_m"] == pytest.approx(np.percentile(errors, 95), rel=1e-12)


def test_failed_solve_is_left_out_and_counted():
    truth, whole = make_run()
    estimates = with_failure(whole, 1, 2)
    table = error_table(truth, estimates).set_index("condition")
    assert table["solves"].to_dict() == {"straight": 4, "refracted": 3}
    assert table["failed_solves"].to_dict() == {"straight": 0, "refracted": 1}
    assert table.loc["refracted", "n"] == 3 * 3 * 40
    expected = ate_statistics(trajectory_errors(truth, whole)[1, [0, 1, 3]])["rmse_m"]
    assert table.loc["refracted", "rmse_m"] == expected
    one = error_table(truth, estimates, by=["realization"]).set_index(["condition", "realization"])
    assert one.loc[("refracted", 2), ["n", "solves", "failed_solves"]].tolist() == [0, 0, 1]
    assert np.isnan(one.loc[("refracted", 2), "rmse_m"])
    comparison = comparison_table(truth, estimates)
    assert (set(comparison["realizations"]), set(comparison["excluded"])) == ({3}, {1})
    over = replace(whole, solve_status=np.full((2, 4), SolveStatus.OVER_CHI_SQUARE))
    assert error_table(truth, over)["failed_solves"].tolist() == [0, 0], (
        "its cost is out of bounds, no more"
    )


def test_records_that_do_not_belong_together_are_refused():
    truth, estimates = make_run()
    lying = replace(with_failure(estimates, 1, 2), solve_status=estimates.solve_status)
    other = replace(truth, name=np.array(["X", "Y", "Z"])), estimates
    later = replace(truth, time=truth.time + 1.0), estimates
    refused(EvaluationError, "are of vehicles", error_table, *other)
    refused(EvaluationError, "different sample times", error_table, *later)
    refused(
        EvaluationError,
        "allowed are 'realization' and 'vehicle'",
        error_table,
        truth,
        estimates,
        ["hour"],
    )
    refused(
        EvaluationError,
        "refracted, realization 2: status is good but poses",
        error_table,
        truth,
        lying,
    )
    says = "'bent' was not run; there are straight, refracted"
    refused(EvaluationError, says, comparison_table, truth, estimates, [("bent", "straight")])


@pytest.mark.parametrize(("options", "confidence"), [({}, 0.95), ({"confidence": 0.8}, 0.8)])
def test_difference_is_that_of_the_pooled_statistics(options, confidence):
    truth, estimates = make_run(shift=5.0, n_realizations=8)
    pooled = error_table(truth, estimates).set_index("condition")
    own = error_table(truth, estimates, by=["realization"]).set_index(["condition", "realization"])
    table = comparison_table(truth, estimates, **options)
    assert table[["condition", "baseline"]].drop_duplicates().to_numpy().tolist() == [
        ["refracted", "straight"]
    ]
    for _, row in table.iterrows():
        column = f"{row['statistic']}_m"
        expected = pooled.loc["refracted", column] - pooled.loc["straight", column]
        assert row["pooled_difference_m"] == pytest.approx(expected, rel=1e-9)
        differences = own.loc["refracted", column] - own.loc["straight", column]
        student = stats.ttest_1samp(differences, 0.0).confidence_interval(confidence)
        assert (row["t_low_m"], row["t_high_m"]) == pytest.approx((student.low, student.high))
        assert 0.0 < row["t_low_m"] < row["mean_difference_m"] < row["t_high_m"]
        assert 0.0 < row["bootstrap_low_m"] < row["pooled_difference_m"] < row["bootstrap_high_m"]


def test_an_interval_is_reproducible_and_absent_for_one_realization():
    truth, estimates = make_run(shift=5.0)
    assert comparison_table(truth, estimates).equals(comparison_table(truth, estimates))
    single = comparison_table(*make_run(n_realizations=1))
    assert (
        single[["t_low_m", "t_high_m", "bootstrap_low_m", "bootstrap_high_m"]].isna().all(axis=None)
    )
    assert single["pooled_difference_m"].notna().all()


def test_pairing_narrows_the_interval():
    # both conditions share errors of 3 m; only the 1 m that differs may widen the interval
    truth, estimates = make_run(seed=2, n_realizations=25, n_vehicles=1, n_times=5)
    errors = trajectory_errors(truth, estimates).mean(axis=(2, 3))
    row = comparison_table(truth, estimates).set_index("statistic").loc["mean"]
    unpaired = stats.ttest_ind(errors[1], errors[0]).confidence_interval(0.95)
    assert row["t_high_m"] - row["t_low_m"] < 0.7 * (unpaired.high - unpaired.low)


@pytest.mark.slow
def test_the_bootstrap_covers_nearly_as_often_as_its_level():
    shift, covered, n = 4.0, 0, 150
    big_truth, big = make_run(seed=0, n_realizations=4000, n_vehicles=1, n_times=4, shift=shift)
    expected = (
        comparison_table(big_truth, big).set_index("statistic").loc["rmse", "pooled_difference_m"]
    )
    for seed in range(1, n + 1):
        truth, estimates = make_run(
            seed=seed, n_realizations=25, n_vehicles=1, n_times=4, shift=shift
        )
        row = comparison_table(truth, estimates).set_index("statistic").loc["rmse"]
        covered += row["bootstrap_low_m"] <= expected <= row["bootstrap_high_m"]
    # percentile intervals of 25 are a little short: between 0.88 and all
    assert covered >= 0.88 * n, covered
