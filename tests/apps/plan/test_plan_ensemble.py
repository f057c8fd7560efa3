"""Everything that may be free, the waters of an ensemble, times that count, and costs."""

import numpy as np
import pytest
from factories import TINY
from refusals import refused

from pymantaray.apps.plan import DeploymentPlan, search_designs
from pymantaray.apps.plan.definition import PlanSection
from pymantaray.apps.plan.evaluate import DesignEvaluator
from pymantaray.apps.plan.results import worst_score
from pymantaray.apps.plan.waters import Missions
from pymantaray.config import parse_study
from pymantaray.config.door.beliefs import Beliefs
from pymantaray.config.estimators import CastBelief
from pymantaray.errors import PlanError
from pymantaray.ocean import open_ocean
from pymantaray.records import write_netcdf

MARK = {"name": "T", "north": 100.0, "east": -200.0, "depth": 5.0}
OTHER = {"name": "U", "north": -500.0, "east": 700.0, "depth": 50.0}
SHORT = {**TINY["mission"], "duration_h": 2.0}


@pytest.fixture(scope="module")
def window(tmp_path_factory):
    """Ocean of TINY in a file of its surroundings alone, which is perturbed faster."""
    path = tmp_path_factory.mktemp("ocean") / "window.nc"
    write_netcdf(open_ocean("synthetic:beaufort", window=(74.2, 74.8, -141.2, -138.8)), path)
    return {"ocean": {**TINY["ocean"], "source": str(path)}}


def plan_of(tree=None, **section):
    base = parse_study({**TINY, "mission": SHORT, "landmarks": [MARK], **(tree or {})}, "tiny")
    return DeploymentPlan(base, PlanSection(**section))


def test_a_position_on_a_line_has_equal_steps_or_varies_continuously(as_stored):
    ends = {"from": {"north": 0.0, "east": 0.0}, "to": {"north": 1000.0, "east": -500.0}}
    steps = plan_of(free={"landmarks.T": {**ends, "count": 3}})
    assert steps.size == 3
    assert steps.lists_at(1) == {"landmarks.T.north": 500.0, "landmarks.T.east": -250.0}
    assert steps.keys == ["landmarks.T.north", "landmarks.T.east"]
    mark = steps.study(steps.lists_at(2)).landmarks[0]
    assert (mark.north, mark.east, mark.depth) == (1000.0, -500.0, 5.0)
    results = search_designs(
        plan_of(free={"landmarks.T": ends}, objectives=["error"], evaluations=10), workers=1
    )
    for design in results.designs:
        assert design["landmarks.T.east"] == pytest.approx(-0.5 * design["landmarks.T.north"])
    assert len({design["landmarks.T.north"] for design in results.designs}) > 4
    as_stored([results.frame, results.scores, results.sentences])


@pytest.mark.parametrize(
    ("start", "stop"),
    [
        ({"north": 0.0}, {"east": 1.0}),
        ({"north": 0.0}, {"north": 0.0}),
        ({"north": "a"}, {"north": 1.0}),
        ({"north": 0.0}, 5.0),
    ],
)
def test_a_line_without_two_ends_is_refused(start, stop):
    plan = {"free": {"landmarks.T": {"from": start, "to": stop}}}
    refused(
        PlanError,
        "a line needs two different tables of numbers with the same keys",
        plan_of,
        **plan,
    )


def test_a_position_in_a_box_varies_in_both_axes():
    box = {
        "landmarks.T.north": {"from": -500.0, "to": 500.0},
        "landmarks.T.east": {"from": 0.0, "to": 900.0},
    }
    results = search_designs(plan_of(free=box, objectives=["error"], evaluations=10), workers=1)
    for key, limits in results.plan.ranges.items():
        values = [design[key] for design in results.designs]
        assert limits.low <= min(values) < max(values) <= limits.high


def test_the_number_of_landmarks_can_be_free(as_stored):
    free = {"landmarks": [[], [MARK], [MARK, OTHER]]}
    results = search_designs(plan_of(free=free, costs={"landmark": 10.0}), workers=1)
    assert results.frame["cost"].tolist() == [0.0, 10.0, 20.0]
    bounds = results.frame["bound_rmse_m"]
    assert bounds[0] > bounds[1] > bounds[2]
    as_stored([results.frame, results.scores, results.sentences])


def test_a_depth_band_slots_and_the_assumed_water_can_be_free():
    slots = {
        "mission": {**SHORT, "schedule": {"kind": "slots", "slots": ["A", "B"], "slot_s": 600.0}}
    }
    plan = plan_of(
        slots,
        free={
            "mission.schedule.slot_s": [600.0, 1200.0],
            "fleet.vehicles.B.target_depth": [100.0, 300.0],
            "conditions": [["refracted"], ["straight"]],
        },
    )
    assert plan.size == 8
    assert plan.study(plan.lists_at(7)).mission.schedule.slot_s == 1200.0


def test_errors_at_given_times_are_those_of_their_pings(as_stored):
    free = {"landmarks.T.depth": [5.0]}
    whole, first, both = (
        DesignEvaluator(plan_of(free=free, error_at_h=hours)).evaluate({}, 0, None)[1]
        for hours in (None, [1.0], [1.0, 2.0])
    )
    np.testing.assert_array_equal(first.time, [3600.0])
    np.testing.assert_allclose(first.bias, whole.bias[:1], atol=1e-9)
    np.testing.assert_allclose(first.covariance, whole.covariance[:1], rtol=1e-9)
    np.testing.assert_array_equal(both.time, whole.time)
    between = DesignEvaluator(plan_of(free=free, error_at_h=[1.5])).evaluate({}, 0, None)[1]
    assert between.time.tolist() == [5400.0]
    refused(
        PlanError, "plan.error_at_h: found 9; allowed: 0 to 2", plan_of, free=free, error_at_h=[9.0]
    )
    as_stored([whole, between])


def test_members_differ_from_the_ocean_and_from_each_other_and_repeat(window, as_stored):
    errors = {"rms": 1.0, "horizontal_scale": 2e4, "down_to": 300.0, "members": 2}
    plan = plan_of(window, free={"landmarks.T.depth": [5.0]}, perturbed=errors)
    assert plan.waters == [(0, 0), (0, 1)]
    still = (
        Missions(plan_of(window, free={"landmarks.T.depth": [5.0]}))
        .run({}, 0, None)[0]
        .ocean["sound_speed"]
    )
    missions = Missions(plan)
    one, other = (missions.run({}, 0, k)[0].ocean["sound_speed"] for k in range(2))
    for changed in (one - still, other - still, one - other):
        assert 0.3 < float(np.sqrt((changed**2).mean())) < 8.0
    again = Missions(plan).run({}, 0, 1)[0].ocean["sound_speed"]
    np.testing.assert_array_equal(again, other)
    as_stored([one, other])


def test_only_an_exact_belief_knows_the_perturbed_water(window, as_stored):
    errors = {"rms": 1.0, "horizontal_scale": 2e4, "down_to": 300.0, "members": 1}
    beliefs = {
        "exact": {"kind": "exact"},
        "forecast": {"kind": "file", "source": "synthetic:beaufort"},
    }
    bias = {}
    for name, belief in beliefs.items():
        conditions = [
            {
                "name": name,
                "ranges": "refracted",
                "range_model": {"kind": "eigenray", "belief": belief},
            }
        ]
        plan = plan_of(
            {"conditions": conditions, **window},
            free={"landmarks.T.depth": [5.0]},
            perturbed=errors,
        )
        bias[name] = DesignEvaluator(plan)({})[0].bias_rmse_m
    assert bias["exact"] < 1e-3
    assert bias["forecast"] > 100.0 * bias["exact"]
    as_stored(bias["forecast"])


def test_the_result_has_the_worst_tenth_and_its_front(window, as_stored):
    errors = {"rms": 1.0, "horizontal_scale": 2e4, "down_to": 300.0, "members": 3}
    free = {"landmarks.T.depth": [5.0, 200.0]}
    results = search_designs(
        plan_of(
            window, free=free, perturbed=errors, ranked_by="worst-tenth", condition="refracted"
        ),
        workers=1,
    )
    frame = results.frame
    assert (frame["worst_error_m"] >= frame["error_m"]).all()
    for k, scores in enumerate(results.scores):
        assert (
            frame["worst_error_m"][k]
            == max(one.error_m for one in scores)
            == worst_score(scores, "error_m")
        )
    assert results.best == int(np.argmin(frame["worst_error_m"]))
    assert set(frame["worst_front"]) <= {"yes", "no"}
    assert frame["worst_front"][results.best] == "yes"
    assert any("3 waters" in line and "the worst of them" in line for line in results.sentences)
    as_stored([results.frame, results.scores, results.sentences])


def test_a_perturbed_ocean_that_varies_in_time_is_refused():
    ocean = {
        **TINY["ocean"],
        "source": ["a.nc", "b.nc"],
        "time_varying": True,
        "time": "2014-07-15T12:00:00",
    }
    errors = {"rms": 1.0, "horizontal_scale": 2e4, "down_to": 300.0}
    refused(
        PlanError,
        "plan.perturbed: the ocean varies in time; set ocean.time_varying to false",
        plan_of,
        {"ocean": ocean},
        free={"landmarks.T.depth": [5.0]},
        perturbed=errors,
    )


def test_a_cast_costs_if_the_condition_assumes_it():
    cast = {"kind": "cast", "north": 0.0, "east": 0.0}
    conditions = [
        {"name": name, "ranges": "refracted", "range_model": {"kind": "eigenray", "belief": belief}}
        for name, belief in (("mean", {"kind": "mean"}), ("cast", cast))
    ]
    costs = [
        DesignEvaluator(
            plan_of(
                {"conditions": conditions},
                free={"landmarks.T.depth": [5.0]},
                condition=name,
                costs={"cast": 7.0},
            )
        )({})[0].cost
        for name in ("mean", "cast")
    ]
    assert costs == [0.0, 7.0]


def test_a_louder_source_loses_fewer_links(as_stored):
    detection = {"frequency_hz": 12e3, "source_level_db": 150.0, "bandwidth_hz": 1e3}
    free = {"detection.source_level_db": [80.0, 100.0, 190.0]}
    results = search_designs(plan_of({"detection": detection}, free=free), workers=1)
    lost = results.frame["lost_percent"]
    assert lost[0] > lost[2]
    assert lost[0] >= lost[1] >= lost[2]
    as_stored([results.frame, results.scores, results.sentences])


def test_the_best_value_at_a_limit_is_reported(as_stored):
    free = {"noise.range_sigma": {"from": 0.5, "to": 20.0}}
    plan = plan_of(free=free, objectives=["error"], condition="straight", evaluations=10)
    results = search_designs(plan, workers=1)
    assert results.designs[results.best] == {"noise.range_sigma": 0.5}
    assert (
        "The best noise.range_sigma is the lower limit of its range; a wider range may be better."
        in results.sentences
    )
    as_stored([results.frame, results.scores, results.sentences])


def test_a_cast_of_perturbed_water_is_its_column(window, as_stored):
    errors = {"rms": 1.0, "horizontal_scale": 2e4, "down_to": 300.0, "members": 1}
    run, ocean = Missions(plan_of(window, free={"landmarks.T.depth": [5.0]}, perturbed=errors)).run(
        {}, 0, 0
    )
    still = Missions(plan_of(window, free={"landmarks.T.depth": [5.0]})).run({}, 0, None)[0].ocean
    cast = (
        Beliefs(run, ocean)
        .believed(CastBelief(kind="cast", north=0.0, east=0.0), 0)
        .local["sound_speed"]
    )
    below = cast.sel(depth=slice(1.0, 250.0)).interp(north=0.0, east=0.0)
    of_member, of_forecast = (
        water["sound_speed"].interp(depth=below["depth"], north=0.0, east=0.0)
        for water in (run.ocean, still)
    )
    from_member, from_forecast = (
        float(np.sqrt(((below - water) ** 2).mean())) for water in (of_member, of_forecast)
    )
    assert (
        from_member < 0.2 * from_forecast
    )  # the column is interpolated in temperature, the member in sound speed
    assert from_forecast > 0.3
    as_stored([below, of_member, of_forecast])
