"""Influence of factors: against dense linear algebra, and against solutions without each factor."""

import numpy as np
import pytest
from factories import make_fleet

from pymantaray.estimation import LOSSES, GraphSolver, build_graph
from pymantaray.estimation.graph.graph import KINDS
from pymantaray.estimation.solvers.influence import MEASURES, factor_influence, worst_factors
from pymantaray.estimation.solvers.losses import whitened_ranges
from pymantaray.estimation.solvers.problems import GraphState, distance_problem


def solved(graph, initial, method="batch"):
    from pymantaray.estimation.solve import METHODS

    values = GraphSolver().solve(graph, initial, method=METHODS[method])
    return type(initial)(values.position, values.quaternion, values.landmark_position)


@pytest.fixture(scope="module")
def case():
    fleet = make_fleet(seed=5, n_landmarks=2, gnss_every=6, dropouts=0.1)
    graph = build_graph(fleet.noisy, "straight")
    return graph, solved(graph, fleet.truth)


@pytest.fixture(scope="module")
def influence(case):
    return factor_influence(*case)


def test_every_factor_has_a_row_in_the_order_of_the_kinds(case, influence):
    graph, _ = case
    expected = [kind.what for name, kind in KINDS.items() for _ in range(len(graph[name]))]
    assert influence["kind"].tolist() == expected


def test_leverages_add_up_to_the_number_of_unknowns(case, influence):
    """The trace of a projection is its rank."""
    graph, values = case
    cost = distance_problem(graph).cost(GraphState.of(values))
    assert 0.5 * (influence["residual_sigmas"] ** 2).sum() == pytest.approx(cost, rel=1e-9)
    ranges = influence[influence["kind"] == "range"]
    np.testing.assert_allclose(
        ranges["residual_sigmas"], np.abs(whitened_ranges(graph, values)), rtol=1e-9
    )
    rows = influence["kind"].map({kind.what: kind.rows for kind in KINDS.values()})
    unknowns = 6 * graph.n_poses + 3 * graph.landmark_name.size
    assert (influence["leverage"] * rows).sum() == pytest.approx(unknowns, rel=1e-6)
    assert influence["leverage"].between(-1e-9, 1.0 + 1e-9).all()


def test_cook_distance_is_the_change_without_the_factor(case, influence):
    """
    Its square in the metric of the covariance is twice the rise of the whole cost, to first order
    in the change.
    """
    graph, values = case
    problem = distance_problem(graph)
    ranges = influence[influence["kind"] == "range"].reset_index(drop=True)
    unknowns = 6 * graph.n_poses + 3 * graph.landmark_name.size
    for row in ranges.nlargest(3, "cook_distance").index:
        without = graph.with_factors(range=graph["range"][np.delete(np.arange(len(ranges)), row)])
        moved = solved(without, values)
        rise = problem.cost(GraphState.of(moved)) - problem.cost(GraphState.of(values))
        assert 2.0 * rise / unknowns == pytest.approx(ranges["cook_distance"][row], rel=0.02)


def test_a_wrong_range_is_the_worst(case, influence):
    graph, values = case
    ranges = graph["range"]
    # one that others check well: an error of one with leverage 0.9 is in the estimate instead
    row = int(np.argmin(influence.loc[influence["kind"] == "range", "leverage"]))
    wrong = ranges.column("distance").copy()
    wrong[row] += 60.0
    graph = graph.with_factors(range=ranges.with_columns(distance=wrong))
    influence = factor_influence(graph, solved(graph, values), kinds=["range"])
    ends = [graph.variable_name(int(v)) for v in ranges.variables[row]]
    for measure in ("residual_sigmas", "cook_distance"):
        worst = worst_factors(influence, measure, 5)
        assert worst.loc[0, ["first", "second"]].tolist() == ends
        assert len(worst) == 5
        assert worst[measure].is_monotonic_decreasing


def test_odometry_is_not_listed(case, influence):
    for measure in MEASURES:
        assert not worst_factors(influence, measure, 10**6)["kind"].eq("odometry").any()


def test_a_loss_takes_leverage_from_a_wrong_range(case):
    graph, values = case
    ranges = graph["range"]
    wrong = ranges.column("distance").copy()
    wrong[7] += 60.0
    graph = graph.with_factors(range=ranges.with_columns(distance=wrong))
    robust = solved(graph, values, "cauchy")
    plain, weighted = (
        factor_influence(graph, robust, loss, kinds=["range"]).loc[7, "leverage"]
        for loss in (None, LOSSES["cauchy"])
    )
    assert weighted < 0.01 * plain


def test_some_kinds_have_the_numbers_of_all(case, influence):
    some = factor_influence(*case, kinds=["fix", "range"])
    whole = influence[influence["kind"].isin(["GNSS fix", "range"])].reset_index(drop=True)
    np.testing.assert_array_equal(some[list(MEASURES)], whole[list(MEASURES)])
