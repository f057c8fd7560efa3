"""
Arrivals that are followed by their measured times: as good as the better of persistence and
candidates, from earlier events only, and their tables by horizon.
"""

import numpy as np
import pandas as pd
import pytest

from pymantaray.apps.replay.baselines import baseline_table, horizon_table, last_measured
from pymantaray.apps.replay.event_data import Components
from pymantaray.apps.replay.followed import SAME, follow
from pymantaray.estimation.filters.gauss_markov import CLUTTER

NOISE = 1e-4  # s


def ways(n, gap, rng):
    """Events of two ways in turn, whose distance changes slowly. [s, m]"""
    return pd.DataFrame(
        {
            "time_s": gap * np.arange(n),
            "source": np.where(np.arange(n) % 2, "A", "B"),
            "receiver": np.where(np.arange(n) % 2, "B", "A"),
            "distance_m": 3000.0 + np.cumsum(rng.normal(0.0, 0.2, n)),
        }
    )


def one_candidate(times, sigma):
    n = len(times)
    return Components(np.arange(n), np.asarray(times), np.full(n, sigma), np.ones(n))


def log_density(off, sigma):
    return np.log(1.0 - CLUTTER) - 0.5 * (off / sigma) ** 2 - np.log(np.sqrt(2 * np.pi) * sigma)


@pytest.mark.parametrize("gap", [5.0, 60.0, 2000.0])
def test_constant_errors_of_the_model_do_not_count_after_some_events(gap):
    """Every candidate is 4 ms early; persistence errs by the noise of two measured times."""
    rng = np.random.default_rng(1)
    events = ways(200, gap, rng)
    true = events["distance_m"] / 1440.0
    events["measured_s"] = true + rng.normal(0.0, NOISE, 200)
    found = follow(events, one_candidate(true - 4e-3, 3e-4))
    best = log_density(rng.normal(0.0, np.sqrt(2.0) * NOISE, 100_000), np.sqrt(2.0) * NOISE).mean()
    assert found.log_likelihood[100:].mean() > best - 0.15
    assert (found.modelled[100:] < 0.05).all()


def test_right_candidates_of_a_restless_receiver_keep_their_share():
    """Times are those of one of two candidates at random, which the last one does not tell."""
    rng = np.random.default_rng(2)
    n = 400
    events = ways(n, 60.0, rng)
    place = rng.uniform(-0.05, 0.05, n)  # unknown to persistence
    events["measured_s"] = events["distance_m"] / 1440.0 + place + rng.normal(0.0, NOISE, n)
    model = one_candidate(events["distance_m"] / 1440.0 + place, NOISE)
    found = follow(events, model)
    alone = log_density(events["measured_s"] - model.time, NOISE)
    assert found.log_likelihood[100:].mean() > alone[100:].mean() - 0.03
    assert (found.modelled[200:] > 0.95).all()


def test_an_arrival_that_no_candidate_has_is_followed_again():
    rng = np.random.default_rng(3)
    events = ways(60, 30.0, rng)
    true = events["distance_m"] / 1440.0
    late = np.arange(60) // 2 % 3 == 2  # each third event of a way has a later arrival
    events["measured_s"] = true + 9e-3 * late + rng.normal(0.0, NOISE, 60)
    found = follow(events, one_candidate(true, 3e-4))
    last = found.arrivals[found.arrivals["event"] >= 50]
    for event, rows in last.groupby("event"):
        off = np.abs(rows["travel_time_s"] - true[event] - 9e-3)
        assert off.min() < SAME
        assert rows["probability"].sum() + found.modelled[event] == pytest.approx(1.0)


def test_a_way_without_its_candidate_is_followed_by_itself():
    """Four ways have their candidate; a fifth one has for a while an arrival that no draw has."""
    rng = np.random.default_rng(5)
    n = 600
    senders = np.array(list("ABCDE"))[np.arange(n) % 5]
    events = ways(n, 15.0, rng).assign(source=senders, receiver="F")
    true = events["distance_m"] / 1440.0
    late = (events["source"] == "E") & (np.arange(n) > 200) & (np.arange(n) % 200 > 100)
    events["measured_s"] = true + 3e-3 * late + rng.normal(0.0, NOISE, n)
    found = follow(events, one_candidate(true, 1.5 * NOISE))
    again = late & late.shift(5, fill_value=False) & (np.arange(n) > 400)
    assert again.sum() > 15
    assert (found.modelled[again] < 0.4).all()
    usual = (events["source"] != "E") & (np.arange(n) > 400)
    assert (found.modelled[usual] > 0.6).all()


def test_predictions_use_earlier_events_of_any_order_of_rows():
    rng = np.random.default_rng(4)
    events = ways(80, 40.0, rng)
    events["measured_s"] = events["distance_m"] / 1440.0 + rng.normal(0.0, 1e-3, 80)
    model = one_candidate(events["distance_m"] / 1440.0, 1e-3)
    before = follow(events, model)
    changed = events.assign(
        measured_s=events["measured_s"] + np.where(np.arange(80) > 50, 0.01, 0.0)
    )
    after = follow(changed, model)
    np.testing.assert_array_equal(after.modelled[:52], before.modelled[:52])
    np.testing.assert_array_equal(after.log_likelihood[:51], before.log_likelihood[:51])
    turned = events.iloc[::-1].reset_index(drop=True)
    mirrored = follow(turned, one_candidate(model.time[::-1], 1e-3))
    np.testing.assert_array_equal(mirrored.log_likelihood[::-1], before.log_likelihood)


def test_the_last_time_of_the_way_is_scaled_by_the_distance():
    events = pd.DataFrame(
        {
            "time_s": [100.0, 0.0, 130.0, 160.0, 190.0],
            "source": ["A", "A", "B", "A", "C"],
            "receiver": ["B", "B", "A", "B", "C"],
            "distance_m": [1510.0, 1500.0, 1510.0, 1520.0, 0.0],
            "measured_s": [1.05, 1.0, 1.2, 1.01, 0.1],
        }
    )
    last = last_measured(events)
    np.testing.assert_array_equal(last["elapsed_s"], [100.0, np.inf, np.inf, 60.0, np.inf])
    expected = [1.0 * 1510.0 / 1500.0, np.nan, np.nan, 1.05 * 1520.0 / 1510.0, np.nan]
    np.testing.assert_allclose(last["predicted_s"], expected)


def test_errors_are_listed_by_the_time_since_the_last_event():
    n = 8
    time = np.cumsum([0.0, 10.0, 20.0, 30.0, 100.0, 700.0, 4000.0, 19.9])
    events = pd.DataFrame(
        {
            "time_s": time,
            "source": "A",
            "receiver": "B",
            "pair": "A and B",
            "source_depth_m": 30.0,
            "receiver_depth_m": 60.0,
            "distance_m": 1500.0,
            "measured_s": 1.0 + 1e-3 * np.arange(n),
            "residual_s": 1e-4 * np.arange(n),
            "residual_m": 0.15 * np.arange(n),
        }
    )
    table = horizon_table(events).set_index("since_last")
    assert table["events"].to_dict() == {
        "all": 8,
        "below 20 s": 2,
        "20 to 60 s": 2,
        "1 to 10 min": 1,
        "10 to 60 min": 1,
        "above 1 h": 1,
        "first of a way": 1,
    }
    np.testing.assert_allclose(table.loc["10 to 60 min", "median_size_m"], 0.75)
    assert np.isinf(table.loc["first of a way", "last_median_m"])
    np.testing.assert_allclose(table.loc["below 20 s", "last_q90_m"], 1.5)
    baselines = baseline_table(events).set_index("prediction")
    assert baselines.loc["last measured time of the way", "predicted"] == n - 1
