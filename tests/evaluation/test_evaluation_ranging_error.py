"""Range errors and dropouts counted by hand on a fleet of four and one landmark."""

from dataclasses import replace

import numpy as np
import pytest
from factories import ranges, trajectories
from scipy import stats

from pymantaray.errors import EvaluationError
from pymantaray.evaluation import ALL_LINKS, dropout_table, range_error_table, range_errors
from pymantaray.evaluation.ranging_error import link_categories
from pymantaray.records import RangingTruth, RayStatus

ROLES = ["station", "float", "float", "waypoints"]


def make_ranges(transmitter, receiver, status=None, seed=0):
    """A fleet of four at random places, and ranges among it and to one landmark."""
    rng = np.random.default_rng(seed)
    truth = trajectories(rng.uniform(-6e3, 6e3, (4, 2, 3)), roles=ROLES)
    attempts = [(i, j, 1) for i, j in zip(transmitter, receiver, strict=True)]
    return *ranges(truth, rng, attempts, status=status, landmarks=[(0, 0, 900)]), truth


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
    plain = RangingTruth(
        distance=true.distance, sound_speed=speed, travel_time=time, chord_travel_time=time
    )
    flat = range_errors(plain)
    assert np.abs([flat.total, flat.bending, flat.reference_speed]).max() < 1e-9


def test_category_comes_from_both_ends_in_either_direction():
    o, _, truth = make_ranges([0, 1, 1, 2, 1, 3, 0, 4, 1], [1, 0, 2, 1, 3, 1, 3, 1, 4])
    kinds = [
        "station-keeping to float",
        "float to float",
        "float to vehicle",
        "station-keeping to vehicle",
    ]
    expected = [*np.repeat(kinds, [2, 2, 2, 1]), "landmark to float", "landmark to float"]
    assert link_categories(o, truth).tolist() == expected


def test_dropouts_are_counted_by_kind_and_cause():
    s = RayStatus
    o, _, truth = make_ranges(
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
    everything, e = (
        table.loc[ALL_LINKS],
        (o.refracted_range - o.straight_range)[status == RayStatus.OK],
    )
    assert everything["attempts"] == transmitter.size
    assert everything["n"] == e.size < transmitter.size
    assert everything["mean_m"] == pytest.approx(e.mean())
    assert everything["sd_m"] == pytest.approx(np.std(e, ddof=1))
    assert everything["skewness"] == pytest.approx(np.mean((e - e.mean()) ** 3) / np.std(e) ** 3)
    assert everything["excess_kurtosis"] == pytest.approx(
        np.mean((e - e.mean()) ** 4) / np.std(e) ** 4 - 3.0
    )
    assert everything["p99_m"] == pytest.approx(stats.scoreatpercentile(e, 99))
    assert (everything["min_m"], everything["max_m"]) == (e.min(), e.max())
    assert everything["percent_beyond_3_sigma"] == pytest.approx(100.0 * np.mean(np.abs(e) > 3.0))
    kinds = table.drop(index=ALL_LINKS)
    assert kinds["n"].sum() == e.size
    assert np.average(kinds["mean_m"], weights=kinds["n"]) == pytest.approx(e.mean())


def test_link_that_was_never_heard_has_no_statistics_but_a_row():
    o, true, truth = make_ranges([0, 1], [1, 2], [RayStatus.SHADOW, RayStatus.OK])
    row = range_error_table(o, true, truth).set_index("category").loc["station-keeping to float"]
    assert (row["attempts"], row["n"]) == (1, 0)
    assert (
        row[["mean_m", "sd_m", "skewness", "p1_m", "min_m", "percent_beyond_3_sigma"]].isna().all()
    )
    empty, true, truth = make_ranges([], [])
    assert dropout_table(empty, truth)["attempts"].tolist() == [0]


def test_records_of_different_fleets_are_refused():
    o, _, truth = make_ranges(*all_pairs())
    with pytest.raises(EvaluationError, match="measurements of vehicles"):
        dropout_table(o, replace(truth, name=np.array(["W", "X", "Y", "Z"])))
