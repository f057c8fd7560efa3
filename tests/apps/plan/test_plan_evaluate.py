"""Designs are evaluated without realizations as full studies evaluate them."""

import numpy as np
import pytest
from factories import TINY
from scipy.stats import chi, kendalltau

from pymantaray.apps.plan import DeploymentPlan, search_designs
from pymantaray.apps.plan.definition import PlanSection
from pymantaray.apps.plan.evaluate import DesignEvaluator, Scores, error_quantile
from pymantaray.apps.plan.results import mean_score, pareto_front, worst_score
from pymantaray.apps.study import run_study
from pymantaray.config import load_study, parse_study
from pymantaray.records import RayStatus, VehicleStatus

MARK = {"name": "T", "north": 100.0, "east": -200.0, "depth": 5.0}


def plan_of(base, **section):
    return DeploymentPlan(base, PlanSection(**section))


@pytest.fixture(scope="module")
def tiny():
    return parse_study({**TINY, "landmarks": [MARK]}, "tiny")


def test_the_quantile_of_an_isotropic_error_is_a_chi_quantile(as_stored):
    covariance = np.tile(4.0 * np.eye(3), (500, 1, 1))
    found = error_quantile(np.zeros((500, 3)), covariance)
    assert found == pytest.approx(2.0 * chi(3).ppf(0.95), rel=5e-3)
    as_stored(found)


def test_the_quantile_of_a_bias_without_noise_is_its_size():
    assert error_quantile(np.tile([3.0, 0.0, 4.0], (7, 1)), np.zeros((7, 3, 3))) == pytest.approx(
        5.0
    )
    assert np.isnan(error_quantile(np.zeros((0, 3)), np.zeros((0, 3, 3))))


def test_lost_links_and_bias_are_those_of_the_study(tiny, tmp_path, as_stored):
    plan = plan_of(tiny, free={"landmarks.T.depth": [5.0, 300.0]}, lost_of="T")
    scores = DesignEvaluator(plan)({"landmarks.T.depth": 300.0})[0]
    run = run_study(plan.study({"landmarks.T.depth": 300.0}), tmp_path / "run", workers=1)
    ranges = run.ranges()
    own = ranges[(ranges["transmitter"] == "T") | (ranges["receiver"] == "T")]
    assert scores.lost_percent == pytest.approx(100.0 * np.mean(own["status"] != "OK"))
    heard = ranges[ranges["status"] == "OK"].groupby(["time", "transmitter"])["receiver"].nunique()
    sent = ranges.groupby(["time", "transmitter"]).ngroups
    assert scores.heard_by_two_percent == pytest.approx(100.0 * (heard >= 2).sum() / sent)
    assert scores.rmse_m == pytest.approx(np.hypot(scores.bound_rmse_m, scores.bias_rmse_m))
    as_stored(scores)


def test_straight_ranges_have_no_bias_and_refracted_ranges_have_one(tiny):
    free = {"landmarks.T.depth": [5.0]}
    straight, refracted = (
        DesignEvaluator(plan_of(tiny, free=free, condition=name))({})[0]
        for name in ("straight", "refracted")
    )
    assert straight.bias_rmse_m < 1e-4
    assert refracted.bias_rmse_m > 100.0 * straight.bias_rmse_m
    assert straight.bound_rmse_m == pytest.approx(refracted.bound_rmse_m)


def test_cost_counts_stations_landmarks_and_pings(tiny, as_stored):
    plan = plan_of(
        tiny,
        free={"mission.ping_interval_h": [1.0, 2.0]},
        costs={"station": 100.0, "landmark": 10.0, "ping": 0.5},
    )
    often, seldom = (
        DesignEvaluator(plan)({"mission.ping_interval_h": h})[0].cost for h in (1.0, 2.0)
    )
    transmitters = len(tiny.fleet.vehicles)
    assert often == pytest.approx(110.0 + 0.5 * 4 * transmitters)
    assert seldom == pytest.approx(110.0 + 0.5 * 2 * transmitters)
    as_stored([often, seldom])


def test_a_link_that_is_probably_not_detected_is_lost(tiny, as_stored):
    from pymantaray.apps.plan.evaluate import expected_measurements

    loud, faint = (
        parse_study(
            {
                **TINY,
                "landmarks": [MARK],
                "detection": {"frequency_hz": 12e3, "source_level_db": level, "bandwidth_hz": 1e3},
            },
            "tiny",
        )
        for level in (200.0, 60.0)
    )
    lost = []
    for config in (loud, faint):
        plan = plan_of(config, free={"landmarks.T.depth": [5.0]})
        evaluator = DesignEvaluator(plan)
        m = expected_measurements(evaluator.missions.run({}, 0, None)[0])
        lost.append(int(np.sum(m.range_status == RayStatus.UNHEARD)))
        assert np.isnan(m.refracted_range[m.range_status == RayStatus.UNHEARD]).all()
    assert lost[0] == 0
    assert lost[1] > 0
    as_stored(m)


def test_a_design_that_fails_has_a_reason_and_does_not_end_the_search(tiny, as_stored):
    plan = plan_of(tiny, free={"fleet.vehicles.B.target_depth": [300.0, 20000.0]})
    results = search_designs(plan, workers=1)
    status = results.frame["status"].tolist()
    if status[1] == "OK":  # a vehicle that grounds is an outcome, not a failure
        assert results.frame["lost_percent"][1] > results.frame["lost_percent"][0]
    assert results.best == 0
    as_stored([results.frame, results.scores, results.sentences])


def test_the_worst_tenth_of_oceans_is_on_the_bad_side():
    oceans = [
        Scores(error_m=e, heard_by_two_percent=h) for e, h in zip(range(20), range(20), strict=True)
    ]
    assert worst_score(oceans, "error_m") == 18.5
    assert worst_score(oceans, "heard_by_two_percent") == 0.5
    assert mean_score(oceans, "error_m") == 9.5
    assert np.isnan(worst_score([*oceans, Scores()], "error_m"))


def test_the_front_is_the_set_of_designs_that_no_other_dominates():
    losses = np.random.default_rng(3).integers(0, 8, (40, 3)).astype(float)
    losses[5] = np.nan
    front = pareto_front(losses)
    for k, row in enumerate(losses):
        dominated = any((other <= row).all() and (other < row).any() for other in losses)
        assert front[k] == (k != 5 and not dominated)


@pytest.mark.slow
def test_designs_have_the_order_of_full_studies(tmp_path):
    """
    Bounds of errors with straight ranges: four designs, whose errors differ by more than the
    standard errors of the studies.
    """
    base = load_study(
        "quick", realizations=25, conditions=["straight"], landmarks=[{**MARK, "sigma": 2.0}]
    )
    free = {"mission.ping_interval_h": [1.5, 6.0], "noise.range_sigma": [1.0, 50.0]}
    results = search_designs(plan_of(base, free=free), workers=1)
    full = [studied(results, k, tmp_path)[0] for k in range(len(results.designs))]
    planned = results.frame["rmse_m"].to_numpy()
    assert kendalltau(planned, full).statistic >= 0.9
    np.testing.assert_allclose(planned, full, rtol=0.15)


@pytest.mark.slow
def test_designs_on_the_front_keep_their_order_in_full_studies(tmp_path):
    """
    Bounds and biases of ranges with the mean slowness of a mean profile, without a receiver and
    with one.
    """
    model = {"kind": "mean-slowness", "belief": "mean"}
    base = load_study(
        "quick", realizations=25, conditions=[{"name": "assumed", "range_model": model}]
    )
    receiver = {"name": "T", "north": 2500.0, "east": 4500.0, "depth": 100.0, "sigma": 2.0}
    plan = plan_of(
        base,
        free={"landmarks": [[], [receiver]], "mission.ping_interval_h": [1.0, 3.0, 6.0]},
        objectives=("error", "cost"),
        costs={"landmark": 50.0, "ping": 1.0},
    )
    results = search_designs(plan, workers=1)
    front = np.flatnonzero(results.front)
    assert front.size >= 3
    full = np.array([studied(results, k, tmp_path) for k in front])
    planned = results.frame.loc[front, ["rmse_m", "error_m"]].to_numpy()
    np.testing.assert_array_equal(np.argsort(full[:, 1]), np.argsort(planned[:, 1]))
    np.testing.assert_allclose(planned, full, rtol=0.15)


def studied(results, number, folder):
    """
    RMSE and 95 % quantile of the errors of vehicles under water at the pings over realizations,
    from the records of a study.
    """
    run = run_study(results.plan.study(results.designs[number]), folder / f"{number}", workers=1)
    m = run.measurements
    under = run.truth.status == VehicleStatus.ACTIVE
    under[m.gnss_vehicle, m.gnss_sample] = False
    samples = np.unique(m.range_sample)
    errors = np.linalg.norm(run.estimates.position[0] - run.truth.position, axis=-1)[..., samples]
    own = errors[:, under[:, samples]]
    return np.sqrt(np.mean(own**2)), np.quantile(own, 0.95)


def test_a_rewritten_profile_has_other_scores_in_the_same_process(tiny, tmp_path, as_stored):
    file = tmp_path / "water.csv"
    tree = tiny.model_dump(exclude_none=True)
    tree["ocean"] = {"source": [str(file)], "bathymetry": 2000.0}
    tree["mission"] |= {"duration_h": 1.0}
    tree["conditions"] = ["straight", "refracted"]
    plan = plan_of(parse_study(tree, "tiny"), free={"landmarks.T.depth": [300.0]})
    found = []
    for gradient in (0.0, 0.08):
        speeds = [1450.0, 1450.0 + 2000.0 * gradient]
        file.write_text(f"depth,sound_speed\n0,{speeds[0]}\n2000,{speeds[1]}\n")
        found.append(search_designs(plan, workers=1).scores[0][0])
    assert found[0].bias_rmse_m < 0.01 < found[1].bias_rmse_m  # constant water bends no ray
    as_stored(found)


def test_the_waters_of_a_plan_are_those_of_the_files_now(tiny, tmp_path):
    """Of the study, and of the values of a free key, in the folder of the plan or elsewhere."""
    tree = tiny.model_dump(exclude_none=True)
    tree["ocean"] = {"source": [str(tmp_path / "base.csv")], "bathymetry": 2000.0}
    others = [["free.csv"], [str(tmp_path / "elsewhere.csv")], ["missing.csv"]]
    section = PlanSection(free={"ocean": {"source": others}})
    plan = DeploymentPlan(parse_study(tree, "tiny"), section, folder=tmp_path)
    files = [tmp_path / f"{name}.csv" for name in ("base", "free", "elsewhere")]
    water = "depth,sound_speed\n0,1450\n2000,1500\n"
    keys = []
    for changed in (None, *files, None):
        for file in files:
            file.write_text(water.replace("1450", "1460") if file == changed else water)
        keys.append(plan.fingerprint)
    assert (len({*keys}), keys[0]) == (4, keys[-1])
    assert plan.files == tuple(map(str, files))
