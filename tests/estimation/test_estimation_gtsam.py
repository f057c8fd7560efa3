"""Batch solves by GTSAM's own optimizer, beside the batch solver."""

import numpy as np
import pytest
from factories import without
from refusals import refused

from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    LOSSES,
    Estimator,
    GraphSolver,
    Method,
    build_graph,
    solve_conditions,
)
from pymantaray.records import SolveStatus

GTSAM = Method(gtsam="converged")


@pytest.fixture
def mission(make_fleet):
    fleet = make_fleet(seed=4, gnss_every=10, n_landmarks=2)
    return fleet, build_graph(fleet.noisy, "straight"), fleet.reckoned


@pytest.mark.parametrize("loss", [None, LOSSES["cauchy"], LOSSES["welsch"]])
def test_gtsam_finds_the_optimum_of_the_batch_solver(mission, loss):
    _, graph, start = mission
    ours = GraphSolver().solve(graph, start, method=Method(loss))
    theirs = GraphSolver().solve(graph, start, method=Method(loss, gtsam="converged"))
    assert theirs.status == SolveStatus.OK
    assert theirs.iterations > 1
    apart = np.linalg.norm(theirs.position - ours.position, axis=1).max()
    assert 0.0 < apart < 1e-3
    assert theirs.from_batch == pytest.approx(apart, abs=2e-4)
    assert theirs.final_cost == pytest.approx(ours.final_cost, rel=1e-9)
    assert theirs.expected_cost == pytest.approx(ours.expected_cost, nan_ok=True)
    assert np.isnan(ours.from_batch)


def test_default_parameters_stop_earlier(mission):
    _, graph, start = mission
    converged, default = (
        GraphSolver().solve(graph, start, method=Method(gtsam=kind))
        for kind in ("converged", "default")
    )
    assert default.iterations < converged.iterations
    assert default.final_cost == pytest.approx(converged.final_cost, rel=1e-4)
    assert converged.from_batch < default.from_batch < 1e-2


def test_covariances_are_those_of_the_batch_solver(mission):
    fleet, _, _ = mission
    samples = np.array([10, 20])
    ours, theirs = (
        solve_conditions(
            fleet.noisy,
            {"straight": Estimator("straight", method=method)},
            covariance_samples=samples,
        )["straight"].covariances
        for method in (Method(), GTSAM)
    )
    np.testing.assert_allclose(theirs.position, ours.position, rtol=1e-4, atol=1e-6)


def test_a_free_graph_is_a_status(mission):
    _, graph, start = mission
    loose = without(graph, "fix", "range", "survey").with_factors(prior=graph["prior"][1:])
    solution = GraphSolver().solve(loose, start, method=GTSAM)
    assert solution.status == SolveStatus.FAILED
    assert np.isnan(solution.position).all()


def test_a_graduated_loss_is_refused(mission):
    _, graph, start = mission
    method = Method(LOSSES["gnc"], gtsam="converged")
    refused(
        EstimationError,
        "GTSAM's optimizer has no graduated loss",
        GraphSolver().solve,
        graph,
        start,
        method=method,
    )
