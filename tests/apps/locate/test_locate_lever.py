"""
Lever arms and headings that are not those of the file, in surveys made without the package's code:
what the pings contradict is estimated, what they do not is left as it is stated.
"""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import direct_time, make_campaign, survey_of, to_world, water
from scipy.stats import chi2

from pymantaray.apps.locate import LeverArm, LocateOptions, Node, ReadOptions, Survey, locate
from pymantaray.apps.locate.models import average_of_models, solve

SCALE = LocateOptions(speed_model="scale", correlation="none", earth="flat")
AUTO = LocateOptions(earth="flat")
TRUE = np.array([6.0, -2.5, 20.0])  # m
WRONG = {
    "forward": (TRUE - [2.0, 0.0, 0.0], 0.0),
    "starboard": (TRUE - [0.0, 2.0, 0.0], 0.0),
    "heading": (TRUE, np.radians(3.0)),
}


@pytest.fixture(scope="module")
def medium():
    return water()


@pytest.fixture(scope="module")
def campaign():
    return make_campaign(7, pings=120, drift=0.0, gross=0.0)


def stated(campaign, lever, turn, sigma=(0.0, 0.0, 0.0)):
    """The campaign with another lever arm and turned headings in its file."""
    survey = survey_of(campaign, lever=LeverArm(tuple(lever), sigma))
    headings = np.array([turn, 0.0, 0.0])
    return survey.assign(
        transmit_attitude=survey.transmit_attitude + headings,
        receive_attitude=survey.receive_attitude + headings,
    )


def nees(located, truth):
    error = (located.positions - truth).ravel()
    return error @ np.linalg.solve(located.covariance, error)


@pytest.mark.parametrize("what", WRONG)
def test_a_lever_arm_that_the_pings_contradict_is_estimated(campaign, medium, what):
    lever, turn = WRONG[what]
    found = locate(stated(campaign, lever, turn), medium, SCALE)
    right = locate(stated(campaign, TRUE, 0.0), medium, SCALE)
    told = locate(stated(campaign, TRUE, 0.0, (2.0, 2.0, 0.0)), medium, SCALE)
    assert nees(found, campaign.truth) < chi2.ppf(0.999, campaign.truth.size)
    assert found.passed
    # as if the uncertainty had been stated
    ratio = np.sqrt(np.diag(found.covariance) / np.diag(told.covariance))
    assert ratio.max() < 1.1
    (line,) = (line for line in found.warnings if "lever arm is estimated" in line)
    assert f"(stated {lever[0]:+.2f}, sigma" in line
    # the transducer is where it was, seen from the stated heading
    unknowns = found.other_unknowns.set_index("unknown")["value"]
    estimate = unknowns[["lever arm forward [m]", "lever arm starboard [m]"]].to_numpy(dtype=float)
    seen = to_world(np.array([[-turn, 0.0, 0.0]]), TRUE)[0, :2]
    np.testing.assert_allclose(estimate, seen, atol=0.1)
    assert not right.solution.model.lever_doubt


def exactly(survey):
    """The survey with a lever arm and headings that are known to be right."""
    return survey.assign(lever=replace(survey.lever, exact=True))


def test_a_lever_arm_that_the_pings_confirm_stays(campaign, medium):
    """Models with a wrong lever arm are compared; only small errors count in the average."""
    survey = stated(campaign, TRUE, 0.0)
    found = locate(survey, medium, replace(AUTO, correlation="none"))
    table = found.candidates
    doubted = table["lever_doubt"] > 0.0
    is_large = table["lever_doubt"] == 2.0
    assert is_large.any()
    assert not (table["allowed"] & is_large).any()
    assert (table["allowed"] & doubted).any()
    assert table.loc[~doubted, "abic"].min() < table.loc[doubted, "abic"].min()
    assert not any("lever arm" in line for line in found.warnings)


def test_an_exact_lever_arm_is_not_averaged(campaign, medium):
    """Without doubts, the average is that of the models with the stated lever arm."""
    survey = exactly(stated(campaign, TRUE, 0.0))
    solution, candidates, _ = solve(survey, medium, SCALE)
    known = [one for one in candidates if one.model.lever_doubt == 0.0]
    assert len(known) < len(candidates)
    all_of_them, known_ones = (
        average_of_models(some, SCALE.kinds, solution) for some in (candidates, known)
    )
    np.testing.assert_array_equal(all_of_them.spread, known_ones.spread)
    # `--lever-sigma 0 0 0` says so
    told = ReadOptions(lever_sigma=(0.0, 0.0, 0.0)).apply(stated(campaign, TRUE, 0.0))
    assert told.lever.exact
    assert not ReadOptions(lever_sigma=(0.0, 0.1, 0.0)).apply(survey).lever.exact


@pytest.mark.parametrize("sigma", [1e-4, 6e-4, 5e-3])
def test_doubts_of_a_right_lever_arm_cost_a_tenth(medium, sigma):
    survey = stated(make_campaign(7, pings=120, drift=0.0, gross=0.0, sigma=sigma), TRUE, 0.0)
    doubted, exact = (
        np.diag(locate(one, medium, SCALE).covariance) for one in (survey, exactly(survey))
    )
    ratio = np.sqrt(doubted / exact)
    assert ratio.min() >= 1.0 - 1e-9
    assert ratio.mean() < 1.1


@pytest.mark.parametrize(
    ("error", "turn"), [((0.3, 0.3), 0.0), ((0.0, 0.0), np.radians(3.0))], ids=["arm", "heading"]
)
def test_small_errors_of_the_lever_arm_are_in_the_sigmas(medium, error, turn):
    """Noise of 0.6 ms hides them: mean squared errors of 12 surveys in units of the sigmas."""
    doubted, exact = [], []
    for seed in range(12):
        made = make_campaign(seed, pings=120, drift=0.0, gross=0.0, sigma=6e-4, nodes=1)
        survey = stated(made, TRUE + np.array([*error, 0.0]), turn)
        doubted.append(nees(locate(survey, medium, SCALE), made.truth))
        exact.append(nees(locate(exactly(survey), medium, SCALE), made.truth))
    assert np.mean(exact) > chi2.ppf(0.999, 3 * 12) / 12
    assert np.mean(doubted) < 0.85 * np.mean(exact)


def test_a_lever_arm_near_the_limit_is_in_the_standard_deviations(campaign, medium):
    """An error of 0.15 m: the stated lever arm is chosen, and the other one counts."""
    found = locate(stated(campaign, TRUE + np.array([0.15, 0.0, 0.0]), 0.0), medium, SCALE)
    right = locate(stated(campaign, TRUE, 0.0), medium, SCALE)
    assert found.solution.model.lever_doubt == 0.0
    assert any("not exclude that the lever arm or the headings" in line for line in found.warnings)
    of_chosen = {"shift": 0.0 * found.shift, "spread": 0.0 * found.spread}
    plain = nees(replace(found, **of_chosen), campaign.truth)
    assert nees(found, campaign.truth) < chi2.ppf(0.999, campaign.truth.size) < plain
    sigma = found.nodes["sigma_east_m"] / right.nodes["sigma_east_m"]
    assert sigma.max() > 1.5


def test_a_gradient_is_not_taken_for_a_lever_arm(medium):
    """Gradients absorb 0.5 m starboard: the positions were wrong by 9 sigma, all tests passed."""
    drifting = make_campaign(7, pings=120)
    found = locate(stated(drifting, TRUE + np.array([0.0, 0.5, 0.0]), 0.0), medium, AUTO)
    assert found.solution.model.lever_doubt
    assert nees(found, drifting.truth) < chi2.ppf(0.999, drifting.truth.size)


def test_a_drift_is_not_taken_for_a_lever_arm(medium):
    """Where only one factor is allowed, a lever arm takes a part of the drift."""
    drifting = make_campaign(3)
    found = locate(stated(drifting, TRUE, 0.0), medium, SCALE)
    doubted = found.candidates["lever_doubt"] > 0.0
    table = found.candidates.groupby(["sound_speed", doubted])["abic"].min()
    assert table["scale", True] < table["scale", False]
    assert table["time", False] < table["scale", True]
    assert not found.solution.model.lever_doubt
    assert found.candidates["chosen"].sum() == 1


def test_a_steady_heading_says_nothing_of_the_lever_arm(medium):
    """Along one line, a lever arm is an offset of the node."""
    rng = np.random.default_rng(1)
    place = np.column_stack([np.linspace(-900.0, 900.0, 80), np.zeros(80), np.full(80, 3.0)])
    truth = np.array([100.0, 400.0, 1300.0])
    times = 2.0 * direct_time(place + np.array([2.0, 0.0, 0.0]), truth) + rng.normal(0.0, 1e-4, 80)
    node = Node("A", (0.0, 390.0, 1300.0), (100.0, 10.0, 1.0))
    survey = Survey((node,), np.zeros(80, int), 10.0 * np.arange(80.0), times, place, place)
    table = locate(survey, medium, SCALE).candidates
    assert "lever_doubt" not in table
