"""
The estimator on board against the batch solver, in any order of arrival, after a restart, and with
invalid input.
"""

import copy
import json
import math
from dataclasses import replace

import factories
import numpy as np
import pytest
from onboard import BEACONS, SPEED, START, STEP_SIGMA, feed, fleet_calls, fleet_estimator, mission
from refusals import refused

from pymantaray.acoustics import Medium
from pymantaray.apps.online import Beacon, OnlineEstimator, Outcome, StartPose
from pymantaray.apps.online.range_model import TableModel
from pymantaray.apps.online.saved_state import _checksum, _fault, read_state, write_state
from pymantaray.errors import OnlineError
from pymantaray.estimation import (
    GraphSolver,
    MeanSlowness,
    Method,
    SolveOptions,
    TransmitterSpeed,
    build_graph,
    dead_reckon,
)
from pymantaray.estimation.ranges.range_models import RangeEndpoints
from pymantaray.geometry.se3 import se3_exp, so3_log
from pymantaray.records import RayStatus


def new(**options):
    return OnlineEstimator(START, BEACONS, SPEED, **options)


def assert_same_pose(one, other):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_last_pose_is_that_of_the_batch_if_all_is_nearly_linear(as_stored):
    fleet = factories.make_fleet(seed=4, gnss_every=8, n_landmarks=2, n_vehicles=2)
    o = fleet.noise_free
    sigmas = (
        "odometry_sigma",
        "first_sigma",
        "depth_sigma",
        "gnss_sigma",
        "range_sigma",
        "landmark_sigma",
    )
    o = factories.add_noise(replace(o, **{name: 1e-3 * getattr(o, name) for name in sigmas}), 5)
    poses = np.arange(o.depth.size).reshape(o.depth.shape)[:, -1:].T
    start = factories.values_at(o, *dead_reckon(o))
    batch = GraphSolver(SolveOptions(step_tolerance=1e-9)).solve(
        build_graph(o, "straight"), start, covariance_poses=poses
    )
    estimator = fleet_estimator(o, TransmitterSpeed(), lag=1e4, gate=math.inf)
    feed(estimator, fleet_calls(o, "straight_range"))
    assert estimator.counts()["used"] == o.depth.size + o.gnss_vehicle.size + o.range_sample.size
    for v, name in enumerate(estimator.vehicles):
        sigma = np.sqrt(np.diag(batch.covariances.position[0, v, :, v]))
        off = estimator.position(vehicle=name) - batch.position[poses[0, v]]
        assert (np.abs(off) < 0.02 * sigma).all(), off / sigma
        np.testing.assert_allclose(
            estimator.covariance(vehicle=name),
            batch.covariances.position[0, v, :, v],
            rtol=0,
            atol=5e-3 * sigma.max() ** 2,
        )
    as_stored([estimator.pose(vehicle=name) for name in estimator.vehicles])


def test_the_filter_of_a_graph_is_this_one_fed_in_order():
    fleet = factories.make_fleet(seed=4, n_landmarks=1, n_vehicles=1)
    # one measurement of a sort at a time: a graph's filter linearizes those of a time together
    own = fleet.noisy.range_transmitter == 0
    status = np.where(own, RayStatus.SHADOW, fleet.noisy.range_status)
    measurements = replace(fleet.noisy, range_status=status)
    last = np.array([[measurements.time.size - 1]])
    graph = build_graph(measurements, "straight")
    offline = GraphSolver().solve(
        graph, fleet.truth, method=Method(kalman=True), covariance_poses=last
    )
    estimator = fleet_estimator(measurements, TransmitterSpeed(), lag=1e4, gate=math.inf)
    feed(estimator, fleet_calls(measurements, "straight_range"))
    pose = estimator.pose()
    np.testing.assert_allclose(pose.position, offline.position[-1], rtol=0, atol=1e-8)
    np.testing.assert_allclose(pose.quaternion, offline.quaternion[-1], rtol=0, atol=1e-11)
    np.testing.assert_allclose(
        pose.covariance[3:, 3:], offline.covariances.position[0, 0, :, 0], rtol=1e-9, atol=1e-9
    )


def test_ranges_reduce_the_error_and_the_covariance_covers_it(as_stored):
    calls, truth = mission()
    with_ranges, without = new(gate=math.inf), new(gate=math.inf)
    feed(with_ranges, calls)
    feed(without, [call for call in calls if call[0] != "range"])
    end = max(truth)
    sigma = np.sqrt(np.diag(with_ranges.covariance()))
    assert np.linalg.norm(sigma) < 0.5 * np.sqrt(np.trace(without.covariance()))
    assert (np.abs(with_ranges.position() - truth[end]) < 4.0 * sigma).all()
    as_stored(
        {"with": with_ranges.pose(), "without": without.pose(52.3), "n": with_ranges.counts()}
    )


@pytest.mark.parametrize("delay", [2.0, 25.0])
def test_the_order_of_arrival_does_not_change_a_digit(delay):
    calls, _ = mission(35.0)
    rng = np.random.default_rng(5)
    arrival = [arguments[0] + delay * rng.random() for _, arguments, _ in calls]
    in_order, late = new(lag=40.0), new(lag=40.0)
    feed(in_order, calls)
    outcomes = feed(late, [calls[k] for k in np.argsort(arrival)])
    assert Outcome.TOO_LATE not in outcomes
    assert Outcome.WAITING in outcomes, "some measurements arrive before their odometry"
    assert late.counts() == in_order.counts()
    for time in (12.0, 20.05, None):
        assert_same_pose(in_order.pose(time), late.pose(time))


def test_a_pose_within_a_step_is_that_of_two_half_steps(as_stored):
    twist, sigma = np.array([0.1, -0.2, 0.4, 1.5, 0.3, -0.2]), np.full(6, 1e-3)
    whole, halves = new(), new()
    for estimator, n in ((whole, 1), (halves, 2)):
        turn, way = se3_exp(twist / n)
        for k in range(n):
            estimator.add_odometry((k + 1) / n, way, so3_log(turn), sigma / np.sqrt(n))
        assert estimator.add_depth(0.5, 50.2, 0.1) == Outcome.USED
    for time in (0.5, 1.0):
        for one, other in zip(whole.pose(time), halves.pose(time), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    assert not np.allclose(whole.position(0.25), whole.position(0.5))
    as_stored([whole.pose(0.5), halves.pose(0.75)])


def test_a_restored_estimator_continues_with_the_same_digits(tmp_path, as_stored):
    calls, _ = mission(50.0)
    file = tmp_path / "state.json"
    whole, first = new(lag=10.0), new(lag=10.0)
    half = len(calls) // 2 + 3
    feed(whole, calls)
    early = ("range", (calls[half][1][0] + 0.3, "north", 0.6, 2e-4), {})
    feed(first, calls[:half])
    first.save(file)
    as_stored(read_state(file))
    second = OnlineEstimator.restore(file, SPEED)
    assert_same_pose(first.pose(), second.pose())
    assert second.counts() == first.counts()
    for estimator in (first, second):
        feed(estimator, [early, *calls[half:]])
    assert_same_pose(first.pose(), second.pose())
    third = OnlineEstimator.restore(file, SPEED)
    feed(third, calls[half:])
    assert_same_pose(third.pose(), whole.pose())
    assert_same_pose(third.pose(45.033), whole.pose(45.033))
    assert third.counts() == whole.counts()
    assert [path.name for path in tmp_path.iterdir()] == ["state.json"]


def test_memory_does_not_grow_with_the_mission(tmp_path):
    calls, _ = mission(100.0)
    estimator, sizes = new(lag=5.0), []
    for k in range(0, len(calls), 250):
        feed(estimator, calls[k : k + 250])
        estimator.save(tmp_path / "state.json")
        sizes.append((tmp_path / "state.json").stat().st_size)
    assert max(sizes[1:]) < 1.2 * min(sizes[1:]), sizes
    with_history = vars(estimator._timeline)
    assert all(len(with_history[name]) < 80 for name in ("events", "waiting", "_states"))


def test_a_later_arrival_is_gated_and_leaves_the_pose_as_it_is():
    calls, _ = mission()
    plain, gated = new(), new()
    feed(plain, calls)
    feed(gated, calls)
    found = gated.add_range(59.0, "north", 0.75, 2e-4)
    assert found == Outcome.GATED
    np.testing.assert_allclose(gated.position(), plain.position(), rtol=0, atol=1e-6)
    assert gated.counts()["gated"] == plain.counts()["gated"] + 1
    wide = new(gate=math.inf)
    feed(wide, calls)
    assert wide.add_range(59.0, "north", 0.75, 2e-4) == Outcome.USED


def test_measurements_wait_for_odometry_repeat_or_are_too_late():
    estimator = new(lag=10.0)
    step = ((1.5, 0.0, 0.0), (0.0, 0.0, 0.0), STEP_SIGMA)
    assert estimator.add_depth(0.5, 50.0, 0.1) == Outcome.WAITING
    assert estimator.add_depth(0.5, 50.0, 0.1) == Outcome.DUPLICATE
    assert estimator.add_odometry(1.0, *step) == Outcome.USED
    assert estimator.counts()["used"] == 1
    assert estimator.add_odometry(1.0, *step) == Outcome.DUPLICATE
    for k in range(2, 31):
        estimator.add_odometry(float(k), *step)
    assert estimator.add_depth(19.9, 50.0, 0.1) == Outcome.TOO_LATE
    assert estimator.add_odometry(5.5, *step) == Outcome.TOO_LATE
    assert estimator.add_depth(20.0, 50.0, 0.1) == Outcome.USED
    counts = estimator.counts()
    assert (counts["too_late"], counts["duplicate"], counts["waiting"]) == (1, 1, 0)


@pytest.mark.slow
def test_a_table_has_the_derivatives_of_finite_differences(table):
    model = TableModel(table)
    transmitter = np.array([[0.0, 0.0, 60.0], [100.0, -50.0, 20.0]])
    receiver = np.array([[900.0, 400.0, 150.0], [-600.0, 500.0, 90.0]])
    links = RangeEndpoints(np.zeros(2), transmitter, receiver, np.zeros(2))
    prediction = model.predict(links)
    assert prediction.possible.all()
    for name, gradient in (
        ("transmitter", prediction.transmitter_gradient),
        ("receiver", prediction.receiver_gradient),
    ):
        for axis in range(3):
            push = np.zeros(3)
            push[axis] = 0.01
            ahead, back = (
                model.predict(
                    links._replace(**{name: getattr(links, name) + sign * push})
                ).travel_time
                for sign in (1.0, -1.0)
            )
            np.testing.assert_allclose(gradient[:, axis], (ahead - back) / 0.02, rtol=0, atol=2e-7)
    far = links._replace(receiver=receiver + np.array([1e5, 0.0, 0.0]))
    assert not model.predict(far).possible.any()


def test_a_table_and_eigenrays_give_the_same_position(table, water, as_stored):
    calls, _ = mission()
    medium, _ = water.at_start
    assert isinstance(medium, Medium)
    by_table, by_rays = (
        OnlineEstimator(START, BEACONS, ranges, gate=math.inf) for ranges in (table, medium)
    )
    for estimator in (by_table, by_rays):
        assert Outcome.NO_ARRIVAL not in feed(estimator, calls[:200])
    np.testing.assert_allclose(by_table.position(), by_rays.position(), rtol=0, atol=0.3)
    far = OnlineEstimator(START, {"far": Beacon((1e5, 0.0, 50.0))}, table)
    assert far.add_range(0.0, "far", 66.0, 1e-3) == Outcome.NO_ARRIVAL
    assert far._timeline.range_residuals() == []
    as_stored([by_table.pose(), by_rays.pose()])


def test_invalid_input_gives_one_line():
    estimator = new(lag=10.0)
    feed(estimator, mission(30.0)[0])
    refused(OnlineError, "before the lag, which begins at 20 s", estimator.position, 5.0)
    refused(OnlineError, "after the last odometry of vehicle at 30 s", estimator.position, 31.0)
    refused(
        OnlineError,
        "'west': unknown; allowed: north, east|'west': unknown; allowed: east, north",
        estimator.add_range,
        29.0,
        "west",
        0.5,
        1e-3,
    )
    refused(
        OnlineError,
        "'X' is unknown; allowed: vehicle",
        estimator.add_depth,
        29.0,
        5.0,
        0.1,
        vehicle="X",
    )
    refused(OnlineError, "depth of vehicle", estimator.add_depth, 29.0, math.nan, 0.1)
    refused(OnlineError, "time is nan", estimator.add_depth, math.nan, 5.0, 0.1)
    refused(OnlineError, "time is -10000000000000.0; it must", estimator.add_depth, -1e13, 5.0, 0.1)
    refused(OnlineError, "sigma is 0; it must be positive", estimator.add_depth, 29.0, 5.0, 0.0)
    for sigma in (np.ones(2), [0.1, [0.2], 0.3], [0.1, 0.2]):
        refused(OnlineError, "fix of vehicle: sigma", estimator.add_fix, 29.0, [0, 0, 0], sigma)
    refused(OnlineError, "travel time is nan s", estimator.add_range, 29.0, "east", math.nan, 1e-3)
    refused(OnlineError, "more than the lag", estimator.add_depth, 1e9, 5.0, 0.1)
    refused(
        OnlineError,
        "another step ends at 30 s",
        estimator.add_odometry,
        30.0,
        [1, 0, 0],
        [0, 0, 0],
        STEP_SIGMA,
    )
    refused(
        OnlineError,
        "translation: 1 of 3",
        estimator.add_odometry,
        31.0,
        [math.nan, 0, 0],
        [0, 0, 0],
        STEP_SIGMA,
    )
    refused(OnlineError, "lag is 0 s", new, lag=0.0)
    refused(OnlineError, "longest_step is 0 s", new, longest_step=0.0)
    refused(OnlineError, "gate is 0", new, gate=0.0)
    refused(OnlineError, "names must differ", OnlineEstimator, {"north": START}, BEACONS, SPEED)
    wrong = {"far": Beacon((0.0, 0.0, 50.0), sigma=-1.0)}
    refused(OnlineError, "sigma of beacon far is -1", OnlineEstimator, START, wrong, SPEED)
    refused(OnlineError, "vehicles: found none", OnlineEstimator, {}, BEACONS, SPEED)
    refused(
        OnlineError,
        "missing; allowed: A, B",
        OnlineEstimator({"A": START, "B": START}, {}, SPEED).position,
    )
    by_transmitter = OnlineEstimator(START, BEACONS, TransmitterSpeed())
    refused(OnlineError, "needs one", by_transmitter.add_range, 0.0, "east", 0.5, 1e-3)
    refused(OnlineError, "found str; it must be", OnlineEstimator, START, BEACONS, "1500")


def test_a_state_of_numbers_of_numpy_can_be_saved(tmp_path):
    one, small = np.int64(1), np.float32(0.5)
    estimator = new(start=one, lag=10 * one, longest_step=60 * one, gate=8 * small)
    step = (np.ones(3, dtype=np.int64), np.zeros(3, dtype=np.float32), 0.01 * small)
    assert estimator.add_odometry(2 * one, *step) == Outcome.USED
    assert estimator.add_depth(2 * one, 50 * one, one) == Outcome.USED
    assert estimator.add_range(one, "north", one, one) == Outcome.USED
    assert estimator.add_range(3 * one, "north", one, small, sound_speed=1450 * one).name
    estimator.save(tmp_path / "state.json")
    restored = OnlineEstimator.restore(tmp_path / "state.json", np.float32(SPEED))
    assert_same_pose(restored.pose(2 * one), estimator.pose(2.0))


def test_a_damaged_or_foreign_file_is_refused_in_one_line(tmp_path):
    file = tmp_path / "state.json"
    estimator = new()
    estimator.save(file)
    refused(OnlineError, "no such file", OnlineEstimator.restore, tmp_path / "none.json", SPEED)
    profile = MeanSlowness([0.0, 100.0], [1500.0, 1501.0])
    refused(
        OnlineError,
        "saved with the range model ConstantSpeed",
        OnlineEstimator.restore,
        file,
        profile,
    )
    head, content = file.read_text().splitlines()
    file.write_text(f"{head}\n{content.replace('50.0', '51.0', 1)}\n")
    refused(OnlineError, "checksum", OnlineEstimator.restore, file, SPEED)
    file.write_text(json.dumps({**json.loads(head), "format": 9}) + f"\n{content}\n")
    refused(
        OnlineError,
        "format 9; this version of pymantaray reads",
        OnlineEstimator.restore,
        file,
        SPEED,
    )
    file.write_text("hello")
    refused(OnlineError, "not a saved estimator", OnlineEstimator.restore, file, SPEED)
    deep = "[" * 100_000
    file.write_text(deep)
    refused(OnlineError, "not a saved estimator", OnlineEstimator.restore, file, SPEED)
    for text in ('{"lag": ', deep):
        changed = json.dumps({**json.loads(head), "sha256": _checksum(text)})
        file.write_text(f"{changed}\n{text}\n")
        refused(OnlineError, "not a usable state: ", OnlineEstimator.restore, file, SPEED)


@pytest.mark.parametrize(("name", "value"), [
    ("lag", 0.0), ("gate", -1.0), ("longest_step", "10"), ("horizon", math.inf), ("lag", None),
])  # fmt: skip
def test_a_saved_number_that_is_none_is_refused(tmp_path, name, value):
    file = tmp_path / "state.json"
    new().save(file)
    written = json.loads(file.read_text().splitlines()[1])
    content = {**written, name: value}
    assert not _fault(written)
    assert _fault(content) == f"{name} is {value!r}"


@pytest.mark.parametrize("names", [[], ["vehicle", "vehicle"], [1]])
def test_saved_vehicles_need_different_texts_as_names(tmp_path, names):
    file = tmp_path / "state.json"
    new().save(file)
    fault = _fault({**read_state(file), "vehicles": names})
    assert fault == "the names of vehicles and beacons are not different texts"


def test_one_wrong_stamp_or_size_is_refused_and_what_follows_is_used():
    estimator = new(lag=10.0)
    for k in range(1, 6):
        assert estimator.add_odometry(float(k), [1, 0, 0], [0, 0, 0], STEP_SIGMA).name == "USED"
    before = estimator.pose()
    for time in (1e9, 605.1, 1e300, math.nan):
        with pytest.raises(OnlineError, match="odometry of vehicle: time"):
            estimator.add_odometry(time, [1, 0, 0], [0, 0, 0], STEP_SIGMA)
    huge = (
        ([1e200, 0, 0], [0, 0, 0], STEP_SIGMA),
        ([1, 0, 0], [0, 1e200, 0], STEP_SIGMA),
        ([1, 0, 0], [0, 0, 0], 1e160),
    )
    for step in huge:
        with pytest.raises(OnlineError, match=r"allowed are magnitudes up to 1e\+09"):
            estimator.add_odometry(6.0, *step)
    others = {
        "depth": lambda: estimator.add_depth(5.0, 1e200, 1.0),
        "sigma of a depth": lambda: estimator.add_depth(5.0, 1.0, 1e170),
        "fix": lambda: estimator.add_fix(5.0, [0, -1e200, 0], 1.0),
        "travel time": lambda: estimator.add_range(5.0, "north", 1e200, 1e-3),
        "start": lambda: OnlineEstimator(StartPose((1e200, 0, 0)), {}, SPEED),
        "beacon": lambda: OnlineEstimator(START, {"B": Beacon((0, 0, 0), 1e200)}, SPEED),
    }
    for add in others.values():
        with pytest.raises(OnlineError, match=r"allowed are magnitudes up to 1e\+09"):
            add()
    assert_same_pose(estimator.pose(), before)
    assert estimator.add_odometry(6.0, [1, 0, 0], [0, 0, 0], STEP_SIGMA).name == "USED"
    assert np.isfinite(estimator.pose().covariance).all()


def test_steps_may_be_as_long_as_is_said():
    estimator = new(lag=10.0, longest_step=1e5)
    assert estimator.add_odometry(9e4, [1, 0, 0], [0, 0, 0], STEP_SIGMA).name == "USED"


@pytest.mark.parametrize(
    ("name", "factor", "fault"),
    [
        ("rotation", 1e300, "is no rotation"),
        ("rotation", -1e300, "is no rotation"),
        ("rotation", 0.0, "is no rotation"),
        ("position", 1e300, "beyond 1e.09 m"),
        ("covariance", -1.0, "not positive semidefinite"),
        ("covariance", 1e300, "too large"),
        ("covariance", -1e300, "too large"),
    ],
)
def test_a_state_with_impossible_numbers_is_refused(tmp_path, name, factor, fault):
    file = tmp_path / "state.json"
    estimator = new()
    estimator.add_odometry(1.0, [1, 0, 0], [0, 0, 0], STEP_SIGMA)
    estimator.save(file)
    content = read_state(file)
    content["base"][name] = (factor * np.array(content["base"][name])).tolist()
    write_state(content, file)
    refused(OnlineError, fault, OnlineEstimator.restore, file, SPEED)


def test_a_state_with_a_member_far_away_is_refused(tmp_path):
    file = tmp_path / "state.json"
    new().save(file)
    content = read_state(file)
    content["fixed"][0][2] = -2e9
    write_state(content, file)
    fault = "fixed is not finite, or beyond 1e.09 m"
    refused(OnlineError, fault, OnlineEstimator.restore, file, SPEED)
    content["fixed"][0][2], content["base"]["position"][0] = 0.0, [0.0, 0.0, -2e9]
    write_state(content, file)
    fault = "base.position is beyond 1e.09 m"
    refused(OnlineError, fault, OnlineEstimator.restore, file, SPEED)


@pytest.mark.parametrize(("event", "fault"), [
    ([1.0, 1, [True], [50.0, 1.0]], "event [1.0, 1, [True], [50.0, 1.0]]"),
    ([1.0, 1, [-1], [50.0, 1.0]], "event [1.0, 1, [-1], [50.0, 1.0]]"),
    ([1.0, 3, [7, 0], [0.5, 1.0, 0.0]], "event [1.0, 3, [7, 0], [0.5, 1.0, 0.0]]"),
    ([-1.0, 1, [0], [50.0, 1.0]], "event [-1.0, 1, [0], [50.0, 1.0]] is before the horizon"),
])  # fmt: skip
def test_a_saved_event_of_no_member_or_too_early_is_named(tmp_path, event, fault):
    file = tmp_path / "state.json"
    new().save(file)
    assert _fault({**read_state(file), "events": [event]}) == fault


@pytest.mark.parametrize("path", [("base", "position"), ("base", "time"), ("fixed",), ("events",)])
def test_a_state_with_texts_for_numbers_is_refused(tmp_path, path):
    file = tmp_path / "state.json"
    estimator = new()
    estimator.add_odometry(1.0, [1, 0, 0], [0, 0, 0], STEP_SIGMA)
    estimator.save(file)
    content = read_state(file)
    *before, last = path
    inside = content[before[0]] if before else content
    if last == "events":
        *_, values = inside[last][0]
        values[0] = str(values[0])
    else:
        inside[last] = np.array(inside[last]).astype(str).tolist()
    write_state(content, file)
    refused(OnlineError, "is no array of numbers", OnlineEstimator.restore, file, SPEED)


def test_a_state_with_a_wrong_field_is_refused_in_one_line(tmp_path):
    file = tmp_path / "state.json"
    estimator = new()
    estimator.add_odometry(1.0, [1, 0, 0], [0, 0, 0], STEP_SIGMA)
    estimator.add_depth(1.0, 50.0, 1.0)
    estimator.add_depth(5.0, 50.0, 1.0)
    estimator.save(file)
    whole = read_state(file)
    wrong = [None, "x", "60", -1, 1e400, [], {}, [[[]]], [None], {"a": 1}, True, 10**400]
    paths = [(key,) for key in whole] + [("base", key) for key in whole["base"]]
    paths += [("events", 0, k) for k in range(4)] + [("waiting", 0, k) for k in range(4)]
    lines = []
    for path in paths:
        for value in [*wrong, KeyError]:
            content = copy.deepcopy(whole)
            node = content
            for part in path[:-1]:
                node = node[part]
            if value is KeyError and isinstance(node, dict):
                del node[path[-1]]
            elif value is KeyError:
                continue
            else:
                node[path[-1]] = value
            write_state(content, file)
            try:
                again = OnlineEstimator.restore(file, SPEED)
            except OnlineError as error:
                lines.append(str(error))
                continue
            # what is accepted can be used
            assert np.isfinite(again.pose(vehicle=again.vehicles[0]).covariance).all(), (
                path,
                value,
            )
            again.counts()
    assert len(lines) > 150
    assert not any("\n" in line for line in lines)


@pytest.mark.parametrize("gate", [4.0, math.inf])
@pytest.mark.parametrize(("error", "words"), [(0.0, None), (1.0, "of what was measured")])
def test_an_estimate_that_explains_no_range_says_so(gate, error, words):
    start = StartPose((0.0, 0.0, 50.0))
    estimator = OnlineEstimator(start, {"B": Beacon((1000.0, 0.0, 50.0))}, 1500.0, gate=gate)
    for k in range(1, 61):
        step = (0.15, 0.0, 0.0), (0.0, 0.0, 0.0), [1e-5] * 3 + [0.01] * 3
        estimator.add_odometry(0.1 * k, *step)
        if k % 10 == 0:
            assert estimator.unexplained() is None or k > 30
            wrong = error * (k % 20 == 0) + error * (k % 30 == 0)
            travel_time = (1000.0 - 0.15 * k) / 1500.0 + wrong
            estimator.add_range(0.1 * k, "B", travel_time, 1e-3)
    why = estimator.unexplained()
    assert why is None if words is None else words in why
    _, times, sigmas = np.transpose(estimator._timeline.range_residuals())
    assert (times.size, set(sigmas)) == (6, {1e-3})
