"""
Positions from made-up surveys: truth within the stated uncertainty, gross errors found, second
solutions, failures told.
"""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from campaigns import GRADIENT, SURFACE_SPEED, direct_time, make_campaign, survey_of, water
from oracles import direct_travel_time_linear_gradient
from refusals import refused
from scipy.stats import binom, chi2, multivariate_normal

from pymantaray.acoustics import Medium
from pymantaray.apps.locate import (
    LeverArm,
    LocateOptions,
    Node,
    PlanOptions,
    PlatformError,
    Survey,
    TravelDirection,
    locate,
    page,
)
from pymantaray.apps.locate.checks import check_survey
from pymantaray.apps.locate.displacement import campaign_of
from pymantaray.apps.locate.evidence import posterior
from pymantaray.apps.locate.linear import Linearization
from pymantaray.apps.locate.mirror import with_mirrors
from pymantaray.apps.locate.models import solve
from pymantaray.apps.locate.noise import Correlation
from pymantaray.apps.locate.sound_speed import SpeedPrior, sound_speed_terms
from pymantaray.apps.locate.travel_times import predict
from pymantaray.apps.locate.unknowns import SurveyUnknowns
from pymantaray.apps.locate.write import summary
from pymantaray.errors import LocateError
from pymantaray.ocean.modes import VerticalModes

FLAT = LocateOptions(earth="flat")  # positions of made-up surveys are in metres
TIME = LocateOptions(earth="flat", speed_model="time", correlation="none")
SCALE = LocateOptions(earth="flat", speed_model="scale", correlation="none")


@pytest.fixture(scope="module")
def medium():
    return water()


@pytest.fixture(scope="module")
def campaign():
    return make_campaign(3)


@pytest.fixture(scope="module")
def located(campaign, medium):
    return locate(survey_of(campaign, sigma=1e-4), medium, FLAT)


def nees(location, truth):
    error = (location.positions - truth).ravel()
    return float(error @ np.linalg.solve(location.covariance, error))


def test_positions_are_true_within_their_covariance(located, campaign):
    assert nees(located, campaign.truth) < chi2.ppf(0.999, campaign.truth.size)
    assert located.solution.settled
    assert located.nodes["status"].tolist() == ["ok"] * 3
    assert located.hyperparameters["sigma_s"] == pytest.approx(1e-4, rel=0.15)


def test_numbers_of_a_located_survey_stay(located, as_stored):
    as_stored(located, without="candidates")
    as_stored(
        [located.tables, located.centre, located.covariance, located.mean_speed], name="tables"
    )
    before = campaign_of(located)
    before = replace(
        before, positions=before.positions + np.array([0.3, -0.2, 0.1]), source="before"
    )
    later = located.since(before)
    as_stored([later.displacement.as_dict(), page._cards(later)], name="displacement")


def test_the_model_that_made_the_data_is_chosen_and_no_test_fails(located):
    assert located.hyperparameters["sound_speed"] == "time"
    assert located.hyperparameters["correlation_ratio"] == 0.0
    assert located.passed
    table = located.candidates
    assert {"known", "scale", "time", "gradient"} <= set(table["sound_speed"])
    assert table.loc[table["chosen"], "sound_speed"].tolist() == ["time"]
    assert (table["abic"].diff().dropna() >= 0.0).all()


def test_gross_errors_are_left_out_with_a_reason_and_nothing_else_is(located, campaign):
    np.testing.assert_array_equal(~located.solution.used, campaign.gross)
    words = located.reason[campaign.gross]
    assert all("ms" in word for word in words)
    assert (located.reason[~campaign.gross] == "").all()


def test_squares_of_the_budget_add_up_to_the_variances(located):
    for name, part in located.budget.groupby("node"):
        row = located.nodes.set_index("name").loc[name]
        parts = part[part["source"] != "total"][["north_m", "east_m", "depth_m"]].to_numpy()
        total = np.sqrt(np.sum(parts**2, axis=0))
        np.testing.assert_allclose(
            total, row[["sigma_north_m", "sigma_east_m", "sigma_depth_m"]].astype(float), rtol=1e-6
        )


def test_leverages_add_up_to_the_number_of_determined_parameters(located):
    leverage = located.pings["leverage"]
    assert leverage.sum() == pytest.approx(located.solution.posterior.effective, rel=1e-6)
    assert leverage.dropna().between(0.0, 1.0).all()


def test_absolute_and_relative_uncertainties_are_reported_apart(located):
    nodes = located.nodes
    assert (nodes["relative_sigma_north_m"] < nodes["sigma_north_m"]).all()
    assert located.centre["sigma_depth_m"] > 3.0 * nodes["relative_sigma_depth_m"].max()


def test_derivatives_are_those_of_the_predicted_times(campaign, medium, as_stored):
    few = np.arange(0, 60)
    survey = survey_of(
        campaign, turn_around_sigma=1e-3, lever=LeverArm(campaign.lever[0], (0.1, 0.1, 0.1))
    ).rows(few)
    speed = sound_speed_terms(survey, campaign.prior, "gradient", SpeedPrior())
    unknowns = SurveyUnknowns(survey, speed, "rigid")
    rng = np.random.default_rng(0)
    values = unknowns.prior_mean
    values[unknowns.slices["speed"]] = 1e-4 * rng.normal(size=speed.size)
    values[unknowns.slices["array"]] = [1.0, -2.0, 3.0, 0.0]

    def times(x):
        legs = predict(survey, medium, unknowns.positions(x), unknowns.lever(x))
        return unknowns.predict_times(x, legs)

    legs = predict(survey, medium, unknowns.positions(values), unknowns.lever(values))
    rows = Linearization(unknowns, values, legs, np.ones(60)).rows(slice(0, 60))
    columns = [
        0,
        4,
        8,
        *range(9, 13),
        13,
        unknowns.slices["lever"].start + 1,
        *range(unknowns.slices["speed"].start, unknowns.size, 11),
    ]
    for column in columns:
        step = np.zeros(unknowns.size)
        step[column] = 1e-4 if column in range(13, unknowns.slices["offset"].start) else 1e-2
        if column == 12 or column >= unknowns.slices["speed"].start:
            step[column] = 1e-6
        numeric = (times(values + step) - times(values - step)) / (2.0 * step[column])
        np.testing.assert_allclose(
            rows[:, column], numeric, rtol=2e-5, atol=2e-5 * np.abs(numeric).max()
        )
    as_stored([legs, rows])


def test_whitening_and_evidence_are_those_of_the_whole_covariance(campaign, medium, as_stored):
    """
    The filter over rows against the covariance matrix written out, and the evidence against the
    density of the data.
    """
    few = np.arange(0, 90)
    survey = survey_of(campaign).rows(few)
    platform = PlatformError(0.3, 0.2, 400.0)
    correlation = Correlation(0.7, 100.0, 0.3)
    speed = sound_speed_terms(survey, campaign.prior, "scale", SpeedPrior())
    unknowns = SurveyUnknowns(survey, speed)
    values = unknowns.prior_mean
    legs = predict(survey, medium, unknowns.positions(values), unknowns.lever(values))
    weight = np.random.default_rng(1).uniform(0.5, 2.0, 90)
    linear = Linearization(unknowns, values, legs, weight)
    sigma = 2e-4
    used = np.arange(90) % 7 != 0
    products = linear.products(used, correlation, platform, sigma)
    apart = np.abs(survey.time[:, None] - survey.time)
    same = survey.node[:, None] == survey.node
    noise = np.eye(90) + 0.7 * np.exp(-apart / 100.0) * (0.3 + 0.7 * same)
    slope = (legs.transmit_gradient + legs.receive_gradient) / sigma
    outer = slope[:, None, :] * slope[None, :, :] * np.exp(-apart / 400.0)[..., None]
    whole = noise * np.outer(weight, weight) + outer @ np.array([0.09, 0.09, 0.04])
    whole = whole[np.ix_(used, used)]
    rows, residual = linear.rows(slice(0, 90))[used], linear.residual[used]
    np.testing.assert_allclose(
        products.normal, rows.T @ np.linalg.solve(whole, rows), rtol=1e-8, atol=1e-12
    )
    np.testing.assert_allclose(
        products.right, rows.T @ np.linalg.solve(whole, residual), rtol=1e-7, atol=1e-12
    )
    assert products.log_determinant == pytest.approx(np.linalg.slogdet(whole)[1], rel=1e-9)
    found = posterior(products, unknowns, values, {}, sigma=sigma, steps=1)
    prior = rows @ np.diag(unknowns.prior_sd**2) @ rows.T
    density = multivariate_normal(
        np.zeros(int(used.sum())), sigma**2 * whole + prior, allow_singular=True
    )
    assert found.log_evidence == pytest.approx(density.logpdf(residual), rel=1e-6)
    as_stored([products, found])


@pytest.mark.parametrize(
    "change",
    [
        pytest.param({"kind": "scale"}, id="sound speed that drifts"),
        pytest.param({"level": True}, id="attitude"),
        pytest.param({"sigma": 3e-5}, id="noise stated too small"),
    ],
)
def test_leaving_a_term_out_fails_the_chi_square_test(campaign, medium, change, as_stored):
    survey = survey_of(campaign, sigma=change.get("sigma", 1e-4))
    if change.get("level"):
        turned = (
            survey.transmit_attitude * [1.0, 0.0, 0.0],
            survey.receive_attitude * [1.0, 0.0, 0.0],
        )
        survey = survey.assign(transmit_attitude=turned[0], receive_attitude=turned[1])
    options = LocateOptions(
        earth="flat", speed_model=change.get("kind", "time"), correlation="none"
    )
    found = locate(survey, medium, options)
    assert not found.passed
    as_stored([found.nodes, found.tests, found.hyperparameters])
    if "sigma" in change:  # the covariance contains the estimated noise
        assert found.widening == 1.0
        return
    factors = [test.variance_factor for test in found.tests if not test.passed]
    assert found.widening >= np.sqrt(max(factors))
    assert nees(found, campaign.truth) < chi2.ppf(0.999, 9)


def test_a_start_2_km_off_converges(campaign, medium, as_stored):
    survey = survey_of(campaign)
    away = [
        Node(
            node.name,
            (place[0] + 1600.0, place[1] - 1200.0, place[2] + 80.0),
            (3000.0, 3000.0, 200.0),
            0.013,
        )
        for node, place in zip(survey.nodes, campaign.truth, strict=True)
    ]
    found = locate(survey.assign(nodes=away), medium, TIME)
    assert nees(found, campaign.truth) < chi2.ppf(0.999, 9)
    np.testing.assert_array_equal(found.solution.used, ~campaign.gross)
    as_stored([found.nodes, found.tests, found.hyperparameters])


def test_a_start_8_km_off_converges_among_gross_errors(campaign, medium):
    survey = survey_of(campaign)
    nodes = [
        Node(node.name, (place[0] - 5600.0, place[1] + 5600.0, place[2]), (9e3, 9e3, 200.0), 0.013)
        for node, place in zip(survey.nodes, campaign.truth, strict=True)
    ]
    rng = np.random.default_rng(3)
    is_late = rng.random(len(survey)) < 0.3
    late = survey.travel_time + is_late * rng.uniform(0.01, 0.3, len(survey))
    found = locate(survey.assign(nodes=nodes, travel_time=late), medium, TIME)
    assert nees(found, campaign.truth) < chi2.ppf(0.999, 9)
    np.testing.assert_array_equal(found.solution.used, ~(campaign.gross | is_late))


def line_survey(campaign, offset):
    """One node and a ship on a straight line, the node this far beside it."""
    along = np.linspace(-1500.0, 1500.0, 80)
    place = np.column_stack([along, np.zeros(80), np.full(80, 3.0)])
    truth = np.array([100.0, offset, 1300.0])
    node = Node("A", (0.0, 20.0, 1300.2), (1000.0, 1000.0, 0.3))
    noise = np.random.default_rng(4).normal(0.0, 1e-4, 80)
    return truth, survey_of(
        campaign,
        nodes=[node],
        node=np.zeros(80, int),
        time=10.0 * np.arange(80),
        travel_time=2.0 * direct_time(place, truth) + noise,
        transmit_position=place,
        receive_position=place,
        transmit_attitude=[],
        receive_attitude=[],
        lever=LeverArm(),
    )


def test_a_survey_along_a_line_reports_both_solutions(campaign, medium, as_stored):
    truth, survey = line_survey(campaign, 400.0)
    found = locate(survey, medium, SCALE)
    (mirror,) = found.mirrors
    assert mirror.undecided
    assert found.nodes["status"].tolist() == ["two solutions"]
    ends = sorted([found.positions[0, 1], mirror.east])
    np.testing.assert_allclose(ends, [-400.0, 400.0], atol=2.0)
    np.testing.assert_allclose([mirror.north, found.positions[0, 0]], truth[0], atol=2.0)
    sides = found.tables["mirrors"].frame.set_index("solution")
    assert sides.loc["reported", "east"] == found.positions[0, 1]
    assert sides.loc["mirrored", "east"] == mirror.east
    difference = sides.loc["mirrored", "chi_square"] - sides.loc["reported", "chi_square"]
    assert difference == pytest.approx(mirror.chi_square_difference)
    (line,) = (line for line in found.warnings if "two solutions: reported at north" in line)
    assert all(f"east {east:.1f}" in line for east in sides["east"])
    (record,) = summary(found)["mirrors"]
    assert record["east"] == mirror.east
    assert record["reported"]["chi_square"] == mirror.reported_chi_square
    as_stored([mirror, found.nodes])


def test_the_side_of_lower_chi_square_is_the_solution(campaign, medium, as_stored):
    _, survey = line_survey(campaign, 400.0)
    node = Node(
        "A", (0.0, 390.0, 1300.2), (1000.0, 60.0, 0.3)
    )  # 13 standard deviations from the mirror image
    survey = survey.assign(nodes=[node])
    right, _, solver = solve(survey, medium, SCALE)
    values = right.values.copy()
    values[1] *= -1.0
    wrong = solver.settle(right.unknowns, values, right.correlation, right.posterior)
    assert wrong.positions[0, 1] == pytest.approx(-400.0, abs=5.0)
    found, (mirror,) = with_mirrors(solver, wrong)
    assert found.positions[0, 1] == pytest.approx(400.0, abs=2.0)
    assert mirror.east == pytest.approx(-400.0, abs=5.0)
    expected = ((-400.0 - 390.0) ** 2 - (400.0 - 390.0) ** 2) / 60.0**2  # of the prior
    assert mirror.chi_square_difference == pytest.approx(expected, rel=0.1)
    assert not mirror.undecided
    as_stored([mirror, found.positions, wrong.positions])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"travel_time": 1e-3},
            "times shorter than those of the prior positions .*; they must be in the unit",
        ),
        (
            {"time": 1.0 / 86_400.0},
            "time gives a median speed of .* m/s; it must be in seconds; multiply days by",
        ),
    ],
)
def test_units_that_make_sound_or_platform_too_fast_are_refused(campaign, medium, changes, message):
    _, survey = line_survey(campaign, 400.0)
    scaled = {name: factor * getattr(survey, name) for name, factor in changes.items()}
    refused(LocateError, message, check_survey, survey.assign(**scaled), medium)
    check_survey(survey, medium)


def test_a_pattern_with_width_has_no_mirror_solution(located):
    assert located.mirrors == []


def test_one_way_times_give_clocks_and_positions(campaign, medium, as_stored):
    rng = np.random.default_rng(8)
    n, truth = 240, campaign.truth
    node = np.tile(np.arange(3), 80)
    time = 20.0 * np.arange(n)
    place = np.column_stack(
        [900.0 * np.cos(time / 300.0), 700.0 * np.sin(time / 230.0), np.full(n, 5.0)]
    )
    offset, drift = np.array([2e-3, -1e-3, 4e-3]), np.array([1e-7, -2e-7, 0.0])
    clock = offset[node] + drift[node] * (time - time[0])
    measured = (
        direct_time(truth[node], place) - clock + rng.normal(0.0, 5e-5, n)
    )  # received less transmitted
    nodes = [
        Node(name, tuple(p), (20.0, 20.0, 5.0), offset_sigma=0.01, drift_sigma=1e-6)
        for name, p in zip(campaign.names, campaign.prior, strict=True)
    ]
    survey = survey_of(
        campaign,
        nodes=nodes,
        node=node,
        time=time,
        travel_time=measured,
        transmit_position=place,
        receive_position=place,
        transmit_attitude=[],
        receive_attitude=[],
        lever=LeverArm(),
        direction=np.full(n, TravelDirection.FROM_NODE),
    )
    found = locate(
        survey, medium, LocateOptions(earth="flat", speed_model="known", correlation="none")
    )
    assert nees(found, truth) < chi2.ppf(0.999, 9)
    table = found.other_unknowns.set_index("unknown")
    estimated = table.loc[[f"{name} clock offset [s]" for name in campaign.names]]
    assert (np.abs(estimated["value"] - offset) < 4.0 * estimated["sigma"]).all()
    as_stored([found.nodes, found.other_unknowns, found.tests])


def test_ranges_between_nodes_shrink_relative_uncertainty(medium, as_stored):
    campaign = make_campaign(11, pings=60, gross=0.0, drift=0.0)
    survey = survey_of(campaign)
    pairs = np.array([[0, 1], [1, 2], [2, 0]] * 20)
    exact = 2.0 * direct_time(campaign.truth[pairs[:, 0]], campaign.truth[pairs[:, 1]]) + 0.013
    more = {
        "node": np.concatenate([survey.node, pairs[:, 0]]),
        "partner": np.concatenate([survey.partner, pairs[:, 1]]),
        "time": np.concatenate([survey.time, survey.time[-1] + np.arange(60.0)]),
        "travel_time": np.concatenate(
            [survey.travel_time, exact + np.random.default_rng(2).normal(0, 1e-4, 60)]
        ),
    }
    nothing = np.full((60, 3), np.nan)
    for name in ("transmit_position", "receive_position"):
        more[name] = np.concatenate([getattr(survey, name), nothing])
    for name in ("transmit_attitude", "receive_attitude"):
        more[name] = np.concatenate([getattr(survey, name), np.zeros((60, 3))])
    for name, value in (("sigma", np.nan), ("flagged", False), ("line", 0), ("direction", 0)):
        more[name] = np.concatenate(
            [getattr(survey, name), np.full(60, value, dtype=getattr(survey, name).dtype)]
        )
    alone, joint = (locate(s, medium, SCALE) for s in (survey, survey.assign(**more)))
    assert nees(joint, campaign.truth) < chi2.ppf(0.999, 9)
    assert joint.solution.used[-60:].all()
    columns = ["relative_sigma_north_m", "relative_sigma_east_m"]
    assert (joint.nodes[columns].to_numpy() < alone.nodes[columns].to_numpy()).all()
    as_stored([joint.nodes, joint.pings, joint.tests])


def test_a_rigid_array_moves_as_one(medium, as_stored):
    campaign = make_campaign(5, pings=60, drift=0.0, prior_sigma=(0.0, 0.0, 0.0))
    survey = survey_of(campaign)
    shift = np.array([1.2, -0.8, 0.6])
    nodes = [
        Node(n.name, tuple(np.array(n.position) - shift), (0.0, 0.0, 0.0), 0.013)
        for n in survey.nodes
    ]
    survey = survey.assign(nodes=nodes, rigid=(3.0, 3.0, 3.0, 0.0))
    found = locate(survey, medium, SCALE)
    np.testing.assert_allclose(found.positions - campaign.truth, 0.0, atol=0.5)
    apart = found.positions - found.positions[0]
    np.testing.assert_allclose(apart, campaign.truth - campaign.truth[0], atol=1e-9)
    as_stored([found.nodes, found.tests, found.hyperparameters], without="relative_sigma")


def test_correlated_noise_is_recognized(medium, as_stored):
    campaign = make_campaign(6, drift=0.0, gross=0.0, pings=250, interval=20.0)
    rng, time = np.random.default_rng(0), campaign.time
    apart = np.abs(time[:, None] - time)
    root = np.linalg.cholesky(np.exp(-apart / 120.0) + 1e-9 * np.eye(time.size))
    survey = survey_of(campaign).assign(
        travel_time=campaign.two_way + 2e-4 * root @ rng.normal(size=time.size)
    )
    found = locate(survey, medium, LocateOptions(earth="flat", speed_model="scale"))
    model = found.hyperparameters
    assert model["correlation_ratio"] > 1.0
    assert model["correlation_time_s"] in (60.0, 180.0)
    white = locate(survey, medium, SCALE)
    assert not white.passed
    assert white.widening > 1.5
    narrow = white.nodes["sigma_north_m"] / white.widening
    assert (found.nodes["sigma_north_m"] > 1.5 * narrow).all()
    as_stored([found.nodes, model, found.candidates, white.tests])


def test_a_node_that_no_ray_reaches_has_a_status(campaign, medium, as_stored):
    survey = survey_of(campaign)
    far = survey.transmit_position.copy()
    far[survey.node == 2] += [60e3, 0.0, 0.0]  # the profile bends rays up before they get there
    far[np.flatnonzero(survey.node == 1)[:3]] += [60e3, 0.0, 0.0]
    nodes = [*survey.nodes[:2], Node("N3", survey.nodes[2].position, (0.0, 0.0, 0.0), 0.013)]
    found = locate(
        survey.assign(transmit_position=far, receive_position=far, nodes=nodes), medium, SCALE
    )
    assert found.nodes["status"][:2].tolist() == ["ok", "ok"]
    assert found.nodes["status"][2] in ("no ray", "too few pings")
    assert all(word.startswith("no ray") or "ms" in word for word in found.reason[survey.node == 2])
    as_stored([found.nodes, found.pings])


def test_a_node_above_the_platform_has_a_status(campaign, medium, as_stored):
    truth, survey = line_survey(campaign, 400.0)
    place = survey.transmit_position + np.array([0.0, 0.0, 1500.0])
    place[40:, 1], place[40:, 0] = place[40:, 0], 0.0
    time = 2.0 * direct_time(place, truth) + np.random.default_rng(1).normal(0.0, 1e-4, 80)
    found = locate(
        survey.assign(transmit_position=place, receive_position=place, travel_time=time),
        medium,
        SCALE,
    )
    assert found.nodes["status"].tolist() == ["above the platform"]
    assert nees(found, truth[None]) < chi2.ppf(0.999, 3)
    as_stored([found.nodes, found.tests, found.hyperparameters])


def test_an_answer_of_another_node_is_named(medium, as_stored):
    campaign = make_campaign(3, drift=0.0)
    survey = survey_of(campaign)
    ones = predict(
        survey.assign(node=(survey.node + 1) % 3),
        medium,
        campaign.truth,
        np.array(campaign.lever[0]),
    )
    rows = np.flatnonzero(~campaign.gross)[5:8]
    times = survey.travel_time.copy()
    times[rows] = ones.travel_time[rows] + 0.013
    survey = survey.assign(travel_time=times)
    found = locate(survey, medium, TIME)
    assert not found.solution.used[rows].any()
    expected = [f"answer of {campaign.names[(survey.node[row] + 1) % 3]}" for row in rows]
    assert [found.reason[row].split(" (")[0] for row in rows] == expected
    as_stored([found.reason[rows], found.nodes])


def test_the_wrong_sign_of_a_lever_arm_is_refused(campaign, medium):
    turned = LeverArm((-6.0, -2.5, 20.0))
    refused(
        LocateError,
        "other sign of forward",
        locate,
        survey_of(campaign, lever=turned),
        medium,
        TIME,
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        pytest.param(
            lambda s: {"travel_time": 1000.0 * s.travel_time},
            "divide milliseconds",
            id="milliseconds",
        ),
        pytest.param(
            lambda s: {"time": s.time[::-1]}, "times must not decrease", id="decreasing times"
        ),
        pytest.param(
            lambda s: {
                "transmit_attitude": np.radians(wrapped(s.transmit_attitude)),
                "receive_attitude": np.radians(wrapped(s.receive_attitude)),
            },
            "write attitudes in degrees",
            id="attitude in radians",
        ),
        pytest.param(
            lambda s: {
                "transmit_attitude": np.radians(np.unwrap(s.transmit_attitude, axis=0)),
                "receive_attitude": np.radians(np.unwrap(s.receive_attitude, axis=0)),
            },
            "write attitudes in degrees",
            id="attitude in radians beyond a turn",
        ),
        pytest.param(
            lambda s: {"travel_time": -s.travel_time},
            "allowed: positive seconds",
            id="negative times",
        ),
    ],
)
def test_wrong_units_are_refused_in_one_line(campaign, medium, changes, message):
    survey = survey_of(campaign)

    def run():
        return locate(survey.assign(**changes(survey)), medium, TIME)

    refused(LocateError, message, run)


def wrapped(angles):
    return np.mod(angles + np.pi, 2.0 * np.pi) - np.pi


def test_a_profile_that_ends_above_a_node_is_refused(campaign):
    depth = np.array([0.0, 900.0])
    short = Medium.from_profile(
        depth, SURFACE_SPEED + GRADIENT * depth, bottom_depth=3000.0, interpolation="linear"
    )
    refused(LocateError, "ends at 900 m, above node N1", locate, survey_of(campaign), short, TIME)


@pytest.mark.slow
def test_ellipses_cover_the_truth_and_normalized_errors_are_right(medium):
    """
    20 surveys with all effects: coverage of 95 % ellipses and mean normalized squared errors within
    their bounds.
    """
    inside, squares, passed = [], [], 0
    for seed in range(20):
        made = make_campaign(seed, lever_sigma=(0.1, 0.1, 0.1), turn_around_sigma=1e-3)
        found = locate(survey_of(made, turn_around_sigma=1e-3, sigma=1e-4), medium, TIME)
        error = found.positions - made.truth
        for k in range(3):
            own = found.covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
            inside.append(
                error[k, :2] @ np.linalg.solve(own[:2, :2], error[k, :2]) < chi2.ppf(0.95, 2)
            )
        squares.append(nees(found, made.truth))
        passed += found.passed
    low, high = binom.ppf([0.0005, 0.9995], 3 * 20, 0.95)
    assert low <= np.sum(inside) <= high, np.mean(inside)
    low, high = chi2.ppf([0.0005, 0.9995], 9 * 20) / 20.0
    assert low <= np.mean(squares) <= high, (low, np.mean(squares), high)
    assert passed >= 18


def test_a_later_echo_is_named_with_its_reflections(as_stored):
    """
    Water of one speed: a reflected path is straight to the mirror image of the ship's transducer or
    of the node.
    """
    speed, bed, depth = 1500.0, 1400.0, 1300.0
    still = Medium.from_profile(
        [0.0, bed], [speed, speed], bottom_depth=bed, interpolation="linear"
    )
    angle = np.linspace(0.0, 2.0 * np.pi, 90)
    place = np.column_stack([700.0 * np.cos(angle), 500.0 * np.sin(angle), np.full(90, 20.0)])
    truth = np.array([30.0, -40.0, depth])
    direct = np.linalg.norm(place - truth, axis=1) / speed
    bottom = np.linalg.norm(place - [30.0, -40.0, 2.0 * bed - depth], axis=1) / speed
    times = 2.0 * direct + np.random.default_rng(3).normal(0.0, 1e-4, 90)
    times[[7, 50]] = (direct + bottom)[[7, 50]]
    times[30] = 2.0 * bottom[30]
    node = Node("A", (0.0, 0.0, 1300.0), (200.0, 200.0, 50.0))
    survey = Survey((node,), np.zeros(90, int), 10.0 * np.arange(90), times, place, place)
    found = locate(survey, still, SCALE)
    words = [found.reason[row].split(" (")[0] for row in (7, 50, 30)]
    assert words[0] == words[1] == "later echo, 0 surface and 1 bottom reflections on one leg"
    assert words[2] == "later echo, 0 surface and 1 bottom reflections on both legs"
    as_stored([found.reason[[7, 50, 30]], found.pings])


def test_a_survey_without_unknowns_is_refused(medium, campaign):
    survey = survey_of(campaign)
    known = [Node(node.name, node.position, (0.0, 0.0, 0.0), 0.013) for node in survey.nodes]
    options = LocateOptions(earth="flat", speed_model="known")
    refused(
        LocateError, "there are no unknowns", locate, survey.assign(nodes=known), medium, options
    )


def test_amplitudes_of_modes_are_estimated_with_positions(medium, as_stored):
    """
    A mode that grows with depth changes the gradient of the profile, whose travel times are known
    in closed form.
    """
    slope = 1.5e-3  # 1/s; what the water has beyond the profile
    depth = np.linspace(0.0, 3000.0, 61)
    shape = depth / np.sqrt(np.mean(depth**2))
    modes = VerticalModes(
        depth, SURFACE_SPEED + GRADIENT * depth, shape[None], np.array([9.0]), 9.0
    )
    amplitude = slope * np.sqrt(np.mean(depth**2))
    time = 15.0 * np.arange(150)
    radius = np.where(np.arange(150) % 3 == 0, 250.0, 1500.0)
    place = np.column_stack(
        [radius * np.cos(time / 300.0), radius * np.sin(time / 300.0), np.full(150, 5.0)]
    )
    truth = np.array([40.0, 25.0, 1310.0])
    times = 2.0 * direct_travel_time_linear_gradient(
        place, truth, sound_speed_surface=SURFACE_SPEED, gradient=GRADIENT + slope
    )
    times += np.random.default_rng(5).normal(0.0, 1e-4, 150)
    node = Node("A", (0.0, 0.0, 1300.0), (100.0, 100.0, 30.0))
    survey = Survey((node,), np.zeros(150, int), time, times, place, place)
    options = LocateOptions(earth="flat", speed_model="modes", modes=modes, correlation="none")
    found = locate(survey, medium, options)
    assert found.hyperparameters["sound_speed"] == "modes"
    assert nees(found, truth[None]) < chi2.ppf(0.999, 3)
    estimate = found.solution.values[found.solution.unknowns.slices["speed"]][0]
    sigma = np.sqrt(found.solution.posterior.covariance[-1, -1])
    assert abs(estimate - amplitude) < 4.0 * sigma
    assert sigma < 0.5 * amplitude
    refused(
        LocateError,
        "needs vertical modes",
        locate,
        survey,
        medium,
        LocateOptions(earth="flat", speed_model="modes"),
    )
    as_stored([found.nodes, found.hyperparameters, found.sound_speed])


@pytest.mark.slow
def test_two_campaigns_differ_by_what_their_covariances_explain(medium):
    """
    The same nodes by two ships whose lever arms are known to 5 cm: the difference of the array's
    centres, 16 times.
    """
    squares = []
    for seed in range(16):
        first = make_campaign(1000 + seed, lever_sigma=(0.05, 0.05, 0.05), pings=150)
        second = make_campaign(
            2000 + seed,
            lever=(1.9, -0.8, 21.3),
            lever_sigma=(0.05, 0.05, 0.05),
            pings=150,
            radius=700.0,
            truth=first.truth,
        )
        both = [locate(survey_of(c, turn_around_sigma=0.0), medium, TIME) for c in (first, second)]
        mean = np.tile(np.eye(3) / 3.0, 3)
        apart = both[0].positions.mean(axis=0) - both[1].positions.mean(axis=0)
        covariance = sum(mean @ one.covariance @ mean.T for one in both)
        squares.append(apart @ np.linalg.solve(covariance, apart))
    low, high = chi2.ppf([0.0005, 0.9995], 3 * 16) / 16.0
    assert low <= np.mean(squares) <= high, (low, np.mean(squares), high)
    assert np.mean(np.array(squares) < chi2.ppf(0.95, 3)) >= 0.85


@pytest.mark.parametrize("pings", [4, 12, 300])
def test_headings_of_a_drifting_platform_are_accepted(campaign, medium, pings):
    survey = survey_of(campaign).rows(np.arange(pings))
    for seed in range(20):
        heading = np.radians(90.0 + np.random.default_rng(seed).normal(0.0, 10.0, pings))
        attitude = np.column_stack([heading, np.zeros((pings, 2))])  # nothing to do with the course
        check_survey(survey.assign(transmit_attitude=attitude, receive_attitude=attitude), medium)


def flat(depth=300.0, *, lift=0.0, bottom=400.0, draft=0.0, prior=290.0):
    """
    Two-way times t = 2 r / 1500 of a circle of pings around a node, transducer 2 m deep; lift is
    added to heights in the file.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    place = np.column_stack([200.0 * np.cos(angle), 200.0 * np.sin(angle), np.full(60, 2.0)])
    time = 2.0 * np.linalg.norm(place - [0.0, 0.0, depth], axis=1) / 1500.0
    stated = place - [0.0, 0.0, lift]
    survey = Survey(
        nodes=(Node("T", (0.0, 0.0, prior)),),
        node=np.zeros(60, int),
        time=10.0 * np.arange(60.0),
        travel_time=time,
        transmit_position=stated,
        receive_position=stated,
    )
    return survey, Medium.from_profile(
        [0.0, 600.0], [1500.0, 1500.0], bottom_depth=bottom, ice_draft=draft
    )


KNOWN = LocateOptions(earth="flat", speed_model="known", correlation="none")


def test_stated_noise_contains_errors_of_positions_on_each_leg():
    survey, medium = flat()
    located = locate(survey, medium, KNOWN)
    linear = copy(located.solution.linear)
    linear.residual = np.full(60, 0.01)
    for direction, legs in ((TravelDirection.TWO_WAY, 2.0), (TravelDirection.TO_NODE, 1.0)):
        time = 0.5 * legs * located.solution.legs.travel_time
        water = replace(located.solution.legs, travel_time=time)
        noisy = survey.assign(
            direction=np.full(60, direction),
            sigma=np.full(60, 1e-4),
            platform_error=PlatformError(0.06, 0.08),  # 0.1 m
        )
        solution = replace(located.solution, linear=linear, legs=water)
        whole = replace(located, survey=noisy, solution=solution)
        ratio = 0.01 / np.hypot(1e-4, legs * 0.1 / 1500.0)
        by_noise = f"the median residual is {ratio:.3g} stated standard deviations"
        assert whole.unexplained[0].startswith(by_noise)
        # the unknown clock of a one-way time may make it short
        short = replace(whole, survey=noisy.assign(travel_time=np.full(60, 0.05)))
        by_time = "the median residual is 20 % of what was measured"
        assert short.unexplained[0].startswith(by_time if legs == 2.0 else by_noise)


def test_a_transducer_far_above_the_surface_is_refused(as_stored):
    survey, medium = flat(lift=18.0)
    refused(
        LocateError,
        r"up to 16.0 m above the surface in 60 of 60 pings; are these ellipsoidal heights",
        locate,
        survey,
        medium,
    )
    located = locate(flat()[0], medium, KNOWN)
    assert (located.positions[0, 2], located.notes) == (pytest.approx(300.0, abs=1e-3), ())
    located = locate(flat(lift=2.5)[0], medium, KNOWN)
    assert located.notes == (
        (
            "survey: the transducer is up to 0.5 m above the surface in 60 of 60 pings; its rays"
            " end there"
        ),
    )
    lever = LeverArm((0.0, 0.0, -5.0))
    refused(LocateError, "up to 3.0 m above the surface .* lever arm the wrong sign",
            locate, survey.assign(lever=lever,
            transmit_position=flat()[0].transmit_position,
            receive_position=flat()[0].receive_position), medium)  # fmt: skip
    as_stored([located.nodes, located.rms])


def test_a_node_below_the_bed_or_above_the_surface_is_refused():
    refused(
        LocateError,
        "node T at .* m is below the sea bed of the water at 280.0 m; give a deeper sea bed",
        locate,
        *flat(bottom=280.0),
        KNOWN,
    )
    refused(
        LocateError,
        "its prior depth is -290 m, above the surface",
        locate,
        *flat(prior=-290.0),
        KNOWN,
    )


def test_a_transducer_in_a_hole_of_the_ice_is_noted():
    survey, medium = flat(draft=3.0)
    located = locate(survey, medium, KNOWN)
    assert located.notes == (
        (
            "survey: the transducer is up to 1.0 m above the underside of the ice in 60 of 60"
            " pings; its rays end there"
        ),
    )


@pytest.mark.parametrize("value", [1e-300, 1e300, np.inf])
def test_extreme_standard_deviations_are_refused(campaign, value):
    """Their squares overflow, or leave no digits of a covariance."""
    for make in (
        lambda: Node("A", (0.0, 0.0, 9.0), (value, 1.0, 1.0)),
        lambda: Node("A", (0.0, 0.0, 9.0), turn_around_sigma=value),
        lambda: LeverArm(sigma=(0.0, value, 0.0)),
        lambda: PlatformError(value, 1.0),
        lambda: SpeedPrior(scale=value),
        lambda: SpeedPrior(gradient=value),
        lambda: PlanOptions(900.0, value),
    ):
        refused(LocateError, "allowed are 0, and 1e-18 to 1e.12", make)
    survey = survey_of(campaign)
    wrong = np.full(len(survey), value)
    refused(LocateError, "1e-18 to 1e.12 seconds", lambda: survey.assign(sigma=wrong))
    refused(LocateError, "within 10000 metres", LeverArm, (1e300, 0.0, 0.0))
    refused(LocateError, "within 1e.06 m", Node, "A", (1e300, 0.0, 9.0))


@pytest.mark.parametrize("values", [{"scale": 0.0}, {"gradient": -1e-4}, {"knot_interval": -1.0}])
def test_a_prior_of_the_sound_speed_must_be_positive(values):
    refused(LocateError, "speed_prior: scale .* all must be positive", SpeedPrior, **values)


def test_pings_of_unknown_nodes_or_places_are_refused(campaign):
    survey = survey_of(campaign)
    for name, value in (("node", -1), ("node", 3), ("partner", 3)):
        wrong = getattr(survey, name).copy()
        wrong[5] = value
        message = "the node of a ping does not exist; allowed indices: 0 to 2"
        refused(LocateError, message, survey.assign, **{name: wrong})
    wrong = survey.transmit_position.copy()
    wrong[5, 1] = np.nan
    message = "ping 6: transmit_position is .*; allowed: finite metres"
    refused(LocateError, message, survey.assign, transmit_position=wrong)


def test_a_turn_around_time_of_more_than_a_minute_is_refused():
    assert Node("A", (0.0, 0.0, 9.0), turn_around=60.0).turn_around == 60.0
    refused(
        LocateError, "is 60.5 s, which is too long", Node, "A", (0.0, 0.0, 9.0), turn_around=60.5
    )


def test_knots_that_would_fill_the_memory_are_refused(campaign, medium):
    options = LocateOptions(
        "time", "none", earth="flat", speed_prior=SpeedPrior(knot_interval=1e-300)
    )
    refused(
        LocateError,
        "knot_interval is 1e-300 s .* or more",
        locate,
        survey_of(campaign),
        medium,
        options,
    )
