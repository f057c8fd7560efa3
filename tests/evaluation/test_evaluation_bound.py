"""
Bounds by hand: one range, a chain of odometry, a fleet that turns about its anchor; and an
estimator that reaches them.
"""

from dataclasses import replace

import factories
import numpy as np
import pandas as pd
import pytest
from refusals import refused

from pymantaray.errors import EvaluationError
from pymantaray.estimation import build_graph, collect_estimates, solve_conditions
from pymantaray.estimation.solvers.marginals import PoseCovariance
from pymantaray.evaluation import (
    DegreesOfFreedom,
    attitude_table,
    bound_table,
    error_bound,
    error_table,
    graph_degrees_of_freedom,
    ping_error_table,
)
from pymantaray.geometry import stream
from pymantaray.geometry.se3 import matrix_from_quaternion
from pymantaray.records import RayStatus

DEPTH, STEP, FIRST, TURN, MOVE = 300.0, 200.0, 2.0, 3e-3, 1.5
TURNED = 1e-2  # of the first pose [rad]


def measured(position, attempts, *, landmarks=(), fixes=((), ()), **changes):
    """Level vehicles that know their steps to TURN and MOVE, and landmarks to half a metre."""
    truth = factories.trajectories(np.array(position, dtype=float))
    n, n_edges = truth.position.shape[0], truth.position.shape[1] - 1
    marks = np.array(landmarks, dtype=float).reshape(-1, 3)
    who, to, sample = np.array(attempts, dtype=int).reshape(-1, 3).T
    place = np.concatenate([truth.position, np.repeat(marks[:, None], n_edges + 1, axis=1)])
    distance = np.linalg.norm(place[who, sample] - place[to, sample], axis=-1)
    o = factories.measure(
        truth,
        marks,
        np.array(fixes, dtype=int),
        (who, to, sample),
        odometry_rotation=np.tile([1.0, 0.0, 0.0, 0.0], (n, n_edges, 1)),
        odometry_translation=np.diff(truth.position, axis=1),
        odometry_sigma=np.tile([TURN] * 3 + [MOVE] * 3, (n, n_edges, 1)),
        landmark_sigma=np.full(len(marks), 0.5),
        first_sigma=np.tile([TURNED] * 3 + [FIRST] * 3, (n, 1)),
        range_status=np.full(who.size, RayStatus.OK),
        transmitter_sound_speed=np.full(who.size, 1450.0),
        straight_range=distance,
        refracted_range=distance,
    )
    return truth, replace(o, **changes)


def test_the_bound_computes_no_innovations(monkeypatch):
    """Of 30 vehicles they took ten times as long as the bound itself."""
    monkeypatch.setattr(
        "pymantaray.estimation.solvers.marginals._innovation", lambda *_: pytest.fail("for nothing")
    )
    truth, o = measured([[[0, 0, DEPTH]]], [(0, 1, 0)], landmarks=[[900, 0, DEPTH]])
    assert np.isfinite(error_bound(truth, o)).all()


def test_one_range_and_one_pose():
    truth, o = measured([[[0, 0, DEPTH]]], [(0, 1, 0)], landmarks=[[900, 0, DEPTH]])
    bound = error_bound(truth, o)[0, 0, :, 0]
    along = 1.0 / (
        1.0 / FIRST**2 + 1.0 / (1.0 + 0.5**2)
    )  # the range's variance, and the landmark's
    down = 1.0 / (1.0 / FIRST**2 + 1.0 / 0.01**2)
    np.testing.assert_allclose(bound, np.diag([along, FIRST**2, down]), rtol=1e-9, atol=1e-9)
    without = error_bound(truth, o, "no-ranges")[0, 0, :2, 0, :2]
    np.testing.assert_allclose(without, FIRST**2 * np.eye(2), rtol=1e-9, atol=1e-9)


def test_what_leaks_is_a_range_like_others():
    place, pair = [[[0, 0, 0.5]], [[2000, 0, 500]]], [(0, 1, 0)]
    fixes = ([0], [0])
    truth, o = measured(place, pair, fixes=fixes)
    _, leaked = measured(place, pair, fixes=fixes, range_status=np.array([RayStatus.LEAKED]))
    _, lost = measured(place, pair, fixes=fixes, range_status=np.array([RayStatus.SHADOW]))
    np.testing.assert_array_equal(error_bound(truth, leaked), error_bound(truth, o))
    assert [bound_table(truth, m)["unseen"].item() for m in (o, leaked, lost)] == [1, 1, 2]
    assert (
        bound_table(truth, lost)["bound_rmse_m"].item()
        > 1.1 * bound_table(truth, o)["bound_rmse_m"].item()
    )


@pytest.mark.parametrize("condition", ["odometry", "no-ranges"])
def test_a_straight_chain_of_odometry(condition):
    k = 12
    track = [[[STEP * i, 0, DEPTH] for i in range(k + 1)]]
    truth, o = measured(track, [(0, 1, k)], landmarks=[[0, 5000, DEPTH]])
    along = FIRST**2 + k * MOVE**2
    lever = STEP**2 * (TURNED**2 * k**2 + TURN**2 * sum((k - j) ** 2 for j in range(1, k + 1)))
    bound = error_bound(truth, o, condition)[0, 0, :2, 0, :2]
    np.testing.assert_allclose(bound, np.diag([along, along + lever]), rtol=1e-9, atol=1e-9)


def test_a_fleet_turns_unseen_about_its_only_anchor():
    place = np.array([[[0, 0, 0.5]], [[2000, 0, 500]], [[-500, 3000, 900]], [[-1500, -900, 200]]])
    pairs = [(i, j, 0) for i in range(4) for j in range(i + 1, 4)]
    tables = {}
    for name, fixed, marks in (
        ("none", [], []),
        ("one", [0], []),
        ("two", [0, 1], []),
        ("landmark", [0], [[3000, 3000, 700]]),
    ):
        attempts = [*pairs, *((i, 4, 0) for i in range(4) if marks)]
        fixes, sigma = (fixed, [0] * len(fixed)), np.full(len(attempts), 0.01)
        truth, o = measured(place, attempts, landmarks=marks, fixes=fixes, range_sigma=sigma)
        tables[name] = bound_table(truth, o).iloc[0]
    assert {name: row["unseen"] for name, row in tables.items()} == {
        "none": 3,  # shifts north and east as well
        "one": 1,
        "two": 0,
        "landmark": 0,
    }
    # the vehicles' priors alone hold the rotation, and nothing else is left of the error
    arms = np.linalg.norm(place[1:, 0, :2], axis=1)
    held = np.degrees(FIRST / np.linalg.norm(arms))
    assert tables["one"]["rotation_deg"] == pytest.approx(held, rel=1e-2)
    assert tables["one"]["rotation_percent"] > 98.0
    assert tables["landmark"]["rotation_deg"] < 0.2 * held
    assert tables["one"]["bound_rmse_m"] < tables["one"]["no_ranges_rmse_m"]
    assert np.isnan(tables["none"]["rotation_deg"])


def test_estimators_with_and_without_ranges_reach_their_bounds():
    fleet = factories.make_fleet(seed=5, n_vehicles=4, n_times=20, turn=0.0, gnss_every=19)
    truth = factories.trajectories(
        fleet.position, time=np.arange(20) * factories.PERIOD, quaternion=fleet.quaternion
    )
    conditions, count = ["odometry", "no-ranges", "straight"], 40
    solved = [
        solve_conditions(factories.add_noise(fleet.noise_free, seed), conditions, fleet.start)
        for seed in range(count)
    ]
    bounds = {name: error_bound(truth, fleet.noise_free, name) for name in conditions}
    table = ping_error_table(
        truth, collect_estimates(fleet.noise_free, solved), fleet.noise_free, bounds
    )
    assert table["n"].tolist() == [count * 4 * 3] * 3
    # by realizations of some ten degrees of freedom that are not tied to each other
    np.testing.assert_allclose(table["efficiency"], 1.0, atol=5.0 * np.sqrt(2.0 / (10 * count)))
    best = table.set_index("condition")["bound_rmse_m"]
    assert best["straight"] < 0.6 * best["no-ranges"]
    assert best["no-ranges"] < best["odometry"]


def test_errors_at_pings_by_hand():
    position = np.repeat([[[0, 0, 0.5]], [[900, 0, 500]], [[0, 900, 700]]], 6, axis=1)
    truth, o = measured(position, [(1, 2, 2), (2, 0, 4)], fixes=([0] * 6 + [2], [*range(6), 4]))
    # B at both pings and C at the first; C has a fix at the second, A always
    estimate = np.broadcast_to(position, (2, 2, 3, 6, 3)).copy()
    estimate[0, :, 1, 2] += [3.0, 4.0, 0.0]
    estimate[1, :, 1, 2] += [0.0, 4.0, 0.0]
    estimate[:, 1, 2, 2] += [0.0, 0.0, 12.0]
    estimate[:, :, :, [0, 1, 3, 5]] += 1e3  # between pings
    estimate[:, :, 2, 4] += 1e3  # at the surface
    table = ping_error_table(truth, factories.estimates(truth, estimate), o).set_index("condition")
    assert table.loc["straight", ["n", "median_m", "from_straight_rmse_m"]].tolist() == [
        6,
        2.5,
        0.0,
    ]
    assert table.loc["straight", "rmse_m"] == pytest.approx(np.sqrt((25 + 25 + 144) / 6))
    assert table["rmse_standard_error_m"].isna().all(), "there are no degrees of freedom"
    assert table.loc["refracted", "from_straight_rmse_m"] == pytest.approx(np.sqrt((9 + 9) / 6))
    assert table["bound_rmse_m"].isna().all()
    bounds = dict.fromkeys(table.index, error_bound(truth, o))
    with_bounds = ping_error_table(truth, factories.estimates(truth, estimate), o, bounds)
    freedom = dict.fromkeys(table.index, DegreesOfFreedom(truth, o))
    again = ping_error_table(truth, factories.estimates(truth, estimate), o, bounds, freedom)
    expected = again["rmse_m"] / np.sqrt(2.0 * 2.0 * freedom["straight"].at_pings)
    np.testing.assert_allclose(again["rmse_standard_error_m"], expected, rtol=1e-12)
    variance = np.einsum("eaiai->ea", bounds["straight"])[[0, 0, 1], [1, 2, 1]].mean()
    assert with_bounds["bound_rmse_m"].tolist() == pytest.approx([np.sqrt(variance)] * 2)
    other = replace(truth, name=np.array(["X", "Y", "Z"]))
    refused(EvaluationError, "measurements of vehicles", error_bound, other, o)
    refused(
        EvaluationError,
        "bound: condition 'none'; allowed are odometry, ",
        error_bound,
        truth,
        o,
        "none",
    )


def test_the_distance_from_straight_has_a_standard_error():
    position = np.repeat([[[0, 0, 0.5]], [[900, 0, 500]], [[0, 900, 700]]], 6, axis=1)
    truth, o = measured(position, [(1, 2, 2), (2, 0, 4)])
    rng, rows = np.random.default_rng(3), []
    for shift in [np.array([[1.0, 0, 0], [0, 2.0, 0], [0, 0, 3.0]]), *rng.normal(size=(60, 20, 3))]:
        estimate = np.broadcast_to(position, (2, len(shift), 3, 6, 3)).copy()
        estimate[1] += shift[:, None, None]
        table = ping_error_table(truth, factories.estimates(truth, estimate), o).set_index(
            "condition"
        )
        rows.append(
            table.loc["refracted", ["from_straight_rmse_m", "from_straight_rmse_standard_error_m"]]
        )
    rmse, error = np.array(rows, dtype=float).T
    # mean squares 1, 4 and 9: their mean has the standard error 7/3
    np.testing.assert_allclose(
        [rmse[0], error[0]], [np.sqrt(14 / 3), 7 / 3 / (2 * np.sqrt(14 / 3))]
    )
    assert rmse[1:].std() == pytest.approx(error[1:].mean(), rel=4.0 / np.sqrt(2 * 60))
    one = factories.estimates(truth, estimate[:, :1])
    assert ping_error_table(truth, one, o)["from_straight_rmse_standard_error_m"].isna().all()


def exact_freedom(graph, values, poses, axes=None):
    """
    Effective degrees of freedom of the positions of poses, or of their attitudes about axes, from
    GTSAM's joint covariance.
    """
    import gtsam

    from pymantaray.estimation._gtsam.factors import graph_factors, values_of

    own = list(range(graph.n_poses))
    joint = gtsam.Marginals(graph_factors(graph), values_of(values)).jointMarginalCovariance(own)
    rotation = matrix_from_quaternion(
        values.quaternion
    )  # GTSAM's errors are in the tangent of the body
    part, axes = (slice(3, 6), [0, 1, 2]) if axes is None else (slice(0, 3), axes)
    covariance = np.block(
        [
            [
                (rotation[a] @ joint.at(a, b)[part, part] @ rotation[b].T)[np.ix_(axes, axes)]
                for b in poses
            ]
            for a in poses
        ]
    )
    return np.trace(covariance) ** 2 / np.sum(covariance**2)


@pytest.mark.parametrize("condition", ["odometry", "no-ranges", "straight"])
def test_degrees_of_freedom_are_those_of_the_joint_covariance(condition):
    fleet = factories.make_fleet(
        seed=2, n_vehicles=3, n_times=16, turn=0.1, gnss_every=15, n_landmarks=1
    )
    o, truth = fleet.noise_free, factories.trajectories(fleet.position, quaternion=fleet.quaternion)
    truth = replace(truth, time=o.time)
    graph = build_graph(o, "straight" if condition == "straight" else None)
    if condition == "odometry":
        graph = factories.without(graph, "fix", "depth")
    freedom = DegreesOfFreedom(truth, o, condition)
    poses = np.arange(48).reshape(3, 16)
    at_pings = [*poses[:, 5], *poses[:, 10]]  # all surface at sample 15
    # random vectors: 48 and 16
    assert freedom.fleet == pytest.approx(exact_freedom(graph, fleet.truth, range(48)), rel=0.3)
    assert freedom.at_pings == pytest.approx(exact_freedom(graph, fleet.truth, at_pings), rel=0.3)
    assert freedom.tilt == pytest.approx(
        exact_freedom(graph, fleet.truth, range(48), [0, 1]), rel=0.3
    )
    assert freedom.heading == pytest.approx(
        exact_freedom(graph, fleet.truth, range(48), [2]), rel=0.3
    )
    own = [exact_freedom(graph, fleet.truth, poses[a]) for a in range(3)]
    np.testing.assert_allclose(freedom.vehicle, own, rtol=0.5)
    of_graph = graph_degrees_of_freedom(graph, fleet.truth)
    np.testing.assert_allclose([of_graph[name] for name in fleet.noise_free.name], own, rtol=0.5)
    assert of_graph["(all)"] == pytest.approx(exact_freedom(graph, fleet.truth, range(48)), rel=0.3)
    assert DegreesOfFreedom(truth, o, condition).fleet == freedom.fleet, "the same in every run"


def test_independent_vehicles_share_random_products(monkeypatch):
    """
    A study spent half a second on products of each vehicle alone, and on drawing the same signs for
    each.
    """
    fleet = factories.make_fleet(
        seed=2, n_vehicles=3, n_times=16, turn=0.1, gnss_every=15, n_landmarks=1
    )
    o, truth = fleet.noise_free, factories.trajectories(fleet.position, quaternion=fleet.quaternion)
    solved, multiply, drawn = [], PoseCovariance.positions, []
    monkeypatch.setattr(
        PoseCovariance, "positions", lambda self, z: solved.append(len(z)) or multiply(self, z)
    )
    monkeypatch.setattr(
        "pymantaray.evaluation.bound.stream", lambda *key: drawn.append(key) or stream(*key)
    )
    alone, together = (
        DegreesOfFreedom(replace(truth, time=o.time), o, name) for name in ("no-ranges", "straight")
    )
    assert alone.vehicle.shape == together.vehicle.shape == (3,)
    assert np.isfinite([alone.fleet, together.fleet]).all()
    # vectors of a vehicle: 16 for all, or for each of three; of a fleet: 48
    assert sum(solved) == (16 + 3 * 16) + 2 * 48
    assert len(drawn) == 2, "once for each object"


def test_the_standard_error_of_an_rmse_is_its_spread_over_studies():
    count = 40
    fleet = factories.make_fleet(seed=2, n_vehicles=2, n_times=16, turn=0.0, gnss_every=15)
    o = fleet.noise_free
    truth = replace(
        factories.trajectories(fleet.position, quaternion=fleet.quaternion), time=o.time
    )
    solved = [solve_conditions(factories.add_noise(o, seed), ["straight"]) for seed in range(count)]
    table = error_table(
        truth,
        collect_estimates(o, solved),
        by=["realization"],
        freedom={"straight": DegreesOfFreedom(truth, o)},
    )
    pooled = error_table(
        truth, collect_estimates(o, solved), freedom={"straight": DegreesOfFreedom(truth, o)}
    )
    spread = table["rmse_m"].std()  # over studies of one realization
    assert spread == pytest.approx(
        table["rmse_standard_error_m"].mean(), rel=4.0 / np.sqrt(2 * count)
    )
    assert pooled["rmse_standard_error_m"].item() == pytest.approx(spread / np.sqrt(count), rel=0.5)
    freedom = {"straight": DegreesOfFreedom(truth, o)}
    each = pd.concat(attitude_table(truth, collect_estimates(o, [s]), freedom) for s in solved)
    for angle in ("tilt", "heading"):
        error = each[f"{angle}_rmse_standard_error_deg"].mean()
        assert each[f"{angle}_rmse_deg"].std() == pytest.approx(error, rel=4.0 / np.sqrt(2 * count))
    # relative errors fall with the root of the degrees of freedom of each angle
    relative = [
        (each[f"{a}_rmse_standard_error_deg"] / each[f"{a}_rmse_deg"]).iloc[0]
        for a in ("tilt", "heading")
    ]
    own = freedom["straight"]
    assert own.tilt > 1.2 * own.heading
    assert relative[0] / relative[1] == pytest.approx(np.sqrt(own.heading / own.tilt), rel=1e-9)
