"""Range errors and dropouts counted by hand on a fleet of four and one landmark."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from pymantaray.errors import EvaluationError
from pymantaray.evaluation import (
    ALL_LINKS,
    dropout_table,
    link_categories,
    range_error_table,
    range_errors,
    range_split_table,
)
from pymantaray.records import Measurements, RangingTruth, RayStatus, Trajectories

ROLES = ["station", "float", "float", "waypoints"]


def make_ranges(transmitter, receiver, status=None, seed=0, n_landmarks=1):
    """Ranges with chord and ray travel times of their own; nothing else matters here."""
    rng = np.random.default_rng(seed)
    n, a = len(transmitter), len(ROLES)
    status = np.full(n, RayStatus.OK) if status is None else np.array(status)
    heard = status == RayStatus.OK
    distance = rng.uniform(500, 12000, n)
    c = rng.uniform(1430, 1500, n)
    chord = distance / rng.uniform(1430, 1500, n)
    time = np.where(heard, chord - rng.exponential(1e-3, n), np.nan)
    o = Measurements(
        name=np.array(list("ABCD")),
        time=np.array([0.0, 200.0]),
        odometry_rotation=np.tile([1.0, 0, 0, 0], (a, 1, 1)),
        odometry_translation=np.zeros((a, 1, 3)),
        odometry_sigma=np.ones((a, 1, 6)),
        depth=np.zeros((a, 2)),
        depth_sigma=np.ones(a),
        gnss_agent=np.empty(0),
        gnss_sample=np.empty(0),
        gnss_position=np.empty((0, 3)),
        gnss_sigma=np.empty(0),
        landmark_name=np.array([f"L{i}" for i in range(n_landmarks)], dtype=str),
        landmark_position=np.zeros((n_landmarks, 3)),
        landmark_sigma=np.ones(n_landmarks),
        first_position=np.zeros((a, 3)),
        first_quaternion=np.tile([1.0, 0, 0, 0], (a, 1)),
        first_sigma=np.ones((a, 6)),
        range_transmitter=np.array(transmitter),
        range_receiver=np.array(receiver),
        range_sample=np.ones(n),
        range_status=status,
        transmitter_sound_speed=c,
        straight_range=distance,
        refracted_range=c * time,
        range_sigma=np.ones(n),
    )
    truth = Trajectories(
        name=o.name,
        role=np.array(ROLES),
        time=o.time,
        position=np.zeros((a, 2, 3)),
        quaternion=np.tile([1.0, 0, 0, 0], (a, 2, 1)),
        status=np.zeros((a, 2)),
    )
    true = RangingTruth(distance=distance, sound_speed=c, travel_time=time, chord_travel_time=chord)
    return o, true, truth


def all_pairs(repeat=1):
    pairs = np.array([(i, j) for i in range(4) for j in range(4) if i != j] * repeat)
    return pairs[:, 0], pairs[:, 1]


def test_split_adds_up_exactly_and_means_what_it_says():
    o, true, _ = make_ranges(*all_pairs(50))
    e = range_errors(true)
    np.testing.assert_allclose(e.reference_speed + e.bending, e.total, rtol=0, atol=1e-9)
    np.testing.assert_allclose(e.total, o.refracted_range - o.straight_range, rtol=0, atol=0)
    # the made-up rays are all faster than their chords
    assert (e.bending <= 0.0).all()
    # a straight ray in a medium of one speed has neither part
    time, speed = true.distance / 1480.0, np.full(true.distance.size, 1480.0)
    plain = RangingTruth(distance=true.distance, sound_speed=speed, travel_time=time, chord_travel_time=time)
    flat = range_errors(plain)
    assert (
        max(np.abs(flat.total).max(), np.abs(flat.bending).max(), np.abs(flat.reference_speed).max()) < 1e-9
    )


def test_category_comes_from_both_ends_in_either_direction():
    o, _true, truth = make_ranges([0, 1, 1, 2, 1, 3, 0, 4, 1], [1, 0, 2, 1, 3, 1, 3, 1, 4])
    assert link_categories(o, truth).tolist() == [
        "station-keeping to float",
        "station-keeping to float",
        "float to float",
        "float to float",
        "float to vehicle",
        "float to vehicle",
        "station-keeping to vehicle",
        "landmark to float",
        "landmark to float",
    ]


def test_dropouts_are_counted_by_kind_and_cause():
    s = RayStatus
    o, _true, truth = make_ranges(
        [0, 1, 0, 2, 1, 2, 1, 2, 1, 2],
        [1, 0, 2, 0, 2, 1, 2, 1, 2, 1],
        [s.SHADOW, s.SHADOW, s.OK, s.BLOCKED, s.OK, s.OK, s.OK, s.WEAK, s.OK, s.OK],
    )
    table = dropout_table(o, truth).set_index("category")
    assert table.index.tolist() == ["station-keeping to float", "float to float", ALL_LINKS]
    assert table["attempts"].tolist() == [4, 6, 10]
    assert table["dropouts"].tolist() == [3, 1, 4]
    assert table["percent"].tolist() == pytest.approx([75.0, 100.0 / 6.0, 40.0])
    assert table["shadow"].tolist() == [2, 0, 2]
    assert table["blocked"].tolist() == [1, 0, 1]
    assert table["weak"].tolist() == [0, 1, 1]
    assert table[["outside", "stopped"]].to_numpy().sum() == 0


def test_statistics_are_those_of_the_heard_links():
    transmitter, receiver = all_pairs(40)
    status = np.where(np.arange(transmitter.size) % 7 == 0, RayStatus.SHADOW, RayStatus.OK)
    o, true, truth = make_ranges(transmitter, receiver, status)
    table = range_error_table(o, true, truth).set_index("category")
    everything, e = table.loc[ALL_LINKS], (o.refracted_range - o.straight_range)[status == RayStatus.OK]
    assert everything["attempts"] == transmitter.size
    assert everything["n"] == e.size < transmitter.size
    assert everything["mean_m"] == pytest.approx(e.mean())
    assert everything["sd_m"] == pytest.approx(np.std(e, ddof=1))
    assert everything["skewness"] == pytest.approx(np.mean((e - e.mean()) ** 3) / np.std(e) ** 3)
    assert everything["excess_kurtosis"] == pytest.approx(np.mean((e - e.mean()) ** 4) / np.std(e) ** 4 - 3.0)
    assert everything["p99_m"] == pytest.approx(stats.scoreatpercentile(e, 99))
    assert (everything["min_m"], everything["max_m"]) == (e.min(), e.max())
    assert everything["percent_beyond_3_sigma"] == pytest.approx(100.0 * np.mean(np.abs(e) > 3.0))
    kinds = table.drop(index=ALL_LINKS)
    assert kinds["n"].sum() == e.size
    assert np.average(kinds["mean_m"], weights=kinds["n"]) == pytest.approx(e.mean())


def test_split_table_has_means_that_add():
    o, true, truth = make_ranges(*all_pairs(40))
    table = range_split_table(o, true, truth).set_index(["category", "part"])["mean_m"].unstack()
    np.testing.assert_allclose(table["reference speed"] + table["bending"], table["total"], rtol=0, atol=1e-9)
    assert set(table.index) == {*link_categories(o, truth).tolist(), ALL_LINKS}


def test_link_that_was_never_heard_has_no_statistics_but_a_row():
    o, true, truth = make_ranges([0, 1], [1, 2], [RayStatus.SHADOW, RayStatus.OK])
    row = range_error_table(o, true, truth).set_index("category").loc["station-keeping to float"]
    assert (row["attempts"], row["n"]) == (1, 0)
    assert row[["mean_m", "sd_m", "skewness", "p1_m", "min_m", "percent_beyond_3_sigma"]].isna().all()
    empty, true, truth = make_ranges([], [])
    assert dropout_table(empty, truth)["attempts"].tolist() == [0]


def test_records_of_different_fleets_are_refused():
    o, _, truth = make_ranges(*all_pairs())
    with pytest.raises(EvaluationError, match="measurements of vehicles"):
        dropout_table(o, replace(truth, name=np.array(["W", "X", "Y", "Z"])))
