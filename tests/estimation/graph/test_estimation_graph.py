"""Which measurements enter the graph, what is refused by name, and where to start on it."""

from dataclasses import replace

import numpy as np
import pytest
from factories import without
from refusals import refused

from pymantaray.apps.graphs.diagnose import check_conditioned, diagnose, worst_misfit
from pymantaray.errors import EstimationError
from pymantaray.estimation import FactorGraph, GraphSolver, Method, build_graph, dead_reckon
from pymantaray.estimation.graph.graph import KINDS, check_anchored, check_graph, check_values
from pymantaray.estimation.solvers.starts import anchor_loose_parts, dead_reckon_graph
from pymantaray.geometry.se3 import matrix_from_quaternion, quaternion_from_matrix, se3_exp, so3_exp
from pymantaray.records import RayStatus


@pytest.fixture
def whole(make_fleet):
    """A healthy graph of three vehicles and a landmark, and the truth."""
    fleet = make_fleet(seed=3, n_landmarks=1)
    return fleet, build_graph(fleet.noisy, "straight"), fleet.truth


def put(array, index, value):
    out = np.array(array, dtype=float)
    out[index] = value
    return out


def test_straight_and_refracted_use_exactly_the_links_that_were_heard(fleet):
    straight, refracted = (build_graph(fleet.noisy, r)["range"] for r in ("straight", "refracted"))
    heard = fleet.noisy.range_status == RayStatus.OK
    assert 0 < np.count_nonzero(heard) < heard.size
    np.testing.assert_array_equal(straight.variables, refracted.variables)
    np.testing.assert_array_equal(straight.column("distance"), fleet.noisy.straight_range[heard])
    np.testing.assert_array_equal(refracted.column("distance"), fleet.noisy.refracted_range[heard])


def test_all_links_include_dropouts_but_no_silent_vehicle(fleet):
    status = np.array(fleet.noisy.range_status)
    status[:4] = RayStatus.STOPPED
    graph = build_graph(replace(fleet.noisy, range_status=status), "straight", "all")
    assert len(graph["range"]) == status.size - 4


def test_variables_are_numbered_vehicle_by_vehicle_and_landmarks_last(make_fleet):
    fleet = make_fleet(n_vehicles=2, n_times=12, n_landmarks=2)
    o, graph = fleet.noisy, build_graph(fleet.noisy, "straight")
    assert [graph.variable_name(v) for v in (0, 11, 12, 24, 25)] == ["A0", "A11", "B0", "L0", "L1"]
    ranges, distance = graph["range"], {}
    assert (ranges.variables[:, 0] < graph.n_poses).all()  # a pose comes first
    for ends, d in zip(ranges.variables, ranges.column("distance"), strict=True):
        distance.setdefault(frozenset(map(graph.variable_name, ends)), []).append(d)
    at_five = o.straight_range[
        (o.range_sample == 5) & np.isin(o.range_transmitter + 10 * o.range_receiver, [13, 31])
    ]
    assert sorted(distance[frozenset(["B5", "L1"])]) == sorted(at_five)
    assert len(at_five) == 2  # there and back
    named = replace(graph, vehicle_name=np.array(["float-1", "7"]))
    assert [named.variable_name(v) for v in (11, 12 + 1, 24)] == ["float-1:11", "7:1", "L0"]


def test_degrees_of_freedom_count_residual_rows_minus_unknowns(make_fleet):
    fleet = make_fleet(n_vehicles=2, n_times=6, n_landmarks=1, gnss_every=3)
    graph = build_graph(fleet.noisy, "straight")
    # 2 first-pose priors and 10 edges of 6 rows, 4 fixes and 1 survey of 3, 12 depths, 6 ranges at
    # sample 5
    assert graph.degrees_of_freedom == 12 * 6 + 5 * 3 + 12 + 6 - (12 * 6 + 3)


def test_a_graph_goes_to_disk_and_back(whole, tmp_path):
    _, graph, _ = whole
    graph.save(tmp_path / "graph.nc")
    again = FactorGraph.load(tmp_path / "graph.nc")
    assert again.vehicle_name.tolist() == graph.vehicle_name.tolist()
    for kind in graph.factors:
        for part in ("variables", "measurement", "covariance"):
            np.testing.assert_array_equal(getattr(again[kind], part), getattr(graph[kind], part))


@pytest.mark.parametrize(("field", "index", "value", "message"), [
    ("odometry_translation", (1, 4, 2), np.nan, "^B5: odometry is .*nan"),
    ("odometry_sigma", (2, 0, 0), 0.0, "^C1: odometry sigma is .0,"),
    ("odometry_sigma", slice(None), -1.0, "^A1: odometry sigma is .*positive and finite"),
    ("depth", (0, 7), np.nan, "^A7: depth is .nan."),
    ("depth_sigma", 1, 0.0, "^B0: depth sigma is .0."),
    ("gnss_position", (1, 0), np.nan, "^A10: GNSS fix is .nan,"),
    ("range_sigma", slice(None), 0.0, "^[ABC]5: range sigma is .0."),
    ("refracted_range", slice(None), np.nan, "^[ABC]5: range is .nan."),
    ("first_quaternion", 1, np.nan, "^B0: first-pose prior is .*nan"),
    ("range_sample", slice(None), 10005, "^range: refers to variable"),
])  # fmt: skip
def test_unusable_measurements_are_refused_by_name(fleet, field, index, value, message):
    broken = replace(fleet.noisy, **{field: put(getattr(fleet.noisy, field), index, value)})
    refused(EstimationError, message, build_graph, broken, "refracted")


def test_a_range_of_a_vehicle_to_itself_is_refused(fleet):
    itself = replace(fleet.noisy, range_receiver=fleet.noisy.range_transmitter)
    refused(
        EstimationError,
        r"^A5: range is .5..*two different variables",
        build_graph,
        itself,
        "refracted",
    )


@pytest.mark.parametrize(("ranges", "links", "message"), [
    ("refracted", "all", "a dropout has none"),
    ("curved", "all", "allowed are"),
    (None, "some", "allowed are"),
])  # fmt: skip
def test_contradictory_conditions_are_refused(fleet, ranges, links, message):
    refused(EstimationError, message, build_graph, fleet.noisy, ranges, links)


def without_first_pose(o, vehicle):
    names = ("first_position", "first_quaternion", "first_sigma")
    return replace(o, **{name: put(getattr(o, name), vehicle, np.nan) for name in names})


def test_vehicle_that_nothing_ties_to_the_world_is_refused_by_name(make_fleet):
    floating = without_first_pose(make_fleet(n_vehicles=2).noisy, 1)
    refused(
        EstimationError,
        r"^B0: no first-pose prior, GNSS fix or landmark prior",
        build_graph,
        floating,
    )
    # ranges tie it to vehicle A
    assert build_graph(floating, "straight")["prior"].subject.tolist() == [0]


def test_fix_or_landmark_is_anchor_enough(make_fleet):
    fixed = make_fleet(n_vehicles=1, gnss_every=10).noisy
    assert len(build_graph(without_first_pose(fixed, 0))["prior"]) == 0
    ranged = make_fleet(n_vehicles=1, n_landmarks=3).noisy
    graph = build_graph(without_first_pose(ranged, 0), "straight")
    check_anchored(graph)
    assert len(graph["fix"]) == 0


def edges(change):
    """A change of the table of edges."""
    return lambda g: g.with_factors(edge=change(g["edge"]))


def edge_covariance(index, value):
    return edges(lambda e: replace(e, covariance=put(e.covariance, index, value)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (edge_covariance((7, 0, 1), 1e-9), r"^A8: odometry covariance's asymmetry is \[0"),
        (edge_covariance((7, [0, 1], [1, 0]), 1.0), "^A8: odometry covariance's eigenvalues"),
        (edge_covariance(7, np.ones((6, 6))), "^A8: .*eigenvalues"),
        (edge_covariance((7, 2, 2), -1.0), "^A8: odometry variance is .*-1"),
        (edge_covariance((7, 2, 2), 1e-300), "^A8: odometry variance .*1e-300"),
        (edge_covariance((7, 2, 2), np.inf), "^A8: odometry variance .*inf"),
        (edge_covariance((7, 2, 3), np.nan), "^A8: odometry covariance"),
        (edges(lambda e: e.with_columns(quaternion=2.0 * e.column("quaternion"))),
         r"^A1: .*quaternion .*length 1"),
        (edges(lambda e: e.with_columns(quaternion=0.0 * e.column("quaternion"))),
         r"^A1: .*quaternion is .-?0, "),
        (
            lambda g: g.with_factors(
                prior=g["prior"].with_columns(quaternion=1.1 * g["prior"].column("quaternion"))),
            "^A0: first-pose prior quaternion",
        ),
        (edges(lambda e: replace(e, variables=e.variables[:, [0, 0]])),
         "^A0: odometry is .0.*two different poses"),
        (edges(lambda e: e.with_columns(position=put(e.column("position"), (0, 0), 1e200))),
         "^A1: odometry is .*1e.09"),
        (lambda g: replace(g, pose_number=np.zeros(g.n_poses)), "^A0: two variables of this name"),
        (lambda g: replace(g, pose_vehicle=g.pose_vehicle + 3), "^pose: refers to vehicle 3"),
        (edges(lambda e: replace(e, variables=e.variables + np.int32([0, 10**6]))),
         "^odometry: refers to variable"),
        (edges(lambda e: replace(e, variables=e.variables - np.int32([10**6, 0]))),
         "^odometry: refers to variable -"),
    ],
)  # fmt: skip
def test_numbers_that_gtsam_would_misread_are_refused(whole, change, message):
    _, graph, values = whole
    bad = change(graph)
    for check in (check_graph, lambda g: GraphSolver().solve(g, values)):
        refused(EstimationError, message, check, bad)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": np.full((90, 3), np.nan)}, "^A0: position is .nan"),
        ({"position": np.full((90, 3), 1e300)}, "^A0: position is .1e.300"),
        ({"quaternion": np.zeros((90, 4))}, "^A0: quaternion is .0, 0, 0, 0.*length 1"),
        ({"landmark_position": np.full((1, 3), np.inf)}, "^L0: position is .inf"),
        (
            {"landmark_position": np.zeros((2, 3))},
            "^values for 90 poses and 2 landmarks; the graph has 90 and 1",
        ),
    ],
)
def test_values_that_cannot_be_a_start_are_refused(whole, change, message):
    _, graph, values = whole
    for check in (check_values, GraphSolver().solve):
        refused(EstimationError, message, check, graph, replace(values, **change))


@pytest.mark.parametrize("gone", [
    ("prior",),  # a landmark and depths hold the fleet, which may still turn about the landmark
    ("prior", "survey"),
    ("range", "prior"),  # depths hold nothing across
    ("edge",),  # poses that only depth and some ranges know
])  # fmt: skip
@pytest.mark.parametrize("noise", ["noisy", "noise_free"])
def test_singular_graphs_started_at_the_truth_fail_with_a_diagnosis(whole, gone, noise):
    fleet, _, values = whole
    graph = without(build_graph(getattr(fleet, noise), "straight"), *gone)
    solution = GraphSolver().solve(graph, values)
    assert solution.status.name == "FAILED"
    assert np.isnan(solution.position).all()
    assert np.isnan(solution.quaternion).all()
    line = diagnose(graph, values)
    assert "\n" not in line
    assert line[0] in "ABCL"
    assert "singular" in line


@pytest.mark.parametrize("n_vehicles", [2, 3], ids=["held by one range", "never ranged"])
def test_a_vehicle_without_ranges_is_solved_with_a_prior(make_fleet, n_vehicles):
    fleet = make_fleet(seed=1, n_vehicles=n_vehicles, n_times=8)
    graph = build_graph(fleet.noisy, "straight")
    last = graph["prior"].subject[-1]
    if n_vehicles == 3:
        graph = graph.with_factors(
            range=graph["range"][(graph["range"].variables < last).all(axis=1)]
        )
    assert GraphSolver().solve(graph, fleet.truth).status.name == "OK"
    assert diagnose(graph, fleet.truth) is None
    loose = graph.with_factors(prior=graph["prior"][:-1])
    assert not GraphSolver().solve(loose, fleet.truth).usable
    line = diagnose(loose, fleet.truth)
    assert line.startswith("ABC"[n_vehicles - 1])
    assert "singular" in line


@pytest.mark.parametrize("variance", [1e-16, 1e-20, 1e-28])
def test_edge_of_almost_no_variance_is_named(whole, variance):
    _, graph, _ = whole
    tight = edge_covariance(40, np.eye(6) * variance)(graph)
    name = graph.variable_name(int(graph["edge"].subject[40]))
    line = f"^{name}: odometry variance {variance:g} .*badly conditioned"
    refused(EstimationError, line, check_conditioned, tight)
    check_conditioned(graph)


def test_worst_misfit_is_where_the_start_is_wrong(whole):
    _, graph, values = whole
    away = replace(values, landmark_position=values.landmark_position + np.array([0, 1e5, 0]))
    assert "L0" in worst_misfit(graph, away)


def test_constant_twist_composes_to_its_exponential(make_fleet):
    o = make_fleet(n_vehicles=1, n_times=41).noise_free
    twist = np.array([0.01, -0.02, 0.05, 30.0, 1.0, -2.0])
    step, way = se3_exp(twist)
    odometry = replace(
        o,
        odometry_rotation=np.tile(quaternion_from_matrix(step), (1, 40, 1)),
        odometry_translation=np.tile(way, (1, 40, 1)),
        first_position=np.zeros((1, 3)),
        first_quaternion=np.array([[1.0, 0, 0, 0]]),
    )
    position, quaternion = dead_reckon(odometry)
    whole, end = se3_exp(40 * twist)
    np.testing.assert_allclose(position[0, -1], end, rtol=0, atol=1e-9)
    np.testing.assert_allclose(matrix_from_quaternion(quaternion[0, -1]), whole, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("field", "what"),
    [("first_position", "first-pose prior"), ("odometry_translation", "odometry")],
)
def test_dead_reckoning_refuses_what_is_missing_by_vehicle(fleet, field, what):
    broken = put(getattr(fleet.noisy, field), 1, np.nan)
    with pytest.raises(EstimationError, match=f"^vehicle B: {what} is not finite"):
        dead_reckon(replace(fleet.noisy, **{field: broken}))


def test_dead_reckoning_of_a_graph_is_that_of_its_measurements(whole):
    fleet, graph, values = whole
    mark = values.landmark_position
    nowhere = replace(values, position=values.position + 1e4, landmark_position=mark + 1e4)
    reckoned, from_file = dead_reckon_graph(graph, nowhere)
    expected = fleet.reckoned
    np.testing.assert_allclose(reckoned.position, expected.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(reckoned.quaternion, expected.quaternion, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(reckoned.landmark_position, fleet.noisy.landmark_position)
    assert from_file.size == 0


def test_dead_reckoning_goes_backwards_and_starts_at_the_file(
    make_fleet,
):
    fleet = make_fleet(seed=4, n_vehicles=2, n_times=6)
    graph, last = build_graph(fleet.noise_free), 5  # of A; its prior moves there, and B has none
    at_end = graph["prior"].kind.table(
        [last],
        [fleet.position[:1, last], fleet.quaternion[:1, last]],
        graph["prior"].covariance[:1],
    )
    shifted = replace(fleet.truth, position=fleet.truth.position + np.array([7.0, 0.0, 0.0]))
    reckoned, from_file = dead_reckon_graph(graph.with_factors(prior=at_end), shifted)
    assert from_file.tolist() == [6]
    np.testing.assert_allclose(reckoned.position[:6], fleet.truth.position[:6], atol=1e-8)
    np.testing.assert_allclose(reckoned.position[6:], shifted.position[6:], atol=1e-8)


def test_anchors_at_loose_parts_make_a_graph_solvable(whole):
    _, graph, values = whole
    loose = without(graph, "prior", "survey")
    refused(EstimationError, r"^A0: no first-pose prior", check_anchored, loose)
    anchored, poses = anchor_loose_parts(loose, values)
    assert poses.tolist() == [0]
    check_anchored(anchored)
    assert GraphSolver().solve(anchored, values, model_is_right=False).status.name == "OK"
    apart, poses = anchor_loose_parts(without(loose, "range"), values)
    assert [graph.variable_name(int(p)) for p in poses] == ["A0", "B0", "C0"]
    with pytest.raises(EstimationError, match=r"^L0: no first-pose prior"):
        check_anchored(apart)  # a landmark that nothing measures
    again, none = anchor_loose_parts(graph, values)
    assert none.size == 0
    np.testing.assert_array_equal(again["prior"].variables, graph["prior"].variables)


def one_more(graph, name, truth):
    """
    One factor of a kind, of the last pose or the landmark, that measures 3 m and 0.1 rad more than
    the truth.
    """
    kind, n = KINDS[name], graph.n_poses
    last = {"pose": n - 1, "landmark": n, "any": n - 1}[kind.ends[-1]]
    ends = [0, last][-len(kind.ends) :]
    place, turn = (
        np.concatenate([truth.position, truth.landmark_position]),
        matrix_from_quaternion(truth.quaternion),
    )
    stride, rotation = place[last], turn[min(last, n - 1)]
    if len(ends) == 2:
        stride, rotation = turn[0].T @ (stride - place[0]), turn[0].T @ rotation
    measured = {
        "position": stride + 3.0,
        "quaternion": quaternion_from_matrix(rotation @ so3_exp(np.array([0.0, 0.0, 0.1]))),
        "depth": stride[2] + 3.0,
        "distance": np.linalg.norm(stride) + 3.0,
    }
    columns = [[measured[column]] for column, _, _ in kind.columns]
    variance = [1e-4 if row.startswith("r") else 1e-2 for row in kind.row_names]
    table = kind.table([ends], columns, [np.diag(variance)])
    return graph.with_factors(**{name: graph[name].append(table)})


@pytest.mark.parametrize("name", sorted(KINDS))
def test_a_factor_of_every_kind_moves_the_estimate_of_every_solver(make_fleet, name):
    """A kind that is counted and then ignored would leave the estimate where it is."""
    fleet = make_fleet(n_vehicles=1, n_times=6, n_landmarks=1)
    graph = build_graph(fleet.noisy, "straight")
    more = one_more(graph, name, fleet.truth)
    assert more.degrees_of_freedom == graph.degrees_of_freedom + KINDS[name].rows
    for method in (Method(), Method(incremental=True)):
        before, after = (GraphSolver().solve(g, fleet.truth, method=method) for g in (graph, more))
        moved = max(
            np.abs(after.position - before.position).max(),
            np.abs(after.landmark_position - before.landmark_position).max(),
            np.abs(after.quaternion - before.quaternion).max(),
        )
        assert moved > 0.01, (name, method, before.status, after.status)


def test_a_new_kind_is_solved_by_its_columns_and_ends(make_fleet, monkeypatch):
    fleet = make_fleet(n_vehicles=1, n_times=6, n_landmarks=1)
    graph = build_graph(fleet.noisy, "straight")
    kinds = {
        "beacon": replace(KINDS["sighting"], what="beacon", plural="beacons", word=None),
        **KINDS,
    }
    monkeypatch.setattr("pymantaray.estimation.graph.graph.KINDS", kinds)
    sighted = one_more(graph, "sighting", fleet.truth)
    beacon = replace(sighted["sighting"], kind=kinds["beacon"])
    tables = {"sighting": sighted, "beacon": graph.with_factors(beacon=beacon)}
    ends = {
        name: [
            GraphSolver().solve(g, fleet.truth, method=m)
            for m in (Method(), Method(incremental=True))
        ]
        for name, g in tables.items()
    }
    for one, other in zip(*ends.values(), strict=True):
        np.testing.assert_allclose(
            one.position, other.position, rtol=0, atol=1e-6
        )  # m; summed in another order
        assert np.abs(one.landmark_position - fleet.truth.landmark_position).max() > 0.1


@pytest.mark.parametrize(("kind", "message"), [
    (replace(KINDS["sighting"], what="baseline", ends=("landmark", "landmark")),
     "^baseline: no residual for position of landmark and landmark;"),
    (replace(KINDS["range"], what="altitude", ends=("pose",)),
     "^altitude: no residual for distance of pose;"),
    (replace(KINDS["range"], what="second range"),
     "^kinds that measure distances: new, range; allowed: range alone"),
])  # fmt: skip
def test_a_kind_that_no_residual_fits_is_refused(whole, monkeypatch, kind, message):
    _, graph, truth = whole
    monkeypatch.setattr("pymantaray.estimation.graph.graph.KINDS", {"new": kind, **KINDS})
    refused(EstimationError, message, GraphSolver().solve, graph, truth)


def test_a_table_of_no_kind_is_refused(whole):
    _, graph, truth = whole
    odd = graph.with_factors(altitude=graph["range"])
    refused(
        EstimationError,
        "^factors of a kind 'altitude'; allowed: prior,",
        GraphSolver().solve,
        odd,
        truth,
    )
