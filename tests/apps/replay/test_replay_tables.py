"""
Laws of the tables: clocks by least squares and their gauge, reciprocity, switching, groups and
their intervals.
"""

import itertools

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from pymantaray.apps.replay.clocks import clock_table, reciprocity_table
from pymantaray.apps.replay.summary import percentiles, summary_table
from pymantaray.apps.replay.switching import fit_clocks, switching_table, taken_candidates

OFFSET = {"A": 2e-3, "B": -3e-3, "C": 0.5e-3, "D": 0.5e-3}


def events_of(ways, m, *, step=45.0, offset=OFFSET, sigma=0.0, shared=0.0, seed=0, **columns):
    """
    Events of ordered pairs, m each, whose residuals are clocks, noise, and what the events of a
    pair share.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for a, b in ways:
        own = shared * rng.standard_normal()
        for i in range(m):
            late = offset[b] - offset[a] + own + sigma * rng.standard_normal()
            rows.append((step * i, a, b, " and ".join(sorted((a, b))), late))
    table = pd.DataFrame(rows, columns=["time_s", "source", "receiver", "pair", "residual_s"])
    table["predicted_s"] = 1.0
    table["measured_s"] = 1.0 + table["residual_s"]
    table["sigma_s"] = np.nan
    return table.assign(**columns)


BOTH = list(itertools.permutations("ABCD", 2))


def test_clocks_without_noise_are_exact_up_to_their_mean():
    clocks = clock_table(e := events_of(BOTH, 2), e["residual_s"]).set_index("node")
    true = pd.Series(OFFSET)
    np.testing.assert_allclose(clocks["offset_s"], true - true.mean(), rtol=0, atol=1e-15)
    assert clocks["offset_s"].sum() == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_allclose(clocks["standard_error_s"], 0.0, atol=1e-15)
    right = clock_table(e, e["residual_s"], reference="B").set_index("node")
    np.testing.assert_allclose(right["offset_s"], true - OFFSET["B"], rtol=0, atol=1e-15)
    assert right.loc["B", "standard_error_s"] == pytest.approx(0.0, abs=1e-15)


def test_standard_errors_are_those_of_a_complete_network(as_stored):
    """
    Of k nodes with m events each ordered pair: variance sigma^2 (k - 1) / (2 k^2 m), which repeated
    draws have.
    """
    k, m, sigma = 4, 25, 1e-3
    closed = sigma * np.sqrt((k - 1) / (2.0 * k * k * m))
    tables = [
        clock_table(e := events_of(BOTH, m, sigma=sigma, seed=seed), e["residual_s"])
        for seed in range(60)
    ]
    told = np.mean([t["standard_error_s"] for t in tables])
    spread = np.std([t["offset_s"] for t in tables], axis=0).mean()
    assert 1.0 < told / closed < 1.15  # the larger one of two estimates
    assert spread == pytest.approx(closed, rel=0.15)
    as_stored(tables[0])


def test_standard_errors_contain_what_events_of_a_pair_share():
    nodes = {chr(65 + i): 0.0 for i in range(10)}
    ways = list(itertools.combinations(nodes, 2))
    tables = [
        clock_table(
            e := events_of(ways, 20, offset=nodes, sigma=1e-4, shared=1e-3, seed=s), e["residual_s"]
        )
        for s in range(40)
    ]
    spread = np.std([t["offset_s"] for t in tables], axis=0).mean()
    assert np.mean([t["standard_error_s"] for t in tables]) == pytest.approx(spread, rel=0.25)


def test_weights_are_those_of_the_sigmas(as_stored):
    """Two events of one pair: the weighted mean."""
    e = events_of([("A", "B")], 2, residual_s=[0.0, 1e-3], sigma_s=[1.0, 0.5])
    offset = clock_table(e, e["residual_s"]).set_index("node")["offset_s"]
    assert offset["B"] - offset["A"] == pytest.approx(0.8e-3)
    as_stored(clock_table(e, e["residual_s"]))


def test_unconnected_nodes_have_a_mean_each_and_unheard_nodes_none(as_stored):
    e = events_of([("A", "B"), ("C", "D")], 3)
    e.loc[len(e)] = {**e.iloc[0], "source": "E", "receiver": "A", "residual_s": np.nan}
    clocks = clock_table(e, e["residual_s"]).set_index("node")
    assert clocks["group"].nunique() == 3
    for group in ("AB", "CD"):
        assert clocks.loc[list(group), "offset_s"].sum() == pytest.approx(0.0, abs=1e-15)
    assert clocks.loc["B", "offset_s"] == pytest.approx(-2.5e-3)
    assert np.isnan(clocks.loc["E", "offset_s"])
    assert clocks.loc["E", "events"] == 0
    as_stored(clocks)


def test_reciprocity_leaves_what_the_clocks_do_not_explain(as_stored):
    """A current of A to B makes one direction early and the other late."""
    e = events_of(BOTH, 40, sigma=1e-5)
    current = np.where(e["pair"] == "A and B", np.where(e["source"] == "A", -1e-3, 1e-3), 0.0)
    clocks = pd.DataFrame({"node": list(OFFSET), "offset_s": list(OFFSET.values())})
    table = reciprocity_table(e, e["residual_s"] + current, clocks, window=60.0).set_index("pair")
    assert (table["matched"] == 40).all()
    assert table.loc["A and B", "left_s"] == pytest.approx(
        -2e-3, abs=5 * table.loc["A and B", "standard_error_s"]
    )
    assert table.loc["C and D", "mean_s"] == pytest.approx(0.0, abs=1e-5)
    assert np.abs(table["left_s"].drop("A and B")).max() < 1e-5
    far = e.assign(time_s=e["time_s"] + np.where(e["source"] < e["receiver"], 1e5, 0.0))
    apart = reciprocity_table(far, e["residual_s"], clocks, window=60.0)
    assert (apart["matched"] == 0).all()
    assert apart["mean_s"].isna().all()
    as_stored([table, apart])


def test_a_partner_in_time_serves_once(as_stored):
    e = events_of([("A", "B")], 3, time_s=[0.0, 10.0, 21.0], residual_s=[1.0, 2.0, 3.0])
    back = events_of([("B", "A")], 1, time_s=[9.0], residual_s=[0.0])
    both = pd.concat([e, back], ignore_index=True)
    clocks = pd.DataFrame({"node": ["A", "B"], "offset_s": [0.0, 0.0]})
    (row,) = reciprocity_table(both, both["residual_s"], clocks, window=60.0).to_dict("records")
    assert (row["matched"], row["mean_s"]) == (1, 2.0)
    as_stored(row)


def switching_events(stays, m=2000, seed=3, gap=5e-3):
    """
    Events of one way on two candidates, the second of which is taken in a share of 0.3; and all
    candidates.
    """
    rng = np.random.default_rng(seed)
    second = np.zeros(m, dtype=bool)
    for i in range(m):
        second[i] = second[i - 1] if i and rng.random() < stays else rng.random() < 0.3
    e = events_of([("A", "B")], m, offset=dict.fromkeys("AB", 0.0))
    e["measured_s"] = 1.0 + gap * second + 1e-4 * rng.standard_normal(m)
    e["residual_s"] = e["measured_s"] - 1.0
    candidates = pd.DataFrame(
        {
            "event": np.repeat(np.arange(m), 2),
            "travel_time_s": np.tile([1.0, 1.0 + gap], m),
            "loss_db": 70.0,
        }
    )
    return e, candidates, second


@pytest.mark.parametrize("stays", [0.0, 1.0 - 0.065 / 0.42])
def test_switching_is_that_of_the_chain(stays, as_stored):
    e, candidates, second = switching_events(stays)
    rightly = pd.DataFrame({"node": ["A", "B"], "offset_s": [0.0, 0.0]})
    taken = taken_candidates(e, candidates, rightly)
    np.testing.assert_array_equal(taken["taken"].to_numpy(dtype=int), second)
    row = switching_table(e, taken, window=60.0, seed=1).iloc[0]
    error = np.sqrt(0.42 / len(e))
    assert row["independent_rate"] == pytest.approx(0.42, abs=0.05)
    assert row["rate"] == pytest.approx(0.42 * (1.0 - stays), abs=4.0 * error)
    if stays:
        assert row["correlation_s"] == pytest.approx(-45.0 / np.log(stays), rel=0.25)
    else:
        assert row["correlation_s"] < 20.0
    assert switching_table(e, taken, window=10.0, seed=1).iloc[0]["steps"] == 0
    as_stored(row.to_dict())


def test_candidates_too_near_to_be_told_apart_do_not_count():
    e, candidates, _ = switching_events(0.0, gap=2e-4)
    taken = taken_candidates(
        e, candidates, pd.DataFrame({"node": ["A", "B"], "offset_s": [0.0, 0.0]})
    )
    assert switching_table(e, taken, window=60.0, seed=1).iloc[0]["steps"] == 0


def test_clocks_and_candidates_are_found_together(as_stored):
    """
    Later candidates on one direction alone would be a clock to residuals of predicted arrivals.
    """
    e, candidates, second = switching_events(0.9, m=400)
    back = events_of([("B", "A")], 400, offset=dict.fromkeys("AB", 0.0))
    both = pd.concat([e, back], ignore_index=True)
    one = pd.DataFrame({"event": 400 + np.arange(400), "travel_time_s": 1.0, "loss_db": 70.0})
    clocks, taken = fit_clocks(both, pd.concat([candidates, one], ignore_index=True))
    alone = clocks.set_index("node")["predicted_offset_s"]
    assert alone["B"] - alone["A"] == pytest.approx(0.5 * 5e-3 * second.mean(), rel=0.02)
    offset = clocks.set_index("node")["offset_s"]
    assert offset["B"] - offset["A"] == pytest.approx(0.0, abs=2e-5)
    np.testing.assert_array_equal(taken["taken"].to_numpy(dtype=int)[:400], second)
    as_stored([clocks, taken])


def summary_events(values, pair, *, distance=2000.0, status="ok"):
    n = len(values)
    return pd.DataFrame(
        {
            "pair": pair,
            "residual_m": values,
            "status": status,
            "source_depth_m": 30.0,
            "receiver_depth_m": np.linspace(30.0, 500.0, n),
            "distance_m": distance,
        }
    )


@pytest.mark.slow
def test_intervals_draw_pairs_not_events(as_stored):
    """
    Of pairs that share their errors the interval is that of the pairs' medians, whatever the number
    of events.
    """
    rng = np.random.default_rng(0)
    level = rng.standard_normal(12)
    widths = []
    for m in (5, 40):
        values = np.repeat(level, m) + 1e-3 * rng.standard_normal(12 * m)
        row = summary_table(
            summary_events(values, np.repeat([f"p{i}" for i in range(12)], m)), seed=5
        ).iloc[0]
        widths.append(row["median_high_m"] - row["median_low_m"])
        assert row["median_low_m"] < np.median(level) < row["median_high_m"]
    assert widths[1] == pytest.approx(widths[0], rel=0.3)
    assert widths[1] > 0.3
    as_stored(row.to_dict())


def test_intervals_hold_95_percent_of_what_drawing_again_gives():
    """
    The median of n values drawn again from n is at most the k-th with a binomial probability, that
    of n // 2 + 1 draws or more among the first k: so the ends of its 95 % interval are the first
    values at which it reaches 2.5 % and 97.5 %.
    """
    assert percentiles(np.arange(1001.0)[::-1]) == (25.0, 975.0)
    n = 17  # of which the 5 % and the 95 % points are other values
    values = np.sort(np.random.default_rng(1).gamma(2.0, 3.0, n))
    at_most = binom.sf(n // 2, n, np.arange(1, n + 1) / n)
    ends = [values[np.argmax(at_most >= p)] for p in (0.025, 0.975)]
    assert ends != [values[np.argmax(at_most >= p)] for p in (0.05, 0.95)]
    row = summary_table(summary_events(values, np.array([f"p{i}" for i in range(n)])), seed=5).iloc[
        0
    ]
    for name in ("median", "median_size"):
        assert [row[f"{name}_low_m"], row[f"{name}_high_m"]] == pytest.approx(ends)


def test_groups_are_few_whole_and_say_why_nothing_was_predicted(as_stored):
    values = np.where(np.arange(600) % 3 == 0, np.nan, 1.0)
    status = np.where(np.isnan(values), "shadow", "ok")
    e = summary_events(
        values,
        np.repeat(["A and B", "A and C", "B and C"], 200),
        status=status,
        distance=np.linspace(10.0, 9e3, 600),
    )
    table = summary_table(e, seed=1)
    for by, most in (("all", 1), ("pair", 3), ("depths", 12), ("range", 8)):
        part = table[table["by"] == by]
        assert 0 < len(part) <= most
        assert part["events"].sum() == 600
        assert part["shadow"].sum() == 200
        assert (part["events"] == part["predicted"] + part["shadow"]).all()
    assert "weak" not in table
    assert table.loc[0, "median_m"] == 1.0
    assert table.loc[table["by"] == "pair", "median_low_m"].isna().all()
    pd.testing.assert_frame_equal(table, summary_table(e, seed=1))
    as_stored(table)
