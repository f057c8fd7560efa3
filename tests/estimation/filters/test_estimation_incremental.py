"""
iSAM2 replay: the batch optimum in the end, what was known in between, and failures that are
statuses.
"""

from dataclasses import replace

import numpy as np
import pytest
from factories import without
from two_minima import drone

from pymantaray.apps.graphs import open_graph, solve_graph
from pymantaray.config.estimators import ConditionSection
from pymantaray.errors import EstimationError
from pymantaray.estimation import (
    LOSSES,
    Estimator,
    GraphSolver,
    IncrementalOptions,
    Method,
    SolveOptions,
    build_graph,
    solve_conditions,
)
from pymantaray.estimation.filters.incremental import solve_incrementally
from pymantaray.records import SolveStatus

ATOL = 1e-2  # m; what the default threshold of relinearization may leave
TIGHT = SolveOptions(step_tolerance=1e-7)


@pytest.fixture
def mission(make_fleet):
    """Three turning vehicles, a landmark, fixes and ranges at 5, 10, ... samples."""
    fleet = make_fleet(seed=4, gnss_every=10, n_landmarks=1)
    return fleet, build_graph(fleet.noisy, "straight"), fleet.reckoned


def cut(graph, until):
    """What of a graph is known at a time, all variables kept; later ones are left to odometry."""
    time = np.concatenate([graph.pose_time, np.full(graph.landmark_name.size, -np.inf)])
    tables = (graph[kind] for kind in ("range", "fix", "depth"))
    known = [table[time[table.variables].max(axis=1) <= until] for table in tables]
    return graph.with_factors(range=known[0], fix=known[1], depth=known[2])


@pytest.mark.parametrize("every", ["ping", "sample"])
def test_last_update_ends_at_the_batch_optimum(mission, every, as_stored):
    _, graph, start = mission
    batch = GraphSolver(TIGHT).solve(graph, start)
    end = solve_incrementally(
        graph, start, options=SolveOptions(incremental=IncrementalOptions(every=every))
    ).solution
    assert end.status == SolveStatus.OK
    np.testing.assert_allclose(end.position, batch.position, rtol=0, atol=ATOL)
    np.testing.assert_allclose(end.landmark_position, batch.landmark_position, rtol=0, atol=ATOL)
    assert end.final_cost == pytest.approx(batch.final_cost, abs=1e-3)
    assert end.expected_cost == batch.expected_cost
    as_stored(end)
    robust = solve_incrementally(graph, start, loss=LOSSES["huber"]).solution
    assert 0.0 < robust.final_cost < end.final_cost
    assert np.isnan(robust.expected_cost)


def test_distance_from_the_batch_optimum_falls_with_the_threshold(mission):
    _, graph, start = mission
    batch = GraphSolver(TIGHT).solve(graph, start)
    off = []
    for relinearize in (1e-1, 1e-3, 1e-5):
        options = IncrementalOptions(
            relinearize=relinearize, wildfire=1e-3 * relinearize, end_tolerance=1.0
        )
        end = solve_incrementally(graph, start, options=SolveOptions(incremental=options)).solution
        off.append(np.abs(end.position - batch.position).max())
    assert off[2] <= off[1] <= off[0], off
    assert off[2] < 1e-3, off


def test_the_estimate_at_each_epoch_is_the_batch_optimum_until_then(mission):
    _, graph, start = mission
    on_line = solve_incrementally(
        graph, start, options=SolveOptions(incremental=IncrementalOptions(every="sample"))
    )
    for when in (1000.0, 3000.0, 5000.0):
        known = GraphSolver(TIGHT).solve(cut(graph, when), start, model_is_right=False)
        now = graph.pose_time == when
        assert now.any()
        # one step of the smoother per sample: centimetres where the batch solver iterates
        np.testing.assert_allclose(on_line.position[now], known.position[now], rtol=0, atol=0.1)


def test_between_pings_a_vehicle_knows_what_it_reckons_from_the_last(mission, as_stored):
    fleet, graph, start = mission
    on_line = solve_incrementally(graph, start)
    np.testing.assert_array_equal(on_line.update_time, np.array([5, 10, 15, 20, 25, 29]) * 200.0)
    n = fleet.position.shape[1]
    first = slice(0, 5)  # before the first ping there is odometry alone
    reckoned = start.position.reshape(-1, n, 3)
    kept = on_line.position.reshape(-1, n, 3)
    np.testing.assert_allclose(kept[:, first], reckoned[:, first], rtol=0, atol=1e-9)
    assert np.linalg.norm(kept[:, 5] - reckoned[:, 5], axis=1).max() > 0.5  # the ping moved it
    # from a ping to the next sample: the same step that the odometry has
    steps = (np.linalg.norm(way[:, 6] - way[:, 5], axis=1) for way in (kept, reckoned))
    np.testing.assert_allclose(*steps, rtol=0, atol=1e-9)
    assert on_line.seconds.shape == (6,)
    assert (on_line.seconds > 0.0).all()
    as_stored(on_line)


def test_the_future_does_not_reach_back(mission):
    _, graph, start = mission
    whole = solve_incrementally(graph, start)
    when = 3000.0
    ranges = graph["range"]
    later = graph.pose_time[ranges.variables[:, 0]] > when
    longer = ranges.with_columns(distance=ranges.column("distance") + np.where(later, 77.0, 0.0))
    changed = solve_incrementally(graph.with_factors(range=longer), start)
    before = graph.pose_time <= when
    np.testing.assert_array_equal(whole.position[before], changed.position[before])
    assert np.abs(whole.position - changed.position).max() > 1.0


@pytest.mark.parametrize("kind", ["huber", "cauchy", "geman-mcclure"])
def test_replay_with_a_robust_loss_ends_at_its_batch_optimum(mission, kind):
    _, graph, start = mission
    rng = np.random.default_rng(0)
    ranges = graph["range"]
    late = np.where(rng.random(len(ranges)) < 0.1, rng.uniform(50, 500, len(ranges)), 0)
    dirty = graph.with_factors(range=ranges.with_columns(distance=ranges.column("distance") + late))
    end = solve_incrementally(dirty, start, loss=LOSSES[kind]).solution
    assert end.status == SolveStatus.OK
    batch = GraphSolver().solve(dirty, end.values, method=Method(LOSSES[kind]))
    np.testing.assert_allclose(end.position, batch.position, rtol=0, atol=ATOL)
    assert np.isnan(end.expected_cost)


def test_starting_values_of_what_odometry_reaches_do_not_matter(mission):
    _, graph, start = mission
    elsewhere = replace(start, position=start.position + 500.0)
    a, b = (solve_incrementally(graph, s) for s in (start, elsewhere))
    np.testing.assert_array_equal(a.position, b.position)


def test_undetermined_variables_fail_without_ending_the_interpreter(mission, as_stored):
    _, graph, start = mission
    of_landmark = np.flatnonzero((graph["range"].variables >= graph.n_poses).any(axis=1))
    # a landmark without a prior, ranged once
    once = np.delete(np.arange(len(graph["range"])), of_landmark[1:])
    unknown = without(graph, "survey").with_factors(range=graph["range"][once])
    failed = solve_incrementally(unknown, start)
    assert failed.solution.status == SolveStatus.FAILED
    assert np.isnan(failed.solution.position).all()
    assert failed.optimum.progress.singular
    assert np.isnan(failed.seconds).any()
    as_stored(failed.solution)


def test_what_cannot_be_replayed_is_refused_in_one_line(mission):
    _, graph, start = mission
    edge = graph["edge"]
    lonely = graph.with_factors(
        edge=edge[edge.subject != graph.n_poses - 1], depth=graph["depth"][:-1]
    )
    timeless = replace(
        graph, pose_time=np.where(np.arange(graph.n_poses) == 7, np.nan, graph.pose_time)
    )
    for bad, options, message in (
        (timeless, {}, "^A7: its time is not finite"),
        (lonely, {}, "^C29: no factor mentions it"),
        (graph, {"loss": LOSSES["gnc"]}, "^a graduated loss needs all ranges at once, so"),
        (graph, {"loss": LOSSES["tukey"]}, "loss tukey loses ranges"),
        (graph, {"loss": LOSSES["welsch"]}, "loss welsch loses ranges"),
        (
            graph,
            {"options": SolveOptions(incremental=IncrementalOptions(every="hour"))},
            "every 'hour'",
        ),
    ):
        with pytest.raises(EstimationError, match=message):
            solve_incrementally(bad, start, **options)


def test_options_of_the_solver_reach_the_replay(mission, as_stored):
    fleet, graph, start = mission
    strict = SolveOptions(decrement_tolerance=1e-30)
    method = Method(incremental=True)
    assert GraphSolver().solve(graph, start, method=method).status == SolveStatus.OK
    assert (
        GraphSolver(strict).solve(graph, start, method=method).status == SolveStatus.NOT_CONVERGED
    )
    often = GraphSolver(SolveOptions(incremental=IncrementalOptions(every="sample")))
    updates = [
        solver.solve(graph, start, method=method).iterations for solver in (GraphSolver(), often)
    ]
    assert updates[1] >= fleet.position.shape[1] > updates[0]
    one = {"e": Estimator("straight", method=method)}
    assert solve_conditions(fleet.noisy, one, solver=often)["e"].iterations == updates[1]
    as_stored(updates)


@pytest.mark.parametrize("lag", [None, 1e6])
def test_a_landmark_without_a_prior_enters_when_it_is_determined(tmp_path, lag, as_stored):
    """
    Its vertex is 1 km off, so that it can only come from the ranges; the optimum is that of a
    batch.
    """
    text, landmark = drone(wave=20.0)
    vertex = next(line for line in text.splitlines() if line.startswith("VERTEX_XYZ"))
    (tmp_path / "g.pyfg").write_text(text.replace(vertex, "VERTEX_XYZ L0 1000 -1000 500"))
    file = open_graph(tmp_path / "g.pyfg")
    method = Method(incremental=lag is None, lag=lag)
    solution = GraphSolver().solve(file.graph, file.values, method=method)
    batch = solve_graph(file, start="best").solution
    assert solution.usable
    np.testing.assert_allclose(solution.landmark_position[0], landmark, atol=3.0)
    np.testing.assert_allclose(solution.position, batch.position, atol=ATOL)
    as_stored(solution)


@pytest.mark.parametrize("loss", LOSSES)
def test_a_configuration_refuses_the_losses_that_this_solver_refuses(loss):
    tree = {"name": "e", "ranges": "straight", "solver": "incremental", "loss": loss}
    if LOSSES[loss].incremental:
        assert ConditionSection.model_validate(tree).loss == loss
    else:
        with pytest.raises(ValueError, match=f"cannot use loss {loss}"):
            ConditionSection.model_validate(tree)
