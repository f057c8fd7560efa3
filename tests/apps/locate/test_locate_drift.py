"""
Surveys in water that drifts, made without the solver's model: the selected model and what is said
of it, tests of parts, standard deviations after failed tests, coverage.
"""

import numpy as np
import pytest
from drifting import constant_water, deep_water, drifting_survey, ornstein_uhlenbeck
from scipy.stats import chi2, kstest

from pymantaray.apps.locate import LocateOptions, locate
from pymantaray.apps.locate.fit_tests import (
    HALVES,
    LEVEL,
    PATTERN,
    FitTest,
    fit_tests,
    judged,
    widening,
)
from pymantaray.apps.locate.sound_speed import Spline

EXACT = {"gnss": 0.0, "red": 0.0}
FLAT = LocateOptions(earth="flat")  # positions of made-up surveys are in metres


def share_of_line(covariance):
    """Part of the variance of a series about its mean that is a straight line."""
    line = np.linspace(-1.0, 1.0, len(covariance))
    about_mean = np.eye(line.size) - 1.0 / line.size
    return line @ covariance @ line / (line @ line) / np.trace(about_mean @ covariance)


@pytest.mark.parametrize("memory", [np.inf, 1800.0, 7200.0])
def test_a_drift_is_a_mean_and_a_series_of_variance_one(memory, as_stored):
    """A series with a memory has the trends of its process; half of the other is a line."""
    times = np.linspace(0.0, 7200.0, 50)[:, None] + [0.0, 2.0]
    spline = Spline(times, 120.0, 80, memory)
    basis = spline._basis
    np.testing.assert_allclose(basis.T @ basis, np.eye(len(basis)), atol=1e-9)
    at = np.linspace(0.0, 7202.0, 400)
    columns = spline.at(at)
    assert np.ptp(columns[:, 0]) < 1e-12
    drift = columns[:, 1:] * spline.unit[1:]
    assert np.mean(np.sum(drift**2, axis=1)) == pytest.approx(1.0, rel=0.05)
    process = np.exp(-np.abs(np.subtract.outer(at, at)) / memory)
    expected = 0.5 if np.isinf(memory) else share_of_line(process)
    assert share_of_line(drift @ drift.T) == pytest.approx(expected, rel=0.1)
    as_stored([columns, spline.unit])


def test_a_drift_of_one_instant_has_knots_of_a_second():
    knots = Spline(np.full((1, 2), 5.0), 600.0, 40).knots
    assert (knots[3], knots[-4]) == (5.0, 6.0)


@pytest.fixture(scope="module")
def medium():
    return deep_water()


@pytest.fixture(scope="module")
def drifting():
    return drifting_survey(8, nodes=1, pings=600, hours=12.0, sigma=1e-4, rms=1e-4)


@pytest.fixture(scope="module")
def located(drifting, medium):
    return locate(drifting.survey, medium, FLAT)


def test_numbers_of_a_survey_in_drifting_water_stay(located, as_stored):
    as_stored([located.tables, located.hyperparameters, located.tests, located.spread])


def centre(location):
    """Mean position of all nodes and its covariance."""
    count = len(location.positions)
    mean = np.tile(np.eye(3) / count, count)
    return location.positions.mean(axis=0), mean @ location.covariance @ mean.T


def halves_chi_square(survey, medium):
    """Chi-square of the difference between two surveys that are the halves of one."""
    (one, first), (two, second) = (centre(locate(survey.half(k), medium, FLAT)) for k in (0, 1))
    return (two - one) @ np.linalg.solve(first + second, two - one)


@pytest.mark.parametrize(
    ("water", "has_memory"),
    [
        pytest.param(
            lambda rng, time, rms: rms * ornstein_uhlenbeck(rng, time.size, time[-1] / 16.0),
            True,
            id="rough",
        ),
        pytest.param(
            lambda _, time, rms: rms * np.sin(2.0 * np.pi * time / 20_000.0), False, id="smooth"
        ),
    ],
)
def test_the_roughness_of_the_water_is_selected(medium, water, has_memory, as_stored):
    made = drifting_survey(
        5, water=water, nodes=1, hours=12.0, pings=900, sigma=5e-5, rms=2e-4, **EXACT
    )
    model = locate(made.survey, medium, FLAT).hyperparameters
    assert model["sound_speed"] == "time"
    assert (model["sound_speed_memory_s"] is not None) == has_memory
    as_stored(model, without="correlation_shared")


def test_the_covariance_is_that_of_the_mixture_of_allowed_models(located, drifting, medium):
    """One allowed model adds nothing; several add a covariance that is positive semidefinite."""
    alone = locate(
        drifting.survey,
        medium,
        LocateOptions(earth="flat", speed_model="scale", correlation="none"),
    )
    np.testing.assert_allclose(alone.spread, 0.0, atol=1e-15)
    assert np.linalg.eigvalsh(located.spread).min() > -1e-12
    plain = located.solution.posterior.covariance[:3, :3] + located.spread
    np.testing.assert_allclose(located.covariance, located.widening**2 * plain)
    budget = located.budget.set_index("source").loc["choice of the model", "depth_m"]
    assert budget == pytest.approx(np.sqrt(located.spread[2, 2]))


def test_the_difference_of_parts_has_the_covariance_of_two_estimates(located):
    """Written out with the rows of the system and a draw-free propagation of priors and noise."""
    solution = located.solution
    unknowns = solution.unknowns
    sd = unknowns.scaled_sd(dict(solution.posterior.hyperparameters))
    active = sd > 0.0
    late = unknowns.survey.time > np.median(unknowns.survey.time[solution.used])
    gains, covers = [], []
    for part in (~late, late):
        rows = solution.linear.whitened_rows(
            solution.used & part,
            solution.correlation,
            unknowns.survey.platform_error,
            solution.posterior.sigma,
        )
        design = np.concatenate([block for block, _ in rows])[:, :-1][:, active]
        design /= solution.posterior.sigma
        whole = np.linalg.inv(design.T @ design + np.diag(sd[active] ** -2.0))
        gains.append(whole @ design.T)
        covers.append(whole @ design.T @ design)
    # the error of each part is (gain design - 1) times the unknowns plus the gain times the noise
    prior = covers[1] - covers[0]
    covariance = prior @ np.diag(sd[active] ** 2) @ prior.T + sum(g @ g.T for g in gains)
    sigma = np.sqrt(np.diag(covariance)[:3] + 4.0 * np.diag(located.spread))
    (test,) = (test for test in located.tests if test.name == HALVES)
    for axis, expected in zip(("north", "east", "depth"), sigma, strict=True):
        shift, _, ratio = test.details.split(axis + " ")[1].split(" ")[:3]
        assert float(shift) / float(ratio.strip("(")) == pytest.approx(
            expected, rel=0.06 / abs(float(ratio.strip("("))) + 0.02
        )


def test_a_node_that_moves_fails_the_test_of_halves(medium, as_stored):
    made = drifting_survey(
        8, water=constant_water, nodes=1, pings=600, hours=12.0, sigma=1e-4, **EXACT
    )
    survey = made.survey
    late = survey.time > np.median(survey.time)
    moved = np.where(late[:, None], [0.3, 0.0, 0.0], 0.0)
    found = locate(
        survey.assign(
            transmit_position=survey.transmit_position + moved,
            receive_position=survey.receive_position + moved,
        ),
        medium,
        LocateOptions(earth="flat", speed_model="scale", correlation="none"),
    )
    (test,) = (test for test in found.tests if test.name == HALVES)
    # with a spread of 100 m of the model, that of the difference of two halves is 2 times 100 m
    wide = fit_tests(found.solution, 100.0**2 * np.eye(3))[-1]
    change = [float(part.split()[1]) for part in wide.details.split(", ")]
    assert abs(change[0]) > 0.2
    assert wide.chi_square == pytest.approx(np.sum(np.square(change)) / 200.0**2, rel=0.01)
    assert not test.passed
    assert "FAILED" in test.text
    assert found.widening**2 >= test.chi_square / test.degrees - 1e-9
    assert found.nodes["sigma_north_m"][0] == pytest.approx(np.sqrt(found.covariance[0, 0]))
    as_stored([wide, found.tests, found.nodes])


def test_failed_tests_widen_the_standard_deviations():
    tests = [FitTest("stated noise", 900.0, 100.0, 0.0), FitTest(HALVES, 27.0, 3.0, 1e-5, 9.0)]
    tests += [FitTest(PATTERN, 87.0, 24.0, 0.5, 64.0)]
    assert widening(judged(tests)) == pytest.approx(3.0)
    assert widening([]) == 1.0


@pytest.mark.parametrize(
    ("probabilities", "passed"),
    [
        ((0.003, 0.5, 0.9), (False, True, True)),
        ((0.004, 0.004, 0.9), (True, True, True)),
        ((0.3, 0.004, 0.003), (True, False, False)),
        ((0.011,), (True,)),
        ((0.009,), (False,)),
    ],
)
def test_tests_have_one_level_together(probabilities, passed):
    tests = judged([FitTest("a", 1.0, 1.0, probability) for probability in probabilities])
    assert tuple(test.passed for test in tests) == passed
    assert min(test.level for test in tests) == pytest.approx(LEVEL / len(tests))


def test_few_pings_have_no_test_of_parts(drifting, medium, as_stored):
    few = drifting.survey.rows(np.arange(0, 600, 40))
    found = locate(few, medium, LocateOptions(earth="flat", speed_model="scale"))
    assert HALVES not in [test.name for test in found.tests]
    as_stored(found.nodes)


def test_a_model_that_is_not_allowed_is_never_called_the_best(medium, as_stored):
    def exact(_, time, __):
        return np.zeros(time.size)

    made = drifting_survey(3, water=exact, nodes=1, pings=500, hours=4.0, sigma=1e-4, **EXACT)
    found = locate(made.survey, medium, FLAT)
    table = found.candidates
    assert table["sound_speed"][0] == "known"
    assert not table["allowed"][0]
    assert not table["chosen"][0]
    assert table.loc[table["chosen"], "allowed"].tolist() == [True]
    assert "known is lower" in found.selection
    requested = locate(made.survey, medium, LocateOptions(earth="flat", speed_model="scale"))
    assert requested.selection == "as requested"
    as_stored([table, found.selection])


def test_the_known_sound_speed_is_that_of_the_profile(medium):
    """Its evidence beside other models is that of a solution with this profile, wrong here."""

    def faster(_, time, __):
        return np.full(time.size, 2e-3)

    made = drifting_survey(3, water=faster, nodes=1, pings=500, hours=4.0, sigma=1e-4, **EXACT)
    of_kind = locate(made.survey, medium, FLAT).candidates.set_index("sound_speed")
    known = LocateOptions(earth="flat", speed_model="known", correlation="none")
    alone = locate(made.survey, medium, known).candidates.set_index("sound_speed")
    beside = of_kind[of_kind["correlation_ratio"] == 0.0].loc["known"]
    assert beside["abic"] == pytest.approx(alone.loc["known", "abic"], abs=5.0)
    assert beside["abic"] > of_kind.loc["scale", "abic"].min() + 100.0


def test_the_solution_is_that_of_the_chosen_candidate(located):
    chosen = located.candidates[located.candidates["chosen"]]
    assert chosen["sound_speed"].tolist() == [located.hyperparameters["sound_speed"]]
    assert located.candidates["allowed"][0]
    assert "largest marginal likelihood" in located.selection


@pytest.mark.slow
def test_surveys_in_drifting_water_have_honest_covariances(medium):
    """Twelve surveys; probabilities of halves, apart and in the test, are uniform."""
    squares, halves, in_test = [], [], []
    for seed in range(12):
        made = drifting_survey(seed, pings=350)
        found = locate(made.survey, medium, FLAT)
        position, covariance = centre(found)
        error = position - made.truth.mean(axis=0)
        squares.append(error @ np.linalg.solve(covariance, error))
        halves.append(halves_chi_square(made, medium))
        in_test += [test.probability for test in found.tests if test.name == HALVES]
    low, high = chi2.ppf([0.001, 0.999], 3 * 12) / 12.0
    assert low <= np.mean(squares) <= high, np.sort(squares)
    assert kstest(chi2.sf(halves, 3), "uniform").pvalue > 0.01
    assert kstest(in_test, "uniform").pvalue > 0.01


@pytest.mark.slow
def test_constant_water_costs_less_than_a_tenth_of_sigma(medium):
    """Against the model that made the data: one factor and white noise."""
    ratios = []
    options = LocateOptions(earth="flat", speed_model="scale", correlation="none")
    for seed in range(12):
        survey = drifting_survey(seed, water=constant_water, **EXACT).survey
        auto, right = (centre(locate(survey, medium, o))[1] for o in (FLAT, options))
        ratios.append(np.sqrt(np.diag(auto) / np.diag(right)))
    assert np.median(ratios) < 1.02
    assert np.mean(ratios) < 1.1
