"""Which measurements enter the graph, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from pymantaray.errors import EstimationError
from pymantaray.estimation import build_graph
from pymantaray.estimation.graph import check_anchored, check_graph
from pymantaray.records import RayStatus


def test_straight_and_refracted_use_exactly_the_links_that_were_heard(fleet):
    straight, refracted = (build_graph(fleet.noisy, r) for r in ("straight", "refracted"))
    heard = fleet.noisy.range_status == RayStatus.OK
    assert 0 < np.count_nonzero(heard) < heard.size
    np.testing.assert_array_equal(straight.range_first, refracted.range_first)
    np.testing.assert_array_equal(straight.range_second, refracted.range_second)
    np.testing.assert_array_equal(straight.range_distance, fleet.noisy.straight_range[heard])
    np.testing.assert_array_equal(refracted.range_distance, fleet.noisy.refracted_range[heard])


def test_all_links_include_dropouts_but_no_silent_vehicle(fleet):
    status = np.array(fleet.noisy.range_status)
    status[:4] = RayStatus.STOPPED
    graph = build_graph(replace(fleet.noisy, range_status=status), "straight", "all")
    assert graph.range_first.size == status.size - 4


def test_variables_are_numbered_vehicle_by_vehicle_and_landmarks_last(make_fleet):
    fleet = make_fleet(n_agents=2, n_times=12, n_landmarks=2)
    graph = build_graph(fleet.noisy, "straight")
    assert [graph.variable_name(v) for v in (0, 11, 12, 24, 25)] == ["A0", "A11", "B0", "L0", "L1"]
    o = fleet.noisy
    distance = {}
    for first, second, d in zip(graph.range_first, graph.range_second, graph.range_distance, strict=True):
        assert first < graph.n_poses  # the file format wants a pose first
        distance.setdefault(frozenset([graph.variable_name(first), graph.variable_name(second)]), []).append(
            d
        )
    at_five = [
        d
        for i, j, k, d in zip(
            o.range_transmitter, o.range_receiver, o.range_sample, o.straight_range, strict=True
        )
        if k == 5 and {i, j} == {1, 3}
    ]
    assert sorted(distance[frozenset(["B5", "L1"])]) == sorted(at_five)
    assert len(at_five) == 2  # there and back


def test_degrees_of_freedom_count_residual_rows_minus_unknowns(make_fleet):
    fleet = make_fleet(n_agents=2, n_times=6, n_landmarks=1, gnss_every=3)
    graph = build_graph(fleet.noisy, "straight")
    # 2 first-pose priors and 10 edges of 6 rows, 4 fixes and 1 survey of 3, 12 depths, 6 ranges at sample 5
    assert graph.degrees_of_freedom == 12 * 6 + 5 * 3 + 12 + 6 - (12 * 6 + 3)


def nan_at(array, index):
    out = np.array(array, dtype=float)
    out[index] = np.nan
    return out


def zero_at(array, index):
    out = np.array(array, dtype=float)
    out[index] = 0.0
    return out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda o: {"odometry_translation": nan_at(o.odometry_translation, (1, 4, 2))},
            "^B5: odometry is .*nan",
        ),
        (lambda o: {"odometry_sigma": zero_at(o.odometry_sigma, (2, 0, 0))}, "^C1: odometry sigma is .0,"),
        (
            lambda o: {"odometry_sigma": -np.array(o.odometry_sigma)},
            "^A1: odometry sigma is .*positive finite",
        ),
        (lambda o: {"depth": nan_at(o.depth, (0, 7))}, "^A7: depth is .nan."),
        (lambda o: {"depth_sigma": zero_at(o.depth_sigma, 1)}, "^B0: depth sigma is .0."),
        (lambda o: {"gnss_position": nan_at(o.gnss_position, (1, 0))}, "^A10: GNSS fix is .nan,"),
        (lambda o: {"range_sigma": zero_at(o.range_sigma, slice(None))}, "^[ABC]5: range sigma is .0."),
        (lambda o: {"refracted_range": nan_at(o.refracted_range, slice(None))}, "^[ABC]5: range is .nan."),
        (lambda o: {"first_quaternion": nan_at(o.first_quaternion, 1)}, "^B0: first-pose prior is .nan"),
        (lambda o: {"range_sample": o.range_sample + 10000}, "^range: refers to variable"),
        (lambda o: {"range_receiver": o.range_transmitter}, "^A5: range is .5..*two different variables"),
    ],
)
def test_unusable_measurements_are_refused_by_name(fleet, change, message):
    with pytest.raises(EstimationError, match=message) as caught:
        build_graph(replace(fleet.noisy, **change(fleet.noisy)), "refracted")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("ranges", "links", "message"),
    [
        ("refracted", "all", "a dropout has none"),
        ("curved", "all", "allowed are"),
        (None, "some", "allowed are"),
    ],
)
def test_contradictory_conditions_are_refused(fleet, ranges, links, message):
    with pytest.raises(EstimationError, match=message):
        build_graph(fleet.noisy, ranges, links)


def without_first_pose(o, agent):
    return {
        name: nan_at(getattr(o, name), agent)
        for name in ("first_position", "first_quaternion", "first_sigma")
    }


def test_vehicle_that_nothing_ties_to_the_world_is_refused_by_name(make_fleet):
    o = make_fleet(n_agents=2).noisy
    floating = replace(o, **without_first_pose(o, 1))
    with pytest.raises(EstimationError, match=r"^B0: no first-pose prior, GNSS fix or landmark prior"):
        build_graph(floating)
    assert build_graph(floating, "straight").prior_pose.tolist() == [0]  # ranges tie it to vehicle A


def test_fix_or_landmark_is_anchor_enough(make_fleet):
    fixed = make_fleet(n_agents=1, gnss_every=10).noisy
    assert build_graph(replace(fixed, **without_first_pose(fixed, 0))).prior_pose.size == 0
    ranged = make_fleet(n_agents=1, n_landmarks=3).noisy
    graph = build_graph(replace(ranged, **without_first_pose(ranged, 0)), "straight")
    check_anchored(graph)
    assert graph.fix_pose.size == 0


def test_covariances_that_are_not_positive_definite_are_refused(fleet):
    graph = build_graph(fleet.noisy)
    covariance = np.array(graph.edge_covariance)
    covariance[7, 0, 1] = covariance[7, 1, 0] = 2 * covariance[7, 0, 0]
    with pytest.raises(EstimationError, match=r"^A8: odometry covariance's eigenvalues"):
        check_graph(replace(graph, edge_covariance=covariance))
