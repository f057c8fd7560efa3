"""
Robust losses: their laws, GTSAM's idea of them, and what they make of late arrivals in a real
mission.
"""

from dataclasses import replace
from functools import cache

import gtsam
import numpy as np
import pytest
from factories import values_at, without
from hypothesis import given, settings, strategies as st
from scipy.integrate import quad

from pymantaray.apps.study.manifest import Stopwatch
from pymantaray.apps.study.mission import simulate_mission
from pymantaray.config.door.study import build_study
from pymantaray.config.load import load_study
from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    LOSSES,
    Estimator,
    GraphSolver,
    Loss,
    MeanSlowness,
    Method,
    SolveOptions,
    build_graph,
    dead_reckon,
    solve_conditions,
)
from pymantaray.estimation.solvers.losses import whitened_ranges
from pymantaray.records import SolveStatus
from pymantaray.sensing import perturb

KINDS = ["huber", "cauchy", "geman-mcclure", "tukey", "welsch"]
RESIDUALS = st.floats(-1e4, 1e4)


M_ESTIMATORS = {
    "huber": gtsam.noiseModel.mEstimator.Huber,
    "cauchy": gtsam.noiseModel.mEstimator.Cauchy,
    "geman-mcclure": gtsam.noiseModel.mEstimator.GemanMcClure,
    "tukey": gtsam.noiseModel.mEstimator.Tukey,
    "welsch": gtsam.noiseModel.mEstimator.Welsch,
}


def solve_robust(graph, initial, loss, options=None):
    return GraphSolver(options).solve(graph, initial, method=Method(loss))


def with_late_arrivals(graph, rate, seed):
    """A share of the ranges is too long by 50 to 500 m."""
    rng = np.random.default_rng(seed)
    ranges = graph["range"]
    late = rng.random(len(ranges)) < rate
    distance = ranges.column("distance") + np.where(late, rng.uniform(50.0, 500.0, late.size), 0.0)
    return graph.with_factors(range=ranges.with_columns(distance=distance)), late


class Study:
    """
    Preset quick, one realization: a graph of straight ranges, where to start, and what is true.
    """

    def __init__(self):
        config = load_study("quick", **{"mission.physics_step_s": 1.0, "mission.duration_h": 16.0})
        mission = simulate_mission(build_study(config), Stopwatch(), lambda *_: None)
        o = perturb(mission.measurements, root_seed=config.study.seed, realization=0)
        self.graph = build_graph(o, "straight")
        self.truth = values_at(o, mission.truth.position, mission.truth.quaternion)
        self.reckoned = values_at(o, *dead_reckon(o))
        self.clean = self.ate(GraphSolver().solve(self.graph, self.reckoned))
        self.dirty, self.late = with_late_arrivals(self.graph, 0.1, 1)
        self.solve = cache(self._solve)  # once for all tests

    def _solve(self, name, start="reckoned"):
        return solve_robust(self.dirty, getattr(self, start), LOSSES[name])

    def ate(self, solution):
        error = np.linalg.norm(solution.position - self.truth.position, axis=1)
        return float(np.sqrt(np.mean(error**2)))


@pytest.fixture(scope="module")
def study():
    return Study()


@pytest.fixture
def small(make_fleet):
    fleet = make_fleet(seed=4, gnss_every=10, n_landmarks=1)
    return build_graph(fleet.noisy, "straight"), fleet.reckoned


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=40)
@given(u=RESIDUALS, scale=st.floats(0.1, 100.0))
def test_cost_and_weight_are_gtsams(kind, u, scale):
    loss = Loss(kind, scale)
    theirs = M_ESTIMATORS[kind].Create(scale)
    assert loss.cost(u) == pytest.approx(theirs.loss(u), rel=1e-9, abs=1e-12)
    assert loss.weight(u) == pytest.approx(theirs.weight(u), rel=1e-9, abs=1e-300)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=40)
@given(u=st.floats(0.01, 100.0))
def test_weight_is_the_costs_slope_over_the_residual(kind, u):
    loss, h = LOSSES[kind], 1e-5 * u
    slope = (loss.cost(u + h) - loss.cost(u - h)) / (2 * h)
    assert slope == pytest.approx(u * loss.weight(u), rel=1e-5, abs=1e-7)
    assert 0.0 <= loss.weight(u) <= 1.0
    assert loss.cost(u) <= 0.5 * u**2


@pytest.mark.parametrize("kind", KINDS)
def test_scales_are_95_percent_efficient_where_noise_is_normal(kind):
    # variance of an M-estimate of location over the mean's: E[psi'] squared over E[psi squared]
    loss = LOSSES[kind]

    def mean(f):
        k = loss.scale
        return quad(
            lambda u: f(u) * np.exp(-0.5 * u**2) / np.sqrt(2 * np.pi), -12, 12, points=[-k, k]
        )[0]

    def psi(u):
        return u * loss.weight(u)

    slope = mean(lambda u: u * psi(u))  # E[psi'] by Stein's identity
    assert slope**2 / mean(lambda u: psi(u) ** 2) == pytest.approx(0.95, abs=1e-5)


@pytest.mark.parametrize(
    "arguments", [("l2", 1.0), ("huber", 0.0), ("cauchy", np.nan), ("huber", 1.0, True)]
)
def test_bad_losses_are_refused_in_one_line(arguments):
    with pytest.raises(EstimationError, match="loss"):
        Loss(*arguments)


def test_optimum_is_where_least_squares_with_its_own_weights_is(small):
    graph, start = small
    graph = graph.with_factors(
        range=replace(graph["range"], covariance=4.0 * graph["range"].covariance)
    )
    dirty, _ = with_late_arrivals(graph, 0.1, 0)
    tight = SolveOptions(step_tolerance=1e-7)
    for name, loss in LOSSES.items():
        found = solve_robust(dirty, start, loss, options=tight)
        assert np.isnan(found.expected_cost)  # no chi-square
        weight = loss.weight(whitened_ranges(dirty, found.values))
        heavy = weight > 1e-20  # tukey and welsch give some ranges no weight
        used = dirty["range"][heavy]
        covariance = used.covariance / weight[heavy, None, None]
        believed = dirty.with_factors(range=replace(used, covariance=covariance))
        plain = GraphSolver(tight).solve(believed, found.values, model_is_right=False)
        np.testing.assert_allclose(found.position, plain.position, rtol=0, atol=1e-5, err_msg=name)


def test_a_vehicle_held_by_ranges_alone_is_singular_without_them(small):
    graph, start = small
    loose = without(graph, "fix", "range").with_factors(prior=graph["prior"][1:])
    for loss in LOSSES.values():
        found = solve_robust(loose, start, loss)
        assert found.status == SolveStatus.FAILED
        assert np.isnan(found.position).all()


@pytest.mark.slow
def test_late_arrivals_ruin_least_squares_and_not_robust_losses(study):
    dirty, late = study.dirty, study.late
    plain = GraphSolver().solve(dirty, study.reckoned, model_is_right=False)
    assert study.ate(plain) > study.clean + 10.0
    for name in ("huber", "cauchy", "gnc"):
        found = study.solve(name)
        assert found.status == SolveStatus.OK, name
        assert abs(study.ate(found) - study.clean) < 0.5, name
        weight = LOSSES[name].weight(whitened_ranges(dirty, found.values))
        assert (weight[late] < 0.1).all(), name  # kept out, every one
        assert (weight[~late] > 0.1).all(), name  # and nothing else


def test_a_start_at_the_truth_hides_a_local_minimum(study):
    """
    Tukey's loss ignores most ranges of a dead-reckoned start; graduated non-convexity finds the
    minimum without the truth.
    """
    hidden, honest = study.solve("tukey", "truth"), study.solve("tukey")
    assert hidden.status == honest.status == SolveStatus.OK  # both are stationary: no gate can tell
    assert honest.final_cost > hidden.final_cost + 10.0
    assert np.abs(honest.position - hidden.position).max() > 5.0
    assert study.ate(honest) > study.ate(hidden)
    graduated, from_truth = study.solve("gnc"), study.solve("geman-mcclure", "truth")
    assert graduated.final_cost == pytest.approx(from_truth.final_cost, abs=1e-3)
    np.testing.assert_allclose(graduated.position, from_truth.position, rtol=0, atol=1e-2)


@pytest.mark.slow
def test_without_outliers_robust_losses_cost_next_to_nothing(study):
    for name, loss in LOSSES.items():
        found = solve_robust(study.graph, study.truth, loss)
        assert found.status == SolveStatus.OK
        assert abs(study.ate(found) - study.clean) < 0.01 * study.clean, name
        if name != "tukey":  # ends in another minimum
            found = solve_robust(study.graph, study.reckoned, loss)
            assert abs(study.ate(found) - study.clean) < 0.1 * study.clean, name


def test_convex_loss_ends_in_one_place(study):
    dirty, _ = with_late_arrivals(study.graph, 0.1, 2)
    ends = [solve_robust(dirty, s, LOSSES["huber"]) for s in (study.truth, study.reckoned)]
    np.testing.assert_allclose(ends[0].position, ends[1].position, rtol=0, atol=1e-2)


def test_times_and_distances_in_uniform_water_have_one_optimum(make_fleet):
    """
    Expanded about the estimate or as stock factors: where all water has one speed both roads are
    one.
    """
    fleet = make_fleet(seed=4, gnss_every=10, n_landmarks=1)
    late = np.where(np.arange(fleet.noisy.range_status.size) % 9, 0.0, 200.0)
    o = replace(fleet.noisy, transmitter_sound_speed=np.full(late.size, 1480.0))
    o = replace(o, refracted_range=o.straight_range + late)
    water = MeanSlowness([0.0, 9000.0], [1480.0, 1480.0])
    for name in ("huber", "cauchy"):
        method = Method(LOSSES[name])
        estimators = {"model": Estimator("refracted", model=water, method=method)}
        estimators["stock"] = Estimator("refracted", method=method)
        solved = solve_conditions(o, estimators)
        assert solved["model"].status == solved["stock"].status == SolveStatus.OK
        assert solved["model"].final_cost == pytest.approx(solved["stock"].final_cost, rel=1e-6)
        np.testing.assert_allclose(
            solved["model"].position, solved["stock"].position, rtol=0, atol=1e-3
        )
