"""Graphs that cannot be solved: one line that names the variable, and an interpreter that lives on."""

from dataclasses import replace

import numpy as np
import pytest

from pymantaray.errors import EstimationError
from pymantaray.estimation import GraphSolver, GraphValues, build_graph, dead_reckon
from pymantaray.estimation.diagnose import diagnose, worst_misfit
from pymantaray.estimation.graph import check_anchored, check_graph, check_values
from pymantaray.estimation.starts import anchor_loose_parts, dead_reckon_graph

NO_PRIOR = {
    "prior_pose": [],
    "prior_position": np.empty((0, 3)),
    "prior_quaternion": np.empty((0, 4)),
    "prior_covariance": np.empty((0, 6, 6)),
}
NO_SURVEY = {
    "survey_landmark": [],
    "survey_position": np.empty((0, 3)),
    "survey_covariance": np.empty((0, 3, 3)),
}
NO_RANGES = {name: [] for name in ("range_first", "range_second", "range_distance", "range_variance")}


@pytest.fixture
def whole(make_fleet):
    """A healthy graph of three vehicles and a landmark, and the truth."""
    fleet = make_fleet(seed=3, n_landmarks=1)
    values = GraphValues(
        position=fleet.position.reshape(-1, 3),
        quaternion=fleet.quaternion.reshape(-1, 4),
        landmark_position=fleet.noisy.landmark_position,
    )
    return fleet, build_graph(fleet.noisy, "straight"), values


def changed(array, index, value):
    out = np.array(array, dtype=float)
    out[index] = value
    return out


def test_healthy_graph_has_no_diagnosis(whole):
    _, graph, values = whole
    assert diagnose(graph, values) is None
    assert diagnose(replace(graph, **NO_RANGES), values) is None


@pytest.mark.parametrize(
    "change",
    [
        NO_PRIOR,  # a landmark and depths hold the fleet, which may still turn about the landmark
        NO_PRIOR | NO_SURVEY,
        NO_RANGES | NO_PRIOR,  # depths hold nothing across
    ],
)
def test_singular_graphs_are_diagnosed_by_name_exactly_where_the_solver_fails(whole, change):
    _, graph, values = whole
    graph = replace(graph, **change)
    line = diagnose(graph, values)
    solution = GraphSolver().solve(graph, values, model_is_right=False)
    assert solution.status.name == "FAILED"
    assert solution.diagnosis == line
    assert line is not None
    assert "\n" not in line
    assert line.split(":")[0][0] in "ABCL"
    assert "singular" in line


def test_vehicle_held_by_one_range_is_named(make_fleet):
    fleet = make_fleet(seed=1, n_agents=2, n_times=8)
    graph = build_graph(fleet.noisy, "straight")
    b = graph.prior_pose[1]
    graph = replace(
        graph,
        prior_pose=graph.prior_pose[:1],
        prior_position=graph.prior_position[:1],
        prior_quaternion=graph.prior_quaternion[:1],
        prior_covariance=graph.prior_covariance[:1],
    )
    assert graph.variable_name(int(b)) == "B0"
    check_anchored(graph)  # ranges tie B to A: structure alone does not see it
    values = GraphValues(
        position=fleet.position.reshape(-1, 3),
        quaternion=fleet.quaternion.reshape(-1, 4),
        landmark_position=np.empty((0, 3)),
    )
    line = diagnose(graph, values)
    assert line is not None
    assert line.startswith("B")
    assert GraphSolver().solve(graph, values).diagnosis == line


def test_vehicle_never_ranged_is_solved_with_a_prior_and_named_without(make_fleet):
    fleet = make_fleet(seed=1, n_agents=3, n_times=8)
    graph = build_graph(fleet.noisy, "straight")
    c = range(int(graph.prior_pose[2]), graph.n_poses)
    used = ~(np.isin(graph.range_first, c) | np.isin(graph.range_second, c))
    alone = replace(graph, **{name: getattr(graph, name)[used] for name in NO_RANGES})
    values = GraphValues(
        position=fleet.position.reshape(-1, 3),
        quaternion=fleet.quaternion.reshape(-1, 4),
        landmark_position=np.empty((0, 3)),
    )
    solution = GraphSolver().solve(alone, values)
    assert solution.status.name == "OK"
    assert solution.diagnosis is None
    alone = replace(alone, **{name: getattr(graph, name)[:2] for name in NO_PRIOR})
    solution = GraphSolver().solve(alone, values)
    assert not solution.usable
    assert solution.diagnosis.startswith("C")
    assert "singular" in solution.diagnosis
    assert "\n" not in solution.diagnosis


@pytest.mark.parametrize("variance", [1e-16, 1e-20, 1e-28])
def test_edge_of_almost_no_variance_is_named(whole, variance):
    _, graph, values = whole
    tight = replace(graph, edge_covariance=changed(graph.edge_covariance, 40, np.eye(6) * variance))
    line = diagnose(tight, values)
    assert line is not None
    assert line.startswith(f"{graph.variable_name(int(graph.edge_to[40]))}: odometry variance {variance:g}")
    assert "badly conditioned" in line


def test_worst_misfit_is_where_the_start_is_wrong(whole):
    _, graph, values = whole
    away = replace(values, landmark_position=values.landmark_position + np.array([0, 1e5, 0]))
    assert "L0" in worst_misfit(graph, away)


def skewed(graph):
    out = np.array(graph.edge_covariance)
    out[7, 0, 1] += 0.5 * out[7, 0, 0]
    return out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda g: {"edge_covariance": skewed(g)}, r"^A8: odometry covariance's asymmetry is \[0.5"),
        (
            lambda g: {"edge_covariance": changed(g.edge_covariance, (7, 2, 2), 0.0)},
            "^A8: odometry variance is .*, 0,",
        ),
        (
            lambda g: {"edge_covariance": changed(g.edge_covariance, (7, 2, 2), -1.0)},
            "^A8: odometry variance is .*-1",
        ),
        (
            lambda g: {"edge_covariance": changed(g.edge_covariance, (7, 2, 2), 1e-300)},
            "^A8: odometry variance .*1e-300",
        ),
        (
            lambda g: {"edge_covariance": changed(g.edge_covariance, (7, 2, 2), np.inf)},
            "^A8: odometry variance .*inf",
        ),
        (
            lambda g: {"edge_covariance": changed(g.edge_covariance, (7, 2, 3), np.nan)},
            "^A8: odometry covariance",
        ),
        (lambda g: {"edge_covariance": changed(g.edge_covariance, 7, np.ones((6, 6)))}, "^A8: .*eigenvalues"),
        (lambda g: {"edge_quaternion": g.edge_quaternion * 2.0}, r"^A1: odometry quaternion .*length 1"),
        (lambda g: {"edge_quaternion": g.edge_quaternion * 0.0}, r"^A1: odometry quaternion is .-?0, "),
        (lambda g: {"prior_quaternion": g.prior_quaternion * 1.1}, r"^A0: first-pose prior quaternion"),
        (lambda g: {"edge_to": g.edge_from}, "^A0: odometry is .0.*two different poses"),
        (
            lambda g: {"edge_translation": changed(g.edge_translation, (0, 0), 1e200)},
            "^A1: odometry is .*1e.09",
        ),
        (lambda g: {"pose_number": np.zeros(g.n_poses)}, "^A0: two variables of this name"),
        (lambda g: {"pose_agent": g.pose_agent + 3}, "^pose: refers to vehicle 3"),
        (lambda g: {"edge_to": g.edge_to + 10**6}, "^odometry: refers to variable"),
        (lambda g: {"edge_from": g.edge_from - 10**6}, "^odometry: refers to variable -"),
    ],
)
def test_numbers_that_gtsam_would_choke_on_or_misread_are_refused_first(whole, change, message):
    _, graph, values = whole
    bad = replace(graph, **change(graph))
    with pytest.raises(EstimationError, match=message) as caught:
        check_graph(bad)
    assert "\n" not in str(caught.value)
    with pytest.raises(EstimationError, match=message):
        GraphSolver().solve(bad, values)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": np.full((90, 3), np.nan)}, "^A0: position is .nan"),
        ({"position": np.full((90, 3), 1e300)}, "^A0: position is .1e.300"),
        ({"quaternion": np.zeros((90, 4))}, "^A0: quaternion is .0, 0, 0, 0.*length 1"),
        ({"landmark_position": np.full((1, 3), np.inf)}, "^L0: position is .inf"),
        (
            {"landmark_position": np.zeros((2, 3))},
            "values for 90 poses and 2 landmarks; the graph has 90 and 1",
        ),
    ],
)
def test_values_that_cannot_be_a_start_are_refused(whole, change, message):
    _, graph, values = whole
    with pytest.raises(EstimationError, match=message):
        check_values(graph, replace(values, **change))
    with pytest.raises(EstimationError, match=message):
        GraphSolver().solve(graph, replace(values, **change))


def test_dead_reckoning_over_a_graph_is_dead_reckoning_of_its_measurements(whole):
    fleet, graph, values = whole
    nowhere = replace(
        values, position=values.position + 1e4, landmark_position=values.landmark_position + 1e4
    )
    reckoned, taken = dead_reckon_graph(graph, nowhere)
    position, quaternion = dead_reckon(fleet.noisy)
    np.testing.assert_allclose(reckoned.position, position.reshape(-1, 3), rtol=0, atol=1e-9)
    np.testing.assert_allclose(reckoned.quaternion, quaternion.reshape(-1, 4), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(reckoned.landmark_position, fleet.noisy.landmark_position)
    assert taken == 0


def test_dead_reckoning_goes_backwards_and_starts_where_the_file_says_for_want_of_a_prior(make_fleet):
    fleet = make_fleet(seed=4, n_agents=2, n_times=6)
    exact = build_graph(fleet.noise_free)
    last = 5  # of A; its prior moves there, and B has none
    graph = replace(
        exact,
        prior_pose=[last],
        prior_position=fleet.position[:1, last],
        prior_quaternion=fleet.quaternion[:1, last],
        prior_covariance=exact.prior_covariance[:1],
    )
    values = GraphValues(
        position=fleet.position.reshape(-1, 3),
        quaternion=fleet.quaternion.reshape(-1, 4),
        landmark_position=np.empty((0, 3)),
    )
    shifted = replace(values, position=values.position + np.array([7.0, 0.0, 0.0]))
    reckoned, taken = dead_reckon_graph(graph, shifted)
    assert taken == 1
    np.testing.assert_allclose(reckoned.position[:6], values.position[:6], atol=1e-8)
    np.testing.assert_allclose(reckoned.position[6:], shifted.position[6:], atol=1e-8)


def test_anchors_go_to_the_first_pose_of_each_loose_part_and_make_it_solvable(whole):
    _, graph, values = whole
    loose = replace(graph, **NO_PRIOR, **NO_SURVEY)
    with pytest.raises(EstimationError, match=r"^A0: no first-pose prior"):
        check_anchored(loose)
    anchored, poses = anchor_loose_parts(loose, values)
    assert poses.tolist() == [0]
    check_anchored(anchored)
    assert GraphSolver().solve(anchored, values, model_is_right=False).status.name == "OK"
    apart, poses = anchor_loose_parts(replace(loose, **NO_RANGES), values)
    assert [graph.variable_name(int(p)) for p in poses] == ["A0", "B0", "C0"]
    with pytest.raises(EstimationError, match=r"^L0: no first-pose prior"):
        check_anchored(apart)  # a landmark that nothing measures
    again, none = anchor_loose_parts(graph, values)
    assert none.size == 0
    np.testing.assert_array_equal(again.prior_pose, graph.prior_pose)
